"""Small versions of the cases of ``python -m benchmarks.verification``."""

import dataclasses
import math
from functools import partial

import pytest

from benchmarks.verification import jaxonomy_peer, opensees_peer, siconos_peer
from benchmarks.verification.case import Case, Errors, Number
from benchmarks.verification.cases import CASES
from benchmarks.verification.interpreters import interpreter

COARSE = (0.02, 0.01)
SMALL = {
    "rods": partial(CASES["rods"], (0.05, 0.025)),
    "el_centro": partial(CASES["el_centro"], COARSE),
    "den_hartog": partial(CASES["den_hartog"], (0.04, 0.02)),
    "damping": partial(CASES["damping"], COARSE),
    "coulomb_decay": partial(CASES["coulomb_decay"], (0.05, 0.025)),
    "collisions": partial(CASES["collisions"], (0.05,), [("newton",)]),
    "paper_case": partial(CASES["paper_case"], (0.02,), ["default"]),
    "rows": partial(CASES["rows"], (0.01,), ["row3_kelvin"]),
    "columns": partial(CASES["columns"], (0.04, 0.02), 1),
    "corners": partial(CASES["corners"], (0.04, 0.02), 1),
    "supports": partial(CASES["supports"], (0.04, 0.02), 1),
    "soil": partial(CASES["soil"], (0.04, 0.02), (0.0,)),
    "yielding": partial(CASES["yielding"], COARSE, ["one_bilinear"]),
    "energy": partial(CASES["energy"], (0.01,), ["row3_kelvin"]),
    "gradients": partial(CASES["gradients"], (0.04,), contact=False),
    "rare_events": partial(CASES["rare_events"], (0.47,)),
}
"""Rows and energy share the program, and rare events that of other tests."""


@pytest.mark.parametrize("name", SMALL)
def test_errors_and_orders_are_within_their_bounds(name):
    case = SMALL[name]()
    assert not case.skipped
    assert case.errors or case.numbers
    assert case.faults() == []


def test_a_case_without_its_peer_says_so(monkeypatch):
    monkeypatch.setattr(opensees_peer, "find_spec", lambda name: None)
    case = opensees_peer.case()
    assert (case.errors, case.faults()) == ((), [])
    assert case.skipped == 'openseespy and numba not installed: pip install -e ".[bench]"'


def test_a_case_without_its_interpreter_says_so(monkeypatch, tmp_path):
    """Only an interpreter that imports the other program is taken."""
    lacking = tmp_path / "python"
    own = "pip install jaxonomy in an environment of its own, and name one by"
    remedies = {
        siconos_peer: "no Python with Siconos: apt install python3-siconos, or name one by",
        jaxonomy_peer: f"no Python with jaxonomy: {own}",
    }
    for peer, remedy in remedies.items():
        monkeypatch.setenv(peer.PYTHON, str(lacking))
        for status, taken in ((1, None), (0, str(lacking))):
            lacking.write_text(f"#!/bin/sh\nexit {status}\n")
            lacking.chmod(0o755)
            assert interpreter.__wrapped__("module", peer.PYTHON) == taken
        lacking.unlink()
        interpreter.cache_clear()
        case = peer.case()
        interpreter.cache_clear()
        assert (case.errors, case.curves, case.faults()) == ((), (), [])
        assert case.skipped == f"{remedy} {peer.PYTHON}"


def test_jaxonomy_s_case_has_two_curves_of_each_program(monkeypatch):
    steps = 0.04, 0.02
    changes = {"STEPS": steps, "TOLERANCES": steps, "BEST_OF": 1, "LANES": 4, "missing": str}
    for name, value in changes.items():
        monkeypatch.setattr(jaxonomy_peer, name, value)
    rows = jaxonomy_peer.by_jaxpound()
    monkeypatch.setattr(jaxonomy_peer, "by_jaxpound", lambda: rows)
    monkeypatch.setattr(jaxonomy_peer, "by_jaxonomy", lambda: (rows, "1.0 with JAX 0.9"))
    case = jaxonomy_peer.case()
    assert case.faults() == []
    assert [curve.version for curve in case.curves] == ["", "", *["1.0 with JAX 0.9"] * 2]
    assert {curve.errors for curve in case.curves} == {case.errors[0].errors}
    assert max(case.errors[0].errors) < 3e-6


def test_what_does_not_hold_is_named():
    errors = Errors("x", (0.2, 0.1), (0.04, 0.01), constant=1.1)
    number = Number("peak", 2.674, 2.67, within=0.005)
    assert Case("title", "problem", "source", (errors,), (number,)).faults() == []
    assert errors.fitted_order == pytest.approx(2)
    assert dataclasses.replace(errors, constant=0.9).faults() == [
        "x: error 4.0e-02 at step 0.2, above 3.6e-02",
        "x: error 1.0e-02 at step 0.1, above 9.0e-03",
    ]
    (fault,) = dataclasses.replace(errors, errors=(0.02, 0.01)).faults()
    assert fault == "x: order 1.00 instead of 2"
    (fault,) = dataclasses.replace(number, known=2.66).faults()
    assert fault == "peak: 2.674, not 2.66 ± 0.005"
    assert "error nan" in dataclasses.replace(errors, errors=(math.nan, 0.01)).faults()[0]
    assert dataclasses.replace(number, found=math.nan).faults()
