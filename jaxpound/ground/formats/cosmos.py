"""COSMOS V1.20 of CESMD and others: .V1c and .V2c, uncorrected and corrected accelerations.

Source: "COSMOS strong motion data format, version 1.20" (2001), with its tables.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from jaxpound.ground.formats import rows
from jaxpound.ground.formats.layout import Layout
from jaxpound.ground.formats.statements import Stated, interval
from jaxpound.ground.formats.text import NUMBER, TextLine

_REALS = re.compile(
    r" *\d+ +Real-header values follow on +(\d+) lines, Format *= *\((\d+)[FE](\d+)", re.I
)
_OF_RECORDER, _OF_SERIES = 33, 61  # indices of intervals in the real header: in s, and in ms
_APPROXIMATE = re.compile(rf"pts, approx +({NUMBER}) +secs?", re.I)


def _state(header: Sequence[TextLine], stated: Stated) -> None:
    """Add the interval of the real header that agrees with the number of values in the title."""
    titles = (i for i, line in enumerate(header) if _REALS.match(line.text))
    if (at := next(titles, None)) is None:
        return
    title = _REALS.match(header[at].text)
    n_lines, *form = (int(number) for number in title.groups())  # type: ignore[union-attr]
    block = header[at + 1 : at + 1 + n_lines]
    reals = rows.numbers_of(block, (form[0], form[1]))
    duration = _APPROXIMATE.search(header[-1].text)
    for index, unit in ((_OF_SERIES, 1e-3), (_OF_RECORDER, 1.0)):
        if index < len(reals) and float(reals[index]) > 0:
            statement = interval(block[0].number, "the real header", reals[index], unit)
            length, most = statement.value * stated.counts[-1].value, 1 + 2 * statement.value
            if duration is None or abs(length - float(duration[1])) <= most:
                stated.intervals.append(statement)
                return


LAYOUT = Layout(
    name="COSMOS V1.20",
    begin=r".*\(Format v0?1\.\d+",
    component=r"Sta Cha[n:] *(?:\S+ *:|\S+:) *([^(]+?)(?: deg)? *(?:\(|$)",
    state=_state,
    title=r" *\d+ +\S.*?\bpts, approx",
)
