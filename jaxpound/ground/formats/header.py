"""The units and the quantity that the header of an accelerogram states in prose.

A unit is understood as a whole or not at all, so that G/10 is never read as g; an unknown unit is
refused by name. A run of blanks becomes one blank before the search, and no pattern tries a
character more than a few times: the time is in proportion to the length of any header.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from jaxpound.ground.formats import units
from jaxpound.ground.formats.text import (
    NUMBER,
    MisreadError,
    OtherKindError,
    TextLine,
    plain,
    shown,
)

_ACCELERATION = re.compile(
    r"(?<![^\W_])(?:(?:acc(?:el(?!ero)[^\W\d_]*+|n|s)?|acel(?!ero)[^\W\d_]*+)(?![^\W_])\.?"
    r"|amplitudes?(?![^\W_])|beschleunigung|acc[ée]l[ée]ration|ivme|ag?(?= ?[(\[]))"
    r"(?: (?:time|history|series|data|values?|record|trace|ordinates?)\b){0,3}",
    re.I,
)
_UNITS = re.compile(
    r"(?:units?|unidad(?:es)?|unit[àa]'?|einheit(?:en)?|unit[ée]s?|birim[iı]?)(?![^\W\d])", re.I
)
_OF = re.compile(r" ?(?:(?:of|is|are|the|utc)\b|in(?= )|[:=(\[,]|-(?= ))", re.I)
_IN = re.compile(r"\b(?:in|en) ", re.I)
_ITS_VALUE = re.compile(rf"[)\]]? ?[:=]? ?{NUMBER} ?$")
_SEPARATOR = re.compile(r"(?:[,;:=/]|(?:is|are)\b) ?", re.I)
_TIME_IN = re.compile(r"\btimes? (?:is |are )?in ", re.I)
_AND = re.compile(r" ?(?:[,;&]|\band\b) ?", re.I)
_LATER = re.compile(r"(?:\b(?:are|is|in|of)\b|[:=]) ?", re.I)
_UNIT_AHEAD = re.compile(r"\bin ((?:(?! in ).){1,20}) $", re.I)
_SENTENCE = re.compile(r"(?:[^.;|]|\.(?! |$)){0,80}+")
_SEGMENT = re.compile(r"(?:(?! in )[^,;:()\[\]|]){0,40}+", re.I)
_VALUE = re.compile(rf"{NUMBER} ?[^\W\d_]", re.I)
_DIVIDED = re.compile(r"[)\]] ?[/*]")
_NAME = re.compile(r"[-_]([\w/^*-]{1,40}+)")
_SERIES = re.compile(r"\b(?:history|series|data|values?|amplitudes?)\b", re.I)
_EXTREME = re.compile(r"(?<![^\W_])(?:peak|pk|max|maximum|min|minimum|pg[avd]|rms)(?![^\W_])", re.I)
_SCALE = re.compile(
    r"\b(?:counts?|(?:scale|scaling|calibration|conversion) ?factor|sensitivity|multiplier|lsb)\b",
    re.I,
)
_NOT_OF_DATA = units.set_of(  # a bracketed unit behind them is that of a range, a level or a filter
    "scale escala esc range rango fondo trigger threshold umbral disparo level soglia filter "
    "filtro corner cutoff resolution noise gain bereich messbereich schwelle plage seuil échelle "
    "aralık eşik"
)
_SENSORS = units.set_of("sensor sensors sensores sensore")  # unless data are spoken of
_INSTRUMENTS = units.set_of("recorder recording instrument sensor housing power plant")


def stated_units(header: Sequence[TextLine]) -> dict[str, int]:
    """The units of accelerations and times that a header states, each with its line."""
    lines = [TextLine(number, plain(text)) for number, text in header]
    mentions = [(unit, line.number) for line in lines for unit in _units_of_line(line)]
    if not any(unit in units.UNITS for unit, _ in mentions):
        mentions += [(unit, number) for number, text in lines for unit in _units_in_passing(text)]
    stated: dict[str, int] = {}
    for unit, number in mentions:
        units.state(stated, unit, number)
    if units.stated_among(stated, units.UNITS):
        return stated
    for number, text in lines:
        if scale := _SCALE.search(text):
            rule = "must state what its values are in: this scale is not understood"
            raise MisreadError(number, f"a header that speaks of {scale[0]!r} {rule}")
    return stated


def _unknown(number: int, text: str) -> MisreadError:
    rule = f"must be one of the known ones: {', '.join(units.UNITS)}"
    return MisreadError(number, f"the header's units = {shown(text.strip(' .:'))} {rule}")


def _unit_itself(number: int, text: str) -> Iterator[str]:
    """The unit, if the whole text is one; an error if it looks like an unknown one."""
    if unit := units.whole_unit(text):
        yield unit
    elif units.goes_on(text) or units.looks_like_unit(text):
        raise _unknown(number, text)


def _units_of_line(line: TextLine) -> Iterator[str]:
    number, text = line
    if unit := units.whole_unit(text):
        yield unit
    for match in _TIME_IN.finditer(text):
        if unit_and_end := units.match_unit(text, match.end(), units.TIME_UNIT):
            yield unit_and_end[0]
    for match in _UNITS.finditer(text):
        yield from _after_units(number, text, match)
    text = _EXTREME.split(text, 1)[0]  # the units behind it are those of the extreme value
    begin = series.end() if (series := _SERIES.search(text)) else len(text)
    for match in _ACCELERATION.finditer(text):
        begin = min(begin, match.end())
        yield from _after_acceleration(number, text, match.end())
    for match in _IN.finditer(text, begin):
        yield from _after_in(number, text, match.end())
    others = _NOT_OF_DATA if series else _NOT_OF_DATA | _SENSORS
    end = next((x.start() for x in units.WORD.finditer(text) if x[0].lower() in others), len(text))
    for match in units.BRACKET.finditer(text, 0, end):
        if _ITS_VALUE.match(text, match.end()):
            continue
        if set(_words_before(text, match.start())[-1:]) & (units.OTHER_QUANTITIES | units.TIMES):
            continue
        inside = units.inside_of(match)
        unit, is_time = units.whole_unit(inside), units.whole_unit(inside, units.TIME_UNIT)
        of_acceleration = match.start() >= begin and units.looks_like_unit(inside)
        if unit and not _DIVIDED.match(text, match.end()):
            yield unit
        elif unit or units.goes_on(inside) or (of_acceleration and not is_time):
            raise _unknown(number, text[match.start() : match.end() + 10])


def _after_units(number: int, text: str, match: re.Match[str]) -> Iterator[str]:
    """Units behind "units": "of g", "are sec and g", ": cm/s/s", "of uncor accel is g"."""
    if set(_words_before(text, match.start())[-2:]) & (units.OTHER_QUANTITIES | _INSTRUMENTS):
        return
    at = match.end()
    while connector := _OF.match(text, at):
        at = connector.end()
    has_connector = at > match.end()
    sentence = str(_SENTENCE.match(text, at + (text[at : at + 1] == " "))[0])  # type: ignore[index]
    for start in (0, *(later.end() for later in _LATER.finditer(sentence))):
        if set(units.words_of(sentence[:start])) & units.OTHER_QUANTITIES:
            return
        if re.search("[0-9%]|percent", sentence[:start], re.I):
            break
        if listed := _listed(sentence, start):
            yield from listed
            return
    before = text[max(0, match.start() - 30) : match.start()]
    if not has_connector and (ahead := _UNIT_AHEAD.search(before)):
        yield from _unit_itself(number, ahead[1])
        return
    is_building = match[0][-1:] not in "sS" and sentence[:1].isdigit()  # as in "unit 3"
    if (has_connector and sentence.strip() and not is_building) or units.looks_like_unit(sentence):
        raise _unknown(number, sentence)


def _listed(text: str, at: int) -> list[str]:
    """The units of a list such as "sec and g"; empty if one of them is unknown."""
    listed = []
    while unit_and_end := (
        units.match_unit(text, at) or units.match_unit(text, at, units.TIME_UNIT)
    ):
        listed.append(unit_and_end[0])
        if not (conjunction := _AND.match(text, unit_and_end[1])):
            return listed
        at = conjunction.end()
    unknown = units.goes_on(text, at) or units.looks_like_unit(text[at : at + 12])
    return [] if unknown or not any(unit in units.UNITS for unit in listed) else listed


def _after_acceleration(number: int, text: str, at: int) -> Iterator[str]:
    if name := _NAME.match(text, at):  # acc_g, acc_cm_s2; but also acc_ns, acceleration-time
        yield from _unit_itself(number, name[1])
        return
    at += text[at : at + 1] == " "
    if bracket := units.BRACKET.match(text, at):
        inside = units.inside_of(bracket)
        words = set(units.words_of(inside))
        if units.whole_unit(inside) or _UNITS.search(inside) or words <= units.NO_UNITS:
            return
        if len(words) == 1 or units.looks_like_unit(inside) or units.is_value_of_unit(inside):
            raise _unknown(number, inside)
        return
    if separator := _SEPARATOR.match(text, at):
        at = separator.end()
    if not (_IN.match(text, at) or _VALUE.match(text, at)):
        yield from _after_in(number, text, at)


def _after_in(number: int, text: str, at: int) -> Iterator[str]:
    """Units, if any, behind "in": "in g", "in the north-south direction"."""
    if _UNITS.match(text, at) or units.BRACKET.match(text, at):
        return
    words = str(_SEGMENT.match(text, at)[0])  # type: ignore[index]
    if listed := _listed(text, at):
        yield from listed
    elif units.goes_on(words) or units.looks_like_unit(words) or units.is_value_of_unit(words):
        raise _unknown(number, words)


def _units_in_passing(text: str) -> Iterator[str]:
    """Units of accelerations only, anywhere in a line, but not those of a value."""
    for match in units.LONE_UNIT.finditer(text := _EXTREME.split(text, 1)[0]):
        before = text[max(0, match.start() - 4) : match.start()].rstrip().lower()
        unit_and_end = units.match_unit(text, match.start())
        if not unit_and_end or before.endswith(tuple("0123456789=")):
            continue
        if unit_and_end[0].endswith("/s2") or (unit_and_end[0] == "gal" and before.endswith(" in")):
            yield unit_and_end[0]


def _words_before(text: str, at: int) -> list[str]:
    return units.words_of(text[max(0, at - 30) : at])


_OTHER_HISTORY = re.compile(
    rf"\b(?:({'|'.join(units.OTHER_HISTORIES)}) ?(?:time\b|history|series|in\b|[(\[]|$)"
    r"|(intensity|energy|spectrum) ?(?:time\b|history|series))",
    re.I,
)
_SPECTRUM = re.compile(r"\b(response|fourier|spectral) (?:amplitude )?(?:spectr|acc)", re.I)
_NOT_OTHER = re.compile(r"\b(?:acc|acel|beschl|ivme|peak|max)", re.I)


def require_acceleration(header: Sequence[TextLine]) -> None:
    """An ``OtherKindError`` for the header of a history of velocity, displacement or energy."""
    for number, raw in header:
        text = plain(raw)
        other = None if _NOT_OTHER.search(text) else _OTHER_HISTORY.search(text)
        if other := _SPECTRUM.search(text) or other:
            quantity = f"the header says {' '.join(filter(None, other.groups())).lower()}"
            raise OtherKindError(number, f"must be an acceleration history, but {quantity}")
