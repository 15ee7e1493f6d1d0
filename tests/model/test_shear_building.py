"""Buildings of several storeys in SI units, and their modes."""

import jax
import numpy as np
import pytest

import jaxpound as jp
from jaxpound import FloorLink, ShearBuilding
from tests import linear
from tests.refusals import refusals


def test_the_first_mode_has_the_period_and_damping_asked_for_and_one_storey_is_a_building():
    for taper in (1.0, 0.4):
        building = ShearBuilding.from_period(6, 2e5, 0.8, 0.04, order=0.4, taper=taper)
        modes = building.modes()
        assert modes.periods[0] == pytest.approx(0.8, rel=1e-9)
        assert modes.damping_ratios[0] == pytest.approx(0.04, rel=1e-7)
        stiffnesses = np.array([storey.stiffness for storey in building.storeys])
        np.testing.assert_allclose(np.diff(stiffnesses, 2) / stiffnesses[0], 0, atol=1e-12)
        assert stiffnesses[-1] == pytest.approx(taper * stiffnesses[0])
    storey = ShearBuilding.from_period(1, 5e5, 0.9, 0.05).storeys[0]
    block = jp.Building.from_period(5e5, 0.9, 0.05)
    numbers = [[*vars(x).values()][:5] for x in (storey, block)]
    assert numbers[0] == pytest.approx(numbers[1], rel=1e-14)
    modes = ShearBuilding((block,)).modes()
    assert "frequency (rad/s)  period (s)" in str(modes)
    assert modes.periods[0] == pytest.approx(float(block.natural_period), rel=1e-10)
    assert modes.damping_ratios[0] == pytest.approx(float(block.damping_ratio), rel=1e-8)


def test_free_vibrations_are_those_of_spectra_and_of_textbooks_wherever_damping_sits():
    for orders in ((1.0, 1.0, 1.0), (0.5, 0.7, 0.5)):
        laws = [jp.ZenerRod(order, 0.02, 0.08) for order in orders]
        building = jp.Storeys((1.0, 0.9, 0.7), tuple(map(jp.Rod, laws, (10.0, 9.0, 8.0))))
        known = linear.vibrations(building.system())
        found = jp.modes(building).eigenvalues
        np.testing.assert_allclose(found, known, rtol=1e-10 if orders[0] == 1 else 2e-4)
    # ω_j = 2 √(k/m) sin((2j − 1)π/(4n + 2)) and ζ_j = c ω_j / (2 k) (τ_f is not quite 0).
    n, c = 5, 0.01
    law = jp.ZenerRod(1.0, 1e-9, c)
    modes = jp.modes(jp.Storeys((1.0,) * n, jp.Rod(law, 100.0)))
    omega = 20 * np.sin((2 * np.arange(n) + 1) * np.pi / (4 * n + 2))
    np.testing.assert_allclose(modes.frequencies, omega, rtol=1e-6)
    np.testing.assert_allclose(modes.damping_ratios, c * omega / 2, rtol=1e-6)
    np.testing.assert_allclose(np.abs(modes.eigenvalues), omega, rtol=1e-6)
    shares = -modes.eigenvalues.real / np.abs(modes.eigenvalues)
    np.testing.assert_allclose(shares, c * omega / 2, rtol=1e-6)
    assert modes.participation.sum() == pytest.approx(1, rel=1e-9)
    shape = np.sin((np.arange(n) + 1) * np.pi / (2 * n + 1))
    np.testing.assert_allclose(modes.shapes[:, 0].real, shape / shape.max(), rtol=1e-6)
    assert "frequency (ω1)  period (1/ω1)" in str(modes)
    # The real part of an eigenvalue is then below that of the stiffness alone.
    elastic, damped = (jp.ZenerRod(1.0, 1e-9, tau) for tau in (1e-6, 0.2))
    rods = [jp.Rod(damped if i == 1 else elastic, 1.0) for i in range(5)]
    modes = jp.modes(jp.Storeys((1.0,) * 5, tuple(rods)))
    way = np.eye(5) - np.eye(5, k=-1)
    for j, omega in enumerate(modes.frequencies):
        moduli = [rod.material.complex_modulus(omega) for rod in rods]
        values = np.linalg.eigvals(way.T @ np.diag(np.array(moduli)) @ way)
        value = values[np.argsort(values.real)[j]]
        assert value.real == pytest.approx(omega**2, rel=1e-9)
        assert modes.damping_ratios[j] == pytest.approx(value.imag / value.real / 2, rel=1e-7)


def test_a_mode_that_only_creeps_has_no_free_vibration():
    """The building is simulated all the same; its first period is what the time step follows."""
    numbers = [1e5, 1e5], [1.4e7, 4.8e7], [0.6, 1.0], 1e-5, [0.05, 0.0732]
    building = ShearBuilding.of_storeys(*numbers)
    modes = building.modes()
    assert modes.damping_ratios[1] > 1
    assert np.isnan(modes.eigenvalues).tolist() == [False, True]
    assert building.natural_period == pytest.approx(modes.periods[0], rel=1e-12)
    # A building is differentiated by its masses and rods, whatever its heights.
    low = ShearBuilding.from_period(2, 1e5, 0.3, 0.05)
    link = FloorLink(0, 1, gap=0.1)

    def top(building):
        return jp.dimensionless_row((building, low), (link,))[0].buildings[0].masses[1]

    slopes = jax.grad(top)(low)
    assert slopes.storeys[1].mass == pytest.approx(1e-5)
    assert slopes.heights == low.heights


