"""Pure dashpots: linear systems by SciPy, and a solver from event to event for all else."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jaxpound as jp
from jaxpound.simulation.scheme import imprecise
from tests.refusals import refusals
from tests.simulation import test_weights as weights
from tests.simulation.contact import rods_without_memory as exact
from tests.simulation.pairs import SHAKING, displacements_in_units, in_unit_of_time

G = jp.GROUND
SPRING = jp.ZenerRod(1.0, 1.0, 1.0)


def with_dashpots(system, seed, size=0.3):
    """Three dashpots across all masses, with weights of their own."""
    draw, n = np.random.default_rng(100 + seed), len(system.masses)
    ends = [tuple(enumerate(row.tolist())) for row in draw.uniform(-1, 1, (3, n))]
    coefficients = size * draw.uniform(0.5, 1.5, 3)
    rods = [jp.Rod(jp.Dashpot(c), ends=x) for c, x in zip(coefficients, ends, strict=True)]
    return dataclasses.replace(system, rods=(*system.rods, *rods))


def frame_of(system):
    """The reference's frame, with dashpots."""
    dashpots = [rod for rod in system.rods if isinstance(rod.material, jp.Dashpot)]
    rods = tuple(rod for rod in system.rods if rod not in dashpots)
    frame = weights.frame_of(dataclasses.replace(system, rods=rods))
    return frame._replace(
        dashpots=tuple(
            exact.Dashpot(rod.material.coefficient, weights.weighted(rod.ends, rod.weights))
            for rod in dashpots
        )
    )


def sliding(seed, joints):
    """The last joints of the rocking neighbours, without walls."""
    system = weights.rocking_neighbours(seed, "kelvin")
    free = [dataclasses.replace(x, gap=np.inf, contact=None) for x in system.links[::2]]
    return dataclasses.replace(system, links=tuple(free[-joints:]))


CASES = {
    "one joint": (sliding, 0, 1),
    "two joints that share a rotation": (sliding, 1, 2),
    "Kelvin and Voigt's contact": (weights.rocking_neighbours, 0, "kelvin"),
    "Newton's contact": (weights.rocking_neighbours, 2, "newton"),
    "dense": (weights.dense, 3, 3, 2, "kelvin"),
}


@pytest.mark.parametrize("name", CASES)
def test_with_friction_and_contact_they_are_of_second_order(name):
    """In displacements, and their derivative along a way of all numbers (see ``test_weights``)."""
    make, seed, *rest = CASES[name]
    system = with_dashpots(make(seed, *rest), seed)
    way = weights.relative_way(system, seed)
    path, slope, kinds = weights.reference(system, way, frame_of)
    errors = []
    for step in weights.STEPS:
        x, along_way = weights.at_instants(system, way, step)
        of_slope = np.median(np.abs(along_way - slope)) / np.median(np.abs(slope))
        errors.append((np.linalg.norm(x - path) / np.linalg.norm(path), of_slope))
    coarse, _, fine = np.array(errors)
    assert kinds.count("turn") > 4
    assert "joint" in name or "touch" in kinds
    assert (coarse > (12, 6) * fine).all(), errors  # 16 would be of second order
    assert (fine < (1e-3, 2e-2)).all(), errors


MASSES, STIFFNESSES, COEFFICIENTS = (1.0, 0.8), (1.0, 2.0), (0.15, 0.3, 0.1)
ENDS = (0, G), (1, G), (0, 1)
END = 16.0


def pair(coefficients=COEFFICIENTS, **link):
    """Two blocks on springs, with dashpots to the ground and between them."""
    rods = [jp.Rod(SPRING, k, ends) for k, ends in zip(STIFFNESSES, ENDS, strict=False)]
    rods += [jp.Rod(jp.Dashpot(c), ends=x) for c, x in zip(coefficients, ENDS, strict=True)]
    return jp.System(MASSES, rods, (jp.Link((0, 1), **link),) if link else ())


def matrix():
    """Of the linear equations of x and x'."""
    b = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, -1.0]])
    damping, m = b.T * COEFFICIENTS @ b, np.array(MASSES)[:, None]
    return np.block([[np.zeros((2, 2)), np.eye(2)], [-np.diag(STIFFNESSES) / m, -damping / m]])


