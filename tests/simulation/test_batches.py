import re
import subprocess
import sys
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp

GRID = jp.TimeGrid(0.04, 100)


def gaps(amplitude, friction):
    structures = replace(jp.paper.structures(), friction=friction)
    return jp.demand(structures, jp.Ricker(amplitude, [1.25, 2.0], [1.5, 2.5]), GRID)


def impulses(amplitude, friction):
    """Of blocks that collide, some of them in any step."""
    structures = replace(
        jp.paper.structures(), friction=friction, initial_gap=0.05, contact=jp.Newton(0.6)
    )
    return jp.demand(structures, jp.Ricker(amplitude, [1.25, 2.0], [1.5, 2.5]), GRID).peak_impulse


def batch(n):
    return np.linspace(0.1, 1.0, n), np.linspace(0.4, 0.1, n)


@pytest.mark.parametrize("chunk_size", [1, 3, 7, 50, None])
def test_chunks_give_what_one_batch_gives(chunk_size):
    """Sizes that divide the batch, that leave a rest, and one larger than it."""
    whole = jax.vmap(gaps)(*batch(7))
    parts = jp.in_chunks(gaps, chunk_size)(*batch(7))
    for one, other in zip(jax.tree.leaves(whole), jax.tree.leaves(parts), strict=True):
        assert isinstance(other, np.ndarray)
        np.testing.assert_allclose(other, one, rtol=1e-12, atol=1e-14)


def test_batches_of_nearly_as_many_runs_share_a_program():
    compiled = []

    def wave(a):
        compiled.append(a)
        return jnp.sqrt(a) + jnp.sin(a) / 3

    run, a = jp.in_chunks(wave, 64), np.linspace(0.1, 1.0, 200)
    for programs, sizes in ((1, (5, 6, 7, 8)), (2, (9, 14, 16)), (3, (40, 63, 64, 65, 200))):
        found = [run(a[:n]) for n in sizes]
        assert len(compiled) == programs
        for n, result in zip(sizes, found, strict=True):
            np.testing.assert_array_equal(result, found[-1][:n])  # to the last bit
            np.testing.assert_allclose(result, np.sqrt(a[:n]) + np.sin(a[:n]) / 3, rtol=1e-14)


def test_chunks_take_keys_and_return_gradients():
    def slope(key):
        amplitude = jax.random.uniform(key, minval=0.1)
        return jax.grad(lambda mu: gaps(amplitude, mu).min_gap)(0.2)

    keys = jax.random.split(jax.random.key(1), 5)
    whole = jax.jit(jax.vmap(slope))(keys)
    np.testing.assert_allclose(jp.in_chunks(slope, 2)(keys), whole, rtol=1e-10)


@pytest.mark.unchecked
@pytest.mark.parametrize("size", [0, -3, 2.5, True, "many"])
def test_an_impossible_chunk_size_is_refused(size):
    with pytest.raises(ValueError, match=r"in_chunks: chunk_size = .* must be a positive whole"):
        jp.in_chunks(gaps, size)


@pytest.mark.parametrize("args", [(), (1.0,), (np.ones(3), np.ones(4)), (np.ones(0), np.ones(0))])
def test_arguments_that_make_no_batch_are_refused(args):
    with pytest.raises(ValueError, match="the same number of runs, at least 1"):
        jp.in_chunks(gaps, 2)(*args)


@pytest.mark.unchecked
@pytest.mark.parametrize("n", [0, -1, 1.5, True])
def test_an_impossible_number_of_cores_is_refused(n):
    with pytest.raises(ValueError, match=r"use_cores: n = .* must be a positive whole number"):
        jp.use_cores(n)


def test_cores_cannot_change_once_jax_has_started():
    jnp.zeros(1).block_until_ready()
    assert jp.use_cores(len(jax.devices("cpu"))) == len(jax.devices("cpu"))
    with pytest.raises(RuntimeError, match="use_cores: n = 77 must be set before JAX computes"):
        jp.use_cores(77)


SHARDED = """
import sys
import jax, jaxpound as jp, numpy as np
jax.config.update("jax_enable_x64", True)
assert jp.use_cores(2) == 2
from jax.sharding import Mesh, PartitionSpec as P
from tests.simulation.test_batches import batch, gaps, impulses

assert len(jax.devices()) == 2
def devices(x): return len(x.sharding.device_set)

whole = jax.vmap(gaps)(*batch(64))
assert devices(whole.min_gap) == 2 and not whole.min_gap.sharding.is_fully_replicated
slope = jax.jit(jax.vmap(jax.grad(lambda a, mu: gaps(a, mu).min_gap, argnums=(0, 1))))(*batch(64))
def average(mu): return jax.vmap(lambda a: gaps(a, mu).min_gap)(batch(64)[0]).mean()
mean = jax.jit(jax.grad(average))(0.2)
rows = jax.vmap(lambda a: jax.vmap(lambda mu: gaps(a, mu).min_gap)(batch(3)[1]))
table = jax.jit(rows)(batch(32)[0])
odd = jax.vmap(gaps)(*batch(33))
chunks = jp.in_chunks(gaps, 16)(*batch(39))
# Inside a sharding of the caller's own nothing is spread again.
mesh = Mesh(np.array(jax.devices()), ("mine",))
own = jax.shard_map(jax.vmap(gaps), mesh=mesh, in_specs=P("mine"), out_specs=P("mine"))
own = jax.jit(own)(*map(jax.numpy.asarray, batch(64)))
struck = jax.jit(jax.vmap(impulses)).lower(*batch(64)).compile()
assert "all-gather" not in struck.as_text()
slopes = jax.vmap(jax.value_and_grad(impulses))
struck_own = jax.shard_map(slopes, mesh=mesh, in_specs=P("mine"), out_specs=P("mine"))
struck_own, _ = jax.jit(struck_own)(*map(jax.numpy.asarray, batch(64)))
# Nor within a default device, so that arrays may be committed to it.
with jax.default_device(jax.devices()[1]):
    there = jax.vmap(gaps)(*jax.device_put(batch(64), jax.devices()[1])).min_gap
assert devices(there) == 1
results = dict(whole=whole.min_gap, slope=slope, mean=mean, table=table, odd=odd.min_gap,
               chunks=chunks.min_gap, own=own.min_gap, there=there,
               struck=struck(*batch(64)), struck_own=struck_own)
np.savez(sys.argv[1], **{k: np.asarray(v) for k, v in results.items()})
"""


