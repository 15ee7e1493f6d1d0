"""A mainshock and its aftershocks as one ground motion."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from jaxpound.ground.motion import as_motion
from jaxpound.ground.plausibility import unseen
from jaxpound.ground.run_input import sampled
from tests.ground.motions import RECORD, SAMPLES, values
from tests.ground.test_excitation import Sine, taken
from tests.refusals import refusals, refused

FINE = jp.Record([0.3, -0.2, 0.4, 0.1, -0.3], 0.25, "fine")  # neither end is zero
WAVE = jp.Ricker([0.5, 0.2], [1.0, 0.5], [1.5, 2.0])
PULSE = jp.Pulse(0.8, 1.5, 2.0, cycles=1.5, time_unit="s")
sequence = jp.sequence
ALL = sequence([RECORD, -2 * FINE, 2 * WAVE + PULSE, Sine()], 3.0)
STARTS = [0.0, 4.5, 8.5, 15.0]  # ends are at 1.5, 1.0 and 3.5 of each


def test_parts_follow_each_other_each_after_its_own_instants():
    np.testing.assert_allclose(ALL.starts, STARTS)
    t = np.linspace(0, 20, 801)
    parts = zip((1, -2, 2, 1), (RECORD, FINE, WAVE, PULSE), (0, 4.5, 8.5, 8.5), strict=True)
    expected = sum(k * values(x, "acceleration", t - start) for k, x, start in parts)
    expected += np.where(t >= 15, np.sin(t - 15), 0)
    np.testing.assert_allclose(jax.jit(ALL.acceleration)(t), expected, atol=1e-12)
    grid = jp.TimeGrid(0.025, 800)
    np.testing.assert_allclose(sampled(ALL, grid).samples, expected, atol=1e-12)
    np.testing.assert_allclose(taken(ALL, grid)[0], expected, atol=1e-12)
    # The sums of the means are the velocity, exactly but of the wavelet, and it begins at rest.
    _, means = taken(ALL, grid)
    middles = jnp.asarray(np.append(0.0, t[:-1] + 0.0125))
    velocity = jax.jit(lambda: ALL.velocity_and_bulge(middles, 0.025)[0])()
    passed = 0.025 * np.cumsum(np.append(means[0] / 2, means[1:-1]))
    error = np.abs(passed - (velocity[1:] - velocity[0]))
    assert error[t[:-1] < 7].max() < 1e-12
    assert error.max() < 3e-4  # of a velocity of up to 5


def test_one_alone_is_itself_and_a_record_in_two_parts_is_whole():
    grid = jp.TimeGrid(0.05, 60)
    for ground in (RECORD, 2 * FINE, WAVE, PULSE):
        np.testing.assert_array_equal(taken(sequence([ground], 9.0), grid), taken(ground, grid))
    begin, end = (jp.Record(x, 0.5) for x in (SAMPLES[:2], SAMPLES[2:]))
    # Both go to zero within the interval between them, and so make the straight line.
    np.testing.assert_allclose(taken(sequence([begin, end], 0.5), grid), taken(RECORD, grid))
    silent = jp.Record(np.zeros(2), 0.5)
    later = taken(sequence([silent, FINE], 1.0), grid)
    np.testing.assert_allclose(
        np.array(later)[:, 31:], np.array(taken(FINE, grid))[:, 1:-30], atol=1e-14
    )


def test_records_with_ends_that_are_not_zero_do_not_jump():
    t = np.linspace(1.0, 8.0, 70_001)
    steps = np.diff(values(sequence([FINE, FINE, FINE], 1.0), "acceleration", t))
    assert np.abs(steps).max() <= 1e-4 * 1.0001 * 0.6 / 0.25  # the steepest line between samples


def test_sequences_of_sequences_sums_and_scalings():
    t = np.linspace(0, 20, 401)
    inner = sequence([sequence([RECORD, FINE], 3.0), WAVE], 3.0)
    flat = sequence([RECORD, FINE, WAVE], 3.0)
    np.testing.assert_allclose(inner.starts, [0.0, 8.5])
    outer = sequence([RECORD, sequence([FINE, WAVE], 3.0)], 3.0)
    for nested in (inner, outer, sequence([flat], 1.0), 0.5 * (2 * flat), flat + FINE - FINE):
        a, b = (values(x, "acceleration", t) for x in (nested, flat))
        np.testing.assert_allclose(a, b, atol=1e-12)
    doubled = 2 * sequence([RECORD, np.sin], 1.0)
    assert type(doubled) is type(flat)
    assert doubled.duration is None
    np.testing.assert_allclose((RECORD - flat).acceleration(7.0), -flat.acceleration(7.0))
    assert repr(sequence([RECORD, WAVE], 3.0)).startswith("ShockSequence(grounds=(Record('quake',")


def test_functions_and_objects_begin_at_their_own_zero():
    """Before it they may not even be defined."""

    def root(t):
        return np.sqrt(t) + 0.1

    grid = jp.TimeGrid(0.1, 60)
    t = grid.times()
    after = sampled(sequence([RECORD, root], 1.0), grid).samples - sampled(RECORD, grid).samples
    expected = np.sqrt(np.maximum(t - 2.5, 0)) + 0.1 * (t > 2.45)
    np.testing.assert_allclose(after, expected, atol=1e-12)

    class Known:
        duration = 2.0

        def acceleration(self, t):
            return 0.1 * jnp.sin(t)

    assert sequence([Known(), RECORD], 1.0).starts == [0.0, 3.0]
    assert as_motion(Known()).velocity is None
    shaken = sampled(sequence([Known(), Known()], 1.0), grid).samples
    np.testing.assert_allclose(shaken[30:], (0.1 * np.sin(t))[30:] + 0.1 * np.sin(t[:31]))


def test_units_of_time_energy_and_what_a_grid_does_not_see():
    both = sequence([RECORD, 2 * FINE], 3.0)
    scales = jp.Scales(mass=1e3, frequency=4.0)
    converted = scales.to_dimensionless(both)
    t = np.linspace(0, 6, 61)
    np.testing.assert_allclose(converted.acceleration(4 * t), both.acceleration(t), atol=1e-12)
    energies = RECORD.energy(-1), 4 * FINE.energy(-1)
    assert both.energy(-1) == pytest.approx(sum(energies))
    assert both.energy(3.0) == pytest.approx(energies[1])
    assert sequence([RECORD, np.sin], 1.0).energy(-1) is None
    (late,) = unseen(sequence([0.1 * RECORD, FINE], 3.0), jp.TimeGrid(0.1, 30))
    assert "begins at 4.5, after the end of the run" in late
    weak = sequence([RECORD, 0.01 * FINE], 3.0)  # of hardly any energy
    assert unseen(weak + 0.1 * RECORD, jp.TimeGrid(0.1, 30))
    words = r"grounds\[0\].duration = .* must be one number, finite"
    for wrong in (-1.0, np.inf):
        timed = Sine()
        timed.duration = wrong
        refused(words, sequence, [timed, RECORD], 1)
    coarse = jp.TimeGrid(0.8, 20)
    assert len(unseen(both, coarse)) == len(unseen(RECORD + FINE, coarse)) == 2
    np.testing.assert_allclose(jp.pga(both, jp.TimeGrid(0.05, 200)), 3.0)
    intensity = jp.ground.arias_intensity(both, fine := jp.TimeGrid(0.001, 9000))
    parts = (jp.ground.arias_intensity(x, fine) for x in (RECORD, 2 * sequence([FINE], 0)))
    ramp = np.pi / 2 * 0.25 * 0.6**2 / 3  # to the first sample, before a run of its own
    assert float(intensity) == pytest.approx(float(sum(parts)) + ramp, rel=1e-4)


def test_it_is_a_pytree_with_derivatives_by_every_part():
    @jax.jit
    def at(rest, factor):
        return sequence([RECORD, factor * FINE, WAVE], rest).acceleration(jnp.array([4.6, 9.0]))

    whole = at(3.0, 2.0)
    np.testing.assert_allclose(
        whole,
        sequence([RECORD, 2 * FINE, WAVE], 3.0).acceleration(np.array([4.6, 9.0])),
        rtol=1e-12,
    )
    h = 1e-6
    for i, slope in enumerate(jax.jit(jax.jacfwd(at, (0, 1)))(3.0, 2.0)):
        moved = [at(*(np.array([3.0, 2.0]) + s * h * np.eye(2)[i])) for s in (1, -1)]
        np.testing.assert_allclose(slope, (moved[0] - moved[1]) / (2 * h), atol=1e-7)
    gradient = jax.grad(lambda x: x.acceleration(4.6))(sequence([RECORD, 2 * FINE], 3.0))
    assert gradient.grounds[1].factor == pytest.approx(float(FINE.acceleration(0.1)))
    single = jax.tree.map(np.float32, sequence([RECORD, 2 * FINE], 3.0))
    assert single.acceleration(np.float32(4.6)).dtype == jnp.float32
    np.testing.assert_allclose(single.acceleration(np.float32(4.6)), whole[0], rtol=1e-5)


IN_UNITS = jp.Record(SAMPLES, 0.5, time_unit="1/ω1")
test_wrong_arguments_are_named = refusals(
    ([], 1.0, r"grounds = \(\) must hold at least one ground motion"),
    (RECORD, 1.0, "grounds = Record.* must be a tuple"),
    ([RECORD, 3], 1.0, r"grounds\[1\] = 3 must have acceleration"),
    ([RECORD, RECORD], -0.1, "rest = -0.1 must be finite and not negative|rest = -0.1 must be"),
    ([RECORD, RECORD], np.inf, "rest = inf must be"),
    ([RECORD, RECORD], None, "rest = None must be a real number"),
    ([RECORD, RECORD], [1.0, 2.0], r"rest of shape \(2,\) must be one number"),
    ([np.sin, RECORD], 1.0, r"grounds\[0\] = .*sin.* must have a duration, as records and wavele"),
    ([RECORD, IN_UNITS], 1.0, "must be in the same unit of time as"),
    of=sequence,
    before="^sequence: .*",
)


def test_a_chosen_grid_is_as_long_as_the_sequence():
    pair = jp.Buildings((jp.Building.from_period(mass=500e3, period=0.9, damping_ratio=0.05),))
    for last, end in ((0.3 * FINE, 5.5), (jp.Ricker(0.01, 0.5, 1.5), 7.0)):
        for ground in (
            sequence([0.3 * RECORD, last], 3.0),
            0.5 * sequence([0.3 * RECORD, last], 3.0),
        ):
            time = jp.simulate(pair, ground).time
            assert float(time[-1]) == pytest.approx(end, abs=0.01)
            assert float(time[1]) <= 0.9 / 50
    words = "duration = None must be stated in s, since that of the last ground motion is unknown"
    refused(words, jp.simulate, pair, sequence([RECORD, np.sin], 1.0))
