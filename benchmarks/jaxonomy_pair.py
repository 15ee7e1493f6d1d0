"""Errors and times beside jaxonomy, which integrates from event to event with adaptive steps.

    python -m venv other && other/bin/pip install jaxonomy
    python benchmarks/jaxonomy_pair.py other/bin/python

The pair of the verification suite on rods of order 1, which have no memory, under the paper's
wavelets, 20 time units. jaxonomy (Dormand and Prince's order 5, events by bisection) asks for an
older JAX than jaxpound does, and so runs in a process of its own. Processor times on one core,
compiled; those of jaxpound also with ``jp.runtime.use_loop_kernels()``. A batch is one of 256 slip
forces by ``jax.vmap`` in both programs.
"""

import json
import subprocess
import sys
import time

import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)

END, RUNS, ROUNDS = 20.0, 256, 7
FRICTIONS = (0.1, 0.4)  # of the batch


def best(call, each=1):
    """The shortest of several processor times of a call, over the number of its runs."""
    jax.block_until_ready(call())
    times = []
    for _ in range(ROUNDS):
        start = time.process_time()
        for _ in range(5):
            jax.block_until_ready(call())
        times.append((time.process_time() - start) / 5)
    return min(times) / each


def rows(settings, closing):
    """Of each setting: the largest x1 − x2, and times of one run and of a run of a batch.

    ``closing(setting)`` is a function of the slip force.
    """
    table = []
    friction, frictions = PROBLEM["friction"], np.linspace(*FRICTIONS, RUNS)
    for setting in settings:
        run = closing(setting)
        single, many = jax.jit(run), jax.jit(jax.vmap(run))
        seconds = (
            best(lambda program=single: program(friction)),
            best(lambda program=many: program(frictions), RUNS),
        )
        table.append([setting, float(single(friction)), *seconds])
    return table


def hybrid():
    """The pair as a system of jaxonomy; its discrete state is the direction of slip, 0 in stick."""
    from jaxonomy.framework import LeafSystem

    periods, arrivals = (jnp.array(PROBLEM[name]) for name in ("periods", "arrivals"))
    (tau_f1, tau_x1), (tau_f2, tau_x2) = PROBLEM["rods"]
    rho, k = PROBLEM["mass_ratio"], PROBLEM["stiffness_ratio"]

    def shaking(t):
        a = jnp.pi / periods
        v = (a * (t - arrivals)) ** 2
        waves = 2 * a**2 * PROBLEM["amplitude"] * jnp.exp(-v)
        return jnp.sum(waves * (4 * v**2 - 12 * v + 3))

    def pull(y):
        return -y[4] + rho * y[5]

    class Pair(LeafSystem):
        def __init__(self):
            super().__init__(name="pair")
            self.declare_dynamic_parameter("friction", PROBLEM["friction"])
            self.declare_discrete_state(shape=(), default_value=0.0)
            self.declare_continuous_state(default_value=jnp.zeros(7), ode=self.motion)
            falls = {"direction": "positive_then_non_positive"}
            self.declare_zero_crossing(self.slip, self.stopped, name="stop", **falls)
            self.declare_zero_crossing(self.rest, self.breaks, name="breakaway", **falls)

        def motion(self, t, state, friction):
            x1, x2, v1, v2, f1, f2, _ = y = state.continuous_state
            way, u = state.discrete_state, shaking(t)
            q = jnp.where(way == 0, pull(y) / (1 + rho), way * friction)
            rates = (x1 + tau_x1 * v1 - f1) / tau_f1, (k * (x2 + tau_x2 * v2) - f2) / tau_f2
            return jnp.array([v1, v2, -f1 - q - u, rho * (q - f2) - u, *rates, 0.0])

        def slip(self, t, state, friction):
            y, way = state.continuous_state, state.discrete_state
            return jnp.where(way == 0, 1.0, way * (y[2] - y[3]))

        def stopped(self, t, state, friction):
            y = state.continuous_state
            holds = jnp.abs(pull(y)) <= (1 + rho) * friction
            y = y.at[3].set(y[2]).at[6].max(y[0] - y[1])  # the largest x1 − x2 is at a stop
            way = jnp.where(holds, 0.0, jnp.sign(pull(y)))
            return state.with_continuous_state(y).with_discrete_state(way)

        def rest(self, t, state, friction):
            y, way = state.continuous_state, state.discrete_state
            return jnp.where(way == 0, (1 + rho) * friction - jnp.abs(pull(y)), 1.0)

        def breaks(self, t, state, friction):
            return state.with_discrete_state(jnp.sign(pull(state.continuous_state)))

    return Pair()


