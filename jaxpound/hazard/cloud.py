"""Cloud analysis: demands of unscaled records, regressed on their intensity."""

from __future__ import annotations

import dataclasses
from os import PathLike

import numpy as np
from jaxtyping import ArrayLike

from jaxpound._checks import Rule, array, enforce, positive, positive_number
from jaxpound._errors import InvalidInput, resumable
from jaxpound._tables import Shown, TextTable
from jaxpound.hazard.analysis import Analysis, SuiteRuns, single_suite
from jaxpound.hazard.capacities import CensoredRegression, regression
from jaxpound.model.topology import Topology
from jaxpound.results import named
from jaxpound.study.fragility import Fragility

_LEAST_SIGMA = 1e-9  # below it σ is the rounding of a power law


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Cloud(Shown):
    """Demands of records and their regression, ln demand = a + b ln im + ε, ε normal."""

    intensity: np.ndarray
    """Intensity of each record, shape (n,)."""
    demand: np.ndarray
    """Demand of each record, or its lower bound where it is censored, shape (n,)."""
    censored: np.ndarray
    """Whether only a bound is known, shape (n,)."""
    line: CensoredRegression
    """a, b and the standard deviation σ of ε, with their covariance."""
    name: str = "demand"
    """Name of the demand."""
    measure: str = "intensity"
    """The measure of intensity, with its unit."""
    threshold: float | None = None
    """The threshold of the analysis, in the demand's unit, if there was one."""
    topology: Topology | None = None

    @property
    def intercept(self) -> float:
        """a, the logarithm of the median demand at intensity 1."""
        return float(self.line.coefficients[0])

    @property
    def slope(self) -> float:
        """b; 1 where the demand is proportional to the intensity."""
        return float(self.line.coefficients[1])

    @property
    def dispersion(self) -> float:
        """σ, standard deviation of ln demand at an intensity."""
        return self.line.sigma

    def median(self, intensity: ArrayLike) -> np.ndarray:
        """Median demand e^a im^b at intensities > 0, of their shape."""
        (im,) = positive(intensity=intensity)
        return np.asarray(np.exp(self.intercept) * np.asarray(im, float) ** self.slope)

    def fragility(self, threshold: float | None = None) -> Fragility:
        """Probability that the demand reaches a threshold, over intensity.

        θ = (threshold / e^a)^(1/b) and β = σ / b; their covariance follows from the regression's.
        ``threshold``, in the demand's unit, > 0, is by default that of the analysis. Raises
        ``ValueError`` if there is none or it is not positive, or the demand does not grow with the
        intensity.
        """
        threshold = self.threshold if threshold is None else threshold
        if threshold is None:
            raise InvalidInput("threshold", "None", "must be a number: the cloud has none")
        positive_number(threshold=threshold)
        a, b, sigma = self.intercept, self.slope, self.dispersion
        enforce([Rule("slope b", b, b > 0, "positive: the demand grows with intensity")])
        log_median = (np.log(threshold) - a) / b
        to = np.array([[-1 / b, -log_median / b, 0.0], [0.0, -sigma / b**2, 1 / b]])
        reached = (self.demand >= threshold).astype(int)
        return Fragility(
            float(np.exp(log_median)),
            sigma / b,
            to @ self.line.covariance @ to.T,
            *(self.intensity, reached, np.ones_like(reached), False),
            measure=self.measure,
            source=f"from the regression of {reached.size} demands, {reached.sum()} of them at "
            "least the threshold",
            event=named.event_in_words(self.name, threshold, True, self.topology),
        )

    def _tables(self) -> list[TextTable]:
        errors = np.sqrt(np.diag(self.line.covariance))
        values = (self.intercept, self.slope, self.dispersion)
        names = ("intercept a", "slope b", "dispersion σ")
        n, bounds = len(self.intensity), int(self.censored.sum())
        words = named.demand_in_words(self.name, self.topology)
        notes = [f"{words} of {n} records over {self.measure}"]
        notes += [f"of {bounds} only a lower bound is known"] if bounds else []
        rows = list(zip(names, values, map(float, errors), strict=True))
        title = "Cloud: ln demand = a + b ln im + ε"
        return [TextTable(title, ("", "value", "standard error"), rows, notes, digits=4)]