def test_published_buildings_and_si_units():
    """Chopra's frame: T = 2 s; its higher periods are shorter by the rods' stiffening."""
    periods = ShearBuilding.published("chopra-5").modes().periods
    assert periods[0] == pytest.approx(2.0, rel=1e-3)
    assert (periods[1:] < [0.6852, 0.4346, 0.3383, 0.2966]).all()
    for name, period in (("jankowski-left", 1.2), ("jankowski-right", 0.3)):
        building = ShearBuilding.published(name)
        assert building.modes().periods[0] == pytest.approx(period, rel=1e-3)
    left = ShearBuilding.from_period(2, 3e5, 0.4, 0.05)
    right = jp.Building.from_period(4e5, 0.5, 0.05)
    law = jp.KelvinVoigt(5e9, 0.65)
    link = FloorLink(0, 1, next_floor=0, friction=5e4, gap=0.03, contact=law)
    row, scales = jp.dimensionless_row((left, right), (link,))
    assert row.buildings[0].masses[0] == row.buildings[0].rods[0].stiffness == 1.0
    assert row.links[0].friction * scales.force == pytest.approx(5e4)
    assert row.links[0].gap * scales.length == pytest.approx(0.03)
    assert scales.contact_to_si(row.links[0].contact).stiffness == pytest.approx(5e9)
    frequencies = np.array(row.natural_frequencies) * float(scales.frequency)
    np.testing.assert_allclose(2 * np.pi / frequencies, [0.4, 0.5], rtol=1e-9)
    # Two blocks are those of ``dimensionless``.
    pair, other = jp.dimensionless(right, left.storeys[0], 5e4, 0.03)
    link = FloorLink(0, 0, friction=5e4, gap=0.03)
    blocks, same = jp.dimensionless_row((right, left.storeys[0]), (link,))
    assert vars(other) == vars(same)
    one, two = pair.system(), blocks.system()
    np.testing.assert_allclose(one.masses, two.masses, rtol=1e-14)
    for a, b in zip(one.rods, two.rods, strict=True):
        assert b.stiffness == pytest.approx(a.stiffness, rel=1e-14)
        assert vars(a.material) == pytest.approx(vars(b.material), rel=1e-14)


LOW = ShearBuilding.from_period(2, 1e5, 0.3, 0.05)
SHIFTED = ShearBuilding(LOW.storeys, (4.0, 3.0))
BY_PERIOD, OF_STOREYS = ShearBuilding.from_period, ShearBuilding.of_storeys
ROW, ROD, HIGH, OWNER = jp.dimensionless_row, (0.5, 0.1, 0.2), (FloorLink(0, 2),), "ShearBuilding."
test_bad_input = refusals(
    (lambda: ShearBuilding(()), r"storeys = \(\) must hold at least one storey"),
    (lambda: ShearBuilding(LOW.storeys, (3.0,)), "heights, 1 of them, must be 2, as storeys"),
    (lambda: ShearBuilding(LOW.storeys, -3.0), "heights.0 = -3 must be positive"),
    (OF_STOREYS, [1, 2], [1] * 3, *ROD, "stiffnesses, 3 of them, must be 2, as masses, or one"),
    (OF_STOREYS, [1.0, -2.0], 1.0, *ROD, "of_storeys: storeys.1: mass = -2 must be positive"),
    (BY_PERIOD, 0, 1.0, 1.0, 0.05, "n_storeys = 0 must be"),
    (BY_PERIOD, 2, [1.0, 2], 0.5, 0.05, r"storey_mass = \[1.0, 2\] must be one number, that of"),
    (BY_PERIOD, 2, 1, 1, 0.9, f"{OWNER}from_period: damping_ratio = 0.9 must be below what a rod"),
    (lambda: BY_PERIOD(2, 1.0, 1.0, 0.05, taper=-1.0), "taper = -1 must be positive"),
    (lambda: ShearBuilding.published("chopra"), "unknown name 'chopra'"),
    (ROW, (LOW, SHIFTED), (FloorLink(0, 0),), "links.0: 1–2, floor 1, at 3 m and 4 m, must be at"),
    (ROW, (LOW, LOW), HIGH, "links.0: floor = 2 must be from 0 to 1: building 1 has 2 floors"),
    (ROW, (LOW, 3.0), "buildings.1 = 3.0 must be"),
    (lambda: jp.modes(3.0), "modes: structures = 3.0 must be"),
    (lambda: jp.modes(LOW), r"structures in SI units have a method of their own"),
)


def test_floors_at_other_heights_are_linked_where_it_is_said_and_tall_buildings_shown_in_short():
    row, _ = jp.dimensionless_row((LOW, SHIFTED), (FloorLink(0, 0, next_floor=0),))
    assert row.system().links[0].ends == (0, 2)
    building = ShearBuilding.from_period(20, 2e5, 2.0, 0.05)
    assert "<18 more>, Building(mass=200000, " in repr(building)
    row, _ = jp.dimensionless_row((building,) * 4, jp.floor_links((building,) * 4, gap=0.1))
    for shown in map(repr, (building, row, row.buildings[0], row.system())):
        assert len(shown) < 900  # ten lines of a terminal
