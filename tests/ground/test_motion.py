"""Ground motions: closed forms, records, sums and scalings, measures."""

import dataclasses
import math
import operator

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jax.test_util import check_grads
from scipy.integrate import solve_ivp

import jaxpound as jp
from jaxpound.ground.motion import excitation, sampled, velocity_and_bulge

GRID = jp.TimeGrid(0.1, 5)
SAMPLES = np.array([0.5, 1.0, -3.0, 2.0])
RECORD = jp.Record(SAMPLES, 0.5, "quake")

# Few lengths, since each is another compiled program.
finite_samples = st.sampled_from([2, 3, 12]).flatmap(
    lambda n: st.lists(st.floats(-10, 10), min_size=n, max_size=n).map(np.array)
)


def sine(t):
    return 0.3 * np.sin(2 * t)


def scalar_sine(t):
    return 0.3 * math.sin(2 * t)


def fails_with(error):
    def ground(t):
        raise error

    return ground


# Ricker wavelets


@given(
    st.floats(-2, 2),
    st.floats(0.3, 5),
    st.floats(-1, 6),
    st.floats(-2, 8),
)
def test_ricker_velocity_and_acceleration_are_derivatives(amplitude, period, arrival, t):
    wavelet = jp.Ricker(amplitude, period, arrival)
    size = abs(amplitude) * (np.pi / period) ** 2
    np.testing.assert_allclose(
        wavelet.velocity(t), jax.grad(wavelet.displacement)(t), rtol=1e-10, atol=1e-13 * size
    )
    np.testing.assert_allclose(
        wavelet.acceleration(t), jax.grad(wavelet.velocity)(t), rtol=1e-10, atol=1e-13 * size
    )


def test_ricker_by_hand():
    wavelet = jp.Ricker(0.5, np.pi, 2.0)  # a = 1
    assert wavelet.displacement(2.0) == pytest.approx(-0.5)
    assert wavelet.velocity(2.0) == 0
    assert wavelet.acceleration(2.0) == pytest.approx(3.0)
    assert wavelet.displacement(3.0) == pytest.approx(0.5 / np.e)
    assert wavelet.velocity(3.0) == pytest.approx(1.0 / np.e)
    assert wavelet.velocity(1.0) == pytest.approx(-1.0 / np.e)
    assert wavelet.acceleration(3.0) == pytest.approx(-5.0 / np.e)
    # At half the period the same point of the wavelet is four times as sharp.
    assert jp.Ricker(0.5, np.pi / 2, 2.0).acceleration(2.5) == pytest.approx(-20.0 / np.e)


@pytest.mark.parametrize("quantity", ["displacement", "velocity", "acceleration"])
def test_ricker_is_the_sum_of_its_wavelets(quantity):
    t = np.linspace(0, 6, 25)
    of = operator.methodcaller(quantity, t)
    periods, arrivals = [1.25, 1, 2], [1.5, 2, 3]
    one_by_one = [jp.Ricker(0.5, tp, ts) for tp, ts in zip(periods, arrivals, strict=True)]
    together = of(jp.Ricker(0.5, periods, arrivals))
    np.testing.assert_allclose(together, sum(map(of, one_by_one)), rtol=1e-12, atol=1e-14)
    # One amplitude for all is that amplitude for each.
    np.testing.assert_array_equal(together, of(jp.Ricker([0.5] * 3, periods, arrivals)))
    weighted = of(jp.Ricker([1.0, 0.0, -2.0], periods, arrivals))
    expected = 2 * of(one_by_one[0]) - 4 * of(one_by_one[2])
    np.testing.assert_allclose(weighted, expected, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("shape", [(), (1,), (4,), (2, 3), (0,)])
def test_motions_have_the_shape_of_time(shape):
    t = np.full(shape, 0.7)
    for ground in (jp.Ricker(0.5, [1, 2, 3], [1, 2, 3]), jp.Ricker(0.5, 1, 2), RECORD):
        for motion in (ground, 2 * ground, ground + ground):
            assert jax.eval_shape(motion.acceleration, t).shape == shape
        assert ground.acceleration(t).shape == shape


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ((0.5, [1, 2], [1]), r"periods of shape \(2,\) and arrivals of shape \(1,\)"),
        ((0.5, 1.0, [1]), r"periods of shape \(\) and arrivals of shape \(1,\)"),
        (([1, 2, 3], [1, 2], [1, 2]), r"amplitude of shape \(3,\) must be one number or"),
        ((0.5, np.ones((2, 2)), np.ones((2, 2))), r"periods of shape \(2, 2\) must be a number or"),
        ((0.5, [1, 0], [1, 2]), r"periods = 0 \(at index \[1\]\) must be positive and finite"),
        ((0.5, -1, 2), "periods = -1 must be positive and finite"),
        ((0.5, [1, np.inf], [1, 2]), "periods = inf"),
        ((0.5, [1, 2], [1, np.nan]), r"arrivals = nan \(at index \[1\]\) must be finite"),
        ((np.inf, 1, 2), "amplitude = inf must be finite"),
        ((None, 1, 2), "amplitude = None must be a real number"),
        ((0.5, "1", 2), "periods = '1' must be a real number"),
    ],
)
def test_ricker_refuses_bad_values(values, message):
    with pytest.raises(ValueError, match=f"^Ricker: {message}"):
        jp.Ricker(*values)


