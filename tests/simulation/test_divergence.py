"""The growth of small changes: against finite differences and an independent reference."""

from dataclasses import replace

import jax
import numpy as np
import pytest

import jaxpound as jp

# From an independent reference, of the runs of two gaps that differ by 1e-8: the size of the
# difference of the displacements, over 1e-8 (a stiff, lightly damped pair, 17 impacts until 40).
TIMES = (4.0, 8.0, 12.0, 16.0, 20.0)
GROWTH = (2.2, 1.8, 21.0, 27.0, 110.0)
STEEL = jp.ZenerRod(0.5, 0.01, 0.05)
GRID = jp.TimeGrid.until(20.0, 0.04)


@pytest.fixture(scope="module")
def sensitive():
    soft, stiff = jp.ZenerRod(0.6, 0.05, 0.056), jp.ZenerRod(0.6, 0.05, 0.053)
    pair = jp.AdjacentStructures(soft, stiff, 1.0, 12.0, 0.005, 0.1, jp.Newton(0.9))
    return jp.growth(pair, jp.Ricker(0.3, [2.4] * 7, 2.0 + 3.0 * np.arange(7)), GRID)


def test_growth_is_that_of_an_independent_reference(sensitive):
    """Within a factor: that of the reference is of displacements alone."""
    places = np.round(np.array(TIMES) / GRID.dt).astype(int)
    ratio = np.asarray(sensitive.factor)[places] / GROWTH
    assert ((ratio > 0.8) & (ratio < 5)).all()
    assert (np.asarray(sensitive.factor)[: round(1.7 / GRID.dt)] == 0).all()  # nothing has touched
    assert sensitive.end == sensitive.factor[-1] > 20 * sensitive.factor[places[0]]


def test_the_horizon_is_where_the_error_is_as_large_as_is_allowed(sensitive):
    horizon = float(sensitive.horizon(1e-2, share=0.1))
    i = round(horizon / GRID.dt)
    error = 1e-2 * np.asarray(sensitive.factor)
    allowed = 0.1 * np.asarray(sensitive.motion)
    assert error[i] > allowed[i]
    assert (error[:i] <= allowed[:i]).all()
    assert sensitive.horizon(1e-3, share=0.1) > horizon
    assert sensitive.horizon(1e-12) == np.inf


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
