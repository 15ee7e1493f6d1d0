"""The parameters of a law of hysteresis, calibrated to noisy cyclic tests."""

from functools import cache

import jax
import numpy as np
import pytest

import jaxpound as jp
from tests.refusals import refusals
from tests.test_tables import assert_shown

CYCLE = np.sin(np.linspace(0, 2 * np.pi, 41))[1:]
PATH = np.concatenate([[0.0], *(a * CYCLE for a in (0.05, 0.1, 0.2, 0.3))])
TRUTH = {"yield_displacement": 0.1, "hardening": 0.05, "exponent": 2.0, "beta": 0.4}
K, STD = 5.0, 0.01
FORCE = np.asarray(jp.cyclic_test(jp.BoucWen(**TRUTH), PATH, K, 1).force)
START = jp.BoucWen(0.05, 0.02, 1.5, 0.6)
BOUNDS = {"yield_displacement": jp.Bounds(0.02, 0.4, "log"), "hardening": (0.0, 0.2)}
BOUNDS |= {"exponent": (1, 6), "beta": (0, 1), "stiffness": (1.0, 20.0)}
NOISE = STD * np.random.default_rng(0).normal(size=FORCE.size)


@cache
def fitted():
    return jp.calibrate_cyclic(START, BOUNDS, PATH, FORCE + NOISE, 3.0, noise=STD, starts=2)


def test_a_law_is_recovered_from_a_noisy_test_within_its_intervals():
    fit = fitted()
    for name, value in (TRUTH | {"stiffness": K}).items():
        estimate = fit.parameters[name]
        assert estimate.low < value < estimate.high, name
        assert getattr(fit.law, name, fit.stiffness) == pytest.approx(estimate.value)
    assert fit.noise == pytest.approx(STD, rel=0.1)
    np.testing.assert_allclose(FORCE + NOISE - fit.test.force, fit.residuals, atol=1e-12)
    assert fit.test.displacement.shape == fit.residuals.shape == PATH.shape
    assert str(fit.parameters["beta"]) in assert_shown(fit)
    assert fit.at_bounds == ()


def test_intervals_cover_as_often_as_they_say():
    """By the linearised estimate: its spread over many draws of noise is what intervals state."""
    names = [*fitted().parameters]

    def force(numbers):
        *numbers, stiffness = numbers
        law = jp.BoucWen(**dict(zip(names[:-1], numbers, strict=True)))
        return jp.cyclic_test(law, PATH, stiffness, 1).force

    assert names == [*TRUTH, "stiffness"]
    jacobian = np.asarray(jax.jit(jax.jacfwd(force))(np.array([*TRUTH.values(), K])))
    errors = STD * np.random.default_rng(2).normal(size=(4000, FORCE.size))
    errors = errors @ np.linalg.pinv(jacobian).T
    half = np.array([(x.high - x.low) / 2 for x in fitted().parameters.values()])
    np.testing.assert_allclose((np.abs(errors) < half).mean(0), 0.95, atol=0.03)


def test_what_was_not_measured_does_not_count_and_wide_steps_are_divided():
    law, turns = jp.Bilinear(0.1, 0.05), [0.0, 0.08, 0.3, -0.3, 0.2]
    force = np.array(jp.cyclic_test(law, turns, K, 1).force)
    force[3] = np.nan
    bounds = {"yield_displacement": (0.02, 0.25), "stiffness": (1.0, 20.0)}
    start = jp.Bilinear(0.12, 0.05)
    fit = jp.calibrate_cyclic(start, bounds, turns, force, 4.0, starts=1, steps=2)
    assert fit.law.yield_displacement == pytest.approx(0.1, rel=1e-6)
    assert fit.stiffness == pytest.approx(K, rel=1e-6)
    assert np.isnan(fit.residuals[3])
    assert fit.test.force.shape == (5,)


ORDERS = {"exponet": (1.0, 6.0)}
test_wrong_calibrations_are_refused = refusals(
    (START, BOUNDS, PATH, FORCE[1:], r"forces of shape \(160,\) must be \(161,\)"),
    (START, BOUNDS, PATH, np.full(PATH.size, np.inf), "forces = inf .* must be finite, or NaN"),
    (START, {}, PATH, FORCE, "variables = {} must name a parameter"),
    (START, ORDERS, PATH, FORCE, "did you mean 'rods.0.material.exponent'"),
    (START, {"beta": (0.7, 1.0)}, PATH, FORCE, "beta = 0.6 must be between its bounds"),
    (START, BOUNDS, PATH[:4], FORCE[:4], "measured = 4 must be more numbers than the 5"),
    of=jp.calibrate_cyclic,
)
