"""Studies against a hazard curve: those whose intensities it draws, or that are weighted by it."""

import dataclasses
import re

import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
import pytest
from scipy import stats

import jaxpound as jp
from jaxpound.plots import hazards
from jaxpound.reliability.design_points import DesignPoints
from jaxpound.reliability.result import Samples, cov_of_mean
from jaxpound.scenarios.distributions import Distribution
from jaxpound.store.store import describe
from tests.refusals import refusals, refused
from tests.study.test_run import GRID, MEDIAN, SIGMA, SLIDING, linear, study, unit

mpl.use("Agg")

HAZARD = jp.HazardCurve([0.1, 0.2, 0.4, 0.8, 1.6], [2e-2, 7e-3, 1.6e-3, 2.5e-4, 3e-5])
DRAWN, LOGNORMAL = HAZARD.distribution(), jp.LogNormal(0.16, 0.6)


@dataclasses.dataclass(frozen=True)
class Wave:
    amplitude: Distribution
    dimension: int = 1

    def draw(self, z):
        return jp.Ricker(self.amplitude.from_normal(z[0]) * jnp.ones(1), [2.0], [1.5])


# The response is linear: the required gap is the amplitude times that of a wave of amplitude 1, so
# that a gap is closed as often as the hazard exceeds an amplitude.
SCENARIOS = jp.Scenarios(SLIDING, Wave(DRAWN))


@pytest.fixture(scope="module")
def found():
    return study(SCENARIOS, 2000, chunk_size=1000, key=3)


@pytest.fixture(scope="module")
def closing():
    return float(1.0 - unit().min_gap)


def test_a_study_tells_its_rate_and_from_which_intensities_it_comes(found, closing):
    for at in (0.15, 0.4, 0.9):
        rate = HAZARD.annual_rate_of(found.pounding_probability(at * closing, 0.999))
        assert rate.low < float(HAZARD.rate(at)) < rate.high < 10 * rate.low
    rate = HAZARD.annual_rate_of(found, gap=0.35 * closing)
    same = found.pounding_probability(0.35 * closing)
    assert [rate.value, rate.low, rate.high] == pytest.approx(2e-2 * np.array(same[:3]))
    n = len(found)
    assert rate.cov == pytest.approx(np.sqrt((1 - same.value) / same.value / n))
    amplitude, exact = found["pga"] / unit().pga, expected(0.35)
    by = rate.deaggregation(EDGES, intensity=amplitude)
    assert exact[0] == by.rate[0] == 0
    assert np.isnan(by.cov[0])
    assert (np.abs(by.rate - exact) <= 3.5 * by.cov * by.rate)[1:].all()
    p = by.rate[1:] / 2e-2
    np.testing.assert_allclose(by.cov[1:], np.sqrt((1 - p) / p / n))
    assert by.rate.sum() == pytest.approx(rate.value)
    usual = rate.deaggregation(bands=5)
    assert usual.share.sum() == pytest.approx(1.0)
    assert usual.edges[0] == pytest.approx(found["pga"][amplitude >= 0.35].min(), rel=1e-5)
    assert "peak ground acceleration (g) from" in repr(usual)
    for p in (0.1, 0.02):
        gap = HAZARD.required_gap(found, p, 50.0, confidence=0.999)
        assert gap.low < HAZARD.intensity_at(p, 50.0) * closing < gap.high < 2 * gap.low


EDGES = [0.0, 0.3, 0.4, 0.55, 0.8, np.inf]


def expected(least):
    """Rates of amplitudes within EDGES that are at least so much."""
    above = np.append(HAZARD.rate(np.maximum(EDGES[1:-1], least)), 0.0)
    return np.r_[float(HAZARD.rate(least)), above[:-1]] - above


