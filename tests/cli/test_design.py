"""The command line's design: configuration, run, what is written, and errors with their place."""

import argparse
import re
from types import SimpleNamespace

import numpy as np
import pytest

import jaxpound as jp
from jaxpound._tables import rounded
from jaxpound.cli import design, files, main, parameters, reading, simulate
from jaxpound.design import search
from jaxpound.design.search import Descent
from jaxpound.model.parameters import get
from jaxpound.results.named import in_words
from tests.cli.commands import run
from tests.cli.written import is_figure, number, page_of, summary, tables

EXAMPLE = files.example("design").replace('# "rod_', '"rod_')
SMALL = "earthquakes = 12 & fresh = 16 & starts = 2 & iterations = 8 & duration = 6.0"
SMALL += " & # dt -> dt = 0.02"


def read(path, records=()):
    file = reading.File.opened(path, "design")
    given = file.read(design.DesignConfig)
    return given, *design.prepared(file, given, records)


def test_the_example_and_goals_in_words_of_the_library(write):
    given, wanted, _ = read(None)
    assert wanted.space.names == ("links.0.friction",)
    assert wanted.space.variables["links.0.friction"] == jp.design.Bounds(0.0, 5 * 200e3)
    limits = {"peak_f1": jp.design.Limit(1.9e6, "mean"), "damper_force": jp.design.Limit(800e3)}
    assert wanted.objective == jp.Objective(limits=limits)
    assert (len(wanted.ensemble), given.search.fresh) == (256, 1000)
    search = given.search.model()
    assert (search.starts, search.iterations, search.key, search.batch) == (4, 100, 0, None)
    least = '"least demand" & demand = "peak_x1" & # over -> over = 0.1'
    for changes, goal in (
        ('"worst gap"', jp.SmallestGap("worst")),
        ('"CVaR" & share = 0.2', jp.SmallestGap(0.2)),
        ('"soft minimum" & temperature = 0.02', jp.design.SoftMinimum(0.02)),
        ('"pounding probability"', jp.PoundingProbability()),
        (least, jp.design.LeastDemand("peak_x1", 0.1)),
    ):
        assert read(write(f"{SMALL} & goal = {changes}"))[1].objective.goal == goal


class StoppedError(BaseException):
    """As an interrupt, of this test."""


def test_a_stopped_design_goes_on_and_is_written(write, tmp_path, monkeypatch):
    """Without --save, and before twenty iterations: those of a row may take minutes."""
    record = shake(tmp_path / "shake.csv", 300)
    path, out = write(SMALL), tmp_path / "out"

    def stop_at_once(*_, **__):
        raise StoppedError

    done, report = [], Descent._report

    def stopping_report(self, history, bar):
        done.append(len(history))
        if len(done) == 3:
            raise StoppedError
        return report(self, history, bar)

    monkeypatch.setattr(Descent, "_report", stopping_report)
    monkeypatch.setattr(search, "_SAVE_AFTER", 0.0)
    options = {"command": "design", "record": [record], "out": out, "strict": False, "pdf": False}
    args = argparse.Namespace(config=path, save=None, **options)
    with pytest.raises(StoppedError):
        design.run(args)
    assert "the search is kept in" in main.describe_kept(args)
    (unfinished,) = out.iterdir()
    other = tmp_path / "other.toml"  # another configuration has a search of its own
    other.write_text(path.read_text() + "\n# edited\n")
    with monkeypatch.context() as patch:
        patch.setattr(jp, "design_damper", stop_at_once)
        with pytest.raises(StoppedError):
            design.run(argparse.Namespace(config=other, save=None, **options))
    (of_other,) = {*out.iterdir()} - {unfinished}
    done[:] = [1, 2, 3]
    printed = run("design", path, "--record", record, "--out", out)
    assert done == [*range(1, 4), *range(4, 9)]
    assert not unfinished.exists()

    assert "trained on 13 earthquakes (SI)" in printed
    assert "fresh: 16 earthquakes (SI)" in printed
    assert re.search(r"(?m)^slip force, 1–2, floor 1 +N +200,000 +8\d\d,\d00 ", printed)
    assert all(words in printed for words in OF_RODS)
    written = [line for line in printed.splitlines() if line.startswith(str(out))]
    assert sorted(str(x) for x in out.iterdir() if x != of_other) == sorted(written)
    assert (out / "design.toml").read_text() == path.read_text()
    answers = summary(out)
    assert answers["iterations"] == 8
    force = answers["limits"]["damper_force"]
    assert force["reached"] <= 800e3 * 1.001
    buildings = reading.File.opened(out / "buildings.toml", "simulate").read(simulate.Simulation)
    nominal = read(path)[1].space.nominal
    for name, row in answers["variables"].items():
        assert float(get(buildings.buildings, name)) == pytest.approx(row["after"])
        assert float(get(nominal, name)) == pytest.approx(row["before"])
    for one, other in zip(buildings.layout.shear_buildings, nominal.buildings, strict=True):
        assert one.storeys[0].mass == other.storeys[0].mass
    (link,) = buildings.buildings.links
    assert float(link.friction) == pytest.approx(force["reached"], rel=2e-3)
    assert_page_says(page_of(out), answers, nominal, buildings.buildings)
    assert is_figure(out / "convergence.png")


