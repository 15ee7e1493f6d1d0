"""Random motions of filtered noise, of an earthquake and a site, and pulses; their sums."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import jaxpound as jp
from jaxpound.scenarios.random_ground import ScaledDraw, SumOfDraws
from jaxpound.scenarios.random_noise import CORRELATIONS, REGRESSIONS, _distributions
from jaxpound.scenarios.scenarios import discrete_coordinates, parameter_names
from tests.refusals import refusals, refused

PAPER = jp.paper.structures()
KT = jp.KanaiTajimi(2.0, 0.6)
SMALL = jp.FilteredNoise(KT, samples=20, dt=0.1, intensity=0.1)
SCALES = jp.Scales(mass=5e5, frequency=7.0)
SIZES = {"samples": 1250, "dt": 0.02}
MOTION = {"arias_intensity": 0.05, "duration": 10.0, "mid_time": 7.0, "damping": 0.2}
MOTION |= {"frequency": 5.0, "frequency_slope": -0.2}
GIVEN = jp.scenarios.NonstationaryNoise(**MOTION, **SIZES, high_pass=None)
SITE = jp.scenarios.SiteBasedNoise(
    magnitude=6.6, distance=20.0, vs30=600.0, fault="reverse", **SIZES
)
PULSE = jp.scenarios.RandomPulse(
    jp.scenarios.TwoSided(jp.LogNormal(0.2, 0.4)), jp.Normal(3.0, 0.5), arrival=1.0
)


def test_noise_of_a_spectral_density_has_its_variance_and_intensity_scales_it():
    """Of Kanai and Tajimi's filter: π S0 ω_g (1 + 4 ζ_g²) / (2 ζ_g)."""
    z = np.random.default_rng(0).normal(size=20)
    white = dataclasses.replace(SMALL, spectral_density=0.03, intensity=2.0)
    deviation = np.sqrt(np.pi * 0.03 * 2.0 * (1 + 4 * 0.6**2) / (2 * 0.6))
    for samples, tolerance in ((20, 0.02), (400, 1e-3)):  # the first are of 2 time units
        both = [dataclasses.replace(x, samples=samples) for x in (SMALL, white)]
        numbers = np.tile(z, samples // 20)
        unit, scaled = jax.jit(lambda z, both=both: [x.draw(z).samples for x in both])(numbers)
        np.testing.assert_allclose(scaled, 2.0 * deviation / 0.1 * unit, rtol=tolerance)


def test_filtered_motions_that_end_displaced_are_returned_to_rest():
    """Noise of Clough and Penzien's filter, an envelope of 10 s, 30 s: without the filter, 2 m."""
    filter_, envelope = (
        jp.ground.CloughPenzien(15.6, 0.6, high_pass=1.5),
        jp.ground.PlateauEnvelope(2, 10, 0.5),
    )
    how = {"time_unit": "s", "spectral_density": 0.01 / jp.STANDARD_GRAVITY**2}
    adrift = jp.FilteredNoise(filter_, samples=1500, dt=0.02, envelope=envelope, **how)
    z, t = np.random.default_rng(1).normal(size=(20, 1500)), 0.02 * np.arange(1502)
    last = []
    for noise in (adrift, dataclasses.replace(adrift, high_pass=0.1)):
        velocity = jax.jit(jax.vmap(lambda z, noise=noise: noise.draw(z).velocity(t)))(z)
        last.append(jp.STANDARD_GRAVITY * 0.02 * np.asarray(velocity).sum(1).std())
    assert 1.0 < last[0] < 4.0
    assert last[1] < 1e-4
    z, last = np.random.default_rng(4).normal(size=2500), 2500 * GIVEN.dt
    share = {}
    for high_pass in (0.1, None):
        noise = dataclasses.replace(GIVEN, samples=2500, high_pass=high_pass)
        assert noise.time_unit == "s"

        @jax.jit
        def velocities(z, noise=noise):
            record = noise.draw(z)
            return record.velocity(last), jp.ground.pgv(record)

        end, largest = velocities(z)
        share[high_pass] = abs(float(end)) / float(largest)
    assert share[0.1] < 1e-3
    assert share[None] > 1e-2


@pytest.mark.parametrize("noise", [SMALL, dataclasses.replace(GIVEN, samples=200, high_pass=0.1)])
def test_noise_is_linear_in_its_numbers(noise):
    a, b = np.random.default_rng(0).normal(size=(2, noise.dimension))
    draw = jax.jit(lambda z: noise.draw(z).samples)
    np.testing.assert_allclose(draw(2 * a - b), 2 * draw(a) - draw(b), rtol=1e-9, atol=1e-14)
    assert not noise.discrete
    noise = SCALES.to_dimensionless(noise) if noise.time_unit == "s" else noise
    assert parameter_names(jp.Scenarios(PAPER, noise))[:2] == ("noise_1", "noise_2")


def test_noise_differentiates_and_keeps_single_precision():
    z = np.random.default_rng(1).normal(size=20)

    @jax.jit
    def total(w):
        noise = dataclasses.replace(SMALL, filter=jp.KanaiTajimi(w, 0.6))
        return jnp.sum(noise.draw(z).samples ** 3)

    numeric = (total(2.0 + 1e-5) - total(2.0 - 1e-5)) / 2e-5
    assert float(jax.jit(jax.grad(total))(2.0)) == pytest.approx(float(numeric), rel=1e-6)
    draw = jax.jit(lambda z: SMALL.draw(z).samples)
    single = draw(z.astype(np.float32))
    assert single.dtype == jnp.float32
    np.testing.assert_allclose(single, draw(z), atol=1e-6)
    noise = dataclasses.replace(SMALL, intensity=jp.LogNormal(0.1, 0.5))
    assert noise.dimension == 21
    z = np.append(np.random.default_rng(2).normal(size=20), -1.0)
    expected = np.exp(-0.5) * SMALL.draw(z[:20]).samples
    np.testing.assert_allclose(noise.draw(z).samples, expected)
    assert float(noise.parameters(z)["intensity"]) == pytest.approx(0.1 * np.exp(-0.5))


def crossings(x, t, start, end):
    """Zero crossings upwards per second between two instants."""
    inside = (t[:-1] >= start) & (t[:-1] < end)
    return ((x[:, :-1] < 0) & (x[:, 1:] >= 0))[:, inside].sum(1).mean() / (end - start)


def test_nonstationary_noise_has_its_intensity_duration_and_frequencies():
    """Means over 600 motions, within three standard errors."""
    z = np.random.default_rng(3).normal(size=(600, GIVEN.samples))
    x = np.asarray(jax.jit(jax.vmap(lambda z: GIVEN.draw(z).samples))(z))
    t = GIVEN.dt * np.arange(GIVEN.samples)
    arias = np.pi / 2 * (x**2).sum(1) * GIVEN.dt
    error = arias.std() / np.sqrt(600)
    assert abs(arias.mean() - GIVEN.arias_intensity) < 3 * error < 0.003
    grown = (x**2).mean(0).cumsum()
    early, middle, late = np.interp(np.array([0.05, 0.45, 0.95]) * grown[-1], grown, t)
    assert late - early == pytest.approx(GIVEN.duration, rel=0.03)
    assert middle == pytest.approx(GIVEN.mid_time, rel=0.03)
    # Of such an oscillator's displacement, the rate of crossings is its frequency.
    for at in (3.0, 7.0, 15.0):
        expected = GIVEN.frequency + GIVEN.frequency_slope * (at - GIVEN.mid_time)
        assert crossings(x, t, at - 1, at + 1) == pytest.approx(expected, rel=0.04)


def test_parameters_of_a_site_and_of_a_population_have_the_published_distributions():
    """Against SciPy's distributions, at the means that the regression gives."""
    z = np.random.default_rng(5).normal(size=(4000, 6))
    found = {name: np.asarray(x) for name, x in jax.jit(jax.vmap(SITE._drawn))(z).items()}
    marginals = {
        "duration": stats.beta(1.1314, 2.4474, 5, 40),
        "mid_time": stats.beta(1.5792, 3.6405, 0.5, 39.5),
        "frequency": stats.gamma(4.0982, scale=1.4330),
        "damping": stats.beta(1.4250, 5.7208, 0.02, 0.98),
    }
    nu = {name: stats.norm.ppf(m.cdf(found[name])) for name, m in marginals.items()}
    location = np.log(np.pi / 2) - 4.8255
    nu["arias_intensity"] = (np.log(found["arias_intensity"]) - location) / 1.4318
    for name, x in nu.items():
        r, place = REGRESSIONS[name], np.array([20 / 25, 600 / 750])
        place = np.log(place) if name == "arias_intensity" else place
        mean = np.array(r.coefficients) @ [1.0, 1.0, 6.6 / 7, *place]
        spread = np.hypot(r.between, r.within)
        assert stats.kstest((x - mean) / spread, "norm").pvalue > 0.01, name
    slope = found["frequency_slope"]
    assert ((slope > -2) & (slope < 0.5)).all()
    nu["frequency_slope"] = slope
    order = [nu[name] for name in REGRESSIONS]
    ranked = np.array([stats.norm.ppf(stats.rankdata(x) / 4001) for x in order])
    np.testing.assert_allclose(np.corrcoef(ranked), CORRELATIONS, atol=0.05)
    # Over all data, for which a standard normal ν stands; means are of the paper's figures.
    nu = stats.norm.ppf((np.arange(20_000) + 0.5) / 20_000)
    published = {"duration": 17.4, "mid_time": 12.3, "frequency": 5.7, "damping": 0.21}
    published["frequency_slope"] = -0.1
    for name, mean in published.items():
        assert jax.jit(_distributions()[name])(nu).mean() == pytest.approx(mean, rel=0.12), name
    logarithms = np.log(_distributions()["arias_intensity"](nu))
    assert logarithms.mean() == pytest.approx(-4.39, abs=0.03)
    assert logarithms.std() == pytest.approx(1.43, abs=0.02)
    value = _distributions()["frequency_slope"]
    nu = np.linspace(-8.0, 8.0, 161)
    rise, fall = 6.7729, 17.095

    def grown(x):  # in proportion to the probability of at most x
        left = (np.exp(rise * np.minimum(x, 0)) - np.exp(-2 * rise)) / rise
        return left - np.expm1(-fall * np.maximum(x, 0)) / fall

    share = grown(np.asarray(jax.jit(value)(nu))) / grown(0.5)
    np.testing.assert_allclose(share, stats.norm.cdf(nu), rtol=1e-9, atol=1e-15)
    assert np.isfinite(jax.jit(jax.vmap(jax.grad(value)))(nu)).all()


def test_motions_of_a_site_differentiate_and_are_finite_far_out():
    z = np.random.default_rng(6).normal(size=SITE.dimension)
    names = list(jp.Scenarios(PAPER, jp.Scales(1.0, 7.0).to_dimensionless(SITE)).parameters(z))
    assert names[:7] == [*REGRESSIONS, "noise_1"]
    draw = jax.jit(lambda z: jp.ground.arias_intensity(SITE.draw(z)))
    slope = jax.jit(jax.grad(draw))(z)
    h = 1e-5 * np.eye(z.size)[1]
    numeric = (draw(z + h) - draw(z - h)) / 2e-5
    assert float(slope[1]) == pytest.approx(float(numeric), rel=1e-5)
    for far in (-6.0, 6.0):
        assert np.isfinite(draw(np.append(np.full(6, far), z[6:])))


def test_random_pulses_sums_and_multiples_have_their_numbers_in_studies_and_seconds():
    assert (PULSE.dimension, PULSE.discrete) == (2, ())
    pulse = PULSE.draw(np.array([-0.3, 1.0]))
    assert (pulse.arrival, pulse.cycles) == (1.0, 2.0)
    assert float(pulse.period) == pytest.approx(3.5)
    assert float(pulse.amplitude) < 0
    assert list(PULSE.parameters(np.zeros(2))) == ["amplitude", "period"]
    assert float(PULSE.draw(np.array([0.0, -9.0])).period) > 0
    # Numbers in order of the parts; names that repeat are numbered by part.
    jumping = jp.RandomRicker(1, jp.LogNormal(0.1, 0.5), jp.Uniform(1, 3), jp.Uniform(1, 3))
    both = 2 * (PULSE + SMALL * jp.LogNormal(1.0, 0.3) + jp.Ricker(0.1, 2.0, 1.0))
    assert both.dimension == 2 + 21
    z = np.random.default_rng(7).normal(size=23)
    t = np.linspace(0.0, 2.0, 30)

    @jax.jit
    def motions(z):
        wavelet = jp.Ricker(0.1, 2.0, 1.0)
        grounds = (
            both.draw(z),
            PULSE.draw(z[:2]) + wavelet + jnp.exp(0.3 * z[-1]) * SMALL.draw(z[2:22]),
            (wavelet - (SMALL - PULSE) / 2).draw(z[:22]),
        )
        parts = wavelet, SMALL.draw(z[:20]), PULSE.draw(z[20:22])
        return [ground.acceleration(t) for ground in (*grounds, *parts)]

    drawn, alone, less, wavelet, noise, pulse = map(np.asarray, motions(z))
    np.testing.assert_allclose(drawn, 2 * alone, rtol=1e-9)
    np.testing.assert_allclose(less, wavelet - (noise - pulse) / 2, rtol=1e-9)
    assert list(parameter_names(jp.Scenarios(PAPER, both)))[-2:] == ["noise_20", "scale"]
    twice = jp.Pulse(0.1, 2.0, 1.0) + sum([SMALL, jumping, SMALL])
    names = parameter_names(jp.Scenarios(PAPER, twice))
    assert (names[0], names[-1]) == ("noise_1_of_2", "noise_20_of_4")
    assert discrete_coordinates(twice) == (20 + 3,)
    assert isinstance(twice, SumOfDraws)
    assert isinstance(np.float64(2.0) * SMALL, ScaledDraw)
    uncertain = jp.UncertainStructures(PAPER, {"friction": jp.LogNormal(0.25, 0.2)})
    scenarios = jp.Scenarios(uncertain, PULSE + SMALL)
    study = jp.monte_carlo(scenarios, 8, jp.TimeGrid(0.1, 40), key=1, progress=False)
    structures, ground = scenarios.at(3, 1)
    demand = jp.demand(structures, ground, jp.TimeGrid(0.1, 40))
    assert float(demand.min_gap) == pytest.approx(study["min_gap"][3])
    noise, pulse = (dataclasses.replace(x, time_unit="s") for x in (SMALL, PULSE))
    z = np.random.default_rng(8).normal(size=22)
    t = np.linspace(0.0, 2.0, 30)
    both = SCALES.to_dimensionless(pulse + noise)
    in_seconds = (pulse + noise).draw(z).acceleration(t)
    np.testing.assert_allclose(both.draw(z).acceleration(7 * t), in_seconds, atol=1e-12)
    assert both.time_unit == "1/ω1"


with_ = partial(partial, dataclasses.replace)
test_bad_values_are_named = refusals(
    (lambda: jp.FilteredNoise(3, 20, 0.1), "filter = 3 must be of type Filter"),
    (lambda: jp.FilteredNoise(KT, 1, 0.1), "samples = 1 must be at least 2"),
    (lambda: jp.FilteredNoise(KT, 2.5, 0.1), "samples = 2.5 must be a positive whole"),
    (lambda: jp.FilteredNoise(KT, 20, 0.0), "dt = 0 must be positive"),
    (lambda: jp.FilteredNoise(KT, 20, 0.1, 3.0), "envelope = 3.0 must be a function of t"),
    (lambda: jp.FilteredNoise(KT, 20, 0.1, None, -1.0), "intensity = -1 must be finite and"),
    (with_(SMALL, high_pass=0.0), "high_pass = 0 must be positive and"),
    (with_(SMALL, spectral_density=-1.0), "spectral_density = -1 must be positive and finite"),
    (with_(SMALL, time_unit="h"), "time_unit = 'h' must be 's' or"),
    (with_(GIVEN, damping=1.0), "damping = 1 must be above 0 and below 1"),
    (with_(GIVEN, high_pass=0.0), "high_pass = 0 must be positive"),
    (with_(SITE, fault="normal"), "fault = 'normal' must be one of strike-slip"),
    (with_(SITE, distance=-1.0), "distance = -1 must be positive"),
    (
        lambda: jp.scenarios.RandomPulse(1.0, 1.0, 1.0),
        "one of the parameters must be a Distribution",
    ),
    (with_(PULSE, cycles=-1.0), "cycles = -1 must be positive"),
    (lambda: SumOfDraws((jp.Ricker(1, 1, 1),)), "must hold at least one that is drawn"),
    (lambda: SMALL + 3, r"parts\[1\] = 3 must have acceleration"),
    (lambda: SMALL + GIVEN, "must be in the same unit of time, but are in 1/ω1 and s"),
    (lambda: SMALL * "2", "factor = '2' must be a real number"),
    (lambda: SMALL * np.nan, "factor = nan must be finite"),
    (lambda: SMALL / 0, "divisor = 0 must be no zero"),
    (lambda: SMALL.draw(np.zeros(3)), r"FilteredNoise.draw: z of shape \(3,\) must be of shape"),
    (lambda: SITE.draw(np.zeros((2, 3))), r"SiteBasedNoise.draw: z of shape \(2, 3\) must be of"),
    (with_(SMALL, envelope=jp.GammaEnvelope), "must be a function of t"),
    (jp.Scenarios, PAPER, GIVEN, "must be in units of 1/ω1, as the structures are"),
    (SCALES.to_dimensionless, SMALL, "must be in seconds, but is in units of 1/ω1 already"),
)


@pytest.mark.usefixtures("small_machine")
def test_more_samples_than_memory_has_room_for_are_refused():
    refused("samples = 10,000,000 would take 220 GB of memo", jp.FilteredNoise, KT, 10_000_000, 0.1)
