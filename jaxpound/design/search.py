"""The loop of a design search: iterations until there is no more progress, kept in a file."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import time
from collections.abc import Callable, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import numpy as np
from tqdm.auto import tqdm

from jaxpound._checks import count, instance, number, positive, seed
from jaxpound.design.lagrangian import AugmentedLagrangian, State
from jaxpound.design.problem import OWNER, Point, ProblemData, best_start, better
from jaxpound.study.archives import (
    Archive,
    DamagedError,
    digest,
    opened,
    sweep_parts,
    write_archive,
)
from jaxpound.study.store import describe

if TYPE_CHECKING:
    from optax import GradientTransformation

STOPPED_BY_CALLBACK = "the callback ended it"

_SAVE_EVERY = 20  # iterations, or
_SAVE_AFTER = 5.0  # seconds: of a row an iteration may take as long
_FORMAT = 2  # of the file


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


@dataclasses.dataclass(frozen=True)
class SearchOptions:
    """How a design is searched for; ``design_damper`` says what each option is.

    Raises
    ------
    ValueError
        If an option breaks its rule.
    """

    starts: int = 4
    key: int = 0
    iterations: int = 150
    optimiser: GradientTransformation | None = None
    batch: int | None = None
    patience: int = 40
    tolerance: float = 1e-4
    limit_tolerance: float = 1e-3
    save: str | PathLike[str] | None = None
    callback: Callable[[Progress], Any] | None = None
    progress: bool = True
    polish: bool = True

    def __post_init__(self) -> None:
        import optax  # takes as long as all the rest

        for name in ("starts", "iterations", "patience"):
            count(OWNER, name, getattr(self, name))
        if self.batch is not None:
            count(OWNER, "batch", self.batch)
        for name in ("tolerance", "limit_tolerance"):
            positive(OWNER, **{name: number(OWNER, name, getattr(self, name))})
        seed(OWNER, "key", self.key)
        if self.optimiser is not None:
            instance(OWNER, "optimiser", self.optimiser, optax.GradientTransformation)
        if self.save is not None and not Path(self.save).absolute().parent.is_dir():
            raise ValueError(f"{OWNER}: save = {self.save} must be in a folder that exists")


class Iterate(NamedTuple):
    """One iteration: the design of every start, and the best design of each start so far."""

    here: Point
    best: Point
    alive: np.ndarray


@dataclasses.dataclass(frozen=True)
class Descent:
    """The iterations of all starts, until there is no more progress."""

    lagrangian: AugmentedLagrangian
    options: SearchOptions
    data: ProblemData

    def run(self, scaled: np.ndarray) -> tuple[Point, list[Iterate], str]:
        """From starts, shape (s, d): the best of each, all iterates, and why the search ended.

        Raises
        ------
        ValueError
            If no start stays finite, or the file holds another search or is damaged.
        OSError
            If the file cannot be written to.
        """
        problem, options = self.lagrangian.problem, self.options
        whole = self.lagrangian.per_epoch == 1
        state, saved = self.lagrangian.begin(scaled), None
        history: list[Iterate] = []
        if options.save is not None:
            saved = SavedSearch(Path(options.save), self._identity(state))
            state, history = saved.read(state)
        best = history[-1].best if history else no_design(state)
        n, hidden = options.iterations, not options.progress
        written = time.monotonic()
        with tqdm(total=n, initial=len(history), unit=" iterations", disable=hidden) as bar:
            while not (reason := self._end(history)):
                state, here = self.lagrangian.iterate(state, len(history), self.data)
                if whole:
                    best = better(best, here, state.alive)
                elif len(history) % self.lagrangian.per_epoch == 0:
                    # A minibatch's objective is too noisy to compare designs.
                    best = better(best, problem.points(here.scaled, self.data), state.alive)
                history.append(Iterate(here, best, state.alive))
                if not state.alive.any():
                    raise ValueError(f"{OWNER}: {self._none_finite(history)}")
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
        here, best, alive = history[-1]
        reported = float(np.where(alive & ~best.infeasible, best.objective, -np.inf).max())
        bar.update()
        if np.isfinite(reported):  # else nothing within the limits was found yet
            bar.set_postfix({"objective": f"{reported:.5g}"}, refresh=False)
        if self.options.callback is None:
            return False
        progress = Progress(
            iteration=len(history),
            objective=here.objective,
            violation=here.violation,
            values=self.lagrangian.problem.space.numbers(here.scaled),
            best=reported,
        )
        answer = self.options.callback(progress)
        return isinstance(answer, bool | np.bool_) and bool(answer)

    def _end(self, history: Sequence[Iterate]) -> str:
        """The reason to end, or an empty string."""
        patience = self.options.patience * self.lagrangian.per_epoch
        if len(history) >= self.options.iterations:
            return f"{self.options.iterations} iterations"
        if len(history) <= patience:
            return ""
        (_, then, _), (_, now, alive) = history[-1 - patience], history[-1]
        entered = then.infeasible & ~now.infeasible
        gained = then.merit[alive] - now.merit[alive]
        within = ~now.infeasible[alive]
        if within.any() and not entered[alive].any() and (gained < self.options.tolerance).all():
            return f"no progress in {patience} iterations"
        return ""

    def _none_finite(self, history: Sequence[Iterate]) -> str:
        """Why no start is finite, and what the best design was."""
        problem, (here, best, _) = self.lagrangian.problem, history[-1]
        before = ""
        if not best.infeasible.all():
            i = best_start(best)
            values = problem.space.numbers(best.scaled[i])
            listed = ", ".join(f"{path} = {float(x):.6g}" for path, x in values.items())
            before = f"; the best before was {float(best.objective[i]):.6g} at {listed}"
        return (
            f"all {len(best.merit)} starts must be finite, but after {len(history) - 1} iterations "
            f"none is; of the first, {problem.not_finite(here.scaled[0])}{before}"
        )

    def _identity(self, state: State) -> dict[str, Any]:
        """All that determines the numbers of a search."""
        data, problem = self.data, self.lagrangian.problem
        posed = ("space", "objective", "grid", "scheme", "scales")
        numbers = ("limits", "tolerance")
        leaves = jax.tree.leaves((data.grounds, data.uncertain))
        return {
            **{name: describe(getattr(problem, name)) for name in posed},
            **{name: np.asarray(getattr(data, name)).tolist() for name in numbers},
            "key": np.asarray(jax.random.key_data(data.key)).tolist(),
            "ensemble": [digest(np.asarray(x).tobytes()) for x in leaves],
            "starts": digest(state.scaled.tobytes()),
            "program": [digest(x.encode()) for x in self.lagrangian.texts(state, data)],
        }


def no_design(state: State) -> Point:
    """Placeholders for the best designs, before any design was evaluated."""
    far, none = np.full_like(state.weight, np.inf), np.zeros_like(state.multipliers)
    return Point(state.scaled, -far, none, far, np.ones_like(state.alive), far)


@dataclasses.dataclass(frozen=True)
class SavedSearch:
    """A file with the state and history of a search, which ``identity`` identifies."""

    path: Path
    identity: dict[str, Any]

    def read(self, state: State) -> tuple[State, list[Iterate]]:
        """State and history; the given state and no history if there is no file.

        Raises
        ------
        ValueError
            If the file holds something else or is damaged, or the state cannot be stored as arrays.
        """
        if any(jax.dtypes.issubdtype(x.dtype, jax.dtypes.prng_key) for x in jax.tree.leaves(state)):
            raise ValueError(f"{OWNER}: save cannot keep an optimiser that draws at random")
        with contextlib.suppress(OSError):
            sweep_parts(self.path.parent, self.path.name)
        best = no_design(state)
        try:
            with opened(self.path) as archive:
                self._require_same(archive.about)
                (n,) = archive.read("iterations", (1,), np.int64).tolist()
                held = _read(archive, state, ())
                met = _read(archive, Iterate(best, best, state.alive), (n,))
        except FileNotFoundError:
            return state, []
        except DamagedError as error:
            rule = f"holds no search, or a damaged one ({error})"
            raise ValueError(f"{self._said(rule)}; move it away to begin anew") from error
        return held, [jax.tree.map(lambda x, i=i: x[i], met) for i in range(n)]

    def write(self, state: State, history: Sequence[Iterate]) -> None:
        """Write state and history to the file, replacing what it held."""
        met = jax.tree.map(lambda *rows: np.stack(rows), *history)
        arrays = {name: np.asarray(x) for name, x in (_named(state) | _named(met)).items()}
        arrays["iterations"] = np.array([len(history)], np.int64)
        write_archive(self.path, arrays, {"format": _FORMAT, **self.identity})

    def _require_same(self, theirs: Any) -> None:
        if not isinstance(theirs, dict) or theirs.get("format") != _FORMAT:
            rule = "holds no search, or one of another version of jaxpound"
            raise ValueError(f"{self._said(rule)}; move it away to begin anew")
        ours = json.loads(json.dumps(self.identity))
        if other := [name for name, x in ours.items() if theirs.get(name) != x]:
            raise ValueError(self._said(f"holds another search: {', '.join(other)} differs"))

    def _said(self, rule: str) -> str:
        return f"{OWNER}: save = {self.path} {rule}"


def _named(tree: Any) -> dict[str, Any]:
    """Arrays of a tree by their paths: ``State.scaled``, ``Iterate.best.merit``."""
    kind = type(tree).__name__
    return {
        f"{kind}.{jax.tree_util.keystr(path, simple=True, separator='.')}": x
        for path, x in jax.tree.leaves_with_path(tree)
    }


def _read(archive: Archive, like: Any, before: tuple[int, ...]) -> Any:
    """A tree of arrays like another, with the leading axes ``before`` added to their shapes."""
    leaves = [archive.read(name, (*before, *x.shape), x.dtype) for name, x in _named(like).items()]
    return jax.tree.unflatten(jax.tree.structure(like), leaves)