OF_RODS = [f"building {b}, storey 1, {x}" for x in ("tau f", "tau x") for b in (1, 2)]


def assert_page_says(page, answers, before, after):
    """Every number of the page stands under the name of its column."""
    answer, variables, limits, trained, fresh, (recorded,) = tables(page)
    expected = {"slip force, 1–2, floor 1": ("N", *(x.links[0].friction for x in (before, after)))}
    for i in (1, 2):
        storeys = [x.buildings[i - 1].storeys[0] for x in (before, after)]
        periods = [storey.natural_period for storey in storeys]
        expected[f"natural period of building {i}"] = "s", *periods
        for key in ("tau_f", "tau_x"):
            words = f"building {i}, storey 1, {key.replace('_', ' ')}"
            expected[words] = "s^order", *(getattr(storey, key) for storey in storeys)
        # Of free vibration: near that of steady vibration, where they are small.
        (ratio,) = (x for x in answer if x["quantity"].endswith(f"first mode of building {i}"))
        small, large = (100 * float(storey.damping_ratio) for storey in storeys)
        assert number(ratio["before"]) == pytest.approx(small, rel=0.03)
        assert number(ratio["after"]) == pytest.approx(large, rel=0.15)
    rows = {row["quantity"]: row for row in answer}
    assert rows.keys() > expected.keys()
    for quantity, (unit, old, new) in expected.items():
        row = rows[quantity]
        assert row["unit"] == unit
        assert row["before"] == rounded(float(old))
        assert number(row["after"]) == pytest.approx(float(new), rel=1e-3)
        change = pytest.approx(float(new - old), rel=1e-2, abs=1e-3 * abs(float(new)))
        assert number(row["change"]) == change
    assert [row["variable (SI)"] for row in variables] == [*answers["variables"]]
    for row in variables:
        of_variable = answers["variables"][row["variable (SI)"]]
        assert number(row["after"]) == pytest.approx(of_variable["after"], rel=1e-3)
    assert [row["unit"] for row in limits] == ["N", "N"]
    for key, rows in (("trained", trained), ("fresh", fresh)):
        by_words = {in_words(name): x for name, x in answers[key]["demands"].items()}
        assert len(rows) == len(by_words)
        for row in rows:
            demand = by_words[row[""]]
            assert row["unit"] == demand["unit"] != ""
            for when in ("before", "after"):
                mean, tail = demand[f"mean_{when}"], demand[f"tail_{when}"]
                assert number(row[f"mean {when}"]) == pytest.approx(mean, rel=1e-3)
                assert number(row[f"quantile {when}"]) == pytest.approx(tail, rel=1e-3)
    assert recorded["recorded earthquake"] == "shake"
    assert recorded["smallest gap after"] == rounded(answers["recorded"]["shake"]["min_gap_after"])


WITH_CONTACT = """[contact] ; law = 'kelvin-voigt' ; restitution = 0.65 ; stiffness = 8e8
    & friction = { -> "contact.stiffness" = {low = 0.5, high = 2.0, scale = "log"}
    & "rod_1.tau_x" -> initial_gap = {low = 0.2, high = 3.0} & goal = "gap at rest"
    & peak_f1 -> peak_contact = {at_most = 2e7, over = "mean"}
    & damper_force -> peak_impulse = 1e6 ; contact_work = {at_most = 2e5, over = 0.1}
    & [penalties] ; soft_peak_contact = {weight = 1e-6, over = "mean"}"""


