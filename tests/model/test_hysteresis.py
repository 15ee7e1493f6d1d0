"""Laws of hysteresis without a run, and the buildings that have them."""

from dataclasses import replace
from itertools import pairwise

import jax
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import jaxpound as jp
from tests.refusals import refusals

FRAME = jp.ShearBuilding.from_period(3, 300e3, period=0.5, damping_ratio=0.05)


def test_a_bilinear_rod_dissipates_the_area_of_its_loop():
    law, turns = jp.Bilinear(0.1, 0.05), [0.0, 0.4, -0.4, 0.4]
    test = jp.study.cyclic_test(law, turns, steps=1)
    np.testing.assert_allclose(test.force[1:], [0.115, -0.115, 0.115], rtol=1e-12)
    quarter, area = 0.95 * 0.1 * 0.3, 4 * 0.95 * 0.1 * 0.3
    assert test.dissipated[-1] == pytest.approx(quarter + area, rel=1e-12)
    state = law.start(0.0)
    for before, after in pairwise(turns):
        state = law.advance(state, before, after)
    assert law.kink(state, -1.0)[0] == pytest.approx(0.2)


@pytest.mark.parametrize(("exponent", "beta", "worn"), [(1.0, 0.3, 0.0), (2.6, 0.7, 0.05)])
def test_bouc_wen_follows_its_differential_equation(exponent, beta, worn):
    law = jp.BoucWen(0.1, 0.02, exponent, beta, worn, worn)
    path = np.concatenate([np.linspace(0, 0.35, 60), np.linspace(0.35, -0.3, 100)])

    def rates(_, y, side):
        z, energy = y
        worn_now = energy / 0.1**2
        loss = abs(z) ** exponent * (beta * np.sign(side * z) + 1 - beta) * (1 + worn * worn_now)
        slope = (1 - loss) / (1 + worn * worn_now)
        return [side * slope / 0.1, side * 0.98 * 0.1 * z * (1 - slope)]

    options = {"rtol": 1e-10, "atol": 1e-12, "max_step": 0.01}
    way = solve_ivp(rates, (0, 0.35), [0.0, 0.0], args=(1.0,), **options).y[:, -1]
    exact = solve_ivp(rates, (0, 0.65), way, args=(-1.0,), **options).y[:, -1]
    test = jp.study.cyclic_test(law, path, steps=1)
    z = (test.force[-1] - 0.02 * path[-1]) / (0.98 * 0.1)
    np.testing.assert_allclose([z, test.dissipated[-1]], exact, rtol=3e-3)
    assert np.isfinite(jp.study.cyclic_test(law, [0.0, 10.0, -10.0], steps=1).force).all()
    assert np.abs(test.force).max() < 0.1 * (1 + 0.02 * 3.5)

    # At rest, too, derivatives are finite.
    def force(law):
        return law.reduced_force(0.0, law.advance(law.start(0.0), 0.0, 0.0))

    assert all(np.isfinite(x) for x in jax.tree.leaves(jax.jit(jax.grad(force))(law)))


def test_strengths_of_a_building_follow_codes():
    weak = FRAME.yielding(base_shear_coefficient=0.12, hardening=0.03)
    forces = [s.stiffness * s.hysteresis.yield_displacement for s in weak.storeys]
    weight = 3 * 300e3 * 9.80665
    np.testing.assert_allclose(forces, 0.12 * weight * np.array([6, 5, 3]) / 6, rtol=1e-12)
    assert weak.natural_period == pytest.approx(FRAME.natural_period, rel=1e-12)
    drifts = FRAME.yielding(jp.BoucWen, yield_drift=0.005, exponent=3.0).storeys
    assert [s.hysteresis.yield_displacement for s in drifts] == [0.015] * 3
    numbers = ([300e3] * 2, 4e8, 0.5, 1e-3, 0.05)
    listed = jp.ShearBuilding.of_storeys(*numbers, yield_force=[2e6, 1e6], hardening=0.1)
    assert listed.storeys[1].hysteresis.yield_displacement == 0.0025
    assert jp.model.base_shear_coefficient(0.39, "DCM") == pytest.approx(0.1)


