"""``jaxpound rare``: its configuration, its run, and what it writes."""

import argparse
import csv
import json
import re
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.image import imread

import jaxpound as jp
from jaxpound.cli import main as cli
from jaxpound.cli import rare
from jaxpound.cli.files import example
from jaxpound.cli.reading import File
from tests.cli.commands import edited, number, refusal, run, tables

EXAMPLE, ROW = example("rare"), example("rare", "row")
SHORT = {
    "frequency": "frequency = 1.0",
    "duration": "duration = 6.0",
    "# gap =": "gap = 0.09",
    "thresholds": "thresholds = [0.07, 0.09]",
    "cov": "cov = 0.2",
    "# dt = 0.01": "dt = 0.03",
}
DESIGN = """
[design]
parameter = "friction"
probability = 0.01
tolerance = 0.3
"""


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """The command's screen, its configuration and its folders."""
    folder = tmp_path_factory.mktemp("rare")
    path = folder / "rare.toml"
    path.write_text(edited(EXAMPLE, SHORT) + DESIGN)
    arguments = ["rare", path, "--out", folder / "out", "--store", folder / "store"]
    return run(*arguments), arguments, folder


@pytest.fixture(scope="module")
def by_hand():
    """The same scenarios from the library, in units of the dimensionless system."""
    left = jp.Building.from_period(mass=500e3, period=0.9, damping_ratio=0.05)
    right = jp.Building.from_period(mass=400e3, period=0.6, damping_ratio=0.05)
    pair, scales = jp.dimensionless(left, right, friction_force=200e3, gap=0.2)
    second = float(scales.frequency)
    noise = jp.FilteredNoise(
        jp.KanaiTajimi(2 * np.pi / second, 0.6),
        samples=121,
        dt=0.05 * second,
        envelope=jp.GammaEnvelope(3.0 * second, 2.0),
        intensity=0.08,
    )
    return jp.Scenarios(pair, noise), scales.grid(6.0, 0.025), scales


def test_the_probability_is_that_of_plain_runs(done, by_hand):
    screen, _, folder = done
    answers = json.loads((folder / "out" / "summary.json").read_text())
    scenarios, grid, scales = by_hand
    state = jp.LimitState(scenarios, grid, threshold=0.09 / float(scales.length))
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
    pair, _ = scenarios.realize(jnp.zeros(scenarios.dimension))
    response = scales.to_si(jp.simulate(pair, scales.to_dimensionless(record), grid))
    closing = 0.2 - np.asarray(response.links[0].gap)
    at = np.argmin(np.abs(np.asarray(response.time) - z[0]["time_s"]))
    assert closing[at] == pytest.approx(0.09, rel=0.02)


