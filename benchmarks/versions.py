"""Times of two versions of jaxpound, in turn in one process.

    python benchmarks/versions.py export FOLDER     # in the checkout of each version
    python benchmarks/versions.py compare BEFORE NOW

``export`` writes the programs of this checkout: a batch of 480 pairs of 500 steps that differ in
friction or in all parameters, its gradients, all its scalars, and the runs with contact of
``contact_programs``. ``compare`` compiles and runs those of both folders in turn; of several
processor times the least counts. ``jax.export`` needs the package flatbuffers.
"""

import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import contact_programs
import jax
import jax.numpy as jnp
import numpy as np
from jax import export

import jaxpound as jp

jax.config.update("jax_enable_x64", True)

GRID, GROUND, CASE = jp.TimeGrid.until(20.0, 0.04), jp.paper.ground(), jp.paper.structures()
FRICTIONS, SHARES = jnp.linspace(0.05, 0.5, 480), jnp.linspace(0.95, 1.05, 480)
EACH = jax.tree.map(lambda x: x * SHARES, CASE)
WITH_CONTACT = ("pair", "pair, gradient", "batch", "batch, gradient", "towers 3 and 2")
WITH_CONTACT += ("towers 3 and 2, gradient", "towers 10 and 10")
ROUNDS, COMPILATIONS = 40, 3


def smallest_gap(structures):
    return jp.demand(structures, GROUND, GRID, only=["min_gap"]).min_gap


def by_friction(friction):
    return smallest_gap(replace(CASE, friction=friction))


def scalars(friction):
    return jax.tree.leaves(jp.demand(replace(CASE, friction=friction), GROUND, GRID))


def programs():
    yield "friction", jax.vmap(by_friction), FRICTIONS
    yield "friction, gradient", jax.vmap(jax.grad(by_friction)), FRICTIONS
    yield "all parameters", jax.vmap(smallest_gap), EACH
    yield "all parameters, gradient", jax.vmap(jax.grad(smallest_gap)), EACH
    yield "every scalar", jax.vmap(scalars), FRICTIONS
    for name in WITH_CONTACT:
        yield f"{name}, contact", *contact_programs.PROGRAMS[name]()


def write(folder):
    folder.mkdir(parents=True, exist_ok=True)
    for name, function, argument in programs():
        leaves, tree = jax.tree.flatten(argument)

        def flat(*numbers, function=function, tree=tree):
            return jax.tree.leaves(function(jax.tree.unflatten(tree, numbers)))

        program = export.export(jax.jit(flat))(*leaves)
        (folder / f"{name}.bin").write_bytes(program.serialize())
        np.savez(folder / f"{name}.npz", *map(np.asarray, leaves))


def least(rounds, actions):
    """Least processor time of each action, of rounds in turn, and the last results."""
    times, results = [[] for _ in actions], [None] * len(actions)
    for _ in range(rounds):
        for k, action in enumerate(actions):
            start = time.process_time()
            results[k] = jax.block_until_ready(action())
            times[k].append(time.process_time() - start)
    return [*map(min, times)], results


def compare(*folders):
    print(f"JAX {jax.__version__}: now over before; runs in ms, compilations in s")
    for path in sorted(folders[0].glob("*.bin")):
        lowered, arguments = [], []
        for folder in folders:
            numbers = np.load(folder / f"{path.stem}.npz")
            arguments.append([jnp.asarray(numbers[key]) for key in numbers.files])
            program = export.deserialize((folder / path.name).read_bytes())
            lowered.append(jax.jit(program.call).lower(*arguments[-1]))
        seconds, programs = least(COMPILATIONS, [x.compile for x in lowered])
        runs = [partial(x, *numbers) for x, numbers in zip(programs, arguments, strict=True)]
        times, results = least(ROUNDS, runs)
        apart = max(float(jnp.abs(x - y).max()) for x, y in zip(*results, strict=True))
        ms = f"{1e3 * times[0]:7.2f} {1e3 * times[1]:7.2f}: {times[1] / times[0]:.3f}"
        s = f"{seconds[0]:6.2f} {seconds[1]:6.2f}: {seconds[1] / seconds[0]:.3f}"
        print(f"{path.stem:28}{ms}; compiled{s}; apart {apart:.0e}", flush=True)


if __name__ == "__main__":
    command, *paths = sys.argv[1:]
    {"export": write, "compare": compare}[command](*map(Path, paths))
