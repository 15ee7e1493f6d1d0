"""The configuration of a study, and the commands montecarlo and report."""

import json
import re
import tomllib

import jax
import numpy as np
import pytest
from matplotlib.image import imread

import jaxpound as jp
from jaxpound._tables import rounded
from jaxpound.cli import montecarlo
from jaxpound.cli.files import example
from jaxpound.cli.reading import File
from jaxpound.results.named import in_words
from tests.cli.commands import edited, is_figure, refusal, run, tables

EXAMPLE = example("montecarlo")
SMALL = {
    "duration = ": "duration = 3.0",
    "samples = ": "samples = 40",
    "wavelets = ": "wavelets = 2",
    "arrivals = ": "arrivals = {uniform = [0.5, 2.5]}",
}


def of_records(table, rest="\n[uncertain]"):
    """The example with records in the place of wavelets, and what follows them."""
    head, tail = EXAMPLE.split("[earthquakes]", 1)
    return f"{head}[earthquakes]\n{table}\n{tail[tail.index(rest) :]}"


def read(path):
    """The configuration, its scenarios and its grid."""
    file = File.opened(path, "montecarlo")
    given = file.read(montecarlo.StudyConfig)
    return given, *montecarlo.prepared(file, given)


def test_the_example_is_the_pair_in_si_with_its_scenarios():
    study, scenarios, grid = read(None)
    given = tomllib.loads(EXAMPLE)
    buildings = [jp.Building.from_period(**given[f"building_{i}"]) for i in (1, 2)]
    structures, scales = jp.dimensionless(*buildings, 200e3, 0.1)
    median, ground = scenarios.realize(np.zeros(scenarios.dimension))
    for ours, theirs in zip(jax.tree.leaves(median), jax.tree.leaves(structures), strict=True):
        assert float(ours) == pytest.approx(float(theirs))
    amplitudes = np.abs(ground.amplitude) * scales.length
    np.testing.assert_allclose(amplitudes, 0.025)
    np.testing.assert_allclose(ground.periods * scales.time, 1.0)
    np.testing.assert_allclose(ground.arrivals * scales.time, 3.5)
    one = np.zeros(scenarios.dimension)
    one[0] = 1.0
    factor = scenarios.realize(one)[0].friction / structures.friction
    assert float(factor) == pytest.approx(np.exp(0.2))
    assert grid.dt * float(scales.time) == pytest.approx(0.6 / 50, rel=0.01)
    how = study.study
    assert (how.samples, how.seed, how.sampling) == (10_000, 0, "plain")


def test_recorded_earthquakes_are_read_beside_the_file(write, tmp_path):
    for i, n in enumerate((80, 120)):
        values = 0.2 * np.sin(0.05 * np.arange(n))
        np.savetxt(
            tmp_path / f"{i}.csv", np.column_stack([0.02 * np.arange(n), values]), delimiter=","
        )
    table = 'records = ["0.csv", "1.csv"]\nunits = "m/s2"\nfactor = {uniform = [1, 3]}\n'
    text = of_records(table).replace("duration = 12.0", "")
    study, scenarios, grid = read(write(text=text))
    records = scenarios.ground.records
    (tmp_path / "1.csv").write_text("t (s), a (m/s2)\n" + (tmp_path / "1.csv").read_text())
    text = text.replace('"0.csv", ', "").replace('units = "m/s2"\n', "")
    stated = read(write(text=text))[1].ground.records
    np.testing.assert_array_equal(stated[0].samples, records[1].samples)
    assert [record.n_samples for record in records] == [80, 120]
    assert float(np.abs(records[1].samples).max()) == pytest.approx(0.2 / 9.80665, rel=1e-3)
    assert scenarios.ground.factor == jp.Uniform(1, 3)
    duration = grid.dt * grid.n_steps * float(study.scales.time)
    assert duration == pytest.approx(119 * 0.02, abs=0.02)


def test_rods_may_be_named_with_and_without_quotation_marks(write):
    text = EXAMPLE.replace('"rod_1.tau_x" =', "rod_1.tau_x =")
    path = write(text=text)
    names = list(read(path)[1].structures.uncertain)
    assert names == ["friction", "stiffness_ratio", "rod_1.tau_x"]


