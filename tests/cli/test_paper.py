"""``jaxpound paper``: its numbers are the API's, beside the reference's."""

import re
from pathlib import Path

import numpy as np
import pytest

import jaxpound as jp
from jaxpound.cli import paper
from tests.cli.commands import run
from tests.cli.written import is_figure
from tests.reference import load

CASE = jp.paper.structures(), jp.paper.ground(), jp.paper.grid()
PHASES = {0: "stick", 1: "slip right", -1: "slip left"}


@pytest.fixture(scope="module")
def paper_run(tmp_path_factory) -> tuple[str, Path]:
    out = tmp_path_factory.mktemp("paper") / "new" / "folder"
    return run("paper", "--out", out), out


def row(screen: str, name: str) -> list[float]:
    (line,) = (line for line in screen.splitlines() if line.strip().startswith(name))
    return [float(cell) for cell in line.split(name)[1].split() if cell != "-"]


def test_reference_values_are_the_oracle_s():
    oracle, reference = load("paper_case"), jp.paper.reference()
    assert oracle["min_gap"] == reference.min_gap_change
    assert oracle["t_min"] == reference.min_gap_time
    changes = [(time, PHASES[phase]) for time, phase in oracle["events"]]
    assert changes == list(reference.phase_changes)
    paths = ("friction", "rod_1.tau_x", "rod_1.tau_f", "rod_2.tau_x", "rod_2.tau_f")
    paths += ("rod_1.order", "rod_2.order", "stiffness_ratio", "mass_ratio")
    keys = ("mu", "txa", "tfa", "txb", "tfb", "al", "be", "eps", "rho")
    slopes = {path: oracle["grad_min_gap"][key] for path, key in zip(paths, keys, strict=True)}
    assert slopes == reference.gradient


def test_paper_table_has_the_api_s_numbers_every_phase_change_and_the_paper_s_scheme(paper_run):
    screen, _ = paper_run
    response, known = jp.simulate(*CASE), jp.paper.reference()
    value, reference, difference = row(screen, "min of x2 - x1")
    assert row(screen, "smallest gap = 1 at rest + min")[0] == pytest.approx(1 + value)
    assert value == pytest.approx(float(response.min_gap) - 1, abs=1e-8)
    assert reference == pytest.approx(known.min_gap_change, abs=1e-8)
    assert difference == pytest.approx(value - reference, abs=1e-7)
    assert abs(difference) < 1e-5
    times = [float(response.demand.min_gap_time), known.min_gap_time]
    assert row(screen, "at t")[:2] == pytest.approx(times, abs=1e-8)
    assert row(screen, "phase changes") == [11, 11, 0]
    energy = response.energy
    residual = np.abs(energy.residual).max() / np.abs(energy.input).max()
    assert row(screen, "energy residual / input") == pytest.approx([residual], abs=1e-8)
    assert residual < 1e-4

    printed = re.findall(r"(?m)^  (\S.*) from t +(\S+) +(\S+) +(\S+)$", screen)
    assert len(printed) == 11
    changes = zip(printed, response.phases()[1:], known.phase_changes, strict=True)
    for (name, *numbers), phase, (time, kind) in changes:
        assert name == phase.kind == kind
        start, reference, difference = map(float, numbers)
        assert start == pytest.approx(phase.start, abs=1e-8)
        assert reference == pytest.approx(time, abs=1e-8)
        assert abs(difference) < 1e-4
    value, reference, difference = row(paper_run[0], "min by the paper's scheme")
    demand = jp.demand(*CASE, jp.Scheme(jp.simulation.Switching(), order=1, start="paper"))
    assert value == pytest.approx(float(demand.min_gap) - 1, abs=1e-6)
    assert difference == pytest.approx(paper.PAPER_SCHEME_ERROR, rel=0.02)
    assert value - reference == pytest.approx(difference, rel=0.02)


def test_paper_prints_its_six_figures_and_a_dash_for_a_phase_too_many_or_few(paper_run):
    screen, out = paper_run
    shown = ("ground_motion", "displacements", "velocities", "gap", "friction_force", "rod_forces")
    names = [f"{name}.png" for name in shown]
    assert {path.name for path in out.iterdir()} == {*names, "overview.png"}
    assert screen.splitlines()[-7:] == [str(out / name) for name in ("overview.png", *names)]
    assert all(is_figure(path) for path in out.iterdir())
    assert paper.row("stick from t", None, 1.5) == ("stick from t", "-", "1.50000000", "-")
    assert paper.row("stick from t", 1.5, None) == ("stick from t", "1.50000000", "-", "-")
