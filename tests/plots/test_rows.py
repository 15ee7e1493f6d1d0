"""Drawings of a row and of the pair: every number and symbol, nothing on anything else."""

import itertools

import jax
import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

import jaxpound as jp
from jaxpound import plots
from jaxpound.plots.style import COLOURS
from jaxpound.plots.system import mechanical_system
from tests.made import STEEL, row_of
from tests.plots.runs import LAW, legend, new_axes
from tests.refusals import refused


def linked(n_floors, braces=()):
    links = jp.floor_links(row_of(n_floors).buildings, friction=0.0125, gap=0.234, contact=LAW)
    return row_of(n_floors, links + braces)


BRACE = jp.FloorLink(0, 1, friction=0.5, next_building=0)
ROWS = {
    "two by ten": linked((10, 10)),
    "three": linked((4, 3, 4), (BRACE, jp.FloorLink(1, 0, friction=0.7, next_building=jp.GROUND))),
    "unequal heights": row_of((3, 2), (jp.FloorLink(0, 2, 1, friction=0.1, gap=0.2),)),
    "alone": row_of((2, 2)),
    "a pair": jp.paper.structures(),
    "one building": jp.Storeys((1.0, 0.5), STEEL),
}


@pytest.mark.parametrize("name", ROWS)
def test_every_number_stands_in_the_picture_and_none_on_another(name, legible):
    ax = plots.row(ROWS[name])
    words = [text.get_text() for text in ax.texts]
    system = ROWS[name].system()
    numbers = [f"$m_{{{i}}}$ = {float(mass):.3g}" for i, mass in enumerate(system.masses, 1)]
    numbers += [f"$K_{{{i}}}$ = {float(x.stiffness):.3g}" for i, x in enumerate(system.rods, 1)]
    numbers += [f"$\\mu_{{{i}}}$ = {float(x.friction):.3g}" for i, x in enumerate(system.links, 1)]
    assert set(numbers) <= set(words)
    for i, link in enumerate(system.links, 1):
        assert (f"$\\xi_{{0,{i}}}$ = {float(link.gap):.3g}" in words) == np.isfinite(link.gap)
    legible(ax.figure, [*ax.texts, *(ax.get_legend().texts if ax.get_legend() else ())])


def test_numbers_in_si_stand_between_the_columns_of_their_storey():
    buildings = [jp.ShearBuilding.from_period(n, 2e5, n / 8, 0.05) for n in (4, 3, 4)]
    law = jp.KelvinVoigt(2e9, 0.65)
    links = jp.floor_links(buildings, friction=24.5e3, gap=0.0367, contact=law)
    brace = jp.FloorLink(0, 1, friction=9.8e5, next_building=0)
    wall = jp.FloorLink(1, 0, friction=1.37e6, next_building=jp.GROUND)
    ax = plots.row(jp.Buildings(buildings, (*links, brace, wall)))
    ax.figure.draw_without_rendering()
    words = {text.get_text(): text.get_window_extent() for text in ax.texts}
    numbers = {r"$\xi_{0,1}$ = 0.0367 m", r"$\mu_{1}$ = 24.5 kN"}
    assert {"$m_{1}$ = 200 t", *numbers} <= words.keys()
    columns = [line.get_window_extent() for line in ax.lines if line.get_linewidth() == 2.2]
    of_rods = [box for text, box in words.items() if text.startswith("$K")]
    assert len(of_rods) == 11
    assert not any(box.overlaps(column) for box in of_rods for column in columns)
    assert not any(a.overlaps(b) for a, b in itertools.combinations(words.values(), 2))


def test_what_is_at_a_link_is_drawn(ax):
    rest, orange = r"gap at rest $\xi_0$", mpl.colors.to_rgba("#E69F00")
    for link, words, dampers, pads in (
        ({"friction": 0.1}, [r"damper, slip force $\mu$"], 1, 0),
        ({"gap": 0.1}, [rest], 0, 0),
        ({"gap": 0.1, "contact": LAW}, [rest, "contact (KelvinVoigt)"], 0, 2),
        ({}, [], 0, 0),
    ):
        ax = plots.row(row_of((1, 1), (jp.FloorLink(0, 0, **link),)), ax=new_axes())
        assert legend(ax) == words
        assert sum(line.get_marker() == "s" for line in ax.lines) == dampers
        assert sum(patch.get_facecolor() == orange for patch in ax.patches) == pads


VISCOUS = jp.Rod(jp.PowerLaw(0.4, 0.5), 5.0)


