"""Studies of a general system: two storeys beside one, with a link between them."""

import dataclasses

import jax
import numpy as np

import jaxpound as jp
from jaxpound.model.system import common_gap
from tests.refusals import refused
from tests.storing import studied

STEEL = jp.ZenerRod(0.5, 0.01, 0.05)
GRID = jp.TimeGrid(0.1, 40)
ENDS = {(0, jp.GROUND): 20.0, (1, 0): 20.0, (2, jp.GROUND): 30.0}
RODS = tuple(jp.Rod(STEEL, stiffness, ends) for ends, stiffness in ENDS.items())
SYSTEM = jp.System((1.0, 1.0, 0.8), RODS, (jp.Link((1, 2), 0.1, 0.1),))
OPEN = dataclasses.replace(SYSTEM, links=(jp.Link((1, 2), 0.1),))


def wave(z):
    return jp.Ricker(0.1 + 0.02 * z[0] + 0.01 * z[1], [2.0], [1.5])


def scenarios(system):
    return jp.Scenarios(system, jp.CustomDraw(wave, 2))


def study(system, **more):
    return studied(scenarios(system), 8, GRID, chunk_size=4, **more)


def linked(*gaps):
    masses = range(2 * len(gaps))
    rods = tuple(jp.Rod(STEEL, 1.0, (i, jp.GROUND)) for i in masses)
    links = tuple(jp.Link((2 * i, 2 * i + 1), 0.1, gap) for i, gap in enumerate(gaps))
    return jp.System((1.0,) * len(masses), rods, links)


def test_the_gap_at_rest_is_one_finite_number_or_none():
    for gaps in ((0.3,), (0.3, 0.3), (0.3, np.inf)):
        assert common_gap(linked(*gaps)) == 0.3
    without = dataclasses.replace(SYSTEM, links=())
    for system in (linked(0.3, 0.4), linked(np.inf), without):
        assert common_gap(system) is None
    seen = []
    for gaps_of in (lambda x: (x,), lambda x: (x, x), lambda x: (x, 0.3)):
        jax.eval_shape(lambda x, of=gaps_of: seen.append(common_gap(linked(*of(x))) is x), 0.3)
    jax.eval_shape(lambda x: seen.append(common_gap(linked(x, 0.3)) is None), 0.3)
    assert seen == [True, True, False, True]
    assert common_gap(jp.paper.structures()) == 1.0


def test_a_study_of_a_system_is_kept_in_a_store(tmp_path):
    names = ("amplitude", "file", "allow_pickle", "self")  # NumPy has a meaning for three of them
    measures = dict.fromkeys(names, lambda structures, ground: ground.amplitude)
    found = study(SYSTEM, store=tmp_path, keep_parameters=True, measures=measures)
    run = jax.jit(jax.vmap(lambda z: jp.demand(*scenarios(SYSTEM).realize(z), GRID)))
    demands, z = run(found.points()), found.points()
    over_all = ("peak_drift", "peak_acceleration", "required_gap")
    assert list(found.columns) == [*demands.scalars(), *over_all, *names, "z_1", "z_2"]
    np.testing.assert_allclose(found["amplitude"], 0.1 + 0.02 * z[:, 0] + 0.01 * z[:, 1])
    np.testing.assert_array_equal([*found.parameters().values()], z.T)
    for name, values in demands.scalars().items():
        np.testing.assert_allclose(found[name], values, rtol=1e-9, atol=1e-12, err_msg=name)
    np.testing.assert_allclose(found["required_gap"], 0.1 - demands.min_gap, rtol=1e-9)
    opened = jp.Study.open(tmp_path)
    for name in ("peak_x3", *names):
        np.testing.assert_array_equal(opened[name], found[name])
    assert opened["min_gap"].shape == (8,)
    assert opened.pounding_probability() == opened.pounding_probability(0.1)
    refused(r"Study.separation: structures must be a pair", opened.separation, 0.1)


def test_links_without_a_gap_fail_nothing_and_have_no_sensitivities(tmp_path):
    found = study(OPEN, store=tmp_path)
    assert found.failed == 0
    assert (found["min_gap"] == np.inf).all()
    assert found.pounding_probability().value == 0
    assert "required_gap" not in found.columns
    np.testing.assert_array_equal(study(OPEN, store=tmp_path)["peak_x1"], found["peak_x1"])
    for ask in (lambda: found.pounding_probability(0.1), lambda: found.required_gap(0.1)):
        refused("column 'required_gap' must be one of min_gap", ask)
    found = jp.study.sobol_sensitivity(scenarios(SYSTEM), GRID, n=4)
    assert (found.demand, [*found.first]) == ("required_gap", ["z_1", "z_2"])
    one = jp.Scenarios(SYSTEM, jp.CustomDraw(lambda z: wave([z[0], 0.0]), 1))
    for drawn, more, message in (
        (scenarios(OPEN), {}, r"one of min_gap, .*: there is no required gap unless"),
        (scenarios(OPEN), {"demand": "min_gap"}, "min_gap must be finite, but there is no gap"),
        (one, {}, r"scenarios.dimension = 1 must be at least 2"),
    ):
        refused(message, jp.study.sobol_sensitivity, drawn, GRID, n=4, **more)
