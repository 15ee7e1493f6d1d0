"""Runs of buildings in SI units, and the grid that a record and their periods set."""

import dataclasses
import re
from functools import partial
from pathlib import Path

import jax
import numpy as np
import pytest

import jaxpound as jp
from jaxpound.plots.explorer import Explorer
from jaxpound.simulation.time_steps import chosen_step, record_grid, time_step
from tests.cli.commands import PULSE
from tests.refusals import refusals, refused
from tests.test_buildings import LEFT, RIGHT

T = 0.02 * np.arange(300)
RECORD = jp.Record(0.3 * np.sin(7 * T) * np.exp(-((T - 3) ** 2)), 0.02, "burst")
DAMPED = {"friction": 200e3, "gap": 0.10}


def pair(left=LEFT, right=RIGHT, gravity=jp.STANDARD_GRAVITY, **between):
    return jp.Buildings((left, right), (jp.FloorLink(0, 0, **DAMPED | between),), gravity)


def assert_is_what_its_parts_are(response, record, friction, gap, contact=None):
    structures, scales = pair(friction=friction, gap=gap, contact=contact).dimensionless()
    grid = scales.grid(record.duration, 0.01)  # half of .02 s: at most .6 s / 50
    parts = scales.to_si(jp.simulate(structures, scales.to_dimensionless(record), grid))
    np.testing.assert_allclose(response.gap, parts.gap, rtol=0, atol=1e-12)


def test_a_run_without_a_grid_is_that_of_the_dimensionless_form():
    response = jp.simulate(pair(), RECORD)
    assert response.si
    assert_is_what_its_parts_are(response, RECORD, **DAMPED)
    np.testing.assert_allclose(response.time, 0.01 * np.arange(599), atol=1e-12)
    pga, order = float(jp.pga(RECORD)), jp.Scheme(order=1)
    assert float(response.demand.pga) == pytest.approx(9.80665 * pga, rel=1e-6)
    options = {"duration": 4.5, "dt": 0.005}
    response = jp.simulate(pair(gravity=9.81), RECORD, scheme=order, **options)
    assert float(response.time[-1]) == pytest.approx(4.5)
    assert response.time.shape == (901,)
    assert "order 1" in response.method
    assert float(response.demand.pga) == pytest.approx(9.81 * pga, rel=1e-6)
    scalars = jp.demand(pair(gravity=9.81), RECORD, None, order, **options)
    assert float(scalars.min_gap) == pytest.approx(float(response.min_gap), rel=1e-12)


def test_of_several_records_the_finest_sets_the_step_and_the_longest_the_duration():
    fine = jp.Record(0.01 * np.sin(np.arange(90)), 0.005, "fine")
    time = jp.simulate(pair(), RECORD + fine).time
    assert float(time[1]) == pytest.approx(0.005)
    assert float(time[-1]) == pytest.approx(float(RECORD.duration))


def test_without_a_record_steps_resolve_wavelets_and_the_duration_is_stated():
    slow = jp.Ricker(0.05, 1.0, 2.0)
    pulse = jp.Pulse(0.1, 1.0, 2.0, time_unit="s")
    for wave, step in ((slow, 0.012), (pulse, 0.012), (slow + jp.Ricker(1e-4, 0.05, 2.0), 0.006)):
        time = jp.simulate(pair(), wave, duration=4.0).time
        assert float(time[1]) == pytest.approx(step, rel=1e-2)
    refused("simulate: duration = None must be stated in s", jp.simulate, pair(), slow)


def test_a_law_of_contact_is_in_si():
    law = jp.KelvinVoigt(stiffness=1e11, restitution=0.65)
    between = {"friction": 0.0, "gap": 0.03, "contact": law}
    record = jp.Record(PULSE, 0.02, "pulse")
    response = jp.simulate(pair(**between), record)
    assert_is_what_its_parts_are(response, record, **between)
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


STEPS = [([0.9, 0.6], 1.0, 0.02, 0.01), ([0.9, 0.6], 1.0, 0.01, 0.01), ([0.5], 1.0, 0.01, 0.01)]
STEPS += [([0.9, 0.6], 1.0, 0.005, 0.005), ([0.9, 0.6], 1.0, np.inf, 0.012)]
STEPS += [([0.9, 0.6], 0.01, 0.02, 0.005)]


