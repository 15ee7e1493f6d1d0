"""The drawing of a row: every number of it, nothing on anything else."""

import itertools

import jax
import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

import jaxpound as jp
from jaxpound import plots
from tests.made import STEEL, row_of

LAW = jp.KelvinVoigt(100.0, 0.65)


def links_of(n_floors):
    buildings = row_of(n_floors).buildings
    return jp.floor_links(buildings, friction=0.0125, gap=0.234, contact=LAW)


BRACES = (
    jp.FloorLink(0, 1, friction=0.5, next_building=0),
    jp.FloorLink(1, 0, friction=0.7, next_building=jp.GROUND),
)
ROWS = {
    "two by ten": row_of((10, 10), links_of((10, 10))),
    "three": row_of((4, 3, 4), links_of((4, 3, 4)) + BRACES),
    "unequal heights": row_of((3, 2), (jp.FloorLink(0, 2, 1, friction=0.1, gap=0.2),)),
    "alone": row_of((2, 2)),
    "a pair": jp.paper.structures(),
    "one building": jp.Storeys((1.0, 0.5), STEEL),
}


@pytest.mark.parametrize("name", ROWS)
def test_every_number_stands_in_the_picture_and_none_on_another(name, legible):
    structures = ROWS[name]
    ax = plots.row(structures)
    figure = ax.figure
    words = [text.get_text() for text in ax.texts]
    system = structures.system()
    for i, mass in enumerate(system.masses, 1):
        assert f"$m_{{{i}}}$ = {float(mass):.3g}" in words
    for i, rod in enumerate(system.rods, 1):
        assert f"$K_{{{i}}}$ = {float(rod.stiffness):.3g}" in words
    for i, link in enumerate(system.links, 1):
        assert f"$\\mu_{{{i}}}$ = {float(link.friction):.3g}" in words
        assert (f"$\\xi_{{0,{i}}}$ = {float(link.gap):.3g}" in words) == np.isfinite(link.gap)
    legible(figure, [*ax.texts, *(ax.get_legend().texts if ax.get_legend() else ())])


def test_numbers_in_si_stand_between_the_columns_of_their_storey():
    scales = jp.Scales(mass=2e5, frequency=25.0)
    ax = plots.row(ROWS["three"], scales=scales)
    ax.figure.draw_without_rendering()
    words = {text.get_text(): text.get_window_extent() for text in ax.texts}
    assert "$m_{1}$ = 200 t" in words
    assert f"$\\xi_{{0,1}}$ = {0.234 * float(scales.length):.3g} m" in words
    assert f"$\\mu_{{1}}$ = {0.0125 * float(scales.force) / 1e3:.3g} kN" in words
    columns = [line.get_window_extent() for line in ax.lines if line.get_linewidth() == 2.2]
    of_rods = [box for text, box in words.items() if text.startswith("$K")]
    assert len(of_rods) == 11
    assert not any(box.overlaps(column) for box in of_rods for column in columns)
    boxes = words.values()
    assert not any(a.overlaps(b) for a, b in itertools.combinations(boxes, 2))


def pads(ax):
    return [p for p in ax.patches if p.get_facecolor() == mpl.colors.to_rgba("#E69F00")]


def test_what_is_at_a_link_is_drawn():
    def drawn(**known):
        links = (jp.FloorLink(0, 0, **known),)
        ax = plots.row(row_of((1, 1), links), ax=Figure().add_subplot())
        legend = ax.get_legend()
        return ax, [text.get_text() for text in legend.texts] if legend else []

    ax, words = drawn(friction=0.1)
    assert words == [r"damper, slip force $\mu$"]
    assert sum(line.get_marker() == "s" for line in ax.lines) == 1
    ax, words = drawn(gap=0.1)
    assert words == [r"gap at rest $\xi_0$"]
    assert not any(line.get_marker() == "s" for line in ax.lines)
    ax, words = drawn(gap=0.1, contact=LAW)
    assert words == [r"gap at rest $\xi_0$", "contact (KelvinVoigt)"]
    assert len(pads(ax)) == 2
    assert drawn()[1] == []


def test_floors_stand_at_their_heights():
    elevations = [[4.0, 7.0], [3.5]]
    ax = plots.row(row_of((2, 1)), elevations, Figure().add_subplot())
    slabs = [p for p in ax.patches if isinstance(p, Rectangle) and p.get_fill() and p.get_y() > 0]
    middles = [p.get_y() + p.get_height() / 2 for p in slabs]
    np.testing.assert_allclose(middles, [4.0, 7.0, 3.5])
    assert ax.get_ylabel() == "height (m)"


def test_wrong_arguments_are_refused():
    ax = Figure().add_subplot()
    row = row_of((2, 1))
    with pytest.raises(ValueError, match="row: elevations, 1 of them, must be one for each of the"):
        plots.row(row, [[3.0, 6.0]], ax)
    with pytest.raises(ValueError, match=r"row: elevations\[1\] = \[3.0, 6.0\] must be"):
        plots.row(row, [[3.0, 6.0], [3.0, 6.0]], ax)
    with pytest.raises(ValueError, match="must be known and one row, not a batch"):
        plots.row(jax.tree.map(lambda x: np.array([x, x]), row), ax=ax)
    with pytest.raises(ValueError, match="must be known and one row"):
        jax.jit(lambda one: plots.row(one, ax=ax) and 0)(row)
    rods = tuple(jp.Rod(STEEL.material, 1.0, ends) for ends in ((0, jp.GROUND), (1, 0), (2, 0)))
    with pytest.raises(ValueError, match="masses must be shear buildings"):
        plots.row(jp.System((1.0,) * 3, rods), ax=ax)


def test_the_numbers_of_buildings_in_si_have_units():
    blocks = [jp.Building.from_period(mass=m, period=0.9, damping_ratio=0.05) for m in (5e5, 4e5)]
    buildings = jp.Buildings(tuple(blocks), (jp.FloorLink(0, 0, friction=1e5, gap=0.05),))
    ax = plots.row(buildings, ax=Figure().add_subplot())
    words = [text.get_text() for text in ax.texts]
    assert {"$m_1$ = 500 t", r"$\mu_{1}$ = 100 kN", r"$\xi_{0,1}$ = 0.05 m"} <= {
        text.replace("m_{1}", "m_1") for text in words
    }
