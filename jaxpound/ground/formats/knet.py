"""K-NET and KiK-net: the ASCII format of NIED, Japan."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from jaxpound.ground.formats.rows import (
    Format,
    Row,
    Values,
    flatten,
    parse_rows,
    print_rounding,
    require_count,
)
from jaxpound.ground.formats.text import NUMBER, Line, MisreadError, TextFile, shown, to_float

_HEADER_LINES = 20
_KNET = re.compile(r"Sampling Freq\(Hz\)|Scale Factor\s++[^\s(]++\(gal\)/")


def _read(file: TextFile, _dt: float | None, notes: list[str]) -> Values:
    lines = file.lines
    end = next((i for i, x in enumerate(lines[:_HEADER_LINES]) if x.text.startswith("Memo")), None)
    if end is None:
        raise MisreadError(None, "a K-NET header must end with its line 'Memo.'")
    header = lines[:end]
    _, _, (rate,) = _field(header, "Sampling Freq(Hz)", rf"({NUMBER}) ?Hz", "100Hz")
    at_time, _, (duration,) = _field(header, "Duration Time(s)", f"({NUMBER})", "108")
    form = rf"({NUMBER}) ?\(gal\) ?/ ?({NUMBER})"
    at_scale, _, (gal, per_counts) = _field(header, "Scale Factor", form, "3920(gal)/6182761")
    at_peak, printed, (peak,) = _field(header, "Max. Acc. (gal)", f"({NUMBER})", "48.060")
    rows = parse_rows(lines[end + 1 :], notes)
    for line, numbers in rows:
        for number in numbers:
            if not number.lstrip("+-").isdigit():
                raise MisreadError(line, f"{number} must be a whole number of counts")
    counts = flatten(rows)
    stated = f"{rate:g} Hz for {duration:g} s, {rate * duration:.12g},"
    require_count(at_time, stated, round(rate * duration), len(counts))
    _require_aligned_end(rows, lines)
    samples = (counts - counts.mean()) * (gal / per_counts)
    found = float(np.abs(samples).max())
    if abs(found - peak) > float(print_rounding([printed])[0]) + gal / per_counts:
        rule = f"that of the counts about their mean, {found:.6g}: the file is damaged"
        raise MisreadError(at_peak, f"Max. Acc. = {printed} gal must be {rule}")
    return Values(samples, float(f"{1 / rate:.12g}"), rows, {"gal": at_scale})


FORMAT = Format(lambda lines: any(_KNET.match(x.text) for x in lines[:_HEADER_LINES]), _read)


def _field(
    header: Sequence[Line], name: str, form: str, example: str
) -> tuple[int, str, list[float]]:
    """The line of a field, its text and its positive numbers."""
    for line, text in header:
        text = text.replace("Max Acc.", "Max. Acc.")  # as in NIED's own description
        if text.startswith(name):
            value = text[len(name) :].strip()
            match = re.fullmatch(form, value)
            numbers = [to_float(number) for number in match.groups()] if match else []
            if not numbers or not all(0 < number < 1e12 for number in numbers):
                rule = f"must be positive, as in {example}"
                raise MisreadError(line, f"{name} = {shown(value)} {rule}")
            return line, value, numbers
    raise MisreadError(None, f"a K-NET header must state {name}")


def _require_aligned_end(rows: list[Row], lines: Sequence[Line]) -> None:
    """Refuse a cut inside the last count, which then ends ahead of the column above it."""
    texts = {line.number: line.text for line in lines}
    ends = [[match.end() for match in re.finditer(r"\S++", texts[row.line])] for row in rows]
    last = len(ends[-1]) - 1
    column = {row[last] for row in ends[:-1] if len(row) > last}
    if len(column) == 1 and len(ends) > 2 and ends[-1][last] not in column:
        says = f"{rows[-1].numbers[-1]} must end below the counts ahead of it: the file is cut"
        raise MisreadError(rows[-1].line, says)
