"""Components by their names: vertical ones, and pairs of files of a station's horizontal ones."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from jaxpound.ground.formats.units import OTHER_QUANTITIES, words_of

_UPWARDS = "up|dwn|down|vrt|vert?(?:ical)?|u-?d"
_VERTICAL = re.compile(
    rf"(?:a(?:cc(?:el)?)?[ _]?)?(?:(?:{_UPWARDS})[0-9]?(?:[ ,(].*)?|[uvz][0-9]?)"
    "|d|[a-z]_?[a-z]_?z[0-9]?",
    re.I,
)
_VERTICAL_FILE = re.compile(
    rf".*(?:UP|DWN|VRT|VERT?|[BEHLS][HNLG]Z|[-_. ](?i:(?:{_UPWARDS})[12]?|[uvz]))(?:\.[^.]*)?"
)
_AZIMUTHS = {  # of axes, in degrees, from the first one
    **dict.fromkeys(("N", "S", "NS", "L", "R", "LONG", "X", "FN", "1"), 0),
    **dict.fromkeys(("E", "W", "EW", "T", "TRAN", "Y", "FP", "2"), 90),
}
_MOST_SKEW = 5  # what the printed azimuths of components may be off a right angle, degrees
_PEER = re.compile(r"RSN[0-9]+_", re.I)  # the number of the station and earthquake
_COMPONENTS = tuple(
    re.compile(f"(.*?)(?:{pattern})", re.I | re.S)
    for pattern in (
        r"(?<=\.)(NS|EW)([12]?)",  # the extension of K-NET, and of both sensors of KiK-net
        r"(?:(?<=[-_.][BCEHLS][GHLN])|(?<=^[BCEHLS][GHLN]))([12ENRTXY])([-_.].*|)",  # SEED
        r"(?:[0-9]{3}[-_. ]|(?<=[-_. ]))H(?:OR)?([12])(\.\w*|)",
        r"(FN|FP|N-?S|E-?W|[NS][0-9]{2}[EW]|[0-9]{3}|(?<=[-_. ])(?:[ELNRSTWXY]|LONG|TRAN))(\.\w*|)",
    )
)


def is_vertical(name: str) -> bool:
    """Whether the name of a component says that it is vertical."""
    words = name.strip(" .'\"").split()
    return any(_VERTICAL.fullmatch(x) for x in (" ".join(words), *words[-1:])) or any(
        word.lower().startswith(("vertic", "vertik", "düşey")) for word in words
    )


def is_other(name: str) -> bool:
    """Whether the name of a component says that it is no acceleration."""
    return not OTHER_QUANTITIES.isdisjoint(words_of(name))


def is_vertical_file(name: str) -> bool:
    """Whether the name of a file says that it is of a vertical component."""
    return _VERTICAL_FILE.fullmatch(name) is not None


def pairs_of(files: Sequence[str]) -> dict[str, str]:
    """The station, such as ``A-ELC*.AT2``, of each of two files that differ in a right angle only.

    Where more than two files differ in their component only, none of them is in a pair.
    """
    components = {file: _component(file) for file in files}
    azimuths: dict[str, list[float]] = {}
    for station, azimuth in components.values():
        azimuths.setdefault(station, []).append(azimuth)
    skew = {x: abs((y[0] - y[1]) % 180 - 90) for x, y in azimuths.items() if len(y) == 2}
    return {x: y for x, (y, _) in components.items() if y in skew and not skew[y] > _MOST_SKEW}


def _component(file: str) -> tuple[str, float]:
    """The station of a file, and the azimuth of its component: NaN where PEER's number will do."""
    if peer := _PEER.match(file):
        return f"{peer[0]}*", math.nan
    match = next(filter(None, (pattern.fullmatch(file) for pattern in _COMPONENTS)), None)
    if not match:
        return file, math.nan
    axis = match[2].upper().replace("-", "")
    if (azimuth := _AZIMUTHS.get(axis)) is None:  # 087, N87E or, the other way round, S87E
        azimuth = int(axis.strip("NSEW")) * (-1 if axis[0] + axis[-1] in ("SE", "NW") else 1)
    return f"{match[1]}*{match[3]}", azimuth
