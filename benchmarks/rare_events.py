"""Rare events: runs, time, and the coefficient of variation as stated and as measured by repeats.

python benchmarks/rare_events.py [REPEATS]

The case is that of ``tests/reliability``: the paper's structures in filtered white noise of 500
numbers, whose probabilities are known from independent runs.
"""

import dataclasses
import functools
import sys
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)
sys.path.insert(0, str(Path(__file__).parents[1]))

import jaxpound as jp  # noqa: E402
from tests.reliability import case_w  # noqa: E402

TARGET, AT, WITHIN = 1e-7, 0.3075, 0.003


def timed(call):
    start = time.perf_counter()
    found = call()
    return found, time.perf_counter() - start


def cost_of_a_gradient(state, n=256):
    """Time of a run, and of a closing at an instant with its gradient by 500 numbers."""
    z = np.random.default_rng(0).standard_normal((n, case_w.N))
    instants = np.linspace(1, case_w.GRID.n_steps, n).astype(int)
    series = np.zeros(n, int)
    whole = jp.runtime.in_chunks(jax.value_and_grad(state.value), 64)
    calls = {
        "run": lambda: state.values(z),
        "closing at an instant, with gradient": lambda: state.gradients(z, instants, series),
        "required gap, with gradient": lambda: whole(jnp.asarray(z)),
    }
    print(f"{'':40}{'μs a run':>10}{'runs':>8}")
    first = None
    for name, call in calls.items():
        call()
        best = min(timed(call)[1] for _ in range(5)) / n
        first = first or best
        print(f"{name:40}{best * 1e6:10.0f}{best / first:8.1f}")


def repeated(state, repeats):
    """Each gap from random starts, by keys 0 to ``repeats`` − 1."""
    words = ("gap", "P", "reference", "mean/ref", "stated", "measured", "FORM", "runs", "gradients")
    print("\n" + "".join(f"{x:>11}" for x in (*words, "run equiv.", "seconds")))
    for gap, (reference, _) in case_w.REFERENCE.items():
        one = dataclasses.replace(state, threshold=gap)
        found, seconds = [], []
        for key in range(repeats):
            search = functools.partial(jp.rare_event, one, key=key, progress=False)
            event, took = timed(search)
            found.append(event)
            seconds.append(took)
        p = np.array([event.probability for event in found])
        runs = np.mean([event.runs for event in found])
        gradients = np.mean([event.gradients for event in found])
        numbers = (gap, p.mean(), reference, p.mean() / reference)
        numbers += (np.mean([event.cov for event in found]), p.std(ddof=1) / p.mean())
        numbers += (np.mean([event.form for event in found]), runs, gradients)
        numbers += (runs + 4 * gradients, np.mean(seconds))
        print("".join(f"{x:11.3g}" if x < 1000 else f"{x:11.0f}" for x in numbers))


def curve(state):
    """All gaps, each from the design points of the one before."""
    event, start = None, time.perf_counter()
    runs = gradients = 0
    for gap in np.linspace(0.25, 0.8, 12):
        one = dataclasses.replace(state, threshold=float(gap))
        search = jp.reliability.EventSearch(start=event)
        event = jp.rare_event(one, search=search, progress=False)
        runs, gradients = runs + event.runs, gradients + event.gradients
    took = time.perf_counter() - start
    print(f"\nA curve of 12 gaps: {runs:,} runs, {gradients:,} gradients, {took:.1f} s")


def main():
    repeats = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    state = case_w.NOMINAL
    cost_of_a_gradient(state)
    repeated(state, repeats)
    curve(state)
    event = jp.rare_event(state, cov=0.03, progress=False)
    print(f"\nd ln P/dμ at 0.645: {event.slope('friction')}, reference {case_w.SLOPE} (3 %)")
    found, seconds = timed(
        lambda: jp.reliability.reach_probability(
            "friction", TARGET, case_w.SCENARIOS, case_w.GRID, 0.645, progress=False
        )
    )
    print(f"\n{found}\nreference {AT} within {WITHIN}; {seconds:.0f} s with compilation")


if __name__ == "__main__":
    main()
