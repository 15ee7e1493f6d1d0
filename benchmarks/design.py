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
from jaxpound.design.problem import DesignProblem
from jaxpound.design.run import Designer
from jaxpound.design.space import spread_shares

GRID = jp.TimeGrid.until(20.0, 0.04)
PAPER = jp.paper.structures()
OBJECTIVE = jp.Objective(penalties={"peak_f1": 0.6, "damper_force": 0.5})
RODS = {
    "rod_1.tau_f": jp.design.Bounds(0.001, 0.1, "log"),
    "rod_1.tau_x": jp.design.Bounds(0.2, 10.0, "log"),
    "rod_2.tau_f": jp.design.Bounds(0.02, 0.6, "log"),
    "rod_2.tau_x": jp.design.Bounds(0.7, 10.0, "log"),
}
TWO = jp.DesignSpace(PAPER, {"friction": (0.0, 1.0), "rod_1.tau_x": RODS["rod_1.tau_x"]})
FIVE = jp.DesignSpace(PAPER, {"friction": (0.0, 1.0), **RODS})
STARTS, ITERATIONS = 4, 100


def earthquakes(n):
    ground = jp.RandomRicker(5, jp.LogNormal(0.1, 0.5), jp.Uniform(1.0, 3.8), jp.Uniform(1.0, 7.0))
    return jp.Ensemble.drawn(jp.Scenarios(PAPER, ground), n)


def problem(space, ensemble, scheme=None):
    return DesignProblem(space, ensemble, GRID, scheme or jp.Scheme(), OBJECTIVE)


def designer(problem, **more):
    how = {"iterations": ITERATIONS, "patience": ITERATIONS, "tolerance": 1e-6, "starts": STARTS}
    return Designer(problem, jp.DesignSearch(**(how | more)), progress=False)


def search(one):
    start = time.perf_counter()
    found = one.design()
    return found, time.perf_counter() - start


class Counted:
    """The objective as SciPy asks for it: to be made small, by shares."""

    def __init__(self, problem):
        self.problem, self.calls = problem, 0
        self.value = jax.jit(OBJECTIVE.value)

    def __call__(self, shares):
        """Minus the objective at shares."""
        self.calls += 1
        columns = self.problem.evaluate(np.clip(shares, 0, 1), self.problem.ensemble)
        return -float(self.value(columns))


def told(name, objective, simulations, seconds):
    print(f"  {name:36} {objective:11.6f} {simulations:11,} {seconds:8.1f} s")


def against(title, space, ensemble):
    """Ours, Nelder and Mead's, differential evolution and a grid, side by side."""
    n, bounds = len(ensemble), [(0.0, 1.0)] * space.dimension
    print(f"{title}: {', '.join(space.names)}; {n} earthquakes, objective to be large")
    print(f"  {'':36} {'objective':>11} {'simulations':>11} {'':>8}")
    sought = problem(space, ensemble)
    one = designer(sought)
    _, compiling = search(one)
    found, seconds = search(one)
    print(f"  the first search takes {compiling - seconds:.0f} s more, to compile")
    told(f"Adam, {STARTS} starts, polished", found.objective, found.simulations, seconds)
    other = designer(sought, optimiser=optax.lbfgs(), iterations=15, polish=False)
    search(other)  # compiles
    lines, seconds = search(other)
    told("L-BFGS, 15 iterations (+ line search)", lines.objective, lines.simulations, seconds)
    least = Counted(sought)
    begun = spread_shares(space.shares(PAPER), STARTS, 0)
    start = time.perf_counter()
    ends = [optimize.minimize(least, x, method="Nelder-Mead", bounds=bounds) for x in begun]
    seconds = time.perf_counter() - start
    told(f"Nelder-Mead, {STARTS} starts", -min(x.fun for x in ends), least.calls * n, seconds)
    least, most = Counted(sought), 20 * found.simulations // n
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
        ("switching", jp.Scheme(jp.simulation.Switching())),
        ("smoothed, 0.1", jp.Scheme(jp.Smoothed(0.1))),
    ):
        for goal, space, many in (
            ("1, 2 variables", TWO, jp.Ensemble.of([jp.paper.ground()], GRID)),
            (f"{len(ensemble)}, 5 variables", FIVE, ensemble),
        ):
            found, _ = search(designer(problem(space, many, scheme)))
            judge = Counted(problem(space, many))
            ends = [-judge(x) for x in found.history.shares[-1]]
            print(
                f"  {name:16} {goal:16} best {-judge(found.shares):.6f}; ends of the starts "
                + ", ".join(f"{x:.4f}" for x in ends)
            )
    print()


def iteration(ensemble):
    """Time of one iteration of all starts over that of the same runs without gradient."""
    sought = problem(FIVE, ensemble)
    lagrangian = designer(sought).lagrangian
    begun = spread_shares(FIVE.shares(PAPER), STARTS, 0)
    data = sought.data(sought.evaluate(begun[0], ensemble), 1e-3, 0)
    state = lagrangian.begin(begun)

    @jax.jit
    def forward(shares):
        def run(at):
            return jax.vmap(lambda ground: sought.demands(FIVE.structures(at), ground)["min_gap"])(
                data.grounds
            )

        return jax.vmap(run)(shares)

    ratios = []
    jax.block_until_ready((lagrangian.iterate(state, 0, data), forward(begun)))
    for _ in range(7):
        took = []
        for call in (lambda: lagrangian.iterate(state, 0, data), lambda: forward(begun)):
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
    cores = jp.runtime.use_cores()
    print(f"JAX {jax.__version__}, {jax.default_backend()}, {cores} cores\n")
    many = earthquakes(256)
    iteration(many)
    against("The paper's case", TWO, jp.Ensemble.of([jp.paper.ground()], GRID))
    against("An ensemble, two variables", TWO, many)
    fresh(against("An ensemble, five variables", FIVE, many))
    friction_laws(many)
