"""One chunk of a Monte Carlo study: the task of a worker."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy

from jaxpound._checks import refusal
from jaxpound._version import __version__
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import Ground, as_pytree
from jaxpound.ground.plausibility import first_of
from jaxpound.results.demand import Demand
from jaxpound.results.elements import place_of
from jaxpound.simulation.batches import even_share, in_chunks, runs_at_a_time
from jaxpound.simulation.run import demand
from jaxpound.simulation.scheme import Scheme
from jaxpound.study.archives import DamagedError, digest, require_name
from jaxpound.study.demands import demands_of
from jaxpound.study.sampling import Points, as_key, points
from jaxpound.study.scenarios import (
    ScenarioSet,
    grounds_at,
    keys_in_order,
    parameter_names,
    parameters,
)
from jaxpound.study.statistics import Moments
from jaxpound.study.store import Store, describe

Measure = Callable[[Any, Any], Any]
"""A user's column: a function from a scenario's structures and ground motion to one number."""

Columns = dict[str, np.ndarray]

_PROGRAMS: dict[tuple[str, str], Callable[[np.ndarray], Any]] = {}
_MOST_PROGRAMS = 8  # compiled programs that a process keeps, two for each study


def _kept(what: str, fingerprint: str, make: Callable[[], Callable[..., Any]]) -> Any:
    """A compiled program of a study, from the cache if it is there."""
    if (what, fingerprint) not in _PROGRAMS:
        for oldest in [*_PROGRAMS][: len(_PROGRAMS) - _MOST_PROGRAMS + 1]:
            del _PROGRAMS[oldest]
        _PROGRAMS[what, fingerprint] = make()
    return _PROGRAMS[what, fingerprint]


@lru_cache(maxsize=4)
def _draw(sampling: str, key: tuple[str, tuple[int, ...]], dimension: int) -> Points:
    """The points of a study; cached, since Sobol points are generated in order."""
    return points(sampling, as_key(*key), dimension)


class Outcome(NamedTuple):
    """A finished chunk: its statistics and, without a store, its columns."""

    moments: dict[str, Moments]
    columns: Columns


@dataclasses.dataclass(frozen=True)
class Task:
    """All that a worker needs to run any chunk of a study."""

    scenarios: ScenarioSet
    grid: TimeGrid
    scheme: Scheme
    key: tuple[str, tuple[int, ...]]  # kind and numbers
    sampling: str
    n: int
    chunk_size: int
    measures: dict[str, Measure]
    keep_parameters: bool
    keep_failures: bool
    x64: bool
    names: tuple[str, ...] = ()  # of the columns
    folder: Path | None = None
    most: int = 0  # samples that the store is to contain
    fingerprint: str = ""  # of the program, independent of the points

    def identity(self) -> dict[str, Any]:
        """All that determines the study's numbers, as JSON; the number of samples does not."""
        drawn = parameter_names(self.scenarios) if self.keep_parameters else ()
        kind, numbers = self.key
        partitionable = bool(jax.config.jax_threefry_partitionable)  # type: ignore[attr-defined]
        versions = {
            "jaxpound": __version__,
            "jax": jax.__version__,
            "scipy": scipy.__version__,
        }
        return {
            "versions": versions,
            "precision": "float64" if self.x64 else "float32",
            "key": {"kind": kind, "numbers": list(numbers), "partitionable": partitionable},
            "sampling": self.sampling,
            "chunk_size": self.chunk_size,
            "columns": list(keys_in_order(self.run, self.normal())),
            "parameters": list(drawn),
            "grid": describe(self.grid),
            "scheme": describe(self.scheme),
            "scenarios": describe(self.scenarios),
            "measures": describe(self.measures),
            "program": self.program_digest(),
        }

    def program_digest(self) -> str:
        """Checksum of the programs of scenarios and measures, since functions have no identity."""

        def drawn(z: jax.Array) -> Any:
            structures, ground = self.scenarios.realize(z)
            measured = {name: f(structures, ground) for name, f in self.measures.items()}
            named = parameters(self.scenarios, z) if self.keep_parameters else {}
            return structures, as_pytree(ground, self.grid), measured, named

        traced = jax.jit(drawn).trace(self.normal())
        return digest(traced.lower(lowering_platforms=("cpu",)).as_text().encode())

    def normal(self) -> jax.ShapeDtypeStruct:
        """Shape and type of z."""
        return jax.ShapeDtypeStruct((self.scenarios.dimension,), jnp.zeros((), float).dtype)

    def run(self, z: jax.Array) -> dict[str, jax.Array]:
        """The columns of one scenario."""
        structures, ground = self.scenarios.realize(z)
        columns = demands_of(structures, ground, self.grid, self.scheme)
        more = {name: f(structures, ground) for name, f in self.measures.items()}
        if self.keep_parameters:
            more |= parameters(self.scenarios, z)
        if taken := columns.keys() & more.keys():
            raise ValueError(
                f"monte_carlo: {sorted(taken)[0]!r} is the name of a demand; rename it"
            )
        for name, x in more.items():
            require_name("monte_carlo", name)
            if shape := jnp.shape(x):
                raise ValueError(f"monte_carlo: {name!r} of shape {shape} must be one number")
        return {name: jnp.asarray(x, z.dtype) for name, x in (columns | more).items()}

    def rows(self, chunk: int, full: bool = False) -> range:
        """Indices of a chunk's samples; ``full``: up to the size that the store is to have."""
        n = max(self.n, self.most) if full else self.n
        return range(chunk * self.chunk_size, min((chunk + 1) * self.chunk_size, n))

    def points(self, chunks: Sequence[int], full: bool = False) -> np.ndarray:
        """Points of the samples of some chunks, shape (n, d)."""
        draw = _draw(self.sampling, self.key, self.scenarios.dimension)
        rows = [self.rows(chunk, full) for chunk in chunks]
        return np.concatenate([draw(some.start, some.stop) for some in rows])

    def first_grounds(self) -> Ground:
        """Ground motions of the first scenarios, to be checked before any is run."""
        draw = _draw(self.sampling, self.key, self.scenarios.dimension)
        program = partial(grounds_at, self.scenarios, self.grid)
        return _kept("grounds", self.fingerprint, program)(draw(0, first_of(self.n, self.grid)))

    def finish(self, chunk: int) -> Outcome:
        """Run a chunk and store it; a chunk that a lost worker has stored already is only read."""
        held = None
        if self.folder is not None:
            with contextlib.suppress(DamagedError):
                held = Store(self.folder, self.n).read(chunk)
        return self.keep(chunk, self.compute(chunk)) if held is None else Outcome(moments(held), {})

    def compute(self, chunk: int) -> Columns:
        """The columns of a chunk."""
        rows = self.rows(chunk, full=True)
        with jax.enable_x64(self.x64):
            size = self._runs_at_a_time()
            program = _kept("runs", self.fingerprint, lambda: in_chunks(self.run, size))
            z = self.points([chunk], full=True)
            # Always batches of one size: one program, and the same rounding.
            rest = -len(rows) % size
            results = program(np.concatenate([z, np.repeat(z[-1:], rest, 0)]))
            columns = {name: results[name][: len(rows)] for name in self.names}
            self._refuse_failures(columns, z, rows)
        return columns

    def keep(self, chunk: int, columns: Columns) -> Outcome:
        """Put a chunk in the store, if there is one."""
        if self.folder is not None:
            Store(self.folder, self.n).write(chunk, columns)
        own = {name: x[: len(self.rows(chunk))] for name, x in columns.items()}
        return Outcome(moments(own), {} if self.folder else own)

    def finished(self, chunks: Sequence[int]) -> Iterator[tuple[int, Outcome]]:
        """Those of the given chunks that are in the store."""
        if self.folder is not None:
            for chunk, found in finished(Store(self.folder, self.n), chunks):
                yield chunk, Outcome(found, {})

    def _runs_at_a_time(self) -> int:
        return even_share(self.chunk_size, runs_at_a_time())

    def _refuse_failures(self, columns: Columns, z: np.ndarray, rows: range) -> None:
        good = np.all([_is_result(name, x) for name, x in columns.items()], axis=0)
        if good.all() or self.keep_failures:
            return
        first = int(np.argmin(good))
        at = jnp.asarray(z[first])
        reason = refusal(lambda: demand(*self.scenarios.realize(at), self.grid, self.scheme))
        reason = reason or next(
            f"{name} is not finite" for name, x in columns.items() if not _is_result(name, x[first])
        )
        raise ValueError(
            f"monte_carlo: scenario {rows[first]} fails: {reason}; "
            "keep_failures (= True) leaves such out"
        )


def _is_result(name: str, x: Any) -> Any:
    """Whether a column has what a run can give: finite, or infinite where there is no such thing.

    That is the gap of links that have none, and the time of the first of no impacts.
    """
    place = place_of(Demand, name)
    may_be_none = place is not None and place.field in ("min_gap", "first_impact_time")
    return np.isfinite(x) | (may_be_none & (x == np.inf))


def moments(columns: Mapping[str, np.ndarray]) -> dict[str, Moments]:
    """Moments of every column of a chunk, over its finite numbers."""
    return {name: Moments.of(x[np.isfinite(x)]) for name, x in columns.items()}


def finished(store: Store, chunks: Iterable[int]) -> Iterator[tuple[int, dict[str, Moments]]]:
    """Those of the given chunks that are in the store undamaged, with their moments.

    At the end a warning names the damaged ones.
    """
    then = "what is damaged is left out until monte_carlo makes it anew"
    for chunk, columns in store.undamaged(chunks, then, stacklevel=5):
        yield chunk, moments(columns)


def total(parts: Iterable[Mapping[str, Moments]]) -> dict[str, Moments]:
    """Moments of all chunks together."""
    parts = list(parts)
    return {name: sum((part[name] for part in parts), Moments()) for name in parts[0]}
