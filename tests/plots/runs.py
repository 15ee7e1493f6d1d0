"""Runs that several tests draw, by two programs: without contact, and with a law of contact."""

from dataclasses import replace
from functools import cache

from matplotlib.figure import Figure

import jaxpound as jp
from jaxpound.plots.style import FIGURE_SIZE

PAIR, GROUND = jp.paper.structures(), jp.paper.ground()
GRID, SHORT = jp.TimeGrid(0.02, 1000), jp.TimeGrid(0.02, 400)
LAW = jp.KelvinVoigt(stiffness=100.0, restitution=0.65)
SCALES = jp.Scales(mass=500e3, frequency=7.0)


def new_axes():
    return Figure(figsize=FIGURE_SIZE, layout="constrained").add_subplot()


def legend(ax):
    """The words of the legend; none if there is none."""
    return [text.get_text() for text in ax.get_legend().texts] if ax.get_legend() else []


@cache
def paper_run(friction=PAIR.friction):
    return jp.simulate(replace(PAIR, friction=friction), GROUND, GRID)


@cache
def collide(friction, stiffness=100.0):
    law = replace(LAW, stiffness=stiffness)
    pair = replace(PAIR, friction=friction, initial_gap=0.3, contact=law)
    return jp.simulate(pair, GROUND, SHORT)
