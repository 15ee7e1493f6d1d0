"""Tuned masses and tuned inerters, in closed form."""

from dataclasses import replace

import numpy as np
import pytest

import jaxpound as jp
from jaxpound.model.places import link_places, mass_places, rod_places
from jaxpound.reliability.instants import series_of
from jaxpound.results.named import over_all
from tests.model.test_isolation import frequencies, matrices
from tests.refusals import refusals, refused

FRAME = jp.ShearBuilding.from_period(3, 300e3, period=0.5, damping_ratio=0.03)
BLOCK = jp.Building(300e3, 4e7)
FREQUENCY = np.sqrt(BLOCK.stiffness / BLOCK.mass)


def peaks_of_block(tuned, inertance=0.0):
    """Peaks of the block's displacement over its static one, by the frequency of a load on it."""
    omega = FREQUENCY * np.linspace(0.7, 1.2, 20_001)[:, None, None]
    (masses, stiffness), top = matrices(tuned), tuned.storeys[1]
    masses[1, 1] += inertance  # to the ground: one mass with that of the top
    way = np.array([[1.0, -1.0], [-1.0, 1.0]]) * float(top.stiffness)
    dashpot = way / float(top.stiffness) * 1j * omega * float(top.dashpot)
    dynamic = stiffness + dashpot - masses * omega**2
    load = np.broadcast_to(np.array([[1.0], [0.0]]), (omega.size, 2, 1))
    amplitude = np.abs(np.linalg.solve(dynamic, load)[:, 0, 0]) * BLOCK.stiffness
    inner = amplitude[1:-1]
    return inner[(inner > amplitude[:-2]) & (inner > amplitude[2:])]


@pytest.mark.parametrize("ratio", [0.02, 0.1])
def test_a_tuned_mass_on_an_undamped_block_leaves_den_hartog_s_equal_peaks(ratio):
    tuned = jp.tuned_mass_damper(BLOCK, ratio)
    top = tuned.storeys[1]
    assert top.mass == pytest.approx(ratio * BLOCK.mass, rel=1e-9)
    frequency = np.sqrt(top.dynamic_stiffness / top.mass)
    assert frequency == pytest.approx(FREQUENCY / (1 + ratio), rel=1e-9)
    # Den Hartog's ratio is over 2 m Ω, Ω being the block's frequency and not that of the mass.
    of_block = top.damping_ratio * frequency / FREQUENCY
    assert of_block == pytest.approx(np.sqrt(3 * ratio / (8 * (1 + ratio) ** 3)), rel=1e-6)
    # He makes the mean of two optima, whose peaks are equal but for 4e-4 at a tenth.
    peaks = peaks_of_block(tuned)
    np.testing.assert_allclose(peaks, np.sqrt(1 + 2 / ratio), rtol=2e-3)
    assert peaks[0] == pytest.approx(peaks[1], rel=5e-4)


def test_a_tuned_mass_is_a_share_of_the_modal_mass_at_the_roof():
    tuned = jp.tuned_mass_damper(FRAME, 0.05, frequency_ratio=0.9, damping_ratio=0.2)
    assert (tuned.storeys[:3], tuned.heights) == (FRAME.storeys, (3.0, 3.0, 3.0, 1.5))
    shape = np.sin((np.arange(3) + 1) * np.pi / 7)  # of equal floors on equal storeys
    modal_mass = 300e3 * np.sum((shape / shape[-1]) ** 2)
    top = tuned.storeys[3]
    assert top.mass == pytest.approx(0.05 * modal_mass, rel=1e-6)
    assert top.natural_period == pytest.approx(0.5 / 0.9, rel=1e-6)
    assert top.damping_ratio == pytest.approx(0.2, rel=1e-6)
    # With hardly any damping the modes are those of the springs.
    light = jp.tuned_mass_damper(BLOCK, 0.1, damping_ratio=1e-6)
    np.testing.assert_allclose(light.modes().frequencies, frequencies(light), rtol=1e-6)


