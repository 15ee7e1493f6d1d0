"""Storeys and rows against exact linear motion, and what must hold of any row."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from tests import linear
from tests.refusals import refused
from tests.simulation.pairs import SHAKING as GROUND
from tests.simulation.pairs import displacements_in_units, in_unit_of_time

STEEL = jp.ZenerRod(0.5, 0.01, 0.05)
RUBBER = jp.ZenerRod(0.8, 0.05, 0.4)
SOFT = jp.ZenerRod(0.3, 0.02, 0.2)
GRID = jp.TimeGrid.until(12.0, dt=0.04)
LAW = jp.KelvinVoigt(300.0, 0.65)


def tower(n, materials, stiffness=30.0):
    """A building of n storeys of several materials, lighter and softer towards its top."""
    rods = [jp.Rod(materials[i % len(materials)], stiffness - i) for i in range(n)]
    return jp.Storeys(tuple(np.linspace(1.0, 0.7, n)), tuple(rods))


STEPS = (0.04, 0.02)


def shaken(building):
    """Displacements at every 0.2 of runs of these steps, shape (floors, instants) each."""
    x = displacements_in_units(building.system(), STEPS, 12.0)
    return [path[:, :: round(0.2 / dt)][:, :61] for path, dt in zip(x, STEPS, strict=True)]


def exact(building, fine=0.005):
    samples = GROUND.acceleration(fine * np.arange(round(12.0 / fine) + 1.0))
    return linear.positions(building.system(), np.asarray(samples), fine, round(0.2 / fine)).T


TOWERS = {"5": (5, (STEEL, RUBBER, SOFT)), "12": (12, (STEEL, RUBBER))}
TOWERS |= {"12 Zener": (12, (jp.ZenerRod(1.0, 0.05, 0.1),)), "dampers without friction": (3, None)}


@pytest.mark.parametrize(("n", "materials"), TOWERS.values(), ids=TOWERS)
def test_storeys_are_those_of_the_relaxation_spectrum(n, materials):
    """Rods of other orders in one building, against the matrix exponential of their spectra."""
    if materials is None:
        buildings = tower(n, (STEEL, RUBBER), 20.0), tower(n, (RUBBER,))
        building = jp.Row(buildings, jp.floor_links(buildings, friction=0.0, gap=0.5))
    else:
        building = tower(n, materials)
    reference = exact(building)
    rms = [np.sqrt(((x - reference) ** 2).mean()) for x in shaken(building)]
    assert rms[1] < 4e-3 * np.abs(reference).max()
    assert math.log2(rms[0] / rms[1]) == pytest.approx(2, abs=0.15)


def one_storey(material, mass, stiffness):
    return jp.Storeys((mass,), (jp.Rod(material, stiffness),))


def same_system(structures, system):
    leaves, structure = jax.tree.flatten(structures.system())
    return (leaves, structure) == jax.tree.flatten(system)


def test_buildings_of_one_storey_are_the_block_and_the_pair():
    """They are its system; the numbers of the pair's differ from theirs by rounding."""
    block = jp.System((1.0,), (jp.Rod(STEEL, 1.0, (0, jp.GROUND)),))
    assert same_system(one_storey(STEEL, 1.0, 1.0), block)
    buildings = one_storey(STEEL, 1.0, 1.0), one_storey(RUBBER, 0.5, 2.0)
    between = {"friction": 0.1, "gap": 0.3, "contact": LAW}
    row = jp.Row(buildings, jp.floor_links(buildings, **between))
    rods = jp.Rod(STEEL, 1.0, (0, jp.GROUND)), jp.Rod(RUBBER, 2.0, (1, jp.GROUND))
    assert same_system(row, jp.System((1.0, 0.5), rods, (jp.Link((0, 1), **between),)))
    pair = jp.AdjacentStructures(STEEL, RUBBER, 2.0, 2.0, 0.1, 0.3, LAW)
    leaves, structure = jax.tree.flatten(pair.system())
    assert structure == jax.tree.structure(row.system())
    np.testing.assert_allclose(leaves, jax.tree.leaves(row.system()), rtol=1e-14)


def three():
    left, right = tower(2, (STEEL, RUBBER), 12.0), tower(2, (RUBBER, STEEL), 20.0)
    buildings = left, one_storey(RUBBER, 1.5, 2.5), right
    return jp.Row(buildings, jp.floor_links(buildings, friction=0.05, gap=0.1, contact=LAW))


