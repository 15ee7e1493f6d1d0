"""CSMIP, CDMG, CGS and SCSN of California: raw (V1) and corrected (V2) accelerograms.

RENADIC of Chile and USC have the same layout. Sources: Shakal & Huang, "Standard tape format for
CSMIP strong-motion data tapes", report OSMS 85-03; gmprocess of the USGS (``io/dmg``, ``renadic``).
"""

from __future__ import annotations

from jaxpound.ground.formats.layout import Layout

_COMPONENT = r"(?:CHAN +\d+:|COMP) *(UP|DOWN|[^\s(]+)"
_TITLE = r" *\d+ +(?:\w+ )?(?:points?|pts)\b"
_VOLUME = r"(?:FILE +\d+ OF )?UNCORRECTED ACCELEROGRAM DATA"

CORRECTED = Layout(
    name="CSMIP V2",
    signature="CORRECTED ACCELEROGRAM  ",
    begin="CORRECTED ACCELEROGRAM  ",
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
