"""The growth of small changes: against finite differences and an independent reference."""

import functools
from dataclasses import replace

import jax
import numpy as np
import pytest

import jaxpound as jp
from tests.reference import load
from tests.simulation.pairs import DIFFERENTIATED, FORCES, GRID, growth, law, pair, run

STEEL = jp.ZenerRod(0.5, 0.01, 0.05)
CASES = load("contact")["sensitive"]
STEP = 1e-7  # of the gap, for differences


def of_reference(name, contact, more=0.0):
    """One of the reference's long, stiff, lightly damped pairs, with more gap."""
    system = CASES[name]["system"]
    (link,) = system["links"]
    return pair(
        masses=tuple(system["m"]),
        materials=[jp.ZenerRod(rod["order"], rod["tf"], rod["tx"]) for rod in system["rods"]],
        stiffnesses=[rod["K"] for rod in system["rods"]],
        friction=link["mu"],
        gap=link["gap0"] + more,
        contact=contact,
    )


def single(batch, i):
    return jax.tree.map(lambda x: x[i], batch)


@functools.cache
def compared(names):
    """By name the growth, and the runs with the gap as it is, a little wider and narrower."""
    kind = CASES[names[0]]["system"]["links"][0]
    laws = [law(kind["law"], kind["k"], kind["e"], among) for among in (FORCES, DIFFERENTIATED)]
    grounds = [
        jp.Ricker(shaking["u0"], shaking["tp"], shaking["ts"])
        for shaking in (CASES[name]["ricker"] for name in names)
    ]
    changes = (0.0, STEP, -STEP)
    systems = [of_reference(name, laws[0], more) for more in changes for name in names]
    runs = run(systems, grounds * 3)
    found = growth([of_reference(name, laws[1]) for name in names], grounds)
    n = len(names)
    return {
        name: (single(found, i), [runs[i + n * k] for k in range(3)])
        for i, name in enumerate(names)
    }


@pytest.fixture(params=[("newton", "newton_fast"), ("kelvin_clip",)], ids=lambda x: x[0])
def sensitive(request):
    return compared(request.param)


def instants(name):
    """Of the reference until it is no longer good: indices, displacements, growth."""
    case = CASES[name]
    times = np.array(case["t"])
    good = times <= case["good_until"]
    places = np.round(times[good] / GRID.dt).astype(int)
    return places, np.array(case["x"])[:, good], np.array(case["growth"])[good]


def state(found):
    return np.stack([found.x1, found.x2, found.v1, found.v2])


def test_growth_is_that_of_the_runs_of_neighbouring_gaps(sensitive):
    for found, (_, wider, narrower) in sensitive.values():
        change = np.linalg.norm(state(wider) - state(narrower), axis=0) / (2 * STEP)
        so_far = np.maximum.accumulate(found.factor)
        # Later the change is no longer small.
        early = found.time <= 40
        assert (np.abs(change - found.factor) < 6e-4 * np.maximum(so_far, 1))[early].all()
        touched = int(np.argmax(wider.links[0].touching > 0))
        assert touched > 50
        assert (found.factor[: touched - 1] == 0).all()
        assert found.end == found.factor[-1] > 100


def test_growth_is_that_of_an_independent_reference(sensitive):
    """As long as the run itself is the reference's, to .02."""
    for name, (_, (one, wider, narrower)) in sensitive.items():
        places, x, expected = instants(name)
        errors = np.abs(state(one)[:2, places] - x).max(0)
        change = np.abs(state(wider) - state(narrower))[:2].max(0) / (2 * STEP)
        same = (np.maximum.accumulate(errors) < 0.02) & (expected > 0)
        assert same.sum() >= 7
        np.testing.assert_allclose(change[places][same], expected[same], rtol=0.25)


def test_errors_grow_as_the_growth_says(sensitive):
    """From the scheme's own error, of a few 1e-4, until nothing is left of the trajectory."""
    for name, (found, (one, *_)) in sensitive.items():
        places, x, _ = instants(name)
        errors = np.abs(state(one)[:2, places] - x).max(0)
        so_far = np.maximum(np.maximum.accumulate(found.factor), 1)[places]
        assert (errors < 2e-3 * so_far).all()
        assert errors.max() > 0.1


def test_the_horizon_is_where_the_error_is_as_large_as_is_allowed(sensitive):
    for found, _ in sensitive.values():
        horizon = float(found.horizon(1e-3, share=0.1))
        i = round(horizon / GRID.dt)
        error, allowed = 1e-3 * found.factor, 0.1 * found.motion
        assert error[i] > allowed[i]
        assert (error[:i] <= allowed[:i]).all()
        assert found.horizon(1e-4, share=0.1) > horizon
        assert found.horizon(1e-12) == np.inf


@pytest.fixture(scope="module")
def row():
    rods = tuple(jp.Rod(STEEL, k, (i, jp.GROUND)) for i, k in enumerate((1.0, 2.0, 0.5)))
    law = jp.Newton(0.6)
    links = (jp.Link((0, 1), gap=0.1, contact=law), jp.Link((1, 2), gap=0.1, contact=law))
    return jp.System((1.0, 1.0, 1.0), rods, links)


def test_of_several_links_it_is_the_largest_singular_value(row):
    grid, step = jp.TimeGrid.until(8.0, 0.05), 1e-6

    def end(*gaps):
        links = tuple(replace(link, gap=gap) for link, gap in zip(row.links, gaps, strict=True))
        run = jp.simulate(replace(row, links=links), jp.paper.ground(), grid)
        return np.array([m.x[-1] for m in run.masses] + [m.v[-1] for m in run.masses])

    by_gap = [
        (end(*(0.1 + step * direction)) - end(*(0.1 - step * direction))) / (2 * step)
        for direction in np.eye(2)
    ]
    largest = np.linalg.svd(np.stack(by_gap, -1), compute_uv=False)[0]
    assert float(jp.growth(row, jp.paper.ground(), grid).end) == pytest.approx(largest, rel=1e-5)


def test_what_cannot_grow_is_refused(row):
    with pytest.raises(ValueError, match="growth: structures must have a link with a law of"):
        jp.growth(jp.paper.structures(), jp.paper.ground(), GRID)
    with pytest.raises(ValueError, match="stability limit"):
        jp.growth(row, jp.paper.ground(), jp.TimeGrid(2.0, 10))
    made = jp.Growth(*jax.numpy.ones((3, 4)))
    with pytest.raises(ValueError, match="horizon: uncertainty = 0"):
        made.horizon(0.0)