@pytest.mark.parametrize(
    ("lower", "upper"),
    [(jp.Newton(0.65), jp.Newton(0.65)), (None, jp.KelvinVoigt(2000.0, 0.65))],
    ids=["hit at both floors", "hit at the upper floor, linked at the lower"],
)
def test_derivatives_of_towers_that_collide_are_of_second_order(lower, upper):
    """Of all displacements, in mean square over time, along a random change of all parameters."""
    buildings = tower(3, (STEEL, RUBBER)), tower(2, (RUBBER, STEEL), 12.0)
    links = tuple(jp.FloorLink(0, i, i, 0.05, 0.03, law) for i, law in enumerate((lower, upper)))
    system = jax.tree.map(jnp.asarray, jp.Row(buildings, links).system())
    draw = np.random.default_rng(0)
    change = jax.tree.map(lambda x: x * draw.uniform(-1, 1), system)
    end, steps = 5.0, (0.02, 0.01, 0.005, 0.00125)  # the last is the reference
    grid = jp.TimeGrid(steps[0], round(end / steps[-1]))

    @jax.jit
    def along_change(unit):
        def displacements(system):
            response = jp.simulate(*in_unit_of_time(unit, system, GROUND), grid)
            n_impacts = response.demand.links[1].n_impacts
            return jnp.stack([mass.x for mass in response.masses]), n_impacts

        return jax.jvp(displacements, (system,), (change,), has_aux=True)

    x, slopes, n_impacts = zip(*(along_change(dt / grid.dt) for dt in steps), strict=True)
    assert min(n_impacts[:3]) >= 4
    for series, largest in ((x, 1e-3), (slopes, 5e-3)):
        *coarse, reference = (
            np.asarray(path)[:, : round(end / dt) + 1 : round(grid.dt / dt)]
            for path, dt in zip(series, steps, strict=True)
        )
        errors = [np.linalg.norm(path - reference) / np.linalg.norm(reference) for path in coarse]
        assert errors[1] < largest
        orders = np.log2(np.divide(errors[:-1], errors[1:]))
        np.testing.assert_allclose(orders, 2.05, atol=0.2)


def mirrored(row):
    last = len(row.buildings) - 1
    links = []
    for link in row.links[::-1]:
        floors = {"floor": link.other_floor, "next_floor": link.floor}
        links.append(dataclasses.replace(link, building=last - link.other_building, **floors))
    return jp.Row(row.buildings[::-1], tuple(links))


def long_run(row, ground=GROUND, unit=1.0):
    """In a unit of time in which a step of the grid is ``unit`` times as long."""
    return jp.simulate(*in_unit_of_time(unit, row.system(), ground), jp.TimeGrid(0.04, 1200))


@pytest.fixture(scope="module")
def touching():
    row = three()
    return row, long_run(row)


def test_a_row_touches_and_its_energy_balances(touching):
    """The balance is taken at a coarse step; of a fine one see the pairs' tests."""
    _, run = touching
    assert all(link.n_impacts >= 2 for link in run.demand.links)
    energy = run.energy
    assert np.abs(energy.residual).max() < 0.03 * np.abs(energy.input).max()
    assert energy.contact_lost[-1] > 1e-3 * np.abs(energy.input).max()


def test_mirrored_rows_mirror(touching):
    row, run = touching
    behind = jp.Ricker(-GROUND.amplitude, GROUND.periods, GROUND.arrivals)
    other = long_run(mirrored(row), behind)
    order = [3, 4, 2, 0, 1]  # floors of the mirrored row by those of the row
    for i, j in enumerate(order):
        np.testing.assert_allclose(run.masses[j].x, -other.masses[i].x, atol=1e-9)
    for link, back in zip(run.demand.links, other.demand.links[::-1], strict=True):
        for name in ("min_gap", "peak_contact", "friction_work", "n_impacts"):
            one, same = float(getattr(link, name)), float(getattr(back, name))
            assert one == pytest.approx(same, rel=1e-7)


def test_buildings_far_apart_move_alone(touching):
    row, _ = touching
    links = tuple(dataclasses.replace(link, friction=0.0, gap=50.0) for link in row.links)
    together = long_run(dataclasses.replace(row, links=links))
    alone = [mass for building in row.buildings for mass in long_run(building).masses]
    for mass, same in zip(together.masses, alone, strict=True):
        np.testing.assert_allclose(mass.x, same.x, atol=1e-12)
    assert not any(link.n_impacts for link in together.demand.links)


def test_equal_buildings_never_touch():
    """However narrow the gap; and dampers between them do nothing."""
    buildings = (tower(2, (STEEL, RUBBER)),) * 2
    row = jp.Row(buildings, jp.floor_links(buildings, friction=0.2, gap=1e-3, contact=LAW))
    for link in jp.demand(row, GROUND, GRID).links:
        assert link.n_impacts == 0
        assert link.min_gap == pytest.approx(1e-3, abs=1e-12)
        assert link.friction_work == pytest.approx(0, abs=1e-12)


def test_a_brace_is_a_damper_between_the_floors_of_a_building():
    """It slips by the drift of its storey, and a damper to the ground by the floor's own motion."""
    tall = tower(2, (STEEL,), 12.0)
    damper = jp.FloorLink(0, 0, friction=0.2, next_building=jp.GROUND)
    links = jp.FloorLink(0, 1, friction=0.3, next_building=0), damper
    row = jp.Row((tall,), links)
    assert [link.ends for link in row.system().links] == [(1, 0), (0, jp.GROUND)]
    run = jp.simulate(row, GROUND, GRID)
    lower, upper = run.masses
    np.testing.assert_allclose(run.links[0].slip_velocity, upper.v - lower.v, atol=1e-12)
    np.testing.assert_allclose(run.links[1].slip_velocity, lower.v, atol=1e-12)
    np.testing.assert_allclose(-run.links[0].gap, -np.inf)
    loose = tuple(dataclasses.replace(link, friction=0.0) for link in links)
    bare = jp.simulate(jp.Row((tall,), loose), GROUND, GRID)
    assert run.demand.rods[1].peak_drift < 0.9 * bare.demand.rods[1].peak_drift
    assert all(link.friction_work > 0 for link in run.demand.links)


