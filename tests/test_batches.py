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


def test_chunks_take_keys_and_return_gradients():
    def slope(key):
        amplitude = jax.random.uniform(key, minval=0.1)
        return jax.grad(lambda mu: gaps(amplitude, mu).min_gap)(0.2)

    keys = jax.random.split(jax.random.key(1), 5)
    np.testing.assert_allclose(jp.in_chunks(slope, 2)(keys), jax.vmap(slope)(keys), rtol=1e-10)


@pytest.mark.parametrize("size", [0, -3, 2.5, True, "many"])
def test_an_impossible_chunk_size_is_refused(size):
    with pytest.raises(ValueError, match=r"in_chunks: chunk_size = .* must be a positive whole"):
        jp.in_chunks(gaps, size)


@pytest.mark.parametrize("args", [(), (1.0,), (np.ones(3), np.ones(4)), (np.ones(0), np.ones(0))])
def test_arguments_that_make_no_batch_are_refused(args):
    with pytest.raises(ValueError, match="the same number of runs, at least 1"):
        jp.in_chunks(gaps, 2)(*args)


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
import sys; sys.path.insert(0, "tests")
import jax, jaxpound as jp, numpy as np
jax.config.update("jax_enable_x64", True)
assert jp.use_cores(2) == 2
from jax.sharding import Mesh, PartitionSpec as P
from test_batches import batch, gaps

assert len(jax.devices()) == 2
def devices(x): return len(x.sharding.device_set)

whole = jax.vmap(gaps)(*batch(64))
assert devices(whole.min_gap) == 2 and not whole.min_gap.sharding.is_fully_replicated
slope = jax.vmap(jax.grad(lambda a, mu: gaps(a, mu).min_gap, argnums=(0, 1)))(*batch(64))
forward = jax.vmap(jax.jacfwd(lambda a, mu: gaps(a, mu).min_gap, argnums=(0, 1)))(*batch(64))
mean = jax.grad(lambda mu: jax.vmap(lambda a: gaps(a, mu).min_gap)(batch(64)[0]).mean())(0.2)
table = jax.vmap(lambda a: jax.vmap(lambda mu: gaps(a, mu).min_gap)(batch(3)[1]))(batch(32)[0])
odd = jax.vmap(gaps)(*batch(33))
chunks = jp.in_chunks(gaps, 16)(*batch(39))
# Inside a sharding of the caller's own nothing is spread again.
mesh = Mesh(np.array(jax.devices()), ("mine",))
own = jax.shard_map(jax.vmap(gaps), mesh=mesh, in_specs=P("mine"), out_specs=P("mine"))
own = jax.jit(own)(*map(jax.numpy.asarray, batch(64)))
results = dict(whole=whole.min_gap, slope=slope, forward=forward, mean=mean, table=table,
               odd=odd.min_gap, chunks=chunks.min_gap, own=own.min_gap)
np.savez(sys.argv[1], **{k: np.asarray(v) for k, v in results.items()})
"""


def test_a_batch_over_two_devices_is_the_batch_on_one(tmp_path):
    """Values, both modes of derivatives, a sum over the batch, nested and odd batches."""
    path = tmp_path / "two.npz"
    done = subprocess.run(
        [sys.executable, "-c", SHARDED, str(path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    two = np.load(path)
    a, mu = batch(64)

    def gap(a, mu):
        return gaps(a, mu).min_gap

    slope = jax.vmap(jax.grad(gap, argnums=(0, 1)))(a, mu)
    one = {
        "whole": jax.vmap(gap)(a, mu),
        "slope": slope,
        "forward": slope,
        "mean": jax.vmap(jax.grad(gap, argnums=1))(a, np.full(64, 0.2)).mean(),
        "table": jax.vmap(lambda a: jax.vmap(lambda mu: gap(a, mu))(batch(3)[1]))(batch(32)[0]),
        "odd": jax.vmap(gap)(*batch(33)),
        "chunks": jax.vmap(gap)(*batch(39)),
        "own": jax.vmap(gap)(a, mu),
    }
    assert set(one) == set(two)
    for name, values in one.items():
        np.testing.assert_allclose(two[name], values, rtol=1e-9, atol=1e-12, err_msg=name)
