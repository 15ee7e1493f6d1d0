"""Buildings under a mainshock and an aftershock: damage is carried over."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp

SAMPLES = np.sin(7 * (t := 0.02 * np.arange(200))) * np.exp(-((t - 2) ** 2)) * (1 + 0.5 * t)
MAINSHOCK, AFTERSHOCK = jp.Record(0.15 * SAMPLES, 0.02), jp.Record(0.3 * SAMPLES[::2], 0.03)
REST = 20.0
BUILDING = jp.Building.from_period(500e3, 0.9, damping_ratio=0.1, order=1)
GRID = jp.TimeGrid.until(30.0, 0.01)
START = round((3.98 + REST) / GRID.dt)  # of the aftershock


def yielding(**law):
    weak = dataclasses.replace(BUILDING, hysteresis=jp.Bilinear(0.02, **law))
    stiff = jp.Building.from_period(400e3, 0.5, damping_ratio=0.1, order=1)
    return jp.Buildings((weak, stiff), (jp.FloorLink(0, 0, gap=0.5),))


def both(factor=1.0, rest=REST):
    return jp.sequence([MAINSHOCK, factor * AFTERSHOCK], rest)


@pytest.mark.parametrize("ground", [both() + 0.1 * MAINSHOCK, jp.ground.Scaled(both(), 0.5)])
def test_a_chosen_grid_holds_a_sequence_in_a_sum_or_a_scaling(ground):
    response = jp.simulate(yielding(), ground)
    assert float(response.time[-1]) == pytest.approx(float(both().duration), abs=0.05)


def test_an_elastoplastic_building_at_rest_again_is_a_new_building_that_leans():
    """At rest its force is 0, and so its slider is in the middle, as that of a new building."""
    pair = yielding()
    whole, alone = (jp.simulate(pair, ground, GRID) for ground in (both(), AFTERSHOCK))
    lean = float(whole.x1[START])
    n = GRID.n_steps + 1 - START
    assert abs(lean) > 0.01
    np.testing.assert_allclose(whole.x1[START:] - lean, alone.x1[:n], atol=1e-6)
    np.testing.assert_allclose(whole.x2[START:], alone.x2[:n], atol=1e-6)
    # The lean is that of a run of the mainshock only, and adds to that of the aftershock.
    first = jp.demand(pair, MAINSHOCK, GRID)
    assert abs(lean) == pytest.approx(float(first.residual_drift), abs=1e-6)
    final = float(whole.x1[-1] - alone.x1[n - 1])
    assert final == pytest.approx(lean, abs=1e-6)
    dissipated = [float(x.dissipated_energy) for x in (whole.demand, first, alone.demand)]
    assert dissipated[0] == pytest.approx(sum(dissipated[1:]), rel=1e-6)


@pytest.mark.parametrize("law", [{}, {"hardening": 0.1}])
def test_the_demand_of_a_sequence_is_at_least_that_of_its_mainshock(law):
    pair = yielding(**law)
    demand = jax.jit(jax.vmap(lambda factor: jp.demand(pair, both(factor), GRID)))
    factors = jnp.array([0.0, 0.5, 2.0, -1.0])
    batch, mainshock = demand(factors), jp.demand(pair, MAINSHOCK, GRID)
    ductility = np.asarray(batch.ductility)
    np.testing.assert_allclose(ductility[0], mainshock.ductility, rtol=1e-9)
    assert (ductility >= ductility[0]).all()
    assert ductility.max() > 1.2 * ductility[0]
    eager = [jp.demand(pair, both(float(factor)), GRID) for factor in factors[1:3]]
    for single, place in zip(eager, (1, 2), strict=True):
        for name in ("ductility", "residual_drift", "min_gap"):
            value = np.asarray(getattr(batch, name))[place]
            assert float(getattr(single, name)) == pytest.approx(value, rel=1e-9)


def test_derivatives_by_the_aftershock_s_factor_and_by_the_rest():
    pair = yielding(hardening=0.05)

    @jax.jit
    def min_gap(factor, rest):
        return jp.demand(pair, both(factor, rest), GRID).min_gap

    at = np.array([2.5, REST])
    by = jax.jit(jax.grad(min_gap, (0, 1)))(*at)
    h = 1e-5
    steps = h * np.eye(2)
    differences = [float(min_gap(*(at + d)) - min_gap(*(at - d))) / (2 * h) for d in steps]
    assert abs(differences[0]) > 1e-3
    np.testing.assert_allclose(by, differences, rtol=2e-3, atol=1e-7)


def test_single_precision_and_a_shift_by_silence():
    pair = yielding(hardening=0.05)
    single = jp.demand(*jax.tree.map(np.float32, (pair, both())), GRID, only=["min_gap"])
    assert single.min_gap.dtype == jnp.float32
    exact = float(jp.demand(pair, both(), GRID).min_gap)
    assert float(single.min_gap) == pytest.approx(exact, rel=1e-4)
    silent = jp.sequence([0.0 * MAINSHOCK, AFTERSHOCK], REST)
    later, alone = (jp.simulate(pair, ground, GRID).x1 for ground in (silent, AFTERSHOCK))
    np.testing.assert_allclose(later[START:], alone[: GRID.n_steps + 1 - START], atol=1e-9)
    assert not np.any(later[: START - 1])
