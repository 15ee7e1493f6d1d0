"""Ends with weights and shares of the ground's motion: storeys on footings that sway and rock.

The references know nothing of steps: linear equations by SciPy, and a solver from event to event.
"""

import dataclasses
import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import eigh

import jaxpound as jp
from jaxpound.model import parameters
from tests.simulation.contact import rods_without_memory as exact
from tests.simulation.pairs import SHAKING, in_unit_of_time

G = jp.GROUND
SHARES = (1, 1, 0)
STEPS, END = (0.04, 0.02, 0.01), 6.0
GRID = jp.TimeGrid(STEPS[0], round(END / STEPS[-1]))
INSTANTS = GRID.dt * np.arange(1, round(END / GRID.dt) + 1)
WAVES = exact.ricker(SHAKING.amplitude, SHAKING.periods, SHAKING.arrivals)


@jax.jit
def along(system, way, unit, ground=SHAKING):
    """Displacements and their derivative along a way, in a unit of time.

    A run in a unit of time in which the grid's step is a shorter one needs no other program. Of the
    response the program has nothing else, which compiles in two thirds of the time.
    """

    def displacements(system):
        response = jp.simulate(*in_unit_of_time(unit, system, ground), GRID)
        return jnp.stack([mass.x for mass in response.masses], -1)

    return jax.jvp(displacements, (system,), (way,))


def at_instants(system, way, step):
    """Displacements and their derivative at ``INSTANTS``, of a run with this step."""
    series, unit = along(floats(system), floats(way), step / GRID.dt), round(GRID.dt / step)
    return [np.asarray(x)[unit::unit][: len(INSTANTS)] for x in series]


def floats(tree):
    return jax.tree.map(lambda x: jnp.asarray(x, float), tree)


def between(system, other):
    """The way from one system to another."""
    return jax.tree.map(lambda x, y: y - x, system, other)


def on_footing(height=1.3, rocking=8.0, times=(0.02, 0.1), material=None):
    """A floor, its footing that sways, and the rotation of the footing, an inertia."""
    soil = jp.ZenerRod(1.0, *times) if material is None else material
    storey = jp.Rod(soil, 4.0, ((0, 1.0), (1, -1.0), (2, -height)))
    rods = storey, jp.Rod(soil, 20.0, (1, G)), jp.Rod(soil, rocking, ((2, 1.0),))
    return jp.System((1.0, 0.5, 0.3), rods, influence=SHARES)


