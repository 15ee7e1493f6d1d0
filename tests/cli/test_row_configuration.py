"""Configurations of buildings in a row: what they become, and what is wrong with them."""

import re

import numpy as np
import pytest

import jaxpound as jp
from jaxpound.cli import main as cli
from jaxpound.cli.files import example
from jaxpound.cli.reading import File, entries
from jaxpound.cli.row import FloorLink, RowBuilding, Storeys
from jaxpound.cli.simulate import Simulation
from tests.cli.commands import edited, refusal

EXAMPLE = example("simulate", "row")
THREE = """
[[building]]
storeys = {number = 3, mass = 2e5, period = 0.3, damping_ratio = 0.05, height = 3.0}
[[building]]
storeys = {number = 3, mass = 2e5, period = 0.4, damping_ratio = 0.05, height = 3.5}
[[building]]
storeys = {number = 2, mass = 2e5, period = 0.2, damping_ratio = 0.05, height = 3.5}
"""


def read(text):
    return File("row.toml", text).read(Simulation)


def form_of(links, buildings=THREE):
    return read(buildings + links).form


# --- what a file becomes ------------------------------------------------------------------------


def test_the_example_is_printed_and_names_every_key(capsys):
    with pytest.raises(SystemExit, match="0"):
        cli.main(["simulate", "--example-config", "row"])
    text = capsys.readouterr().out
    assert text == EXAMPLE
    for kind in (RowBuilding, Storeys, FloorLink):
        for key in entries(kind):
            words = key if key == "stiffness" else rf"(^|[{{,] ?|# ){key}( = |\s+#)"
            assert re.search(rf"(?m){words}", text), key


def test_the_example_is_the_library_s_row():
    form = read(EXAMPLE).form
    buildings = (
        jp.ShearBuilding.from_period(2, 200e3, 0.25, 0.05),
        jp.ShearBuilding.of_storeys(
            [250e3, 250e3, 200e3], [150e6, 130e6, 100e6], 0.5, 0.003, 0.04, 3.0
        ),
        jp.ShearBuilding.from_period(2, 200e3, 0.3, 0.05),
    )
    law = jp.KelvinVoigt(stiffness=2e9, restitution=0.65)
    links = (
        *jp.floor_links(buildings[:2], gap=0.02, contact=law),
        jp.FloorLink(1, 1, friction=60e3, gap=0.03, contact=law),
        jp.FloorLink(1, 0, friction=100e3, next_building=1),
    )
    assert [repr(x) for x in form.buildings] == [repr(x) for x in buildings]
    assert [repr(x) for x in form.links] == [repr(x) for x in links]
    assert form.tables == (1, 1, 2, 3)
    row, scales = jp.dimensionless_row(buildings, links)
    assert repr(form.structures) == repr(row)
    assert repr(form.scales) == repr(scales)


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ("building = 2\nfloors = 'common'", [(1, 0, 2, 0), (1, 1, 2, 1)]),
        ("building = 2\nfloors = [2]", [(1, 1, 2, 1)]),
        ("building = 1\nfloor = 3\nnext_floor = 2", [(0, 2, 1, 1)]),
        ("building = 1\nfloors = [1, 3]\nnext_building = 1", [(0, 0, 0, -1), (0, 2, 0, 1)]),
        ("building = 3\nfloor = 2\nnext_building = 'ground'", [(2, 1, -1, -1)]),
    ],
)
def test_where_links_are(keys, expected):
    links = form_of(f"[[link]]\n{keys}\nfriction_force = 1e4").links
    assert ends(links) == expected
    assert all(float(one.friction) == 1e4 and np.isinf(one.gap) for one in links)


def test_a_damper_may_have_no_slip_force():
    (link,) = form_of("[[link]]\nbuilding = 2\nfloor = 1\nfriction_force = 0").links
    assert float(link.friction) == 0


def ends(links):
    return [(one.building, one.floor, one.other_building, one.other_floor) for one in links]


def test_links_at_the_common_floors_of_all_neighbours():
    links = form_of("[[link]]\nfloors = 'common'\ngap = 0.05", THREE.replace("3.0", "3.5")).links
    assert ends(links) == [(0, i, 1, i) for i in range(3)] + [(1, i, 2, i) for i in range(2)]
    assert {float(one.gap) for one in links} == {0.05}


def test_a_published_building_and_one_of_a_single_storey():
    text = "[[building]]\npublished = 'chopra-5'\n[[building]]\nmass = 4e5\nperiod = 0.3\n"
    form = form_of("damping_ratio = 0.05\nheight = 3.6\n[[link]]\nfloors='common'\ngap=0", text)
    chopra, block = form.buildings
    assert repr(chopra) == repr(jp.ShearBuilding.published("chopra-5"))
    assert repr(block.storeys[0]) == repr(jp.Building.from_period(4e5, 0.3, 0.05))
    assert block.elevations.tolist() == [3.6]
    assert ends(form.links) == [(0, 0, 1, 0)]


def test_a_building_alone_needs_no_link():
    assert form_of("", "[[building]]\npublished = 'chopra-5'").links == ()