@functools.cache
def linear(start):
    """Displacements and velocities at instants .4 apart."""
    ground = exact.ricker(SHAKING.amplitude, SHAKING.periods, SHAKING.arrivals)
    shaken = np.array([0.0, 0.0, 1.0, 1.0])
    run = solve_ivp(
        lambda t, y: matrix() @ y - shaken * ground(t),
        (0, END),
        start,
        t_eval=0.4 * np.arange(round(END / 0.4) + 1),
        **exact.ACCURACY,
        max_step=0.05,
    )
    return run.y


STEPS = (0.04, 0.02, 0.01)


@jax.jit
def in_unit(unit, initial):
    """A run of the pair, and its energy, in a unit of time: by one program at all ``STEPS``."""
    system, ground, start = in_unit_of_time(unit, pair(), SHAKING, initial)
    grid = jp.TimeGrid(STEPS[0], round(END / STEPS[-1]))
    response = jp.simulate(system, ground, grid, initial=start)
    return response, response.energy


@pytest.mark.parametrize("start", [(0.0,) * 4, (0.3, 0.0, 0.0, 0.4)], ids=["at rest", "moving"])
def test_linear_systems_are_those_of_scipy_to_second_order(start):
    """Displacements, velocities and the forces of dashpots; their balance of energy, too."""
    y, errors = linear(start), []
    initial = jp.InitialState(start[:2], start[2:])
    rates = np.stack([y[2], y[3], y[2] - y[3]])
    for step in STEPS:
        unit, instants = step / STEPS[0], slice(0, round(END / step) + 1, round(0.4 / step))
        response, energy = jax.device_get(in_unit(unit, initial))
        response = jp.Scales(1.0, 1 / unit, unit**-2.0).to_si(response)
        ours = [getattr(mass, name) for name in ("x", "v") for mass in response.masses]
        forces = [rod.force for rod in response.rods[2:]]
        wrong = np.stack([x[instants] for x in ours]) - y
        exact_forces = np.array(COEFFICIENTS)[:, None] * rates
        of_forces = np.stack([x[instants] for x in forces]) - exact_forces
        residual, supplied = (x[: instants.stop] for x in (energy.residual, energy.input))
        share = np.abs(residual).max() / np.abs(supplied + energy.initial).max()
        errors.append([np.abs(wrong).max(), np.abs(of_forces).max(), share])
        for rod, force in zip(response.demand.rods[2:], forces, strict=True):
            assert float(rod.peak_force) == pytest.approx(np.abs(force).max(), rel=1e-2)
    errors = np.array(errors)
    np.testing.assert_allclose(errors[:-1] / errors[1:], 4.0, rtol=0.25)
    assert (errors[-1] < 1e-3).all()


def test_modes_are_the_eigenvalues_of_the_equations():
    values = np.linalg.eigvals(matrix())
    modes = jp.modes(pair())
    np.testing.assert_allclose(modes.eigenvalues, sorted(values[values.imag > 0], key=abs))


def test_a_dashpot_of_any_strength_is_stable_and_joins_what_is_at_its_ends():
    """Two blocks with a dashpot 10⁶ times as strong are one block, in steps that springs allow."""
    springs = [jp.Rod(SPRING, k, ends) for k, ends in zip(STIFFNESSES, ENDS, strict=False)]
    strong = jp.System(MASSES, (*springs, jp.Rod(jp.Dashpot(1e6), ends=(0, 1))))
    alone = jp.System((sum(MASSES),), (jp.Rod(SPRING, sum(STIFFNESSES), (0, G)),))
    elastic = jp.System(MASSES, springs)
    assert jp.stability_limit(strong) == jp.stability_limit(elastic)
    grid = jp.TimeGrid.until(END, 0.04)
    (left, right), (whole,) = (jp.simulate(x, SHAKING, grid).masses for x in (strong, alone))
    np.testing.assert_allclose(left.x, right.x, rtol=0, atol=1e-5)
    np.testing.assert_allclose(left.x, whole.x, rtol=0, atol=2e-5)


