"""Programs as one kernel."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxpound.simulation.kernels import MOST_TERMS, as_kernel

MARK = 'xla_cpu_small_call = "true"'


def loop(x, unused):
    """Ten steps of a root, with an argument that it does not use, and a result that is another."""
    return jax.lax.scan(lambda y, _: (y - (y * y - x) / (2 * y), y), x, length=10)[0], x


def of(x):
    return as_kernel(loop, x, 3 * x)[0]


def test_a_loop_is_one_kernel_unless_it_is_differentiated():
    x = jnp.asarray(2.0)
    assert MARK in jax.jit(of).lower(x).as_text()
    assert float(jax.jit(of)(x)) == pytest.approx(2**0.5, rel=1e-15)
    value_and_slope = jax.jit(jax.value_and_grad(of))
    assert MARK not in value_and_slope.lower(x).as_text()
    value, slope = value_and_slope(x)
    assert float(slope) == pytest.approx(0.5 / float(value), rel=1e-12)
    forward = jax.jit(jax.jacfwd(of))
    assert float(forward(x)) == pytest.approx(float(slope), rel=1e-12)


def test_a_batch_is_one_kernel_too():
    x = jnp.linspace(1.0, 9.0, 7)
    batch = jax.jit(jax.vmap(of))
    assert MARK in batch.lower(x).as_text()
    np.testing.assert_allclose(batch(x), np.sqrt(x), rtol=1e-15)
    slopes = jax.jit(jax.vmap(jax.grad(of)))(x)
    np.testing.assert_allclose(slopes, 0.5 / np.sqrt(x), rtol=1e-12)


@pytest.mark.parametrize(
    "function",
    [
        jnp.sort,
        lambda x: jnp.outer(x, x) @ x,
        lambda x: jnp.broadcast_to(x, (MOST_TERMS, x.size)).sum() + x,
        lambda x: x.at[jnp.argmax(x)].set(0.0),
    ],
    ids=["sort", "product of matrices", "long sum", "scatter"],
)
def test_what_xla_has_no_place_for_in_a_kernel_is_not_one(function):
    x = jnp.asarray([2.0, 1.0, 3.0])
    program = jax.jit(lambda x: as_kernel(function, x)).lower(x)
    assert MARK not in program.as_text()
    np.testing.assert_allclose(program.compile()(x), function(x))