# Records


@given(finite_samples, st.floats(0.01, 3))
def test_record_is_exact_at_its_samples(samples, dt):
    record = jp.Record(samples, dt)
    t = dt * np.arange(len(samples))
    np.testing.assert_allclose(record.acceleration(t), samples, rtol=1e-12, atol=1e-12)


@given(finite_samples, st.floats(0.01, 3), st.data())
def test_record_is_linear_between_samples_and_runs_out_within_one(samples, dt, data):
    n = len(samples)
    place = np.array(data.draw(st.lists(st.floats(-3, n + 3), min_size=8, max_size=8)))
    knots, padded = np.arange(-1, n + 1), np.pad(samples, 1)
    np.testing.assert_allclose(
        jp.Record(samples, dt).acceleration(place * dt),
        np.interp(place, knots, padded),
        rtol=1e-11,
        atol=1e-11,
    )


def test_ground_is_at_rest_outside_the_record():
    t = np.array([-1e9, -0.5, -0.25, 0.0, 1.5, 1.75, 2.0, 1e9])
    expected = [0, 0, 0.25, 0.5, 2.0, 1.0, 0, 0]
    np.testing.assert_allclose(RECORD.acceleration(t), expected, atol=1e-15)
    assert RECORD.duration == 1.5
    assert RECORD.n_samples == 4


def test_record_keeps_single_precision():
    record = jp.Record(SAMPLES.astype(np.float32), np.float32(0.5))
    t = jnp.array([0.25, 0.75], jnp.float32)
    assert record.acceleration(t).dtype == jnp.float32
    np.testing.assert_allclose(record.acceleration(t), [0.75, -1.0], rtol=1e-6)
    for derived in (
        record.scaled_to_pga(np.float64(2.0)),
        record.baseline_corrected("mean"),
        record.baseline_corrected("linear"),
        record.resampled(0.25),
        record.resampled(1.0),
    ):
        assert derived.samples.dtype == np.float32


@pytest.mark.parametrize("dtype", [np.int16, np.int64, np.uint16])
def test_records_of_counts_do_not_overflow(dtype):
    counts = np.array([0, 30_000, 20_000, 30_000], dtype)
    record, same = jp.Record(counts, 0.5), jp.Record(counts.astype(float), 0.5)
    assert jp.arias_intensity(record) == jp.arias_intensity(same)
    assert jp.pgv(record) == jp.pgv(same)
    np.testing.assert_array_equal((2 * record).acceleration(1.0), 40_000)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (([[1.0, 2.0]], 0.1), r"acceleration of shape \(1, 2\) must be one-dimensional"),
        (([1.0], 0.1), r"acceleration of shape \(1,\) must be one-dimensional with at least two"),
        ((1.0, 0.1), r"acceleration of shape \(\)"),
        (([1.0, np.nan], 0.1), r"acceleration = nan \(at index \[1\]\) must be finite"),
        (([1.0, 1j], 0.1), "acceleration = .* must be a real number"),
        ((None, 0.1), "acceleration = None must be a real number"),
        (([1.0, 2.0], 0), "dt = 0 must be positive and finite"),
        (([1.0, 2.0], -0.1), r"dt = -0\.1 must be positive"),
        (([1.0, 2.0], np.nan), "dt = nan must be positive"),
        (([1.0, 2.0], None), "dt = None must be a real number"),
        (([1.0, 2.0], [0.1, 0.2]), r"dt of shape \(2,\) must be one number"),
        (([1.0, 2.0], 0.1, 9.81), r"name = 9\.81 must be a string"),
        (([1.0, 2.0], 0.1, "", "ms"), "time_unit = 'ms' must be 's' or '1/ω1'"),
        (([1.0, 2.0], 0.1, "", None), "time_unit = None must be 's' or '1/ω1'"),
    ],
)
def test_record_refuses_bad_values(values, message):
    with pytest.raises(ValueError, match=f"^Record: {message}"):
        jp.Record(*values)


