"""Batches with a shortcut, and work for those lanes of a batch alone that need it."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from jaxpound.simulation.contact.lanes import where_needed
from jaxpound.simulation.shortcut import with_shortcut
from jaxpound.simulation.state import step_constants

SIZES = (1, 63, 64, 65, 200)


def shares_in_need(size):
    """None, one, a group of 8 and more, all but one, and all."""
    counts = sorted({0, 1, min(8, size), min(9, size), size - 1, size})
    order = np.random.default_rng(size).permutation(size)
    return [(order < count) * 1.0 for count in counts]


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


def test_links_that_need_every_flow_and_long_rows_have_no_shortcut():
    def has_shortcut(system):
        numbers = jax.tree.map(jnp.asarray, system)
        return step_constants(numbers, 0.04, 2, 0).has_shortcut

    system = chain(0.1)
    fast = jp.VelocityFriction(0.1, 1.0)
    always = dataclasses.replace(system.links[0], velocity_friction=fast)
    many = dataclasses.replace(system, rods=system.rods * 3)
    assert has_shortcut(system) == (jax.default_backend() == "cpu")
    assert not has_shortcut(dataclasses.replace(system, links=(always, system.links[1])))
    assert not has_shortcut(many)


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


RODS = jp.ZenerRod(0.5, 0.05, 0.2), jp.ZenerRod(0.5, 0.05, 0.3)
LAW = jp.KelvinVoigt(400.0, 0.65)


def yielding(gap):
    """Of blocks on rods that yield, whose link has an inerter, and faces on both sides."""
    laws = jp.Bilinear(0.2, 0.05), jp.BoucWen(0.3, 0.05)
    rods = (jp.Rod(laws[i], k, (i, jp.GROUND)) for i, k in enumerate((1.0, 1.7)))
    gaps, inerter = (gap, 1.5 * gap), jp.Inerter(0.3)
    link = jp.Link((0, 1), 0.1, gaps, jp.Newton(0.6), inerter=inerter)
    return jp.System((1.0, 0.8), tuple(rods), (link,))


def chain(gap):
    """Three blocks whose two links share the one in the middle."""
    rods = (jp.Rod(RODS[0], k, (i, jp.GROUND)) for i, k in enumerate((1.0, 1.7, 2.5)))
    links = (jp.Link((i, i + 1), friction=0.05, gap=gap, contact=LAW) for i in (0, 1))
    return jp.System((1.0, 0.8, 1.2), tuple(rods), tuple(links))


MOVED = jp.InitialState((0.1, 0.0, -0.1), (0.0, 0.2, 0.0))
STARTS = [(yielding, None), (chain, MOVED)]


@pytest.mark.parametrize(("structures", "initial"), STARTS, ids=["yielding", "chain"])
def test_a_batch_of_runs_of_which_few_or_all_pound_is_a_loop(structures, initial):
    ground, grid = jp.Ricker(0.5, (3.0, 2.0), (4.0, 6.0)), jp.TimeGrid(0.04, 300)

    def demand(gap):
        return jp.demand(structures(gap), ground, grid, temperature=0.1, initial=initial)

    def pounding(demand):
        return sum(float(link.n_impacts) for link in demand.links) > 0

    single, batch = jax.jit(demand), jax.jit(jax.vmap(demand))
    rests = np.array([float(link.gap) for link in structures(5.0).system().links])
    nearest = np.array([float(link.min_gap) for link in single(5.0).links])
    required = 5.0 * (1 - nearest / rests).max()
    for tightest, widest, share in ((1.01, 2.0, 0.0), (0.95, 2.0, 0.1), (0.3, 0.9, 1.0)):
        gaps = required * np.linspace(tightest, widest, 70)
        results, alone = batch(gaps), [single(gap) for gap in gaps]
        assert np.mean([*map(pounding, alone)]) == pytest.approx(share, abs=0.06)
        for values, wanted in zip(
            jax.tree.leaves(results), zip(*map(jax.tree.leaves, alone), strict=True), strict=True
        ):
            np.testing.assert_allclose(values, np.array(wanted), rtol=1e-8, atol=1e-11)
