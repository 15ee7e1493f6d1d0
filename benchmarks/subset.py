"""Subset simulation: measured coefficients of variation against stated ones, and runs for 10 %.

    python benchmarks/subset.py [plane] [trains] [noise]

``plane`` has a closed form, ``trains`` are five Ricker wavelets with random signs (20 numbers, five
of them discrete), ``noise`` is filtered white noise of 500 numbers. The measured coefficient is the
spread of single repeats, all of them independent; the stated one is what studies of 20 say.
"""

import dataclasses
import sys
import time

import jax
import numpy as np
from scipy.special import ndtri

import jaxpound as jp
from jaxpound.reliability.subset import SubsetSearch, simulated

GRID = jp.TimeGrid.until(20.0, 0.04)
SIZE = 20  # repeats of a study


def noise():
    """White noise through the filter of Kanai and Tajimi, of unit variance, under an envelope."""
    t = 0.04 * np.arange(500)
    frequency, damping = 2.0, 0.6
    damped = frequency * np.sqrt(1 - damping**2)
    h = np.exp(-damping * frequency * t) * (
        2 * damping * frequency * np.cos(damped * t)
        + (frequency**2 - 2 * (damping * frequency) ** 2) / damped * np.sin(damped * t)
    )
    lags = np.subtract.outer(np.arange(500), np.arange(500))
    rows = np.where(lags >= 0, h[np.maximum(lags, 0)], 0.0)
    envelope = (t / 5 * np.exp(1 - t / 5)) ** 2
    matrix = 0.3 * envelope[:, None] * rows / np.linalg.norm(rows, axis=1, keepdims=True)
    return jp.CustomDraw(lambda z: jp.Record(matrix @ z, dt=0.04, time_unit="1/ω1"), 500)


def trains():
    return jp.RandomRicker(5, jp.LogNormal(0.1, 0.5), jp.Uniform(1, 3.8), jp.Uniform(1, 7))


def row(name, exact, events, seconds):
    """Of several studies: their mean against the reference, measured and stated coefficients."""
    p = np.array([event.probability for event in events])
    stated = np.mean([event.cov for event in events])
    inside = np.mean([e.estimate.low <= exact <= e.estimate.high for e in events])
    runs = np.mean([event.runs for event in events])
    measured = p.std(ddof=1) / exact
    error = measured / np.sqrt(len(p))
    print(
        f"| {name} | {exact:.3g} | {p.mean() / exact:.3f} ± {error:.3f} | {measured:.3f} "
        f"| {stated:.3f} | {inside:.0%} of {len(p)} | {runs:,.0f} "
        f"| {runs * (stated / 0.1) ** 2:,.0f} | {seconds / len(p):.2g} s |",
        flush=True,
    )


def study(name, exact, state, studies):
    def search(key, **options):
        return simulated(state, None, SubsetSearch(**options), key, store=None, progress=False)

    search(0, n=100, repeats=2)  # compiles
    start = time.perf_counter()
    events = [search(key, repeats=SIZE) for key in range(studies)]
    row(name, exact, events, time.perf_counter() - start)


class Plane:
    """A linear limit state of a hundred numbers."""

    dimension, level = 100, 0.0

    def __init__(self, exact):
        self.beta = -ndtri(exact)

    def values(self, z):
        """At least 0 where the event occurs."""
        return z.sum(axis=1) / 10 - self.beta


def main():
    jax.config.update("jax_enable_x64", True)
    jp.runtime.use_cores()
    chosen = sys.argv[1:] or ["plane", "trains", "noise"]
    print("| case | P | mean / P | c.o.v. measured | stated | intervals | runs | to 10 % | time |")
    print("|---|---|---|---|---|---|---|---|---|")
    if "plane" in chosen:
        for exact in (1e-2, 1e-4, 1e-6, 1e-8):
            study("plane", exact, Plane(exact), 40)
    references = {
        "trains": (trains, {0.8175: 1.000e-2, 1.1397: 1.00e-3, 1.5212: 8.11e-5}),
        "noise": (noise, {0.27: 1.023e-2, 0.47: 1.047e-4, 0.645: 7.97e-7}),
    }
    for name, (draw, known) in references.items():
        if name in chosen:
            scenarios = jp.Scenarios(jp.paper.structures(), draw())
            state = jp.LimitState(scenarios, GRID, threshold=1.0)
            for gap, exact in known.items():
                studies = 8 if name == "trains" else 4
                study(name, exact, dataclasses.replace(state, threshold=gap), studies)


if __name__ == "__main__":
    main()
