import os
import re
import subprocess
import sys
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from tests.refusals import refusals

GRID = jp.TimeGrid(0.04, 100)


def gaps(amplitude, friction, only=("min_gap", "peak_f1"), **changes):
    structures = replace(jp.paper.structures(), friction=friction, **changes)
    return jp.demand(structures, jp.Ricker(amplitude, [1.25, 2.0], [1.5, 2.5]), GRID, only=only)


def min_gap(amplitude, friction):
    return gaps(amplitude, friction, ("min_gap",)).min_gap


def impulses(amplitude, friction):
    """Of blocks that collide, some of them in any step, on rods of an order of their own."""
    changes = {"initial_gap": 0.05, "contact": jp.Newton(0.6)}
    changes["rod_1"] = replace(jp.paper.structures().rod_1, order=0.2 + friction / 4)
    return gaps(amplitude, friction, ("peak_impulse",), **changes).peak_impulse


def batch(n):
    return np.linspace(0.1, 1.0, n), np.linspace(0.4, 0.1, n)


def test_chunks_give_what_one_batch_gives():
    """Sizes that divide the batch, that leave a rest, and one larger than it; also of keys."""

    def sums(amplitude, friction):
        return {"sum": amplitude + friction, "both": jnp.stack([amplitude, 2 * friction])}

    for function, chunk_size in (*((sums, size) for size in (1, 3, 7, 50, None)), (gaps, 3)):
        both = jax.vmap(function)(*batch(7)), jp.runtime.in_chunks(function, chunk_size)(*batch(7))
        for leaf, part in zip(*map(jax.tree.leaves, both), strict=True):
            assert isinstance(part, np.ndarray)
            np.testing.assert_allclose(part, leaf, rtol=1e-12, atol=1e-14)

    def slope(key):
        of_friction = partial(min_gap, jax.random.uniform(key, minval=0.1))
        return jax.jvp(of_friction, (0.2,), (1.0,))[1]

    keys = jax.random.split(jax.random.key(1), 5)
    slopes = jax.jit(jax.vmap(slope))(keys)
    np.testing.assert_allclose(jp.runtime.in_chunks(slope, 2)(keys), slopes, rtol=1e-10)


def test_batches_of_nearly_as_many_runs_share_a_program():
    compiled = []

    def wave(a):
        compiled.append(a)
        return jnp.sqrt(a) + jnp.sin(a) / 3

    run, a = jp.runtime.in_chunks(wave, 64), np.linspace(0.1, 1.0, 200)
    for programs, sizes in ((1, (5, 6, 7, 8)), (2, (9, 14, 16)), (3, (40, 63, 64, 65, 200))):
        results = [run(a[:n]) for n in sizes]
        assert len(compiled) == programs
        for n, result in zip(sizes, results, strict=True):
            np.testing.assert_array_equal(result, results[-1][:n])  # to the last bit
            np.testing.assert_allclose(result, np.sqrt(a[:n]) + np.sin(a[:n]) / 3, rtol=1e-14)
    # Chunks are even: of many runs few are computed twice to fill the last one up.
    seen = []

    def twice(x):
        jax.debug.callback(seen.append, x)
        return 2 * x

    for n, most in ((512, 480), (481, 480), (1000, 96), (96, 96), (33, 480)):
        seen.clear()
        assert (jp.runtime.in_chunks(twice, most)(np.arange(n)) == 2 * np.arange(n)).all()
        jax.effects_barrier()
        assert len(seen) <= max(1.15 * n, 64)


CHUNK_SIZE = "in_chunks: chunk_size = .* must be a positive whole"
CORES = "use_cores: n = .* must be a positive whole number"
KEYS = "results of type key<fry> must be numbers"
OUTSIDE = "in_chunks runs outside jit, vmap and grad"
test_what_makes_no_batch_of_chunks_on_cores_is_refused = pytest.mark.unchecked(
    refusals(
        *((jp.runtime.in_chunks, gaps, size, CHUNK_SIZE) for size in (0, -3, 2.5, True, "many")),
        *(
            (jp.runtime.in_chunks(gaps, 2), *arguments, "the same number of runs, at least 1")
            for arguments in ((), (1.0,), (np.ones(3), np.ones(4)), (np.ones(0), np.ones(0)))
        ),
        *((jp.runtime.use_cores, n, CORES) for n in (0, -1, 1.5, True)),
        (lambda: jax.jit(jp.runtime.in_chunks(lambda x: 2 * x))(jnp.ones(3)), OUTSIDE),
        (jax.grad(lambda y: jp.runtime.in_chunks(lambda x: x * y)(np.ones(3)).sum()), 2.0, OUTSIDE),
        (jp.runtime.in_chunks(lambda x: jax.random.key(0)), np.ones(3), KEYS),
        (jp.runtime.in_chunks, 3, "in_chunks: function = 3 must be a function"),
    )
)


