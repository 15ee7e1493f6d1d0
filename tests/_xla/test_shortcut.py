"""Batches with a shortcut."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxpound._xla.shortcut import with_shortcut
from tests._xla.needs import shares_in_need

SIZES = (1, 63, 64, 65, 200)


def product_if_needed(scale):
    """x sin(scale y) where needed, else x; ``scale`` is closed over, as constants of a run are."""

    def whole(x, needed, y):
        return {"product": jnp.where(needed > 0, x * jnp.sin(scale * y), x)}, 2 * y

    def short(x, needed, y):
        return ({"product": x + 0 * y}, 2 * y), needed > 0

    return with_shortcut(whole, short), whole


@pytest.mark.parametrize("size", SIZES)
def test_runs_that_need_the_whole_program_have_its_results(size):
    function, whole = product_if_needed(jnp.asarray(0.3))
    x, y = np.linspace(1.0, 2.0, size), jnp.linspace(0.1, 0.4, 3)
    batch, plain = (jax.jit(jax.vmap(f, (0, 0, None))) for f in (function, whole))
    for needed in shares_in_need(size):
        for result, wanted in zip(
            *map(jax.tree.leaves, (batch(x, needed, y), plain(x, needed, y))), strict=True
        ):
            np.testing.assert_allclose(result, wanted, rtol=1e-14)


def test_a_batch_of_which_no_run_needs_the_whole_program_does_not_run_it():
    function = with_shortcut(lambda x: x + 1000.0, lambda x: (x, x > 1.0))
    x = jnp.asarray([0.0, 0.5, 2.0])
    np.testing.assert_array_equal(jax.vmap(function)(x), [0.0, 0.5, 1002.0])
    assert float(function(0.0)) == 1000.0


def test_a_batch_of_batches_is_one_batch():
    """Of numbers of the outer batch, of the inner one, of both, and of neither."""
    function = with_shortcut(lambda x, y, z, w: x + y + z + w + 9.0, lambda x, y, z, w: (x, x > y))
    x, y, z = jnp.asarray([0.0, 0.5, 2.0]), jnp.asarray([1.0, 0.1]), jnp.arange(6.0).reshape(2, 3)
    of_rows = jax.vmap(function, (0, None, 0, None))
    table = jax.jit(jax.vmap(of_rows, (None, 0, 0, None)))(x, y, z, 1.0)
    a, b = np.asarray(x)[None], np.asarray(y)[:, None]
    wanted = np.where(a > b, a + b + z + 10.0, a)
    np.testing.assert_allclose(table, wanted, rtol=1e-15)


def test_programs_keep_no_numbers_that_are_being_traced():
    def scanned(scale, x):
        function = product_if_needed(scale)[0]

        def step(y, _):
            return function(y, y, jnp.ones(1))[0]["product"].sum(), None

        return jax.lax.scan(step, x, length=3)[0]

    with jax.checking_leaks():
        jax.jit(lambda scale: jax.vmap(lambda x: scanned(scale, x))(jnp.ones(3)))(0.3)


def test_derivatives_are_those_of_the_whole_program():
    """In both modes, inside and outside of the batch, by numbers of each run and of all."""
    x, needed, y = jnp.linspace(1.0, 2.0, 70), jnp.arange(70) % 3.0, jnp.linspace(0.1, 0.4, 3)

    def total(which, scale, x, y):
        function = product_if_needed(scale)[which]
        of_all = jax.vmap(lambda x, n: function(x, n, y)[0]["product"].sum() ** 2)
        return of_all(x, needed).sum()

    def of_each(which, scale, x, y):
        function = product_if_needed(scale)[which]

        def single(x, n):
            return jax.grad(lambda x: function(x, n, y)[0]["product"].sum())(x)

        return jax.vmap(single)(x, needed)

    numbers = jnp.asarray(0.3), x, y
    for derivative in (jax.grad, jax.jacfwd):
        of_both = [derivative(lambda *a, i=i: total(i, *a), (0, 1, 2))(*numbers) for i in (0, 1)]
        for result, wanted in zip(*of_both, strict=True):
            np.testing.assert_allclose(result, wanted, rtol=1e-13)
    np.testing.assert_allclose(of_each(0, *numbers), of_each(1, *numbers), rtol=1e-13)
