"""Studies of buildings that yield, by the names of their demands."""

import jax
import numpy as np
import pytest

import jaxpound as jp
from tests.refusals import refused
from tests.storing import studied

STEEL = jp.ZenerRod(0.5, 0.01, 0.05)
LAW = jp.model.YieldingZener(STEEL, jp.Bilinear(0.1, 0.05, 1.5))
BUILDING = jp.Storeys((1.0,), jp.Rod(LAW, 4.0))
GRID = jp.TimeGrid.until(8.0, 0.1)
HILLS = np.exp(-(np.subtract.outer(np.arange(0, 8, 0.1), np.arange(1.0, 6.0)) ** 2))
GROUND = jp.CustomDraw(lambda z: jp.Record(0.15 * HILLS @ z, 0.1, time_unit="1/ω1"), 5)
STRENGTH = "rods.*.material.hysteresis.yield_displacement"


def test_random_strengths_make_a_fragility_by_ductility():
    structures = jp.UncertainStructures(BUILDING, {STRENGTH: jp.LogNormal(0.1, 0.3)})
    scenarios = jp.Scenarios(structures, GROUND)
    study = studied(scenarios, 256, GRID, key=3, keep_parameters=True)
    alone = jp.demand(*scenarios.realize(study.points()[0]), GRID)
    assert study["ductility"][0] == pytest.approx(float(alone.ductility_1), rel=1e-9)
    assert float(alone.ductility) == float(alone.ductility_1)
    np.testing.assert_array_equal(np.isinf(study["first_yield_time_1"]), study["ductility"] < 1)
    curve = study.fragility("pga", demand="ductility", threshold=2.0)
    assert "P(largest ductility ≥ 2 | im)" in str(curve)
    share = study.exceedance("ductility", 2.0).value
    assert 0.2 < share < 0.8
    assert curve.probability(study["pga"]).mean() == pytest.approx(share, abs=0.03)
    assert study.correlations("ductility")[STRENGTH.replace("*", "0")] < 0
    refused("must have a threshold", study.fragility, demand="ductility")


def test_a_rare_ductility_is_as_frequent_as_its_gradients_say():
    scenarios = jp.Scenarios(BUILDING, GROUND)
    options = {"demand": "ductility", "threshold": 14.0, "key": 1, "progress": False}
    by_points = jp.reliability.EventSearch("design points")
    event = jp.rare_event(scenarios, GRID, search=by_points, **options)
    assert event.event == "largest ductility ≥ 14"
    subset = jp.subset_simulation(scenarios, GRID, cov=0.15, **options)
    apart = np.hypot(event.cov, subset.cov) * subset.probability
    assert abs(event.probability - subset.probability) < 3 * apart


def test_ductility_is_a_demand_of_structures_that_yield_only():
    elastic = jp.Storeys((1.0,), jp.Rod(STEEL, 4.0))
    words = "must be of structures with a rod that yields"
    options = {"demand": "ductility", "threshold": 2.0, "progress": False}
    refused(words, jp.rare_event, jp.Scenarios(elastic, GROUND), GRID, **options)

    @jax.jit
    @jax.grad
    def slope_of(law):
        storeys, ground = jp.Storeys((1.0,), jp.Rod(law, 4.0)), jp.Ricker(0.2, [2.0], [2.0])
        return jp.demand(storeys, ground, GRID, only=["ductility_1"]).ductility_1

    slope = slope_of(LAW)
    assert slope.hysteresis.yield_displacement < 0
    assert np.isfinite(slope.zener.order)
