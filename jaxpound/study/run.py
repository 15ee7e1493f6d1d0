"""Monte Carlo over uncertain earthquakes and structures: in chunks, stored, resumable.

Sample i is the scenario of point i, independent of the chunk size, the number of devices and the
process that runs it.
"""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor, as_completed
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from tqdm.auto import tqdm

from jaxpound._checks import count, instance, require_memory
from jaxpound._errors import InvalidInput, resumable, warn
from jaxpound.grid import TimeGrid
from jaxpound.ground.plausibility import of_many
from jaxpound.model.hysteresis import before_yield
from jaxpound.model.system import is_closable
from jaxpound.model.topology import Topology
from jaxpound.results.named import PAIR
from jaxpound.scenarios.sampling import key_numbers, require_sampling
from jaxpound.scenarios.scenarios import ScenarioSet, structures_of
from jaxpound.simulation.scheme import Scheme
from jaxpound.store.store import MANIFEST, Store, describe
from jaxpound.study.chunk import Columns, Measure, Outcome, Task, cached, finished, total
from jaxpound.study.columns import in_rows
from jaxpound.study.demands import doubts, unreached
from jaxpound.study.statistics import Moments
from jaxpound.study.study import Study
from jaxpound.units import result_units

_SMALLEST, _LARGEST, _CHUNKS = 32, 16_384, 8  # samples of a chunk, and chunks at least
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
    store: str | PathLike[str] | None = None,
    chunk_size: int | None = None,
    measures: Mapping[str, Measure] | None = None,
    keep_parameters: bool = False,
    keep_failures: bool = False,
    notes: Any = None,
    executor: Executor | None = None,
    shard: tuple[int, int] = (1, 1),
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
        A folder, made if needed, with one file per chunk. Without it the columns stay in memory.
    chunk_size
        Samples per chunk. By default that of an existing store; else the largest power of 2 that
        makes eight chunks, from 32 to 16,384.
    measures
        Further columns by name: traceable functions of (structures, ground) to one number. A name
        has 1 to 200 printable characters without a slash. A callable dataclass may state what its
        column is, for ``Study.measure``, in a field ``measure``, such as ``"Sa(0.9 s) (g)"``.
    keep_parameters
        Whether the scenarios' parameters are columns too; ``Study.parameters`` can recompute them.
    keep_failures
        Whether failed runs are kept as NaN and left out of all statistics; else they raise.
    notes
        Anything that JSON can hold; the study keeps it in ``about``.
    executor
        An executor of ``concurrent.futures`` that runs the chunks, such as Dask's
        ``Client.get_executor()``. By default this process runs them in order, each spread over all
        devices. Workers must see the store's folder; processes must be started by "spawn", since
        forked ones inherit JAX's locks but not its threads, and never return.
    shard
        (i, k), i from 1 to k: run only every k-th chunk from the i-th, so that k independent
        processes fill one store. The study is that of these chunks.
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
    # Longer than other functions: the parts of a study, in their order, share a dozen values.
    _check(scenarios, n, scheme, sampling, measures or {})
    findings = doubts(scenarios, grid)
    units = result_units(structures_of(scenarios))
    if chunk_size is None and store is not None and os.path.lexists(Path(store) / MANIFEST):
        chunk_size = Store(store).chunk_size
    elif chunk_size is None:
        chunk_size = min(max(_SMALLEST, 2 ** int(math.log2(n / _CHUNKS))), _LARGEST)
    size = count("chunk_size", chunk_size)
    task = Task(
        *(scenarios, grid, scheme, key_numbers(key), sampling, int(n), size),
        measures=dict(measures or {}),
        keep_parameters=bool(keep_parameters),
        keep_failures=bool(keep_failures),
        x64=bool(jax.config.jax_enable_x64),  # type: ignore[attr-defined]
    )
    chunks = _chunks_of_shard(shard, task, in_memory=store is None)
    identity = task.identity() | {"scales": describe(units)}
    task = task.identified(identity)
    # Points and columns of a chunk, all columns, and the moments of columns of all chunks.
    n_columns, number = len(task.names), task.z_type().dtype.itemsize
    rows, in_row = min(task.n, size), scenarios.dimension + n_columns
    require_memory("samples of a chunk", rows, rows * in_row * number)
    if store is None:
        require_memory("n (without a store)", task.n, task.n * n_columns * number)
    require_memory("number of chunks", len(chunks), len(chunks) * n_columns * _MOMENTS_BYTES)
    context = _context(task, notes)

    warn(findings + of_many(task.first_grounds(), grid, in_g=True), strict)
    moments: dict[int, dict[str, Moments]] = {}
    stored = None if store is None else Store.create(store, identity, task.n, context)
    if stored is not None:
        folder, requested = stored.folder.resolve(), stored.requested()
        task = dataclasses.replace(task, folder=folder, requested=requested)
        moments = dict(finished(Store(folder, task.n), chunks))
    columns: dict[int, Columns] = {}  # empty ones with a store
    sizes = {chunk: len(task.rows(chunk)) for chunk in chunks}
    missing = [chunk for chunk in chunks if chunk not in moments]
    done, whole = sum(sizes[chunk] for chunk in moments), sum(sizes.values())
    scale: dict[str, Any] = {"unit": " runs", "unit_scale": True}
    with tqdm(total=whole, initial=done, disable=not progress, **scale) as bar:
        for i, (chunk, outcome) in enumerate(_run(task, missing, executor)):
            moments[chunk], columns[chunk] = outcome
            if i == 0:  # warn before the other chunks are run
                ends = {x: (m.smallest, m.largest) for x, m in moments[chunk].items()}
                warn(unreached(context["topology"], ends, si=units is not None), strict)
            bar.update(sizes[chunk])

    moments, points = {chunk: moments[chunk] for chunk in chunks}, partial(task.points, chunks)
    sources: dict[str, Any] = {"scenarios": scenarios, "points": points, "scales": units}
    if stored is not None:
        stored.sweep()
        return Study.of_store(stored, moments, **sources)
    about = {"n": task.n, **context, "identity": identity}
    parts = partial(_parts_in_memory, [columns[chunk] for chunk in chunks])
    return Study([range(task.n)], about, total(moments.values()), parts, **sources)


