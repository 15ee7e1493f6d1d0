"""``jaxpound rare``: its configuration, its run, and what it writes."""

import argparse
import re
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.image import imread

import jaxpound as jp
from jaxpound.cli import files, rare, reading
from jaxpound.cli import main as cli
from jaxpound.reliability.instants import observed_at
from tests.cli.commands import changed, example_pair, refusal, run
from tests.cli.written import csv_rows, number, summary, tables
from tests.reliability.test_subset import stopped

EXAMPLE, ROW = files.example("rare"), files.example("rare", "row")
SHORT = """frequency = 1.0 & duration = 6.0 & # gap = -> gap = 0.09 & thresholds = [0.07, 0.09]
    & cov = 0.2 & # dt = 0.01 -> dt = 0.03"""
SUBSET = f'{SHORT} & method = "subset" & gap = 0.09 -> gap = 0.07 & thresholds -> nothing'
SUBSET += " & cov = 0.9"
DESIGN = '\n[design]\nparameter = "friction"\nprobability = 0.01\ntolerance = 0.3\n'


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rare")
    path = folder / "rare.toml"
    path.write_text(changed(EXAMPLE, SHORT) + DESIGN)
    arguments = ["rare", path, "--out", folder / "out", "--store", folder / "store"]
    return run(*arguments), arguments, folder


def test_the_probability_is_that_of_plain_runs_and_told_in_newtons(done):
    """Of the same scenarios from the library."""
    screen, _, folder = done
    answers = summary(folder / "out")
    pair = example_pair(friction_force=200e3, gap=0.2)
    soil, how = jp.KanaiTajimi(2 * np.pi, 0.6), {"intensity": 0.08, "time_unit": "s"}
    noise = jp.FilteredNoise(soil, 121, 0.05, envelope=jp.GammaEnvelope(3.0, 2.0), **how)
    scenarios, grid = jp.Scenarios(pair, noise), jp.TimeGrid.until(6.0, 0.03)
    state = jp.LimitState(scenarios, grid, threshold=0.09)
    plain = state.values(np.random.default_rng(0).normal(size=(4096, scenarios.dimension)))
    share = float((plain >= 0).mean())
    assert 5e-3 < share < 0.04
    allowed = 3 * np.hypot(answers["cov"], ((1 - share) / share / plain.size) ** 0.5)
    assert answers["probability"] == pytest.approx(share, rel=allowed)
    assert answers["random_numbers"] == 121
    assert "Rare event: required gap of 0.09 m or more" in screen
    # The motion that is written closes the gap by no less, at its instant.
    z = answers["design_earthquakes"]
    assert z[0]["reliability_index"] == min(x["reliability_index"] for x in z)
    record = jp.read_record(folder / "out" / "design_earthquake.csv", units="g")
    at = round(z[0]["time_s"] / 0.03)
    *_, closing = observed_at("length", pair, record, grid, jp.Scheme(), at)
    assert float(closing) == pytest.approx(0.09, rel=0.02)
    out = folder / "out"
    figures = {"design_earthquake.png", "probability.png"}
    told = {"summary.json", "summary.md", "curve.csv", "design_earthquake.csv"}
    assert {path.name for path in out.iterdir()} == figures | told
    assert all(imread(out / name).shape[1] == 1062 for name in figures)
    rows = csv_rows(out / "curve.csv")
    assert [float(row["threshold"]) for row in rows] == pytest.approx([0.07, 0.09])
    assert float(rows[0]["probability"]) > float(rows[1]["probability"])
    assert float(rows[1]["probability"]) == answers["probability"]
    _, of_curve, of_design = tables((out / "summary.md").read_text())
    for row, written in zip(of_curve, rows, strict=True):
        assert number(row["probability"]) == pytest.approx(float(written["probability"]), rel=1e-3)
    assert len(of_design) == len(answers["design"]["steps"])
    design = answers["design"]
    first, last = design["steps"][0], design["steps"][-1]
    parameter = design["parameter"], design["unit"], design["before"]
    assert parameter == ("link.1.friction_force", "N", 200e3)
    assert first["value"] == pytest.approx(200e3)
    assert last["value"] == design["value"]
    assert last["probability"] == pytest.approx(0.01, rel=0.3)
    # More friction, fewer poundings: the slope is that between the steps.
    slope = np.log(last["probability"] / first["probability"]) / (last["value"] - first["value"])
    assert slope < 0
    assert first["slope_of_ln_probability"] == pytest.approx(slope, rel=0.5)


@pytest.mark.usefixtures("without_pictures")
def test_a_stopped_search_goes_on(done, monkeypatch):
    _, arguments, folder = done
    files = [folder / "out" / name for name in ("curve.csv", "summary.json")]
    before = [path.read_text() for path in files]
    monkeypatch.setattr(jp.LimitState, "gradients", None)  # from the files alone
    monkeypatch.setattr(jp.LimitState, "values_and_times", None)
    run(*arguments)
    assert [path.read_text() for path in files] == before


