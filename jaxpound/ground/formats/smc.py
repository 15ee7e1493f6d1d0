"""SMC of the USGS: corrected and uncorrected accelerograms, in cm/s².

Source: the USGS's description of the SMC format (National Strong-Motion Program).
"""

from __future__ import annotations

from collections.abc import Sequence

from jaxpound.ground.formats import rows
from jaxpound.ground.formats.layout import Layout
from jaxpound.ground.formats.statements import Stated, Statement, rate
from jaxpound.ground.formats.text import MisreadError, TextLine

_INTEGERS, _REALS = (6, 8, 10), (10, 5, 15)  # rows, values a row, characters of each
_COUNT, _RATE, _UNDEFINED = 16, 1, 0  # indices


def _state(header: Sequence[TextLine], stated: Stated) -> None:
    lines = [line for line in header if not line.text.startswith("|")]
    integers, reals = lines[-16:-10], lines[-10:]
    counts, numbers = rows.numbers_of(integers, _INTEGERS[1:]), rows.numbers_of(reals, _REALS[1:])
    if (len(counts), len(numbers)) != (48, 50) or not float(counts[_COUNT]) > 0:
        rule = "48 and 50 numbers, one of which is that of the values"
        raise MisreadError(header[0].number, f"the header of SMC must have {rule}")
    if float(numbers[_RATE]) == float(numbers[_UNDEFINED]) or not float(numbers[_RATE]) > 0:
        rule = "is undefined, as of values at uneven times, which must be resampled first"
        raise MisreadError(reals[0].number, f"sampling rate = {numbers[_RATE]} {rule}")
    stated.counts[:] = [Statement(integers[2].number, "the integer header", float(counts[_COUNT]))]
    stated.intervals.append(rate(reals[0].number, "the real header", f"{float(numbers[_RATE]):g}"))


LAYOUT = Layout(
    name="SMC",
    begin=r"[12] (?:un)?corrected accelerogram",
    component=r".*\bcomponent= *(\S+)",
    unit="cm/s2",
    state=_state,
    numbers=(_INTEGERS, _REALS),
    form=(8, 10),
)
