"""Functions of many arguments of few kinds."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound._xla.alike import by_kind, map_alike


def test_arguments_of_one_kind_are_one_program_that_does_what_each_of_them_does():
    traced = []

    def product(factors, x):
        traced.append(x)
        return {"all": factors["a"] * x.sum(), "each": [factors["a"] * x]}

    factors = [{"a": jnp.asarray(a)} for a in (1.0, 2.0, 3.0, 4.0)]
    arguments = [*zip(factors, map(jnp.arange, (2.0, 3.0, 2.0, 2.0)), strict=True)]
    assert by_kind(arguments) == [[0, 2, 3], [1]]
    apart = map_alike(product, arguments, together=False)
    assert len(traced) == 4
    together = map_alike(product, arguments, together=True)
    assert len(traced) == 4 + 2
    for result, expected in zip(*map(jax.tree.leaves, (together, apart)), strict=True):
        np.testing.assert_array_equal(result, expected)
    # Keys are part of a kind.
    assert by_kind([{"a": 1.0}, {"b": 1.0}, {"a": 2.0}]) == [[0, 2], [1]]
