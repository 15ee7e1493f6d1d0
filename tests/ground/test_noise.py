"""Filters, envelopes, pulses and noise of changing intensity against what defines them."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import integrate, linalg, signal, stats

import jaxpound as jp
from jaxpound.ground.noise import causal, evolving_noise, filtered, high_passed, modulation
from tests.ground.motions import values
from tests.refusals import refusals

FILTERS = [jp.KanaiTajimi(2.0, 0.6), jp.KanaiTajimi(5.0, 0.1)]
FILTERS += [
    jp.ground.CloughPenzien(2.0, 0.6, 0.2, 0.6),
    jp.ground.CloughPenzien(5.0, 0.3, 4.0, 0.2),
]


def of_systems(filter):
    """The same transfer function by SciPy."""
    w, zeta = filter.frequency, filter.damping
    numerator, denominator = [2 * zeta * w, w**2], [1, 2 * zeta * w, w**2]
    if isinstance(filter, jp.ground.CloughPenzien):
        w, zeta = filter.high_pass, filter.high_pass_damping
        numerator = np.polymul(numerator, [1, 0, 0])
        denominator = np.polymul(denominator, [1, 2 * zeta * w, w**2])
    return signal.TransferFunction(numerator, denominator)


@pytest.mark.parametrize("filter", FILTERS)
def test_a_filter_has_its_transfer_function(filter):
    system, w, t = of_systems(filter), np.linspace(0.0, 20.0, 300), np.linspace(0.0, 15.0, 400)
    gain, response = jax.jit(lambda f: (f.gain(w), f.impulse_response(t)))(filter)
    np.testing.assert_allclose(gain, np.abs(system.freqresp(w)[1]), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(response, signal.impulse(system, T=t)[1], rtol=1e-6, atol=1e-8)


@partial(jax.jit, static_argnames="n")
def of_an_impulse(filter, n, dt, density):
    """The weights of noise in steady state: the map's last row, reversed, shape (n,)."""
    return jax.grad(lambda z: filtered(filter, z, dt, density)[-1])(jnp.zeros(n))[::-1]


def variance(system):
    """∫ h² dt of a transfer function, by Lyapunov's equation."""
    a, b, c, _ = signal.tf2ss(system.num, system.den)
    return float((c @ linalg.solve_continuous_lyapunov(a, -b @ b.T) @ c.T).squeeze())


RESOLVED = [*(jp.KanaiTajimi(2.0, zeta) for zeta in (0.3, 0.45, 0.6)), FILTERS[2]]


@pytest.mark.parametrize("filter", RESOLVED)
def test_noise_of_twenty_samples_in_a_period_has_the_spectral_density(filter):
    """That of its straight lines, to 1 % up to 3 ω_g, and samples of its standard deviation."""
    n, dt = 4000, 2 * np.pi / filter.frequency / 20
    row = np.asarray(of_an_impulse(filter, n, dt, None))
    w = filter.frequency * np.linspace(0.02, 3.0, 60)
    lines = np.sinc(w * dt / (2 * np.pi)) ** 2
    density = dt * lines**2 * np.abs(np.exp(-1j * np.outer(w, dt * np.arange(n))) @ row) ** 2
    expected = np.abs(of_systems(filter).freqresp(w)[1]) ** 2 / variance(of_systems(filter))
    tolerance = np.where(w > 2 * filter.frequency, 0.01, 0.002)
    assert (np.abs(density / expected - 1) < tolerance).all()
    assert np.sum(row**2) == pytest.approx(1.0, abs=0.015)


@pytest.mark.parametrize("share", [0.1, 0.3, 1.0, 2.0])
def test_oscillators_move_in_the_noise_as_in_that_of_continuous_time(share):
    """Standard deviation of their displacements, of 5 % damping, S0 = 0.02."""
    filter, n = RESOLVED[2], 6000
    dt, w = 2 * np.pi / filter.frequency / 20, share * filter.frequency
    oscillator = signal.TransferFunction([1], [1, 0.1 * w, w**2])
    system = of_systems(filter)
    both = signal.TransferFunction(system.num, np.polymul(system.den, oscillator.den))
    row = np.append(0.0, of_an_impulse(filter, n, dt, 0.02))  # which a line from zero leads to
    moved = signal.lsim(oscillator, row, dt * np.arange(n + 1))[1]
    expected = 2 * np.pi * 0.02 * variance(both)
    assert (moved**2).sum() == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_noise_has_one_variance_from_the_first_instant_on(dtype):
    map_ = jax.jit(jax.jacfwd(lambda z: filtered(FILTERS[2], z, dtype(0.04))))(np.zeros(300, dtype))
    assert map_.dtype == dtype
    tolerance = 1e-4 if dtype == np.float32 else 1e-12
    map_ = np.asarray(map_)
    variances = (map_**2).sum(1)
    np.testing.assert_allclose(variances, variances[-1], rtol=tolerance)
    np.testing.assert_allclose(np.triu(map_, 1), 0.0, atol=tolerance)


