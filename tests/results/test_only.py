"""Demands of which only some scalars were asked for."""

from dataclasses import replace

import jax
import numpy as np
import pytest

import jaxpound as jp

GRID = jp.TimeGrid.until(8.0, dt=0.05)
PAPER, GROUND = jp.paper.structures(), jp.paper.ground()
NAMES = ("peak_f1", "min_gap")


def test_they_are_those_of_the_whole_demand():
    whole, some = jp.demand(PAPER, GROUND, GRID), jp.demand(PAPER, GROUND, GRID, only=NAMES)
    assert some.scalars() == pytest.approx(
        {name: whole.scalars()[name] for name in ("min_gap", "peak_f1", "pounds")}, rel=1e-12
    )
    assert some.peak_f1 == some.rods[0].peak_force
    for name in ("pga", "min_gap_time", "peak_x1", "friction_work"):
        assert getattr(some, name) is None
    assert "peak_f1" in str(some)
    assert "pga" not in str(some)


def test_a_batch_and_its_table():
    found = jax.vmap(lambda a: jp.demand(PAPER, a * GROUND, GRID, only=NAMES))(np.ones(3))
    assert found.batch == (3,)
    assert found[1].batch == ()
    assert list(found.to_pandas().columns) == ["min_gap", "peak_f1", "pounds"]
    assert "pounding in 0 of 3 valid runs" in str(found)
    without = jax.vmap(lambda a: jp.demand(PAPER, a * GROUND, GRID, only=["pgv"]))(np.ones(3))
    assert "pounding" not in str(without)
    assert without.pounds is None


def test_gaps_of_several_links():
    link = PAPER.system().links[0]
    rods = PAPER.system().rods
    row = jp.System(
        masses=(1.0, 1.3, 0.9),
        rods=(*rods, replace(rods[0], ends=(2, jp.GROUND))),
        links=(link, replace(link, ends=(1, 2))),
    )
    whole = jp.demand(row, GROUND, GRID)
    some = jp.demand(row, GROUND, GRID, only=("min_gap", "slip_distance_2"))
    assert some.min_gap == pytest.approx(float(whole.min_gap), rel=1e-12)
    assert some.min_gap_time is None
    assert some.slip_distance_2 == pytest.approx(float(whole.slip_distance_2), rel=1e-12)
    assert some.links[0].slip_distance is None
    timed = whole.only(["min_gap_time"])
    assert timed.min_gap_time == whole.min_gap_time


@pytest.mark.parametrize(
    ("only", "message"),
    [
        (("min_gp",), "only: unknown 'min_gp'; did you mean 'min_gap'"),
        (("peak_contact",), "only: unknown 'peak_contact'"),
        ("min_gap", "demand: only = 'min_gap' must hold names of scalars"),
        ((), r"demand: only = \(\) must hold names"),
    ],
)
def test_names_of_no_scalars(only, message):
    with pytest.raises(ValueError, match=message):
        jp.demand(PAPER, GROUND, GRID, only=only)
