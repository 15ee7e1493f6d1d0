"""``jaxpound ida``: its configuration, its run, and what it writes."""

import argparse
import re

import numpy as np
import pytest

import jaxpound as jp
from jaxpound.cli import files, ida, main, reading
from jaxpound.hazard.analysis import SuiteRuns
from tests.cli.commands import changed, example_pair, faults, refusal, run
from tests.cli.written import csv_rows, is_figure, number, summary, tables
from tests.ground.test_suite import SUITE, at2
from tests.reliability.test_subset import stopped

EXAMPLE = files.example("ida")
SHORT = "gap = 0.02 & friction_force = 0 & intensities = [0.02, 0.1, 0.4] & duration = 6.0"
SCALED = "code -> range = [0.2, 2.0] & factors = [0.1, 3.0]"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("ida")
    (made / "records").mkdir()
    for record in SUITE:
        (made / "records" / f"{record.name}.AT2").write_text(at2(record.samples, record.dt))
    return made


@pytest.fixture(scope="module")
def done(folder):
    (folder / "ida.toml").write_text(changed(EXAMPLE, f"{SHORT} & {SCALED}"))
    return run("ida", folder / "ida.toml", "--out", folder / "out"), folder / "out"


@pytest.mark.filterwarnings("ignore::jaxpound.PlausibilityWarning")
def test_the_capacities_are_the_library_s_and_all_is_written(done, folder):
    screen, out = done
    pair = example_pair(friction_force=0.0, gap=0.02)
    target = jp.ground.TargetSpectrum([0.0, 0.1, 0.5, 4.0], [0.3, 0.75, 0.75, 0.09375])
    scaled = jp.read_suite(folder / "records").scaled_to(target, (0.2, 2.0), (0.1, 3.0))
    grid = jp.TimeGrid.until(6.0, 0.01 / np.ceil(0.01 / (0.6 / 50)))
    analysis = jp.Analysis(pair, scaled.suite, grid, measure=0.9)
    found = jp.incremental_dynamic_analysis(analysis, [0.02, 0.1, 0.4])
    assert "required gap (m), threshold 0.02" in screen
    answers = summary(out)
    for name, capacity in zip(found.names, found.capacities, strict=True):
        told = answers["capacities"][name]
        assert told is None if np.isinf(capacity) else told == pytest.approx(capacity, rel=1e-9)
    assert answers["fragility"]["median"] == pytest.approx(found.fragility().median)
    assert answers["target"]["at_bound"] == list(scaled.at_bound) == ["fast"]
    np.testing.assert_allclose(answers["fractiles"]["0.5"], np.median(found.demands, axis=0))
    figures = {f"{name}.png" for name in ("ida", "fragility", "spectra")}
    told = {"summary.json", "summary.md", "capacities.csv", "curves.csv"}
    assert {path.name for path in out.iterdir()} == figures | told
    assert all(is_figure(out / name) for name in figures)
    answers = summary(out)
    rows = {row["record"]: row for row in csv_rows(out / "capacities.csv")}
    assert len(csv_rows(out / "curves.csv")) == 9
    of_scaling, of_analysis, of_curve = tables((out / "summary.md").read_text())
    for name, capacity in answers["capacities"].items():
        told = rows[name]["capacity"]
        assert told == "" if capacity is None else float(told) == pytest.approx(capacity)
    assert [row["record"] for row in of_analysis] == [*answers["capacities"]]
    factors = answers["target"]["factors"]
    for row in of_scaling:
        assert number(row["factor"]) == pytest.approx(factors[row["record"]], rel=1e-3)
    assert number(of_curve[0]["value"]) == pytest.approx(answers["fragility"]["median"], rel=1e-3)


@pytest.mark.usefixtures("without_pictures")
@pytest.mark.filterwarnings("ignore::jaxpound.PlausibilityWarning")
def test_a_stopped_analysis_goes_on(done, folder, monkeypatch):
    out, store = folder / "again", folder / "store"
    arguments = ["ida", folder / "ida.toml", "--out", out, "--store", store]
    stopped(monkeypatch, 1, lambda: run(*arguments), "run", SuiteRuns)
    assert any(store.glob("chunk-*.npz"))
    told = main.describe_kept(argparse.Namespace(command="ida", store=store, out=out))
    assert told.startswith(f"finished runs are kept in {store}, and the same command")
    for _ in range(2):  # the second time from the files alone
        assert run(*arguments) == done[0].replace(str(done[1]), str(out))
        monkeypatch.setattr("jaxpound.hazard.analysis.in_chunks", lambda *_: None)
    for name in ("capacities.csv", "curves.csv"):
        assert (out / name).read_text() == (done[1] / name).read_text()


