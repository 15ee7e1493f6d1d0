"""The parameters of a law of hysteresis, calibrated to noisy cyclic tests."""

from functools import cache

import jax
import numpy as np
import pytest

import jaxpound as jp
from tests.refusals import refusals
from tests.test_tables import assert_shown

CYCLE = np.sin(np.linspace(0, 2 * np.pi, 41))[1:]
PATH = np.concatenate([[0.0], *(a * CYCLE for a in (0.05, 0.1, 0.2, 0.3))])
TRUTH = {"yield_displacement": 0.1, "hardening": 0.05, "exponent": 2.0, "beta": 0.4}
K, STD = 5.0, 0.01
FORCE = np.asarray(jp.cyclic_test(jp.BoucWen(**TRUTH), PATH, K, 1).force)
BOUNDS = {"yield_displacement": jp.Bounds(0.02, 0.4, "log"), "hardening": (0.0, 0.2)}
BOUNDS |= {"exponent": (1, 6), "beta": (0, 1)}
SPACE = jp.DesignSpace(
    jp.System((1.0,), (jp.Rod(jp.BoucWen(0.05, 0.02, 1.5, 0.6), 3.0, (0, jp.GROUND)),)),
    {f"rods.0.material.{name}": bounds for name, bounds in BOUNDS.items()}
    | {"rods.0.stiffness": (1.0, 20.0)},
)
NOISE = STD * np.random.default_rng(0).normal(size=FORCE.size)


@cache
def fitted():
    return jp.calibrate_cyclic(SPACE, PATH, FORCE + NOISE, noise={"force": STD}, starts=2)


def test_a_law_is_recovered_from_a_noisy_test_within_its_intervals():
    fit = fitted()
    (rod,) = fit.structures.rods
    for path, estimate in fit.parameters.items():
        name = path.rpartition(".")[2]
        assert estimate.low < (TRUTH | {"stiffness": K})[name] < estimate.high, name
        assert getattr(rod.material, name, rod.stiffness) == pytest.approx(estimate.value)
    assert fit.noise["force"] == pytest.approx(STD, rel=0.1)
    np.testing.assert_allclose(FORCE + NOISE - fit.response.force, fit.residuals["force"])
    shown = assert_shown(fit)
    assert str(fit.parameters["rods.0.material.beta"]) in shown
    assert "m1 g" in shown
    assert fit.at_bounds == ()


def test_intervals_cover_as_often_as_they_say():
    """By the linearised estimate: its spread over many draws of noise is what intervals state."""

    def force(numbers):
        *numbers, stiffness = numbers
        law = jp.BoucWen(**dict(zip(TRUTH, numbers, strict=True)))
        return jp.cyclic_test(law, PATH, stiffness, 1).force

    names = [path.rpartition(".")[2] for path in fitted().parameters]
    assert names == [*TRUTH, "stiffness"]
    jacobian = np.asarray(jax.jit(jax.jacfwd(force))(np.array([*TRUTH.values(), K])))
    errors = STD * np.random.default_rng(2).normal(size=(4000, FORCE.size))
    errors = errors @ np.linalg.pinv(jacobian).T
    half = np.array([(x.high - x.low) / 2 for x in fitted().parameters.values()])
    np.testing.assert_allclose((np.abs(errors) < half).mean(0), 0.95, atol=0.03)


def test_a_storey_of_a_building_is_calibrated_where_it_was_measured():
    frame = jp.ShearBuilding.from_period(2, 3e5, period=0.4, damping_ratio=0.05)
    row = jp.Buildings((frame.yielding(yield_force=9e5, hardening=0.05),))
    path = "buildings.0.storeys.1.hysteresis.yield_displacement"
    stiffness, turns = float(frame.storeys[1].stiffness), [0.0, 0.001, 0.02, -0.02, 0.02]
    force = np.array(jp.cyclic_test(jp.Bilinear(0.006, 0.05), turns, stiffness, 1).force)
    force[3] = np.nan
    space = jp.DesignSpace(row, {path: (0.001, 0.02)})
    fit = jp.calibrate_cyclic(space, turns, force, rod=1, starts=1)
    assert fit.parameters[path].value == pytest.approx(0.006, rel=1e-6)
    assert np.isnan(fit.residuals["force"][3])
    assert "N" in assert_shown(fit)


ELASTIC = jp.System((1.0,), (jp.Rod(jp.ZenerRod(0.5, 0.01, 0.05), 5.0, (0, jp.GROUND)),))
ELASTIC = jp.DesignSpace(ELASTIC, {"rods.0.stiffness": (1.0, 20.0)})
test_wrong_calibrations_are_refused = refusals(
    (SPACE, PATH, FORCE[1:], r"forces of shape \(160,\) must be \(161,\)"),
    (SPACE, PATH, np.full(PATH.size, np.inf), "forces = inf .* must be finite, or NaN"),
    (SPACE, PATH, FORCE, 1, "rod = 1 must be the number of a rod"),
    (SPACE, PATH[:4], FORCE[:4], "measured = 4 must be more numbers than the 5"),
    (SPACE, PATH + np.nan, FORCE, "cyclic_test: displacements = nan .* must be finite"),
    (ELASTIC, PATH, FORCE, "law = None must be of type HysteresisLaw"),
    of=jp.calibrate_cyclic,
)