def test_a_weighted_study_does_too_more_sharply(found, closing):
    amplitude, exact = linear()["pga"] / unit().pga, expected(0.35)
    weights = HAZARD.weights(amplitude, drawn_from=jp.LogNormal(MEDIAN, SIGMA))
    for normalised in (True, False):
        weighted = linear().weighted(weights, normalised=normalised)
        rate = HAZARD.annual_rate_of(weighted, gap=0.35 * closing, drawn=True)
        by = rate.deaggregation(EDGES, intensity=amplitude)
        assert (np.abs(by.rate - exact) <= 3.5 * by.cov * by.rate)[1:].all()
        assert (by.cov[1:] < 0.25).all()
        assert abs(rate.value - exact.sum()) < 3.5 * rate.cov * rate.value
        assert by.rate.sum() == pytest.approx(rate.value)
    # Medians .3 and σ .5 say little of weak earthquakes, and enough of strong ones.
    gap = HAZARD.required_gap(weighted, 0.02, 50.0, confidence=0.999, drawn=True)
    assert gap.low < HAZARD.intensity_at(0.02, 50.0) * closing < gap.high < 1.5 * gap.low
    rate = HAZARD.annual_rate_of(weighted.pounding_probability(0.4 * closing, 0.999))
    assert rate.low < 1.6e-3 < rate.high < 1.5 * rate.low


@pytest.fixture(scope="module")
def event(closing):
    """The amplitude .8 or more, by subset simulation: a share of 1.25 %."""
    state = jp.LimitState(SCENARIOS, GRID, threshold=0.8 * closing)
    sample = np.random.default_rng(0).normal(size=(5, 2000, 1))
    values = state.values(sample.reshape(-1, 1))
    p = (values >= 0).reshape(5, -1).mean(axis=1)
    sample, repeats = sample.reshape(-1, 1), np.repeat(np.arange(5), 2000)
    samples = Samples(sample, np.ones(values.size), values, repeats=repeats)
    estimate = p.mean(), cov_of_mean(p)
    none = DesignPoints.none(state.dimension)
    return jp.RareEvent(state, samples, *estimate, none, values.size, 0, "plain")


def test_a_rare_event_s_rate_and_its_intensities(event, found):
    rate = HAZARD.annual_rate_of(event, 0.9)
    assert (rate.value, rate.cov, rate.confidence) == (2e-2 * event.probability, event.cov, 0.9)
    assert "Mean annual rate of pounding" in repr(rate)
    assert abs(rate.value - 2.5e-4) < 3.5 * rate.cov * rate.value
    refused("intensities of the rare event must be drawn", STRONGER.annual_rate_of, event)
    assert STRONGER.annual_rate_of(event, drawn=True).value > rate.value
    doubted = dataclasses.replace(event, warnings=("one repeat makes most of the estimate",))
    assert "one repeat makes most" in repr(HAZARD.annual_rate_of(doubted))
    amplitude = np.asarray(DRAWN.from_normal(event.samples.points[:, 0]))
    whole = rate.deaggregation([0.7, np.inf], intensity=amplitude)
    assert whole.rate[0] == pytest.approx(rate.value)
    assert whole.cov[0] == pytest.approx(rate.cov)  # by the spread of repeats, too
    by = rate.deaggregation([0.8, 1.6, np.inf], intensity=amplitude)
    assert (np.abs(by.rate - [2.2e-4, 3e-5]) < 4 * by.cov * by.rate).all()
    refused("the rate, 0 a year, must", HAZARD.annual_rate_of(found, gap=1e6).deaggregation)
    refused("intensity = None must be a parameter, z_1", HAZARD.annual_rate_of(event).deaggregation)
    refused("gap = -1 must be finite and not negative", HAZARD.annual_rate_of, found, gap=-1.0)
    refused("link = 0 must be None: pounding is not a study", HAZARD.annual_rate_of, event, link=0)


def test_the_figure_of_a_study_shares_the_axis_of_one_measure_only(found, closing):
    rate = HAZARD.annual_rate_of(found, gap=0.35 * closing)
    above, below = hazards.pounding(HAZARD, rate, bands=6).axes
    assert (above.get_xlabel(), below.get_xlabel()) == ("im", "peak ground acceleration (g)")
    amplitude = found["pga"] / unit().pga
    above, below = hazards.pounding(HAZARD, rate, bands=6, intensity=amplitude).axes
    assert (above.get_xlabel(), below.get_xlabel()) == ("", "im")
    assert above.get_xlim() == below.get_xlim()


test_intensities_that_are_none_are_named = refusals(
    ("amplitud", "unknown intensity = 'amplitud'; allowed: .*pga"),
    ("min_gap", "intensity = -.* must be positive and finite in samples that pound"),
    ([1.0, 2.0], r"intensity of shape \(2,\) must be \(2000,\)"),
    of=lambda of_hazard, closing, intensity: HAZARD.annual_rate_of(
        of_hazard, gap=0.3 * closing
    ).deaggregation(intensity=intensity),
    fixtures=("found", "closing"),
)


