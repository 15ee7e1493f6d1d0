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
    names = named.limitable_demands(system)
    assert len(set(names)) == len(names)
    assert {*names} <= {*named.limited_values(system, run.demand)}
    for name in names:
        quantity = named.quantity_named(name)
        assert quantity.limited
        assert named.unit_of(name, si=True)
        assert "_" not in named.in_words(name, system.topology)
        assert named.kind_and_symbol(name)[0] == quantity.kind


def test_what_is_shown_says_which_floor_storey_or_link_it_is_of():
    run = row_response(ROW, np.linspace(0, 2, 9), lambda i, t: 0.1 * (i + 1) * np.sin(3 * t))
    lines = {line.split()[0]: line for line in repr(run.demand).splitlines()[1:]}
    assert lines["peak_x5"].endswith("g/ω1²      peak displacement of floor 2 of building 2")
    assert lines["peak_f4"].endswith("peak shear of storey 1 of building 2")
    assert lines["min_gap_2"].endswith("smallest gap, 1–2, floor 2")
    assert lines["min_gap"].endswith("smallest gap")
    rows = [line for line in repr(run).splitlines() if "largest" in line]
    words = [line.split(";")[0].split(", ", 1)[1] for line in rows]
    assert words == ["floor 2 of building 2", "floor 1 of building 1", "storey 1 of building 2"]
    impact = run.impacts()[0]
    assert repr(impact).startswith("Impact(between='1–2, floor 1', time=")
    assert "link" not in repr(impact)
    topology = ROW.system().topology
    event = named.event_in_words("peak_x5", 0.2, True, topology)
    assert event == "peak displacement of floor 2 of building 2 ≥ 0.2 m"
    words = "peak displacement\nof floor 2 of building 2"
    assert named.kind_and_symbol("peak_x5", topology) == ("length", words)
    assert named.kind_and_symbol("min_gap_2", topology)[1] == "smallest gap,\n1–2, floor 2"
    assert named.kind_and_symbol("peak_x2", named.PAIR)[1] == "peak $|x_2|$"


def test_names_that_no_scalar_has_are_understood_as_well():
    assert named.unit_of(named.OVERLAP, si=True) == "m"
    assert named.in_words("required_gap_2") == "required gap of link 2"
    assert named.in_words("damper_force_2", ROW.system().topology).endswith(", 1–2, floor 2")
    assert named.kind_and_symbol("measure_of_mine") == (None, "measure of mine")
    demands = [named.is_demand(x) for x in ("required_gap_2", "peak_drift", "initial_gap")]
    assert demands == [True, True, False]
    assert [named.is_zero_by_newton(x) for x in ("peak_contact_2", "peak_impulse")] == [True, False]
    system, demand = jp.paper.structures().system(), pair_demand(0.25)
    value_of = partial(named.value_of, system, demand)
    assert value_of(named.OVERLAP) == -0.25
    (link,) = system.links
    assert float(value_of(named.REQUIRED_GAP)) == pytest.approx(float(link.gap) - 0.25)
    refused(r"^value_of: unknown demand 'peak_x3'", value_of, "peak_x3")
    refused(r"^value_of: demand = 'peak_contact' must be of str", value_of, "peak_contact")