def matrices_of_footing(height, rocking):
    """Masses, stiffnesses of the rods, and their elongations by displacement."""
    elongations = np.array([[1.0, -1.0, -height], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    return np.array([1.0, 0.5, 0.3]), np.array([4.0, 20.0, rocking]), elongations


def rates_of_footing(numbers, times=(0.02, 0.1)):
    """The matrix of the linear equations of x, x' and f, with f + τf f' = K (e + τx e')."""
    (m, k, b), none, (tau_f, tau_x) = matrices_of_footing(*numbers), np.zeros((3, 3)), times
    stretched = k[:, None] * b / tau_f
    return np.block(
        [
            [none, np.eye(3), none],
            [none, none, -b.T / m[:, None]],
            [stretched, tau_x * stretched, -np.eye(3) / tau_f],
        ]
    )


@functools.cache
def exact_footing(times):
    """Displacements and their derivatives by the height and the rocking stiffness."""
    numbers, small = np.array([1.3, 8.0]), 1e-3
    matrix, changes = rates_of_footing(numbers, times), []
    for change in small * np.eye(2):  # differences are exact: the matrix is bilinear
        low, high = (rates_of_footing(numbers + x, times) for x in (-change, change))
        changes.append((high - low) / (2 * small))

    def rates(t, state):
        z, *slopes = state.reshape(3, 9)
        shaken = np.zeros(9)
        shaken[3:6] = np.multiply(SHARES, WAVES(t))
        moved = [matrix @ y + a @ z for y, a in zip(slopes, changes, strict=True)]
        return np.concatenate([matrix @ z - shaken, *moved])

    tight = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-12, "max_step": 0.05}
    run = solve_ivp(rates, (0, END), np.zeros(27), t_eval=INSTANTS, **tight)
    return run.y.reshape(3, 9, -1)[:, :3].swapaxes(1, 2)


@pytest.mark.parametrize("times", [(0.02, 0.1), (0.1, 0.1)], ids=["viscous", "elastic"])
def test_a_storey_on_a_footing_that_sways_and_rocks_is_of_second_order(times):
    """In its displacements, and their derivatives by the height and the rocking stiffness."""
    system, references = on_footing(times=times), exact_footing(times)
    others = on_footing(2.3, times=times), on_footing(rocking=9.0, times=times)
    assert np.abs(references[0, :, 2]).max() > 0.03  # it rocks
    for slope, other in zip(references[1:], others, strict=True):
        errors = []
        for step in STEPS:
            ours = at_instants(system, between(system, other), step)
            pairs = zip(ours, (references[0], slope), strict=True)
            errors.append([np.linalg.norm(x - y) / np.linalg.norm(y) for x, y in pairs])
        errors = np.array(errors)
        np.testing.assert_allclose(errors[:-1] / errors[1:], 4.0, rtol=0.25)
        assert (errors[-1] < (2e-3, 6e-3)).all()


def test_the_modes_of_a_footing_are_those_of_its_equations():
    """Eigenvalues of viscous rods; frequencies, shapes, shares and the stable step of elastic."""
    eigenvalues = np.linalg.eigvals(rates_of_footing((1.3, 8.0)))
    vibrations = sorted(eigenvalues[eigenvalues.imag > 1e-9], key=abs)
    modes = jp.modes(on_footing())
    np.testing.assert_allclose(modes.eigenvalues, vibrations, rtol=1e-8)
    np.testing.assert_allclose(modes.participation.sum(), 1.0, rtol=1e-12)

    elastic = on_footing(material=jp.ZenerRod(1.0, 0.1, 0.1))
    m, k, b = matrices_of_footing(1.3, 8.0)
    squares, shapes = eigh(b.T * k @ b, np.diag(m))
    modes = jp.modes(elastic)
    np.testing.assert_allclose(modes.frequencies, np.sqrt(squares), rtol=1e-9)
    shares = (np.multiply(SHARES, m) @ shapes) ** 2 / 1.5
    np.testing.assert_allclose(modes.participation, shares, rtol=1e-8)
    largest = shapes[np.abs(shapes).argmax(0), range(3)]
    np.testing.assert_allclose(modes.shapes, shapes / largest, rtol=0, atol=1e-8)
    limit = jp.stability_limit(elastic)
    assert limit == pytest.approx(2 / np.sqrt(squares[-1]), rel=1e-9)
    # Runs are stable up to it.
    shaken = jp.Ricker(0.4, 4.0, 6.0)
    assert np.isfinite(jp.demand(elastic, shaken, jp.TimeGrid(0.999 * limit, 100)).pga)
    with pytest.raises(ValueError, match="stability limit"):
        jp.demand(elastic, shaken, jp.TimeGrid(1.001 * limit, 100))


def rocking_neighbours(seed, law):
    """A storey on a footing that rocks, and a column beside it.

    Masses are floor, footing, rotation and column. An edge of the footing has walls on both
    sides; friction is between the floor's height and the column. Both joints share the rotation.
    """
    draw = np.random.default_rng(seed)

    def near(x):
        return float(x * draw.uniform(0.8, 1.25))

    height, edge = near(1.2), near(0.5)
    soil = [jp.ZenerRod(1.0, near(0.03), near(0.12)) for _ in range(4)]
    rods = (
        jp.Rod(soil[0], near(5.0), ((0, 1.0), (1, -1.0), (2, -height))),
        jp.Rod(soil[1], near(9.0), ((1, 1.0),)),
        jp.Rod(soil[2], near(6.0), ((2, 1.0),)),
        jp.Rod(soil[3], near(7.0), ((3, 1.0),)),
    )
    laws = {"newton": jp.Newton(near(0.6)), "kelvin": jp.KelvinVoigt(near(200.0), near(0.6))}
    wall = jp.Link(
        ((1, 1.0), (2, edge)),
        friction=near(0.02),
        gap=(near(0.04), near(0.05)),
        contact=laws[law],
    )
    damper = jp.Link(((1, 1.0), (2, near(1.1)), (3, -1.0)), friction=near(0.08))
    masses = near(1.0), near(0.6), near(0.25), near(0.8)
    return jp.System(masses, rods, (wall, damper), influence=(1, 1, 0, 1))


def at_rest(seed, both):
    """The rocking neighbours, in touch for long: with near walls, or the left and each other."""
    system, law = rocking_neighbours(seed, "newton"), jp.Newton(0.3)
    right, left, damper = system.links
    right, left = (dataclasses.replace(x, gap=0.4 * x.gap, contact=law) for x in (right, left))
    if not both:
        return dataclasses.replace(system, links=(right, left, damper))
    wall = dataclasses.replace(right, gap=left.gap, weights=tuple(-x for x in right.weights))
    damper = dataclasses.replace(damper, gap=0.02, contact=law)
    return dataclasses.replace(system, links=(wall, damper))


def dense(seed, n, n_joints, law):
    """Unknowns that all rods and joints see with weights, the last of them a rotation."""
    draw = np.random.default_rng(seed)

    def ends(own):
        """Mostly of one unknown, whose weight is near 1."""
        weights = 0.5 * draw.uniform(-1, 1, n)
        weights[own] = draw.uniform(0.8, 1.2)
        return tuple(enumerate(weights.tolist()))

    rods = tuple(
        jp.Rod(jp.ZenerRod(1.0, *draw.uniform((0.02, 0.08), (0.05, 0.2))), k, ends(i))
        for i, k in enumerate(draw.uniform(3.0, 9.0, n))
    )
    links = [jp.Link(ends(j), draw.uniform(0.02, 0.1)) for j in range(n_joints)]
    if law:
        gap, stiffness, e = draw.uniform((0.03, 100.0, 0.4), (0.08, 300.0, 0.8))
        links[0] = dataclasses.replace(links[0], gap=gap, contact=jp.KelvinVoigt(stiffness, e))
    influence = (*np.linspace(0.9, 0.6, n - 1).tolist(), 0.0)  # of all seeds, as it is static
    return jp.System(tuple(draw.uniform(0.5, 1.2, n)), rods, tuple(links), influence=influence)


def weighted(ends, weights):
    """Masses with weights, of two ends 1 and −1; two ends are those of the reference."""
    if not weights:
        return tuple((end, sign) for end, sign in zip(ends, (1.0, -1.0), strict=True) if end != G)
    return tuple(zip(ends.masses, map(float, weights), strict=True))


def frame_of(system):
    """The reference's masses, springs, sliders and faces of a system."""
    rods = tuple(
        exact.Spring(rod.stiffness, rod.material.tau_f, rod.material.tau_x, ends)
        for rod in system.rods
        for ends in [weighted(rod.ends, rod.weights)]
    )
    sliders, faces = [], []
    for link in system.links:
        side = getattr(link.ends, "side", 1)
        if side > 0:  # a left face has the weights of the right face before it
            ends = weighted(link.ends, link.weights)
            sliders.append(exact.Slider(link.friction, ends))
        if isinstance(link.contact, jp.Newton):
            law = float(link.contact.restitution)
        elif link.contact is not None:
            mass = exact.effective_mass(ends, system.masses)
            law = exact.kelvin_voigt(link.contact.stiffness, link.contact.restitution, mass)
        if link.contact is not None:
            faces.append(exact.Face(len(sliders) - 1, side, float(link.gap), law))
    return exact.Frame(system.masses, rods, tuple(sliders), tuple(faces), system.influences)


SMALL = 1e-4


def reference(system, way, frame=frame_of, apart=1e-6):
    """Displacements and their derivative, from event to event, and the kinds of events ``apart``.

    ``frame`` makes the solver's frame of a system.
    """
    runs = []
    for change in (-SMALL, SMALL):
        moved = jax.tree.map(lambda x, y, change=change: x + change * y, system, way)
        run = exact.Run(frame(moved), WAVES, longest=0.02)
        path, log = run.path(INSTANTS), [(-1.0, "start", 0), *run.log]
        # What ends rebounds at an instant, a touch or a turn, is decided by rounding.
        kinds = [new[1] for old, new in itertools.pairwise(log) if new[0] > old[0] + apart]
        runs.append((path, kinds))
    (low, kinds), (high, others) = runs
    assert kinds == others
    return (low + high) / 2, (high - low) / (2 * SMALL), kinds


def errors_along(row, way, path, slope, steps):
    """Of displacements of a row, and of their derivative along a way, at each step."""
    system, system_way = jax.jvp(jp.Row.system, (jax.tree.map(jnp.asarray, row),), (way,))
    errors = []
    for step in steps:
        pairs = zip(at_instants(system, system_way, step), (path, slope), strict=True)
        errors.append([np.linalg.norm(x - y) / np.linalg.norm(y) for x, y in pairs])
    return np.array(errors).T.tolist()


def relative_way(system, seed):
    """A way along which all numbers but orders change by shares of up to .5 of their own."""
    draw = np.random.default_rng(seed)

    def change(path, x):
        share = draw.uniform(-0.5, 0.5)
        return share * x if np.isfinite(x) and "order" not in str(path[-1]) else 0.0

    return jax.tree_util.tree_map_with_path(change, system)


CASES = {f"newton {seed}": (rocking_neighbours, seed, "newton") for seed in (0, 3, 7)}
CASES |= {f"newton, one at rest {seed}": (at_rest, seed, False) for seed in (0, 1)}
CASES |= {f"newton, both at rest {seed}": (at_rest, seed, True) for seed in (0, 1)}
CASES |= {f"kelvin {seed}": (rocking_neighbours, seed, "kelvin") for seed in (0, 1, 2)}
CASES |= {f"3 unknowns {seed}": (dense, seed, 3, 2, "kelvin") for seed in range(3)}
CASES |= {f"5 unknowns {seed}": (dense, seed, 5, 3, None) for seed in range(3)}


@pytest.mark.parametrize("name", CASES)
def test_joints_that_share_a_rotation_are_of_second_order(name):
    """In displacements and their derivative along a way of all numbers.

    By Newton's law the derivative of a path jumps at impacts, at instants that have an error of
    their own: of its errors the median is compared. Seeds are those without touches so slow that
    the reference, changed by as much as an error at the longest step, has them or not.
    """
    make, seed, *rest = CASES[name]
    system = make(seed, *rest)
    way = relative_way(system, seed)
    path, slope, kinds = reference(system, way)
    errors = []
    for step in STEPS:
        x, along_way = at_instants(system, way, step)
        of_path = np.linalg.norm(x - path) / np.linalg.norm(path)
        if name.startswith("newton"):
            of_slope = np.median(np.abs(along_way - slope)) / np.median(np.abs(slope))
        else:
            of_slope = np.linalg.norm(along_way - slope) / np.linalg.norm(slope)
        errors.append((of_path, of_slope))
    coarse, _, fine = np.array(errors)
    assert kinds.count("turn") > 5
    assert "5 unknowns" in name or "touch" in kinds
    assert (coarse > 10 * fine).all(), errors  # 16 would be of second order
    assert (fine < (1e-3, 5e-3)).all(), errors


def plain(i, j=G):
    return i, j


def with_weights(i, j=G):
    return ((i, 1.0),) if j == G else ((i, 1.0), (j, -1.0))


SOIL = jp.ZenerRod(0.5, 0.02, 0.1)


def neighbours(ends, touching):
    """Two storeys beside one; all that a link may have, by two ends or by weights."""
    storeys = ((0, G), 6.0), ((1, 0), 5.0), ((2, G), 8.0)
    rods = tuple(jp.Rod(SOIL, k, ends(*pair)) for pair, k in storeys)
    if touching:
        law, inerter = jp.KelvinVoigt(200.0, 0.6), jp.Inerter(0.1)
        links = [jp.Link(ends(1, 2), 0.03, (0.05, 0.06), law, inerter=inerter)]
    else:
        gain, damper = jp.VelocityFriction(0.05, 0.1), jp.Rod(jp.PowerLaw(0.1, 0.5), 30.0)
        links = [jp.Link(ends(1, 2), 0.1, 0.6, inerter=jp.Inerter(0.2))]
        links.append(jp.Link(ends(0), 0.05, velocity_friction=gain, damper=damper))
    return jp.System((1.0, 0.8, 0.7), rods, tuple(links))


def displaced(system):
    """A sum of displacements at the end and before, and the smallest gap."""
    response = jp.simulate(system, SHAKING, jp.TimeGrid(0.04, 150))
    sums = [mass.x[-1] + mass.x[100] for mass in response.masses]
    return sum((1 + i) * x for i, x in enumerate(sums)), response


@functools.cache
def slopes(spelling, touching):
    """The sum, its gradient by path and the response."""
    system = floats(neighbours(spelling, touching))
    backwards = jax.jit(jax.value_and_grad(displaced, has_aux=True))
    (value, response), gradient = backwards(system)
    by_path = {x: float(parameters.get(gradient, x)) for x in parameters.paths(system)}
    return system, float(value), by_path, response


@pytest.mark.parametrize("touching", [False, True], ids=["friction", "contact"])
def test_two_ends_are_weights_of_1_and_minus_1(touching):
    _, value, gradient, response = slopes(plain, touching)
    _, same, slopes_by_weights, other = slopes(with_weights, touching)
    assert same == pytest.approx(value, rel=1e-12)
    size = max(abs(x) for x in gradient.values())
    for path, slope in gradient.items():
        assert slopes_by_weights[path] == pytest.approx(slope, rel=1e-9, abs=1e-11 * size), path
    assert {x for x in slopes_by_weights if x not in gradient} >= {"rods.1.weights.1"}
    if touching:
        assert response.demand.n_impacts_1 > 0
        assert response.demand.n_impacts_2 > 0
    for name in ("masses", "rods", "links"):
        for ours, theirs in zip(getattr(response, name), getattr(other, name), strict=True):
            for field in dataclasses.fields(ours):
                x, y = getattr(ours, field.name), getattr(theirs, field.name)
                if field.name not in ("ends", "weights") and isinstance(x, jax.Array):
                    np.testing.assert_allclose(x, y, rtol=1e-9, atol=1e-12, err_msg=field.name)


@pytest.mark.parametrize("touching", [False, True], ids=["friction", "contact"])
def test_what_all_weights_of_an_element_share_is_in_its_other_numbers(touching):
    """Displacements depend on w μ, w² K and gap/w alone: so the gradients by these cancel."""
    system, _, gradient, _ = slopes(with_weights, touching)

    def change(path):
        return gradient[path] * float(parameters.get(system, path))

    def by_weights(element):
        return sum(change(x) for x in gradient if x.startswith(f"{element}.weights"))

    for rod in range(3):
        stiffness = change(f"rods.{rod}.stiffness")
        assert by_weights(f"rods.{rod}") == pytest.approx(2 * stiffness, rel=1e-8)
    link = by_weights("links.0")
    others = change("links.0.friction") + 2 * change("links.0.inerter.inertance")
    if touching:
        link += by_weights("links.1")
        others += sum(2 * change(f"links.{k}.contact.stiffness") for k in (0, 1))
        others -= sum(change(f"links.{k}.gap") for k in (0, 1))
    assert abs(link) > 1e-3
    assert link == pytest.approx(others, rel=1e-7)


def test_the_unit_of_a_rotation_changes_nothing():
    """In another unit of angle, a third of it, the inertia is a ninth and arms are a third."""
    system, unit = rocking_neighbours(0, "kelvin"), 3.0
    others = {"masses.2": system.masses[2] / unit**2}
    for name in ("rods", "links"):
        for k, element in enumerate(getattr(system, name)):
            # A left face has the weights of its right face, and none of its own.
            pairs = zip(element.ends.masses, element.weights, strict=bool(element.weights))
            for number, (mass, weight) in enumerate(pairs):
                if mass == 2:
                    others[f"{name}.{k}.weights.{number}"] = weight / unit
    scaled = parameters.put(system, others)
    program = jax.jit(lambda system: jp.simulate(system, SHAKING, SHORT))
    run, other = (jax.device_get(program(floats(s))) for s in (system, scaled))
    x, y = (np.stack([mass.x for mass in response.masses], -1) for response in (run, other))
    np.testing.assert_allclose(y, x * [1.0, 1.0, unit, 1.0], rtol=0, atol=1e-10)
    assert run.demand.n_impacts_1 > 0
    for name in ("elongations", "absolute_accelerations"):
        for k, (a, b) in enumerate(zip(getattr(run, name), getattr(other, name), strict=True)):
            turned = unit if name == "absolute_accelerations" and k == 2 else 1.0
            np.testing.assert_allclose(b, a * turned, rtol=0, atol=1e-9)
    np.testing.assert_allclose(other.energy.input, run.energy.input, rtol=0, atol=1e-10)


def sliding(seed):
    """The rocking neighbours without walls."""
    system = rocking_neighbours(seed, "kelvin")
    return dataclasses.replace(system, links=system.links[2:])


SHORT = jp.TimeGrid(0.04, 150)


def peaks(system):
    demand = jp.demand(system, SHAKING, SHORT)
    sizes = [mass.peak_x + mass.peak_acceleration for mass in demand.masses]
    return sum(sizes) + demand.friction_work + demand.rods[0].peak_force, demand


def test_a_batch_with_weights_is_a_loop_and_both_modes_agree():
    """And a demand has the peaks of its response, also in single precision."""
    systems = [floats(sliding(seed)) for seed in range(3)]
    batch = jax.tree.map(lambda *x: jnp.stack(x), *systems)
    backwards = jax.jit(jax.vmap(jax.value_and_grad(peaks, has_aux=True)))
    (values, _), gradients = backwards(batch)
    forwards = jax.jit(lambda x, way: jax.jvp(peaks, (x,), (way,), has_aux=True))
    for k, system in enumerate(systems):
        way = floats(relative_way(sliding(k), k))
        value, slope, demand = forwards(system, way)
        assert float(values[k]) == pytest.approx(float(value), rel=1e-11)
        parts = jax.tree.map(lambda x, y, k=k: x[k] * y, gradients, way)
        assert sum(map(float, jax.tree.leaves(parts))) == pytest.approx(float(slope), rel=1e-8)
    response = jp.simulate(system, SHAKING, SHORT)
    np.testing.assert_allclose(
        *map(jax.tree.leaves, (demand, response.demand)), rtol=1e-11, atol=1e-13
    )
    for mass, acceleration, peak in zip(
        response.masses, response.absolute_accelerations, demand.masses, strict=True
    ):
        assert np.abs(mass.x).max() <= peak.peak_x < 1.02 * np.abs(mass.x).max()
        assert peak.peak_acceleration > 0.999 * np.abs(acceleration).max()
    assert response.energy.relative_residual < 2e-2
    single = jp.demand(*jax.tree.map(np.float32, (system, SHAKING)), SHORT)
    assert {x.dtype for x in jax.tree.leaves(single)} == {jnp.dtype("float32")}
    np.testing.assert_allclose(*map(jax.tree.leaves, (single, demand)), rtol=5e-3, atol=1e-4)
