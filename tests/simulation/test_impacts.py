"""What holds of any run with impacts, and the cases at the edges of what may happen in one."""

import functools
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from tests.simulation import pairs
from tests.simulation.pairs import DIFFERENTIATED, FORCES, GRID, growth, in_unit_of_time, law, run

PAPER, SHAKING = jp.paper.structures(), jp.paper.ground()
KINDS = pytest.mark.parametrize("laws", [("newton",), ("kelvin",), FORCES], ids=lambda x: x[0])
ENDING = replace(SHAKING, arrivals=np.add(SHAKING.arrivals, GRID.dt * GRID.n_steps - 3.26))
"""So late that the run of a gap of .5 ends in contact."""
PUSH = jp.Ricker(-1 / (6 * (np.pi / 1000.0) ** 2), [1000.0], [0.0])  # a steady one


def drawn(laws, seed=0):
    """Random pairs under random wavelets; two of five or so touch."""
    rng = np.random.default_rng(seed)
    uniform = rng.uniform

    def about(low, high):
        return np.exp(uniform(np.log(low), np.log(high)))

    def random_pair(i):
        taus = [about(0.005, 0.3) for _ in range(2)]
        return pairs.pair(
            masses=(about(0.3, 3.0), about(0.3, 3.0)),
            materials=[jp.ZenerRod(uniform(0.2, 0.8), t, t * uniform(1, 15)) for t in taus],
            stiffnesses=(about(0.3, 3.0), about(0.3, 3.0)),
            friction=uniform(0, 0.5),
            gap=uniform(0.01, 0.4),
            contact=law(laws[i % len(laws)], about(20.0, 3000.0), uniform(0.3, 1.0)),
        )

    ranges = (-0.5, 0.5), (1.2, 4), (1, 20)
    wavelets = [jp.Ricker(*(uniform(*ends, 8) for ends in ranges)) for _ in range(32)]
    return [random_pair(i) for i in range(32)], wavelets


@functools.cache
def drawn_run(laws):
    return run(*drawn(laws))


def struck(contact, gap, **changes):
    return replace(PAPER, contact=contact, initial_gap=gap, **changes).system()


def with_gap(system, gap):
    return replace(system, links=(replace(system.links[0], gap=gap),))


@KINDS
def test_energy_never_grows_and_the_strongest_impact_is_that_of_the_series(laws):
    """What the ground supplies is kinetic, in rods, dampers and contact, or lost, for good."""
    response = drawn_run(laws)
    assert (response.demand.n_impacts > 0).sum() >= 5
    (link,), energy = response.links, response.energy
    supplied = np.abs(energy.input).max(1, keepdims=True)
    # The scheme's error at steps of .02; without contact it is as large.
    assert (np.abs(energy.residual) < 8e-3 * supplied).all()
    assert (np.diff(energy.contact_lost) >= 0).all()
    # To the correction of a step's end for its mean sample, of which contact keeps no account.
    stored = np.asarray(energy.contact_stored / supplied)
    assert (stored > -2e-6).all()
    assert (stored[link.touching == 0] < 2e-6).all()
    impulses = np.nan_to_num(link.impacts.impulse).max(1)
    assert np.count_nonzero(impulses) >= 5
    np.testing.assert_allclose(response.demand.links[0].peak_impulse, impulses, rtol=1e-12)


def test_a_gap_that_opens_slowly_from_rest_does_not_touch_again():
    """Where rest ends the gap is 2e-6 too small; taken for a touch it led back to rest for ever."""
    systems, grounds = (each[23:24] for each in drawn(("newton",), seed=5))
    found = run(systems, grounds)
    assert found.demand.n_impacts > 20
    assert -1e-5 < found.demand.min_gap < 0
    assert (np.abs(found.energy.residual) < 8e-3 * np.abs(found.energy.input).max()).all()


