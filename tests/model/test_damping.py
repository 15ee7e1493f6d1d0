"""Rayleigh's damping, and dashpots of storeys: ratios of modes, and motions by other solvers."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import eigh

import jaxpound as jp
from jaxpound.model.dampers import MatrixDashpot
from jaxpound.model.damping import normal_modes
from jaxpound.model.ends import elongation
from jaxpound.study.demands import doubts
from tests.model.test_isolation import matrices
from tests.refusals import refusals

MASSES, STIFFNESSES = (2.5e5, 2.7e5, 2.7e5, 1.8e5), (2.5e8, 2.45e8, 1.95e8, 0.98e8)
SHAKING = jp.Pulse(0.4, 0.5, 1.5, time_unit="s")
GRID = jp.TimeGrid.until(4.0, 0.005)


FIVE = jp.Rayleigh(0.05)
SHAKEN = jp.RandomRicker(1, jp.LogNormal(0.02, 0.3), jp.Uniform(0.5, 1.0), jp.Uniform(0.5, 1.5))


def frame(damping=FIVE, **options):
    return jp.ShearBuilding.of_storeys(MASSES, STIFFNESSES, damping=damping, **options)


def linear(building):
    """Masses, stiffnesses and Rayleigh's matrix of a building on the ground, by other formulas."""
    mass, stiffness = matrices(building)
    squares = eigh(stiffness, mass, eigvals_only=True)
    first, second = np.sqrt(squares[:2])
    both = np.array([[1 / first, first], [1 / second, second]]) / 2
    alpha, beta = np.linalg.solve(both, [0.05, 0.05])
    return mass, stiffness, alpha * mass + beta * stiffness, np.sqrt(squares), (alpha, beta)


def test_modes_have_the_ratios_of_rayleigh_s_formula():
    *_, omega, (alpha, beta) = linear(frame())
    for damping in (jp.Rayleigh(0.05), jp.Rayleigh(mass=alpha, stiffness=beta)):
        modes = frame(damping).modes()
        np.testing.assert_allclose(modes.frequencies, omega, rtol=1e-9)
        np.testing.assert_allclose(
            modes.damping_ratios, alpha / (2 * omega) + beta * omega / 2, rtol=1e-9
        )
    others = frame(jp.Rayleigh(0.03, modes=(1, 4))).modes().damping_ratios
    np.testing.assert_allclose(others[[0, 3]], 0.03, rtol=1e-9)
    assert (others[1:3] < 0.03).all()
    block = jp.ShearBuilding.from_period(1, 3e5, period=0.8, damping=jp.Rayleigh(0.02))
    np.testing.assert_allclose(block.modes().damping_ratios, 0.02, rtol=1e-9)
    np.testing.assert_allclose(block.natural_period, 0.8, rtol=1e-9)


@pytest.mark.parametrize("n", [1, 2, 7, 30])
def test_frequencies_and_their_derivatives_are_those_of_the_eigenvalues(n):
    draw = np.random.default_rng(n)
    masses, stiffnesses = draw.uniform(1, 3, n), draw.uniform(100, 400, n)

    def by_eigenvalues(stiffnesses, mode):
        building = jp.ShearBuilding.of_storeys([*masses], [*stiffnesses])
        mass, stiffness = matrices(building)
        return np.sqrt(eigh(stiffness, mass, eigvals_only=True)[mode])

    way = draw.uniform(-1, 1, n)
    for mode in {0, min(1, n - 1), n - 1}:

        def ours(size, mode=mode):
            return normal_modes(masses, stiffnesses + size * way)[0][mode]

        value, slope = jax.value_and_grad(ours)(0.0)
        assert float(value) == pytest.approx(by_eigenvalues(stiffnesses, mode), rel=1e-12)
        high, low = (by_eigenvalues(stiffnesses + x * way, mode) for x in (1e-3, -1e-3))
        assert float(slope) == pytest.approx((high - low) / 2e-3, rel=1e-6)


