import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, reject
from hypothesis import strategies as st
from scipy import stats

import jaxpound as jp
from jaxpound.scenarios.scenarios import discrete_coordinates, parameter_names, parameters
from tests.refusals import refusals, refused
from tests.storing import studied

PAPER = jp.paper.structures()
PATHS = [
    *(f"rod_{i}.{name}" for i in (1, 2) for name in ("order", "tau_f", "tau_x")),
    *("mass_ratio", "stiffness_ratio", "friction", "initial_gap"),
]
WAVELETS = jp.LogNormal(0.2, 0.5), jp.Uniform(1.0, 3.0), jp.Uniform(0.0, 8.0)
RICKER = jp.RandomRicker(3, *WAVELETS, intensity=jp.LogNormal(1, 1))
SIZES = (5, 0.1), (9, 0.2), (7, 0.05)
RECORDS = [jp.Record(np.sin(np.arange(k)), dt, time_unit="1/ω1") for k, dt in SIZES]


def value(structures, path):
    for name in path.split("."):
        structures = getattr(structures, name)
    return float(structures)


def normals(d):
    return st.lists(st.floats(-9, 9), min_size=d, max_size=d).map(np.array)


distributions = st.one_of(
    st.builds(jp.Normal, st.floats(-2, 2), st.floats(0.1, 3)),
    st.builds(jp.LogNormal, st.floats(0.01, 10), st.floats(0.1, 2)),
    st.builds(lambda low, wide: jp.Uniform(low, low + wide), st.floats(-1, 1), st.floats(0.1, 3)),
)


@pytest.mark.filterwarnings("ignore::jaxpound.PlausibilityWarning")
@given(st.dictionaries(st.sampled_from(PATHS), distributions, min_size=1), st.data())
def test_no_draw_is_invalid(uncertain, data):
    """Whatever the distributions: τ_x ≥ τ_f, orders in (0, 1], the rest of its sign."""
    try:
        draw = jp.UncertainStructures(PAPER, uncertain)
    except ValueError:  # where a distribution is nearly all outside
        reject()
    assert draw.dimension == len(uncertain)
    z = data.draw(normals(draw.dimension))
    structures = draw.draw(z)  # whose own rules raise
    for path, x in draw.parameters(z).items():
        assert value(structures, path) == float(x)
    for path in set(PATHS) - set(uncertain):
        assert value(structures, path) == value(PAPER, path)


def test_distributions_far_from_bounds_stay_and_relaxation_times_keep_their_order():
    uncertain = {"friction": jp.LogNormal(0.25, 0.2), "rod_1.tau_x": jp.Normal(1.2, 0.1)}
    draw = jp.UncertainStructures(PAPER, uncertain)
    z = np.array([0.7, -1.3])
    values = list(draw.parameters(z).values())
    np.testing.assert_allclose(values, [0.25 * np.exp(0.14), 1.2 - 0.13], rtol=1e-12)
    # τ_f below a certain τ_x; τ_x above the τ_f drawn, as given that it is above.
    same = jp.LogNormal(1.0, 0.5)
    z = jnp.asarray(np.random.default_rng(0).normal(size=(20_000, 2)))
    with pytest.warns(jp.PlausibilityWarning, match=r"rod_1.tau_f .*: 50.00% .* \[1e-30, 1.183\]"):
        alone = jp.UncertainStructures(PAPER, {"rod_1.tau_f": jp.LogNormal(1.183, 0.5)})
    tau_f = jax.jit(jax.vmap(alone.draw))(z[:, :1]).rod_1.tau_f
    expected = stats.truncnorm(-np.inf, 0.0, scale=0.5)
    assert stats.kstest(np.log(tau_f / 1.183), expected.cdf).pvalue > 0.01
    both = jp.UncertainStructures(PAPER, {"rod_2.tau_x": same, "rod_2.tau_f": same})
    rod = jax.jit(jax.vmap(both.draw))(z).rod_2
    assert (rod.tau_x >= rod.tau_f).all()
    assert stats.kstest(np.log(rod.tau_f), stats.norm(scale=0.5).cdf).pvalue > 0.01
    rod = jax.tree.map(np.asarray, rod)
    above = stats.norm.sf(np.log(rod.tau_x) / 0.5) / stats.norm.sf(np.log(rod.tau_f) / 0.5)
    assert stats.kstest(above, "uniform").pvalue > 0.01


