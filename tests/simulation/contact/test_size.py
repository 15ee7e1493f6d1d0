"""Contact's programs stay small: LLVM's time grows faster than their length."""

import jax
import jax.numpy as jnp
import pytest

import jaxpound as jp
from tests.simulation.pairs import GRID

PAIR = jax.tree.map(
    jnp.asarray,
    jp.AdjacentStructures(
        *(jp.ZenerRod(0.5, 0.05, 0.2), jp.ZenerRod(0.5, 0.05, 0.3)),
        *(0.8, 1.7, 0.1, 0.2),
        contact=jp.KelvinVoigt(400.0, 0.65),
    ),
)
BATCH = jax.tree.map(lambda x: jnp.stack([x] * 64), PAIR)


def smallest_gap(structures):
    return jp.demand(structures, jp.paper.ground(), GRID).min_gap


@pytest.mark.parametrize(
    ("function", "structures", "most"),
    [
        (smallest_gap, PAIR, 4600),
        (jax.value_and_grad(smallest_gap), PAIR, 11_000),
        (jax.vmap(jax.value_and_grad(smallest_gap)), BATCH, 12_000),
    ],
    ids=["value", "value and gradient", "batch"],
)
def test_instructions_of_a_pair_that_pounds(function, structures, most):
    """Operations of the lowered program; before events were a table the gradient had 17,265."""
    program = jax.jit(function).lower(structures).as_text()
    operations = sum(" = " in line for line in program.splitlines())
    assert operations < most
