"""Derivatives of the smallest gap by friction law and step, against the event-driven reference.

python benchmarks/gradients.py
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

import jaxpound as jp

jax.config.update("jax_enable_x64", True)

STEPS = (0.04, 0.02, 0.01, 0.005, 0.002)
WIDTHS = (0.1, 0.03, 0.01, 0.003, 0.001, 0.0003)
FACTORS = (4, 2, 1, 1 / 2, 1 / 4, 1 / 8)
LAWS = {
    "event-resolved": jp.Scheme(),
    "switching, order 2": jp.Scheme(jp.simulation.Switching()),
    "the paper's": replace(jp.PAPER_SCHEME, checkpoint=True),
}
NAMES = ("mu", "tau_x1", "tau_f1", "tau_x2", "tau_f2", "alpha", "beta", "epsilon", "rho")
REFERENCE = jp.paper.reference()

S = jp.paper.structures()
PAPER = S, jp.paper.ground()
OTHER = (  # other buildings and wavelets, twice the friction, twice the accelerations
    replace(S, friction=0.5, stiffness_ratio=3.0, mass_ratio=0.7, initial_gap=3.0),
    jp.Ricker(amplitude=0.8, periods=[1.5, 3, 2.2, 4, 2.8], arrivals=[1.2, 2.6, 4.4, 5.5, 7]),
)
PAPER, OTHER = jax.tree.map(lambda x: jnp.asarray(x, float), (PAPER, OTHER))


@partial(jax.jit, static_argnames=("scheme", "h"))
def gradient(case, scheme, h, size=1.0):
    """Nine derivatives of the smallest gap, it, and its time; all lengths of the run × size."""
    structures, ground = case

    def min_gap(s):
        s = replace(s, friction=size * s.friction, initial_gap=size * s.initial_gap)
        run = jp.demand(s, size * ground, jp.TimeGrid.until(20.0, h), scheme)
        return run.min_gap / size, run.min_gap_time

    (gap, time), d = jax.value_and_grad(min_gap, has_aux=True)(structures)
    one, two = d.rod_1, d.rod_2
    slopes = [d.friction, one.tau_x, one.tau_f, two.tau_x, two.tau_f, one.order, two.order]
    return jnp.stack([*slopes, d.stiffness_ratio, d.mass_ratio]), gap, time


@partial(jax.jit, static_argnames="h")
def by_width(case, h, widths):
    """Smoothed; ten times the size and the width is the same run, so that one program does all."""
    smoothed = jp.Scheme(jp.Smoothed(0.01))
    return jax.vmap(lambda width: gradient(case, smoothed, h, 0.01 / width))(widths)


def fastest_change(case, h):
    """The largest change of the slip velocity within a step of h."""
    run = jp.simulate(*case, jp.TimeGrid.until(20.0, 0.01))
    return np.abs(np.diff(run.v1 - run.v2)).max() * h / 0.01


def row(name, cells, form=">9"):
    print((f"{name:22}" + "".join(f"{x:{form}}" for x in cells)).rstrip())


def errors(name, runs, exact):
    """Largest error of each run; * where the gap is smallest at another of its minima."""
    marks = ["*" if abs(time - exact[2]) > 1 else " " for _, _, time in runs]
    worst = [np.abs(slopes - exact[0]).max() for slopes, _, _ in runs]
    row(name, [f"{x:8.1e}{mark}" for x, mark in zip(worst, marks, strict=True)])


def main():
    smallest = float(S.initial_gap) + REFERENCE.min_gap_change
    slopes = np.array(list(REFERENCE.gradient.values()))  # in the order of NAMES
    exact = {"paper": (slopes, smallest, REFERENCE.min_gap_time)}

    widths = jnp.array(WIDTHS)
    with ThreadPoolExecutor(2) as pool:  # most of the time is compilation
        runs = {k: pool.map(partial(gradient, PAPER, law), STEPS) for k, law in LAWS.items()}
        smoothed = list(pool.map(lambda h: zip(*by_width(PAPER, h, widths), strict=True), STEPS))
    results = {name: list(run) for name, run in runs.items()}
    for width, *runs in zip(WIDTHS, *smoothed, strict=True):
        results[f"smoothed, v_s = {width:g}"] = runs

    print("The paper's case: largest error of nine derivatives of min gap")
    row("h", STEPS)
    for name, runs in results.items():
        errors(name, runs, exact["paper"])
    print("* another minimum, about as deep, is the smallest there")
    print("\nError of min gap itself")
    row("h", STEPS)
    for name, runs in results.items():
        row(name, [gap - smallest for _, gap, _ in runs], "9.1e")
    print(f"\nThe derivatives, not their errors, at h = {STEPS[2]}")
    row("", NAMES)
    row("reference", exact["paper"][0], "9.4f")
    for name, runs in results.items():
        row(name, runs[2][0], "9.4f")

    print("\nHow wide? Errors by v_s / w, with w half the slip velocity's largest change in a step")
    row("", FACTORS)
    exact["other"] = gradient(OTHER, jp.Scheme(), STEPS[-1])
    for name, case in (("paper", PAPER), ("other", OTHER)):
        for h in STEPS:
            w = fastest_change(case, h) / 2
            runs = zip(*by_width(case, h, w * jnp.array(FACTORS)), strict=True)
            errors(f"{name} h={h:g} w={w:.2g}", list(runs), exact[name])


if __name__ == "__main__":
    main()
