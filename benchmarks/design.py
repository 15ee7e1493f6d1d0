"""Design by gradients against searches without: simulations, time, and the optimum they find.

    pip install -e ".[bench]" && python benchmarks/design.py

One run with its gradient counts as one simulation; what it costs in plain runs is the first figure.
"""

import time

import jax
import numpy as np
import optax
from scipy import optimize

import jaxpound as jp
from jaxpound.design.run import Sought
from jaxpound.design.space import spread_shares

GRID = jp.TimeGrid.until(20.0, 0.04)
PAPER = jp.paper.structures()
OBJECTIVE = jp.Objective(penalties={"peak_f1": 0.6, "damper_force": 0.5})
RODS = {
    "rod_1.tau_f": jp.Bounds(0.001, 0.1, "log"),
    "rod_1.tau_x": jp.Bounds(0.2, 10.0, "log"),
    "rod_2.tau_f": jp.Bounds(0.02, 0.6, "log"),
    "rod_2.tau_x": jp.Bounds(0.7, 10.0, "log"),
}
TWO = jp.DesignSpace(PAPER, {"friction": (0.0, 1.0), "rod_1.tau_x": RODS["rod_1.tau_x"]})
FIVE = jp.DesignSpace(PAPER, {"friction": (0.0, 1.0), **RODS})
STARTS, ITERATIONS = 4, 100


def earthquakes(n):
    ground = jp.RandomRicker(5, jp.LogNormal(0.1, 0.5), jp.Uniform(1.0, 3.8), jp.Uniform(1.0, 7.0))
    return jp.Ensemble.drawn(jp.Scenarios(PAPER, ground), n)


def sought(space, ensemble, scheme=None, optimiser=None):
    return Sought(
        space,
        ensemble,
        GRID,
        scheme or jp.Scheme(),
        OBJECTIVE,
        optimiser=optimiser,
        batch=None,
        iterations=ITERATIONS,
        scales=None,
    )


def search(one, **more):
    how = {"patience": ITERATIONS, "tolerance": 1e-6, "start": None, "starts": STARTS, "key": 0}
    start = time.perf_counter()
    found = one.search(**(how | {"progress": False} | more))
    return found, time.perf_counter() - start


class Counted:
    """The objective as SciPy asks for it: to be made small, by shares."""

    def __init__(self, one):
        self.one, self.calls = one, 0
        self.value = jax.jit(OBJECTIVE.value)

    def __call__(self, shares):
        """Minus the objective at shares."""
        self.calls += 1
        columns = self.one.evaluate(np.clip(shares, 0, 1), self.one.ensemble)
        return -float(self.value(columns))


def told(name, objective, simulations, seconds):
    print(f"  {name:36} {objective:11.6f} {simulations:11,} {seconds:8.1f} s")


def against(title, space, ensemble):
    """Ours, Nelder and Mead's, differential evolution and a grid, side by side."""
    n, bounds = len(ensemble), [(0.0, 1.0)] * space.dimension
    print(f"{title}: {', '.join(space.names)}; {n} earthquakes, objective to be large")
    print(f"  {'':36} {'objective':>11} {'simulations':>11} {'':>8}")
    one = sought(space, ensemble)
    search(one)  # compiles
    found, seconds = search(one)
    told(f"Adam, {STARTS} starts, polished", found.objective, found.simulations, seconds)
    other = sought(space, ensemble, optimiser=optax.lbfgs())
    other.iterations = 15
    search(other, polish=False)
    lines, seconds = search(other, polish=False)
    told("L-BFGS, 15 iterations (+ line search)", lines.objective, lines.simulations, seconds)
    least = Counted(one)
    begun = spread_shares(space.shares(PAPER), STARTS, 0)
    start = time.perf_counter()
    ends = [optimize.minimize(least, x, method="Nelder-Mead", bounds=bounds) for x in begun]
    seconds = time.perf_counter() - start
    told(f"Nelder-Mead, {STARTS} starts", -min(x.fun for x in ends), least.calls * n, seconds)
    least, most = Counted(one), 20 * found.simulations // n
    start = time.perf_counter()
    end = optimize.differential_evolution(
        least, bounds, maxiter=most // (15 * len(bounds)) - 1, tol=0, polish=False, rng=0
    )
    told("differential evolution", -end.fun, least.calls * n, time.perf_counter() - start)
    start = time.perf_counter()
    seen = found.landscape("friction", "rod_1.tau_x", 41)
    told(
        "41 x 41 grid of mu and tau_x1",
        seen.objective.max(),
        41 * 41 * n,
        time.perf_counter() - start,
    )
    print(f"  design {found.values}")
    print(f"  gradient {found.gradient_norm:.1e}, at bounds {found.active_bounds}\n")
    return found


