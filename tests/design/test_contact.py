"""Designs, elasticities and calibrations of blocks that touch."""

import dataclasses

import jax
import numpy as np
import pytest

import jaxpound as jp
from tests.refusals import refusals, refused

GRID = jp.TimeGrid(0.1, 50)
PAIR = {"friction": 0.02, "initial_gap": 0.05, "contact": jp.Newton(0.65)}
TOUCHING = dataclasses.replace(jp.paper.structures(), **PAIR)
RUNS = 62


def wave(amplitude):
    return jp.Ricker(amplitude, [2.5], [2.0])


def pair(gap, contact):
    return dataclasses.replace(TOUCHING, initial_gap=gap, contact=contact)


@jax.jit
@jax.vmap
def run(amplitude, gap, restitution):
    return jp.demand(pair(gap, jp.Newton(restitution)), wave(amplitude), GRID)


def demands(*numbers):
    """Demands by amplitude, gap and restitution; one program of as many runs serves all tests."""
    return run(*(np.resize(x, RUNS) for x in numbers))


CHOSEN_GAP = jp.DesignSpace(TOUCHING, {"initial_gap": (0.02, 0.5)})


def test_the_smallest_gap_within_a_limit_of_the_impulse():
    """Impacts are weaker the larger the gap, so that the limit decides it."""
    limit, amplitudes = 0.2, (0.25, 0.3)
    ensemble = jp.Ensemble.of([wave(a) for a in amplitudes], GRID)
    objective = jp.Objective(
        jp.design.GapAtRest(), limits={"peak_impulse": jp.design.Limit(limit, "mean")}
    )
    search = jp.DesignSearch(starts=1, iterations=40, polish=False)
    how = {"search": search, "fresh": None, "progress": False}
    found = jp.design_damper(CHOSEN_GAP, ensemble, GRID, objective=objective, **how)
    gaps = np.linspace(0.25, 0.4, 31)
    runs = demands(np.repeat(amplitudes, 31), np.tile(gaps, 2), 0.65)
    impulses = runs.peak_impulse.reshape(2, 31).mean(axis=0)
    assert (np.diff(impulses) < 0).all()
    expected = np.interp(-limit, -impulses, gaps)
    assert found.values["initial_gap"] == pytest.approx(expected, rel=0.01)
    assert found.limited_demands["peak_impulse"] <= limit * (1 + 1e-3)
    assert found.objective == pytest.approx(-found.values["initial_gap"])
    rows = found.trained.rows()
    for name in ("peak_impulse", "contact_work"):
        assert 0 < rows[name]["mean_after"] < rows[name]["mean_before"]


def test_whether_blocks_meet_does_not_depend_on_the_law():
    """So PoundingProbability, which needs the motion without one, is refused with one."""
    amplitudes, gaps = np.repeat([0.2, 0.3], 31), np.tile(np.linspace(0.25, 0.6, 31), 2)
    free = jax.jit(jax.vmap(lambda a, gap: jp.demand(pair(gap, None), wave(a), GRID)))
    passing = free(amplitudes, gaps)
    assert 12 < np.sum(passing.pounds) < 50
    np.testing.assert_array_equal(demands(amplitudes, gaps, 0.65).pounds, passing.pounds)
    ensemble, objective = jp.Ensemble.of([wave(0.3)], GRID), jp.Objective(jp.PoundingProbability())
    says = "PoundingProbability must be of structures without a law"
    refused(says, jp.design_damper, CHOSEN_GAP, ensemble, GRID, objective=objective)


def test_elasticities_by_the_gap_and_the_law_of_contact():
    found = jp.design.elasticities(TOUCHING, wave(0.3), GRID, demand="contact_work")
    h = 1e-4 * np.array([1, -1, 0, 0])
    runs = demands(0.3, 0.05 * (1 + h[::-1]), 0.65 * (1 + h))
    lost = np.log(np.asarray(runs.contact_work))
    by_restitution, by_gap = (lost[0] - lost[1]) / 2e-4, (lost[3] - lost[2]) / 2e-4
    assert found.values["contact.restitution"] == pytest.approx(by_restitution, rel=1e-3)
    assert found.values["initial_gap"] == pytest.approx(by_gap, rel=1e-3)
    assert by_restitution < 0


@pytest.mark.filterwarnings("ignore:.*the energy balance leaves")  # the steps are coarse
def test_stiffness_and_restitution_from_measured_bounces():
    """From a noisy series of the gap, and from when and how fast an instrument saw impacts."""
    truth = {"contact.stiffness": 200.0, "contact.restitution": 0.65}
    start = {"contact.stiffness": 120.0, "contact.restitution": 0.5}
    pad = dataclasses.replace(TOUCHING, contact=jp.KelvinVoigt(200.0, 0.65))
    run, random = jp.simulate(pad, wave(0.3), GRID), np.random.default_rng(0)
    noise = {"gap": 0.003, "impacts.time": 0.005, "impacts.rebound_velocity": 0.01}
    impacts = run.impacts()
    exact = {
        "gap": np.asarray(run.gap),
        "impacts.time": np.array([x.time for x in impacts]),
        "impacts.rebound_velocity": np.array([x.rebound_velocity for x in impacts]),
    }
    assert len(impacts) >= 2
    measured = {name: x + noise[name] * random.normal(size=x.size) for name, x in exact.items()}
    measured["impacts.time"][0] = np.nan
    stiffness = jp.design.Bounds(50, 800, "log")
    bounds = {"contact.stiffness": stiffness, "contact.restitution": (0.3, 1.0)}
    space = jp.DesignSpace(pad, bounds)
    found = jp.design.calibrate(
        space, measured, wave(0.3), GRID, noise=noise, start=start, starts=1
    )
    for path, value in truth.items():
        estimate = found.parameters[path]
        width = estimate.high - estimate.low
        assert abs(estimate.value - value) < width  # twice the half width: 4 standard deviations
        assert width < 0.2 * value
    assert found.residuals["impacts.time"].shape == (len(impacts),)
    assert found.noise == pytest.approx(noise, rel=1.0)
    assert "impacts.rebound_velocity" in repr(found)


BETWEEN = r"of shape \(0,\) must be \(m,\), m impacts from 1 to 50"
NAMES = r"measured\['impacts.link'\] must be one of x1, .*impulse"


def fit_impacts(structures, name, values):
    space = jp.DesignSpace(structures, {"friction": (0.01, 1.0)})
    return jp.design.calibrate(space, {name: values}, wave(0.3), GRID)


test_impacts_that_cannot_be_fitted = refusals(
    (jp.paper.structures(), "impacts.time", [1.0], "without a law of contact"),
    (TOUCHING, "impacts.time", [], BETWEEN),
    (TOUCHING, "impacts.time", np.ones(51), r"of shape \(51,\) must be \(m,\)"),
    (TOUCHING, "impacts.link", [0.0], NAMES),
    of=fit_impacts,
)