@pytest.mark.parametrize(("given", "unit"), [("s", "s"), ("1/ω1", "1/ω1"), ("1/omega1", "1/ω1")])
def test_records_keep_their_unit_of_time(given, unit):
    record = jp.Record(SAMPLES, 0.5, "quake", time_unit=given)
    derived = [
        record,
        record.scaled_to_pga(1.0),
        record.baseline_corrected(),
        record.resampled(0.25),
        record.resampled(1.0),
        jax.tree.map(lambda x: 2 * x, record),
        jax.jit(lambda r: r)(record),
    ]
    assert {one.time_unit for one in derived} == {unit}
    assert all(f"dt = {float(one.dt):.6g} {unit}, duration" in repr(one) for one in derived)


def test_sums_of_records_in_two_units_of_time_are_refused():
    other = jp.Record(SAMPLES, 0.5, time_unit="1/ω1")
    assert (jp.Ricker(1, 1, 1) + other - 2 * other).acceleration(0.0) is not None
    with pytest.raises(ValueError, match=r"Sum: grounds: Record\(.* must be in the same unit"):
        RECORD + jp.Ricker(1, 1, 1) + 2 * other


@given(finite_samples.filter(lambda x: np.abs(x).max() > 1e-3), st.floats(1e-3, 10))
def test_scaled_record_has_the_pga_asked_for_and_the_same_shape(samples, pga):
    record = jp.Record(samples, 0.1, "quake").scaled_to_pga(pga)
    assert jp.pga(record) == pytest.approx(pga, rel=1e-12)
    peak = np.abs(samples).max()
    np.testing.assert_allclose(record.samples, samples * pga / peak, rtol=1e-12, atol=1e-300)
    assert (record.dt, record.name) == (0.1, "quake")


@pytest.mark.parametrize("bad", [0, -1, np.nan, np.inf, "1", None, True, [1.0, 2.0]])
def test_scaling_refuses_a_bad_pga(bad):
    with pytest.raises(ValueError, match=r"^Record\.scaled_to_pga: pga "):
        RECORD.scaled_to_pga(bad)


def test_scaling_refuses_a_silent_record():
    with pytest.raises(ValueError, match="own peak = 0 must be positive"):
        jp.Record([0.0, 0.0], 0.1).scaled_to_pga(1.0)


@given(finite_samples, st.floats(-5, 5), st.floats(-5, 5))
def test_baseline_correction_removes_its_polynomial_exactly(samples, offset, slope):
    record = jp.Record(samples, 0.1, "quake")
    line = slope * np.linspace(0, 1, len(samples))
    for kind, added in (("mean", offset), ("linear", offset + line)):
        corrected = record.baseline_corrected(kind)
        other = jp.Record(samples + added, 0.1).baseline_corrected(kind)
        np.testing.assert_allclose(other.samples, corrected.samples, atol=1e-12)
        again = corrected.baseline_corrected(kind)
        np.testing.assert_allclose(again.samples, corrected.samples, atol=1e-12)
        assert corrected.name == "quake"


@given(finite_samples)
def test_baseline_correction_is_least_squares(samples):
    i = np.arange(len(samples))
    for kind, degree in (("mean", 0), ("linear", 1)):
        fit = np.polynomial.Polynomial.fit(i, samples, degree)
        corrected = jp.Record(samples, 0.1).baseline_corrected(kind)
        np.testing.assert_allclose(corrected.samples, samples - fit(i), atol=1e-11)


def test_baseline_correction_works_on_traced_records_and_refuses_other_kinds():
    compiled = jax.jit(lambda r: r.baseline_corrected().samples)(RECORD)
    np.testing.assert_allclose(compiled, RECORD.baseline_corrected().samples, atol=1e-14)
    with pytest.raises(ValueError, match="kind = 'cubic' must be 'mean' or 'linear'"):
        RECORD.baseline_corrected("cubic")


@pytest.mark.parametrize("parts", [1, 2, 5, 7])
def test_finer_record_is_the_same_motion(parts):
    t = np.linspace(-0.01, 1.51, 333)
    finer = RECORD.resampled(0.5 / parts)
    assert finer.n_samples == 3 * parts + 1
    assert finer.name == "quake"
    np.testing.assert_allclose(finer.samples[::parts], SAMPLES, rtol=1e-14)
    inside = (t >= 0) & (t <= 1.5)
    np.testing.assert_allclose(
        finer.acceleration(t[inside]), RECORD.acceleration(t[inside]), rtol=1e-12, atol=1e-12
    )


