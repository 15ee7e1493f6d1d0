"""Series whose largest number over a run is the demand, and their values at one instant."""

import jax
import numpy as np
import pytest

import jaxpound as jp
from jaxpound.model.places import link_places
from jaxpound.risk.instants import chosen_instants, measured, series_of
from jaxpound.simulation.course import positions_at

STEEL = jp.ZenerRod(order=0.5, tau_f=0.01, tau_x=0.05)


def row():
    rods = jp.Rod(STEEL, 5.0), jp.Rod(STEEL, 3.0)
    left, right = (jp.Storeys((1.0,) * n, rod) for n, rod in zip((3, 2), rods, strict=True))
    return jp.Row((left, right), jp.floor_links((left, right), friction=0.1, gap=1.0)).system()


def test_positions_at_an_instant_are_those_of_the_run():
    grid = jp.TimeGrid.until(6.0, dt=0.04)
    structures, ground = jp.paper.structures(), jp.paper.ground()
    response, system = jp.simulate(structures, ground, grid), structures.system()
    (closing,) = series_of(system, "required_gap", pounding=False)
    (pounding,) = series_of(system, "required_gap", pounding=True)
    for instant in (0, 17, 60):
        found = positions_at(structures, ground, grid, jp.Scheme(), instant)
        x = [float(mass.x[instant]) for mass in response.masses]
        gap = float(response.links[0].gap[instant])
        assert [float(one) for one in found.x] == pytest.approx(x, abs=1e-12)
        assert float(measured(closing.row, found, system)) == pytest.approx(1 - gap, abs=1e-12)
        assert float(measured(pounding.row, found, system)) == pytest.approx(-gap, abs=1e-12)


def test_the_gradient_of_a_closing_is_that_of_its_difference():
    grid = jp.TimeGrid.until(6.0, dt=0.1)

    def closing(amplitude):
        ground = amplitude * jp.paper.ground()
        return positions_at(jp.paper.structures(), ground, grid, jp.Scheme(), 45).closings[0]

    slope, secant = jax.grad(closing)(1.5), (closing(1.5001) - closing(1.4999)) / 2e-4
    assert float(slope) == pytest.approx(float(secant), rel=1e-6)
    assert abs(slope) > 0.01


def test_series_of_a_row():
    system = row()
    gaps = series_of(system, "required_gap", pounding=False)
    assert [one.words for one in gaps] == [
        f"closing, {place}" for place in link_places(system.topology)
    ]
    # Five masses and two links: displacements, closings, gaps.
    assert [np.flatnonzero(one.row).tolist() for one in gaps] == [[5], [6]]
    (up, down) = series_of(system, "peak_drift_2", pounding=False)
    assert up.row[:3].tolist() == [-1.0, 1.0, 0.0]
    assert np.array_equal(up.row, -down.row)
    assert len(series_of(system, "peak_drift", pounding=False)) == 10
    assert series_of(system, "peak_f1", pounding=False) == ()
    assert series_of(system, lambda demand: demand.pga, pounding=False) == ()


def test_instants_are_some_twenty_in_a_period():
    found = chosen_instants(500, 0.04, 1)
    assert (len(found), found[-1]) == (64, 500)
    assert np.diff(found).min() >= 7
    assert len(chosen_instants(500, 0.04, 8)) == 16
    assert len(chosen_instants(20_000, 0.02, 1)) == 256
    assert chosen_instants(3, 0.1, 1).tolist() == [1, 2, 3]
