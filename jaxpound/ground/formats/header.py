"""What the header of an accelerogram states in prose: units, and what was recorded.

A header is free text. A unit in it is understood as a whole or not at all, so that G/10 is never
taken for g; a stated unit that is not known is refused by name. Runs of blanks are made one blank
before anything is searched for, and no pattern tries a character more than a few times: a header is
read in a time proportional to its length, whatever it holds.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from jaxpound.ground.formats.text import NUMBER, Line, MisreadError, plain, set_of, shown
from jaxpound.ground.formats.units import (
    BRACKET,
    LONE_UNIT,
    NO_UNITS,
    OTHER_QUANTITIES,
    TIME_UNIT,
    TIMES,
    UNIT,
    UNITS,
    acceleration_unit,
    goes_on,
    inside_of,
    is_value_of_unit,
    known_unit,
    looks_like_unit,
    state,
    whole_unit,
    words_of,
)

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
_VALUE = re.compile(rf"{NUMBER} ?[^\W\d_]", re.I)
_DIVIDED = re.compile(r"[)\]] ?[/*]")
_NAME = re.compile(r"[-_]([\w/^*-]{1,40}+)")
_SERIES = re.compile(r"\b(?:history|series|data|values?|amplitudes?)\b", re.I)
_EXTREME = re.compile(r"(?<![^\W_])(?:peak|pk|max|maximum|min|minimum|pg[avd]|rms)(?![^\W_])", re.I)
_SCALE = re.compile(
    r"\b(?:counts?|(?:scale|scaling|calibration|conversion) ?factor|sensitivity|multiplier|lsb)\b",
    re.I,
)
_INSTRUMENTS = set_of("recorder recording instrument sensor housing power plant")


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


def _unknown(number: int, text: str) -> MisreadError:
    rule = f"must be one of the known ones: {', '.join(UNITS)}"
    return MisreadError(number, f"the header's units = {shown(text.strip(' .:'))} {rule}")


def _units_of_line(line: Line) -> Iterator[str]:
    number, text = line
    for match in _TIME_IN.finditer(text):
        if found := known_unit(TIME_UNIT, text, match.end()):
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
    for match in BRACKET.finditer(text):
        if set(_words_before(text, match.start())[-1:]) & (OTHER_QUANTITIES | TIMES):
            continue
        inside, unit = inside_of(match), whole_unit(UNIT, inside_of(match))
        of_acceleration = match.start() >= begin and looks_like_unit(inside)
        if unit and not _DIVIDED.match(text, match.end()):
            yield unit
        elif unit or goes_on(inside) or (of_acceleration and not whole_unit(TIME_UNIT, inside)):
            raise _unknown(number, text[match.start() : match.end() + 10])


def _after_units(number: int, text: str, match: re.Match[str]) -> Iterator[str]:
    """What "units" is followed by: "of g", "are sec and g", ": cm/s/s", "of uncor accel is g"."""
    if set(_words_before(text, match.start())[-2:]) & (OTHER_QUANTITIES | _INSTRUMENTS):
        return
    at = match.end()
    while connector := _OF.match(text, at):
        at = connector.end()
    stated = at > match.end()
    sentence = str(_SENTENCE.match(text, at + (text[at : at + 1] == " "))[0])  # type: ignore[index]
    for start in (0, *(later.end() for later in _LATER.finditer(sentence))):
        if set(words_of(sentence[:start])) & OTHER_QUANTITIES:
            return
        if re.search("[0-9%]|percent", sentence[:start], re.I):
            break
        if units := _listed(sentence, start):
            yield from units
            return
    if not stated and (
        ahead := _UNIT_AHEAD.search(text[max(0, match.start() - 30) : match.start()])
    ):
        if unit := whole_unit(UNIT, ahead[1]):
            yield unit
        elif looks_like_unit(ahead[1]) or goes_on(ahead[1]):
            raise _unknown(number, ahead[1])
        return
    is_one = match[0][-1:] not in "sS"  # "unit 3" is a building
    if (stated and not (is_one and sentence[:1].isdigit())) or looks_like_unit(sentence):
        raise _unknown(number, sentence)


def _listed(text: str, at: int) -> list[str]:
    """The units of a list such as "sec and g"; empty if one of them is not known."""
    units = []
    while found := known_unit(UNIT, text, at) or known_unit(TIME_UNIT, text, at):
        units.append(found[0])
        if not (conjunction := _AND.match(text, found[1])):
            return units
        at = conjunction.end()
    unknown = goes_on(text, at) or looks_like_unit(text[at : at + 12])
    return [] if unknown or not any(unit in UNITS for unit in units) else units


def _after_acceleration(number: int, text: str, at: int) -> Iterator[str]:
    if name := _NAME.match(text, at):  # acc_g, acc_cm_s2; but also acc_ns, acceleration-time
        if unit := whole_unit(UNIT, name[1]):
            yield unit
        elif goes_on(name[1]) or looks_like_unit(name[1]):
            raise _unknown(number, name[1])
        return
    at += text[at : at + 1] == " "
    if bracket := BRACKET.match(text, at):
        inside = inside_of(bracket)
        words = set(words_of(inside))
        if not (whole_unit(UNIT, inside) or _UNITS.search(inside) or words <= NO_UNITS) and (
            len(words) == 1 or looks_like_unit(inside) or is_value_of_unit(inside)
        ):
            raise _unknown(number, inside)
        return
    if separator := _SEPARATOR.match(text, at):
        at = separator.end()
    if not (_IN.match(text, at) or _VALUE.match(text, at)):
        yield from _after_in(number, text, at)


def _after_in(number: int, text: str, at: int) -> Iterator[str]:
    """Units, where there may be words as well: "in g", "in the north-south direction"."""
    if _UNITS.match(text, at) or BRACKET.match(text, at):
        return
    segment = str(_SEGMENT.match(text, at)[0])  # type: ignore[index]
    if found := known_unit(UNIT, text, at):
        yield found[0]
    elif goes_on(segment) or looks_like_unit(segment) or is_value_of_unit(segment):
        raise _unknown(number, segment)


def _units_in_passing(text: str) -> Iterator[str]:
    """Units that only an acceleration has, anywhere in a line, but not those of a value."""
    if extreme := _EXTREME.search(text):
        text = text[: extreme.start()]
    for match in LONE_UNIT.finditer(text):
        before = text[max(0, match.start() - 4) : match.start()].rstrip().lower()
        found = known_unit(UNIT, text, match.start())
        if not found or before.endswith(tuple("0123456789=")):
            continue
        if found[0].endswith("/s2") or (found[0] == "gal" and before.endswith(" in")):
            yield found[0]


def _words_before(text: str, at: int) -> list[str]:
    return words_of(text[max(0, at - 30) : at])


_OTHER_HISTORY = re.compile(
    r"\b(?:(vel|velocity|disp|displacement) ?(?:time\b|history|series|in\b|[(\[]|$)"
    r"|(intensity|energy|spectrum) ?(?:time\b|history|series))",
    re.I,
)
_NOT_OTHER = re.compile(r"\b(?:acc|peak|max)", re.I)


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