def test_finer_record_ends_with_its_last_sample_in_single_precision_too():
    record = jp.Record(np.ones(2000, np.float32), np.float32(0.01))
    assert record.resampled(0.005).n_samples == 3999


def test_coarser_record_keeps_slow_motion_and_loses_fast_motion():
    t = 0.01 * np.arange(4001)
    slow, fast = np.sin(2 * np.pi * 0.5 * t), np.sin(2 * np.pi * 20.0 * t)
    # At dt = 0.04 the fast sine lies above the Nyquist frequency, 12.5: sampled it would alias.
    coarse = jp.Record(slow + fast, 0.01).resampled(0.04)
    assert coarse.dt == 0.04
    assert coarse.n_samples == 1001
    middle = slice(25, -25)
    np.testing.assert_allclose(coarse.samples[middle], slow[::4][middle], atol=5e-3)
    assert np.abs((slow + fast)[::4] - slow[::4])[middle].max() > 0.5


def test_coarser_record_at_a_ratio_of_whole_numbers():
    t = 0.01 * np.arange(3001)
    coarse = jp.Record(np.sin(t), 0.01).resampled(0.025)
    expected = np.sin(0.025 * np.arange(coarse.n_samples))
    np.testing.assert_allclose(coarse.samples[20:-20], expected[20:-20], atol=2e-3)


@pytest.mark.parametrize(
    ("dt", "message"),
    [
        (0, "dt = 0 must be positive and finite"),
        (-0.1, r"dt = -0\.1 must be positive"),
        (np.nan, "dt = nan must be positive"),
        (np.inf, "dt = inf must be positive"),
        (None, "dt = None must be a real number"),
        ("1", "dt = '1' must be a real number"),
        ([0.1, 0.2], r"dt of shape \(2,\) must be one number"),
        (2**0.5 / 2, r"dt = 0\.707106.* must be a ratio of whole numbers"),
        (2.0, r"dt = 2 must be at most the record's duration, 1\.5"),
    ],
)
def test_resampling_refuses_bad_intervals(dt, message):
    with pytest.raises(ValueError, match=rf"^Record\.resampled: {message}"):
        RECORD.resampled(dt)


def test_resampling_says_that_its_interval_cannot_be_traced():
    with pytest.raises(ValueError, match="cannot be traced"):
        jax.jit(lambda r: r.resampled(0.25).samples)(RECORD)


def test_record_is_a_pytree_of_samples_and_interval():
    leaves = jax.tree_util.tree_leaves_with_path(RECORD)
    assert [jax.tree_util.keystr(path) for path, _ in leaves] == [".samples", ".dt"]
    gradient = jax.grad(lambda r: r.acceleration(0.75))(RECORD)
    assert type(gradient) is jp.Record
    np.testing.assert_allclose(gradient.samples, [0, 0.5, 0.5, 0])
    # The later the samples come the earlier on the line is t: ∂(t/dt)/∂dt = −t/dt² = −3.
    assert gradient.dt == pytest.approx(-3 * (-3.0 - 1.0))
    with pytest.raises(dataclasses.FrozenInstanceError):
        RECORD.dt = 1.0


@pytest.mark.parametrize(
    "leaf", [None, object(), 0, "text", jnp.ones((2, 3))], ids=lambda leaf: type(leaf).__name__
)
def test_any_record_can_be_printed(leaf):
    assert "Record(" in repr(jax.tree.map(lambda _: leaf, RECORD))
    assert "'quake', 4 samples, dt = 0.5" in repr(RECORD)


# Sums and scalings


COMBINATIONS = {
    "sum": (RECORD + jp.Ricker(1, 1, 1), lambda r, w, s: r + w),
    "difference": (RECORD - jp.Ricker(1, 1, 1), lambda r, w, s: r - w),
    "factor on the left": (3 * RECORD, lambda r, w, s: 3 * r),
    "factor on the right": (RECORD * 3, lambda r, w, s: 3 * r),
    "NumPy factor": (np.float64(3) * RECORD, lambda r, w, s: 3 * r),
    "array factor": (np.array(3.0) * RECORD, lambda r, w, s: 3 * r),
    "JAX factor": (jnp.array(3.0) * RECORD, lambda r, w, s: 3 * r),
    "divisor": (RECORD / 4, lambda r, w, s: r / 4),
    "negation": (-RECORD, lambda r, w, s: -r),
    "function on the right": (RECORD + sine, lambda r, w, s: r + s),
    "function on the left": (sine + RECORD, lambda r, w, s: r + s),
    "minus a function": (RECORD - sine, lambda r, w, s: r - s),
    "function minus": (sine - RECORD, lambda r, w, s: s - r),
    "builtin sum": (sum([RECORD, jp.Ricker(1, 1, 1), RECORD]), lambda r, w, s: 2 * r + w),
    "nested": (2 * (sine + (RECORD - jp.Ricker(1, 1, 1))) / 4, lambda r, w, s: (s + r - w) / 2),
}


