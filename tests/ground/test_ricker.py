"""Ricker wavelets against their own derivatives and by hand."""

import operator

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jaxpound as jp
from tests.ground.motions import RECORD
from tests.refusals import refusals


@jax.jit
def slopes(wavelet, t):
    return jax.grad(wavelet.displacement)(t), jax.grad(wavelet.velocity)(t)


@given(st.floats(-2, 2), st.floats(0.3, 5), st.floats(-1, 6), st.floats(-2, 8))
def test_ricker_velocity_and_acceleration_are_derivatives(amplitude, period, arrival, t):
    wavelet = jp.Ricker(amplitude, period, arrival)
    within = {"rtol": 1e-10, "atol": 1e-13 * abs(amplitude) * (np.pi / period) ** 2}
    velocity, acceleration = slopes(wavelet, t)
    np.testing.assert_allclose(wavelet.velocity(t), velocity, **within)
    np.testing.assert_allclose(wavelet.acceleration(t), acceleration, **within)


def test_ricker_by_hand():
    wavelet = jp.Ricker(0.5, np.pi, 2.0)  # a = 1
    assert wavelet.displacement(2.0) == pytest.approx(-0.5)
    assert wavelet.velocity(2.0) == 0
    assert wavelet.acceleration(2.0) == pytest.approx(3.0)
    assert wavelet.displacement(3.0) == pytest.approx(0.5 / np.e)
    assert wavelet.velocity(3.0) == pytest.approx(1.0 / np.e)
    assert wavelet.velocity(1.0) == pytest.approx(-1.0 / np.e)
    assert wavelet.acceleration(3.0) == pytest.approx(-5.0 / np.e)
    # At half the period the same point of the wavelet is four times as sharp.
    assert jp.Ricker(0.5, np.pi / 2, 2.0).acceleration(2.5) == pytest.approx(-20.0 / np.e)


@pytest.mark.parametrize("quantity", ["displacement", "velocity", "acceleration"])
def test_ricker_is_the_sum_of_its_wavelets(quantity):
    t = np.linspace(0, 6, 25)
    of = operator.methodcaller(quantity, t)
    periods, arrivals = [1.25, 1, 2], [1.5, 2, 3]
    one_by_one = [jp.Ricker(0.5, tp, ts) for tp, ts in zip(periods, arrivals, strict=True)]
    together = of(jp.Ricker(0.5, periods, arrivals))
    np.testing.assert_allclose(together, sum(map(of, one_by_one)), rtol=1e-12, atol=1e-14)
    # One amplitude for all is that amplitude for each.
    np.testing.assert_array_equal(together, of(jp.Ricker([0.5] * 3, periods, arrivals)))
    weighted = of(jp.Ricker([1.0, 0.0, -2.0], periods, arrivals))
    expected = 2 * of(one_by_one[0]) - 4 * of(one_by_one[2])
    np.testing.assert_allclose(weighted, expected, rtol=1e-12, atol=1e-13)


def test_motions_have_the_shape_of_time():
    for ground in (jp.Ricker(0.5, [1, 2, 3], [1, 2, 3]), jp.Ricker(0.5, 1, 2), RECORD):
        for motion in (ground, 2 * ground, ground + ground):
            for shape in ((), (1,), (4,), (2, 3), (0,)):
                assert jax.eval_shape(motion.acceleration, np.full(shape, 0.7)).shape == shape


test_ricker_refuses_bad_values = refusals(
    (0.5, [1, 2], [1], r"periods of shape \(2,\) and arrivals of shape \(1,\)"),
    (0.5, 1.0, [1], r"periods of shape \(\) and arrivals of shape \(1,\)"),
    ([1, 2, 3], [1, 2], [1, 2], r"amplitude of shape \(3,\) must be one number or"),
    (0.5, np.ones((2, 2)), np.ones((2, 2)), r"periods of shape \(2, 2\) must be a number or"),
    (0.5, [1, 0], [1, 2], r"periods = 0 \(at index \[1\]\) must be positive and finite"),
    (0.5, -1, 2, "periods = -1 must be positive and finite"),
    (0.5, [1, np.inf], [1, 2], "periods = inf"),
    (0.5, [1, 2], [1, np.nan], r"arrivals = nan \(at index \[1\]\) must be finite"),
    (np.inf, 1, 2, "amplitude = inf must be finite"),
    (None, 1, 2, "amplitude = None must be a real number"),
    (0.5, "1", 2, "periods = '1' must be a real number"),
    of=jp.Ricker,
    before="^Ricker: ",
)