def test_weights_whose_sum_overflows_are_refused(write, tmp_path, capsys):
    path = write(text=of_records('records = ["a.csv", "b.csv"]\nweights = [1e308, 1e308]'))
    message = "[earthquakes] weights = [1e+308, 1e+308] must be a list of numbers between 0 and"
    assert message in refusal(capsys, "montecarlo", path, "--store", tmp_path / "st")


def test_a_laboratory_s_models_and_towers_are_plausible(write):
    """What is far from the example, and yet is built."""
    model = {
        "mass": "mass = 5.0",
        "period": "period = 0.06",
        "friction_force": "friction_force = 0.5",
        "gap": "gap = 0.001",
        "amplitude": "amplitude = {uniform = [1e-5, 1e-4]}",
        "periods": "periods = {uniform = [0.005, 0.02]}",
        "arrivals": "arrivals = {uniform = [0.05, 0.3]}",
        "duration": "duration = 0.5",
    }
    tower = {
        "mass": "mass = 5e8",
        "period": "period = 9.5",
        "friction_force": "friction_force = 5e7",
        "gap": "gap = 2.0",
        "amplitude": "amplitude = {uniform = [0.1, 2.0]}",
        "periods": "periods = {uniform = [1.0, 15.0]}",
        "arrivals": "arrivals = {uniform = [10.0, 250.0]}",
        "duration": "duration = 300.0",
    }
    for changes in (model, tower):
        text = edited(EXAMPLE, changes)
        head, tail = text.split("[building_2]", 1)
        second = edited(tail, {key: changes[key] for key in ("mass", "period")})
        _, _, grid = read(write(text=f"{head}[building_2]{second}"))
        assert grid.n_steps > 100


def test_a_study_in_which_nothing_is_random_is_refused(write, tmp_path, capsys):
    rows = np.column_stack([0.02 * np.arange(80), 0.1 * np.sin(0.1 * np.arange(80))])
    np.savetxt(tmp_path / "one.csv", rows, delimiter=",")
    path = write(text=of_records('records = ["one.csv"]', "\n[run]"))
    error = refusal(capsys, "montecarlo", path, "--store", tmp_path / "st")
    assert f"{path}: nothing is random; it must have [uncertain]" in error


def test_a_missing_record_is_named(write, tmp_path, capsys):
    path = write(text=of_records('records = ["none.at2"]'))
    error = refusal(capsys, "montecarlo", path, "--store", tmp_path / "st")
    assert re.search(r"config.toml: \[earthquakes\] records: \S*none.at2: no such file", error)


def test_a_study_from_the_command_line_in_two_shards_and_its_report(write, tmp_path):
    changes = {"# chunk_size": "chunk_size = 10", "# spectral": "spectral_acceleration = true"}
    path, store, out = write(SMALL | changes), tmp_path / "st", tmp_path / "out"
    run("montecarlo", path, "--store", store, "--shard", "1/2")
    run("report", "--store", store, "--out", out)
    page = (out / "summary.md").read_text()
    assert "20 scenarios of 40 asked for (unfinished)" in page
    run("montecarlo", path, "--store", store, "--shard", "2/2")
    screen = run("montecarlo", path, "--store", store)
    assert "Study of 40 scenarios, 0 failed (SI)" in screen
    study, scenarios, grid = read(path)
    found = jp.monte_carlo(scenarios, 40, grid, chunk_size=10, scales=study.scales, progress=False)
    assert f"probability of pounding {found.pounding_probability()}" in screen

    printed = run("report", "--store", store, "--out", out).split()
    assert sorted(map(str, out.iterdir())) == sorted(printed)
    assert (out / "study.toml").read_text() == path.read_text()
    summary = json.loads((out / "summary.json").read_text())
    assert summary["pounding_probability"]["value"] == found.pounding_probability().value
    rules = found.separation(0.1)
    assert summary["required_gap"]["0.1"]["srss"] == pytest.approx(rules.srss)
    assert summary["demands"]["peak_f1"]["mean"] == pytest.approx(found.moments("peak_f1").mean)
    curve = jp.fit_fragility(found["pgv"], found["pounds"] == 1)
    assert summary["fragility"]["pgv"]["median"] == pytest.approx(curve.median)
    assert summary["fragility"]["spectral_acceleration_1"]["unit"] == "m/s²"
    page = (out / "summary.md").read_text()
    assert f"**Probability of pounding: {found.pounding_probability().value:.4g} (" in page
    for name in re.findall(r"\((\w+\.png)\)", page):
        assert imread(out / name).size
    assert is_figure(out / "convergence.png")
    gaps, demands, fragility = tables(page)
    row = summary["required_gap"]["0.05"]
    (gap,) = (x for x in gaps if x["exceeded with probability"] == "0.05")
    assert (gap["unit"], gap["SRSS"]) == ("m", rounded(row["srss"]))
    for name, row in summary["demands"].items():
        (told,) = (x for x in demands if x["demand"] == in_words(name))
        assert told["unit"] == row["unit"] != ""
        assert told["5 % quantile"] == rounded(row["quantile_0.05"])
        assert told["95 % quantile"] == rounded(row["quantile_0.95"])
    assert {x["unit"] for x in demands} == {"m", "s", "N", "m/s", "m/s²", "J"}
    for name, told in zip(summary["fragility"], fragility, strict=True):
        assert told["median θ"] == rounded(summary["fragility"][name]["median"])
        assert told["unit"] == summary["fragility"][name]["unit"] != ""

    more = run("montecarlo", path, "--store", store, "--samples", 50)
    assert "Study of 50 scenarios" in more


