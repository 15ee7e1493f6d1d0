"""Demands by their names: what each is called, and its value in a run."""

from functools import partial

import numpy as np
import pytest

import jaxpound as jp
from jaxpound.results import named
from tests.made import pair_demand, row_of, row_response
from tests.refusals import refused

LINKS = (jp.FloorLink(0, 0, gap=0.2, contact=jp.Newton(0.5)), jp.FloorLink(0, 1, gap=0.3))
ROW = row_of((3, 2), LINKS)


@pytest.mark.parametrize("structures", [jp.paper.structures(), ROW], ids=["pair", "row"])
def test_every_limited_demand_has_a_value_a_unit_and_words(structures):
    system, time = structures.system(), np.linspace(0, 2, 9)
    run = row_response(structures, time, lambda i, t: 0.1 * (i + 1) * t)
    names = named.limited_demands(system)
    assert len(set(names)) == len(names)
    frictions = [link.friction for link in system.links]
    assert {*names} <= {*named.limited_values(system, run.demand, frictions)}
    for name in names:
        quantity = named.quantity_named(name)
        assert quantity.limited
        assert named.unit_of(name, si=True)
        assert "_" not in named.in_words(name, system.topology)
        assert named.kind_and_symbol(name)[0] == quantity.kind


def test_names_that_no_scalar_has_are_understood_as_well():
    assert named.unit_of(named.OVERLAP, si=True) == "m"
    assert named.in_words("required_gap_2") == "required gap of link 2"
    assert named.in_words("damper_force_2", ROW.system().topology).endswith(", 1–2, floor 2")
    assert named.kind_and_symbol("measure_of_mine") == (None, "measure of mine")
    demands = [named.is_demand(x) for x in ("required_gap_2", "peak_drift", "initial_gap")]
    assert demands == [True, True, False]
    assert [named.is_zero_by_newton(x) for x in ("peak_contact_2", "peak_impulse")] == [True, False]
    system, demand = jp.paper.structures().system(), pair_demand(0.25)
    value_of = partial(named.value_of, "LimitState", system, demand)
    assert value_of(named.OVERLAP) == -0.25
    (link,) = system.links
    assert float(value_of(named.REQUIRED_GAP)) == pytest.approx(float(link.gap) - 0.25)
    refused(r"^LimitState: unknown demand 'peak_x3'", value_of, "peak_x3")
    refused(r"^LimitState: demand = 'peak_contact' must be of str", value_of, "peak_contact")
