"""What the header of an accelerogram states: its units, its time step, and what was recorded.

A header is prose by many hands. A unit in it is understood as a whole or not at all, so that G/10
is never taken for g; what is stated and not known is refused by name. Runs of blanks are made one
blank before anything is searched for, and no pattern tries a character more than a few times: a
header is read in a time proportional to its length, whatever it holds.
"""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Iterator, Sequence
from typing import NamedTuple

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
}
SECONDS = {"s": 1.0, "ms": 0.001}
NUMBER = r"[-+]?(?:[0-9]++(?:\.[0-9]*+)?+|\.[0-9]++)(?:[EeDd][-+]?[0-9]{1,4}+(?![0-9]))?+"
"""A pattern of a decimal number, also with Fortran's D for its exponent, of at most four digits."""


class MisreadError(ValueError):
    """What is wrong with a file, or with the line of it that is numbered."""

    def __init__(self, line: int | None, says: str) -> None:
        super().__init__(says)
        self.line = line


class Line(NamedTuple):
    """A line that is not blank, and its number from 1 on."""

    number: int
    text: str


def _set(words: str) -> frozenset[str]:
    return frozenset(words.split())


# --- units as they are written ------------------------------------------------------------------

_METRE, _SECOND, _PER = "met(?:er|re)s?", "(?:seconds?|secs?|s)", "(?: ?/ ?| per )"
_SQUARED = r"(?: ?(?:\^|\*\*)? ?2| squared)"
_UNIT = re.compile(
    f"(?:(?:(?P<mm>milli-?{_METRE}|mm)|(?P<cm>centi-?{_METRE}|cm)|(?P<m>{_METRE}|m)"
    "|(?P<ft>feet|foot|ft)|(?P<in>inch(?:es)?|in))"
    f"(?:{_PER}{_SECOND}{_PER}{_SECOND}"
    rf"|{_PER}(?:{_SECOND}{_SQUARED}|\({_SECOND}{_SQUARED}\))"
    rf"|[ .*_]?{_SECOND} ?(?:\^|\*\*)? ?(?:-2|\(-2\))"
    "|p?s2|_(?:per_)?s_?2)"  # as in the names of columns acc_ms2, acc_m_s2
    "|(?P<gal>gals?)|(?P<mg>(?:m|milli[ -]?)g(?:'?s)?)|(?P<g>g(?:'?s)?))(?![^\\W_])",
    re.I,
)
_LONE_UNIT = re.compile(rf"(?<![\w/^*.-]){_UNIT.pattern}", re.I)
_TIME_UNIT = re.compile(
    "(?:(?P<ms>milliseconds?|msecs?|ms)|(?P<s>seconds?|secs?|s))(?![^\\W_])", re.I
)
_GOES_ON = re.compile(r" ?[/*^%×]| x (?=[0-9])|['_+-](?=\w)", re.I)
_UNIT_WORDS = _set(  # of units that are not known here, or are no acceleration's
    "count counts digit digits bit bits lsb volt volts mv uv percent milli micro centi ug mgal "
    "mgals milligal milligals nm um km kine si mks cgs g gs mg gal gals mm cm meter meters metre "
    "metres inch inches ft feet kg cg dg yd dm"
)
_RATIO = re.compile(
    r"[^\W\d_] ?/ ?\(?(?:(?:s|ms|sec|min|h|hr|hour)(?![^\W\d_])|[^\W\d_]++ ?\^?-?[234](?!\w))",
    re.I,
)
_NO_UNITS = _set(  # what brackets after "acceleration" may hold
    "n s e w ns ew ud nw ne sw se x y z h t up down north south east west horizontal vertical "
    "longitudinal transverse component time history series corrected uncorrected filtered "
    "unfiltered processed"
)
_WORD = re.compile(r"[^\W\d_]++")
_SAME_SIGN = str.maketrans({"−": "-", "∕": "/", "⁄": "/", "·": ".", "⋅": ".", "’": "'"})


