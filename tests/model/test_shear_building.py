"""Buildings of several storeys in SI units, and their modes."""

import jax
import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import root

import jaxpound as jp
from jaxpound import FloorLink, ShearBuilding
from jaxpound.model.ends import elongation
from jaxpound.model.structures import storey_ends
from tests import linear
from tests.refusals import refusals


def test_the_first_mode_has_the_period_and_damping_asked_for_and_one_storey_is_a_building():
    for taper in (1.0, 0.4):
        building = ShearBuilding.from_period(6, 2e5, 0.8, 0.04, order=0.4, taper=taper)
        assert building.natural_period == pytest.approx(0.8, rel=1e-9)
        modes = building.modes()  # of the free vibration, to the square of the damping ratio
        assert modes.periods[0] == pytest.approx(0.8, rel=0.04**2)
        assert modes.damping_ratios[0] == pytest.approx(0.04, abs=0.04**2)
        stiffnesses = np.array([storey.stiffness for storey in building.storeys])
        np.testing.assert_allclose(np.diff(stiffnesses, 2) / stiffnesses[0], 0, atol=1e-12)
        assert stiffnesses[-1] == pytest.approx(taper * stiffnesses[0])
    storey = ShearBuilding.from_period(1, 5e5, 0.9, 0.05).storeys[0]
    block = jp.Building.from_period(5e5, 0.9, 0.05)
    numbers = [[*vars(x).values()][:5] for x in (storey, block)]
    assert numbers[0] == pytest.approx(numbers[1], rel=1e-14)
    assert ShearBuilding((block,)).natural_period == pytest.approx(0.9, rel=1e-10)
    modes = ShearBuilding((block,)).modes()
    assert "frequency (rad/s)  period (s)" in str(modes)
    rod, mass = block.zener(), float(block.mass)

    def residual(parts):  # of m s² + K*(s) = 0
        s = complex(*parts)
        modulus = (1 + rod.tau_x * s**rod.order) / (1 + rod.tau_f * s**rod.order)
        value = s**2 + complex(block.stiffness * modulus) / mass
        return value.real, value.imag

    s = complex(*root(residual, (-0.3, 7.0), tol=1e-12).x)
    assert modes.eigenvalues[0] == pytest.approx(s, rel=1e-9)
    assert modes.periods[0] == pytest.approx(2 * np.pi / abs(s), rel=1e-9)
    assert modes.damping_ratios[0] == pytest.approx(-s.real / abs(s), rel=1e-9)


def test_floors_of_other_masses_have_the_period_too_and_gradients_by_each_mass():
    """A light roof and a high first storey: the shapes follow from masses and stiffnesses."""
    masses, heights = [3e5, 2.5e5, 3e5, 1e5], [4.0, 3.2, 3.2, 3.0]
    frame = ShearBuilding.from_period(4, masses, 1.1, 0.05, taper=0.6, height=heights)
    assert frame.natural_period == pytest.approx(1.1, rel=1e-9)
    assert [storey.mass for storey in frame.storeys] == masses
    np.testing.assert_allclose(frame.elevations, np.cumsum(heights))
    stiffnesses = np.array([storey.stiffness for storey in frame.storeys])
    np.testing.assert_allclose(stiffnesses / stiffnesses[0], np.linspace(1, 0.6, 4), rtol=1e-12)
    drifts = np.eye(4) - np.eye(4, k=-1)
    least = eigh(drifts.T * stiffnesses @ drifts, np.diag(masses), eigvals_only=True)[0]
    omega = 2 * np.pi / 1.1
    modulus = np.real(frame.storeys[0].zener().complex_modulus(omega))
    assert least * modulus == pytest.approx(omega**2, rel=1e-10)
    equal = [ShearBuilding.from_period(3, m, 0.6, 0.05) for m in (2e5, np.full(3, 2e5))]
    assert repr(equal[0]) == repr(equal[1])

    def roof_stiffness(*masses):
        return ShearBuilding.from_period(4, masses, 1.1, 0.05, taper=0.6).storeys[-1].stiffness

    slopes = jax.jit(jax.grad(roof_stiffness, argnums=(0, 1, 2, 3)))(*masses)
    for i, slope in enumerate(slopes):
        up, down = ([m + (j == i) * d for j, m in enumerate(masses)] for d in (100.0, -100.0))
        difference = (roof_stiffness(*up) - roof_stiffness(*down)) / 200
        assert slope == pytest.approx(difference, rel=1e-6)


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