def test_peaks_of_floors_are_those_of_their_series(touching):
    """Displacements and drifts of every floor, also through impacts; forces of the storeys."""
    row, coarse = touching
    fine = long_run(row, unit=0.25)
    floors = jp.floor_demands(row, fine.demand)
    assert [one.masses for one in floors] == [(0, 1), (2,), (3, 4)]
    x = [np.asarray(mass.x) for mass in fine.masses]
    for one in floors:
        below = 0.0
        for i, mass in enumerate(one.masses):
            assert one.displacement[i] == pytest.approx(np.abs(x[mass]).max(), rel=2e-3)
            assert one.drift[i] == pytest.approx(np.abs(x[mass] - below).max(), rel=4e-3)
            assert one.shear[i] == pytest.approx(np.abs(fine.rods[mass].force).max(), rel=4e-3)
            below = x[mass]
    contact = [link.peak_contact for link in fine.demand.links]
    assert floors[0].contact_right.tolist() == [contact[0], 0.0]
    assert floors[1].contact.tolist() == [max(contact)]
    assert floors[2].contact_left.tolist() == [contact[1], 0.0]
    # The coarse run's peaks are those of the fine one to the error of its step.
    for one, other in zip(jp.floor_demands(row, coarse.demand), floors, strict=True):
        np.testing.assert_allclose(one.drift, other.drift, rtol=0.03)


def test_floors_of_a_batch_are_those_of_its_runs():
    """The axes of a batch are in front."""
    row = jp.Row(three().buildings)
    amplitudes = jnp.array([0.2, 0.4])

    def floors(amplitude):
        found = jp.demand(row, dataclasses.replace(GROUND, amplitude=amplitude), GRID)
        return jp.floor_demands(row, found)

    both = jax.vmap(floors)(amplitudes)
    table = both[2].to_pandas()  # of the third building: each floor of each run
    assert table.index.names == ["run", "building", "floor"]
    assert table.index.tolist() == [(0, 3, 1), (0, 3, 2), (1, 3, 1), (1, 3, 2)]
    assert table["series"].tolist() == [4, 5, 4, 5]
    np.testing.assert_array_equal(table["shear"], np.ravel(both[2].shear))
    assert [*both[1].to_columns()][:5] == ["run", "building", "floor", "series", "displacement"]
    assert [one.shear.shape for one in both] == [(2, 2), (2, 1), (2, 2)]
    alone = floors(amplitudes[1])
    for one, other in zip(jax.tree.leaves(both), jax.tree.leaves(alone), strict=True):
        np.testing.assert_allclose(one[1], other, rtol=1e-9)


def test_derivatives_by_a_damper_that_is_not_there_are_those_of_the_pair():
    """Without friction a row is its pairs, also where the derivative by the friction is taken."""
    numbers = (STEEL, 1.0, 1.0), (RUBBER, 0.6, 1.8), (SOFT, 1.6, 0.7)
    buildings = tuple(one_storey(*each) for each in numbers)

    def ends(frictions, buildings):
        links = tuple(jp.FloorLink(k, 0, friction=mu) for k, mu in enumerate(frictions))
        response = jp.simulate(jp.Row(buildings, links), GROUND, GRID)
        return jnp.stack([mass.x[-1] for mass in response.masses])

    slopes = jax.jit(jax.jacfwd(ends))
    whole = slopes(jnp.zeros(2), buildings)
    for k in (0, 1):
        pair = slopes(jnp.zeros(1), buildings[k : k + 2])
        np.testing.assert_allclose(whole[k : k + 2, k], pair[:, 0], rtol=1e-9)
    np.testing.assert_allclose([whole[2, 0], whole[0, 1]], 0, atol=1e-12)


def test_bad_input():
    row, pair = three(), jp.paper.structures()
    demand = jp.demand(pair, GROUND, GRID)
    refused("has 2 masses; it must be of these structures, .* 5", jp.floor_demands, row, demand)
    with pytest.raises(ValueError, match="drift_ratio: it needs drifts in SI and"):
        _ = jp.floor_demands(pair, demand)[0].drift_ratio
    rods = tuple(jp.Rod(STEEL, 1.0, ends) for ends in ((0, jp.GROUND), (1, 0), (0, 1)))
    tied = jp.System((1.0, 1.0), rods)
    demand = jp.demand(tied, GROUND, GRID)
    (floors,) = jp.floor_demands(tied, demand)  # a rod beside a storey does not add to its shear
    np.testing.assert_array_equal(floors.shear, [demand.peak_f1, demand.peak_f2])
