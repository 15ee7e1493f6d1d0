"""Fragility: the probability of pounding as a function of a measure of intensity."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import ArrayLike
from scipy.special import log_ndtr, ndtr, ndtri

from jaxpound import _checks
from jaxpound._checks import Rule, array, enforce, instance, real, require_one_of, require_share
from jaxpound._errors import InvalidInput, warn
from jaxpound._tables import Shown, TextTable
from jaxpound.ground.measure import Measure, measure_unit, units_like
from jaxpound.study.weighting import require_weights

ANY_LINK = "any link"  # name of the curve of any of several links, beside "link 1" and so on
_BY_CHANCE = 3.0  # standard deviations: once in 700 pairs of stripes of equal probability
_LEAST = 40.0  # −z from which Φ(z) is 0


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Fragility(Shown):
    """A lognormal fragility function, P(pounding | im) = Φ(ln(im / θ) / β) (Baker 2015, eq. 1).

    ``fit_fragility`` fits it and keeps the data, for figures. A curve from a handbook is
    ``Fragility(median, dispersion)``.

    Raises ``ValueError`` if median or dispersion is not one number, positive and finite, or the
    covariance not of shape (2, 2).

    Examples
    --------
    >>> curve = jp.study.Fragility(median=0.6, dispersion=0.4)
    >>> round(float(curve.probability(0.4)), 3)
    0.155
    >>> hazard = jp.HazardCurve([0.1, 1.0], [1e-2, 1e-5])
    >>> round(hazard.annual_rate_of(curve).value, 7)  # 1e-5 θ^-3 e^((3 β)² / 2)
    9.51e-05
    """

    median: float
    """θ, the intensity at which pounding has probability one half, in the intensity's unit."""
    dispersion: float
    """β, standard deviation of ln im at pounding."""
    covariance: np.ndarray = dataclasses.field(default_factory=lambda: np.full((2, 2), np.nan))
    """Asymptotic covariance of (ln θ, β), shape (2, 2), from the observed information; with weights
    that of White (1982), which also uses the scatter of the scores. NaN if unknown."""
    intensity: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0))
    """Intensities of the data, shape (m,); m = 0 for a curve without data."""
    pounding: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0, int))
    """Number of runs with pounding at each intensity, shape (m,)."""
    trials: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0, int))
    """Number of runs at each intensity, shape (m,)."""
    stripes: bool = True
    """Whether the data are multiple stripes, at chosen intensities, and not a cloud."""
    weights: np.ndarray | None = None
    """Weights of the runs at each intensity, shape (m,); None if all count the same."""
    measure: str = ""
    """The measure of intensity with its unit, such as ``"PGA (g)"``; empty if unknown.
    ``HazardCurve.annual_rate_of`` requires that it is that of the hazard curve."""
    source: str = ""
    """What it was fitted to instead of counts, in words: capacities, or a regression."""
    event: str = "pounding"
    """Whose probability it is, in words, such as ``"largest ductility ≥ 4"``."""

    def __post_init__(self) -> None:
        for name in ("median", "dispersion"):
            (value,) = _checks.positive_number(**{name: getattr(self, name)})
            object.__setattr__(self, name, float(value))
        matrix = array("covariance", self.covariance, (2, 2))
        object.__setattr__(self, "covariance", matrix)
        instance("measure", self.measure, str)
        object.__setattr__(self, "measure", str(Measure.of_text(self.measure)))

    @property
    def unit(self) -> str:
        """Unit of the intensities; empty if unknown."""
        return Measure.of_text(self.measure).unit

    def in_unit(self, unit: str) -> Fragility:
        """The same fragility of intensities in another unit, such as "g" for "m/s²".

        Raises ``ValueError`` for a unit that is not one of the same quantity.
        """
        instance("unit", unit, str)
        if not (sizes := units_like(self.unit)):
            rule = "must state a unit that is known, such as 'PGA (g)'"
            raise InvalidInput("measure", repr(self.measure), rule)
        unit = measure_unit(unit) or unit
        require_one_of(unit, sizes, "unit")
        factor, measure = sizes[self.unit] / sizes[unit], Measure.of_text(self.measure)
        text = str(dataclasses.replace(measure, unit=unit))
        numbers = {name: factor * getattr(self, name) for name in ("median", "intensity")}
        return dataclasses.replace(self, **numbers, measure=text)

    @property
    def median_error(self) -> float:
        """Standard error of θ."""
        return float(self.median * self.covariance[0, 0] ** 0.5)

    @property
    def dispersion_error(self) -> float:
        """Standard error of β."""
        return float(self.covariance[1, 1] ** 0.5)

    def probability(self, intensity: ArrayLike) -> np.ndarray:
        """Probability of pounding at intensities ≥ 0 (else a ``ValueError``), of their shape."""
        im = _not_negative(intensity)
        with np.errstate(divide="ignore"):
            return ndtr(np.log(im / self.median) / self.dispersion)

    def band(self, intensity: ArrayLike, confidence: float = 0.95) -> tuple[np.ndarray, np.ndarray]:
        """Pointwise band of ``probability`` at intensities: lower and upper limit, shape (k,) each.

        It is that of the ``covariance``: ln(im / θ) / β is normal to first order. Of clouds of 40
        runs, and of 6 stripes of 5 runs or more, it contains the truth in 95 % to 99 %, of 300 runs
        in 90 % or more.
        """
        require_share("confidence", confidence)
        points = _not_negative(intensity)
        with np.errstate(divide="ignore"):
            z = np.maximum(np.log(points / self.median) / self.dispersion, -_LEAST)
        slope = -np.stack([np.ones_like(z), z], axis=-1) / self.dispersion
        error = np.sqrt(np.einsum("...i,ij,...j", slope, self.covariance, slope))
        half = ndtri((1 + confidence) / 2) * error
        return ndtr(z - half), ndtr(z + half)

    def _tables(self) -> list[TextTable]:
        runs, pounding = int(self.trials.sum()), int(self.pounding.sum())
        stripes = f" at {len(self.intensity):,} intensities" if self.stripes else ""
        weighted = " with weights" * (self.weights is not None)
        note = f"fitted to {runs:,} runs{stripes}{weighted}, {pounding:,} with {self.event}"
        note = self.source or (note if runs else "")
        title = f"Fragility P({self.event} | im) = Φ(ln(im / θ) / β)"
        rows = [
            ("median θ", self.median, self.median_error, self.unit or "that of im"),
            ("dispersion β", self.dispersion, self.dispersion_error, ""),
        ]
        columns = ("", "value", "standard error", "unit")
        return [TextTable(title, columns, rows, [note] if note else [], digits=4)]


