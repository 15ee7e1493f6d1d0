"""Ends with weights: rotations, against a reference from event to event and against themselves."""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import eigh

import jaxpound as jp
from tests.reference import load
from tests.simulation.contact.rods_without_memory import (
    Face,
    Frame,
    Run,
    Slider,
    Spring,
    between,
    ricker,
    rows,
)
from tests.simulation.pairs import in_unit_of_time
from tests.simulation.test_initial import coulomb
from tests.simulation.weighted import CASES, END, FAR, INSTANTS, footing, solved

# -- the reference itself ----------------------------------------------------------------------


def elastic(build, by):
    """Springs in the place of rods: their relaxation is none."""
    return build(CASES["linear"].numbers | {"tau_f": 1.0, "tau_x": 1.0} | by)


def matrices(parts):
    """M and K of elastic rods."""
    b = rows(parts.rods, len(parts.masses))
    return np.diag(parts.masses), b.T @ (
        np.array([rod.stiffness for rod in parts.rods])[:, None] * b
    )


def test_the_reference_vibrates_at_the_frequencies_of_theory():
    """Each mode of a footing that sways and rocks, from its shape at rest."""
    parts = elastic(footing, {})
    mass, stiffness = matrices(parts)
    squares, shapes = eigh(stiffness, mass)
    t = np.array([0.7, 2.9])
    frame = Frame(parts.masses, parts.rods, influence=parts.influence)
    for square, shape in zip(squares, shapes.T, strict=True):
        x = Run(frame, lambda t: 0.0, start=(shape, 0 * shape)).path(t)
        np.testing.assert_allclose(
            x, np.outer(np.cos(math.sqrt(square) * t), shape), rtol=0, atol=1e-8
        )


def test_the_reference_decays_as_coulomb_says():
    """A rotation of inertia 2 on a spring of 2; friction acts at an arm of 1.6."""
    frame = Frame((2.0,), (Spring(2.0, 1.0, 1.0, ((0, 1.0),)),), (Slider(0.125, ((0, 1.6),)),))
    t = np.linspace(0.5, 14.0, 28)
    x = Run(frame, lambda t: 0.0, start=((1.05,), (0.0,))).path(t)
    exact, stops = coulomb(t, 1.05, 0.0, 0.1)
    assert 3 < stops < 16
    np.testing.assert_allclose(x[:, 0], exact, rtol=0, atol=1e-9)


def test_the_reference_holds_joints_that_share_a_rotation():
    """Two that stick leave one of three unknowns: an oscillator of one."""
    masses, wave = (1.0, 0.8, 0.3), ricker(0.2, [2.0], [1.5])
    rods = tuple(Spring(k, 1.0, 1.0, ((i, 1.0),)) for i, k in enumerate((2.0, 3.0, 1.0)))
    ends = ((0, 1.0), (2, 0.5)), ((1, 1.0), (2, -0.4))
    frame = Frame(masses, rods, tuple(Slider(50.0, e) for e in ends), (), (1.0, 1.0, 0.0))
    free = np.array([-0.5, 0.4, 1.0])  # what neither joint sees
    mass, stiffness = free**2 @ masses, free**2 @ [2.0, 3.0, 1.0]
    load = (free * masses) @ frame.influence
    alone = Frame((mass,), (Spring(stiffness, 1.0, 1.0, ((0, 1.0),)),), influence=(load / mass,))
    t = np.array([1.0, 2.0, 4.5])
    x, turned = Run(frame, wave).path(t), Run(alone, wave).path(t)
    np.testing.assert_allclose(x, turned * free, rtol=0, atol=1e-9)
    assert np.abs(turned).min() > 0.01


def test_the_reference_takes_what_an_impact_takes():
    """A rotation without gravity and springs to speak of hits a stop at an arm, at 2.5 of time."""
    arm, e = 0.5, 0.6
    stop = Face(0, 1, 0.25, e)
    frame = Frame(
        (2.0,), (Spring(1e-14, 1.0, 1.0, ((0, 1.0),)),), (Slider(0.0, ((0, arm),)),), (stop,)
    )
    x = Run(frame, lambda t: 0.0, start=((0.0,), (0.2,))).path([2.0, 3.5])
    np.testing.assert_allclose(x[:, 0], (0.4, 0.5 - e * 0.2), rtol=0, atol=1e-10)


def test_the_reference_of_the_file_is_the_one_that_it_says():
    """Of the first four units of time of each case."""
    for name, case in CASES.items():
        x = solved(case).path(INSTANTS[:4])
        np.testing.assert_allclose(x, load("weights")["cases"][name]["x"][:4], rtol=0, atol=1e-8)


# -- values and derivatives of the library -----------------------------------------------------


