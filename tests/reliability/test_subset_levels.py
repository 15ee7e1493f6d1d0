"""Subset simulation of limit states whose probabilities have closed forms."""

import numpy as np
import pytest
from scipy.special import ndtr, ndtri
from scipy.stats import chi2

from jaxpound.reliability.subset import levels_of_samples, run_in_lockstep


def simulated(value, dimension, *, n=1000, p0=0.1, repeats=20, key=0):
    rngs = {r: np.random.default_rng([key, r]) for r in range(repeats)}
    levels = {r: levels_of_samples(dimension, n, p0, rng) for r, rng in rngs.items()}
    return run_in_lockstep(each(value), levels)


def each(value):
    """The values of all queries."""
    return lambda queries: {name: value(z) for name, z in queries.items()}


def linear(dimension, beta):
    direction = np.linspace(1.0, 3.0, dimension)
    direction /= np.linalg.norm(direction)
    return lambda z: z @ direction - beta


def probability(found):
    """The estimate and its standard error, by the spread of the repeats."""
    p = np.array([levels[-1].estimate for levels in found])
    return p.mean(), p.std(ddof=1) / np.sqrt(len(p))


@pytest.mark.parametrize("exact", [1e-2, 1e-4, 1e-7])
def test_a_plane(exact):
    for dimension in (2, 20, 200):
        estimate, error = probability(simulated(linear(dimension, -ndtri(exact)), dimension))
        assert abs(estimate - exact) < 3 * error < exact, dimension


def test_few_samples_a_level_make_no_bias_and_one_sign_counts():
    """A threshold between two samples would make it +10 % here."""
    exact = ndtr(-3.5)
    estimate, error = probability(simulated(linear(10, 3.5), 10, n=200, repeats=1500))
    assert error < 0.025 * exact
    assert abs(estimate - exact) < 2.5 * error
    # A discrete number, and failures on both sides of it.
    by_sign = lambda z: np.where(z[:, 0] < 0, z[:, 1], -z[:, 1]) - 3.5  # noqa: E731
    found = simulated(by_sign, 3, repeats=100)
    estimate, error = probability(found)
    assert abs(estimate - ndtr(-3.5)) < 3 * error < 0.15 * estimate
    signs = [np.sign(levels[-1].points[:, 0]).mean() for levels in found]
    assert abs(np.mean(signs)) < 0.3  # both sides are sampled


def test_a_sphere_and_a_plateau():
    for value, dimension, exact in (
        # Every direction fails: |z|² of 10 numbers is chi-squared.
        (lambda z: (z**2).sum(axis=1) - 40.0, 10, chi2.sf(40.0, 10)),
        # A plateau, as of forces before contact, where most values are equal: the event is z_0 ≥ 4.
        (lambda z: np.maximum(z[:, 0] - 2.0, 0.0) - 2.0, 2, ndtr(-4.0)),
    ):
        estimate, error = probability(simulated(value, dimension))
        assert abs(estimate - exact) < 3 * error


def test_each_level_is_the_distribution_beyond_its_threshold_reached_by_adapted_steps():
    beta = 3.719
    for levels in simulated(linear(20, beta), 20, n=2000, repeats=4):
        for level in levels[1:]:
            x = beta + level.threshold
            exact = ndtr(-x)
            assert level.probability == pytest.approx(exact, rel=1.0)
            # Of a normal number above x the mean is φ(x) / Φ(−x).
            mean = np.exp(-(x**2) / 2) / np.sqrt(2 * np.pi) / exact
            assert level.values.mean() + beta == pytest.approx(mean, rel=0.05)
            assert level.values.min() > level.threshold
    # Papaioannou et al. 2015 find 0.44, whatever the dimension and the level.
    for dimension in (5, 100):
        found = simulated(linear(dimension, 4.75), dimension, repeats=10)
        acceptance = [level.acceptance for levels in found for level in levels[1:]]
        assert np.mean(acceptance) == pytest.approx(0.44, abs=0.04)


def test_a_repeat_depends_on_no_other_and_shares_divide_levels_unevenly():
    alone = simulated(linear(5, 4.0), 5, repeats=1)[0]
    among = simulated(linear(5, 4.0), 5, repeats=3)[0]
    assert [x.threshold for x in alone] == [x.threshold for x in among]
    for levels in simulated(linear(4, 3.0), 4, n=333, p0=0.13, repeats=4):
        assert {len(level.values) for level in levels} == {333}
    found = simulated(lambda z: np.full(len(z), -1.0), 2, repeats=2)
    assert [len(levels) for levels in found] == [1, 1]
    assert probability(found)[0] == 0
    found = simulated(linear(3, 40.0), 3, n=200, repeats=2)
    last = [levels[-1] for levels in found]
    assert all(x.probability < 1.1e-11 and x.estimate == 0 for x in last)


def test_requests_of_all_repeats_are_one_batch():
    sizes, reached = [], []
    rngs = [np.random.default_rng(r) for r in range(8)]
    levels = {r: levels_of_samples(10, 500, 0.1, rng) for r, rng in enumerate(rngs)}

    def values(asked):
        sizes.append(sum(map(len, asked.values())))
        return each(linear(10, 3.0))(asked)

    found = run_in_lockstep(values, levels, lambda p: reached.append(np.mean(p)))
    assert sizes[0] == 8 * 500
    assert set(sizes[1:10]) == {8 * 50}
    # Of samples equal to the threshold none goes on: fewer seeds, and more runs.
    least = sum(500 + 450 * (len(levels) - 1) for levels in found)
    assert least <= sum(sizes) < 1.01 * least
    assert reached[0] == 1
    assert reached[1] == pytest.approx(0.1)
