"""How often isolated frames meet their walls, beside 371 runs of OpenSees that are published.

    python -m benchmarks.moat_walls    # writes docs/moat_walls.json and .png, prints the tables

The published runs (an open data base of a study at Berkeley, 2023) are of three-storey steel frames
on triple pendulums beside moat walls. They are summed up by the share of runs with an impact, by
the ratio of the gap to the code's displacement under each motion,

    r = gap / (g S_a(T_M) T_M² / (4π² B_M)),      logit P = a + b ln r.

Frames and motions here are of our own, and none of their numbers was tuned.
"""

import argparse
import itertools
import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)

import jaxpound as jp  # noqa: E402
from jaxpound.plots.style import CYCLE, in_house_style, label, new_figure  # noqa: E402

FILE = Path(__file__).parents[1] / "docs" / "moat_walls.json"
G = jp.STANDARD_GRAVITY

PUBLISHED = {
    "edges": [0.0, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, np.inf],
    "runs": [40, 62, 62, 56, 36, 78, 37],
    "shares": [0.975, 0.871, 0.597, 0.250, 0.139, 0.115, 0.081],
    "logit": [-0.224, -3.888],
    "deviations": [0.140, 0.393],
    "accelerations": [0.33, 3.63],  # median of the base without and with impact, g
}

RANGES = {
    "period": (2.5, 4.0),  # T_M, s
    "damping": (0.10, 0.20),  # at the code's displacement
    "frame period": (0.5, 0.9),  # on a rigid base, s
    "strength": (0.15, 0.45),  # of the frame, over its weight
    "log ratio": (np.log(0.3), np.log(2.5)),  # of the gap to the code's displacement
}
DEMAND = 1.0  # S_M1: the code's spectral acceleration times the period, g s
MASS, STOREYS = 300e3, 3
B_M = [0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5], [0.8, 1.0, 1.2, 1.5, 1.7, 1.9, 2.0]
WALL = jp.HertzDamped(stiffness=5e9, restitution=0.7, damping="muthukumar")  # N/m^1.5
NOISE = jp.scenarios.SiteBasedNoise(
    magnitude=7.0, distance=12.0, vs30=400.0, fault="strike-slip", samples=1500, dt=0.02
)
PULSE = jp.scenarios.RandomPulse(  # Bray and Rodriguez-Marek (2004), Shahi and Baker (2014)
    amplitude=jp.scenarios.TwoSided(jp.LogNormal(0.49, 0.49)),
    period=jp.LogNormal(3.3, 0.56),
    arrival=8.0,
    phase=jp.Uniform(0.0, np.pi),
    time_unit="s",
)
MOTIONS = {"far field": NOISE, "near fault": NOISE + PULSE}
GRID = jp.TimeGrid.until(35.0, dt=0.005)


def drawn(motion, key):
    """The numbers of a building, by name, and the ground motion."""
    of_building, of_ground = jax.random.split(key)
    shares = jax.random.uniform(of_building, (len(RANGES),))
    numbers = {
        name: low + (high - low) * share
        for (name, (low, high)), share in zip(RANGES.items(), shares, strict=True)
    }
    return numbers, motion.draw(jax.random.normal(of_ground, (motion.dimension,)))


def displacement(spectral_acceleration, numbers):
    """The code's displacement under a spectral acceleration at T_M, g, in m."""
    reduction = jnp.interp(numbers["damping"], *map(jnp.array, B_M))
    period = numbers["period"]
    return G * spectral_acceleration * period**2 / (4 * np.pi**2 * reduction)


def pendulum(numbers, size):
    """Pendulums that have the period T_M and the damping at a displacement, m."""
    part = np.pi / 2 * numbers["damping"]  # of the secant stiffness that is of friction
    radius = G * (numbers["period"] / (2 * np.pi)) ** 2 / (1 - part)
    return jp.FrictionPendulum(radius, part / (1 - part) * size / radius)


def isolated(numbers):
    """The frame on pendulums, with a wall at the gap ratio times the code's displacement."""
    size = displacement(DEMAND / numbers["period"], numbers)
    frame = jp.ShearBuilding.from_period(
        STOREYS, MASS, numbers["frame period"], damping=jp.Rayleigh(0.03)
    ).yielding(base_shear_coefficient=numbers["strength"], hardening=0.02)
    wall = jp.MoatWall(jnp.exp(numbers["log ratio"]) * size, WALL)
    base, links = jp.on_bearings(frame, pendulum(numbers, size), MASS, wall=wall)
    return jp.Buildings((base,), links)


def spectral_acceleration(ground, period):
    """At 5 % of damping, g."""
    block = jp.Building.from_period(MASS, period, 0.05, order=None)
    peak = jp.demand(jp.Buildings((block,)), ground, GRID, only=["peak_x1"]).peak_x1
    return peak * (2 * np.pi / period) ** 2 / G


