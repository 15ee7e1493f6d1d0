"""Pushover against springs in series, by hand."""

import numpy as np
import pytest

import jaxpound as jp
from tests.refusals import refusals

FRAME = jp.ShearBuilding.from_period(3, 300e3, period=0.5, damping_ratio=0.05)
K = np.array([float(storey.stiffness) for storey in FRAME.storeys])
SHARES = np.array([1, 5 / 6, 1 / 2])  # of the base shear, of loads as 1 : 2 : 3


def test_each_storey_follows_its_own_law_under_its_share_of_the_base_shear():
    strengths = np.array([1e6, 0.7e6, 0.5e6])
    pushed = jp.pushover(FRAME.yielding(yield_force=list(strengths), hardening=0.1), 14.0)
    shears = np.outer(pushed.base_shear, SHARES)
    expected = (shears + (1 / 0.1 - 1) * np.maximum(shears - strengths, 0)) / K
    np.testing.assert_allclose(pushed.drifts, expected, rtol=1e-7)
    np.testing.assert_allclose(pushed.drifts[pushed.yields, range(3)], strengths / K, rtol=1e-7)
    assert pushed.drifts[-1, 1] == pytest.approx(14 * 0.7e6 / K[1])  # of the critical storey


def test_a_storey_without_hardening_is_a_mechanism_and_one_that_softens_relieves_the_others():
    plastic = jp.pushover(FRAME.yielding(yield_force=1e6))
    assert plastic.yields.tolist() == [64, -1, -1]
    assert plastic.base_shear[-1] == pytest.approx(1e6)
    np.testing.assert_allclose(plastic.drifts[-1], [6e6 / K[0], *(SHARES * 1e6 / K)[1:]], rtol=1e-7)
    elastic = jp.ShearBuilding((*FRAME.yielding(yield_force=1e6).storeys[:1], *FRAME.storeys[1:]))
    np.testing.assert_allclose(jp.pushover(elastic).drifts, plastic.drifts, rtol=1e-7)
    # With strengths as the shears all yield at once, and one goes on alone.
    even = jp.pushover(FRAME.yielding(yield_force=list(1e6 * SHARES)))
    assert (abs(even.yields - 64) < 2).all()
    assert (even.drifts[-1] / (1e6 * SHARES / K)).round(6).tolist().count(1.0) == 2
    softening = FRAME.yielding(yield_force=1e6, hardening=-0.1, ultimate_displacement=0.02)
    pushed = jp.pushover(softening, 8.0)
    end = 1e6 * (1 - 0.1 * (min(8.0, 0.02 * K[0] / 1e6) - 1))
    assert pushed.base_shear.max() == pytest.approx(1e6)
    assert pushed.base_shear[-1] == pytest.approx(end)
    np.testing.assert_allclose(pushed.drifts[-1, 1:], (SHARES * end / K)[1:], rtol=1e-7)


test_wrong_buildings_are_refused = refusals(
    (3, "pushover: building = 3 must be of type ShearBuilding"),
    (FRAME, "pushover: building must yield"),
    (FRAME.yielding(yield_force=1e6), 1.0, "pushover: ductility = 1 must be above 1"),
    (FRAME.yielding(yield_force=np.array([[1e6] * 2] * 3)), "must yield, by single numbers"),
    of=jp.pushover,
)
