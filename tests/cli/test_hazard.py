"""``jaxpound hazard``: its configuration, and what it writes."""

import re

import numpy as np
import pytest
from matplotlib.image import imread

import jaxpound as jp
from jaxpound.cli.files import example
from jaxpound.quantities import STANDARD_GRAVITY
from tests.cli.commands import changed, faults, refusal, run, unrendered
from tests.cli.written import csv_rows, is_figure, number, summary, tables

EXAMPLE = example("hazard")
OPENQUAKE = """\
#,,,,,"generated_by='OpenQuake engine 3.7.0', kind='mean', investigation_time=50.0, imt='PGA'"
lon,lat,depth,poe-0.1000000,poe-0.2000000,poe-0.4000000
13.4,46.0,0.0,0.5,0.2,0.05
13.5,46.0,0.0,0.4,0.1,0.02
"""
STUDY = '\n[study]\nstore = "study"\nintensity = "pga"\ngap = 0.04\nlink = 1\n'
STUDY += "gap_probabilities = [0.1, 0.02]\n"


def of_file(site):
    """The example with a file in the place of points, and a line for its site."""
    of_curve = f'file = "curve.csv"\n{site}\n'
    return re.sub(r"(?s)intensity = .*?measure[^\n]*", of_curve, EXAMPLE, count=1)


def of_study():
    """The example with a study in the place of a fragility."""
    head, tail = EXAMPLE.split("[fragility]", 1)
    return f"{head}{STUDY}\n{tail[tail.index('[results]') :]}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("hazard")
    changes = "samples = 400 & duration = 8.0 & # dt = 0.01 -> dt = 0.03"
    changes += " & intensity = {lognormal = [0.5, 0.6]} & spectral_acceleration = true"
    (made / "study.toml").write_text(changed(example("montecarlo"), changes))
    run("montecarlo", made / "study.toml", "--store", made / "study")
    (made / "curve.csv").write_text(OPENQUAKE)
    return made


CURVE = [[0.05, 3e-2], [0.1, 1e-2], [0.2, 3e-3], [0.4, 6e-4], [0.8, 8e-5], [1.6, 6e-6]]
"""That of the example."""


@pytest.fixture(scope="module")
def drawn(folder):
    changes = f"intensity = {{hazard = {CURVE}}} & spectral_acceleration = false"
    (folder / "drawn.toml").write_text(changed((folder / "study.toml").read_text(), changes))
    run("montecarlo", folder / "drawn.toml", "--store", folder / "drawn")
    return folder


def of_drawn():
    """The example with a study that the hazard has drawn."""
    study = STUDY.replace('"study"', '"drawn"').replace("0.04", "0.005").replace("0.02]", "0.05]")
    return of_study().replace(STUDY, f"{study}drawn = true\n")


def told(folder, text):
    (folder / "hazard.toml").write_text(text)
    screen = run("hazard", folder / "hazard.toml", "--out", folder / "out")
    return screen, summary(folder / "out")


@pytest.mark.usefixtures("without_pictures")
def test_a_power_law_gives_cornell_s_rate(tmp_path):
    """λ(θ) e^(k² β² / 2), its interval from the errors by d ln λ/d ln θ = −k, d ln λ/dβ = k² β."""
    changes = "intensity = [0.1, 1.0] & annual_rate = [1e-2, 1e-5] & years = 30.0"
    screen, answers = told(tmp_path, changed(EXAMPLE, changes))
    rate = 1e-5 * 0.6**-3 * np.exp(9 * 0.4**2 / 2)
    cov = np.hypot(3 * 0.05 / 0.6, 9 * 0.4 * 0.05)
    assert answers["annual_rate"]["value"] == pytest.approx(rate, rel=1e-9)
    assert answers["annual_rate"]["cov"] == pytest.approx(cov, rel=1e-9)
    assert answers["annual_rate"]["high"] == pytest.approx(rate * np.exp(1.96 * cov), rel=1e-4)
    assert answers["return_period_years"] == pytest.approx(1 / rate)
    assert answers["probability"]["value"] == pytest.approx(-np.expm1(-30 * rate))
    assert "probability in 30 years" in screen


def test_what_is_written(tmp_path):
    screen, answers = told(tmp_path, EXAMPLE)
    out = tmp_path / "out"
    names = {"hazard.png", "summary.json", "summary.md", "deaggregation.csv"}
    assert {path.name for path in out.iterdir()} == names
    assert imread(out / "hazard.png").shape[1] == 1062
    assert answers["required_gap"] == {}
    rows = [{k: float(x) for k, x in row.items()} for row in csv_rows(out / "deaggregation.csv")]
    assert len(rows) == 20
    total = answers["annual_rate"]["value"]
    assert sum(row["annual_rate"] for row in rows) == pytest.approx(total, rel=2e-3)
    centre = max(rows, key=lambda row: row["share"])
    assert 0.05 < centre["cov"] < 0.5
    assert centre["from"] < answers["mean_intensity_at_pounding"] < 1.2 * centre["to"]
    of_rate, of_curve, of_bands = tables((out / "summary.md").read_text())
    assert of_rate[0]["value"] in screen
    assert (of_curve[0]["value"], of_curve[0]["standard error"]) == ("0.6", "0.05")
    assert number(of_bands[0]["annual rate"]) == pytest.approx(rows[0]["annual_rate"], rel=1e-3)