@KINDS
def test_mirrored_pairs_under_the_mirrored_ground_move_as_in_a_mirror(laws):
    systems, grounds = (each[:16] for each in drawn(laws))
    mirrored = []
    for system in systems:
        first, second = system.rods
        rods = replace(second, ends=first.ends), replace(first, ends=second.ends)
        mirrored.append(replace(system, masses=system.masses[::-1], rods=rods))
    backwards = [replace(ground, amplitude=-ground.amplitude) for ground in grounds]
    ours, other = drawn_run(laws)[:16], run(mirrored, backwards)
    assert ours.demand.n_impacts.sum() > 5
    # Rounding, magnified by the impacts.
    np.testing.assert_allclose((ours.x1, ours.x2), (-other.x2, -other.x1), rtol=0, atol=1e-10)
    (link,), (same,) = ours.links, other.links
    for name in ("contact", "friction", "gap", "contact_lost"):
        np.testing.assert_allclose(getattr(link, name), getattr(same, name), rtol=0, atol=1e-7)
    for name in ("time", "end", "approach_velocity", "rebound_velocity", "impulse"):
        series = (getattr(each.impacts, name) for each in (link, same))
        np.testing.assert_allclose(*series, rtol=1e-7, atol=1e-9)


@KINDS
def test_impacts_and_friction_leave_the_momentum_to_the_rods_and_the_ground(laws):
    """Next to the same pair that is too far apart to touch, so that the ground drops out."""
    systems, grounds = (each[:16] for each in drawn(laws))
    apart = run([with_gap(system, 100.0) for system in systems], grounds)
    found = drawn_run(laws)[:16]
    assert (found.demand.n_impacts > 0).sum() > 3

    def momentum_and_force(response):
        masses, rods = response.masses, response.rods
        momentum = sum(np.asarray(mass.mass)[:, None] * mass.x for mass in masses)
        return np.array([momentum, sum(rod.force for rod in rods)])

    momentum, force = momentum_and_force(found) - momentum_and_force(apart)
    kicks = GRID.dt**2 * force
    np.testing.assert_allclose(np.diff(momentum, n=2), -kicks[:, 1:-1], rtol=0, atol=1e-13)


@pytest.mark.parametrize("name", ["newton", "kelvin"])
def test_blocks_pressed_together_for_the_whole_run_move_as_one(name):
    """As two that a joint holds; contact and friction bear what the joint would bear."""
    systems = [struck(law(name, 1e4), 0.0, friction=slip) for slip in (10.0, 0.0, 0.05)]
    joined, *pressed = run(systems, [PUSH] * 3)
    held = joined.links[0].friction
    assert joined.x1[1:].min() > 0
    for response in pressed:
        (link,), phases = response.links, response.phases()
        assert link.touching[50:].all()
        assert link.contact[50:].min() > 0.1
        if name == "newton":  # held from the start, or from where friction no longer does it
            np.testing.assert_allclose(response.x1, joined.x1, rtol=0, atol=1e-9)
            assert np.abs(link.gap).max() == 0
            bears = (link.contact + link.friction)[10:]
            np.testing.assert_allclose(bears, held[10:], rtol=0, atol=1e-8)
        else:
            deepest = 1.1 * held.max() / 1e4
            assert 0 < -link.gap.min() < deepest
            assert np.abs(response.x1 - joined.x1).max() < deepest
        assert sum(p.end - p.start for p in phases if not p.contact) < 50 * GRID.dt
        assert phases[-1].contact
        # None shorter than what rounding makes of an instant.
        assert min(p.end - p.start for p in phases) > 1e-9
    assert pressed[0].demand.n_impacts == 0


