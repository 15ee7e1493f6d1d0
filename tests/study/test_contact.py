"""Studies of blocks that touch: how often, how hard, and which parameter of the law matters."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import jaxpound as jp
from jaxpound.study import sensitivity
from jaxpound.study.chunk import Task
from jaxpound.study.statistics import quantile
from tests.refusals import refused
from tests.storing import studied

TOUCHING = dataclasses.replace(
    jp.paper.structures(), friction=0.02, initial_gap=0.03, contact=jp.Newton(0.65)
)
GRID = jp.TimeGrid(0.1, 80)
WAVES = jp.RandomRicker(2, jp.LogNormal(0.03, 0.7), jp.Uniform(1.5, 4.0), jp.Uniform(1.0, 5.0))
RESTITUTION = {"contact.restitution": jp.Uniform(0.4, 0.9)}
SCENARIOS = jp.Scenarios(jp.UncertainStructures(TOUCHING, RESTITUTION), WAVES)


@pytest.fixture(scope="module")
def study():
    return studied(SCENARIOS, 64, GRID, chunk_size=32, keep_parameters=True)


def test_times_and_numbers_of_impacts_are_told_of_scenarios_with_one(study):
    hit = study["n_impacts"] > 0
    assert 0 < hit.sum() < hit.size
    assert study.failed == 0
    first = study["first_impact_time"]
    np.testing.assert_array_equal(np.isfinite(first), hit)
    assert (first[~hit] == np.inf).all()
    np.testing.assert_array_equal(study["pounds"] == 1, hit)
    assert (study["peak_impulse"][hit] > 0).all()
    assert not study["peak_impulse"][~hit].any()
    first = first[hit]
    moments = study.moments("first_impact_time")
    assert moments.n == hit.sum()
    assert (moments.mean, moments.largest) == (pytest.approx(first.mean()), first.max())
    assert study.quantile("first_impact_time", 0.5) == quantile(first, 0.5)
    e = study.parameters()["contact.restitution"]
    assert 0.4 <= e.min() < e.max() <= 0.9
    rank = stats.spearmanr(e[hit], first).statistic
    found = study.correlations("first_impact_time")["contact.restitution"]
    assert found == pytest.approx(rank)

    def parts(*names):
        values = [np.full(64, np.inf if "first" in name else 1.0) for name in names]
        return iter([np.stack(values) if len(names) > 1 else values[0]])

    nowhere = dataclasses.replace(study, _parts=parts)
    assert np.isnan(nowhere.correlations("first_impact_time")["contact.restitution"])
    refused(r"quantile: sample of shape \(0,\) must be", nowhere.quantile, "first_impact_time", 0.5)

    impulse = np.sort(study["peak_impulse"])
    found = study.exceedance("peak_impulse", impulse[-5])
    assert found.value == 4 / 64
    assert found[1:3] == pytest.approx(stats.binomtest(4, 64).proportion_ci(method="exact"))
    assert study.exceedance("n_impacts", 0) == study.pounding_probability()
    assert study.exceedance("first_impact_time", 8.0).value == 1 - hit.mean()
    refused("column 'peak_force' must be one of min_gap, ", study.exceedance, "peak_force", 1.0)
    refused("exceedance: value", study.exceedance, "peak_impulse", [1.0, 2.0])
    counts = study.counts()
    assert [*counts] == sorted({*study["n_impacts"].astype(int)})
    assert counts[0].value == 1 - hit.mean()
    assert sum(x.value for x in counts.values()) == pytest.approx(1.0)
    mean = sum(k * x.value for k, x in counts.items())
    assert mean == pytest.approx(study.moments("n_impacts").mean)
    refused("counts: the numbers of 'min_gap' must be whole", study.counts, "min_gap")
    pgv, limit = study["pgv"], np.median(study["peak_impulse"][hit])
    strong = jp.fit_fragility(pgv, study["peak_impulse"] > limit)
    assert strong.median > jp.fit_fragility(pgv, hit).median
    # After a contact the gap does not say how far the blocks would have moved without it.
    assert "required_gap" not in study.columns
    refused("column 'required_gap' must be one of min_gap, ", study.pounding_probability, 0.05)
    assert study.pounding_probability().value > 0


def test_restitution_matters_to_the_energy_lost_and_times_of_impacts_have_no_variance(monkeypatch):
    ground = jp.Ricker([0.12], [2.5], [2.5])
    uncertain = RESTITUTION | {"rod_2.order": jp.Uniform(0.529, 0.531)}
    scenarios = jp.Scenarios(jp.UncertainStructures(TOUCHING, uncertain), ground)
    found = jp.study.sobol_sensitivity(scenarios, GRID, demand="contact_work", n=16)
    assert found.total["contact.restitution"].value > 0.9
    words = r"there is no required gap unless .* a law of contact"
    refused(words, jp.study.sobol_sensitivity, scenarios, GRID, n=16)

    def demands(structures, ground, *_):
        e = structures.contact.restitution
        return {"first_impact_time": jnp.where(e > 0.65, jnp.inf, e)}

    monkeypatch.setattr(sensitivity, "demands_of", demands)
    words, time = "must be finite, but there is no impact in some scen", "first_impact_time"
    refused(words, jp.study.sobol_sensitivity, SCENARIOS, GRID, demand=time, n=2)


RECORD = jp.Record(0.1 * np.sin(np.arange(80)), 0.1, time_unit="1/ω1")
DISPLACEMENT = {"demand": "peak_x1", "threshold": 0.1}
AT_GRID = DISPLACEMENT | {"grid": GRID}
IN_SECONDS = [jp.Record(RECORD.samples, 0.1)]
BLOCKS = [jp.Building.from_period(*x, 0.05) for x in ((500e3, 0.9), (400e3, 0.6))]


def beside(gap, contact):
    return jp.Buildings(BLOCKS, (jp.FloorLink(0, 0, gap=gap, contact=contact),))


def designed(structures):
    objective = jp.Objective(jp.design.LeastDemand("peak_x1"))
    space, earthquakes = jp.DesignSpace(structures, {"mass_ratio": (0.5, 2.0)}), jp.Ensemble
    return jp.design_damper(space, earthquakes.of([RECORD], GRID), GRID, objective=objective)


def drawn(structures):
    return jp.Scenarios(structures, WAVES)


STUDIES = {
    "monte_carlo": lambda s: jp.monte_carlo(drawn(s), 4, GRID),
    "sobol_sensitivity": lambda s: jp.study.sobol_sensitivity(drawn(s), GRID, n=4),
    "rare_event": lambda s: jp.rare_event(drawn(s), GRID, **DISPLACEMENT),
    "subset_simulation": lambda s: jp.subset_simulation(drawn(s), GRID, **DISPLACEMENT),
    "design_damper": designed,
    "elasticities": lambda s: jp.design.elasticities(s, RECORD, GRID),
    "perturbation_growth": lambda s: jp.study.perturbation_growth(s, RECORD, GRID),
    "simulate": lambda s: jp.simulate(s, RECORD, GRID),
}


def assert_judged(name, function, single, batches):
    """Single precision, and batches by the path of their numbers."""
    says = rf'^{name}: contact is run in float32.*jax\.config\.update\("jax_enable_x64", True\)'
    with jax.enable_x64(False), pytest.raises(jp.PlausibilityWarning, match=says):
        function(single)
    for path, batch in batches.items():
        says = rf"^{name}: structures: {path} of shape \(2,\) must be one number; .* jax\.vmap"
        refused(says, function, batch)


SOFT, GAPS = jp.KelvinVoigt(np.array([50.0, 60.0]), 0.65), jnp.array([0.1, 0.2])


@pytest.mark.parametrize("name", STUDIES)
def test_single_precision_and_batches_are_told_by_the_function_that_was_called(name):
    batches = {
        "initial_gap": dataclasses.replace(TOUCHING, initial_gap=GAPS),
        r"contact\.stiffness": dataclasses.replace(TOUCHING, contact=SOFT),
    }
    assert_judged(name, STUDIES[name], TOUCHING, batches)


SEARCHES = {
    "rare_event": jp.rare_event,
    "subset_simulation": jp.subset_simulation,
    "reach_probability": partial(jp.reliability.reach_probability, "friction", 1e-3),
}


@pytest.mark.parametrize("name", SEARCHES)
def test_limit_states_are_judged_by_the_search_that_takes_them(name):
    """Of single precision; batches by the limit state itself, or else by the search."""
    search = SEARCHES[name]
    with jax.enable_x64(False), pytest.raises(jp.PlausibilityWarning, match=f"^{name}: contact is"):
        search(jp.LimitState(drawn(TOUCHING), **AT_GRID))
    batch = drawn(dataclasses.replace(TOUCHING, initial_gap=GAPS))
    says = r"structures: initial_gap of shape \(2,\) must be one number"
    refused(f"^LimitState: {says}", jp.LimitState, batch, **AT_GRID)
    refused(f"^{name}: {says}", search, batch, GRID)
    refused(
        f"{name}: grid = .* must be left out", search, jp.LimitState(drawn(TOUCHING), GRID), GRID
    )


def test_analyses_of_buildings_tell_of_single_precision_and_batches_too():
    law = jp.KelvinVoigt(2e9, 0.65)
    many = dataclasses.replace(law, stiffness=np.array([2e9, 3e9]))
    batches = {r"links\.0\.gap": beside(GAPS, law)}
    batches[r"links\.0\.contact\.stiffness"] = beside(0.1, many)
    analysis = partial(jp.Analysis, records=IN_SECONDS, **AT_GRID)
    assert_judged("Analysis", analysis, beside(0.1, law), batches)


def test_it_is_told_once(monkeypatch):
    """Before the first run, which need not be compiled for it."""
    monkeypatch.setattr(Task, "compute", lambda *_: 1 / 0)
    stopped = pytest.raises(ZeroDivisionError)
    with jax.enable_x64(False), pytest.warns(jp.PlausibilityWarning) as told, stopped:
        jp.monte_carlo(SCENARIOS, 4, GRID, progress=False)
    assert len(told) == 1
    with jax.enable_x64(False), pytest.raises(ValueError, match=r"^monte_carlo: contact is"):
        jp.monte_carlo(SCENARIOS, 4, GRID, strict=True)
