"""Known parameters, found again from noisy motion."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from tests.pickled import assert_survives_pickling
from tests.refusals import refusals
from tests.test_tables import assert_shown

GRID = jp.TimeGrid.until(14.0, 0.05)
TRUTH, GROUND = jp.paper.structures(), jp.paper.ground()
VARIABLES = {"friction": (0.05, 1.0), "rod_1.order": (0.05, 0.9)}
SPACE = jp.DesignSpace(TRUTH, VARIABLES | {"rod_1.tau_x": jp.design.Bounds(0.2, 10.0, "log")})
VALUES = {"friction": 0.25, "rod_1.order": 0.23, "rod_1.tau_x": 1.183}
START = {"friction": 0.6, "rod_1.order": 0.5, "rod_1.tau_x": 3.0}
STD = {"x1": 0.01, "a2": 0.05}


@functools.cache
def run():
    return jp.simulate(TRUTH, GROUND, GRID)


def measured(seed):
    random = np.random.default_rng(seed)
    series = {"x1": run().x1, "a2": run().absolute_accelerations[1]}
    return {k: np.asarray(x) + STD[k] * random.normal(size=x.size) for k, x in series.items()}


@functools.cache
def calibrated():
    return jp.design.calibrate(SPACE, measured(0), GROUND, GRID, start=START, starts=2, noise=STD)


def test_known_parameters_are_found_within_their_intervals():
    """From a start far off; the true values are in 95 % intervals, and these are narrow."""
    found = calibrated()
    for path, value in VALUES.items():
        estimate = found.parameters[path]
        assert estimate.low < value < estimate.high, path
        assert estimate.high - estimate.low < 0.1 * value
    assert found.noise == pytest.approx(STD, rel=0.15)
    assert_survives_pickling(found)
    assert found.structures.rod_2.tau_x == TRUTH.rod_2.tau_x
    np.testing.assert_allclose(np.diag(found.correlation), 1)
    left = measured(0)["x1"] - np.asarray(found.response.x1)
    np.testing.assert_allclose(found.residuals["x1"], left)
    shown = assert_shown(found)
    assert str(found.parameters["friction"]) in shown
    at = shown.index("x1")
    assert shown[at + 1 : at + 3] == [f"{found.noise['x1']:.4g}", "g/ω1²"]
    assert found.at_bounds == ()


def test_intervals_cover_as_often_as_they_say():
    """By the linearised estimate: its spread over many draws of noise is what intervals state."""
    half = np.array([(x.high - x.low) / 2 for x in calibrated().parameters.values()])

    def series(values):
        structures = SPACE.structures(values)
        run = jp.simulate(structures, GROUND, GRID)
        return jnp.concatenate([run.x1 / 0.01, run.absolute_accelerations[1] / 0.05])

    shares = SPACE.shares(TRUTH)
    jacobian = np.asarray(jax.jit(jax.jacfwd(series))(shares))
    to = jax.jit(jax.jacfwd(lambda s: jnp.stack(list(SPACE.values(s).values()))))(shares)
    noise = np.random.default_rng(2).normal(size=(4000, len(jacobian)))
    errors = noise @ np.linalg.pinv(jacobian).T @ np.asarray(to).T
    covered = (np.abs(errors) < half).mean(axis=0)
    np.testing.assert_allclose(covered, 0.95, atol=0.02)


def test_missing_numbers_and_unknown_noise():
    """In SI units: ``test_buildings.py``."""
    x1 = np.array(measured(0)["x1"])
    x1[::3] = np.nan
    found = jp.design.calibrate(SPACE, {"x1": x1}, GROUND, GRID, starts=1)
    assert found.noise["x1"] == pytest.approx(0.01, rel=0.15)
    assert np.isnan(found.residuals["x1"][::3]).all()
    for path, value in VALUES.items():
        assert found.parameters[path].value == pytest.approx(value, rel=0.1)


TRACELESS = jp.DesignSpace(TRUTH, {"friction": (0.1, 1.0), "initial_gap": (0.5, 2.0)})
COARSE = {"grid": jp.TimeGrid(0.5, 30), "measured": {"x1": np.zeros(31)}, "strict": True}
HIDDEN = {"space": TRACELESS, "starts": 1}


def changed(change):
    standard = {"space": SPACE, "measured": measured(0), "ground": GROUND, "grid": GRID}
    return jp.design.calibrate(**(standard | change))


test_bad_calibrations_are_named = refusals(
    ({"measured": {}}, "must hold a series"),
    ({"measured": {"x3": np.zeros(281)}}, r"measured\['x3'\] must be one of x1, x2"),
    ({"measured": {"x1": np.zeros(280)}}, r"of shape \(280,\) must be \(281,\)"),
    ({"measured": {"x1": np.full(281, np.inf)}}, "must be finite, or NaN for no number"),
    ({"measured": {"x1": np.r_[0.0, np.full(280, np.nan)]}}, "measured = 1 must be more"),
    ({"noise": {"a2": 0.1}}, "noise lacks 'x1'"),
    ({"noise": {"x1": 0.0, "a2": 1.0}}, r"noise\['x1'\] = 0 must be positive"),
    ({"start": {"friction": 2.0}}, "calibrate: start: design lacks 'rod_1.order'"),
    ({"confidence": 1.0}, "confidence = 1 must be between 0 and 1"),
    ({"starts": 0}, "starts = 0 must be a positive"),
    ({"noise": {"x1": "a", "a2": 1.0}}, r"noise\['x1'\] = 'a' must be a real number"),
    # Parameters that leave no trace; before the fit, what the grid does not resolve.
    (HIDDEN, "must determine all of friction, initial_gap"),
    (COARSE, r"^calibrate: ground: the shortest of periods is"),
    of=changed,
)


def test_a_parameter_at_its_bound_is_named():
    space = jp.DesignSpace(TRUTH, {"friction": (0.3, 1.0)})
    series, more = {"x1": measured(0)["x1"]}, {"noise": {"x1": 0.01}, "start": {"friction": 0.5}}
    found = jp.design.calibrate(space, series, GROUND, GRID, starts=1, **more)
    assert found.at_bounds == ("friction",)
    assert "friction is at a bound: its interval means nothing" in assert_shown(found)


CYCLE = np.sin(np.linspace(0, 2 * np.pi, 41))[1:]
PATH = np.concatenate([[0.0], *(a * CYCLE for a in (0.05, 0.1, 0.2, 0.3))])
LAW = {"yield_displacement": 0.1, "hardening": 0.05, "exponent": 2.0, "beta": 0.4}
FORCE = np.asarray(jp.study.cyclic_test(jp.BoucWen(**LAW), PATH, 5.0, 64).force)[::64]
BOUNDS = {"yield_displacement": jp.design.Bounds(0.02, 0.4, "log"), "hardening": (0.0, 0.2)}
BOUNDS |= {"exponent": (1, 6), "beta": (0, 1)}
BOUNDS = {f"material.{name}": bounds for name, bounds in BOUNDS.items()} | {"stiffness": (1, 20)}
YIELDING = jp.System((1.0,), (jp.Rod(jp.BoucWen(0.05, 0.02, 1.5, 0.6), 3.0, (0, jp.GROUND)),))
ROD = jp.DesignSpace(YIELDING, {f"rods.0.{name}": bounds for name, bounds in BOUNDS.items()})
NOISE = 0.01 * np.random.default_rng(0).normal(size=FORCE.size)


def test_a_law_is_recovered_from_a_noisy_test_within_its_intervals():
    fit = jp.design.calibrate_cyclic(ROD, PATH, FORCE + NOISE, noise={"force": 0.01}, starts=2)
    (rod,) = fit.structures.rods
    for path, estimate in fit.parameters.items():
        name = path.rpartition(".")[2]
        assert estimate.low < (LAW | {"stiffness": 5.0})[name] < estimate.high, name
        assert getattr(rod.material, name, rod.stiffness) == pytest.approx(estimate.value)
    assert fit.noise["force"] == pytest.approx(0.01, rel=0.1)
    np.testing.assert_allclose(FORCE + NOISE - fit.response.force, fit.residuals["force"])
    assert {str(fit.parameters["rods.0.material.beta"]), "of the test"} <= {*assert_shown(fit)}


def test_a_storey_of_a_building_is_calibrated_where_it_was_measured():
    frame = jp.ShearBuilding.from_period(2, 3e5, period=0.4, damping_ratio=0.05)
    row = jp.Buildings((frame.yielding(yield_force=9e5, hardening=0.05),))
    path = "buildings.0.storeys.1.hysteresis.yield_displacement"
    stiffness, turns = float(frame.storeys[1].stiffness), [0.0, 0.001, 0.02, -0.02, 0.02]
    force = np.array(jp.study.cyclic_test(jp.Bilinear(0.006, 0.05), turns, stiffness, 1).force)
    force[3] = np.nan
    space = jp.DesignSpace(row, {path: (0.001, 0.02)})
    fit = jp.design.calibrate_cyclic(space, turns, force, rod=1, starts=1)
    assert fit.parameters[path].value == pytest.approx(0.006, rel=1e-6)
    assert np.isnan(fit.residuals["force"][3])


test_wrong_calibrations_are_refused = refusals(
    (ROD, PATH, FORCE[1:], r"forces of shape \(160,\) must be \(161,\)"),
    (ROD, PATH, FORCE, 1, "rod = 1 must be the number of a rod"),
    (ROD, PATH + np.nan, FORCE, "calibrate_cyclic: displacements = nan .* must be finite"),
    (SPACE, PATH, FORCE, "law = None must be of type HysteresisLaw"),
    of=jp.design.calibrate_cyclic,
)
