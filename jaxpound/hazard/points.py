"""The points of a hazard curve: their files and rules, the intensities they draw, their weights."""

from __future__ import annotations

import csv
import dataclasses
import re
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.scipy.special import log_ndtr, ndtri
from scipy import special

from jaxpound import _checks
from jaxpound._checks import Rule, did_you_mean, enforce, positive_number, real
from jaxpound._errors import InvalidInput
from jaxpound.ground.measure import Measure, units_like

LEAST_RATE = 1e-100  # smaller annual rates are rounding errors of the program that wrote them
_SIZES = (1e-12, 1e12)  # of intensities, in any unit
_RATES = (LEAST_RATE, 1e3)  # a thousand earthquakes a year are three a day
_STRONG, _OFTEN = 0.4, 0.02  # PGA in g, and an annual rate that no site in use reaches for it
_PLACES = {"lon", "lat", "depth", "name", "vs30", "custom_site_id"}  # columns without a rate
_NEARLY_SURE = 0.9  # from here two rates in a row are more probably probabilities


class CurvePoints(NamedTuple):
    """Points of a hazard curve; between them, and beyond both ends, the rate is a power law."""

    intensity: np.ndarray  # shape (m,)
    annual_rate: np.ndarray  # shape (m,)

    @staticmethod
    def of(intensity: Any, annual_rate: Any) -> CurvePoints:
        """Points that obey the rules of a hazard curve; see ``HazardCurve``."""
        im = np.array(real("intensity", intensity), float)
        rate = np.array(real("annual_rate", annual_rate), float)
        if im.ndim != 1 or im.size < 2 or rate.shape != im.shape:
            shapes = f"intensity {im.shape} and annual_rate {rate.shape}"
            raise InvalidInput(shapes, "", "must be (m,), of one length m ≥ 2")
        ranges = "from {:g} to {:g}".format(*_SIZES), "from {:g} to {:g} a year".format(*_RATES)
        falls = "no larger than the one before: a hazard curve falls as the intensity grows"
        rules = [
            Rule("intensity", im, np.clip(im, *_SIZES) == im, ranges[0]),
            Rule("annual_rate", rate, np.clip(rate, *_RATES) == rate, ranges[1]),
            Rule("intensity", im, np.r_[True, np.diff(im) > 0], "larger than the one before"),
            Rule("annual_rate", rate, np.r_[True, np.diff(rate) <= 0], falls),
        ]
        enforce(rules)
        return CurvePoints(im, rate)

    @property
    def slope(self) -> np.ndarray:
        """Exponents k = −d ln rate / d ln im of the m − 1 pieces between the points."""
        return -np.diff(np.log(self.annual_rate)) / np.diff(np.log(self.intensity))

    def piece(self, im: np.ndarray) -> np.ndarray:
        """The piece of each intensity; beyond the ends that which is continued."""
        before = np.searchsorted(self.intensity, im, side="right") - 1
        return np.clip(before, 0, self.intensity.size - 2)

    def integral(
        self, median: float, dispersion: float, edges: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """∫ Φ(ln(im / θ) / β) |dλ(im)| over each band of intensity, exactly, shape (n − 1,).

        Also its derivatives by ln θ and β, of the median θ and dispersion β, shape (n − 1, 2).
        ``edges`` of the bands, shape (n,), rise; 0 and ∞ are allowed.
        """
        # Pieces between edges and points of the curve: on each, λ is one power law.
        inner = (self.intensity > edges[0]) & (self.intensity < edges[-1])
        ends = np.unique(np.concatenate([edges, self.intensity[inner]]))
        piece, beta = self.piece(ends[:-1]), dispersion
        k, from_median = self.slope[piece], np.log(self.intensity[piece]) - np.log(median)
        with np.errstate(divide="ignore"):
            u = np.log(ends) - np.log(median)
        z = np.stack([u[:-1], u[1:]]) / beta
        start = np.log(self.annual_rate[piece]) + k * from_median
        # ∫ λ dP = e^(start + k²β²/2) [Φ(z + kβ)], by completing the square.
        interior = np.exp(start + (k * beta) ** 2 / 2 + _log_between(*(z + k * beta)))
        # At intensity 0 there is no pounding, and no earthquake exceeds ∞.
        finite = np.isfinite(z)
        rate = np.where(finite, np.exp(start - k * beta * np.where(finite, z, 0.0)), 0.0)
        density = np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi) * rate
        at_ends = special.ndtr(z) * rate
        integrals = np.maximum(interior + at_ends[0] - at_ends[1], 0.0)
        slopes = -k * interior, k * (k * beta * interior - density[0] + density[1])
        band = np.searchsorted(ends, edges[:-1])
        value, *slope = (np.add.reduceat(x, band) for x in (integrals, *slopes))
        return value, np.stack(slope, axis=-1)

    def doubts(self, measure: Measure) -> list[str]:
        """Findings if annual rates look like probabilities within years, in sentences."""
        (im, rate), sizes = self, units_like(measure.unit)
        rule = "annual_rate should be of a year; of probabilities p within years it is "
        rule += "-ln(1 - p)/years"
        if _NEARLY_SURE < rate[1] <= rate[0] <= 1:
            first = f"annual_rate = {rate[0]:.4g}, {rate[1]:.4g}, ..."
            return [f"{first} looks like probabilities: {rule}"]
        if measure.name != "PGA" or "g" not in sizes:
            return []
        in_g = im * sizes[measure.unit] / sizes["g"]
        strong = max(_STRONG, in_g[0])
        often = np.exp(np.interp(np.log(strong), np.log(in_g), np.log(rate)))
        if strong > in_g[-1] or often <= _OFTEN:
            return []
        curve = f"of a PGA of {strong:.2g} g is {often:.2g}, once in {1 / often:.2g} years"
        sites = f"no site is known where {_STRONG} g is exceeded once in {1 / _OFTEN:.0f} years"
        return [f"annual_rate {curve}; {sites}: {rule}"]


