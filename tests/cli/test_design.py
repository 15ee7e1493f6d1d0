"""The command line's design: configuration, run, what is written, and errors with their place."""

import argparse
import re
from types import SimpleNamespace

import numpy as np
import pytest

import jaxpound as jp
from jaxpound._tables import rounded
from jaxpound.cli import design, design_report, files, main, parameters, reading, simulate
from jaxpound.design import search
from jaxpound.design.search import Descent
from jaxpound.results.named import in_words
from tests.cli.commands import run
from tests.cli.written import is_figure, number, page_of, summary, tables

EXAMPLE = files.example("design").replace('# "rod_', '"rod_')
SMALL = "earthquakes = 12 & fresh = 16 & starts = 2 & iterations = 8 & duration = 6.0"
SMALL += " & # dt -> dt = 0.02"


def read(path, records=()):
    file = reading.File.opened(path, "design")
    given = file.read(design.DesignConfig)
    return given, design.prepared(file, given, records)


def test_the_example_and_goals_in_words_of_the_library(write):
    given, wanted = read(None)
    assert wanted.space.names == ("friction",)
    nominal = wanted.space.nominal
    assert wanted.space.variables["friction"].high == pytest.approx(5 * nominal.friction)
    limits = {"peak_f1": jp.Limit(1.9e6, "mean"), "damper_force": jp.Limit(800e3)}
    assert wanted.objective == jp.Objective(limits=limits)
    assert (len(wanted.ensemble), given.search.fresh) == (256, 1000)
    assert given.search.options() == {"starts": 4, "iterations": 100, "key": 0}
    least = '"least demand" & demand = "peak_x1" & # over -> over = 0.1'
    for changes, goal in (
        ('"worst gap"', jp.WorstGap()),
        ('"CVaR" & share = 0.2', jp.CVaR(0.2)),
        ('"soft minimum" & temperature = 0.02', jp.SoftMinimum(0.02)),
        ('"pounding probability"', jp.PoundingProbability()),
        (least, jp.LeastDemand("peak_x1", 0.1)),
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
    assert re.search(r"(?m)^slip force of the damper +N +200,000 +8\d\d,\d00 ", printed)
    assert printed.index("slip force of the damper") < printed.index("rod_1.tau_x")
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
        rod, _, field = name.rpartition(".")
        own = getattr(buildings.structures, rod) if rod else buildings.structures
        assert getattr(own, field) == pytest.approx(row["after"])
    assert buildings.structures.mass_ratio == pytest.approx(nominal.mass_ratio)
    slip_force = buildings.structures.friction * buildings.scales.force
    assert slip_force == pytest.approx(force["reached"], rel=2e-3)
    assert_page_says(page_of(out), answers, buildings)
    assert is_figure(out / "convergence.png")


def assert_page_says(page, answers, buildings):
    """Every number of the page stands under the name of its column."""
    answer, rods, limits, *compared, recorded = tables(page)
    nominal, _ = read(None)
    first, second, force, gap = nominal.scales.buildings(nominal.structures)
    expected = [("slip force of the damper", "N", force, buildings.damper.friction_force)]
    expected.append(("gap at rest", "m", gap, buildings.gap))
    models = [side.shear().storeys[0] for side in (buildings.building_1, buildings.building_2)]
    for i, pair in enumerate(zip((first, second), models, strict=True), 1):
        for name, unit, factor in (("natural_period", "s", 1), ("damping_ratio", "%", 100)):
            both = (factor * float(getattr(building, name)) for building in pair)
            expected.append((f"{name.replace('_', ' ')} of building {i}", unit, *both))
    for row, (quantity, unit, before, after) in zip(answer, expected, strict=True):
        assert (row["quantity"], row["unit"]) == (quantity, unit)
        assert row["before"] == rounded(float(before))
        assert number(row["after"]) == pytest.approx(float(after), rel=1e-3)
        change = pytest.approx(float(after - before), rel=1e-2, abs=1e-3 * abs(float(after)))
        assert number(row["change"]) == change
    chosen = {path for path in answers["variables"] if path.startswith("rod_")}
    assert {row["parameter of a rod"] for row in rods} == chosen
    for row in rods:
        rod, _, name = row["parameter of a rod"].partition(".")
        model = models[int(rod[-1]) - 1]
        assert number(row["after"]) == pytest.approx(float(getattr(model, name)), rel=1e-3)
        assert row["unit"] == "s^order"
    assert [row["unit"] for row in limits] == ["N", "N"]
    tails = ("5 % quantile", "95 % quantile") * 2
    for key, tail, rows in zip(["trained"] * 2 + ["fresh"] * 2, tails, compared, strict=True):
        by_words = {in_words(name): x for name, x in answers[key]["demands"].items()}
        for row in rows:
            demand = by_words[row["demand"]]
            assert row["unit"] == demand["unit"] != ""
            for when in ("before", "after"):
                assert row[f"mean {when}"] == rounded(demand[f"mean_{when}"])
                assert row[f"{tail} {when}"] == rounded(demand[f"tail_{when}"])
    (row,) = recorded
    assert row["recorded earthquake"] == "shake"
    assert row["smallest gap after"] == rounded(answers["recorded"]["shake"]["min_gap_after"])


WITH_CONTACT = """[contact] ; law = 'kelvin-voigt' ; restitution = 0.65 ; stiffness = 8e8
    & friction = { -> "contact.stiffness" = {low = 0.5, high = 2.0, scale = "log"}
    & "rod_1.tau_x" -> initial_gap = {low = 0.2, high = 3.0} & goal = "gap at rest"
    & peak_f1 -> peak_contact = {at_most = 2e7, over = "mean"}
    & damper_force -> peak_impulse = 1e6 ; contact_work = {at_most = 2e5, over = 0.1}
    & [penalties] ; soft_peak_contact = {weight = 1e-6, over = "mean"}"""


def test_a_design_with_contact(write):
    """A pad between the buildings: its stiffness is chosen, within limits on contact."""
    given, wanted = read(write(f"{SMALL} & {WITH_CONTACT}"))
    space, objective = wanted.space, wanted.objective
    stiffness = space.nominal.contact.stiffness
    assert float(stiffness * given.scales.units["stiffness"]) == pytest.approx(8e8)
    assert space.variables["contact.stiffness"] == jp.Bounds(0.5 * stiffness, 2 * stiffness, "log")
    limits = {"peak_contact": jp.Limit(2e7, "mean"), "peak_impulse": jp.Limit(1e6)}
    assert objective.limits == limits | {"contact_work": jp.Limit(2e5, 0.1)}
    assert objective.goal == jp.GapAtRest()
    rest = space.nominal.initial_gap
    assert float(rest * given.scales.length) == pytest.approx(0.10)
    assert space.variables["initial_gap"] == jp.Bounds(0.2 * rest, 3 * rest)
    assert objective.penalties == {"soft_peak_contact": jp.Penalty(1e-6, "mean")}
    shares = space.shares(space.nominal)
    shares[space.names.index("contact.stiffness")] = 0.0
    shares[space.names.index("initial_gap")] = 1.0
    found = SimpleNamespace(structures=space.structures(shares), space=space, active_bounds={})
    named = parameters.Parameters(given.layout)
    _, gap, *_, row = design_report._answer(found, space.nominal, named)
    assert (row["quantity"], row["unit"]) == ("contact stiffness", "N/m")
    assert (row["before"], row["after"]) == (pytest.approx(8e8), pytest.approx(4e8))
    assert (gap["quantity"], gap["unit"]) == ("gap at rest", "m")
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
    assert "probability of required gap >= 0.05 m" in (out / "summary.md").read_text()


def shake(path, n):
    t = 0.02 * np.arange(n)
    np.savetxt(path, np.column_stack([t, 0.2 * np.sin(3 * np.pi * t)]), delimiter=",")
    return path


def test_records_join_the_random_earthquakes(write, tmp_path):
    (tmp_path / "more").mkdir()
    a, b, other = (shake(tmp_path / f"{name}.csv", 100) for name in ("a", "b", "more/a"))
    table = '[variables] -> [recorded] ; files = ["a.csv"] ; units = "m/s2" ; [variables]'
    path = write(f"{SMALL} & {table}")
    _, wanted = read(path, [b])
    assert (len(wanted.ensemble), list(wanted.recorded)) == (14, ["a", "b"])
    peaks = [np.abs(wanted.recorded[x].ground(0).samples).max() for x in "ab"]
    assert peaks[1] == pytest.approx(9.80665 * peaks[0])
    assert len(wanted.ensemble.fresh(5)) == 5
    a.write_text("time (s), acc (m/s2)\n" + a.read_text())
    path = write(f"{SMALL} & {table}".replace('units = "m/s2" ; ', ""))
    stated = read(path)[1].recorded["a"].ground(0).samples
    np.testing.assert_array_equal(stated, wanted.recorded["a"].ground(0).samples)
    with pytest.raises(ValueError, match="records: name = 'a' must be that of one record only"):
        read(path, [other])
