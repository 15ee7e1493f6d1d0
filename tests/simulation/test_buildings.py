"""Buildings and a record in SI units: the run of the dimensionless system, in one call."""

import dataclasses
from contextlib import nullcontext
from pathlib import Path

import jax
import numpy as np
import pytest

import jaxpound as jp
from jaxpound.simulation.buildings import time_step
from tests.cli.commands import PULSE

LEFT = jp.Building.from_period(mass=500e3, period=0.9, damping_ratio=0.05)
RIGHT = jp.Building.from_period(mass=400e3, period=0.6, damping_ratio=0.05)
T = 0.02 * np.arange(300)
RECORD = jp.Record(0.3 * np.sin(7 * T) * np.exp(-((T - 3) ** 2)), 0.02, "burst")
DAMPED = {"friction_force": 200e3, "gap": 0.10}


def test_one_call_is_what_its_parts_are():
    response = jp.simulate_buildings(LEFT, RIGHT, RECORD, **DAMPED)
    structures, scales = jp.dimensionless(LEFT, RIGHT, **DAMPED)
    grid = scales.grid(RECORD.duration, 0.01)  # half of .02 s: at most .6 s / 50
    parts = scales.to_si(jp.simulate(structures, scales.to_dimensionless(RECORD), grid))
    assert response.si
    np.testing.assert_allclose(response.time, 0.01 * np.arange(599), atol=1e-12)
    np.testing.assert_allclose(response.gap, parts.gap, atol=1e-12)
    assert float(response.demand.pga) == pytest.approx(9.80665 * float(jp.pga(RECORD)), rel=1e-6)


def test_a_law_of_contact_is_in_si():
    law = jp.KelvinVoigt(stiffness=1e11, restitution=0.65)
    pair = {"friction_force": 0.0, "gap": 0.03}
    record = jp.Record(PULSE, 0.02, "pulse")
    response = jp.simulate_buildings(LEFT, RIGHT, record, **pair, contact=law)
    structures, scales = jp.dimensionless(LEFT, RIGHT, **pair, contact=law)
    grid = scales.grid(record.duration, 0.01)
    parts = scales.to_si(jp.simulate(structures, scales.to_dimensionless(record), grid))
    np.testing.assert_allclose(response.gap, parts.gap, rtol=0, atol=1e-12)
    # So stiff a contact is short, and the blocks are alone with it. Spring and dashpot cancel after
    # (π − 2 φ)/ω_d, where ξ = sin φ; freely at .675 times the speed of the touch, the blocks have
    # parted another 2 ξ/ω later.
    first, mass = response.impacts()[0], 1 / (1 / 500e3 + 1 / 400e3)
    ratio = first.rebound_velocity / first.approach_velocity
    assert ratio == pytest.approx(0.675, rel=1e-2)
    change = first.approach_velocity + first.rebound_velocity
    assert first.impulse == pytest.approx(mass * change, rel=1e-2)
    phi, omega = np.arcsin(float(law.damping_ratio)), np.sqrt(law.stiffness / mass)
    lasts = (np.pi - 2 * phi) / (omega * np.cos(phi)) + 2 * np.sin(phi) / omega
    assert first.end - first.time == pytest.approx(lasts, rel=1e-2)


def test_a_law_of_contact_may_be_traced():
    def gap(stiffness):
        law = jp.KelvinVoigt(stiffness, 0.65)
        return jp.simulate_buildings(LEFT, RIGHT, RECORD, **DAMPED, contact=law).min_gap

    assert jax.eval_shape(gap, 1e9).shape == ()


def test_step_duration_scheme_and_gravity_may_be_chosen():
    scheme = jp.Scheme(order=1)
    response = jp.simulate_buildings(
        LEFT, RIGHT, RECORD, **DAMPED, duration=4.5, dt=0.005, scheme=scheme, gravity=9.81
    )
    assert float(response.time[-1]) == pytest.approx(4.5)
    assert response.time.shape == (901,)
    assert "order 1" in response.method
    assert float(response.demand.pga) == pytest.approx(9.81 * float(jp.pga(RECORD)), rel=1e-6)


@pytest.mark.parametrize(
    ("periods", "limit", "record_dt", "expected"),
    [
        ([0.9, 0.6], 1.0, 0.02, 0.01),
        ([0.9, 0.6], 1.0, 0.01, 0.01),
        ([0.9, 0.6], 1.0, 0.005, 0.005),
        ([0.9, 0.6], 1.0, np.inf, 0.012),
        ([0.9, 0.6], 0.01, 0.02, 0.005),
        ([0.5], 1.0, 0.01, 0.01),
    ],
)
def test_time_step_follows_from_periods_record_and_stability(periods, limit, record_dt, expected):
    assert time_step(periods, limit, record_dt) == pytest.approx(expected)


def test_slip_force_and_gap_may_be_traced():
    def gap(friction_force, gap):
        call = {"friction_force": friction_force, "gap": gap}
        return jp.simulate_buildings(LEFT, RIGHT, RECORD, **call, strict=True).min_gap

    by_force, by_gap = jax.grad(gap, argnums=(0, 1))(200e3, 0.1)
    change = 50.0
    difference = (gap(200e3 + change, 0.1) - gap(200e3 - change, 0.1)) / (2 * change)
    assert float(by_force) == pytest.approx(float(difference), rel=1e-3)
    assert float(by_gap) == pytest.approx(1.0)