@pytest.mark.parametrize("name", ["kelvin", "jankowski"])
def test_a_run_that_ends_in_contact_is_the_beginning_of_one_that_goes_on(name):
    """The one ends in its first contact; the other is under the same ground earlier."""
    later = 2500  # steps
    earlier = replace(ENDING, arrivals=ENDING.arrivals - GRID.dt * later)
    whole, cut = run([struck(law(name, 50.0), 0.5)] * 2, [earlier, ENDING])
    until = GRID.n_steps - later + 1
    for field in ("gap", "contact", "contact_stored", "contact_lost", "friction_work", "touching"):
        one, other = (getattr(each.links[0], field) for each in (whole, cut))
        np.testing.assert_allclose(one[:until], other[later:], rtol=0, atol=1e-11)
    done, under_way = whole.impacts()[0], cut.impacts()[0]
    assert np.isfinite([done.end, done.rebound_velocity]).all()
    assert np.isnan([under_way.end, under_way.rebound_velocity]).all()
    assert under_way.time == pytest.approx(done.time + GRID.dt * later, abs=1e-11)
    assert under_way.approach_velocity == pytest.approx(done.approach_velocity, rel=1e-11)
    demand, link = cut.demand.links[0], cut.links[0]
    assert demand.n_impacts == 1
    assert demand.peak_contact == link.contact[-1] > 0  # it still grows
    assert demand.peak_penetration == pytest.approx(-float(link.gap[-1]), rel=1e-11)
    assert cut.phases()[-1].contact
    assert under_way.peak_force == pytest.approx(link.contact[-1], rel=1e-12)
    most = link.contact[-1] * (GRID.dt * GRID.n_steps - under_way.time)
    assert under_way.impulse < most


def test_many_impacts_within_a_step():
    """A block that falls onto the other bounces ever faster, until it rests on it."""
    falls = struck(jp.Newton(0.9), 0.01, friction=0.0)
    quarter = in_unit_of_time(0.25, falls, PUSH)
    coarse, fine = run(*zip((falls, PUSH), quarter, strict=True))
    steps = [round(impact.time / GRID.dt) for impact in coarse.impacts()]
    assert np.bincount(steps).max() == 4  # of which a response keeps no more
    assert coarse.demand.n_impacts > len(steps) + 20
    # Errors at steps of .02.
    np.testing.assert_allclose(coarse.x1[:801], fine.x1[::4], rtol=0, atol=3e-4)
    np.testing.assert_allclose(coarse.gap[:801], fine.gap[::4], rtol=0, atol=4e-4)
    lost = float(fine.demand.links[0].contact_work) / 0.25**2
    assert coarse.demand.links[0].contact_work == pytest.approx(lost, rel=0.02)
    assert (coarse.gap[800], coarse.links[0].touching[800]) == (0, 1)


@pytest.mark.parametrize("name", ["kelvin", "jankowski"])
def test_stick_in_contact(name):
    """What holds the blocks is the contact's force, which stays, and friction, which may not."""
    (response,) = run([struck(law(name, 15.0), 0.02, friction=1.0)], [SHAKING])
    stick = [phase for phase in response.phases() if phase.kind == "stick" and phase.contact]
    assert max(phase.end - phase.start for phase in stick) > 10
    last, (link,) = response.time > stick[-1].start + GRID.dt, response.links
    assert np.ptp(link.gap[last]) == np.ptp(link.contact[last]) == 0
    assert link.gap[-1] < 0
    assert link.contact[-1] > 0.02
    left, right = (1 / mass.mass for mass in response.masses)
    held = (response.f2 * right - response.f1 * left) / (left + right)
    np.testing.assert_allclose((link.contact + link.friction)[last], held[last], atol=1e-12)
    assert np.abs(link.friction).max() <= 1


def test_a_step_that_cannot_be_followed_is_not_a_silent_result():
    """Blocks pressed together that would vibrate tens of thousands of times in a step."""
    (found,) = run([struck(law("kelvin", 1e14, 0.99), 0.0, friction=0.0)], [PUSH])
    assert np.isnan(found.x1).all()