@pytest.mark.parametrize(("periods", "limit", "record_dt", "expected"), STEPS)
def test_time_step_follows_from_periods_record_and_stability(periods, limit, record_dt, expected):
    assert time_step(periods, limit, record_dt) == pytest.approx(expected)


def test_the_time_step_of_a_row_counts_stiff_dampers_and_inertances():
    damper = jp.Rod(jp.PowerLaw(8e5, 0.3), 2e10)
    row = [jp.ShearBuilding((building,)) for building in (LEFT, RIGHT)]
    light, links = jp.tuned_inerter_damper(row[0], 0.05, mass_ratio=1e-6)
    steps = []
    for case in ((row, (jp.FloorLink(0, 0, damper=damper),)), ((light,), links)):
        with pytest.warns(jp.PlausibilityWarning) as caught:
            steps.append(jp.simulate(jp.Buildings(*case), RECORD, duration=0.3).time[1])
        words = " ".join(str(warning.message) for warning in caught)
        assert "after the end of the run" in words
        assert ("the damper of link 1–2, floor 1: dt is " in words) == (len(steps) == 1)
    limit = 2 / np.sqrt(2e10 * (1 / 500e3 + 1 / 400e3))
    assert limit / 3 < steps[0] < limit / 2
    assert steps[1] == pytest.approx(0.01)


def test_a_step_above_the_limit_is_refused_with_the_part_that_sets_it_in_both_units():
    viscous = jp.Building.from_period(500e3, 0.9, 0.05, order=1, tau_f=1e-6)
    structures, scales = pair(viscous).dimensionless()
    tau_f, grid = 1e-6 / float(scales.time), jp.TimeGrid(0.01, 100)
    says = r"must be positive and below the stability limit \S+ of these .*, set by building 1"
    stiff = f"{says}, which its small tau_f = 1e-06 s makes .* times as stiff as at rest: a larger"
    for run, *args in (
        (partial(jp.simulate, dt=0.01), pair(viscous), RECORD),
        (jp.demand, pair(viscous), RECORD, grid),
    ):
        refused(stiff.replace(r"\S+", r"\S+ s"), run, *args)
    once = stiff.replace("1e-06 s", f"{tau_f:.4g}")
    refused(once, jp.demand, structures, jp.paper.ground(), scales.grid(1.0, 0.01))


def test_many_steps_because_of_a_small_relaxation_time_are_no_longer_silent():
    """The steps and what asks for them; not by default, nor where the storeys' number does."""
    low = partial(jp.ShearBuilding.from_period, 5, 3e5, 0.55, 0.05, 1)
    high = jp.ShearBuilding.from_period(8, 3e5, 1.1, 0.05, 1, 1e-3)
    options = jp.Scheme(), [RECORD]
    buildings = jp.Buildings((high, low(1e-6)))
    says = (
        r"dt: 43,355 steps of 0\.000138 s are taken, 72 times as many as periods and record need, "
    )
    says += (
        r"because of storey 2 of building 2, which its small tau_f = 1e-06 s makes .* a larger one"
    )
    with pytest.warns(jp.PlausibilityWarning, match=says):
        assert record_grid(buildings, *options).n_steps == 43355
    refused(says, partial(record_grid, strict=True), buildings, *options)
    assert record_grid(jp.Buildings((high, low())), *options)
    tower = jp.Buildings((jp.ShearBuilding.from_period(50, 3e5, 5.0, 0.05, 1),))
    assert chosen_step(tower, jp.Scheme(), 10.0) < 5.0 / 50 / 20


