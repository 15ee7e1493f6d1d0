"""Ensembles: their earthquakes are those that were given or drawn."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from jaxpound import Ensemble, Ricker
from jaxpound.ground.supports import at_support
from tests.refusals import refusals
from tests.study.test_run import RANDOM, study

PAPER = jp.paper.structures()
GRID = jp.TimeGrid(0.05, 200)
T = 0.05 * np.arange(201)
WAVES = [Ricker(0.3, [1.5], [2.0]), Ricker([0.1, 0.2, -0.3], [1.0, 2.0, 3.0], [1, 2, 3])]
RECORDS = [jp.Record(np.sin(T), 0.05, "sine", "1/ω1")]
RECORDS += [jp.Record(np.cos(T[:50]), 0.1, time_unit="1/ω1")]


def accelerations(ensemble):
    return np.stack([ensemble.ground(i).acceleration(T) for i in range(len(ensemble))])


SINGLE = Ricker(0.2, 2.0, 1.0)
GIVEN = {"waves": WAVES, "records": RECORDS, "both": [*WAVES, *RECORDS]}
GIVEN |= {"one wave": [SINGLE, WAVES[1]], "one and a record": [SINGLE, RECORDS[0]]}
GIVEN |= {"mixed": [RECORDS[0], WAVES[1]], "sampled": [2.0 * WAVES[0], RECORDS[1]]}


@pytest.mark.parametrize("grounds", GIVEN.values(), ids=GIVEN)
def test_given_earthquakes_are_what_they_were(grounds):
    ensemble = Ensemble.of(grounds, GRID)
    expected = np.stack([ground.acceleration(T) for ground in grounds])
    np.testing.assert_allclose(accelerations(ensemble), expected, atol=1e-12)
    assert len(ensemble) == len(grounds)
    assert ensemble.fresh(3) is None


def test_records_among_others_keep_their_unit_in_si():
    """Also at each support: what is in g is not taken for m/s²."""
    record = jp.Record(np.sin(2 * np.pi * T), 0.05)
    grounds = record + np.cos, jp.ground.Scaled(WAVES[0], 1.0)
    for ground, member in zip(grounds, Ensemble.of(grounds, GRID), strict=True):
        shaking = [x.in_si(9.81).acceleration(T) for x in (ground, member)]
        np.testing.assert_allclose(*shaking, atol=1e-9)
    wave = jp.travelling(record, 10.0, (0.0, 5.0))
    (member,) = Ensemble.of([wave], GRID)
    for k in (0, 1):
        shaking = [at_support(x.in_si(9.81), k).acceleration(T) for x in (wave, member)]
        np.testing.assert_allclose(*shaking, atol=1e-9)


def test_given_earthquakes_of_all_kinds_add_up_and_join_those_that_are_drawn():
    ensemble = Ensemble.of([np.sin, WAVES[0]], GRID)
    np.testing.assert_allclose(accelerations(ensemble)[0], np.sin(GRID.times()))
    both = Ensemble.of(WAVES, GRID).including(RECORDS, GRID)
    expected = np.stack([ground.acceleration(T) for ground in GIVEN["both"]])
    np.testing.assert_allclose(accelerations(both), expected, atol=1e-12)
    wave = jp.RandomRicker(2, jp.LogNormal(0.1, 0.5), jp.Uniform(1.0, 3.8), jp.Uniform(1.0, 7.0))
    drawn = Ensemble.drawn(jp.Scenarios(PAPER, wave), 3)
    both = drawn.including(RECORDS, GRID)
    expected = [*accelerations(drawn), *(one.acceleration(T) for one in RECORDS)]
    np.testing.assert_allclose(accelerations(both), expected, atol=1e-12)
    fresh, same = both.fresh(4), drawn.fresh(4)
    np.testing.assert_array_equal(accelerations(fresh), accelerations(same))
    assert Ensemble.of(WAVES, GRID).including(RECORDS, GRID).fresh(4) is None


def test_drawn_earthquakes_are_monte_carlo_s():
    drawn = study(n=12, key=3)
    ensemble = Ensemble.drawn(RANDOM, 8, 3)
    structures, grounds = jax.jit(jax.vmap(RANDOM.realize))(drawn.points())
    np.testing.assert_allclose(ensemble.grounds.amplitude, grounds.amplitude[:8])
    np.testing.assert_allclose(ensemble.uncertain["friction"], structures.friction[:8])
    assert list(ensemble.uncertain) == ["friction"]
    assert list(Ensemble.drawn(RANDOM, 1).uncertain) == ["friction"]
    np.testing.assert_allclose(ensemble.fresh(4).grounds.periods, grounds.periods[8:])
    assert "8 earthquakes, with uncertain friction" in repr(ensemble)


def test_what_depends_on_a_draw_is_uncertain_even_where_it_seldom_varies():
    def rarely_weak(z):
        rod = dataclasses.replace(PAPER.rod_1, tau_x=np.float64(2.0) * PAPER.rod_1.tau_x)
        friction = jnp.where(z[0] > 9, 0.1, 0.3)
        return dataclasses.replace(PAPER, rod_1=rod, friction=friction, initial_gap=jnp.cos(0.5))

    scenarios = jp.Scenarios(jp.CustomDraw(rarely_weak, 1), WAVES[0])
    ensemble = Ensemble.drawn(scenarios, 3)
    assert list(ensemble.uncertain) == ["friction"]
    np.testing.assert_array_equal(ensemble.uncertain["friction"], 0.3)


TWO, FULL = Ensemble.drawn(RANDOM, 2), r"n = 1,000,000,000,000 would take \d+ TB of memory"
UNCERTAIN = "friction is uncertain; these have no value of it"


def beyond(sampling, most):
    return Ensemble.drawn(RANDOM, 2, sampling=sampling, start=most - 1)


test_bad_ensembles_are_named = refusals(
    (lambda: Ensemble.of([], GRID), "must hold ground motions"),
    (lambda: Ensemble.of([3], GRID), r"grounds\[0\] = 3 must have acceleration"),
    (lambda: Ensemble.drawn(RANDOM, 0), "n = 0 must be a positive"),
    (lambda: Ensemble.drawn(RANDOM, 2, -1), "key = -1 must be a whole number from 0"),
    (lambda: Ensemble.drawn(RANDOM, 2, jax.random.key(3, impl="rbg")), "key of kind rbg"),
    (lambda: Ensemble.drawn(RANDOM, 2, "a"), "key = 'a' must be a whole number or a key of jax"),
    (lambda: Ensemble.drawn(RANDOM, 4, sampling="grid"), "must be one of plain, sobol"),
    (lambda: TWO.including(WAVES, GRID), UNCERTAIN),
    (lambda: Ensemble.drawn(RANDOM, 10**12), FULL),
    (lambda: TWO.fresh(10**12), FULL),
    (lambda: beyond("plain", 2**31), "start . n = 2,147,483,649 must be at most 2,147,483,648"),
    (lambda: beyond("sobol", 2**30), "start . n = 1,073,741,825 must be at most 1,073,741,824"),
    of=lambda _, make: make(),
    fixtures=("small_machine",),
)
