"""The result of a search for a rare event: its probability and how it comes about."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import ndtri

from jaxpound._checks import require_share
from jaxpound._tables import Shown, Table
from jaxpound.model.system import Structures
from jaxpound.risk.limit_state import LimitState
from jaxpound.study.statistics import Estimate


class DesignEarthquake(NamedTuple):
    """A scenario that is the likeliest of those that reach the limit state at one instant."""

    beta: float
    """Its distance |z| from the origin, the reliability index of the instant."""
    time: float
    """The instant, in 1/ω1; NaN where the demand is not of one."""
    z: Float[np.ndarray, " d"]
    """Its standard normal numbers."""
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
    points: Float[np.ndarray, "n d"]
    """Samples, standard normal numbers."""
    weights: Float[np.ndarray, " n"]
    """Their weights."""
    values: Float[np.ndarray, " n"]
    """``LimitState.values`` of the samples: at least 0 where the event occurs."""
    design_points: Float[np.ndarray, "k d"]
    """Points nearest to the origin at which the limit state is reached, one an instant, the nearest
    first; none (k = 0) of a method without them."""
    instants: Float[np.ndarray, " k"]
    """The instants of the design points, in 1/ω1; NaN where the demand is not of one."""
    form: float = float("nan")
    """Probability by the first-order reliability method over the whole run, from the design points
    alone; NaN without them."""
    warnings: tuple[str, ...] = ()
    """Why not to trust the estimate, in sentences."""

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

        Raises
        ------
        ValueError
            If confidence is not between 0 and 1.
        """
        require_share("RareEvent.interval", "confidence", confidence)
        p, cov = self.probability, self.cov
        if not (p > 0 and math.isfinite(cov)):
            return Estimate(p, 0.0, math.nan, confidence)
        width = float(ndtri((1 + confidence) / 2)) * math.sqrt(math.log1p(cov**2))
        return Estimate(p, p * math.exp(-width), min(1.0, p * math.exp(width)), confidence)

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
