from functools import partial
from itertools import groupby

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, example, given, strategies

import jaxpound as jp
from jaxpound.simulation.joints.coulomb import _events, _outcome, slip_stick
from jaxpound.simulation.joints.friction import _creep
from jaxpound.simulation.joints.motion import LinkStep
from tests.refusals import refusals

H = 0.1
moderate = strategies.floats(-2, 2).map(lambda x: round(x, 3))
step = strategies.fixed_dictionaries(
    {"w": moderate.map(lambda x: 0.1 * x) | strategies.just(0.0), "a": moderate, "a_last": moderate}
    | {"rho": strategies.floats(0.1, 5), "mu": strategies.floats(0, 1).map(lambda x: round(x, 3))}
)


@partial(jax.jit, static_argnums=0)
def slide(law, w, a, a_last, rho, mu, phase=0.0):
    return law.slide(LinkStep(w, phase * jnp.ones_like(w), a, a - a_last, 1 + rho, mu, H))


def mean_force(slip, w, a, rho):
    """That over the step, of which the velocities tell."""
    return (a - (slip.velocity - w) / H) / (1 + rho)


@partial(jax.jit, static_argnums=0)
def jacobians(law, case):
    """Forward and reverse derivatives of what a step returns, by every input."""

    def outcome(values):
        slip = slide(law, **values)
        turn = jnp.where(slip.turns, slip.turn, 0.0)
        moved = [slip.velocity, slip.force, slip.velocity_now, slip.jump]
        return jnp.stack([*moved, turn, slip.turn_time * slip.turns])

    return jax.jacfwd(outcome)(case), jax.jacrev(outcome)(case)


def brute_force(w, a, a_last, rho, mu, n=4000):
    """w' ∈ A(τ) − R μ Sgn(w) by n implicit Euler substeps of one step, each solved exactly."""
    dt, brake = H / n, H / n * (1 + rho) * mu
    tau = (np.arange(n) + 0.5) / n
    push = dt * (a + (a - a_last) * (tau - 0.5))
    path = [w]
    for kick in push:
        free = path[-1] + kick
        path.append(np.sign(free) * max(abs(free) - brake, 0.0))
    return np.array(path)


