"""Batches: spread over the devices that JAX has, and run in chunks where they exceed memory."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextvars import ContextVar, copy_context
from functools import cache, partial
from typing import Any, TypeVar

import jax
import numpy as np
from jax import lax
from jax.custom_batching import custom_vmap
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir
from jax.sharding import AxisType, Mesh, NamedSharding, PartitionSpec

from jaxpound._checks import count, is_traced
from jaxpound._errors import InvalidInput

T = TypeVar("T")

_RUNS = PartitionSpec("runs")
_SMALLEST_SHARE = 16  # runs of a device: fewer are not worth the coordination

# Runs at a time of a core. Of 512 every array would fill a page of memory, so that a run's numbers
# all fell on the same lines of the cache: a fifth slower, gradients three quarters.
_CPU_RUNS = 480

# Threads of JAX before 0.12 for a device. With as many threads as devices a program that awaits a
# sum over all devices never ends where others wait to be launched: each of them has one thread for
# a device, and so have those that each thread of Python launches (of which there may be three).
_THREADS = 4

# Whether runs are traced that are not to be spread any more: those of one device, or a group of
# them. JAX's own mesh does not say so inside a ``jit`` that was traced before.
_is_apart = ContextVar("is_apart", default=False)


def use_cores(n: int | None = None) -> int:
    """Let JAX see ``n`` cores of this machine's CPU as devices, over which batches are spread.

    A run uses one core. ``jax.vmap`` of ``demand`` or ``simulate`` then uses all, if its batch is a
    multiple of n and at least 16 n; ``in_chunks`` uses them for a batch of any size. Call it once,
    before JAX computes anything: it sets ``jax_num_cpu_devices`` of ``jax.config``, and for JAX
    before 0.12 the environment variable ``PJRT_NPROC``, the number of JAX's threads, if it is less.

    Results lie where they were computed, spread over the devices. Within ``jax.default_device(d)``,
    and only there, arrays that are committed to one device can be batched: nothing is spread.

    ``n`` is a positive whole number, by default that of all cores that this process may use.
    Returns it; raises a ``RuntimeError`` if JAX has started with another number already.
    """
    has_affinity = hasattr(os, "sched_getaffinity")
    cores = len(os.sched_getaffinity(0)) if has_affinity else os.cpu_count() or 1
    n = count("n", cores if n is None else n)
    try:
        jax.config.update("jax_num_cpu_devices", n)
        if jax.__version_info__ < (0, 12):
            own = os.environ.get("PJRT_NPROC", "")
            threads = max(cores, _THREADS * n, int(own) if own.isdecimal() else 0)
            os.environ["PJRT_NPROC"] = str(threads)
    except RuntimeError as error:
        if (started := len(jax.devices("cpu"))) != n:
            rule = f"must be set before JAX computes anything; it has started with {started}"
            raise RuntimeError(f"use_cores: n = {n} {rule}") from error
    return n


def in_chunks(function: Callable[..., T], chunk_size: int | None = None) -> Callable[..., T]:
    """Like ``jax.vmap(function)``, for batches of any size: in chunks, by one compiled program.

    Memory beyond arguments and results does not grow with the batch, and a chunk that fits the
    caches is faster too. ``function`` takes and returns pytrees of arrays; every argument is
    batched along its first axis. Chunks are spread over the devices that JAX has, and filled up to
    one size (a batch smaller than a chunk to a power of two). The result compiles at its first
    call, and once for each size: keep it for later calls.

    Parameters
    ----------
    function
        What to do with one run, such as ``lambda structures, ground: jp.demand(...)``, a gradient
        of it, or a draw by ``jax.random.fold_in(key, index)`` followed by a run. What all runs
        share, and what is to be differentiated, belongs inside it.
    chunk_size
        Runs at a time, rounded up to a multiple of the number of devices; by default 480 for every
        core of a CPU (what fits its cache), 65,536 for every other device.

    Returns
    -------
    A function of the same arguments whose results are NumPy arrays with a leading axis. It raises a
    ``ValueError`` if the arguments are not arrays with one and the same length, at least 1, if the
    results are not numbers, and inside ``jit``, ``vmap`` or ``grad``.

    Examples
    --------
    >>> grid = jp.TimeGrid.until(20.0, dt=0.05)
    >>> def gap(friction):
    ...     structures = replace(jp.paper.structures(), friction=friction)
    ...     return jp.demand(structures, jp.paper.ground(), grid).min_gap
    >>> [round(float(x), 3) for x in jp.runtime.in_chunks(gap)(np.array([0.1, 0.2, 0.3]))]
    [0.172, 0.26, 0.314]
    """
    if not callable(function):
        raise InvalidInput("function", repr(function), "must be a function")
    if chunk_size is not None:
        chunk_size = count("chunk_size", chunk_size)
    run = jax.jit(jax.vmap(function))

    def mapped(*args: Any) -> T:
        n = _batch_size(args)
        _no_tracer(args)
        devices = jax.local_devices()
        # Few sizes, so that batches of nearly as many runs share a program.
        most = chunk_size or runs_at_a_time()
        size = 1 << (n - 1).bit_length()
        if n > most:  # evenly, so that the last is not filled up with many copies
            unit = 2 * _SMALLEST_SHARE * len(devices)
            size = -(-even_share(n, most) // unit) * unit
        size = -(-min(size, most) // len(devices)) * len(devices)
        mesh = _mesh()
        results: Any = None

        def chunk(start: int) -> Any:
            rows = np.minimum(np.arange(start, start + size), n - 1)
            part = jax.tree.map(lambda x: x[rows], args)
            placed = part if mesh is None else jax.device_put(part, NamedSharding(mesh, _RUNS))
            return run(*placed)

        following = chunk(0)
        for start in range(0, n, size):
            part = following
            # It computes while the results of the one before are copied.
            following = chunk(start + size) if start + size < n else None
            _no_tracer(part)
            if results is None:
                results = jax.tree.map(lambda x: _room(n, x), part)
            for whole, piece in zip(*map(jax.tree.leaves, (results, part)), strict=True):
                whole[start : start + size] = np.asarray(piece)[: n - start]
        return results

    return mapped


def even_share(n: int, most: int) -> int:
    """Length of the fewest equal parts of n items, of at most ``most`` each, rounded up."""
    return -(-n // -(-n // most))


def runs_at_a_time() -> int:
    """The default chunk size of ``in_chunks``."""
    devices = jax.local_devices()
    return len(devices) * (_CPU_RUNS if devices[0].platform == "cpu" else 65_536)


def spread(tree: T) -> T:
    """``tree`` itself; under ``jax.vmap``, its batch is spread over the devices that JAX has.

    It is not spread where it cannot be divided evenly, where it is small, or inside a sharding that
    the caller has set up. What all runs share, and what follows from it alone, is computed once.
    """
    leaves, structure = jax.tree.flatten(tree)
    return jax.tree.unflatten(structure, _spread(*leaves))


def without_mesh(tree: T) -> T:
    """The same arrays, whose types do not name the mesh on which they lie, if ``spread`` made it.

    So a program that is traced with them can be part of what is done ``on_each_device``.
    """
    return jax.tree.map(_of_no_mesh.bind, tree)


@jax.custom_jvp
def _spread(*leaves: Any) -> list[Any]:
    return _placed(*leaves)


@partial(_spread.defjvp, symbolic_zeros=True)
def _(primals: Any, tangents: Any) -> Any:
    # Else zero derivatives would be computed at every step.
    return _spread(*primals), list(tangents)


@custom_vmap
def _placed(*leaves: Any) -> list[Any]:
    return list(leaves)


@_placed.def_vmap
def _(size: int, batched: list[bool], *leaves: Any) -> Any:
    if (mesh := _mesh_for(size)) is None:
        return _spread(*leaves), batched  # an outer vmap may still divide its own axis
    split, pairs = NamedSharding(mesh, _RUNS), zip(leaves, batched, strict=True)
    return [lax.with_sharding_constraint(x, split) if is_in else x for x, is_in in pairs], batched


_of_no_mesh = Primitive("of_no_mesh")
_of_no_mesh.def_impl(lambda x: x)
_of_no_mesh.def_abstract_eval(
    lambda x: x.update(sharding=None) if jax.sharding.get_abstract_mesh().empty else x
)
ad.deflinear(_of_no_mesh, lambda change: [change])
batching.defvectorized(_of_no_mesh)
mlir.register_lowering(_of_no_mesh, lambda context, x: [x])


def on_each_device(
    work: Callable[..., T], *args: Any, size: int, shared: Sequence[bool] | None = None
) -> T:
    """``work`` of the runs on each device apart: where it looks at runs together, devices wait.

    ``size`` is that of the batch; ``shared`` says which arguments all of its runs have in common.
    """

    def apart(*args: Any) -> T:
        context = copy_context()
        context.run(_is_apart.set, True)
        return context.run(work, *args)

    if (mesh := _mesh_for(size)) is None:
        return apart(*args)
    specs = tuple(PartitionSpec() if common else _RUNS for common in shared or [False] * len(args))
    local = jax.shard_map(apart, mesh=mesh, in_specs=specs, out_specs=_RUNS, check_vma=False)
    return local(*args)


def _mesh_for(size: int) -> Mesh | None:
    """The devices over which a batch is spread, or None."""
    chosen = jax.config.jax_default_device  # type: ignore[attr-defined]
    # A program of many processes may have sharded the batch over all of their devices.
    mesh = None if chosen or jax.process_count() > 1 else _mesh()
    if mesh is None or _is_apart.get() or not jax.sharding.get_abstract_mesh().empty:
        return None
    return None if size % mesh.size or size < mesh.size * _SMALLEST_SHARE else mesh


@cache
def _mesh() -> Mesh | None:
    """The devices of this process, if there are several."""
    if len(devices := jax.local_devices()) < 2:
        return None
    return Mesh(np.array(devices), ("runs",), axis_types=(AxisType.Auto,))


def _batch_size(args: tuple[Any, ...]) -> int:
    shapes = [np.shape(leaf) for leaf in jax.tree.leaves(args)]
    sizes = {shape[0] if shape else None for shape in shapes}
    if len(sizes) != 1 or None in sizes or 0 in sizes:
        rule = "must be arrays with the same number of runs, at least 1, along their first axis; "
        rule += "what all runs share belongs inside the function"
        raise ValueError(f"in_chunks: arguments of shapes {', '.join(map(str, shapes))} {rule}")
    return shapes[0][0]


def _no_tracer(tree: Any) -> None:
    if is_traced(tree):
        remedy = "take derivatives inside its function, and the sum or mean of its results"
        raise ValueError(f"in_chunks runs outside jit, vmap and grad; {remedy}")


def _room(n: int, x: jax.Array) -> np.ndarray:
    if not isinstance(x.dtype, np.dtype):
        raise ValueError(f"in_chunks: results of type {x.dtype} must be numbers")
    return np.empty((n, *x.shape[1:]), x.dtype)
