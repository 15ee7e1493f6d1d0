"""Rods as Maxwell branches, and a pair of them from phase to phase: what Siconos is beside."""

import dataclasses

import numpy as np
import pytest
from scipy.linalg import expm

import jaxpound as jp
from benchmarks.verification import siconos_peer
from benchmarks.verification.maxwell import BAND, branches, pair
from tests.reference import load

PAPER = jp.paper.structures()
TIMES = np.array(load("paper_case")["t"])
GRID = jp.TimeGrid.until(20.0, 0.01)
SOME = np.arange(50, 2001, 50)
"""Steps of the grid: 40 instants."""


@pytest.fixture(scope="module")
def smooth():
    """The pair of order 1 at some instants, by SciPy."""
    return siconos_peer.phased(siconos_peer.SMOOTH, 0.01 * SOME)


def test_the_branches_have_the_modulus_of_the_rod():
    omega = np.logspace(*BAND, 101)
    for rod in (PAPER.rod_1, PAPER.rod_2):
        found, exact = branches(rod), np.asarray(rod.complex_modulus(omega))
        assert np.abs(found.modulus(omega) / exact - 1).max() < 5e-6
        assert min(found.spring, found.dashpot, *found.weights) > 0
    rod = jp.ZenerRod(1.0, 0.1, 0.4)
    exact = np.asarray(rod.complex_modulus(np.logspace(-3, 3, 20)))
    np.testing.assert_allclose(branches(rod).modulus(np.logspace(-3, 3, 20)), exact, rtol=1e-14)


def test_blocks_on_branches_respond_to_a_step_like_those_on_fractional_rods():
    """Against the inverse Laplace transform: both blocks, free of each other, under u'' = 1."""
    known = [load("rods")[name] for name in ("rod_1", "rod_2")]
    times = np.array([float(t) for t in known[0]["step_response"]])
    matrix = pair(dataclasses.replace(PAPER, friction=0.0)).first_order()
    whole = np.pad(matrix, (0, 1))
    whole[2:4, -1] = -1.0
    for i, one in enumerate(known):
        assert (PAPER.rod_1, PAPER.rod_2)[i].order == one["order"]
        found = [expm(whole * t)[i, -1] for t in times]
        np.testing.assert_allclose(found, [*one["step_response"].values()], atol=5e-6)


def test_the_pair_on_branches_has_the_phases_of_the_papers_case():
    known, found = load("paper_case"), siconos_peer.phased(PAPER, TIMES)
    assert [kind for _, kind in found.changes] == [kind for _, kind in known["events"]]
    both = zip(found.changes, known["events"], strict=True)
    assert max(abs(change[0] - event[0]) for change, event in both) < 1e-5
    assert found.closing == pytest.approx(-known["min_gap"], abs=1e-6)
    np.testing.assert_allclose(found.x.T, [known["x1"], known["x2"]], atol=5e-6)


def test_jaxpound_moves_the_pair_of_order_1_like_scipy(smooth):
    run = jp.simulate(siconos_peer.SMOOTH, jp.paper.ground(), GRID)
    x = np.stack([mass.x for mass in run.masses], axis=1)[SOME]
    assert np.abs(x - smooth.x).max() < 2e-4
    assert float(run.min_gap) == pytest.approx(1 - smooth.closing, abs=3e-5)
    kinds = {0: "stick", 1: "slip right", -1: "slip left"}
    assert [phase.kind for phase in run.phases()[1:]] == [kinds[kind] for _, kind in smooth.changes]


def test_siconos_moves_the_pair_of_order_1_like_scipy(smooth):
    if siconos_peer.missing():
        pytest.skip(siconos_peer.missing())
    (moved,), (seconds,), _ = siconos_peer.peer(siconos_peer.SMOOTH, [GRID.dt], rounds=1)
    assert moved.shape == (GRID.n_steps + 1, 4)
    assert np.abs(moved[SOME, :2] - smooth.x).max() < 2e-3
    assert seconds > 0
