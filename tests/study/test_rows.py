"""Studies of a row: random storeys, the gaps of its links, pounding at any of them."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import jaxpound as jp
from jaxpound.results.named import over_all, required_gaps
from jaxpound.study.statistics import quantile
from tests.refusals import refusals, refused
from tests.rows import GAPS, GRID, ROW, WAVES, touching
from tests.storing import studied
from tests.test_tables import assert_shown

STIFFNESS = {"buildings.*.rods.*.stiffness": jp.LogNormal(20.0, 0.15)}
SCENARIOS = jp.Scenarios(jp.UncertainStructures(ROW, STIFFNESS, correlation=0.6), WAVES)


def run(n, store=None, **more):
    return studied(SCENARIOS, n, GRID, store=store, chunk_size=32, **more)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("row") / "store"


@pytest.fixture(scope="module")
def study(folder):
    return run(64, folder)


def test_gaps_and_pounding_are_those_of_one_link_or_of_any_in_a_table(study, folder):
    assert (study.n_links, study.closable_links) == (2, (0, 1))
    own = [GAPS[k] - study[f"min_gap_{k + 1}"] for k in range(2)]
    for k in range(2):
        np.testing.assert_allclose(study[f"required_gap_{k + 1}"], own[k], atol=1e-12)
        assert study.required_gap(0.2, link=k) == quantile(study[f"required_gap_{k + 1}"], 0.8)
    np.testing.assert_array_equal(study["required_gap"], np.maximum(*own))
    assert study.required_gap(0.2).value >= study.required_gap(0.2, link=1).value
    hit = [study[f"min_gap_{k + 1}"] <= 0 for k in range(2)]
    assert 0 < hit[0].sum() < (hit[0] | hit[1]).sum() < 64
    for k in range(2):
        np.testing.assert_array_equal(study.pounding(link=k) == 1, hit[k])
        assert study.pounding_probability(link=k).value == hit[k].mean()
        assert study.pounding_probability(GAPS[k], link=k).value == hit[k].mean()
    np.testing.assert_array_equal(study.pounding() == 1, hit[0] | hit[1])
    assert study.pounding_probability().value == (hit[0] | hit[1]).mean()
    wide = np.maximum(*(study[f"required_gap_{k + 1}"] for k in range(2))) >= 0.09
    assert study.pounding_probability(0.09).value == wide.mean()
    every = study.fragility("pgv")
    assert every.pounding.sum() == study.pounding().sum()
    for k in range(2):
        own = study.fragility("pgv", link=k)
        expected = jp.fit_fragility(study["pgv"], study[f"min_gap_{k + 1}"] <= 0)
        assert (own.median, own.dispersion) == (expected.median, expected.dispersion)
        assert (every.probability([0.2, 0.4]) > own.probability([0.2, 0.4])).all()
    drifts = [study[name] for name in ("peak_x1", "peak_drift_2", "peak_x3", "peak_drift_4")]
    np.testing.assert_array_equal(study["peak_drift"], np.max(drifts, axis=0))
    accelerations = [study[f"peak_acceleration_{i}"] for i in range(1, 5)]
    np.testing.assert_array_equal(study["peak_acceleration"], np.max(accelerations, axis=0))
    demand = jax.jit(jax.vmap(lambda z: jp.demand(*SCENARIOS.realize(z), GRID)))(study.points())
    np.testing.assert_allclose(demand.peak_drift, study["peak_drift"], rtol=1e-12)
    (line,) = (x for x in repr(study).splitlines() if x.split()[0] == "peak_x4")
    assert line.endswith("  peak displacement of floor 2 of building 2")
    curve = study.fragility("pgv", demand="peak_x4", threshold=np.median(study["peak_x4"]))
    assert curve.event.startswith("peak displacement of floor 2 of building 2 ≥ ")
    words = (
        "must be a pair: .*; for a row, en_1998_gap takes the quantiles of peak_x of both floors"
    )
    refused(words, study.separation, 0.1)
    assert demand.rods[1].peak_drift.shape == (64,)
    scales = jp.Scales(mass=500e3, frequency=7.0)
    for one in (study, jp.Study.open(folder)):
        in_si = dataclasses.replace(one, scales=scales)
        found = in_si.required_gaps(0.1)
        assert found.gaps[1] == in_si.required_gap(0.1, link=1)
        shown = assert_shown(found)
        assert shown[0] == "Required gap at a probability of pounding of 0.1"
        at = shown.index("1–2, floor 2")
        assert shown[at + 1] == f"{found.gaps[1].value:.4g}"
        assert "gap (m)" in shown
    # The other has: what happens there does not depend on its own gap.
    system = touching(jp.KelvinVoigt(300.0, 0.65)).system()
    lower, upper = demand.links
    peaks = ("peak_contact", "peak_impulse", "peak_penetration")
    hit = dict.fromkeys(peaks, np.ones(64))
    found = dataclasses.replace(demand, links=(lower, dataclasses.replace(upper, **hit)))
    gaps = required_gaps(system, found)
    assert [*gaps] == ["required_gap_1"]
    np.testing.assert_allclose(gaps["required_gap_1"], study["required_gap_1"], atol=1e-12)
    largest = over_all(system, found)
    assert [*largest] == ["peak_drift", "peak_acceleration", *peaks]
    np.testing.assert_array_equal(largest["peak_contact"], np.ones(64))


def test_parameters_are_correlated_by_building_or_by_a_matrix():
    z = np.random.default_rng(0).normal(size=(20_000, SCENARIOS.structures.dimension))
    drawn = jax.jit(jax.vmap(SCENARIOS.structures.parameters))(z)
    assert [*drawn] == [f"buildings.{b}.rods.{i}.stiffness" for b in range(2) for i in range(2)]
    found = np.corrcoef([np.log(x) for x in drawn.values()])
    expected = np.kron(np.eye(2), [[1, 0.6], [0.6, 1]])
    np.testing.assert_allclose(found, expected, atol=0.02)
    np.testing.assert_array_equal(SCENARIOS.structures.correlations, expected)
    for x in drawn.values():
        assert stats.kstest(np.log(x / 20.0) / 0.15, "norm").pvalue > 0.01
    uncertain = {"links.*.friction": jp.LogNormal(0.1, 0.2), "links.0.gap": jp.LogNormal(0.1, 0.2)}
    matrix = np.array([[1.0, 0.2, -0.5], [0.2, 1.0, 0.3], [-0.5, 0.3, 1.0]])
    drawn = jp.UncertainStructures(ROW, uncertain, matrix)
    z = np.random.default_rng(1).normal(size=(20_000, 3))
    made = jax.jit(jax.vmap(drawn.parameters))(z)
    found = np.corrcoef([np.log(made[path]) for path in drawn.uncertain])
    np.testing.assert_allclose(found, matrix, atol=0.02)
    alone = jp.UncertainStructures(ROW, uncertain).parameters(jnp.asarray(z[0]))
    for path, x in jp.UncertainStructures(ROW, uncertain, np.eye(3)).parameters(z[0]).items():
        np.testing.assert_allclose(x, alone[path], rtol=1e-12)


FRICTION = {"links.*.friction": jp.LogNormal(0.1, 0.2)}
test_correlations_that_cannot_be_are_named = refusals(
    (FRICTION, 1.0, "correlation = 1 must be above -1 and below 1, with 2 parameters that"),
    (FRICTION, -1.0, "correlation = -1 must be above -1 and below 1"),
    (FRICTION, "all", "correlation = 'all' must be a real number"),
    (FRICTION, np.eye(3), r"of shape \(3, 3\) must be a number, or of shape \(2, 2\): li"),
    (FRICTION, [[1.0, 0.5], [0.4, 1.0]], "must be symmetric and finite, with a diagonal of 1"),
    (FRICTION, [[2.0, 0.5], [0.5, 2.0]], "must be symmetric and finite, with a diagonal of 1"),
    (FRICTION, [[1.0, 1.0], [1.0, 1.0]], "must be positive definite, but its smallest eigenv"),
    ({"links.0.gap": jp.Uniform(0.1, 0.2)}, 0.5, "= 0.5 must not be given: no two paths"),
    ({"links.*.slip": jp.Uniform(0.1, 0.2)}, None, r"no path matches 'links\.\*\.slip'"),
    of=lambda uncertain, correlation: jp.UncertainStructures(ROW, uncertain, correlation),
    before="^UncertainStructures: .*",
)


def test_links_that_are_not_there_or_far_are_named(study, folder):
    for ask in (study.pounding_probability, study.pounding, study.fragility):
        for link in (2, -1, True, 0.0):
            refused(r"link = .* must be the number of one of the 2 l", ask, link=link)
    refused(r"^Study.required_gap: link = 5 must be", study.required_gap, 0.1, link=5)
    refused(r"^Study.pounding: gap = -1 must be finite and not negative", study.pounding, -1.0)
    lower, upper = ROW.links
    far = dataclasses.replace(ROW, links=(lower, dataclasses.replace(upper, gap=1e3)))
    with pytest.warns(
        jp.PlausibilityWarning, match=r"^monte_carlo: link 1–2, floor 2: gap = \d+\S* g/ω1²"
    ):
        studied(jp.Scenarios(far, WAVES), 16, GRID, chunk_size=32)


def test_sensitivities_of_random_storeys():
    uncertain = jp.UncertainStructures(ROW, STIFFNESS, correlation=0.9)
    scenarios = jp.Scenarios(uncertain, jp.Ricker(0.2, [2.0], [1.5]))
    found = jp.study.sobol_sensitivity(scenarios, GRID, demand="peak_drift", n=64)
    assert [*found.first] == [*uncertain.uncertain]
    total = {path: x.value for path, x in found.total.items()}
    # The second storey of a building has little that the first does not tell.
    for b in range(2):
        first, second = (total[f"buildings.{b}.rods.{i}.stiffness"] for i in range(2))
        assert first > 3 * second > 0