def test_the_part_that_sets_the_limit_is_a_storey_a_building_or_the_damper_of_a_link():
    high, low = (jp.ShearBuilding.from_period(n, 3e5, n / 6, 0.05) for n in (3, 2))

    def row(links, dt):
        jp.simulate(jp.Buildings((high, low), links), RECORD, dt=dt)

    (first, second), stiff = jp.floor_links((high, low), gap=0.05), jp.PowerLaw(1e6, 1.0, 1.0)
    braced = dataclasses.replace(second, damper=jp.Rod(stiff, 1e11))
    elastic = jp.Building(4e5, 1e7, order=1.0, tau_f=0.1, tau_x=0.1)
    other = dataclasses.replace(elastic, stiffness=1e6)
    for part, run in (
        ("storey 2 of building 2", partial(row, links=(first, second), dt=0.3)),
        ("the damper of link 1–2, floor 2", partial(row, links=(first, braced), dt=0.02)),
        ("building 2", partial(jp.simulate, pair(other, elastic), RECORD, dt=0.5)),
    ):
        refused(rf"^simulate: dt = \S+ s must .* of these structures, set by {part}$", run)


LIMIT = r"dt = 1 s must be positive and below the stability limit .* s of these str"
ROW = jp.ShearBuilding((LEFT,))
STRUCTURES, SCALES = jp.paper.structures(), pair().scales
STANDARD = {"structures": pair(), "ground": RECORD}
FIXED = r"must be None, since the grid has it"
test_bad_arguments_are_named_in_si = pytest.mark.unchecked(
    refusals(
        ({"dt": 1.0}, LIMIT),
        ({"dt": 0.0}, "dt = 0 s must be positive"),
        ({"dt": 0.03}, r"dt = 0\.03 s must be at most the record's, 0\.02 s: samples would be"),
        ({"dt": "a"}, "dt = 'a' must be a real number"),
        ({"duration": 0.001}, r"duration = 0\.001 s must be between 2 and 1,000,000 steps"),
        ({"duration": 3600.0, "dt": 1e-3}, "duration = 3600 s must be between 2"),
        ({"duration": 4000}, "duration = 4000 s must be between 0.001 and 3600 s .at most an hour"),
        ({"scheme": 2}, "scheme = 2 must be of type Scheme"),
        ({"grid": 0.01}, "grid = 0.01 must be of type TimeGrid"),
        ({"grid": jp.TimeGrid(0.01, 100), "dt": 0.01}, f"dt = 0.01 {FIXED}"),
        ({"grid": jp.TimeGrid(0.01, 100), "duration": 1.0}, f"duration = 1.0 {FIXED}"),
        ({"structures": STRUCTURES}, "grid = None must be a TimeGrid: it is chosen for Buildings"),
        ({"structures": ROW}, r"structures = .*; Buildings\(\(left, right\), links\) makes"),
        of=lambda changes: jp.simulate(**STANDARD | changes),
        before="^simulate: ",
    )
)

OF_LINK = r"link 1–2[^:]*: "
MOVES = "gap = 5 m should be at most 5 times what the buildings move at an acceleration of 1"
SOFT = r"stiffness = 10 N/m makes a contact last about 4\.7e"
DEEP = r": the penetration, 0\.\d+ m, should be at most 0\.25 "


def test_implausible_input_is_told_in_si():
    soft = {"friction": 0.0, "gap": 0.0, "contact": jp.KelvinVoigt(10.0, 0.65)}
    for record, changes, *messages in (
        (RECORD.scaled_to_pga(7.0), {}, "simulate: ground: PGA = 7 g should be at most 2 g"),
        (RECORD, {"gap": 5.0}, f"Buildings: {OF_LINK}{MOVES}"),
        (RECORD, soft, f"Buildings: {OF_LINK}{SOFT}", f"simulate: link 1–2[^:]*{DEEP}"),
    ):
        with pytest.warns(jp.PlausibilityWarning) as warned:
            jp.simulate(buildings := pair(**changes), record)
        assert [warning.filename for warning in warned] == [__file__] * len(messages)
        for words, warning in zip(messages, warned, strict=True):
            assert re.match(words, str(warning.message))
        says = re.sub("Buildings: ", "simulate: ", messages[0])
        refused(f"^{says}", jp.simulate, buildings, record, strict=True)


