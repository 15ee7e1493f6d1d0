"""GeoNet of New Zealand: uncorrected (V1A) and corrected (V2A) accelerograms, in mm/s².

Source: the headers of GeoNet's files, and the reader of the USGS's gmprocess (``io/geonet``).
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from jaxpound.ground.formats.layout import Layout
from jaxpound.ground.formats.statements import Stated
from jaxpound.ground.formats.text import MisreadError, TextLine

_FACTOR = re.compile(r"Raw readings in units of (\S+) mm/s/s", re.I)


def _state(header: Sequence[TextLine], _stated: Stated) -> None:
    for number, text in header:
        if (factor := _FACTOR.match(text)) and float(factor[1]) != 1:
            raise MisreadError(number, f"units of {factor[1]} mm/s/s must be units of 1.00 mm/s/s")


LAYOUT = Layout(
    name="GeoNet V1A or V2A",
    signature=r"(?:un)?corrected accelerogram \d{8}_\d{6}_",
    begin=r"(?:un)?corrected accelerogram \d{8}_\d{6}_",
    component=r"Component +(\S+)",
    unit="mm/s2",
    state=_state,
    numbers=((10, 10, 8),),
    form=(10, 8),
    integrals=True,
)