def of_ground(found, ground):
    identity = {**found.about["identity"], "scenarios": describe(jp.Scenarios(SLIDING, ground))}
    return dataclasses.replace(found, about={**found.about, "identity": identity})


def wavelets(intensity):
    return jp.RandomRicker(2, LOGNORMAL, jp.Uniform(1, 2), jp.Uniform(1, 2), intensity=intensity)


STRONGER = jp.HazardCurve(HAZARD.intensity, HAZARD.annual_rate**0.9)

KT, ENVELOPE = jp.KanaiTajimi(15.0, 0.6), jp.ground.PlateauEnvelope(1.0, 4.0, 0.8)
UNDRAWN = {
    "wavelets": wavelets(LOGNORMAL),
    "noise": jp.FilteredNoise(KT, 20, 0.05, ENVELOPE, LOGNORMAL),
    "another curve": wavelets(STRONGER.distribution()),
    "a function": jp.CustomDraw(lambda z: DRAWN.from_normal(z[0]) * jp.Ricker([1], [2], [1.5]), 1),
}


@pytest.mark.parametrize("ground", UNDRAWN.values(), ids=UNDRAWN)
def test_a_study_that_no_hazard_has_drawn_is_not_taken_for_one_that_it_has(found, ground):
    undrawn = of_ground(found, ground)
    refused(r"drawn by HazardCurve.distribution .* intensity, such", HAZARD.required_gap, undrawn)
    for other in (undrawn, undrawn.weighted(np.ones(len(undrawn)))):
        words = r"HazardCurve.weights, .* study.fragility.*drawn=True"
        refused(words, HAZARD.annual_rate_of, other, gap=1.0)
    rate = HAZARD.annual_rate_of(undrawn, gap=1.0, drawn=True)
    assert rate.value == HAZARD.annual_rate_of(found, gap=1.0).value
    assert HAZARD.required_gap(undrawn, drawn=True).value == HAZARD.required_gap(found).value


def test_an_intensity_is_the_hazard_s_up_to_a_factor(found):
    """As of records whose intensity is not 1, or of a curve in another unit."""
    in_g = jp.HazardCurve(HAZARD.intensity / 9.81, HAZARD.annual_rate)
    same = HAZARD.annual_rate_of(found, gap=1.0).value
    for curve in (HAZARD, in_g):
        drawn = of_ground(found, wavelets(curve.distribution()))
        assert HAZARD.annual_rate_of(drawn, gap=1.0).value == same
    # Weights may be of this hazard or of another, of a study that it has drawn too.
    weights = STRONGER.weights(found["pga"], drawn_from=jp.LogNormal(1.0, 2.0))
    weighted, words = found.weighted(weights), "intensities of the study must be drawn"
    assert STRONGER.annual_rate_of(weighted, gap=1.0, drawn=True).value > 0
    refused(words, STRONGER.annual_rate_of, weighted, gap=1.0)
    for other in (weights, weights**2, np.arange(1.0, len(found) + 1)):
        refused(words, HAZARD.annual_rate_of, found.weighted(other), gap=1.0)


def lognormal_gaps(found, n):
    random = np.random.default_rng(0)
    im = np.exp(random.normal(-0.5, 0.8, n))
    parts = {"pga": im, "required_gap": im * np.exp(0.4 * random.normal(size=n))}
    moments = {name: jp.study.statistics.Moments.of(x) for name, x in parts.items()}
    held = {"_parts": lambda name: (parts[name],), "_moments": moments}
    return dataclasses.replace(found, rows=[range(n)], **held)


def test_the_gap_by_fragilities_is_that_of_their_closed_form(found):
    """Required gaps lognormal about im: at gap g the fragility has median g and dispersion .4."""
    hazard = jp.HazardCurve([0.01, 10.0], 1e-4 * np.array([0.01, 10.0]) ** -2.0)
    cloud = lognormal_gaps(found, 5_000)
    gap = hazard.required_gap(cloud, 0.02, 50.0, intensity="pga", confidence=0.999)
    target = -np.log(0.98) / 50
    exact = np.sqrt(1e-4 * np.exp((2 * 0.4) ** 2 / 2) / target)
    assert gap.value == pytest.approx(exact, rel=0.05)
    assert gap.low < exact < gap.high < 1.4 * gap.low
    rate = hazard.annual_rate_of(cloud.fragility(gap=gap.value))
    assert rate.value == pytest.approx(target, rel=1e-3)


