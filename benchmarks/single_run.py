"""Time one run of the paper's case: modal against full history, and against the paper's algorithm.

    pip install -e ".[bench]" && python benchmarks/single_run.py

Every ratio is taken within this one process, best of several repetitions; times themselves say more
about the machine and its other users than about jaxpound.
"""

import subprocess
import sys
import time

import jax
import numba
import numpy as np
from jax.extend.core import jaxprs_in_params

import jaxpound as jp

jax.config.update("jax_enable_x64", True)

STRUCTURES, GROUND, GRID = jp.paper.structures(), jp.paper.ground(), jp.paper.grid()
FULL = jp.Scheme(history=jp.FullHistory())

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


@numba.njit
def paper_algorithm(order, tau_f, tau_x, stiffness, mass_ratio, friction, shaking, h):
    """Eqs. (10)–(12) as printed (with h^−β in the second line of eq. 10): the double loop."""
    n = shaking.size - 1
    weights = np.ones((2, n + 1))
    speed = np.empty(2)
    for i in range(2):
        speed[i] = h ** -order[i]
        for j in range(1, n + 1):
            weights[i, j] = (1 - (order[i] + 1) / j) * weights[i, j - 1]
    x, past = np.zeros((2, n + 2)), np.zeros((2, n + 1))
    f = np.zeros(2)
    phase, least = 0.0, 0.0
    for m in range(1, n + 1):
        for i in range(2):
            memory = 0.0
            for j in range(1, m + 1):
                memory += weights[i, j] * past[i, m - j]
            elastic = stiffness[i] * x[i, m] * (1 + tau_x[i] * speed[i])
            f[i] = (elastic + speed[i] * memory) / (1 + tau_f[i] * speed[i])
            past[i, m] = stiffness[i] * tau_x[i] * x[i, m] - tau_f[i] * f[i]
        hold = (-f[0] + mass_ratio * f[1]) / (1 + mass_ratio)
        slip = (x[0, m] - x[0, m - 1]) - (x[1, m] - x[1, m - 1])
        if phase == 0:
            if abs(hold) > friction:
                phase = np.sign(hold)
        elif slip * phase <= 0:
            phase = 0.0 if abs(hold) <= friction else -phase
        q = hold if phase == 0 else friction * phase
        x[0, m + 1] = 2 * x[0, m] - x[0, m - 1] + h**2 * (-f[0] - q - shaking[m])
        if phase == 0:
            x[1, m + 1] = x[0, m + 1] - (x[0, m] - x[1, m])
        else:
            push = mass_ratio * (q - f[1]) - shaking[m]
            x[1, m + 1] = 2 * x[1, m] - x[1, m - 1] + h**2 * push
        least = min(least, x[1, m] - x[0, m])
    return least


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
