import dataclasses

import jax.numpy as jnp
import pytest

import jaxpound as jp
from tests.pickled import assert_survives_pickling
from tests.refusals import refusals, refused
from tests.study.test_run import GRID, SLIDING
from tests.test_tables import assert_shown


def wave(z):
    """Peaks are |2 + z1 + 0.5 z2 + 0.2 z1 z2| times those of a unit wave: the system is linear."""
    return jp.Ricker(5 + z[0] + 0.5 * z[1] + 0.2 * z[0] * z[1], [2.0], [1.5])


SCENARIOS = jp.Scenarios(SLIDING, jp.CustomDraw(wave, 3, ("one", "two", "none")))


def test_indices_of_a_product_are_its_closed_form():
    """Variance 1 + 0.25 + 0.04, of which the last belongs to both."""
    found = jp.study.sobol_sensitivity(SCENARIOS, GRID, demand="peak_x1", n=2048)
    variance = 1.29
    for name, first, total in (("one", 1.0, 1.04), ("two", 0.25, 0.29), ("none", 0.0, 0.0)):
        assert found.first[name].value == pytest.approx(first / variance, abs=0.02)
        assert found.total[name].value == pytest.approx(total / variance, abs=0.02)
        assert found.first[name].low - 0.02 <= first / variance <= found.first[name].high + 0.02
    assert found.runs == 2048 * 5
    assert_survives_pickling(found)
    shown = assert_shown(found)
    at = shown.index("two")
    assert shown[at + 1 : at + 3] == [str(found.first["two"]), str(found.total["two"])]
    again = jp.study.sobol_sensitivity(SCENARIOS, GRID, demand="peak_x1", n=2048)
    assert again.first == found.first


ARGUMENTS = {"scenarios": SCENARIOS, "grid": GRID, "n": 4}
test_bad_arguments_are_named = refusals(
    ({"n": 1000}, "n = 1000 must be a power of 2"),
    ({"demand": "gap"}, "demand = 'gap' must be one of min_gap, .*, required_gap"),
    ({"demand": "friction_work"}, "friction_work = 0 must vary, but does not"),
    ({"confidence": 2.0}, "confidence = 2 must be between 0 and 1"),
    ({"scenarios": 3}, "scenarios = 3 must be of type ScenarioSet"),
    of=lambda change: jp.study.sobol_sensitivity(**ARGUMENTS | change),
)


def test_scenarios_that_fail_or_are_not_resolved_are_told():
    def structures(z):
        order = jnp.where(z[0] > 0, 2.0, 0.5)
        return dataclasses.replace(SLIDING, rod_1=jp.ZenerRod(order, 0.1, 1.0))

    half = jp.Scenarios(jp.CustomDraw(structures, 2), jp.Ricker(0.3, [2.0], [1.5]))
    refused(r"32 of 64 scenarios fail", jp.study.sobol_sensitivity, half, GRID, n=16)
    coarse, said = jp.TimeGrid(0.4, 10), r"^sobol_sensitivity: ground: 100% of the 4 earthquakes"
    with pytest.warns(jp.PlausibilityWarning, match=said):
        jp.study.sobol_sensitivity(SCENARIOS, coarse, demand="peak_x1", n=4)
    refused(said, jp.study.sobol_sensitivity, SCENARIOS, coarse, demand="peak_x1", n=4, strict=True)
