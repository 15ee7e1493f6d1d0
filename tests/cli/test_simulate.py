"""``jaxpound simulate``: its numbers are the API's, its configuration is the library's objects."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

import jaxpound as jp
from jaxpound._tables import rounded
from jaxpound.cli import buildings, reading, simulate
from jaxpound.cli import main as cli
from jaxpound.cli.files import example
from tests.cli.commands import PULSE, example_pair, refusal, run
from tests.cli.written import is_figure, summary

FIGURES = {"overview", "ground_motion", "displacements", "gap", "rod_hysteresis", "energy"}
FIGURES |= {"row", "envelopes"}
FIGURES_OF_DAMPER = {"friction_force", "friction_hysteresis"}


PAIR = example_pair(friction_force=200e3, gap=0.10)


@pytest.fixture(scope="module")
def el_centro_response(el_centro) -> jp.Response:
    """The example's buildings under El Centro, without the command line."""
    record = jp.read_record(el_centro)
    return jp.simulate(PAIR, record, jp.TimeGrid.until(float(record.duration), 0.01))


def test_el_centro_summary_and_screen_have_the_api_s_numbers(
    el_centro_run, el_centro_response, el_centro
):
    answers = summary(el_centro_run[1])
    assert answers["jaxpound"] == jp.__version__
    record = {"pga_g": 0.2807955, "duration_s": 53.71, "dt_s": 0.01}
    assert answers["record"].pop("file") == str(el_centro)
    assert answers["record"] == pytest.approx(record)
    assert (answers["run"]["dt_s"], answers["run"]["steps"]) == (pytest.approx(0.01), 5371)
    assert answers["configuration"] == tomllib.loads(example("simulate"))

    demand, energy = el_centro_response.demand, el_centro_response.energy
    results = answers["results"]
    expected = {"min_gap_m": demand.min_gap, "min_gap_time_s": demand.min_gap_time}
    expected |= {"input_energy_J": energy.input[-1], "rods_energy_J": energy.rods[-1]}
    expected |= {"damper_energy_J": energy.friction[-1], "kinetic_energy_J": energy.kinetic[-1]}
    expected |= {"energy_residual_over_input": energy.relative_residual}
    for name, value in expected.items():
        assert results[name] == pytest.approx(float(value), rel=1e-6), name
    (link,) = results["links"]
    for name in ("slip_distance", "residual_offset"):
        assert link[f"{name}_m"] == pytest.approx(float(getattr(demand, name)), rel=1e-6)
    first, second = results["buildings"]
    assert first["natural_period_s"] == pytest.approx(0.9)
    assert first["modes"][0]["damping_ratio"] == pytest.approx(0.05, rel=0.03)  # of free vibration
    assert first["peak_displacement_m"] == pytest.approx(float(demand.peak_x1))
    assert second["base_shear_N"] == pytest.approx(float(demand.peak_f2))
    a2 = el_centro_response.absolute_accelerations[1]
    peak = second["peak_absolute_acceleration_m_per_s2"]
    assert peak == pytest.approx(float(demand.peak_acceleration_2))
    assert 1 <= peak / np.abs(a2).max() < 1.01  # the grid may miss the top
    told = (results["pounds"], results["overlap_m"], results["first_contact_s"])
    assert told == (False, 0, None)
    assert results["min_gap_m"] > 0.02  # what the example's heading promises
    screen, out = el_centro_run
    assert screen.startswith("No --config given")
    assert repr(el_centro_response) in screen
    assert screen.count("floor by floor") == 2
    assert "POUNDS" not in screen
    assert "first contact" not in screen
    period, damping = (first["modes"][0][key] for key in ("period_s", "damping_ratio"))
    assert re.search(rf"(?m)^ *1 +{rounded(period)} +{rounded(damping)} ", screen)
    assert f"damper {results['damper_energy_J']:.4g} J" in screen
    printed = screen.splitlines()[-13:]
    assert sorted(printed) == sorted(str(path) for path in out.iterdir())