def test_a_design_with_contact(write):
    """A pad between the buildings: its stiffness is chosen, within limits on contact."""
    given, wanted, _ = read(write(f"{SMALL} & {WITH_CONTACT}"))
    space, objective = wanted.space, wanted.objective
    assert float(space.nominal.links[0].contact.stiffness) == 8e8
    assert space.variables["links.0.contact.stiffness"] == jp.design.Bounds(4e8, 16e8, "log")
    limits = {"peak_contact": jp.design.Limit(2e7, "mean"), "peak_impulse": jp.design.Limit(1e6)}
    assert objective.limits == limits | {"contact_work": jp.design.Limit(2e5, 0.1)}
    assert objective.goal == jp.design.GapAtRest()
    rest = space.nominal.links[0].gap
    assert (float(rest), space.variables["links.0.gap"]) == (
        0.10,
        jp.design.Bounds(0.2 * rest, 3 * rest),
    )
    assert objective.penalties == {"soft_peak_contact": jp.design.Penalty(1e-6, "mean")}
    shares = space.shares(space.nominal)
    shares[space.names.index("links.0.contact.stiffness")] = 0.0
    shares[space.names.index("links.0.gap")] = 1.0
    start, after = space.values(space.shares(space.nominal)), space.values(shares)
    found = SimpleNamespace(structures=space.structures(shares), space=space, active_bounds={})
    found.start, found.values = ({x: float(y) for x, y in z.items()} for z in (start, after))
    rows = design.answer_of(found, parameters.Parameters(given.layout))
    answer = {row["quantity"]: row for row in rows}
    row, gap = answer["contact stiffness, 1–2, floor 1"], answer["gap at rest, 1–2, floor 1"]
    assert row["unit"] == "N/m"
    assert (row["before"], row["after"]) == (pytest.approx(8e8), pytest.approx(4e8))
    assert gap["unit"] == "m"
    assert (gap["before"], gap["after"]) == (pytest.approx(0.10), pytest.approx(0.30))


IN_NOISE = """fresh = 0 & wavelets -> filter = "kanai-tajimi" ; frequency = 1.5 ; damping = 0.6 ;
    acceleration = 0.08 ; duration = 6.0 ; dt = 0.05 ; envelope = {peak = 3.0, power = 2.0}
    & amplitude -> nothing & periods -> nothing & arrivals -> nothing & negative -> nothing
    & peak_f1 -> required_gap = {at_most = 0.05, probability = 0.01} & damper_force -> nothing
    & "rod_1.tau_x" -> nothing & "rod_1.tau_f" -> nothing & "rod_2.tau_x" -> nothing
    & "rod_2.tau_f" -> nothing & goal = "least demand" & demand = "damper_force" & starts = 1"""


@pytest.mark.usefixtures("without_pictures")
def test_a_limit_on_the_probability_of_pounding(write, tmp_path):
    small = SMALL.replace("dt = 0.02", "dt = 0.03")
    path, out = write(f"{small} & {IN_NOISE}"), tmp_path / "out"
    printed = run("design", path, "--out", out)
    limit = summary(out)["limits"]["required_gap"]
    assert limit["probability"] == 0.01
    assert 0 < limit["reached"] <= 0.011
    assert limit["cov"] <= 0.034
    assert "P(required_gap >= " in printed
    assert "P(required_gap >= 0.05)" in (out / "summary.md").read_text()


def shake(path, n):
    t = 0.02 * np.arange(n)
    np.savetxt(path, np.column_stack([t, 0.2 * np.sin(3 * np.pi * t)]), delimiter=",")
    return path


def test_records_join_the_random_earthquakes(write, tmp_path):
    (tmp_path / "more").mkdir()
    a, b, other = (shake(tmp_path / f"{name}.csv", 100) for name in ("a", "b", "more/a"))
    table = '[variables] -> [recorded] ; files = ["a.csv"] ; units = "m/s2" ; [variables]'
    path = write(f"{SMALL} & {table}")
    _, wanted, recorded = read(path, [b])
    assert (len(wanted.ensemble), list(recorded)) == (14, ["a", "b"])
    peaks = [np.abs(recorded[x].ground(0).samples).max() for x in "ab"]
    assert peaks[1] == pytest.approx(9.80665 * peaks[0])
    assert len(wanted.ensemble.fresh(5)) == 5
    a.write_text("time (s), acc (m/s2)\n" + a.read_text())
    path = write(f"{SMALL} & {table}".replace('units = "m/s2" ; ', ""))
    stated = read(path)[2]["a"].ground(0).samples
    np.testing.assert_array_equal(stated, recorded["a"].ground(0).samples)
    with pytest.raises(ValueError, match="records: name = 'a' must be that of one record only"):
        read(path, [other])