def test_random_wavelets_have_their_distributions_and_signs():
    z = jnp.asarray(np.random.default_rng(1).normal(size=(20_000, RICKER.dimension)))
    assert RICKER.dimension == 3 * 4 + 1
    named, waves = jax.jit(jax.vmap(lambda z: (RICKER.parameters(z), RICKER.draw(z))))(z)
    assert stats.kstest(np.log(named["amplitude_2"] / 0.2) / 0.5, "norm").pvalue > 0.01
    assert stats.kstest((named["period_3"] - 1) / 2, "uniform").pvalue > 0.01
    assert stats.kstest(named["arrival_1"] / 8, "uniform").pvalue > 0.01
    assert stats.kstest(np.log(named["intensity"]), "norm").pvalue > 0.01
    assert waves.amplitude.shape == (20_000, 3)
    assert abs(float((waves.amplitude < 0).mean()) - 0.5) < 0.01
    expected = named["intensity"] * named["sign_2"] * named["amplitude_2"]
    np.testing.assert_allclose(waves.amplitude[:, 1], expected)
    for negative, sign in ((0.0, 1.0), (1.0, -1.0)):
        draw = dataclasses.replace(RICKER, negative=negative, intensity=None)
        assert draw.dimension == 9
        np.testing.assert_allclose(draw.draw(jnp.zeros(9)).amplitude, sign * 0.2)
        names = [*(f"amplitude_{i}" for i in (1, 2, 3)), "period_1"]
        assert list(draw.parameters(jnp.zeros(9)))[:4] == names
    size = RICKER.amplitude
    signed = jp.RandomRicker(3, jp.scenarios.TwoSided(size), RICKER.periods, RICKER.arrivals)
    assert (signed.dimension, signed.discrete, signed.negative) == (9, (), 0.0)
    z = np.array([-2.0, -0.1, 1.0, *np.zeros(6)])
    expected = jp.scenarios.TwoSided(size).from_normal(z[:3])
    np.testing.assert_allclose(signed.draw(z).amplitude, expected)
    assert (np.sign(expected) == [-1, -1, 1]).all()
    other = dataclasses.replace(signed, negative=0.5)
    assert (other.dimension, other.discrete) == (12, (9, 10, 11))


def test_sets_say_which_of_their_numbers_are_discrete():
    structures = jp.UncertainStructures(PAPER, {"friction": jp.LogNormal(0.25, 0.2)})
    records = jp.RandomRecord(RECORDS, jp.LogNormal(1.0, 0.5))
    custom = jp.CustomDraw(lambda z: RECORDS[0], 3, discrete=(1,))
    for ground, expected in (
        (RICKER, (10, 11, 12)),
        (dataclasses.replace(RICKER, negative=0.0), ()),
        (records, (1,)),
        (dataclasses.replace(records, records=RECORDS[:1]), ()),
        (custom, (2,)),
        (jp.Ricker(0.1, 1.0, 1.0), ()),
    ):
        scenarios = jp.Scenarios(structures, ground)
        assert scenarios.discrete == discrete_coordinates(scenarios) == expected
    names = parameter_names(jp.Scenarios(structures, RICKER))
    assert [names[i] for i in (10, 11, 12)] == ["sign_1", "sign_2", "sign_3"]
    assert discrete_coordinates(object()) == ()


def test_a_record_is_drawn_whole_and_scaled():
    draw = jp.RandomRecord(RECORDS, jp.LogNormal(2.0, 0.3), weights=(1, 2, 1))
    assert draw.dimension == 2
    t = np.linspace(-0.2, 3.0, 400)
    realize = jax.jit(lambda z: (draw.draw(z).acceleration(t), draw.parameters(z)))
    for z, i in ((-1.0, 0), (0.0, 1), (0.6, 1), (0.8, 2)):
        drawn, named = realize(jnp.array([z, 1.0]))
        factor, knots = 2 * np.exp(0.3), RECORDS[i].dt * np.arange(-1, RECORDS[i].n_samples + 1)
        expected = factor * np.interp(t, knots, np.pad(RECORDS[i].samples, 1))
        np.testing.assert_allclose(drawn, expected, atol=1e-12)
        assert (int(named["record"]), float(named["factor"])) == (i, pytest.approx(factor))
    z = jnp.asarray(np.random.default_rng(2).normal(size=(20_000, 2)))
    which = np.asarray(jax.jit(jax.vmap(draw.parameters))(z)["record"])
    np.testing.assert_allclose(np.bincount(which) / 20_000, [0.25, 0.5, 0.25], atol=0.01)
    draw = jp.RandomRecord(RECORDS[:1], jp.Uniform(0.5, 2.0))
    assert draw.dimension == 1
    np.testing.assert_allclose(draw.draw(jnp.zeros(1)).samples, 1.25 * RECORDS[0].samples)