def test_a_yielding_block_on_a_dashpot_is_of_second_order():
    """Between yield and unloading the equations are linear."""
    k, c, limit, ground = 4.0, 0.4, 0.05, exact.ricker([0.3], [2.0], [2.0])
    shaking, end = jp.Ricker(0.3, 2.0, 2.0), 8.0
    instants = 0.4 * np.arange(round(end / 0.4) + 1)
    t, y, flows, path = 0.0, np.zeros(3), 0.0, []  # y: x, x' and the plastic elongation

    def rates(t, y):
        pull = -k * (y[0] - y[2]) - c * y[1] - ground(t)
        return [y[1], pull, flows and y[1]]

    while t < end - 1e-12:
        if flows:
            ends = [lambda t, y, s=flows: s * y[1]]
        else:
            ends = [lambda t, y, s=s: limit - s * (y[0] - y[2]) for s in (1, -1)]
        for event in ends:
            event.terminal, event.direction = True, -1
        run = solve_ivp(
            rates, (t, end), y, events=ends, dense_output=True, max_step=0.02, **exact.ACCURACY
        )
        inside = instants[(instants >= t - 1e-12) & (instants < run.t[-1] - 1e-12)]
        path += [run.sol(x)[0] for x in inside]
        t, y = run.t[-1], run.y[:, -1].copy()
        flows = 0.0 if flows else np.sign(y[0] - y[2])
    path.append(y[0])
    material = jp.Bilinear(limit, 0.0)
    rods = jp.Rod(material, k, (0, G)), jp.Rod(jp.Dashpot(c), ends=(0, G))
    runs = displacements_in_units(jp.System((1.0,), rods), STEPS, end, shaking)
    errors = []
    for step, (x,) in zip(STEPS, runs, strict=True):
        x = x[: round(end / step) + 1 : round(0.4 / step)]
        errors.append(np.linalg.norm(x - path) / np.linalg.norm(path))
    assert abs(y[2]) > limit / 2
    assert errors[0] > 10 * errors[-1], errors
    assert errors[-1] < 1e-3


def test_gradients_batches_and_single_precision():
    """With friction, contact and an inerter: eager, jitted, batched, and in float32."""
    grid, law = jp.TimeGrid.until(6.0, 0.04), jp.KelvinVoigt(200.0, 0.6)

    def gap(c, dtype=float):
        system = pair((0.15, 0.3, c), friction=0.05, gap=0.4, contact=law, inerter=jp.Inerter(0.1))
        system, ground = jax.tree.map(lambda x: jnp.asarray(x, dtype), (system, SHAKING))
        return jp.demand(system, ground, grid, only=("min_gap",)).min_gap

    values = jnp.array([0.05, 0.2])
    ours = jax.jit(jax.vmap(jax.value_and_grad(gap)))(values)
    for c, value, slope in zip(values, *ours, strict=True):
        assert float(gap(c)) == pytest.approx(float(value), rel=1e-12)
        central = (gap(c + 1e-5) - gap(c - 1e-5)) / 2e-5
        assert float(slope) == pytest.approx(float(central), rel=1e-5)
        with pytest.warns(jp.PlausibilityWarning, match="float32"):
            single = gap(c, jnp.float32)
        assert float(single) == pytest.approx(float(value), rel=1e-3)


def test_in_si_they_are_those_of_the_dimensionless_row():
    """Between the floors of buildings; a brace of a power law that is ever stiffer tends to it."""
    left = jp.Building.from_period(mass=500e3, period=0.9, damping_ratio=0.05)
    right = jp.ShearBuilding.from_period(2, 300e3, period=0.6, damping_ratio=0.05)
    shaking = jp.Pulse(0.8, 0.9, 3.0, time_unit="s")
    grid = jp.TimeGrid.until(8.0, 0.004)

    def linked(damper):
        return jp.Buildings((left, right), (jp.FloorLink(0, 0, gap=0.3, damper=damper),))

    buildings = linked(jp.Rod(jp.Dashpot(1e6)))
    in_si = jp.demand(buildings, shaking, grid)
    row, scales = buildings.dimensionless()
    without_units = jp.demand(row, scales.to_dimensionless(shaking), scales.grid(8.0, 0.004))
    assert float(without_units.min_gap * scales.length) == pytest.approx(float(in_si.min_gap))
    force = float(in_si.rods[-1].peak_force)
    assert float(without_units.rods[-1].peak_force * scales.force) == pytest.approx(force)
    braced = jp.demand(linked(jp.Rod(jp.PowerLaw(1e6, 1.0), 1e9)), shaking, grid)
    assert float(braced.min_gap) == pytest.approx(float(in_si.min_gap), rel=2e-3)
    assert 0 < float(in_si.min_gap) < 0.29


