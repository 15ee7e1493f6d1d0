"""Configurations of buildings in a row: what they become, and what is wrong with them."""

import numpy as np
import pytest

import jaxpound as jp
from jaxpound.cli.files import example
from tests.cli.commands import changed, faults, layout_of, refusal

EXAMPLE = example("simulate", "row")
THREE = """
[[building]]
storeys = {number = 3, mass = 2e5, period = 0.3, damping_ratio = 0.05, height = 3.0}
[[building]]
storeys = {number = 3, mass = 2e5, period = 0.4, damping_ratio = 0.05, height = 3.5}
[[building]]
storeys = {number = 2, mass = 2e5, period = 0.2, damping_ratio = 0.05, height = 3.5}
"""


def test_the_example_is_the_library_s_row():
    layout = layout_of(EXAMPLE)
    masses, stiffnesses = [250e3, 250e3, 200e3], [150e6, 130e6, 100e6]
    buildings = (
        jp.ShearBuilding.from_period(2, 200e3, 0.25, 0.05),
        jp.ShearBuilding.of_storeys(masses, stiffnesses, 0.5, 0.003, 0.04, 3.0),
        jp.ShearBuilding.from_period(2, 200e3, 0.3, 0.05),
    )
    law = jp.KelvinVoigt(stiffness=2e9, restitution=0.65)
    links = (
        *jp.floor_links(buildings[:2], gap=0.02, contact=law),
        jp.FloorLink(1, 1, friction=60e3, gap=0.03, contact=law),
        jp.FloorLink(1, 0, friction=100e3, next_building=1),
    )
    assert repr(layout.buildings) == repr(jp.Buildings(buildings, links))
    assert layout.tables == (1, 1, 2, 3)


def test_a_warning_names_the_table_of_a_link_and_its_floors():
    links = ("building = 2\nfloors = 'common'", "building = 2\nfloor = 2\nnext_building = 2")
    of_first = f"[[link]]\n{links[0]}\nfriction_force = 1e5\n"
    says = r"^jaxpound: \[\[link\]\] 2 \(in 2, floors 1–2\): slip force = 1 N should be 0 or"
    with pytest.warns(jp.PlausibilityWarning, match=says):
        layout_of(f"{THREE}{of_first}[[link]]\n{links[1]}\nfriction_force = 1")


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
    links = layout_of(f"{THREE}[[link]]\n{keys}\nfriction_force = 1e4").buildings.links
    assert ends(links) == expected
    assert all(float(one.friction) == 1e4 and np.isinf(one.gap) for one in links)


def test_a_lighter_roof_and_a_higher_first_storey_with_a_period():
    text = THREE.replace("height = 3.5", "height = [4.0, 3.2, 3.2]", 1)
    text = text.replace("mass = 2e5, period = 0.2", "mass = [2e5, 1.2e5], period = 0.2")
    frames = (3, 2e5, 0.3, 3.0), (3, 2e5, 0.4, (4.0, 3.2, 3.2)), (2, (2e5, 1.2e5), 0.2, 3.5)
    expected = [jp.ShearBuilding.from_period(*x, 0.05, height=height) for *x, height in frames]
    assert [*map(repr, layout_of(text).shear_buildings)] == [*map(repr, expected)]


def test_links_and_buildings_of_other_kinds():
    text = f"{THREE}[[link]]\nbuilding = 2\nfloor = 1\nfriction_force = 0"
    (link,) = layout_of(text).buildings.links
    assert float(link.friction) == 0
    level = THREE.replace("3.0", "3.5")
    links = layout_of(f"{level}[[link]]\nfloors = 'common'\ngap = 0.05").buildings.links
    assert ends(links) == [(0, i, 1, i) for i in range(3)] + [(1, i, 2, i) for i in range(2)]
    assert {float(one.gap) for one in links} == {0.05}
    text = "[[building]]\npublished = 'chopra-5'\n[[building]]\nmass = 4e5\nperiod = 0.3\n"
    text += "damping_ratio = 0.05\nheight = 3.6\n[[link]]\nfloors='common'\ngap=0"
    layout = layout_of(text)
    chopra, block = layout.shear_buildings
    assert repr(chopra) == repr(jp.ShearBuilding.published("chopra-5"))
    assert repr(block.storeys[0]) == repr(jp.Building.from_period(4e5, 0.3, 0.05))
    assert block.elevations.tolist() == [3.6]
    assert ends(layout.buildings.links) == [(0, 0, 1, 0)]
    assert layout_of("[[building]]\npublished = 'chopra-5'").buildings.links == ()


def ends(links):
    return [(one.building, one.floor, one.other_building, one.other_floor) for one in links]


LISTED = """[[building]]
[building.storeys]
masses = [2e5, 3e5]
stiffnesses = [1e8, 1e8]
order = 0.5
tau_f = 3e-3
tau_x = 4e-2"""

