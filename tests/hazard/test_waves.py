"""Records that travel along the supports of a bridge, one suite for all analyses."""

import dataclasses

import jax
import numpy as np
import pytest

import jaxpound as jp
from jaxpound.model.system import without_contact
from tests.hazard.test_ida import LEFT, PAIR, RIGHT, analysed
from tests.pickled import assert_survives_pickling
from tests.refusals import refusals, refused

LAW = jp.KelvinVoigt(stiffness=2e9, restitution=0.65)
JOINTS = [
    jp.FloorLink(0, 0, gap=0.03, contact=LAW),
    jp.FloorLink(1, 0, gap=0.03, contact=LAW, next_building=jp.support(2)),
]
BRIDGE = jp.Buildings((LEFT, RIGHT), JOINTS, supports=(0, 1))
TIMES = 0.02 * np.arange(200)
BURSTS = [0.2 * np.sin(w * TIMES) * np.exp(-((TIMES - 2) ** 2)) for w in (7.0, 9.0, 11.0)]
RECORDS = jp.RecordSuite([jp.Record(burst, 0.02) for burst in BURSTS])
WAVE = {"velocity": 400.0, "distances": (0.0, 80.0, 160.0)}
FORCE = {"demand": "peak_contact_2", "threshold": 8e6}
LADDER = [0.05, 0.1, 0.2, 0.4]


def test_runs_are_those_of_each_record_that_travels():
    analysis = jp.Analysis(BRIDGE, RECORDS, **WAVE, **FORCE)
    grid = analysis.time_grid
    assert grid.duration == pytest.approx(199 * 0.02 + 160.0 / 400.0)  # the last support is reached

    def force(record):
        return float(jp.demand(BRIDGE, jp.travelling(record, **WAVE), grid).links[1].peak_contact)

    ida = jp.incremental_dynamic_analysis(analysis, LADDER, progress=False)
    expected = [[force(x.scaled_to_pga(level)) for level in LADDER] for x in RECORDS]
    np.testing.assert_allclose(ida.demands, expected, rtol=1e-9, atol=1e-3)
    at_capacity = [force(x) for x in RECORDS.scaled(ida.factors)]
    np.testing.assert_allclose(at_capacity, FORCE["threshold"], rtol=1e-2)
    np.testing.assert_array_equal(ida.unscaled, RECORDS.pgas)
    stripes = jp.multiple_stripes(analysis, LADDER, progress=False)
    np.testing.assert_allclose(np.transpose(stripes.demands), ida.demands, rtol=1e-9)
    cloud = jp.cloud_analysis(analysis, progress=False)
    np.testing.assert_allclose(cloud.demand, [force(x) for x in RECORDS], rtol=1e-9)


def test_equal_decks_pound_only_where_the_wave_comes_late():
    """Decks that move alike keep their gap; delayed by half a period they move against each other.

    A velocity that is infinite moves all supports alike, as without a wave.
    """
    equal = jp.Buildings((LEFT, LEFT), (jp.FloorLink(0, 0, gap=0.02),), supports=(0, 1))
    ends = {"records": RECORDS, "distances": (0.0, 180.0)}
    assert abs(analysed(equal, velocity=np.inf, **ends).demands).max() < 1e-12
    late = analysed(equal, velocity=400.0, **ends)
    assert (late.capacities < 0.2).all()
    together = jp.Analysis(BRIDGE, RECORDS).value(1, 0.5)
    assert float(travelling(velocity=np.inf).value(1, 0.5)) == pytest.approx(float(together))
    assert_survives_pickling(late)


@pytest.mark.parametrize("travels", [True, False])
def test_a_mainshock_travels_if_it_is_a_wave(travels):
    mainshock = 0.5 * RECORDS[1]
    mainshock = jp.travelling(mainshock, **WAVE) if travels else mainshock
    yielding = dataclasses.replace(LEFT, hysteresis=jp.Bilinear(0.01))
    bridge = dataclasses.replace(BRIDGE, buildings=(yielding, RIGHT))
    shocks = {"mainshock": mainshock, "rest": 5.0}
    analysis = jp.Analysis(bridge, RECORDS.chosen([0]), **WAVE, **FORCE, **shocks)
    both = jp.sequence([mainshock, 1.5 * jp.travelling(RECORDS[0], **WAVE)], rest=5.0)
    assert analysis.time_grid.duration == pytest.approx(float(both.duration), abs=0.02)
    expected = jp.demand(bridge, both, analysis.time_grid).links[1].peak_contact
    assert float(analysis.value(0, 1.5)) == pytest.approx(float(expected), rel=1e-9)


def test_the_derivative_by_the_velocity_is_that_of_differences():
    grid = jp.TimeGrid.until(4.5, 0.01)

    def closed(velocity):
        return travelling(grid=grid, velocity=velocity).value(0, 1.0)

    def by_itself(velocity):
        wave = jp.travelling(RECORDS[0], velocity, WAVE["distances"])
        return 0.03 - float(jp.demand(without_contact(BRIDGE), wave, grid).min_gap)

    difference = (by_itself(400.1) - by_itself(399.9)) / 0.2
    assert float(jax.grad(closed)(400.0)) == pytest.approx(difference, rel=1e-4)
    refused("grid = None must be a TimeGrid where", jax.grad(lambda v: travelling(velocity=v)), 4.0)


def test_a_store_knows_the_wave(tmp_path):
    stored = {"records": RECORDS, "store": tmp_path / "ida", "progress": False}
    first = analysed(BRIDGE, **WAVE, **stored)
    again = analysed(BRIDGE, **WAVE, **stored)
    np.testing.assert_array_equal(first.capacities, again.capacities)
    slow = WAVE | {"velocity": 300.0}
    refused("velocity is 400.0 there and 300.0 here", analysed, BRIDGE, **slow, **stored)
    refused("velocity is 400.0 there and absent here", analysed, BRIDGE, **stored)


def travelling(structures=BRIDGE, **changed):
    return jp.Analysis(structures, RECORDS, **(WAVE | changed))


test_wrong_waves_are_refused = refusals(
    ({"velocity": None}, "velocity = None must be a real number"),
    ({"distances": None}, "distances = None must be a tuple"),
    ({"velocity": -1.0}, "velocity = -1 must be positive"),
    ({"velocity": 0.5}, r"velocity = 0.5 must be between 1 and 100000 m/s \(200 to 2,000 m/s is"),
    ({"distances": (0.0, -1.0, 2.0)}, r"distances\[1\] = -1 must be finite and not negative"),
    ({"distances": (0.0, 80.0)}, "ground, motions of 2 supports, must be of 3"),
    ({"structures": PAIR}, "ground, motions of 3 supports, must be of 1"),
    ({"mainshock": (RECORDS[0],) * 2, "rest": 1.0}, "ground must be .* each part, not 2 and 3"),
    of=lambda changed: travelling(**changed),
    before="^Analysis: ",
)


def test_a_suite_by_itself_and_doubts_of_a_record():
    refused(
        "of a suite of records it is one, suite.0., or RandomRecord", jp.travelling, RECORDS, **WAVE
    )
    with pytest.warns(jp.PlausibilityWarning, match="the mean acceleration"):
        offset = jp.Record(np.full(200, 0.1), dt=0.02)
    once = "^Analysis: (?!.*the mean .*the mean ).*the mean acceleration"  # of three supports
    refused(once, jp.Analysis, BRIDGE, [offset], **WAVE, strict=True)
