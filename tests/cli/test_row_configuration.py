"""Configurations of buildings in a row: what they become, and what is wrong with them."""

import numpy as np
import pytest

import jaxpound as jp
from jaxpound.cli.files import example
from jaxpound.cli.reading import File
from jaxpound.cli.simulate import Simulation
from tests.cli.commands import changed, faults, refusal

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


def layout_of(links, buildings=THREE):
    return read(buildings + links).layout


# --- what a file becomes ------------------------------------------------------------------------


def test_the_example_is_the_library_s_row():
    layout = read(EXAMPLE).layout
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
    assert [repr(x) for x in layout.si.buildings] == [repr(x) for x in buildings]
    assert [repr(x) for x in layout.si.links] == [repr(x) for x in links]
    assert layout.tables == (1, 1, 2, 3)
    row, scales = jp.dimensionless_row(buildings, links)
    assert repr(layout.structures) == repr(row)
    assert repr(layout.scales) == repr(scales)


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
    links = layout_of(f"[[link]]\n{keys}\nfriction_force = 1e4").si.links
    assert ends(links) == expected
    assert all(float(one.friction) == 1e4 and np.isinf(one.gap) for one in links)


def test_a_damper_may_have_no_slip_force():
    (link,) = layout_of("[[link]]\nbuilding = 2\nfloor = 1\nfriction_force = 0").si.links
    assert float(link.friction) == 0


def ends(links):
    return [(one.building, one.floor, one.other_building, one.other_floor) for one in links]


def test_links_at_the_common_floors_of_all_neighbours():
    links = layout_of(
        "[[link]]\nfloors = 'common'\ngap = 0.05", THREE.replace("3.0", "3.5")
    ).si.links
    assert ends(links) == [(0, i, 1, i) for i in range(3)] + [(1, i, 2, i) for i in range(2)]
    assert {float(one.gap) for one in links} == {0.05}


def test_a_published_building_and_one_of_a_single_storey():
    text = "[[building]]\npublished = 'chopra-5'\n[[building]]\nmass = 4e5\nperiod = 0.3\n"
    layout = layout_of("damping_ratio = 0.05\nheight = 3.6\n[[link]]\nfloors='common'\ngap=0", text)
    chopra, block = layout.si.buildings
    assert repr(chopra) == repr(jp.ShearBuilding.published("chopra-5"))
    assert repr(block.storeys[0]) == repr(jp.Building.from_period(4e5, 0.3, 0.05))
    assert block.elevations.tolist() == [3.6]
    assert ends(layout.si.links) == [(0, 0, 1, 0)]


def test_a_building_alone_needs_no_link():
    assert layout_of("", "[[building]]\npublished = 'chopra-5'").si.links == ()


# --- what is wrong ------------------------------------------------------------------------------

LISTED = """[[building]]
[building.storeys]
masses = [2e5, 3e5]
stiffnesses = [1e8, 1e8]
order = 0.5
tau_f = 3e-3
tau_x = 4e-2"""

