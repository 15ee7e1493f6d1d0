"""Limits on the probability of rare events: designs against plain Monte Carlo and known ones."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from jaxpound.design.problem import LogRatios, RareEstimates
from jaxpound.design.rare_limits import TrustRegion, updated_curvatures
from jaxpound.design.run import InfeasibleError
from tests.design.searches import in_search
from tests.made import in_si
from tests.refusals import refusals
from tests.reliability import case_w

N, DT = 60, 0.15
GRID = jp.TimeGrid.until(9.0, dt=DT)
PAPER = jp.paper.structures()
TIMES = DT * np.arange(N)
SMOOTH = np.exp(-0.5 * (np.subtract.outer(TIMES, TIMES) / 0.3) ** 2)
SMOOTH *= 0.12 * np.sin(0.4 * TIMES)[:, None]


def ground(z):
    return jp.Record(jnp.asarray(SMOOTH, z.dtype) @ z, DT, time_unit="1/ω1")


RODS = jp.UncertainStructures(PAPER, {"rod_1.tau_x": jp.LogNormal(PAPER.rod_1.tau_x, 0.2)})
SCENARIOS = jp.Scenarios(RODS, jp.CustomDraw(ground, N))
ENSEMBLE = jp.Ensemble.drawn(SCENARIOS, 4)
SPACE = jp.DesignSpace(PAPER, {"friction": (0.05, 1.0), "initial_gap": (0.02, 2.0)})
SHORT = {"starts": 1, "iterations": 40, "fresh": None, "progress": False}
SELDOM = 2e-3
NEAR = {"friction": 0.3, "initial_gap": 0.2}


def objective(**limit):
    """The narrowest gap; dampers have a price."""
    return jp.Objective(
        jp.design.GapAtRest(), {"damper_force": 0.5}, {"required_gap": jp.design.Limit(**limit)}
    )


def designed(goal, space=SPACE, ensemble=ENSEMBLE, grid=GRID, **more):
    return jp.design_damper(space, ensemble, grid, objective=goal, **in_search(SHORT | more))


@pytest.fixture(scope="module")
def narrow(tmp_path_factory):
    """The cheapest gap and damper that pound once in five hundred earthquakes, and its file."""
    save = tmp_path_factory.mktemp("narrow") / "search.npz"
    return designed(objective(probability=SELDOM), save=save, start=NEAR), save


def test_the_design_pounds_as_seldom_as_wanted_and_is_an_optimum(narrow):
    design, _ = narrow
    reached = design.limited_demands["required_gap"]
    assert reached == design.events["required_gap"].probability
    assert reached == pytest.approx(SELDOM, rel=0.1)
    random = dataclasses.replace(RODS, nominal=design.structures)
    scenarios = jp.Scenarios(random, jp.CustomDraw(ground, N))
    run = jp.runtime.in_chunks(
        lambda z: jp.demand(*scenarios.realize(z), GRID, only=["min_gap"]).min_gap
    )
    z = np.random.default_rng(7).normal(size=(60_000, scenarios.dimension))
    share = np.mean(run(z) <= 0)
    assert share == pytest.approx(reached, abs=4 * np.sqrt(share / 60_000) + 0.05 * reached)
    # First-order conditions: the prices of gap and friction are in the ratio of slopes of ln P.
    event = design.events["required_gap"]
    assert 0.05 < design.values["friction"] < 1.0
    friction, gap = event.slopes_by(("friction", "initial_gap")).values()  # as the search has them
    error = abs(friction.error / gap.value) + abs(friction.value * gap.error / gap.value**2)
    assert friction.value / gap.value == pytest.approx(0.5, abs=0.05 + 3 * error)
    assert design.multipliers["required_gap"] == pytest.approx(-1 / gap.value, rel=0.15)
    assert "P(pounding)" in str(design)
    assert "round" in design.stopped


def test_a_stopped_search_goes_on(narrow, monkeypatch):
    design, save = narrow

    def run(*_):
        raise AssertionError("an estimate that is kept needs no run")

    monkeypatch.setattr(jp.LimitState, "values_and_times", run)
    again = designed(objective(probability=SELDOM), save=save, start=NEAR)
    assert (again.values, again.limited_demands) == (design.values, design.limited_demands)


def test_a_landscape_knows_the_probability_at_the_design(narrow):
    design, _ = narrow
    log_ratio = np.log(design.limited_demands["required_gap"] / SELDOM)
    drawn = design.landscape("friction", "initial_gap", n=5)
    assert np.isfinite(drawn.violation).all()
    assert drawn.violation.min() < log_ratio < drawn.violation.max()
    friction, gap = drawn.x_values, drawn.y_values
    distance = abs(friction - design.values["friction"]) + abs(gap - design.values["initial_gap"])
    near = np.unravel_index(distance.argmin(), distance.shape)
    shares = SPACE.shares({"friction": friction[near], "initial_gap": gap[near]})
    model = design._log_ratios.at(shares)
    assert drawn.violation[near] == pytest.approx(float(model[0]))


def test_the_least_damper_for_one_in_ten_millions_of_a_gap_in_metres():
    """Known from Newton's method on independent samples: a friction of 0.3075."""
    scales = jp.Scales(mass=1e5, frequency=5.0)
    closing = 0.645 * float(scales.length)
    seldom = {"required_gap": jp.design.Limit(closing, probability=1e-7)}
    goal = jp.Objective(jp.design.LeastDemand("damper_force"), limits=seldom)
    pair = in_si(PAPER, scales)
    unit, dt = float(scales.force), case_w.DT * float(scales.time)
    space = jp.DesignSpace(pair, {"links.0.friction": (0.05 * unit, unit)})

    def in_seconds(z):
        return jp.Record(jnp.asarray(case_w.MATRIX, z.dtype) @ z, dt)

    scenarios = jp.Scenarios(pair, jp.CustomDraw(in_seconds, case_w.N))
    grid = jp.TimeGrid.until(4.0, dt)
    design = designed(goal, space, jp.Ensemble.drawn(scenarios, 2), grid)
    assert design.values["links.0.friction"] / unit == pytest.approx(0.3075, abs=0.004)
    in_newtons = -unit / case_w.SLOPE
    assert design.multipliers["required_gap"] == pytest.approx(in_newtons, rel=0.1)
    event = design.events["required_gap"]
    assert event.limit_state.threshold == pytest.approx(closing)
    assert design.limited_demands["required_gap"] == event.probability