def state_matrix(masses, stiffness, damping):
    """The state matrix of masses on Kelvin–Voigt rods."""
    n = len(masses)
    lower = -np.hstack([stiffness, damping]) / np.array(masses)[:, None]
    return np.vstack([np.eye(2 * n)[n:], lower])


@pytest.mark.parametrize("strongest", [0.3, 3.0, 30.0])
def test_modes_are_those_of_the_state_matrix_wherever_dampers_stand(strongest):
    """Also the number of those that only creep; a path for each, so that none is found twice."""
    rng = np.random.default_rng(7)
    for n in (2, 3, 5, 8):
        masses, ends = rng.uniform(0.5, 2, n), [*map(storey_ends, range(n)), (n - 1, jp.GROUND)]
        stiffnesses = np.append(rng.uniform(20, 200, n), 0.01)
        dashpots = np.append(rng.uniform(0.01, 0.1, n), strongest)
        numbers = [*zip(ends, stiffnesses, dashpots, strict=True)]
        rods = [jp.Rod(jp.ZenerRod(1.0, 1e-12, c / k), k, x) for x, k, c in numbers]
        modes = jp.modes(jp.System(tuple(masses), tuple(rods)))
        influence = np.array([elongation(rod, np.eye(n)) for rod in rods]).T
        between = [influence @ np.diag(x) @ influence.T for x in (stiffnesses, dashpots)]
        poles = np.linalg.eigvals(state_matrix(masses, *between))
        poles = poles[poles.imag > 1e-6 * abs(poles)]
        assert modes.overdamped.sum() == n - poles.size
        vibrates = modes.eigenvalues[~modes.overdamped]
        np.testing.assert_allclose(np.sort_complex(vibrates), np.sort_complex(poles), rtol=1e-7)
        assert modes.participation.sum() == pytest.approx(1, rel=1e-9)
        dynamic = [
            (state_matrix(masses, *between)[n:], s, x)
            for s, x in zip(modes.eigenvalues, modes.shapes.T, strict=True)
        ]
        for lower, s, shape in dynamic:
            if not np.isnan(s):
                np.testing.assert_allclose(
                    lower @ np.append(shape, s * shape),
                    s**2 * shape,
                    rtol=1e-6,
                    atol=1e-6 * abs(s) ** 2,
                )


def test_equal_buildings_have_equal_modes_with_shapes_of_their_own():
    building = ShearBuilding.from_period(3, 3e5, 0.5, 0.05)
    alone, modes = building.modes(), jp.modes(jp.Buildings((building,) * 3))
    np.testing.assert_allclose(modes.eigenvalues, np.repeat(alone.eigenvalues, 3), rtol=1e-7)
    np.testing.assert_allclose(modes.participation.reshape(3, 3).sum(1), alone.participation)
    assert np.linalg.matrix_rank(modes.shapes) == 9


def test_linear_viscous_dampers_to_the_ground_damp_in_proportion_to_the_masses():
    """A ``PowerLaw`` on a stiff brace: α/(2ω) in each mode; only linear ones count."""
    elastic, alpha = jp.ZenerRod(1.0, 1e-9, 1e-9), 0.56
    frame = [jp.Rod(elastic, 160.0, storey_ends(i)) for i in range(3)]
    fluid = [jp.PowerLaw(alpha / 2, exponent, velocity=0.5) for exponent in (1.0, 0.5)]
    damped, bare = (
        jp.modes(
            jp.System((1.0,) * 3, (*frame, *(jp.Rod(law, 1e7, (i, jp.GROUND)) for i in range(3))))
        )
        for law in fluid
    )
    np.testing.assert_allclose(damped.damping_ratios, alpha / 2 / damped.frequencies, rtol=1e-5)
    np.testing.assert_allclose(damped.frequencies, bare.frequencies, rtol=1e-5)
    np.testing.assert_allclose(bare.damping_ratios, 0.0, atol=1e-7)


def test_a_mode_that_only_creeps_is_said_to_be_overdamped():
    """It has the frequency and the damping ratio of its steady vibration: those of a textbook."""
    modes = jp.modes(jp.Storeys((1.0,), jp.Rod(jp.ZenerRod(1.0, 1e-9, 3.0), 4.0)))
    assert modes.overdamped.tolist() == [True]
    assert np.isnan(modes.eigenvalues).all()
    assert modes.frequencies[0] == pytest.approx(2.0, rel=1e-6)
    assert modes.damping_ratios[0] == pytest.approx(3.0, rel=1e-6)
    assert "1, overdamped" in str(modes)


