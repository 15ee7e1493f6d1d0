"""Viscous dampers and friction that grows with velocity, by a reference and closed forms."""

import dataclasses
import functools

import jax
import numpy as np
import pytest

import jaxpound as jp
from jaxpound.simulation.scheme import imprecise
from tests.simulation import moats

GROUND = jp.Ricker(0.25, [1.6, 2.4], [3.4, 5.6])
WITHIN = {  # shares of the largest displacement, and of the derivatives
    "power law": (1e-3, 0.01),
    "dashpot and friction": (1e-3, 2e-3),
    "sliding base": (3e-3, 0.012),
}


@pytest.mark.parametrize("name", WITHIN)
def test_runs_and_their_derivatives_are_those_of_the_reference(name):
    moats.check(name, *WITHIN[name])


@pytest.mark.parametrize("name", ["power law", "sliding base"])
def test_the_mirror_image_has_the_faces_of_the_other_side(name):
    moats.check_mirror(name)


def response(name, **values):
    """Of a case that does not touch, at the last step, with numbers changed by their paths."""
    case = moats.CASES[name]
    for path, value in {"link.gap.0": 9.0, "link.gap.1": 9.0, **values}.items():
        case = moats.changed(case, path, value)
    return moats.response_of(case, unit=moats.STEPS[-1] / moats.GRID.dt)


def test_a_small_exponent_is_coulombs_friction():
    stiff = {"rods.2.K": 4000.0}
    friction = response("power law", **stiff, **{"rods.2.F": 0.0, "link.mu": 0.2})
    x, work = friction.x1, float(friction.demand.friction_work_1)
    for exponent, within in {0.2: 0.04, 0.05: 0.01, 0.0125: 0.004}.items():
        damper = response("power law", **stiff, **{"rods.2.F": 0.2, "rods.2.a": exponent})
        assert np.abs(damper.x1 - x).max() < within * np.abs(x).max()
        taken = float(damper.demand.dissipated_energy_3)
        assert taken == pytest.approx(work, rel=1.1 * exponent)
        assert damper.energy.relative_residual < 1e-3
    assert damper.demand.n_impacts_1 == 0


def test_friction_that_grows_at_once_is_coulombs():
    fast = response("sliding base", **{"link.mu": 0.04, "link.velocity_friction.v": 1e-5})
    friction = response("sliding base", **{"link.mu": 0.09, "link.velocity_friction.F": 0.0})
    size = np.abs(friction.x1).max()
    np.testing.assert_allclose(fast.x1, friction.x1, rtol=0, atol=2e-4 * size)


def test_a_linear_dashpot_beside_a_spring_is_a_zener_rod():
    """K1 beside a dashpot c in series with K2: τ_f = c/K2 and τ_x = τ_f (1 + K2/K1)."""
    spring, brace, dashpot = 4.0, 50.0, 0.8
    base, grid = (0, jp.GROUND), jp.TimeGrid(0.01, 1000)
    tau = dashpot / brace
    damper = jp.Rod(jp.PowerLaw(dashpot / 2, 1.0, velocity=0.5), brace, base)
    rods = jp.Rod(jp.ZenerRod(1.0, 0.01, 0.01), spring, base), damper
    zener = jp.Rod(jp.ZenerRod(1.0, tau, tau * (1 + brace / spring)), spring, base)
    ours, exact = (jp.simulate(jp.System((1.0,), x), GROUND, grid) for x in (rods, (zener,)))
    x, force = exact.x1, exact.f1
    np.testing.assert_allclose(ours.x1, x, rtol=0, atol=5e-4 * np.abs(x).max())
    np.testing.assert_allclose(ours.f1 + ours.f2, force, rtol=0, atol=2e-3 * np.abs(force).max())


def test_a_run_warns_of_a_brace_that_its_steps_do_not_resolve():
    """Before it runs, of concrete numbers, where first order shows."""

    def system(force=0.5, brace=4000.0, exponent=1.0):
        damper = jp.Rod(jp.PowerLaw(force, exponent, velocity=0.5), brace, (1, 0))
        rods = [jp.Rod(jp.ZenerRod(1.0, 0.02, 0.1), 4.0, ends) for ends in ((0, jp.GROUND), (1, 0))]
        return jp.System((1.0, 0.5), (*rods, damper))

    grid = jp.TimeGrid(0.01, 10)
    message = "rod .*: dt is 40 times c/K, .* at most 4 times: .* like 1.50% less mass; take dt, or"
    for exponent in (1.0, 0.3):
        with pytest.raises(ValueError, match=f"^demand: .*{message} .* 10 times smaller$"):
            jp.demand(system(exponent=exponent), GROUND, grid, strict=True)
    assert imprecise(system(brace=399.0), grid, ()) == []
    assert imprecise(system(), jp.TimeGrid(0.00099, 10), ()) == []
    for force in (0.0, 0.004):
        assert imprecise(system(force=force), grid, ()) == []
    assert jax.eval_shape(lambda x: imprecise(system(force=x), grid, ()) or x, 0.5).shape == ()


def test_the_damper_of_a_link_is_a_rod():
    steel, damper = jp.ZenerRod(1.0, 0.03, 0.15), jp.Rod(jp.PowerLaw(0.3, 0.35), 60.0)
    rod, base = jp.Rod(steel, 4.0, (0, jp.GROUND)), (0, jp.GROUND)
    inside = jp.System((1.0,), (rod,), (jp.Link(base, 0.1, (0.1, 0.2), damper=damper),))
    beside = dataclasses.replace(damper, ends=base)
    outside = jp.System((1.0,), (rod, beside), (jp.Link(base, 0.1, (0.1, 0.2)),))
    assert jax.tree.structure(inside) == jax.tree.structure(outside)
    assert jax.tree.leaves(inside) == jax.tree.leaves(outside)


