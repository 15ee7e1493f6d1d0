"""The loop over time by itself: what it starts from, and its steps however they are laid out."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from jaxpound._xla.plan import Plan
from jaxpound.simulation.time.scan import scan_with_history

ORDERS = (0.3, 0.8)


def advance(carry, sums, m, entry):
    """Two coupled memories, driven by an input."""
    c = [entry - 0.3 * sums[1] + 0.1 * carry, 0.5 * carry - 0.2 * sums[0]]
    carry = 0.9 * carry + 0.2 * c[0] * c[1] + 0.1 * entry
    return carry, c, (carry, {"c": c[0], "m": jnp.where(m < 0, 0, m)})


PLAIN, WRITTEN_OUT, RECOMPUTED = map(Plan, ("loop", "written out", "recomputed"))
IN_SEGMENTS = Plan("loop", segments=True)


@partial(jax.jit, static_argnames=("history", "plan", "checkpoint"))
def run(inputs, history, plan=PLAIN, checkpoint=False):
    orders = [jnp.asarray(order) for order in ORDERS]
    case = jnp.zeros(()), inputs.size - 1, orders, history, inputs, plan
    return scan_with_history(advance, *case, checkpoint)


@pytest.mark.parametrize("n", [1, 4, 30, 101])
@pytest.mark.parametrize("history", [jp.simulation.FullHistory(), jp.ModalHistory()])
def test_every_plan_takes_the_same_steps(n, history):
    inputs = jnp.asarray(np.random.default_rng(n).normal(size=n + 1))
    end, (carries, seen) = run(inputs, history)
    assert carries.shape == (n + 1,)
    np.testing.assert_array_equal(seen["m"], np.arange(n + 1))
    assert end == carries[-1]
    for case in ((WRITTEN_OUT, True), (WRITTEN_OUT,), (RECOMPUTED,), (IN_SEGMENTS,)):
        np.testing.assert_allclose(run(inputs, history, *case)[1][0], carries, rtol=1e-12)
    slope = jax.grad(lambda inputs, plan: run(inputs, history, plan)[0])
    np.testing.assert_allclose(slope(inputs, RECOMPUTED), slope(inputs, WRITTEN_OUT), rtol=1e-12)