GRID = jp.TimeGrid(0.1, 40)
SHAKING = SCALES.to_dimensionless(RECORD)
WAVE = jp.Ricker(0.1, 2.0, 1.0)
SPACE = jp.DesignSpace(STRUCTURES, {"friction": (0.01, 1.0)})
UNCERTAIN = jp.UncertainStructures(STRUCTURES, {"friction": jp.LogNormal(0.1, 0.2)})
CALLS = (
    lambda ground: jp.simulate(STRUCTURES, ground, GRID),
    lambda ground: jp.demand(STRUCTURES, ground, GRID),
    lambda ground: jax.grad(lambda s: jp.demand(s, ground, GRID).min_gap)(STRUCTURES),
    lambda ground: jp.design.calibrate(SPACE, {"x1": np.zeros(41)}, ground, GRID),
    lambda ground: jp.Scenarios(UNCERTAIN, ground),
    lambda ground: jp.monte_carlo(scaled(ground), 8, GRID),
)


def scaled(ground):
    return jp.Scenarios(STRUCTURES, jp.CustomDraw(lambda z: z[0] * ground, 1))


def design(grounds):
    jp.design_damper(SPACE, jp.Ensemble.of(grounds, GRID), GRID, progress=False)


SAYS = r"must be in units of 1/ω1.*scales\.to_dimensionless makes.*Buildings takes it"
IN_SECONDS = (lambda t: 0.0 * t) + RECORD
test_dimensionless_structures_refuse_a_record_in_seconds = refusals(
    *(
        (call, ground, rf"Record\(.*{SAYS}")
        for call in CALLS
        for ground in (RECORD, 2 * RECORD, WAVE + 0.5 * RECORD, IN_SECONDS)
    ),
    *(
        (design, grounds, "design_damper: ensemble = .* in units of 1/ω1")
        for grounds in ([RECORD], [WAVE, 2 * RECORD], [IN_SECONDS])
    ),
)

OF_FILES = r"ground = .*'mine.at2'.* must have acceleration\(t\).*; read_record reads one"
MEANT = "must be in seconds, but is in"
MAKES = r"structures = .*; Buildings\(\(left, right\), links\) makes structures of them"
test_a_wrong_object_is_told_which_function_wants_it = pytest.mark.unchecked(
    refusals(
        (jp.simulate, LEFT, WAVE, GRID, f"simulate: {MAKES}"),
        (jp.demand, (LEFT, RIGHT), WAVE, GRID, f"demand: {MAKES}"),
        (jp.demand, ROW, WAVE, GRID, f"demand: {MAKES}"),
        (jp.simulate, STRUCTURES, Path("mine.at2"), GRID, OF_FILES),
    )
)
FOLLOWS = (
    "must be a TimeGrid: it follows from buildings, a record's dt, wavelets and rests, of which"
)
BURST = r"Record\('burst'.*"
SAME_UNIT = rf"^RandomRecord: records\[1\] = {BURST} the same unit of time"
DEMAND = jax.jit(lambda record: jp.demand(STRUCTURES, record, GRID).min_gap)
GRADIENT = jax.grad(lambda gap: jp.simulate(pair(gap=gap), RECORD).min_gap)
test_a_wrong_unit_of_time_and_traced_buildings_are_refused = refusals(
    (jp.Ensemble.of, [RECORD, SHAKING], GRID, "Ensemble.of: grounds must be in one unit of time"),
    (DEMAND, RECORD, r"Record\(\(300,\) samples, time in s\) must be in units of 1/ω1"),
    (jp.RandomRecord, (SHAKING, RECORD), SAME_UNIT),
    (Explorer, STRUCTURES, RECORD, GRID, f"^Explorer: ground = {BURST} in units of 1/ω1"),
    (GRADIENT, 0.1, f"^simulate: grid = None {FOLLOWS}"),
    (jax.grad(lambda a: jp.demand(pair(), a * WAVE, duration=4.0).min_gap), 0.1, FOLLOWS),
    (SCALES.to_dimensionless, SHAKING, f"record = {BURST}{MEANT}"),
    (
        jp.simulate,
        pair(),
        SHAKING,
        f"^simulate: ground = {BURST} must be in seconds, as Buildings are",
    ),
)