@pytest.mark.usefixtures("without_pictures")
def test_without_errors_there_is_no_interval_and_probabilities_are_told_of_once(tmp_path, capsys):
    text = changed(EXAMPLE, "median_error -> nothing & dispersion_error -> nothing")
    screen, answers = told(tmp_path, text)
    assert "(no 95% interval)" in screen
    assert answers["annual_rate"]["low"] is None
    assert (tmp_path / "out" / "deaggregation.csv").read_text().splitlines()[1].endswith(",")
    assert answers["annual_rate"]["value"] > 0
    rates = [float(f"{-np.expm1(-50 * rate):.3g}") for _, rate in CURVE]
    told(tmp_path, changed(EXAMPLE, f"annual_rate = {rates}"))
    assert capsys.readouterr().err.count("of probabilities p within years it is -ln(1 - p)") == 1


@pytest.mark.usefixtures("without_pictures")
def test_a_file_of_openquake(folder):
    for site, share in ((1, 0.2), (2, 0.1)):
        _, answers = told(folder, of_file(f"site = {site}"))
        assert answers["measure"] == "PGA (g)"
        assert answers["hazard"]["annual_rate"][1] == pytest.approx(-np.log1p(-share) / 50)


def test_a_study_of_si_units_meets_a_hazard_in_g(folder):
    screen, answers = told(folder, of_study())
    study, given = jp.Study.open(folder / "study"), answers["hazard"]
    curve = jp.fit_fragility(study["pga"] / STANDARD_GRAVITY, study.pounding(0.04) == 1)
    points = [np.array(given[key]) for key in ("intensity", "annual_rate")]
    rate = jp.HazardCurve(*points).annual_rate_of(curve)
    assert answers["fragility"]["median"] == pytest.approx(curve.median, rel=1e-6)
    assert answers["annual_rate"]["value"] == pytest.approx(rate.value, rel=1e-6)
    assert answers["annual_rate"]["high"] == pytest.approx(rate.high, rel=1e-6)
    assert is_figure(folder / "out" / "fragility.png")
    # At the required gap the rate is that of its probability.
    for share, gap in answers["required_gap"].items():
        at = jp.fit_fragility(study["pga"] / STANDARD_GRAVITY, study.pounding(gap["value"]) == 1)
        found = jp.HazardCurve(*points).annual_rate_of(at).probability(50.0)
        assert found.value == pytest.approx(float(share), rel=0.05)
        assert gap["low"] < gap["value"] < gap["high"]
    assert "required gap (m)" in screen
    # The same hazard in other units, by the key or by the measure, is the same.
    gal = (100 * STANDARD_GRAVITY * np.array(given["intensity"])).tolist()
    other = re.sub(r"(?m)^intensity = \[.*$", f"intensity = {gal}", of_study())
    with unrendered():
        _, again = told(folder, other.replace('"PGA (g)"', '"PGA (cm/s2)"'))
        _, silent = told(folder, of_study().replace('"PGA (g)"', '"PGA"'))
    assert again["annual_rate"]["value"] == pytest.approx(rate.value, rel=1e-6)
    assert (again["measure"], silent["measure"]) == ("PGA (cm/s2)", "PGA (g)")
    assert silent["annual_rate"] == answers["annual_rate"]


@pytest.mark.usefixtures("without_pictures")
def test_spectral_accelerations_of_the_study_meet_a_hazard_of_them(folder):
    text = of_study().replace('"pga"', '"spectral_acceleration_1"')
    _, answers = told(folder, text.replace('"PGA (g)"', '"SA(0.9) (g)"'))
    study = jp.Study.open(folder / "study")
    curve = jp.fit_fragility(study["spectral_acceleration_1"], study.pounding(0.04) == 1)
    assert answers["fragility"]["median"] == pytest.approx(curve.median / STANDARD_GRAVITY)
    assert answers["measure"] == "SA(0.9) (g)"
    measures = [str(study.measure(f"spectral_acceleration_{i}")) for i in (1, 2)]
    assert measures == ["Sa(0.9 s) (m/s²)", "Sa(0.6 s) (m/s²)"]
    in_si = study.fragility("spectral_acceleration_1", 0.04)
    assert (in_si.unit, in_si.measure) == ("m/s²", measures[0])


