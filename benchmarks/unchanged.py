"""Whether the numbers are those of another version: record them there, compare them here.

    python benchmarks/unchanged.py record numbers.json     # in a checkout of the other version
    python benchmarks/unchanged.py compare numbers.json    # in this one

Systems, ground motions, schemes and widths are drawn from a fixed seed; of each run the scalars,
series at some instants, the gradient by every parameter and the phases are kept to the last bit,
and of a study its table. Compared are the relative differences, by kind of number.
"""

import argparse
import json
from collections import defaultdict
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)

import jaxpound as jp  # noqa: E402

SERIES = ("x1", "x2", "v1", "v2", "f1", "f2", "friction", "gap")
GOALS = ("min_gap", "min_gap_time", "peak_f1", "peak_acceleration_2", "slip_distance")


def pairs(n, seed=0):
    """Random systems and Ricker wavelets."""
    draw = np.random.default_rng(seed)
    for _ in range(n):
        rods = []
        for _ in range(2):
            tau_f = 10 ** draw.uniform(-3, 0)
            tau_x = tau_f * 10 ** draw.uniform(0, 2)
            rods.append(jp.ZenerRod(draw.uniform(0.1, 1.0), tau_f, tau_x))
        structures = jp.AdjacentStructures(
            *rods,
            mass_ratio=10 ** draw.uniform(-0.5, 0.5),
            stiffness_ratio=10 ** draw.uniform(-0.5, 0.5),
            friction=draw.choice([0.0, 0.1, 0.3, 1.0]),
            initial_gap=1.0,
        )
        periods = draw.uniform(1, 5, 3)
        yield structures, jp.Ricker(draw.uniform(0.1, 0.6), periods, draw.uniform(1, 6, 3))


def record(seed=1):
    """A record of random samples, on no grid of the runs."""
    samples = np.random.default_rng(seed).normal(size=120)
    return jp.Record(samples * np.hanning(120), dt=0.13, time_unit="1/ω1")


def numbers():
    """All that is compared, by name."""
    grid = jp.TimeGrid(dt=0.04, n_steps=400)
    known = {}

    def add(kind, name, value):
        known[f"{kind}/{name}"] = np.ravel(np.asarray(value, float)).tolist()

    def goals(structures, ground, scheme):
        found = jp.demand(structures, ground, grid, scheme, temperature=0.1)
        return jnp.stack([getattr(found, name) for name in (*GOALS, "soft_min_gap")])

    value = jax.jit(goals, static_argnums=2)
    slope = jax.jit(jax.jacrev(goals, argnums=(0, 1)), static_argnums=2)

    schemes = {
        "default": jp.Scheme(),
        "smoothed": jp.Scheme(jp.Smoothed(0.05)),
        "paper": replace(jp.PAPER_SCHEME, history=jp.ModalHistory()),
        "full": jp.Scheme(history=jp.simulation.FullHistory()),
    }
    for label, scheme in schemes.items():
        for i, (structures, ground) in enumerate(pairs(24 if label == "default" else 4)):
            for shaking, motion in (("ricker", ground), ("record", 0.3 * record() + ground)):
                place = f"{label}-{shaking}-{i}"
                response = jp.simulate(structures, motion, grid, scheme)
                for name, scalar in response.demand.scalars().items():
                    add(f"scalars of {shaking}", f"{place}-{name}", scalar)
                for name in SERIES:
                    series = np.asarray(getattr(response, name))
                    add(f"series of {shaking}", f"{place}-{name}", series[::40])
                add("phases", place, [len(response.phases())])
                add("values", place, value(structures, motion, scheme))
                if i < 8:
                    leaves = jax.tree.leaves(slope(structures, motion, scheme))
                    add(f"gradients of {shaking}", place, np.hstack([np.ravel(x) for x in leaves]))
    for i, pair in enumerate(pairs(6, seed=2)):
        structures, ground = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), pair)
        add("float32", str(i), jp.simulate(structures, ground, grid).demand.min_gap)

    scenarios = jp.Scenarios(
        jp.paper.structures(),
        jp.RandomRicker(3, jp.LogNormal(0.3, 0.4), jp.Uniform(1.0, 4.0), jp.Uniform(1.0, 5.0)),
    )
    study = jp.monte_carlo(scenarios, 96, grid, progress=False)
    for name, column in study.to_columns().items():
        if np.asarray(column).dtype.kind == "f":
            add("study", name, column)
    return known


def main():
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("what", choices=["record", "compare"])
    parser.add_argument("file")
    args = parser.parse_args()
    known = numbers()
    if args.what == "record":
        with open(args.file, "w", encoding="utf-8") as file:
            json.dump(known, file)
        return
    with open(args.file, encoding="utf-8") as file:
        before = json.load(file)
    print(
        f"names only there: {len(before.keys() - known.keys())}, only here: "
        f"{len(known.keys() - before.keys())}"
    )
    groups = defaultdict(list)
    for name in before.keys() & known.keys():
        a, b = np.array(before[name]), np.array(known[name])
        size = np.abs(a).max(initial=1e-300)
        groups[name.partition("/")[0]].append((np.abs(a - b).max(initial=0) / size, name))
    print(f"{'kind':24}{'compared':>10}{'same bits':>11}{'largest relative difference':>30}")
    for kind, found in sorted(groups.items()):
        worst, name = max(found)
        same = sum(difference == 0 for difference, _ in found)
        print(f"{kind:24}{len(found):10}{same:11}{worst:30.1e}  {name}")


if __name__ == "__main__":
    main()