def peer():
    """Print what jaxonomy finds, as JSON."""
    from jaxonomy.simulation import SimulatorOptions, simulate

    system = hybrid()
    start = system.create_context()

    def closing(tolerance):
        options = SimulatorOptions(
            rtol=tolerance,
            atol=tolerance / 100,
            max_major_steps=500,
            save_time_series=False,
            ode_solver_method="dopri5",
            math_backend="jax",
        )

        def run(friction):
            begin = start.with_parameter("friction", friction)
            ends = simulate(system, begin, (0.0, END), options=options, postprocess=False)
            return ends.context.continuous_state[6]

        return run

    print(json.dumps({"jaxonomy, tolerance": rows([1e-4, 1e-5, 1e-6, 1e-7, 1e-8], closing)}))


def pair():
    """The structures: the paper's pair on rods of order 1."""
    from dataclasses import replace

    import jaxpound as jp

    rods = {"rod_1": jp.ZenerRod(1.0, 0.1, 0.4), "rod_2": jp.ZenerRod(1.0, 0.2, 0.6)}
    return replace(jp.paper.structures(), **rods)


def by_jaxpound(scheme):
    """A function of the time step: the largest closing as a function of the slip force."""
    from dataclasses import replace

    import jaxpound as jp

    structures, ground = pair(), jp.paper.ground()

    def of_step(h):
        grid = jp.TimeGrid.until(END, h)

        def run(friction):
            shaken = replace(structures, friction=friction)
            gap = jp.demand(shaken, ground, grid, scheme, only=("min_gap",)).min_gap
            return structures.initial_gap - gap

        return run

    return of_step


def ours(loop_kernels):
    """The rows of jaxpound, by name."""
    import jaxpound as jp

    if loop_kernels:
        jp.runtime.use_loop_kernels()
    name = "jaxpound" + loop_kernels * ", loop kernels"
    steps = (0.04, 0.02, 0.01, 0.005)
    return {
        f"{name}, h": rows([*steps, 0.0025, 0.00125], by_jaxpound(jp.Scheme())),
        f"{name}, extrapolated, h": rows(steps, by_jaxpound(jp.Scheme(extrapolated=True))),
    }


def main(python):
    """The table of both programs."""
    import jaxpound as jp

    structures, ground = pair(), jp.paper.ground()
    PROBLEM.update(
        periods=np.asarray(ground.periods).tolist(),
        arrivals=np.asarray(ground.arrivals).tolist(),
        amplitude=float(ground.amplitude),
        rods=[[float(r.tau_f), float(r.tau_x)] for r in (structures.rod_1, structures.rod_2)],
        mass_ratio=float(structures.mass_ratio),
        stiffness_ratio=float(structures.stiffness_ratio),
        friction=float(structures.friction),
    )
    exact = by_jaxpound(jp.Scheme(extrapolated=True))(0.0005)(PROBLEM["friction"])
    tables = ours(loop_kernels=False)
    for interpreter, which in ((sys.executable, "--loop-kernels"), (python, "--peer")):
        call = [interpreter, __file__, which, json.dumps(PROBLEM)]
        output = subprocess.run(call, check=True, capture_output=True, text=True).stdout
        tables |= json.loads(output.splitlines()[-1])
    print(f"{'':40}{'':>9}{'error':>11}{'one run':>12}{'run of a batch':>17}")
    for name, table in tables.items():
        for setting, reached, single, many in table:
            error = reached - float(exact)
            print(f"{name:40}{setting:9g}{error:11.1e}{1e3 * single:9.2f} ms{1e6 * many:14.0f} µs")


PROBLEM = {}

if __name__ == "__main__":
    if sys.argv[1] in ("--peer", "--loop-kernels"):
        PROBLEM.update(json.loads(sys.argv[2]))
        peer() if sys.argv[1] == "--peer" else print(json.dumps(ours(loop_kernels=True)))
    else:
        main(sys.argv[1])
