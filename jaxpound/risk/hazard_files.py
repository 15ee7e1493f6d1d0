"""Hazard curves from the files of the programs that compute them."""

from __future__ import annotations

import csv
import re
from os import PathLike
from pathlib import Path

import numpy as np

from jaxpound._checks import did_you_mean, is_whole
from jaxpound.risk.hazard_points import LEAST_RATE

_PLACES = {"lon", "lat", "depth", "name", "vs30", "custom_site_id"}

HazardPoints = tuple[np.ndarray, np.ndarray, str]
"""Intensities, annual rates, and the measure's name."""


def read_hazard(file: str | PathLike[str], site: int | str | None, first: int = 0) -> HazardPoints:
    """The points of a site's hazard curve, by a file of OpenQuake or of the USGS.

    Rows of sites are counted from ``first``.

    Raises
    ------
    ValueError
        If the file is neither, or the site is not there or not chosen; with the file's name.
    """
    path = Path(file)
    lines = path.read_text(encoding="utf-8-sig").splitlines()
    about = lines[0] if lines and lines[0].startswith("#") else ""
    rows = [row for row in csv.reader(lines[bool(about) :]) if any(row)]
    names = rows[0] if rows else []
    probabilities = any(name.startswith("poe-") for name in names)
    levels = [i for i, name in enumerate(names) if name not in _PLACES]
    if not {"lon", "lat"} <= set(names) or len(levels) < 2 or len(rows) < 2:
        rule = "a line of names, lon and lat and the intensities (OpenQuake: poe-0.1), above sites"
        raise ValueError(f"HazardCurve.read: {path} must hold {rule}")
    row = _site(path, names, rows[1:], site, first)
    im = np.array([_number(path, names[i].removeprefix("poe-")) for i in levels])
    value = np.array([_number(path, row[i]) for i in levels])
    measure = _measure(path, about)
    good = value >= LEAST_RATE
    if probabilities:
        years = _years(path, about)
        if ((value < 0) | (value > 1)).any():
            raise ValueError(f"HazardCurve.read: {path}: probabilities must be from 0 to 1")
        good &= value < 1
        value = -np.log1p(-np.where(good, value, 0.0)) / years
    if good.sum() < 2:
        rule = "two intensities or more whose rate is told and above 0"
        raise ValueError(f"HazardCurve.read: {path}: the site must have {rule}")
    return im[good], value[good], measure


def _site(
    path: Path, names: list[str], rows: list[list[str]], site: int | str | None, first: int
) -> list[str]:
    owner, by_name = f"HazardCurve.read: {path}:", "name" in names
    known = [row[names.index("name")] for row in rows] if by_name else []
    if site is None:
        if len(rows) > 1:
            named = f": {', '.join(known[:6])}{', …' * (len(known) > 6)}" if known else ""
            raise ValueError(f"{owner} site must be one of {len(rows)}, from {first}{named}")
        site = first
    if isinstance(site, str):
        if site not in known:
            asked = f"; {did_you_mean(site, known)}" if did_you_mean(site, known) else ""
            raise ValueError(f"{owner} site = {site!r} must be a name in the file{asked}")
        site = first + known.index(site)
    if not (is_whole(site) and first <= site < first + len(rows)):
        rule = f"must be a row from {first} to {first + len(rows) - 1}"
        raise ValueError(f"{owner} site = {site!r} {rule}")
    row = rows[site - first]
    if len(row) != len(names):
        told = f"{len(row)} numbers and names"
        raise ValueError(f"{owner} site {site} with {told} must have one for each of {len(names)}")
    return row


def _number(path: Path, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"HazardCurve.read: {path}: {text!r} must be a number") from None


def _years(path: Path, about: str) -> float:
    found = re.search(r"investigation_time=([\d.eE+-]+)", about)
    years = float(found[1]) if found else 0.0
    if not years > 0:
        rule = "must be told above the names (investigation_time=50.0), in years"
        raise ValueError(f"HazardCurve.read: {path}: investigation_time {rule}")
    return years


def _measure(path: Path, about: str) -> str:
    """The measure with its unit: told above the names, or by the folder of a file of the USGS."""
    told = re.search(r"imt='([^']+)'", about)
    if told is not None:
        name = told[1]
    else:
        name = path.parent.name
        if period := re.fullmatch(r"SA(\d+)P(\d+)", name):
            name = f"SA({int(period[1])}.{period[2]})"
    if name == "PGA" or re.fullmatch(r"SA\([\d.]+\)", name):
        return f"{name} (g)"
    return f"{name} (cm/s)" if name == "PGV" else "im" if told is None else name
