"""The local flow: free collisions under every law, and its derivatives."""

import dataclasses
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

import jaxpound as jp
from jaxpound._fields import node_classes
from jaxpound.model.contact import with_mass
from jaxpound.simulation.contact.flows import flow
from jaxpound.simulation.contact.records import SLOTS, Clock, Contact, Coupling, FlowInput
from tests.reference import LAWS, load

COLLISIONS = load("contact")["collisions"]
AT_START = Clock(jnp.zeros(()), jnp.zeros(()), jnp.asarray(False))


def start_of(law, velocity, gap, delassus=1.0, friction=0.0, pull=0.0, rise=0.0, gaps=((0, 1),)):
    """Of a joint with a gap, or with several."""
    unit, sizes = jnp.ones(1), jnp.asarray(gap, float).ravel()
    laws = law if isinstance(law, tuple) else (law,) * sizes.size
    coupling = Coupling(
        delassus=delassus * jnp.ones((1, 1)),
        frictions=friction * unit,
        resistances=(None,),
        sizes=sizes,
        laws=tuple(with_mass(jax.tree.map(jnp.asarray, law), 1 / delassus) for law in laws),
        gaps=gaps,
    )
    contact = Contact(*(0 * sizes,) * len(Contact._fields))
    return FlowInput(0 * unit, velocity * unit, pull * unit, rise * unit, coupling, contact)


def follow(h, slots, start, needed=True):
    return flow(h, slots, jnp.asarray(needed), start, AT_START)


@cache
def collided():
    return jax.jit(lambda start: follow(0.5, SLOTS, start))


@pytest.mark.parametrize("name", LAWS)
def test_free_collisions_are_those_of_the_laws(name):
    """Restitution, peak force and penetration, momentum and the energy lost, for four e."""
    cases = [case for case in COLLISIONS if case["law"] == name]
    assert len(cases) == 4
    for case in cases:
        left, right = case["m"]
        speed, delassus = case["v0"][0] - case["v0"][1], 1 / left + 1 / right
        start = start_of(LAWS[name](case["k"], case["e"]), speed, case["gap0"], delassus)
        out = collided()(start)
        restitution = -float(out.velocity[0]) / speed
        assert restitution == pytest.approx(case["restitution"], abs=1e-6)
        lost = (1 - restitution**2) * speed**2 / delassus / 2
        assert float(out.gaps.lost_after[0]) == pytest.approx(lost, abs=1e-7)
        assert float(out.gaps.stored_after[0]) == pytest.approx(0, abs=1e-7)
        # The impulse takes from the one what it gives to the other.
        impulse = float(out.gaps.log.impacts.impulse[0, 0])
        assert impulse == pytest.approx((1 + restitution) * speed / delassus, rel=1e-12)
        depth = float(out.turns.farthest[0]) - case["gap0"]
        assert depth == pytest.approx(case["peak_penetration"], rel=1e-6, abs=1e-15)
        assert float(out.gaps.log.highest[0]) == pytest.approx(case["peak_force"], rel=1e-6)
        if name in ("kelvin", "hertzdamp_exact", "newton"):
            assert restitution == pytest.approx(case["e"], abs=1e-6)


@pytest.mark.parametrize("law", [jp.KelvinVoigt(1000.0, 0.65), jp.Newton(0.65)])
def test_derivatives_of_a_collision_with_friction_under_load(law):
    """By all that is given, in both modes, against differences; friction reverses in contact."""
    start = start_of(law, 0.6, 0.1, delassus=2.3, friction=0.2, pull=1.3, rise=-0.4)
    flat, rebuild = ravel_pytree(start)

    def out(x):
        end = follow(0.25, SLOTS, rebuild(x))
        of_step = (end.closing, end.velocity, end.mean, end.gaps.lost_after, end.now.velocity)
        return jnp.concatenate([*of_step, end.turns.farthest, end.gaps.log.highest])

    forwards, backwards = jax.jit(jax.jacfwd(out))(flat), jax.jit(jax.jacrev(out))(flat)
    np.testing.assert_allclose(backwards, forwards, rtol=1e-9, atol=1e-9)
    value = jax.jit(out)
    scale = np.abs(forwards).max(1) + 1e-9
    for i in np.flatnonzero(flat):
        step = 2e-4 * max(abs(float(flat[i])), 0.1)
        change = jnp.zeros_like(flat).at[i].set(step)
        slope = (value(flat + change) - value(flat - change)) / (2 * step)
        np.testing.assert_allclose(forwards[:, i] / scale, slope / scale, atol=1e-3)