def fit_fragility(
    intensity: ArrayLike,
    pounding: ArrayLike,
    trials: ArrayLike | None = None,
    *,
    weights: ArrayLike | None = None,
    measure: str = "",
) -> Fragility:
    """Fit of a lognormal fragility function by maximum likelihood (Baker 2015, eq. 11).

    Raises ``ValueError`` if the likelihood has no maximum: pounding always, never, always above an
    intensity and never below, or not more often at higher intensities. Warns
    (``PlausibilityWarning``) if pounding is less frequent at a stripe than at a lower one by more
    than chance explains.

    Parameters
    ----------
    intensity
        Intensities im > 0, shape (m,), such as ``study["pga"]``.
    pounding
        Without trials (a cloud): whether there was pounding, shape (m,), such as
        ``study["required_gap"] >= gap``, or pounding that exceeds a limit, such as
        ``study["peak_contact"] > limit``. With trials (multiple stripes): the number of runs with
        pounding.
    trials
        Number of runs at each intensity, at least 1; shape (m,), or one number for all.
    weights
        Weight ≥ 0 of each run at an intensity, shape (m,), of any scale, such as those of
        importance samples: the power of the run's factor in the likelihood. The covariance is then
        that of White (1982) for a likelihood other than the data's: H⁻¹ S H⁻¹ with H the
        information and S the sum of the squares of the scores.
    measure
        See ``Fragility``.

    Examples
    --------
    >>> pga, pounding = [0.2, 0.4, 0.6, 0.8, 1.0], [1, 4, 9, 14, 18]
    >>> curve = jp.fit_fragility(pga, pounding, trials=[20] * 5)
    >>> round(curve.median, 3), round(curve.dispersion, 3)
    (0.59, 0.537)
    >>> round(float(curve.probability(0.5)), 3)
    0.379
    """
    im, k = np.asarray(real("intensity", intensity), float), np.asarray(pounding)
    k = k if k.dtype == bool else np.asarray(real("pounding", pounding))
    n = np.asarray(1 if trials is None else real("trials", trials))
    n = np.full(im.shape, n) if n.ndim == 0 else n
    if im.ndim != 1 or not im.size or k.shape != im.shape or n.shape != im.shape:
        shapes = f"intensity {im.shape}, pounding {k.shape} and trials {n.shape}"
        raise InvalidInput(shapes, "", "must be (m,)")
    rules = [
        Rule("intensity", im, (im > 0) & np.isfinite(im), "positive and finite"),
        Rule("trials", n, (n >= 1) & (n % 1 == 0), "whole numbers from 1 on"),
        Rule("pounding", k, (k >= 0) & (k <= n) & (k % 1 == 0), "from 0 to trials, whole"),
    ]
    enforce(rules)
    k, n = k.astype(int), n.astype(int)
    w: np.ndarray | None = None
    if weights is not None:
        w = array("weights", weights, im.shape)
        require_weights(w)
        w = w / w.mean()
    counted = np.ones(im.shape, bool) if w is None else w > 0
    z, weight = np.log(im[counted]), 1 if w is None else w[counted]
    hits, runs = k[counted], n[counted]
    if reason := _no_maximum(im[counted], weight * hits, weight * runs):
        raise InvalidInput("pounding", "", f"must determine a curve, but {reason}")
    (a, b), information = _maximise(z, weight * hits, weight * runs)
    spread = np.linalg.inv(information)
    if w is not None:
        eta = a + b * z
        rise, fall = inverse_mills_ratio(eta), inverse_mills_ratio(-eta)
        squares = weight**2 * (hits * rise**2 + (runs - hits) * fall**2)
        x = np.stack([np.ones_like(z), z])
        spread = spread @ (x * squares) @ x.T @ spread
    # Derivative of (ln θ, β) = (−a/b, 1/b) with respect to (a, b) of Φ(a + b ln im).
    slope = np.array([[-1 / b, a / b**2], [0.0, -1 / b**2]])
    stripes = trials is not None
    if stripes and (drop := falls(im, k, n)):
        reason = "a fragility, which rises with the intensity, does not fit"
        warn([f"pounding occurs {drop}: {reason}"], strict=False)
    curve = float(np.exp(-a / b)), float(1 / b), slope @ spread @ slope.T
    return Fragility(*curve, im, k, n, stripes, w, measure=measure)