def _parts_in_memory(columns: Sequence[Columns], *names: str) -> list[np.ndarray]:
    return [in_rows(of_chunk, *names) for of_chunk in columns]


def _check(scenarios: Any, n: Any, scheme: Any, sampling: Any, measures: Any) -> None:
    instance("scenarios", scenarios, ScenarioSet)
    count("scenarios.dimension", scenarios.dimension)
    instance("scheme", scheme, Scheme)
    instance("measures", measures, Mapping)
    most = require_sampling(sampling)
    if count("n", n) > most:
        raise InvalidInput("n", str(n), f"must be at most {most:,} for {sampling} sampling")
    for name, measure in measures.items():
        if not callable(measure):
            raise InvalidInput(f"measures[{name!r}]", repr(measure), "must be a function")


def _chunks_of_shard(shard: Any, task: Task, in_memory: bool) -> range:
    """Numbers of the chunks that this process runs."""
    rule, chunks = "", range(-(-task.n // task.chunk_size))
    pair = isinstance(shard, tuple) and len(shard) == 2 and all(isinstance(x, int) for x in shard)
    if not (pair and 1 <= shard[0] <= shard[1]):
        rule = "must be (i, k) with 1 ≤ i ≤ k"
    elif in_memory and shard != (1, 1):
        rule = "must come with a store to fill"
    elif shard[0] > len(chunks):
        rule = f"must leave a chunk for each shard: the study has {len(chunks)}"
    if rule:
        raise InvalidInput("shard", repr(shard), rule)
    return chunks[shard[0] - 1 :: shard[1]]


def _context(task: Task, notes: Any) -> dict[str, Any]:
    """Notes and, at z = 0, the topology and (of a pair) period and damping ratio of each block."""
    try:
        json.dumps(notes, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise InvalidInput("notes", "", f"must be what JSON can hold ({error})") from error
    scenarios, key, topologies = task.scenarios, task.fingerprint, list[Topology]()

    @jax.jit
    def median(z: jax.Array) -> list[jax.Array]:
        system = scenarios.realize(z)[0].system()
        topologies.append(system.topology)
        if system.topology != PAIR or not is_closable(system.links[0].gap):
            return []
        oscillators = []
        for rod, mass in zip(system.rods, system.masses, strict=True):
            elastic, stiffness = before_yield(rod.material), rod.stiffness
            period = 2 * jnp.pi / elastic.natural_frequency(stiffness, mass)
            oscillators += [period, elastic.damping_ratio(stiffness, mass)]
        return oscillators

    z = jnp.zeros(scenarios.dimension)
    *oscillators, topology = cached("median", key, lambda: (*map(float, median(z)), topologies[0]))
    if not np.isfinite(oscillators).all():
        values = ", ".join(f"{x:.4g}" for x in oscillators)
        rule = f"must be valid, but periods and damping ratios of its structures are {values}"
        raise InvalidInput("the scenario of z = 0", "", rule)
    return {"notes": notes, "oscillators": oscillators or None, "topology": topology}


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