def test_stiffness_costs_no_step_and_tends_to_newtons_law():
    """Contacts that last from .2 to .0006, at steps of .02 and of .0025."""
    stiffnesses = (1e2, 1e3, 1e4, 1e5, 1e6, 1e7)
    coarse = [(struck(law("kelvin", k), 0.5), SHAKING) for k in stiffnesses]
    fine = [in_unit_of_time(1 / 8, *one) for one in coarse]
    found = run(*zip(*coarse, *fine, strict=True))
    x = np.stack([found.x1, found.x2])
    errors = np.abs(x[:, :6, :401] - x[:, 6:, ::8]).max((0, 2))
    assert errors[1] < 4e-3
    assert (errors < 2 * errors[1]).all()
    (rigid,) = run([struck(jp.Newton(0.65), 0.5)], [SHAKING])
    impulses = found.links[0].impacts.impulse[:6, 0]
    away = np.abs(impulses / rigid.impacts()[0].impulse - 1)
    np.testing.assert_allclose(away[1:-1] / away[2:], np.sqrt(10), rtol=0.05)
    np.testing.assert_allclose(found.x1[5], rigid.x1, rtol=0, atol=2.4e-3)
    lost = float(rigid.demand.links[0].contact_work)
    assert found.demand.links[0].contact_work[5] == pytest.approx(lost, rel=2e-3)


def test_a_soft_contact_tends_to_none_and_equal_buildings_never_touch():
    contact, soft = law("kelvin"), law("kelvin", 1e-9)
    alike = struck(contact, 0.0, stiffness_ratio=1.0, rod_2=PAPER.rod_1)
    soft, free, equal = run([struck(soft, 0.3), struck(contact, 100.0), alike], [SHAKING] * 3)
    assert soft.demand.n_impacts > 0
    np.testing.assert_allclose(soft.x1, free.x1, rtol=0, atol=2e-4)
    assert (equal.demand.n_impacts, equal.demand.peak_contact) == (0, 0)
    assert np.isinf(equal.demand.first_impact_time)


@pytest.mark.parametrize("name", ["newton", "kelvin"])
def test_a_gap_that_is_closed_from_the_start(name):
    """Touch at t = 0; and no other run than that of a gap next to none."""
    found, other = run([struck(law(name), gap) for gap in (0.0, 1e-9)], [SHAKING] * 2)
    assert found.demand.n_impacts >= 2
    np.testing.assert_allclose(found.x1, other.x1, rtol=0, atol=1e-8)
    if name == "newton":
        assert found.demand.min_gap == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("name", ["newton", *DIFFERENTIATED])
def test_grazing_impacts(name):
    """Gaps that the paper's pair, if it could not touch, would close by 1e-3, 1e-4 and 1e-5.

    With the speed of approach the effect of Newton's law falls as the square root of what the gap
    lacks; that of a force falls at least as what it lacks, and the derivative stays finite.
    """
    (free,) = run([struck(law(name), 100.0)], [SHAKING])
    gaps = 100.0 - float(free.min_gap) - np.array([1e-3, 1e-4, 1e-5])
    grazing = run([struck(law(name), gap) for gap in gaps], [SHAKING] * 3)
    assert (grazing.demand.n_impacts == 1).all()
    differences = np.abs([grazing.x1 - free.x1, grazing.x2 - free.x2])
    changes = differences[:, :, 500:].max((0, 2))
    touching = [struck(law(name, among=DIFFERENTIATED), gap) for gap in gaps]
    slopes = growth(touching, [SHAKING] * 3).factor[:, 800]
    if name == "newton":
        speeds = grazing.links[0].impacts.approach_velocity[:, 0]
        for sizes in (changes, speeds):
            np.testing.assert_allclose(sizes[:-1] / sizes[1:], np.sqrt(10), rtol=0.05)
        assert slopes[2] / slopes[1] == pytest.approx(np.sqrt(10), rel=0.07)
    else:
        assert (changes[1:] < 0.12 * changes[:-1]).all()
        assert (np.diff(slopes) < 0).all()