def system_of(parts):
    """In the words of the library."""
    rods = [
        jp.Rod(jp.ZenerRod(1.0, rod.tau_f, rod.tau_x), rod.stiffness, rod.ends)
        for rod in parts.rods
    ]
    links = []
    for joint in parts.joints:
        options = {}
        if joint.gap:
            law = jp.KelvinVoigt(*joint.law) if len(joint.law) == 2 else jp.Newton(*joint.law)
            gap = tuple(np.inf if side is FAR else side for side in joint.gap)
            options = {"gap": gap[1] if joint.gap[0] is FAR else gap, "contact": law}
        links.append(jp.Link(joint.ends, friction=joint.friction, **options))
    return jp.System(parts.masses, rods, links, influence=parts.influence)


@functools.partial(jax.jit, static_argnums=(0, 1))
def along(build, grid, numbers, direction, unit, ground, start):
    """Displacements, (instants, masses), and their derivatives in a direction of the numbers.

    A run in a unit of time in which the step of the grid is a shorter one.
    """

    def path(numbers):
        initial = start and jp.InitialState(*start)
        parts = system_of(build(numbers)), jp.Ricker(*ground), initial
        system, shaking, initial = in_unit_of_time(unit, *parts)
        masses = jp.simulate(system, shaking, grid, initial=initial).masses
        return jnp.stack([mass.x for mass in masses], -1)

    return jax.jvp(path, (numbers,), (direction,))


def runs(case, grid, step, numbers=(), by=()):
    """A path at its instants until ``END``, and its derivatives by some numbers."""
    numbers = {k: jnp.asarray(float(x)) for k, x in (case.numbers | dict(numbers)).items()}
    ground, start = jax.tree.map(lambda x: jnp.asarray(x, float), (case.ground, case.start))
    slopes = {}
    for name in by or case.by[:1]:
        direction = {k: jnp.asarray(float(k == name)) for k in numbers}
        inputs = numbers, direction, step / grid.dt, ground, start
        x, slopes[name] = (np.asarray(y) for y in along(case.build, grid, *inputs))
    return x, slopes


FOOTING, DRAWN = (0.02, 0.01, 0.005), (0.04, 0.02, 0.01)
"""Steps: the fastest vibration of the footing, of period .26, asks for shorter ones."""
WITHIN = {
    "linear": (2e-5, 6e-5),
    "friction at the storey": (2e-5, 6e-4),
    "friction at the storey and an edge": (6e-5, 0.015),
    "friction at the middle of the footing": (3e-5, 1.5e-3),
    "pulled and let go": (1e-4, 0.015),
    "friction beside a neighbour": (3e-5, 7e-4),
    "a neighbour is hit": (3e-5, 5e-3),
    "the storey hits a wall": (5e-5, 6e-3),
    "edges hit walls": (3e-4, 8e-3),
    "the storey hits a wall by Newton's law": (6e-5, 7e-3),
    "an edge hits a wall by Newton's law": (2e-4, 0.02),
    "an edge comes to rest at a wall by Newton's law": (3e-4, 0.01),
    "random, 3 unknowns, seed 1": (3e-4, 0.01),
    "random, 3 unknowns, seed 2": (2e-4, 5e-4),
    "random, 4 unknowns, seed 1": (2e-4, 3e-3),
    "random, 4 unknowns, seed 3": (2e-4, 2e-3),
    "random, 5 unknowns, seed 1": (4e-4, 6e-3),
    "random, 5 unknowns, seed 5": (2e-4, 1e-3),
}
"""Errors of values and derivatives at the last step, in mean square over time, as shares."""


@pytest.mark.parametrize("name", CASES)
def test_values_and_derivatives_are_of_second_order(name):
    """By weights, frictions, inertias and gaps; as they are on average over time and masses."""
    case, exact = CASES[name], load("weights")["cases"][name]
    steps = DRAWN if name.startswith("random") else FOOTING
    grid = jp.TimeGrid(steps[0], round(END / steps[-1]))
    wanted = {"x": exact["x"]} | exact["derivatives"]
    errors = {key: [] for key in wanted}
    for step in steps:
        x, slopes = runs(case, grid, step, by=case.by)
        at = np.round(INSTANTS / step).astype(int)
        for key, path in ({"x": x} | slopes).items():
            sizes = np.abs(wanted[key]).max(0)
            errors[key].append(np.sqrt(np.mean(((path[at] - wanted[key]) / sizes) ** 2)))
    values, derivatives = WITHIN[name]
    for key, (first, _, last) in errors.items():
        assert first > 11 * last, (key, errors[key])  # 16 would be of second order
        assert last < (values if key == "x" else derivatives), (key, last)


# -- what must not matter ----------------------------------------------------------------------

SHORT = jp.TimeGrid(0.04, 100)
WAVE = jp.Ricker(0.4, [1.25, 2.0], [1.5, 2.5])


def assert_same(trees, **within):
    for leaf, other in zip(*map(jax.tree.leaves, trees), strict=True):
        np.testing.assert_allclose(leaf, other, **within)


