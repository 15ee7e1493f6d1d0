"""Noise of changing intensity and frequency against the sums that define it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import integrate, signal, stats

from jaxpound.ground.evolving import evolving_noise, high_passed, modulation

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


@pytest.mark.parametrize(("duration", "mid_time"), [(12.0, 8.0), (5.0, 20.0), (30.0, 7.0)])
def test_the_modulating_function_has_its_arias_intensity_duration_and_mid_time(duration, mid_time):
    t = np.linspace(0.0, 150.0, 60_001)
    q = np.asarray(jax.jit(modulation)(t, 0.05, duration, mid_time))
    grown = np.pi / 2 * integrate.cumulative_simpson(q**2, x=t, initial=0.0)
    assert grown[-1] == pytest.approx(0.05, rel=1e-4)
    early, middle, late = np.interp(np.array([0.05, 0.45, 0.95]) * 0.05, grown, t)
    assert late - early == pytest.approx(duration, rel=1e-3)
    assert middle == pytest.approx(mid_time, rel=1e-3)


def test_a_duration_out_of_reach_leaves_the_mid_time():
    """The modulating function is then that of an exponential density, the last without a pole."""
    t = np.array([0.5, 3.0, 20.0])
    scale = 4.0 / stats.expon.ppf(0.45)
    expected = np.sqrt(2 / np.pi * stats.expon.pdf(t, scale=scale))
    np.testing.assert_allclose(jax.jit(modulation)(t, 1.0, 30.0, 4.0), expected, rtol=1e-9)


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
