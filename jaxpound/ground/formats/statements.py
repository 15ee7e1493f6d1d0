"""The number of samples and the sampling interval that a header states in prose.

The words are those of the networks: English, Spanish, Italian, German, French and Turkish.
"""

from __future__ import annotations

import dataclasses
import math
import re
import unicodedata
from collections.abc import Iterator, Sequence
from decimal import Decimal
from typing import NamedTuple

from jaxpound.ground.formats.text import NUMBER, MisreadError, TextLine, plain, to_float, with_e

_POINTS = (
    "(?:data(?: points)?|datos|dati|points?|pts|samples?|muestras|puntos|punti|campioni|values"
    "|valores|valeurs|echantillons|readings|lines|ordinates|veri)"
)
_NUMBER_OF = r"(?:n[a-z]{0,7}|cantidad)\.?(?: total)? ?(?:of|de|di|degli|d')? ?(?:acc[a-z]{0,10} )?"
_NOT_A_RATE = "(?! ?(?:/|per|por|al|a) ?s|[a-z])"
_COUNT = re.compile(
    rf"\b(?:{_NUMBER_OF}{_POINTS}|npts|ndata|num\. total de muestras|(?:veri|ornek|nokta) sayisi"
    r"|anzahl(?: der)? (?:[a-z]*werte|[a-z]*punkte|samples)"
    rf"|(?:{_POINTS}|n|(?:sample )?count)(?= ?[:=]))(?: p[eo]r ch?an[a-z]*)?{_NOT_A_RATE}"
)
_COUNT_BEHIND = re.compile(
    r"(?:^|(?<![\w.+/-])(?=[0-9]{3}))([0-9]{1,3}\.[0-9]{3}|[0-9]+),? (?:(?:raw|uncorrected|"
    rf"corrected|acc[a-z]*\.?) ){{0,2}}{_POINTS}{_NOT_A_RATE}"
)
_INTERVAL = re.compile(
    r"\b(?:(?:sampling|sample|time|digiti[sz]ation)[ -]?(?:interval|step|period|increment|spacing)"
    r"|(?:intervalo|paso|periodo) (?:de muestreo|de tiempo)|passo (?:di campionamento|temporale)"
    r"|intervallo di campionamento|abtast(?:intervall|schritt)|zeit(?:schritt|intervall|inkrement)"
    r"|schrittweite|pas d(?:e temps|'echantillonnage)|ornekleme araligi|delta ?t|dt|sampled every"
    r"|(?:interval|intervalle|intervalo|delta)(?= ?[:=])|(?:equally[- ]spaced )?(?:at )?intervals "
    r"of|(?:equally|evenly)[- ]spaced at)\b"
)
_RATE = re.compile(
    r"\b(?:(?:sampl[a-z]*|data) ?(?:rate|freq[a-z]*)|(?:sampling|muestreo|fs)(?= ?[:=])|samples per"
    r" sec[a-z]*|(?:tasa|vel\.|velocidad|frecuencia) de muestreo|frequenza di campionamento|abtast"
    r"(?:rate|frequenz)|frequence d'echantillonnage|ornekleme (?:hizi|frekansi|orani))(?![a-z])"
)
_PER_SECOND = "(?:sps|hz|(?:samples?|muestras|points?|pts) ?(?:/|per|por) ?s[a-z]*)"
_SECONDS = "(?:sec[a-z]*|s|sn|seg[a-z]*|secondi|sekunden|secondes)"
_MS = "(?:ms|msec[a-z]*|mill?is[a-z]*)"
_RATE_BEHIND = re.compile(
    rf"(?<![\w.+-])({NUMBER}) ?(?:sps|(?:samples?|muestras|pts) ?(?:/|per|por) ?s[a-z]*)\b"
    rf"|(?:sampled|digiti[sz]ed|recorded|ornekleme|campionamento) (?:at )?({NUMBER}) ?hz\b"
)
_INTERVAL_BEHIND = re.compile(
    rf"(?<![\w.+-])({NUMBER}) ?({_SECONDS}|{_MS})\.? (?:time )?(?:intervals?|steps?)\b"
)
# Behind the name of what is stated: brackets, numbers of channels, a colon; then values.
_VALUES = re.compile(
    rf"(?:,? c1-c[0-9])?,? ?(?P<unit>\([^()]{{1,30}}\)|\[[^][]{{1,30}}\]|[a-z/]{{1,7}}(?= ?[:=]))?"
    rf"(?:,? c1-c[0-9])? ?(?:is |are |of |[:=])? ?/?(?P<values>{NUMBER}(?:/{NUMBER})*)"
    r"(?P<blank> ?)(?:\(?(?P<behind>[a-z/]{1,12})\)?)?(?![\w.:-])",
    re.I,
)