def test_el_centro_files_can_be_read_back(el_centro_run, el_centro_response):
    _, out = el_centro_run
    series, response = np.load(out / "series.npz"), el_centro_response
    assert len(series.files) == 14
    expected = {f"{name}_m": getattr(response, name) for name in ("x1", "x2", "gap")}
    expected |= {f"{name}_N": getattr(response, name) for name in ("f2", "friction")}
    for name, values in {
        **expected,
        "time_s": response.time,
        "v1_m_per_s": response.v1,
        "ground_acceleration_m_per_s2": response.ground_acceleration,
        "ground_velocity_m_per_s": response.ground_velocity,
        "absolute_acceleration_1_m_per_s2": response.absolute_accelerations[0],
        "slip_direction": response.phase,
    }.items():
        scale = float(np.abs(values).max())
        np.testing.assert_allclose(series[name], values, rtol=0, atol=1e-8 * scale, err_msg=name)
    pga = np.abs(series["ground_acceleration_m_per_s2"]).max()
    assert pga == pytest.approx(0.2807955 * jp.STANDARD_GRAVITY)
    assert {path.stem for path in out.glob("*.png")} == FIGURES | FIGURES_OF_DAMPER
    as_large_as_needed = {"row", "envelopes", "rod_hysteresis", "friction_hysteresis"}
    assert all(is_figure(x) for x in out.glob("*.png") if x.stem not in as_large_as_needed)


def columns_of(path):
    header, *rows = path.read_text().splitlines()
    return dict(zip(header.split(","), np.loadtxt(rows, delimiter=",").T, strict=True))


NEAR = "friction_force = 0 & gap = 0.03 & series = 'csv'"


def test_without_damper_and_with_a_small_gap_the_buildings_pound(pulse, write, tmp_path):
    out = tmp_path / "out"
    screen = run("simulate", "--record", pulse, "--config", write(NEAR), "--out", out, "--pdf")
    assert "No --config" not in screen
    for path in out.glob("*.png"):
        pdf = path.with_suffix(".pdf").read_bytes()
        assert pdf.startswith(b"%PDF")
        assert b"/Type3" not in pdf  # letters stay letters
        assert str(path.with_suffix(".pdf")) in screen
    results = summary(out)["results"]
    assert results["pounds"]
    assert results["overlap_m"] == pytest.approx(-results["min_gap_m"])
    assert results["overlap_m"] > 0
    assert "POUNDS" in screen
    assert f"overlap {results['overlap_m']:.4g} m, first contact at " in screen
    assert "contact itself is not modelled" in screen
    assert "slid" not in screen
    assert "damper 0" not in screen
    assert not list(out.glob("friction_*"))

    table = columns_of(out / "series.csv")
    assert list(table)[:3] == ["time_s", "ground_acceleration_m_per_s2", "x1_m"]
    closed = np.flatnonzero(table["gap_m"] <= 0)[0]
    assert table["time_s"][closed - 1] < results["first_contact_s"] <= table["time_s"][closed]
    assert results["min_gap_m"] == pytest.approx(table["gap_m"].min(), abs=1e-3)
    gap = 0.03 + table["x2_m"] - table["x1_m"]
    np.testing.assert_allclose(table["gap_m"], gap, rtol=0, atol=1e-9)
    # dt is the record's .02 s halved, the first whole fraction below a fiftieth of .6 s.
    np.testing.assert_allclose(np.diff(table["time_s"]), 0.01, rtol=1e-6)
    assert not (out / "series.npz").exists()


KELVIN = '[contact] ; law = "kelvin-voigt" ; stiffness = 1.6e9 ; restitution = 0.65'


@pytest.mark.usefixtures("without_pictures")
def test_with_a_law_of_contact_the_impacts_are_told(pulse, write, tmp_path):
    path, out = write(f"{NEAR} & {KELVIN}"), tmp_path / "out"
    screen = run("simulate", "--record", pulse, "--config", path, "--out", out)
    results = summary(out)["results"]
    file, given = read(path)
    response = simulate.respond(file, given, jp.read_record(pulse))
    link, told = response.demand.links[0], results["links"][0]["contact"]
    assert told["n_impacts"] == len(told["impacts"]) == len(response.impacts()) > 0
    assert told["peak_contact_N"] == pytest.approx(float(link.peak_contact))
    assert told["peak_impulse_N_s"] == pytest.approx(float(link.peak_impulse))
    assert told["contact_work_J"] == pytest.approx(float(response.energy.contact_lost[-1]))
    assert abs(told["stored_at_end_J"]) < 1e-2 * told["contact_work_J"]
    first = told["impacts"][0]
    assert first["time_s"] == told["first_impact_time_s"] == results["first_contact_s"]
    # Momentum: the impulse changes the velocities of both; nearly alone, as it is short.
    masses = 1 / (1 / 500e3 + 1 / 400e3)
    change = first["approach_velocity_m_per_s"] + first["rebound_velocity_m_per_s"]
    assert first["impulse_N_s"] == pytest.approx(masses * change, rel=0.1)
    assert "POUNDS" in screen
    assert f"penetration {results['overlap_m']:.4g} m, first contact at " in screen
    assert "not modelled" not in screen
    assert f"contact {told['contact_work_J']:.4g} J (" in screen
    table = columns_of(out / "series.csv")
    np.testing.assert_allclose(table["contact_N"], response.links[0].contact)
    for name in ("contact_stored_J", "contact_lost_J", "friction_work_J", "touching"):
        values = getattr(response.links[0], name.removesuffix("_J"))
        np.testing.assert_allclose(table[name], values, rtol=1e-12)
    figures = {path.stem for path in out.glob("*.png")}
    assert figures == FIGURES | {"contact_force", "contact_hysteresis"}


