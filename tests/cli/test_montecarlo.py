"""The configuration of a study, and the commands montecarlo and report."""

import re
import shlex
import sys
import tomllib

import jax
import numpy as np
import pytest

import jaxpound as jp
from jaxpound._tables import rounded
from jaxpound.cli import files, montecarlo, reading
from jaxpound.cli import main as cli
from jaxpound.model.parameters import get
from jaxpound.results.named import in_words
from tests.cli.commands import changed, refusal, run, unrendered
from tests.cli.written import is_figure, page_of, summary, tables
from tests.storing import studied

EXAMPLE = files.example("montecarlo")
TABLE = r"config.toml: \[earthquakes\]"
SMALL = "duration = 3.0 & samples = 40 & wavelets = 2 & arrivals = {uniform = [0.5, 2.5]}"


def of_records(table, rest="\n[uncertain]"):
    """The example with records in the place of wavelets, and what follows them."""
    head, tail = EXAMPLE.split("[earthquakes]", 1)
    return f"{head}[earthquakes]\n{table}\n{tail[tail.index(rest) :]}"


def read(path):
    file = reading.File.opened(path, "montecarlo")
    given = file.read(montecarlo.StudyConfig)
    return given, *montecarlo.prepared(file, given)


def test_the_example_is_the_pair_in_si_and_rods_need_no_quotation_marks(write):
    study, scenarios, grid = read(None)
    given = tomllib.loads(EXAMPLE)
    buildings = [jp.Building.from_period(**given[f"building_{i}"]) for i in (1, 2)]
    pair = jp.Buildings(tuple(buildings), (jp.FloorLink(0, 0, friction=200e3, gap=0.1),))
    median, ground = scenarios.realize(np.zeros(scenarios.dimension))
    for ours, theirs in zip(jax.tree.leaves(median), jax.tree.leaves(pair), strict=True):
        assert float(ours) == pytest.approx(float(theirs))
    np.testing.assert_allclose(np.abs(ground.amplitude), 0.025)
    np.testing.assert_allclose(ground.periods, 1.0)
    np.testing.assert_allclose(ground.arrivals, 3.5)
    drawn = scenarios.realize(np.eye(scenarios.dimension)[0])[0]
    assert float(drawn.links[0].friction) == pytest.approx(200e3 * np.exp(0.2))
    assert grid.dt == pytest.approx(0.6 / 50, rel=0.01)
    assert (study.study.samples, study.study.seed, study.study.sampling) == (10_000, 0, "plain")
    bare = write(text=EXAMPLE.replace('"rod_1.tau_x" =', "rod_1.tau_x ="))
    of_building = ["buildings.1.storeys.0.stiffness", "buildings.0.storeys.0.tau_x"]
    assert [*read(bare)[1].structures.uncertain] == ["links.0.friction", *of_building]


def test_keys_of_a_pair_stand_for_those_of_a_row(write):
    keys = {
        "friction": ("link.1.friction_force", "links.0.friction"),
        "initial_gap": ("link.1.gap", "links.0.gap"),
        "stiffness_ratio": ("building.2.storey.1.stiffness", "buildings.1.storeys.0.stiffness"),
        "rod_*.tau_x": ("building.*.storey.1.tau_x", "buildings.0.storeys.0.tau_x"),
        "contact.restitution": ("link.*.contact.restitution", "links.0.contact.restitution"),
    }
    contact = '[contact] ; law = "newton" ; restitution = 0.65'
    for key, (of_row, path) in keys.items():
        drawn = []
        for stated in (key, of_row):
            line = f'"{stated}" = {{lognormal = [0.98, 0.1]}}'
            others = 'friction = { -> nothing & "rod_1.tau_x" -> nothing'
            changes = f"{contact} & {others} & stiffness_ratio -> {line}"
            drawn.append(read(write(changes))[1].structures)
        first, second = ([*x.uncertain.items()] for x in drawn)
        assert first == second
        assert first[0][0] == path
        assert first[0][1].median == pytest.approx(0.98 * float(get(drawn[0].nominal, path)))


def test_a_factor_on_the_mass_ratio_is_the_inverse_of_one_on_the_second_mass(write):
    changes = "stiffness_ratio -> mass_ratio = {lognormal = [1.25, 0.1]}"
    structures = read(write(changes))[1].structures
    mass = structures.uncertain["buildings.1.storeys.0.mass"]
    assert (mass.median, mass.sigma) == (pytest.approx(400e3 / 1.25), 0.1)


def shake(path, size, n):
    values = size * np.sin(0.05 * np.arange(n))
    np.savetxt(path, np.column_stack([0.02 * np.arange(n), values]), delimiter=",")