def test_what_slip_owes_is_paid():
    """A pair with a dashpot, of which friction to the ground stops one block: smooth in its speed.

    The instant of the stop within a step must not be seen in what the other block does.
    """
    rods = [jp.Rod(SPRING, 1e-3, (mass, G)) for mass in (0, 1)]
    rods.append(jp.Rod(jp.Dashpot(1.0), ends=(0, 1)))
    system = jp.System((1.0, 1.0), rods, (jp.Link((0, G), friction=1.0),))
    still, grid = jp.Ricker(0.0, 2.0, 2.0), jp.TimeGrid(0.05, 20)

    @jax.jit
    @jax.vmap
    def end(speed):
        start = jp.InitialState((0.0, 0.0), (speed, 0.5))
        return jp.simulate(system, still, grid, initial=start).masses[1].x[-1]

    speeds = np.linspace(0.4, 0.55, 31)
    x = np.asarray(end(jnp.asarray(speeds)))
    rough = x - np.polynomial.Polynomial.fit(speeds, x, 5)(speeds)
    assert np.abs(rough).max() < 1e-5  # 7e-5 if it were owed with the other sign
    assert (np.diff(rough) / np.diff(speeds)).std() < 5e-4


def test_steps_that_are_long_for_a_dashpot_beside_contact_are_told():
    link = {"friction": 0.05, "gap": 0.1, "contact": jp.KelvinVoigt(200.0, 0.6)}
    strong = pair((0.0, 30.0, 0.0), **link)
    words = "link 1–2, floor 1: dt c/m is 0.6.*, with c of the dashpots .* take dt 1.5.* times"
    coarse = jp.TimeGrid(0.04, 100)
    with pytest.warns(jp.PlausibilityWarning, match=words):
        jp.demand(strong, SHAKING, coarse)
    assert imprecise(strong, jp.TimeGrid(0.01, 400), ()) == []
    assert imprecise(pair((0.0, 30.0, 0.0), friction=0.05), coarse, ()) == []


def test_their_energy_is_that_of_the_force_over_the_rate():
    response = jp.simulate(pair(friction=0.05), SHAKING, jp.TimeGrid.until(END, 0.01))
    terms, taken = response.energy, [rod.dissipated[-1] for rod in response.rods[2:]]
    power = [rod.force**2 / c for rod, c in zip(response.rods[2:], COEFFICIENTS, strict=True)]
    work = [float(np.trapezoid(np.asarray(x), np.asarray(response.time))) for x in power]
    np.testing.assert_allclose(taken, work, rtol=1e-3)
    scalars = [rod.dissipated_energy for rod in response.demand.rods[2:]]
    np.testing.assert_array_equal(scalars, taken)
    springs = zip(response.rods[:2], STIFFNESSES, strict=True)
    stored = sum(float(rod.force[-1] ** 2) / k / 2 for rod, k in springs)
    assert float(terms.rods[-1]) == pytest.approx(sum(work) + stored, rel=2e-3)


def test_a_batch_has_the_stability_limit_of_its_least():
    limits = []
    for ratio in (2.0, [2.0, 3.0], 3.0):
        pair_of_paper = dataclasses.replace(jp.paper.structures(), stiffness_ratio=np.array(ratio))
        limits.append(jp.stability_limit(pair_of_paper))
    assert limits[1] == limits[2] < limits[0]


test_wrong_dashpots_are_named = refusals(
    (lambda: jp.Dashpot(-1.0), "Dashpot: coefficient = -1 must be finite and not negative"),
    (
        lambda: jp.System(
            (1.0,), (jp.Rod(SPRING, 1.0, (0, G)), jp.Rod(jp.Dashpot(1.0), 5.0, (0, G)))
        ),
        r"System: rods\.1\.stiffness = 5\.0 must be left out for Dashpot",
    ),
    (lambda: jp.Rod(SPRING), "Rod: stiffness = None must be positive for ZenerRod"),
    (
        lambda: jp.System((1.0,), (jp.Rod(jp.Dashpot(1.0), ends=(0, G)),)),
        "masses.0 must be tied to the ground by rods, .*; dashpots hold no mass",
    ),
    (
        lambda: jp.System((1.0,), (jp.Rod(jp.Dashpot(1.0), ends=((0, 2.0),)),)),
        "masses.0 must be tied to the ground by rods",
    ),
    (
        lambda: dataclasses.replace(pair(), rods=pair().rods[::-1]),
        "rods.0, a dashpot, must come after the rods with a stiffness that tie its ends",
    ),
    (
        lambda: jp.Storeys((1.0, 1.0), jp.Rod(jp.Dashpot(1.0))),
        "Storeys: rods.0 must have a stiffness, as it is a storey: a dashpot holds no floor",
    ),
)
