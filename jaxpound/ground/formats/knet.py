"""K-NET and KiK-net: the ASCII format of NIED, Japan."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence

import numpy as np

from jaxpound.ground.formats import rows as printed
from jaxpound.ground.formats import statements
from jaxpound.ground.formats.layout import Channel, Layout
from jaxpound.ground.formats.statements import Stated, Statement
from jaxpound.ground.formats.text import NUMBER, MisreadError, TextLine, shown, to_float

_HEADER_LINES = 20
_DIRECTIONS = {  # of KiK-net: in the borehole, and on the surface
    str(number): f"{axis} {sensor}"
    for number, (sensor, axis) in enumerate(
        itertools.product(("borehole", "surface"), ("N-S", "E-W", "U-D")), 1
    )
}
LAYOUT = Layout(
    name="K-NET or KiK-net",
    signature=r"Sampling Freq\(Hz\)|Scale Factor\s++[^\s(]++\(gal\)/",
    component=r"Dir\. +(\S+)",
)


def read(lines: Sequence[TextLine], notes: list[str]) -> Channel:
    """The component of a file."""
    end = next((i for i, x in enumerate(lines[:_HEADER_LINES]) if x.text.startswith("Memo")), None)
    if end is None:
        raise MisreadError(None, "a K-NET header must end with its line 'Memo.'")
    header = lines[:end]
    at_rate, _, (rate,) = _field(header, "Sampling Freq(Hz)", rf"({NUMBER}) ?Hz", "100Hz")
    at_time, _, (duration,) = _field(header, "Duration Time(s)", f"({NUMBER})", "108")
    form = rf"({NUMBER}) ?\(gal\) ?/ ?({NUMBER})"
    at_scale, _, (gal, per_counts) = _field(header, "Scale Factor", form, "3920(gal)/6182761")
    at_peak, peak_text, (peak,) = _field(header, "Max. Acc. (gal)", f"({NUMBER})", "48.060")
    rows = printed.parse_rows(lines[end + 1 :], notes)
    for line, numbers in rows:
        for number in numbers:
            if not number.lstrip("+-").isdigit():
                raise MisreadError(line, f"{number} must be a whole number of counts")
    counts = printed.flatten(rows)
    text = f"{rate:g} Hz for {duration:g} s, {rate * duration:.12g},"
    stated = Stated(
        {"gal": at_scale},
        [Statement(at_time, text, float(round(rate * duration)), 0.0)],
        [statements.rate(at_rate, "Sampling Freq(Hz)", f"{rate:g}")],
    )
    printed.require_count(stated, len(counts))
    texts = {line.number: line.text for line in lines}
    ends = [[match.end() for match in re.finditer(r"\S++", texts[row.line])] for row in rows]
    usual = max(ends[:1000], key=ends[:1000].count)
    odd = [row for row, at in zip(rows, ends, strict=True) if at != usual[: len(at)]]
    if len(rows) > 2 and 0 < len(odd) <= max(1, len(rows) // 100):
        rule = "must end below those of other rows: digits are lost, or the file is cut"
        raise MisreadError(odd[0].line, f"the counts {shown(texts[odd[0].line].strip())} {rule}")
    samples = (counts - counts.mean()) * (gal / per_counts)
    largest = float(np.abs(samples).max())
    if abs(largest - peak) > float(printed.print_rounding([peak_text])[0]) + gal / per_counts:
        rule = f"that of the counts about their mean, {largest:.6g}: the file is damaged"
        raise MisreadError(at_peak, f"Max. Acc. = {peak_text} gal must be {rule}")
    names = tuple(_DIRECTIONS.get(name, name) for name in LAYOUT.components(header))
    return Channel(names, stated, rows, samples)


def _field(
    header: Sequence[TextLine], name: str, form: str, example: str
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
