"""Ground motions: the peak, the spectra, their mean and target that are drawn are their own."""

import jax
import numpy as np
import pytest

import jaxpound as jp
from jaxpound.plots.records import accelerogram, spectra, suite_spectra
from tests.ground.test_scaling import TARGET, scaled
from tests.ground.test_suite import SUITE
from tests.plots.runs import legend, new_axes
from tests.refusals import refusals

TIME = np.arange(0, 10, 0.02)
RECORD = jp.Record(0.3 * np.exp(-((TIME - 4) ** 2)) * np.sin(6 * TIME), dt=0.02, name="burst")
DIMENSIONLESS = jp.Scales(mass=1e5, frequency=4.0).to_dimensionless(RECORD)


def test_accelerogram_marks_the_peak_and_axes_say_the_unit_of_time(ax):
    assert accelerogram(RECORD, ax) is ax
    series, peak = ax.lines
    np.testing.assert_array_equal(series.get_ydata(), RECORD.samples)
    np.testing.assert_allclose(series.get_xdata(), TIME)
    assert np.abs(peak.get_ydata()[0]) == pytest.approx(float(jp.pga(RECORD)))
    for words in (f"{float(jp.pga(RECORD)):.3g}", " s"):
        assert words in peak.get_label()
    assert "($g$)" in ax.get_ylabel()
    noise = jp.FilteredNoise(jp.KanaiTajimi(15.0, 0.6), 200, 0.02, time_unit="s")
    motion = jp.Pulse(0.5, 1.0, 2.0, time_unit="s") + noise.draw(np.ones(200))
    on_grid = accelerogram(motion, new_axes(), jp.TimeGrid(0.01, 500))
    t, acceleration = on_grid.lines[0].get_data()
    np.testing.assert_allclose(t, 0.01 * np.arange(501))
    np.testing.assert_allclose(acceleration, motion.acceleration(t))
    assert "(s)" in ax.get_xlabel()
    assert "(s)" in on_grid.get_xlabel()
    time = accelerogram(DIMENSIONLESS, new_axes()).get_xlabel()
    period = spectra({"a": DIMENSIONLESS}, new_axes(), [1.0]).get_xlabel()
    assert time == r"time $t$ ($1/\omega_1$)"
    assert period == r"natural period $T$ ($1/\omega_1$)"


test_wrong_arguments_are_named = refusals(
    (
        spectra,
        {"a": DIMENSIONLESS, "b": RECORD},
        r"records\['b'\] = .* in the same unit of time as",
    ),
    (spectra, {}, "must hold at least one record"),
    (spectra, RECORD, "records = .* must be of type"),
    (spectra, {"a": 3}, r"records\['a'\] = 3 must be of type Record"),
    (lambda: spectra({"a": RECORD}, periods=[0, 1]), "must be positive"),
    (lambda: spectra({"a": RECORD}, damping=1), "damping = 1 must be at least 0"),
    (accelerogram, jp.paper.ground(), "must be a TimeGrid for a Ricker"),
    (accelerogram, 3, "record = 3 must have acceleration"),
    (suite_spectra, SUITE[0], r"suite = .* must be of type"),
)


def test_spectra_are_the_spectral_accelerations_with_their_mean_and_target(ax):
    periods, half = [0.3, 1.0, 2.5], jp.Record(RECORD.samples / 2, dt=0.02)
    both, options = {"whole": RECORD, "half": half}, {"damping": 0.1, "marks": {"left": 1.0}}
    assert spectra(both, ax, periods, **options) is ax
    whole, halved, mark = ax.lines
    expected = jax.jit(lambda period: jp.spectral_acceleration(RECORD, period=period, damping=0.1))
    assert list(whole.get_ydata()) == pytest.approx([float(expected(x)) for x in periods])
    np.testing.assert_allclose(halved.get_ydata(), whole.get_ydata() / 2)
    assert mark.get_xdata()[0] == 1.0
    assert "10 %" in ax.get_ylabel()
    ax.figure.draw_without_rendering()
    found, ax = scaled((1e-3, 1e3)), new_axes()
    assert suite_spectra(found, ax) is ax
    *records, mean, target, share = ax.lines
    at = records[0].get_xdata()
    expected = found.suite.spectra(at)
    np.testing.assert_allclose([line.get_ydata() for line in records], expected)
    np.testing.assert_allclose(mean.get_ydata(), expected.mean(axis=0))
    np.testing.assert_allclose(target.get_ydata(), TARGET.at(target.get_xdata()))
    np.testing.assert_allclose(share.get_xdata()[[0, -1]], found.range)
    assert legend(ax) == ["3 records", "their mean", "target", "90 % of it", "period range"]
    ax.figure.draw_without_rendering()
    ax = suite_spectra(SUITE, new_axes(), periods=[0.1, 0.5, 1.0], damping=0.1)
    np.testing.assert_allclose(ax.lines[0].get_ydata(), SUITE.spectra([0.1, 0.5, 1.0], 0.1)[0])
    assert "10 %" in ax.get_ylabel()
    assert "(s)" in ax.get_xlabel()
