"""The growth of small changes: against finite differences and an independent reference."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from tests.pickled import assert_survives_pickling
from tests.reference import load
from tests.refusals import refused
from tests.simulation.pairs import DIFFERENTIATED, FORCES, GRID, growth, law, run
from tests.simulation.test_contact import ground_of, system_of
from tests.test_buildings import LEFT, RECORD, RIGHT

CASES = load("contact")["sensitive"]
STEP = 1e-7  # of the gap, for differences


def of_reference(name, contact, more=0.0):
    """One of the reference's long, stiff, lightly damped pairs, with more gap."""
    system = system_of(CASES[name])
    (link,) = system.links
    return replace(system, links=(replace(link, gap=link.gap + more, contact=contact),))


@pytest.fixture(
    scope="module", params=[("newton", "newton_fast"), ("kelvin_clip",)], ids=["newton", "kelvin"]
)
def sensitive(request):
    """By name the growth, and the runs with the gap as it is, a little wider and narrower."""
    names, n = request.param, len(request.param)
    kind = CASES[names[0]]["system"]["links"][0]
    laws = [law(kind["law"], kind["k"], kind["e"], among) for among in (FORCES, DIFFERENTIATED)]
    grounds = [ground_of(CASES[name]) for name in names]
    changes = (0.0, STEP, -STEP)
    systems = [of_reference(name, laws[0], more) for more in changes for name in names]
    runs = run(systems, grounds * 3)
    growths = growth([of_reference(name, laws[1]) for name in names], grounds)
    by_lane = [jax.tree.map(lambda x, i=i: x[i], growths) for i in range(n)]
    return {name: (by_lane[i], [runs[i + n * k] for k in range(3)]) for i, name in enumerate(names)}


def instants(name):
    """Of the reference until it is no longer good: indices, displacements, growth."""
    case = CASES[name]
    times = np.array(case["t"])
    good = times <= case["good_until"]
    places = np.round(times[good] / GRID.dt).astype(int)
    return places, np.array(case["x"])[:, good], np.array(case["growth"])[good]


def state(response):
    return np.stack([response.x1, response.x2, response.v1, response.v2])


def change_of(wider, narrower):
    return (state(wider) - state(narrower)) / (2 * STEP)


def test_growth_and_horizon_are_those_of_the_runs_of_neighbouring_gaps(sensitive):
    for grown, (_, wider, narrower) in sensitive.values():
        change = np.linalg.norm(change_of(wider, narrower), axis=0)
        so_far = np.maximum.accumulate(grown.factor)
        # Later the change is no longer small.
        early = grown.time <= 40
        assert (np.abs(change - grown.factor) < 6e-4 * np.maximum(so_far, 1))[early].all()
        touched = int(np.argmax(wider.links[0].touching > 0))
        assert touched > 50
        assert (grown.factor[: touched - 1] == 0).all()
        assert grown.end == grown.factor[-1] > 100
        assert_survives_pickling(grown)
        # The horizon is where the error is as large as is allowed.
        horizon = float(grown.horizon(1e-3, share=0.1))
        i = round(horizon / GRID.dt)
        error, allowed = 1e-3 * grown.factor, 0.1 * grown.motion
        assert error[i] > allowed[i]
        assert (error[:i] <= allowed[:i]).all()
        assert grown.horizon(1e-4, share=0.1) > horizon
        assert grown.horizon(1e-12) == np.inf


def test_growth_and_errors_are_those_of_an_independent_reference(sensitive):
    """The growth as long as the run is the reference's, to .02; errors until nothing is left."""
    for name, (grown, (response, wider, narrower)) in sensitive.items():
        places, x, expected = instants(name)
        errors = np.abs(state(response)[:2, places] - x).max(0)
        change = np.abs(change_of(wider, narrower))[:2].max(0)
        same = (np.maximum.accumulate(errors) < 0.02) & (expected > 0)
        assert same.sum() >= 7
        np.testing.assert_allclose(change[places][same], expected[same], rtol=0.25)
        so_far = np.maximum(np.maximum.accumulate(grown.factor), 1)[places]
        assert (errors < 2e-3 * so_far).all()
        assert errors.max() > 0.1


HIT = {"gap": 0.02, "contact": jp.Newton(0.6)}
LINKS = jp.FloorLink(0, 0, **HIT), jp.FloorLink(1, 0, next_building=jp.GROUND, **HIT)
ROW = jp.Buildings((LEFT, RIGHT), LINKS)


def test_of_several_links_it_is_the_largest_singular_value_in_si_too():
    grid, step = jp.TimeGrid.until(6.0, 0.02), 1e-8

    def shaking(t):  # the samples that growth takes of a record
        return jp.STANDARD_GRAVITY * RECORD.acceleration(t)

    @jax.jit
    def end(gaps):
        links = tuple(replace(link, gap=gap) for link, gap in zip(ROW.links, gaps, strict=True))
        masses = jp.simulate(replace(ROW, links=links), shaking, grid).masses
        return jnp.stack([mass.x[-1] for mass in masses] + [mass.v[-1] for mass in masses])

    ends = [[end(0.02 + sign * change) for sign in (1, -1)] for change in step * np.eye(2)]
    by_gap = [np.subtract(*pair) / (2 * step) for pair in ends]
    largest = np.linalg.svd(np.stack(by_gap, -1), compute_uv=False)[0]
    assert np.linalg.norm(by_gap, axis=1).min() > 1e-3 * largest > 0  # both gaps close
    growth_end = jax.jit(lambda row: jp.study.perturbation_growth(row, RECORD, grid).end)
    assert float(growth_end(ROW)) == pytest.approx(largest, rel=1e-5)


def test_what_cannot_grow_is_refused():
    ground, pair = jp.paper.ground(), jp.paper.structures()
    refused(
        "perturbation_growth: structures must have a link with a law of",
        jp.study.perturbation_growth,
        pair,
        ground,
        GRID,
    )
    refused("stability limit", jp.study.perturbation_growth, ROW, RECORD, jp.TimeGrid(2.0, 10))
    refused("horizon: uncertainty = 0", jp.study.PerturbationGrowth(*jnp.ones((3, 4))).horizon, 0.0)
