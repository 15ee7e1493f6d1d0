"""The largest x1 − x2 of a pair on rods of order 1 by jaxonomy, in a process of its own.

    python jaxonomy_run.py PROBLEM.json

jaxonomy asks for an older JAX than jaxpound does; this script needs it only. PROBLEM has the
wavelets (``periods``, ``arrivals``, ``amplitude``), the ``rods`` with τ_f and τ_x, ``mass_ratio``,
``stiffness_ratio``, ``friction`` and ``frictions`` of a batch, the ``end``, ``tolerances`` and how
many ``rounds`` to time. It prints, as JSON, a list for each tolerance: x1 − x2, and the shortest
wall times of one run and of a run of the batch; and the ``version`` of jaxonomy and of JAX.
"""

import json
import os
import sys
import time
from importlib.metadata import version
from pathlib import Path

if hasattr(os, "sched_setaffinity"):  # one core, as the runs beside it
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:1])

import jax
import jax.numpy as jnp

jax.config.update("jax_enable_x64", True)

from jaxonomy.framework import LeafSystem  # noqa: E402
from jaxonomy.simulation import SimulatorOptions, simulate  # noqa: E402


def system(problem):
    """The pair as a hybrid system; its discrete state is the direction of slip, 0 in stick."""
    periods, arrivals = (jnp.array(problem[name]) for name in ("periods", "arrivals"))
    (tau_f1, tau_x1), (tau_f2, tau_x2) = problem["rods"]
    rho, k = problem["mass_ratio"], problem["stiffness_ratio"]

    def shaking(t):
        a = jnp.pi / periods
        v = (a * (t - arrivals)) ** 2
        waves = 2 * a**2 * problem["amplitude"] * jnp.exp(-v)
        return jnp.sum(waves * (4 * v**2 - 12 * v + 3))

    def pull(y):
        return -y[4] + rho * y[5]

    class Pair(LeafSystem):
        def __init__(self):
            super().__init__(name="pair")
            self.declare_dynamic_parameter("friction", problem["friction"])
            self.declare_discrete_state(shape=(), default_value=0.0)
            self.declare_continuous_state(default_value=jnp.zeros(7), ode=self.motion)
            falls = {"direction": "positive_then_non_positive"}
            self.declare_zero_crossing(self.slip, self.stopped, name="stop", **falls)
            self.declare_zero_crossing(self.rest, self.breaks, name="breakaway", **falls)

        def motion(self, t, state, friction):
            x1, x2, v1, v2, f1, f2, _ = y = state.continuous_state
            direction, u = state.discrete_state, shaking(t)
            q = jnp.where(direction == 0, pull(y) / (1 + rho), direction * friction)
            rates = (x1 + tau_x1 * v1 - f1) / tau_f1, (k * (x2 + tau_x2 * v2) - f2) / tau_f2
            return jnp.array([v1, v2, -f1 - q - u, rho * (q - f2) - u, *rates, 0.0])

        def slip(self, t, state, friction):
            y, direction = state.continuous_state, state.discrete_state
            return jnp.where(direction == 0, 1.0, direction * (y[2] - y[3]))

        def stopped(self, t, state, friction):
            y = state.continuous_state
            holds = jnp.abs(pull(y)) <= (1 + rho) * friction
            y = y.at[3].set(y[2]).at[6].max(y[0] - y[1])  # the largest x1 − x2 is at a stop
            direction = jnp.where(holds, 0.0, jnp.sign(pull(y)))
            return state.with_continuous_state(y).with_discrete_state(direction)

        def rest(self, t, state, friction):
            y, direction = state.continuous_state, state.discrete_state
            return jnp.where(direction == 0, (1 + rho) * friction - jnp.abs(pull(y)), 1.0)

        def breaks(self, t, state, friction):
            return state.with_discrete_state(jnp.sign(pull(state.continuous_state)))

    return Pair()


def shortest(call, rounds):
    """The shortest of several wall times of a call, once compiled."""
    jax.block_until_ready(call())
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        jax.block_until_ready(call())
        times.append(time.perf_counter() - start)
    return min(times)


def rows(problem):
    """Of each tolerance: x1 − x2, and the times of one run and of a run of a batch."""
    pair = system(problem)
    begin, frictions = pair.create_context(), jnp.array(problem["frictions"])
    friction, rounds = problem["friction"], problem["rounds"]
    for tolerance in problem["tolerances"]:
        options = SimulatorOptions(
            rtol=tolerance,
            atol=tolerance / 100,
            max_major_steps=500,
            save_time_series=False,
            ode_solver_method="dopri5",
            math_backend="jax",
        )

        def run(friction, options=options):
            start, span = begin.with_parameter("friction", friction), (0.0, problem["end"])
            ends = simulate(pair, start, span, options=options, postprocess=False)
            return ends.context.continuous_state[6]

        single, many = jax.jit(run), jax.jit(jax.vmap(run))
        yield (
            float(single(friction)),
            shortest(lambda program=single: program(friction), rounds),
            shortest(lambda program=many: program(frictions), rounds) / len(frictions),
        )


if __name__ == "__main__":
    stated = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    versions = f"{version('jaxonomy')} with JAX {jax.__version__}"
    print(json.dumps({"rows": list(rows(stated)), "version": versions}))