def test_rebounds_of_newtons_law_come_to_rest():
    """A block pressed against another bounces ever faster, until it rests, with its momentum."""
    out = collided()(start_of(jp.Newton(0.5), 0.1, 0.01, delassus=2.0, friction=0.05, pull=1.0))
    assert (float(out.velocity[0]), float(out.closing[0])) == (0.0, 0.01)
    assert 3 < float(out.gaps.log.touches[0]) < 60
    assert float(out.held[0]) == 1
    # From then on friction takes what it can and contact the rest of what keeps the gap closed.
    rest = collided()(start_of(jp.Newton(0.5), 0.0, 0.0, delassus=2.0, friction=0.05, pull=1.0))
    assert float(rest.gaps.force[0] + rest.now.friction[0]) == pytest.approx(0.5)
    assert float(rest.gaps.log.touches[0]) == 0


def test_stick_that_breaks_towards_a_closed_gap_becomes_rest():
    """Friction bears .05 of the growing pull from the first, and contact the rest from then on."""
    start = start_of(jp.Newton(0.5), 0.0, 0.0, delassus=2.0, friction=0.05, pull=0.1, rise=0.1)
    out = collided()(start)
    assert (float(out.closing[0]), float(out.velocity[0]), float(out.held[0])) == (0, 0, 1)


def test_stick_ends_where_friction_that_has_changed_its_sign_reaches_the_slip_force():
    """Friction grows from −.3 μ to 5 μ: slip begins at .245 of the step, and moves with μ."""

    def end_velocity(slip_force):
        start = start_of(jp.Newton(0.5), 0.0, 10.0, friction=slip_force, pull=0.235, rise=0.53)
        return follow(0.5, 0, start).velocity[0]

    velocity, slope = jax.jit(jax.value_and_grad(end_velocity))(0.1)
    rate, slides = 0.53 / 0.5, 0.5 * (1 - 0.13 / 0.53)
    assert float(velocity) == pytest.approx(rate * slides**2 / 2, rel=1e-12)
    assert float(slope) == pytest.approx(-slides, rel=1e-12)


def test_a_link_without_friction_starts_from_rest_and_a_load_that_grows_from_zero():
    start = start_of(jp.KelvinVoigt(1000.0, 0.65), 0.0, 10.0, pull=1.0, rise=2.0)
    assert float(collided()(start).velocity[0]) == pytest.approx(0.5, rel=1e-12)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Spring:
    """A law whose number is called as a field of the contact, with further ones in its force."""

    mode: float
    shares: tuple = ()

    def force(self, penetration, speed, touch_speed):
        change = sum(i * share for i, share in enumerate(self.shares, 1))
        return self.mode * (1 + change) * penetration


def speed_after(*law):
    start = start_of(Spring(*law), 1.0, 0.1)
    return follow(0.5, 0, start).now.velocity[0]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Hardening:
    """A law with two numbers."""

    stiffness: float
    factor: float

    def force(self, penetration, speed, touch_speed):
        return self.stiffness * penetration * (1 + self.factor * penetration**2)


@jax.tree_util.register_dataclass
class Softening(Hardening):
    """A law with as many numbers, in the same places."""

    def force(self, penetration, speed, touch_speed):
        return self.stiffness * penetration / (1 + self.factor * penetration**2)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Backed:
    """A spring before a stiffer one."""

    stiffness: float
    behind: float
    distance: float

    def force(self, penetration, speed, touch_speed):
        beyond = jnp.where(penetration > self.distance, penetration - self.distance, 0.0)
        return self.stiffness * penetration + self.behind * beyond


@pytest.mark.parametrize("side", [1, -1])
def test_two_gaps_on_one_side_are_a_law_that_stiffens(side):
    """A cushion before a wall, on either side of a joint whose gap on the other side stays open."""
    laws = jp.KelvinVoigt(40.0, 1.0), jp.KelvinVoigt(400.0, 1.0), jp.Newton(1.0)
    exact = jax.jit(partial(follow, 0.7, 0))(start_of(Backed(40.0, 400.0, 0.05), 1.0, 0.1))
    gaps = ((0, side), (0, side), (0, -side))
    start = start_of(laws, 1.0 * side, [0.1, 0.15, 0.5], gaps=gaps)
    end = jax.jit(partial(follow, 0.7, 0))(start)
    np.testing.assert_allclose(side * end.closing, exact.closing, rtol=1e-7)
    np.testing.assert_allclose(side * end.velocity, exact.velocity, rtol=1e-7)
    turn = end.turns.farthest if side > 0 else -end.turns.nearest
    np.testing.assert_allclose(turn, exact.turns.farthest, rtol=1e-7)
    assert end.gaps.log.touches.tolist() == [1, 1, 0]