def test_reverse_mode_is_forward_mode_and_a_batch_is_a_loop():
    """By all numbers of a base that slides, with a damper, at four velocities of the friction."""
    base, grid = (0, jp.GROUND), jp.TimeGrid(0.04, 200)
    only = ("peak_x1", "friction_work", "dissipated_energy_2")

    def value(numbers):
        force, exponent, brace, friction, increase, velocity = numbers
        damper = jp.Rod(jp.PowerLaw(force, exponent), brace, base)
        rods = jp.Rod(jp.ZenerRod(1.0, 0.05, 0.2), 1.5, base), damper
        link = jp.Link(base, friction, velocity_friction=jp.VelocityFriction(increase, velocity))
        demand = jp.demand(jp.System((1.0,), rods, (link,)), GROUND, grid, only=only)
        return demand.peak_x1 + demand.friction_work + demand.dissipated_energy_2

    batch = np.array([[0.1, 0.4, 50.0, 0.05, 0.05, x] for x in (0.01, 0.1, 0.2, 1.0)])
    values, gradients = jax.device_get(jax.jit(jax.vmap(jax.value_and_grad(value)))(batch))
    forward = jax.jit(lambda x: jax.jvp(value, (x,), (x,)))
    for numbers, together, gradient in zip(batch, values, gradients, strict=True):
        alone, slope = forward(numbers)
        assert together == pytest.approx(float(alone), rel=1e-12)
        assert gradient @ numbers == pytest.approx(float(slope), rel=1e-9)


def test_a_friction_pendulum_let_go_swings_in_its_period_and_loses_what_friction_takes():
    """Half a cycle takes π √(R/g) and ends closer by 2 μ R, until |x| < μ R, where it stays."""
    radius, friction, start = 2.24, 0.01, 0.3
    bearing = jp.FrictionPendulum(radius, friction)
    light = jp.Building.from_period(1e4, 0.1, 0.02)
    building, links = jp.on_bearings(light, bearing, base_mass=4e5)
    half, loss = np.pi * np.sqrt(radius / jp.STANDARD_GRAVITY), 2 * friction * radius
    left = start - loss * np.arange(8)
    still, aside = jp.Pulse(0.0, 1.0, 1.0, time_unit="s"), jp.InitialState((start, start))
    grid = jp.TimeGrid.until(8 * half, 0.01)
    run = jp.simulate(jp.Buildings((building,), links), still, grid, initial=aside)
    *swings, rest = run.phases()
    assert [x.kind for x in swings] == ["slip left", "slip right"] * 3 + ["slip left"]
    np.testing.assert_allclose([x.end - x.start for x in swings], half, rtol=2e-5)
    assert rest.kind == "stick"
    assert abs(left[-1]) < loss / 2 < abs(left[-2])
    assert run.x1[-1] == pytest.approx(-left[-1], abs=1e-5)
    slid = np.sum(left[:-1] + left[1:])
    assert run.demand.slip_distance == pytest.approx(slid, rel=1e-4)
    work = friction * 4.1e5 * jp.STANDARD_GRAVITY * slid
    assert run.demand.friction_work == pytest.approx(work, rel=1e-4)
    assert run.energy.relative_residual < 3e-4


MOTION = jp.TimeGrid(0.04, 200)


def of_damper(force, exponent):
    """The largest displacement, and what the damper takes, in the precision of its numbers."""
    base, dtype = (0, jp.GROUND), force.dtype
    damper = jp.Rod(jp.PowerLaw(force, exponent), dtype.type(60.0), base)
    rods = jp.Rod(jp.ZenerRod(1.0, 0.05, 0.2), dtype.type(4.0), base), damper
    system = jax.tree.map(lambda x: jax.numpy.asarray(x, dtype), jp.System((1.0,), rods))
    ground = jax.tree.map(lambda x: jax.numpy.asarray(x, dtype), GROUND)
    demand = jp.demand(system, ground, MOTION, only=("peak_x1", "dissipated_energy_2"))
    return jax.numpy.stack([demand.peak_x1, demand.dissipated_energy_2])


@jax.jit
def forward_mode(force, exponent):
    """Values and derivatives by the force."""
    by_force = functools.partial(of_damper, exponent=exponent)
    return jax.jvp(by_force, (force,), (jax.numpy.ones_like(force),))


reverse_mode = jax.jit(jax.jacrev(of_damper, (0, 1)))


@pytest.mark.parametrize("exponent", [0.3, 1.0])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_a_force_of_zero_has_the_derivative_of_a_small_force(exponent, dtype):
    exponent, single = dtype(exponent), dtype == np.float32
    small = dtype(1e-3 if single else 1e-8)
    value, forward = forward_mode(dtype(0), exponent)
    reverse, _ = reverse_mode(dtype(0), exponent)
    quotient = (np.asarray(forward_mode(small, exponent)[0]) - np.asarray(value)) / small
    np.testing.assert_allclose(forward, quotient, rtol=0.02 if single else 1e-4)
    np.testing.assert_allclose(reverse, forward, rtol=1e-3)
    assert forward[0] < -0.1


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("exponent", [0.001, 0.01, 0.05, 0.3])
def test_exponents_of_any_size_have_gradients(exponent, dtype):
    assert np.isfinite(reverse_mode(dtype(0.2), dtype(exponent))).all()
