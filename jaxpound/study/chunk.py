"""A chunk of a Monte Carlo study: the task of a worker."""

from __future__ import annotations

import contextlib
import dataclasses
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy

from jaxpound._checks import refusal
from jaxpound._errors import InvalidInput
from jaxpound._xla.batches import even_share, in_chunks, runs_at_a_time
from jaxpound.grid import TimeGrid
from jaxpound.ground.run_input import as_run
from jaxpound.model.system import gravity_of
from jaxpound.results.demand import Demand
from jaxpound.results.elements import is_valid
from jaxpound.scenarios import scenarios as sets
from jaxpound.scenarios.sampling import Points, as_key, points
from jaxpound.simulation.run import demand
from jaxpound.simulation.scheme import Scheme
from jaxpound.store import store
from jaxpound.store.archive import DamagedError, digest, require_name
from jaxpound.store.store import Store, program_digest
from jaxpound.study.demands import demands_of
from jaxpound.study.statistics import Moments
from jaxpound.study.storage import Storage

Columns = dict[str, np.ndarray]
Outcome = tuple[dict[str, Moments], Columns]  # of a finished chunk; no columns with a store

_PROGRAMS: dict[tuple[str, str], Any] = {}
_MOST_PROGRAMS = 12  # compiled programs that a process keeps, and medians: three for each study


def cached(kind: str, fingerprint: str, make: Callable[[], Any]) -> Any:
    """What ``make`` returns, kept for later studies of the same fingerprint."""
    if (kind, fingerprint) not in _PROGRAMS:
        if len(_PROGRAMS) >= _MOST_PROGRAMS:
            del _PROGRAMS[next(iter(_PROGRAMS))]  # the oldest
        _PROGRAMS[kind, fingerprint] = make()
    return _PROGRAMS[kind, fingerprint]


@lru_cache(maxsize=4)
def _draw(sampling: str, key: tuple[str, tuple[int, ...]], dimension: int) -> Points:
    """The points of a study; cached, since Sobol points are generated in order."""
    return points(sampling, as_key(*key), dimension)


