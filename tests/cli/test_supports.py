"""Bridges in files: decks on supports that move apart under a wave that travels."""

import numpy as np
import pytest

import jaxpound as jp
from jaxpound.cli.buildings import as_toml
from tests.cli.commands import layout_of, run
from tests.cli.written import summary
from tests.ground.test_suite import SUITE, at2
from tests.refusals import refusals

DECK = "[[building]]\nmass = 9e5\nperiod = 0.8\ndamping_ratio = 0.05\n"
JOINTS = """[[link]]
building = 1
floor = 1
gap = 0.05
[[link]]
building = 2
floor = 1
next_building = "support 3"
gap = 0.04
"""
WAVE = "[wave]\nvelocity = 400\ndistances = [0, 60, 120]\n"
BRIDGE = f"{DECK}{DECK}support = 2\n{JOINTS}{WAVE}"


def test_decks_and_joints_are_those_of_the_library_and_are_written_back():
    buildings = layout_of(BRIDGE).buildings
    assert buildings.supports == (0, 1)
    assert [str(link) for link in buildings.links] == ["1–2, floor 1", "2–support 3, floor 1"]
    again = layout_of(as_toml(buildings) + WAVE).buildings
    assert again.system().topology == buildings.system().topology


def test_a_run_is_that_of_a_wave(pulse, tmp_path):
    path, out = tmp_path / "bridge.toml", tmp_path / "out"
    path.write_text(f"{BRIDGE}[run]\nduration = 1.6\n")
    run("simulate", "--record", pulse, "--config", path, "--out", out)
    wave = jp.travelling(jp.read_record(pulse), 400.0, (0.0, 60.0, 120.0))
    response = jp.simulate(layout_of(BRIDGE).buildings, wave, duration=1.6)
    results = summary(out)["results"]["links"]
    assert [link["next_building"] for link in results] == [2, "support 3"]
    for link, demand in zip(results, response.demand.links, strict=True):
        assert link["min_gap_m"] == pytest.approx(float(demand.min_gap))
    with np.load(out / "series.npz") as series:
        moved = series["support_displacement_3_m"]
    np.testing.assert_allclose(moved, response.supports[2].displacement)


@pytest.mark.usefixtures("without_pictures")
def test_an_incremental_dynamic_analysis_is_that_of_records_that_travel(tmp_path):
    path, out = tmp_path / "bridge.toml", tmp_path / "out"
    (tmp_path / "records").mkdir()
    for record in SUITE.chosen([0, 2]):
        text = at2(record.samples, record.dt)
        (tmp_path / "records" / f"{record.name}.AT2").write_text(text)
    ladder = "[ida]\nintensities = [0.05, 0.4]\n"
    path.write_text(f'{BRIDGE}[suite]\nfolder = "records"\n{ladder}')
    run("ida", path, "--out", out)
    wave, records = {"velocity": 400.0, "distances": (0.0, 60.0, 120.0)}, tmp_path / "records"
    analysis = jp.Analysis(layout_of(BRIDGE).buildings, jp.read_suite(records), **wave)
    expected = jp.incremental_dynamic_analysis(analysis, [0.05, 0.4], progress=False)
    capacities = summary(out)["capacities"]
    assert [*capacities.values()] == pytest.approx(expected.capacities.tolist(), rel=1e-9)


test_what_is_no_bridge_is_refused = refusals(
    (f"{DECK}{DECK}support = 2\n", "wave. distances.* 0 of them.* must be 2, one for each support"),
    (f"{DECK}{WAVE}", "wave. distances.* 3 of them.* must be 1"),
    (BRIDGE.replace("support 3", "support 0"), "next_building"),
    (BRIDGE.replace("[0, 60, 120]", "40"), "wave. distances = 40 must be a list of numbers"),
    (f"{DECK}[wave]\nvelocity = 400\ndistances = []\n", "wave. distances = .. must be a list"),
    (BRIDGE.replace("velocity = 400", "velocity = -1"), "velocity"),
    of=layout_of,
)