@pytest.mark.parametrize("name", ["newton", *DIFFERENTIATED])
def test_derivatives_at_the_edges_are_differences(name):
    """Where the gap is closed from the start, at touch, and where the run ends in contact."""
    cases = [(0.3, SHAKING, 1000.0), (0.0, SHAKING, 1000.0), (0.5, ENDING, 50.0)]
    grounds = [ground for _, ground, _ in cases]

    def pairs(among, step=0.0):
        return [struck(law(name, k, among=among), max(gap + step, 0.0)) for gap, _, k in cases]

    step = 1e-6
    wider, narrower = (run(pairs(FORCES, d), grounds) for d in (step, -step))
    slopes = growth(pairs(DIFFERENTIATED), grounds).factor
    for i, (gap, *_) in enumerate(cases):
        states = (np.stack([one.x1, one.x2, one.v1, one.v2]) for one in (wider[i], narrower[i]))
        differences = np.linalg.norm(np.subtract(*states), axis=0) / (2 * step if gap else step)
        # The slope of Jankowski's damping is infinite at touch, where substeps are the least exact.
        within = (3e-4 if name == "jankowski" else 1e-4) * slopes[i].max()
        np.testing.assert_allclose(slopes[i], differences, rtol=0, atol=within)
    assert slopes[:, -1].min() > 0


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Pad:
    """A law as its author writes it: for a penetration that is there, and only for that."""

    stiffness: float
    thickness: float

    def force(self, penetration, speed, touch_speed):
        return self.stiffness * penetration**1.5 / (1 - (penetration / self.thickness) ** 2)


def test_a_law_of_ones_own_is_asked_for_what_it_says_alone():
    """It has no value apart (δ < 0), where its thickness is the gap not even a finite one."""
    pad, grid = Pad(2000.0, 0.5), jp.TimeGrid.until(8.0, dt=0.05)

    def hit(stiffness):
        law = replace(pad, stiffness=stiffness)
        structures = replace(PAPER, contact=law, initial_gap=0.5)
        return jp.demand(structures, SHAKING, grid).peak_contact

    force_and_slope = jax.jit(lambda stiffness: jax.jvp(hit, (stiffness,), (1.0,)))
    force, slope = force_and_slope(pad.stiffness)
    (hertz,) = run([struck(law("hertz", pad.stiffness ** (1 / 1.25)), 0.5)], [SHAKING])
    assert force == pytest.approx(float(hertz.demand.peak_contact), rel=0.05)
    harder, softer = (force_and_slope(stiffness)[0] for stiffness in (2040.0, 1960.0))
    assert slope == pytest.approx(float(harder - softer) / 80, rel=1e-3)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Root:
    """Hertz's law with damping, whose derivatives are not finite at penetration or speed 0."""

    stiffness: float
    factor: float

    def force(self, penetration, speed, touch_speed):
        elastic = self.stiffness * penetration * jnp.sqrt(penetration)
        return elastic * (1 + self.factor * speed / touch_speed)


def test_a_law_with_a_root_and_a_quotient_has_the_derivatives_of_the_library_s_law():
    library = jp.HertzDamped(2000.0, 0.65)
    grid = jp.TimeGrid.until(8.0, dt=0.05)

    def hit(contact, stiffness, gap):
        contact = replace(contact, stiffness=stiffness)
        structures = replace(PAPER, contact=contact, initial_gap=gap)
        return jp.demand(structures, SHAKING, grid).peak_contact

    def force_and_slopes(contact):
        program = jax.jit(jax.value_and_grad(lambda x: hit(contact, *x)))
        force, slopes = program(jnp.array([2000.0, 0.5]))
        return [force, *slopes]

    own = Root(library.stiffness, float(library.damping_factor))
    np.testing.assert_allclose(force_and_slopes(own), force_and_slopes(library), rtol=1e-6)