def test_a_building_with_rayleigh_s_damping_is_that_of_scipy_to_second_order():
    """Displacements, accelerations of floors and the energy that the damping takes."""
    mass, stiffness, damping, *_ = linear(frame())
    inverse, n = np.linalg.inv(mass), len(MASSES)

    def rates(t, y):
        x, v = y[:n], y[n : 2 * n]
        a = -inverse @ (damping @ v + stiffness @ x) - jp.STANDARD_GRAVITY * float(pulse(t))
        return np.concatenate([v, a, [v @ damping @ v]])

    pulse = jax.jit(SHAKING.acceleration)
    instants = 0.1 * np.arange(41)
    options = {"t_eval": instants, "rtol": 1e-9, "atol": 1e-11, "max_step": 0.05}
    run = solve_ivp(rates, (0, 4), np.zeros(2 * n + 1), **options)
    x, v = run.y[:n], run.y[n : 2 * n]
    absolute = -inverse @ (damping @ v + stiffness @ x)
    errors = []
    for step in (0.01, 0.005, 0.0025):
        every = round(0.1 / step)
        response = jp.simulate(jp.Buildings((frame(),)), SHAKING, jp.TimeGrid.until(4.0, step))
        ours = np.stack([mass.x for mass in response.masses])[:, ::every]
        accelerations = np.stack(response.absolute_accelerations)[:, ::every]
        taken = float(response.energy.damping[-1])
        errors.append(
            [
                np.abs(ours - x).max() / np.abs(x).max(),
                np.abs(accelerations - absolute).max() / np.abs(absolute).max(),
                abs(taken / run.y[-1, -1] - 1),
                float(response.energy.relative_residual),
            ]
        )
        peak = np.max([demand.peak_acceleration for demand in response.demand.masses])
        assert peak == pytest.approx(np.abs(response.absolute_accelerations).max(), rel=2e-2)
    errors = np.array(errors)
    np.testing.assert_allclose(errors[:-1] / errors[1:], 4.0, rtol=0.3)
    assert (errors[-1] < 2e-3).all()
    # What is left in the end is what springs and masses still have.
    energy = response.energy
    springs = zip(response.rods, STIFFNESSES, strict=True)
    stored = sum(float(rod.force[-1] ** 2) / k / 2 for rod, k in springs)
    assert float(energy.rods[-1]) == pytest.approx(stored, rel=1e-2, abs=1e-3 * taken)


def as_rods(buildings):
    """The system of buildings, with the dashpots among its rods."""
    system = buildings.system()
    return dataclasses.replace(system, rods=(*system.rods, *system.damping), damping=())


@pytest.mark.parametrize("law", [None, jp.Newton(0.6), jp.KelvinVoigt(5e8, 0.6)], ids=str)
def test_damping_moves_buildings_as_rods_of_dashpots_do(law):
    """Beside friction, contact and yield, of which the tests of dashpots have the order."""
    left = frame(yield_force=6e5, hardening=0.05)
    right = jp.ShearBuilding.from_period(3, 2e5, period=0.35, damping=jp.Rayleigh(0.03))
    links = jp.floor_links((left, right), friction=2e4, gap=0.002, contact=law)
    buildings = jp.Buildings((left, right), links)
    ours = jp.simulate(buildings, SHAKING, GRID)
    same = dataclasses.replace(SHAKING, time_unit="1/ω1")
    others = jp.simulate(as_rods(buildings), same, GRID)
    for mass, other in zip(ours.masses, others.masses, strict=True):
        np.testing.assert_allclose(mass.x, other.x, rtol=0, atol=1e-12)
    for a, b in zip(ours.absolute_accelerations, others.absolute_accelerations, strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-9)
    pairs = zip(ours.demand.masses, others.demand.masses, strict=True)
    for mass, other in pairs:
        assert float(mass.peak_acceleration) == pytest.approx(float(other.peak_acceleration))
    assert float(ours.demand.ductility) > 1
    assert len(ours.rods) == 7
    taken = sum(float(rod.dissipated[-1]) for rod in others.rods[7:])
    assert float(ours.energy.damping[-1]) == pytest.approx(taken, rel=2e-2)
    assert float(ours.energy.relative_residual) < 2e-2


def damping_matrix(building):
    """D of a building's dashpots, by their ends."""
    system = jp.Buildings((building,)).system()
    matrix = np.zeros((n := len(system.masses), n))
    for rod in system.damping:
        row = np.zeros(n + 1)
        row[list(rod.ends)] = 1, -1  # the last is the ground
        matrix += float(rod.material.coefficient) * np.outer(row, row)[:n, :n]
    return matrix