def test_causal_sums_and_envelopes():
    kernel, x = np.random.default_rng(0).normal(size=(2, 77))
    np.testing.assert_allclose(jax.jit(causal)(kernel, x), np.convolve(kernel, x)[:77], atol=1e-12)
    t = np.array([-1.0, 0.0, 2.5, 5.0, 12.0])
    gamma = jp.GammaEnvelope(peak=5.0, power=2.0)
    expected = np.where(t > 0, (t / 5 * np.exp(1 - t / 5)) ** 2, 0.0)
    np.testing.assert_allclose(gamma(t), expected, rtol=1e-12)
    plateau = jp.ground.PlateauEnvelope(rise=5.0, end=10.0, decay=0.4)
    np.testing.assert_allclose(plateau(t), [0, 0, 0.25, 1, np.exp(-0.8)], rtol=1e-12)
    for envelope in (gamma, plateau):  # both branches are differentiated
        slopes = jax.jit(jax.grad(lambda e: jnp.sum(e(t))))(envelope)
        assert np.isfinite(jax.tree.leaves(slopes)).all()


PULSES = [jp.Pulse(0.8, 1.5, 3.0, 0.4, 1.7), jp.Pulse(-0.5, 2.0, 4.0, np.pi / 2, 1.0)]
PULSES += [jp.Pulse(1.2, 0.9, 2.0, 0.0, 3.0, "s")]
SCALES = jp.Scales(mass=5e5, frequency=7.0)


@pytest.mark.parametrize("pulse", PULSES)
def test_a_pulse_s_motions_are_derivatives_of_each_other_and_end_continuously(pulse):
    end = pulse.cycles * pulse.period / 2
    t = pulse.arrival + np.linspace(-1.3, 1.3, 53) * end
    outside = pulse.arrival + end * np.array([-9.0, -1.0, 1.0, 9.0])

    @jax.jit
    def motions(p):
        slopes = (jax.vmap(jax.grad(f))(t) for f in (p.displacement, p.velocity))
        return (p.velocity(t), p.acceleration(t)), tuple(slopes)

    (velocity, acceleration), slopes = motions(pulse)
    np.testing.assert_allclose(velocity, slopes[0], atol=1e-14)
    np.testing.assert_allclose(acceleration, slopes[1], atol=1e-13)
    for quantity in ("velocity", "acceleration"):
        np.testing.assert_allclose(values(pulse, quantity, outside), 0.0, atol=1e-14)
    assert float(values(pulse, "displacement", outside)[0]) == 0.0
    slopes = jax.jit(jax.jacrev(lambda p: p.acceleration(outside)))(pulse)
    assert all(np.isfinite(x).all() for x in jax.tree.leaves(slopes))


def test_a_pulse_is_that_of_mavroeidis_and_papageorgiou():
    """Their eqs. for velocity and for the permanent displacement, in g and 1/ω1 and in SI."""
    a, period, centre, nu, gamma = 0.8, 1.5, 3.0, 0.4, 1.7
    f = 1 / period
    t = centre + np.linspace(-0.99, 0.99, 41) * gamma / (2 * f)
    s = 2 * np.pi * f * (t - centre)
    v = a / 2 * (1 + np.cos(s / gamma)) * np.cos(s + nu)
    left = a / (4 * np.pi * f) / (1 - gamma**2)
    left *= np.sin(nu + np.pi * gamma) - np.sin(nu - np.pi * gamma)
    for unit, g in (("1/ω1", 1.0), ("s", jp.STANDARD_GRAVITY)):
        pulse = jp.Pulse(a, period, centre, nu, gamma, unit)
        np.testing.assert_allclose(g * values(pulse, "velocity", t), v, rtol=1e-12, atol=1e-14)
        assert float(g * values(pulse, "displacement", 99.0)) == pytest.approx(left, rel=1e-12)


def test_a_pulse_in_seconds_becomes_dimensionless_and_says_when_it_is_not_resolved():
    pulse, record = PULSES[2], jp.Record([0.0, 0.1, -0.2, 0.0], 0.5)
    both = SCALES.to_dimensionless(0.5 * (pulse + record))
    t = np.linspace(0.0, 5.0, 40)
    expected = 0.5 * (values(pulse, "acceleration", t) + values(record, "acceleration", t))
    np.testing.assert_allclose(values(both, "acceleration", 7 * t), expected, atol=1e-12)
    assert not PULSES[0].unresolved(0.1)
    assert "7.5 time steps long" in PULSES[0].unresolved(0.2)[0]
    assert not (0 * PULSES[0]).unresolved(0.2)


