"""Beyond one process: Dask's scheduler, a worker killed on the way, executorlib, JAX's mesh."""

import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from tests.study.test_run import assert_same, study

ROOT = Path(__file__).parents[1]


@pytest.fixture
def own_environment():
    """Dask sets numbers of threads in the environment, which later tests would inherit."""
    before = dict(os.environ)
    yield
    os.environ.clear()
    os.environ.update(before)


@pytest.mark.filterwarnings("default", "ignore:monte_carlo. ground. PGA of")
@pytest.mark.usefixtures("own_environment")
def test_a_dask_worker_killed_in_the_middle_costs_only_its_chunks(tmp_path):
    distributed = pytest.importorskip("distributed")
    killed = tmp_path / "killed"
    arguments = {"n": 10_000, "chunk_size": 250}
    how = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None, "silence_logs": 50}
    with distributed.LocalCluster(**how) as cluster, distributed.Client(cluster) as client:
        found = []

        def run():
            with jax.enable_x64(True), jax.numpy_rank_promotion("raise"):
                found.append(study(store=killed, executor=client.get_executor(), **arguments))

        thread = threading.Thread(target=run)
        thread.start()
        while len([*killed.glob("chunk-*.npz")]) < 3:
            time.sleep(0.01)
            assert thread.is_alive()
        had = {path: path.stat().st_ino for path in killed.glob("chunk-*.npz")}
        os.kill(cluster.workers[0].pid, signal.SIGKILL)
        thread.join()
    assert len(found[0]) == 10_000
    assert not [*killed.glob("*.part")]  # what the killed one was writing
    assert all(path.stat().st_ino == file for path, file in had.items())
    # Workers have one thread for linear algebra, whose rounding differs.
    assert_same(found[0], study(**arguments))


@pytest.mark.filterwarnings("default", "ignore:monte_carlo. ground. PGA of")
@pytest.mark.usefixtures("own_environment")
def test_workers_of_executorlib_make_the_study_of_one_process(tmp_path):
    executorlib = pytest.importorskip("executorlib")
    arguments = {"n": 96, "chunk_size": 32}
    with executorlib.SingleNodeExecutor(max_workers=2, block_allocation=True) as executor:
        shared = study(store=tmp_path / "shared", executor=executor, **arguments)
    assert len([*(tmp_path / "shared").glob("chunk-*.npz")]) == 3
    assert_same(shared, study(**arguments))


SCENARIOS = """jp.Scenarios(
    jp.paper.structures(),
    jp.RandomRicker(1, jp.LogNormal(0.3, 0.5), jp.Uniform(1.0, 3.0), jp.Uniform(0.0, 3.0)),
)"""
PROGRAM = """
import sys
from pathlib import Path
import jax
import jaxpound as jp
jax.config.update("jax_num_cpu_devices", 2)
exec(Path("examples/many_processes.py").read_text().replace("RUNS = 8192", "RUNS = 1024"))
shard = (jax.process_index() + 1, jax.process_count())
store = jp.Storage(sys.argv[4], chunk_size=64, shard=shard)
print(len(jp.monte_carlo(SCENARIOS, 256, jp.TimeGrid(0.1, 40), store=store, progress=False)))
""".replace("SCENARIOS", SCENARIOS)
"""The documented script, with fewer runs, and a study of which each process makes a part."""


def start_two(store):
    with socket.socket() as free:
        free.bind(("localhost", 0))
        address = f"localhost:{free.getsockname()[1]}"
    how = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "cwd": ROOT}
    start, numbers = [sys.executable, "-c", PROGRAM, address, "2"], ("0", "1")
    for process in [subprocess.Popen([*start, number, store], **how) for number in numbers]:
        out, errors = process.communicate(timeout=300)
        assert process.returncode == 0, errors
        yield out


def test_two_processes_of_one_program_share_a_batch_and_fill_a_store(tmp_path):
    """Over the devices of both a batch is a plain one here, and the store holds a whole study."""
    words = r"(\d) of 2, 4 devices: .* = ([\d.]+), smallest gap (\S+)\n128\n"
    printed = start_two(str(tmp_path / "study"))
    (first, *numbers), (second, *same) = (re.search(words, out).groups() for out in printed)
    assert (first, second, numbers) == ("0", "1", same)
    assert_same(jp.Study.open(tmp_path / "study"), study(eval(SCENARIOS), 256))
    ground = jp.RandomRicker(5, jp.LogNormal(0.1, 0.5), jp.Uniform(1, 3), jp.Uniform(0, 8))
    scenarios = jp.Scenarios(jp.paper.structures(), ground)
    grid = jp.TimeGrid.until(20.0, 0.04)

    def gap(index):
        z = jax.random.normal(jax.random.fold_in(jax.random.key(0), index), scenarios.dimension)
        return jp.demand(*scenarios.realize(z), grid).min_gap

    gaps = jp.runtime.in_chunks(gap)(jnp.arange(1024))
    assert float(numbers[0]) == pytest.approx(np.mean(gaps <= 0.5), abs=1e-6)
    assert float(numbers[1]) == pytest.approx(gaps.min(), abs=1e-8)