def test_no_design_is_rare_enough():
    space = jp.DesignSpace(PAPER, {"friction": (0.2, 0.3), "initial_gap": (0.1, 0.2)})
    start = {"friction": 0.25, "initial_gap": 0.15}
    with pytest.raises(InfeasibleError, match=r"P\(pounding\) = .*above its limit"):
        designed(objective(probability=1e-9), space, iterations=10, start=start)


GIVEN = jp.Ensemble.of([jp.paper.ground()], GRID)


def design_with(demand, probability, ensemble):
    limits = {demand: jp.design.Limit(0.5, probability=probability)}
    return designed(jp.Objective(jp.design.GapAtRest(), limits=limits), ensemble=ensemble)


test_limits_that_cannot_be_estimated = refusals(
    ("required_gap", 1e-3, GIVEN, "required_gap: a probability needs an ensemble that is drawn"),
    ("required_gap", 1e-13, ENSEMBLE, "required_gap: probability = 1e-13 must be at least 1e-12"),
    ("damper_force", 1e-3, ENSEMBLE, "damper_force: unknown demand 'damper_force'"),
    of=design_with,
)


def test_curvatures_make_slopes_those_of_both_designs():
    hessian = np.array([[[4.0, 1.0], [1.0, 3.0]]])
    places = np.array([[0.0, 0.0], [0.3, 0.1], [0.2, 0.5]])
    slopes = np.einsum("kij,nj->nki", hessian, places)
    both = zip(places, slopes, strict=True)
    at = [LogRatios(place, np.zeros(1), slope, np.zeros((1, 2, 2))) for place, slope in both]
    curvature = updated_curvatures(at[0], at[1])
    np.testing.assert_allclose(curvature[0] @ (places[1] - places[0]), (slopes[1] - slopes[0])[0])
    assert np.linalg.eigvalsh(curvature[0]).min() > -1e-12
    # A concave function is taken as linear, and so are designs that are nearly the same.
    assert not updated_curvatures(at[0], at[1]._replace(slopes=-slopes[1])).any()
    nearly = at[0]._replace(scaled=places[0] + 1e-3, slopes=slopes[1])
    assert not updated_curvatures(at[0], nearly).any()


def estimate(place, value, slope):
    """One event: ln(P/p) and its slope at a design of one variable."""
    numbers = (np.array(x) for x in ([place], [value], [[slope]], [[[0.0]]]))
    return RareEstimates({}, LogRatios(*numbers))


def test_a_trust_region_follows_its_model():
    region = TrustRegion(estimate(0.5, 4.0, -10.0))
    np.testing.assert_array_equal(region.box, [[0.0], [1.0]])
    assert region.model.values[0] < 4.0  # a round does not aim at more than the model can say
    # ln(P/p) is 3 where the model has 0: the step is rejected, and the box is half of it.
    assert not region.accepts(estimate(0.9, 3.0, -1.0))
    np.testing.assert_allclose(region.box, [[0.3], [0.7]])
    # A step to the end of the box, as predicted, widens it.
    assert region.accepts(estimate(0.7, 2.0, -10.0))
    np.testing.assert_allclose(region.box, [[0.3], [1.0]])
    # A step back is an oscillation: the box shrinks to half of it.
    assert region.accepts(estimate(0.6, 2.5, -10.0))
    np.testing.assert_allclose(region.box, [[0.55], [0.65]])