@pytest.mark.usefixtures("without_pictures")
def test_units_and_dt_of_a_bare_record(write, tmp_path, capsys):
    record, out = tmp_path / "gal.txt", tmp_path / "out"
    np.savetxt(record, PULSE * 980.665)
    bare = ["--record", record, "--dt", 0.02, "--out", out]
    line = refusal(capsys, "simulate", *bare)
    assert re.search(r"gal.txt:\d+: acceleration = \S+ g must be at most 20 g: are the units", line)
    run("simulate", *bare, "--units", "gal", "--config", write('series = "none"'))
    answers = summary(out)
    assert answers["record"]["pga_g"] == pytest.approx(np.abs(PULSE).max(), rel=1e-6)
    assert (answers["run"]["dt_s"], answers["run"]["steps"]) == (pytest.approx(0.01), 200)
    assert not list(out.glob("series.*"))
    file, configuration = read(write("duration = 0.5 & dt = 0.02"))
    time = simulate.respond(file, configuration, jp.Record(PULSE, 0.02)).time
    assert (time.size, float(time[1])) == (26, pytest.approx(0.02))


def read(path: Path) -> tuple[reading.File, simulate.Simulation]:
    file = reading.File.opened(path, "simulate")
    return file, file.read(simulate.Simulation)


def with_second_building(keys: str) -> str:
    first, rest = example("simulate").split("[building_2]", 1)
    return f"{first}[building_2]\n{keys}\n[damper]{rest.rsplit('[damper]', 1)[1]}"


def test_rods_and_the_scheme_are_read_and_rods_may_rule_the_time_step(write):
    rod = "mass = 4e5\nstiffness = 38e6\norder = 1\ntau_f = 0.003\ntau_x = 0.05"
    building = read(write(text=with_second_building(rod)))[1].building_2.shear().storeys[0]
    given = jp.Building(4e5, 38e6, 1.0, 0.003, 0.05)
    assert building == given or vars(building) == vars(given)
    # A rod that is far stiffer when fast than when slow: the limit rules, not the period.
    rod = "mass = 4e5\nstiffness = 1e5\norder = 0.1\ntau_f = 1e-4\ntau_x = 90.0"
    file, configuration = read(write(text=with_second_building(rod)))
    limit = jp.stability_limit(configuration.buildings, configuration.run.scheme)
    time = simulate.respond(file, configuration, jp.Record(PULSE[:40], 0.02)).time
    assert float(time[1]) <= limit / 2
    assert read(write())[1].run.scheme == jp.Scheme()
    switching = read(write('friction = "switching" & order = 2 -> order = 1'))[1]
    assert switching.run.scheme == jp.Scheme(jp.simulation.Switching(), 1)
    _, smoothed = read(write('friction = "smoothed" & smoothing_velocity = 1e-3'))
    assert smoothed.run.scheme == jp.Scheme(jp.Smoothed(1e-3))  # metres a second


LAWS = {
    'law = "newton" ; restitution = 0.6': jp.Newton(0.6),
    'law = "kelvin-voigt" ; STIFF ; tension = true': jp.KelvinVoigt(3e9, 0.6, tension=True),
    'law = "hertz" ; stiffness = 3e9': jp.Hertz(3e9),
    'law = "hertz-damped" ; STIFF ; damping = "ye"': jp.HertzDamped(3e9, 0.6, "ye"),
    'law = "jankowski" ; STIFF': jp.Jankowski(3e9, 0.6),
}


@pytest.mark.parametrize(("keys", "law"), LAWS.items(), ids=lambda x: type(x).__name__)
def test_laws_of_contact_are_read_in_si_and_written_back(keys, law, write):
    stiff = "stiffness = 3e9 ; restitution = 0.6"
    _, given = read(write(f"[contact] ; {keys.replace('STIFF', stiff)}"))
    assert vars(given.contact.model()) == vars(law)
    again = read(write(text=buildings.as_toml(given.layout.buildings)))[1]
    for configuration in (given, again):
        (link,) = configuration.buildings.links
        assert type(link.contact) is type(law)
        assert vars(link.contact) == vars(law)


