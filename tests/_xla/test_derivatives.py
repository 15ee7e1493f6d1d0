"""A function with a loop, differentiated in both modes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxpound._xla.derivatives import in_both_modes, kept, recomputed


def power(inputs, constants):
    """The base to the power of a count, by a loop that counts, and a number that it ignores."""
    base, counts = inputs["base"], constants
    start = jnp.ones_like(base), jnp.zeros_like(counts)
    product, _ = jax.lax.while_loop(
        lambda state: state[1] < counts, lambda state: (state[0] * base, state[1] + 1), start
    )
    return {"power": product, "shifted": product + inputs["shift"].sum()}


INPUTS = {"base": jnp.asarray(1.3), "shift": jnp.arange(3.0)}
COUNT = jnp.asarray(5.0)


def test_both_modes_are_exact_on_a_counter():
    """d(b⁵)/db = 5 b⁴, under jit and vmap too, where the lanes' loops have different lengths."""
    power_both = in_both_modes(power, "a power")
    with pytest.raises(ValueError, match="Reverse-mode differentiation does not work"):
        jax.grad(lambda inputs: power(inputs, COUNT)["power"])(INPUTS)
    for differentiate in (jax.jacfwd, jax.jacrev):
        jacobian = jax.jit(differentiate(lambda inputs: power_both(inputs, COUNT)))(INPUTS)
        assert jacobian["power"]["base"] == pytest.approx(5 * 1.3**4, rel=1e-15)
        np.testing.assert_array_equal(jacobian["power"]["shift"], np.zeros(3))
        np.testing.assert_array_equal(jacobian["shifted"]["shift"], np.ones(3))
    counts = jnp.asarray([0.0, 3.0, 7.0])
    slope = jax.grad(lambda base, n: power_both({**INPUTS, "base": base}, n)["power"])
    slopes = jax.jit(jax.vmap(slope, (None, 0)))(1.3, counts)
    np.testing.assert_allclose(slopes, [0.0, 3 * 1.3**2, 7 * 1.3**6], rtol=1e-14)


def test_leaves_that_are_not_differentiated_have_the_derivative_zero():
    frozen = in_both_modes(power, "a power", lambda path: path[-1].key != "shift")
    gradient = jax.grad(lambda inputs: frozen(inputs, COUNT)["shifted"])(INPUTS)
    assert gradient["base"] == pytest.approx(5 * 1.3**4, rel=1e-15)
    np.testing.assert_array_equal(gradient["shift"], np.zeros(3))


def test_second_derivatives_are_refused_by_name():
    slope = jax.grad(
        lambda base: in_both_modes(power, "a power")({**INPUTS, "base": base}, COUNT)["power"]
    )
    for second in (jax.grad, jax.jacfwd):
        with pytest.raises(NotImplementedError, match="second derivatives of a power are not avai"):
            second(slope)(1.3)


def test_reverse_mode_computes_anew_what_is_not_kept():
    """Of the loop's sine and cosine; the number of cosines tells."""

    def wave(x):
        return jnp.sin(kept(jnp.cos(x)))

    def cosines(function):
        return str(jax.make_jaxpr(jax.grad(function))(1.0)).count("= cos ")

    whole, but_kept = recomputed(wave), recomputed(wave, but_kept=True)
    assert jax.grad(whole)(1.0) == jax.grad(but_kept)(1.0) == jax.grad(wave)(1.0)
    assert cosines(whole) > cosines(but_kept)
