"""Tests of a rod alone, by laws of hysteresis; those of fractional rods are with the histories."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from tests.refusals import refusals

TURNS = jnp.array([0.0, 0.3, -0.4, 0.25])
BILINEAR, SMOOTH = jp.Bilinear(0.1, 0.05), jp.BoucWen(0.1, 0.05, 1.0, 0.4)
WORN = replace(SMOOTH, exponent=2.5, strength_degradation=0.05, stiffness_degradation=0.03)


def test_a_bilinear_rod_is_exact_for_any_sampling_and_its_loops_enclose_what_it_dissipates():
    few, many = (jp.study.cyclic_test(BILINEAR, TURNS, 5.0, steps) for steps in (1, 64))
    # Along the line beyond yield in each direction: K (α e ± (1 − α) e_y).
    line = 5.0 * (0.05 * TURNS[1:] + 0.95 * 0.1 * np.array([1, -1, 1]))
    np.testing.assert_allclose(few.force[1:], line, rtol=1e-12)
    np.testing.assert_allclose(many.force[::64], few.force, rtol=1e-12)
    work = np.sum((many.force[1:] + many.force[:-1]) / 2 * np.diff(many.displacement))
    # What is stored: in the spring beside, and in the one in series with the slider.
    stored = 5.0 * (0.05 * 0.25**2 + 0.95 * 0.1**2) / 2
    assert work - stored == pytest.approx(float(many.dissipated[-1]), rel=2e-3)
    limited = replace(BILINEAR, ultimate_displacement=0.2)
    assert len({*jp.study.cyclic_test(limited, [0.0, 0.2, 0.25, 0.3], steps=1).force.tolist()}) == 2


def test_a_smooth_rod_is_of_second_order_in_its_steps():
    few = jp.study.cyclic_test(SMOOTH, TURNS, steps=1).force
    assert few[1] == pytest.approx(0.05 * 0.3 + 0.95 * 0.1 * (1 - np.exp(-3.0)), rel=1e-12)
    coarse, fine, finest = (
        jp.study.cyclic_test(WORN, TURNS, steps=n).force[-1] for n in (16, 32, 256)
    )
    assert abs(coarse - finest) > 3.4 * abs(fine - finest)
    assert fine == pytest.approx(float(finest), rel=1e-3)


def test_forces_have_the_derivatives_of_central_differences():
    names = ["yield_displacement", "hardening", "exponent", "beta", "strength_degradation"]
    at = np.array([getattr(WORN, name) for name in names] + [5.0])

    def forces(numbers):
        changed = replace(WORN, **dict(zip(names, numbers[:-1], strict=True)))
        test = jp.study.cyclic_test(changed, TURNS, numbers[-1], 8)
        return jnp.array([test.force[-1], test.dissipated[-1]])

    step, wrong = 1e-6 * np.eye(6), np.array([-0.1, *at[1:]])
    every = np.asarray(jax.jit(jax.vmap(forces))(np.vstack([at + step, at - step, wrong])))
    central = (every[:6] - every[6:12]) / 2e-6
    for mode in (jax.jacrev, jax.jacfwd):
        np.testing.assert_allclose(jax.jit(mode(forces))(at).T, central, rtol=1e-6, atol=1e-8)
    assert np.isnan(every[12]).all()


test_wrong_tests_are_refused = refusals(
    (jp.ZenerRod(0.5, 0.01, 0.05), TURNS, "cyclic_test: law = .* must be of type HysteresisLaw"),
    (jp.Bilinear(np.array([0.1, 0.2])), TURNS, "law must be of single numbers: jax.vmap"),
    (BILINEAR, [0.3], r"displacements of shape \(1,\) must be \(n,\)"),
    (BILINEAR, [0.3, np.inf], r"displacements = inf \(at index \[1\]\) must be finite"),
    (BILINEAR, TURNS, -1.0, "stiffness = -1 must be positive"),
    of=jp.study.cyclic_test,
)
