"""Studies of buildings on soil: a random velocity of shear waves, stored, and rules of codes."""

import numpy as np
import pytest

import jaxpound as jp
from jaxpound.study.gaps import double_difference_correlation

SOIL = jp.Soil(150.0, 1800.0, 0.3)
BLOCKS = [jp.Building.from_period(m, t, 0.05, None) for m, t in ((400e3, 0.5), (300e3, 0.4))]
VELOCITY = "buildings.0.footing.soil.shear_wave_velocity"


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    blocks = jp.Buildings(BLOCKS, (jp.FloorLink(0, 0, gap=0.05),))
    pair = jp.on_soil(blocks, SOIL, radius=5.0, footing_mass=2e5, height=3.0)
    structures = jp.UncertainStructures(pair, {VELOCITY: jp.LogNormal(150.0, 0.3)})
    scenarios = jp.Scenarios(structures, jp.Ricker(0.02, 0.5, 1.0))
    folder, grid = tmp_path_factory.mktemp("soil") / "study", jp.TimeGrid.until(3.0, 5e-3)
    ran = jp.monte_carlo(scenarios, 16, grid, store=folder, progress=False)
    return pair, ran, jp.Study.open(folder)


def test_a_random_soil_moves_the_building_on_it_only(study):
    """The fifth of the demands, of the footing beside, is that of the same soil in all runs."""
    _, ran, opened = study
    assert np.ptp(ran["peak_x2"]) > 1e-4  # footings are masses 2 and 5
    assert np.ptp(ran["peak_x5"]) < 1e-12
    assert len(set(ran.parameters()[VELOCITY])) == 16
    assert "footing of building 1" in str(ran)
    assert opened.topology == ran.topology


def test_rules_of_codes_take_the_first_modes_on_soil(study):
    pair, ran, _ = study
    modes = [pair.modes(b) for b in range(2)]
    numbers = [x[0] for mode in modes for x in (mode.periods, mode.damping_ratios)]
    separation = ran.separation(0.1)
    assert separation.correlation == pytest.approx(double_difference_correlation(*numbers))
    u1, u2 = (ran.quantile(f"peak_x{i}", 0.9).value for i in (1, 4))
    assert separation.srss == pytest.approx(np.hypot(u1, u2))
