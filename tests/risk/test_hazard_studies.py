"""Studies against a hazard curve: those whose intensities it draws, or that are weighted by it."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import jaxpound as jp
from tests.study.test_run import MEDIAN, SIGMA, SLIDING, linear, study, unit

HAZARD = jp.HazardCurve([0.1, 0.2, 0.4, 0.8, 1.6], [2e-2, 7e-3, 1.6e-3, 2.5e-4, 3e-5])
DRAWN = HAZARD.distribution()
# The response is linear: the required gap is the amplitude times that of a wave of amplitude 1, so
# that a gap is closed as often as the hazard exceeds an amplitude.
SCENARIOS = jp.Scenarios(
    SLIDING,
    jp.CustomDraw(lambda z: jp.Ricker(DRAWN.from_normal(z[0]) * jnp.ones(1), [2.0], [1.5]), 1),
)


@pytest.fixture(scope="module")
def found():
    return study(SCENARIOS, 2000, chunk_size=1000, key=3)


@pytest.fixture(scope="module")
def closing():
    """The required gap of a wave of amplitude 1."""
    return float(1.0 - unit().min_gap)


def test_the_rate_of_pounding_is_that_of_the_intensity_that_closes_the_gap(found, closing):
    for at in (0.15, 0.4, 0.9):
        rate = HAZARD.annual_rate_of(found.pounding_probability(at * closing, 0.999))
        assert rate.low < float(HAZARD.rate(at)) < rate.high < 10 * rate.low


def test_the_gap_for_two_per_cent_in_fifty_years_is_that_of_its_intensity(found, closing):
    for p in (0.1, 0.02):
        gap = HAZARD.required_gap(found, p, 50.0, confidence=0.999)
        assert gap.low < HAZARD.intensity_at(p, 50.0) * closing < gap.high < 2 * gap.low


def test_a_study_of_other_intensities_is_weighted_by_the_hazard(closing):
    """Medians .3 and σ .5 say little of weak earthquakes, and enough of strong ones."""
    other = linear()
    amplitude = other["pga"] / unit().pga
    weights = HAZARD.weights(amplitude, drawn_from=jp.LogNormal(MEDIAN, SIGMA))
    weighted = other.weighted(weights, normalised=False)
    gap = HAZARD.required_gap(weighted, 0.02, 50.0, confidence=0.999)
    assert gap.low < HAZARD.intensity_at(0.02, 50.0) * closing < gap.high < 1.5 * gap.low
    rate = HAZARD.annual_rate_of(weighted.pounding_probability(0.4 * closing, 0.999))
    assert rate.low < 1.6e-3 < rate.high < 1.5 * rate.low


def with_capacity(found, columns):
    """A study of given columns."""
    parts = {name: np.asarray(x, float) for name, x in columns.items()}
    moments = {name: jp.study.statistics.Moments.of(x) for name, x in parts.items()}
    rows = [range(len(parts["pga"]))]
    of = lambda name: (parts[name],)  # noqa: E731
    return dataclasses.replace(found, rows=rows, _parts=of, _moments=moments)


def test_the_gap_by_fragilities_is_that_of_their_closed_form(found):
    """Required gaps lognormal about im: at gap g the fragility has median g and dispersion .4."""
    hazard = jp.HazardCurve([0.01, 10.0], 1e-4 * np.array([0.01, 10.0]) ** -2.0)
    random = np.random.default_rng(0)
    im = np.exp(random.normal(-0.5, 0.8, 5_000))
    gaps = im * np.exp(0.4 * random.normal(size=im.size))
    cloud = with_capacity(found, {"pga": im, "required_gap": gaps})
    gap = hazard.required_gap(cloud, 0.02, 50.0, intensity="pga", confidence=0.999)
    target = -np.log(0.98) / 50
    exact = np.sqrt(1e-4 * np.exp((2 * 0.4) ** 2 / 2) / target)
    assert gap.value == pytest.approx(exact, rel=0.05)
    assert gap.low < exact < gap.high < 1.4 * gap.low
    rate = hazard.annual_rate_of(cloud.fragility(gap=gap.value))
    assert rate.value == pytest.approx(target, rel=1e-3)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"probability": 0.9}, "annual rate of probability = 0.9 in 50 years, 0.046.* below"),
        ({"probability": 0.0}, "probability = 0 must be between 0 and 1"),
        ({"years": 0.0}, "years = 0 must be positive"),
        ({"intensity": "pgo"}, "'pgo' must be one of"),
        ({"intensity": "pga"}, "must be the rate of pounding at a gap at which .* none"),
    ],
)
def test_gaps_that_cannot_be_told_say_why(found, more, message):
    with pytest.raises(ValueError, match=message):
        HAZARD.required_gap(found, **more)


def test_records_of_intensity_one_are_scaled_by_the_hazard():
    record = jp.Record(np.array([0.0, 1.0, -0.4, 0.0]), 0.5, time_unit="1/ω1")
    ground = jp.RandomRecord((record,), factor=DRAWN)
    for z, share in ((0.0, 0.5), (2.0, stats.norm.sf(2))):
        peak = np.abs(ground.draw(jnp.array([z])).samples).max()
        assert float(HAZARD.rate(peak)) == pytest.approx(2e-2 * share)