def fresh(found):
    """The advantage on 10,000 earthquakes that it was not made for."""
    compared = found.compare(earthquakes(256).fresh(10_000))
    print("Out of sample, 10,000 fresh earthquakes, paired, 95 %")
    print(f"  min gap wider by   {compared.difference()}")
    print(f"  objective higher by {compared.objective['difference']}\n")


def friction_laws(ensemble):
    """The same search with gradients that miss how stops move, judged by event-resolved runs."""
    print("Gradients by friction law, designs judged by event-resolved friction")
    for name, scheme in (
        ("event-resolved", jp.Scheme()),
        ("switching", jp.Scheme(jp.Switching())),
        ("smoothed, 0.1", jp.Scheme(jp.Smoothed(0.1))),
    ):
        for goal, space, many in (
            ("1, 2 variables", TWO, jp.Ensemble.of([jp.paper.ground()], GRID)),
            (f"{len(ensemble)}, 5 variables", FIVE, ensemble),
        ):
            found, _ = search(sought(space, many, scheme))
            judge = Counted(sought(space, many))
            ends = [-judge(x) for x in found.history.shares[-1]]
            print(
                f"  {name:16} {goal:16} best {-judge(found.shares):.6f}; ends of the starts "
                + ", ".join(f"{x:.4f}" for x in ends)
            )
    print()


def iteration(ensemble):
    """Time of one iteration of all starts over that of the same runs without gradient."""
    one = sought(FIVE, ensemble)
    begun = spread_shares(FIVE.shares(PAPER), STARTS, 0)
    before = one.evaluate(begun[0], ensemble)
    given = one._given(before, None, 1e-3, 0)
    state = one.move.begin(begun)
    program, _ = one.move.compiled(state, given)

    @jax.jit
    def forward(shares):
        def run(at):
            return jax.vmap(
                lambda ground: one.setting.demands(FIVE.structures(at), ground)["min_gap"]
            )(given.grounds)

        return jax.vmap(run)(shares)

    ratios = []
    jax.block_until_ready((program(state, given), forward(begun)))
    for _ in range(7):
        took = []
        for call in (lambda: program(state, given), lambda: forward(begun)):
            start = time.perf_counter()
            jax.block_until_ready(call())
            took.append(time.perf_counter() - start)
        ratios.append((took[0] / took[1], *took))
    ratio, with_gradient, without = sorted(ratios)[len(ratios) // 2]
    print(f"One iteration of {STARTS} starts, {len(ensemble)} earthquakes, five variables:")
    print(
        f"  {with_gradient * 1e3:.0f} ms, {ratio:.1f} times the runs alone ({without * 1e3:.0f})\n"
    )


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    cores = jp.use_cores()
    print(f"JAX {jax.__version__}, {jax.default_backend()}, {cores} cores\n")
    many = earthquakes(256)
    iteration(many)
    against("The paper's case", TWO, jp.Ensemble.of([jp.paper.ground()], GRID))
    against("An ensemble, two variables", TWO, many)
    fresh(against("An ensemble, five variables", FIVE, many))
    friction_laws(many)