def test_cores_cannot_change_once_jax_has_started():
    jnp.zeros(1).block_until_ready()
    assert jp.runtime.use_cores(len(jax.devices("cpu"))) == len(jax.devices("cpu"))
    with pytest.raises(RuntimeError, match="use_cores: n = 77 must be set before JAX computes"):
        jp.runtime.use_cores(77)


def test_a_larger_number_of_threads_of_the_user_s_own_is_kept(monkeypatch):
    monkeypatch.setattr(jax.config, "update", lambda *_: None)  # as before JAX starts
    needs_none = jax.__version_info__ >= (0, 12)
    for own, is_enough in (("1000", True), ("1", False), ("many", False)):
        monkeypatch.setenv("PJRT_NPROC", own)
        jp.runtime.use_cores(1)
        assert (os.environ["PJRT_NPROC"] == own) is (is_enough or needs_none)


SHARDED = """
import sys
import jax, jaxpound as jp, numpy as np
jax.config.update("jax_enable_x64", True)
assert jp.runtime.use_cores(2) == 2
from jaxpound._xla import plan; plan.choose(plan.looped)
from jax.sharding import Mesh, PartitionSpec as P
from tests._xla.test_batches import batch, gaps, impulses, min_gap

assert len(jax.devices()) == 2

whole = jax.vmap(gaps)(*batch(64))
assert len(whole.min_gap.devices()) == 2 and not whole.min_gap.sharding.is_fully_replicated
results = dict(whole=whole.min_gap, odd=jax.vmap(min_gap)(*batch(33)))
# By numbers of each run, and by one that all share.
def average(a, mu, more): return jax.vmap(lambda a, mu: min_gap(a, mu + more))(a, mu).mean()
*slopes, results["mean"] = jax.jit(jax.grad(average, argnums=(0, 1, 2)))(*batch(64), 0.0)
results["slope"] = 64 * np.array(slopes)
rows = jax.vmap(lambda a: jax.vmap(lambda mu: min_gap(a, mu))(batch(3)[1]))
results["table"] = jax.jit(rows)(batch(32)[0])
results["chunks"] = jp.runtime.in_chunks(min_gap, 16)(*batch(39))
# Inside a sharding of the caller's own nothing is spread again.
mesh = Mesh(np.array(jax.devices()), ("mine",))
def inside(f): return jax.jit(jax.shard_map(f, mesh=mesh, in_specs=P("mine"), out_specs=P("mine")))
arrays = [*map(jax.numpy.asarray, batch(64))]
with plan.chosen(plan.fast):  # that of users, whose shortcut is written out
    struck = jax.jit(jax.vmap(impulses)).lower(*batch(64)).compile()
assert "all-gather" not in struck.as_text()
results["struck"] = struck(*batch(64))
results["struck_own"] = inside(jax.vmap(impulses))(*arrays)
# One that cannot be divided stays where it is, its groups of 64 runs too.
odd = jax.jit(jax.vmap(impulses)).lower(*batch(65))
assert "manual_computation" not in odd.as_text()
results["struck_odd"] = odd.compile()(*batch(65))
results["struck_chunks"] = jp.runtime.in_chunks(impulses, 64)(*arrays)
def struck_mean(more): return jax.vmap(lambda a, mu: impulses(a, mu + more))(*arrays).mean()
results["struck_slope"] = jax.jit(jax.grad(struck_mean))(0.0)
# Of the derivative JAX itself says whether it differs from device to device as the run does.
def both(a, mu): return jax.jvp(impulses, (a, mu), (1.0, 0.0))
assert inside(jax.vmap(both)).lower(*arrays).as_text()
# Nor within a default device, so that arrays may be committed to it.
with jax.default_device(jax.devices()[1]):
    results["there"] = jax.vmap(min_gap)(*jax.device_put(batch(64), jax.devices()[1]))
assert len(results["there"].devices()) == 1
np.savez(sys.argv[1], **{k: np.asarray(v) for k, v in results.items()})
"""


