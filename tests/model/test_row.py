"""Storeys, rows and links between floors: what they are as systems, and what they refuse."""

from dataclasses import replace
from functools import partial

import jax
import numpy as np
import pytest

import jaxpound as jp
from jaxpound import FloorLink, Rod, Row, Storeys
from jaxpound.model import parameters
from jaxpound.model.row import checked_floors
from tests.refusals import refusals, refused

STEEL = jp.ZenerRod(0.5, 0.01, 0.05)
ROD = Rod(STEEL, 5.0)
HIGH = Storeys((1.0, 0.9, 0.8), ROD)
LOW = Storeys((1.2, 1.1), (Rod(STEEL, 4.0), Rod(STEEL, 3.0, (1, 0))))


def test_a_row_is_its_system_and_a_pytree_whose_numbers_are_leaves():
    links = (
        FloorLink(0, 1, friction=0.1, gap=0.3),
        FloorLink(0, 2, next_floor=1, gap=0.2, contact=jp.Newton(0.6)),
        FloorLink(1, 0, friction=0.2, next_building=1),
        FloorLink(1, 1, friction=0.3, next_building=jp.GROUND),
    )
    system = Row((HIGH, LOW), links).system()
    assert system.masses == (1.0, 0.9, 0.8, 1.2, 1.1)
    assert [rod.ends for rod in system.rods] == [(0, -1), (1, 0), (2, 1), (3, -1), (4, 3)]
    assert [float(rod.stiffness) for rod in system.rods] == [5.0, 5.0, 5.0, 4.0, 3.0]
    assert [link.ends for link in system.links] == [(1, 4), (2, 4), (3, -1), (4, -1)]
    assert [float(link.friction) for link in system.links] == [0.1, 0.0, 0.2, 0.3]
    assert system.links[1].contact == links[1].contact
    # The checks of a system find nothing to complain of.
    jp.System(system.masses, system.rods, system.links[:2])
    row = Row((HIGH, LOW), jp.floor_links((HIGH, LOW), friction=0.1, gap=0.3))
    batch = jax.tree.map(lambda x: np.stack([x, x]), row)
    assert isinstance(batch, Row)
    assert (batch.links[0].floor, batch.links[0].gap.shape) == (0, (2,))
    assert jax.tree.structure(batch) == jax.tree.structure(row)
    changed = parameters.put(row, {"buildings.1.rods.0.stiffness": 7.0, "links.1.gap": 0.5})
    assert changed.system().rods[3].stiffness == 7.0
    assert [link.gap for link in changed.system().links] == [0.3, 0.5]
    assert "buildings.0.masses.2" in parameters.paths(row)


def test_common_floors_are_those_of_one_number_or_one_height_and_have_links_of_one_gap():
    assert [(x.floor, x.other_floor) for x in jp.floor_links((HIGH, LOW))] == [(0, 0), (1, 1)]
    three = jp.ShearBuilding.from_period(3, 1e5, 0.4, 0.05, height=3.0)
    two = jp.ShearBuilding(three.storeys[:2], (6.1, 3.0))  # floors at 6.1 m and 9.1 m
    assert [(x.floor, x.other_floor) for x in jp.floor_links((three, two))] == [(1, 0), (2, 1)]
    model = jp.ShearBuilding(three.storeys, 0.1)  # of a shaking table: no slab is 0.2 m there
    assert len(jp.floor_links((model, model))) == 3
    shifted = jp.ShearBuilding(three.storeys, (4.5, 3.0, 3.0))
    refused("buildings 1 and 2 must have floors at the same heig", jp.floor_links, (three, shifted))
    refused("1 of them, must be two or more", jp.floor_links, (three,))
    three = (HIGH, LOW, HIGH)
    dampers = jp.floor_links(three, building=0, friction=0.1)
    links = dampers + jp.floor_links(three, building=1, gap=0.2)
    assert [str(link) for link in links] == [str(link) for link in jp.floor_links(three)]
    assert [float(link.friction) for link in links] == [0.1, 0.1, 0.0, 0.0]
    gaps, laws = [0.1, (0.2, 0.3), 0.4, 0.5], [jp.Newton(x) for x in (0.1, 0.2, 0.3, 0.4)]
    listed = jp.floor_links(three, friction=np.arange(4.0), gap=gaps, contact=laws)
    assert [float(link.friction) for link in listed] == [0.0, 1.0, 2.0, 3.0]
    assert [link.gap for link in listed] == gaps
    assert [link.contact for link in listed] == laws
    tupled = jp.floor_links(three, friction=(0.1, 0.2, 0.3, 0.4))
    assert [float(link.friction) for link in tupled] == [0.1, 0.2, 0.3, 0.4]
    both = jp.floor_links(three, gap=(0.2, 0.3))  # a tuple is of two faces
    assert [link.gap for link in both] == [(0.2, 0.3)] * 4
    slopes = jax.grad(lambda mu: sum(x.friction**2 for x in jp.floor_links(three, friction=mu)))
    np.testing.assert_array_equal(slopes(np.arange(4.0)), 2 * np.arange(4.0))
    for name, x in {"friction": np.ones(3), "gap": [0.1] * 5, "contact": laws[:1]}.items():
        words = f"{name}, {len(x)} of them, must be one for all links or 4, one for each"
        refused(words, jp.floor_links, three, **{name: x})
    for building in (2, -1, 1.0, (0, 1)):
        refused("building = .* must be from 0 to 1, a bu", jp.floor_links, three, building=building)


