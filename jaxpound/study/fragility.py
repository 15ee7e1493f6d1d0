"""Fragility: the probability of pounding against a measure of the shaking's intensity."""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import numpy as np
from jaxtyping import ArrayLike
from scipy.special import log_ndtr, ndtr, ndtri

from jaxpound._checks import Rule, count, enforce, instance, number, positive, real, require_share
from jaxpound._tables import Shown, Table
from jaxpound.ground.measure import Measure, known_unit
from jaxpound.ground.plausibility import tell

ANY_LINK = "any link"
"""Name of the curve of pounding at any of several links, beside those of "link 1" and so on."""

_BY_CHANCE = 3.0  # standard deviations: once in 700 pairs of stripes of one probability
_LEAST = 40.0  # −z from which Φ(z) is 0
_CELLS = 2000  # groups of neighbouring intensities that a bootstrap of many samples draws from


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Fragility(Shown):
    """A lognormal fragility function, P(pounding | im) = Φ(ln(im / θ) / β) (Baker 2015, eq. 1).

    ``fit_fragility`` makes one; it keeps the data, for the bootstrap and for figures. One that is
    known in numbers, of a handbook, is ``Fragility(median, dispersion)``.

    Raises
    ------
    ValueError
        If median or dispersion is not one number, positive and finite, or the covariance not of
        shape (2, 2); if measure tells another unit.

    Examples
    --------
    >>> curve = jp.Fragility(median=0.6, dispersion=0.4)
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
    that of White (1982), from the scatter of the scores too. NaN where it is not known."""
    intensity: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0))
    """Intensities of the data, shape (m,); none (m = 0) of a curve that is known in numbers."""
    pounding: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0, int))
    """How often there was pounding at each, shape (m,)."""
    trials: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0, int))
    """Number of runs at each, shape (m,)."""
    stripes: bool = True
    """Whether the data are multiple stripes, with chosen intensities, and not a cloud."""
    weights: np.ndarray | None = None
    """Weights of the runs at each intensity, shape (m,); None if all count the same."""
    unit: str = ""
    """Unit of the intensities, where it is known: of a study's column, or that of the measure."""
    measure: str = ""
    """The measure of intensity with its unit, such as ``"PGA (g)"``; empty where it is not known.
    ``HazardCurve.annual_rate_of`` refuses a fragility of another measure, or in another unit, than
    the curve's."""
    _of_counts: ClassVar[bool] = True  # fitted to them, which can then be resampled

    def __post_init__(self) -> None:
        owner = type(self).__name__
        for name in ("median", "dispersion"):
            (value,) = positive(owner, **{name: number(owner, name, getattr(self, name))})
            object.__setattr__(self, name, float(value))
        covariance = np.asarray(real(owner, "covariance", self.covariance), float)
        if covariance.shape != (2, 2):
            raise ValueError(f"{owner}: covariance of shape {covariance.shape} must be (2, 2)")
        object.__setattr__(self, "covariance", covariance)
        instance(owner, "measure", self.measure, str)
        of_measure, unit = Measure.of_text(self.measure).unit, known_unit(self.unit) or self.unit
        if unit and of_measure and of_measure != unit:
            rule = f"be in the unit of the intensities, {self.unit}"
            raise ValueError(f"{owner}: measure = {self.measure!r} must {rule}")
        object.__setattr__(self, "unit", unit or of_measure)

    @property
    def measured(self) -> Measure:
        """The measure of intensity, in the fragility's unit."""
        return dataclasses.replace(Measure.of_text(self.measure), unit=self.unit)

    @property
    def median_error(self) -> float:
        """Standard error of θ."""
        return float(self.median * self.covariance[0, 0] ** 0.5)

    @property
    def dispersion_error(self) -> float:
        """Standard error of β."""
        return float(self.covariance[1, 1] ** 0.5)

    def probability(self, intensity: ArrayLike) -> np.ndarray:
        """Probability of pounding at intensities ≥ 0, of their shape.

        Raises
        ------
        ValueError
            If an intensity is negative or not a number.
        """
        im = _not_negative("Fragility.probability", intensity)
        with np.errstate(divide="ignore"):
            z = np.log(im / self.median) / self.dispersion
        return ndtr(z)

    def band(
        self,
        intensity: ArrayLike,
        confidence: float = 0.95,
        replicates: int | None = None,
        seed: int = 0,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Pointwise band of ``probability``: by ``covariance``, or by bootstrap.

        By the covariance ln(im / θ) / β is taken as normal, to first order. By the bootstrap,
        stripes are resampled within each intensity, a cloud as a whole (one of more than 2,000
        samples after grouping neighbours into 2,000). Resamples without a fit are left out. Runs
        with weights, and a curve that was not fitted to counts (of capacities, of a regression, of
        numbers) are not resampled.

        Parameters
        ----------
        intensity
            Shape (k,).
        confidence
            Between 0 and 1.
        replicates
            Number of bootstrap samples; by default the band is that of the covariance. The
            bootstrap is too narrow with little data: its 95 % band of clouds of 40 runs holds the
            truth in 76 to 91 %, and of 6 stripes of 5, 10 and 20 runs in 79 to 89, 87 to 92 and 90
            to 94 %, that of the covariance in 95 % to 99 %; of 300 runs both hold it in 90 % or
            more.
        seed
            Seed of the resampling.

        Returns
        -------
        Lower and upper limit, shape (k,) each.

        Raises
        ------
        ValueError
            If an argument breaks its rule, or no resample can be fitted.
        """
        require_share("band", "confidence", confidence)
        at = _not_negative("band", intensity)
        resampled = self._of_counts and self.weights is None and self.intensity.size
        if replicates is None or not resampled:
            return self._first_order(at, confidence)
        count("band", "replicates", replicates)
        random = np.random.default_rng(seed)
        im, k, n = self.intensity, self.pounding, self.trials
        if not self.stripes:
            im, k, n = grouped(im, k, _CELLS)
        start = np.array([-np.log(self.median) / self.dispersion, 1 / self.dispersion])
        curves = []
        for _ in range(replicates):
            if self.stripes:
                k_drawn, n_drawn = random.binomial(n, k / n), n
            else:
                cells = np.concatenate([k, n - k])
                k_drawn, rest = random.multinomial(cells.sum(), cells / cells.sum()).reshape(2, -1)
                n_drawn = k_drawn + rest
            if not _no_maximum(im, k_drawn, n_drawn):
                (a, b), _ = _maximise(np.log(im), k_drawn, n_drawn, start)
                with np.errstate(divide="ignore"):
                    curves.append(ndtr(a + b * np.log(at)))
        if not curves:
            raise ValueError(f"band: none of {replicates} bootstrap samples can be fitted")
        tail = (1 - confidence) / 2
        low, high = np.quantile(curves, [tail, 1 - tail], axis=0)
        return low, high

    def _first_order(self, at: np.ndarray, confidence: float) -> tuple[np.ndarray, np.ndarray]:
        """``band`` by the covariance."""
        with np.errstate(divide="ignore"):
            z = np.maximum(np.log(at / self.median) / self.dispersion, -_LEAST)
        slope = -np.stack([np.ones_like(z), z], axis=-1) / self.dispersion
        error = np.sqrt(np.einsum("...i,ij,...j", slope, self.covariance, slope))
        reach = ndtri((1 + confidence) / 2) * error
        return ndtr(z - reach), ndtr(z + reach)

    def _tables(self) -> list[Table]:
        runs, pounding = int(self.trials.sum()), int(self.pounding.sum())
        where = f" at {len(self.intensity):,} intensities" if self.stripes else ""
        where += " with weights" * (self.weights is not None)
        return [
            Table(
                "Fragility P(pounding | im) = Φ(ln(im / θ) / β)",
                ("", "value", "standard error", "unit"),
                [
                    ("median θ", self.median, self.median_error, self.unit or "that of im"),
                    ("dispersion β", self.dispersion, self.dispersion_error, ""),
                ],
                [f"fitted to {runs:,} runs{where}, {pounding:,} with pounding"] if runs else [],
                digits=4,
            )
        ]


def fit_fragility(
    intensity: ArrayLike,
    pounding: ArrayLike,
    trials: ArrayLike | None = None,
    *,
    weights: ArrayLike | None = None,
    measure: str = "",
) -> Fragility:
    """Fit of a lognormal fragility function by maximum likelihood (Baker 2015, eq. 11).

    Parameters
    ----------
    intensity
        Intensities im > 0, shape (m,), such as ``study["pga"]``.
    pounding
        Without trials (a cloud): whether there was pounding, shape (m,), such as
        ``study["required_gap"] >= gap``, or pounding that exceeds a limit, such as
        ``study["peak_contact"] > limit``. With trials (multiple stripes): how often.
    trials
        Number of runs at each intensity, at least 1; shape (m,), or one number for all.
    weights
        Weight ≥ 0 of each run at an intensity, shape (m,), of any scale, such as those of
        importance samples: a run's share of the likelihood is raised to it. The covariance is then
        not that of as many runs as the weights' sum, but that of White (1982), of a likelihood that
        is not the distribution's own: H⁻¹ S H⁻¹ with H the information and S the sum of the squares
        of the scores.
    measure
        The measure of intensity with its unit, such as ``"PGA (g)"``, to be checked against that of
        a hazard curve.

    Raises
    ------
    ValueError
        If shapes differ, an intensity is not positive and finite, counts are not whole numbers
        from 0 to trials, or a weight is negative or not finite. If the likelihood has no maximum:
        pounding always or never, at all intensities above one and at none below, or not more often
        at higher intensities.

    Warns
    -----
    PlausibilityWarning
        If pounding is less frequent at an intensity than at a lower one by more than chance, of
        multiple stripes: demands that return.

    Examples
    --------
    >>> pga, pounding = [0.2, 0.4, 0.6, 0.8, 1.0], [1, 4, 9, 14, 18]
    >>> curve = jp.fit_fragility(pga, pounding, trials=[20] * 5)
    >>> round(curve.median, 3), round(curve.dispersion, 3)
    (0.59, 0.537)
    >>> round(float(curve.probability(0.5)), 3)
    0.379
    """
    owner = "fit_fragility"
    im, k = np.asarray(real(owner, "intensity", intensity), float), np.asarray(pounding)
    if k.dtype != bool:
        k = np.asarray(real(owner, "pounding", pounding))
    n = np.asarray(1 if trials is None else real(owner, "trials", trials))
    n = np.full(im.shape, n) if n.ndim == 0 else n
    if im.ndim != 1 or not im.size or k.shape != im.shape or n.shape != im.shape:
        raise ValueError(
            f"{owner}: intensity {im.shape}, pounding {k.shape} and trials {n.shape} must be (m,)"
        )
    enforce(
        owner,
        [
            Rule("intensity", im, (im > 0) & np.isfinite(im), "positive and finite"),
            Rule("trials", n, (n >= 1) & (n % 1 == 0), "whole numbers from 1 on"),
            Rule("pounding", k, (k >= 0) & (k <= n) & (k % 1 == 0), "from 0 to trials, whole"),
        ],
    )
    k, n = k.astype(int), n.astype(int)
    w, counted = None, np.ones(im.shape, bool)
    if weights is not None:
        w = _weights(owner, weights, im)
        counted = w > 0
    z, each = np.log(im[counted]), 1 if w is None else w[counted]
    hits, runs = k[counted], n[counted]
    if reason := _no_maximum(im[counted], each * hits, each * runs):
        raise ValueError(f"{owner}: pounding must leave something to fit, but {reason}")
    start = np.array([-z.mean(), 1.0])
    (a, b), information = _maximise(z, each * hits, each * runs, start)
    spread = np.linalg.inv(information)
    if w is not None:
        rise, fall = _ratios(a + b * z)
        squares = each**2 * (hits * rise**2 + (runs - hits) * fall**2)
        x = np.stack([np.ones_like(z), z])
        spread = spread @ (x * squares) @ x.T @ spread
    # From (a, b) of Φ(a + b ln im) to (ln θ, β) = (−a/b, 1/b).
    to = np.array([[-1 / b, a / b**2], [0.0, -1 / b**2]])
    median, dispersion = float(np.exp(-a / b)), float(1 / b)
    stripes = trials is not None
    if stripes and (drop := falls(im, k, n)):
        rule = "a fragility rises with the intensity, and does not fit"
        tell(owner, [f"pounding is there {drop}: {rule}"], strict=False)
    data = im, k, n, stripes, w
    return Fragility(median, dispersion, to @ spread @ to.T, *data, measure=measure)


def falls(im: np.ndarray, k: np.ndarray, n: np.ndarray) -> str:
    """Where pounding becomes less frequent as the intensity grows, in words; empty if nowhere.

    That is the pair of stripes whose shares k / n differ most by their standard deviation, if they
    had the same probability, and by more than chance has it.
    """
    order = np.argsort(im)
    im, k, n = im[order], k[order], n[order]
    low, high = np.triu_indices(im.size, 1)
    together = (k[low] + k[high]) / (n[low] + n[high])
    variance = together * (1 - together) * (1 / n[low] + 1 / n[high])
    fall = k[low] / n[low] - k[high] / n[high]
    z = np.where(fall > 0, fall, 0.0) / np.sqrt(np.where(fall > 0, variance, 1.0))
    if not z.size or z.max() < _BY_CHANCE:
        return ""
    i, j = low[np.argmax(z)], high[np.argmax(z)]
    return f"{k[i]} of {n[i]} times at {im[i]:.4g} and {k[j]} of {n[j]} at {im[j]:.4g}"


def _not_negative(owner: str, intensity: ArrayLike) -> np.ndarray:
    """Intensities, of which ∞ is one, too."""
    im = np.asarray(real(owner, "intensity", intensity), float)
    enforce(owner, [Rule("intensity", im, im >= 0, "not negative")])
    return im


def _weights(owner: str, weights: ArrayLike, im: np.ndarray) -> np.ndarray:
    """Weights of mean 1."""
    w = np.asarray(real(owner, "weights", weights), float)
    if w.shape != im.shape:
        raise ValueError(f"{owner}: weights {w.shape} must be {im.shape}, as intensity")
    right = (w >= 0) & np.isfinite(w)
    enforce(owner, [Rule("weights", w, right, "finite and not negative")])
    enforce(owner, [Rule("sum of the weights", w.sum(), w.sum() > 0, "positive")])
    return w / w.mean()


def _no_maximum(im: np.ndarray, k: np.ndarray, n: np.ndarray) -> str:
    """Why the likelihood of an increasing curve has no maximum; empty if it has one."""
    if not k.any() or (k == n).all():
        return "it is there " + ("always" if k.any() else "never")
    if im.min() == im.max():
        return f"all intensities are {im[0]:.6g}"
    with_it, without = im[k > 0], im[k < n]
    if with_it.min() >= without.max():
        return f"it is there always above im = {without.max():.6g} and never below"
    z = np.log(im)
    # The likelihood rises with the slope at slope zero if and only if this covariance is positive.
    if np.sum(z * (k - n * (k.sum() / n.sum()))) <= 0:
        return "it does not become more frequent as the intensity grows"
    return ""


def _maximise(
    z: np.ndarray, k: np.ndarray, n: np.ndarray, start: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Newton's method for (a, b) of P = Φ(a + b z), whose log likelihood is concave.

    Returns (a, b) and the observed information there, shape (2, 2).
    """
    x = np.stack([np.ones_like(z), z])

    def likelihood(c: np.ndarray) -> float:
        eta = c @ x
        return float(np.sum(k * log_ndtr(eta) + (n - k) * log_ndtr(-eta)))

    c, best = start, likelihood(start)
    for _ in range(100):
        eta = c @ x
        rise, fall = _ratios(eta)
        slope = x @ (k * rise - (n - k) * fall)
        weight = k * rise * (rise + eta) + (n - k) * fall * (fall - eta)
        information = (x * weight) @ x.T
        step = np.linalg.solve(information, slope)
        if slope @ step < 1e-20 * max(abs(best), 1.0):
            break
        share = 1.0
        while (value := likelihood(c + share * step)) < best and share > 1e-9:
            share /= 2
        c, best = c + share * step, value
    return c, information


def _ratios(eta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """φ/Φ at η and at −η: derivatives of ln Φ(η), and of ln Φ(−η) with the other sign."""
    density = -(eta**2) / 2 - np.log(2 * np.pi) / 2
    return np.exp(density - log_ndtr(eta)), np.exp(density - log_ndtr(-eta))


def grouped(im: np.ndarray, k: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A cloud grouped into at most ``most`` stripes of neighbours, each at its mean of ln im."""
    parts = np.array_split(np.argsort(im), min(most, im.size))
    centre = np.array([np.exp(np.mean(np.log(im[part]))) for part in parts])
    return centre, np.array([k[part].sum() for part in parts]), np.array([len(x) for x in parts])