class Statement(NamedTuple):
    """A number that a header states, and how far the true one may be from it."""

    line: int
    text: str
    value: float
    slack: float = 0.0


@dataclasses.dataclass
class Stated:
    """What a header states: units, each with its line; numbers of samples; intervals, in s."""

    units: dict[str, int] = dataclasses.field(default_factory=dict)
    counts: list[Statement] = dataclasses.field(default_factory=list)
    intervals: list[Statement] = dataclasses.field(default_factory=list)


def half_digit(number: str) -> float:
    """Half a unit in the last printed place of a number."""
    return 0.5 * 10.0 ** int(Decimal(with_e(number)).as_tuple().exponent)


def interval(line: int, text: str, number: str, factor: float = 1.0) -> Statement:
    """The statement of an interval, positive and of which a unit is ``factor`` s."""
    if not 0 < to_float(number) < math.inf:
        raise MisreadError(line, f"{text}: the time step {number} must be positive")
    return Statement(line, text, factor * to_float(number), factor * half_digit(number))


def rate(line: int, text: str, number: str) -> Statement:
    """The interval at a rate, in Hz, which is exact if it is printed as a whole number."""
    hertz = to_float(number)
    slack = 0.0 if number.isdigit() else half_digit(number) / hertz**2
    return Statement(line, text, float(f"{1 / hertz:.12g}"), slack)


def state_numbers(header: Sequence[TextLine], stated: Stated) -> None:
    """Add the numbers of samples and intervals that a header states in prose."""
    for number, raw in header:
        small = plain(raw).lower().replace("ı", "i").replace("_", " ")
        without_accents = unicodedata.normalize("NFKD", small).encode("ascii", "ignore")
        text = " ".join(without_accents.decode().split())
        text = re.sub(r"(?<![0-9.,])([0-9]+),([0-9]+)(?![0-9.,])", r"\1.\2", text)
        stated.counts += _counts(number, text)
        stated.intervals += _intervals(number, text)


def _counts(line: int, text: str) -> Iterator[Statement]:
    stated = [(match[0], match[1]) for match in _COUNT_BEHIND.finditer(text)]
    for name in _COUNT.finditer(text):
        values = _VALUES.match(text, name.end())
        if values and (values["blank"] or not values["behind"]):
            phrase = text[name.start() : values.end("values")]
            numbers = {*values["values"].split("/")}
            if len(numbers) > 1:
                raise MisreadError(line, f"{phrase} must be one number for all channels")
            stated.append((phrase, *numbers))
    for phrase, number in stated:
        count = to_float(number)
        if not count.is_integer() and re.fullmatch(r"[0-9]{1,3}\.[0-9]{3}", number):
            count = round(1000 * count)  # thousands, as in 1.600
        if count == int(count) > 0:
            yield Statement(line, phrase, count)


def _intervals(line: int, text: str) -> Iterator[Statement]:
    printed = [(match[1] or match[2], "hz") for match in _RATE_BEHIND.finditer(text)]
    printed += [(match[1], match[2]) for match in _INTERVAL_BEHIND.finditer(text)]
    for names, usual in ((_INTERVAL, "s"), (_RATE, "hz")):
        for name in names.finditer(text):
            if values := _VALUES.match(text, name.end()):
                unit = f"{values['unit'] or ''} {values['behind'] or ''}".strip(" ()[]") or usual
                unit = usual if usual == "hz" and not _factor(unit) else unit
                printed += [(number, unit) for number in {*values["values"].split("/")}]
    for number, unit in printed:
        if not 0 < to_float(number) < math.inf:
            continue
        if re.match(_PER_SECOND, unit):
            yield rate(line, text, number)
        elif _factor(unit):
            yield interval(line, text, number, _factor(unit))


def _factor(unit: str) -> float:
    """Size of a unit of time in s, 0 if it is none."""
    if re.match(rf"{_MS}\b", unit):
        return 1e-3
    return float(re.match(rf"{_SECONDS}\b", unit) is not None)
