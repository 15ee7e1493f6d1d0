"""Whose errors and warnings they are, and that errors survive a copy and another process."""

import concurrent.futures
import copy
import functools
import pickle

import jax
import pytest

import jaxpound as jp
from jaxpound import _errors
from tests.refusals import refused

ROD = jp.ZenerRod(0.5, 0.1, 2.0)
WAVELET = jp.RandomRicker(1, jp.LogNormal(0.1, 0.5), jp.Uniform(1.0, 3.8), jp.Uniform(1.0, 7.0))
GRID = jp.TimeGrid.until(8.0, dt=0.1)


SCENARIOS = jp.Scenarios(jp.paper.structures(), WAVELET)


def owner_of(call):
    with pytest.raises(jp.InvalidInput) as caught:
        call()
    return caught.value.owner


def test_an_error_is_that_of_the_function_method_or_class_that_was_called():
    structures, rest = jp.paper.structures(), jp.Ricker(0.1, 1.0, 2.0)
    study = jp.monte_carlo(SCENARIOS, 2, GRID, progress=False)
    for owner, call in {
        "simulate": lambda: jp.simulate(structures, None, GRID),
        "TimeGrid": lambda: jp.TimeGrid(2.5, 0.1),
        "TimeGrid.until": lambda: jp.TimeGrid.until("x", 0.1),  # a class method
        "ZenerRod.damping_ratio": lambda: ROD.damping_ratio(mass=-1.0),  # by another method
        "Study.exceedance": lambda: study.exceedance("required_gap", "x"),  # inherited
        "Study": lambda: study["a column"],  # an operator
        "Link": lambda: jp.Link((0, 1), friction=-1.0),
        "KelvinVoigt": lambda: jp.KelvinVoigt(1.0, 2.0),  # its class checks more than its fields
        "Ricker": lambda: rest / "x",  # an operator
    }.items():
        assert owner_of(call) == owner


def test_of_functions_the_outermost_is_named_and_of_constructors_the_innermost():
    frame = jp.ShearBuilding.from_period(2, 3e5, 0.5, 0.05)
    assert owner_of(lambda: jp.pushover(frame)) == "pushover"
    assert owner_of(lambda: jp.tuned_mass_damper(frame, -0.1)) == "tuned_mass_damper"
    call = functools.partial(jp.ShearBuilding.of_storeys, [3e5, 3e5], [1e8, -1e8], 0.5, 0.1, 0.1)
    assert owner_of(call) == "ShearBuilding.of_storeys: storeys.1"  # the part of a renamed error


def test_a_function_of_the_users_own_ends_the_search():
    def draw(z):
        return jp.Ricker(0.1, jp.spectral_acceleration("x", period=1.0), z[0])

    scenarios = jp.Scenarios(jp.paper.structures(), jp.scenarios.CustomDraw(draw, 1))
    call = functools.partial(jp.monte_carlo, scenarios, 2, GRID, progress=False)
    assert owner_of(call) == "spectral_acceleration"


def test_transformations_of_jax_do_not_end_it():
    initial = jp.InitialState((0.0,), (0.0,))

    def gap(friction):
        structures = jp.AdjacentStructures(ROD, ROD, 1.0, 4.0, friction, 1.0)
        return jp.demand(structures, jp.Ricker(0.1, 1.0, 2.0), GRID, initial=initial).min_gap

    for transformed in (jax.jit(gap), jax.grad(gap)):
        assert owner_of(functools.partial(transformed, 0.1)) == "demand"


def test_a_users_own_error_has_no_owner_and_an_inner_class_is_its_callers():
    assert owner_of(lambda: throw(jp.InvalidInput("stiffness", "-1", "must be positive"))) == ""
    assert (
        owner_of(lambda: jp.rare_event(SCENARIOS, GRID, demand="foo", threshold=1.0))
        == "rare_event"
    )


def throw(error):
    raise error


def test_the_command_line_names_its_files_itself():
    code = compile("def call(): jp.TimeGrid.until('x', 1)", "main.py", "exec")
    names = {"__name__": "jaxpound.cli.main", "jp": jp}
    exec(code, names)
    assert owner_of(names["call"]) == "jaxpound"


def test_errors_are_copied_pickled_and_come_from_other_processes_whole():
    error = _errors.InvalidInput("mass", "-1", "must be positive", owner="Building")
    for same in (copy.copy(error), pickle.loads(pickle.dumps(error))):
        assert (str(same), same.owner) == ("Building: mass = -1 must be positive", "Building")
    with concurrent.futures.ThreadPoolExecutor() as pool:
        future = pool.submit(jp.Link, (0, 1), friction=-1.0)
        refused("^Link: friction = -1 must be", future.result)
