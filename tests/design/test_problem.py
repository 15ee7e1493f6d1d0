"""Designs of general systems: what is priced, and which structures are taken."""

import dataclasses

import jax
import numpy as np
import pytest

import jaxpound as jp
from jaxpound.design.problem import DesignProblem
from jaxpound.results.named import LIMITABLE_OF_PAIR, limitable_demands
from tests.refusals import refused
from tests.study.test_demands import GRID, OPEN, SYSTEM, linked

ENSEMBLE = jp.Ensemble.of([jp.Ricker(a, [2.0], [1.5]) for a in (0.08, 0.1)], GRID)
FRICTION = {"links.0.friction": (0.0, 1.0)}


def problem(system, variables=FRICTION, **objective):
    space = jp.DesignSpace(system, variables)
    return DesignProblem(space, ENSEMBLE, GRID, jp.Scheme(), jp.Objective(**objective))


def test_prices_are_those_that_the_system_has():
    paper = jp.paper.structures()
    largest = {"peak_contact", "peak_impulse", "peak_penetration"}
    of_contact = largest | {"contact_work", "soft_peak_contact"}
    without = problem(paper, {"friction": (0.0, 1.0)}).limitable
    assert {"damper_force", "peak_x2", "peak_f2", "slip_distance"} <= {*without}
    assert not of_contact & {*without}
    touching = dataclasses.replace(paper, contact=jp.Newton(0.65))
    assert problem(touching, {"contact.restitution": (0.5, 0.8)}).limitable == LIMITABLE_OF_PAIR
    assert {*LIMITABLE_OF_PAIR} - {*without} == of_contact
    several = limitable_demands(linked(0.3, 0.3))
    assert {"peak_x4", "peak_f4", "slip_distance_2"} <= {*several}
    assert {"damper_force_1", "damper_force_2", "total_damper_force"} <= {*several}
    assert not {"damper_force", "slip_distance", "peak_x5", "peak_drift"} & {*several}
    first, second = linked(0.3, 0.3).links
    second = dataclasses.replace(second, contact=jp.Newton(0.65))
    mixed = dataclasses.replace(linked(0.3, 0.3), links=(first, second))
    own = {f"{name}_2" for name in {*LIMITABLE_OF_PAIR} - {*without}}
    assert {*limitable_demands(mixed)} - {*several} == own | largest
    assert {"peak_drift", "peak_acceleration"} <= {*limitable_demands(SYSTEM)}
    every = limitable_demands(mixed)
    assert [*jp.Objective(limits=dict.fromkeys(every, 1.0)).limits] == [*every]


def test_a_system_is_designed():
    objective = jp.Objective(penalties={"peak_x3": 0.1}, limits={"damper_force": 0.7})
    search = jp.DesignSearch(starts=1, iterations=2, polish=False)
    how = {"search": search, "fresh": None, "progress": False}
    space = jp.DesignSpace(SYSTEM, FRICTION)
    found = jp.design_damper(space, ENSEMBLE, GRID, objective=objective, **how)
    (friction,) = found.values.values()
    assert found.structures.links[0].friction == friction
    runs = [jp.demand(found.structures, ENSEMBLE.ground(i), GRID) for i in range(2)]
    after = found.trained.after
    assert list(after) == ["min_gap", "initial_gap", *limitable_demands(SYSTEM)]
    for name in ("min_gap", "peak_x3", "peak_f2", "slip_distance"):
        wanted = [getattr(run, name) for run in runs]
        np.testing.assert_allclose(after[name], wanted, rtol=1e-9, err_msg=name)
    np.testing.assert_allclose(after["damper_force"], friction)
    np.testing.assert_allclose(after["initial_gap"], 0.1)
    wanted = [abs(run.residual_offset) for run in runs]
    np.testing.assert_allclose(after["residual_offset"], wanted, rtol=1e-9)


NO_LINK = dataclasses.replace(SYSTEM, links=()), {"masses.0": (0.5, 1.0)}


@pytest.mark.parametrize(("system", "variables"), [(OPEN, FRICTION), NO_LINK])
def test_without_a_gap_a_goal_of_gaps_is_refused(system, variables):
    for goal in (jp.SmallestGap(), jp.design.GapAtRest(), jp.PoundingProbability()):
        named = rf"goal = {type(goal).__name__}\(.*\) must not be of gaps"
        refused(f"^DesignProblem: objective: {named}", problem, system, variables, goal=goal)
    posed = problem(system, variables, goal=jp.design.LeastDemand("peak_drift"))
    assert posed.columns == posed.limitable
    assert {*jax.eval_shape(posed.demands, system, ENSEMBLE.ground(0))} == {*posed.columns}
    says, goal = (
        "objective: 'peak_contact' in goal must be of structures with a contact law",
        jp.design.LeastDemand("peak_contact"),
    )
    refused(says, problem, system, variables, goal=goal)


def test_a_probability_at_one_gap_is_refused_where_gaps_differ_or_one_is_chosen():
    goal = jp.PoundingProbability(0.3)
    says = "^DesignProblem: objective: PoundingProbability: gap mu"
    chosen = linked(0.3, 0.3), {"links.1.gap": (0.1, 1.0)}
    for system, variables in ((linked(0.3, 0.4), FRICTION), chosen):
        assert problem(system, variables, goal=jp.PoundingProbability()).columns[1] == "min_gap_1"
        refused(says, problem, system, variables, goal=goal)
    problem(linked(0.3, 0.3), FRICTION, goal=goal)


def test_prices_that_the_structures_lack_are_refused():
    rule = r"'damper_force' in limits must be one of damper_force_1, .*friction_work_2"
    rule = f"^DesignProblem: objective: {rule}"
    refused(rule, problem, linked(0.3, 0.3), limits={"damper_force": 1.0})
    refused("'peak_x4' in penalties must be one of", problem, SYSTEM, penalties={"peak_x4": 1.0})
    by_newton = dataclasses.replace(linked(0.3, 0.3).links[0], contact=jp.Newton(0.6))
    meeting = dataclasses.replace(SYSTEM, links=(by_newton,))
    says = "'peak_contact' in limits must not be by Newton's law, .* peak_impulse is what they have"
    refused(says, problem, meeting, limits={"peak_contact": 1.0})
    assert problem(meeting, limits={"peak_impulse": 1.0}).limitable
