"""The loop over time by itself: what it starts from, and its steps however they are laid out."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from jaxpound.simulation.rollout import _differentiated_with
from jaxpound.simulation.scan import scan_with_history

ORDERS = (0.3, 0.8)


def advance(carry, sums, m, entry):
    """Two coupled memories, driven by an input."""
    c = [entry - 0.3 * sums[1] + 0.1 * carry, 0.5 * carry - 0.2 * sums[0]]
    carry = 0.9 * carry + 0.2 * c[0] * c[1] + 0.1 * entry
    return carry, c, (carry, {"c": c[0], "m": jnp.where(m < 0, 0, m)})


@partial(jax.jit, static_argnames=("history", "block", "segmented", "checkpoint"))
def run(inputs, history, **layout):
    orders = [jnp.asarray(order) for order in ORDERS]
    zero = jnp.zeros(())
    return scan_with_history(advance, zero, inputs.size - 1, orders, history, inputs, **layout)


@pytest.mark.parametrize("n", [1, 4, 30, 101])
@pytest.mark.parametrize("history", [jp.FullHistory(), jp.ModalHistory()])
def test_every_layout_takes_the_same_steps(n, history):
    inputs = jnp.asarray(np.random.default_rng(n).normal(size=n + 1))
    end, (carries, seen) = run(inputs, history)
    assert carries.shape == (n + 1,)
    np.testing.assert_array_equal(seen["m"], np.arange(n + 1))
    assert end == carries[-1]
    loop = {"block": "loop"}
    slope = jax.grad(lambda inputs, **layout: run(inputs, history, **layout)[0])
    for layout in (loop, loop | {"segmented": True}, {"checkpoint": True}, {"block": "recomputed"}):
        np.testing.assert_allclose(run(inputs, history, **layout)[1][0], carries, rtol=1e-12)
    np.testing.assert_allclose(slope(inputs, block="recomputed"), slope(inputs), rtol=1e-12)


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
