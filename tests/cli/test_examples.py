"""The examples that the commands print: they are read, and name every key."""

import re

import numpy as np
import pytest

import jaxpound as jp
from jaxpound.cli import buildings, design, hazard, ida, montecarlo, rare, reading, simulate
from jaxpound.cli import main as cli
from jaxpound.cli.files import example
from jaxpound.results.named import LIMITABLE_OF_PAIR

CONFIGURATIONS = {"simulate": simulate.Simulation, "montecarlo": montecarlo.StudyConfig}
CONFIGURATIONS |= {"design": design.DesignConfig, "ida": ida.IdaConfig}
CONFIGURATIONS |= {"rare": rare.RareConfig, "hazard": hazard.Lifetime}
FORMS = [(x, form) for x in CONFIGURATIONS for form in ("", "pair", "row")]


@pytest.mark.parametrize(("command", "form"), [x for x in FORMS if x[0] != "hazard" or not x[1]])
def test_the_example_is_printed_and_read(command, form, capsys):
    with pytest.raises(SystemExit, match="0"):
        cli.main([command, "--example-config", *filter(None, [form])])
    text = capsys.readouterr().out
    assert text == example(command, form or "pair")
    reading.File("example", text).read(CONFIGURATIONS[command])


def test_the_example_of_a_record_is_a_motion_of_the_library_s_noise(tmp_path, capsys):
    with pytest.raises(SystemExit, match="0"):
        cli.main(["simulate", "--example-record"])
    path = tmp_path / "quake.at2"
    path.write_text(capsys.readouterr().out)
    noise = jp.scenarios.SiteBasedNoise(6.5, 10.0, 400.0, "strike-slip", samples=1250, dt=0.02)
    z = np.zeros(noise.dimension)
    z[6:] = np.random.default_rng(4).standard_normal(len(z) - 6)
    record = jp.read_record(path)
    assert record.dt == 0.02
    np.testing.assert_allclose(record.samples, noise.draw(z).samples, rtol=1e-6, atol=1e-12)


TABLES = {
    "simulate": "gap building_1 building_2 damper contact run ground wave output",
    "montecarlo": "earthquakes study run",
    "design": "objective search",
    "ida": "suite target ida",
    "rare": "earthquakes limit search design",
    "hazard": "hazard fragility study results",
}
ELSEWHERE = {"montecarlo": {"smoothing_velocity"}}
ELSEWHERE["hazard"] = {"unit"}  # which says to write it in measure
ELSEWHERE["rare"] = {"records", "units", "factor", "weights", "intensity"}


@pytest.mark.parametrize(("command", "tables"), TABLES.items())
def test_the_example_names_every_key(command, tables):
    text, kinds = example(command), reading.entries(CONFIGURATIONS[command])
    if command in ("simulate", "hazard"):
        assert {*kinds} - {x for x in kinds if reading.of_array(kinds[x])} == {*tables.split()}
    if command == "simulate":  # of buildings that yield as for a row
        text += example("simulate", "row")
    if command == "montecarlo":  # as for a row, and noise as for rare events
        text += example("montecarlo", "row") + example("rare")
    if command == "design":
        assert all(price in text for price in LIMITABLE_OF_PAIR)
    for table in tables.split():
        if command == "simulate" and reading.is_table(kinds[table]):
            assert re.search(rf"(?m)^(# )?\[{table}\]$", text)
        for key in {*(reading.entries(kinds[table]) or [table])} - ELSEWHERE.get(command, set()):
            assert re.search(rf"(?m)^(# )?{key} = ", text), key


@pytest.mark.parametrize("kind", ["BuildingSection", "StoreySection", "LinkSection"])
def test_the_example_of_a_row_names_every_key(kind):
    for key in reading.entries(getattr(buildings, kind)):
        words = key if key == "stiffness" else rf"(^|[{{,] ?|# ){key}( = |\s+#)"
        assert re.search(rf"(?m){words}", example("simulate", "row")), key