RATIOS = (0.02, 0.05, 0.04, 0.1)
MODAL = jp.model.ModalDamping(RATIOS)


def modal_matrix(mass, stiffness, ratios=RATIOS):
    squares, shapes = eigh(stiffness, mass)
    return mass @ shapes @ np.diag(2 * np.array(ratios) * np.sqrt(squares)) @ shapes.T @ mass


@pytest.mark.parametrize("damping", [FIVE, MODAL], ids=["Rayleigh", "modal"])
def test_on_bearings_it_acts_on_what_stands_on_them(damping):
    """The building moves on its base as on the ground, and the base is free of it."""
    bearing = jp.LeadRubber(period=2.5, strength=0.05)
    (base, _) = jp.on_bearings(frame(damping), bearing, 3e5)
    assert (base.n_bearings, base.damping) == (1, damping)
    mass, stiffness, expected, _, _ = linear(frame())
    expected = modal_matrix(mass, stiffness) if damping is MODAL else expected
    matrix = damping_matrix(base)
    np.testing.assert_allclose(matrix[1:, 1:], expected, rtol=1e-9, atol=1e-3)
    np.testing.assert_allclose(matrix @ np.ones(5), 0, atol=1e-6 * expected.max())
    tuned = jp.tuned_mass_damper(frame(damping), 0.02)
    own = damping_matrix(tuned)[:4, :4] - expected
    own[-1, -1] -= tuned.storeys[-1].dashpot
    np.testing.assert_allclose(own, 0, atol=1e-9 * expected.max())


def test_modes_have_the_ratios_that_are_stated():
    modes = frame(MODAL).modes()
    np.testing.assert_allclose(modes.damping_ratios, RATIOS, rtol=1e-9)
    np.testing.assert_allclose(modes.frequencies, linear(frame())[3], rtol=1e-9)
    for_all = frame(jp.model.ModalDamping(0.05))
    np.testing.assert_allclose(for_all.modes().damping_ratios, 0.05, rtol=1e-9)
    block = jp.ShearBuilding.from_period(1, 3e5, period=0.8, damping=jp.model.ModalDamping(0.02))
    np.testing.assert_allclose(block.modes().damping_ratios, 0.02, rtol=1e-9)
    heavy = frame(MODAL).with_p_delta()
    assert heavy.modes().damping_ratios == pytest.approx(RATIOS, rel=1e-9)
    assert float(heavy.natural_period) > float(frame().natural_period)
    sand = jp.Soil(300.0, 1800.0, 0.3)
    on_rock = dataclasses.replace(sand, shear_wave_velocity=1e4)
    placed = [jp.on_soil(frame(MODAL), x, radius=8.0, footing_mass=3e5) for x in (on_rock, sand)]
    assert placed[0].modes().damping_ratios[0] == pytest.approx(RATIOS[0], rel=1e-2)
    assert placed[1].modes().damping_ratios[0] > 1.05 * RATIOS[0]
    system = jp.Buildings((placed[1],)).system()
    inherent = [rod for rod in system.damping if isinstance(rod.material, MatrixDashpot)]
    rotation = [*np.cumsum(placed[1].heights), 0.0, 1.0]
    for rigid in ([1.0] * 5 + [0.0], rotation):  # relative to the ground, and to the footing
        assert abs(np.array([elongation(rod, rigid) for rod in inherent])).max() < 1e-12
    again = frame(jp.model.ModalDamping(np.array(RATIOS))).modes()
    np.testing.assert_array_equal(again.damping_ratios, modes.damping_ratios)


def test_a_tower_has_as_many_operations_as_dashpots():
    """The program of a run; every pair of floors has a dashpot."""

    def operations(n):
        def coefficients(stiffness):
            damping = jp.model.ModalDamping(0.05)
            building = jp.ShearBuilding.of_storeys([3e5] * n, [stiffness] * n, damping=damping)
            return [rod.material.coefficient for rod in jp.Buildings((building,)).system().damping]

        return len(jax.make_jaxpr(coefficients)(4e8).eqns)

    assert operations(16) < 1.5 * 4 * operations(8)