def run(motion, key):
    """Gap ratio, whether the wall is met, and the base's largest acceleration, g."""
    numbers, ground = drawn(motion, key)
    at_period = spectral_acceleration(ground, numbers["period"])
    target = DEMAND / numbers["period"]
    result = jp.demand(isolated(numbers), (target / at_period) * ground, GRID)
    ratio = jnp.exp(numbers["log ratio"])  # as the motion has the code's spectrum at T_M
    return ratio, result.pounds, result.masses[0].peak_acceleration / G


def logistic(ratios, met):
    """The a and b of logit P = a + b ln r by most likelihood, and their standard deviations."""
    rows = np.stack([np.ones_like(ratios), np.log(ratios)], 1)
    numbers = np.zeros(2)
    for _ in range(50):
        p = 1 / (1 + np.exp(-rows @ numbers))
        information = rows.T @ ((p * (1 - p))[:, None] * rows)
        numbers += np.linalg.solve(information, rows.T @ (met - p))
    return numbers, np.sqrt(np.diag(np.linalg.inv(information)))


def statistics(motion, n):
    """Counts, shares with impact, logistic curve and accelerations of n runs under a motion."""
    keys = jax.random.split(jax.random.key(0), n)
    runs = jax.jit(lambda keys: jax.lax.map(lambda key: run(motion, key), keys, batch_size=100))
    ratios, met, accelerations = map(np.asarray, runs(keys))
    numbers, deviations = logistic(ratios, met)
    bins = np.digitize(ratios, PUBLISHED["edges"]) - 1
    counts = np.bincount(bins, minlength=len(PUBLISHED["runs"]))
    known = {
        "runs": counts,
        "shares": np.bincount(bins, met, minlength=counts.size) / np.maximum(counts, 1),
        "logit": numbers,
        "deviations": deviations,
        "accelerations": [np.median(accelerations[met == x]) for x in (0, 1)],
    }
    return {name: np.round(x, 3).tolist() for name, x in known.items()}


def main():
    """Run, print and write."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--runs", type=int, default=1484, help="four times those published")
    n = arguments.parse_args().runs
    ours = {name: statistics(motion, n) for name, motion in MOTIONS.items()}
    FILE.write_text(json.dumps(ours, indent=1) + "\n")
    print(table(everything()), curve(everything()), sep="\n\n")
    draw(everything())


def everything():
    """The published statistics and ours, by name."""
    return {"published": PUBLISHED} | json.loads(FILE.read_text())


def table(statistics):
    """Rows of Markdown: the range of the gap ratio, and the share with impact and runs of each."""
    edges, rows = PUBLISHED["edges"], []
    for k, (low, high) in enumerate(itertools.pairwise(edges)):
        shares = (f"{x['shares'][k]:.3f} of {x['runs'][k]}" for x in statistics.values())
        between = f"{low:g} to {high:g}" if np.isfinite(high) else f"beyond {low:g}"
        rows.append(f"| {between} | {' | '.join(shares)} |")
    return "\n".join(rows)


def curve(statistics):
    """Rows of Markdown: a, b and accelerations of each."""
    rows = []
    for k, name in enumerate(("$a$", "$b$")):
        numbers = (f"{x['logit'][k]:.2f} ± {x['deviations'][k]:.2f}" for x in statistics.values())
        rows.append(f"| {name} | {' | '.join(numbers)} |")
    for k, name in enumerate(("without", "with")):
        numbers = (f"{x['accelerations'][k]:.2f} g" for x in statistics.values())
        rows.append(f"| median acceleration of the base {name} impact | {' | '.join(numbers)} |")
    return "\n".join(rows)


@in_house_style
def draw(statistics):
    """The figure of the page: shares of runs that meet a wall, with their logistic curves."""
    figure = new_figure(1.2, 1.0)
    ax = figure.add_subplot()
    ratios, edges = np.geomspace(0.3, 2.6, 200), [0.3, *PUBLISHED["edges"][1:-1], 2.6]
    middles = np.sqrt(np.multiply(edges[:-1], edges[1:]))
    styles = ("black", "o"), (CYCLE[0], "s"), (CYCLE[1], "^")
    for (name, known), (colour, mark) in zip(statistics.items(), styles, strict=True):
        a, b = known["logit"]
        words = "published, OpenSees" if name == "published" else f"jaxpound, {name}"
        ax.plot(ratios, 1 / (1 + np.exp(-a - b * np.log(ratios))), color=colour, label=words)
        ax.plot(middles, known["shares"], mark, color=colour, markersize=4)
    ticks = [0.3, 0.5, 0.75, 1.0, 1.5, 2.0]
    ax.set(xscale="log", xlim=(0.29, 2.7))
    ax.set_xticks(ticks, labels=[f"{x:g}" for x in ticks])
    ax.minorticks_off()
    label(ax, "gap over the code's displacement, r", "share of runs that meet the wall")
    ax.legend(loc="upper right")
    figure.savefig(FILE.with_suffix(".png"), dpi=150)


if __name__ == "__main__":
    main()
