"""Records scaled to a target spectrum."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jaxpound._checks import Rule, enforce, positive
from jaxpound._tables import Shown, Table
from jaxpound.ground.target import PeriodRange, TargetSpectrum

if TYPE_CHECKING:
    from jaxpound.ground.suite import RecordSuite

OWNER = "RecordSuite.scaled_to"


class Bounds(NamedTuple):
    """Between which the factors must lie."""

    low: float
    high: float

    @classmethod
    def of(cls, factors: Any) -> Bounds:
        """A pair of numbers as bounds; a ``ValueError`` for anything else."""
        if np.shape(factors) != (2,):
            raise ValueError(f"{OWNER}: factors = {factors!r} must be bounds (low, high)")
        low, high = positive(OWNER, **{f"factors[{i}]": x for i, x in enumerate(factors)})
        enforce(OWNER, [Rule("factors", high, high >= low, f"at least the lower bound, {low:g}")])
        return cls(float(low), float(high))


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class ScaledSuite(Shown):
    """Records scaled to a target spectrum; ``RecordSuite.scaled_to`` makes it."""

    suite: RecordSuite
    """The scaled records."""
    factors: Float[np.ndarray, " n"]
    """Factor of each record."""
    target: TargetSpectrum
    range: PeriodRange
    """In which the spectra were to meet."""
    periods: Float[np.ndarray, " m"]
    """Periods at which they were compared, evenly spaced in the logarithm."""
    accelerations: Float[np.ndarray, "n m"]
    """Spectral acceleration of each scaled record at them, g."""
    bounds: Bounds
    """Of the factors."""

    @property
    def mean(self) -> Float[np.ndarray, " m"]:
        """Arithmetic mean of the scaled records' spectra, g: that of the codes."""
        return np.asarray(self.accelerations.mean(axis=0))

    @property
    def misfits(self) -> Float[np.ndarray, " n"]:
        """Root mean square of ln(record / target) over the periods, for each scaled record."""
        return misfit(np.log(self.accelerations / self.target.at(self.periods)))

    @property
    def misfit(self) -> float:
        """Root mean square of ln(mean spectrum / target) over the periods."""
        return float(misfit(np.log(self.mean / self.target.at(self.periods))))

    @property
    def least_ratio(self) -> float:
        """Smallest ratio of the mean spectrum to the target; codes ask for at least 0.9."""
        return float((self.mean / self.target.at(self.periods)).min())

    @property
    def at_bound(self) -> tuple[str, ...]:
        """Names of the records whose factor is at one of the bounds."""
        low, high = self.bounds
        at = (self.factors <= low * (1 + 1e-12)) | (self.factors >= high * (1 - 1e-12))
        return tuple(name for name, held in zip(self.suite.names, at, strict=True) if held)

    def findings(self) -> list[str]:
        """That factors are at a bound, in words; none if all are within."""
        if not self.at_bound:
            return []
        listed = ", ".join(self.at_bound)
        low, high = self.bounds
        return [f"factors of {listed} are at a bound, {low:g} or {high:g}: they fit less well"]

    def _tables(self) -> list[Table]:
        low, high = self.range
        rows = [
            (name, factor, off, "at a bound" if name in self.at_bound else "")
            for name, factor, off in zip(self.suite.names, self.factors, self.misfits, strict=True)
        ]
        name = f" {self.target.name!r}" if self.target.name else ""
        notes = [
            f"misfit: root mean square of ln(spectrum / target), periods {low:.4g} to {high:.4g}",
            f"mean of the suite: misfit {self.misfit:.4g}, at least {self.least_ratio:.4g} of the "
            "target",
            *self.findings(),
        ]
        columns = ("record", "factor", "misfit", "")
        return [Table(f"Scaled to the target spectrum{name}", columns, rows, notes, digits=4)]


def misfit(logarithms: Any) -> Any:
    """Root mean square of the logarithm of a ratio, over the last axis."""
    return np.sqrt(np.mean(logarithms**2, axis=-1))


def fitted_factors(ratios: Float[np.ndarray, "n m"], bounds: Bounds) -> Float[np.ndarray, " n"]:
    """Least squares in the logarithm: the factor f of each record, within bounds.

    It minimises Σ (ln f − ln r)² over the ratios r of the target to the record: a parabola in ln f,
    so that the best factor within bounds is the bound that is nearest to the vertex.
    """
    return np.clip(np.exp(np.log(ratios).mean(axis=1)), *bounds)


def raised(
    factors: Float[np.ndarray, " n"],
    ratios: Float[np.ndarray, "n m"],
    bounds: Bounds,
    least: float,
) -> Float[np.ndarray, " n"]:
    """Factors times the smallest common one with which the mean spectrum reaches the target.

    That is ``least`` of the target at every period; no factor exceeds its upper bound.

    Raises
    ------
    ValueError
        If it does not even with all factors at the upper bound.
    """
    from scipy.optimize import brentq

    def short(common: float) -> float:
        mean = np.mean(np.minimum(common * factors, bounds.high)[:, None] / ratios, axis=0)
        return float(mean.min() - least)

    if short(1.0) >= 0:
        return factors
    most = bounds.high / factors.min()
    if (reached := short(most)) < 0:
        rule = f"at most {reached + least:.4g}, which factors of {bounds.high:g} reach"
        raise ValueError(f"{OWNER}: least = {least:g} must be {rule}")
    common = brentq(short, 1.0, most, xtol=1e-13, rtol=1e-13)
    return np.minimum(common * factors, bounds.high)