def test_in_single_precision_modes_of_very_different_storeys_are_numbers():
    stiffnesses = jnp.array([4e8, 4e8, 4e15, 4e8], jnp.float32)
    frequencies, _ = jax.jit(lambda k: normal_modes([jnp.float32(3e5)] * 4, [*k]))(stiffnesses)
    assert frequencies.dtype == jnp.float32
    assert np.isfinite(frequencies).all()


def test_a_run_and_its_derivatives_have_the_ratios_of_modes():
    """By modal superposition with SciPy; slopes by ratios and by stiffness are differences."""
    mass, stiffness, *_ = linear(frame())
    squares, shapes = eigh(stiffness, mass)
    shares = shapes.T @ mass @ np.ones(4)

    def roof(buildings):
        return jp.demand(buildings, SHAKING, GRID, only=("peak_x4",)).peak_x4

    def varied(change):
        ratios = [ratio * (1 + change[0]) for ratio in RATIOS]
        stiffnesses = [k * (1 + change[1]) for k in STIFFNESSES]
        damping = jp.model.ModalDamping(ratios)
        return jp.Buildings((jp.ShearBuilding.of_storeys(MASSES, stiffnesses, damping=damping),))

    response = jp.simulate(varied([0.0, 0.0]), SHAKING, GRID)
    pulse, modal = jax.jit(SHAKING.acceleration), []
    for square, share, ratio in zip(squares, shares, RATIOS, strict=True):

        def rates(t, y, square=square, share=share, ratio=ratio):
            force = -share * jp.STANDARD_GRAVITY * float(pulse(t))
            return [y[1], force - square * y[0] - 2 * ratio * np.sqrt(square) * y[1]]

        options = {"t_eval": response.time[::20], "rtol": 1e-8, "atol": 1e-10, "max_step": 0.05}
        modal.append(solve_ivp(rates, (0, 4.001), [0.0, 0.0], **options).y[0])
    ours = np.stack([x.x[::20] for x in response.masses])
    np.testing.assert_allclose(ours, shapes @ modal, rtol=0, atol=3e-3 * np.abs(ours).max())

    value, slopes = jax.jit(jax.value_and_grad(lambda c: roof(varied(c))))(jnp.zeros(2))
    assert float(value) == pytest.approx(float(response.demand.peak_x4), rel=1e-10)
    for k, slope in enumerate(slopes):
        ends = [float(roof(varied(s * 1e-5 * np.eye(2)[k]))) for s in (1, -1)]
        assert float(slope) == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-5)


def test_a_block_on_a_spring_and_a_dashpot_is_exactly_viscous():
    block = jp.Building.from_period(5e5, 0.9, 0.05, order=None)
    omega = 2 * np.pi / 0.9
    assert float(block.natural_period) == pytest.approx(0.9, rel=1e-12)
    assert float(block.damping_ratio) == pytest.approx(0.05, rel=1e-12)
    assert block.dashpot == pytest.approx(2 * 0.05 * 5e5 * omega)
    modes = jp.modes(jp.Buildings((block,)))
    np.testing.assert_allclose(modes.eigenvalues, omega * (-0.05 + 1j * np.sqrt(1 - 0.05**2)))
    frame = jp.ShearBuilding.from_period(3, 2e5, 0.5, 0.04, order=None).modes()
    np.testing.assert_allclose(frame.damping_ratios, 0.04 * frame.frequencies * 0.5 / (2 * np.pi))
    assert jp.Building.from_period(5e5, 0.9, None).dashpot is None