@pytest.mark.parametrize(("ratio", "light"), [(0.05, 1e-6), (0.2, 1e-6), (0.05, 0.04)])
def test_a_tuned_inerter_of_a_block_leaves_the_equal_peaks_of_a_tuned_mass(ratio, light):
    tuned, (link,) = jp.tuned_inerter_damper(BLOCK, ratio, mass_ratio=light)
    assert link.inerter.inertance == pytest.approx(ratio * BLOCK.mass, rel=1e-9)
    assert tuned.storeys[1].mass == pytest.approx(light * BLOCK.mass, rel=1e-9)
    peaks = peaks_of_block(tuned, link.inerter.inertance)
    np.testing.assert_allclose(peaks, np.sqrt(1 + 2 / (ratio + light)), rtol=5e-3)
    buildings = jp.Buildings((tuned,), (link,))
    poles = np.sort(np.abs(jp.modes(buildings).eigenvalues))
    np.testing.assert_allclose(poles, np.sort(np.abs(jp.modes(buildings).frequencies)), rtol=0.05)


@pytest.mark.parametrize(("floor", "near"), [(jp.GROUND, 0.01), (0, 0.06), (1, 0.16)])
def test_a_tuned_inerter_has_the_share_of_the_modal_mass_that_its_floors_move(floor, near):
    """The first mode splits as by a tuned mass, less so where its spring bridges few storeys."""
    tuned, (link,) = jp.tuned_inerter_damper(FRAME, 0.05, floor=floor, number=1)
    shape = np.sin(np.arange(4) * np.pi / 7)  # of the ground and equal floors on equal storeys
    shape /= shape[-1]
    inertance = 0.05 * 300e3 * np.sum(shape**2) / (1 - shape[floor + 1]) ** 2
    assert link.inerter.inertance == pytest.approx(inertance, rel=1e-6)
    assert tuned.storeys[:3] == FRAME.storeys
    assert tuned.storeys[3].mass == pytest.approx(5e-4 * 300e3 * np.sum(shape**2), rel=1e-6)
    ends = {jp.GROUND: "2–ground, floor 4", 0: "in 2, floors 1–4", 1: "in 2, floors 2–4"}
    assert str(link) == ends[floor]
    first = jp.tuned_inerter_damper(FRAME, 0.05, floor=floor)
    periods = jp.modes(jp.Buildings((first[0],), first[1])).periods[:2]
    by_mass = jp.tuned_mass_damper(FRAME, 0.05).modes().periods[:2]
    np.testing.assert_allclose(periods, by_mass, rtol=near)


def test_modes_of_a_tuned_mass_are_close_and_damped_as_the_rods_have_it():
    """Both modes of a dashpot are damped by 11.2 %, of the frequency of their geometric mean."""
    ratio, block = 0.05, jp.Building(1e6, 4e6 * np.pi**2)
    zeta, tuning = np.sqrt(ratio / (1 + ratio)), 1 / (1 + ratio)
    tuned = jp.tuned_mass_damper(block, ratio, frequency_ratio=tuning, damping_ratio=zeta)
    modes = tuned.modes()
    np.testing.assert_allclose(modes.damping_ratios, zeta * np.sqrt(1 + ratio) / 2, rtol=1e-5)
    assert not modes.overdamped.any()
    assert modes.participation.sum() == pytest.approx(1, rel=1e-9)


def test_a_tuned_mass_is_no_storey_anywhere():
    weak = FRAME.yielding(base_shear_coefficient=0.1)
    tuned = jp.tuned_mass_damper(FRAME, 0.002)
    assert (tuned.n_floors, tuned.elevations.tolist()) == (3, [3.0, 6.0, 9.0])
    again = tuned.yielding(base_shear_coefficient=0.1)
    assert repr(again.storeys) == repr((*weak.storeys, tuned.storeys[3]))
    pushed = [jp.pushover(x, ductility=3.0) for x in (again, weak)]
    np.testing.assert_array_equal(pushed[0].drifts, pushed[1].drifts)
    assert repr(tuned.with_p_delta().storeys[3]) == repr(tuned.storeys[3])
    other = jp.ShearBuilding.from_period(4, 300e3, 0.6, 0.03, height=3.0)
    assert [link.floor for link in jp.floor_links((tuned, other), gap=0.1)] == [0, 1, 2]
    # Light as it is, it is no floor whose mass could be in another unit.
    buildings = jp.Buildings((other, tuned), jp.floor_links((other, tuned), gap=0.1))
    topology, system = buildings.system().topology, buildings.system()
    assert topology.tuned == (7,)
    assert mass_places(topology)[6:] == ("floor 3 of building 2", "tuned mass of building 2")
    assert rod_places(topology)[7] == "tuned mass of building 2"
    for name, group in (("peak_drift", "drift"), ("peak_acceleration", "acceleration")):
        words = [series.words for series in series_of(system, name, False)]
        assert len(words) == 14
        assert all(x.startswith(group) and "tuned" not in x for x in words)
    device, links = jp.tuned_inerter_damper(FRAME, 0.05)
    between = link_places(jp.Buildings((device,), links).system().topology)
    assert between == ("1–ground, tuned mass",)
    on_bearings, _ = jp.on_bearings(tuned, jp.LeadRubber(2.5, 0.05), 300e3)
    assert on_bearings.n_floors == 4
    refused("n_tuned = 3 must be a whole number from 0 to 2", replace, FRAME, n_tuned=3)


