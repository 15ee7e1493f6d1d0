"""Importance sampling around design points: the density, its samples, diagnostics and files.

The density is normal around every design point. A share of the samples is drawn from a guard, a
wide density that also reaches failures for which no design point was found: the standard normal
widened along the directions that the design points span. It bounds the weights, and where its
samples reach the limit state away from the design points, the estimate has a warning.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import log_ndtr, logsumexp, ndtr

from jaxpound._errors import InvalidInput, warn
from jaxpound.reliability.design_points import COVERED, DesignPoints, find_design_points
from jaxpound.reliability.limit_state import COMPILING, LimitState, SearchRuns, require_dependence
from jaxpound.reliability.result import NO_ESTIMATE, RAREST, RareEvent, Samples, always
from jaxpound.scenarios.sampling import Points, as_key, key_numbers, points
from jaxpound.store.archive import DamagedError, digest, opened, write_archive

BATCH = 256  # runs: sample i is in batch i // 256 on every machine
_GUARD = 0.1  # share of the samples from the guard
_SPARSE = 0.1  # share of the guard's density below which that around the design points is thin
_SPANNED = 0.9  # share of the squared singular values of the directions that the guard widens

COMMON = 0.04  # share of plain runs above which plain Monte Carlo is as good
_FEWEST, _FEWEST_HITS = 2, 10  # batches and samples that reach it before a c.o.v. is believed
_MISSED = (2, 5)  # failures far from all points, in one and two batches of stronger motions
_THIN, _LARGEST, _OUTSIDE = 0.1, 0.1, 0.1  # shares of the estimate from which there is a warning
_NEARLY = 0.75  # share of the way to a linearised limit state, from which on no point is far
_STRONGER = 0.5  # factor of the stronger motions, as a share of the nearest design point's distance

_POINTS_FILE = "design-points.npz"
_COLUMNS = ("batch", "plain", "value", "time")
_FORMAT = 2  # 1: until version 0.2 each batch had a chunk of its own
_ARRAYS = {  # of design points: axes and type
    **{"z": (2, np.float64), "directions": (2, np.float64), "betas": (1, np.float64)},
    **{"instants": (1, np.int64), "series": (1, np.int64)},
}


class Mixture(NamedTuple):
    """A normal mixture: q(z) = (1 − g) Σ w_k φ(z − z_k) + g φ(z) widened in the span of a basis."""

    centres: Float[np.ndarray, "k d"]
    log_weights: Float[np.ndarray, " k"]
    basis: Float[np.ndarray, "r d"]
    wide: float  # standard deviation of the guard along the basis

    @staticmethod
    def of(points: DesignPoints) -> Mixture:
        """The mixture of design points, each weighted by the probability beyond its plane."""
        near = points.near
        logs = log_ndtr(-near.betas)
        _, sizes, rows = np.linalg.svd(near.directions, full_matrices=False)
        rank = int(np.searchsorted(np.cumsum(sizes**2) / np.sum(sizes**2), _SPANNED)) + 1
        return Mixture(near.z, logs - logsumexp(logs), rows[:rank], max(1.5, near.betas[0] / 2))

    def draw(self, points: Points, start: int, stop: int) -> Float[np.ndarray, "n d"]:
        """Samples start to stop − 1, each by its number alone, from points of d + 1 numbers."""
        normal = points(start, stop)
        y, chance = normal[:, :-1], ndtr(normal[:, -1])
        ends = np.cumsum((1 - _GUARD) * np.exp(self.log_weights))
        part = np.searchsorted(ends, chance)
        centred = y + self.centres[np.minimum(part, len(ends) - 1)]
        widened = y + (self.wide - 1) * (y @ self.basis.T) @ self.basis
        return np.where((part == len(ends))[:, None], widened, centred)

    def log_ratios(self, z: Float[np.ndarray, "n d"]) -> tuple[np.ndarray, np.ndarray]:
        """Logarithms of q/φ and of the guard's density over that around the design points."""
        constants = self.log_weights - 0.5 * np.sum(self.centres**2, axis=1)
        around = logsumexp(z @ self.centres.T + constants, axis=1)
        along = np.sum((z @ self.basis.T) ** 2, axis=1)
        guard = 0.5 * along * (1 - self.wide**-2) - len(self.basis) * np.log(self.wide)
        return np.logaddexp(np.log1p(-_GUARD) + around, np.log(_GUARD) + guard), guard - around


