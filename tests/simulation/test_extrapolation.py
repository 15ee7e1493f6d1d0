"""Runs at two steps whose leading errors cancel."""

from dataclasses import replace
from functools import partial

import jax
import numpy as np
import pytest

import jaxpound as jp

PAPER, GROUND = jp.paper.structures(), jp.paper.ground()
TWICE = jp.Scheme(extrapolated=True)
ELASTIC = jp.ZenerRod(order=1.0, tau_f=0.1, tau_x=0.1)


def grid(dt):
    return jp.TimeGrid.until(12.0, dt=dt)


def test_it_is_what_two_runs_say():
    coarse, fine = (jp.demand(PAPER, GROUND, grid(dt)) for dt in (0.04, 0.02))
    both = jp.demand(PAPER, GROUND, grid(0.04), TWICE)
    for name, value in both.scalars().items():
        if name != "pounds":
            expected = (4 * fine.scalars()[name] - coarse.scalars()[name]) / 3
            assert value == pytest.approx(expected, rel=1e-9), name


def test_a_smooth_run_is_of_fourth_order():
    one = jp.System(masses=(1.0,), rods=(jp.Rod(ELASTIC, 1.0, (0, jp.GROUND)),))
    errors = []
    for dt in (0.2, 0.1):
        found = jp.simulate(
            one,
            jp.Ricker(0.0, [1.0], [0.0]),
            grid(dt),
            TWICE,
            initial=jp.InitialState((0.3,), (0.2,)),
        )
        exact = 0.3 * np.cos(found.time) + 0.2 * np.sin(found.time)
        errors.append(np.abs(found.masses[0].x - exact).max())
    assert errors[1] < 3e-6
    assert 3.7 < np.log2(errors[0] / errors[1]) < 4.3


def test_through_stick_and_slip_the_value_gains_digits():
    """The paper's reference has eight digits of the gap. Derivatives stay of second order."""

    def min_gap(friction, dt, scheme):
        return jp.demand(replace(PAPER, friction=friction), GROUND, grid(dt), scheme).min_gap

    @partial(jax.jit, static_argnums=(0, 1))
    def value_and_slope(dt, scheme):
        return jax.jvp(lambda mu: min_gap(mu, dt, scheme), (PAPER.friction,), (1.0,))

    exact = 1 + jp.paper.reference().min_gap_change
    for dt in (0.04, 0.02):
        plain = jp.demand(PAPER, GROUND, grid(dt)).min_gap
        value, slope = value_and_slope(dt, TWICE)
        assert abs(value - exact) < abs(plain - exact) / 20
        assert slope == pytest.approx(0.876358, abs=1e-4)  # at steps of 0.00125
    assert abs(value - exact) < 2e-6


def test_series_are_those_of_the_grid():
    found = jp.simulate(PAPER, GROUND, grid(0.04), TWICE)
    plain = jp.simulate(PAPER, GROUND, grid(0.04))
    fine = jp.simulate(PAPER, GROUND, grid(0.0025))
    assert found.x1.shape == plain.x1.shape
    np.testing.assert_allclose(found.friction, plain.friction, atol=1e-9)
    assert [phase.kind for phase in found.phases()] == [phase.kind for phase in plain.phases()]
    errors = [np.abs(one.x1 - fine.x1[::16]).max() for one in (found, plain)]
    assert errors[0] < errors[1] / 10
    assert "extrapolated" in found.method


def test_where_it_does_not_hold():
    with pytest.raises(ValueError, match="extrapolated = True must have order 2"):
        jp.Scheme(order=1, extrapolated=True)
    with pytest.raises(ValueError, match="extrapolated = True must have order 2"):
        jp.Scheme(jp.Switching(), extrapolated=True)
    pounding = replace(PAPER, initial_gap=0.3, contact=jp.Newton(0.6))
    with pytest.raises(ValueError, match=r"links\.0 must have no contact"):
        jp.demand(pounding, GROUND, grid(0.04), TWICE)
