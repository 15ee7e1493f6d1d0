"""Motions of supports: waves that travel, and sums and scalings of each."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from jaxpound.ground.run_input import all_sampled, as_run
from jaxpound.ground.supports import at_support, n_supports
from tests.refusals import refused

RECORD = jp.Record([0.0, 0.3, -0.2, 0.1, 0.0], dt=0.5)
DISTANCES = (0.0, 100.0, 250.0)
WAVE = jp.travelling(RECORD, 500.0, DISTANCES)
TIMES = np.linspace(0.0, 3.0, 61)


def test_a_wave_reaches_supports_one_after_the_other():
    for ground, distance in zip(WAVE.grounds, DISTANCES, strict=True):
        expected = np.interp(TIMES - distance / 500.0, 0.5 * np.arange(5), RECORD.samples)
        np.testing.assert_allclose(ground.acceleration(TIMES), expected, atol=1e-12)
    np.testing.assert_array_equal(WAVE.acceleration(TIMES), RECORD.acceleration(TIMES))
    assert float(WAVE.duration) == 2.5


def test_sums_scalings_and_sequences_are_those_of_each_support():
    def hum(t):
        return 0.01 * jnp.sin(t)

    ground = 2 * (WAVE + hum) - 0.5 * WAVE
    assert n_supports(ground) == 3
    for k, own in enumerate(WAVE.grounds):
        expected = 1.5 * own.acceleration(TIMES) + 2 * hum(TIMES)
        np.testing.assert_allclose(at_support(ground, k).acceleration(TIMES), expected, atol=1e-12)
    both = jp.sequence([WAVE, 0.5 * WAVE], rest=1.0)
    assert both.starts == [0.0, 3.5]
    later = at_support(both, 2).acceleration(3.5 + TIMES[:-1])
    np.testing.assert_allclose(later, 0.5 * WAVE.grounds[2].acceleration(TIMES[:-1]), atol=1e-12)
    assert n_supports(hum) == 0
    assert at_support(hum, 1) is hum
    refused("in each part, not 2 and 3", n_supports, jp.ground.Sum((WAVE, (hum, hum))))


def test_delays_are_kept_in_other_units_and_by_other_samples():
    ground = WAVE.dimensionless(2.0)
    np.testing.assert_allclose(
        ground.grounds[1].acceleration(2 * TIMES), WAVE.grounds[1].acceleration(TIMES), atol=1e-12
    )
    halved = WAVE.grounds[1].scaled_to_pga(0.15)
    np.testing.assert_allclose(
        halved.acceleration(TIMES), WAVE.grounds[1].acceleration(TIMES) / 2, atol=1e-12
    )
    for wave in (WAVE, 2.0 * WAVE, RECORD + WAVE, (RECORD, RECORD)):
        rule = r"grounds\[1\] = .* must be of one support"
        refused(rule, jp.ground.SupportMotions, (RECORD, wave))


@pytest.mark.parametrize("gravity", [None, 9.81])
def test_a_run_takes_each_motion_in_its_units(gravity):
    record = RECORD if gravity else RECORD.dimensionless(1.0)
    grid, factor = jp.TimeGrid.until(3.0, 0.05), gravity or 1.0
    pair = jp.travelling(record, 500.0, DISTANCES[:2]).grounds
    for ground in (as_run(pair, grid, gravity), as_run((pair[0], lambda t: 0 * t), grid, gravity)):
        assert n_supports(ground) == 2
        shaking = at_support(ground, 0).acceleration(TIMES)
        np.testing.assert_allclose(shaking, factor * record.acceleration(TIMES), atol=1e-9)
    every = all_sampled(pair, grid)
    np.testing.assert_allclose(
        every.grounds[1].samples, pair[1].acceleration(np.asarray(grid.times())), atol=1e-9
    )


def test_a_random_motion_travels_with_a_random_velocity_and_a_known_velocity():
    pulse = jp.scenarios.RandomPulse(jp.LogNormal(0.3, 0.2), 1.0, 2.0, time_unit="s")
    random = 2 * jp.travelling(pulse, jp.LogNormal(400.0, 0.3), DISTANCES)
    assert random.dimension == 2
    z = np.array([0.5, -1.0])
    drawn, velocity = random.draw(z), 400.0 * np.exp(-0.3)
    assert float(random.parameters(z)["velocity"]) == pytest.approx(velocity)
    own = pulse.draw(z[:1])
    late = at_support(drawn, 1).acceleration(TIMES + DISTANCES[1] / velocity)
    np.testing.assert_allclose(late, 2 * own.acceleration(TIMES), atol=1e-9)
    known = jp.travelling(pulse, 400.0, DISTANCES)  # within a program, as studies draw it
    late = jax.jit(lambda z: at_support(known.draw(z), 1).acceleration(TIMES + 0.25))(z[:1])
    np.testing.assert_allclose(late, own.acceleration(TIMES), atol=1e-9)
    refused("; a tuple has the motion of each support", jp.travelling, [RECORD], 1.0, (0.0,))
    refused("velocity = -1 must be positive", jp.travelling, pulse, -1.0, DISTANCES)
