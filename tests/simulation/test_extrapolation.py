"""Runs at two steps whose leading errors cancel."""

from dataclasses import replace
from functools import cache

import jax
import numpy as np
import pytest

import jaxpound as jp
from tests.refusals import refusals
from tests.simulation.pairs import displacements_in_units, in_unit_of_time

PAPER, GROUND = jp.paper.structures(), jp.paper.ground()
TWICE = jp.Scheme(extrapolated=True)
ELASTIC = jp.ZenerRod(order=1.0, tau_f=0.1, tau_x=0.1)


def grid(dt):
    return jp.TimeGrid.until(12.0, dt=dt)


@cache
def plain(dt):
    return jp.simulate(PAPER, GROUND, grid(dt))


def test_it_is_what_two_runs_say_with_the_series_of_the_grid():
    coarse, fine = (plain(dt).demand.scalars() for dt in (0.04, 0.02))
    twice = jp.simulate(PAPER, GROUND, grid(0.04), TWICE)
    for scalars in (jp.demand(PAPER, GROUND, grid(0.04), TWICE), twice.demand):
        for name, value in scalars.scalars().items():
            if name != "pounds":
                assert value == pytest.approx((4 * fine[name] - coarse[name]) / 3, rel=1e-9), name
    assert twice.x1.shape == plain(0.04).x1.shape
    np.testing.assert_allclose(twice.friction, plain(0.04).friction, atol=1e-9)
    assert [phase.kind for phase in twice.phases()] == [x.kind for x in plain(0.04).phases()]
    errors = [np.abs(run.x1 - plain(0.0025).x1[::16]).max() for run in (twice, plain(0.04))]
    assert errors[0] < errors[1] / 10
    assert "extrapolated" in twice.method


def test_a_smooth_run_is_of_fourth_order():
    block = jp.System(masses=(1.0,), rods=(jp.Rod(ELASTIC, 1.0, (0, jp.GROUND)),))
    still, start, steps = jp.Ricker(0.0, [1.0], [0.0]), jp.InitialState((0.3,), (0.2,)), (0.2, 0.1)
    errors = []
    runs = displacements_in_units(block, steps, 12.0, still, start, TWICE)
    for (x,), dt in zip(runs, steps, strict=True):
        t = dt * np.arange(121)
        errors.append(np.abs(x - 0.3 * np.cos(t) - 0.2 * np.sin(t))[t <= 12].max())
    assert errors[1] < 3e-6
    assert 3.7 < np.log2(errors[0] / errors[1]) < 4.3


def test_through_stick_and_slip_the_value_gains_digits():
    """The paper's reference has eight digits of the gap. Derivatives stay of second order."""
    steps = jp.TimeGrid(0.04, 600)

    @jax.jit
    def value_and_slope(unit):
        def min_gap(friction):
            system = replace(PAPER, friction=friction).system()
            return jp.demand(*in_unit_of_time(unit, system, GROUND), steps, TWICE).min_gap

        return jax.jvp(min_gap, (PAPER.friction,), (1.0,))

    exact = 1 + jp.paper.reference().min_gap_change
    for dt in (0.04, 0.02):
        value, slope = value_and_slope(dt / steps.dt)
        assert abs(value - exact) < abs(plain(dt).min_gap - exact) / 20
        assert slope == pytest.approx(0.876358, abs=1e-4)  # at steps of 0.00125
    assert abs(value - exact) < 2e-6


POUNDING = replace(PAPER, initial_gap=0.3, contact=jp.Newton(0.6))
ORDER = "extrapolated = True must have order 2"
test_where_it_does_not_hold = refusals(
    (lambda: jp.Scheme(order=1, extrapolated=True), ORDER),
    (lambda: jp.Scheme(jp.simulation.Switching(), extrapolated=True), ORDER),
    (jp.demand, POUNDING, GROUND, grid(0.04), TWICE, r"links\.0 must have no contact"),
)
