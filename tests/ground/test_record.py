"""Records: their straight lines, their signal processing, what they refuse."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import cumulative_trapezoid

import jaxpound as jp
from tests.ground.motions import RECORD, SAMPLES
from tests.refusals import refusals

# Few lengths, since each is another compiled program.
finite_samples = st.sampled_from([2, 3, 12]).flatmap(
    lambda n: st.lists(st.floats(-10, 10), min_size=n, max_size=n).map(np.array)
)
accelerations = jax.jit(jp.Record.acceleration)
cleaned = [jax.jit(method) for method in (jp.Record.without_mean, jp.Record.detrended)]


@given(finite_samples, st.floats(0.01, 3), st.data())
def test_record_is_linear_between_its_samples_and_runs_out_within_one(samples, dt, data):
    n = len(samples)
    record, at, knots = jp.Record(samples, dt), dt * np.arange(n), np.arange(-1, n + 1)
    np.testing.assert_allclose(accelerations(record, at), samples, rtol=1e-12, atol=1e-12)
    place = np.array(data.draw(st.lists(st.floats(-3, n + 3), min_size=8, max_size=8)))
    expected = np.interp(place, knots, np.pad(samples, 1))
    np.testing.assert_allclose(accelerations(record, place * dt), expected, rtol=1e-11, atol=1e-11)


def test_a_record_ends_in_rest_keeps_single_precision_and_takes_counts():
    t = np.array([-1e9, -0.5, -0.25, 0.0, 1.5, 1.75, 2.0, 1e9])
    expected = [0, 0, 0.25, 0.5, 2.0, 1.0, 0, 0]
    np.testing.assert_allclose(RECORD.acceleration(t), expected, atol=1e-15)
    assert (RECORD.duration, RECORD.n_samples) == (1.5, 4)
    record = jp.Record(SAMPLES.astype(np.float32), np.float32(0.5))
    accelerations = record.acceleration(jnp.array([0.25, 0.75], jnp.float32))
    assert accelerations.dtype == jnp.float32
    np.testing.assert_allclose(accelerations, [0.75, -1.0], rtol=1e-6)
    derived = [record.scaled_to_pga(np.float64(2.0)), record.resampled(0.25), record.resampled(1.0)]
    derived += [record.without_mean(), record.detrended(), record.high_passed(0.7, order=1)]
    assert {one.samples.dtype for one in derived} == {np.dtype(np.float32)}
    # Counts do not overflow.
    for dtype in (np.int16, np.int64, np.uint16):
        counts = np.array([0, 30_000, 20_000, 30_000], dtype)
        record, same = jp.Record(counts, 0.5), jp.Record(counts.astype(float), 0.5)
        assert jp.ground.arias_intensity(record) == jp.ground.arias_intensity(same)
        assert jp.ground.pgv(record) == jp.ground.pgv(same)
        np.testing.assert_array_equal((2 * record).acceleration(1.0), 40_000)
    # A finer record ends with its last sample.
    long = jp.Record(np.sin(np.arange(2000, dtype=np.float32)), np.float32(0.01))
    assert long.resampled(0.005).n_samples == 3999


BAD_RECORDS = [
    (([[1.0, 2.0]], 0.1), r"acceleration of shape \(1, 2\) must be one-dimensional"),
    (([1.0], 0.1), r"acceleration of shape \(1,\) must be one-dimensional with at least two"),
    ((1.0, 0.1), r"acceleration of shape \(\)"),
    (([1.0, np.nan], 0.1), r"acceleration = nan \(at index \[1\]\) must be finite"),
    (([1.0, 1j], 0.1), "acceleration = .* must be a real number"),
    ((None, 0.1), "acceleration = None must be a real number"),
    (([1.0, 2.0], 0.1, 9.81), r"name = 9\.81 must be a string"),
    (([1.0, 2.0], 0.1, "", "ms"), "time_unit = 'ms' must be 's' or '1/ω1'"),
    (([1.0, 2.0], 0.1, "", None), "time_unit = None must be 's' or '1/ω1'"),
]
BAD_STEPS = [
    (0, "dt = 0 must be positive and finite"),
    (-0.1, r"dt = -0\.1 must be positive"),
    (np.nan, "dt = nan must be positive"),
    (None, "dt = None must be a real number"),
    ([0.1, 0.2], r"dt of shape \(2,\) must be one number"),
    (np.inf, "dt = inf must be positive"),
    ("1", "dt = '1' must be a real number"),
]
BAD_STEPS_OF_ANOTHER = [
    (2**0.5 / 2, r"dt = 0\.707106.* must be a ratio of whole numbers"),
    (2.0, r"dt = 2 must be at most the record's duration, 1\.5"),
]
HIGH_PASS = r"Record\.high_passed:"
BAD_CORNERS = [
    (0, "0 must be positive"),
    (-1.0, "-1 must be positive"),
    (np.nan, "nan must be positive"),
    ("1", "'1' must be a real number"),
    (1.0, r"1 must be at least 1 / duration = 0\.6667 and below the Nyquist frequency, 1$"),
    (0.6, r"0\.6 must be at least 1 / duration = 0\.6667"),
]
BAD_PEAKS = [0, -1, np.nan, np.inf, "1", None, True, [1.0, 2.0]]
test_bad_values_are_refused = refusals(
    *((jp.Record, *values, f"^Record: {message}") for values, message in BAD_RECORDS),
    *((jp.Record, [1.0, 2.0], dt, f"^Record: {message}") for dt, message in BAD_STEPS),
    *(
        (RECORD.resampled, dt, rf"^Record\.resampled: {message}")
        for dt, message in BAD_STEPS + BAD_STEPS_OF_ANOTHER
    ),
    *((RECORD.scaled_to_pga, pga, r"^Record\.scaled_to_pga: pga ") for pga in BAD_PEAKS),
    (jp.Record([0.0, 0.0], 0.1).scaled_to_pga, 1.0, "own peak = 0 must be positive"),
    *(
        (RECORD.high_passed, corner, f"^{HIGH_PASS} corner = {rule}")
        for corner, rule in BAD_CORNERS
    ),
    (RECORD.high_passed, 0.8, 0, f"^{HIGH_PASS} order = 0 must be a positive whole number"),
    (RECORD.high_passed, 0.8, 11, f"^{HIGH_PASS} order = 11 must be at most 10"),
    (jax.jit(lambda r: r.high_passed(0.8).samples), RECORD, f"{HIGH_PASS} corner and the record"),
    (jax.jit(lambda x: RECORD.high_passed(x).samples), 0.8, "record must not be traced"),
    (jax.jit(lambda r: r.resampled(0.25).samples), RECORD, "cannot be traced"),
    (lambda: jp.Record([1.0, 2.0], 0.02, units="yd/s2"), "units = 'yd/s2' must be one of g, m/s2"),
)


def test_records_keep_their_unit_of_time():
    for time_unit, unit in (("s", "s"), ("1/ω1", "1/ω1"), ("1/omega1", "1/ω1")):
        record = jp.Record(SAMPLES, 0.5, "quake", time_unit=time_unit)
        derived = [record, record.scaled_to_pga(1.0), record.detrended()]
        derived += [record.without_mean(), record.high_passed(0.7, order=1)]
        derived += [record.resampled(0.25), record.resampled(1.0)]
        derived += [jax.tree.map(lambda x: 2 * x, record), jax.jit(lambda r: r)(record)]
        assert {x.time_unit for x in derived} == {unit}
        assert all(f"dt = {float(x.dt):.6g} {unit}, duration" in repr(x) for x in derived)
    other = jp.Record(SAMPLES, 0.5, time_unit="1/ω1")
    assert (jp.Ricker(1, 1, 1) + other - 2 * other).acceleration(0.0) is not None
    with pytest.raises(ValueError, match=r"Sum: grounds, record 2 = Record\(.* in the same unit"):
        RECORD + jp.Ricker(1, 1, 1) + 2 * other


@given(finite_samples.filter(lambda x: np.abs(x).max() > 1e-3), st.floats(1e-3, 10))
def test_scaled_record_has_the_pga_asked_for_and_the_same_shape(samples, pga):
    record = jp.Record(samples, 0.1, "quake").scaled_to_pga(pga)
    assert jp.pga(record) == pytest.approx(pga, rel=1e-12)
    peak = np.abs(samples).max()
    np.testing.assert_allclose(record.samples, samples * pga / peak, rtol=1e-12, atol=1e-300)
    assert (record.dt, record.name) == (0.1, "quake")


@given(finite_samples, st.floats(-5, 5), st.floats(-5, 5))
def test_baseline_correction_is_least_squares(samples, offset, slope):
    i = np.arange(len(samples))
    line = slope * np.linspace(0, 1, len(samples))
    for correct, added, degree in zip(cleaned, (offset, offset + line), (0, 1), strict=True):
        corrected = correct(jp.Record(samples, 0.1, "quake"))
        fit = np.polynomial.Polynomial.fit(i, samples, degree)
        np.testing.assert_allclose(corrected.samples, samples - fit(i), atol=1e-11)
        assert abs(corrected.samples.mean()) < 1e-12
        for same in (jp.Record(samples + added, 0.1), corrected):
            again = correct(same)
            np.testing.assert_allclose(again.samples, corrected.samples, atol=1e-12)


def displacement(record):
    """Of the ground, in g s², by the trapezoidal rule."""
    velocity = cumulative_trapezoid(record.samples, dx=record.dt, initial=0)
    return cumulative_trapezoid(velocity, dx=record.dt, initial=0)


def test_a_high_pass_keeps_fast_motion_in_phase_and_removes_slow_motion_and_offset():
    t = 0.01 * np.arange(4001)
    fast, slow, middle = np.sin(2 * np.pi * 2.0 * t), np.sin(2 * np.pi * 0.05 * t), slice(500, -500)
    record = jp.Record(0.3 * (fast + 0.5 * slow), 0.01)
    np.testing.assert_allclose(
        record.high_passed(0.4).samples[middle], 0.3 * fast[middle], atol=3e-4
    )
    # At the corner each of the two runs leaves 1/√2; below it both of them act.
    for order in (1, 2, 4):
        for corner in (2.0, 10.0):
            ratio = np.tan(np.pi * corner * 0.01) / np.tan(np.pi * 2.0 * 0.01)  # bilinear transform
            left = 1 / (1 + ratio ** (2 * order))
            passed = jp.Record(fast, 0.01).high_passed(corner, order).samples[middle]
            np.testing.assert_allclose(passed, left * fast[middle], atol=0.01 * left)
    shaking = np.exp(-(((t - 20) / 5) ** 2)) * fast
    clean = jp.Record(0.3 * shaking, 0.01)
    with pytest.warns(jp.PlausibilityWarning, match="the mean acceleration, 0.02 g, is 6.3% of"):
        raw = jp.Record(clean.samples + 0.02, 0.01)
    moved = np.abs(displacement(clean)).max()
    assert np.abs(displacement(raw)).max() > 1000 * moved
    for made in (raw.without_mean(), raw.detrended(), raw.high_passed(0.2)):
        assert np.abs(displacement(made)).max() < 1.05 * moved
        np.testing.assert_allclose(made.samples, clean.samples, atol=1e-3)


def test_a_record_notes_what_was_removed_and_what_is_made_of_it_has_these_notes():
    record = jp.Record(SAMPLES + 0.125, 0.5, "quake")
    made = record.without_mean().high_passed(0.7, order=1).detrended()
    notes = "mean of 0.25 g removed", "high-pass at 0.7 Hz (Butterworth, order 1, acausal)"
    notes += ("least-squares line removed",)
    assert (record.notes, made.notes) == ((), notes)
    assert repr(made).endswith(f" g, {', '.join(notes)})")
    for later in (made.scaled_to_pga(1.0), made.resampled(0.25), made.resampled(1.0)):
        assert (later.notes, later.name) == (notes, "quake")
    assert made.dimensionless(2.0).high_passed(0.35).notes[3].startswith("high-pass at 0.35 cycles")
    assert next(iter(jp.RecordSuite([made]).scaled(2.0))).notes == notes
    traced = []
    jax.eval_shape(lambda x: traced.append(jp.Record(x, 0.5).without_mean().notes), SAMPLES)
    assert traced == [("mean removed",)]


def test_gradients_pass_the_removal_of_a_mean_and_of_a_line():
    n = np.arange(4)
    for correct, degree in zip(cleaned, (0, 1), strict=True):
        slope = jax.jacobian(lambda x, f=correct: f(jp.Record(x, 0.5)).samples)(SAMPLES)
        fit = np.linalg.pinv(np.vander(n, degree + 1))
        np.testing.assert_allclose(slope, np.eye(4) - np.vander(n, degree + 1) @ fit, atol=1e-12)


@pytest.mark.parametrize("parts", [1, 2, 5, 7])
def test_finer_record_is_the_same_motion(parts):
    t, finer = np.linspace(0.0, 1.5, 333), RECORD.resampled(0.5 / parts)
    assert (finer.n_samples, finer.name) == (3 * parts + 1, "quake")
    np.testing.assert_allclose(finer.samples[::parts], SAMPLES, rtol=1e-14)
    of_both = (record.acceleration(t) for record in (finer, RECORD))
    np.testing.assert_allclose(*of_both, rtol=1e-12, atol=1e-12)


def test_coarser_record_keeps_slow_motion_and_loses_fast_motion():
    t = 0.01 * np.arange(4001)
    slow, fast = np.sin(2 * np.pi * 0.5 * t), np.sin(2 * np.pi * 20.0 * t)
    # At dt = 0.04 the fast sine lies above the Nyquist frequency, 12.5: sampled it would alias.
    coarse = jp.Record(slow + fast, 0.01, units="g").resampled(0.04)
    assert (coarse.dt, coarse.n_samples) == (0.04, 1001)
    middle = slice(25, -25)
    np.testing.assert_allclose(coarse.samples[middle], slow[::4][middle], atol=5e-3)
    assert np.abs((slow + fast)[::4] - slow[::4])[middle].max() > 0.5
    coarse = jp.Record(np.sin(t[:3771]), 0.01).resampled(0.025)  # at a ratio of whole numbers
    expected = np.sin(0.025 * np.arange(coarse.n_samples))
    np.testing.assert_allclose(coarse.samples[20:-20], expected[20:-20], atol=2e-3)


def test_record_is_a_pytree_of_samples_and_interval_that_can_always_be_printed():
    leaves = jax.tree_util.tree_leaves_with_path(RECORD)
    assert [jax.tree_util.keystr(path) for path, _ in leaves] == [".samples", ".dt"]
    gradient = jax.grad(lambda r: r.acceleration(0.75))(RECORD)
    assert type(gradient) is jp.Record
    np.testing.assert_allclose(gradient.samples, [0, 0.5, 0.5, 0])
    # The later the samples come the earlier on the line is t: ∂(t/dt)/∂dt = −t/dt² = −3.
    assert gradient.dt == pytest.approx(-3 * (-3.0 - 1.0))
    with pytest.raises(dataclasses.FrozenInstanceError):
        RECORD.dt = 1.0
    corrected = RECORD.detrended()
    np.testing.assert_allclose(cleaned[1](RECORD).samples, corrected.samples, atol=1e-14)
    assert corrected.name == RECORD.without_mean().name == "quake"
    for leaf in (None, object(), 0, "text", jnp.ones((2, 3))):
        assert "Record(" in repr(jax.tree.map(lambda _, leaf=leaf: leaf, RECORD))
    assert "'quake', 4 samples, dt = 0.5" in repr(RECORD)


T = 0.02 * np.arange(500)
BURST = np.sin(7 * T) * np.exp(-((T - 4) ** 2))  # of one


def test_a_record_in_other_units_is_in_g():
    for units, size in {"m/s2": 9.80665, "cm/s^2": 980.665, "gal": 980.665, "g": 1.0}.items():
        record = jp.Record(3.0 * size * BURST, 0.02, units=units)  # 3 g are stated: no warning
        np.testing.assert_allclose(record.samples, 3.0 * BURST, rtol=1e-12)
        single = jp.Record((size * BURST).astype(np.float32), 0.02, units=units)
        assert single.samples.dtype == np.float32
        assert jax.tree.structure(record) == jax.tree.structure(jp.Record(BURST, 0.02))


def test_a_record_that_states_no_units_is_warned_of_where_it_may_be_in_other_ones():
    rule = r"Record: no unit is stated, and in g the peak is 2\.9\d* g: state units=.m/s2"
    with pytest.warns(jp.PlausibilityWarning, match=rule) as caught:
        record = jp.Record(3.0 * BURST, 0.02)  # 0.3 g in m/s²
    assert caught[0].filename == __file__
    # What is made of it has been warned of; others are in g, or few made-up numbers.
    record.scaled_to_pga(4.0).resampled(0.01).detrended()
    jp.RecordSuite([record]).scaled(1.5)
    jp.Record(1.4 * BURST, 0.02)
    jp.Record(0.0 * BURST, 0.02)
    jp.Record(3.0 * BURST[:80], 0.02)
    jp.Record(3.0 * BURST, 0.02, time_unit="1/ω1")
    jax.jit(lambda x: jp.Record(x, 0.02).acceleration(1.0))(3.0 * BURST)


def test_a_sample_alone_is_told_by_its_place_and_value(tmp_path):
    damaged = 0.3 * BURST
    damaged[123] = -19.0
    rule = r"acceleration\[123\] = -19 g, at 2\.46 s, stands alone, 18\.\d+ g beyond the samples"
    with pytest.warns(jp.PlausibilityWarning, match=f"^Record: {rule}"):
        jp.Record(damaged, 0.02, units="g")
    path = tmp_path / "quake.txt"
    np.savetxt(path, damaged, fmt="%.6f", header="acceleration (g)")
    with pytest.warns(jp.PlausibilityWarning, match=rf"quake\.txt: {rule}"):
        jp.read_record(path, dt=0.02)
