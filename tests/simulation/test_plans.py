"""Plans of a run's program: all of them give its numbers; which it has follows from its steps."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.extend.core import jaxprs_in_params

import jaxpound as jp
from jaxpound._xla import plan
from jaxpound.simulation.constants import StepConstants
from jaxpound.simulation.run import _demand

RODS = jp.ZenerRod(0.5, 0.05, 0.2), jp.ZenerRod(0.5, 0.05, 0.3)
LAW = jp.KelvinVoigt(400.0, 0.65)


GRID, GROUND = jp.TimeGrid(0.04, 100), jp.Ricker(0.6, (2.0, 1.5), (1.5, 2.5))


def pair(number, law=None):
    """Two blocks with friction between them, far apart, or near: then the pair 3 does not touch."""
    gap = 5.0 if law is None else 0.03 + 0.02 * number
    return jp.AdjacentStructures(*RODS, 0.8, 1.7, 0.02 + 0.02 * number, gap, law)


def three_that_yield(number):
    """Blocks of which two have laws of one kind, on rods that remember too."""
    laws = jp.BoucWen(0.1, 0.05, 1.5), jp.BoucWen(0.2, 0.1), jp.Bilinear(0.15, 0.05)
    stiffnesses = zip(laws, (1.0 + 0.1 * number, 1.7, 2.5), strict=True)
    rods = [jp.Rod(law, k, (i, jp.GROUND)) for i, (law, k) in enumerate(stiffnesses)]
    return jp.System((1.0, 0.8, 1.2), (*rods, jp.Rod(RODS[0], 0.5, (0, 1))), ())


def two_that_yield(number):
    laws = jp.Bilinear(0.1 + 0.01 * number, 0.05), jp.Bilinear(0.2, 0.1)
    rods = tuple(jp.Rod(law, 1.0 + i, (i, jp.GROUND)) for i, law in enumerate(laws))
    return jp.System((1.0, 0.8), rods, (jp.Link((0, 1), friction=0.05),))


def in_arrays(work):
    """What larger systems have, whether they touch or not."""
    many = work._replace(elements=plan.FEW + 1)
    return dataclasses.replace(plan.looped(many), peaks_in_arrays=True)


SYSTEMS = {
    "friction": (pair, "min_gap", [plan.fast, plan.looped]),
    "contact": (lambda x: pair(x, LAW), "peak_contact", [plan.fast, plan.looped]),
    "short laws": (two_that_yield, "peak_x1", [plan.fast, plan.looped]),
    "long laws": (three_that_yield, "peak_x1", [plan.fast, in_arrays]),
}


@pytest.mark.parametrize("system", SYSTEMS)
def test_all_plans_give_the_numbers_of_the_plain_loop(system):
    """Single runs, their derivatives in reverse mode, and batches, of single runs of that loop."""
    structures, name, others = SYSTEMS[system]
    numbers = np.linspace(0.0, 3.0, 4)

    def peak(x):
        return getattr(jp.demand(structures(x), GROUND, GRID, only=(name,)), name)

    with plan.chosen(plan.plain):
        plain = jax.jit(jax.value_and_grad(peak))
        values, slopes = np.array([plain(x) for x in numbers]).T
    assert len({*values, slopes[1]}) == 5
    for choice in others:
        with plan.chosen(choice):
            value, slope = jax.jit(jax.value_and_grad(peak))(numbers[1])
            batch = jax.jit(jax.vmap(peak))(numbers)
        np.testing.assert_allclose([value, slope], [values[1], slopes[1]], rtol=1e-9)
        np.testing.assert_allclose(batch, values, rtol=1e-9)


def test_a_choice_holds_for_what_is_run_within_and_no_program_of_another_is_taken():
    works = []

    def noted(work):
        works.append(work)
        return plan.plain(work)

    before, structures = plan.choice(), pair(0.0)
    for _ in range(2):
        with plan.chosen(noted):
            inside = jp.demand(structures, GROUND, GRID)
    assert works == [plan.Work(elements=2)]
    assert plan.choice() is before
    size = _demand._cache_size()
    outside = jp.demand(structures, GROUND, GRID)
    assert (_demand._cache_size() > size) or before is noted
    assert float(outside.min_gap) == pytest.approx(float(inside.min_gap), rel=1e-12)


def test_a_plan_follows_from_what_a_step_computes():
    work, fast, looped = plan.Work, plan.fast, plan.looped
    assert fast(work(4)) == plan.Plan("written out")
    assert fast(work(5)) == looped(work(2)) == plan.Plan("loop")
    assert fast(work(4, laws="short", series=True)) == plan.Plan("recomputed", segments=True)
    assert fast(work(4, laws="long")).block == "loop"
    assert fast(work(9, laws="long")).laws_in_arrays
    pounding = fast(work(8, inner_loop="sometimes"))
    assert (pounding.block, pounding.recomputed_steps) == ("loop", True)
    assert not pounding.peaks_in_arrays
    assert fast(work(9, inner_loop="sometimes")).peaks_in_arrays
    for other in (work(9, "long", "always", True), work(2)):
        assert plan.plain(other) == plan.Plan()


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

    single = jax.jit(demand)
    with plan.chosen(plan.fast):  # that of users, whose shortcut is written out
        batch = jax.jit(jax.vmap(demand)).lower(np.ones(70)).compile()
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


def test_links_that_need_every_flow_and_long_rows_have_no_shortcut():
    def has_shortcut(system):
        numbers = jax.tree.map(jnp.asarray, system)
        return StepConstants.of(numbers, jp.Scheme(), 0.04).plan.shortcut != "none"

    system = chain(0.1)
    fast = jp.VelocityFriction(0.1, 1.0)
    always = dataclasses.replace(system.links[0], velocity_friction=fast)
    many = dataclasses.replace(system, rods=system.rods * 3)
    assert has_shortcut(system) == (jax.default_backend() == "cpu")
    assert not has_shortcut(dataclasses.replace(system, links=(always, system.links[1])))
    assert not has_shortcut(many)


def test_the_steps_of_a_block_are_one_program_in_a_batch_too():
    """A state whose batch lies along another axis than that of its result would make them two."""
    run = jax.make_jaxpr(jax.vmap(lambda mu: jp.demand(_with(mu), GROUND, GRID).min_gap))
    with plan.chosen(plan.fast):
        whole = run(jnp.ones(3)).jaxpr
    programs = [program for name, program in _inner(whole) if name == "step"]
    assert len(programs) > 1
    assert len({id(program) for program in programs}) == 1


def _with(friction):
    return dataclasses.replace(pair(0), friction=friction)


def _inner(program):
    for equation in program.eqns:
        for inner in jaxprs_in_params(equation.params):
            yield equation.params.get("name"), inner
            yield from _inner(inner)
