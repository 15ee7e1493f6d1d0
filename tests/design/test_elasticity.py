"""Elasticities against differences of logarithms."""

import dataclasses

import numpy as np
import pytest

import jaxpound as jp
from tests.pickled import assert_survives_pickling
from tests.refusals import refusals, refused
from tests.test_tables import assert_shown

PAPER, GRID = jp.paper.structures(), jp.TimeGrid.until(14.0, 0.05)
OTHER = jp.Ricker(0.3, [1.5, 2.5, 1.0, 2.0, 3.0], [2.0, 4.0, 3.0, 5.0, 6.0])
GROUNDS = [jp.paper.ground(), OTHER]
ENSEMBLE = jp.Ensemble.of(GROUNDS, GRID)


def test_wavelets_beside_a_record_are_judged_in_g():
    """They are in m/s² under Buildings, where 6 m/s² is no PGA of 6 g: nothing is warned of."""
    grid, building = jp.TimeGrid(0.02, 200), jp.Building.from_period(3e5, 0.5, 0.05)
    record = jp.Record(0.1 * np.sin(2 * np.pi * grid.times()[:150]), 0.02)
    waves = [jp.Ricker(amplitude, 1.0, 1.5) for amplitude in (0.09, 0.1)]
    ensemble = jp.Ensemble.of([*waves, record], grid)
    pair = jp.Buildings((building, building), (jp.FloorLink(0, 0, friction=1e5, gap=0.1),))
    shaken = jp.design.elasticities(pair, ensemble, grid, demand="peak_acceleration_1")
    assert 5 < shaken.value < 30


def test_elasticities_are_relative_derivatives():
    found = jp.design.elasticities(PAPER, ENSEMBLE, GRID, demand="peak_x1")

    def mean(structures):
        runs = [jp.demand(structures, g, GRID, only=["peak_x1"]) for g in GROUNDS]
        return np.mean([float(run.peak_x1) for run in runs])

    assert found.value == pytest.approx(mean(PAPER))
    assert_survives_pickling(found)
    rod = PAPER.rod_2
    for path, change in (
        ("friction", lambda f: {"friction": PAPER.friction * f}),
        ("rod_2.tau_x", lambda f: {"rod_2": dataclasses.replace(rod, tau_x=rod.tau_x * f)}),
        ("mass_ratio", lambda f: {"mass_ratio": f}),
    ):
        up, down = (mean(dataclasses.replace(PAPER, **change(1 + h))) for h in (1e-4, -1e-4))
        expected = (np.log(up) - np.log(down)) / 2e-4
        assert found.values[path] == pytest.approx(expected, rel=1e-3, abs=1e-5)
    assert found.values["initial_gap"] == 0
    sizes = [abs(float(line.split()[-1])) for line in repr(found).splitlines()[1:]]
    assert sizes == sorted(sizes, reverse=True)
    assert assert_shown(found)[0].startswith(
        f"peak displacement of building 1 = {found.value:.6g} g/ω1²; percent of it"
    )


def test_one_earthquake_is_an_ensemble_of_one_and_must_be_resolved():
    alone = jp.design.elasticities(PAPER, GROUNDS[0], GRID)
    assert str(alone).startswith("smallest gap = ")
    run = jp.demand(PAPER, GROUNDS[0], GRID, only=["min_gap"])
    assert alone.value == pytest.approx(float(run.min_gap))
    assert alone.values["initial_gap"] == pytest.approx(1 / float(run.min_gap))
    still = dataclasses.replace(PAPER, initial_gap=0.0)
    silence = dataclasses.replace(GROUNDS[0], amplitude=np.zeros(5))
    refused("min_gap = 0 must be finite and not zero", jp.design.elasticities, still, silence, GRID)
    coarse = jp.TimeGrid(0.4, 25)
    for ground, said in ((OTHER, "the shortest of periods is"), (ENSEMBLE, "of the 2 earthquakes")):
        # The suite makes errors of warnings: nothing runs after this one.
        message = f"^elasticities: ground: .*{said}"
        with pytest.raises(jp.PlausibilityWarning, match=message):
            jp.design.elasticities(PAPER, ground, coarse)
        refused(message, jp.design.elasticities, PAPER, ground, coarse, strict=True)


QUESTION = {"structures": PAPER, "ground": GROUNDS[0], "grid": GRID}
test_bad_questions_are_named = refusals(
    ({"demand": "gap"}, "demand = 'gap' must be one of min_gap"),
    ({"over": "median"}, "over = 'median' must be 'worst', 'mean' or a share"),
    ({"structures": 3}, "structures = 3 must be AdjacentStructures, a System"),
    of=lambda change: jp.design.elasticities(**(QUESTION | change)),
)