@pytest.mark.parametrize(("ground", "expected"), COMBINATIONS.values(), ids=COMBINATIONS)
def test_combinations_combine_the_accelerations(ground, expected):
    t = np.linspace(0, 1.4, 15)
    parts = RECORD.acceleration(t), jp.Ricker(1, 1, 1).acceleration(t), sine(t)
    np.testing.assert_allclose(ground.acceleration(t), expected(*parts), rtol=1e-12, atol=1e-14)
    grid = jp.TimeGrid(0.1, 14)
    np.testing.assert_allclose(
        sampled(ground, grid).samples, expected(*parts), rtol=1e-12, atol=1e-14
    )


def test_combinations_are_differentiable_pytrees():
    ground = 2.0 * RECORD + jp.Ricker(0.5, 1.0, 1.0)
    gradient = jax.grad(lambda g: g.acceleration(0.5))(ground)
    assert type(gradient) is type(ground)
    assert gradient.grounds[0].factor == pytest.approx(1.0)
    assert gradient.grounds[1].amplitude == pytest.approx(
        float(jp.Ricker(1.0, 1.0, 1.0).acceleration(0.5)), rel=1e-12
    )


@pytest.mark.parametrize(
    ("combine", "message"),
    [
        (lambda: RECORD + 1, r"Sum: grounds\[1\] = 1 must have acceleration\(t\)"),
        (lambda: None + RECORD, r"Sum: grounds\[0\] = None must have acceleration\(t\)"),
        (lambda: RECORD - "x", r"Scaled: ground = 'x' must have acceleration\(t\)"),
        (lambda: RECORD * RECORD, "Scaled: factor = .* must be a real number"),
        (lambda: RECORD * None, "Scaled: factor = None must be a real number"),
        (lambda: np.nan * RECORD, "Scaled: factor = nan must be finite"),
        (lambda: np.array([1.0, 2.0]) * RECORD, r"Scaled: factor of shape \(2,\) must be one"),
        (lambda: RECORD / "2", "Scaled: divisor = '2' must be a real number"),
    ],
)
def test_senseless_combinations_are_refused(combine, message):
    with pytest.raises(ValueError, match=message):
        combine()


# Sampling