def fit_cloud(
    intensity: ArrayLike,
    demand: ArrayLike,
    limit: ArrayLike | None = None,
    *,
    measure: str = "intensity",
) -> Cloud:
    """Regression of the logarithm of a demand on that of intensity (Cornell et al. 2002).

    Its ``fragility(threshold)`` is the probability of reaching a threshold. Raises ``ValueError``
    if shapes differ, a number is not positive and finite, all intensities are equal, or fewer than
    three demands are below the limit.

    Parameters
    ----------
    intensity
        Intensities > 0, shape (n,), such as ``study["pga"]``.
    demand
        Demands > 0, shape (n,), such as ``study["required_gap"]``.
    limit
        Demands above it are censored: they count as at least the limit, as where a run has no
        meaning any more. A number or shape (n,); by default there is none.
    measure
        See ``fit_fragility``.

    Examples
    --------
    >>> im, gaps = [0.1, 0.2, 0.4, 0.8], [0.01, 0.03, 0.05, 0.12]
    >>> cloud = jp.hazard.fit_cloud(im, gaps)
    >>> round(cloud.slope, 3), round(cloud.dispersion, 3)
    (1.149, 0.17)
    >>> curve = cloud.fragility(threshold=0.05)
    >>> round(curve.median, 3), round(curve.dispersion, 3)
    (0.371, 0.148)
    """
    im, y = (np.asarray(x, float) for x in positive(intensity=intensity, demand=demand))
    if im.ndim != 1 or y.shape != im.shape:
        raise InvalidInput(f"intensity {im.shape} and demand {y.shape}", "", "must be (n,)")
    bound = np.full(im.shape, np.inf)
    if limit is not None:
        (limit,) = positive(limit=array("limit", limit, (), im.shape))
        bound = np.broadcast_to(limit, im.shape)
    censored = y >= bound
    if (~censored).sum() < 3 or np.ptp(im[~censored]) == 0:
        rule = "must hold those of at least 3 records of different intensity, below the limit"
        raise InvalidInput("demand", "", rule)
    y = np.minimum(y, bound)
    line = regression(np.column_stack([np.ones_like(im), np.log(im)]), np.log(y), censored)
    rule = "positive: demands that are a power of the intensity leave nothing to estimate"
    enforce([Rule("dispersion σ", line.sigma, line.sigma > _LEAST_SIGMA, rule)])
    return Cloud(im, y, censored, line, measure=measure)


@resumable("store")
def cloud_analysis(
    analysis: Analysis,
    *,
    limit: float | None = None,
    store: str | PathLike[str] | None = None,
    progress: bool = True,
) -> Cloud:
    """The demand of each unscaled record of an analysis, and its regression on intensity.

    The records are of one suite; the threshold is positive, and needed where the gaps at rest of
    several links differ. ``limit``, in the demand's unit, is as of ``fit_cloud``, ``store`` and
    ``progress`` as of ``incremental_dynamic_analysis``, and so are errors.
    """
    level, name, words, topology = single_suite(analysis).about
    if name == named.OVERLAP:
        rule = "must be a gap: those at rest of the links differ, and overlaps have no logarithm"
        raise InvalidInput("threshold", "None", rule)
    if analysis.threshold is not None:
        positive_number(threshold=analysis.threshold)
    im = analysis.unscaled
    runs = SuiteRuns(analysis, im, store, progress)
    with runs.bar:
        demands = runs.run(np.arange(len(im)), im)
    cloud = fit_cloud(im, demands, limit, measure=words)
    threshold = level if level > 0 else None  # the gap at rest may be 0
    return dataclasses.replace(cloud, name=name, threshold=threshold, topology=topology)
