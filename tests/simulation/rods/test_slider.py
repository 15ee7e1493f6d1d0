"""A step of a bilinear rod in closed form beside the steps of any law."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from jaxpound._fields import pytree_dataclass
from jaxpound.model.hysteresis import Plastic
from jaxpound.simulation.rods.slider import slider_step
from jaxpound.simulation.rods.yielding import Hysteretic, followed

SIZE = 4000


def steps(dtype):
    """Random steps of rods, which yield, turn, or both, or not; numbers of the law and the path."""
    random = np.random.default_rng(7)
    e_y, hardening = random.uniform(0.05, 0.3, SIZE), random.uniform(0.0, 1.0, SIZE)
    place = random.normal(scale=0.2, size=SIZE)
    last = place + e_y * random.uniform(-1, 1, SIZE)
    change, before = random.normal(scale=0.1, size=(2, SIZE))
    numbers = e_y, hardening, place, last, change, change - before, last + change
    return [jnp.asarray(x, dtype) for x in numbers]


def in_closed_form(e_y, hardening, place, *path):
    law = jp.Bilinear(e_y, hardening)
    state, kink, _ = slider_step(law, Plastic(place, 0 * place), *path)
    return jnp.stack([state.elongation, state.dissipated, kink])


def by_the_rules(e_y, hardening, place, *path):
    rod = Hysteretic(jp.Bilinear(e_y, hardening), jnp.ones_like(e_y))
    state, kink, _ = followed(rod, Plastic(place, 0 * place), *path)
    return jnp.stack([state.elongation, state.dissipated, kink])


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_closed_form_follows_the_rules_of_any_law(dtype):
    numbers, bound = steps(dtype), {np.float32: 2e-6, np.float64: 1e-15}[dtype]
    place, _, kink = result = in_closed_form(*numbers)
    assert result.dtype == dtype
    assert np.asarray(result) == pytest.approx(np.asarray(by_the_rules(*numbers)), abs=bound)
    moves, turns = place != numbers[2], numbers[4] * (numbers[4] - numbers[5]) < 0
    for chosen in (moves & turns, moves & ~turns, ~moves & turns, ~moves & ~turns, kink != 0):
        assert 100 < chosen.sum() < 0.9 * SIZE


@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_so_do_its_derivatives(mode):
    by_number = partial(mode, argnums=tuple(range(7)))
    closed, by_rules = (
        np.asarray(jax.vmap(by_number(f))(*steps(np.float64)))
        for f in (in_closed_form, by_the_rules)
    )
    scale = np.maximum(1, np.abs(by_rules))  # where the slider starts slowly they are large
    assert np.abs((closed - by_rules) / scale).max() < 1e-9
    changes = (np.abs(by_rules) > 1e-3).any((1, 2))
    assert changes.tolist() == [i != 3 for i in range(7)]  # all but the elongation before


def test_a_class_derived_from_the_bilinear_rod_keeps_its_own_rules():
    """One whose slider is stuck never yields."""

    @pytree_dataclass
    class Stuck(jp.Bilinear):
        def advance(self, state, before, after):
            return state

        def kink(self, state, direction):
            return jp.Bilinear.kink(self, state, direction)[0], 0.0

    grid, ground = jp.TimeGrid(0.02, 200), jp.Ricker(0.5, (2.0,), (1.5,))
    stuck, elastic, bilinear = (
        float(jp.demand(jp.Storeys((1.0,), jp.Rod(law, 20.0)), ground, grid).masses[0].peak_x)
        for law in (Stuck(0.01), jp.Bilinear(1e3), jp.Bilinear(0.01))
    )
    assert stuck == pytest.approx(elastic, rel=1e-12)
    assert abs(bilinear - elastic) > 0.01