test_gaps_that_cannot_be_told_say_why = refusals(
    ({"probability": 0.9}, "annual rate of probability = 0.9 in 50 years, 0.046.* below"),
    ({"probability": 0.0}, "probability = 0 must be between 0 and 1"),
    ({"years": 0.0}, "years = 0 must be positive"),
    ({"confidence": 2.0, "intensity": "pga"}, "confidence = 2 must be between 0 and 1"),
    ({"years": [50, 100]}, r"years of shape \(2,\) must be one number"),
    ({"intensity": "pgo"}, "'pgo' must be one of"),
    ({"intensity": "pga"}, "must be the rate of pounding at a gap at which .* none"),
    of=lambda of_hazard, more: HAZARD.required_gap(of_hazard, **more),
    fixtures=("found",),
)


def test_curves_in_other_units_and_of_other_measures_are_not_mistaken(found):
    in_si = dataclasses.replace(found, scales=jp.Scales(mass=1e5, frequency=6.0))
    assert (found.unit("pga"), in_si.unit("pga"), in_si.unit("pounds")) == ("g", "m/s²", "")
    in_g, in_m = (dataclasses.replace(HAZARD, measure=f"PGA ({x})") for x in ("g", "m/s2"))
    of_sa = dataclasses.replace(HAZARD, measure="SA(0.5) (g)")
    words = "must be that of the study's column 'pga', peak ground a"
    refused(words, of_sa.required_gap, found, intensity="pga")
    words = "must be the rate of pounding at a gap"
    for hazard in (in_g, in_m):
        for other in (found, in_si):  # of which no fragility can be fitted
            refused(words, hazard.required_gap, other, intensity="pga")
    curve = dataclasses.replace(lognormal_gaps(found, 500), scales=in_si.scales).fragility(gap=1.0)
    assert curve.unit == "m/s²" in repr(curve)
    converted = curve.in_unit("g")
    assert in_g.annual_rate_of(curve).value == in_g.annual_rate_of(converted).value
    with pytest.warns(jp.PlausibilityWarning, match="measure = 'im' names no unit; it should"):
        silent = HAZARD.annual_rate_of(curve)
    assert in_m.annual_rate_of(curve).value == silent.value


@dataclasses.dataclass(frozen=True)
class Spectral:
    measure: str

    def __call__(self, structures, ground):
        return jp.spectral_acceleration(ground, GRID, period=3.0)


def test_a_curve_at_another_period_is_not_taken_for_a_measure_that_states_its_own():
    sa = Spectral("Sa(3 1/ω1) (g)")
    by_name = {"sa": sa, "of_site": Spectral("Sa(0.5 s) (g)"), "pga_of_site": lambda *x: sa(*x)}
    shaken = study(SCENARIOS, 64, measures=by_name)
    words = [str(shaken.measure(name)) for name in by_name]
    assert words == ["Sa(3 1/ω1) (g)", "Sa(0.5 s) (g)", "pga of site"]
    hazard = dataclasses.replace(HAZARD, measure="SA(0.2) (g)")
    for name, of in zip(by_name, words, strict=True):
        refused(re.escape(f"column '{name}', {of}"), hazard.required_gap, shaken, intensity=name)


def test_records_are_scaled_by_the_hazard_and_rates_from_beyond_it_doubted():
    record = jp.Record(np.array([0.0, 1.0, -0.4, 0.0]), 0.5, time_unit="1/ω1")
    ground = jp.RandomRecord((record,), factor=DRAWN)
    for z, share in ((0.0, 0.5), (2.0, stats.norm.sf(2))):
        peak = np.abs(ground.draw(jnp.array([z])).samples).max()
        assert float(HAZARD.rate(peak)) == pytest.approx(2e-2 * share)
    far, near = (HAZARD.annual_rate_of(jp.study.Fragility(median, 0.4)) for median in (6.0, 0.6))
    assert "more than 50% of the rate comes from intensities beyond" in repr(far)
    assert near.warnings == ()
