"""Units in texts, which are understood as a whole or not at all."""

from __future__ import annotations

import re

from jaxpound.ground.formats.text import NUMBER, MisreadError, set_of
from jaxpound.quantities import STANDARD_GRAVITY

UNITS = {  # in m/s2
    "g": STANDARD_GRAVITY,
    "m/s2": 1.0,
    "cm/s2": 0.01,
    "gal": 0.01,
    "ft/s2": 0.3048,
    "in/s2": 0.0254,
    "mm/s2": 0.001,
    "mg": 0.001 * STANDARD_GRAVITY,
    "g/10": 0.1 * STANDARD_GRAVITY,  # of digitised films
}
SECONDS = {"s": 1.0, "ms": 0.001}
_METRE, _SECOND, _PER = "met(?:er|re)s?", "(?:seconds?|secs?|segs?|sn|s)", "(?: ?/ ?| per )"
_SQUARED = r"(?: ?(?:\^|\*\*)? ?[2²]| squared)"
UNIT = re.compile(
    f"(?:(?:(?P<mm>milli-?{_METRE}|mm)|(?P<cm>centi-?{_METRE}|cm)|(?P<m>{_METRE}|m)"
    "|(?P<ft>feet|foot|ft)|(?P<in>inch(?:es)?|in))"
    f"(?:{_PER}{_SECOND}{_PER}{_SECOND}"
    rf"|{_PER}(?:{_SECOND}{_SQUARED}|\({_SECOND}{_SQUARED}\))"
    rf"|[ .*_]?{_SECOND} ?(?:\^|\*\*)? ?(?:-2|\(-2\))"
    "|p?s2|_(?:per_)?s_?2)"  # as in the names of columns acc_ms2, acc_m_s2
    "|(?P<gal>gal(?:e?s)?)|(?P<mg>(?:m|milli[ -]?)g(?:'?s)?)|(?P<tenth>g ?/ ?10)|(?P<g>g(?:'?s)?))"
    "(?![^\\W_])",
    re.I,
)
LONE_UNIT = re.compile(rf"(?<![\w/^*.-]){UNIT.pattern}", re.I)
TIME_UNIT = re.compile(
    "(?:(?P<ms>milliseconds?|msecs?|ms)|(?P<s>seconds?|secs?|s))(?![^\\W_])", re.I
)
_GOES_ON = re.compile(r" ?[/*^%×]| x (?=[0-9])|['_+-](?=\w)", re.I)
UNIT_WORDS = set_of(  # words of unknown units, and of units of other quantities
    "count counts digit digits bit bits lsb volt volts mv uv percent milli micro centi ug mgal "
    "mgals milligal milligals nm um km kine si mks cgs g gs mg gal gals mm cm meter meters metre "
    "metres inch inches ft feet kg cg dg yd dm"
)
RATIO = re.compile(
    r"[^\W\d_] ?/ ?\(?(?:(?:s|ms|sec|min|h|hr|hour)(?![^\W\d_])|[^\W\d_]++ ?\^?-?[234](?!\w))", re.I
)
NO_UNITS = set_of(  # what brackets after "acceleration" may hold
    "n s e w ns ew ud nw ne sw se x y z h t up down north south east west horizontal vertical "
    "longitudinal transverse component time history series corrected uncorrected filtered "
    "unfiltered processed"
)
WORD = re.compile(r"[^\W\d_]++")


def match_unit(text: str, at: int = 0, pattern: re.Pattern[str] = UNIT) -> tuple[str, int] | None:
    """The known unit that starts at an index, and its end; None if it continues, as in g/10."""
    match = pattern.match(text, at)
    if not match or _GOES_ON.match(text, match.end()):
        return None
    name = str(match.lastgroup).replace("tenth", "g/10")
    return name if name in {"g", "g/10", "mg", "gal", "s", "ms"} else f"{name}/s2", match.end()


def whole_unit(text: str, pattern: re.Pattern[str] = UNIT) -> str | None:
    """The unit, if the whole text is one."""
    unit_and_end = match_unit(text, 0, pattern)
    return unit_and_end[0] if unit_and_end and not text[unit_and_end[1] :].strip(" .") else None


def words_of(text: str) -> list[str]:
    """The words of a text, in lower case."""
    return [word.lower() for word in WORD.findall(text)]


def looks_like_unit(text: str) -> bool:
    """Whether a text looks like an unknown unit: g/100, % g, counts, mm/min2, yd/s2."""
    words = words_of(text)
    if not words or set(words) <= NO_UNITS:
        return "%" in text
    ends = {words[0], words[-1]}
    return "%" in text or bool((ends & UNIT_WORDS and len(words) <= 4) or RATIO.search(text))


BRACKET = re.compile(r"[(\[]([^()\[\]]{0,40}+(?:\([^()\[\]]{0,9}+\)[^()\[\]]{0,9}+)?+)")
_A_NUMBER = re.compile(rf"{NUMBER} ?")
TIMES = set_of("t time times timestamp datetime temps zeit tiempo tempo zaman s sec seconds ms")
OTHER_HISTORIES = set_of(
    "vel velocity velocidad velocita velocità vitesse geschwindigkeit hız hiz disp displacement "
    "desplazamiento déplacement deplacement verschiebung weg spostamento deplasman yerdeğiştirme"
)
OTHER_QUANTITIES = OTHER_HISTORIES | set_of(
    "espectral spektralbeschleunigung jerk arias husid cav intensity energy sa sv sd psa psv psd "
    "spectral spectrum spectra response fourier drift strain stress force moment rotation "
    "pressure temperature voltage depth length distance altitude elevation height frequency "
    "period angle coordinate coordinates magnitude"
)


def state(stated: dict[str, int], unit: str, line: int) -> None:
    """Add a unit to those stated; a ``MisreadError`` if they have another one of its quantity."""
    sizes = UNITS if unit in UNITS else SECONDS
    if (other := stated_among(stated, sizes)) and sizes[other] != sizes[unit]:
        raise MisreadError(line, f"the header states both {other!r} and {unit!r}")
    stated.setdefault(unit, line)


def stated_among(stated: dict[str, int], sizes: dict[str, float]) -> str | None:
    """The unit of accelerations (``UNITS``) or times (``SECONDS``) among those stated."""
    return next((unit for unit in stated if unit in sizes), None)


def inside_of(bracket: re.Match[str]) -> str:
    """The text inside a bracket: g of (in g)."""
    inside = bracket[1].strip()
    return inside[3:] if inside[:3].lower() == "in " else inside


def goes_on(text: str, at: int = 0) -> bool:
    """Whether a known unit begins another one, as g begins g/100."""
    match = UNIT.match(text, at)
    return bool(match and _GOES_ON.match(text, match.end()))


def is_value_of_unit(text: str) -> bool:
    """Whether a text is a number of known units, such as 0.01 m/s2."""
    number = _A_NUMBER.match(text)
    return number is not None and UNIT.match(text, number.end()) is not None
