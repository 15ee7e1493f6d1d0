"""PEER's AT2 files: a header with the number of values and the time step, then the values."""

from __future__ import annotations

import re
from collections.abc import Sequence

from jaxpound.ground.formats.layout import Layout
from jaxpound.ground.formats.statements import Stated, state_numbers
from jaxpound.ground.formats.text import NUMBER, MisreadError, TextLine, plain, shown

_LINE = re.compile(r"(?!\s*(?:#|%|//))(?=.*\bDT\b).*\bNPTS\b", re.I)
_NUMBERS_FIRST = re.compile(rf"\s*({NUMBER})[ ,]{{1,3}}({NUMBER})[ ,]{{1,3}}NPTS,? ?DT(.*)", re.I)


def _state(header: Sequence[TextLine], stated: Stated) -> None:
    """Replace what the header states by what the line of NPTS and DT does."""
    number, text = next(line for line in header if _LINE.match(line.text))
    in_order = _NUMBERS_FIRST.sub(r"NPTS = \1, DT = \2 \3", plain(text))
    stated.counts.clear()
    stated.intervals.clear()
    state_numbers([TextLine(number, in_order)], stated)
    if not (stated.counts and stated.intervals):
        rule = "must state NPTS, a positive whole number, and DT > 0, in s or ms"
        raise MisreadError(number, f"{shown(text.strip())} {rule}")


LAYOUT = Layout(
    name="PEER AT2",
    signature=_LINE.pattern,
    component=r"(?!.*NPTS)[^,]*,[^,]*,.*?([^,(\s][^,(]{0,11}?) *(?:\([^()]*\) *)?$",
    state=_state,
    behind=_LINE.pattern,
    history=True,
)