CONTACT = {"# [contact]": '[contact]\nlaw = "newton"\nrestitution = 0.65', "gap": "gap = 0.04"}


def test_a_study_with_contact_and_its_report(write, tmp_path):
    uncertain = {'"rod_1.tau_x"': "contact.restitution = {uniform = [0.8, 1.2]}"}
    path, store, out = write(SMALL | CONTACT | uncertain), tmp_path / "st", tmp_path / "out"
    run("montecarlo", path, "--store", store)
    study = jp.Study.open(store)
    e = study.parameters()["contact.restitution"]
    assert 0.52 <= e.min() < e.max() <= 0.78
    run("report", "--store", store, "--out", out)
    summary = json.loads((out / "summary.json").read_text())
    assert summary["required_gap"] == {}
    hit = np.isfinite(study["first_impact_time"])
    assert 0 < hit.sum() < len(study)
    assert summary["impacts"]["0"]["value"] == 1 - hit.mean()
    first = summary["demands"]["first_impact_time"]
    assert first["mean"] == pytest.approx(study["first_impact_time"][hit].mean())
    assert first["largest"] < 3.0
    page = (out / "summary.md").read_text()
    impacts, demands, _ = tables(page)
    assert [x["number of impacts"] for x in impacts] == [*summary["impacts"]]
    units = {x["demand"]: x["unit"] for x in demands}
    assert units["number of impacts"] == "-"
    assert units["impulse of the strongest impact"] == "N s"
    assert "Rank correlation with the impulse of the strongest impact: " in page
    for name in re.findall(r"\((\w+\.png)\)", page):
        assert imread(out / name).size


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["montecarlo", "none.toml", "--store", "st"], "none.toml: No such file"),
        (["montecarlo", "STUDY", "--store", "st", "--shard", "1-2"], "--shard: '1-2' must be I/N"),
        (
            ["montecarlo", "STUDY", "--store", "st", "--shard", "3/2"],
            "'3/2' must be I/N with I from 1 to N",
        ),
        (["report", "--store", "none", "--out", "out"], "must be a folder with a manifest.json"),
    ],
)
def test_bad_commands_are_refused(arguments, message, write, capsys, monkeypatch, tmp_path):
    path = write(SMALL)
    monkeypatch.chdir(tmp_path)
    assert message in refusal(capsys, *(path if x == "STUDY" else x for x in arguments))
    assert not (tmp_path / "st").exists()


def test_an_unresolved_study_is_refused_if_strict(write, tmp_path, capsys):
    """Wavelets of 1 to 2 ms, with a step of 12 ms."""
    path = write({**SMALL, "periods = ": "periods = {uniform = [0.001, 0.002]}"})
    store = tmp_path / "store"
    error = refusal(capsys, "montecarlo", path, "--store", store, "--strict")
    assert "ground: 100% of the 40 earthquakes looked at are not resolved; of one, the " in error
    assert not store.exists()
