"""Fragility from capacities: the intensities at which each record first reaches a threshold."""

from __future__ import annotations

import numpy as np
from jaxtyping import ArrayLike

from jaxpound._checks import Rule, enforce, real
from jaxpound._tables import Table
from jaxpound.risk.censored import regression
from jaxpound.study.fragility import Fragility


class AsymptoticFragility(Fragility):
    """A ``Fragility`` that was not fitted to counts: its band follows from its covariance."""

    _of_counts = False

    def _tables(self) -> list[Table]:
        (table,) = super()._tables()
        title = table.title.replace("pounding", "threshold reached")
        return [table._replace(title=title, notes=self._notes())]

    def _notes(self) -> list[str]:
        return [f"from {int(self.trials.max()):,} runs"]


class CapacityFragility(AsymptoticFragility):
    """A ``Fragility`` of capacities; its data are their empirical distribution.

    ``intensity`` are the capacities in rising order, ``pounding`` how many are at most as large and
    ``trials`` the number of records.
    """

    def _notes(self) -> list[str]:
        n, known = int(self.trials[0]), len(self.intensity)
        above = f", {n - known} more above what was analysed" if n > known else ""
        return [f"from {known} capacities{above}"]


def fit_capacities(
    capacities: ArrayLike, analysed: ArrayLike | None = None, *, measure: str = ""
) -> CapacityFragility:
    """Lognormal fragility of capacities (Baker 2015, incremental and truncated dynamic analysis).

    If every capacity is known, ln θ is the mean of their logarithms and β its standard deviation,
    with n − 1. If some are infinite, records that did not reach the threshold up to the intensity
    ``analysed``, both maximise the likelihood ∏ φ(z_i)/β ∏ (1 − Φ(z_max)), z = ln(im / θ) / β.

    Parameters
    ----------
    capacities
        Intensity > 0 at which each record first reaches the threshold, shape (n,); infinite where
        it never did.
    analysed
        Highest intensity that was tried, a number or shape (n,); needed where one is infinite.
    measure
        See ``fit_fragility``.

    Raises
    ------
    ValueError
        If shapes differ, a value is not positive, ``analysed`` is missing or infinite where it is
        needed, or fewer than two capacities are known, or all are equal.

    Examples
    --------
    >>> curve = jp.fit_capacities([0.2, 0.3, 0.45])
    >>> round(curve.median, 3), round(curve.dispersion, 4)
    (0.3, 0.4055)
    >>> curve = jp.fit_capacities([0.2, 0.3, np.inf], analysed=0.4)
    >>> round(curve.median, 3), round(curve.dispersion, 3)
    (0.313, 0.402)
    """
    owner = "fit_capacities"
    known = np.asarray(real(owner, "capacities", capacities), float)
    if known.ndim != 1 or not known.size:
        raise ValueError(f"{owner}: capacities of shape {known.shape} must be (n,) with n ≥ 1")
    enforce(owner, [Rule("capacities", known, known > 0, "positive")])
    reached = np.isfinite(known)
    if not reached.all() and analysed is None:
        raise ValueError(f"{owner}: analysed = None must be given where a capacity is infinite")
    given = np.asarray(np.inf if analysed is None else real(owner, "analysed", analysed), float)
    if given.shape not in ((), known.shape):
        raise ValueError(f"{owner}: analysed of shape {given.shape} must be {known.shape}")
    limits = np.broadcast_to(given, known.shape)
    right = (limits > 0) & (reached | np.isfinite(limits))
    rule = "positive, and finite where a capacity is not"
    enforce(owner, [Rule("analysed", limits, right, rule)])
    sure = np.sort(known[reached])
    n, m = known.size, sure.size
    if m < 2 or sure[0] == sure[-1]:
        what = "equal" if m > 1 else f"known of {m} of {n}"
        raise ValueError(f"{owner}: capacities must differ, of at least 2 records; they are {what}")
    y = np.where(reached, np.log(known), np.log(limits))
    line = regression(np.ones((n, 1)), y, ~reached)
    return CapacityFragility(
        float(np.exp(line.coefficients[0])),
        line.sigma,
        line.covariance,
        sure,
        np.arange(1, m + 1),
        np.full(m, n),
        True,
        measure=measure,
    )
