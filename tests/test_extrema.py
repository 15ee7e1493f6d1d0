"""Larger, smaller and peak: values, ties, NaN, and derivatives under compilation."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given, strategies
from hypothesis.extra.numpy import arrays

from jaxpound._extrema import larger, peak, smaller

NUMBERS = strategies.floats(-1e6, 1e6)


@given(arrays(float, strategies.sampled_from([1, 2, 20]), elements=NUMBERS))
def test_values_are_numpy_s_and_the_peak_is_the_largest_absolute_value(y):
    assert larger(y[0], y[-1]) == np.maximum(y[0], y[-1])
    assert smaller(y[0], y[-1]) == np.minimum(y[0], y[-1])
    assert peak(jnp.asarray(y)) == np.abs(y).max()
    assert np.count_nonzero(jax.grad(peak)(y)) <= 1


def test_derivatives_are_those_of_one_of_the_two_at_a_tie_of_the_first():
    """Under fusion, where ``jnp.maximum`` may compare a result with operands rounded otherwise."""
    for function in (larger, smaller):
        assert jax.grad(function, argnums=(0, 1))(1.0, 1.0) == (1.0, 0.0)
        assert jnp.isnan(function(jnp.nan, 0.0))
    assert jnp.isnan(peak(jnp.array([1.0, jnp.nan, 2.0])))
    x = np.random.default_rng(0).normal(size=1000)

    def terms(x):
        return x * jnp.exp(x) + x / 3, jnp.sin(x) * x - x / 7

    slopes = jax.jit(jax.vmap(jax.grad(lambda x: larger(*terms(x)))))(x)
    one, other = (jax.vmap(jax.grad(lambda x, i=i: terms(x)[i]))(x) for i in (0, 1))
    first, second = terms(x)
    np.testing.assert_allclose(slopes, np.where(first >= second, one, other), rtol=1e-12)