def test_random_stiffnesses_change_rayleigh_s_coefficients():
    """A batch is its runs one by one; gradients by all numbers are those of differences."""

    def roof(buildings):
        return jp.demand(buildings, SHAKING, GRID, only=("peak_x4",)).peak_x4

    def varied(size, ratio):
        stiffnesses = [k * size for k in STIFFNESSES]
        building = jp.ShearBuilding.of_storeys(MASSES, stiffnesses, damping=jp.Rayleigh(ratio))
        return jp.Buildings((building,))

    sizes, ratios = jnp.array([0.8, 1.1]), jnp.array([0.02, 0.05])

    @jax.jit
    @jax.vmap
    def batch(size, ratio):
        return jax.value_and_grad(lambda a, b: roof(varied(a, b)), (0, 1))(size, ratio)

    values, slopes = batch(sizes, ratios)
    for k, (size, ratio) in enumerate(zip([0.8, 1.1], [0.02, 0.05], strict=True)):
        assert float(values[k]) == pytest.approx(float(roof(varied(size, ratio))), rel=1e-10)
    for way, slope in enumerate(slopes):
        step = np.array([1e-5, 0.0]) if way == 0 else np.array([0.0, 1e-5])
        both = zip(sizes, ratios, strict=True)
        pairs = [[float(roof(varied(*(np.array(x) + s * step)))) for s in (1, -1)] for x in both]
        np.testing.assert_allclose(slope, [(a - b) / 2e-5 for a, b in pairs], rtol=1e-5)
    paths = jp.model.parameters.paths(varied(1.0, 0.05))
    assert "buildings.0.damping.ratio" in paths


def test_coefficients_are_those_of_a_ratio_in_runs_too():
    """Both, or one of them, traced: a batch, and the derivative where one of them is 0."""

    @jax.jit
    def roof(alpha, beta):
        building = frame(jp.Rayleigh(mass=alpha, stiffness=beta))
        return jp.demand(jp.Buildings((building,)), SHAKING, GRID, only=("peak_x4",)).peak_x4

    *_, (alpha, beta) = linear(frame())
    exact = float(jp.demand(jp.Buildings((frame(),)), SHAKING, GRID).peak_x4)
    assert float(roof(alpha, beta)) == pytest.approx(exact, rel=1e-9)
    for name, other in (("mass", roof(alpha, 0.0)), ("stiffness", roof(0.0, beta))):
        building = frame(jp.Rayleigh(**{name: alpha if name == "mass" else beta}))
        demand = jp.demand(jp.Buildings((building,)), SHAKING, GRID)
        assert float(demand.peak_x4) == pytest.approx(float(other), rel=1e-9)
    both = jax.vmap(roof, (0, None))(jnp.array([0.0, alpha]), beta)
    assert float(both[1]) == pytest.approx(exact, rel=1e-9)
    slope = float(jax.grad(roof)(0.0, beta))
    rise = float(roof(1e-3, beta) - roof(0.0, beta)) / 1e-3
    assert slope == pytest.approx(rise, rel=1e-2) != 0


def test_the_weight_of_a_building_leaves_its_damping_as_it_is():
    heavy = frame().with_p_delta()
    matrices = [damping_matrix(building) for building in (frame(), heavy)]
    np.testing.assert_allclose(matrices[1], matrices[0], rtol=1e-12, atol=1e-6)
    assert float(heavy.natural_period) > float(frame().natural_period)


def test_code_rules_know_the_damping_of_blocks():
    """The correlation of two blocks is that of their ratios, however these are stated."""
    pairs = [
        (jp.Building.from_period(4e5, t, 0.05, order=None) for t in (0.9, 0.8)),
        (jp.ShearBuilding.from_period(1, 4e5, t, damping=jp.Rayleigh(0.05)) for t in (0.9, 0.8)),
    ]
    for pair in pairs:
        buildings = jp.Buildings((*pair,), (jp.FloorLink(0, 0, friction=1e4, gap=0.1),))
        scenarios = jp.Scenarios(buildings, SHAKEN)
        study = jp.monte_carlo(scenarios, 4, jp.TimeGrid.until(3.0, 0.02), progress=False)
        periods_and_ratios = study.about["oscillators"]
        np.testing.assert_allclose(periods_and_ratios, [0.9, 0.05, 0.8, 0.05], rtol=1e-9)


def pair_with_contact(ratio):
    frames = [jp.ShearBuilding.from_period(2, 2e5, t, damping=ratio) for t in (0.5, 0.35)]
    law = jp.KelvinVoigt(1e9, 0.65)
    return jp.Buildings(frames, jp.floor_links(frames, gap=0.05, contact=law))