def test_what_is_written(done):
    _, _, folder = done
    out = folder / "out"
    figures = {"design_earthquake.png", "probability.png"}
    told = {"summary.json", "summary.md", "curve.csv", "design_earthquake.csv"}
    assert {path.name for path in out.iterdir()} == figures | told
    assert all(imread(out / name).shape[1] == 1062 for name in figures)
    answers = json.loads((out / "summary.json").read_text())
    with (out / "curve.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["threshold"]) for row in rows] == pytest.approx([0.07, 0.09])
    assert float(rows[0]["probability"]) > float(rows[1]["probability"])
    assert float(rows[1]["probability"]) == answers["probability"]
    _, of_curve, of_design = tables((out / "summary.md").read_text())
    for row, written in zip(of_curve, rows, strict=True):
        assert number(row["probability"]) == pytest.approx(float(written["probability"]), rel=1e-3)
    assert len(of_design) == len(answers["design"]["steps"])


def test_the_parameter_is_told_in_newtons(done):
    _, _, folder = done
    design = json.loads((folder / "out" / "summary.json").read_text())["design"]
    first, last = design["steps"][0], design["steps"][-1]
    assert (design["parameter"], design["unit"], design["before"]) == ("friction", "N", 200e3)
    assert first["value"] == pytest.approx(200e3)
    assert last["value"] == design["value"]
    assert last["probability"] == pytest.approx(0.01, rel=0.3)
    # More friction, fewer poundings: the slope is that between the steps.
    slope = np.log(last["probability"] / first["probability"]) / (last["value"] - first["value"])
    assert slope < 0
    assert first["slope_of_ln_probability"] == pytest.approx(slope, rel=0.5)


def test_a_stopped_search_goes_on(done, monkeypatch):
    _, arguments, folder = done
    before = [(folder / "out" / name).read_text() for name in ("curve.csv", "summary.json")]
    with monkeypatch.context() as patch:
        patch.setattr(jp.LimitState, "gradients", None)  # from the files alone
        patch.setattr(jp.LimitState, "values_and_times", None)
        run(*arguments)
    after = [(folder / "out" / name).read_text() for name in ("curve.csv", "summary.json")]
    assert after == before


def test_other_earthquakes_and_uncertain_buildings():
    def state(text):
        file = File("rare.toml", text)
        return rare.limit_state(file, file.read(rare.RareConfig))

    plateau = {"envelope": "envelope = {rise = 1.0, end = 4.0, decay = 1.0}"}
    random = {"acceleration": "acceleration = {lognormal = [0.08, 0.4]}"}
    uncertain = "\n[uncertain]\nfriction = {lognormal = [1.0, 0.2]}\n"
    found = state(edited(EXAMPLE, SHORT | plateau | random) + uncertain)
    names = found.scenarios.parameters(jnp.zeros(found.dimension))
    assert found.dimension == 123  # 121 samples, their intensity, the friction
    assert {"friction", "intensity", "noise_121"} <= {*names}
    head, tail = EXAMPLE.split("[earthquakes]", 1)
    wavelets = re.sub("(?m)^# ", "", re.search(r"(?s)# \[earthquakes\]\n(.*?)\n\n", tail)[1])
    run_of = tail[tail.index("# Uncertain") :].replace("# duration =", "duration =")
    found = state(f"{head}[earthquakes]\n{wavelets}\n\n{run_of}")
    assert (found.dimension, found.scenarios.discrete) == (36, ())


def test_a_stopped_subset_simulation_goes_on(tmp_path, monkeypatch):
    path, store = tmp_path / "rare.toml", tmp_path / "store"
    subset = {"method": 'method = "subset"', "# gap =": "gap = 0.07", "thresholds": ""}
    path.write_text(edited(EXAMPLE, SHORT | subset))
    made, values = [], jp.LimitState.values

    def run_once(most):
        """The summary after a run that is interrupted after so many batches."""

        def counted(self, z):
            if len(made) == most:
                raise KeyboardInterrupt
            made.append(len(z))
            return values(self, z)

        made.clear()
        with monkeypatch.context() as patch:
            patch.setattr(jp.LimitState, "values", counted)
            run("rare", path, "--out", tmp_path / "out", "--store", store)
        return json.loads((tmp_path / "out" / "summary.json").read_text())

    with pytest.raises(KeyboardInterrupt):
        run_once(3)
    assert len([*store.rglob("chunk-*.npz")]) == 3
    told = run_once(None)
    assert sum(made) + 3 * 2000 == told["runs"] >= 20_000
    assert run_once(0) == told
    assert "subset simulation" in told["method"]


def test_a_search_without_a_store_goes_on_too(tmp_path, monkeypatch):
    path, out = tmp_path / "rare.toml", tmp_path / "out"
    subset = {"method": 'method = "subset"', "# gap =": "gap = 0.07", "thresholds": ""}
    path.write_text(edited(EXAMPLE, SHORT | subset | {"cov": "cov = 0.9"}))
    args = argparse.Namespace(command="rare", config=path, out=out, store=None)
    args = argparse.Namespace(**vars(args), strict=False, pdf=False)
    made, values = [], jp.LimitState.values

    def stopping(self, z):
        if len(made) == 2:
            raise KeyboardInterrupt
        made.append(len(z))
        return values(self, z)

    with monkeypatch.context() as patch:
        patch.setattr(jp.LimitState, "values", stopping)
        with pytest.raises(KeyboardInterrupt):
            rare.run(args)
    (kept,) = out.iterdir()
    assert cli.describe_kept(args).startswith(
        f"finished runs are kept in {kept}, and the same command"
    )
    made.clear()

    def counted(self, z):
        made.append(len(z))
        return values(self, z)

    with monkeypatch.context() as patch:
        patch.setattr(jp.LimitState, "values", counted)
        run("rare", path, "--out", out)
    assert sum(made) + 2 * 2000 == json.loads((out / "summary.json").read_text())["runs"]
    assert not kept.exists()


@pytest.mark.parametrize(
    ("changes", "searches"),
    [
        ({}, 3),
        ({"gap": "gap = 0.21"}, 4),
        ({"# [uncertain]": "[uncertain]\ninitial_gap = {lognormal = [1.0, 0.1]}"}, 4),
    ],
)
def test_pounding_is_the_closing_of_the_gap(changes, searches, monkeypatch):
    """The example's last threshold is its gap at rest: their event is searched for once."""
    states = []

    def searched(state, **options):
        states.append(state)
        return SimpleNamespace(design_points=(), limit_state=state)

    monkeypatch.setattr(rare, "event_of", searched)
    file = File("rare.toml", edited(EXAMPLE, changes))
    given = file.read(rare.RareConfig)
    found = rare.searched(file, given, rare.limit_state(file, given))
    assert len(states) == searches
    assert (found.event is [*found.curve.values()][-1]) == (searches == 3)
    assert str(given.limit) == "pounding"


def test_a_row_and_another_demand():
    file = File("rare.toml", ROW)
    given = file.read(rare.RareConfig)
    state = rare.limit_state(file, given)
    assert state.threshold * float(given.scales.length) == pytest.approx(0.04)
    noise = jp.FilteredNoise(
        jp.CloughPenzien(5 * np.pi, 0.6, high_pass=np.pi / 2),
        samples=501,
        dt=0.02,
        envelope=jp.PlateauEnvelope(rise=2.0, end=6.0, decay=0.8),
        intensity=0.1,
        time_unit="s",
    )
    z = jnp.sin(jnp.arange(501.0))
    drawn = state.scenarios.realize(z)[1]
    assert drawn.samples == pytest.approx(noise.draw(z).samples)
    assert float(drawn.dt * given.scales.time) == pytest.approx(0.02)
    assert len(state.series) == 10  # the drifts of five storeys, to both sides


WAVELETS = """wavelets = 2
amplitude = {uniform = [0.01, 0.04]}
periods = {uniform = [0.5, 1.5]}
arrivals = {uniform = [1.0, 4.0]}

"""


def test_a_design_by_earthquakes_with_jumps_is_refused_before_the_search(tmp_path, capsys):
    head, tail = EXAMPLE.split("[earthquakes]\n", 1)
    wanted = '[design]\nparameter = "friction"\nprobability = 1e-3\n'
    tail = tail[tail.index("[limit]\n") :].replace("# duration = 12.0", "duration = 6.0")
    path = tmp_path / "jumps.toml"
    path.write_text(f"{head}[earthquakes]\n{WAVELETS}{wanted}{tail}")
    told = refusal(capsys, "rare", path, "--out", tmp_path / "nothing")
    assert "[design] scenarios: sign_1, sign_2 must not be discrete" in told
    assert "wavelets have no jumps with negative = 0" in told
    assert not (tmp_path / "nothing").exists()


def test_implausible_earthquakes_are_refused_if_strict(tmp_path, capsys):
    path = tmp_path / "strong.toml"
    path.write_text(edited(EXAMPLE, {"acceleration": "acceleration = 8.0"}))  # of m/s², say
    told = refusal(capsys, "rare", path, "--strict", "--out", tmp_path / "nothing")
    assert "ground: PGA of 100% of the 64 earthquakes looked at, up to" in told
    assert not (tmp_path / "nothing").exists()