def plain(text: str) -> str:
    """A line with single blanks between its words and simple signs: ² is 2."""
    return " ".join(unicodedata.normalize("NFKC", text).translate(_SAME_SIGN).split())


def shown(text: str) -> str:
    """A text as a message has it: its beginning, if it is long."""
    return repr(text if len(text) <= 60 else text[:57] + "...")


def _known(pattern: re.Pattern[str], text: str, at: int = 0) -> tuple[str, int] | None:
    """The unit that starts there and its end; none if more belongs to it, as in g/10."""
    match = pattern.match(text, at)
    if not match or _GOES_ON.match(text, match.end()):
        return None
    name = str(match.lastgroup)
    return name if name in {"g", "mg", "gal", "s", "ms"} else f"{name}/s2", match.end()


def _whole(pattern: re.Pattern[str], text: str) -> str | None:
    """The unit that a text is, as a whole."""
    found = _known(pattern, text)
    return found[0] if found and not text[found[1] :].strip(" .") else None


def _words(text: str) -> list[str]:
    return [word.lower() for word in _WORD.findall(text)]


def _looks_like_unit(text: str) -> bool:
    """Whether a text that is no known unit is still one: g/10, % g, counts, mm/min2, yd/s2."""
    words = _words(text)
    if not words or set(words) <= _NO_UNITS:
        return "%" in text
    ends = {words[0], words[-1]}
    return "%" in text or bool((ends & _UNIT_WORDS and len(words) <= 4) or _RATIO.search(text))


# --- the units of the accelerations -------------------------------------------------------------

_ACCELERATION = re.compile(
    r"(?<![^\W_])(?:(?:acc(?:el(?!ero)[^\W\d_]*+|n|s)?|acel(?!ero)[^\W\d_]*+)(?![^\W_])\.?"
    r"|amplitudes?(?![^\W_])|ag?(?= ?[(\[]))"
    r"(?: (?:time|history|series|data|values?|record|trace|ordinates?)\b){0,3}",
    re.I,
)
_UNITS = re.compile(r"units?(?![^\W\d])", re.I)
_OF = re.compile(r" ?(?:(?:of|is|are|the)\b|in(?= )|[:=(\[])", re.I)
_IN = re.compile(r"\bin ", re.I)
_SEPARATOR = re.compile(r"(?:[,;:=/]|(?:is|are)\b) ?", re.I)
_TIME_IN = re.compile(r"\btimes? (?:is |are )?in ", re.I)
_AND = re.compile(r" ?(?:[,;&]|\band\b) ?", re.I)
_LATER = re.compile(r"(?:\b(?:are|is|in|of)\b|[:=]) ?", re.I)
_UNIT_AHEAD = re.compile(r"\bin ((?:(?! in ).){1,20}) $", re.I)
_SENTENCE = re.compile(r"(?:[^.;|]|\.(?! |$)){0,80}+")
_SEGMENT = re.compile(r"(?:(?! in )[^,;:()\[\]|]){0,40}+", re.I)
_BRACKET = re.compile(r"[(\[]([^()\[\]]{0,40}+(?:\([^()\[\]]{0,9}+\)[^()\[\]]{0,9}+)?+)")
_VALUE = re.compile(rf"{NUMBER} ?[^\W\d_]", re.I)
_A_NUMBER = re.compile(rf"{NUMBER} ?")
_DIVIDED = re.compile(r"[)\]] ?[/*]")
_NAME = re.compile(r"[-_]([\w/^*-]{1,40}+)")
_SERIES = re.compile(r"\b(?:history|series|data|values?|amplitudes?)\b", re.I)
_EXTREME = re.compile(r"(?<![^\W_])(?:peak|pk|max|maximum|min|minimum|pg[avd]|rms)(?![^\W_])", re.I)
_SCALE = re.compile(
    r"\b(?:counts?|(?:scale|scaling|calibration|conversion) ?factor|sensitivity|multiplier|lsb)\b",
    re.I,
)
_TIMES = _set("t time times temps zeit tiempo tempo s sec seconds ms")
_INSTRUMENTS = _set("recorder recording instrument sensor housing power plant")
_OTHER_QUANTITIES = _set(
    "vel velocity disp displacement jerk arias husid cav intensity energy sa sv sd psa psv psd "
    "spectral spectrum spectra response fourier drift strain stress force moment rotation "
    "pressure temperature voltage depth length distance altitude elevation height frequency "
    "period angle coordinate coordinates magnitude"
)


