"""The local flow: free collisions under every law, and its derivatives."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import pytest

import jaxpound as jp
from jaxpound.model.contact import with_mass
from jaxpound.simulation.contact.flows import flow
from jaxpound.simulation.contact.records import SLOTS, Clock, Contact, FlowInput
from tests.reference import load

COLLISIONS = load("contact")["collisions"]
LAWS = {
    "kelvin": lambda k, e: jp.KelvinVoigt(k, e, tension=True),
    "kelvin_clip": jp.KelvinVoigt,
    "hertz": lambda k, _: jp.Hertz(k),
    "hertzdamp": lambda k, e: jp.HertzDamped(k, e, "muthukumar"),
    "hertzdamp_hc": lambda k, e: jp.HertzDamped(k, e, "hunt-crossley"),
    "hertzdamp_flores": lambda k, e: jp.HertzDamped(k, e, "ye"),
    "hertzdamp_exact": jp.HertzDamped,
    "jankowski": jp.Jankowski,
    "newton": lambda _, e: jp.Newton(e),
}
AT_START = Clock(jnp.zeros(()), jnp.zeros(()))


def given(law, velocity, gap, delassus=1.0, friction=0.0, pull=0.0, rise=0.0):
    one = jnp.ones(1)
    return FlowInput(
        closing=0 * one,
        velocity=velocity * one,
        pull=pull * one,
        rise=rise * one,
        delassus=delassus * jnp.ones((1, 1)),
        friction=friction * one,
        gap=gap * one,
        laws=(with_mass(jax.tree.map(jnp.asarray, law), 1 / delassus),),
        contact=Contact(*(0 * one,) * len(Contact._fields)),
    )


@functools.cache
def collided():
    return jax.jit(lambda start: flow(0.5, SLOTS, jnp.asarray(True), start, AT_START))


@pytest.mark.parametrize("name", LAWS)
def test_free_collisions_are_those_of_the_laws(name):
    """Restitution, peak force and penetration, momentum and the energy lost, for four e."""
    cases = [case for case in COLLISIONS if case["law"] == name]
    assert len(cases) == 4
    for case in cases:
        left, right = case["m"]
        speed, delassus = case["v0"][0] - case["v0"][1], 1 / left + 1 / right
        start = given(LAWS[name](case["k"], case["e"]), speed, case["gap0"], delassus)
        out = collided()(start)
        restitution = -float(out.velocity[0]) / speed
        assert restitution == pytest.approx(case["restitution"], abs=1e-6)
        lost = (1 - restitution**2) * speed**2 / delassus / 2
        assert float(out.lost[0]) == pytest.approx(lost, abs=1e-7)
        assert float(out.stored[0]) == pytest.approx(0, abs=1e-7)
        # The impulse takes from the one what it gives to the other.
        impulse = float(out.log.impacts.impulse[0, 0])
        assert impulse == pytest.approx((1 + restitution) * speed / delassus, rel=1e-12)
        depth = float(out.log.farthest[0]) - case["gap0"]
        assert depth == pytest.approx(case["peak_penetration"], rel=1e-6, abs=1e-15)
        assert float(out.log.highest[0]) == pytest.approx(case["peak_force"], rel=1e-6)
        if name in ("kelvin", "hertzdamp_exact", "newton"):
            assert restitution == pytest.approx(case["e"], abs=1e-6)


def test_stick_ends_where_friction_that_has_changed_its_sign_reaches_the_slip_force():
    """Friction grows from −.3 μ to 5 μ: slip begins at .245 of the step, and moves with μ."""

    def end_velocity(slip_force):
        start = given(jp.Newton(0.5), 0.0, 10.0, friction=slip_force, pull=0.235, rise=0.53)
        return flow(0.5, 0, jnp.asarray(True), start, AT_START).velocity[0]

    velocity, slope = jax.jit(jax.value_and_grad(end_velocity))(0.1)
    rate, slides = 0.53 / 0.5, 0.5 * (1 - 0.13 / 0.53)
    assert float(velocity) == pytest.approx(rate * slides**2 / 2, rel=1e-12)
    assert float(slope) == pytest.approx(-slides, rel=1e-12)


def test_a_link_without_friction_starts_from_rest_and_a_load_that_grows_from_zero():
    start = given(jp.KelvinVoigt(1000.0, 0.65), 0.0, 10.0, pull=1.0, rise=2.0)
    assert float(collided()(start).velocity[0]) == pytest.approx(0.5, rel=1e-12)


def test_the_names_of_a_law_s_numbers_do_not_matter():
    """A field that is called as one of the contact's is differentiated in both modes."""

    @jax.tree_util.register_dataclass
    @dataclasses.dataclass(frozen=True)
    class Spring:
        mode: float

        def force(self, penetration, speed, touch_speed):
            return self.mode * penetration

    def speed(stiffness):
        start = given(Spring(stiffness), 1.0, 0.1)
        return flow(0.5, 0, jnp.asarray(True), start, AT_START).now.velocity[0]

    forward, reverse = (jax.jit(mode(speed))(40.0) for mode in (jax.jacfwd, jax.grad))
    assert abs(float(forward)) > 1e-3
    assert float(reverse) == pytest.approx(float(forward), rel=1e-12)
