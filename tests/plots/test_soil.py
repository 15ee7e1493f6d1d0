"""Drawings of buildings on soil: the footing in the ground, its numbers, and that it moves."""

import numpy as np
import pytest
from matplotlib.patches import Rectangle

import jaxpound as jp
from jaxpound import plots
from jaxpound.plots.animation import Scene
from tests.plots.runs import new_axes

SOIL = jp.Soil(150.0, 1800.0, 0.3)


@pytest.fixture(scope="module")
def pair():
    buildings = [jp.ShearBuilding.from_period(n, 2e5, n / 5, 0.05, None) for n in (2, 1)]
    left, right = (jp.on_soil(x, SOIL, radius=6.0, footing_mass=2e5) for x in buildings)
    links = jp.floor_links((left, right), gap=0.05)[:1] + jp.model.through_soil(left, right, 0.1)
    return jp.Buildings((left, right), links)


def test_footings_stand_in_the_ground_with_their_numbers(pair, legible):
    ax = plots.row(pair)
    places = {text.get_text(): text.get_position()[1] for text in ax.texts}
    footing = pair.buildings[0].footing
    numbers = [f"$K_{{3}}$ = {float(f'{footing.sway_stiffness / 1e6:.3g}'):,g} MN/m"]
    numbers += [f"$K_{{4}}$ = {float(f'{footing.rocking_stiffness / 1e6:.3g}'):,g} MN/m"]
    numbers += ["$m_{3}$ = 200 t", "$m_{6}$ = 200 t"]
    assert all(places[words] < 0 for words in numbers)
    assert not any(words.startswith(("$m_{4}$", "$m_{7}$")) for words in places)  # rotations
    legible(ax.figure, [text for text in ax.texts if not text.get_text().startswith("$c_")])


def test_modes_and_animations_begin_at_the_footing(pair):
    modes = [building.modes() for building in pair.buildings]
    lines = [line.get_xdata() for line in plots.mode_shapes(pair, n=1).lines[:2]]
    for line, mode, n in zip(lines, modes, (2, 1), strict=True):
        shape = mode.shapes[:, 0].real
        shape = shape * np.sign(shape[n - 1])
        np.testing.assert_allclose(line, [shape[n], *shape[:n]])
    run = jp.simulate(pair, jp.Ricker(0.02, 0.5, 1.0), jp.TimeGrid.until(3.0, 5e-3))
    scene = Scene(run, ax := new_axes(), elevations=[x.elevations for x in pair.buildings])
    instant = int(np.abs(run.masses[2].x).argmax())
    scene.show(instant)
    bodies = [x for x in ax.patches if isinstance(x, Rectangle)]
    lowest = [x for x in bodies if x.get_y() < 0]
    moved = [float(run.masses[i].x[instant]) for i in (2, 5)]
    lefts = sorted(x.get_x() for x in lowest)
    scene.show(0)
    rest = sorted(x.get_x() for x in lowest)
    shifts = [x - y for x, y in zip(lefts, rest, strict=True) if x != y]
    np.testing.assert_allclose(shifts, moved)
    plots.gap_map(run)
