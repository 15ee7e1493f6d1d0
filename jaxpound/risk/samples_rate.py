"""The annual rate of pounding by earthquakes that a hazard draws, band by band of intensity."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from jaxpound._checks import Rule, enforce, hint, real
from jaxpound.risk.rare_event import RareEvent
from jaxpound.study.scenarios import parameter_names, parameters
from jaxpound.study.study import Study
from jaxpound.study.weighting import Hits

_WIDER = 1e-6  # of the outermost bands, so that the samples at their ends are within


@dataclasses.dataclass(frozen=True, eq=False)
class SamplesRate:
    """The rate of earthquakes times the weights of the samples that pound, by their intensity."""

    measure: str
    """Name of the intensity, with its unit."""
    rate: float
    """Earthquakes a year, of which the samples are some."""
    intensity: np.ndarray
    """Of the samples, shape (n,)."""
    hits: np.ndarray
    """Whether they pound, shape (n,)."""
    weights: np.ndarray
    """Shape (n,)."""
    normalised: bool
    """See ``Study.weighted``."""
    repeats: np.ndarray | None = None
    """Number of the repeat of each sample, shape (n,), if those of one are not independent."""

    def edges(self, bands: int) -> np.ndarray:
        """Edges of bands that hold all samples that pound."""
        those = self.intensity[self.hits]
        return np.geomspace(those.min() / (1 + _WIDER), those.max() * (1 + _WIDER), bands + 1)

    def parts(self, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The rate from each band, its upper edge excluded, and its c.o.v. by the samples."""
        n, w = edges.size - 1, self.weights
        band = np.searchsorted(edges, self.intensity, side="right") - 1
        band[self.intensity == edges[-1]] = n - 1
        those = self.hits & (band >= 0) & (band < n)
        at, of_those = band[those], w[those]
        hit: Any
        square: Any
        hit, square = (np.bincount(at, x, minlength=n) for x in (of_those, of_those**2))
        sums = Hits(w.size, w.sum(), (w**2).sum(), hit, square)  # of all bands at once
        p = hit / (sums.weight if self.normalised else sums.n)
        variance = sums.variance(p, self.normalised)
        if self.repeats is not None:
            _, repeat = np.unique(self.repeats, return_inverse=True)
            m = repeat.max() + 1
            each = np.bincount(repeat[those] * n + at, of_those, minlength=m * n).reshape(m, n)
            # The mean over all samples is that of m repeats of the same size.
            variance = (each * m / w.size).var(axis=0, ddof=1) / m
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.rate * p, np.where(hit > 0, np.sqrt(variance) / p, np.nan)


def of_study(
    rate: float, study: Study, gap: float | None, link: int | None
) -> Callable[[str, Any], SamplesRate]:
    """Of a study whose intensities are those of the hazard, and the pounding at a gap."""

    def by(owner: str, intensity: Any) -> SamplesRate:
        name = "pga" if intensity is None else intensity
        if isinstance(name, str) and name in study.columns:
            measure, x = str(study.measure(name)), study[name]
        elif isinstance(name, str):
            known = study.parameters()
            measure, x = name, _named(owner, name, known, [*study.columns, *known])
        else:
            measure, x = "intensity", _numbers(owner, name, len(study))
        pounding = study.pounding(gap, link=link)
        good = ~np.isnan(pounding)
        hits = pounding[good] == 1
        _require_positive(owner, x[good][hits])
        return SamplesRate(measure, rate, x[good], hits, study.weights[good], study.normalised)

    return by


def of_event(rate: float, event: RareEvent) -> Callable[[str, Any], SamplesRate]:
    """Of a rare event whose scenarios draw the intensity by the hazard."""

    def by(owner: str, intensity: Any) -> SamplesRate:
        scenarios = event.limit_state.scenarios
        if intensity is None or isinstance(intensity, str):
            names = parameter_names(scenarios)
            if intensity is None:
                rule = f"a parameter, {', '.join(names[-6:])}, or a number for each sample"
                raise ValueError(f"{owner}: intensity = None must be {rule}, of a rare event")
            known = jax.jit(jax.vmap(lambda z: parameters(scenarios, z)))(event.points)
            measure, x = intensity, _named(owner, intensity, known, names)
        else:
            measure, x = "intensity", _numbers(owner, intensity, len(event.values))
        hits = event.values >= 0
        _require_positive(owner, x[hits])
        repeats = event.repeats if event.repeats.size else None
        return SamplesRate(measure, rate, x, hits, event.weights, False, repeats)

    return by


def _named(owner: str, name: str, known: Any, names: Any) -> np.ndarray:
    if name not in known:
        raise ValueError(f"{owner}: unknown intensity = {name!r}; {hint(name, names)}")
    return np.asarray(known[name], float)


def _numbers(owner: str, value: Any, n: int) -> np.ndarray:
    x = np.asarray(real(owner, "intensity", value), float)
    if x.shape != (n,):
        raise ValueError(f"{owner}: intensity of shape {x.shape} must be ({n},)")
    return x


def _require_positive(owner: str, x: np.ndarray) -> None:
    if not x.size:
        raise ValueError(f"{owner}: a sample must pound, for its intensity to be told")
    right = (x > 0) & np.isfinite(x)
    enforce(owner, [Rule("intensity", x, right, "positive and finite in samples that pound")])