OF_STOREYS = r"""
stiffnesses = [1e8] => [[building]] 1 storeys stiffnesses, 1 of t
tau_x = [0.04, 0.04, 0.04] => storeys tau_x, 3 of them, must be 2, a number
tau_x = 0.04 ; heights = [3] => storeys heights, 1 of them, must be 2
masses = [2e5, -3e5]
    => [[building]] 1 storeys masses: storey 2 = -300000 kg must be between 0.001 and 1e+10 kg
masses = 2e5 => storeys masses = 200000.0 must be a list with a number
masses = [] => storeys masses = [] must be a list with a numbe
stiffnesses = [1e8, 'soft']
    => [[building]] 1 storeys stiffnesses: storey 2 = "soft" must be a finite number
stiffnesses = true => storeys stiffnesses = true must be a list
tau_x = [4e-2, 1e-3] => [[building]] 1 storeys storey 2: tau_x = 0.001 must be
tau_x -> nothing => [[building]] 1 storeys lacks tau_x; give masses, stiffnesses, order
tau_x = 4e-2 ; period = 1.0 => storeys must not have period here; give n
tau_x -> tau_y = 4e-2 => [[building]] 1 storeys has an unknown key 'tau_y'; did
stiffnesses = [1e15, 1e15] => [[building]] 1 natural period = 6.
"""
OF_ROWS = r"""
[[building]] => [[building]] 1 lacks storeys; give storeys, or published, or mass, period
[[building]] ; published = 'chopra-5' ; mass = 1e5 => 1 must not have mass here; give published
[building] ; mass = 1e5 => building = {mass = 100000.0} must be tables, each below a line [[
building = [] => the top level lacks a table [[building]]
# alone ; [[link]] ; floors = 'common' ; gap = 0 => lacks building; give building (link)
gap = 0.1 ; THREE => must not have gap here; give building (link), or gap, building_1
THREE ; [damper] ; friction_force = 1e3 => must not have damper here; give building (link)
[building_1] ; mass = 4e5 ; period = 1 ; damping_ratio = 0 ; [[link]] ; floor = 1 => [[link]] 1
THREE ; [[link]] ; building = 2 ; floors = 'common' ; gap = 0 ; [[link]] ; building = 2 ; floor = 2
    ; gap = 0.1 => [[link]] 2 (2–3, floor 2) must not stand where [[link]] 1 does
THREE ; [[link]] ; building = 2 ; floor = 1 ; gap = 0 ; [[link]] ; building = 2 ; floor = 5 ; gap =
    0.1 => [[link]] 2 floor = 5 must be from 1 to 3: building 2 has 3 floors
THREE ; [[link]] ; building = 2 ; floor = 1 ; gap = 0 ; contact = {law = 'hertz', stiffness = 1e9} ;
    [run] ; friction = 'switching' => [run] friction = "switching" must be "event-resolved" where a
    link has contact
THREE ; [[link]] ; building = 2 ; floor = 2 ; gap = 0 ; [[link]] ; building = 1 ; floor = 2 ;
    next_floor = 2 ; gap = 0 ; [run] ; friction = 'switching' => [run] friction = "switching" must
    be "event-resolved" where a link has contact or velocity_friction, or floors have several links
"""
# Below [[building]], and of the first link of three buildings.
OF_BUILDINGS = r"""
storeys = 5 => storeys = 5 must be a table
floors = 5 => has an unknown key 'floors';
storeys = {number = 4, mass = [1e5, 2e5], period = 1, damping_ratio = 0.05}
    => storeys mass, 2 of them, must be 4, a number for each storey
storeys = {number = 3, mass = 1e5, period = 1, damping_ratio = 0.05, height = [3.0, 3.0]}
    => storeys height, 2 of them, must be 3, a number for each storey
storeys = {number = 0, mass = 1e5, period = 1, damping_ratio = 0.05}
    => storeys number = 0 must be from 1 to 1000
storeys = {number = 3, mass = 1e5, period = 1, damping_ratio = 0.05, order = [0.5, 0.5, 0.5]}
    => storeys must not have a list of order with number
storeys = {number = 3, mass = 1e5, period = 1, damping_ratio = 0.9}
    => storeys damping_ratio = 0.9 must be
storeys = {number = 3} => storeys lacks mass, period, damping
period = 1.0 => lacks mass, damping_ratio; give mass, period
published = 'chopra-6' => published: unknown name 'chopra-6'; did you mean 'chopra-5'?
"""
OF_LINKS = r"""
building = 4 ; floor = 1 ; gap = 0 => building = 4 must be from 1 to 3: th
building = 3 ; floor = 1 ; gap = 0 => next_building = 4 must be from 1 to 3: th
building = 3 ; floors = 'common' ; gap = 0 => building = 3 must be from 1 to 2, with
building = 1 ; floor = 4 ; gap = 0 => floor = 4 must be from 1 to 3: building 1 has 3 floors
building = 1 ; floor = 0 ; gap = 0 => floor = 0 must be from 1 to 1000
building = 2 ; floor = 3 ; gap = 0 => next_floor = 3 must be from 1 to 2: building 3 has 2 floors
building = 1 ; floor = 1 ; next_building = 3 ; gap = 0
    => next_building = 3 must be 2 (to the right), 1 itself or the ground
building = 1 ; floor = 1 ; next_floor = 1 ; next_building = 1 ; gap = 0
    => in 1, floor 1 must be two different floors
building = 1 ; floor = 2 ; gap = 0
    => 1–2, floor 2, at 6 m and 7 m, must be at one height; next_floor says which floor is meant
building = 1 ; floors = 'common' ; gap = 0
    => buildings 1 and 2 must have floors at the same height
building = 2 ; floors = 'comon' ; gap = 0 => floors = "comon" must be "common" or a l
building = 2 ; floors = [] ; gap = 0 => floors = [] must be "common" or a list of fl
building = 2 ; floors = [0] ; gap = 0 => floors = [0] must be "common" or a list of floors, c
building = 2 ; gap = 0 => lacks floor; give building, floor (next_building, next_floor), or
building = 2 ; floor = 1 ; floors = [1] ; gap = 0 => must not have floors here; give
floor = 2 ; gap = 0 => lacks building; give building, floor
building = 2 ; floors = [1] ; next_floor = 1 ; gap = 0 => must not have floors here; give
building = 2 ; floor = 1 ; next_floor = 1 ; next_building = 'ground' ; gap = 0
    => next_floor must not be given with ground
building = 2 ; floors = 'common' ; next_building = 3 ; gap = 0
    => must not have next_building here; give floors (building), or building, floor
building = 2 ; floor = 1 ; next_building = 'grund' ; gap = 0
    => next_building = "grund" must be the number of a building, "ground", or a support
building = 2 ; floor = 1 ; gap = -0.1 => gap = -0.1 m must be between 0 and 10 m (
building = 2 ; floor = 1 ; friction_force = -1
    => friction_force = -1 N must be between 0 and 1e+10 N (
building = 2 ; floor = 1 => must have one of friction_force, gap, damper, velocity_friction
building = 2 ; floor = 1 ; friction = 1e3 => has an unknown key 'friction'; did
building = 2 ; floor = 1 ; contact = {law = 'hertz', stiffness = 1e9}
    => lacks the key 'gap', which contact needs
building = 2 ; floor = 1 ; gap = 0 ; contact = {law = 'hertz'}
    => contact lacks the key 'stiffness', which law = "hertz" needs
building = 2 ; floor = 1 ; gap = 0 ; contact = 1e9 => contact = 1e+09 must be a table
"""
CASES = [(changed(LISTED, changes), says) for changes, says in faults(OF_STOREYS)]
ROWS = [
    *faults(OF_ROWS),
    *([f"[[building]] ; {x}", f"[[building]] 1 {says}"] for x, says in faults(OF_BUILDINGS)),
    *([f"THREE ; [[link]] ; {x}", f"[[link]] 1 {says}"] for x, says in faults(OF_LINKS)),
]
CASES += [(text.replace(" ; ", "\n"), says) for text, says in ROWS]