@pytest.mark.unchecked
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"dt": 1.0},
            r"dt = 1 s must be positive and below the stability limit .* s of these buil",
        ),
        ({"dt": 0.0}, "dt = 0 s must be positive"),
        ({"dt": 0.03}, r"dt = 0\.03 s must be at most the record's, 0\.02 s: samples would be"),
        ({"dt": "a"}, "dt = 'a' must be a real number"),
        ({"duration": 0.001}, r"duration = 0\.001 s must be between 2 and 1,000,000 steps"),
        ({"duration": 3600.0, "dt": 1e-3}, "duration = 3600 s must be between 2"),
        (
            {"duration": 4000},
            "duration = 4000 s must be between 0.001 and 3600 s .at most an hour",
        ),
        ({"record": jp.Ricker(1, 1, 1)}, "record = .* must be of type Record"),
        ({"scheme": 2}, "scheme = 2 must be of type Scheme"),
        (
            {"building_2": jp.Building(4e5, [1e7, 2e7], 0.5, 0.1, 0.2)},
            r"building_2 of shape \(2,\)",
        ),
        (
            {"building_1": jp.Building([4e5, 5e5], 1e7, 0.5, 0.1, 0.2)},  # of which the units are
            r"building_1 of shape \(2,\) must be one building",
        ),
    ],
)
def test_bad_arguments_are_named_in_si(changes, message):
    call = {"building_1": LEFT, "building_2": RIGHT, "record": RECORD, **DAMPED} | changes
    with pytest.raises(ValueError, match=f"^simulate_buildings: {message}"):
        jp.simulate_buildings(**call)


def test_traced_buildings_are_refused():
    def gap(building):
        return jp.simulate_buildings(building, RIGHT, RECORD, **DAMPED).min_gap

    with pytest.raises(ValueError, match=r"^simulate_buildings: buildings and record\.dt must be"):
        jax.grad(gap)(LEFT)


def test_implausible_input_is_told_in_si():
    for record, gap, message in (
        (RECORD.scaled_to_pga(7.0), 0.1, r"record: PGA = 7 g should be at most 5 g"),
        (
            RECORD,
            5.0,
            r"gap = 5 m should be at most 5 times what the buildings move at an acceleration of 1",
        ),
    ):
        call = LEFT, RIGHT, record
        with pytest.warns(jp.PlausibilityWarning, match=f"^simulate_buildings: {message}") as told:
            jp.simulate_buildings(*call, friction_force=200e3, gap=gap)
        assert [one.filename for one in told] == [__file__]
        with pytest.raises(ValueError, match=f"^simulate_buildings: {message}"):
            jp.simulate_buildings(*call, friction_force=200e3, gap=gap, strict=True)


def test_a_contact_that_hardly_acts_is_told():
    call = {"friction_force": 0.0, "gap": 0.0, "contact": jp.KelvinVoigt(10.0, 0.65)}
    soft = r"^simulate_buildings: contact: stiffness = 10 N/m makes a contact last about 4\.7e"
    deep = r"^simulate_buildings: contact: the penetration, 0\.\d+ m, should be at most 0\.25 "
    with (
        pytest.warns(jp.PlausibilityWarning, match=deep),
        pytest.warns(jp.PlausibilityWarning, match=soft),
    ):
        jp.simulate_buildings(LEFT, RIGHT, RECORD, **call)
    with pytest.raises(ValueError, match=soft):
        jp.simulate_buildings(LEFT, RIGHT, RECORD, **call, strict=True)


# A record in seconds.


STRUCTURES, SCALES = jp.dimensionless(LEFT, RIGHT, **DAMPED)
GRID = jp.TimeGrid(0.1, 40)
SHAKING = SCALES.to_dimensionless(RECORD)
WAVE = jp.Ricker(0.1, 2.0, 1.0)
CALLS = {
    "simulate": lambda ground: jp.simulate(STRUCTURES, ground, GRID),
    "demand": lambda ground: jp.demand(STRUCTURES, ground, GRID),
    "traced": lambda ground: jax.grad(lambda s: jp.demand(s, ground, GRID).min_gap)(STRUCTURES),
    "calibrate": lambda ground: jp.calibrate(
        jp.DesignSpace(STRUCTURES, {"friction": (0.01, 1.0)}), {"x1": np.zeros(41)}, ground, GRID
    ),
    "Scenarios": lambda ground: jp.Scenarios(
        jp.UncertainStructures(STRUCTURES, {"friction": jp.LogNormal(0.1, 0.2)}), ground
    ),
    "monte_carlo": lambda ground: jp.monte_carlo(
        jp.Scenarios(STRUCTURES, jp.CustomDraw(lambda z: z[0] * ground, 1)), 8, GRID
    ),
}


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_dimensionless_structures_refuse_a_record_in_seconds(call):
    says = r"Record\(.*must be in units of 1/ω1.*scales\.to_dimensionless makes.*Buildings takes it"
    for ground in (RECORD, 2 * RECORD, WAVE + 0.5 * RECORD, (lambda t: 0.0 * t) + RECORD):
        with pytest.raises(ValueError, match=says):
            call(ground)


