"""Scaling to a target: against SciPy's bounded least squares, and the codes' ranges."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

import jaxpound as jp
from tests.ground.test_suite import SUITE
from tests.refusals import refusals

TARGET = jp.ground.TargetSpectrum([0.0, 0.1, 0.5, 4.0], [0.3, 0.75, 0.75, 0.75 / 8], name="site")
CODES = jp.ground.PeriodRange.asce_7, jp.ground.PeriodRange.en_1998


def scaled(*args, periods=(0.2, 2.0), **more):
    return SUITE.scaled_to(TARGET, periods, *args, **more)


def test_factors_are_the_bounded_least_squares():
    with pytest.warns(jp.PlausibilityWarning, match="factors of fast are at a bound, 0.25 or 3"):
        found = scaled((0.25, 3.0))
    ratios = np.log(TARGET.at(found.periods) / SUITE.spectra(found.periods))
    for factor, misfit, wanted in zip(found.factors, found.misfits, ratios, strict=True):
        best = lsq_linear(np.ones((wanted.size, 1)), wanted, bounds=np.log([0.25, 3.0]))
        assert np.log(factor) == pytest.approx(best.x[0], abs=1e-6)
        assert misfit == pytest.approx(np.sqrt(2 * best.cost / wanted.size), rel=1e-6)
    assert found.at_bound == ("fast",)
    assert found.bounds == (0.25, 3.0)
    np.testing.assert_allclose(found.accelerations, found.suite.spectra(found.periods), rtol=1e-9)
    off = np.log(found.accelerations.mean(axis=0) / TARGET.at(found.periods))
    assert found.misfit == pytest.approx(np.sqrt(np.mean(off**2)))
    assert "at a bound" in repr(found)


def test_the_best_fit_best_and_the_mean_reaches_its_least_share():
    whole, best = scaled((1e-3, 1e3)), scaled((1e-3, 1e3), best=2)
    ranked = np.argsort(whole.misfits)[:2]
    assert best.suite.names == tuple(whole.suite.names[i] for i in sorted(ranked))
    np.testing.assert_array_equal(best.factors, whole.factors[np.sort(ranked)])
    # All factors are raised alike, those at the bound excepted.
    plain, raised = scaled((1e-3, 1e3)), scaled((1e-3, 1e3), least=0.9)
    assert plain.least_ratio < 0.9
    assert raised.least_ratio == pytest.approx(0.9, rel=1e-9)
    assert np.ptp(raised.factors / plain.factors) == pytest.approx(0, abs=1e-9)
    with pytest.warns(jp.PlausibilityWarning):
        bounded = scaled((0.25, 4.0), least=0.9)
    assert bounded.least_ratio == pytest.approx(0.9, rel=1e-9)
    assert bounded.factors.max() == 4.0


def test_ranges_targets_and_their_damping():
    """ASCE/SEI 7-16, 16.2.3.1: 0.2 T_min to 2.0 T_max; EN 1998-1, 3.2.3.1.2(4): 0.2 T1 to 2 T1."""
    assert jp.ground.PeriodRange.asce_7(1.0, 0.5) == pytest.approx((0.1, 2.0))
    assert jp.ground.PeriodRange.asce_7(1.0, 0.5, shortest=0.04) == pytest.approx((0.04, 2.0))
    assert jp.ground.PeriodRange.asce_7(1.0, shortest=0.3) == pytest.approx((0.2, 2.0))
    assert jp.ground.PeriodRange.en_1998(0.8) == pytest.approx((0.16, 1.6))
    of_array = SUITE.scaled_to(TARGET, np.array([0.2, 1.0]), (1e-3, 1e3))
    assert of_array.range == jp.ground.PeriodRange(0.2, 1.0)
    # Plateaus and branches in 1/T of codes are exact.
    np.testing.assert_allclose(TARGET.at([0.0, 0.05, 0.3]), [0.3, 0.525, 0.75])
    np.testing.assert_allclose(TARGET.at([1.0, 2.0, 4.0]), 0.375 / np.array([1.0, 2.0, 4.0]))
    for damping in (0.02, 0.1, 0.4):
        assert OF_EN(0.2, "A", damping=damping).damping == pytest.approx(damping)


TARGETS, OF_EN, ONES = jp.ground.TargetSpectrum, jp.ground.TargetSpectrum.en_1998, [1.0, 1.0]
WITHIN = "periods = .* must be within those of the target 'site', 0 to 4"
NOT_RISING = "periods = 0.1 .* must be rising"
TOO_LARGE = r"least = 0.9 must be at most 0\.\d+, which factors of 1"
test_wrong_ranges_factors_and_targets_are_named = refusals(
    (lambda: scaled(periods=(0.01, 1.0)), "'slow' holds, 0.04 to 7.98"),
    (lambda: scaled(periods=(0.2, 8.5)), "'slow' holds"),
    (lambda: scaled(periods=(0.2, 6.0)), WITHIN),
    (lambda: scaled(periods=(1.0, 0.2)), "periods = 0.2 must be above the lower end, 1"),
    (lambda: scaled(periods=1.0), "must be a range"),
    *((call, "must hold at least one period") for call in CODES),
    *((lambda call=call: call(1.0, -1.0), "must be positive") for call in CODES),
    (lambda: scaled((0.25, 3.0), strict=True), "factors of fast are at a bound"),
    (lambda: scaled(best=4), "best = 4 must be at most 3"),
    (lambda: scaled((0.25, 1.0), least=0.9), TOO_LARGE),
    (lambda: scaled(least=[0.9, 0.9]), r"least of shape \(2,\) must be one number"),
    (lambda: scaled(2.0), "must be bounds"),
    (lambda: scaled((2.0, 1.0)), "at least the lower bound, 2"),
    (lambda: scaled((0.0, 1.0)), r"factors\[0\] = 0 must be positive"),
    (lambda: TARGETS([0.1], [1.0]), "must be of one shape"),
    (lambda: TARGETS([0.1, 0.2], [1.0]), "must be of one shape"),
    (lambda: TARGETS([0.2, 0.1], ONES), NOT_RISING),
    (lambda: TARGETS([0.1, 0.2], [1.0, 0.0]), r"accelerations = 0 .* must be positive"),
    (lambda: TARGETS([1, 2], ONES, damping=1), "damping = 1 must be at least 0 and below 1"),
    (lambda: TARGET.at("long"), r"TargetSpectrum\.at: periods = 'long' must be a real"),
    (lambda: OF_EN(0.2, "F"), "ground = 'F' must be one of A, B, C, D, E"),
    (lambda: OF_EN(0.2, "A", kind=3), "kind = 3 must be 1 or 2"),
    (lambda: OF_EN(0.2, "A", damping=5), "damping = 5 must be at least 0"),
    (lambda: OF_EN(0.0, "A"), "acceleration = 0 must be positive"),
    (lambda: TARGETS.asce_7(1.0, 0.6, 0.5), r"t_l = 0\.5 must be above s_d1 / s_ds"),
)


# Type 1, ground A, 0.2 g: at rest, half way up, the plateau, 1/T, 1/T² from 2 s on.
GROUND_A = [0, 0.075, 0.15, 0.4, 0.8, 2.0, 4.0], [0.2, 0.35, 0.5, 0.5, 0.25, 0.1, 0.025]
# S = 1.5, T_B = 0.1 s, T_C = 0.25 s, T_D = 1.2 s.
TYPE_2 = [0.0, 0.1, 0.25, 1.2, 4.0], [0.15, 0.375, 0.375, 0.078125, 0.00703125]
# η = √(10 / (5 + ξ)), and 0.55 at least, by the damping ξ; not at T = 0.
ETAS = {0.02: 1.195228609, 0.1: 0.816496581, 0.4: 0.55}
# S_DS = 0.8, S_D1 = 0.48: T_0 = 0.12 s, T_S = 0.6 s; T_L = 6 s.
OF_ASCE = [0.0, 0.06, 0.12, 0.6, 1.0, 6.0, 12.0], [0.32, 0.56, 0.8, 0.8, 0.48, 0.08, 0.02]


@pytest.mark.parametrize(
    ("spectrum", "at", "expected"),
    [
        (OF_EN(0.2, "A"), *GROUND_A),
        (OF_EN(0.1, "D"), [0.0, 0.2, 0.8, 1.6], [0.135, 0.3375, 0.3375, 0.16875]),
        (OF_EN(1.0, "B"), [0.15, 0.5, 1.0], [3.0, 3.0, 1.5]),
        (OF_EN(1.0, "E"), [0.15, 0.5, 1.0], [3.5, 3.5, 1.75]),
        (OF_EN(0.1, "C", kind=2), *TYPE_2),
        (TARGETS.asce_7(0.8, 0.48, 6.0), *OF_ASCE),
        *((OF_EN(0.2, "A", damping=x), [0.0, 0.3], [0.2, 0.5 * eta]) for x, eta in ETAS.items()),
    ],
)
def test_spectra_of_codes(spectrum, at, expected):
    np.testing.assert_allclose(spectrum.at(at), expected)
