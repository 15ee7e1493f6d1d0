"""The loop over time by itself: however its steps are laid out, they are the same steps."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from jaxpound.simulation.scan import scan_with_history

ORDERS = (0.3, 0.8)
LAYOUTS = ("looped", "step by step")
OTHERS = [
    *({"layout": name, "segmented": segmented} for name in LAYOUTS for segmented in (False, True)),
    *({"layout": name, "checkpoint": True} for name in ("written out", *LAYOUTS)),
]


def advance(carry, sums, m, entry):
    """Two coupled memories, driven by an input."""
    c = [entry - 0.3 * sums[1] + 0.1 * carry, 0.5 * carry - 0.2 * sums[0]]
    carry = 0.9 * carry + 0.2 * c[0] * c[1] + 0.1 * entry
    return carry, c, (carry, {"c": c[0], "m": jnp.where(m < 0, 0, m)})


@partial(jax.jit, static_argnames=("history", "layout", "segmented", "checkpoint"))
def run(inputs, history, **options):
    orders = [jnp.asarray(order) for order in ORDERS]
    zero = jnp.zeros(())
    return scan_with_history(advance, zero, inputs.size - 1, orders, history, inputs, **options)


@pytest.mark.parametrize("n", [1, 4, 30, 101])
@pytest.mark.parametrize("history", [jp.FullHistory(), jp.ModalHistory()])
def test_every_layout_takes_the_same_steps(n, history):
    inputs = jnp.asarray(np.random.default_rng(n).normal(size=n + 1))
    end, (carries, seen) = run(inputs, history)
    assert carries.shape == (n + 1,)
    np.testing.assert_array_equal(seen["m"], np.arange(n + 1))
    assert end == carries[-1]
    for options in OTHERS:
        np.testing.assert_allclose(run(inputs, history, **options)[1][0], carries, rtol=1e-12)


def test_gradients_of_all_layouts_agree():
    inputs = jnp.asarray(np.random.default_rng(0).normal(size=40))
    slope = jax.grad(lambda inputs, **options: run(inputs, jp.ModalHistory(), **options)[0])
    written = slope(inputs)
    for options in OTHERS:
        np.testing.assert_allclose(slope(inputs, **options), written, rtol=1e-10)


def test_steps_one_by_one_need_no_memory():
    def advance(carry, sums, m, entry):
        assert not sums
        return carry + entry, [], carry

    inputs, options = jnp.arange(5.0), {"layout": "step by step"}
    end, series = scan_with_history(
        advance, jnp.zeros(()), 4, [], jp.ModalHistory(), inputs, **options
    )
    assert end == 10
    np.testing.assert_array_equal(series, [0, 0, 1, 3, 6])
