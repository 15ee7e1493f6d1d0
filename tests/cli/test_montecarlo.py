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
from jaxpound.cli import main as cli
from jaxpound.cli import montecarlo
from jaxpound.cli.files import example
from jaxpound.cli.reading import File, entries
from jaxpound.results.demand import in_words
from tests.cli.commands import edited, is_figure, run, tables

EXAMPLE = example("montecarlo")
SMALL = {
    "duration = ": "duration = 3.0",
    "samples = ": "samples = 40",
    "wavelets = ": "wavelets = 2",
    "arrivals = ": "arrivals = {uniform = [0.5, 2.5]}",
}


@pytest.fixture
def write(tmp_path):
    """The example with lines replaced."""

    def write_config(changes=None, text=EXAMPLE):
        path = tmp_path / "study.toml"
        path.write_text(edited(text, changes or {}))
        return path

    return write_config


def test_the_example_names_every_key_and_is_printed(capsys):
    with pytest.raises(SystemExit, match="0"):
        cli.main(["montecarlo", "--example-config"])
    assert capsys.readouterr().out == EXAMPLE
    for table in ("earthquakes", "study", "run"):
        for key in entries(entries(montecarlo.Study)[table]):
            texts = EXAMPLE + example("montecarlo", "row") + example("rare")
            assert re.search(rf"(?m)^(# )?{key} = ", texts) or key == "smoothing_velocity", key


