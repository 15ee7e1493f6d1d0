"""Floors that hit columns, in runs: a solver from event to event, and the node without mass.

The references have formulas of their own for shares, stiffness and dashpot of a column.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jaxpound as jp
from jaxpound.model import Column
from jaxpound.model.ends import weighted
from tests.simulation.contact import rods_without_memory as exact
from tests.simulation.pairs import SHAKING
from tests.simulation.test_weights import STEPS, errors_along, reference, relative_way


def row(ends="fixed", side="right", ground=False, law=None, **column):
    """Two storeys beside one; a floor of one building hits a column of the other."""
    steel = jp.ZenerRod(1.0, 0.03, 0.12)
    high = jp.Storeys((1.0, 0.8), (jp.Rod(steel, 6.0), jp.Rod(steel, 5.0)))
    low = jp.Storeys((0.7,), jp.Rod(steel, 9.0))
    numbers = {"rigidity": 1.5, "position": 0.4, "height": 0.6} | column
    law = law or jp.KelvinVoigt(300.0, 0.6)
    floors = (0, 0 if ground else 1) if side == "right" else (0 if ground else 1, 0)
    link = jp.FloorLink(
        0, *floors, gap=0.05, contact=law, column=Column(ends=ends, side=side, **numbers)
    )
    return jp.Row((low, high) if side == "right" else (high, low), (link,))


def frame_of(row):
    """The reference's masses, springs and face."""
    system, (link,) = row.system(), row.links
    column, law = link.column, link.contact
    x, length = float(column.position), float(column.height)
    a, b = x * length, (1 - x) * length
    if column.ends == "fixed":
        w, k = 1 - b**2 * (3 * a + b) / length**3, 3 * column.rigidity * length**3 / (a * b) ** 3
    else:
        w, k = a / length, 3 * column.rigidity * length / (a * b) ** 2
    hit, above, *below = {"right": (0, 2, 1), "left": (2, 1, 0)}[column.side]
    if link.floor == link.other_floor:  # the storey above the ground
        above, below = {"right": (1, []), "left": (0, [])}[column.side]
    ends = ((hit, 1.0), (above, -w), *((mass, w - 1) for mass in below))
    ends = ends if column.side == "right" else tuple((mass, -share) for mass, share in ends)
    mass, decrement = exact.effective_mass(ends, system.masses), -np.log(law.restitution)
    dashpot = 2 * decrement / np.hypot(np.pi, decrement) * np.sqrt(law.stiffness * mass)
    share = k / (k + law.stiffness)

    def force(depth, speed, _):
        return share * law.stiffness * depth + share**2 * dashpot * speed

    rods = tuple(
        exact.Spring(rod.stiffness, rod.material.tau_f, rod.material.tau_x, weighted(rod))
        for rod in system.rods
    )
    faces = (exact.Face(0, 1, float(link.gap), force),)
    return exact.Frame(system.masses, rods, (exact.Slider(0.0, ends),), faces)


CASES = [("fixed", "right", False), ("fixed", "left", False), ("pinned", "right", False)]
CASES += [("pinned", "left", True)]


def errors_of(ends, side, ground, steps=STEPS):
    """Of displacements, and of their derivative along a way of all numbers, at each step."""
    structures = row(ends, side, ground)
    way = relative_way(structures, 1)
    path, slope, kinds = reference(structures, way, frame_of, apart=0.0)
    assert kinds.count("touch") > 2
    return errors_along(structures, way, path, slope, steps)


@pytest.mark.parametrize(("ends", "side", "ground"), CASES)
def test_a_floor_at_a_column_is_of_second_order(ends, side, ground):
    """In displacements, and their derivative along a way of all numbers, the column's included."""
    errors = np.array(errors_of(ends, side, ground))
    assert (errors[:, 0] > 10 * errors[:, -1]).all(), errors  # 16 would be of second order
    assert (errors[:, -1] < (1e-3, 1e-2)).all(), errors


def collision(share, restitution, in_series):
    """Largest force and speed after of an impact of mass 1 at speed 1 on contact and column.

    The contact's stiffness is 1, and ``share`` of its motion is the column's 1 less; with the node
    between them, or by the law of contact that stands for both.
    """
    column, law = Column(1.0, position=0.5, height=1.0), jp.KelvinVoigt(1.0, restitution)
    column = dataclasses.replace(column, rigidity=share / (1 - share) / column.stiffness)
    k, damping = column.stiffness, 2 * float(law.damping_ratio)
    force = column.behind(law).force

    def rates(_, y):
        x, v, node, _ = y
        if in_series:
            p = k * (x - node)
            return [v, -p, (p - node) / damping, 0.0]
        return [v, -float(force(x, v, 1.0)), 0.0, 0.0]

    def released(_, y):
        return k * (y[0] - y[2]) if in_series else float(force(y[0], y[1], 1.0)) + (y[1] > 0)

    released.terminal, released.direction = True, -1
    run = solve_ivp(
        rates,
        (0, 100.0),
        [1e-9, 1.0, 0.0, 0.0],
        events=released,
        rtol=1e-7,
        atol=1e-10,
        max_step=0.05,
    )
    x, v, node, _ = run.y
    forces = (
        k * (x - node) if in_series else [float(force(*z, 1.0)) for z in zip(x, v, strict=True)]
    )
    return float(max(forces)), float(-v[-1])


