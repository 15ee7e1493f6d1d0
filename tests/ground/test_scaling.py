"""Scaling to a target: against SciPy's bounded least squares, and the codes' ranges."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

import jaxpound as jp
from tests.ground.test_suite import SUITE

TARGET = jp.TargetSpectrum([0.0, 0.1, 0.5, 4.0], [0.3, 0.75, 0.75, 0.75 / 8], name="site")
RANGE = (0.2, 2.0)


def scaled(*args, **more):
    return SUITE.scaled_to(TARGET, RANGE, *args, **more)


def test_factors_are_the_bounded_least_squares():
    with pytest.warns(jp.PlausibilityWarning, match="factors of fast are at a bound, 0.25 or 3"):
        found = scaled((0.25, 3.0))
    ratios = np.log(TARGET.at(found.periods) / SUITE.spectra(found.periods))
    for name, factor, wanted in zip(found.suite.names, found.factors, ratios, strict=True):
        best = lsq_linear(np.ones((wanted.size, 1)), wanted, bounds=np.log([0.25, 3.0]))
        assert np.log(factor) == pytest.approx(best.x[0], abs=1e-6)
        own = found.misfits[found.suite.names.index(name)]
        assert own == pytest.approx(np.sqrt(2 * best.cost / wanted.size), rel=1e-6)
    assert found.at_bound == ("fast",)
    np.testing.assert_allclose(found.accelerations, found.suite.spectra(found.periods), rtol=1e-9)
    off = np.log(found.accelerations.mean(axis=0) / TARGET.at(found.periods))
    assert found.misfit == pytest.approx(np.sqrt(np.mean(off**2)))
    assert "at a bound" in repr(found)


def test_a_bound_may_be_refused():
    with pytest.raises(ValueError, match="factors of fast are at a bound"):
        scaled((0.25, 3.0), strict=True)


def test_the_best_fit_best():
    whole, best = scaled((1e-3, 1e3)), scaled((1e-3, 1e3), best=2)
    ranked = np.argsort(whole.misfits)[:2]
    assert best.suite.names == tuple(whole.suite.names[i] for i in sorted(ranked))
    np.testing.assert_array_equal(best.factors, whole.factors[np.sort(ranked)])
    with pytest.raises(ValueError, match="best = 4 must be at most 3"):
        scaled(best=4)


def test_the_mean_reaches_its_least_share():
    """All factors are raised alike, those at the bound excepted."""
    plain, found = scaled((1e-3, 1e3)), scaled((1e-3, 1e3), least=0.9)
    assert plain.least_ratio < 0.9
    assert found.least_ratio == pytest.approx(0.9, rel=1e-9)
    assert np.ptp(found.factors / plain.factors) == pytest.approx(0, abs=1e-9)
    with pytest.warns(jp.PlausibilityWarning):
        bounded = scaled((0.25, 4.0), least=0.9)
    assert bounded.least_ratio == pytest.approx(0.9, rel=1e-9)
    assert bounded.factors.max() == 4.0
    with pytest.raises(ValueError, match=r"least = 0.9 must be at most 0\.\d+, which factors of 1"):
        scaled((0.25, 1.0), least=0.9)


def test_ranges_of_codes():
    """ASCE/SEI 7-16, 16.2.3.1: 0.2 T_min to 2.0 T_max; EN 1998-1, 3.2.3.1.2(4): 0.2 T1 to 2 T1."""
    assert jp.PeriodRange.asce_7(1.0, 0.5) == pytest.approx((0.1, 2.0))
    assert jp.PeriodRange.asce_7(1.0, 0.5, shortest=0.04) == pytest.approx((0.04, 2.0))
    assert jp.PeriodRange.asce_7(1.0, shortest=0.3) == pytest.approx((0.2, 2.0))
    assert jp.PeriodRange.en_1998(0.8) == pytest.approx((0.16, 1.6))
    for call in (jp.PeriodRange.asce_7, jp.PeriodRange.en_1998):
        with pytest.raises(ValueError, match="must hold at least one period"):
            call()
        with pytest.raises(ValueError, match="must be positive"):
            call(1.0, -1.0)


def test_a_target_between_its_ordinates():
    """Plateaus and branches in 1/T of codes are exact."""
    np.testing.assert_allclose(TARGET.at([0.0, 0.05, 0.3]), [0.3, 0.525, 0.75])
    np.testing.assert_allclose(TARGET.at([1.0, 2.0, 4.0]), 0.375 / np.array([1.0, 2.0, 4.0]))
    for periods, accelerations, words in (
        ([0.1], [1.0], "must be of one shape"),
        ([0.1, 0.2], [1.0], "must be of one shape"),
        ([0.2, 0.1], [1.0, 1.0], "periods = 0.1 .* must be finite, not negative and rising"),
        ([0.1, 0.2], [1.0, 0.0], r"accelerations = 0 .* must be positive"),
    ):
        with pytest.raises(ValueError, match=words):
            jp.TargetSpectrum(periods, accelerations)
    with pytest.raises(ValueError, match=r"TargetSpectrum\.at: periods = 'long' must be a real"):
        TARGET.at("long")
    with pytest.raises(ValueError, match="damping = 1 must be at least 0 and below 1"):
        jp.TargetSpectrum([0.1, 0.2], [1.0, 1.0], damping=1)


@pytest.mark.parametrize(
    ("periods", "words"),
    [
        ((0.01, 1.0), "'slow' holds, 0.04 to 7.98"),
        ((0.2, 8.5), "'slow' holds"),
        ((0.2, 6.0), "periods = .* must be within those of the target 'site', 0 to 4"),
        ((1.0, 0.2), "periods = 0.2 must be above the lower end, 1"),
        (1.0, "must be a range"),
    ],
)
def test_a_range_that_is_not_known(periods, words):
    with pytest.raises(ValueError, match=words):
        SUITE.scaled_to(TARGET, periods)


def test_wrong_bounds():
    for factors, words in (
        (2.0, "must be bounds"),
        ((2.0, 1.0), "at least the lower bound, 2"),
        ((0.0, 1.0), r"factors\[0\] = 0 must be positive"),
    ):
        with pytest.raises(ValueError, match=words):
            scaled(factors)
    with pytest.raises(ValueError, match=r"least of shape \(2,\) must be one number"):
        SUITE.scaled_to(TARGET, (0.2, 1.0), least=[0.9, 0.9])


def test_a_range_may_be_an_array():
    found = SUITE.scaled_to(TARGET, np.array([0.2, 1.0]), (1e-3, 1e3))
    assert found.range == jp.PeriodRange(0.2, 1.0)
