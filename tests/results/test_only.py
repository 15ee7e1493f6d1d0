"""Demands of which only some scalars were asked for."""

from dataclasses import replace

import jax
import numpy as np
import pytest

import jaxpound as jp
from tests.made import row_of, row_response
from tests.refusals import refusals

GRID = jp.TimeGrid.until(8.0, dt=0.05)
PAPER, GROUND = jp.paper.structures(), jp.paper.ground()
NAMES = ("peak_f1", "min_gap")


@pytest.fixture(scope="module")
def whole():
    """Three runs with all scalars."""
    return jax.jit(jax.vmap(lambda a: jp.demand(PAPER, a * GROUND, GRID)))(np.ones(3))


def test_they_are_those_of_the_whole_demand(whole):
    run = jax.jit(jax.vmap(lambda a: jp.demand(PAPER, a * GROUND, GRID, only=NAMES)))
    batch = run(np.ones(3))
    some, of_all = batch[1], whole[1].scalars()
    expected = {name: of_all[name] for name in ("min_gap", "peak_f1", "pounds")}
    assert some.scalars() == pytest.approx(expected, rel=1e-12)
    assert some.peak_f1 == some.rods[0].peak_force
    for name in ("pga", "min_gap_time", "peak_x1", "friction_work"):
        assert getattr(some, name) is None
    assert "peak_f1" in str(some)
    assert "pga" not in str(some)
    assert (batch.batch, some.batch) == ((3,), ())
    assert list(batch.to_pandas().columns) == ["min_gap", "peak_f1", "pounds"]
    assert "pounding in 0 of 3 valid runs" in str(batch)
    without = whole.only(["pgv"])
    assert "pounding" not in str(without)
    assert without.pounds is None


def test_gaps_of_several_links():
    link = jp.FloorLink(0, 0, gap=0.2, friction=0.1)
    row = row_of([1, 1, 1], (link, replace(link, building=1)))
    whole = row_response(row, np.linspace(0, 2, 9), lambda i, t: 0.1 * (-1) ** i * t).demand
    some = whole.only(("min_gap", "slip_distance_2"))
    assert (some.min_gap, some.slip_distance_2) == (whole.min_gap, whole.slip_distance_2)
    assert some.min_gap_time is some.links[0].slip_distance is None
    assert whole.only(["min_gap_time"]).min_gap_time == whole.min_gap_time


test_names_of_no_scalars = refusals(
    (("min_gp",), "only: unknown 'min_gp'; did you mean 'min_gap'"),
    (("peak_contact",), "only: unknown 'peak_contact'"),
    ("min_gap", "demand: only = 'min_gap' must hold names of scalars"),
    ((), r"demand: only = \(\) must hold names"),
    of=lambda only: jp.demand(PAPER, GROUND, GRID, only=only),
)