WITHIN = {
    (0.65, 0.05): 1e-3,
    (0.65, 0.3): 0.01,
    (0.65, 0.7): 0.03,
    (0.4, 0.3): 0.04,
    (0.4, 0.7): 0.08,
}


@pytest.mark.parametrize(("restitution", "share"), WITHIN)
def test_the_law_of_both_is_near_that_of_a_node_without_mass(restitution, share):
    """The nearer, the softer the column is beside the contact and the less this damps."""
    (force, speed), (of_node, after) = (collision(share, restitution, x) for x in (False, True))
    assert force == pytest.approx(of_node, rel=WITHIN[restitution, share])
    assert speed == pytest.approx(after, rel=WITHIN[restitution, share])


def test_at_the_floor_it_is_the_link_of_the_floors():
    """Hit close below the floor above, a column is rigid and moves with this floor."""
    grid, near = jp.TimeGrid(0.02, 300), row(position=1 - 1e-5)
    aligned = dataclasses.replace(near, links=(dataclasses.replace(near.links[0], column=None),))
    ours, plain = (jp.demand(x, SHAKING, grid) for x in (near, aligned))
    assert plain.n_impacts > 2
    for name in ("peak_x1", "peak_x3", "peak_contact", "min_gap", "contact_work"):
        assert float(getattr(ours, name)) == pytest.approx(float(getattr(plain, name)), rel=1e-6)
    assert float(ours.peak_column_shear) == pytest.approx(float(ours.peak_contact), rel=1e-6)


def test_shear_energy_and_momentum():
    """Of the force w goes to the floor above and 1 − w below, where nothing is lost."""
    structures, grid = row(capacity=0.5), jp.TimeGrid(0.005, 1200)
    response = jp.simulate(structures, SHAKING, grid)
    demand, (link,) = response.demand, structures.links
    w = link.column.weight
    shear = max(w, 1 - w) * float(demand.peak_contact)
    assert float(demand.peak_column_shear) == pytest.approx(shear, rel=1e-12)
    assert float(demand.column_shear_ratio) == pytest.approx(shear / 0.5, rel=1e-12)
    assert float(response.energy.relative_residual) < 1e-3
    impulse = sum(impact.impulse for impact in response.impacts())
    rods = [np.trapezoid(np.asarray(rod.force), dx=0.005) for rod in response.rods]
    shaken = np.trapezoid(np.asarray(response.ground_acceleration), dx=0.005)
    loads = [-rods[0], rods[2] - rods[1], -rods[2]]
    masses = zip(response.masses, (0.7, 1.0, 0.8), loads, strict=True)
    gained = [m * (float(x.v[-1]) + shaken) - load for x, m, load in masses]
    np.testing.assert_allclose(gained, impulse * np.array([-1, 1 - w, w]), atol=2e-4)
    low, high = jp.floor_demands(structures, demand)
    np.testing.assert_allclose(low.contact_right, [demand.peak_contact])
    peaks = float(demand.peak_contact) * np.array([1 - w, w])
    np.testing.assert_allclose(high.contact_left, peaks)
    assert not np.any(low.contact_left)
    assert not np.any(high.contact_right)


def test_gradients_and_batches():
    """By rigidity, position and capacity, in reverse and in a batch."""
    grid = jp.TimeGrid(0.02, 300)

    def ratio(numbers):
        structures = row(rigidity=numbers[0], position=numbers[1], capacity=numbers[2])
        return jp.demand(structures, SHAKING, grid).column_shear_ratio

    at = jnp.array([1.5, 0.4, 0.5])
    values, slopes = jax.jit(jax.vmap(jax.value_and_grad(ratio)))(jnp.stack([at, 1.1 * at]))
    for x, value, slope in zip([at, 1.1 * at], values, slopes, strict=True):
        for i, change in enumerate(1e-5 * jnp.eye(3)):
            assert float(slope[i]) == pytest.approx(
                float(ratio(x + change) - ratio(x - change)) / 2e-5, rel=1e-4
            )
        assert float(ratio(x)) == pytest.approx(float(value), rel=1e-9)
    law = jp.KelvinVoigt(300.0, 1.0)  # without damping, too
    slope = jax.grad(lambda k: jp.demand(row(law=law, rigidity=k), SHAKING, grid).peak_contact)(1.5)
    assert np.isfinite(slope)