# --- what is wrong ------------------------------------------------------------------------------

LIST = "masses = [2e5, 3e5]\nstiffnesses = [1e8, 1e8]\norder = 0.5\ntau_f = 3e-3\ntau_x = 4e-2"


def storeys(changes):
    """A building of two listed storeys, with some keys changed."""
    return f"[[building]]\n[building.storeys]\n{edited(LIST, changes)}"


FAULTS = [
    (storeys({"stiffnesses": "stiffnesses = [1e8]"}), "[[building]] 1 storeys stiffnesses, 1 of t"),
    (storeys({"tau_x": "tau_x = [0.04, 0.04, 0.04]"}), "storeys tau_x, 3 of them, must be 2, as m"),
    (storeys({"tau_x": "tau_x = 0.04\nheights = [3]"}), "storeys heights, 1 of them, must be 2"),
    (
        storeys({"masses": "masses = [2e5, -3e5]"}),
        "[[building]] 1 storeys masses: storey 2 = -300000 kg must be between 0.001 and 1e+10 kg",
    ),
    (storeys({"masses": "masses = 2e5"}), "storeys masses = 200000.0 must be a list with a number"),
    (storeys({"masses": "masses = []"}), "storeys masses = [] must be a list with a numbe"),
    (
        storeys({"stiffnesses": "stiffnesses = [1e8, 'soft']"}),
        '[[building]] 1 storeys stiffnesses: storey 2 = "soft" must be a finite number',
    ),
    (storeys({"stiffnesses": "stiffnesses = true"}), "storeys stiffnesses = true must be a list"),
    (
        storeys({"tau_x": "tau_x = [4e-2, 1e-3]"}),
        "[[building]] 1 storeys storey 2: tau_x = 0.001 s^order must be",
    ),
    (storeys({"tau_x": ""}), "[[building]] 1 storeys lacks tau_x; give number, mass, period"),
    (storeys({"tau_x": "tau_x = 4e-2\nperiod = 1.0"}), "storeys must not have masses here; give n"),
    (storeys({"tau_x": "tau_y = 4e-2"}), "[[building]] 1 storeys has an unknown key 'tau_y'; did"),
    (
        storeys({"stiffnesses": "stiffnesses = [1e15, 1e15]"}),
        "[[building]] 1 natural period = 6.",
    ),
    ("[[building]]\nstoreys = 5", "[[building]] 1 storeys = 5 must be a table"),
    ("[[building]]\nfloors = 5", "[[building]] 1 has an unknown key 'floors'; "),
    (
        "[[building]]\nstoreys = {number = 0, mass = 1e5, period = 1, damping_ratio = 0.05}",
        "[[building]] 1 storeys number = 0 must be from 1 to 1000",
    ),
    (
        "[[building]]\nstoreys = {number = 3, mass = 1e5, period = 1, damping_ratio = 0.05, "
        "order = [0.5, 0.5, 0.5]}",
        "[[building]] 1 storeys must not have a list of order here; give number, mass",
    ),
    (
        "[[building]]\nstoreys = {number = 3, mass = 1e5, period = 1, damping_ratio = 0.9}",
        "[[building]] 1 storeys damping_ratio = 0.9 must be",
    ),
    ("[[building]]\nstoreys = {number = 3}", "[[building]] 1 storeys lacks mass, period, damping"),
    ("[[building]]", "[[building]] 1 lacks its storeys; give storeys, published, or mass, period"),
    ("[[building]]\nperiod = 1.0", "[[building]] 1 lacks mass, damping_ratio; give mass, period"),
    (
        "[[building]]\npublished = 'chopra-6'",
        "[[building]] 1 published: unknown name 'chopra-6'; did you mean 'chopra-5'?",
    ),
    ("[[building]]\npublished = 'chopra-5'\nmass = 1e5", "1 must not have mass beside published"),
    ("[building]\nmass = 1e5", "building = {mass = 100000.0} must be tables, each below a line [["),
    ("building = []", "the top level lacks a table [[building]]"),
    ("[[link]]\nfloors = 'common'\ngap = 0", "the top level lacks a table [[building]]"),
    ("gap = 0.1\n" + THREE, "gap must not be given beside [[building]]: these belong to two forms"),
    (THREE + "[damper]\nfriction_force = 1e3", "[damper] must not be given beside [[building]]"),
    ("[building_1]\nmass = 4e5\nperiod = 1\ndamping_ratio = 0\n[[link]]\nfloor = 1", "[[link]] 1"),
    *(
        (f"{THREE}[[link]]\n{keys}", f"[[link]] 1 {says}")
        for keys, says in (
            (
                "building = 4\nfloor = 1\ngap = 0",
                "building = 4 must be from 1 to 3: th",
            ),
            (
                "building = 3\nfloor = 1\ngap = 0",
                "next_building = 4 must be from 1 to 3: th",
            ),
            ("building = 3\nfloors = 'common'\ngap = 0", "building = 3 must be from 1 to 2, with"),
            (
                "building = 1\nfloor = 4\ngap = 0",
                "floor = 4 must be from 1 to 3: building 1 has 3 floors",
            ),
            ("building = 1\nfloor = 0\ngap = 0", "floor = 0 must be from 1 to 1000"),
            (
                "building = 2\nfloor = 3\ngap = 0",
                "next_floor = 3 must be from 1 to 2: building 3 has 2 floors",
            ),
            (
                "building = 1\nfloor = 1\nnext_building = 3\ngap = 0",
                "next_building = 3 must be 2 (to the right), 1 itself or the ground",
            ),
            (
                "building = 1\nfloor = 1\nnext_floor = 1\nnext_building = 1\ngap = 0",
                "in 1, floor 1 must be two different floors",
            ),
            (
                "building = 1\nfloor = 2\ngap = 0",
                "1–2, floor 2, at 6 m and 7 m, must be at one "
                "height; next_floor says which floor is meant",
            ),
            (
                "building = 1\nfloors = 'common'\ngap = 0",
                'floors = "common": buildings 1 and 2 must have floors at the same height',
            ),
            ("building = 2\nfloors = 'comon'\ngap = 0", 'floors = "comon" must be "common" or a l'),
            ("building = 2\nfloors = []\ngap = 0", 'floors = [] must be "common" or a list of fl'),
            (
                "building = 2\nfloors = [0]\ngap = 0",
                'floors = [0] must be "common" or a list of floors, c',
            ),
            ("building = 2\ngap = 0", "must have floor or floors, one of them"),
            ("building = 2\nfloor = 1\nfloors = [1]\ngap = 0", "must have floor or floors, one o"),
            ("floor = 2\ngap = 0", "lacks the key 'building'"),
            (
                "building = 2\nfloors = [1]\nnext_floor = 1\ngap = 0",
                "next_floor must not be g",
            ),
            (
                "building = 2\nfloor = 1\nnext_floor = 1\nnext_building = 'ground'\ngap = 0",
                "next_floor must not be given with ground",
            ),
            (
                "building = 2\nfloors = 'common'\nnext_building = 3\ngap = 0",
                'next_building must not be given with floors = "common"',
            ),
            (
                "building = 2\nfloor = 1\nnext_building = 'grund'\ngap = 0",
                'next_building = "grund" must be the number of a building, or "ground"',
            ),
            ("building = 2\nfloor = 1\ngap = -0.1", "gap = -0.1 m must be between 0 and 10 m ("),
            (
                "building = 2\nfloor = 1\nfriction_force = -1",
                "friction_force = -1 N must be between 0 and 1e+10 N (",
            ),
            ("building = 2\nfloor = 1", "must have friction_force or gap, at least one of them"),
            (
                "building = 2\nfloor = 1\nfriction = 1e3",
                "has an unknown key 'friction'; did",
            ),
            (
                "building = 2\nfloor = 1\ncontact = {law = 'hertz', stiffness = 1e9}",
                "lacks the key 'gap', which contact needs",
            ),
            (
                "building = 2\nfloor = 1\ngap = 0\ncontact = {law = 'hertz'}",
                "contact lacks the key 'stiffness', which law = \"hertz\" needs",
            ),
            ("building = 2\nfloor = 1\ngap = 0\ncontact = 1e9", "contact = 1e+09 must be a table"),
        )
    ),
    (
        f"{THREE}[[link]]\nbuilding = 2\nfloors = 'common'\ngap = 0\n"
        "[[link]]\nbuilding = 2\nfloor = 2\ngap = 0.1",
        "[[link]] 2 (2–3, floor 2) must not stand where [[link]] 1 does",
    ),
    (
        f"{THREE}[[link]]\nbuilding = 2\nfloor = 1\ngap = 0\n"
        "[[link]]\nbuilding = 2\nfloor = 5\ngap = 0.1",
        "[[link]] 2 floor = 5 must be from 1 to 3: building 2 has 3 floors",
    ),
    (
        f"{THREE}[[link]]\nbuilding = 2\nfloor = 1\ngap = 0\n"
        "contact = {law = 'hertz', stiffness = 1e9}\n[run]\nfriction = 'switching'",
        '[run] friction = "switching" must be "event-resolved" where a [[link]] has contact',
    ),
    (
        f"{THREE}[[link]]\nbuilding = 2\nfloor = 2\ngap = 0\n"
        "[[link]]\nbuilding = 1\nfloor = 2\nnext_floor = 2\ngap = 0\n"
        "[run]\nfriction = 'switching'",
        '[run] friction = "switching" must be "event-resolved" where floors have several links',
    ),
]


@pytest.mark.parametrize(("text", "says"), FAULTS, ids=[says[:50] for _, says in FAULTS])
def test_a_faulty_row(text, says, pulse, tmp_path, capsys):
    path, out = tmp_path / "row.toml", tmp_path / "out"
    path.write_text(text)
    line = refusal(capsys, "simulate", "--record", pulse, "--config", path, "--out", out)
    assert line.startswith(f"jaxpound: error: {path}: ")
    assert says in line
    assert not out.exists()
