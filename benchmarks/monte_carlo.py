"""Time Monte Carlo studies: what draws, columns and the store cost over the bare batched loop.

    pip install -e ".[bench,cluster]" && python benchmarks/monte_carlo.py

Ratios are taken in turn: within one process, or between processes that run one after the other.
"""

import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import jax
import numpy as np

import jaxpound as jp

GRID = jp.TimeGrid.until(20.0, 0.04)
FOLDER = Path(__file__).parent


def scenarios():
    """Five wavelets, uncertain friction and one uncertain relaxation time."""
    uncertain = {"friction": jp.Uniform(0.1, 0.4), "rod_1.tau_x": jp.LogNormal(1.183, 0.1)}
    return jp.Scenarios(
        jp.UncertainStructures(jp.paper.structures(), uncertain),
        jp.RandomRicker(5, jp.LogNormal(0.1, 0.5), jp.Uniform(1.0, 3.8), jp.Uniform(1.0, 7.0)),
    )


def bare(n):
    """The batched loop alone: draw, run, and keep every scalar in memory."""
    drawn = scenarios()

    def run(index):
        z = jax.random.normal(jax.random.fold_in(jax.random.key(0), index), drawn.dimension)
        return jp.demand(*drawn.realize(z), GRID).scalars()

    return jp.runtime.in_chunks(run), np.arange(n, dtype=np.uint32)


def study(n, folder, chunk_size=None, **more):
    storage = jp.Storage(folder, chunk_size=chunk_size)
    return jp.monte_carlo(scenarios(), n, GRID, store=storage, progress=False, **more)


def peak():
    """Peak resident memory of this process, GiB."""
    return int(re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text())[1]) / 2**20


def child(kind, n, folder="-"):
    """Seconds, peak memory and probability of one run in a process of its own."""
    done = subprocess.run(
        [sys.executable, __file__, kind, str(n), str(folder)],
        stdout=subprocess.PIPE,
        check=True,
        text=True,
    )
    return [float(x) for x in done.stdout.split()]


def run_child(kind, n, folder):
    jax.config.update("jax_enable_x64", True)
    jp.runtime.use_cores()
    start = time.perf_counter()
    if kind == "bare":
        loop, indices = bare(n)
        share = float(np.mean(loop(indices)["min_gap"] <= 0.3))
    else:
        share = study(n, folder).pounding_probability(0.7).value
    print(time.perf_counter() - start, peak(), share)


def overhead():
    print("Every scalar of 200,000 scenarios, in one process, once compiled")
    loop, indices = bare(200_000)
    loop(indices[:2048])
    with tempfile.TemporaryDirectory() as folder:
        study(2048, Path(folder) / "warm")
        ratios = []
        for turn in range(3):
            start = time.perf_counter()
            loop(indices)
            middle = time.perf_counter()
            study(200_000, Path(folder) / f"{turn}")
            ratios.append((time.perf_counter() - middle) / (middle - start))
            print(f"  bare loop {middle - start:5.2f} s, with store {ratios[-1]:.3f} times that")
    print(f"  median {np.median(ratios):.3f}")


def millions():
    print("In a process of its own, compiling included")
    with tempfile.TemporaryDirectory() as folder:
        for n in (100_000, 1_000_000):
            store = Path(folder) / f"{n}"
            for words, kind in (("bare loop", "bare"), ("with store", "study"), ("again", "study")):
                seconds, gib, share = child(kind, n, store)
                print(
                    f"  {n:9,} {words:10} {seconds:6.1f} s, peak resident {gib:.2f} GiB, "
                    f"P(required gap >= .7) {share:.4f}"
                )
            size = sum(path.stat().st_size for path in store.iterdir())
            print(f"  {n:9,} store      {size / 1e6:.0f} MB, {size / n:.0f} bytes a scenario")


def pin(dask_worker):
    """Give a worker, all its threads, one core of its own, before JAX starts there."""
    cores = sorted(os.sched_getaffinity(0))
    for thread in os.listdir("/proc/self/task"):
        os.sched_setaffinity(int(thread), {cores[int(dask_worker.name) % len(cores)]})


def workers():
    from distributed import Client, LocalCluster

    print("Dask workers of one core each, 524,288 scenarios in chunks of 8,192, once compiled")
    seconds = {}
    for n in (1, 2, 1, 2):
        with (
            LocalCluster(n_workers=n, threads_per_worker=1, dashboard_address=None) as cluster,
            Client(cluster) as client,
            tempfile.TemporaryDirectory() as folder,
        ):
            client.run(pin)
            executor = client.get_executor()
            more = {"chunk_size": 8192, "executor": executor}
            study(65_536, Path(folder) / "warm", **more)
            start = time.perf_counter()
            study(524_288, Path(folder) / "timed", key=1, **more)  # the same program
            took = time.perf_counter() - start
        seconds[n] = min(took, seconds.get(n, np.inf))
        print(f"  {n} workers {took:5.2f} s")
    print(f"  two workers are {seconds[1] / seconds[2]:.2f} times as fast as one")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        run_child(sys.argv[1], int(sys.argv[2]), sys.argv[3])
    else:
        jax.config.update("jax_enable_x64", True)
        cores = jp.runtime.use_cores()
        print(f"JAX {jax.__version__}, {jax.default_backend()}, {cores} cores\n")
        for part in (overhead, millions, workers):
            part()
            print()