def test_ground(write):
    for changes, expected in (
        ("", PULSE),
        ("scale = -2", -2 * PULSE),
        ("scale -> pga = 0.1", 0.1 * PULSE / np.abs(PULSE).max()),
        ('baseline = "mean"', PULSE - PULSE.mean()),
    ):
        file, configuration = read(write(changes))
        record = simulate.shaking(file, configuration.ground, jp.Record(PULSE, 0.02))
        np.testing.assert_allclose(record.samples, expected, atol=1e-15)


def test_a_truncated_record(el_centro, tmp_path, capsys):
    path = tmp_path / "cut.at2"
    path.write_text("".join(el_centro.read_text().splitlines(keepends=True)[:100]))
    line = refusal(capsys, "simulate", "--record", path, "--out", tmp_path / "out")
    assert f"{path}:4: truncated: npts= 5372" in line


@pytest.mark.usefixtures("without_pictures")
def test_implausible_input_is_one_warning_a_line_or_refused(write, pulse, tmp_path, capsys):
    moved = "gap = 10 m should be at most 5 times what the buildings move"
    for changes, finding in (
        ("scale -> pga = 6", "ground: PGA = 6 g should be at most 2 g"),
        ("gap = 10 & scale = 1e-3", moved),  # found before the run, in the file alone
    ):
        odd, out = write(f'{changes} & series = "none"'), tmp_path / finding[:3]
        call = ["simulate", "--record", str(pulse), "--config", str(odd), "--out", str(out)]
        error = refusal(capsys, *call, "--strict")
        assert error.removeprefix("jaxpound: error: ").removeprefix(f"{odd}: ").startswith(finding)
        assert cli.main(call) == 0
        (warning,) = capsys.readouterr().err.splitlines()
        assert warning.startswith(f"jaxpound: warning: {finding}")


@pytest.mark.usefixtures("without_pictures")
def test_an_offset_is_refused_if_strict_unless_the_baseline_is_corrected(write, tmp_path, capsys):
    path, out = tmp_path / "raw.csv", tmp_path / "out"
    times = 0.02 * np.arange(PULSE.size)
    np.savetxt(path, np.column_stack([times, PULSE - PULSE.mean() + 0.05]), "%.6f", delimiter=",")
    call = ["simulate", "--record", path, "--units", "g", "--out", out, "--strict", "--config"]
    words = "the mean acceleration, 0.05 g, is"
    refused = refusal(capsys, *call, write('series = "none"'))
    assert refused.startswith(f"jaxpound: error: {path}: {words}")
    for baseline in ("mean", "linear"):
        run(*call, write(f'baseline = "{baseline}" & series = "none"'))
    assert capsys.readouterr().err == ""


def test_a_run_that_fails_is_told_in_one_line_and_leaves_no_empty_folder(
    pulse, tmp_path, monkeypatch, capsys
):
    def respond(*_, **__):
        raise FloatingPointError("the run ended in\nnon-finite numbers")

    out = tmp_path / "new" / "out"
    for fails in (respond, lambda *_, **__: 1 / 0):
        monkeypatch.setattr(simulate, "respond", fails)
        error = refusal(capsys, "simulate", "--record", pulse, "--out", out)
        if fails is respond:
            assert error == "jaxpound: error: the run ended in non-finite numbers\n"
        assert not list(tmp_path.iterdir())


FULL = [("npz", 100, "summary.json")]
FULL += [("npz", 100_000, "series.npz"), ("csv", 100_000, "series.csv")]


@pytest.mark.parametrize(("series", "room", "name"), [*FULL, ("none", 10_000, "overview.png")])
def test_a_full_disk_names_the_file_and_leaves_no_part_of_it(
    series, room, name, el_centro, el_centro_run, write, tmp_path, capsys
):
    """The operating system's own refusal in the middle of a file; compiled by the run before."""
    resource = pytest.importorskip("resource")
    out, path = tmp_path / "new" / "out", write(f'series = "{series}"')
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, hard))
    try:
        arguments = ["--record", el_centro, "--config", path, "--out", out]
        assert cli.main(["simulate", *map(str, arguments)]) == 2
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert capsys.readouterr().err == f"jaxpound: error: {out / name}: File too large\n"
    left = [] if name == "summary.json" else ["summary.json"]
    left += ["floors.csv"] * (series == "none")  # the last file before the figures
    assert {path.name for path in out.glob("*")} == {*left}
    assert out.exists() == bool(left)  # no empty folder