def stated_units(header: Sequence[Line]) -> dict[str, int]:
    """The units that a header states, each with its line: of accelerations, of times, or of both.

    Raises
    ------
    MisreadError
        If it states units that are not known, or two that differ, or speaks of counts or a scale
        factor and states no units.
    """
    lines = [Line(number, plain(text)) for number, text in header]
    found = [(unit, line.number) for line in lines for unit in _units_of_line(line)]
    if not any(unit in UNITS for unit, _ in found):
        found += [(unit, line.number) for line in lines for unit in _units_in_passing(line.text)]
    stated: dict[str, int] = {}
    for unit, number in found:
        state(stated, unit, number)
    if acceleration_unit(stated):
        return stated
    for number, text in lines:
        if scale := _SCALE.search(text):
            rule = "must state what its values are in: this scale is not understood"
            raise MisreadError(number, f"a header that speaks of {scale[0]!r} {rule}")
    return stated


def state(stated: dict[str, int], unit: str, line: int) -> None:
    """Add a unit to those stated; a ``MisreadError`` if another of the same quantity is."""
    sizes = UNITS if unit in UNITS else SECONDS
    for other in stated:
        if other in sizes and sizes[other] != sizes[unit]:
            raise MisreadError(line, f"the header states both {other!r} and {unit!r}")
    stated.setdefault(unit, line)


def acceleration_unit(stated: dict[str, int]) -> str | None:
    """The unit of accelerations among those stated."""
    return next((unit for unit in stated if unit in UNITS), None)


def time_unit(stated: dict[str, int]) -> str | None:
    """The unit of times among those stated."""
    return next((unit for unit in stated if unit in SECONDS), None)


def _unknown(number: int, text: str) -> MisreadError:
    rule = f"must be one of the known ones: {', '.join(UNITS)}"
    return MisreadError(number, f"the header's units = {shown(text.strip(' .:'))} {rule}")


def _units_of_line(line: Line) -> Iterator[str]:
    number, text = line
    for match in _TIME_IN.finditer(text):
        if found := _known(_TIME_UNIT, text, match.end()):
            yield found[0]
    for match in _UNITS.finditer(text):
        yield from _after_units(number, text, match)
    if extreme := _EXTREME.search(text):  # the units that follow are that value's
        text = text[: extreme.start()]
    begin = series.end() if (series := _SERIES.search(text)) else len(text)
    for match in _ACCELERATION.finditer(text):
        begin = min(begin, match.end())
        yield from _after_acceleration(number, text, match.end())
    for match in _IN.finditer(text, begin):
        yield from _after_in(number, text, match.end())
    for match in _BRACKET.finditer(text):
        if set(_words_before(text, match.start())[-1:]) & (_OTHER_QUANTITIES | _TIMES):
            continue
        inside, unit = _inside(match), _whole(_UNIT, _inside(match))
        of_acceleration = match.start() >= begin and _looks_like_unit(inside)
        if unit and not _DIVIDED.match(text, match.end()):
            yield unit
        elif unit or _goes_on(inside) or (of_acceleration and not _whole(_TIME_UNIT, inside)):
            raise _unknown(number, text[match.start() : match.end() + 10])