def test_known_damping_beside_contact_is_judged_where_other_numbers_are_traced():
    """In studies, and in programs of the user's own."""
    grid, record = jp.TimeGrid.until(0.2, 0.02), jp.Record([0.0, 0.3, 0.0], 0.1)
    assert doubts(jp.Scenarios(pair_with_contact(FIVE), SHAKEN), grid) == []
    strong = pair_with_contact(jp.Rayleigh(0.9))
    (finding,) = doubts(jp.Scenarios(strong, SHAKEN), grid)
    assert finding.startswith("link 1–2, floor 1: dt c/m is 1.12, with c")
    with pytest.warns(jp.PlausibilityWarning, match="dt c/m is"):
        jax.eval_shape(lambda _: jp.demand(strong, record, grid).min_gap, 1.0)


def test_buildings_without_any_damping_are_told_of():
    bare = jp.ShearBuilding.of_storeys(MASSES, STIFFNESSES)
    with pytest.warns(jp.PlausibilityWarning, match="building 1 has no damping"):
        jp.Buildings((bare,))
    jp.Buildings((frame(jp.Rayleigh(0.0)),))


def test_single_precision_is_that_of_doubles():
    cast = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), (jp.Buildings((frame(),)), SHAKING))
    ours = jp.demand(*cast, GRID).peak_x4
    assert ours.dtype == jnp.float32
    exact = jp.demand(jp.Buildings((frame(),)), SHAKING, GRID).peak_x4
    assert float(ours) == pytest.approx(float(exact), rel=1e-4)


test_faults_are_named = refusals(
    (jp.Rayleigh, "Rayleigh: ratio = None must be stated, or mass and stiffness"),
    (lambda: jp.Rayleigh(0.05, mass=0.1), "mass = 0.1 must be left out: it follows from ratio"),
    (lambda: jp.Rayleigh(1.05), r"ratio = 1.05 must be between 0 and 1 \(of the critical damping"),
    (lambda: jp.Rayleigh(0.05, modes=(0, 1)), r"modes = \(0, 1\) must be the numbers of two"),
    (
        lambda: frame(jp.Rayleigh(0.05, modes=(1, 5))),
        r"damping: modes = \(1, 5\) must be from 1 to 4, the storeys",
    ),
    (
        lambda: frame(jp.model.ModalDamping([0.05, 0.02])),
        "damping: ratios, 2 of them, must be 4, one for each storey above bearings, or one for all",
    ),
    (lambda: jp.model.ModalDamping([]), r"ratios = \(\) must hold at least one"),
    (lambda: jp.model.ModalDamping([0.1, -0.1]), r"ratios.1 = -0.1 must be"),
    (lambda: frame(0.05), "damping = 0.05 must be of type Rayleigh or ModalDamping or None"),
    (
        lambda: jp.Building(1e5, 1e7, order=0.5),
        "tau_f = None must be stated beside order; without all three it is a spring",
    ),
    (
        lambda: jp.ShearBuilding.from_period(3, 2e5, 0.5),
        "damping_ratio = None must be one of damping_ratio and damping: the other is None",
    ),
    (
        lambda: jp.Building.from_period(1e5, 0.5, 0.05, None, 0.01),
        "tau_f = 0.01 must be left out where order is None",
    ),
    (
        lambda: jp.Building.from_period(1e5, 0.5, None, order=0.7),
        "order = 0.7 must be left out without a damping ratio: the block is on a spring",
    ),
    (
        lambda: jp.Rayleigh(mass=0.1, modes=(1, 3)),
        r"modes = \(1, 3\) must be left out beside mass and stiffness",
    ),
    (
        lambda: jp.on_bearings(frame(), jp.LeadRubber(2.5, 0.05), 3e5)[0].yielding(yield_force=1e6),
        "yield_force = 1000000.0 must be a list with a number for each storey of a building on",
    ),
    (
        lambda: dataclasses.replace(frame(), n_bearings=4),
        "n_bearings = 4 must be a whole number from 0 to 3",
    ),
    (
        lambda: jp.System((1.0,), (r := jp.Rod(jp.model.Spring(), 1.0, (0, -1)),), damping=(r,)),
        r"damping.0.material = Spring\(\) must be a Dashpot: rods with a stiffness belong in rods",
    ),
)
