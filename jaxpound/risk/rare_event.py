"""The result of a search for a rare event: its probability and how it comes about."""

from __future__ import annotations

import dataclasses
import math
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtri

from jaxpound._checks import require_share
from jaxpound._tables import Shown, Table
from jaxpound.model.parameters import require_paths
from jaxpound.model.system import Structures
from jaxpound.risk.limit_state import LimitState
from jaxpound.risk.slope import Slope, slopes_of, tail_of
from jaxpound.study.statistics import Estimate

RAREST = 1e-12
"""Below this a probability is only bounded."""


def always(runs: int) -> str:
    """What is known of an event that occurs in each of some random runs, in words."""
    least = 0.05 ** (1 / runs)
    return (
        f"the event occurs in each of {runs:,} random runs: its probability is above {least:.6g} "
        "(95 %)"
    )


class DesignEarthquake(NamedTuple):
    """A scenario that is the likeliest of those that reach the limit state at one instant."""

    beta: float
    """Its distance |z| from the origin, the reliability index of the instant."""
    time: float
    """The instant, in 1/ω1; NaN where the demand is not of one."""
    z: np.ndarray
    """Its standard normal numbers, shape (d,)."""
    structures: Structures
    ground: Any


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class RareEvent(Shown):
    """The probability that a limit state is reached; ``rare_event`` or ``subset_simulation``.

    Its samples have weights: the probability is mean(weights · (values ≥ 0)).
    """

    probability: float
    """The estimate P of the probability."""
    cov: float
    """Coefficient of variation of the estimate."""
    runs: int
    """Number of runs."""
    gradients: int
    """Number of runs with a gradient by z."""
    method: str
    """How it was found, in words."""
    limit_state: LimitState
    points: np.ndarray
    """Samples, standard normal numbers, shape (n, d)."""
    weights: np.ndarray
    """Their weights, shape (n,)."""
    values: np.ndarray
    """``LimitState.values`` of the samples, shape (n,): at least 0 where the event occurs."""
    design_points: np.ndarray
    """Points nearest to the origin at which the limit state is reached, one an instant, the nearest
    first, shape (k, d); none (k = 0) of a method without them."""
    instants: np.ndarray
    """Their instants in 1/ω1, shape (k,); NaN where the demand is not of one."""
    form: float = float("nan")
    """Probability by the first-order reliability method over the whole run, from the design points
    alone; NaN without them."""
    warnings: tuple[str, ...] = ()
    """Why not to trust the estimate, in sentences."""
    series: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0, int))
    """Of each design point the number of the series, in ``LimitState.series``, shape (k,)."""
    times: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0))
    """Of each sample the time of its smallest gap, shape (n,); none of a method without them."""
    repeats: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0, int))
    """Of each sample the number of the repeat that it belongs to: samples of one repeat are
    correlated. None where all are independent."""
    thin: float = float("nan")
    """Share of the estimate from where few samples are drawn: failures that no design point stands
    for. NaN of a method without design points."""

    @property
    def beta(self) -> float:
        """Reliability index −Φ⁻¹(P)."""
        return float(-ndtri(self.probability))

    @property
    def estimate(self) -> Estimate:
        """The probability with its 95 % interval."""
        return self.interval()

    def interval(self, confidence: float = 0.95) -> Estimate:
        """The probability with its interval: ln P normal with a variance of ln(1 + c.o.v.²).

        Up to a probability that is a bound, whose c.o.v. is NaN, the interval is from 0.

        Raises
        ------
        ValueError
            If confidence is not between 0 and 1.
        """
        require_share("RareEvent.interval", "confidence", confidence)
        p, cov = self.probability, self.cov
        if not (p > 0 and math.isfinite(cov)):
            return Estimate(p, 0.0, p if math.isnan(cov) else math.nan, confidence)
        width = float(ndtri((1 + confidence) / 2)) * math.sqrt(math.log1p(cov**2))
        return Estimate(p, p * math.exp(-width), min(1.0, p * math.exp(width)), confidence)

    @cached_property
    def slopes(self) -> dict[str, Slope]:
        """Derivatives of ln P by all parameters of the structures, by path; NaN of infinite ones.

        From the samples near the limit state, which are run once more, with gradients. A parameter
        that the scenarios draw is shifted in all of them. Slopes are 0 of what the demand does not
        depend on: the gap at rest where the event is that another gap closes.

        Raises
        ------
        ValueError
            If fewer than 20 samples reach the limit state.
        """
        return slopes_of(self.limit_state, self.points, self.weights, self.values, self.repeats)

    def slope(self, path: str) -> Slope:
        """Derivative of ln P by a parameter, with its standard error; see ``slopes``.

        Raises
        ------
        ValueError
            If there is no such parameter; as ``slopes``.
        """
        require_paths("RareEvent.slope", self.limit_state.programs.nominal, [path])
        return self.slopes[path]

    @property
    def decay(self) -> Slope:
        """λ = −d ln P/db by the threshold b, with its standard error.

        Raises
        ------
        ValueError
            As ``slopes``.
        """
        tail = tail_of(self.weights, self.values, self.repeats)
        return Slope(tail.decay, tail.error)

    @property
    def largest_share(self) -> float:
        """The share of the estimate that a single sample makes."""
        parts = np.where(self.values >= 0, self.weights, 0.0)
        return float(parts.max() / parts.sum()) if parts.any() else math.nan

    @property
    def failures_by_instant(self) -> tuple[np.ndarray, np.ndarray]:
        """Times of the smallest gap where the event occurs, in order, and their shares of P.

        Shares sum to 1; times are in 1/ω1.
        """
        hit = np.flatnonzero((self.values >= 0)[: len(self.times)])
        rows = hit[np.argsort(self.times[hit], kind="stable")]
        return self.times[rows], self.weights[rows] / max(self.weights[rows].sum(), 1e-300)

    @property
    def design_earthquakes(self) -> tuple[DesignEarthquake, ...]:
        """The scenarios of the design points, the likeliest first."""
        found = []
        for z, time in zip(self.design_points, self.instants, strict=True):
            scenario = self.limit_state.realized(z, self.limit_state.changes)
            found.append(DesignEarthquake(float(np.linalg.norm(z)), float(time), z, *scenario))
        return tuple(found)

    def _tables(self) -> list[Table]:
        state = self.limit_state
        name = state.demand if isinstance(state.demand, str) else "demand"
        event = "pounding" if state.threshold is None else f"{name} >= {state.threshold:.6g}"
        rows: list[tuple[str, Any]] = [
            ("probability", str(self.estimate)),
            ("coefficient of variation", f"{self.cov:.3g}"),
            ("reliability index", f"{self.beta:.4g}"),
            ("runs", self.runs),
            ("gradients", self.gradients),
        ]
        if math.isfinite(self.form):
            rows.append(("by FORM over the run", f"{self.form:.4g}"))
        if len(self.design_points):
            rows.append(("smallest distance of a design point", f"{self._least():.4g}"))
        notes = [f"method: {self.method}", *(f"warning: {x}" for x in self.warnings)]
        return [Table(f"Rare event: {event}", (), rows, notes)]

    def _least(self) -> float:
        return float(np.linalg.norm(self.design_points, axis=1).min())