def _after_units(number: int, text: str, match: re.Match[str]) -> Iterator[str]:
    """What "units" is followed by: "of g", "are sec and g", ": cm/s/s", "of uncor accel is g"."""
    if set(_words_before(text, match.start())[-2:]) & (_OTHER_QUANTITIES | _INSTRUMENTS):
        return
    at = match.end()
    while connector := _OF.match(text, at):
        at = connector.end()
    stated = at > match.end()
    sentence = str(_SENTENCE.match(text, at + (text[at : at + 1] == " "))[0])  # type: ignore[index]
    for start in (0, *(later.end() for later in _LATER.finditer(sentence))):
        if set(_words(sentence[:start])) & _OTHER_QUANTITIES:
            return
        if re.search("[0-9%]|percent", sentence[:start], re.I):
            break
        if units := _listed(sentence, start):
            yield from units
            return
    if not stated and (
        ahead := _UNIT_AHEAD.search(text[max(0, match.start() - 30) : match.start()])
    ):
        if unit := _whole(_UNIT, ahead[1]):
            yield unit
        elif _looks_like_unit(ahead[1]) or _goes_on(ahead[1]):
            raise _unknown(number, ahead[1])
        return
    is_one = match[0][-1:] not in "sS"  # "unit 3" is a building
    if (stated and not (is_one and sentence[:1].isdigit())) or _looks_like_unit(sentence):
        raise _unknown(number, sentence)


def _listed(text: str, at: int) -> list[str]:
    """The units of a list such as "sec and g"; empty if one of them is not known."""
    units = []
    while found := _known(_UNIT, text, at) or _known(_TIME_UNIT, text, at):
        units.append(found[0])
        if not (conjunction := _AND.match(text, found[1])):
            return units
        at = conjunction.end()
    unknown = _goes_on(text, at) or _looks_like_unit(text[at : at + 12])
    return [] if unknown or not any(unit in UNITS for unit in units) else units


def _after_acceleration(number: int, text: str, at: int) -> Iterator[str]:
    if name := _NAME.match(text, at):  # acc_g, acc_cm_s2; but also acc_ns, acceleration-time
        if unit := _whole(_UNIT, name[1]):
            yield unit
        elif _goes_on(name[1]) or _looks_like_unit(name[1]):
            raise _unknown(number, name[1])
        return
    at += text[at : at + 1] == " "
    if bracket := _BRACKET.match(text, at):
        inside = _inside(bracket)
        words = set(_words(inside))
        if not (_whole(_UNIT, inside) or _UNITS.search(inside) or words <= _NO_UNITS) and (
            len(words) == 1 or _looks_like_unit(inside) or _value_of_unit(inside)
        ):
            raise _unknown(number, inside)
        return
    if separator := _SEPARATOR.match(text, at):
        at = separator.end()
    if not (_IN.match(text, at) or _VALUE.match(text, at)):
        yield from _after_in(number, text, at)


def _after_in(number: int, text: str, at: int) -> Iterator[str]:
    """Units, where there may be words as well: "in g", "in the north-south direction"."""
    if _UNITS.match(text, at) or _BRACKET.match(text, at):
        return
    segment = str(_SEGMENT.match(text, at)[0])  # type: ignore[index]
    if found := _known(_UNIT, text, at):
        yield found[0]
    elif _goes_on(segment) or _looks_like_unit(segment) or _value_of_unit(segment):
        raise _unknown(number, segment)


def _units_in_passing(text: str) -> Iterator[str]:
    """Units that only an acceleration has, anywhere in a line, but not those of a value."""
    if extreme := _EXTREME.search(text):
        text = text[: extreme.start()]
    for match in _LONE_UNIT.finditer(text):
        before = text[max(0, match.start() - 4) : match.start()].rstrip().lower()
        found = _known(_UNIT, text, match.start())
        if not found or before.endswith(tuple("0123456789=")):
            continue
        if found[0].endswith("/s2") or (found[0] == "gal" and before.endswith(" in")):
            yield found[0]


def _inside(bracket: re.Match[str]) -> str:
    inside = bracket[1].strip()
    return inside[3:] if inside[:3].lower() == "in " else inside