def test_a_design_of_dimensionless_structures_refuses_records_in_seconds():
    space = jp.DesignSpace(STRUCTURES, {"friction": (0.01, 1.0)})
    for grounds in ([RECORD], [WAVE, 2 * RECORD], [(lambda t: 0.0 * t) + RECORD]):
        ensemble = jp.Ensemble.of(grounds, GRID)
        with pytest.raises(ValueError, match=r"design_damper: ensemble: .* in units of 1/ω1"):
            jp.design_damper(space, ensemble, GRID, progress=False)
    with pytest.raises(ValueError, match="Ensemble: grounds must be in one unit of time"):
        jp.Ensemble.of([RECORD, SHAKING], GRID)


def test_records_keep_their_unit_where_they_are_traced():
    says = r"Record\(\(300,\) samples, time in s\) must be in units of 1/ω1"
    with pytest.raises(ValueError, match=says):
        jax.jit(lambda record: jp.demand(STRUCTURES, record, GRID).min_gap)(RECORD)


def test_an_si_run_chooses_its_step_in_a_traced_function_too():
    def min_gap(force):
        run = jp.simulate_buildings(LEFT, RIGHT, RECORD, friction_force=force, gap=0.1)
        return run.min_gap

    force = 2e5
    assert float(jax.jit(min_gap)(force)) == pytest.approx(float(min_gap(force)), rel=1e-12)
    slope = float(jax.jit(jax.grad(min_gap))(force))
    difference = (min_gap(force + 10) - min_gap(force - 10)) / 20
    assert slope == pytest.approx(float(difference), rel=1e-3)


def test_random_records_and_the_explorer_refuse_seconds():
    from jaxpound.plots.explorer import Explorer

    with pytest.raises(
        ValueError, match=r"^RandomRecord: records\[1\] = Record\('burst'.* the same unit of time"
    ):
        jp.RandomRecord((SHAKING, RECORD))
    with pytest.raises(ValueError, match=r"^Explorer: ground: Record\('burst'.* in units of 1/ω1"):
        Explorer(STRUCTURES, RECORD, GRID)


def test_a_dimensionless_record_is_refused_where_seconds_are_meant():
    with pytest.raises(
        ValueError, match=r"record = Record\('burst'.*must be in seconds, but is in"
    ):
        SCALES.to_dimensionless(SHAKING)
    with pytest.raises(ValueError, match="must be in seconds, but is in units of 1/ω1 already"):
        jp.simulate_buildings(LEFT, RIGHT, SHAKING, **DAMPED)


@pytest.mark.unchecked
@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: jp.simulate(LEFT, WAVE, GRID),
            "simulate: structures = .*; simulate_buildings",
        ),
        (
            lambda: jp.demand((LEFT, RIGHT), WAVE, GRID),
            "demand: structures = .*; simulate_bui",
        ),
        (
            lambda: jp.demand(jp.ShearBuilding((LEFT,)), WAVE, GRID),
            r"demand: structures = .*; simulate_row takes them, and Buildings\(\(left, right\)",
        ),
        (
            lambda: jp.simulate_buildings(jp.ShearBuilding((LEFT,)), RIGHT, RECORD, **DAMPED),
            "building_1 = .* must be of type Building; simulate_row takes them",
        ),
        (
            lambda: jp.simulate_buildings(STRUCTURES, RIGHT, RECORD, **DAMPED),
            "building_1 = .*; simulate and demand take dimensionless structures",
        ),
        (
            lambda: jp.simulate_buildings(LEFT, RIGHT, "mine.at2", **DAMPED),
            "record = 'mine.at2' must be of type Record; read_record reads one from a file",
        ),
        (
            lambda: jp.simulate(STRUCTURES, Path("mine.at2"), GRID),
            r"ground = .*'mine.at2'.* must have acceleration\(t\).*; read_record reads one",
        ),
    ],
)
def test_a_wrong_object_is_told_which_function_wants_it(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.parametrize("name", ["friction_force", "gap", "gravity"])
def test_an_array_for_a_number_is_refused_at_once(name):
    call = DAMPED | {name: np.array([0.1, 0.2])}
    says = rf"^simulate_buildings: {name} of shape \(2,\) must be one number: a sweep is jax\.vmap"
    with pytest.raises(ValueError, match=says):
        jp.simulate_buildings(LEFT, RIGHT, RECORD, **call)


def test_contact_in_single_precision_is_told_of():
    touching = dataclasses.replace(STRUCTURES, contact=jp.KelvinVoigt(400.0, 0.65))
    with jax.enable_x64(False):
        for structures in (touching, STRUCTURES):
            told = nullcontext()
            if structures is touching:
                told = pytest.raises(ValueError, match=r"^demand: contact is run in float32")
            with told:
                jp.demand(structures, WAVE, GRID, strict=True)
