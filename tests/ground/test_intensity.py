"""Measures of intensity and the response spectrum against closed forms, and their names."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, strategies
from jax.test_util import check_grads
from scipy.integrate import solve_ivp

import jaxpound as jp
from jaxpound.ground.measure import Measure, measure_unit, units_like
from tests.ground.motions import RECORD, SAMPLES, sine
from tests.refusals import refused


@given(strategies.floats(0.01, 3), strategies.floats(0.5, 5))
def test_measures_of_a_sine_are_the_closed_forms(amplitude, omega):
    periods, per_period = 3, 800
    dt = 2 * np.pi / omega / per_period
    samples = amplitude * np.sin(omega * dt * np.arange(periods * per_period + 1))
    record = jp.Record(samples, dt, units="g")
    duration = periods * 2 * np.pi / omega
    assert record.duration == pytest.approx(duration)
    assert jp.pga(record) == pytest.approx(amplitude, rel=1e-12)
    # From rest u' = (A/ω)(1 − cos ωt).
    assert jp.ground.pgv(record) == pytest.approx(2 * amplitude / omega, rel=1e-4)
    arias = np.pi / 2 * amplitude**2 * duration / 2
    assert jp.ground.arias_intensity(record) == pytest.approx(arias, rel=1e-4)
    assert jp.ground.pgv(record, gravity=9.81) == pytest.approx(
        9.81 * 2 * amplitude / omega, rel=1e-4
    )
    assert jp.ground.arias_intensity(record, gravity=9.81) == pytest.approx(9.81 * arias, rel=1e-4)


def test_measures_of_functions_are_taken_on_the_grid():
    grid = jp.TimeGrid(0.001, 5000)
    # ∫ sin² 2t dt over [0, 5] = 5/2 − sin(20)/8
    arias = np.pi / 2 * 0.09 * (2.5 - np.sin(20) / 8)
    measures = jp.pga, jp.ground.pgv, jp.ground.arias_intensity
    of_sine = jax.jit(lambda: [measure(sine, grid) for measure in measures])()
    assert of_sine == pytest.approx([0.3, 0.3, arias], rel=1e-5)
    assert jp.pga(2 * RECORD, jp.TimeGrid(0.5, 3)) == 6.0
    fine = jp.TimeGrid(0.0005, 40_000)

    @jax.jit
    def of_wavelets(ground):
        return jp.ground.pgv(ground, fine), abs(ground.velocity(fine.times())).max()

    pgv, largest = of_wavelets(jp.paper.ground())
    assert pgv == pytest.approx(float(largest), rel=1e-3)


@pytest.mark.parametrize("measure", [jp.pga, jp.ground.pgv, jp.ground.arias_intensity])
def test_measures_work_batched_and_ask_for_a_grid_where_they_need_one(measure):
    factors = jnp.array([1.0, 2.0])
    batch = jax.jit(jax.vmap(lambda k: measure(jp.Record(k * SAMPLES, 0.5))))(factors)
    single = [measure(RECORD), measure(RECORD.scaled_to_pga(6.0))]
    np.testing.assert_allclose(batch, single, rtol=1e-12)
    for ground in (sine, jp.Ricker(1, 1, 1), 2 * RECORD):
        refused("grid = None must be a TimeGrid", measure, ground)
    refused(r"grid = 0\.1 must be a TimeGrid", measure, sine, 0.1)


def test_spectral_accelerations_of_a_sudden_force_and_a_stiff_oscillator():
    """u'' = −1 from t = 0: x rises to (1 + e^(−πζ/√(1 − ζ²))) / ω²."""
    record = jp.Record(-np.ones(2001), 0.002, time_unit="1/ω1")
    spectrum = jax.jit(lambda of, p, zeta: jp.spectral_acceleration(of, period=p, damping=zeta))
    for period, damping in ((1.0, 0.05), (0.5, 0.0), (3.0, 0.3)):
        found = spectrum(record, period, damping)
        over = np.exp(-np.pi * damping / np.sqrt(1 - damping**2))
        assert float(found) == pytest.approx(1 + over, rel=1e-12)
    record = jp.Record(np.sin(np.linspace(0, 6, 400)), 0.02)
    assert float(spectrum(record, 0.01, 0.05)) == pytest.approx(1.0, rel=1e-2)


def test_spectral_acceleration_and_its_slopes_are_exact_at_any_step():
    """Against a fine integration of the same straight lines, peaks between samples included."""
    record = jp.Record(np.random.default_rng(0).normal(size=60), 0.1)
    spectrum = jax.jit(lambda period: jp.spectral_acceleration(record, period=period))
    for period in (0.15, 0.4, 1.3):
        w = 2 * np.pi / period

        def motion(t, y, w=w):
            a = np.interp(t, 0.1 * np.arange(60), record.samples)
            return [y[1], -2 * 0.05 * w * y[1] - w**2 * y[0] - a]

        times = np.linspace(0, 0.1 * 59, 59 * 400 + 1)
        fine = {"t_eval": times, "max_step": 0.02, "rtol": 1e-9, "atol": 1e-12}
        exact = solve_ivp(motion, (0, times[-1]), [0, 0], **fine)
        assert float(spectrum(period)) == pytest.approx(w**2 * np.abs(exact.y[0]).max(), rel=1e-6)
    record = jp.Record(np.random.default_rng(1).normal(size=60), 0.1)
    spectrum = jax.jit(lambda p: jp.spectral_acceleration(record, period=p[0], damping=p[1]))
    at = np.array([0.9, 0.05])
    check_grads(spectrum, (at,), order=2, modes=["fwd"], eps=1e-5, rtol=1e-5)


def test_spectral_acceleration_traces_and_refuses_bad_periods():
    record = jp.Record(np.sin(np.linspace(0, 6, 50)), 0.1)
    of_period = jax.jit(jax.vmap(lambda p: jp.spectral_acceleration(record, period=p)))
    spectrum = of_period(np.array([0.5, -1.0]))
    assert float(spectrum[0]) == pytest.approx(float(jp.spectral_acceleration(record, period=0.5)))
    assert np.isnan(spectrum[1])
    of_record = partial(jp.spectral_acceleration, record)
    refused("period = 0 must be positive", of_record, period=0.0)
    refused("damping = 1 must be at least 0 and below 1", of_record, period=1.0, damping=1.0)


@pytest.mark.parametrize(
    ("text", "words", "unit", "name", "period"),
    [
        ("PGA (g)", "PGA", "g", "PGA", None),
        ("peak ground acceleration (m/s2)", "peak ground acceleration", "m/s²", "PGA", None),
        ("PGA, rock [cm/s^2]", "PGA, rock", "cm/s²", "PGA", None),
        ("PGV (g/ω1)", "PGV", "g/ω1", "PGV", None),
        ("PGV (cm/s)", "PGV", "cm/s", "PGV", None),
        ("SA(0.2)", "SA(0.2)", "", "Sa", (0.2, "s")),
        ("Sa(0.9 s) (g)", "Sa(0.9 s)", "g", "Sa", (0.9, "s")),
        ("Sa(0.9 1/ω1) (g)", "Sa(0.9 1/ω1)", "g", "Sa", (0.9, "1/ω1")),
        ("spectral acceleration at .5 s", "spectral acceleration at .5 s", "", "Sa", (0.5, "s")),
        ("Sa(T1 = 0.7 s) (gal)", "Sa(T1 = 0.7 s)", "gal", "Sa", (0.7, "s")),
        ("Sa(900 ms) (g)", "Sa(900 ms)", "g", "Sa", (0.9, "s")),
        ("Sa(T1) at 5 % (g)", "Sa(T1) at 5 %", "g", "Sa", None),
        ("Sa(15 %, 0.9 s) (g)", "Sa(15 %, 0.9 s)", "g", "Sa", (0.9, "s")),
        ("spectral_acceleration_1", "spectral_acceleration_1", "", "Sa", None),
        ("AvgSA (g)", "AvgSA", "g", "AvgSA", None),
        ("im", "im", "", "", None),
        ("sauce (kg)", "sauce (kg)", "", "", None),
    ],
)
def test_what_a_text_tells(text, words, unit, name, period):
    told = Measure.of_text(text)
    assert (told.words, told.unit, told.name, told.period) == (words, unit, name, period)


ALIKE = [("PGA (g)", "peak ground acceleration (m/s²)"), ("SA(0.9)", "Sa(0.9 s) (g)")]
ALIKE += [("Sa (g)", "Sa(0.9 s) (g)"), ("im", "PGA (g)"), ("shaking of the year", "PGA (g)")]
APART = [("PGA (g)", "PGV (g)"), ("PGA (g)", "Sa(0.9 s) (g)"), ("SA(0.87)", "Sa(0.9 s) (g)")]
APART += [("SA(0.9)", "Sa(0.9 1/ω1) (g)"), ("Sa(0.9 s, 2 %)", "Sa(0.9 s) (g)")]


@pytest.mark.parametrize("texts", ALIKE + APART)
def test_which_may_be_one(texts):
    left, right = map(Measure.of_text, texts)
    assert left.may_be(right) is right.may_be(left) is (texts in ALIKE)


def test_units_of_two_spellings_are_one():
    units = [Measure.of_text(f"PGA{x}").unit for x in (" (gal)", " (cm/s2)", " (g)", "")]
    sizes = [units_like(unit).get(unit) for unit in units]
    assert sizes[0] == sizes[1] not in (sizes[2], None)
    assert sizes[3] is None
    assert measure_unit("inches") == "" == measure_unit("g/12")
    assert set(units_like("cm/s")) == {"m/s", "cm/s"}
    spectral = Measure.spectral_acceleration(0.87, "s")
    assert Measure.of_text(str(spectral)) == spectral
