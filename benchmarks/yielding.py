"""Cost of storeys that yield beside elastic fractional ones, in one process.

    python benchmarks/yielding.py

Runs, gradients in reverse mode and compile times of a building, elastic and yielding, and the
ratios; by the smallest of several alternating measurements. A batch is of buildings that differ in
stiffness.
"""

import time

import jax
import jax.numpy as jnp

jax.config.update("jax_enable_x64", True)

import jaxpound as jp  # noqa: E402

STEEL = jp.ZenerRod(order=0.5, tau_f=0.01, tau_x=0.05)
BILINEAR, BOUC_WEN = jp.Bilinear(0.1, 0.05), jp.BoucWen(0.1, 0.05, 2.0, 0.5)
ELASTIC = "elastic, with memory"
MATERIALS = {
    ELASTIC: STEEL,
    "bilinear": BILINEAR,
    "bilinear, with memory": jp.model.YieldingZener(STEEL, BILINEAR),
    "Bouc–Wen": BOUC_WEN,
    "Bouc–Wen, with memory": jp.model.YieldingZener(STEEL, BOUC_WEN),
}
CASES = ((1, 20_000, 1), (2, 8_000, 1), (3, 8_000, 1), (10, 4_000, 1))
"""Storeys, steps, and buildings."""
BATCHES = ((1, 500, 1_000), (2, 500, 700), (3, 500, 500), (4, 500, 300))
GROUND = jp.Ricker(0.3, [1.5, 2.0, 2.5], [2.0, 4.0, 6.0])


def largest(stiffness, material, n, grid):
    """Peak displacements of a building of n storeys, summed."""
    building = jp.Storeys((1.0,) * n, jp.Rod(material, stiffness))
    return sum(jnp.asarray(mass.peak_x) for mass in jp.demand(building, GROUND, grid).masses)


def compiled(function, *args):
    """A compiled function, and the seconds that it took."""
    start = time.perf_counter()
    program = jax.jit(function).lower(*args).compile()
    return program, time.perf_counter() - start


def seconds(programs, args, repeats=9):
    """The smallest time of each program, measured in turn."""
    least = dict.fromkeys(programs, float("inf"))
    for _ in range(repeats):
        for name, program in programs.items():
            start = time.perf_counter()
            jax.block_until_ready(program(*args[name]))
            least[name] = min(least[name], time.perf_counter() - start)
    return least


def main() -> None:
    """Print the table."""
    for n, steps, runs in CASES + BATCHES:
        grid = jp.TimeGrid(0.01, steps)
        stiffness = jnp.linspace(15.0, 25.0, runs) if runs > 1 else jnp.asarray(20.0)
        args = {name: (stiffness, law) for name, law in MATERIALS.items()}

        def run(stiffness, law, n=n, grid=grid):
            each = jax.vmap(largest, (0, None, None, None)) if stiffness.ndim else largest
            return each(stiffness, law, n, grid).sum()

        values, gradients, costs = {}, {}, {}
        for name in MATERIALS:
            values[name], first = compiled(run, *args[name])
            gradients[name], second = compiled(jax.value_and_grad(run), *args[name])
            costs[name] = first, second
        of_value, of_gradient = (seconds(programs, args) for programs in (values, gradients))
        storeys = f"{n} storeys, {steps} steps" + (f", batch of {runs}" if runs > 1 else "")
        print(f"{storeys}: run, gradient, compilation of both; over the elastic")
        for name in MATERIALS:
            numbers = (of_value[name], of_gradient[name], *costs[name])
            elastic = (of_value[ELASTIC], of_gradient[ELASTIC], *costs[ELASTIC])
            ratios = [x / y for x, y in zip(numbers, elastic, strict=True)]
            print(
                f"  {name:22}",
                *(f"{x:8.4f} s ({r:.2f})" for x, r in zip(numbers, ratios, strict=True)),
                flush=True,
            )


if __name__ == "__main__":
    main()
