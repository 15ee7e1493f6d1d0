"""The paper's case: what is said of it besides its numbers, which other tests compare."""

from dataclasses import replace

import numpy as np
import pytest

import jaxpound as jp

GRID = jp.TimeGrid(0.02, 1000)


def test_a_hundredth_of_ground_friction_and_gap_gives_a_hundredth_of_everything():
    assert round(float(jp.pga(jp.paper.ground(), jp.paper.grid()))) == 22
    structures, ground = jp.paper.structures(), jp.paper.ground()
    whole = jp.simulate(structures, ground, GRID)
    less = replace(structures, friction=0.0025, initial_gap=0.01)
    small = jp.simulate(less, jp.Ricker(0.005, ground.periods, ground.arrivals), GRID)
    for name in ("x1", "x2", "f1", "f2", "friction", "gap"):
        np.testing.assert_allclose(100 * getattr(small, name), getattr(whole, name), atol=1e-10)
    starts = [[phase.start for phase in run.phases()] for run in (small, whole)]
    assert starts[0] == pytest.approx(starts[1], abs=1e-9)
