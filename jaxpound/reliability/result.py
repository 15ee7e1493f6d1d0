"""The result of a search for a rare event: its probability and how it comes about.

Derivatives of a small probability by parameters of the structures follow from the samples near the
limit state: P(θ) = E[w 1{V ≥ 0}], so dP/dθ = E[w δ(V) ∂V/∂θ] with the limit state's value V.
Only samples near the limit count: those whose value is exceeded with a probability between
P e^(−1/2) and P e^(1/2). Each is divided by that probability, whose logarithm is nearly a line over
such a range, for any tail.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple, cast

import numpy as np
from jaxtyping import Float, Int
from scipy.special import ndtri

from jaxpound._checks import require_share
from jaxpound._errors import InvalidInput
from jaxpound._tables import Shown, TextTable
from jaxpound.model.system import Structures, in_si
from jaxpound.reliability.design_points import DesignPoints
from jaxpound.reliability.limit_state import LimitState
from jaxpound.results.named import event_in_words
from jaxpound.study.statistics import Estimate

RAREST = 1e-12  # below it a probability is only bounded
NO_ESTIMATE = "the number is a bound and no estimate"
_NEAR = 0.5  # largest difference of ln P between a sample's value and the limit
_FEWEST = 20


class Slope(NamedTuple):
    """Derivative of ln P by a parameter, with its standard error."""

    value: float
    error: float

    def __str__(self) -> str:
        return f"{self.value:.4g} ± {self.error:.2g}"


def always(runs: int) -> str:
    """A sentence on an event that occurs in each of some random runs."""
    least = f"{0.05 ** (1 / runs):.6g} (95 %)"
    return f"the event occurs in each of {runs:,} random runs: its probability is above {least}"


class DesignEarthquake(NamedTuple):
    """The likeliest scenario that reaches the limit state at an instant."""

    beta: float
    """Its distance |z| from the origin, the reliability index of the instant."""
    time: float
    """The instant, in the grid's unit of time; NaN where the demand has none."""
    z: np.ndarray
    """Its standard normal numbers, shape (d,)."""
    structures: Structures
    ground: Any


@dataclasses.dataclass(frozen=True, eq=False)
class Samples:
    """Samples of a limit state; the probability is mean(weights · (values ≥ 0))."""

    points: Float[np.ndarray, "n d"]
    """Standard normal numbers."""
    weights: Float[np.ndarray, " n"]
    values: Float[np.ndarray, " n"]
    """``LimitState.values`` of the points: at least 0 where the event occurs."""
    times: Float[np.ndarray, " n"] = dataclasses.field(default_factory=lambda: np.zeros(0))
    """Time of each one's smallest gap, NaN for other demands; empty by subset simulation."""
    repeats: Int[np.ndarray, " n"] = dataclasses.field(default_factory=lambda: np.zeros(0, int))
    """Number of each one's repeat: samples of a repeat are correlated. Empty where all samples are
    independent."""

    def __len__(self) -> int:
        return len(self.points)

    @property
    def parts(self) -> np.ndarray:
        """Each sample's part of n times the probability."""
        return np.where(self.values >= 0, self.weights, 0.0)

    @property
    def probability(self) -> float:
        """The estimate."""
        return float(self.parts.mean())

    @property
    def cov(self) -> float:
        """Its coefficient of variation; infinite if no sample reaches the limit state."""
        parts = self.parts
        return cov_of_mean(parts) if parts.any() else math.inf

    @property
    def largest_share(self) -> float:
        """The share of the estimate that a single sample makes."""
        parts = self.parts
        return float(parts.max() / parts.sum()) if parts.any() else math.nan

    @property
    def failures_by_instant(self) -> tuple[np.ndarray, np.ndarray]:
        """Times of the smallest gap where the event occurs, in order, and their shares of P.

        Shares sum to 1; times are in the grid's unit. There are none by subset simulation.
        """
        hit = np.flatnonzero((self.values >= 0)[: len(self.times)])
        rows = hit[np.argsort(self.times[hit], kind="stable")]
        return self.times[rows], self.weights[rows] / max(self.weights[rows].sum(), 1e-300)

    def joined(self, other: Samples) -> Samples:
        """Both samples together."""
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return Samples(*(np.concatenate(pair) for pair in pairs))

    def slope(self, above: np.ndarray) -> Slope:
        """Ratio of the sum over samples to that of ``parts``; only repeats are independent."""
        below = self.parts
        if self.repeats.size:
            above, below = np.bincount(self.repeats, above), np.bincount(self.repeats, below)
        ratio = above.sum() / below.sum()
        error = np.std(above - ratio * below, ddof=1) / np.sqrt(len(below)) / below.mean()
        return Slope(float(ratio), float(error))


