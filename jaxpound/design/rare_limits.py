"""Limits on the probability of rare events: their estimates at one design after another.

The logarithm of a small probability is nearly linear in a design, so that a search may take it as
what its value and slopes at the last design say, which come from samples of the rare event. After
the search it is estimated anew, at the design found.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound._checks import Rule, enforce
from jaxpound.design.problem import OWNER, DesignProblem, LogRatios
from jaxpound.model.parameters import get, put
from jaxpound.model.system import Structures
from jaxpound.results.demand import kind_of
from jaxpound.risk.limit_state import LimitState
from jaxpound.risk.rare_event import RAREST, RareEvent
from jaxpound.risk.run import event_of
from jaxpound.study.scenarios import ScenarioSet, discrete_coordinates, parameter_names

TOLERANCE = 0.1
"""Relative excess over a limit on a probability that is tolerated."""

_COV = TOLERANCE / 3  # of each estimate


@dataclasses.dataclass(frozen=True, eq=False)
class OfDesign:
    """Random scenarios of a design: its structures, but for those parameters that are drawn."""

    scenarios: ScenarioSet
    nominal: Structures
    drawn: tuple[str, ...]

    @property
    def dimension(self) -> int:
        """Number of standard normal numbers."""
        return self.scenarios.dimension

    @property
    def discrete(self) -> tuple[int, ...]:
        """Indices of the discrete ones."""
        return tuple(discrete_coordinates(self.scenarios))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(parameter_names(self.scenarios))

    def realize(self, z: Any) -> tuple[Structures, Any]:
        """The scenario drawn by z: structures and ground motion."""
        structures, ground = self.scenarios.realize(z)
        return put(self.nominal, {path: get(structures, path) for path in self.drawn}), ground


class Estimated(NamedTuple):
    """The rare events of a design, by the demand that is limited, and their slopes there."""

    events: dict[str, RareEvent]
    log_ratios: LogRatios


def limit_states(problem: DesignProblem) -> dict[str, LimitState]:
    """The events whose probabilities a problem limits, by the demand's name.

    Raises
    ------
    ValueError
        If the ensemble was not drawn, a probability is too small to be estimated, or a demand is no
        limit state.
    """
    ensemble, nominal, states = problem.ensemble, problem.space.nominal, {}
    for name in problem.objective.rare:
        limit, place = problem.objective.limits[name], f"{OWNER}: objective: limits: {name}"
        if ensemble.scenarios is None:
            rule = "needs an ensemble that is drawn (Ensemble.drawn)"
            raise ValueError(f"{place}: a probability {rule}")
        enforce(
            place, [Rule("probability", limit.most, limit.most >= RAREST, f"at least {RAREST:g}")]
        )
        at_most = limit.at_most
        if at_most is not None and problem.scales is not None:
            at_most /= float(problem.scales.unit_of(kind_of(name)))
        scenarios = OfDesign(ensemble.scenarios, nominal, tuple(ensemble.uncertain))
        try:
            states[name] = LimitState(scenarios, problem.grid, problem.scheme, name, at_most)
        except ValueError as error:
            raise ValueError(f"{place}: {error}") from error
    return states


class RareLimits:
    """Estimates of limited probabilities, at one design after another.

    Parameters
    ----------
    problem
        The problem.
    states
        Its ``limit_states``.
    key
        A seed: samples of all designs are drawn by it.
    save
        The file of the search, beside which the estimates are kept, or None.
    progress
        Whether to show bars.
    """

    def __init__(
        self,
        problem: DesignProblem,
        states: Mapping[str, LimitState],
        key: int,
        save: str | PathLike[str] | None,
        progress: bool,
    ) -> None:
        self._problem, self._states = problem, states
        self._key, self._progress = key, progress
        self._folder = None if save is None else Path(save).with_suffix(".events")
        self._made = 0
        self._last: dict[str, RareEvent] = {}

    def at(self, scaled: np.ndarray) -> Estimated:
        """Events at a design, with the slopes of their logarithms.

        Raises
        ------
        ValueError
            If the probability of one cannot be estimated, or it is certain.
        """
        events = {name: self._event(name, scaled) for name in self._states}
        by_scaled = jax.jacobian(self._problem.space.values)(jnp.asarray(scaled))
        logs, slopes = [], []
        for name, event in events.items():
            p = self._problem.objective.limits[name].most
            logs.append(math.log(max(event.probability, RAREST) / p))
            if math.isfinite(event.cov):
                found = event.slopes
                of_design = [found[path].value * np.asarray(x) for path, x in by_scaled.items()]
                slopes.append(np.sum(of_design, axis=0))
            else:  # rarer than can be estimated
                slopes.append(np.zeros(len(scaled)))
        d, k = len(scaled), len(logs)
        numbers = (scaled, logs, slopes, np.zeros((k, d, d)))
        return Estimated(events, LogRatios(*(np.asarray(x, scaled.dtype) for x in numbers)))

    def _event(self, name: str, scaled: np.ndarray) -> RareEvent:
        values = self._problem.space.numbers(scaled)
        changes = {path: float(x) for path, x in values.items()}
        store = None if self._folder is None else self._folder / f"{self._made}-{name}"
        self._made += 1
        event = event_of(
            dataclasses.replace(self._states[name], changes=changes),
            cov=_COV,
            key=self._key,
            start=self._last.get(name),
            store=store,
            progress=self._progress,
        )
        if event.probability == 1:
            listed = ", ".join(f"{path} = {x:.6g}" for path, x in changes.items())
            rule = f"must be rare enough to be estimated at {listed}: {'; '.join(event.warnings)}"
            raise ValueError(f"{OWNER}: objective: limits: {name} {rule}")
        if len(event.design_points):
            self._last[name] = event
        return event
