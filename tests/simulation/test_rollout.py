"""What a run starts from."""

import jax
import jax.numpy as jnp

from jaxpound.simulation.rollout import _differentiated_with


def test_a_derivative_of_zero_stays_zero_in_both_modes():
    """Where what follows has an infinite derivative too, and by arrays without numbers."""
    zero, empty = jnp.zeros(()), jnp.zeros(0)

    def diverging(numbers):
        return jnp.inf * _differentiated_with(zero, numbers)

    by_number, by_array = jax.grad(diverging)((3.0, empty))
    assert by_number == 0
    assert by_array.shape == (0,)
    value, slope = jax.jvp(lambda x: _differentiated_with(zero, (2.0, x)), (empty,), (empty,))
    assert value == slope == 0
    slopes = jax.vmap(jax.grad(lambda x: _differentiated_with(zero, x)))(jnp.ones(3))
    assert (slopes == 0).all()