def test_a_batch_over_two_devices_is_the_batch_on_one(tmp_path):
    """Values, derivatives, a mean over the batch, nested and odd batches, against a loop."""
    path = tmp_path / "two.npz"
    subprocess.run([sys.executable, "-c", SHARDED, str(path)], check=True)
    two, (a, mu) = np.load(path), batch(64)
    run, struck = jax.jit(jax.value_and_grad(min_gap, argnums=(0, 1))), jax.jit(impulses)

    def loop(a, mu):
        values, slopes = zip(*[run(*case) for case in zip(a, mu, strict=True)], strict=True)
        return np.array(values), np.array(slopes).T

    whole, slope = loop(a, mu)
    alone = {"whole": whole, "there": whole, "slope": slope, "mean": slope[1].mean()}
    alone |= {"odd": loop(*batch(33))[0], "chunks": loop(*batch(39))[0]}
    alone["table"] = [loop(np.full(3, x), batch(3)[1])[0] for x in batch(32)[0]]
    alone["struck"] = alone["struck_own"] = alone["struck_chunks"] = [*map(struck, a, mu)]
    alone["struck_odd"] = [*map(struck, *batch(65))]
    alone["struck_slope"] = np.mean([*map(jax.jit(jax.grad(impulses, 1)), a, mu)])
    assert set(alone) == set(two)
    for name, values in alone.items():
        np.testing.assert_allclose(two[name], values, rtol=1e-9, atol=1e-12, err_msg=name)


IN_FLIGHT = """
import jax, jaxpound as jp, numpy as np
cores = jp.runtime.use_cores()
grid, structures = jp.TimeGrid(0.02, 400), jp.paper.structures()
def min_gap(a): return jp.demand(structures, jp.Ricker(a, [1.25, 2.0], [1.5, 2.5]), grid).min_gap
mean = jax.jit(lambda a: jax.vmap(min_gap)(a).mean())
amplitudes = np.linspace(0.1, 0.5, 16 * cores)
gaps = [mean(amplitudes) for _ in range(600)]
assert len(set(map(float, gaps))) == 1
"""


def test_means_of_many_batches_in_flight_end():
    """Of more than JAX has room for: the next ones wait to be launched."""
    subprocess.run([sys.executable, "-c", IN_FLIGHT], check=True, timeout=60)


def test_second_derivatives_of_a_batch_against_differences_of_the_first():
    (a, mu), step = batch(3), 1e-6

    def slope(a, mu):
        return jax.jvp(partial(min_gap, a), (mu,), (1.0,))[1]

    batched = jax.jit(jax.vmap(lambda a, mu: jax.jvp(partial(slope, a), (mu,), (1.0,))))
    bend, slopes = batched(a, mu)[1], [batched(a, mu + sign * step)[0] for sign in (1, -1)]
    np.testing.assert_allclose(bend, (slopes[0] - slopes[1]) / (2 * step), rtol=1e-5, atol=1e-7)
    assert np.abs(bend).max() > 1e-3


def test_structures_that_a_batch_closes_over_are_not_folded_into_its_program():
    """XLA would compute what follows from them while it compiles, for the whole batch."""
    amplitudes = np.linspace(0.05, 0.3, 777)
    program = jax.jit(jax.vmap(lambda a: min_gap(a, 0.25))).lower(amplitudes).compile().as_text()
    assert not re.search(r"\[[\d,]*777[\d,]*\]\S* constant\(", program)


def test_a_batch_is_differentiated_by_what_its_runs_share():
    """Its runs share their friction, of which the derivative is the sum of theirs."""
    amplitudes = jnp.array([0.3, 0.5])
    sums = jax.grad(lambda friction: jax.vmap(min_gap, (0, None))(amplitudes, friction).sum())
    alone = jax.jit(jax.grad(min_gap, 1))
    expected = sum(float(alone(amplitude, 0.2)) for amplitude in amplitudes)
    assert float(jax.jit(sums)(0.2)) == pytest.approx(expected, rel=1e-9)


def test_quotients_of_a_nested_batch_stay_quotients():
    """XLA computes them once; by numbers that an inner batch shares they would become products."""
    slope, (amplitude, friction) = jax.grad(min_gap, argnums=1), batch(24)
    inner = jax.vmap(slope, (0, None))
    programs = jax.vmap(slope), jax.vmap(inner, (None, 0))
    arguments = (amplitude, friction), (amplitude[:8], friction[:3])
    quotients = [
        jax.jit(program).lower(*numbers).compile().as_text().count(" divide(")
        for program, numbers in zip(programs, arguments, strict=True)
    ]
    assert quotients[1] >= quotients[0] > 0