IN_1, WAVELET = SCALES.to_dimensionless, jp.Ricker(1, 1, 1)
test_bad_values_are_named = refusals(
    (lambda: jp.KanaiTajimi(-2.0, 0.6), r"frequency = -2 must be positive"),
    (lambda: jp.KanaiTajimi(2.0, 1.0), "damping = 1 must be above 0 and below 1"),
    (lambda: jp.ground.CloughPenzien(2.0, 0.6, 3.0), "high_pass = 3 must be below frequency = 2"),
    (
        lambda: jp.ground.CloughPenzien(2.0, 0.6, 0.2, 1.0),
        "high_pass_damping = 1 must be above 0 and be",
    ),
    (lambda: jp.GammaEnvelope(0.0, 1.0), "peak = 0 must be positive"),
    (lambda: jp.ground.PlateauEnvelope(3.0, 2.0, 1.0), "end = 2 must be .*above rise = 3"),
    (lambda: jp.Pulse(1.0, 0.0, 1.0), "period = 0 must be positive"),
    (lambda: jp.Pulse(1.0, [1.0, 2.0], 1.0), r"period of shape \(2,\) must be one number"),
    (lambda: jp.Pulse(1.0, 1.0, 1.0, time_unit="ms"), "time_unit = 'ms' must be 's' or"),
    (lambda: PULSES[2] + PULSES[0], "must be in the same unit of time"),
    (lambda: IN_1(0.5 * IN_1(PULSES[2])), "be in seconds, but is in units of 1/ω1 already"),
    (lambda: IN_1(PULSES[2] + WAVELET), "must be in seconds, but has no unit of time"),
    (lambda: IN_1(lambda t: t), "must be of type Record"),
)

N, DT = 400, 0.03
MAP = jax.jit(jax.jacfwd(lambda z, *p: evolving_noise(z, DT, *p)))


def direct(frequency, slope, mid_time, damping):
    """The matrix of impulse responses of Rezaeian and Der Kiureghian (2008), normalised."""
    t = DT * np.arange(N)
    w = 2 * np.pi * np.maximum(frequency + slope * (t - mid_time), 0.3)
    across = np.sqrt(1 - damping**2)
    s = t[:, None] - t
    late = np.maximum(s, 0.0)
    h = np.where(s >= 0, w / across * np.exp(-damping * w * late) * np.sin(across * w * late), 0)
    size = np.sqrt((h**2).sum(1))
    return h / np.where(size > 0, size, 1.0)[:, None]


@pytest.mark.parametrize(
    ("given", "tolerance"),
    [
        ((5.0, 0.0, 4.0, 0.3), 1e-10),
        ((5.0, -0.2, 4.0, 0.1), 1e-9),
        ((3.0, 0.3, 4.0, 0.03), 1e-5),
        ((6.0, -1.0, 4.0, 0.3), 2e-3),  # from 10 Hz to .3 Hz, where it stays
    ],
)
def test_evolving_noise_is_the_sum_of_responses_to_impulses(given, tolerance):
    np.testing.assert_allclose(MAP(jnp.zeros(N), *given), direct(*given), atol=tolerance)


def test_evolving_noise_differentiates():
    z = jnp.asarray(np.random.default_rng(0).normal(size=N))

    @jax.jit
    def total(p):
        return jnp.sum(evolving_noise(z, DT, *p) ** 3)

    point, h = jnp.array([5.0, -0.2, 4.0, 0.1]), 1e-5
    numeric = [(total(point + h * e) - total(point - h * e)) / (2 * h) for e in np.eye(4)]
    np.testing.assert_allclose(jax.jit(jax.grad(total))(point), numeric, rtol=1e-5, atol=1e-4)


def test_the_modulating_function_has_its_arias_intensity_duration_and_mid_time():
    t, modulated = np.linspace(0.0, 150.0, 60_001), jax.jit(modulation)
    for duration, mid_time in ((12.0, 8.0), (5.0, 20.0), (30.0, 7.0)):
        q = np.asarray(modulated(t, 0.05, duration, mid_time))
        grown = np.pi / 2 * integrate.cumulative_simpson(q**2, x=t, initial=0.0)
        assert grown[-1] == pytest.approx(0.05, rel=1e-4)
        early, middle, late = np.interp(np.array([0.05, 0.45, 0.95]) * 0.05, grown, t)
        assert late - early == pytest.approx(duration, rel=1e-3)
        assert middle == pytest.approx(mid_time, rel=1e-3)
    # Out of reach it leaves the mid-time: an exponential density, the last without a pole.
    t = np.array([0.5, 3.0, 20.0])
    scale = 4.0 / stats.expon.ppf(0.45)
    expected = np.sqrt(2 / np.pi * stats.expon.pdf(t, scale=scale))
    np.testing.assert_allclose(modulated(t, 1.0, 30.0, 4.0), expected, rtol=1e-9)


def test_the_high_pass_filter_is_a_critically_damped_oscillator():
    """Its acceleration under straight lines, by SciPy; it leaves no velocity behind."""
    t, corner = DT * np.arange(N), 0.1
    x = np.sin(2 * t) * np.exp(-0.5 * t) + 0.3 * (t < 5)
    x[0] = 0.0
    w = 2 * np.pi * corner
    oscillator = signal.TransferFunction([1, 0, 0], [1, 2 * w, w**2])
    expected = signal.lsim(oscillator, x, t)[1]  # exact for straight lines
    filtered = jax.jit(high_passed)
    np.testing.assert_allclose(filtered(x, DT, corner), expected, atol=1e-10)
    long = filtered(np.pad(x, (0, 4000)), DT, corner)
    assert abs(float(integrate.trapezoid(long, dx=DT))) < 1e-10
