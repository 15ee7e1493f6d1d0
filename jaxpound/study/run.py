"""Monte Carlo over uncertain earthquakes and structures: in chunks, stored, resumable.

Sample i is the scenario of point i, independent of the chunk size, the number of devices and the
process that runs it.
"""

from __future__ import annotations

import dataclasses
import json
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
from jaxpound.grid import TimeGrid
from jaxpound.ground.plausibility import of_many, tell
from jaxpound.model.structures import AdjacentStructures
from jaxpound.model.system import Structures, Topology
from jaxpound.simulation.scheme import Scheme
from jaxpound.study.archives import digest
from jaxpound.study.chunk import Measure, Outcome, Task, total
from jaxpound.study.demands import unreached
from jaxpound.study.sampling import key_numbers, require_sampling
from jaxpound.study.scenarios import ScenarioSet
from jaxpound.study.store import MANIFEST, Store, describe
from jaxpound.study.study import Study
from jaxpound.units import Scales

_CHUNK_SIZE = 16_384
_MOMENTS_BYTES = 250  # of one column of one chunk


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
    scales: Scales | None = None,
    notes: Any = None,
    executor: Executor | None = None,
    shard: tuple[int, int] = (1, 1),
    progress: bool = True,
    strict: bool = False,
) -> Study:
    """Demands of n random scenarios.

    With a store, the same call resumes an earlier one, wherever it was stopped, and ends with the
    same files; a larger n extends the study. Only chunks that were being run are lost. Damaged
    chunks are named in a warning and run again. Several processes may fill one store at once, with
    the same n or others. (Results agree to the last bit if the numbers of JAX devices and of
    threads of the linear algebra are the same; else to rounding.)

    Parameters
    ----------
    scenarios
        What is random: ``Scenarios``, or any object with ``dimension`` and ``realize``.
    n
        Number of samples, at most 2^31 (2^30 for Sobol points).
    grid, scheme
        See ``simulate``.
    key
        A seed, or a key of ``jax.random``.
    sampling
        "plain" for independent samples, "sobol" for scrambled Sobol points (n best a power of 2).
    store
        A folder, made if needed, with one file per chunk. Without it the columns stay in memory.
    chunk_size
        Samples per chunk; by default 16,384, or that of the store.
    measures
        Further columns by name: traceable functions of (structures, ground) to one number. A name
        has 1 to 200 printable characters, no slash among them.
    keep_parameters
        Whether the scenarios' parameters are columns too. Otherwise ``Study.parameters`` recomputes
        them.
    keep_failures
        Whether failed runs are kept as NaN and left out of all statistics; else they raise.
    scales
        Given for results in SI units.
    notes
        Anything that JSON can hold, kept with the study.
    executor
        Where chunks run: an executor of ``concurrent.futures``, such as Dask's
        ``Client.get_executor()``. By default here, one after the other, each spread over all
        devices. Its workers must see the store's folder; other processes must be started by
        "spawn": forked ones, which inherit JAX's locks but not its threads, never return.
    shard
        (i, k), i from 1 to k: only every k-th chunk from the i-th, so that k independent processes
        fill one store.
    progress
        Whether to show a progress bar with rate and time left.
    strict
        Whether a ``PlausibilityWarning`` is raised as a ``ValueError``.

    Returns
    -------
    Study
        The columns (all of ``Demand``, required gaps of links without a law of contact, demands
        over all floors, measures, parameters) and what follows from them; for a shard, of its own
        chunks.

    Raises
    ------
    ValueError
        If an argument breaks its rule, or memory has no room for the study. If a scenario is
        invalid or its run fails, with its index and the reason. If the store holds another study,
        with what differs. If ``strict``, also where there would be a warning.
    OSError
        If the store cannot be written to. Finished chunks stay, and are used by the next call.

    Warns
    -----
    PlausibilityWarning
        Before the first run: if, of the first 256 scenarios, more than 1 % have a ground motion
        that the grid does not resolve (see ``simulate``), or a PGA above 5 g. After the first
        chunk: if the gap of a link is more than 100 times the displacements at its ends (peak
        |x1| + peak |x2|).

    Examples
    --------
    >>> amplitude, periods = jp.LogNormal(0.03, 0.5), jp.Uniform(1.0, 3.8)
    >>> ground = jp.RandomRicker(2, amplitude, periods, arrivals=jp.Uniform(1.0, 7.0))
    >>> scenarios = jp.Scenarios(jp.paper.structures(), ground)
    >>> study = jp.monte_carlo(scenarios, 64, jp.TimeGrid.until(20.0, dt=0.1), progress=False)
    >>> print(study.pounding_probability(gap=0.03))
    0.1406 (95%: 0.06637 to 0.2502)
    """
    _check(scenarios, n, grid, scheme, sampling, measures or {}, scales, shard)
    if store is None and shard != (1, 1):
        raise ValueError(f"monte_carlo: shard = {shard} must come with a store to fill")
    begun = store is not None and os.path.lexists(Path(store) / MANIFEST)
    if store is not None and begun and chunk_size is None:
        chunk_size = Store(store).chunk_size
    size = count("monte_carlo", "chunk_size", _CHUNK_SIZE if chunk_size is None else chunk_size)
    task = Task(
        scenarios=scenarios,
        grid=grid,
        scheme=scheme,
        key=key_numbers("monte_carlo", key),
        sampling=sampling,
        n=int(n),
        chunk_size=size,
        measures=dict(measures or {}),
        keep_parameters=bool(keep_parameters),
        keep_failures=bool(keep_failures),
        x64=bool(jax.config.jax_enable_x64),  # type: ignore[attr-defined]
    )
    chunks = range(-(-task.n // size))
    own = chunks[shard[0] - 1 :: shard[1]]
    if not own:
        rule = f"leave a chunk for each shard: the study has {len(chunks)}"
        raise ValueError(f"monte_carlo: shard = {shard} must {rule}")
    try:
        json.dumps(notes, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise ValueError(f"monte_carlo: notes must be what JSON can hold ({error})") from error
    identity = task.identity() | {"scales": describe(scales)}
    _require_room(task, len(identity["columns"]), len(own), in_memory=store is None)
    program = {k: x for k, x in identity.items() if k not in ("key", "sampling", "scales")}
    # A store that exists has its own.
    topology, oscillators = _median(scenarios)
    context: dict[str, Any] = {}
    if not begun:
        context = {"notes": notes, "oscillators": oscillators, "topology": topology}
    task = dataclasses.replace(
        task,
        names=tuple(identity["columns"]),
        fingerprint=digest(json.dumps(program).encode()),
    )
    tell("monte_carlo", of_many(task.first_grounds(), grid, in_g=True), strict)
    made = None
    if store is not None:
        made = Store.create(store, identity, task.n, context)
        task = dataclasses.replace(task, folder=made.folder.resolve(), most=made.asked())

    outcomes = dict(task.finished(own))
    missing = [chunk for chunk in own if chunk not in outcomes]
    rows = {chunk: len(task.rows(chunk)) for chunk in own}
    with tqdm(
        total=sum(rows.values()),
        initial=sum(rows[chunk] for chunk in outcomes),
        unit=" runs",
        unit_scale=True,
        disable=not progress,
    ) as bar:
        for i, (chunk, outcome) in enumerate(_outcomes(task, missing, executor)):
            if i == 0:  # before the time for all is spent
                findings = _unreached(outcome, topology, oscillators is not None, scales)
                tell("monte_carlo", findings, strict)
            outcomes[chunk] = outcome
            bar.update(rows[chunk])

    more: dict[str, Any] = {
        "scenarios": scenarios,
        "points": partial(task.points, own),
        "scales": scales,
    }
    if made is not None:
        made.sweep()
        moments = {chunk: outcomes[chunk].moments for chunk in own}
        study = Study.of_store(made, moments, **more)
    else:
        kept = [outcomes.pop(chunk) for chunk in own]
        study = Study(
            [range(task.n)],
            {"n": task.n, **context, "identity": identity},
            total([x.moments for x in kept]),
            lambda name: (outcome.columns[name] for outcome in kept),
            **more,
        )
    return study


def _unreached(
    outcome: Outcome, topology: Topology, pair: bool, scales: Scales | None
) -> list[str]:
    """Findings if gaps are out of proportion to the displacements in a chunk."""
    size = 1.0 if scales is None else float(scales.length)
    moments = outcome.moments
    return unreached(
        topology,
        lambda name: size * moments[name].smallest,
        lambda name: size * moments[name].largest,
        pair=pair,
        si=scales is not None,
    )


def _check(
    scenarios: Any,
    n: Any,
    grid: Any,
    scheme: Any,
    sampling: Any,
    measures: Any,
    scales: Any,
    shard: Any,
) -> None:
    """Refuse invalid arguments, by name."""
    owner = "monte_carlo"
    instance(owner, "scenarios", scenarios, ScenarioSet)
    count(owner, "scenarios.dimension", scenarios.dimension)
    instance(owner, "grid", grid, TimeGrid)
    instance(owner, "scheme", scheme, Scheme)
    instance(owner, "measures", measures, Mapping)
    for name, measure in measures.items():
        if not callable(measure):
            raise ValueError(f"{owner}: measures[{name!r}] = {measure!r} must be a function")
    if scales is not None:
        instance(owner, "scales", scales, Scales)
    most = require_sampling(owner, sampling)
    if count(owner, "n", n) > most:
        raise ValueError(f"{owner}: n = {n} must be at most {most:,} for {sampling} sampling")
    right = isinstance(shard, tuple) and len(shard) == 2
    if not (right and all(isinstance(x, int) for x in shard) and 1 <= shard[0] <= shard[1]):
        raise ValueError(f"{owner}: shard = {shard!r} must be (i, k) with 1 ≤ i ≤ k")


def _require_room(task: Task, columns: int, chunks: int, in_memory: bool) -> None:
    """Refuse a study that exceeds the memory: its points, columns, and moments of columns."""
    owner, number, d = "monte_carlo", task.normal().dtype.itemsize, task.scenarios.dimension
    size = min(task.n, task.chunk_size)
    require_memory(owner, "samples of a chunk", size, size * (d + columns) * number)
    if in_memory:
        require_memory(owner, "n (without a store)", task.n, task.n * columns * number)
    require_memory(owner, "number of chunks", chunks, chunks * columns * _MOMENTS_BYTES)


def _median(scenarios: ScenarioSet) -> tuple[Topology, list[float] | None]:
    """Topology of the median scenario, z = 0, and its oscillators.

    These are period and damping ratio of both structures of a pair, uncoupled; of others None.
    """
    topologies: list[Topology] = []

    @jax.jit
    def median(z: jax.Array) -> list[jax.Array]:
        structures: Any = scenarios.realize(z)[0]
        instance("monte_carlo", "scenarios: structures", structures, Structures)
        topologies.append(structures.system().topology)
        if not isinstance(structures, AdjacentStructures):
            return []
        (w1, w2), (z1, z2) = structures.natural_frequencies, structures.damping_ratios
        return [2 * jnp.pi / w1, z1, 2 * jnp.pi / w2, z2]

    found = [float(x) for x in median(jnp.zeros(scenarios.dimension))]
    if not np.isfinite(found).all():
        shown = ", ".join(f"{x:.4g}" for x in found)
        rule = "must be valid, but periods and damping ratios of its structures are"
        raise ValueError(f"monte_carlo: the scenario of z = 0 {rule} {shown}")
    return topologies[0], found or None


def _outcomes(
    task: Task, chunks: Sequence[int], executor: Executor | None
) -> Iterator[tuple[int, Outcome]]:
    """Chunks as they are finished."""
    if executor is None:
        with ThreadPoolExecutor(1) as keeper:  # one chunk is written while the next is run
            before = None
            for chunk in chunks:
                columns = task.compute(chunk)
                if before is not None:
                    yield before[0], before[1].result()
                before = chunk, keeper.submit(task.keep, chunk, columns)
            if before is not None:
                yield before[0], before[1].result()
        return
    store = None if task.folder is None else Store(task.folder, task.n)
    futures = {executor.submit(task.finish, chunk): chunk for chunk in chunks}
    try:
        for future in as_completed(futures):
            chunk, outcome = futures[future], future.result()
            if store is not None and not store.has(chunk):
                raise ValueError(
                    f"monte_carlo: chunk {chunk} is not in {task.folder}: the executor's workers "
                    "must see that folder"
                )
            yield chunk, outcome
    finally:
        for future in futures:
            future.cancel()