LOWEST, LEVEL = FloorLink(0, 0), FloorLink(0, 1)
UPWARDS, DOWN = FloorLink(0, 0, next_floor=1), FloorLink(0, 1, 0)
SLIDING_RING = tuple(replace(x, friction=0.1) for x in (LOWEST, UPWARDS, DOWN, LEVEL))
LEFTWARDS, TO_ITSELF = FloorLink(1, 0, next_building=0), FloorLink(0, 1, 1, next_building=0)
TO_GROUND, TIE = partial(FloorLink, next_building=jp.GROUND), Rod(STEEL, 1.0, (0, 1))

TWICE = r"links.2 \(1–2, floor 2\) must not stand where links.1 does: one link has friction, "
TWICE += r"damper, gap and contact, and gap=\(left, right\) makes one of two faces"
test_links_that_cannot_be_are_refused = refusals(
    ((FloorLink(0, 3),), r"links.0: floor = 3 must be from 0 to 2: building 1 has 3 floors"),
    ((FloorLink(0, 2),), r"links.0: next_floor = 2 must be from 0 to 1: building 2 has 2 floors"),
    ((FloorLink(1, 0),), "links.0: next_building = 2 must be from 0 to 1"),
    ((FloorLink(4, 0),), "links.0: building = 4 must be from 0 to 1"),
    ((LEFTWARDS,), r"next_building = 0 must be 2 \(to the right\), 1 itself or the ground"),
    ((TO_ITSELF,), "in 1, floor 2 must be two different floors"),
    ((LOWEST, LEVEL, LEVEL), TWICE),
    (SLIDING_RING, r"links.3 \(1–2, floor 2\) must not close a ring"),
    of=lambda links: Row((HIGH, LOW), links),
)

test_bad_input = refusals(
    (lambda: FloorLink(0, -1), "FloorLink: floor = -1 must be a whole number from 0 on"),
    (lambda: FloorLink(True, 0), "building = True must be a whole number"),
    (lambda: FloorLink(0, 0, next_floor=-2), "next_floor = -2 .* or GROUND"),
    (lambda: FloorLink(0, 0, gap=-0.1), "1–2, floor 1: gap = -0.1 must be not neg"),
    (TO_GROUND, 0, 0, 3, "next_floor = 3 must be left out: the other end is the ground"),
    (lambda: FloorLink(0, 0, jp.GROUND, next_building=5), "next_building = 5 must be left out"),
    (lambda: Storeys((1.0,), STEEL), "rods of type ZenerRod must be a Rod, or a tuple"),
    (lambda: jp.floor_links((HIGH, jp.Building(1.0, 1.0, 1.0, 1.0, 1.0))), r"buildings.1"),
    (lambda: FloorLink(0, 0, friction=-1.0), "friction = -1 must be finite and not"),
    (lambda: FloorLink(0, 0, contact=jp.Newton(0.5)), "gap = inf must be finite"),
    (lambda: Storeys((), ()), r"masses = \(\) must hold at least one storey"),
    (lambda: Storeys((1.0, 1.0), (ROD,)), "rods, 1 of them, must be one for each of the 2"),
    (lambda: Storeys((1.0, -1.0), ROD), "Storeys: masses.1 = -1 must be positive"),
    (Storeys, (1.0,), (TIE,), r"rods.0.ends = \(0, 1\) must be left out, or those of its storey"),
    (lambda: Row(()), r"buildings = \(\) must hold at least one building"),
    (lambda: Row((jp.paper.structures(),)), "Row: buildings.0 = .* must be .*Storeys"),
    (lambda: jp.System((1.0,), (ROD,)), "rods.0.ends = None must be two masses, or GROUND"),
)


def test_floors_without_a_partner_are_told_of_and_verdicts_say_of_how_many_they_are():
    first, roof = [4.0, 3.2, 3.2], [4.0, 3.6]
    high, low, flat = (
        jp.ShearBuilding.from_period(len(h), 3e5, 0.5, 0.05, height=h)
        for h in (first, roof, [1.5, 1.5])
    )
    pairs = (1, 2), (2, 1), (2, 3), (3, 2)
    alone = " and ".join(f"2 of building {i} beside {j}" for i, j in pairs)
    rule = rf"^floor_links: floors {alone} have no .* within 0\.2 m and are not checked"
    with pytest.warns(jp.PlausibilityWarning, match=rule) as told:
        links = jp.floor_links((high, low, high), gap=0.06)
    assert [(len(told), told[0].filename)] == [(1, __file__)]
    jp.floor_links((high, low), friction=1e5)  # dampers are where they are
    refused("within 0.2 m; next_floor joins others", jp.floor_links, (high, flat), gap=0.1)
    grid, ground = jp.TimeGrid(0.005, 200), jp.Ricker(0.01, 0.5, 0.5)
    words = "of 1 of 2 floors (the others have no gap)"
    response = jp.simulate(jp.Buildings((high, low), links[:1]), ground, grid)
    assert repr(response.demand).endswith(f"pounds: {words}")
    assert f", {words}" in repr(response)
    whole = links[0], jp.FloorLink(0, 1, 1, gap=0.06)
    demand = jp.demand(jp.Buildings((high, low), whole), ground, grid)
    assert demand.checked_floors == ""
    assert "no gap" not in repr(demand)


def test_a_floor_behind_a_wall_is_checked():
    topology = jp.Row((HIGH, HIGH), (jp.FloorLink(0, 1, gap=0.1),)).system().topology
    assert checked_floors(topology, [0.1]).startswith(f", of 1 of {HIGH.n_floors} floors")
    assert checked_floors(topology, [np.inf]) == ""
