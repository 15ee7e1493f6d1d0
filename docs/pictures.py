"""The pictures of the README and of these pages: python docs/pictures.py.

The paper's structures at a gap of 0.7, without and with a damper, as an animation; the drawing of
the system; the paper's case over time.
"""

from dataclasses import replace
from pathlib import Path

import jax
from matplotlib.figure import Figure

import jaxpound as jp
from jaxpound.plots.animation import animate
from jaxpound.plots.runs import overview
from jaxpound.plots.system import mechanical_system

jax.config.update("jax_enable_x64", True)
HERE = Path(__file__).parent


def main() -> None:
    """Write them beside this file."""
    structures, ground = replace(jp.paper.structures(), initial_gap=0.7), jp.paper.ground()
    grid = jp.TimeGrid.until(14.0, dt=0.02)
    runs = {
        name: jp.simulate(replace(structures, friction=mu), ground, grid)
        for name, mu in (("without damper", 0.0), ("with a friction damper", 0.6))
    }
    animate(runs, frames=60, seconds=7.0).save(HERE / "animation.gif", "pillow", dpi=100)
    drawing = Figure(figsize=(7.08, 2.3), layout="constrained")
    mechanical_system(ax=drawing.add_subplot())
    drawing.savefig(HERE / "system.png", dpi=150)
    case = jp.simulate(jp.paper.structures(), ground, jp.paper.grid())
    overview(case).savefig(HERE / "paper_case.png", dpi=130)


if __name__ == "__main__":
    main()
