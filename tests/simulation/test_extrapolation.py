"""Runs at two steps whose leading errors cancel."""

from dataclasses import replace
from functools import partial

import jax
import numpy as np
import pytest

import jaxpound as jp
from tests.refusals import refusals

PAPER, GROUND = jp.paper.structures(), jp.paper.ground()
TWICE = jp.Scheme(extrapolated=True)
ELASTIC = jp.ZenerRod(order=1.0, tau_f=0.1, tau_x=0.1)


def grid(dt):
    return jp.TimeGrid.until(12.0, dt=dt)


def test_it_is_what_two_runs_say_with_the_series_of_the_grid():
    coarse, fine = (jp.demand(PAPER, GROUND, grid(dt)).scalars() for dt in (0.04, 0.02))
    for name, value in jp.demand(PAPER, GROUND, grid(0.04), TWICE).scalars().items():
        if name != "pounds":
            assert value == pytest.approx((4 * fine[name] - coarse[name]) / 3, rel=1e-9), name
    twice, plain, fine = (
        jp.simulate(PAPER, GROUND, grid(dt), scheme)
        for dt, scheme in ((0.04, TWICE), (0.04, jp.Scheme()), (0.0025, jp.Scheme()))
    )
    assert twice.x1.shape == plain.x1.shape
    np.testing.assert_allclose(twice.friction, plain.friction, atol=1e-9)
    assert [phase.kind for phase in twice.phases()] == [phase.kind for phase in plain.phases()]
    errors = [np.abs(response.x1 - fine.x1[::16]).max() for response in (twice, plain)]
    assert errors[0] < errors[1] / 10
    assert "extrapolated" in twice.method


def test_a_smooth_run_is_of_fourth_order():
    block = jp.System(masses=(1.0,), rods=(jp.Rod(ELASTIC, 1.0, (0, jp.GROUND)),))
    still, start, errors = jp.Ricker(0.0, [1.0], [0.0]), jp.InitialState((0.3,), (0.2,)), []
    for dt in (0.2, 0.1):
        response = jp.simulate(block, still, grid(dt), TWICE, initial=start)
        exact = 0.3 * np.cos(response.time) + 0.2 * np.sin(response.time)
        errors.append(np.abs(response.masses[0].x - exact).max())
    assert errors[1] < 3e-6
    assert 3.7 < np.log2(errors[0] / errors[1]) < 4.3


def test_through_stick_and_slip_the_value_gains_digits():
    """The paper's reference has eight digits of the gap. Derivatives stay of second order."""

    @partial(jax.jit, static_argnums=0)
    def value_and_slope(dt):
        def min_gap(friction):
            return jp.demand(replace(PAPER, friction=friction), GROUND, grid(dt), TWICE).min_gap

        return jax.jvp(min_gap, (PAPER.friction,), (1.0,))

    exact = 1 + jp.paper.reference().min_gap_change
    for dt in (0.04, 0.02):
        plain = jp.demand(PAPER, GROUND, grid(dt)).min_gap
        value, slope = value_and_slope(dt)
        assert abs(value - exact) < abs(plain - exact) / 20
        assert slope == pytest.approx(0.876358, abs=1e-4)  # at steps of 0.00125
    assert abs(value - exact) < 2e-6


POUNDING = replace(PAPER, initial_gap=0.3, contact=jp.Newton(0.6))

test_where_it_does_not_hold = refusals(
    (lambda: jp.Scheme(order=1, extrapolated=True), "extrapolated = True must have order 2"),
    (lambda: jp.Scheme(jp.Switching(), extrapolated=True), "extrapolated = True must have order 2"),
    (jp.demand, POUNDING, GROUND, grid(0.04), TWICE, r"links\.0 must have no contact"),
)
