"""Multiple stripes: counts, and suites of their own by intensity."""

import warnings

import numpy as np
import pytest

import jaxpound as jp
from tests.ground.test_suite import SUITE
from tests.hazard.test_ida import LADDER, LEFT, PAIR, RIGHT
from tests.refusals import refused

LINKS = [jp.FloorLink(0, 0, gap=0.02), jp.FloorLink(1, 0, gap=0.5)]
ROW = jp.Buildings((LEFT, RIGHT, LEFT), LINKS)


def striped(records, structures=PAIR, intensities=LADDER, **changed):
    return jp.multiple_stripes(jp.Analysis(structures, records, **changed), intensities)


def test_stripes_of_one_suite_or_of_one_each_are_those_of_the_incremental_analysis(linear):
    found = striped(SUITE)
    np.testing.assert_allclose(np.transpose(found.demands), linear.demands, rtol=1e-12)
    np.testing.assert_array_equal(found.pounding, linear.stripes.pounding)
    assert "required gap (m)" in repr(found)
    suites = [SUITE, SUITE.chosen([0, 2]), SUITE, SUITE.chosen([1])]
    found = striped(suites)
    np.testing.assert_array_equal(found.trials, [3, 2, 3, 1])
    np.testing.assert_allclose(found.demands[1], linear.demands[[0, 2], 1], rtol=1e-12)
    np.testing.assert_allclose(found.demands[3], linear.demands[[1], 3], rtol=1e-12)
    again = striped([SUITE, SUITE.scaled(2.0), SUITE.scaled(3.0), SUITE])  # of the same names
    np.testing.assert_allclose(np.transpose(again.demands), linear.demands, rtol=1e-9)
    near = [0.1, 0.1 + 1e-9, 0.1 + 2e-9]  # at which records of one name have one name again
    alike = [SUITE, SUITE.chosen([0]).scaled(2.0), SUITE.chosen([0, 1]).scaled(3.0)]
    others = striped(alike, intensities=near)
    for rows, found in zip((slice(None), [0], [0, 1]), others.demands, strict=True):
        np.testing.assert_allclose(found, linear.demands[rows, 1], rtol=1e-6)
    refused("2 suites must be 4, one an intensity", striped, suites[:2])
    with pytest.warns(jp.PlausibilityWarning, match="the mean acceleration") as doubts:
        offset = jp.Record(np.full(200, 0.1), dt=0.02, name="offset")
    assert len(doubts) == 1
    refused("the mean acceleration", striped, [offset], strict=True)  # as of the other analyses


def test_pounding_where_gaps_differ_is_an_overlap_of_any_link():
    """Without dampers; the second link is too wide to matter."""
    found = striped(SUITE, intensities=[0.05, 0.4], structures=ROW)
    weak, strong = (np.asarray(one) + 0.02 for one in found.demands)  # what the first link closes
    np.testing.assert_allclose(strong, 8 * weak, rtol=1e-9)
    np.testing.assert_array_equal(found.pounding, [(weak >= 0.02).sum(), (strong >= 0.02).sum()])
    assert (found.threshold, found.demand) == (0.0, "overlap")
    assert "median overlap (m)" in repr(found)


def test_demands_that_return_are_told_where_a_fragility_is_fitted():
    demands = [np.linspace(0, level, 20) for level in (0.5, 1.2, 2.0, 4.0)]
    stripes = jp.hazard.Stripes(np.array([0.1, 0.2, 0.4, 0.8]), tuple(demands), 1.0)
    curve = jp.fit_fragility(stripes.intensities, stripes.pounding, stripes.trials)
    assert stripes.fragility().median == curve.median
    assert "return" not in repr(stripes)
    for counts, returning in (((0, 0, 10, 0), True), ((2, 6, 5, 9), False)):
        demands = tuple(np.arange(10) < k for k in counts)
        stripes = jp.hazard.Stripes(np.array([0.1, 0.2, 0.4, 0.8]), demands, 1.0)
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            stripes.fragility()
        words = "10 of 10 times at 0.4 and 0 of 10 at 0.8"
        assert [words in str(x.message) for x in told] == [True] * returning
        assert (f"demands return below it: {words}" in repr(stripes)) is returning