def read(path):
    """The configuration, its scenarios and its grid."""
    file = File.opened(path, "montecarlo")
    given = file.read(montecarlo.Study)
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
    head, tail = EXAMPLE.split("[earthquakes]", 1)
    rest = tail[tail.index("\n[uncertain]") :].replace("duration = 12.0", "")
    table = (
        '[earthquakes]\nrecords = ["0.csv", "1.csv"]\nunits = "m/s2"\nfactor = {uniform = [1, 3]}\n'
    )
    study, scenarios, grid = read(write(text=head + table + rest))
    records = scenarios.ground.records
    (tmp_path / "1.csv").write_text("t (s), a (m/s2)\n" + (tmp_path / "1.csv").read_text())
    own = table.replace('"0.csv", ', "").replace('units = "m/s2"\n', "")
    stated = read(write(text=head + own + rest))[1].ground.records
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


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"wavelets": "wavelet = 4"},
            "has an unknown key 'wavelet'; did you mean 'wavelets'",
        ),
        ({"wavelets": ""}, "[earthquakes] lacks the key 'wavelets'"),
        (
            {"wavelets": "wavelets = 0"},
            "[earthquakes] wavelets = 0 must be from 1 to 2147483648",
        ),
        (
            {"wavelets": "wavelets = 1_000_000_000"},
            "[earthquakes] wavelets = 1,000,000,000 would take 88 TB of memory; this machine has",
        ),
        ({"amplitude": "amplitude = 0.3"}, "[earthquakes] amplitude = 0.3 must be {normal = [mean"),
        ({"amplitude": "amplitude = {beta = [1, 2]}"}, "must be {normal = [mean, std]}, {logn"),
        ({"amplitude": "amplitude = {normal = [1]}"}, "must be {normal = [mean, std]}, {logn"),
        (
            {"periods": "periods = {uniform = [2, 1]}"},
            "[earthquakes] periods: high = 1 s must be finite and above low = 2 s",
        ),
        (
            {"amplitude": "amplitude = {uniform = [0.04, 0.01]}"},
            "[earthquakes] amplitude: high = 0.01 m must be finite and above low = 0.04 m",
        ),
        (
            {"amplitude": "amplitude = {lognormal = [-0.04, 0.2]}"},
            "[earthquakes] amplitude: median = -0.04 m must be positive",
        ),
        ({"amplitude": "amplitude = {unifrom = [1, 2]}"}, "did you mean 'uniform'?"),
        (
            {"amplitude": "amplitude = {uniform = [0, nan]}"},
            "; uniform = [0, nan] must be two finite numbers",
        ),
        (
            {"friction = {": "friction = {uniform = [2, 1]}"},
            "[uncertain] friction: high = 1 must be finite and above low = 2",
        ),
        (
            {'"rod_1.tau_x"': '"rod_1.tau_x" = {normal = [0.01, 1e-4]}'},
            "[uncertain], in SI units: rod_1.tau_x ~ Normal(mean=0.00064",
        ),
        ({"friction_force": "friction_force = 0"}, "[uncertain] friction must be of a value above"),
        ({"negative": "negative = 2.0"}, "[earthquakes] negative = 2.0 must be between 0 and 1"),
        ({"wavelets": 'records = ["a"]'}, "[earthquakes] amplitude must not be given with records"),
        ({"wavelets": "wavelets = 4\nunits = 'g'"}, "units must not be given without records"),
        ({"negative": "records = []"}, "[earthquakes] records = [] must be a list of files"),
        (
            {"friction = {": "frictoin = {uniform = [1, 2]}"},
            "has an unknown key 'frictoin'; did you mean",
        ),
        ({"duration": ""}, "[run] lacks the key 'duration'"),
        ({"duration": "duration = 0.001"}, "[run] duration = 0.001 s must be between 2 and"),
        ({"# dt": "dt = 5.0"}, "[run] dt = 5 s must be positive and below the stability limit"),
        ({"samples": "samples = 0"}, "[study] samples = 0 must be from 1 to"),
        ({"seed": "seed = -1"}, "[study] seed = -1 must be from 0"),
        (
            {"sampling": 'sampling = "halton"'},
            '[study] sampling = "halton" must be one of "plain", "sobol"',
        ),
        ({"gap": "gap = -0.1"}, "gap = -0.1 m must be between 0 and 10 m ("),
        ({"[damper]": "[dampers]"}, "unknown key 'dampers'; did you mean 'damper'?"),
    ],
)
def test_what_is_wrong_is_named_with_its_place(write, changes, message, capsys, tmp_path):
    assert cli.main(["montecarlo", str(write(changes)), "--store", str(tmp_path / "st")]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.startswith(f"jaxpound: error: {tmp_path / 'study.toml'}: ")
    assert error.count("\n") == error.count("study.toml") == 1
    assert not (tmp_path / "st").exists()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"periods": "periods = {uniform = [1e-6, 2e-6]}"},
            "[earthquakes] periods = {uniform = [1e-06, 2e-06]} reaches 1e-06 s; it must stay "
            "between 0.001 and 60 s",
        ),
        ({"periods": "periods = {uniform = [-2, -1]}"}, "reaches -2 s; it must stay between 0.001"),
        (
            {"periods": "periods = {normal = [1.0, 0.3]}"},
            "[earthquakes] periods = {normal = [1, 0.3]} reaches -0.426 s once in",
        ),
        (
            {"arrivals": "arrivals = {uniform = [20, 30]}"},
            "[earthquakes] arrivals = {uniform = [20, 30]} reaches 20 s; it must stay between 0 "
            "and 12 s (the run",
        ),
        ({"arrivals": "arrivals = {uniform = [-1, 2]}"}, "reaches -1 s; it must stay between 0"),
        (
            {"intensity": "intensity = {hazard = [[0.1, 1e-3], [0.2, 2e-3]]}"},
            "[earthquakes] intensity: annual_rate = 0.002 (at index [1]) must be no larger than",
        ),
        (
            {"intensity": "intensity = {hazard = [[0.1, 1e-3], [0.2, 9e-4]]}"},
            "[earthquakes] intensity = {hazard = [[0.1, 0.001], [0.2, 0.0009]]} reaches 2.",
        ),
        (
            {"intensity": "intensity = {lognormal = [1.0, 21.0]}"},
            "[earthquakes] intensity = {lognormal = [1, 21]} reaches 2.25e+43 once in",
        ),
        ({"intensity": "intensity = {normal = [1.0, 0.5]}"}, "reaches -1.377 once in 1,000,000"),
        ({"amplitude": "amplitude = {uniform = [10, 40]}"}, "reaches 40 m; it must stay between"),
        (
            {"friction = {": "friction = {lognormal = [1.0, 100]}"},
            "[uncertain] friction = {lognormal = [1, 100]} reaches 2.745e+206 once in 1,000,000 "
            "draws; it must stay between 0 and 1e+06",
        ),
        (
            {"friction = {": "friction = {normal = [0, 1]}"},
            "[uncertain] friction = {normal = [0, 1]} reaches -4.753 once in 1,000,000 draws; it",
        ),
        (
            {"stiffness_ratio": "mass_ratio = {lognormal = [1e-7, 0.1]}"},
            "[uncertain] mass_ratio = {lognormal = [1e-07, 0.1]}, once in 1,000,000 draws: "
            "[building_2] mass = ",
        ),
        (
            {"stiffness_ratio": "stiffness_ratio = {uniform = [1.0, 1e6]}"},
            "[building_2] natural period = 0.00026429 s must be between 0.002 and 60 s",
        ),
    ],
)
def test_nonsense_is_refused_before_the_first_run(write, changes, message, capsys, tmp_path):
    assert cli.main(["montecarlo", str(write(changes)), "--store", str(tmp_path / "st")]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (tmp_path / "st").exists()


def test_weights_whose_sum_overflows_are_refused(write, tmp_path, capsys):
    head, tail = EXAMPLE.split("[earthquakes]", 1)
    table = '[earthquakes]\nrecords = ["a.csv", "b.csv"]\nweights = [1e308, 1e308]\n'
    path = write(text=head + table + tail[tail.index("\n[uncertain]") :])
    assert cli.main(["montecarlo", str(path), "--store", str(tmp_path / "st")]) == 2
    message = "[earthquakes] weights = [1e+308, 1e+308] must be a list of numbers between 0 and"
    assert message in capsys.readouterr().err


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
    head, tail = EXAMPLE.split("[earthquakes]", 1)
    text = head + '[earthquakes]\nrecords = ["one.csv"]\n' + tail[tail.index("\n[run]") :]
    path = write(text=text)
    assert cli.main(["montecarlo", str(path), "--store", str(tmp_path / "st")]) == 2
    assert f"{path}: nothing is random; it must have [uncertain]" in capsys.readouterr().err


def test_a_missing_record_is_named(write, tmp_path, capsys):
    head, tail = EXAMPLE.split("[earthquakes]", 1)
    text = head + '[earthquakes]\nrecords = ["none.at2"]\n' + tail[tail.index("\n[uncertain]") :]
    assert cli.main(["montecarlo", str(write(text=text)), "--store", str(tmp_path / "st")]) == 2
    error = capsys.readouterr().err
    assert re.search(r"study.toml: \[earthquakes\] records: \S*none.at2: no such file", error)


def test_a_study_from_the_command_line_in_two_shards_and_its_report(write, tmp_path):
    changes = {"# chunk_size": "chunk_size = 10", "# spectral": "spectral_acceleration = true"}
    path, store, out = (
        write(SMALL | changes),
        tmp_path / "st",
        tmp_path / "out",
    )
    for shard in ("1/2", "2/2"):
        run("montecarlo", path, "--store", store, "--shard", shard)
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
    ("changes", "message"),
    [
        (
            {"stiffness_ratio": "contact.stiffness = {uniform = [0.5, 2.0]}"},
            "[uncertain] contact.stiffness must be a parameter of the law of contact, which has "
            "restitution",
        ),
        (
            {
                "# [contact]": "",
                "stiffness_ratio": '"contact.stiffness" = {uniform = [0.5, 2.0]}',
            },
            "[uncertain] contact.stiffness must be a parameter of the law of contact, and the file "
            "has no [contact]",
        ),
        (
            {"stiffness_ratio": "contact.restitutoin = {uniform = [0.5, 2.0]}"},
            "[uncertain] has an unknown key 'contact",
        ),
        (
            {"stiffness_ratio": "contact.restitution = {uniform = [1e-4, 1.2]}"},
            "[contact] restitution = 6.57799e-05 must be between 0.001 and 1 (speed at",
        ),
    ],
)
def test_factors_on_parameters_of_contact(changes, message, write, tmp_path, capsys):
    path = write(SMALL | CONTACT | changes)
    assert cli.main(["montecarlo", str(path), "--store", str(tmp_path / "st")]) == 2
    assert message in capsys.readouterr().err