OF_STOREYS = r"""
stiffnesses = [1e8] => [[building]] 1 storeys stiffnesses, 1 of t
tau_x = [0.04, 0.04, 0.04] => storeys tau_x, 3 of them, must be 2, as m
tau_x = 0.04 ; heights = [3] => storeys heights, 1 of them, must be 2
masses = [2e5, -3e5]
    => [[building]] 1 storeys masses: storey 2 = -300000 kg must be between 0.001 and 1e+10 kg
masses = 2e5 => storeys masses = 200000.0 must be a list with a number
masses = [] => storeys masses = [] must be a list with a numbe
stiffnesses = [1e8, 'soft']
    => [[building]] 1 storeys stiffnesses: storey 2 = "soft" must be a finite number
stiffnesses = true => storeys stiffnesses = true must be a list
tau_x = [4e-2, 1e-3] => [[building]] 1 storeys storey 2: tau_x = 0.001 s^order must be
tau_x -> nothing => [[building]] 1 storeys lacks tau_x; give number, mass, period
tau_x = 4e-2 ; period = 1.0 => storeys must not have masses here; give n
tau_x -> tau_y = 4e-2 => [[building]] 1 storeys has an unknown key 'tau_y'; did
stiffnesses = [1e15, 1e15] => [[building]] 1 natural period = 6.
"""
OF_ROWS = r"""
[[building]] ; storeys = 5 => [[building]] 1 storeys = 5 must be a table
[[building]] ; floors = 5 => [[building]] 1 has an unknown key 'floors';
[[building]] ; storeys = {number = 0, mass = 1e5, period = 1, damping_ratio = 0.05}
    => [[building]] 1 storeys number = 0 must be from 1 to 1000
[[building]] ; storeys = {number = 3, mass = 1e5, period = 1, damping_ratio = 0.05, order =
    [0.5, 0.5, 0.5]} => [[building]] 1 storeys must not have a list of order here; give number, mass
[[building]] ; storeys = {number = 3, mass = 1e5, period = 1, damping_ratio = 0.9}
    => [[building]] 1 storeys damping_ratio = 0.9 must be
[[building]] ; storeys = {number = 3} => [[building]] 1 storeys lacks mass, period, damping
[[building]] => [[building]] 1 lacks its storeys; give storeys, published, or mass, period
[[building]] ; period = 1.0 => [[building]] 1 lacks mass, damping_ratio; give mass, period
[[building]] ; published = 'chopra-6'
    => [[building]] 1 published: unknown name 'chopra-6'; did you mean 'chopra-5'?
[[building]] ; published = 'chopra-5' ; mass = 1e5 => 1 must not have mass beside published
[building] ; mass = 1e5 => building = {mass = 100000.0} must be tables, each below a line [[
building = [] => the top level lacks a table [[building]]
# alone ; [[link]] ; floors = 'common' ; gap = 0 => the top level lacks a table [[building]]
gap = 0.1 ; THREE => gap must not be given beside [[building]]: these belong to two forms
THREE ; [damper] ; friction_force = 1e3 => [damper] must not be given beside [[building]]
[building_1] ; mass = 4e5 ; period = 1 ; damping_ratio = 0 ; [[link]] ; floor = 1 => [[link]] 1
[[link]] ; building = 4 ; floor = 1 ; gap = 0 => [[link]] 1 building = 4 must be from 1 to 3: th
[[link]] ; building = 3 ; floor = 1 ; gap = 0
    => [[link]] 1 next_building = 4 must be from 1 to 3: th
[[link]] ; building = 3 ; floors = 'common' ; gap = 0
    => [[link]] 1 building = 3 must be from 1 to 2, with
[[link]] ; building = 1 ; floor = 4 ; gap = 0
    => [[link]] 1 floor = 4 must be from 1 to 3: building 1 has 3 floors
[[link]] ; building = 1 ; floor = 0 ; gap = 0 => [[link]] 1 floor = 0 must be from 1 to 1000
[[link]] ; building = 2 ; floor = 3 ; gap = 0
    => [[link]] 1 next_floor = 3 must be from 1 to 2: building 3 has 2 floors
[[link]] ; building = 1 ; floor = 1 ; next_building = 3 ; gap = 0
    => [[link]] 1 next_building = 3 must be 2 (to the right), 1 itself or the ground
[[link]] ; building = 1 ; floor = 1 ; next_floor = 1 ; next_building = 1 ; gap = 0
    => [[link]] 1 in 1, floor 1 must be two different floors
[[link]] ; building = 1 ; floor = 2 ; gap = 0 => [[link]] 1 1–2, floor 2, at 6 m and 7 m, must
    be at one height; next_floor says which floor is meant
[[link]] ; building = 1 ; floors = 'common' ; gap = 0
    => [[link]] 1 floors = "common": buildings 1 and 2 must have floors at the same height
[[link]] ; building = 2 ; floors = 'comon' ; gap = 0
    => [[link]] 1 floors = "comon" must be "common" or a l
[[link]] ; building = 2 ; floors = [] ; gap = 0
    => [[link]] 1 floors = [] must be "common" or a list of fl
[[link]] ; building = 2 ; floors = [0] ; gap = 0
    => [[link]] 1 floors = [0] must be "common" or a list of floors, c
[[link]] ; building = 2 ; gap = 0 => [[link]] 1 must have floor or floors, one of them
[[link]] ; building = 2 ; floor = 1 ; floors = [1] ; gap = 0
    => [[link]] 1 must have floor or floors, one o
[[link]] ; floor = 2 ; gap = 0 => [[link]] 1 lacks the key 'building'
[[link]] ; building = 2 ; floors = [1] ; next_floor = 1 ; gap = 0
    => [[link]] 1 next_floor must not be g
[[link]] ; building = 2 ; floor = 1 ; next_floor = 1 ; next_building = 'ground' ; gap = 0
    => [[link]] 1 next_floor must not be given with ground
[[link]] ; building = 2 ; floors = 'common' ; next_building = 3 ; gap = 0
    => [[link]] 1 next_building must not be given with floors = "common"
[[link]] ; building = 2 ; floor = 1 ; next_building = 'grund' ; gap = 0
    => [[link]] 1 next_building = "grund" must be the number of a building, or "ground"
[[link]] ; building = 2 ; floor = 1 ; gap = -0.1
    => [[link]] 1 gap = -0.1 m must be between 0 and 10 m (
[[link]] ; building = 2 ; floor = 1 ; friction_force = -1
    => [[link]] 1 friction_force = -1 N must be between 0 and 1e+10 N (
[[link]] ; building = 2 ; floor = 1
    => [[link]] 1 must have friction_force or gap, at least one of them
[[link]] ; building = 2 ; floor = 1 ; friction = 1e3
    => [[link]] 1 has an unknown key 'friction'; did
[[link]] ; building = 2 ; floor = 1 ; contact = {law = 'hertz', stiffness = 1e9}
    => [[link]] 1 lacks the key 'gap', which contact needs
[[link]] ; building = 2 ; floor = 1 ; gap = 0 ; contact = {law = 'hertz'}
    => [[link]] 1 contact lacks the key 'stiffness', which law = "hertz" needs
[[link]] ; building = 2 ; floor = 1 ; gap = 0 ; contact = 1e9
    => [[link]] 1 contact = 1e+09 must be a table
THREE ; [[link]] ; building = 2 ; floors = 'common' ; gap = 0 ; [[link]] ; building = 2 ; floor
    = 2 ; gap = 0.1 => [[link]] 2 (2–3, floor 2) must not stand where [[link]] 1 does
THREE ; [[link]] ; building = 2 ; floor = 1 ; gap = 0 ; [[link]] ; building = 2 ; floor = 5 ;
    gap = 0.1 => [[link]] 2 floor = 5 must be from 1 to 3: building 2 has 3 floors
THREE ; [[link]] ; building = 2 ; floor = 1 ; gap = 0 ; contact = {law = 'hertz', stiffness =
    1e9} ; [run] ; friction = 'switching' => [run] friction = "switching" must be "event-resolved"
    where a [[link]] has contact
THREE ; [[link]] ; building = 2 ; floor = 2 ; gap = 0 ; [[link]] ; building = 1 ; floor = 2 ;
    next_floor = 2 ; gap = 0 ; [run] ; friction = 'switching' => [run] friction = "switching" must
    be "event-resolved" where floors have several links
"""
CASES = [(changed(LISTED, changes), says) for changes, says in faults(OF_STOREYS)]
CASES += [
    (("THREE ; " * text.startswith("[[link]]") + text).replace(" ; ", "\n"), says)
    for text, says in faults(OF_ROWS)
]


@pytest.mark.parametrize(("text", "says"), CASES, ids=[says[:50] for _, says in CASES])
def test_a_faulty_row(text, says, pulse, tmp_path, capsys):
    path, out = tmp_path / "row.toml", tmp_path / "out"
    path.write_text(text.replace("THREE", THREE))
    line = refusal(capsys, "simulate", "--record", pulse, "--config", path, "--out", out)
    assert line.startswith(f"jaxpound: error: {path}: ")
    assert says in line
    assert not out.exists()
