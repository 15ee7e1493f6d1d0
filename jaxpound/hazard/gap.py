"""The gap at which pounding has a target annual rate, by the fragility at every gap."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache

import numpy as np
from scipy.optimize import brentq

from jaxpound._errors import InvalidInput
from jaxpound.hazard.annual_rate import AnnualRate
from jaxpound.study.statistics import Estimate

TRIED = (0.98, 0.9, 0.5, 0.1, 0.02, 5e-3, 1e-3)  # shares of runs that pound at the first gaps
_STEP = 0.05  # of ln gap, for the slope of ln rate


def gap_by_fragilities(
    annual_rate: Callable[[float], AnnualRate], tried: Iterable[float], target: float
) -> Estimate:
    """The gap of a target rate, with the interval of ln rate over the slope of ln rate by ln gap.

    ``annual_rate`` raises a ``ValueError`` at a gap at which no fragility can be fitted; the gaps
    ``tried`` are the first.
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
        rate = rate_at(u)
        return float("nan") if rate is None else float(np.log(rate.value / target))

    logs = [float(np.log(gap)) for gap in sorted(tried) if gap > 0]
    logs = [u for u in logs if rate_at(u) is not None]
    excesses = [excess(u) for u in logs]
    if not (excesses and excesses[0] > 0 > excesses[-1]):
        rates = "none"
        if excesses:
            least, most = target * np.exp(min(excesses)), target * np.exp(max(excesses))
            rates = f"{least:.4g} to {most:.4g}"
        rule = "must be the rate of pounding at a gap at which a fragility can be fitted"
        rule = f"{target:.4g} a year, {rule}: of these there are {rates}"
        raise InvalidInput("HazardCurve.required_gap", "the target,", "", rule)
    last = max(i for i, x in enumerate(excesses) if x > 0)
    root = float(brentq(excess, logs[last], logs[last + 1], xtol=1e-6))
    slope = (excess(root + _STEP) - excess(root - _STEP)) / (2 * _STEP)
    gap, rate = float(np.exp(root)), rate_at(root)
    assert rate is not None
    factor = float(np.exp(abs(np.log(rate.high / rate.value) / slope)))
    return Estimate(gap, gap / factor, gap * factor, rate.confidence)
