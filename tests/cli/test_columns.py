"""Columns that floors hit in configurations."""

import json

import jax
import numpy as np
import pytest

import jaxpound as jp
from jaxpound.cli.buildings import as_toml
from jaxpound.cli.parameters import Parameters
from tests.cli.commands import layout_of, simulated
from tests.refusals import refusals

HEIGHTS = {"3.0": 2, "[4.2, 3.4]": 2}
STOREYS = "".join(
    f"[[building]]\nstoreys = {{number = {n}, mass = 3e5, period = 0.4, damping_ratio = 0.05, "
    f"height = {heights}}}\n"
    for heights, n in HEIGHTS.items()
)
CONTACT = "contact = {law = 'kelvin-voigt', stiffness = 2e9, restitution = 0.7}\n"
COLUMN = "column = {rigidity = 9.6e7, ends = 'pinned', capacity = 7e5}\n"
SINGLE = (
    f"{STOREYS}[[link]]\nbuilding = 1\nfloor = 2\nnext_floor = 2\ngap = 0.01\n{CONTACT}{COLUMN}"
)
COMMON = f"{STOREYS}[[link]]\nfloors = 'common'\ngap = 0.01\n{CONTACT}{COLUMN}"
BUILDINGS = tuple(
    jp.ShearBuilding.from_period(2, 3e5, 0.4, 0.05, height=height) for height in (3.0, [4.2, 3.4])
)
LAW = jp.KelvinVoigt(2e9, 0.7)
IN_PYTHON = jp.model.Column(9.6e7, "pinned", 7e5)
LINKS = {
    SINGLE: (jp.FloorLink(0, 1, 1, gap=0.01, contact=LAW, column=IN_PYTHON),),
    COMMON: jp.floor_links(BUILDINGS, gap=0.01, contact=LAW, columns=IN_PYTHON),
}


@pytest.mark.parametrize("text", LINKS, ids=["single", "common"])
def test_a_file_is_the_library_s_links_and_is_written_back(text):
    layout = layout_of(text)
    assert repr(layout.buildings.links) == repr(LINKS[text])
    again = layout_of(as_toml(layout.buildings)).buildings
    systems = again.system(), layout.buildings.system()
    assert systems[0].topology == systems[1].topology
    np.testing.assert_allclose(*([*map(float, jax.tree.leaves(x))] for x in systems), rtol=1e-12)


def test_its_numbers_are_parameters_and_its_shear_a_result(tmp_path):
    parameters = Parameters(layout_of(SINGLE))
    assert parameters.keys["link.1.column.rigidity"] == ["links.0.column.rigidity"]
    assert parameters.unit_of("links.0.column.rigidity") == "N m²"
    assert parameters.in_words("links.0.column.capacity") == "shear capacity, 1–2, floor 2–column 2"
    record = tmp_path / "record.txt"
    t = np.arange(0, 3, 0.01)
    np.savetxt(record, np.column_stack([t, 0.5 * np.sin(12 * t) * np.sin(np.pi * t / 3)]))
    _, folder, *_ = simulated(SINGLE, record, tmp_path)
    (link,) = json.loads((folder / "summary.json").read_text())["results"]["links"]
    assert link["column_shear_N"] > 0
    assert link["column_shear_ratio"] == pytest.approx(link["column_shear_N"] / 7e5)


test_what_a_file_may_not_have = refusals(
    ("column = {}", "column lacks the key 'rigidity'"),
    ("column = {rigidity = 1e30}", "rigidity = 1e.30 N m² must be between"),
    ("column = {rigidity = 1e8, ends = 'welded'}", "ends = .*welded"),
    ("column = {rigidity = 1e8, position = 2}", "position = 2 must be between 1e-06 and"),
    ("friction_force = 1e5\ncolumn = {rigidity = 1e8}", "must be left out at a column"),
    of=lambda line: layout_of(f"{STOREYS}[[link]]\nbuilding = 1\nfloor = 2\ngap = 0.01\n{line}"),
)