def _goes_on(text: str, at: int = 0) -> bool:
    """Whether a known unit is the beginning of another one, as g is of g/10."""
    match = _UNIT.match(text, at)
    return bool(match and _GOES_ON.match(text, match.end()))


def _value_of_unit(text: str) -> bool:
    """Whether a text is a number of known units, as 0.01 m/s2 is."""
    number = _A_NUMBER.match(text)
    return number is not None and _UNIT.match(text, number.end()) is not None


def _words_before(text: str, at: int) -> list[str]:
    return _words(text[max(0, at - 30) : at])


# --- what was recorded, and the columns ---------------------------------------------------------

_OTHER_HISTORY = re.compile(
    r"\b(?:(vel|velocity|disp|displacement) ?(?:time\b|history|series|in\b|[(\[]|$)"
    r"|(intensity|energy|spectrum) ?(?:time\b|history|series))",
    re.I,
)
_NOT_OTHER = re.compile(r"\b(?:acc|peak|max)", re.I)
_CELL = re.compile(r"[^\s(\[]++(?: ?[(\[][^()\[\]]{0,40}+[)\]])?+")
_NO_TIMES = _set(
    "period periods tn frequency frequencies freq f hz distance index no number n i k id point "
    "points sample samples count step steps"
)
_COMPONENTS = (
    _NO_UNITS
    | _TIMES
    | _set("v u d acc accel acceleration hor ver comp ch chan channel canal long lat tran trans")
)


def require_acceleration(header: Sequence[Line]) -> None:
    """Refuse the header of a history of something else.

    Raises
    ------
    MisreadError
        If a line says that it is one of velocity, displacement, intensity or energy.
    """
    for number, raw in header:
        text = plain(raw)
        if not _NOT_OTHER.search(text) and (other := _OTHER_HISTORY.search(text)):
            says = f"the header says {(other[1] or other[2]).lower()}"
            raise MisreadError(number, f"must be an acceleration history, but {says}")


def read_column_names(header: Sequence[Line], stated: dict[str, int]) -> None:
    """Check the names of two columns, and add their units to those stated.

    The names are the last line of words in the header, or the last but one above one of units.

    Raises
    ------
    MisreadError
        If the first column is not time, or the second not acceleration, or if they are in units
        that are not known or not those stated.
    """
    for number, raw in [line for line in header if _WORD.search(line.text)][-2:]:
        cells = _column_names(raw)
        if len(cells) != 2 or not (first := _words(cells[0])) or not _words(cells[1]):
            continue
        if first[0] in _NO_TIMES:
            says = f"the first column must be times, but the header says {first[0]}"
            raise MisreadError(number, says)
        if first[0] not in _TIMES:
            continue
        if others := [word for word in _words(cells[1]) if word in _OTHER_QUANTITIES]:
            says = f"must be an acceleration history, but the header says {others[0]}"
            raise MisreadError(number, says)
        for cell, pattern, known in zip(cells, (_TIME_UNIT, _UNIT), (SECONDS, UNITS), strict=True):
            if unit := _unit_of_cell(number, cell, pattern, known):
                state(stated, unit, number)


def names_columns(header: Sequence[Line], row: str, width: int) -> int | None:
    """The line, of the last two of words, that names as many columns as a row has, if one does.

    It has the row's own separators, or nothing but names of directions and channels.
    """
    for number, raw in [line for line in header if _WORD.search(line.text)][-2:]:
        cells = _column_names(raw)
        if len(cells) != width or not all(_WORD.search(cell) for cell in cells):
            continue
        separated = any(mark in row and mark in raw for mark in ",;\t")
        if separated or all(set(_words(cell)) <= _COMPONENTS for cell in cells):
            return number
    return None


def _column_names(raw: str) -> list[str]:
    text = raw.lstrip("#%/ \t").rstrip(",; \t")
    for separator in ";,\t":
        if separator in text:
            return [plain(cell) for cell in text.split(separator)]
    return _CELL.findall(plain(text))


