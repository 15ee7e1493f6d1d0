"""Numbers that XLA must not know, and derivatives of zero."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxpound._xla.quotients import differentiated_once, differentiated_with, once, unit_of


@pytest.mark.parametrize("function", [once, differentiated_once])
def test_numbers_and_both_derivatives_stay_the_same_to_the_last_bit(function):
    x = jnp.linspace(0.1, 3.0, 50)

    def waves(x, function=lambda tree, unit: tree):
        return jax.tree.map(jnp.sin, function({"x": x}, unit_of(0 * x)))["x"]

    for result, expected in (
        (waves(x, function), waves(x)),
        (jax.jacfwd(waves)(x, function), jax.jacfwd(waves)(x)),
        (jax.jacrev(waves)(x, function), jax.jacrev(waves)(x)),
    ):
        np.testing.assert_array_equal(result, expected)


def test_a_program_has_the_quotients_that_it_is_to_compute_once():
    """XLA does not know that the unit is 1: it would leave them out, and all that they are for."""

    def program(function, derivative):
        return (
            jax.jit(derivative(lambda x: function(jnp.sin(x), unit_of(0 * x)))).lower(1.0).compile()
        )

    quotients = {
        (function, derivative): program(function, derivative).as_text().count(" divide(")
        for function in (once, differentiated_once)
        for derivative in (lambda f: f, jax.grad)
    }
    assert [count > 0 for count in quotients.values()] == [True, True, False, True]


def test_a_derivative_of_zero_stays_zero_in_both_modes():
    """Where what follows has an infinite derivative too, and by arrays without numbers."""
    zero, empty = jnp.zeros(()), jnp.zeros(0)

    def diverging(numbers):
        return jnp.inf * differentiated_with(zero, numbers)

    by_number, by_array = jax.grad(diverging)((3.0, empty))
    assert by_number == 0
    assert by_array.shape == (0,)
    value, slope = jax.jvp(lambda x: differentiated_with(zero, (2.0, x)), (empty,), (empty,))
    assert value == slope == 0
    slopes = jax.vmap(jax.grad(lambda x: differentiated_with(zero, x)))(jnp.ones(3))
    assert (slopes == 0).all()
