"""Two buildings of n storeys with a damper at every floor: compilation, speed and accuracy.

    python benchmarks/storeys.py             # the pair, 2 × 2, 2 × 5 and 2 × 10
    python benchmarks/storeys.py --accuracy  # 2 × 10: errors of values and derivatives by step, and
                                             # without friction against linear theory
    python benchmarks/storeys.py --contact   # the pair to 2 × 10 with contact at every floor
    python benchmarks/storeys.py --derivatives  # of rows and storeys against the tests' oracle

Speed is of a batch of earthquakes, per rod and step, over that of the paper's pair in the same
process; all times are of the processor, compilation without any cache. The gradient is that of the
batch's mean by all slip forces and gaps, its time in those of the batch's values.
"""

import argparse
import dataclasses
import sys
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_enable_compilation_cache", False)

import jaxpound as jp  # noqa: E402

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests import linear  # noqa: E402
from tests.simulation import test_contact as oracle  # noqa: E402

BATCH, STEPS, ROUNDS = 512, 500, 5


def storeys(n, friction=0.05, contact=None):
    """Two buildings of n storeys of other rods and masses, dampers and gaps at all floors."""
    laws = jp.ZenerRod(0.5, 0.01, 0.05), jp.ZenerRod(0.7, 0.05, 0.3)
    rods = []
    for first, law, stiffness in ((0, laws[0], 20.0), (n, laws[1], 30.0)):
        for i in range(first, first + n):
            rods.append(jp.Rod(law, stiffness, (i, i - 1 if i > first else jp.GROUND)))
    links = [jp.Link((i, n + i), friction * (1 + i), 1.0, contact) for i in range(n)]
    return jp.System((1.0,) * n + (0.7,) * n, tuple(rods), tuple(links))


def compiled(function, *args):
    """A compiled function, and the processor time that tracing and compiling it took."""
    start = time.process_time()
    program = jax.jit(function).lower(*args).compile()
    return program, time.process_time() - start


def best(program, *args):
    """The shortest processor time of a call."""
    times = []
    for _ in range(ROUNDS):
        start = time.process_time()
        jax.block_until_ready(program(*args))
        times.append(time.process_time() - start)
    return min(times)


def linked(system, frictions, gaps):
    """The system with other slip forces and gaps at rest."""
    numbers = zip(system.links, frictions, gaps, strict=True)
    links = [dataclasses.replace(link, friction=mu, gap=gap) for link, mu, gap in numbers]
    return dataclasses.replace(system, links=tuple(links))


def speed(contact=None):
    """A table by number of storeys."""
    amplitudes = np.linspace(0.2, 0.8, BATCH)
    print(
        f"{'':10}{'compile: value':>16}{'gradient':>10}{'per rod and step':>24}{'of the pair':>13}"
        f"{'gradient by all μ and gaps':>28}"
    )
    pair = None
    systems = {"pair": dataclasses.replace(jp.paper.structures(), contact=contact).system()}
    systems |= {f"2 x {n}": storeys(n, contact=contact) for n in (2, 5, 10)}
    for name, structures in systems.items():
        structures = jax.tree.map(jnp.asarray, structures)
        grid = jp.TimeGrid(0.02, STEPS)

        def gap(structures, amplitude, grid=grid):
            ground = jp.Ricker(amplitude, [1.25, 2.0, 3.5], [2.0, 3.0, 5.0])
            return jp.demand(structures, ground, grid).min_gap

        def mean(frictions, gaps, structures=structures, gap=gap):
            changed = linked(structures, frictions, gaps)
            return jax.vmap(gap, (None, 0))(changed, amplitudes).mean()

        _, value = compiled(gap, structures, 0.5)
        many, _ = compiled(jax.vmap(gap, (None, 0)), structures, amplitudes)
        rods = len(structures.rods)
        whole = best(many, structures, amplitudes)
        each = whole / BATCH / STEPS / rods
        pair = pair or each
        chosen = (
            tuple(link.friction for link in structures.links),
            tuple(link.gap for link in structures.links),
        )
        slopes, slope = compiled(jax.value_and_grad(mean, (0, 1)), *chosen)
        values = best(slopes, *chosen) / whole
        print(
            f"{name:10}{value:14.1f} s{slope:8.1f} s{each * 1e9:21.1f} ns{each / pair:13.2f}"
            f"{values:21.1f} values",
            flush=True,
        )


