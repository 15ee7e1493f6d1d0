"""Work for those lanes of a batch alone that need it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxpound._xla.lanes import where_needed
from tests._xla.needs import shares_in_need


def root(x, limit):
    """Iterations of Newton's method for √x, whose number differs from lane to lane."""

    def improved(state):
        return (state[0] + x / state[0]) / 2, state[0]

    start = x, jnp.zeros_like(x)
    return jax.lax.while_loop(lambda y: jnp.abs(y[0] - y[1]) > limit, improved, start)[0]


@pytest.mark.parametrize("width", [2, 8])
@pytest.mark.parametrize("size", [1, 65, 5000])
def test_lanes_that_need_work_have_its_results_and_all_others_zeros(width, size):
    work = jax.jit(jax.vmap(where_needed(root, width), (0, 0, None)))
    x = np.linspace(1.0, 4.0, size)
    for needed in shares_in_need(size):
        result = work(needed > 0, x, 1e-14)
        np.testing.assert_allclose(result, np.where(needed > 0, np.sqrt(x), 0.0), rtol=1e-14)
    table = jax.vmap(work, (0, 0, None))(
        np.stack([needed, 0 * needed]) > 0, np.stack([x, x]), 1e-14
    )
    np.testing.assert_allclose(table, [result, 0 * result], rtol=1e-14)