def test_a_study_that_the_hazard_has_drawn_needs_no_fragility(drawn):
    screen, answers = told(drawn, of_drawn())
    study, points = jp.Study.open(drawn / "drawn"), np.transpose(CURVE)
    rate = jp.HazardCurve(*points).annual_rate_of(study, gap=0.005)
    assert 0.02 < rate.value / 3e-2 < 0.9
    for key in ("value", "low", "high", "cov"):
        assert answers["annual_rate"][key] == pytest.approx(getattr(rate, key))
    assert answers["fragility"] is None
    for share, gap in answers["required_gap"].items():
        found = study.required_gap(-np.log1p(-float(share)) / 50 / 3e-2)
        assert gap["value"] == pytest.approx(found.value)
    assert "peak ground acceleration (m/s²) from" in screen
    assert imread(drawn / "out" / "hazard.png").shape[1] == 1062
    rows = csv_rows(drawn / "out" / "deaggregation.csv")
    assert sum(float(row["annual_rate"]) for row in rows) == pytest.approx(rate.value)
    page = (drawn / "out" / "summary.md").read_text()
    assert "The interval is that of the probability in an earthquake" in page


EXAMPLES = {"EXAMPLE": EXAMPLE, "STUDY": of_study(), "DRAWN": of_drawn(), "FILE": of_file("")}
FAULTS = r"""
DRAWN: gap = 9.0 => [study] store must hold runs with pounding
STUDY: link = 1 ; drawn = true
    => [study] intensities of the study must be drawn by HazardCurve.distribution of this curve
DRAWN: annual_rate = [3e-2, 1e-2, 3e-3, 6e-4, 9e-5, 6e-6]
    => [study] intensities of the study must be drawn by HazardCurve.distribution of this curve
STUDY: measure = "SA(0.2) (g)"
    => [hazard] measure = 'SA(0.2) (g)' must be that of the fragility, peak ground accel
STUDY: measure = "PGA (g)" ; unit = 'gal' => [hazard] unit must be written in measure, such as
EXAMPLE: bands = 2001 => [results] bands = 2001 must be from 1 to
STUDY: intensity = "pga" -> intensity = "peak_x1"
    => [study] intensity = "peak_x1" must measure the shaking, such as pga
DRAWN: gap_probabilities = [0.1, 0.99] => [study] the annual rate of probability = 0.99 in 50
STUDY: intensity = "pga" -> intensity = "spectral_acceleration_1"
    => [hazard] measure = 'PGA (g)' must be that of the fragility, Sa(0.9 s) (g)
STUDY: measure = "SA(0.2)" & intensity = "pga" -> intensity = "spectral_acceleration_1"
    => [hazard] measure = 'SA(0.2) (g)' must be that of the fragility, Sa(0.9 s) (g)
EXAMPLE: intensity = [0.05, 0.1, 0.2, 0.4, 0.8, 1e300]
    => [hazard] intensity = 1e+300 (at index [5]) must be
EXAMPLE: annual_rate = [3e4, 1e-2, 3e-3, 6e-4, 8e-5, 6e-6]
    => [hazard] annual_rate = 30000 (at index [0]) must be
EXAMPLE: annual_rate = [1, 2] => [hazard] intensity (6,) and
EXAMPLE: annual_rate = [1, 2, 3, 4, 5, 6] => [hazard] annual_rate = 2
EXAMPLE: annual_rate -> nothing => [hazard] lacks annual_rate; give intensity, annual_rate
EXAMPLE: measure -> file = "x" => [hazard] must not have file here; give intensity, annual_rate
DRAWN: link = 1 -> link = 2 => [study] link = 2 must be one of the study's links with a gap, 1
EXAMPLE: median = 0 => [fragility] median = 0 must be between
EXAMPLE: median_error -> nothing => [fragility] lacks median_error; give median, dispersion
FILE: file = "curve.csv" => curve.csv: site must be one of 2, from 1
FILE: file = "curve.csv" ; site = 3 => curve.csv: site = 3 must be a row from 1 to 2
STUDY: intensity = "pga" -> intensity = "pgx" => [study] column 'pgx' must be one of
STUDY: link = 3 => [study] link = 3 must be one of the study's links
STUDY: measure = "PGA (cm/s)" => [hazard] measure = 'PGA (cm/s)' must be in the unit of
STUDY: store = "none" => none
STUDY: gap_probabilities = [0.99]
    => [study] the target, 0.0921 a year, must be the rate of pounding at a gap
"""
CASES = [
    (changed(EXAMPLES[x], y), says) for f, says in faults(FAULTS) for x, y in [f.split(": ", 1)]
]
CASES += [
    (EXAMPLE + STUDY, "must not have study here; give fragility, or study"),
]


@pytest.mark.parametrize(("text", "words"), CASES)
def test_wrong_input_is_named(text, words, drawn, capsys):
    (drawn / "wrong.toml").write_text(text)
    assert words in refusal(capsys, "hazard", drawn / "wrong.toml", "--out", drawn / "nothing")