def falls(im: np.ndarray, k: np.ndarray, n: np.ndarray) -> str:
    """A pair of stripes, in words, between which pounding becomes less frequent; empty if none.

    The pair whose shares k / n differ most in standard deviations, which those of equal
    probability have, and by more than chance explains.
    """
    order = np.argsort(im)
    im, k, n = im[order], k[order], n[order]
    low, high = np.triu_indices(im.size, 1)
    pooled = (k[low] + k[high]) / (n[low] + n[high])
    variance = pooled * (1 - pooled) * (1 / n[low] + 1 / n[high])
    fall = k[low] / n[low] - k[high] / n[high]
    z = np.where(fall > 0, fall, 0.0) / np.sqrt(np.where(fall > 0, variance, 1.0))
    if not z.size or z.max() < _BY_CHANCE:
        return ""
    i, j = low[np.argmax(z)], high[np.argmax(z)]
    return f"{k[i]} of {n[i]} times at {im[i]:.4g} and {k[j]} of {n[j]} at {im[j]:.4g}"


def _not_negative(intensity: ArrayLike) -> np.ndarray:
    """Intensities from 0 to ∞, both included."""
    im = np.asarray(real("intensity", intensity), float)
    enforce([Rule("intensity", im, im >= 0, "not negative")])
    return im


def _no_maximum(im: np.ndarray, k: np.ndarray, n: np.ndarray) -> str:
    """The reason why the likelihood of a rising curve has no maximum; empty if it has one."""
    if not k.any() or (k == n).all():
        return "it always occurs" if k.any() else "it never occurs"
    if im.min() == im.max():
        return f"all intensities are {im[0]:.6g}"
    pounding, safe = im[k > 0], im[k < n]
    if pounding.min() >= safe.max():
        return f"it always occurs above im = {safe.max():.6g} and never below"
    # The likelihood rises with the slope at slope zero if and only if this covariance is positive.
    if np.sum(np.log(im) * (k - n * (k.sum() / n.sum()))) <= 0:
        return "it does not become more frequent as the intensity grows"
    return ""


def _maximise(z: np.ndarray, k: np.ndarray, n: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(a, b) of P = Φ(a + b z) by Newton's method, and the observed information, shape (2, 2)."""
    x = np.stack([np.ones_like(z), z])

    def likelihood(c: np.ndarray) -> float:
        eta = c @ x
        return float(np.sum(k * log_ndtr(eta) + (n - k) * log_ndtr(-eta)))

    def derivatives(c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        eta = c @ x
        rise, fall = inverse_mills_ratio(eta), inverse_mills_ratio(-eta)
        weight = k * rise * (rise + eta) + (n - k) * fall * (fall - eta)
        return x @ (k * rise - (n - k) * fall), (x * weight) @ x.T

    return maximum(likelihood, derivatives, np.array([-z.mean(), 1.0]))


def maximum(
    likelihood: Callable[[np.ndarray], float],
    derivatives: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    start: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Where a concave log likelihood is largest, by Newton's method, and the information there."""
    c, best = start, likelihood(start)
    for _ in range(100):
        slope, information = derivatives(c)  # the gradient, and minus the second derivatives
        step = np.linalg.solve(information, slope)
        if slope @ step < 1e-20 * max(abs(best), 1.0):
            break
        share = 1.0
        while (value := likelihood(c + share * step)) < best and share > 1e-9:
            share /= 2
        c, best = c + share * step, value
    return c, information


def inverse_mills_ratio(eta: np.ndarray) -> np.ndarray:
    """φ/Φ at η, the derivative of ln Φ(η); at −η that of ln Φ(−η) with the other sign."""
    return np.exp(-(eta**2) / 2 - np.log(2 * np.pi) / 2 - log_ndtr(eta))