def test_without_a_target_the_range_of_a_code_and_the_default_period(folder):
    head, tail = changed(EXAMPLE, SHORT).split("[target]", 1)
    text = re.sub(r"(?m)^period = 0.9 .*a natural.*$", "", head + tail[tail.index("[ida]") :])
    file = reading.File("ida.toml", text, folder)
    given = file.read(ida.IdaConfig)
    suite, scaled = ida.records(file, given)
    assert (suite.names, scaled, given.ida.period) == (("fast", "medium", "slow"), None, None)
    assert ida.analysed(file, given, suite).measure == "Sa(0.9 s) (g)"
    for code in ("asce 7", "en 1998"):
        changes = f'code = "{code}" & factors = [0.01, 100]'
        file = reading.File("ida.toml", changed(EXAMPLE, changes), folder)
        _, scaled = ida.records(file, file.read(ida.IdaConfig))
        assert scaled.range == pytest.approx((0.12, 1.8), rel=1e-3)


@pytest.mark.filterwarnings("ignore:.*left out are:jaxpound.PlausibilityWarning")
def test_the_suite_of_stations(folder, tmp_path):
    sizes = {"000": 0.5, "090": 1.0, "-UP": 3.0}
    for component, size in sizes.items():
        text = at2(size * SUITE["slow"].samples, 0.02, component.strip("-"))
        (tmp_path / f"A-ELC{component}.AT2").write_text(text)
    for component, names in (('"both"', ("A-ELC000", "A-ELC090")), ('"larger"', ("A-ELC090",))):
        changes = f'folder = "." & component = {component} & pattern = "*.at2"'
        file = reading.File(
            "ida.toml", changed(EXAMPLE.partition("[target]")[0], changes), tmp_path
        )
        file = reading.File("ida.toml", file.text + "[ida]\nintensities = [0.1]", tmp_path)
        given = file.read(ida.IdaConfig)
        assert ida.records(file, given)[0].names == names
        with pytest.raises(ValueError, match=r"\[suite\] .*: left out are A-ELC-UP\.AT2"):
            ida.records(file, given, strict=True)


FAULTS = r"""
folder = "none" => [suite] folder = ...none' must be a folder
pattern = "*.csv" => [suite] pattern = '*.csv' must fit a file in
component = "all" => [suite] component = 'all' must be 'both', 'larger', 1 or 2
component = 2 => [suite] component = 2 must be there in each station: 'fast' has 'fast' alone
rows = "down" => [suite] rows = 'down' must be 'history'
code = "asce" => [target] code = "asce" must be one of "asce 7", "en 1998"
code -> nothing => [target] lacks code; give code, or range
code -> range = [0.2, 5.0] => [target] periods = ... must be within those of the targ
factors = [2.0, 1.0] => [target] factors = 1 must be at least the lower
periods = [1.0, 0.5] => [target] periods (2,) and accelerations (4,)
intensities = [0.2, 0.1] => [ida] intensities = 0.1 ... must be rising
measure = "pga" => [ida] period must be given with measure = "sa" only
demand = "peak_x1" => [ida] threshold = None must be a number: demand is
demand = "drift" => [ida] unknown demand 'drift'; did you mean 'peak_drift'
demand = "peak_contact" ; threshold = 1
    => [ida] demand = 'peak_contact' must be of structures with a contact law
threshold = 0 => [ida] threshold = 0 m must be between 1e-09 and 10 m
demand = "peak_x1" ; threshold = 1e22 => [ida] threshold = 1e+22 m must be b
intensities = [0.1, 1e300]
    => [ida] intensities = [0.1, 1e+300] must be a list of numbers between 1e-06
demand = "peak" ; threshold = 1 => [ida] unknown demand 'peak'
friction = -> dt = 0.02 ; friction = "event-resolved" => [run] dt = 0.02
"""


@pytest.mark.parametrize(("changes", "words"), faults(FAULTS))
@pytest.mark.filterwarnings("ignore::jaxpound.PlausibilityWarning")
def test_wrong_input_is_named(changes, words, folder, capsys):
    (folder / "wrong.toml").write_text(changed(EXAMPLE, changes))
    line = refusal(capsys, "ida", folder / "wrong.toml", "--out", folder / "nothing")
    pattern = re.escape(words).replace(re.escape("..."), ".*")
    assert re.search(rf"wrong\.toml: {pattern}", line), line
