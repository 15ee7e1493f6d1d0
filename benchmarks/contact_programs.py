"""Length of the programs with contact, seconds to compile them, and to run them.

    python benchmarks/contact_programs.py [--loop-kernels] [PROGRAM ...]     # by default all

A pair of buildings, and two towers that touch at their floors, with the law of Kelvin and Voigt,
500 steps, in processor time. Run it in turn in the checkouts of two versions to compare them.
"""

import resource
import sys
from dataclasses import replace

import jax
import jax.numpy as jnp

import jaxpound as jp

jax.config.update("jax_enable_x64", True)

GRID, GROUND = jp.TimeGrid(0.02, 500), jp.Ricker(0.5, (3.0, 2.0), (4.0, 6.0))
LAW = jp.KelvinVoigt(400.0, 0.65)
RUNS, REPEATS = 64, 10


def pair():
    rods = jp.ZenerRod(0.5, 0.05, 0.2), jp.ZenerRod(0.5, 0.05, 0.3)
    return jax.tree.map(jnp.asarray, jp.AdjacentStructures(*rods, 0.8, 1.7, 0.1, 0.2, LAW))


def towers(*storeys):
    """Two towers with contact at all floors of the lower one."""
    material = jp.ZenerRod(0.5, 0.05, 0.1)
    buildings = tuple(
        jp.Storeys((1.0,) * n, (jp.Rod(material, stiffness),) * n)
        for n, stiffness in zip(storeys, (3.0, 5.0), strict=True)
    )
    links = (jp.FloorLink(0, i, friction=0.05, gap=0.2, contact=LAW) for i in range(min(storeys)))
    return jax.tree.map(jnp.asarray, jp.Row(buildings, tuple(links)))


def batch(structures):
    """Gaps that differ by 1 %: all runs touch."""
    changed = replace(structures, initial_gap=structures.initial_gap * 1.01)
    shares = jnp.linspace(0.0, 1.0, RUNS)
    return jax.vmap(lambda s: jax.tree.map(lambda x, y: x + s * (y - x), structures, changed))(
        shares
    )


def smallest_gap(structures):
    return jp.demand(structures, GROUND, GRID).min_gap


GRADIENT = jax.value_and_grad(smallest_gap)
PROGRAMS = {
    "pair": lambda: (smallest_gap, pair()),
    "pair without contact": lambda: (smallest_gap, replace(pair(), contact=None)),
    "pair, gradient": lambda: (GRADIENT, pair()),
    "batch": lambda: (jax.vmap(smallest_gap), batch(pair())),
    "batch, gradient": lambda: (jax.vmap(GRADIENT), batch(pair())),
    "towers 3 and 2": lambda: (smallest_gap, towers(3, 2)),
    "towers 3 and 2, gradient": lambda: (GRADIENT, towers(3, 2)),
    "towers 10 and 10": lambda: (smallest_gap, towers(10, 10)),
    "towers 10 and 10, gradient": lambda: (GRADIENT, towers(10, 10)),
}


def seconds():
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def main(names):
    if "--loop-kernels" in names:
        jp.runtime.use_loop_kernels()
        names.remove("--loop-kernels")
    print(f"{'':28}{'operations':>10}{'traced, s':>11}{'compiled, s':>13}{'run, ms':>9}")
    for name in names or PROGRAMS:
        function, structures = PROGRAMS[name]()
        start = seconds()
        lowered = jax.jit(function).lower(structures)
        traced = seconds()
        program = lowered.compile()
        compiled = seconds()
        jax.block_until_ready(program(structures))
        before = seconds()
        for _ in range(REPEATS):
            jax.block_until_ready(program(structures))
        run = (seconds() - before) / REPEATS
        operations = sum(" = " in line for line in lowered.as_text().splitlines())
        times = f"{traced - start:11.1f}{compiled - traced:13.1f}{1e3 * run:9.2f}"
        print(f"{name:28}{operations:10}{times}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
