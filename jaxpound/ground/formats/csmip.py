"""CSMIP, CDMG, CGS and SCSN of California: raw (V1) and corrected (V2) accelerograms.

USC, RENADIC of Chile and BHRC of Iran have nearly the same layout. Sources: Shakal & Huang, "Standard tape format for
CSMIP strong-motion data tapes", report OSMS 85-03; gmprocess of the USGS (``io/dmg``, ``renadic``).
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from jaxpound.ground.formats.layout import Layout
from jaxpound.ground.formats.statements import Stated, Statement, half_digit
from jaxpound.ground.formats.text import NUMBER, TextLine

_DURATION = re.compile(rf"\bDURATION = *({NUMBER})")
_COMPONENT = r"(?:CHAN +\d+:|COMP) *(UP|DOWN|[^\s(]+)"
_TITLE = r" *\d+ +(?:\w+ )?(?:points?|pts)\b"
_VOLUME = r"(?:FILE +\d+ OF )?UNCORRECTED ACCELEROGRAM DATA"

CORRECTED = Layout(
    name="CSMIP V2",
    signature=r"CORRECTED ACCELEROGRAM  ",
    begin=r"CORRECTED ACCELEROGRAM  ",
    component=_COMPONENT,
    unit="cm/s2",
    title=_TITLE,
    form=(8, 10),
)
RAW = Layout(
    name="CSMIP V1 or RENADIC",
    signature=_VOLUME,
    begin=_VOLUME,
    component=_COMPONENT,
    numbers=((7, 16, 5), (7, 8, 10)),
    title=_TITLE,
    form=(8, 9),
    pairs=(10, 7),
)


def _state_interval(header: Sequence[TextLine], stated: Stated) -> None:
    """Add the interval of a number of points and a duration, of points or of steps."""
    for number, text in header:
        if (duration := _DURATION.search(text)) and stated.counts:
            n = stated.counts[-1].value
            slack = half_digit(duration[1]) / n + float(duration[1]) / n**2
            stated.intervals.append(
                Statement(number, text.strip(), float(f"{float(duration[1]) / n:.6g}"), slack)
            )


BHRC = Layout(
    name="BHRC of Iran",
    signature=r"\* VOL1DS FILE",
    begin=r"\* VOL1DS FILE",
    component=r"COMP +([A-Z])",
    state=_state_interval,
    numbers=((14, 14, 5),),
    form=(10, 13),
)
