"""Errors of the paper's case by step and scheme, against the independent event-driven reference.

python benchmarks/accuracy.py

Then what one run of the smallest gap takes to be right to 1e-6, plain and extrapolated, of the case
and of the same with rods of order 1, which have no memory.
"""

import time
from dataclasses import replace

import jax
import numpy as np

import jaxpound as jp

SMALLEST, _, CHANGES, _ = jp.paper.reference()
jax.config.update("jax_enable_x64", True)

SCHEMES = {
    "default": jp.Scheme(),
    "order 1, event-resolved": jp.Scheme(order=1),
    "order 2, switching": jp.Scheme(jp.simulation.Switching()),
    "the paper's": jp.PAPER_SCHEME,
}


def errors(scheme, h):
    structures = jp.paper.structures()
    run = jp.simulate(structures, jp.paper.ground(), jp.TimeGrid.until(20.0, h), scheme)
    min_error = float(run.min_gap) - structures.initial_gap - SMALLEST
    changes = run.phases()[1:]
    if [p.kind for p in changes] == [kind for _, kind in CHANGES]:
        late = [p.start - time for p, (time, _) in zip(changes, CHANGES, strict=True)]
        worst_change = f"{np.abs(late).max():10.1e}"
    else:
        worst_change = f"{len(changes):>6} not {len(CHANGES)}"
    return min_error, worst_change, float(run.energy.relative_residual)


def timed():
    """A table of errors of the smallest gap and processor times of one run."""
    ground, case = jp.paper.ground(), jp.paper.structures()
    plain, extrapolated = jp.Scheme(), jp.Scheme(extrapolated=True)
    rods = {f"rod_{i}": replace(getattr(case, f"rod_{i}"), order=1.0) for i in (1, 2)}
    for words, structures in {"the case": case, "rods of order 1": replace(case, **rods)}.items():

        def compiled(h, scheme, structures=structures):
            grid = jp.TimeGrid.until(20.0, h)
            return jax.jit(lambda s: jp.demand(s, ground, grid, scheme).min_gap).lower(structures)

        exact = float(compiled(0.0005, extrapolated).compile()(structures))
        print(f"\n{words}: error of the smallest gap and processor time of a run")
        for h in (0.04, 0.02, 0.01, 0.005, 0.0025, 0.00125):
            row = f"{h:9}"
            for scheme in (plain, extrapolated):
                run = compiled(h, scheme).compile()
                error = float(run(structures)) - exact
                row += f"{error:11.1e}{1e3 * shortest(run, structures):8.2f} ms"
            print(row)


def shortest(run, *args):
    """The shortest processor time of a call, of seven rounds of ten."""
    times = []
    for _ in range(7):
        start = time.process_time()
        for _ in range(10):
            jax.block_until_ready(run(*args))
        times.append((time.process_time() - start) / 10)
    return min(times)


def main():
    print("The paper's case: errors of min(x2 - x1), of the latest of 11 phase changes, and of")
    print("the energy balance relative to the input")
    print(f"{'scheme':25}{'h':>7}{'steps':>7}{'minimum':>10}{'change':>10}{'energy':>10}")
    for name, scheme in SCHEMES.items():
        for h in (0.04, 0.02, 0.01, 0.005, 0.002):
            min_error, worst_change, residual = errors(scheme, h)
            numbers = f"{min_error:10.1e}{worst_change:>10}{residual:10.1e}"
            print(f"{name:25}{h:7}{round(20 / h):7}{numbers}")
    timed()


if __name__ == "__main__":
    main()
