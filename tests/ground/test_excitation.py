"""What the time loop takes of a ground motion: values, means over the steps, velocities."""

import jax
import jax.extend
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

import jaxpound as jp
from jaxpound.ground.motion import as_motion
from jaxpound.ground.run_input import sampled
from tests.ground.motions import GRID, RECORD, SAMPLES, sine, values


class Sine:
    """A user's ground motion that knows its integral."""

    def acceleration(self, t):
        return jnp.sin(t)

    def velocity(self, t):
        return 1 - jnp.cos(t)


def taken(ground, grid, order=2):
    """u'' and its mean over the steps, at all instants, as the time loop reads them."""

    @jax.jit
    def run():
        series, at = as_motion(ground).excitation(grid, order)
        return jax.lax.scan(lambda _, xs: (None, at(*xs)), None, (grid.times(), series))[1]

    return run()


def steps_about(t, h):
    """Begin and end of the steps about instants; the first one begins with the run."""
    return np.where(t > 0, t - h / 2, 0.0), t + h / 2


def mean_of_sine(t, h):
    begin, end = steps_about(t, h)
    return (np.cos(begin) - np.cos(end)) / (end - begin)


def mean_of_record(t, h):
    """By the trapezoidal rule over the ends of the step and the kinks between them."""
    kinks, padded = 0.5 * np.arange(-1, len(SAMPLES) + 1), np.pad(SAMPLES, 1)
    means = []
    for begin, end in zip(*steps_about(t, h), strict=True):
        x = np.array([begin, *kinks[(kinks > begin) & (kinks < end)], end])
        means.append(np.trapezoid(np.interp(x, kinks, padded), x) / (end - begin))
    return np.array(means)


MEANS = {  # the mean over a step of h about t, exactly
    "sine": (Sine(), mean_of_sine),
    "record": (RECORD, mean_of_record),
    "factor": (-2 * RECORD, lambda t, h: -2 * mean_of_record(t, h)),
    "sum": (RECORD + Sine(), lambda t, h: mean_of_record(t, h) + mean_of_sine(t, h)),
}


@pytest.mark.parametrize(("ground", "mean"), MEANS.values(), ids=MEANS)
@pytest.mark.parametrize("dt", [0.05, 0.3])
def test_the_time_loop_takes_values_and_exact_means(ground, mean, dt):
    grid = jp.TimeGrid(dt, 45)
    t = grid.times()
    accelerations, means = taken(ground, grid)
    np.testing.assert_allclose(accelerations, sampled(ground, grid).samples, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(means, mean(t, dt), rtol=1e-10, atol=1e-13)


def test_the_mean_of_a_wavelet_is_of_fourth_order_and_its_value_in_the_paper_s_scheme():
    wavelet = jp.Ricker([0.5, -0.2], [1.0, 2.0], [1.5, 2.0])
    errors = []
    for dt, n in ((0.1, 30), (0.05, 60)):
        grid = jp.TimeGrid(dt, n)
        t = grid.times()
        begin, end = (values(wavelet, "velocity", t + x) for x in (-dt / 2, dt / 2))
        value, mean = taken(wavelet, grid)
        errors.append(np.abs(mean - (end - begin) / dt).max())
        for same in (value, *taken(wavelet, grid, order=1)):
            expected = values(wavelet, "acceleration", t)
            np.testing.assert_allclose(same, expected, rtol=1e-12, atol=1e-12)
    assert 14 < errors[0] / errors[1] < 18


def test_of_a_ground_motion_without_a_velocity_the_value_is_the_mean():
    for ground in (sampled(sine, GRID), lambda t: 0.3 * jnp.sin(2 * t)):
        value, mean = taken(ground, GRID)
        np.testing.assert_array_equal(value, mean)
        np.testing.assert_allclose(value, sine(GRID.times()), rtol=1e-14, atol=1e-15)

    class Stream:
        velocity = 3.0  # not its integral, though called so

        def acceleration(self, t):
            return 0.1 * t

    np.testing.assert_array_equal(*taken(Stream(), GRID))


def test_the_series_is_one_entry_an_instant_and_differentiable_by_the_interval():
    grid = jp.TimeGrid(0.1, 7)
    for ground, arrays in ((jp.Ricker(1, 1, 1), 0), (RECORD, 2), (RECORD + 2 * RECORD + sine, 4)):
        made = jax.eval_shape(lambda ground=ground: as_motion(ground).excitation(grid, 2).series)
        assert [leaf.shape for leaf in jax.tree.leaves(made)] == [(8,)] * arrays

    @jax.jit
    def series(factor):
        return (factor * RECORD).excitation(grid, 2).series

    batch = jax.vmap(series, out_axes=None)(jnp.array([1.0, 2.0, 3.0]))  # refuses what is batched
    np.testing.assert_array_equal(batch[0], series(1.0)[0])
    # Kinks lie on the instants: the mean has a derivative there, against central differences.
    grid = jp.TimeGrid(0.25, 8)

    @jax.jit
    def means(dt):
        return jp.Record(SAMPLES, dt).excitation(grid, 2).series[1]

    check_grads(means, (0.5,), order=1, modes=["fwd", "rev"], eps=1e-6, rtol=1e-6)


def test_velocities_are_exact_where_they_are_known():
    grid = jp.TimeGrid(0.3, 12)
    t, h = grid.times(), grid.dt
    for ground in (Sine(), jp.Ricker(0.5, 1, 1), RECORD):

        @jax.jit
        def both(ground=ground):
            times = t, t - h / 2, t + h / 2
            at, before, after = (-RECORD.velocity(x) - 2 * ground.velocity(x) for x in times)
            combined = RECORD - 2 * (ground + RECORD)
            return combined.velocity_and_bulge(t, h), (at, (before + after) / 2)

        (velocity, bulge), expected = both()
        np.testing.assert_allclose(velocity, expected[0], rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(velocity + bulge, expected[1], rtol=1e-12, atol=1e-13)


def scan_bodies(jaxpr):
    """The programs that a program repeats in its loops, those within others included."""
    for equation in jaxpr.eqns:
        for value in jax.tree.leaves(tuple(equation.params.values()), is_leaf=is_program):
            if is_program(value):
                inner = getattr(value, "jaxpr", value)
                if equation.primitive.name == "scan":
                    yield inner
                yield from scan_bodies(inner)


def is_program(value):
    return isinstance(value, jax.extend.core.Jaxpr | jax.extend.core.ClosedJaxpr)


def test_derivatives_by_all_samples_cost_no_array_of_them_in_a_step():
    """A loop that gathered from the record would add a cotangent of all of it at every step."""
    n = 1009
    record = jp.Record(np.sin(0.1 * np.arange(n)), 0.02, time_unit="1/ω1")
    grid = jp.TimeGrid(0.02, 1000)

    def min_gap(ground):
        return jp.demand(jp.paper.structures(), ground, grid).min_gap

    for ground in (record, 2 * record + jp.paper.ground()):
        bodies = list(scan_bodies(jax.make_jaxpr(jax.grad(min_gap))(ground).jaxpr))
        assert len(bodies) >= 2  # forward and backward
        for body in bodies:
            variables = [*body.invars, *body.constvars, *(x for e in body.eqns for x in e.outvars)]
            assert max(np.prod(x.aval.shape) for x in variables) < 200