def _unit_of_cell(
    number: int, cell: str, pattern: re.Pattern[str], known: dict[str, float]
) -> str | None:
    """The unit of a column: in brackets, after an underscore or a slash, or its whole name."""
    if unit := _whole(pattern, cell):
        return unit
    if bracket := _BRACKET.search(cell):
        inside = _inside(bracket)
        if (unit := _whole(pattern, inside)) or set(_words(inside)) <= _NO_UNITS - {"h"}:
            return unit
    else:
        inside = re.split("_|/| in ", cell, maxsplit=1, flags=re.I)[-1]
        begins = _words(cell)[0] in _UNIT_WORDS | {"m"} or _goes_on(cell) or _value_of_unit(cell)
        if not begins and (unit := _whole(pattern, inside)):
            return unit
        if begins or inside == cell or (pattern is _UNIT and _RATIO.search(cell)):
            inside = cell
        if not (begins or _looks_like_unit(inside) or _words(inside)[:1] == ["min"]):
            return None
    rule = f"must be one of the known ones: {', '.join(known)}"
    raise MisreadError(number, f"the column's units = {shown(inside)} {rule}")


# --- NPTS and DT --------------------------------------------------------------------------------

_NPTS = re.compile(r"\bNPTS\b", re.I)
_STATES = re.compile(rf" ?[=:]? ?({NUMBER})", re.I)
_DT = re.compile(r"\bDT\b", re.I)
_NPTS_BEHIND = re.compile(rf"({NUMBER})[ ,]{{1,3}}({NUMBER})[ ,]{{1,3}}NPTS\b", re.I)
_DT_UNIT = re.compile(r"[ ,]{0,2}[(\[]? ?([^\W\d_]++)(?! ?[=:])", re.I)


def states_npts(text: str) -> bool:
    """Whether a line has the word NPTS, as the header of PEER's AT2 files has."""
    return _NPTS.search(text) is not None


def npts_and_dt(line: Line) -> tuple[int, float]:
    """The number of values and the time step, in s, that a line states.

    Raises
    ------
    MisreadError
        If it states no numbers for them or not positive ones, or a unit of time that is not known.
    """
    text = plain(line.text)
    if behind := _NPTS_BEHIND.match(text):
        npts, dt = behind[1], behind[2]
        after = match.end() if (match := _DT.search(text, behind.end())) else behind.end()
    else:
        first, after_npts = _stated(_NPTS, text, 0, "")
        second, after = _stated(_DT, text, after_npts, "sm")
        if not (first and second):
            raise MisreadError(line.number, f"{shown(text)} must state numbers for NPTS and DT")
        npts, dt = first, second
    count, step = to_float(npts), to_float(dt)
    if not (0 < count < math.inf and count.is_integer()):
        raise MisreadError(line.number, f"NPTS = {npts} must be a positive whole number")
    if not 0 < step < math.inf:
        raise MisreadError(line.number, f"DT = {dt} must be positive and finite")
    unit = _DT_UNIT.match(text, after)
    if not unit:
        return int(count), step
    known = _whole(_TIME_UNIT, unit[1])
    alone = not text[unit.end() :].strip(" ,.;)]")
    if not known and (alone or unit[1].lower() in {"min", "minutes", "hz", "h", "us"}):
        raise MisreadError(line.number, f"DT = {dt} {unit[1]}: its unit must be s or ms")
    return int(count), step * SECONDS[known or "s"]


def _stated(name: re.Pattern[str], text: str, begin: int, units: str) -> tuple[str, int]:
    """The number after a name, and its end; "" if none of that name has one."""
    for match in name.finditer(text, begin):
        number = _STATES.match(text, match.end())
        if number and (text[number.end() :][:1].lower() or " ") in " ,;" + units:
            return number[1], number.end()
    return "", len(text)


def to_float(number: str) -> float:
    """The value of a number as printed."""
    return float(number.upper().replace("D", "E"))