def test_a_batch_over_two_devices_is_the_batch_on_one(tmp_path):
    """Values, derivatives, a mean over the batch, nested and odd batches, against a loop."""
    path = tmp_path / "two.npz"
    done = subprocess.run(
        [sys.executable, "-c", SHARDED, str(path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    two = np.load(path)
    a, mu = batch(64)

    def gap(a, mu):
        return gaps(a, mu).min_gap

    run = jax.jit(jax.value_and_grad(gap, argnums=(0, 1)))

    def loop(a, mu):
        values, slopes = zip(*[run(*case) for case in zip(a, mu, strict=True)], strict=True)
        return np.array(values), np.array(slopes).T

    whole, slope = loop(a, mu)
    one = {
        "whole": whole,
        "slope": slope,
        "mean": loop(a, np.full(64, 0.2))[1][1].mean(),
        "table": [loop(np.full(3, x), batch(3)[1])[0] for x in batch(32)[0]],
        "odd": loop(*batch(33))[0],
        "chunks": loop(*batch(39))[0],
        "own": whole,
        "there": whole,
    }
    alone = jax.jit(impulses)
    one["struck"] = one["struck_own"] = [alone(*case) for case in zip(a, mu, strict=True)]
    assert set(one) == set(two)
    for name, values in one.items():
        np.testing.assert_allclose(two[name], values, rtol=1e-9, atol=1e-12, err_msg=name)


def test_second_derivatives_of_a_batch_against_differences_of_the_first():
    a, mu = batch(3)

    def slope(a, mu):
        return jax.jacfwd(lambda mu: gaps(a, mu).min_gap)(mu)

    def both(a, mu):
        return slope(a, mu), jax.jacfwd(slope, argnums=1)(a, mu)

    batched = jax.jit(jax.vmap(both))
    step = 1e-6
    bend, slopes = batched(a, mu)[1], [batched(a, mu + sign * step)[0] for sign in (1, -1)]
    np.testing.assert_allclose(bend, (slopes[0] - slopes[1]) / (2 * step), rtol=1e-5, atol=1e-7)
    assert np.abs(bend).max() > 1e-3


@pytest.mark.unchecked
def test_chunks_inside_a_transformation_are_refused_by_name():
    chunked = jp.in_chunks(lambda x: 2 * x)
    with pytest.raises(ValueError, match="in_chunks runs outside jit, vmap and grad"):
        jax.jit(chunked)(jnp.ones(3))
    with pytest.raises(ValueError, match="in_chunks runs outside jit, vmap and grad"):
        jax.grad(lambda y: jp.in_chunks(lambda x: x * y)(np.ones(3)).sum())(2.0)
    with pytest.raises(ValueError, match=r"results of type key<fry> must be numbers"):
        jp.in_chunks(lambda x: jax.random.key(0))(np.ones(3))
    with pytest.raises(ValueError, match="in_chunks: function = 3 must be a function"):
        jp.in_chunks(3)


def test_structures_that_a_batch_closes_over_are_not_folded_into_its_program():
    """XLA would compute what follows from them while it compiles, for the whole batch."""
    grid, n = jp.TimeGrid.until(5.0, dt=0.05), 777

    def smallest(amplitude):
        return jp.demand(jp.paper.structures(), amplitude * jp.paper.ground(), grid).min_gap

    program = jax.jit(jax.vmap(smallest)).lower(np.linspace(0.05, 0.3, n)).compile().as_text()
    assert not re.search(rf"\[[\d,]*{n}[\d,]*\]\S* constant\(", program)


@pytest.mark.parametrize(("n", "most"), [(512, 480), (481, 480), (1000, 96), (96, 96), (33, 480)])
def test_chunks_are_even(n, most):
    """Of many runs few are computed twice to fill the last chunk up."""
    seen = []

    def run(x):
        jax.debug.callback(lambda y: seen.append(y), x)
        return 2 * x

    assert (jp.in_chunks(run, most)(np.arange(n)) == 2 * np.arange(n)).all()
    jax.effects_barrier()
    assert len(seen) <= max(1.15 * n, 64)