def test_weights_soften_a_building_and_its_hardening():
    weak = FRAME.yielding(yield_drift=0.005, hardening=0.1, ultimate_displacement=0.3)
    under = weak.with_p_delta()
    for before, after, above in zip(weak.storeys, under.storeys, (3, 2, 1), strict=True):
        taken = above * 300e3 * 9.80665 / 3.0
        assert before.stiffness - after.stiffness == pytest.approx(taken, rel=1e-9)
        slopes = [s.stiffness * s.hysteresis.hardening for s in (before, after)]
        assert slopes[0] - slopes[1] == pytest.approx(taken, rel=1e-9)
        damping = [s.stiffness * (s.tau_x - s.tau_f) for s in (before, after)]
        assert damping[0] == pytest.approx(damping[1], rel=1e-9)


def test_a_row_that_yields_is_the_same_in_both_units():
    frame = jp.ShearBuilding.from_period(2, 300e3, period=0.4, damping_ratio=0.05)
    weak = frame.yielding(base_shear_coefficient=0.1, hardening=0.05)
    low = jp.Building.from_period(400e3, 0.3, 0.05)
    links = (jp.FloorLink(0, 0, friction=50e3, gap=0.02, contact=jp.KelvinVoigt(1e9, 0.65)),)
    t = 0.02 * np.arange(150)
    record = jp.Record(0.4 * np.sin(10 * t) * np.exp(-((t - 1.5) ** 2)), dt=0.02)
    buildings, grid = jp.Buildings((weak, low), links), jp.TimeGrid.until(2.0, 0.005)
    in_si, (row, scales) = jp.demand(buildings, record, grid), buildings.dimensionless()
    shaking = scales.to_dimensionless(record)
    by_scales = scales.to_si(jp.simulate(row, shaking, scales.grid(2.0, 0.005)))
    for name in ("ductility_1", "residual_drift_2", "dissipated_energy_1", "first_yield_time_1"):
        a, b = getattr(in_si, name), getattr(by_scales.demand, name)
        assert a == pytest.approx(float(b), rel=1e-7), name
    assert in_si.ductility_1 > 1.5
    assert in_si.n_impacts > 0
    assert in_si.rods[2].ductility is None
    energy, by_rod = by_scales.energy, in_si.flat("dissipated_energy")
    assert energy.relative_residual < 1e-2
    total = sum(float(by_rod[f"dissipated_energy_{i}"]) for i in (1, 2))
    assert energy.yielding[-1] == pytest.approx(total, rel=1e-5)


WEAK, STOREY = FRAME.yielding(yield_drift=0.005), FRAME.storeys[0]
SOFT = jp.ShearBuilding((replace(STOREY, stiffness=1e5),))
test_refused = refusals(
    (jp.Bilinear, 0.0, r"Bilinear: yield_displacement = 0 must be positive and finite"),
    (jp.Bilinear, 0.1, 1.5, r"hardening = 1.5 must be between -1 and 1"),
    (
        jp.BoucWen,
        0.1,
        0.0,
        2,
        0.5,
        0,
        0,
        0.05,
        r"ultimate_displacement = 0.05 must be at least yie",
    ),
    (jp.Bilinear, 0.1, -0.1, r"ultimate_displacement = inf must be finite where hardening is neg"),
    (jp.BoucWen, 0.1, 0.0, 0.5, r"BoucWen: exponent = 0.5 must be finite and at least 1$"),
    (jp.model.base_shear_coefficient, 0.5, "DCX", r"ductility_class = 'DCX' must be a class"),
    (FRAME.yielding, r"a strength by nothing must be by one of yield_force, base_shear"),
    (lambda: FRAME.yielding(yield_force=-1.0), r"yield_force = -1 must be between 1e-06 and"),
    (WEAK.with_p_delta, r"ultimate_displacement = inf must be finite"),
    (SOFT.with_p_delta, r"must be below 1: else the weight buckles the storey"),
)
