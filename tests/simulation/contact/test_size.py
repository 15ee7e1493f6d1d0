"""Contact's programs stay small: LLVM's time grows faster than their length."""

import jax
import jax.numpy as jnp
import pytest

import jaxpound as jp
from tests.simulation.pairs import GRID

RODS = jp.ZenerRod(0.5, 0.05, 0.2), jp.ZenerRod(0.5, 0.05, 0.3)
NUMBERS = jp.AdjacentStructures(*RODS, 0.8, 1.7, 0.1, 0.2, contact=jp.KelvinVoigt(400.0, 0.65))
PAIR = jax.tree.map(jnp.asarray, NUMBERS)
BATCH = jax.tree.map(lambda x: jnp.stack([x] * 64), PAIR)


def smallest_gap(structures):
    return jp.demand(structures, jp.paper.ground(), GRID).min_gap


GRADIENT = jax.value_and_grad(smallest_gap)
PROGRAMS = {"value": (smallest_gap, PAIR, 4600), "value and gradient": (GRADIENT, PAIR, 11_000)}
PROGRAMS["batch"] = jax.vmap(GRADIENT), BATCH, 12_000


@pytest.mark.parametrize(("function", "structures", "most"), PROGRAMS.values(), ids=PROGRAMS)
def test_instructions_of_a_pair_that_pounds(function, structures, most):
    """Operations of the lowered program; before events were a table the gradient had 17,265."""
    program = jax.jit(function).lower(structures).as_text()
    assert sum(" = " in line for line in program.splitlines()) < most