@dataclasses.dataclass(frozen=True)
class Task:
    """Everything that a worker needs to run any chunk of a study."""

    scenarios: sets.ScenarioSet
    grid: TimeGrid
    scheme: Scheme
    key: tuple[str, tuple[int, ...]]  # kind and numbers
    sampling: str
    n: int
    storage: Storage
    chunk_size: int
    x64: bool
    names: tuple[str, ...] = ()  # of the columns
    folder: Path | None = None  # the storage's, in which workers find it
    fingerprint: str = ""  # of the program, independent of the points

    def identity(self) -> dict[str, Any]:
        """Everything that determines the study's numbers, as JSON; not the number of samples."""
        (kind, numbers), storage = self.key, self.storage
        partitionable = bool(jax.config.jax_threefry_partitionable)  # type: ignore[attr-defined]

        def drawn(z: jax.Array) -> Any:  # its program identifies the functions
            structures, ground = self.scenarios.realize(z)
            measured = {name: f(structures, ground) for name, f in storage.measures.items()}
            kept = sets.parameters(self.scenarios, z) if storage.keep_parameters else {}
            return structures, as_run(ground, self.grid, gravity_of(structures)), measured, kept

        inputs = {name: getattr(self, name) for name in ("sampling", "grid", "scheme", "scenarios")}
        inputs["key"] = {"kind": kind, "numbers": numbers, "partitionable": partitionable}
        inputs["measures"], inputs["parameters"] = storage.measures, ()
        if storage.keep_parameters:
            inputs["parameters"] = sets.parameter_names(self.scenarios)
        columns = sets.keys_in_order(self.run, self.z_type())
        program = program_digest(drawn, self.z_type())
        described = store.identity(None, columns, self.chunk_size, program, **inputs)
        return described | {"versions": described["versions"] | {"scipy": scipy.__version__}}

    def identified(self, identity: dict[str, Any]) -> Task:
        """The task with the columns' names and the fingerprint of its programs."""
        program = {k: x for k, x in identity.items() if k not in ("key", "sampling", "scales")}
        fingerprint = digest(json.dumps(program).encode())
        return dataclasses.replace(self, names=tuple(identity["columns"]), fingerprint=fingerprint)

    def z_type(self) -> jax.ShapeDtypeStruct:
        """Shape and type of z."""
        return jax.ShapeDtypeStruct((self.scenarios.dimension,), jnp.zeros((), float).dtype)

    def run(self, z: jax.Array) -> dict[str, jax.Array]:
        """The columns of one scenario."""
        structures, ground = self.scenarios.realize(z)
        columns = demands_of(structures, ground, self.grid, self.scheme)
        more = {name: f(structures, ground) for name, f in self.storage.measures.items()}
        if self.storage.keep_parameters:
            more |= sets.parameters(self.scenarios, z)
        for name, x in more.items():
            if name in columns:
                raise InvalidInput(repr(name), "", "is the name of a demand; rename it")
            require_name(name)
            if shape := jnp.shape(x):
                raise InvalidInput(repr(name), "", f"of shape {shape} must be one number")
        return {name: jnp.asarray(x, z.dtype) for name, x in (columns | more).items()}

    def rows(self, chunk: int) -> range:
        """Indices of a chunk's samples."""
        return range(chunk * self.chunk_size, min((chunk + 1) * self.chunk_size, self.n))

    def points(self, rows: Sequence[range]) -> np.ndarray:
        """Points of samples by their indices, shape (n, d)."""
        draw = _draw(self.sampling, self.key, self.scenarios.dimension)
        return np.concatenate([draw(part.start, part.stop) for part in rows])

    def finish(self, chunk: int) -> Outcome:
        """Run a chunk and store it; only read a chunk that a lost worker has stored already."""
        with contextlib.suppress(DamagedError):
            stored = None if self.folder is None else Store(self.folder, self.n).read(chunk)
            if stored is not None:
                return moments(stored), {}
        return self.keep(chunk, self.compute(chunk))

    def compute(self, chunk: int) -> Columns:
        """The columns of a chunk, of all its samples that processes with this store request."""
        rows = (self if self.folder is None else Store(self.folder)).rows(chunk)
        with jax.enable_x64(self.x64):
            size = even_share(self.chunk_size, runs_at_a_time())
            program = cached("runs", self.fingerprint, lambda: in_chunks(self.run, size))
            z = self.points([rows])
            # All batches have the same size: one program, and the same rounding.
            results = program(np.concatenate([z, np.repeat(z[-1:], -len(rows) % size, 0)]))
            columns = {name: results[name][: len(rows)] for name in self.names}
            self._refuse_failures(columns, z, rows)
        return columns

    def keep(self, chunk: int, columns: Columns) -> Outcome:
        """The outcome of a chunk, which is written to the store if the task has one."""
        if self.folder is not None:
            Store(self.folder, self.n).write(chunk, columns)
        used = {name: x[: len(self.rows(chunk))] for name, x in columns.items()}
        return moments(used), {} if self.folder else used

    def _refuse_failures(self, columns: Columns, z: np.ndarray, rows: range) -> None:
        valid = {name: is_valid(Demand, name, x) for name, x in columns.items()}
        in_all = np.all([*valid.values()], axis=0)
        if in_all.all() or self.storage.keep_failures:
            return
        first = int(np.argmin(in_all))
        point = jnp.asarray(z[first])
        reason = refusal(lambda: demand(*self.scenarios.realize(point), self.grid, self.scheme))
        reason = reason or next(f"{name} is not finite" for name in valid if not valid[name][first])
        rule = f"fails: {reason}; keep_failures=True leaves failed runs out"
        raise InvalidInput(f"scenario {rows[first]}", "", rule, owner="monte_carlo")


def moments(columns: Mapping[str, np.ndarray]) -> dict[str, Moments]:
    """Moments of every column of a chunk, over its finite numbers."""
    return {name: Moments.of(x[np.isfinite(x)]) for name, x in columns.items()}


def finished(store: Store, chunks: Iterable[int]) -> Iterator[tuple[int, dict[str, Moments]]]:
    """The undamaged ones of these chunks, with their moments; a warning names the damaged ones."""
    consequence = "damaged chunks are left out until monte_carlo runs them again"
    for chunk, columns in store.undamaged(chunks, consequence):
        yield chunk, moments(columns)


def total(parts: Iterable[Mapping[str, Moments]]) -> dict[str, Moments]:
    """Moments of all chunks together."""
    parts = list(parts)
    return {name: sum((part[name] for part in parts), Moments()) for name in parts[0]}
