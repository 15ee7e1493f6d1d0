"""Gaps of codes against numbers by hand."""

import itertools
from functools import partial

import jax
import numpy as np
import pytest
from scipy.integrate import quad

import jaxpound as jp
from jaxpound.study.gaps import double_difference_correlation
from tests.refusals import refusals


def test_gaps_of_codes_by_hand():
    """Displacements of 8 and 6 cm: 10 cm, and 7 cm."""
    assert jp.en_1998_gap(0.08, 0.06) == pytest.approx(0.1)
    assert jp.en_1998_gap(8, 6, level_floors=True) == pytest.approx(7.0)
    at_levels = jp.en_1998_gap(np.array([0.03, 0.05]), np.array([0.04, 0.12]))
    np.testing.assert_allclose(at_levels, [0.05, 0.13])
    assert float(jax.grad(lambda u: jp.en_1998_gap(u, 0.06))(0.08)) == pytest.approx(0.8)
    # C_d 5.5 and 4, I_e 1 and 1.25: of 8/5.5 and 7.5/4 cm, 8 and 6 cm, which are 10 together.
    gap = jp.asce_7_gap(8 / 5.5, 7.5 / 4, amplification=(5.5, 4.0), importance=(1.0, 1.25))
    assert gap == pytest.approx(10.0)
    assert jp.asce_7_gap(0.04, 0.03, amplification=4, importance=2.0) == pytest.approx(0.1)


CASES = [((1.0, 0.05), (0.7, 0.05)), ((2.0, 0.02), (1.9, 0.1)), ((1.0, 0.3), (3.0, 0.1))]


@pytest.mark.parametrize(("one", "two"), CASES)
def test_the_double_difference_s_correlation_is_that_of_two_oscillators_in_white_noise(one, two):
    """ρ = Re ∫ H1 H2* dω over √(∫ |H1|² ∫ |H2|²), by quadrature, of periods and damping ratios."""

    def h(w, t, z):
        w0 = 2 * np.pi / t
        return 1 / (w0**2 - w**2 + 2j * z * w0 * w)

    def integral(a, b):
        ends = [0, *sorted(2 * np.pi / period for period, _ in (one, two)), np.inf]
        product = lambda w: (h(w, *a) * np.conj(h(w, *b))).real  # noqa: E731
        return sum(quad(product, *part, limit=500)[0] for part in itertools.pairwise(ends))

    rho = integral(one, two) / np.sqrt(integral(one, one) * integral(two, two))
    assert double_difference_correlation(*one, *two) == pytest.approx(rho, rel=1e-6)
    assert double_difference_correlation(*two, *one) == pytest.approx(rho, rel=1e-6)
    # Equal oscillators move together.
    assert double_difference_correlation(1.0, 0.05, 1.0, 0.05) == pytest.approx(1.0)
    assert double_difference_correlation(1.0, 0.0, 1.0, 0.0) == 1.0
    assert double_difference_correlation(1.0, 0.0, 2.0, 0.0) == 0.0


THREE = partial(jp.asce_7_gap, 0.1, 0.1, amplification=4.0, importance=(1, 1, 1))
test_bad_arguments_are_named = refusals(
    (lambda: jp.en_1998_gap(-0.1, 0.1), "en_1998_gap: displacement_1 = -0.1 must be finite"),
    (lambda: jp.asce_7_gap(0.1, 0.1, amplification=0.0), "amplification = 0 must be positive"),
    (THREE, "importance = .1, 1, 1. must be one number or one for each of two"),
)
