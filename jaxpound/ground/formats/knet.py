"""K-NET and KiK-net: the ASCII format of NIED, Japan."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from jaxpound.ground.formats import rows as printed
from jaxpound.ground.formats import statements
from jaxpound.ground.formats.layout import Channel, Layout
from jaxpound.ground.formats.statements import Stated, Statement
from jaxpound.ground.formats.text import NUMBER, MisreadError, TextLine, shown, to_float

_HEADER_LINES = 20
_FIELDS = (  # names, forms of their numbers, examples
    ("Sampling Freq(Hz)", rf"({NUMBER}) ?Hz", "100Hz"),
    ("Duration Time(s)", f"({NUMBER})", "108"),
    ("Scale Factor", rf"({NUMBER}) ?\(gal\) ?/ ?({NUMBER})", "3920(gal)/6182761"),
    ("Max. Acc. (gal)", f"({NUMBER})", "48.060"),
)
_DIRECTIONS = {  # of KiK-net, in the borehole and on the surface; K-NET has the axis itself
    str(3 * k + i): (axis, sensor)
    for k, sensor in enumerate(("borehole", "surface"))
    for i, axis in enumerate(("N-S", "E-W", "U-D"), 1)
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
    (at_rate, _, (rate,)), (at_time, _, (duration,)), scale, (at_peak, peak_text, (peak,)) = (
        _field(header, *field) for field in _FIELDS
    )
    at_scale, _, (gal, per_counts) = scale
    rows = printed.parse_rows(lines[end + 1 :], notes)
    for line, numbers in rows:
        for number in numbers:
            if not number.lstrip("+-").isdigit():
                raise MisreadError(line, f"{number} must be a whole number of counts")
    counts = printed.flatten(rows)
    text = f"{rate:g} Hz for {duration:g} s, {rate * duration:.12g},"
    count = Statement(at_time, text, float(round(rate * duration)))
    interval = statements.rate(at_rate, "Sampling Freq(Hz)", f"{rate:g}")
    stated = Stated({"gal": at_scale}, [count], [interval])
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
    names = LAYOUT.components(header)
    return Channel(_DIRECTIONS.get("".join(names), tuple(names)), stated, rows, samples)


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