@jax.tree_util.register_dataclass
class Stated(Spring):
    """A law that says that its force is linear."""

    linear = True


def test_a_law_that_is_said_to_be_linear_is_followed_by_power_series():
    ends = []
    for law in (Stated(40.0), Spring(40.0)):
        program = jax.jit(partial(follow, 0.5, 0)).lower(start_of(law, 1.0, 0.1))
        assert ("tensor<16x16x" in program.as_text()) == (law == Spring(40.0))  # stages
        ends.append(program.compile()(start_of(law, 1.0, 0.1)).velocity)
    np.testing.assert_allclose(*ends, rtol=1e-7)


def test_laws_of_two_classes_with_equal_numbers_have_programs_of_their_own():
    """A block meets one at unit speed, and turns where the work is its energy."""
    deepest = jax.jit(lambda start: follow(1.0, 0, start).turns.farthest)
    laws = Hardening(40.0, 30.0), Softening(40.0, 30.0)
    x = np.array([float(deepest(start_of(law, 1.0, 0.0))[0]) for law in laws])
    work = 20 * x**2 * [1 + 15 * x[0] ** 2, np.log(1 + 30 * x[1] ** 2) / (30 * x[1] ** 2)]
    np.testing.assert_allclose(work, 0.5, rtol=1e-4)


def test_programs_are_kept_by_the_classes_of_laws():
    """JAX takes trees of two such classes for equal, now and then with the same program."""
    laws = Hardening(40.0, 30.0), Softening(40.0, 30.0)
    assert jax.tree.structure(laws[0]) == jax.tree.structure(laws[1])
    assert node_classes([laws[0]]) == (list, Hardening) != node_classes([laws[1]])
    bound = [jax.tree.structure(with_mass(law, 1.0)) for law in laws]
    assert bound[0] != bound[1]


def test_the_names_of_a_law_s_numbers_do_not_matter():
    """A field that is called as one of the contact's is differentiated in both modes."""
    forward, reverse = (jax.jit(mode(speed_after))(40.0) for mode in (jax.jacfwd, jax.grad))
    assert abs(float(forward)) > 1e-3
    assert float(reverse) == pytest.approx(float(forward), rel=1e-12)


def test_a_law_may_have_many_numbers():
    """The speed depends on the sum of twelve of them, each times its own factor."""
    speed = jax.jit(jax.grad(lambda shares: speed_after(40.0, shares)))
    slopes = np.array(speed((0.1,) * 12))
    assert abs(slopes[0]) > 1e-3
    np.testing.assert_allclose(slopes, slopes[0] * np.arange(1, 13), rtol=1e-9)


def test_too_many_events_are_not_a_silent_result():
    out = collided()(start_of(jp.KelvinVoigt(1e16, 0.999999), 1.0, 0.01, pull=1e6))
    assert np.isnan(out.closing).all()


def test_a_flow_that_fails_before_any_touch_is_not_one_without_contact():
    out = collided()(start_of(jp.KelvinVoigt(1000.0, 0.65), 0.1, 10.0, pull=np.nan))
    assert np.isnan(
        [out.closing, out.gaps.log.touched]
    ).all()  # or the step would go on with the latter


def test_lanes_of_a_batch_are_followed_as_they_are_alone():
    """Also where only some of them need it; those that do not are left out."""
    speeds = jnp.linspace(0.1, 1.0, 21)
    needed = speeds > 0.3
    law = jp.KelvinVoigt(1000.0, 0.65)

    def run(speed, need):
        return follow(0.5, SLOTS, start_of(law, speed, 0.1), needed=need).velocity[0]

    many = jax.jit(jax.vmap(run))(speeds, needed)
    alone = [float(collided()(start_of(law, s, 0.1)).velocity[0]) for s in speeds]
    np.testing.assert_allclose(many[needed], np.array(alone)[needed], rtol=1e-12)
    assert (many[~needed] == 0).all()