def test_the_report_of_an_unfinished_study_says_so(write, tmp_path):
    path = write(SMALL | {"# chunk_size": "chunk_size = 10"})
    run("montecarlo", path, "--store", tmp_path / "st", "--shard", "1/2")
    run("report", "--store", tmp_path / "st", "--out", tmp_path / "out")
    assert (
        "20 scenarios of 40 asked for (unfinished)" in (tmp_path / "out" / "summary.md").read_text()
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["montecarlo", "none.toml", "--store", "st"], "none.toml: No such file"),
        (["montecarlo", "STUDY", "--store", "st", "--shard", "1-2"], "--shard: '1-2' must be I/N"),
        (
            ["montecarlo", "STUDY", "--store", "st", "--shard", "3/2"],
            "'3/2' must be I/N with I from 1 to N",
        ),
        (
            ["montecarlo", "STUDY", "--store", "st", "--samples", "0"],
            "--samples: '0' must be a positive whole number",
        ),
        (["report", "--store", "none", "--out", "out"], "must be a folder with a manifest.json"),
    ],
)
def test_bad_commands_are_refused(arguments, message, write, capsys, monkeypatch, tmp_path):
    path = write(SMALL)
    monkeypatch.chdir(tmp_path)
    assert cli.main([str(path) if x == "STUDY" else x for x in arguments]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "st").exists()


def test_an_unresolved_study_is_refused_if_strict(write, tmp_path, capsys):
    """Wavelets of 1 to 2 ms, with a step of 12 ms."""
    path = write({**SMALL, "periods = ": "periods = {uniform = [0.001, 0.002]}"})
    store = tmp_path / "store"
    assert cli.main(["montecarlo", str(path), "--store", str(store), "--strict"]) == 2
    error = capsys.readouterr().err
    assert "ground: 100% of the 40 earthquakes looked at are not resolved; of one, the " in error
    assert error.count("\n") == 1
    assert not store.exists()