def test_parts_combine_in_order_with_names_and_derivatives():
    uncertain = {"friction": jp.Uniform(0.1, 0.5), "rod_2.order": jp.Uniform(0.3, 0.9)}
    structures = jp.UncertainStructures(PAPER, uncertain)
    both = jp.Scenarios(structures, RICKER)
    z = jnp.asarray(np.random.default_rng(3).normal(size=15))
    drawn, ground = both.realize(z)
    for ours, theirs in ((drawn, structures.draw(z[:2])), (ground, RICKER.draw(z[2:]))):
        for one, other in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
            np.testing.assert_allclose(one, other)
    names = parameter_names(both)
    assert names[:3] == ("friction", "rod_2.order", "amplitude_1")
    assert len(names) == both.dimension == 15
    fixed = jp.Scenarios(PAPER, RICKER)
    assert fixed.dimension == 13
    assert fixed.realize(z[:13])[0] is PAPER
    assert jp.Scenarios(structures, jp.paper.ground()).dimension == 2

    def ground(z):
        return jp.Ricker(0.3 * jnp.exp(z[0]), [2.0], [3.0 + z[1]])

    named = jp.CustomDraw(ground, 2, ("strength", "delay"))
    unnamed = jp.CustomDraw(ground, 2)
    z = jnp.array([0.5, -0.5, 1.0])
    assert list(parameters(jp.Scenarios(PAPER, named), z[:2])) == ["strength", "delay"]
    structures = jp.UncertainStructures(PAPER, {"friction": jp.Uniform(0.1, 0.5)})
    assert parameter_names(jp.Scenarios(structures, unnamed)) == ("friction", "z_2", "z_3")
    assert float(named.draw(z).arrivals[0]) == 2.5
    both = jp.Scenarios(UNCERTAIN(PAPER, {"rod_1.tau_x": jp.LogNormal(1.2, 0.3)}), RICKER)
    z = jnp.asarray(np.random.default_rng(4).normal(size=both.dimension))

    @jax.jit
    def total(z):
        return sum(jnp.sum(leaf) for leaf in jax.tree.leaves(both.realize(z)))

    slopes = jax.jit(jax.grad(total))(z)
    h = 1e-6
    numeric = [(total(z + h * e) - total(z - h * e)) / (2 * h) for e in np.eye(z.size)]
    np.testing.assert_allclose(slopes, numeric, rtol=1e-6, atol=1e-8)


def random_structures(distribution):
    return jp.UncertainStructures(PAPER, {"friction": distribution})


def random_periods(distribution):
    return jp.RandomRicker(2, U, distribution, U)


def random_pulse(distribution):
    return jp.scenarios.RandomPulse(0.1, distribution, 1.0)


@pytest.mark.parametrize("draw", [random_structures, random_periods, random_pulse])
def test_what_a_range_cuts_off_is_said_where_it_matters(draw):
    lost = r"~ Normal\(mean=1.0, std=0.5\): 2.28% of its prob.*, outside \[.*, inf\], is cut off"
    with pytest.warns(jp.PlausibilityWarning, match=lost) as warned:
        draw(jp.Normal(1.0, 0.5))
    assert warned[0].filename == __file__
    for silent in (jp.Normal(1.0, 0.3), jp.LogNormal(1.0, 2.0)):
        draw(silent)
    refused("must have at least 10% of its probability in", draw, jp.Normal(-1.0, 0.5))

    # In a traced function likewise; a traced distribution is not judged.
    assert float(jax.jit(lambda x: draw(jp.Normal(1.0, 0.3)).dimension + x)(0.5)) > 1
    assert float(jax.jit(lambda x: draw(jp.Normal(x, 0.5)).dimension + x)(0.5)) > 1


