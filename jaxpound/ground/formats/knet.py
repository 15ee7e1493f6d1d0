"""K-NET and KiK-net: the ASCII format of NIED, Japan."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

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
    (at_rate, rate), (at_time, duration), (at_scale, gal, per), (at_peak, peak) = (
        _field(lines[:end], *field) for field in _FIELDS
    )
    rows = printed.parse_rows(lines[end + 1 :], notes)
    for line, numbers in rows:
        for number in numbers:
            if not number.lstrip("+-").isdigit():
                raise MisreadError(line, f"{number} must be a whole number of counts")
    counts, n = printed.flatten(rows), to_float(rate) * to_float(duration)
    count = Statement(at_time, f"{rate} Hz for {duration} s, {n:.12g},", float(round(n)))
    stated = Stated({"gal": at_scale}, [count], [statements.rate(at_rate, _FIELDS[0][0], rate)])
    printed.require_count(stated, len(counts))
    if odd := printed.odd_row(lines, rows):
        rule = "must end below those of other rows: digits are lost, or the file is cut"
        raise MisreadError(odd.number, f"the counts {shown(odd.text.strip())} {rule}")
    scale = to_float(gal) / to_float(per)
    samples = (counts - counts.mean()) * scale
    largest = float(np.abs(samples).max())
    if abs(largest - to_float(peak)) > statements.half_digit(peak) + scale:
        rule = f"that of the counts about their mean, {largest:.6g}: the file is damaged"
        raise MisreadError(at_peak, f"Max. Acc. = {peak} gal must be {rule}")
    names = LAYOUT.components(lines[:end])
    return Channel(_DIRECTIONS.get("".join(names), tuple(names)), stated, rows, samples)


def _field(header: Sequence[TextLine], name: str, form: str, example: str) -> tuple[Any, ...]:
    """The line of a field, and its positive numbers as printed."""
    for line, text in header:
        text = text.replace("Max Acc.", "Max. Acc.")  # as in NIED's own description
        if text.startswith(name):
            value = text[len(name) :].strip()
            match = re.fullmatch(form, value)
            if not match or not all(0 < to_float(number) < 1e12 for number in match.groups()):
                rule = f"must be positive, as in {example}"
                raise MisreadError(line, f"{name} = {shown(value)} {rule}")
            return line, *match.groups()
    raise MisreadError(None, f"a K-NET header must state {name}")
