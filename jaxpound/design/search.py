"""A search for a design: its options, and iterations until there is no more progress."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import numpy as np
from tqdm.auto import tqdm

from jaxpound._checks import instance, seed
from jaxpound._errors import InvalidInput
from jaxpound._fields import Checked, parameter
from jaxpound.design.lagrangian import AugmentedLagrangian, FirstOrderConditions, SearchState
from jaxpound.design.problem import Point, ProblemData, RareEstimates, best_start, better
from jaxpound.design.space import spread_shares
from jaxpound.model.system import Structures
from jaxpound.store.archive import DamagedError, digest, opened, sweep_parts, write_archive
from jaxpound.store.store import describe

if TYPE_CHECKING:
    from optax import GradientTransformation

STOPPED_BY_CALLBACK = "the callback ended it"

_SAVE_EVERY = 20  # iterations, or
_SAVE_AFTER = 5.0  # seconds: of a row an iteration may take as long
_FORMAT = 2  # of the file
_ANEW = "move it away to begin anew"
# The name of an array by its path: ``State.scaled``, ``Iterate.best.merit``.
_name = partial(jax.tree_util.keystr, simple=True, separator=".")


class Progress(NamedTuple):
    """The progress of a search, which its callback gets."""

    iteration: int
    objective: np.ndarray
    """Goal less penalties of every start, shape (s,); larger is better."""
    violation: np.ndarray
    """Largest relative excess over a limit, shape (s,)."""
    values: dict[str, np.ndarray]
    """The variables of every start, shape (s,) each."""
    best: float
    """Best objective within the limits so far; −∞ while there is none."""


@dataclasses.dataclass(frozen=True, eq=False)
class DesignSearch(Checked):
    """The way in which ``design_damper`` and ``pareto_front`` search: by gradients, from starts.

    Parameters
    ----------
    start
        The design of the first start; by default the space's nominal structures.
    starts
        Number of starts: the others are spread over the space (scrambled Sobol points).
    iterations
        Largest number of iterations.
    key
        Seed of the starts, of minibatches and of the samples of rare events.
    optimiser
        An optimiser of optax, for the variables scaled to 0 to 1 between their bounds; by default
        Adam with steps that fall from 0.2 to 0 (cosine). ``optax.lbfgs()`` works too.
    batch
        Earthquakes of an iteration; by default all. With minibatches, the best design is evaluated
        on the whole ensemble once per epoch and at the end, and there is no polishing; gradient and
        multipliers of the result are means over an epoch.
    patience, tolerance
        The search ends when in ``patience`` iterations (with minibatches: epochs) no start has
        improved by ``tolerance`` times the mean required gap, or the minimised demand.
    limit_tolerance
        Relative excess over a limit that is tolerated.
    polish
        Whether to refine the best design by at most 30 steps of SciPy's sequential quadratic
        programming, with the same gradients.
    callback
        Called with a ``Progress`` after every iteration; if it returns True, the search ends.

    Examples
    --------
    >>> jp.DesignSearch({"friction": 0.1}, starts=2, iterations=50).patience
    40
    """

    start: Structures | Mapping[str, float] | None = None
    starts: int = parameter(whole=True, default=4)
    iterations: int = parameter(whole=True, default=150)
    key: int = 0
    optimiser: GradientTransformation | None = None
    batch: int | None = parameter(whole=True, default=None)
    patience: int = parameter(whole=True, default=40)
    tolerance: float = parameter(above=0, single=True, default=1e-4)
    limit_tolerance: float = parameter(above=0, single=True, default=1e-3)
    polish: bool = True
    callback: Callable[[Progress], Any] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        seed("key", self.key)
        if not (self.callback is None or callable(self.callback)):
            raise InvalidInput("callback", repr(self.callback), "must be a function")
        if self.optimiser is not None:
            import optax  # only here: it takes as long to import as all else

            instance("optimiser", self.optimiser, optax.GradientTransformation)


class Iterate(NamedTuple):
    """One iteration: the design of every start, and the best design of each start so far."""

    here: Point
    best: Point
    alive: np.ndarray


class SearchResult(NamedTuple):
    """The best design of a search, and how it was found."""

    point: Point
    history: list[Iterate]
    winner: int
    stopped: str
    polishing: int  # runs with a gradient
    conditions: FirstOrderConditions
    rare: RareEstimates  # at the design; no events without limited probabilities


@dataclasses.dataclass(frozen=True)
class Descent:
    """The iterations of all starts, until there is no more progress."""

    lagrangian: AugmentedLagrangian
    search: DesignSearch
    data: ProblemData
    save: Path | None
    progress: bool

    def best(self, first: np.ndarray) -> SearchResult:
        """The best design, from a design and others spread over the box."""
        low, high = np.asarray(self.data.box)
        starts = spread_shares(first, self.search.starts, self.search.key)
        starts[1:] = low + (high - low) * starts[1:]
        designs, history, stopped = self.run(starts)
        winner = best_start(designs, history[-1].alive)
        best = jax.tree.map(lambda x: x[winner], designs)
        conditions, runs = self.conditions(self.data), 0
        polishes = self.search.polish and self.lagrangian.per_epoch == 1
        if polishes and stopped != STOPPED_BY_CALLBACK:
            best, runs = conditions.polished(best)
        unlimited = RareEstimates({}, self.data.rare)
        return SearchResult(best, history, winner, stopped, runs, conditions, unlimited)

    def conditions(self, data: ProblemData) -> FirstOrderConditions:
        """Those of first order, by the program that this search has compiled."""
        return FirstOrderConditions(self.lagrangian, data, self.search.starts)

    def run(self, scaled: np.ndarray) -> tuple[Point, list[Iterate], str]:
        """From starts, shape (s, d): the best of each, all iterates, and why the search ended."""
        problem, whole = self.lagrangian.problem, self.lagrangian.per_epoch == 1
        state, saved = self.lagrangian.begin(scaled), None
        history: list[Iterate] = []
        if self.save is not None:
            saved = SavedSearch(self.save, self._identity(state))
            state, history = saved.read(state)
        best = history[-1].best if history else no_design(state)
        n, hidden = self.search.iterations, not self.progress
        written = time.monotonic()
        with tqdm(total=n, initial=len(history), unit=" iterations", disable=hidden) as bar:
            while not (reason := self._end(history)):
                state, point = self.lagrangian.iterate(state, len(history), self.data)
                if whole:
                    best = better(best, point, state.alive)
                elif len(history) % self.lagrangian.per_epoch == 0:
                    # A minibatch's objective is too noisy to compare designs.
                    best = better(best, problem.points(point.scaled, self.data), state.alive)
                history.append(Iterate(point, best, state.alive))
                if not state.alive.any():
                    raise InvalidInput("", "", self._none_finite(history))
                due = len(history) % _SAVE_EVERY == 0 or time.monotonic() > written + _SAVE_AFTER
                if saved is not None and due:
                    saved.write(state, history)
                    written = time.monotonic()
                if self._report(history, bar):
                    reason = STOPPED_BY_CALLBACK
                    break
        if saved is not None:
            saved.write(state, history)
        if not whole:
            best = better(best, problem.points(state.scaled, self.data), state.alive)
        return best, history, reason

    def _report(self, history: Sequence[Iterate], bar: tqdm) -> bool:
        """Show the last iteration, and say whether the callback ends the search."""
        point, best, alive = history[-1]
        reported = float(np.where(alive & ~best.infeasible, best.objective, -np.inf).max())
        bar.update()
        if np.isfinite(reported):  # else no design is within the limits yet
            bar.set_postfix({"objective": f"{reported:.5g}"}, refresh=False)
        if self.search.callback is None:
            return False
        values = jax.device_get(self.lagrangian.problem.space.values(point.scaled))
        progress = Progress(len(history), point.objective, point.violation, values, reported)
        stop = self.search.callback(progress)
        return isinstance(stop, bool | np.bool_) and bool(stop)

    def _end(self, history: Sequence[Iterate]) -> str:
        """The reason to end, or an empty string."""
        patience = self.search.patience * self.lagrangian.per_epoch
        if len(history) >= self.search.iterations:
            return f"{self.search.iterations} iterations"
        if len(history) <= patience:
            return ""
        (_, earlier, _), (_, latest, finite) = history[-1 - patience], history[-1]
        entered = earlier.infeasible & ~latest.infeasible
        gained = earlier.merit[finite] - latest.merit[finite]
        within = ~latest.infeasible[finite]
        if within.any() and not entered[finite].any() and (gained < self.search.tolerance).all():
            return f"no progress in {patience} iterations"
        return ""

    def _none_finite(self, history: Sequence[Iterate]) -> str:
        """Why no start is finite, and what the best design was."""
        problem, (point, best, _) = self.lagrangian.problem, history[-1]
        reason = f"all {len(best.merit)} starts must be finite, but after {len(history) - 1}"
        reason += f" iterations none is; of the first, {problem.not_finite(point.scaled[0])}"
        if best.infeasible.all():
            return reason
        i = best_start(best)
        values = problem.space.values(best.scaled[i])
        listed = ", ".join(f"{path} = {float(x):.6g}" for path, x in values.items())
        return f"{reason}; the best before was {float(best.objective[i]):.6g} at {listed}"

    def _identity(self, state: SearchState) -> dict[str, Any]:
        """All that determines the numbers of a search."""
        data, problem = self.data, self.lagrangian.problem
        of_problem = ("space", "objective", "grid", "scheme")
        leaves = jax.tree.leaves((data.grounds, data.uncertain))
        return {
            **{name: describe(getattr(problem, name)) for name in of_problem},
            "limits": np.asarray(data.limits).tolist(),
            "tolerance": np.asarray(data.tolerance).tolist(),
            "key": np.asarray(jax.random.key_data(data.key)).tolist(),
            "ensemble": [digest(np.asarray(x).tobytes()) for x in leaves],
            "starts": digest(state.scaled.tobytes()),
            "program": [digest(x.encode()) for x in self.lagrangian.texts(state, data)],
        }


def no_design(state: SearchState) -> Point:
    """Placeholders for the best designs, before any design was evaluated."""
    infinite, zeros = np.full_like(state.weight, np.inf), np.zeros_like(state.multipliers)
    return Point(state.scaled, -infinite, zeros, infinite, np.ones_like(state.alive), infinite)


@dataclasses.dataclass(frozen=True)
class SavedSearch:
    """A file with the state and history of a search, which ``identity`` identifies."""

    path: Path
    identity: dict[str, Any]

    def read(self, state: SearchState) -> tuple[SearchState, list[Iterate]]:
        """State and history; the state passed and no history if there is no file."""
        if any(jax.dtypes.issubdtype(x.dtype, jax.dtypes.prng_key) for x in jax.tree.leaves(state)):
            raise InvalidInput("save", "", "cannot keep an optimiser that draws at random")
        with contextlib.suppress(OSError):
            sweep_parts(self.path.parent, self.path.name)
        best = no_design(state)
        row = Iterate(best, best, state.alive)
        try:
            with opened(self.path) as archive:
                about, identity = archive.about, json.loads(json.dumps(self.identity))
                rule = ""
                if not isinstance(about, dict) or about.get("format") != _FORMAT:
                    rule = "holds no search, or one of another version of jaxpound"
                elif differing := [name for name, x in identity.items() if about.get(name) != x]:
                    rule = f"holds another search: {', '.join(differing)} differs"
                if rule:
                    raise InvalidInput("save", str(self.path), f"{rule}; {_ANEW}")
                (n,) = archive.read("iterations", (1,), np.int64).tolist()
                all_of = jax.tree.map(lambda x: jax.ShapeDtypeStruct((n, *x.shape), x.dtype), row)
                stored = jax.tree.map_with_path(
                    lambda path, x: archive.read(_name(path), x.shape, x.dtype),
                    {"State": state, "Iterate": all_of},
                )
        except FileNotFoundError:
            return state, []
        except DamagedError as error:
            rule = f"holds no search, or a damaged one ({error}); {_ANEW}"
            raise InvalidInput("save", str(self.path), rule) from error
        rows = [jax.tree.map(lambda x, i=i: x[i], stored["Iterate"]) for i in range(n)]
        return stored["State"], rows

    def write(self, state: SearchState, history: Sequence[Iterate]) -> None:
        """Write state and history to the file, replacing what it held."""
        tree = {"State": state, "Iterate": jax.tree.map(lambda *rows: np.stack(rows), *history)}
        arrays = {_name(path): np.asarray(x) for path, x in jax.tree.leaves_with_path(tree)}
        arrays["iterations"] = np.array([len(history)], np.int64)
        write_archive(self.path, arrays, {"format": _FORMAT, **self.identity})
