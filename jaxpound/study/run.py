"""Monte Carlo over uncertain earthquakes and structures: in chunks, stored, resumable.

Sample i is the scenario of point i, independent of the chunk size, the number of devices and the
process that runs it.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor, as_completed
from functools import partial
from os import PathLike
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from tqdm.auto import tqdm

from jaxpound._checks import count, require_memory
from jaxpound._errors import InvalidInput, resumable, warn
from jaxpound.buildings import Buildings
from jaxpound.grid import TimeGrid
from jaxpound.ground.plausibility import first_of, of_many
from jaxpound.model.hysteresis import before_yield
from jaxpound.model.system import is_closable
from jaxpound.model.topology import GROUND, floors, footings
from jaxpound.results.named import PAIR
from jaxpound.scenarios.sampling import key_numbers, require_sampling
from jaxpound.scenarios.scenarios import ScenarioSet, grounds_at, structures_of, topology_of
from jaxpound.simulation.scheme import Scheme
from jaxpound.store.store import Store, describe
from jaxpound.study.chunk import Columns, Outcome, Task, cached, finished, total
from jaxpound.study.demands import doubts, unreached
from jaxpound.study.statistics import Moments
from jaxpound.study.storage import Storage
from jaxpound.study.study import Study, in_rows
from jaxpound.units import result_units

_MOMENTS_BYTES = 250  # of a column of a chunk


@resumable("store")
def monte_carlo(
    scenarios: ScenarioSet,
    n: int,
    grid: TimeGrid,
    scheme: Scheme = Scheme(),
    key: int | jax.Array = 0,
    *,
    sampling: str = "plain",
    store: str | PathLike[str] | Storage | None = None,
    executor: Executor | None = None,
    progress: bool = True,
    strict: bool = False,
) -> Study:
    """Demands of n random scenarios.

    With a store, the same call resumes a call that was stopped at any moment; a larger n extends
    the study. A warning names damaged chunks, which are run again. Several processes may fill one
    store at once, even with different n; with a ``shard`` each runs its part, without one each runs
    all chunks that were missing when it began. (Results agree to the last bit if the numbers of JAX
    devices and of threads of the linear algebra are the same; else to rounding.)

    Parameters
    ----------
    scenarios
        ``Scenarios``, or any other ``ScenarioSet``.
    n
        Number of samples, at most 2^31 (2^30 for Sobol points).
    grid, scheme, strict
        See ``simulate``.
    key
        A seed, or a key of ``jax.random``.
    sampling
        "plain" for independent samples, "sobol" for scrambled Sobol points (n best a power of 2).
    store
        A folder for the columns, or a ``Storage``, which also says what is kept. Without a folder
        they stay in memory.
    executor
        An executor of ``concurrent.futures`` that runs the chunks, such as Dask's
        ``Client.get_executor()`` or those of executorlib. By default this process runs them in
        order, each spread over all devices. Workers must see the store's folder; processes must be
        started by "spawn", since forked ones inherit JAX's locks but not its threads, and never
        return.
    progress
        Whether to show a progress bar.

    Raises
    ------
    ValueError
        If an argument breaks its rule, the study exceeds the memory, a scenario is invalid or its
        run fails (with its index and the reason), or the store holds another study (with the
        differences).
    OSError
        If the store cannot be written to. Its finished chunks are kept for the next call.

    Warns
    -----
    PlausibilityWarning
        Before the first run: if, of the first 256 scenarios, more than 1 % have a ground motion
        that the grid does not resolve, or a PGA above 5 g; if contact is run in single precision.
        After the first chunk: if a gap is more than 100 times the displacements at its ends.

    Examples
    --------
    >>> amplitude, periods = jp.LogNormal(0.03, 0.5), jp.Uniform(1.0, 3.8)
    >>> ground = jp.RandomRicker(2, amplitude, periods, arrivals=jp.Uniform(1.0, 7.0))
    >>> scenarios = jp.Scenarios(jp.paper.structures(), ground)
    >>> study = jp.monte_carlo(scenarios, 64, jp.TimeGrid.until(20.0, dt=0.1), progress=False)
    >>> print(study.pounding_probability(gap=0.03))
    0.1406 (95%: 0.06637 to 0.2502)
    """
    storage = store if isinstance(store, Storage) else Storage(store)
    findings = doubts(scenarios, grid, scheme)
    if count("n", n) > (most := require_sampling(sampling)):
        raise InvalidInput("n", str(n), f"must be at most {most:,} for {sampling} sampling")
    task = Task(
        *(scenarios, grid, scheme, key_numbers(key), sampling, int(n)),
        *(storage, storage.sized(n)),
        x64=bool(jax.config.jax_enable_x64),  # type: ignore[attr-defined]
    )
    chunks = storage.chunks(task.n, task.chunk_size)
    units = result_units(structures_of(scenarios))
    identity = task.identity() | {"scales": describe(units)}
    task = task.identified(identity)
    _require_memory(task, len(chunks))
    context = _context(task)
    first = task.points([range(first_of(task.n, grid))])
    grounds = cached("grounds", task.fingerprint, partial(grounds_at, scenarios, grid))(first)
    warn(findings + of_many(grounds, grid, in_g=True), strict)
    moments: dict[int, dict[str, Moments]] = {}
    stored = None
    if storage.folder is not None:
        stored = Store.create(storage.folder, identity, task.n, context)
        task = dataclasses.replace(task, folder=stored.folder.resolve())
        moments = dict(finished(stored, chunks))
    columns: dict[int, Columns] = {}  # empty ones with a store
    rows = {chunk: task.rows(chunk) for chunk in chunks}
    missing = [chunk for chunk in chunks if chunk not in moments]
    done, whole = (sum(len(rows[chunk]) for chunk in part) for part in (moments, chunks))
    scale: dict[str, Any] = {"unit": " runs", "unit_scale": True}
    with tqdm(total=whole, initial=done, disable=not progress, **scale) as bar:
        for i, (chunk, outcome) in enumerate(_run(task, missing, executor)):
            moments[chunk], columns[chunk] = outcome
            if i == 0:  # warn before the other chunks are run
                ends = {x: (m.smallest, m.largest) for x, m in moments[chunk].items()}
                warn(unreached(context["topology"], ends, si=units is not None), strict)
            bar.update(len(rows[chunk]))

    moments = {chunk: moments[chunk] for chunk in chunks}
    points = partial(task.points, [*rows.values()])
    sources: dict[str, Any] = {"scenarios": scenarios, "points": points, "scales": units}
    if stored is not None:
        stored.sweep()
        return Study.of_store(stored, moments, **sources)
    about = {"n": task.n, **context, "identity": identity}
    parts = partial(_parts_in_memory, [columns[chunk] for chunk in chunks])
    return Study([range(task.n)], about, total(moments.values()), parts, **sources)


def _parts_in_memory(columns: Sequence[Columns], *names: str) -> list[np.ndarray]:
    return [in_rows(of_chunk, *names) for of_chunk in columns]


def _require_memory(task: Task, chunks: int) -> None:
    """For points and columns of a chunk, all columns, and moments of columns of all chunks."""
    storage, n = task.storage, len(task.names)
    rows, number = len(task.rows(0)), task.z_type().dtype.itemsize
    in_row = (task.scenarios.dimension + n) * number
    require_memory("samples of a chunk", rows, rows * in_row)
    if storage.folder is None:
        require_memory("n (without a store)", task.n, task.n * n * number)
    require_memory("number of chunks", chunks, chunks * n * _MOMENTS_BYTES)


def _context(task: Task) -> dict[str, Any]:
    """Notes and, at z = 0, the topology and (of a pair) period and damping ratio of each block."""
    scenarios, z = task.scenarios, jnp.zeros(task.scenarios.dimension)
    topology = topology_of(scenarios)

    @jax.jit
    def oscillators(z: jax.Array) -> list[jax.Array]:
        median = scenarios.realize(z)[0].system()
        if median.topology != PAIR or not is_closable(median.links[0].gap):
            return []
        periods_and_ratios = []
        for number, (rod, mass) in enumerate(zip(median.rods, median.masses, strict=True)):
            elastic, stiffness = before_yield(rod.material), rod.stiffness
            frequency = elastic.natural_frequency(stiffness, mass)
            own = [x for x in median.damping if x.ends == (number, GROUND)]
            dashpots = sum(x.material.coefficient for x in own) / (2 * mass * frequency)
            periods_and_ratios += [2 * jnp.pi / frequency]
            periods_and_ratios += [elastic.damping_ratio(stiffness, mass) + dashpots]
        return periods_and_ratios

    def numbers_of_median() -> list[float]:
        if footings(topology) and [len(x) for x in floors(topology)] == [1, 1]:  # a pair on soil
            return _first_modes(scenarios.realize(z)[0])
        return [*map(float, oscillators(z))]

    numbers = cached("median", task.fingerprint, numbers_of_median)
    if not np.isfinite(numbers).all():
        values = ", ".join(f"{x:.4g}" for x in numbers)
        rule = f"must be valid, but periods and damping ratios of its structures are {values}"
        raise InvalidInput("the scenario of z = 0", "", rule)
    about = {"notes": task.storage.notes, "oscillators": numbers or None}
    return about | {"topology": topology}


def _first_modes(structures: Any) -> list[float]:
    """Period and damping ratio of the first mode of each block of ``Buildings``."""
    if not isinstance(structures, Buildings):
        return []
    modes = [structures.modes(b) for b in range(2)]
    return [float(x[0]) for mode in modes for x in (mode.periods, mode.damping_ratios)]


def _run(
    task: Task, chunks: Sequence[int], executor: Executor | None
) -> Iterator[tuple[int, Outcome]]:
    """Run chunks; each is returned when it is finished."""
    if executor is None:
        with ThreadPoolExecutor(1) as writer:  # a chunk is written while the next is run
            writing = ((x, writer.submit(task.keep, x, task.compute(x))) for x in chunks)
            delayed: Any = itertools.pairwise(itertools.chain(writing, [None]))
            yield from ((chunk, written.result()) for (chunk, written), _ in delayed)
        return
    store = None if task.folder is None else Store(task.folder, task.n)
    futures = {executor.submit(task.finish, chunk): chunk for chunk in chunks}
    try:
        for future in as_completed(futures):
            chunk, outcome = futures[future], future.result()
            if store is not None and not store.has(chunk):
                rule = f"is not in {task.folder}: the executor's workers must see that folder"
                raise ValueError(f"monte_carlo: chunk {chunk} {rule}")
            yield chunk, outcome
    finally:
        for future in futures:
            future.cancel()