def test_recorded_earthquakes_are_read_beside_the_file(write, tmp_path):
    for i, n in enumerate((80, 120)):
        shake(tmp_path / f"{i}.csv", 0.2, n)
    table = 'records = ["0.csv", "1.csv"]\nunits = "m/s2"\nfactor = {uniform = [1, 3]}\n'
    text = of_records(table).replace("duration = 12.0", "")
    _, scenarios, grid = read(write(text=text))
    records = scenarios.ground.records
    (tmp_path / "1.csv").write_text("t (s), a (m/s2)\n" + (tmp_path / "1.csv").read_text())
    text = text.replace('"0.csv", ', "").replace('units = "m/s2"\n', "")
    stated = read(write(text=text))[1].ground.records
    np.testing.assert_array_equal(stated[0].samples, records[1].samples)
    assert [record.n_samples for record in records] == [80, 120]
    assert float(np.abs(records[1].samples).max()) == pytest.approx(0.2 / 9.80665, rel=1e-3)
    assert scenarios.ground.factor == jp.Uniform(1, 3)
    assert grid.dt * grid.n_steps == pytest.approx(119 * 0.02, abs=0.02)


MODEL = """mass = 5.0 & period = 0.06 & friction_force = 0.5 & gap = 0.001 & duration = 0.5
    & amplitude = {uniform = [1e-5, 1e-4]} & periods = {uniform = [0.005, 0.02]}
    & arrivals = {uniform = [0.05, 0.3]}"""
TOWER = """mass = 5e8 & period = 9.5 & friction_force = 5e7 & gap = 2.0 & duration = 300.0
    & amplitude = {uniform = [0.1, 2.0]} & periods = {uniform = [1.0, 15.0]}
    & arrivals = {uniform = [10.0, 250.0]}"""


@pytest.mark.parametrize("changes", [MODEL, TOWER])
def test_a_laboratory_s_models_and_towers_are_plausible(changes, write):
    """What is far from the example, and yet is built."""
    head, tail = changed(EXAMPLE, changes).split("[building_2]", 1)
    second = changed(tail, " & ".join(changes.split(" & ")[:2]))
    assert read(write(text=f"{head}[building_2]{second}"))[2].n_steps > 100


NOTHING = r"config.toml: nothing is random; it must have \[uncertain\]"
OVERFLOW = rf"{TABLE} weights = \[1e\+308, 1e\+308\] must be a list of numbers between 0 and"


@pytest.mark.parametrize(
    ("records", "rest", "says"),
    [
        ('["one.csv"]', "\n[run]", NOTHING),
        ('["none.at2"]', "\n[uncertain]", f"{TABLE} records: \\S*none.at2: no such file"),
        (
            '[{file = "one.csv", column = 2}]',
            "\n[uncertain]",
            f"{TABLE} records: \\S*one.csv:1: column = 2 must be a number from 1",
        ),
        (
            '["one.csv", {column = 2}]',
            "\n[uncertain]",
            f"{TABLE} records = .* must be a list of paths or {{file = ...}} with, if",
        ),
        ('["a.csv", "b.csv"]\nweights = [1e308, 1e308]', "\n[uncertain]", OVERFLOW),
    ],
)
def test_records_that_make_no_study_are_refused(records, rest, says, write, tmp_path, capsys):
    shake(tmp_path / "one.csv", 0.1, 80)
    path = write(text=of_records(f"records = {records}", rest))
    assert re.search(says, refusal(capsys, "montecarlo", path, "--store", tmp_path / "st"))


def test_a_study_from_the_command_line_in_two_shards_and_its_report(write, tmp_path):
    path = write(f"{SMALL} & chunk_size = 10")
    store, out = tmp_path / "st", tmp_path / "out"
    run("montecarlo", path, "--store", store, "--shard", "1/2")
    with unrendered():
        run("report", "--store", store, "--out", out)
    page = (out / "summary.md").read_text()
    assert "20 scenarios of 40 asked for (unfinished)" in page
    run("montecarlo", path, "--store", store, "--shard", "2/2")
    screen = run("montecarlo", path, "--store", store)
    assert "Study of 40 scenarios, 0 failed (SI)" in screen
    _, scenarios, grid = read(path)
    found = studied(scenarios, 40, grid, chunk_size=10, keep_parameters=True)  # as the command
    assert f"probability of pounding {found.pounding_probability()}" in screen

    printed = run("report", "--store", store, "--out", out).split()
    assert sorted(map(str, out.iterdir())) == sorted(printed)
    assert (out / "study.toml").read_text() == path.read_text()
    answers = summary(out)
    assert answers["pounding_probability"]["value"] == found.pounding_probability().value
    rules = found.separation(0.1)
    assert answers["required_gap"]["0.1"]["srss"] == pytest.approx(rules.srss)
    assert answers["demands"]["peak_f1"]["mean"] == pytest.approx(found.moments("peak_f1").mean)
    curve = jp.fit_fragility(found["pgv"], found["pounds"] == 1)
    assert answers["fragility"]["pgv"]["median"] == pytest.approx(curve.median)
    page = page_of(out)
    assert f"**Probability of pounding: {found.pounding_probability().value:.4g} (" in page
    assert is_figure(out / "convergence.png")
    gaps, demands, fragility = tables(page)
    row = answers["required_gap"]["0.05"]
    (gap,) = (x for x in gaps if x["exceeded with probability"] == "0.05")
    assert gap["required gap (m)"].startswith(rounded(row["value"]))
    assert gap["SRSS"] == rounded(row["srss"])
    for name, row in answers["demands"].items():
        (told,) = (x for x in demands if x["demand"] == in_words(name))
        assert told["unit"] == row["unit"] != ""
        for share, quantile in (("5", "0.05"), ("95", "0.95")):
            assert told[f"{share} % quantile"] == rounded(row[f"quantile_{quantile}"])
    assert {x["unit"] for x in demands} == {"m", "s", "N", "m/s", "m/s²", "J"}
    for curve, told in zip(answers["fragility"].values(), fragility, strict=True):
        assert told["median θ"] == rounded(curve["median"])
        assert told["unit"] == curve["unit"] != ""

    assert "Study of 50 scenarios" in run("montecarlo", path, "--store", store, "--samples", 50)


