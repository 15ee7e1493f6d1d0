"""Ground motions: the peak and the spectrum that are drawn are the record's."""

import jax
import numpy as np
import pytest
from matplotlib.figure import Figure

import jaxpound as jp
from jaxpound.plots import records as record_plots

TIME = np.arange(0, 10, 0.02)
RECORD = jp.Record(0.3 * np.exp(-((TIME - 4) ** 2)) * np.sin(6 * TIME), dt=0.02, name="burst")


def test_accelerogram_marks_the_peak():
    ax = Figure().add_subplot()
    assert record_plots.accelerogram(RECORD, ax) is ax
    (series, peak) = ax.lines
    np.testing.assert_array_equal(series.get_ydata(), RECORD.samples)
    np.testing.assert_allclose(series.get_xdata(), TIME)
    assert np.abs(peak.get_ydata()[0]) == pytest.approx(float(jp.pga(RECORD)))
    assert f"{float(jp.pga(RECORD)):.3g}" in peak.get_label()
    assert "(s)" in ax.get_xlabel()
    assert " s" in peak.get_label()
    assert "($g$)" in ax.get_ylabel()


def test_an_accelerogram_of_a_pulse_and_noise_is_drawn_on_a_grid():
    noise = jp.FilteredNoise(jp.KanaiTajimi(15.0, 0.6), 200, 0.02, time_unit="s")
    motion = jp.Pulse(0.5, 1.0, 2.0, time_unit="s") + noise.draw(np.ones(200))
    ax = record_plots.accelerogram(motion, Figure().add_subplot(), jp.TimeGrid(0.01, 500))
    series = ax.lines[0]
    np.testing.assert_allclose(series.get_xdata(), 0.01 * np.arange(501))
    np.testing.assert_allclose(series.get_ydata(), motion.acceleration(series.get_xdata()))
    assert "(s)" in ax.get_xlabel()


def test_axes_say_the_record_s_unit_of_time():
    record = jp.Scales(mass=1e5, frequency=4.0).to_dimensionless(RECORD)
    time = record_plots.accelerogram(record, Figure().add_subplot()).get_xlabel()
    period = record_plots.spectra({"a": record}, Figure().add_subplot(), [1.0]).get_xlabel()
    assert time == r"time $t$ ($1/\omega_1$)"
    assert period == r"natural period $T$ ($1/\omega_1$)"
    with pytest.raises(ValueError, match=r"records: Record.* must be in the same unit of"):
        record_plots.spectra({"a": record, "b": RECORD})


def test_wrong_arguments_are_named():
    for call, message in (
        (lambda: record_plots.spectra({}), "must hold at least one record"),
        (lambda: record_plots.spectra(RECORD), "records = .* must be of type"),
        (lambda: record_plots.spectra({"a": 3}), r"records\['a'\] = 3 must be of type Record"),
        (lambda: record_plots.spectra({"a": RECORD}, periods=[0, 1]), "must be positive"),
        (lambda: record_plots.spectra({"a": RECORD}, damping=1), "damping = 1 must be at least 0"),
        (lambda: record_plots.accelerogram(jp.paper.ground()), "must be a TimeGrid for a Ricker"),
        (lambda: record_plots.accelerogram(3), "record = 3 must have acceleration"),
    ):
        with pytest.raises(ValueError, match=message):
            call()


def test_spectra_are_the_spectral_accelerations():
    ax, periods = Figure().add_subplot(), [0.3, 1.0, 2.5]
    half = jp.Record(RECORD.samples / 2, dt=0.02)
    found = record_plots.spectra(
        {"whole": RECORD, "half": half}, ax, periods, damping=0.1, marks={"left": 1.0}
    )
    assert found is ax
    whole, halved, mark = ax.lines
    expected = jax.jit(lambda period: jp.spectral_acceleration(RECORD, period=period, damping=0.1))
    for period, value in zip(periods, whole.get_ydata(), strict=True):
        assert value == pytest.approx(float(expected(period)))
    np.testing.assert_allclose(halved.get_ydata(), whole.get_ydata() / 2)
    assert mark.get_xdata()[0] == 1.0
    assert "10 %" in ax.get_ylabel()
    ax.figure.draw_without_rendering()