def test_the_largest_demands_of_floors_leave_out_the_tuned_mass_whose_stroke_is_apart():
    buildings = jp.Buildings((jp.tuned_mass_damper(FRAME, 0.05),))
    shaking = jp.Ricker(0.05, 0.5, 1.0), jp.TimeGrid.until(1.5, dt=0.02)
    response = jp.simulate(buildings, *shaking)
    demand = response.demand
    assert response.topology.tuned == demand.topology.tuned == (3,)
    (floors,) = jp.floor_demands(buildings, demand)
    assert floors.masses == (0, 1, 2)
    largest = over_all(buildings.system(), demand)
    assert largest["peak_drift"] == floors.drift.max() < demand.rods[3].peak_drift
    assert largest["peak_acceleration"] == floors.acceleration.max()
    assert largest["peak_acceleration"] < demand.masses[3].peak_acceleration
    np.testing.assert_array_equal(floors.stroke, [demand.rods[3].peak_drift])
    assert f"tuned mass: stroke {float(floors.stroke[0]):.4g} m" in str(floors)
    assert floors.drift_ratio.shape == (3,)


NOT_POSITIVE = "must be positive and finite"
TOO_SHORT = "period = 0.0005 must be between 0.002 and 60 s"
OF_TYPE = "building = 3.0 must be of type ShearBuilding or Building"
test_bad_tuned_masses_are_refused = refusals(
    (3.0, 0.05, {}, OF_TYPE),
    (FRAME, 0.0, {}, f"mass_ratio = 0 {NOT_POSITIVE}"),
    (FRAME, 0.1, {"frequency_ratio": 0}, f"frequency_ratio = 0 {NOT_POSITIVE}"),
    (FRAME, 0.1, {"damping_ratio": 0}, f"damping_ratio = 0 {NOT_POSITIVE}"),
    (FRAME, 0.1, {"damping_ratio": 2.0}, "damping_ratio = 2 must be between 0 and 1"),
    (FRAME, 0.1, {"frequency_ratio": 1e3}, f"frequency_ratio: {TOO_SHORT}"),
    (FRAME, 1e9, {"frequency_ratio": 1}, "mass_ratio: mass = .* must be between 0.001 and 1e.10"),
    of=lambda building, ratio, more: jp.tuned_mass_damper(building, ratio, **more),
    before="^tuned_mass_damper: ",
)
test_bad_tuned_inerters_are_refused = refusals(
    (FRAME, 0.0, {}, f"inertance_ratio = 0 {NOT_POSITIVE}"),
    (3.0, 0.1, {}, OF_TYPE),
    (FRAME, 0.1, {"floor": 2}, "floor = 2 must be a floor below the roof, from 0 to 1"),
    (FRAME.storeys[0], 0.1, {"floor": 0}, "floor = 0 must be GROUND"),
    (FRAME, 0.1, {"mass_ratio": -1}, f"mass_ratio = -1 {NOT_POSITIVE}"),
    (FRAME, 0.1, {"number": -1}, "number = -1 must be a whole number from 0"),
    of=lambda building, ratio, more: jp.tuned_inerter_damper(building, ratio, **more),
    before="^tuned_inerter_damper: ",
)


def test_an_inerter_has_no_negative_inertance():
    refused("^Inerter: inertance = -1 must be finite and not negative", jp.Inerter, -1.0)