@pytest.mark.parametrize(
    ("ground", "expected"),
    [
        (sine, sine),
        (scalar_sine, sine),
        (lambda t: jnp.sin(t), np.sin),
        (lambda t: 1.0 if t < 0.25 else 0.5, lambda t: np.where(t < 0.25, 1.0, 0.5)),
        (lambda t: jax.lax.cond(t < 0.25, lambda: 1.0, lambda: 0.0), lambda t: 1.0 * (t < 0.25)),
        (lambda t: 0.25, lambda t: np.full(t.shape, 0.25)),
        (lambda t: 1, np.ones_like),
        (
            scalar_sine + jp.Ricker(0.5, 1, 0.2),
            lambda t: sine(t) + jp.Ricker(0.5, 1, 0.2).acceleration(t),
        ),
        (jp.Ricker(0.5, 1, 0.2), lambda t: jp.Ricker(0.5, 1, 0.2).acceleration(t)),
    ],
)
def test_any_function_of_time_can_be_sampled(ground, expected):
    record = sampled(ground, GRID)
    assert record.dt == 0.1
    np.testing.assert_allclose(record.samples, expected(GRID.times()), rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(record.acceleration(GRID.times()), record.samples, rtol=1e-12)


def test_a_function_of_a_traced_parameter_can_be_sampled():
    def peak(a):
        return jnp.max(sampled(lambda t: a * t, GRID).samples)

    assert jax.jit(peak)(2.0) == pytest.approx(1.0)
    assert jax.grad(peak)(2.0) == pytest.approx(0.5)


@pytest.mark.parametrize(
    "error", [ValueError("my own"), TypeError("my own"), KeyError("my own"), ZeroDivisionError()]
)
def test_the_functions_own_error_surfaces(error):
    ground = fails_with(error)
    for call in (
        lambda: sampled(ground, GRID),
        lambda: sampled(RECORD + ground, GRID),
        lambda: jp.pga(ground, GRID),
        lambda: jp.demand(jp.paper.structures(), ground, GRID),
    ):
        with pytest.raises(type(error)) as caught:
            call()
        assert caught.value is error


def test_an_error_at_one_instant_only_surfaces():
    def ground(t):
        if t > 0.35:
            raise ValueError("the table ends at 0.35")
        return math.sin(t)

    with pytest.raises(ValueError, match=r"the table ends at 0\.35"):
        sampled(ground, GRID)


@pytest.mark.parametrize(
    ("ground", "message"),
    [
        (lambda t: np.ones(3), r"of shape \(3,\) must have the shape of t, \(6,\)"),
        (lambda t: t[:, None], r"of shape \(6, 1\) must have the shape of t, \(6,\)"),
        (lambda t: None, "= None must be a real number"),
        (lambda t: "x", "= 'x' must be a real number"),
        (lambda t: 1j * t, "must be a real number"),
        (lambda t: np.where(t > 0.25, np.nan, t), r"= nan \(at index \[3\]\) must be finite"),
        (lambda t: np.inf, "= inf must be finite"),
    ],
)
def test_functions_must_return_a_finite_real_number_for_each_instant(ground, message):
    with pytest.raises(ValueError, match=rf"ground: acceleration\(t\) .*{message}"):
        sampled(ground, GRID)


def test_what_is_no_ground_motion_cannot_be_sampled():
    with pytest.raises(ValueError, match=r"ground = 3 must have acceleration\(t\) or be a func"):
        sampled(3, GRID)


# What the time loop takes


class Sine:
    """A user's ground motion that knows its integral."""

    def acceleration(self, t):
        return jnp.sin(t)

    def velocity(self, t):
        return 1 - jnp.cos(t)


def taken(ground, grid, order=2):
    """u'' and its mean over the steps, at all instants, as the time loop reads them."""
    series, at = excitation(ground, grid, order)

    def instant(_, xs):
        return None, at(*xs)

    return jax.lax.scan(instant, None, (grid.times(), series), length=grid.n_steps + 1)[1]


MEANS = {  # the mean over a step of h about t, exactly
    "sine": (Sine(), lambda t, h: np.sin(t) * np.sin(h / 2) / (h / 2)),
    "record": (RECORD, lambda t, h: mean_of_lines(SAMPLES, 0.5, t, h)),
    "factor": (-2 * RECORD, lambda t, h: -2 * mean_of_lines(SAMPLES, 0.5, t, h)),
    "sum": (
        RECORD + Sine(),
        lambda t, h: mean_of_lines(SAMPLES, 0.5, t, h) + np.sin(t) * np.sin(h / 2) / (h / 2),
    ),
}


def mean_of_lines(samples, dt, t, h):
    """By the trapezoidal rule over the ends of the step and the kinks between them."""
    kinks, padded = dt * np.arange(-1, len(samples) + 1), np.pad(samples, 1)
    means = []
    for begin, end in zip(t - h / 2, t + h / 2, strict=True):
        x = np.array([begin, *kinks[(kinks > begin) & (kinks < end)], end])
        means.append(np.trapezoid(np.interp(x, kinks, padded), x) / h)
    return np.array(means)


@pytest.mark.parametrize(("ground", "mean"), MEANS.values(), ids=MEANS)
@pytest.mark.parametrize("dt", [0.05, 0.3])
def test_the_time_loop_takes_values_and_exact_means(ground, mean, dt):
    grid = jp.TimeGrid(dt, 45)
    t = grid.times()
    values, means = taken(ground, grid)
    np.testing.assert_allclose(values, sampled(ground, grid).samples, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(means, mean(t, dt), rtol=1e-10, atol=1e-13)


def test_the_mean_of_a_wavelet_is_of_fourth_order_and_its_value_in_the_paper_s_scheme():
    wavelet = jp.Ricker([0.5, -0.2], [1.0, 2.0], [1.5, 2.0])
    errors = []
    for dt, n in ((0.1, 30), (0.05, 60)):
        grid = jp.TimeGrid(dt, n)
        t = grid.times()
        exact = (wavelet.velocity(t + dt / 2) - wavelet.velocity(t - dt / 2)) / dt
        value, mean = taken(wavelet, grid)
        errors.append(float(jnp.abs(mean - exact).max()))
        np.testing.assert_allclose(value, wavelet.acceleration(t), rtol=1e-12, atol=1e-12)
        for same in taken(wavelet, grid, order=1):
            np.testing.assert_allclose(same, wavelet.acceleration(t), rtol=1e-12, atol=1e-12)
    assert 14 < errors[0] / errors[1] < 18


def test_of_a_ground_motion_without_a_velocity_the_value_is_the_mean():
    for ground in (sampled(sine, GRID), lambda t: 0.3 * jnp.sin(2 * t)):
        value, mean = taken(ground, GRID)
        np.testing.assert_array_equal(value, mean)
        np.testing.assert_allclose(value, sine(GRID.times()), rtol=1e-14, atol=1e-15)


def test_the_series_is_one_entry_an_instant_and_shared_by_many_factors():
    grid = jp.TimeGrid(0.1, 7)
    for ground, arrays in ((jp.Ricker(1, 1, 1), 0), (RECORD, 2), (RECORD + 2 * RECORD + sine, 4)):
        leaves = jax.tree.leaves(excitation(ground, grid, 2).series)
        assert [leaf.shape for leaf in leaves] == [(8,)] * arrays

    def series(factor):
        return excitation(factor * RECORD, grid, 2).series

    batch = jax.vmap(series, out_axes=None)(jnp.array([1.0, 2.0, 3.0]))  # refuses what is batched
    np.testing.assert_array_equal(batch[0], series(1.0)[0])


def test_the_excitation_by_a_record_is_differentiable_by_its_sample_interval():
    """Kinks lie on the instants: the mean has a derivative there, against central differences."""
    grid = jp.TimeGrid(0.25, 8)

    def means(dt):
        return excitation(jp.Record(SAMPLES, dt), grid, 2).series[1]

    check_grads(means, (0.5,), order=1, modes=["fwd", "rev"], eps=1e-6, rtol=1e-6)


def test_velocities_are_exact_where_they_are_known():
    grid = jp.TimeGrid(0.3, 12)
    t, h = grid.times(), grid.dt
    for ground in (Sine(), jp.Ricker(0.5, 1, 1), RECORD):
        around = (ground.velocity(t - h / 2) + ground.velocity(t + h / 2)) / 2
        found = velocity_and_bulge(RECORD - 2 * (ground + RECORD), t, h)
        expected = (
            -RECORD.velocity(t) - 2 * ground.velocity(t),
            -(RECORD.velocity(t - h / 2) + RECORD.velocity(t + h / 2)) / 2 - 2 * around,
        )
        np.testing.assert_allclose(found[0], expected[0], rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(found[0] + found[1], expected[1], rtol=1e-12, atol=1e-13)


def test_a_field_of_a_user_s_that_is_called_velocity_is_not_its_integral():
    class Stream:
        velocity = 3.0

        def acceleration(self, t):
            return 0.1 * t

    np.testing.assert_array_equal(*taken(Stream(), GRID))


# Measures


@given(st.floats(0.01, 3), st.floats(0.5, 5))
def test_measures_of_a_sine_are_the_closed_forms(amplitude, omega):
    periods, per_period = 3, 800
    dt = 2 * np.pi / omega / per_period
    record = jp.Record(amplitude * np.sin(omega * dt * np.arange(periods * per_period + 1)), dt)
    duration = periods * 2 * np.pi / omega
    assert record.duration == pytest.approx(duration)
    assert jp.pga(record) == pytest.approx(amplitude, rel=1e-12)
    # From rest u' = (A/ω)(1 − cos ωt).
    assert jp.pgv(record) == pytest.approx(2 * amplitude / omega, rel=1e-4)
    arias = np.pi / 2 * amplitude**2 * duration / 2
    assert jp.arias_intensity(record) == pytest.approx(arias, rel=1e-4)
    assert jp.pgv(record, gravity=9.81) == pytest.approx(9.81 * 2 * amplitude / omega, rel=1e-4)
    assert jp.arias_intensity(record, gravity=9.81) == pytest.approx(9.81 * arias, rel=1e-4)


def test_measures_of_functions_are_taken_on_the_grid():
    grid = jp.TimeGrid(0.001, 5000)
    assert jp.pga(sine, grid) == pytest.approx(0.3, rel=1e-5)
    assert jp.pgv(sine, grid) == pytest.approx(0.3, rel=1e-5)
    # ∫ sin² 2t dt over [0, 5] = 5/2 − sin(20)/8
    arias = np.pi / 2 * 0.09 * (2.5 - np.sin(20) / 8)
    assert jp.arias_intensity(sine, grid) == pytest.approx(arias, rel=1e-5)
    assert jp.pga(2 * RECORD, jp.TimeGrid(0.5, 3)) == 6.0


def test_paper_ground_moves_as_its_closed_form():
    ground, grid = jp.paper.ground(), jp.TimeGrid(0.0005, 40_000)
    t = grid.times()
    assert jp.pgv(ground, grid) == pytest.approx(float(abs(ground.velocity(t)).max()), rel=1e-3)


@pytest.mark.parametrize("measure", [jp.pga, jp.pgv, jp.arias_intensity])
def test_measures_ask_for_a_grid_where_they_need_one(measure):
    for ground in (sine, jp.Ricker(1, 1, 1), 2 * RECORD):
        with pytest.raises(ValueError, match="grid = None must be a TimeGrid"):
            measure(ground)
    with pytest.raises(ValueError, match=r"grid = 0\.1 must be a TimeGrid"):
        measure(sine, 0.1)


@pytest.mark.parametrize("measure", [jp.pga, jp.pgv, jp.arias_intensity])
def test_measures_work_compiled_and_batched(measure):
    factors = jnp.array([1.0, 2.0])
    batch = jax.jit(jax.vmap(lambda k: measure(jp.Record(k * SAMPLES, 0.5))))(factors)
    single = [measure(RECORD), measure(RECORD.scaled_to_pga(6.0))]
    np.testing.assert_allclose(batch, single, rtol=1e-12)


# The spectrum.


def test_spectral_acceleration_of_a_suddenly_applied_force_is_the_closed_form():
    """u'' = −1 from t = 0: x rises to (1 + e^(−πζ/√(1 − ζ²))) / ω²."""
    record = jp.Record(-np.ones(2001), 0.002)
    for period, damping in ((1.0, 0.05), (0.5, 0.0), (3.0, 0.3)):
        found = jp.spectral_acceleration(record, period=period, damping=damping)
        over = np.exp(-np.pi * damping / np.sqrt(1 - damping**2))
        assert float(found) == pytest.approx(1 + over, rel=1e-12)


def test_spectral_acceleration_is_exact_at_any_step():
    """Against a fine integration of the same straight lines, peaks between samples included."""
    record = jp.Record(np.random.default_rng(0).normal(size=60), 0.1)
    for period in (0.15, 0.4, 1.3):
        w = 2 * np.pi / period

        def motion(t, y, w=w):
            a = np.interp(t, 0.1 * np.arange(60), record.samples)
            return [y[1], -2 * 0.05 * w * y[1] - w**2 * y[0] - a]

        times = np.linspace(0, 0.1 * 59, 59 * 400 + 1)
        exact = solve_ivp(
            motion, (0, times[-1]), [0, 0], t_eval=times, max_step=0.02, rtol=1e-9, atol=1e-12
        )
        found = float(jp.spectral_acceleration(record, period=period))
        assert found == pytest.approx(w**2 * np.abs(exact.y[0]).max(), rel=1e-6)


def test_spectral_acceleration_has_exact_slopes_at_peaks_between_samples():
    record = jp.Record(np.random.default_rng(1).normal(size=60), 0.1)

    def spectrum(p):
        return jp.spectral_acceleration(record, period=p[0], damping=p[1])

    at = np.array([0.9, 0.05])
    check_grads(spectrum, (at,), order=2, modes=["fwd"], eps=1e-5, rtol=1e-5)


def test_spectral_acceleration_of_a_stiff_oscillator_is_the_pga():
    record = jp.Record(np.sin(np.linspace(0, 6, 400)), 0.02)
    assert float(jp.spectral_acceleration(record, period=0.01)) == pytest.approx(1.0, rel=1e-2)


def test_spectral_acceleration_traces_and_refuses_bad_periods():
    record = jp.Record(np.sin(np.linspace(0, 6, 50)), 0.1)
    spectrum = jax.vmap(lambda p: jp.spectral_acceleration(record, period=p))(np.array([0.5, -1.0]))
    assert float(spectrum[0]) == pytest.approx(float(jp.spectral_acceleration(record, period=0.5)))
    assert np.isnan(spectrum[1])
    with pytest.raises(ValueError, match="period = 0 must be positive"):
        jp.spectral_acceleration(record, period=0.0)
    with pytest.raises(ValueError, match="damping = 1 must be at least 0 and below 1"):
        jp.spectral_acceleration(record, period=1.0, damping=1.0)
