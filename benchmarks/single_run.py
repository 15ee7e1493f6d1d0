"""Time one run of the paper's case: modal against full history, and against the paper's algorithm.

    pip install -e ".[bench]" && python benchmarks/single_run.py

Every ratio is taken within this one process, best of several repetitions; times themselves say more
about the machine and its other users than about jaxpound.
"""

import subprocess
import sys
import time

import jax
import numpy as np
from jax.extend.core import jaxprs_in_params
from peers import paper_algorithm

import jaxpound as jp

jax.config.update("jax_enable_x64", True)

STRUCTURES, GROUND, GRID = jp.paper.structures(), jp.paper.ground(), jp.paper.grid()
FULL = jp.Scheme(history=jp.simulation.FullHistory())

FIRST_CALL = """
import jax
jax.config.update("jax_enable_x64", True)
import jaxpound as jp, time
jax.numpy.zeros(1).block_until_ready()  # JAX's own start
start = time.perf_counter()
run = jp.{call}(jp.paper.structures(), jp.paper.ground(), jp.paper.grid())
jax.block_until_ready(run.min_gap)
print(time.perf_counter() - start)
"""


def paper_run():
    rods, ratio = (STRUCTURES.rod_1, STRUCTURES.rod_2), STRUCTURES.stiffness_ratio
    return paper_algorithm(
        *(np.array([getattr(rod, name) for rod in rods]) for name in ("order", "tau_f", "tau_x")),
        np.array([1.0, ratio]),
        STRUCTURES.mass_ratio,
        STRUCTURES.friction,
        SHAKING,
        GRID.dt,
    )


def best(call, repetitions=15):
    call()
    times = []
    for _ in range(repetitions):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times)


def first_call(call):
    """In a process of its own: trace, compile and run; nothing is cached from an earlier one."""
    output = subprocess.run(
        [sys.executable, "-c", FIRST_CALL.format(call=call)], capture_output=True, check=True
    )
    return float(output.stdout)


def scan_state(n_steps, scheme):
    """Numbers carried from step to step, read off the compiled program's own loop."""
    grid = jp.TimeGrid(GRID.dt, n_steps)
    jaxpr = jax.make_jaxpr(lambda s: jp.demand(s, GROUND, grid, scheme))(STRUCTURES)
    scans = list(find_scans(jaxpr.jaxpr))
    return max(sum(v.aval.size for v in scan.outvars[: scan.params["num_carry"]]) for scan in scans)


def find_scans(jaxpr):
    for equation in jaxpr.eqns:
        if equation.primitive.name == "scan":
            yield equation
        for inner in jaxprs_in_params(equation.params):
            yield from find_scans(inner)


SHAKING = np.asarray(GROUND.acceleration(GRID.times()))


def main():
    runs = {
        "demand, modal history": lambda: jp.demand(STRUCTURES, GROUND, GRID).min_gap.item(),
        "simulate, modal history": lambda: jp.simulate(STRUCTURES, GROUND, GRID).min_gap.item(),
        "demand, full history": lambda: jp.demand(STRUCTURES, GROUND, GRID, FULL).min_gap.item(),
        "simulate, full history": lambda: jp.simulate(
            STRUCTURES, GROUND, GRID, FULL
        ).min_gap.item(),
        "the paper's algorithm, Numba": paper_run,
    }
    times = {name: best(call, 5 if "full" in name else 15) for name, call in runs.items()}
    print(f"One run of {GRID.n_steps + 1} instants, float64, JAX {jax.__version__}, warm")
    for name, seconds in times.items():
        print(f"  {name:30} {1e3 * seconds:8.1f} ms")
    print("Ratios")
    for call in ("demand", "simulate"):
        modal = times[f"{call}, modal history"]
        print(f"  {call}: full / modal history    {times[f'{call}, full history'] / modal:6.1f}")
        ratio = times["the paper's algorithm, Numba"] / modal
        print(f"  {call}: paper's, Numba / modal  {ratio:6.1f}")
    print("First call in a new process (trace, compile, run), after JAX's own start")
    for call in ("demand", "simulate"):
        print(f"  {call:10} {min(first_call(call) for _ in range(3)):5.2f} s")
    print("Numbers carried by the scan")
    for name, scheme in (
        ("24 modes", jp.Scheme(history=jp.ModalHistory(modes=24))),
        ("full", FULL),
    ):
        sizes = ", ".join(f"{scan_state(n, scheme)} for N = {n:,}" for n in (1000, 10_000))
        print(f"  {name:10} {sizes}")


if __name__ == "__main__":
    main()