@pytest.mark.parametrize("law", [jp.KelvinVoigt(500.0, 0.65), jp.Newton(0.65)])
def test_ends_without_weights_are_those_with_plus_and_minus_one(law):
    """To the last bit: two towers of two storeys, whose lower floors meet on either side."""
    steel, ground = jp.ZenerRod(0.5, 0.01, 0.05), jp.GROUND
    rods = {(0, ground): 6.0, (1, 0): 5.0, (ground, 2): 9.0, (3, 2): 8.0}

    def run(spelled, **influence):
        links = (
            jp.Link(spelled((0, 2)), friction=0.1, gap=(0.08, 0.05), contact=law),
            jp.Link(spelled((1, 3)), friction=0.05, gap=0.1, contact=law),
        )
        by_rod = [jp.Rod(steel, k, spelled(ends)) for ends, k in rods.items()]
        system = jp.System((1.0, 0.9, 1.1, 0.8), by_rod, links, **influence)
        return jp.simulate(system, WAVE, SHORT)

    plain = run(lambda ends: ends)
    assert float(plain.demand.pounds) > 0
    for ones in ({}, {"influence": (1, 1, 1, 1)}):
        weighted = run(lambda ends: between(*ends), **ones)
        for leaf, other in zip(*map(jax.tree.leaves, (plain, weighted)), strict=True):
            np.testing.assert_array_equal(leaf, other)


def test_the_unit_of_a_rotation_does_not_matter():
    """Degrees in the place of radians: weights times c, the inertia times c²."""
    case, grid = CASES["edges hit walls"], jp.TimeGrid(FOOTING[0], round(END / FOOTING[-1]))
    radians, degrees = (runs(case, grid, grid.dt, {"unit": x})[0] for x in (1.0, math.pi / 180))
    sizes = np.abs(radians).max(0)
    np.testing.assert_allclose(
        degrees * [1, 1, math.pi / 180] / sizes, radians / sizes, rtol=0, atol=1e-12
    )


def test_a_weight_of_0_is_none_and_its_derivative_is_not():
    """The footing's friction at its middle, by a weight of 0 and by no weight."""
    case = CASES["friction at the middle of the footing"]
    parts = case.build(case.numbers)
    *others, (mass, _) = parts.joints[1].ends
    assert mass == 2
    without = parts._replace(joints=(parts.joints[0], parts.joints[1]._replace(ends=(*others,))))
    responses = [jp.simulate(system_of(x), WAVE, SHORT) for x in (parts, without)]
    for mass, other in zip(*(response.masses for response in responses), strict=True):
        np.testing.assert_allclose(mass.x, other.x, rtol=0, atol=1e-14)


@functools.partial(jax.jit, static_argnums=0)
def response_of(build, numbers):
    response = jp.simulate(system_of(build(numbers)), WAVE, SHORT)
    return response, response.energy


def test_a_batch_is_a_loop_jit_is_eager_and_energy_balances():
    """By a weight of the joint with a gap."""
    case = CASES["random, 4 unknowns, seed 3"]
    several = [case.numbers | {"arm_gap": x} for x in (-0.6, -0.4, -0.2)]
    batch = {k: jnp.stack([jnp.asarray(by[k], float) for by in several]) for k in several[0]}
    responses, energies = jax.vmap(functools.partial(response_of, case.build))(batch)
    for i, by in enumerate(several):
        response, energy = response_of(
            case.build, jax.tree.map(lambda x: jnp.asarray(x, float), by)
        )
        together = jax.tree.map(lambda x, i=i: x[i], (responses, energies))
        assert_same(((response, energy), together), rtol=1e-9, atol=1e-11)
        assert np.abs(energy.residual).max() < 2e-2 * np.abs(energy.input).max()
    eager = jp.simulate(system_of(case.build(by)), WAVE, SHORT)
    assert_same((eager.demand, response.demand), rtol=1e-9, atol=1e-11)
    # What is reported of links is what their ends do.
    parts, x = case.build(by), np.stack([mass.x for mass in response.masses], -1)
    closings = (x @ rows(parts.joints, x.shape[1]).T).T
    joint = len(parts.joints) - 1
    np.testing.assert_allclose(
        eager.links[joint].gap, parts.joints[joint].gap[1] - closings[joint], rtol=0, atol=1e-12
    )
    assert (np.abs(eager.links[joint].friction) <= parts.joints[joint].friction * (1 + 1e-12)).all()


def test_the_limit_of_stability_is_that_of_theory():
    """2/ω of the fastest vibration, for weights of any size."""
    for by in ({}, {"height": 3.0}, {"unit": 0.1}):
        parts = elastic(footing, by)
        mass, stiffness = matrices(parts)
        fastest = math.sqrt(eigh(stiffness, mass, eigvals_only=True)[-1])
        assert jp.stability_limit(system_of(parts)) == pytest.approx(2 / fastest, rel=1e-9)
