"""The points of a hazard curve: their rules, and what in them is implausible."""

from __future__ import annotations

from typing import Any

import numpy as np

from jaxpound._checks import Rule, enforce, real
from jaxpound.ground.measure import Measure, units_like
from jaxpound.risk.hazard_intensity import CurvePoints

LEAST_RATE = 1e-100
"""Smallest annual rate: those below are the rounding of the program that told them."""

_SIZES = (1e-12, 1e12)  # of intensities, in whatever unit
_RATES = (LEAST_RATE, 1e3)  # a thousand earthquakes a year are three a day
_STRONG, _OFTEN = 0.4, 0.02  # PGA in g, and an annual rate that no known site reaches for it
_NEARLY_SURE = 0.9  # from here two rates in a row are more probably probabilities


def checked(owner: str, intensity: Any, annual_rate: Any) -> CurvePoints:
    """Intensities and annual rates as arrays.

    Raises
    ------
    ValueError
        If the shapes differ or are not (m,) with m ≥ 2, a number is out of its range, intensities
        do not rise, or rates rise.
    """
    im = np.array(real(owner, "intensity", intensity), float)
    rate = np.array(real(owner, "annual_rate", annual_rate), float)
    if im.ndim != 1 or im.size < 2 or rate.shape != im.shape:
        shapes = f"intensity {im.shape} and annual_rate {rate.shape}"
        raise ValueError(f"{owner}: {shapes} must be (m,), of one length m ≥ 2")
    ranges = "from {:g} to {:g}".format(*_SIZES), "from {:g} to {:g} a year".format(*_RATES)
    falls = "no larger than the one before: a hazard curve falls as the intensity grows"
    rules = [
        Rule("intensity", im, _within(im, *_SIZES), ranges[0]),
        Rule("annual_rate", rate, _within(rate, *_RATES), ranges[1]),
        Rule("intensity", im, np.r_[True, np.diff(im) > 0], "larger than the one before"),
        Rule("annual_rate", rate, np.r_[True, np.diff(rate) <= 0], falls),
    ]
    enforce(owner, rules)
    return im, rate


def _within(x: np.ndarray, low: float, high: float) -> np.ndarray:
    return (low <= x) & (x <= high)


def doubts(points: CurvePoints, measure: Measure) -> list[str]:
    """Findings if annual rates look like probabilities within years, in sentences."""
    (im, rate), sizes = points, units_like(measure.unit)
    rule = "annual_rate should be of a year; of probabilities p within years it is -ln(1 - p)/years"
    if _NEARLY_SURE < rate[1] <= rate[0] <= 1:
        return [f"annual_rate = {rate[0]:.4g}, {rate[1]:.4g}, ... looks like probabilities: {rule}"]
    if measure.name != "PGA" or "g" not in sizes:
        return []
    in_g = im * sizes[measure.unit] / sizes["g"]
    strong = max(_STRONG, in_g[0])
    often = np.exp(np.interp(np.log(strong), np.log(in_g), np.log(rate)))
    if strong > in_g[-1] or often <= _OFTEN:
        return []
    return [
        f"annual_rate of a PGA of {strong:.2g} g is {often:.2g}, once in {1 / often:.2g} years; "
        f"no site is known where {_STRONG} g is exceeded once in {1 / _OFTEN:.0f} years: {rule}"
    ]