U, LOW = jp.Uniform(0.1, 1.0), {"rod_1.tau_x": jp.Uniform(0.0, 0.004)}
UNCERTAIN = jp.UncertainStructures
IN_RANGE = r"rod_1.order ~ Uniform\(low=1.2, high=1.8\) must have at least 10% .* in \[1e-30, 1\]"
RUBBED, FRICTION = UNCERTAIN(PAPER, {"friction": U}), jp.CustomDraw(abs, 1, ("friction",))
test_bad_values_are_named = refusals(
    (lambda: jp.UncertainStructures(PAPER, {}), "must name a parameter"),
    (UNCERTAIN, PAPER, {"rod_1.tau_y": U}, "unknown path 'rod_1.tau_y'; did you mean 'rod_1.tau_"),
    (UNCERTAIN, PAPER, {"friction": 0.2}, "friction = 0.2 must be of type"),
    (UNCERTAIN, PAPER, {"rod_1.order": jp.Uniform(1.2, 1.8)}, IN_RANGE),
    (UNCERTAIN, PAPER, LOW, r"must have at least 10% of its probability in \[0.004, inf\]"),
    (UNCERTAIN, 3, {"friction": U}, "nominal = 3 must be of type"),
    (lambda: jp.RandomRicker(0, U, U, U), "wavelets = 0 must be a positive whole number"),
    (lambda: jp.RandomRicker(2, 0.3, U, U), "amplitude = 0.3 must be of type Distribution"),
    (lambda: jp.RandomRicker(2, U, U, U, negative=1.5), "negative = 1.5 must be between 0 and 1"),
    (lambda: jp.RandomRecord([]), r"records = \[\] must hold at least one record"),
    (lambda: jp.RandomRecord([3]), r"records\[0\] = 3 must be of type Record"),
    (lambda: jp.RandomRecord(RECORDS, weights=(1, 2)), r"weights = \(1, 2\) must be 3 numbers"),
    (lambda: jp.RandomRecord(RECORDS, weights=(0, 0, 0)), "with a positive sum"),
    (lambda: jp.Scenarios(PAPER, jp.paper.ground()), "both fixed; one must be drawn"),
    (jp.Scenarios, RUBBED, FRICTION, "friction, must be 2 different names"),
    (lambda: jp.Scenarios(3, RICKER), "structures = 3 must be of type Structures or"),
    (lambda: jp.Scenarios(PAPER, 3), "ground = 3 must have acceleration"),
    (lambda: jp.CustomDraw(3, 1), "function = 3 must be a function of z"),
    (lambda: jp.CustomDraw(abs, 0), "dimension = 0 must be a positive whole number"),
    (lambda: jp.CustomDraw(abs, 2, ("a", "a")), "must be 2 different names"),
    (lambda: jp.CustomDraw(abs, 2, discrete=(2,)), r"discrete = \(2,\) must be indices from 0"),
)


@pytest.mark.usefixtures("small_machine")
def test_more_numbers_than_memory_has_room_for_are_refused():
    refused("wavelets = 1,000,000 would take 88 GB of memory;", jp.RandomRicker, 1_000_000, U, U, U)
    refused("dimension = 1,000,000,000 would take 22 TB of memory", jp.CustomDraw, abs, 10**9)


@pytest.mark.parametrize("sampling", ["plain", "sobol"])
def test_scenarios_by_index_are_those_of_the_study(sampling):
    scenarios = jp.Scenarios(UNCERTAIN(PAPER, {"friction": jp.LogNormal(1, 2)}), RICKER)
    grid, options = jp.TimeGrid(0.1, 40), {"sampling": sampling, "keep_parameters": True}
    study = studied(scenarios, 8, grid, key=3, **options)
    batch = scenarios.at([5, 0, 6], 3, sampling=sampling)
    np.testing.assert_allclose(batch[0].friction, study["friction"][[5, 0, 6]])
    np.testing.assert_allclose(batch[1].arrivals[:, 0], study["arrival_1"][[5, 0, 6]])
    structures, ground = scenarios.at(study.indices[6], 3, sampling=sampling)
    assert jnp.shape(structures.friction) == ()
    assert float(jp.demand(structures, ground, grid).min_gap) == pytest.approx(study["min_gap"][6])
    whole, within = "must be whole numbers", "must be from 0 to"
    for indices, message in (
        *((1.5, whole), ([], whole), (-1, within), (2**31, within), ([[1]], r"shape \(n,\)")),
    ):
        refused(message, scenarios.at, indices, 3, sampling=sampling)
