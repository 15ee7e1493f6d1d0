"""Programs as one kernel."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from jaxpound.simulation.kernels import as_kernel

TABLE = jnp.arange(4000.0)
MARK = 'xla_cpu_small_call = "true"'


def loop(x, unused):
    """Ten steps of a root, with an argument that it does not use, and a result that is another."""
    return jax.lax.scan(lambda y, _: (y - (y * y - x) / (2 * y), y), x, length=10)[0], x


def of(x):
    return as_kernel(loop, x, 3 * x)[0]


def test_a_loop_is_one_kernel_unless_it_is_differentiated_or_runs_step_by_step():
    x = jnp.asarray(2.0)
    with jax.disable_jit():
        assert float(of(x)) == pytest.approx(2**0.5, rel=1e-15)
    assert MARK in jax.jit(of).lower(x).as_text()
    assert float(jax.jit(of)(x)) == pytest.approx(2**0.5, rel=1e-15)
    value_and_slope = jax.jit(jax.value_and_grad(of))
    assert MARK not in value_and_slope.lower(x).as_text()
    value, slope = value_and_slope(x)
    assert float(slope) == pytest.approx(0.5 / float(value), rel=1e-12)
    assert float(jax.jit(jax.jacfwd(of))(x)) == pytest.approx(float(slope), rel=1e-12)


def test_a_batch_is_none():
    """XLA would hand sums over a large one to a library."""
    x = jnp.linspace(1.0, 9.0, 7)
    batch = jax.jit(jax.vmap(of))
    assert MARK not in batch.lower(x).as_text()
    np.testing.assert_allclose(batch(x), np.sqrt(x), rtol=1e-15)
    slopes = jax.jit(jax.vmap(jax.grad(of)))(x)
    np.testing.assert_allclose(slopes, 0.5 / np.sqrt(x), rtol=1e-12)


OTHERS = {
    "sort": jnp.sort,
    "product of matrices": lambda x: jnp.outer(x, x) @ x,
    "long sum": lambda x: jnp.broadcast_to(x, (50, x.size)).sum() + x,
    "scatter": lambda x: x.at[jnp.argmax(x)].set(0.0),
    "table": lambda x: jax.lax.dynamic_index_in_dim(TABLE, x[0].astype(int), keepdims=False) + x,
}


@pytest.mark.parametrize("function", OTHERS.values(), ids=OTHERS)
def test_what_xla_has_no_place_for_in_a_kernel_is_not_one(function):
    x = jnp.asarray([2.0, 1.0, 3.0])
    program = jax.jit(lambda x: as_kernel(function, x)).lower(x)
    assert MARK not in program.as_text()
    np.testing.assert_allclose(program.compile()(x), function(x))


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Sorted:
    """A spring by operations that a kernel cannot have: a sort, and a product of matrices."""

    stiffness: float

    def force(self, penetration, speed, touch_speed):
        values = jnp.sort(jnp.stack([penetration, 0 * penetration]))
        return self.stiffness * values @ jnp.arange(2.0)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Tabulated:
    """A ground motion from a table of a program, which XLA cannot hand to a kernel."""

    amplitude: float

    def acceleration(self, t):
        number = jnp.clip(100 * t, 0, TABLE.size - 1).astype(int)
        value = jax.lax.dynamic_index_in_dim(TABLE, number, keepdims=False)
        return self.amplitude * jnp.sin(value / 50)


def gap_of(width, law, ground):
    """Smallest gap of the paper's pair, from this width on, with a law of contact."""
    pair = dataclasses.replace(jp.paper.structures(), initial_gap=width, contact=law)
    return jp.demand(pair, ground, jp.TimeGrid.until(8.0, 0.05)).min_gap


def test_runs_with_a_ground_from_a_table_are_no_kernel():
    laws = jp.KelvinVoigt(300.0, 0.65), None
    runs = (jax.jit(partial(gap_of, law=law, ground=Tabulated(3.0))) for law in laws)
    touching, free = (run(0.05) for run in runs)
    assert free < touching < 0


def test_runs_with_a_law_that_is_no_kernel_are_none():
    """Alone and in a batch; a run with a law that is one has the same gap."""
    gaps, batches = jnp.asarray([0.05, 0.1]), []
    for law in (Sorted(300.0), jp.KelvinVoigt(300.0, restitution=1.0, tension=True)):
        gap = partial(gap_of, law=law, ground=jp.paper.ground())
        marked = MARK in jax.jit(gap).lower(gaps[0]).as_text()
        assert marked == isinstance(law, jp.KelvinVoigt)
        batches.append(jax.jit(jax.vmap(gap))(gaps))
    assert (batches[0] < 0).all()
    np.testing.assert_allclose(*batches, rtol=1e-7)
