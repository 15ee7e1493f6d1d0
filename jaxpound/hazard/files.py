"""Hazard curves from the files of the programs that compute them."""

from __future__ import annotations

import csv
import re
from os import PathLike
from pathlib import Path

import numpy as np

from jaxpound._checks import did_you_mean, is_whole
from jaxpound._errors import InvalidInput
from jaxpound.hazard.points import LEAST_RATE

_PLACES = {"lon", "lat", "depth", "name", "vs30", "custom_site_id"}

HazardPoints = tuple[np.ndarray, np.ndarray, str]
"""Intensities, annual rates, and the measure's name."""


def read_hazard(file: str | PathLike[str], site: int | str | None, first: int = 0) -> HazardPoints:
    """``HazardCurve.read``, with rows of sites counted from ``first``."""
    path = Path(file)
    owner = f"HazardCurve.read: {path}"
    lines = path.read_text(encoding="utf-8-sig").splitlines()
    header = lines[0] if lines and lines[0].startswith("#") else ""
    rows = [row for row in csv.reader(lines[bool(header) :]) if any(row)]
    names = rows[0] if rows else []
    probabilities = any(name.startswith("poe-") for name in names)
    levels = [i for i, name in enumerate(names) if name not in _PLACES]
    if not {"lon", "lat"} <= set(names) or len(levels) < 2 or len(rows) < 2:
        rule = "a line of names, lon and lat and the intensities (OpenQuake: poe-0.1), above sites"
        raise ValueError(f"{owner} must hold {rule}")
    row = _site(owner, names, rows[1:], site, first)
    im = np.array([_number(owner, names[i].removeprefix("poe-")) for i in levels])
    value = np.array([_number(owner, row[i]) for i in levels])
    usable = value >= LEAST_RATE
    if probabilities:
        if ((value < 0) | (value > 1)).any():
            raise InvalidInput(owner, "probabilities", "", "must be from 0 to 1")
        usable &= value < 1
        match = re.search(r"investigation_time=([\d.eE+-]+)", header)
        years = float(match[1]) if match else 0.0
        if not years > 0:
            rule = "must be given above the names (investigation_time=50.0), in years"
            raise InvalidInput(owner, "investigation_time", "", rule)
        value = -np.log1p(-np.where(usable, value, 0.0)) / years
    if usable.sum() < 2:
        rule = "two intensities or more whose rate is given and above 0"
        raise InvalidInput(owner, "the site", "", f"must have {rule}")
    return im[usable], value[usable], _measure(path, header)


def _site(
    owner: str, names: list[str], rows: list[list[str]], site: int | str | None, first: int
) -> list[str]:
    """The row of the site."""
    sites = [row[names.index("name")] for row in rows] if "name" in names else []
    if site is None:
        if len(rows) > 1:
            listed = f": {', '.join(sites[:6])}{', …' * (len(sites) > 6)}" if sites else ""
            rule = f"must be one of {len(rows)}, from {first}{listed}"
            raise InvalidInput(owner, "site", "", rule)
        site = first
    if isinstance(site, str):
        if site not in sites:
            guess = f"; {did_you_mean(site, sites)}" if did_you_mean(site, sites) else ""
            raise InvalidInput(owner, "site", repr(site), f"must be a name in the file{guess}")
        site = first + sites.index(site)
    if not (is_whole(site) and first <= site < first + len(rows)):
        rule = f"must be a row from {first} to {first + len(rows) - 1}"
        raise InvalidInput(owner, "site", repr(site), rule)
    row = rows[site - first]
    if len(row) != len(names):
        rule = f"with {len(row)} numbers and names must have one for each of {len(names)}"
        raise InvalidInput(owner, f"site {site}", "", rule)
    return row


def _number(owner: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InvalidInput(owner, repr(text), "", "must be a number") from None


def _measure(path: Path, header: str) -> str:
    """The measure with its unit, from the header or the name of a USGS file's folder."""
    match = re.search(r"imt='([^']+)'", header)
    name = match[1] if match else path.parent.name
    if not match and (period := re.fullmatch(r"SA(\d+)P(\d+)", name)):
        name = f"SA({int(period[1])}.{period[2]})"
    if name == "PGA" or re.fullmatch(r"SA\([\d.]+\)", name):
        return f"{name} (g)"
    return f"{name} (cm/s)" if name == "PGV" else name if match else "im"
