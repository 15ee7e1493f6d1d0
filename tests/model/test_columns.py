"""Floors that hit columns of a neighbour: which do, at what share of the height, and with what law.

Formulas are those of a beam with a load between its ends (Roark); nothing of a run.
"""

import dataclasses

import jax
import numpy as np
import pytest
from scipy.integrate import quad

import jaxpound as jp
from jaxpound import FloorLink
from jaxpound.model import Column, parameters
from jaxpound.model.places import link_places
from tests.refusals import refusals, refused

LAW = jp.KelvinVoigt(4e9, 0.65)
LOW, HIGH = (
    jp.ShearBuilding.from_period(n, 3e5, period, 0.05, height=heights)
    for n, period, heights in ((3, 0.5, 3.0), (4, 0.4, [4.2, 3.4, 3.4, 3.4]))
)
COLUMN = Column(4e7, capacity=3e5)


@pytest.mark.parametrize("ends", ["fixed", "pinned"])
@pytest.mark.parametrize("position", [0.2, 0.5, 0.7])
def test_a_column_is_the_beam_of_the_books(ends, position):
    """The deflection under a unit load is ∫ M²/(E I); the weight is the shape of a sway."""
    rigidity, height = 3.0, 2.0
    column = Column(rigidity, ends, position=position, height=height)
    a, b = position * height, (1 - position) * height
    pair = np.array([b / height, -a * b**2 / height**2])  # shear and moment at the lower end
    if ends == "fixed":
        pair[0] = b**2 * (3 * a + b) / height**3

    def moment(x):
        return (pair[1] if ends == "fixed" else 0.0) + pair[0] * x - max(x - a, 0.0)

    work, _ = quad(lambda x: moment(x) ** 2, 0, height, points=[a], epsabs=1e-13)
    assert column.stiffness == pytest.approx(rigidity / work, rel=1e-9)
    assert column.weight == pytest.approx(1 - pair[0], rel=1e-12)  # as Maxwell and Betti have it
    assert float(column.shear(5.0)) == pytest.approx(5.0 * max(pair[0], 1 - pair[0]), rel=1e-12)


def test_contact_and_column_are_in_series():
    column = Column(4e7, position=0.5, height=3.0)
    k = column.stiffness
    law = column.behind(LAW)
    assert float(1 / law.stiffness) == pytest.approx(1 / 4e9 + 1 / k, rel=1e-12)
    damping = [2 * float(x.damping_ratio) * float(x.stiffness) ** 0.5 for x in (law, LAW)]
    assert damping[0] == pytest.approx(damping[1] * (k / (k + 4e9)) ** 2, rel=1e-9)
    rigid = dataclasses.replace(column, rigidity=4e17).behind(LAW)
    assert float(rigid.restitution) == pytest.approx(0.65, rel=1e-6)
    assert float(column.behind(jp.KelvinVoigt(4e9, 1.0)).restitution) == 1.0


def test_floors_without_a_partner_hit_columns_from_both_sides():
    links = jp.floor_links((LOW, HIGH), gap=[0.01, 0.02, 0.03, 0.04, 0.05], columns=COLUMN)
    words = ["floor 1–column 1", "column 2–floor 1", "floor 2–column 2"]
    words = [f"1–2, {x}" for x in (*words, "column 3–floor 2", "floor 3–column 3")]
    assert [str(link) for link in links] == words
    buildings = jp.Buildings((LOW, HIGH), links)
    system = buildings.system()
    assert [*link_places(system.topology)] == words
    assert [float(x.gap) for x in system.links] == [0.01, 0.02, 0.03, 0.04, 0.05]
    lower, upper = (x.elevations for x in (LOW, HIGH))
    assert [x.ends.masses for x in system.links] == [
        (0, 3),
        (3, 1, 0),
        (1, 4, 3),
        (4, 2, 1),
        (2, 5, 4),
    ]
    for link in system.links:
        ups = np.append(lower, upper)[list(link.ends.masses)]
        low = ups[2] if len(ups) == 3 else 0.0
        share = (ups[0] - low) / (ups[1] - low)
        w = share**2 * (3 - 2 * share)
        sign = 1 if link.ends.masses[0] < 3 else -1
        np.testing.assert_allclose(np.multiply(link.weights, sign), [1, -w, w - 1][: len(ups)])
    only = jp.floor_links((HIGH, LOW), columns=(COLUMN, None), building=0)  # no gap, no warning
    assert [str(x) for x in only] == [
        "1–2, column 1–floor 1",
        "1–2, column 2–floor 2",
        "1–2, column 3–floor 3",
    ]
    same = jp.ShearBuilding(HIGH.storeys, (3.0, 3.1, 2.9, 4.0))
    mixed = jp.floor_links((LOW, same), gap=0.02, columns=COLUMN)
    assert [x.column for x in mixed] == [None] * 3


