"""OpenSees' Steel01 and BoucWen beside jaxpound's rods that yield: accuracy against time.

    pip install -e ".[bench]" && python -m benchmarks.opensees_yielding

A bilinear oscillator and two storeys after Bouc and Wen, each storey with a rod of order 1 beside
it, which OpenSees has as a spring and a ViscousDamper. Errors are of the displacements at every
second, over the largest of them, against the event-driven solution in ``tests/oracles/yield.json``.
Ratios of times are to jaxpound's longest step at which its error is at most as large as OpenSees'.
"""

import sys
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import jaxpound as jp

jax.config.update("jax_enable_x64", True)
jp.runtime.use_loop_kernels()  # before the other benchmarks compute anything
sys.path.append(str(Path(__file__).parent))
from opensees import opensees  # noqa: E402

from tests.simulation.rods.test_yielding import CASES, ground_of, system_of  # noqa: E402

NAMES = {"one_bilinear": "bilinear, one mass", "two_boucwen": "Bouc–Wen, two storeys"}
OURS, THEIRS = (0.04, 0.02, 0.01, 0.005), (0.01, 0.005, 0.002, 0.001, 0.0005)
RUNS, REPEATS = 480, 5
SHAKING = 9  # the number of time series and pattern in OpenSees


def error(case, x):
    """Largest error of the displacements x at every second, shape (n, masses)."""
    exact = np.array(case["x"])
    return np.abs(np.asarray(x)[: len(exact)] - exact).max() / np.abs(exact).max()


def ours(case, h):
    """Error of a run with the step h, and the seconds of one and of one in a batch."""
    structures = system_of(case), ground_of(case), jp.TimeGrid.until(case["T"], h)
    single, together = programs(*structures)
    return error(case, at_seconds(*structures)), least(single), least(together) / RUNS


def at_seconds(structures, ground, grid):
    """Displacements at every second, shape (n, masses)."""
    response = jp.simulate(structures, ground, grid)
    return np.stack([mass.x for mass in response.masses], -1)[:: round(1 / grid.dt)]


def programs(structures, ground, grid):
    """What computes the largest displacement of the first mass in one run, and in a batch."""
    structures, ground = jax.tree.map(jnp.asarray, (structures, ground))

    def largest(amplitude):
        shaking = jp.Ricker(amplitude, ground.periods, ground.arrivals)
        return jp.demand(structures, shaking, grid).masses[0].peak_x

    batch = jnp.linspace(0.9, 1.1, RUNS) * ground.amplitude
    single, together = jax.jit(largest), jax.jit(jax.vmap(largest))
    return (
        lambda: jax.block_until_ready(single(batch[0])),
        lambda: jax.block_until_ready(together(batch)),
    )


def least(run, clock=time.perf_counter):
    """The smallest of several times, after a first run."""
    run()
    times = []
    for _ in range(REPEATS):
        start = clock()
        run()
        times.append(clock() - start)
    return min(times)


def theirs(ops, case, h):
    """Error of OpenSees' run with the step h, and its seconds."""
    masses, rods = case["system"]["m"], case["system"]["rods"]
    ops.wipe()
    ops.model("basic", "-ndm", 1, "-ndf", 1)
    for node in range(len(masses) + 1):
        ops.node(node + 1, 0.0)
    ops.fix(1, 1)
    for node, mass in enumerate(masses, start=2):
        ops.mass(node, mass)
    tag = 0
    for rod in rods:
        ends = rod["a"] + 2, rod["b"] + 2
        for material, *numbers in materials(rod):
            tag += 1
            ops.uniaxialMaterial(material, tag, *numbers)
            ops.element("zeroLength", tag, *ends, "-mat", tag, "-dir", 1)
    return shaken(ops, case, ground_of(case), h)


def shaken(ops, case, ground, h, algorithm="Newton", tolerance=1e-12, clock=time.perf_counter):
    """Error of the model of OpenSees, whose masses are nodes from 2 on, and its seconds."""
    acceleration = np.asarray(ground.acceleration(h * jnp.arange(round(case["T"] / h) + 1)))
    ops.timeSeries("Path", SHAKING, "-dt", h, "-values", *acceleration)
    ops.pattern("UniformExcitation", SHAKING, 1, "-accel", SHAKING)
    ops.constraints("Plain")
    ops.numberer("Plain")
    ops.system("FullGeneral")
    ops.test("NormDispIncr", tolerance, 50)
    ops.algorithm(algorithm)
    for node in range(2, len(case["x"][0]) + 2):  # Newmark's rule starts from the ground's
        ops.setNodeAccel(node, 1, -float(acceleration[0]), "-commit")
    ops.integrator("Newmark", 0.5, 0.25)
    ops.analysis("Transient")
    nodes = range(2, len(case["x"][0]) + 2)
    x, start = [[0.0] * len(nodes)], clock()
    for _ in range(round(case["T"])):
        if ops.analyze(round(1 / h), h):
            raise RuntimeError(f"OpenSees: no convergence at h = {h}")
        x.append([ops.nodeDisp(node, 1) for node in nodes])
    return error(case, x), clock() - start


def materials(rod):
    """OpenSees' materials, side by side, of a rod."""
    if rod["law"] == "bilinear":
        return [("Steel01", rod["K"] * rod["ey"], rod["K"], rod["alpha"])]
    if rod["law"] == "boucwen":
        of_length = rod["ey"] ** rod["n"]  # OpenSees' z is a length
        shares = (1 - rod["beta"]) / of_length, rod["beta"] / of_length
        numbers = rod["alpha"], rod["K"], rod["n"], *shares, 1.0, 0.0, 0.0, 0.0
        return [("BoucWen", *numbers)]
    branch = rod["K"] * (rod["tx"] / rod["tf"] - 1)  # a spring and a dashpot in series
    return [("Elastic", rod["K"]), ("ViscousDamper", branch, branch * rod["tf"], 1.0)]


def main() -> None:
    """Print the tables."""
    ops = opensees()
    for name, title in NAMES.items():
        case = CASES[name]
        print(title)
        print(f"  {'':10}{'step':>8}{'error':>10}{'one run, ms':>14}{'of a batch, µs':>16}")
        rows = []
        for h in OURS:
            off, single, of_batch = ours(case, h)
            rows.append((off, single, of_batch))
            print(f"  {'jaxpound':10}{h:8g}{off:10.1e}{1e3 * single:14.3f}{1e6 * of_batch:16.1f}")
        for h in THEIRS:
            off, seconds = theirs(ops, case, h)
            print(f"  {'OpenSees':10}{h:8g}{off:10.1e}{1e3 * seconds:14.1f}", end="")
            as_good = [row for row in rows if row[0] <= off]
            if as_good:
                _, single, of_batch = as_good[0]
                print(
                    f"   {seconds / single:,.0f} and {seconds / of_batch:,.0f} times as long",
                    end="",
                )
            print(flush=True)


if __name__ == "__main__":
    main()
