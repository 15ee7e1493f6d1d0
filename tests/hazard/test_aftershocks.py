"""Fragility under aftershocks, given the damage of a mainshock before."""

import dataclasses

import numpy as np
import pytest

import jaxpound as jp
from tests.ground.test_suite import SUITE
from tests.hazard.test_ida import GAP, IN_UNITS, LEFT, PAIR, RIGHT, analysed
from tests.refusals import refusals, refused

REST = 12.0
MAINSHOCK = 0.1 * SUITE[0]
LEANING = jp.Buildings(
    (dataclasses.replace(LEFT, hysteresis=jp.Bilinear(0.005)), RIGHT),
    (jp.FloorLink(0, 0, gap=0.06),),
)


def test_a_linear_building_that_has_come_to_rest_is_as_new(linear):
    found = analysed(mainshock=MAINSHOCK, rest=REST)
    np.testing.assert_array_equal(found.unscaled, linear.unscaled)
    # The third begins with a jump where it is alone, and not after the quiet.
    np.testing.assert_allclose(found.capacities[:2], linear.capacities[:2], rtol=1e-5)
    assert found.measure == linear.measure


def test_runs_are_sequences_of_which_only_the_aftershock_is_scaled():
    analysis = jp.Analysis(LEANING, SUITE, mainshock=3 * MAINSHOCK, rest=REST)
    longest = max(float(record.duration) for record in SUITE)
    whole = float(SUITE[0].duration) + REST + longest
    assert analysis.time_grid.duration == pytest.approx(whole, abs=0.02)
    stripes = jp.multiple_stripes(analysis, [0.2, 0.4], progress=False)
    for i, record in enumerate(SUITE):
        ground = jp.sequence([3 * MAINSHOCK, record.scaled_to_pga(0.4)], REST)
        single = jp.demand(LEANING, ground, analysis.time_grid).min_gap
        assert stripes.demands[1][i] == pytest.approx(0.06 - float(single), rel=1e-6)
    cloud = jp.cloud_analysis(analysis, progress=False)
    np.testing.assert_allclose(cloud.intensity, SUITE.pgas)


def test_a_building_that_leans_to_its_neighbour_pounds_sooner_and_away_from_it_later():
    runs = {"progress": False, "tolerance": 0.01}
    fresh = analysed(LEANING, **runs).capacities
    pulse = jp.Pulse(0.2, 1.0, 1.0, cycles=1.0, time_unit="s")
    away, to = (
        analysed(LEANING, mainshock=ground, rest=REST, **runs).capacities
        for ground in (pulse, -pulse)
    )
    assert (to < fresh).all()
    assert (fresh < away).all()
    assert np.median(to / fresh) < 0.95 < 1.05 < np.median(away / fresh)


def test_a_store_knows_its_mainshock(tmp_path):
    stored = {"store": tmp_path / "ida", "progress": False, "rest": REST}
    first = analysed(mainshock=MAINSHOCK, **stored)
    again = analysed(mainshock=MAINSHOCK, **stored)
    np.testing.assert_array_equal(first.capacities, again.capacities)
    refused("holds another study: .*mainshock", analysed, mainshock=2 * MAINSHOCK, **stored)


def test_a_grid_that_ends_too_early_is_warned_of():
    grid = jp.TimeGrid.until(float(SUITE[0].duration) + REST, 0.02)
    with pytest.warns(jp.PlausibilityWarning, match="begins at 19.98, after the end of the run"):
        jp.Analysis(PAIR, [SUITE[1].scaled_to_pga(1e-3)], grid, mainshock=MAINSHOCK, rest=REST)


test_wrong_arguments_are_named = refusals(
    ({"mainshock": MAINSHOCK}, "rest = None must be a real number"),
    ({"rest": 10.0}, r"rest = 10\.0 must be None, as there is no mainshock"),
    ({"mainshock": MAINSHOCK, "rest": -1.0}, "rest = -1 must be"),
    ({"mainshock": np.sin, "rest": 1.0}, "mainshock = .* must have a duration"),
    ({"mainshock": 3.0, "rest": 1.0}, r"mainshock = 3\.0 must have acceleration"),
    ({"mainshock": IN_UNITS, "rest": 1.0}, "mainshock = Record.* must be in seconds"),
    (
        {"mainshock": 20 * MAINSHOCK, "rest": REST, "threshold": GAP / 10},
        r"threshold = 0\.002 must be above .*, what the demand is after the mainshock",
    ),
    of=lambda changed: analysed(**changed),
    before="^(incremental_dynamic_analysis|Analysis): ",
)