@pytest.mark.parametrize(("text", "says"), CASES, ids=[says[:50] for _, says in CASES])
def test_a_faulty_row(text, says, pulse, tmp_path, capsys):
    path, out = tmp_path / "row.toml", tmp_path / "out"
    path.write_text(text.replace("THREE", THREE))
    line = refusal(capsys, "simulate", "--record", pulse, "--config", path, "--out", out)
    assert line.startswith(f"jaxpound: error: {path}: ")
    assert says in line


def test_common_floors_without_a_partner_are_told_of_once():
    rod = "order = 1.0, tau_f = 1e-5, tau_x = 5e-3"
    tables = [
        f"[[building]]\nstoreys = {{masses = {m}, stiffnesses = 5e8, {rod}, heights = {h}}}\n"
        for m, h in (([3e5] * 3, [4.0, 3.2, 3.2]), ([3e5] * 2, [4.0, 3.6]))
    ]
    rule = "^jaxpound: floors 2 of building 1 beside 2 and 2 of building 2 beside 1 have no floor"
    with pytest.warns(jp.PlausibilityWarning, match=rule) as told:
        layout = layout_of("".join(tables) + "[[link]]\nfloors = 'common'\ngap = 0.1\n")
    assert len(told) == len(layout.buildings.links) == 1
