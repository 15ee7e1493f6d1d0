"""One search for a rare event by design points: pilot, points, samples, and doubts about them."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.special import ndtr

from jaxpound.risk.design_points import COVERED, NEAR, DesignPoints, find_design_points
from jaxpound.risk.kept import Kept
from jaxpound.risk.limit_state import LimitState, require_dependence
from jaxpound.risk.mixture import Mixture
from jaxpound.risk.rare_event import RAREST, RareEvent, always
from jaxpound.risk.sampling import BATCH, COMPILING, Samples, until_sure
from jaxpound.study.sampling import Points

OWNER = "rare_event"

COMMON = 0.04
"""Share of plain runs above which plain Monte Carlo is as good."""

_THIN, _LARGEST, _OUTSIDE = 0.1, 0.1, 0.1  # shares of the estimate that are told
_STRONGER = 0.5  # factor of the stronger motions, as a share of the nearest design point's distance
_MISSED = (2, 5)  # their failures far from all points that are many, after one batch and after two


@dataclasses.dataclass
class Search:
    """The state of a search."""

    state: LimitState
    cov: float
    """The coefficient of variation wanted."""
    most: int
    """Runs at most."""
    normal: Points
    """Standard normal points of d + 1 numbers: the last chooses a part of the mixture."""
    kept: Kept | None
    """The folder of the search."""
    bar: Any
    """The progress bar."""
    runs: int = 0
    """Runs so far."""

    def pilot(self) -> Samples:
        """The first batch of plain samples.

        Raises
        ------
        ValueError
            If the demand is no number, or the same in all runs however strong the motion.
        """
        self.bar.set_postfix_str(COMPILING)
        found = self._batch(0, None)
        require_dependence(OWNER, self.state, found.z, found.values)
        return found

    def points(self, numbers: tuple[int, ...], start: RareEvent | None) -> DesignPoints:
        """The design points, from those of another event or from random starts."""

        def told(gradients: int, nearest: float) -> None:
            found = f", nearest at {nearest:.3g}" if np.isfinite(nearest) else ""
            self.bar.set_postfix_str(f"{gradients} gradients{found}")

        def search() -> DesignPoints:
            state, before = self.state, 0
            if start is not None:
                found = find_design_points(state, numbers, _points_of(start, state), told)
                if len(found):
                    return found
                before = found.gradients
            found = find_design_points(state, numbers, None, told)
            return DesignPoints(*found[:5], before + found.gradients, *found[6:])

        self.bar.set_postfix_str("compiling the gradients")
        return search() if self.kept is None else self.kept.design_points(search)

    def plain(self, pilot: Samples, gradients: int) -> RareEvent:
        """The event of plain samples, where it is not rare."""
        sure = pilot.probability == 1
        found, state = pilot if sure else self._samples(None, self.most, pilot), self.state
        event = RareEvent(
            probability=found.probability,
            cov=found.cov,
            runs=self.runs,
            gradients=gradients,
            method="plain Monte Carlo: the event is not rare",
            limit_state=state,
            points=found.z,
            weights=found.weights,
            values=found.values,
            design_points=np.zeros((0, state.dimension)),
            instants=np.zeros(0),
            times=found.times,
        )
        warnings = [*self._unsure(event)]
        if sure:
            warnings.append(always(len(found)))
        return dataclasses.replace(event, warnings=tuple(warnings))

    def doubt(self, found: DesignPoints) -> str:
        """Why design points may not stand for all failures, in words; empty if nothing says so."""
        if not len(found):
            return "no gradients lead to the limit state"
        if found.failed > len(found):
            return "few gradients lead to the limit state"
        if found.covered < COVERED:
            return f"{1 - found.covered:.0%} of random starts end in design points of their own"
        return self._missed(found)

    def _missed(self, found: DesignPoints) -> str:
        """``doubt`` by motions that are so strong that likely failures are many among them.

        As far off as the nearest design point, a failure of any direction lies two of their
        standard deviations from the origin (Bucher 2009, Probabilistic Engineering Mechanics
        24:504, extrapolates probabilities from such samples; here they are only counted).
        """
        factor = max(1.0, _STRONGER * float(found.betas[0]))
        missed = 0
        for number, many in enumerate(_MISSED, 1):
            stronger = self._batch(number, None, factor)
            far = ~found.stand_for(stronger.z)
            missed += int(np.count_nonzero(far & (stronger.values >= 0)))
            if missed < many:
                return ""
        motions = f"{number * BATCH} random motions {factor:.2g} times as strong"
        return f"{missed} of {motions} fail far from all design points"

    def around(self, found: DesignPoints, doubt: str) -> RareEvent:
        """The event of samples around design points."""
        near, state = found.within(NEAR), self.state
        doubts = (f"{doubt}: compare with subset_simulation",) if doubt else ()
        event = RareEvent(
            probability=RAREST,
            cov=float("nan"),
            runs=self.runs,
            gradients=found.gradients,
            method="design points, no samples",
            limit_state=state,
            points=np.zeros((0, state.dimension)),
            weights=np.zeros(0),
            values=np.zeros(0),
            design_points=found.z,
            instants=np.where(found.instants < 0, np.nan, found.instants * state.grid.dt),
            series=found.series,
            form=near.form(),
        )
        if ndtr(-found.betas).sum() < RAREST:
            said = (
                f"out of reach: the probability is below {RAREST:g}, by the design points (the "
                f"nearest at {found.betas[0]:.3g}); the number is a bound and no estimate"
            )
            return dataclasses.replace(event, warnings=(said, *doubts))
        mixture = Mixture.of(found)
        samples = self._samples(mixture, self.most - self.runs)
        one = ", one an instant" if state.series else ""
        thin = samples.parts[mixture.thin(samples.z)].sum() / max(samples.parts.sum(), 1e-300)
        event = dataclasses.replace(
            event,
            probability=samples.probability,
            cov=samples.cov,
            runs=self.runs,
            method=f"importance sampling around {len(near)} design points{one}",
            points=samples.z,
            weights=samples.weights,
            values=samples.values,
            times=samples.times,
            thin=float(thin),
        )
        warnings = (*doubts, *self._unsure(event), *_doubtful(event, near))
        return dataclasses.replace(event, warnings=warnings)

    def _samples(self, mixture: Mixture | None, most: int, first: Samples | None = None) -> Samples:
        """Samples, as many as are needed: plain ones, or of a mixture."""
        batches = until_sure(lambda i: self._batch(i, mixture), self.cov, most, first)
        for found in batches:
            words = f"P = {found.probability:.3g}, c.o.v. {found.cov:.2g}"
            self.bar.set_postfix_str(words)
        return found

    def _batch(self, number: int, mixture: Mixture | None, factor: float = 1.0) -> Samples:
        """A batch of samples by its number: of a mixture, or plain ones times a factor."""
        ends = number * BATCH, (number + 1) * BATCH
        if mixture is None:
            z = factor * self.normal(*ends)[:, :-1]
            weights = np.ones(len(z))
        else:
            z = mixture.draw(self.normal, *ends)
            weights = mixture.weights(z)

        def run() -> tuple[np.ndarray, np.ndarray]:
            return self.state.values_and_times(z)

        if self.kept is None:
            values, times = run()
        else:
            values, times = self.kept.batch(number, plain=mixture is None, run=run)
        self.runs += BATCH
        self.bar.update(BATCH)
        return Samples(z, weights, values, times)

    def _unsure(self, event: RareEvent) -> Iterator[str]:
        if event.cov > self.cov:
            yield (
                f"the coefficient of variation is {event.cov:.2g} after {event.runs:,} runs, above "
                f"{self.cov:.2g}: raise max_runs = {self.most:,}"
            )
        failed = np.count_nonzero(~np.isfinite(event.values))
        if failed:
            yield f"{failed:,} of {len(event.values):,} runs failed and count as safe"


def _points_of(event: RareEvent, state: LimitState) -> DesignPoints:
    """The design points of an event from which the search of another limit state starts."""
    instants = event.instants / state.grid.dt
    return DesignPoints(
        z=event.design_points,
        directions=np.zeros_like(event.design_points),
        betas=np.linalg.norm(event.design_points, axis=1),
        instants=np.where(np.isnan(instants), -1, np.round(instants)).astype(int),
        series=event.series,
        gradients=0,
        failed=0,
    )


def _doubtful(event: RareEvent, near: DesignPoints) -> Iterator[str]:
    """Signs that failures were missed."""
    if event.thin > _THIN:
        yield (
            f"{event.thin:.0%} of the estimate comes from where few samples are drawn: there are "
            "failures that no design point stands for; compare with subset_simulation"
        )
    if event.largest_share > _LARGEST:
        yield (
            f"a single sample makes {event.largest_share:.0%} of the estimate: ask for a smaller "
            "cov, or compare with subset_simulation"
        )
    ends = near.instants * event.limit_state.grid.dt
    if (event.values >= 0).any() and (near.instants >= 0).all():
        times, shares = event.failures_by_instant
        period = 2 * np.pi
        outside = shares[(times < ends.min() - period / 2) | (times > ends.max() + period)].sum()
        if outside > _OUTSIDE:
            yield (
                f"{outside:.0%} of the estimate comes from runs whose demand is largest at times "
                "for which there is no design point; compare with subset_simulation"
            )