def test_a_link_by_hand_is_that_of_the_elevations_and_of_any_unit():
    by_hand = FloorLink(0, 1, 1, gap=0.03, contact=LAW, column=COLUMN)
    assert str(by_hand) == "1–2, floor 2, column"
    link = jp.floor_links((LOW, HIGH), gap=0.03, contact=LAW, columns=COLUMN)[2]
    systems = [jp.Buildings((LOW, HIGH), (x,)).system() for x in (by_hand, link)]
    np.testing.assert_array_equal(*map(jax.tree.leaves, systems))
    stated = dataclasses.replace(COLUMN, position=0.25, side="right")
    words = r"links.0: column.position = 0.25 must be left out, as it is 0.\d+ by the elevations"
    refused(words, jp.Buildings, (LOW, HIGH), (FloorLink(0, 1, 1, column=stated),))
    words = "columns: position = 0.25 must be left out: it follows from the elevations"
    refused(words, jp.floor_links, (LOW, HIGH), gap=0.1, columns=stated)
    refused("position = None must be known, and height", lambda: COLUMN.weight)
    pair = jp.Buildings((LOW, HIGH), (by_hand,))
    row, scales = pair.dimensionless()
    ours, other = row.system().links[0], pair.system().links[0]
    np.testing.assert_allclose(ours.weights, other.weights)
    stiffness = float(ours.contact.stiffness) * scales.unit_of("stiffness")
    assert stiffness == pytest.approx(float(other.contact.stiffness), rel=1e-12)
    assert float(ours.column.capacity) * scales.force == pytest.approx(3e5)
    assert "links.0.column.rigidity" in parameters.paths(pair)
    softer = parameters.put(pair, {"links.0.column.rigidity": 2e7})
    assert softer.system().links[0].contact.stiffness < other.contact.stiffness
    # A floor of it counts as checked, the column's do not.
    demand = jp.demand(pair, jp.Ricker(0.01, 0.5, 0.5), jp.TimeGrid(0.005, 100))
    assert demand.checked_floors.startswith(", of 1 of 3 floors")


NEIGHBOURS = jp.Storeys((1.0, 1.0), jp.Rod(jp.ZenerRod(1.0, 0.1, 0.2), 5.0))


def at_column(**more):
    return FloorLink(0, 0, **({"next_floor": 1, "gap": 0.1, "column": COLUMN} | more))


test_what_cannot_be_is_refused = refusals(
    (lambda: Column(-1.0), "Column: rigidity = -1 must be positive"),
    (lambda: Column(1.0, "welded"), "ends = 'welded' must be one of fixed, pinned"),
    (lambda: Column(1.0, side="up"), "side = 'up' must be one of left, right"),
    (lambda: Column(1.0, position=1.0), "position = 1 must be .*above 0 and below 1"),
    (lambda: at_column(friction=0.1), "friction = 0.1 must be left out at a column"),
    (lambda: at_column(contact=jp.Newton(0.5)), "contact = Newton must be KelvinVoigt at a column"),
    (lambda: at_column(contact=jp.Hertz(1e4)), "contact = Hertz must be KelvinVoigt"),
    (lambda: FloorLink(0, 1, gap=(0.1, 0.2), column=COLUMN), "must be of one gap between neig"),
    (lambda: FloorLink(0, 1, 0, next_building=0, column=COLUMN), "must be of one gap between"),
    (
        lambda: jp.Row((NEIGHBOURS, NEIGHBOURS), (at_column(),)),
        "Row: link 1–2, floors 1–2, column: column must have position and height where",
    ),
    (
        lambda: jp.Buildings((LOW, HIGH), (FloorLink(0, 0, 2, gap=0.1, column=COLUMN),)),
        "at 3 m and 11 m, must be within the storey of the column, 3.4 m high",
    ),
    (
        lambda: jp.Buildings((LOW, HIGH), (at_column(next_floor=0),) * 2),
        "links.1.ends = .* must have a closing that does not follow from those",
    ),
    (
        lambda: jp.Link(((0, 1.0), (1, -0.5)), column=COLUMN),
        "column must be left to the links of FloorLink",
    ),
    (
        lambda: jp.floor_links((NEIGHBOURS, NEIGHBOURS), columns=COLUMN),
        "columns must be left out of buildings without heights",
    ),
    (lambda: jp.floor_links((LOW, HIGH), columns=[COLUMN]), "columns, 1 of them, must be one for"),
    (lambda: jp.floor_links((LOW, HIGH), columns=3.0), "columns = 3.0 must be .*Column"),
)


def test_bearings_and_the_ground_have_no_columns():
    """Floors that meet bearings alone are told of, and links to them are refused."""
    bases = [
        jp.on_bearings(x, jp.LeadRubber(2.5, 0.05), 3e5, height=h)[0]
        for x, h in ((LOW, 0.3), (HIGH, 0.6))
    ]
    with pytest.warns(jp.PlausibilityWarning, match="floors 1 of building 1 beside 2"):
        links = jp.floor_links(bases, gap=0.03, columns=COLUMN)
    assert all(min(link.floor, link.other_floor) > 0 or link.column.side for link in links)
    assert all((link.floor, link.other_floor) != (0, 0) for link in links)
    by_hand = (FloorLink(0, 0, 0, gap=0.03, column=COLUMN),)
    refused("bearings and tuned masses have none", jp.Buildings, tuple(bases), by_hand)
    refused(
        "at a column, must be of one gap between neighbours",
        FloorLink,
        0,
        1,
        jp.GROUND,
        column=COLUMN,
    )
