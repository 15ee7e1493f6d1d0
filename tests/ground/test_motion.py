"""Sums and scalings of ground motions; functions on a time grid."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from jaxpound.ground.run_input import sampled
from tests.ground.motions import GRID, RECORD, sine, values
from tests.refusals import refusals


def scalar_sine(t):
    return 0.3 * math.sin(2 * t)


COMBINATIONS = {
    "sum": (RECORD + jp.Ricker(1, 1, 1), lambda r, w, s: r + w),
    "difference": (RECORD - jp.Ricker(1, 1, 1), lambda r, w, s: r - w),
    "factor on the left": (3 * RECORD, lambda r, w, s: 3 * r),
    "factor on the right": (RECORD * 3, lambda r, w, s: 3 * r),
    "NumPy factor": (np.float64(3) * RECORD, lambda r, w, s: 3 * r),
    "array factor": (np.array(3.0) * RECORD, lambda r, w, s: 3 * r),
    "JAX factor": (jnp.array(3.0) * RECORD, lambda r, w, s: 3 * r),
    "divisor": (RECORD / 4, lambda r, w, s: r / 4),
    "negation": (-RECORD, lambda r, w, s: -r),
    "function on the right": (RECORD + sine, lambda r, w, s: r + s),
    "function on the left": (sine + RECORD, lambda r, w, s: r + s),
    "minus a function": (RECORD - sine, lambda r, w, s: r - s),
    "function minus": (sine - RECORD, lambda r, w, s: s - r),
    "builtin sum": (sum([RECORD, jp.Ricker(1, 1, 1), RECORD]), lambda r, w, s: 2 * r + w),
    "nested": (2 * (sine + (RECORD - jp.Ricker(1, 1, 1))) / 4, lambda r, w, s: (s + r - w) / 2),
}


@pytest.mark.parametrize(("ground", "expected"), COMBINATIONS.values(), ids=COMBINATIONS)
def test_combinations_combine_the_accelerations(ground, expected):
    t = np.linspace(0, 1.4, 15)
    terms = (np.asarray(values(x, "acceleration", t)) for x in (RECORD, jp.Ricker(1, 1, 1)))
    combined = expected(*terms, sine(t))
    grid = jp.TimeGrid(0.1, 14)
    both = jax.jit(lambda: (ground.acceleration(t), sampled(ground, grid).samples))
    for accelerations in both():
        np.testing.assert_allclose(accelerations, combined, rtol=1e-12, atol=1e-14)


def test_combinations_and_sampled_functions_are_differentiable():
    ground, unit = 2.0 * RECORD + jp.Ricker(0.5, 1.0, 1.0), jp.Ricker(1.0, 1.0, 1.0)
    gradient = jax.jit(jax.grad(lambda g: g.acceleration(0.5)))(ground)
    assert type(gradient) is type(ground)
    assert gradient.grounds[0].factor == pytest.approx(1.0)
    by_amplitude = gradient.grounds[1].amplitude
    assert by_amplitude == pytest.approx(float(unit.acceleration(0.5)), rel=1e-12)

    def peak(a):
        return jnp.max(sampled(lambda t: a * t, GRID).samples)

    assert jax.jit(jax.value_and_grad(peak))(2.0) == pytest.approx((1.0, 0.5))


NO_ACCELERATIONS = [
    (lambda t: np.ones(3), r"of shape \(3,\) must have the shape of t, \(6,\)"),
    (lambda t: t[:, None], r"of shape \(6, 1\) must have the shape of t, \(6,\)"),
    (lambda t: None, "= None must be a real number"),
    (lambda t: "x", "= 'x' must be a real number"),
    (lambda t: 1j * t, "must be a real number"),
    (lambda t: np.where(t > 0.25, np.nan, t), r"= nan \(at index \[3\]\) must be finite"),
    (lambda t: np.inf, "= inf must be finite"),
]
test_senseless_motions_are_refused = refusals(
    (lambda: RECORD + 1, r"Sum: grounds\[1\] = 1 must have acceleration\(t\)"),
    (lambda: None + RECORD, r"Sum: grounds\[0\] = None must have acceleration\(t\)"),
    (lambda: RECORD - "x", r"Scaled: ground = 'x' must have acceleration\(t\)"),
    (lambda: RECORD * RECORD, "Scaled: factor = .* must be a real number"),
    (lambda: RECORD * None, "Scaled: factor = None must be a real number"),
    (lambda: np.nan * RECORD, "Scaled: factor = nan must be finite"),
    (lambda: np.array([1.0, 2.0]) * RECORD, r"Scaled: factor of shape \(2,\) must be one"),
    (lambda: RECORD / "2", "Record: divisor = '2' must be a real number"),
    (lambda: sampled(3, GRID), r"ground = 3 must have acceleration\(t\) or be a func"),
    *(
        (lambda ground=ground: sampled(ground, GRID), rf"ground: acceleration\(t\) .*{message}")
        for ground, message in NO_ACCELERATIONS
    ),
)

WAVELET = jp.Ricker(0.5, 1, 0.2)


@pytest.mark.parametrize(
    ("ground", "expected"),
    [
        (sine, sine),
        (scalar_sine, sine),
        (lambda t: jnp.sin(t), np.sin),
        (lambda t: 1.0 if t < 0.25 else 0.5, lambda t: np.where(t < 0.25, 1.0, 0.5)),
        (lambda t: jax.lax.cond(t < 0.25, lambda: 1.0, lambda: 0.0), lambda t: 1.0 * (t < 0.25)),
        (lambda t: 0.25, lambda t: np.full(t.shape, 0.25)),
        (lambda t: 1, np.ones_like),
        (scalar_sine + WAVELET, lambda t: sine(t) + WAVELET.acceleration(t)),
        (WAVELET, WAVELET.acceleration),
    ],
)
def test_any_function_of_time_can_be_sampled(ground, expected):
    record = sampled(ground, GRID)
    assert record.dt == 0.1
    np.testing.assert_allclose(record.samples, expected(GRID.times()), rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(record.acceleration(GRID.times()), record.samples, rtol=1e-12)


@pytest.mark.parametrize(
    "error", [ValueError("my own"), TypeError("my own"), KeyError("my own"), ZeroDivisionError()]
)
def test_the_functions_own_error_surfaces(error):
    def failing(t):
        raise error

    def ending(t):
        if t > 0.35:  # at one instant only
            raise error
        return math.sin(t)

    for call in (
        lambda: sampled(failing, GRID),
        lambda: sampled(ending, GRID),
        lambda: sampled(RECORD + failing, GRID),
        lambda: jp.pga(failing, GRID),
        lambda: jp.demand(jp.paper.structures(), failing, GRID),
    ):
        with pytest.raises(type(error)) as caught:
            call()
        assert caught.value is error