def _log_between(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """ln(Φ(high) − Φ(low)), computed in the nearer tail."""
    above = low > 0
    low, high = np.where(above, -high, low), np.where(above, -low, high)
    with np.errstate(divide="ignore"):
        log_high = special.log_ndtr(high)
        return log_high + np.log1p(-np.exp(special.log_ndtr(low) - log_high))


@dataclasses.dataclass(frozen=True)
class HazardIntensity:
    """Intensity of an earthquake that exceeds the lowest of a hazard curve, as a distribution.

    ``HazardCurve.distribution`` makes it. P(intensity > im) = λ(im) / λ(lowest), with ln λ linear
    in ln im between the points and continued above the last.
    """

    intensity: tuple[float, ...]
    annual_rate: tuple[float, ...]

    def __post_init__(self) -> None:
        before, last = self.annual_rate[-2:]
        if not before > last:
            rule = "of the highest intensity must be smaller than that of the one before"
            raise InvalidInput("annual_rate", f"{last:.8g}", f"{rule}, {before:.8g}")

    def from_normal(self, z: Any) -> Any:
        """The intensity that is exceeded with probability Φ(−z)."""
        z = jnp.asarray(z, float)
        rates, u = np.log(self.annual_rate), np.log(self.intensity)
        falls = np.diff(rates) < 0
        pieces = u[:-1], rates[0] - rates[:-1], -np.diff(rates) / np.diff(u)
        start, below, slope = (jnp.asarray(x[falls], z.dtype) for x in pieces)
        # Minus ln of the share of earthquakes that are stronger.
        depth = -log_ndtr(-z)
        piece = jnp.clip(jnp.searchsorted(below, depth, side="right") - 1, 0, below.size - 1)
        return jnp.exp(start[piece] + (depth - below[piece]) / slope[piece])

    def to_normal(self, x: Any) -> Any:
        """Inverse of ``from_normal``: −∞ below the lowest intensity."""
        x = jnp.asarray(x, float)
        inside = x > self.intensity[0]
        u = jnp.log(jnp.where(inside, x, 2 * self.intensity[0]))
        points = np.log(self.intensity), np.log(self.annual_rate)
        steepness = np.diff(points[1]) / np.diff(points[0])
        start, rate, slope = (jnp.asarray(x, u.dtype) for x in (*points, steepness))
        piece = jnp.clip(jnp.searchsorted(start, u, side="right") - 1, 0, slope.size - 1)
        stronger = jnp.exp(rate[piece] + slope[piece] * (u - start[piece]) - rate[0])
        inside &= stronger < 1
        return jnp.where(inside, -ndtri(jnp.where(inside, stronger, 0.5)), -jnp.inf)


def rate_of(probability: float, years: float) -> float:
    """Annual rate of an event of this probability within years: −ln(1 − p) / years."""
    _checks.require_share("probability", probability)
    (years,) = positive_number(years=years)
    return float(-np.log1p(-probability) / years)


def read_hazard(
    path: Path, site: int | str | None, first: int = 0
) -> tuple[np.ndarray, np.ndarray, str]:
    """Fields of ``HazardCurve.read``, with rows of sites counted from ``first``."""
    lines = path.read_text(encoding="utf-8-sig").splitlines()
    header = lines[0] if lines and lines[0].startswith("#") else ""
    rows = [row for row in csv.reader(lines[bool(header) :]) if any(row)]
    names = rows[0] if rows else []
    levels = [i for i, name in enumerate(names) if name not in _PLACES]
    if not {"lon", "lat"} <= set(names) or len(levels) < 2 or len(rows) < 2:
        rule = "a line of names, lon and lat and the intensities (OpenQuake: poe-0.1), above sites"
        raise InvalidInput("", "", f"must hold {rule}")
    row = _site(names, rows[1:], site, first)
    im = np.array([_number(names[i].removeprefix("poe-")) for i in levels])
    value = np.array([_number(row[i]) for i in levels])
    usable = value >= LEAST_RATE
    if any(name.startswith("poe-") for name in names):
        if ((value < 0) | (value > 1)).any():
            raise InvalidInput("probabilities", "", "must be from 0 to 1")
        usable &= value < 1
        match = re.search(r"investigation_time=([\d.eE+-]+)", header)
        years = float(match[1]) if match else 0.0
        if not years > 0:
            rule = "must be given above the names (investigation_time=50.0), in years"
            raise InvalidInput("investigation_time", "", rule)
        value = -np.log1p(-np.where(usable, value, 0.0)) / years
    if usable.sum() < 2:
        rule = "two intensities or more whose rate is given and above 0"
        raise InvalidInput("the site", "", f"must have {rule}")
    # The measure with its unit, from the header or the name of a USGS file's folder.
    match = re.search(r"imt='([^']+)'", header)
    measure = match[1] if match else path.parent.name
    if not match and (period := re.fullmatch(r"SA(\d+)P(\d+)", measure)):
        measure = f"SA({int(period[1])}.{period[2]})"
    of_acceleration = measure == "PGA" or re.fullmatch(r"SA\([\d.]+\)", measure)
    unit = "g" if of_acceleration else "cm/s" if measure == "PGV" else ""
    words = f"{measure} ({unit})" if unit else measure if match else "im"
    return im[usable], value[usable], words


def _site(names: list[str], rows: list[list[str]], site: int | str | None, first: int) -> list[str]:
    sites = [row[names.index("name")] for row in rows] if "name" in names else []
    if site is None:
        if len(rows) > 1:
            listed = f": {', '.join(sites[:6])}{', …' * (len(sites) > 6)}" if sites else ""
            raise InvalidInput("site", "", f"must be one of {len(rows)}, from {first}{listed}")
        site = first
    if isinstance(site, str):
        if site not in sites:
            guess = f"; {did_you_mean(site, sites)}" if did_you_mean(site, sites) else ""
            raise InvalidInput("site", repr(site), f"must be a name in the file{guess}")
        site = first + sites.index(site)
    if not (_checks.is_whole(site) and first <= site < first + len(rows)):
        rule = f"must be a row from {first} to {first + len(rows) - 1}"
        raise InvalidInput("site", repr(site), rule)
    row = rows[site - first]
    if len(row) != len(names):
        rule = f"with {len(row)} numbers and names must have one for each of {len(names)}"
        raise InvalidInput(f"site {site}", "", rule)
    return row


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InvalidInput(repr(text), "", "must be a number") from None
