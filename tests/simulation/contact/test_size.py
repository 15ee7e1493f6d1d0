"""Contact's programs stay small: LLVM's time grows faster than their length."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import pytest
from jax.extend.core import jaxprs_in_params

import jaxpound as jp
from jaxpound._xla import plan
from tests.simulation.pairs import GRID

RODS = jp.ZenerRod(0.5, 0.05, 0.2), jp.ZenerRod(0.5, 0.05, 0.3)
NUMBERS = jp.AdjacentStructures(*RODS, 0.8, 1.7, 0.1, 0.2, contact=jp.KelvinVoigt(400.0, 0.65))
PAIR = jax.tree.map(jnp.asarray, NUMBERS)
BATCH = jax.tree.map(lambda x: jnp.stack([x] * 64), PAIR)


def smallest_gap(structures):
    return jp.demand(structures, jp.paper.ground(), GRID).min_gap


GRADIENT = jax.value_and_grad(smallest_gap)
PROGRAMS = {"value": (smallest_gap, PAIR, 4800), "value and gradient": (GRADIENT, PAIR, 11_300)}
PROGRAMS["batch"] = jax.vmap(smallest_gap), BATCH, 8000
PROGRAMS["batch, value and gradient"] = jax.vmap(GRADIENT), BATCH, 13_400


@pytest.mark.parametrize(("function", "structures", "most"), PROGRAMS.values(), ids=PROGRAMS)
def test_instructions_of_a_pair_that_pounds(function, structures, most):
    """Operations of the lowered program; before events were a table the gradient had 17,265."""
    with plan.chosen(plan.fast):  # that of users
        program = jax.jit(function).lower(structures).as_text()
    assert sum(" = " in line for line in program.splitlines()) < most


def test_floors_of_the_same_shape_are_one_program():
    """A further floor of two towers adds two rods and masses; its link made 1,134 of it."""

    def operations(floors):
        towers = (jp.Storeys((1.0,) * floors, (jp.Rod(RODS[0], 3.0),) * floors),) * 2
        contact = {"friction": 0.05, "gap": 0.2, "contact": jp.KelvinVoigt(400.0, 0.65)}
        row = jp.Row(towers, tuple(jp.FloorLink(0, i, **contact) for i in range(floors)))
        program = jax.jit(smallest_gap).lower(jax.tree.map(jnp.asarray, row)).as_text()
        return sum(" = " in line for line in program.splitlines())

    assert operations(6) - operations(5) < 750


def scans(program):
    """The loops over blocks of steps, and all loops inside them."""
    for step in program.eqns:
        if step.primitive.name == "scan":
            yield step
        for inner in jaxprs_in_params(step.params):
            yield from scans(inner)


def test_numbers_that_reverse_mode_keeps_of_a_step():
    """The flow's results, else flows are computed anew, and the state; not the rest of it."""
    numbers = []
    for loop in scans(jax.make_jaxpr(GRADIENT)(PAIR).jaxpr):
        # What a loop takes entry by entry has one dimension more than in its steps.
        pairs = zip(loop.invars, loop.params["jaxpr"].jaxpr.invars, strict=True)
        taken = [x.aval.shape for x, in_step in pairs if x.aval.ndim > in_step.aval.ndim]
        numbers.append(sum(map(math.prod, taken)) / (GRID.n_steps + 1))
    assert 45 < max(numbers) < 60


def test_reverse_mode_with_checkpoints_is_forward_mode():
    def impulse(structures):
        scheme = jp.Scheme(checkpoint=True)
        return jp.demand(structures, jp.paper.ground(), GRID, scheme).peak_impulse

    change = jax.tree.map(jnp.ones_like, PAIR)
    value, slope = jax.jit(lambda x: jax.jvp(impulse, (x,), (change,)))(PAIR)
    value_again, slopes = jax.jit(jax.value_and_grad(impulse))(PAIR)
    assert float(value) == pytest.approx(float(value_again), rel=1e-12)
    assert float(value) > 0
    assert sum(jax.tree.leaves(slopes)) == pytest.approx(float(slope), rel=1e-9)


MODES = {"forward": jax.jacfwd, "reverse": jax.grad}


@pytest.mark.parametrize("outer", MODES.values(), ids=MODES)
@pytest.mark.parametrize("inner", MODES.values(), ids=MODES)
def test_second_derivatives_are_refused(inner, outer):
    def gap(friction):
        return smallest_gap(dataclasses.replace(PAIR, friction=friction))

    with pytest.raises(NotImplementedError, match="second derivatives of a run with contact"):
        jax.eval_shape(outer(inner(gap)), 0.1)
