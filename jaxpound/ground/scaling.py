"""Records scaled to a target spectrum, and the factors with which they meet it."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from jaxpound._checks import Rule, enforce
from jaxpound._errors import InvalidInput
from jaxpound._tables import Shown, TextTable
from jaxpound.ground.target import PeriodRange, TargetSpectrum, bounds

if TYPE_CHECKING:
    from jaxpound.ground.suite import RecordSuite

OWNER = "RecordSuite.scaled_to"


class FactorBounds(NamedTuple):
    """Bounds of the factors."""

    low: float
    high: float

    @classmethod
    def of(cls, factors: Any) -> FactorBounds:
        """A pair of numbers as bounds; an ``InvalidInput`` for anything else."""
        low, high = bounds(OWNER, "factors", factors, "bounds")
        enforce(OWNER, [Rule("factors", high, high >= low, f"at least the lower bound, {low:g}")])
        return cls(low, high)


def misfit(logarithms: Any) -> Any:
    """Root mean square of the logarithm of a ratio, over the last axis."""
    return np.sqrt(np.mean(logarithms**2, axis=-1))


def raised_factors(
    factors: np.ndarray, ratios: np.ndarray, highest: float, least: float
) -> np.ndarray:
    """Factors times the smallest common one with which the mean of the spectra reaches ``least``.

    ``least`` is its smallest ratio to the target; no factor exceeds ``highest``.
    """
    from scipy.optimize import brentq

    def shortfall(common: float) -> float:
        mean = np.mean(np.minimum(common * factors, highest)[:, None] / ratios, axis=0)
        return float(mean.min() - least)

    if shortfall(1.0) >= 0:
        return factors
    most = highest / factors.min()
    if (reached := shortfall(most)) < 0:
        rule = f"must be at most {reached + least:.4g}, which factors of {highest:g} reach"
        raise InvalidInput(OWNER, "least", f"{least:g}", rule)
    common = brentq(shortfall, 1.0, most, xtol=1e-13, rtol=1e-13)
    return np.minimum(common * factors, highest)


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class ScaledSuite(Shown):
    """Records scaled to a target spectrum; ``RecordSuite.scaled_to`` makes it."""

    suite: RecordSuite
    """The scaled records."""
    factors: np.ndarray
    """Factor of each record, shape (n,)."""
    target: TargetSpectrum
    range: PeriodRange
    """The range of periods of the fit."""
    periods: np.ndarray
    """Periods of the comparison, evenly spaced in the logarithm, shape (m,)."""
    accelerations: np.ndarray
    """Spectral acceleration of each scaled record at these periods, g, shape (n, m)."""
    bounds: tuple[float, float]
    """Bounds of the factors, ``low`` and ``high``."""

    @property
    def mean(self) -> np.ndarray:
        """Arithmetic mean of the scaled records' spectra, as in the codes, g, shape (m,)."""
        return np.asarray(self.accelerations.mean(axis=0))

    @property
    def misfits(self) -> np.ndarray:
        """Root mean square of ln(record / target) over the periods, of each record, shape (n,)."""
        return misfit(np.log(self.accelerations / self.target.at(self.periods)))

    @property
    def misfit(self) -> float:
        """Root mean square of ln(mean spectrum / target) over the periods."""
        return float(misfit(np.log(self.mean / self.target.at(self.periods))))

    @property
    def least_ratio(self) -> float:
        """Smallest ratio of the mean spectrum to the target; codes require at least 0.9."""
        return float((self.mean / self.target.at(self.periods)).min())

    @property
    def at_bound(self) -> tuple[str, ...]:
        """Names of the records whose factor is a bound."""
        low, high = self.bounds
        is_at = (self.factors <= low * (1 + 1e-12)) | (self.factors >= high * (1 - 1e-12))
        return tuple(np.array(self.suite.names)[is_at].tolist())

    def findings(self) -> list[str]:
        """A sentence on the factors that are bounds; none if all are within."""
        if not self.at_bound:
            return []
        listed, (low, high) = ", ".join(self.at_bound), self.bounds
        return [f"factors of {listed} are at a bound, {low:g} or {high:g}: they fit less well"]

    def _tables(self) -> list[TextTable]:
        low, high = self.range
        notes_at = ["at a bound" if name in self.at_bound else "" for name in self.suite.names]
        rows = [*zip(self.suite.names, self.factors, self.misfits, notes_at, strict=True)]
        notes = [
            f"misfit: root mean square of ln(spectrum / target), periods {low:.4g} to {high:.4g}",
            f"mean of the suite: misfit {self.misfit:.4g}, at least {self.least_ratio:.4g} of the "
            "target",
            *self.findings(),
        ]
        title = f"Scaled to the target spectrum{self.target.named()}"
        return [TextTable(title, ("record", "factor", "misfit", ""), rows, notes, digits=4)]