def test_a_building_is_differentiated_by_its_masses_and_rods_whatever_its_heights():
    low = ShearBuilding.from_period(2, 1e5, 0.3, 0.05)
    link = FloorLink(0, 1, gap=0.1)

    def top(building):
        return jp.Buildings((building, low), (link,)).dimensionless()[0].buildings[0].masses[1]

    slopes = jax.grad(top)(low)
    assert slopes.storeys[1].mass == pytest.approx(1e-5)
    assert slopes.heights == low.heights


def test_published_buildings_and_si_units():
    """Chopra's frame: T = 2 s; its higher periods are shorter by the rods' stiffening."""
    chopra = ShearBuilding.published("chopra-5")
    assert chopra.natural_period == pytest.approx(2.0, rel=1e-3)
    periods = chopra.modes().periods
    assert (periods[1:] < [0.6852, 0.4346, 0.3383, 0.2966]).all()
    for name, period in (("jankowski-left", 1.2), ("jankowski-right", 0.3)):
        building = ShearBuilding.published(name)
        assert building.natural_period == pytest.approx(period, rel=1e-3)
    left = ShearBuilding.from_period(2, 3e5, 0.4, 0.05)
    right = jp.Building.from_period(4e5, 0.5, 0.05)
    law = jp.KelvinVoigt(5e9, 0.65)
    link = FloorLink(0, 1, next_floor=0, friction=5e4, gap=0.03, contact=law)
    row, scales = jp.Buildings((left, right), (link,)).dimensionless()
    assert row.buildings[0].masses[0] == row.buildings[0].rods[0].stiffness == 1.0
    assert row.links[0].friction * scales.force == pytest.approx(5e4)
    assert row.links[0].gap * scales.length == pytest.approx(0.03)
    assert scales.contact_to_si(row.links[0].contact).stiffness == pytest.approx(5e9)
    frequencies = np.array(row.natural_frequencies) * float(scales.frequency)
    np.testing.assert_allclose(2 * np.pi / frequencies, [0.4, 0.5], rtol=1e-9)


LOW = ShearBuilding.from_period(2, 1e5, 0.3, 0.05)
SHIFTED = ShearBuilding(LOW.storeys, (4.0, 3.0))
BY_PERIOD, OF_STOREYS = ShearBuilding.from_period, ShearBuilding.of_storeys
ROW, ROD, HIGH, OWNER = jp.Buildings, (0.5, 0.1, 0.2), (FloorLink(0, 2),), "ShearBuilding."
test_bad_input = refusals(
    (lambda: ShearBuilding(()), r"storeys = \(\) must hold at least one storey"),
    (lambda: ShearBuilding(LOW.storeys, (3.0,)), "heights, 1 of them, must be 2, a number for"),
    (lambda: ShearBuilding(LOW.storeys, -3.0), "heights.0 = -3 must be positive"),
    (OF_STOREYS, [1, 2], [1] * 3, *ROD, "stiffnesses, 3 of them, must be 2, a number for each"),
    (OF_STOREYS, [1.0, -2.0], 1.0, *ROD, "of_storeys: storeys.1: mass = -2 must be positive"),
    (BY_PERIOD, 0, 1.0, 1.0, 0.05, "n_storeys = 0 must be"),
    (BY_PERIOD, 3, [1.0, 2], 0.5, 0.05, "storey_mass, 2 of them, must be 3, a number for each"),
    (BY_PERIOD, 2, [1.0, -2], 0.5, 0.05, "from_period: storey_mass.1 = -2 must be positive"),
    (lambda: BY_PERIOD(2, 1.0, 1.0, 0.05, height=[3.0] * 3), "height, 3 of them, must be 2, a"),
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
    row, _ = jp.Buildings((LOW, SHIFTED), (FloorLink(0, 0, next_floor=0),)).dimensionless()
    assert row.system().links[0].ends == (0, 2)
    building = ShearBuilding.from_period(20, 2e5, 2.0, 0.05)
    assert "<18 more>, Building(mass=200000, " in repr(building)
    row, _ = jp.Buildings((building,) * 4, jp.floor_links((building,) * 4, gap=0.1)).dimensionless()
    for shown in map(repr, (building, row, row.buildings[0], row.system())):
        assert len(shown) < 960  # twelve lines of a terminal