@given(step)
@example({"w": 0.05, "a": -1.0, "a_last": -1.0, "rho": 1.0, "mu": 0.1})  # reverses
@example({"w": 0.05, "a": 0.1, "a_last": 0.1, "rho": 1.0, "mu": 0.5})  # sticks
@example({"w": 0.0, "a": 1.0, "a_last": 0.5, "rho": 1.0, "mu": 0.5})  # breaks away
@example({"w": 0.002, "a": 0.0, "a_last": -2.0, "rho": 1.0, "mu": 0.3})  # stops for a while
@example({"w": 0.02, "a": 0.98, "a_last": 0.0, "rho": 1.0, "mu": 0.6})  # stops, then breaks away
def test_event_resolved_is_the_exact_inclusion_within_a_step(case):
    # Friction has held a link at rest until the step begins.
    first_pull = (case["a"] + case["a_last"]) / 2
    assume(case["w"] != 0 or abs(first_pull) <= (1 + case["rho"]) * case["mu"])
    slip = slide(jp.EventResolved(), **case)
    assert abs(slip.force) <= case["mu"] * (1 + 1e-15)
    assert abs(mean_force(slip, case["w"], case["a"], case["rho"])) <= case["mu"] + 1e-12
    assert slip.force * slip.velocity_now >= 0
    path = brute_force(**case)
    # The law follows slip, stick and slip again: more than that in one step is not resolved.
    directions = [sign for sign, _ in groupby(np.sign(path[1:])) if sign]
    assume(len(directions) <= (2 if directions[:1] == [np.sign(case["w"])] else 1))
    assert slip.velocity == pytest.approx(path[-1], abs=2e-4)
    assert slip.velocity_now == pytest.approx(path[len(path) // 2], abs=2e-4)
    if slip.turns and slip.turn_time > 0:
        stop = len(path) // 2 + int(float(slip.turn_time) / H * 4000)
        slid = path[len(path) // 2 : stop].sum() * H / 4000
        assert slip.turn == pytest.approx(slid, abs=1e-5)


@given(step, strategies.integers(0, 3))
def test_steps_are_mirrored_continuous_and_of_no_width_stick_where_coulomb_s_law_does(case, which):
    """A change of 1e-7 in any input moves the velocity by what slopes of order 1 allow."""
    mirrored = {**case, "w": -case["w"], "a": -case["a"], "a_last": -case["a_last"]}
    for law in (jp.EventResolved(), jp.Smoothed(0.05)):
        slip, other = slide(law, **case), slide(law, **mirrored)
        for name in ("velocity", "force", "velocity_now", "jump", "phase"):
            np.testing.assert_allclose(getattr(slip, name), -getattr(other, name), atol=1e-15)
        np.testing.assert_allclose(slip.turn_time, other.turn_time, atol=1e-15)
    slip = slide(jp.Smoothed(1e-300), **{**case, "w": 0.0})
    holds = abs(case["a"]) <= (1 + case["rho"]) * case["mu"]
    assert holds == (abs(slip.velocity) < 1e-12)
    name = ("w", "a", "a_last", "mu")[which]
    near = case | {name: case[name] + 1e-7}
    start, end = (slide(jp.EventResolved(), **inputs) for inputs in (case, near))
    assert abs(end.velocity - start.velocity) < 1e-5


@given(step)
@example({"w": 0.0, "a": 0.0, "a_last": 0.0, "rho": 1.0, "mu": 0.0})
@example({"w": 0.0, "a": 0.5, "a_last": 0.5, "rho": 1.0, "mu": 0.0})
@example({"w": 0.0, "a": 1.0, "a_last": 1.0, "rho": 1.0, "mu": 0.5})
@example({"w": 0.1, "a": -1.0, "a_last": -1.0, "rho": 1.0, "mu": 0.0})
def test_derivatives_are_finite_in_every_case_and_those_of_the_velocity_central_differences(case):
    law = jp.EventResolved()
    for each in (law, jp.simulation.Switching(), jp.Smoothed(1e-3), jp.Smoothed(1e-300)):
        for jacobian in jacobians(each, case):
            for name, slope in jacobian.items():
                assert np.isfinite(slope).all(), (each, name, slope)
    slopes = {name: slope[0] for name, slope in jacobians(law, case)[0].items()}
    # In stick w is the constant 0, and has no derivative.
    for name in ("a", "a_last", "mu") + (("w",) if case["w"] else ()):
        around = (case | {name: case[name] + change} for change in (-1e-6, 0, 1e-6))
        low, middle, high = (float(slide(law, **inputs).velocity) for inputs in around)
        if abs(high - 2 * middle + low) < 1e-9:  # not at a kink
            assert slopes[name] == pytest.approx((high - low) / 2e-6, abs=2e-3), name


def test_switching_follows_the_paper_s_table():
    def after(w, a, phase):
        slip = slide(jp.simulation.Switching(), w=w, a=a, a_last=0.0, rho=1.0, mu=0.25, phase=phase)
        return slip.phase, slip.force, slip.velocity

    assert after(0.0, 0.4, 0.0) == (0, 0.2, 0)  # is held
    assert after(0.0, -0.8, 0.0) == (-1, -0.25, pytest.approx(H * (-0.8 + 0.5)))  # breaks away
    assert after(0.3, -9.0, 1.0)[:2] == (1, 0.25)  # slides
    assert after(-0.01, 0.4, 1.0) == (0, 0.2, 0)  # stops
    assert after(-0.01, -2.0, 1.0)[:2] == (-1, -0.25)  # turns


creep = jax.jit(_creep)
widths = strategies.sampled_from([1e3, 1.0, 1e-3, 1e-9, 1e-100])


@given(push=strategies.floats(-1e3, 1e3), brake=strategies.floats(0, 1e3), width=widths)
def test_the_creep_equation_is_solved_at_every_width(push, brake, width):
    w = float(creep(push, brake, width))
    assert np.isfinite(w)
    assert np.sign(w) in (0, np.sign(push))
    assert abs(w) <= abs(push)
    # Bracketed to rounding: the left side is increasing.
    nudge = 1e-9 * max(abs(w), 1e-9 * width)
    low, high = (x + brake * np.tanh(x / width) for x in (w - nudge, w + nudge))
    slack = 1e-12 * (abs(push) + brake)
    assert low - slack <= push <= high + slack


def test_creep_differentiates_by_the_implicit_function_theorem_to_second_order():
    point = (0.7, 0.5, 0.3)
    first, second = jax.jit(jax.grad(_creep, (0, 1, 2))), jax.jit(jax.grad(jax.grad(_creep)))
    h = 1e-5

    def difference(function, i):
        up, down = (function(*np.add(point, d * np.eye(3)[i])) for d in (h, -h))
        return float(up - down) / (2 * h)

    slopes = [difference(creep, i) for i in range(3)]
    assert [float(slope) for slope in first(*point)] == pytest.approx(slopes, rel=1e-8)
    assert second(*point) == pytest.approx(difference(lambda *x: first(*x)[0], 0), rel=1e-7)


def test_no_width_is_unstable():
    """With a constant push the slip velocity settles, whatever the width, and never oscillates."""
    for width in (1e-300, 1e-6, 1e-3, 0.1):
        w, path = 1.0, []
        for _ in range(400):
            w = float(slide(jp.Smoothed(width), w=w, a=0.3, a_last=0.3, rho=1.0, mu=0.5).velocity)
            path.append(w)
        rest = width * np.arctanh(0.3) if width > 1e-200 else 0.0
        assert path[-1] == pytest.approx(rest, rel=1e-3, abs=1e-12)
        assert np.min(path) >= min(0.0, rest) - 0.02


test_smoothed_friction_needs_a_positive_width = refusals(
    *((x, f"Smoothed: velocity = {x:g} must be positive") for x in (0.0, -1.0, np.nan, np.inf)),
    of=jp.Smoothed,
)


def formulas(*x):
    return _outcome(_events(*x), x[-1])


def derivatives(step, *modes):
    """Of a step's outcome, the inner mode first, as a program of a batch of points."""

    def function(x):
        return jnp.stack(jax.tree.leaves(step(*x, H)))

    for mode in modes:
        function = mode(function)
    return jax.jit(jax.vmap(function))


def test_the_step_s_derivatives_are_those_of_its_own_formulas():
    """Written out, in both modes and to second order, against plain forward differentiation."""
    random, n = np.random.default_rng(3), 4000
    w = random.normal(size=n) * 0.03 * (random.random(n) < 0.8)
    pull, hold = random.normal(size=n), np.abs(random.normal(size=n)) * (random.random(n) < 0.9)
    rise = random.normal(size=n) * random.choice([0.01, 1.0, 5.0], n)
    points = np.stack([w, pull, rise, hold], -1)
    e = jax.vmap(lambda *x: _events(*x, H))(*points.T)
    plain_slip, reverses, rests = ~e.stops, e.stops & ~e.sticks, e.sticks & ~e.breaks
    for case in (plain_slip, reverses, rests, e.breaks, e.stuck, ~e.slips_first, e.hold == 0):
        assert case.sum() > 50
    plain = derivatives(formulas, jax.jacfwd)(points)
    assert np.isfinite(plain).all()
    for mode in (jax.jacfwd, jax.jacrev):
        slopes = derivatives(slip_stick, mode)(points)
        # Stops at once (θ near 0) cost the plain derivatives their last digits.
        np.testing.assert_allclose(slopes, plain, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(np.median(np.abs(slopes - plain), 0), 0, atol=1e-15)
    points = np.stack([*random.normal(size=(3, 1000)), np.abs(random.normal(size=1000))], -1)
    points[:, 0] *= 0.03
    plain = derivatives(formulas, jax.jacfwd, jax.jacfwd)(points)
    assert np.abs(plain).max() > 1
    for inner in (jax.jacfwd, jax.jacrev):
        bends = derivatives(slip_stick, inner, jax.jacfwd)(points)
        np.testing.assert_allclose(bends, plain, rtol=1e-6, atol=1e-6)