def test_walls_stand_where_gaps_to_the_ground_close_and_bearings_in_a_pit(legible):
    wall = {"gap": (0.3, 0.2), "contact": LAW, "friction": 0.1, "damper": VISCOUS}
    links = (jp.FloorLink(0, 0, next_building=jp.GROUND, **wall),)
    fast = jp.VelocityFriction(0.7, 0.2)
    links += (jp.FloorLink(0, 1, 0, friction=0.2, gap=0.1, velocity_friction=fast),)
    links += (jp.FloorLink(1, 1, next_building=jp.GROUND, gap=0.5),)
    ax = plots.row(row_of((4, 2), links), [[0.5, 3.5, 6.5, 9.5], [3.0, 6.0]])
    walls = sorted(patch.get_x() for patch in ax.patches if patch.get_hatch())
    blocks = [[x.get_x() for x in ax.patches if x.get_facecolor() == c] for c in colours(ax)]
    left, right = (min(block) for block in blocks)
    assert walls[0] < left < left + 3 < walls[1] < right < right + 3 < walls[2]
    ground = next(line for line in ax.lines if line.get_color() == "#000000")
    assert min(ground.get_ydata()) == 0.5 - 3.0  # the bearings' storey is as high as the others
    words = {text.get_text() for text in ax.texts}
    numbers = {"$\\mu_{1}$ = 0.1\n$F_{7}$ = 0.4", "$\\mu_{3}$ = 0.2\nto 0.9"}  # the seventh rod
    assert numbers | {f"$\\xi_{{0,{k}}}$ = {x}" for k, x in ((1, 0.2), (2, 0.3), (4, 0.5))} <= words
    says = [r"damper, slip force $\mu$", "damper (PowerLaw)", r"gap at rest $\xi_0$"]
    says += ["contact (KelvinVoigt)"]
    assert legend(ax) == says
    legible(ax.figure, [*ax.texts, *ax.get_legend().texts])
    assert ax.figure.get_figheight() < ax.figure.get_figwidth()
    # Walls with soil are as low as bearings, and leave storeys their scale.
    links = tuple(jp.FloorLink(b, 0, gap=0.35, contact=LAW) for b in (0, 1))
    ax = plots.row(row_of((1, 5, 1), links), [[0.5], [0.5, 3.5, 6.5, 9.5, 12.5], [0.5]])
    ground = next(line for line in ax.lines if line.get_color() == "#000000")
    assert min(ground.get_ydata()) == 0.5 - 3.0
    assert ax.figure.get_figheight() < ax.figure.get_figwidth()
    legible(ax.figure, [*ax.texts, *ax.get_legend().texts])


def colours(ax):
    return [mpl.colors.to_rgba(colour, 0.25) for colour in ("#0072B2", "#D55E00")]


def test_floors_stand_at_their_heights_and_numbers_in_si_have_units(ax):
    plots.row(row_of((2, 1)), [[4.0, 7.0], [3.5]], ax)
    slabs = [p for p in ax.patches if isinstance(p, Rectangle) and p.get_fill() and p.get_y() > 0]
    middles = [p.get_y() + p.get_height() / 2 for p in slabs]
    np.testing.assert_allclose(middles, [4.0, 7.0, 3.5])
    assert ax.get_ylabel() == "height (m)"
    blocks = [jp.Building.from_period(mass=m, period=0.9, damping_ratio=0.05) for m in (5e5, 4e5)]
    link = jp.FloorLink(0, 0, friction=1e5, gap=0.05)
    ax = plots.row(jp.Buildings(tuple(blocks), (link,)), ax=new_axes())
    words = {text.get_text().replace("m_{1}", "m_1") for text in ax.texts}
    assert {"$m_1$ = 500 t", r"$\mu_{1}$ = 100 kN", r"$\xi_{0,1}$ = 0.05 m"} <= words


def test_wrong_arguments_are_refused(ax):
    row = row_of((2, 1))
    batch = jax.tree.map(lambda x: np.array([x, x]), row)
    rods = tuple(jp.Rod(STEEL.material, 1.0, ends) for ends in ((0, jp.GROUND), (1, 0), (2, 0)))
    for structures, elevations, message in (
        (row, [[3.0, 6.0]], "row: elevations, 1 of them, must be one for each of the"),
        (row, [[3.0, 6.0], [3.0, 6.0]], r"row: elevations\[1\] = \[3.0, 6.0\] must be"),
        (batch, None, "must be known and one row, not a batch"),
        (jp.System((1.0,) * 3, rods), None, "masses must be shear buildings"),
    ):
        refused(message, plots.row, structures, elevations, ax)
    traced = jax.jit(lambda unknown: plots.row(unknown, ax=ax) and 0)
    refused("must be known and one row", traced, row)
    pairs = jax.tree.map(lambda x: np.array([x, x]), jp.paper.structures())
    refused("must be a single pair, not a batch", mechanical_system, pairs, ax)


SYMBOLS = ["m_1", "m_2", "x_1", "x_2", "u(t)", r"\mu", r"\xi", r"\alpha", r"\beta"]
NUMBERS = ["0.23", "0.004", "1.18", "0.53", "0.2", "= 4", r"\mu = 0.25", "= 2"]


@pytest.mark.parametrize("structures", [None, jp.paper.structures()], ids=["symbols", "numbers"])
def test_every_symbol_stands_in_the_picture_and_none_on_another(structures, legible):
    ax = Figure(figsize=(7.1, 2.9), layout="constrained").add_subplot()
    assert mechanical_system(structures, ax) is ax
    words = " ".join(text.get_text() for text in ax.texts)
    for symbol in SYMBOLS + ([] if structures is None else NUMBERS):
        assert symbol in words
    legible(ax.figure, ax.texts)


def test_a_column_is_hit_at_the_height_of_the_floor():
    """One pad is at the floor, the other at the column between floors."""
    low, high = (jp.ShearBuilding.from_period(2, 3e5, 0.4, 0.05, height=h) for h in (3.0, 4.2))
    column, law = jp.model.Column(9.6e7), jp.KelvinVoigt(2e9, 0.7)
    links = jp.floor_links((low, high), gap=0.01, contact=law, columns=column)
    pair, ups = jp.Buildings((low, high), links[:1]), [low.elevations, high.elevations]
    ax = plots.row(pair, ups)
    pads = [x for x in ax.patches if x.get_facecolor()[:3] == to_rgb(COLOURS["pounding"])]
    assert [x.get_y() + x.get_height() / 2 for x in pads] == pytest.approx([3.0, 3.0])
    columns = [
        x for line in ax.lines for x in line.get_xdata() if x > 1 and len({*line.get_xdata()}) == 1
    ]
    assert min(abs(pads[1].get_x() + pads[1].get_width() - x) for x in columns) < 1e-9
