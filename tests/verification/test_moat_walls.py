"""The comparison with published runs: its page, its curve, and its bearings."""

import numpy as np
import pytest

import jaxpound as jp
from benchmarks import moat_walls
from tests.test_docs import DOCS


def test_the_page_has_the_numbers_of_the_file():
    page, statistics = (DOCS / "moat_walls.md").read_text(), moat_walls.everything()
    assert moat_walls.table(statistics) in page
    assert moat_walls.curve(statistics) in page


def test_the_curve_is_the_likeliest():
    """Of shares that a logistic curve makes exactly, and with the errors of many draws."""
    draw = np.random.default_rng(0)
    ratios = np.exp(draw.uniform(-1, 1, 4000))
    p = 1 / (1 + np.exp(0.3 + 4 * np.log(ratios)))
    numbers, _ = moat_walls.logistic(ratios, p)
    np.testing.assert_allclose(numbers, [-0.3, -4.0], rtol=1e-10)
    fits = [moat_walls.logistic(ratios, draw.uniform(size=p.size) < p) for _ in range(40)]
    errors = np.array([fit[0] for fit in fits]) - [-0.3, -4.0]
    np.testing.assert_allclose(errors.std(0), fits[0][1], rtol=0.35)


def test_bearings_have_period_and_damping_at_the_displacement_of_the_code():
    numbers = {"period": 3.0, "damping": 0.15}
    size = float(moat_walls.displacement(0.3, numbers))
    assert size == pytest.approx(0.3 * jp.STANDARD_GRAVITY * 9 / (4 * np.pi**2 * 1.35))
    bearing = moat_walls.pendulum(numbers, size)
    assert float(bearing.damping_ratio(size)) == pytest.approx(0.15)
    secant = 1 / bearing.radius + bearing.friction / size  # over the weight
    assert 2 * np.pi / np.sqrt(jp.STANDARD_GRAVITY * secant) == pytest.approx(3.0)
