from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, strategies
from scipy import stats

import jaxpound as jp
from jaxpound.scenarios.distributions import reach, truncated
from tests.refusals import refusals

CASES = [
    (jp.Normal(2.0, 0.5), stats.norm(2.0, 0.5)),
    (jp.LogNormal(0.25, 0.4), stats.lognorm(0.4, scale=0.25)),
    (jp.Uniform(-1.0, 3.0), stats.uniform(-1.0, 4.0)),
]


@pytest.mark.parametrize(("ours", "theirs"), CASES, ids=lambda x: type(x).__name__)
def test_a_distribution_is_its_quantile_function_of_the_normal_s_probability(ours, theirs):
    z = np.linspace(-5, 5, 101)
    x, back = jax.jit(lambda z: (ours.from_normal(z), ours.to_normal(ours.from_normal(z))))(z)
    np.testing.assert_allclose(x, theirs.ppf(stats.norm.cdf(z)), rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(back, z, rtol=1e-7, atol=1e-12)
    below, above = theirs.support()
    assert (ours.to_normal(below), ours.to_normal(above)) == (-np.inf, np.inf)
    p = (0, 1) if isinstance(ours, jp.Uniform) else (1e-6, 1 - 1e-6)
    np.testing.assert_allclose(reach(ours), theirs.ppf(p), rtol=1e-6)


@pytest.mark.parametrize(("ours", "theirs"), CASES, ids=lambda x: type(x).__name__)
@given(strategies.floats(-8, 8), strategies.floats(0.001, 0.98), strategies.floats(0.001, 0.999))
def test_truncation_is_the_conditional_distribution(ours, theirs, z, start, share):
    low, high = theirs.ppf(start), theirs.ppf(start + share * (1 - start))
    x = float(truncated(ours, jnp.asarray(z), low, high))
    assert low <= x <= high
    p = theirs.cdf(low) + stats.norm.cdf(z) * (theirs.cdf(high) - theirs.cdf(low))
    assert x == pytest.approx(theirs.ppf(p), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("negative", [0.5, 0.2])
def test_two_sided_numbers_have_sizes_and_signs_as_given(negative):
    """An increasing function of z; sizes keep their distribution, both tails included."""
    size = jp.LogNormal(0.2, 0.5)
    both = jp.scenarios.TwoSided(size, negative)
    z = np.linspace(-7.5, 7.5, 301)
    x = np.asarray(jax.jit(both.from_normal)(z))
    assert (np.diff(x) > 0).all()
    theirs = stats.lognorm(0.5, scale=0.2)
    share = np.where(x < 0, negative * theirs.sf(-x), negative + (1 - negative) * theirs.cdf(x))
    inside = np.abs(z) < 5
    np.testing.assert_allclose(share[inside], stats.norm.cdf(z[inside]), rtol=1e-9)
    np.testing.assert_allclose(theirs.sf(x[-1]) * (1 - negative), stats.norm.sf(z[-1]), rtol=1e-9)
    np.testing.assert_allclose(theirs.sf(-x[0]) * negative, stats.norm.cdf(z[0]), rtol=1e-9)
    np.testing.assert_allclose(jax.jit(both.to_normal)(x), z, rtol=1e-7, atol=1e-12)


def test_two_sided_numbers_pass_zero_without_a_jump_and_with_finite_slopes():
    both = jp.scenarios.TwoSided(jp.LogNormal(0.2, 0.5))
    assert abs(float(both.from_normal(1e-12)) - float(both.from_normal(-1e-12))) < 0.02
    z = jnp.array([-9.0, -1e-3, 0.0, 1e-3, 9.0])
    slopes = jax.jit(jax.vmap(jax.grad(both.from_normal)))(z)
    assert np.isfinite(slopes).all()
    h = 1e-6
    value = jax.jit(both.from_normal)
    numeric = (value(z + h) - value(z - h)) / (2 * h)
    apart = np.array([0, 1, 3, 4])
    np.testing.assert_allclose(slopes[apart], numeric[apart], rtol=1e-4)
    uniform = jp.scenarios.TwoSided(jp.Uniform(0.0, 1.0))  # flat through 0
    expected = 2 * stats.norm.cdf(np.asarray(z)) - 1
    np.testing.assert_allclose(uniform.from_normal(z), expected, atol=1e-12)


def test_truncation_keeps_both_tails_and_the_nearer_end():
    """Far out, where probabilities round to 0 or 1, and under derivatives."""
    normal = jp.Normal(0.0, 1.0)
    draw = jax.jit(partial(truncated, normal))
    for low, high in ((8.0, 12.0), (-12.0, -8.0)):
        x = draw(jnp.linspace(-3, 3, 7), low, high)
        expected = stats.truncnorm.ppf(stats.norm.cdf(np.linspace(-3, 3, 7)), low, high)
        np.testing.assert_allclose(x, expected, rtol=1e-9)
    z = jnp.asarray([-30.0, -9.0, -1.0, 0.0, 1.0, 9.0, 30.0])
    np.testing.assert_allclose(draw(z, -np.inf, np.inf), z, rtol=1e-12)
    of_z = jax.grad(lambda z: truncated(jp.LogNormal(1.0, 0.5), z, 0.9, 1.1))
    assert np.isfinite(jax.jit(jax.vmap(of_z))(z)).all()
    z = jnp.linspace(-3, 3, 5)
    for start, end in ((0.0, 2.0), (4.0, 3.0)):
        draw = jax.jit(partial(truncated, jp.Uniform(start, start + 1)))
        np.testing.assert_array_equal(draw(z, 2.0, 3.0), end)


test_bad_values_are_named = refusals(
    (jp.scenarios.TwoSided, jp.Normal(0.0, 1.0), "size = .* must have positive numbers only"),
    (jp.scenarios.TwoSided, jp.LogNormal(1.0, 1.0), 1.0, "negative = 1 must be between 0 and 1"),
    (jp.scenarios.TwoSided, 3, "size = 3 must be of type Distribution"),
    (lambda: jp.Normal(0.0, 0.0), "Normal: std = 0 must be positive"),
    (lambda: jp.Normal(np.nan, 1.0), "Normal: mean = nan must be finite"),
    (lambda: jp.LogNormal(-1.0, 1.0), "LogNormal: median = -1 must be positive"),
    (lambda: jp.LogNormal(1.0, "wide"), "LogNormal: sigma = 'wide' must be a real number"),
    (lambda: jp.Uniform(1.0, 1.0), "Uniform: high = 1 must be finite and above low = 1"),
    (lambda: jp.Uniform(-np.inf, 1.0), "Uniform: low = -inf must be finite"),
)