def cov_of_mean(numbers: np.ndarray) -> float:
    """Coefficient of variation of the mean of independent numbers."""
    return float(numbers.std(ddof=1) / math.sqrt(len(numbers)) / numbers.mean())


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class RareEvent(Shown):
    """The probability of a limit state; made by ``rare_event`` or ``subset_simulation``."""

    limit_state: LimitState
    samples: Samples
    """Those around design points, plain ones of an event that is not rare, or those of all levels
    of subset simulation, each level without those in the next. None where the event is out of reach
    of design points."""
    probability: float
    """The estimate P of the probability, or a bound."""
    cov: float
    """Coefficient of variation of the estimate; NaN of a bound."""
    design_points: DesignPoints
    """Where the limit state is nearest; none by subset simulation, or if it is not rare."""
    runs: int
    """Number of runs."""
    gradients: int
    """Number of runs with a gradient by z."""
    method: str
    """The method, in words."""
    thin: float = math.nan
    """Share of the estimate from regions with few samples: failures far from all design points.
    NaN without samples around design points."""
    warnings: tuple[str, ...] = ()
    """Why not to trust the estimate, in sentences."""

    @property
    def instants(self) -> Float[np.ndarray, " k"]:
        """Those of the design points in the grid's unit; NaN where the demand has none."""
        numbers = self.design_points.instants
        return np.where(numbers < 0, np.nan, numbers * self.limit_state.grid.dt)

    @cached_property
    def form(self) -> float:
        """First-order estimate of P over the whole run, from the design points; NaN without."""
        return self.design_points.near.form()

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

        For a bound, whose c.o.v. is NaN, the interval begins at 0. Raises ``ValueError`` if
        confidence is not between 0 and 1.
        """
        require_share("confidence", confidence)
        p, cov = self.probability, self.cov
        if not (p > 0 and math.isfinite(cov)):
            return Estimate(p, 0.0, p if math.isnan(cov) else math.nan, confidence)
        width = float(ndtri((1 + confidence) / 2)) * math.sqrt(math.log1p(cov**2))
        return Estimate(p, p * math.exp(-width), min(1.0, p * math.exp(width)), confidence)

    def slopes_by(self, chosen: Sequence[str] | None = None) -> dict[str, Slope]:
        """Derivatives of ln P by chosen or all parameters of the structures, NaN of infinite ones.

        They follow from the samples near the limit state, which each call runs again with
        gradients: ask for several at once, and for chosen ones, which compile sooner. A parameter
        that the scenarios draw is shifted in all of them. The slope is 0 by parameters that the
        demand does not depend on, such as the gap at rest where the event is that another gap
        closes. Raises ``ValueError`` if there is no such parameter, or fewer than 20 samples reach
        the limit state.
        """
        density, slopes, samples = self._densities(), {}, self.samples
        near, parts = np.flatnonzero(density), np.zeros(len(samples))
        for path, slope in self.limit_state.sensitivities(samples.points[near], chosen).items():
            parts[near] = density[near] * slope
            slopes[path] = samples.slope(parts)
        return slopes

    def slope(self, path: str) -> Slope:
        """Derivative of ln P by a parameter, with its standard error; of several: ``slopes_by``."""
        return self.slopes_by([path])[path]

    @property
    def decay(self) -> Slope:
        """λ = −d ln P/db by the threshold b, with its standard error; raises as ``slopes_by``."""
        return self.samples.slope(self._densities())

    def _densities(self) -> Float[np.ndarray, " n"]:
        """Each sample's part of n times the density of values at the limit."""
        weights, values = self.samples.weights, self.samples.values
        hit = self.samples.parts
        rule = "must have at least {} samples, of several values, that reach the limit state"
        refusal = InvalidInput("the event", "", rule.format(_FEWEST))
        if np.count_nonzero(hit) < _FEWEST:
            raise refusal
        order = np.argsort(-values, kind="stable")
        order = order[np.cumsum(weights[order]) > 0]
        exceeded = (np.cumsum(weights[order]) - weights[order] / 2) / hit.sum()
        logs = np.log(exceeded)
        high, low = np.interp([-_NEAR, _NEAR], logs, values[order])
        if not high > low:
            raise refusal
        densities, near = np.zeros(len(values)), np.abs(logs) <= _NEAR
        densities[order[near]] = weights[order[near]] / exceeded[near] / (high - low)
        return densities

    @property
    def design_earthquakes(self) -> tuple[DesignEarthquake, ...]:
        """The scenarios of the design points, the likeliest first."""
        state, points, earthquakes = self.limit_state, self.design_points, []
        for z, beta, time in zip(points.z, points.betas, self.instants, strict=True):
            scenario = state.realized(z, state.changes)
            earthquakes.append(DesignEarthquake(float(beta), float(time), z, *scenario))
        return tuple(earthquakes)

    @property
    def event(self) -> str:
        """Whose probability it is, in words, such as ``"largest ductility ≥ 4"``."""
        state, threshold = self.limit_state, cast("float", self.limit_state.threshold)
        if not isinstance(state.demand, str):
            return f"demand ≥ {threshold:.4g}"
        nominal = state.nominal
        si, topology = in_si(nominal), nominal.system().topology
        return event_in_words(state.demand, threshold, si, topology)

    def _tables(self) -> list[TextTable]:
        event = "pounding" if self.limit_state.threshold is None else self.event
        rows: list[tuple[str, Any]] = [
            ("probability", str(self.estimate)),
            ("coefficient of variation", f"{self.cov:.3g}"),
            ("reliability index", f"{self.beta:.4g}"),
            *(("runs", self.runs), ("gradients", self.gradients)),
        ]
        if math.isfinite(self.form):
            rows.append(("by FORM over the run", f"{self.form:.4g}"))
        if len(self.design_points):
            least = self.design_points.betas[0]
            rows.append(("smallest distance of a design point", f"{least:.4g}"))
        notes = [f"method: {self.method}", *(f"warning: {x}" for x in self.warnings)]
        return [TextTable(f"Rare event: {event}", (), rows, notes)]