def posed(text):
    file = reading.File("rare.toml", text)
    given = file.read(rare.RareConfig)
    return file, given, rare.limit_state(file, given)


def test_other_earthquakes_and_uncertain_buildings():
    plateau = "envelope = {rise = 1.0, end = 4.0, decay = 1.0}"
    random = "acceleration = {lognormal = [0.08, 0.4]}"
    uncertain = "\n[uncertain]\nfriction = {lognormal = [1.0, 0.2]}\n"
    *_, state = posed(changed(EXAMPLE, f"{SHORT} & {plateau} & {random}") + uncertain)
    names = state.scenarios.parameters(jnp.zeros(state.dimension))
    assert state.dimension == 123  # 121 samples, their intensity, the friction
    assert {"links.0.friction", "intensity", "noise_121"} <= {*names}
    head, tail = EXAMPLE.split("[earthquakes]", 1)
    wavelets = re.sub("(?m)^# ", "", re.search(r"(?s)# \[earthquakes\]\n(.*?)\n\n", tail)[1])
    run_of = tail[tail.index("# Uncertain") :].replace("# duration =", "duration =")
    *_, state = posed(f"{head}[earthquakes]\n{wavelets}\n\n{run_of}")
    assert (state.dimension, state.scenarios.discrete) == (36, ())


@pytest.mark.usefixtures("without_pictures")
def test_a_stopped_subset_simulation_without_a_store_goes_on(tmp_path, monkeypatch):
    path, out = tmp_path / "rare.toml", tmp_path / "out"
    path.write_text(changed(EXAMPLE, SUBSET))
    options = {"command": "rare", "config": path, "out": out, "store": None}
    args = argparse.Namespace(**options, strict=False, pdf=False)
    assert stopped(monkeypatch, 2, lambda: rare.run(args)) == 2 * 2000
    (kept,) = out.iterdir()
    assert len([*kept.rglob("chunk-*.npz")]) == 2
    said = cli.describe_kept(args)
    assert said.startswith(f"finished runs are kept in {kept}, and the same command")
    sizes, values = [], jp.LimitState.values
    counting = lambda state, z: sizes.append(len(z)) or values(state, z)  # noqa: E731
    monkeypatch.setattr(jp.LimitState, "values", counting)
    run("rare", path, "--out", out)
    assert sum(sizes) + 2 * 2000 == summary(out)["runs"]
    assert "subset simulation" in summary(out)["method"]
    assert not kept.exists()


INITIAL_GAP = "[uncertain] ; initial_gap = {lognormal = [1.0, 0.1]}"


@pytest.mark.parametrize(
    ("changes", "searches"), [("", 3), ("gap -> gap = 0.21", 4), (INITIAL_GAP, 4)]
)
def test_pounding_is_the_closing_of_the_gap(changes, searches, monkeypatch):
    """The example's last threshold is its gap at rest: their event is searched for once."""
    states = []

    def searched(state, **options):
        states.append(state)
        return SimpleNamespace(design_points=(), limit_state=state)

    monkeypatch.setattr(jp, "rare_event", searched)
    file, given, state = posed(changed(EXAMPLE, changes))
    found = rare.searched(file, given, state)
    assert len(states) == searches
    assert (found.event is [*found.curve.values()][-1]) == (searches == 3)
    assert given.event == "pounding"


def test_a_row_and_another_demand():
    *_, state = posed(ROW)
    assert state.threshold == 0.04
    soil = jp.ground.CloughPenzien(5 * np.pi, 0.6, high_pass=np.pi / 2)
    how = {"envelope": jp.ground.PlateauEnvelope(rise=2.0, end=6.0, decay=0.8), "intensity": 0.1}
    noise = jp.FilteredNoise(soil, samples=501, dt=0.02, time_unit="s", **how)
    z = jnp.sin(jnp.arange(501.0))
    drawn = state.scenarios.realize(z)[1]
    assert drawn.samples == pytest.approx(noise.draw(z).samples)
    assert float(drawn.dt) == pytest.approx(0.02)
    assert len(state.series) == 10  # the drifts of five storeys, to both sides


WAVELETS = "wavelets = 2\namplitude = {uniform = [0.01, 0.04]}\nperiods = {uniform = [0.5, 1.5]}\n"
WAVELETS += "arrivals = {uniform = [1.0, 4.0]}\n\n"


def test_a_design_by_earthquakes_with_jumps_is_refused_before(tmp_path, capsys):
    head, tail = EXAMPLE.split("[earthquakes]\n", 1)
    wanted = '[design]\nparameter = "friction"\nprobability = 1e-3\n'
    tail = tail[tail.index("[limit]\n") :].replace("# duration = 12.0", "duration = 6.0")
    path = tmp_path / "refused.toml"
    path.write_text(f"{head}[earthquakes]\n{WAVELETS}{wanted}{tail}")
    line = refusal(capsys, "rare", path, "--out", tmp_path / "nothing")
    assert "[design] scenarios: sign_1, sign_2 must not be discrete" in line
    assert "wavelets have no jumps with negative = 0" in line