def test_the_commands_that_are_printed_make_the_study_of_one_run(write, tmp_path, capsys):
    path, shared, alone = write(f"{SMALL} & chunk_size = 10"), tmp_path / "a study", tmp_path / "st"
    options = ["--samples", 30, "--strict"]
    arguments = map(str, ["montecarlo", path, "--store", shared, *options, "--commands", 2])
    assert cli.main([*arguments]) == 0
    assert not shared.exists()
    first, second = capsys.readouterr().out.splitlines()
    quoted = f"jaxpound montecarlo {path} '--store={shared}' --samples=30 --strict"
    assert (first, second) == (f"{quoted} --shard=1/2", f"{quoted} --shard=2/2")
    for line in (first, second):
        assert cli.main(shlex.split(line)[1:]) == 0
    run("montecarlo", path, "--store", alone, *options)
    study, whole = jp.Study.open(shared), jp.Study.open(alone)
    assert len(study) == 30
    assert study.columns == whole.columns
    for name in whole.columns:
        np.testing.assert_array_equal(study[name], whole[name])


@pytest.fixture(scope="module")
def small_study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("small")
    (folder / "study.toml").write_text(changed(EXAMPLE, SMALL))
    run("montecarlo", folder / "study.toml", "--store", folder / "st")
    return folder / "st"


@pytest.mark.parametrize("ending", ["csv", "parquet"])
@pytest.mark.usefixtures("without_pictures")
def test_a_report_writes_the_table_of_a_study(ending, small_study, tmp_path):
    pandas = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    table = tmp_path / "out" / f"study.{ending}"
    printed = run("report", "--store", small_study, "--out", table.parent, "--table", table)
    assert str(table) in printed.splitlines()
    read_table = {"csv": pandas.read_csv, "parquet": pandas.read_parquet}[ending]
    columns = read_table(table).reset_index()
    for name, values in jp.Study.open(small_study).to_columns().items():
        np.testing.assert_array_equal(columns[name], values)


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ("no folder/study.csv", "no folder.*No such file or directory"),
        ("study.txt", r"argument --table: \S*study.txt must end in .csv or .parquet"),
        ("study.parquet", r"argument --table: jaxpound needs pyarrow, which the extra 'tables'"),
    ],
)
def test_a_table_that_cannot_be_written(table, says, small_study, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    command = ["report", "--store", small_study, "--out", tmp_path / "out"]
    assert re.search(says, refusal(capsys, *command, "--table", tmp_path / table))
    assert not [*tmp_path.iterdir()]


def test_a_study_with_contact_and_its_report(write, tmp_path):
    contact = '[contact] ; law = "newton" ; restitution = 0.65 & gap = 0.04'
    uncertain = '"rod_1.tau_x" -> contact.restitution = {uniform = [0.8, 1.2]}'
    path = write(f"{SMALL} & {contact} & {uncertain}")
    store, out = tmp_path / "st", tmp_path / "out"
    run("montecarlo", path, "--store", store)
    study = jp.Study.open(store)
    e = study.parameters()["links.0.contact.restitution"]
    assert 0.52 <= e.min() < e.max() <= 0.78
    run("report", "--store", store, "--out", out)
    answers = summary(out)
    assert answers["required_gap"] == {}
    hit = np.isfinite(study["first_impact_time"])
    assert 0 < hit.sum() < len(study)
    assert answers["impacts"]["0"]["value"] == 1 - hit.mean()
    first = answers["demands"]["first_impact_time"]
    assert first["mean"] == pytest.approx(study["first_impact_time"][hit].mean())
    assert first["largest"] < 3.0
    page = page_of(out)
    impacts, demands, _ = tables(page)
    assert [x["number of impacts"] for x in impacts] == [*answers["impacts"]]
    units = {x["demand"]: x["unit"] for x in demands}
    assert units["number of impacts"] == "-"
    assert units["impulse of the strongest impact"] == "N s"
    assert "Rank correlation with the impulse of the strongest impact: " in page