def accuracy():
    """Errors against a run of shorter steps, 2 × 10 storeys."""
    system = jax.tree.map(jnp.asarray, storeys(10))
    leaves, structure = jax.tree.flatten(system)
    draw = np.random.default_rng(0)
    way = jax.tree.unflatten(structure, [x * draw.uniform(-0.3, 0.3) for x in leaves])
    ground = jp.Ricker(0.5, [1.25, 2.0, 3.5], [2.0, 3.0, 5.0])

    def seen(s, dt):
        found = jp.demand(s, ground, jp.TimeGrid.until(10.0, dt))
        return jnp.array(
            [*(link.min_gap for link in found.links), *(m.peak_x for m in found.masses)]
        )

    steps = (0.04, 0.02, 0.01, 0.0025)
    found = [jax.jvp(lambda s, h=h: seen(s, h), (system,), (way,)) for h in steps]
    for what, k in (("values", 0), ("derivatives along a direction of all parameters", 1)):
        *coarse, fine = (np.asarray(both[k]) for both in found)
        errors = [np.sqrt(np.mean((one - fine) ** 2)) for one in coarse]
        order = np.polyfit(np.log(steps[:-1]), np.log(errors), 1)[0]
        listed = ", ".join(f"{h}: {e:.1e}" for h, e in zip(steps, errors, strict=False))
        print(f"{what} (size {np.abs(fine).max():.2g}), rms errors: {listed}; order {order:.1f}")


def against_linear_theory():
    """Errors of all displacements of 2 × 10 storeys without friction, by step."""
    system, times = storeys(10, friction=0.0), np.arange(0, 10, 0.16)
    ground = jp.Ricker(0.5, [1.25, 2.0, 3.5], [2.5, 3.5, 6.0])
    fine, n_steps = 0.0025, 4000
    samples = np.asarray(ground.acceleration(fine * np.arange(n_steps + 1)))
    exact = linear.positions(system, samples, fine, round(0.16 / fine)).T
    errors = {}
    for h in (0.04, 0.02, 0.01):
        run = jp.simulate(system, ground, jp.TimeGrid.until(10.0, h))
        found = np.stack([mass.x for mass in run.masses])[:, :: round(0.16 / h)]
        errors[h] = np.abs(found[:, : times.size] - exact).max()
    order = np.polyfit(np.log([*errors]), np.log([*errors.values()]), 1)[0]
    listed = ", ".join(f"{h}: {e:.1e}" for h, e in errors.items())
    print(f"linear theory (size {np.abs(exact).max():.2g}), largest errors: {listed}; {order:.2f}")


def derivatives(dt=0.005):
    """Largest errors of derivatives of rows and storeys, as shares of the largest derivative."""
    for name in oracle.GROUPS:
        grid = jp.TimeGrid.until(20.0, dt=dt)
        ((found, known, _),) = oracle.derivatives_of_groups([oracle.CASES[name]], grid)
        errors = np.abs(found - known) / np.abs(known).max(0)
        print(f"{name:24} h = {dt}: worst {errors.max():.1e}, median {np.median(errors):.1e}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--accuracy", action="store_true")
    parser.add_argument("--contact", action="store_true")
    parser.add_argument("--derivatives", action="store_true")
    args = parser.parse_args()
    if args.derivatives:
        derivatives()
    elif args.accuracy:
        against_linear_theory()
        accuracy()
    else:
        speed(jp.KelvinVoigt(1000.0, 0.65) if args.contact else None)
