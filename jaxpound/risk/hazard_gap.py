"""The gap at which the annual rate of pounding is a given one, by the fragility at every gap."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache

import numpy as np
from scipy.optimize import brentq

from jaxpound.risk.annual_rate import AnnualRate
from jaxpound.study.statistics import Estimate

TRIED = (0.98, 0.9, 0.5, 0.1, 0.02, 5e-3, 1e-3)
"""Shares of a study's runs that pound at the gaps to begin with."""

_STEP = 0.05  # of ln gap, for the slope of ln rate


def gap_by_fragilities(
    annual_rate: Callable[[float], AnnualRate], tried: Iterable[float], target: float
) -> Estimate:
    """The gap of a target rate, with the interval of ln rate over the slope of ln rate by ln gap.

    Parameters
    ----------
    annual_rate
        The rate at a gap; a ``ValueError`` where no fragility can be fitted.
    tried
        Gaps to begin with.
    target
        The annual rate.

    Raises
    ------
    ValueError
        If the target is not between the rates at two of these gaps.
    """

    @cache
    def rate_at(u: float) -> AnnualRate | None:
        """The rate by ln of the gap; None where there is nothing to fit."""
        try:
            return annual_rate(float(np.exp(u)))
        except ValueError:
            return None

    def excess(u: float) -> float:
        """Ln of the rate over the target."""
        found = rate_at(u)
        return float("nan") if found is None else float(np.log(found.value / target))

    known = {}
    for gap in sorted(tried):
        if gap > 0 and rate_at(float(np.log(gap))) is not None:
            known[float(np.log(gap))] = excess(float(np.log(gap)))
    u, over = list(known), list(known.values())
    if not (over and over[0] > 0 > over[-1]):
        rates = "none"
        if over:
            rates = f"{target * np.exp(min(over)):.4g} to {target * np.exp(max(over)):.4g}"
        raise ValueError(
            f"HazardCurve.required_gap: the target, {target:.4g} a year, must be the rate of "
            f"pounding at a gap at which a fragility can be fitted: of these there are {rates}"
        )
    last = max(i for i, x in enumerate(over) if x > 0)
    root = float(brentq(excess, u[last], u[last + 1], xtol=1e-6))
    slope = (excess(root + _STEP) - excess(root - _STEP)) / (2 * _STEP)
    found = rate_at(root)
    assert found is not None
    factor = float(np.exp(abs(np.log(found.high / found.value) / slope)))
    gap = float(np.exp(root))
    return Estimate(gap, gap / factor, gap * factor, found.confidence)