class DesignPointSearch:
    """A search for the probability of a limit state by its design points; see ``rare_event``."""

    def __init__(
        self,
        state: LimitState,
        cov: float,
        most: int,
        key: Any,
        start: RareEvent | None,
        folder: str | PathLike[str] | None,
        bar: Any,
    ) -> None:
        self.runs = self.gradients = 0  # so far
        self._state, self._cov, self._most, self._bar = state, cov, most, bar
        kind, self._numbers = key_numbers(key)
        # Of d + 1 numbers: the last selects a part of the mixture.
        self._normal = points("plain", as_key(kind, self._numbers), state.dimension + 1)
        self._start, self._folder = start, None if folder is None else Path(folder)
        design_points = None if start is None else start.design_points.z
        search, more = "a search by design points", {"start": design_points, "format": _FORMAT}
        # Batches by number, and whether they are plain; their samples are drawn again.
        self._stored = SearchRuns(folder, search, state, key, _COLUMNS, BATCH, **more)

    def event(self, only_by_points: bool) -> RareEvent | str:
        """The event, or a sign that design points do not stand for all failures, in words."""
        points = None if self._start is None else self._design_points()
        if points is None or not points.form() <= COMMON / 2:  # NaN without points
            self._bar.set_postfix_str(COMPILING)
            pilot = self._batch(0, None)
            require_dependence(self._state, pilot.points, pilot.values)
            if pilot.probability > COMMON:
                return self._plain(pilot)
        points = self._design_points() if points is None else points
        doubt = self._doubt(points)
        if not doubt or (only_by_points and len(points)):
            return self._around(points, doubt)
        if only_by_points:
            rule = f"must lead to the limit state, but none of {points.failed} searches has"
            rule += " reached it; use the method 'subset', or in reach_probability another value to"
            raise InvalidInput("gradients", "", f"{rule} start from")
        return doubt

    def _design_points(self) -> DesignPoints:
        """The design points: from their file, or sought from those of the start, or at random."""
        self._bar.set_postfix_str("compiling the gradients")
        points = self._search() if self._folder is None else self._stored_points(self._folder)
        self.gradients += points.gradients
        self.runs += points.runs
        self._bar.update(points.runs)
        return points

    def _search(self) -> DesignPoints:
        def report(gradients: int, nearest: float) -> None:
            distance = f", nearest at {nearest:.3g}" if np.isfinite(nearest) else ""
            self._bar.set_postfix_str(f"{gradients} gradients{distance}")

        gradients = runs = 0
        if self._start is not None:
            steps = self._start.limit_state.grid.dt / self._state.grid.dt
            first = self._start.design_points.start(steps)
            near = find_design_points(self._state, self._numbers, first, report)
            if len(near):
                return near
            gradients, runs = near.gradients, near.runs
        far = find_design_points(self._state, self._numbers, None, report)
        return dataclasses.replace(far, gradients=gradients + far.gradients, runs=runs + far.runs)

    def _stored_points(self, folder: Path) -> DesignPoints:
        """The design points of the folder's file; of ``_search`` and written there, without one."""
        seal = digest(repr(sorted(self._stored.identity.items())).encode())
        path, counts = folder / _POINTS_FILE, ("gradients", "failed", "covered", "runs")
        try:
            with opened(path) as archive:
                about = archive.about
                if about["study"] != seal:
                    raise DamagedError("of another search")
                if not about.keys() >= {*counts}:
                    raise DamagedError("of an older version")
                fields: dict[str, Any] = {name: about[name] for name in counts}
                for name, (axes, kind) in _ARRAYS.items():
                    fields[name] = archive.read(name, tuple(about["shape"][:axes]), kind)
                return DesignPoints(**fields)
        except DamagedError as error:
            damage = f"{_POINTS_FILE} is damaged ({error}); it is made anew"
            warn([f"store {folder}: {damage}"], category=UserWarning)
        except FileNotFoundError:
            pass
        points = self._search()
        about = {name: getattr(points, name) for name in counts}
        arrays = {name: np.asarray(getattr(points, name), x) for name, (_, x) in _ARRAYS.items()}
        write_archive(path, arrays, {"study": seal, **about, "shape": [*points.z.shape]})
        return points

    def _plain(self, pilot: Samples) -> RareEvent:
        """The event of plain samples, where it is not rare."""
        sure = pilot.probability == 1
        samples = pilot if sure else self._samples(None, self._most, pilot)
        points = DesignPoints.none(self._state.dimension)
        bound = [always(len(samples))] if sure else []
        method = "plain Monte Carlo: the event is not rare"
        return self._event(samples, points, method, [*self._unsure(samples), *bound])

    def _doubt(self, points: DesignPoints) -> str:
        """A sign that design points do not stand for all failures, in words; empty without one."""
        if not len(points):
            return "no gradients lead to the limit state"
        if points.failed > len(points):
            return "few gradients lead to the limit state"
        if points.covered < COVERED:
            return f"{1 - points.covered:.0%} of random starts end in design points of their own"
        # Motions that are so strong that likely failures are many among them: failures at the
        # distance of the nearest design point, in any direction, lie two standard deviations of
        # these motions from the origin (Bucher 2009, Probabilistic Engineering Mechanics 24:504,
        # extrapolates probabilities from such samples; here they are counted).
        factor = max(1.0, _STRONGER * float(points.betas[0]))
        missed = 0
        for number, many in enumerate(_MISSED, 1):
            stronger = self._batch(number, None, factor)
            reached = stronger.points @ points.directions.T >= _NEARLY * points.betas
            far = ~reached.any(axis=1)
            missed += int(np.count_nonzero(far & (stronger.values >= 0)))
            if missed < many:
                return ""
        motions = f"{number * BATCH} random motions {factor:.2g} times as strong"
        return f"{missed} of {motions} fail far from all design points"

    def _around(self, points: DesignPoints, doubt: str) -> RareEvent:
        """The event of samples around design points, about which there is a doubt in words."""
        state = self._state
        doubts = (f"{doubt}: compare with subset_simulation",) if doubt else ()
        if ndtr(-points.betas).sum() < RAREST:
            by = f"by the design points (the nearest at {points.betas[0]:.3g})"
            bound = f"out of reach: the probability is below {RAREST:g}, {by}; {NO_ESTIMATE}"
            none = Samples(np.zeros((0, state.dimension)), *np.zeros((2, 0)))
            return self._event(none, points, "design points, no samples", [bound, *doubts])
        mixture = Mixture.of(points)
        samples = self._samples(mixture, self._most - self.runs)
        method = f"importance sampling around {len(mixture.centres)} design points"
        method += ", one an instant" if state.series else ""
        is_thin = mixture.log_ratios(samples.points)[1] > -np.log(_SPARSE)
        thin = float(samples.parts[is_thin].sum() / max(samples.parts.sum(), 1e-300))
        signs = *self._unsure(samples), *signs_of_missed_failures(state, samples, points, thin)
        return self._event(samples, points, method, [*doubts, *signs], thin)

    def _event(
        self,
        samples: Samples,
        points: DesignPoints,
        method: str,
        warnings: list[str],
        thin: float = np.nan,
    ) -> RareEvent:
        estimate = (samples.probability, samples.cov) if len(samples) else (RAREST, np.nan)
        about: Any = {"method": method, "thin": thin, "warnings": tuple(warnings)}
        counted = self.runs, self.gradients
        return RareEvent(self._state, samples, *estimate, points, *counted, **about)

    def _samples(self, mixture: Mixture | None, most: int, first: Samples | None = None) -> Samples:
        """Samples, as many as are needed: plain ones, or of a mixture; ``first`` is batch 0."""
        samples, batches = self._batch(0, mixture) if first is None else first, 1
        while True:
            self._bar.set_postfix_str(f"P = {samples.probability:.3g}, c.o.v. {samples.cov:.2g}")
            hits = np.count_nonzero(samples.values >= 0)
            sure = samples.cov <= self._cov and hits >= _FEWEST_HITS and batches >= _FEWEST
            if sure or (batches + 1) * BATCH > most:
                return samples
            samples, batches = samples.joined(self._batch(batches, mixture)), batches + 1

    def _batch(self, number: int, mixture: Mixture | None, factor: float = 1.0) -> Samples:
        """A batch of samples by its number: of a mixture, or plain ones times a factor."""
        ends = number * BATCH, (number + 1) * BATCH
        if mixture is None:
            z = factor * self._normal(*ends)[:, :-1]
            weights = np.ones(len(z))
        else:
            z = mixture.draw(self._normal, *ends)
            weights = np.exp(-mixture.log_ratios(z)[0])
        name = number, int(mixture is None)
        values, times = self._stored.results({name: z}, self._state.values_and_times)[name]
        self.runs += BATCH
        self._bar.update(BATCH)
        return Samples(z, weights, values, times)

    def _unsure(self, samples: Samples) -> Iterator[str]:
        if samples.cov > self._cov:
            reached = f"the coefficient of variation is {samples.cov:.2g} after {self.runs:,} runs"
            yield f"{reached}, above {self._cov:.2g}: raise max_runs = {self._most:,}"
        if failed := np.count_nonzero(~np.isfinite(samples.values)):
            yield f"{failed:,} of {len(samples):,} runs failed and count as safe"


def signs_of_missed_failures(
    state: LimitState, samples: Samples, points: DesignPoints, thin: float
) -> Iterator[str]:
    """Signs that failures were missed, in sentences."""
    near = points.near
    if thin > _THIN:
        source = f"{thin:.0%} of the estimate comes from where few samples are drawn"
        reason = "there are failures that no design point stands for"
        yield f"{source}: {reason}; compare with subset_simulation"
    if samples.largest_share > _LARGEST:
        share = f"a single sample makes {samples.largest_share:.0%} of the estimate"
        yield f"{share}: ask for a smaller cov, or compare with subset_simulation"
    ends = near.instants * state.grid.dt
    if (samples.values >= 0).any() and (near.instants >= 0).all():
        times, shares = samples.failures_by_instant
        period = 2 * np.pi * (state.grid.dt / state.time_step)
        outside = shares[(times < ends.min() - period / 2) | (times > ends.max() + period)].sum()
        if outside > _OUTSIDE:
            source = f"{outside:.0%} of the estimate comes from runs whose demand is largest at"
            reason = "times for which there is no design point"
            yield f"{source} {reason}; compare with subset_simulation"
