"""Series whose largest number over a run is the demand, and their values at one instant."""

import dataclasses

import jax
import numpy as np
import pytest

import jaxpound as jp
from jaxpound.model.places import link_places
from jaxpound.reliability import instants
from jaxpound.reliability.instants import chosen_instants, measured, series_of
from tests.made import row_of

observed_at = jax.jit(instants.observed_at, static_argnums=(0, 3, 4))

PAPER, GROUND, SCHEME = jp.paper.structures(), jp.paper.ground(), jp.Scheme()
GRID = jp.TimeGrid.until(6.0, dt=0.04)


def test_positions_at_an_instant_are_those_of_the_run_with_their_gradients():
    response, system = jp.simulate(PAPER, GROUND, GRID), PAPER.system()
    (closing,) = series_of(system, "required_gap", pounding=False)
    (pounding,) = series_of(system, "required_gap", pounding=True)
    for instant in (0, 17, 60):
        positions = observed_at("length", PAPER, GROUND, GRID, SCHEME, instant)
        x = [float(mass.x[instant]) for mass in response.masses]
        gap = float(response.links[0].gap[instant])
        assert [*map(float, positions[:2])] == pytest.approx(x, abs=1e-12)
        for series, value in ((closing, 1 - gap), (pounding, -gap)):
            at_instant = measured("length", series.row, positions, system)
            assert float(at_instant) == pytest.approx(value, abs=1e-12)

    @jax.jit
    @jax.value_and_grad
    def closing_of(amplitude):
        return observed_at("length", PAPER, amplitude * GROUND, GRID, SCHEME, 112)[2]

    (_, slope), *near = (closing_of(amplitude) for amplitude in (1.5, 1.5001, 1.4999))
    secant = (near[0][0] - near[1][0]) / 2e-4
    assert float(slope) == pytest.approx(float(secant), rel=1e-6)
    assert abs(slope) > 0.01


def test_accelerations_and_forces_at_an_instant_are_those_of_the_run():
    """With a contact force among them, and without."""
    law = jp.KelvinVoigt(50.0, 0.6)
    structures = dataclasses.replace(PAPER, initial_gap=0.05, contact=law)
    response = jp.simulate(structures, GROUND, GRID)
    meets = int(np.argmax(response.links[0].contact))
    assert response.links[0].contact[meets] > 0
    forces = [rod.force for rod in response.rods]
    for observer, run in (("acceleration", response.absolute_accelerations), ("force", forces)):
        for instant in (17, meets):
            observed = observed_at(observer, structures, GROUND, GRID, SCHEME, instant)
            expected = [float(series[instant]) for series in run]
            assert [*map(float, observed)] == pytest.approx(expected, abs=1e-12)


def test_series_of_a_row_and_those_that_lead_to_impacts():
    links = jp.floor_links(row_of((3, 2)).buildings, friction=0.1, gap=1.0)
    system = row_of((3, 2), links).system()
    gaps = series_of(system, "required_gap", pounding=False)
    places = [f"closing, {place}" for place in link_places(system.topology)]
    assert [series.words for series in gaps] == places
    # Five masses and two links: displacements, closings, gaps.
    assert [np.flatnonzero(series.row).tolist() for series in gaps] == [[5], [6]]
    # Of accelerations the factors are by mass, of forces by rod.
    for demand, kind, factors in (
        ("peak_drift_2", "length", [-1.0, 1.0, 0.0]),
        ("peak_acceleration_2", "acceleration", [0.0, 1.0, 0.0, 0.0, 0.0]),
        ("peak_f1", "force", [1.0, 0.0, 0.0, 0.0, 0.0]),
    ):
        (up, down) = series_of(system, demand, pounding=False)
        assert (up.kind, up.row[: len(factors)].tolist()) == (kind, factors)
        assert np.array_equal(up.row, -down.row)
    for demand in ("peak_drift", "peak_acceleration"):
        assert len(series_of(system, demand, pounding=False)) == 10
    assert series_of(system, lambda demand: demand.pga, pounding=False) == ()
    # Overlaps of the links that have a law of contact, to contact and accelerations by it.
    free, touching = system.links
    touching = dataclasses.replace(touching, contact=jp.Newton(0.5))
    system = dataclasses.replace(system, links=(free, touching))
    for demand in ("peak_contact", "peak_impulse_2", "peak_acceleration_1"):
        (overlap,) = series_of(system, demand, pounding=False)
        assert np.flatnonzero(overlap.row).tolist() == [6, 8]
        assert overlap.words.startswith("overlap")


def test_instants_are_some_twenty_in_a_period():
    instants = chosen_instants(500, 0.04, 1)
    assert (len(instants), instants[-1]) == (64, 500)
    assert np.diff(instants).min() >= 7
    assert len(chosen_instants(500, 0.04, 8)) == 16
    assert len(chosen_instants(20_000, 0.02, 1)) == 256
    assert chosen_instants(3, 0.1, 1).tolist() == [1, 2, 3]
