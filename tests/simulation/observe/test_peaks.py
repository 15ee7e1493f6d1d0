"""Peaks between samples."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, strategies

import jaxpound as jp
from jaxpound.simulation.observe.peaks import Peak, Peaks, Sample


def peak(samples, dtype=np.float64):
    tally = Peak(*[jnp.zeros((), dtype)] * 4)
    for sample in jnp.asarray(samples, dtype):
        tally = tally.observe(sample)
    return tally.largest


VERTICES = [([0, 1, 1, 0], 1.125), ([0, 1, 1 - 1e-9, 0], 1.125), ([0, 1 - 1e-9, 1, 0], 1.125)]
VERTICES += [([0, 1, 0], 1.0), ([0, 3, 4, 3, 0], 4.0), ([0, 0, 0, 1, 2], 2.0), ([0, 0, 0], 0.0)]


@pytest.mark.parametrize(("samples", "largest"), VERTICES)
def test_the_vertex_of_a_parabola_is_found_also_where_two_samples_tie(samples, largest):
    for sign in (1, -1):
        assert float(peak(sign * np.array(samples, float))) == pytest.approx(largest, abs=1e-8)


@given(strategies.floats(-1.0, 1.0), strategies.floats(0.5, 3.0))
def test_the_peak_of_a_parabola_is_exact_wherever_it_lies(place, height):
    t = np.arange(-3, 4)
    assert float(peak(height * (25 - (t - place) ** 2))) == pytest.approx(25 * height, rel=1e-12)


def test_where_samples_tie_by_rounding_peak_and_slope_are_those_of_the_curve():
    t = np.arange(-10, 11) * 1e-4
    for shift in (0.0, 4e-5, 5e-5):
        samples = (0.3 + np.cos(3 * (t - shift))).astype(np.float32)
        assert (np.diff(samples) == 0).any()
        assert float(peak(samples, np.float32)) == pytest.approx(1.3, abs=4e-7)
    t = np.arange(-3, 5) - 0.5
    slope = jax.grad(lambda height: peak(height * (25 - t**2)))(2.0)
    assert float(slope) == pytest.approx(25, rel=1e-12)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("power", [0.45, 0.55, 0.9])
def test_the_peak_of_a_motion_that_begins_with_tiny_numbers_has_a_slope(dtype, power):
    """As a short pulse begins: numbers whose squares underflow, which turn like any others."""
    tiny = np.array([0, 1, 2, 1, -1], dtype) * np.finfo(dtype).tiny ** power

    def largest(height):
        return peak([*(height * tiny), 3 * height, 4 * height, 3 * height], dtype)

    value, slope = jax.value_and_grad(largest)(jnp.asarray(1.0, dtype))
    assert (float(value), float(slope)) == (4.0, 4.0)


def test_the_peaks_of_many_series_in_arrays_are_those_of_each_series():
    """Smooth or not, with and without values between samples; with their slopes."""
    series = jnp.asarray(np.random.default_rng(3).normal(size=(5, 20)))
    between = {1: (2.5,), 3: (-0.5, 3.5)}

    def largest(scale, in_arrays):
        peaks = Peaks.start(jnp.zeros(()), len(series), in_arrays)
        for n, values in enumerate(series.T):
            samples = [
                Sample(scale * y, jnp.asarray(i % 2 == 0 or n % 3 > 0), [scale * z for z in others])
                for i, y in enumerate(values)
                for others in [between.get(i, ()) if n == 7 else ()]
            ]
            peaks = peaks.observe(samples)
        return jnp.stack([peak.largest for peak in peaks.each()])

    for function in (largest, jax.jacfwd(largest), jax.jacrev(largest)):
        in_arrays, apart = map(np.asarray, (function(1.5, True), function(1.5, False)))
        assert in_arrays == pytest.approx(apart, rel=1e-14)
    assert apart[3] == 3.5  # larger than all samples, and so the slope


def test_a_series_that_stops_does_not_overshoot_whatever_rounding_does_to_its_rise():
    for rise in (0.0, 1e-16, -1e-16):
        assert float(peak([0.1, 0.3, 0.4, 0.4 + rise, 0.4])) == pytest.approx(0.4, rel=1e-14)


def test_peaks_of_a_link_that_sticks_do_not_depend_on_the_unit_of_length():
    """The drift between the ends was once larger by 1e-4 in other units, by rounding alone."""
    steel, grid = jp.ZenerRod(1.0, 0.02, 0.1), jp.TimeGrid(0.02, 500)

    @jax.jit
    @jax.vmap
    def drift(numbers, unit):
        soft, friction, stiff, amplitude = numbers
        pairs = zip((soft, stiff, soft / 3), ((0, jp.GROUND), (1, jp.GROUND), (0, 1)), strict=True)
        rods = tuple(jp.Rod(steel, k, ends) for k, ends in pairs)
        system = jp.System((1.0, 1.4), rods, (jp.Link((0, 1), friction * unit),))
        ground = jp.Ricker(unit * amplitude, [1.6, 2.4], [3.4, 5.6])
        return jp.demand(system, ground, grid).rods[2].peak_drift / unit

    rng = np.random.default_rng(1)
    ranges = ((1, 60), (0.02, 0.4), (1, 60), (0.1, 0.6))
    cases = np.exp(np.stack([rng.uniform(*np.log(ends), 600) for ends in ranges], 1))
    ours, others = (np.asarray(drift(cases, np.full(600, unit))) for unit in (1.0, 0.37))
    np.testing.assert_allclose(ours, others, rtol=1e-12, atol=1e-14)
