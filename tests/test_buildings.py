"""Buildings in SI units: every function takes them, and answers as for their dimensionless form."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from jaxpound.design.problem import DesignProblem
from jaxpound.ground.run_input import as_run
from jaxpound.model.system import in_si, without_contact
from jaxpound.quantities import unit
from jaxpound.results.named import kind_of
from jaxpound.study.gaps import double_difference_correlation
from tests.model.test_system import KnownCushion
from tests.refusals import refusals, refused

LEFT = jp.Building.from_period(mass=500e3, period=0.9, damping_ratio=0.05)
RIGHT = jp.Building.from_period(mass=400e3, period=0.6, damping_ratio=0.05)
LAW = jp.KelvinVoigt(stiffness=2e9, restitution=0.65)
PAIR = jp.Buildings((LEFT, RIGHT), (jp.FloorLink(0, 0, friction=100e3, gap=0.05),))


def linked(**changes):
    return dataclasses.replace(PAIR, links=(dataclasses.replace(PAIR.links[0], **changes),))


POUNDING = linked(gap=0.02, contact=LAW)
T = 0.02 * np.arange(400)
RECORD = jp.Record(0.2 * np.sin(7 * T) * np.exp(-((T - 3) ** 2)), 0.02, "burst")
WAVELET = jp.Ricker(0.03, 0.8, 2.0)
GRID = jp.TimeGrid.until(float(RECORD.duration), 0.01)


def scaled(buildings):
    row, scales = buildings.dimensionless()
    return row, scales, scales.grid(GRID.duration, GRID.dt)


def close(result, expected, rtol=1e-8):
    assert jax.tree.structure(result) == jax.tree.structure(expected)
    for x, y in zip(*map(jax.tree.leaves, (result, expected)), strict=True):
        np.testing.assert_allclose(x, y, rtol=rtol, atol=rtol * np.abs(y).max())


def random_ground(scales=None):
    """Wavelets in metres and seconds, or the same in dimensionless numbers."""
    metre, second = (1.0, 1.0) if scales is None else (1 / scales.length, 1 / scales.time)
    times = (jp.Uniform(low * second, high * second) for low, high in ((0.6, 2.0), (1.0, 4.0)))
    return jp.RandomRicker(3, jp.LogNormal(0.015 * metre, 0.4), *times)


def test_runs_are_those_of_the_dimensionless_form_with_records_in_g_and_motions_in_metres():
    response = jp.simulate(POUNDING, RECORD + WAVELET, GRID)
    row, scales, grid = scaled(POUNDING)
    metre, second = 1 / scales.length, 1 / scales.time
    same = jp.Ricker(0.03 * metre, 0.8 * second, 2.0 * second)
    expected = scales.to_si(jp.simulate(row, scales.to_dimensionless(RECORD) + same, grid))
    assert (response.si, response.demand.si) == (True, True)
    assert float(response.demand.n_impacts) > 2
    assert str(response) == str(expected)
    close(response.demand, expected.demand)
    for name in ("x1", "v2", "f1", "gap", "friction", "ground_acceleration", "ground_velocity"):
        close(getattr(response, name), getattr(expected, name))
    alone = jp.demand(PAIR, WAVELET, GRID)
    assert float(alone.pga) == pytest.approx(float(jp.pga(WAVELET, GRID)), rel=1e-12)  # m/s²
    sampled = jp.demand(PAIR, lambda t: np.asarray(WAVELET.acceleration(t)), GRID)
    assert float(sampled.min_gap) == pytest.approx(float(alone.min_gap), abs=1e-4)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class RectangularPulse:
    """A motion of a user's own; its ends need not be instants of the grid."""

    size: float
    start: float
    end: float

    def acceleration(self, t):
        return jnp.where((t >= self.start) & (t < self.end), self.size, 0.0)

    def velocity(self, t):
        return self.size * (jnp.clip(t, self.start, self.end) - self.start)


def test_a_user_s_motion_is_traced_in_metres_and_seconds_with_its_velocity():
    row, scales, grid = scaled(PAIR)
    pulse = RectangularPulse(-0.5, 1.0, 1.503)
    second, g = 1 / float(scales.time), jp.STANDARD_GRAVITY
    same = RectangularPulse(-0.5 / g, 1.0 * second, 1.503 * second)

    def slope_of(pulse, structures, grid):
        min_gap = partial(jp.demand, structures, grid=grid, only=("min_gap",))
        return jax.jit(jax.jacfwd(lambda pulse: min_gap(pulse).min_gap))(pulse)

    slope, expected = slope_of(pulse, PAIR, GRID), slope_of(same, row, grid)
    assert float(slope.end) == pytest.approx(float(expected.end) * scales.length * second, rel=1e-8)
    assert float(slope.size) == pytest.approx(float(expected.size) * scales.length / g, rel=1e-8)
    both = as_run(2.0 * RECORD + pulse, GRID, 9.8)
    assert both.grounds[1] is pulse
    assert float(both.acceleration(1.2)) == pytest.approx(2 * 9.8 * RECORD.acceleration(1.2) - 0.5)


def test_masses_and_stiffnesses_are_differentiated_and_batched_in_any_precision():
    only = ("min_gap",)

    def gap(mass):
        buildings = jp.Buildings((dataclasses.replace(LEFT, mass=mass), RIGHT), PAIR.links)
        return jp.demand(buildings, RECORD, GRID, only=only).min_gap

    single, masses = jax.jit(gap), np.array([450e3, 500e3])
    slope = (single(500e3 + 50.0) - single(500e3 - 50.0)) / 100.0
    gaps, slopes = jax.jit(jax.vmap(jax.value_and_grad(gap)))(masses)
    assert float(slopes[1]) == pytest.approx(float(slope), rel=1e-5)
    alone = [single(mass) for mass in masses.tolist()]
    np.testing.assert_allclose(gaps, alone, rtol=1e-12)
    response = jp.demand(*jax.tree.map(np.float32, (PAIR, RECORD)), GRID, only=only)
    assert response.min_gap.dtype == jnp.float32
    assert float(response.min_gap) == pytest.approx(float(alone[1]), abs=1e-5)


def test_a_study_is_in_si(tmp_path):
    uncertain = {"links.0.friction": jp.Uniform(50e3, 150e3)}
    scenarios = jp.Scenarios(jp.UncertainStructures(PAIR, uncertain), random_ground())
    storage = jp.Storage(tmp_path / "study", keep_parameters=True)
    study = jp.monte_carlo(scenarios, 48, GRID, key=3, store=storage, progress=False)
    row, scales, grid = scaled(PAIR)
    uncertain = {"links.0.friction": jp.Uniform(50e3 / scales.force, 150e3 / scales.force)}
    scenarios = jp.Scenarios(jp.UncertainStructures(row, uncertain), random_ground(scales))
    expected = jp.monte_carlo(scenarios, 48, grid, key=3, progress=False)
    for name in expected.columns:
        converted = expected[name] * scales.unit_of(kind_of(name))
        np.testing.assert_allclose(study[name], converted, rtol=1e-7, atol=1e-9)
        assert (study.unit(name), expected.unit(name)) == tuple(
            unit(kind_of(name), si) for si in (True, False)
        )
    assert 50e3 < study["links.0.friction"].min() < study["links.0.friction"].max() < 150e3
    assert all(words in str(study) for words in ("m/s²", "(SI)"))
    rules, correlation = study.separation(0.1), double_difference_correlation(0.9, 0.05, 0.6, 0.05)
    assert rules.correlation == pytest.approx(correlation, rel=1e-9)
    peaks = [study.quantile(f"peak_x{i}", 0.9).value for i in (1, 2)]
    assert rules.srss == pytest.approx(np.hypot(*peaks))
    again = jp.Study.open(tmp_path / "study")
    assert again.unit("min_gap") == "m"
    np.testing.assert_array_equal(again["required_gap"], study["required_gap"])


def test_rare_events_have_thresholds_in_metres_and_the_same_design_points():
    noise = jp.FilteredNoise(jp.KanaiTajimi(15.0, 0.6), 60, 0.04, intensity=0.1, time_unit="s")
    row, scales = PAIR.dimensionless()
    metre, grids = 1 / float(scales.length), (jp.TimeGrid.until(2.4, 0.04), scales.grid(2.4, 0.04))
    scenarios = jp.Scenarios(PAIR, noise), jp.Scenarios(row, scales.to_dimensionless(noise))
    cases = [*zip(scenarios, grids, (0.11, 0.11 * metre), strict=True)]
    state, expected = (jp.LimitState(*case[:2], threshold=case[2]) for case in cases)
    z = np.random.default_rng(1).normal(size=(4, state.dimension))
    numbers = np.array([50, 52, 54, 56]), np.zeros(4, int)
    values, slopes = state.gradients(z, *numbers)
    expected_values, expected_slopes = expected.gradients(z, *numbers)
    np.testing.assert_allclose(values * metre, expected_values, rtol=1e-7)
    np.testing.assert_allclose(slopes * metre, expected_slopes, rtol=1e-6, atol=1e-9)
    assert state.time_step == pytest.approx(expected.grid.dt)
    search = jp.reliability.EventSearch("design points", max_runs=768)
    options = {"search": search, "key": 1, "progress": False}
    touching = jp.LimitState(jp.Scenarios(linked(contact=LAW), noise), grids[0], threshold=0.11)
    np.testing.assert_allclose(touching.values(z), state.values(z), rtol=1e-9)  # it is left out
    event, expected = (jp.rare_event(*case, **options) for case in cases)
    assert len(event.instants) == len(expected.instants) > 5
    assert event.probability == pytest.approx(expected.probability, rel=1e-6)


def test_a_user_s_law_of_contact_has_rare_events_and_runs_as_it_is_written():
    """Its units are not known, so it has no dimensionless form; none is needed."""
    buildings = linked(contact=KnownCushion(2e8))
    state = jp.LimitState(jp.Scenarios(buildings, random_ground()), GRID, threshold=0.15)
    assert state.time_step == pytest.approx(scaled(PAIR)[2].dt)
    refused("must be a law of this package", buildings.dimensionless)

    laws = KnownCushion(2e9), jp.KelvinVoigt(stiffness=2e9, restitution=1.0)
    of_user, elastic = (linked(gap=0.02, contact=law) for law in laws)
    gap = jp.demand(of_user, RECORD + WAVELET, GRID, only=("min_gap",)).min_gap
    elastic = jp.simulate(elastic, RECORD + WAVELET, GRID)
    assert float(gap) == pytest.approx(float(elastic.min_gap), rel=1e-6)


def test_a_design_has_bounds_and_limits_in_newtons_and_metres():
    limits = {"damper_force": jp.design.Limit(300e3), "peak_x1": jp.design.Limit(0.2)}
    row, scales, grid = scaled(PAIR)

    def problem_of(structures, most, ground, grid):
        space = jp.DesignSpace(structures, {"links.0.friction": (0.0, most)})
        ensemble = jp.Ensemble.drawn(jp.Scenarios(structures, ground), 8, key=1)
        return DesignProblem(space, ensemble, grid, jp.Scheme(), jp.Objective(limits=limits))

    problem = problem_of(PAIR, 400e3, random_ground(), GRID)
    most = 400e3 / float(scales.force)
    same = problem_of(row, most, random_ground(scales), grid)
    share = np.array([0.6])
    columns, expected = (x.evaluate(share, x.ensemble) for x in (problem, same))
    assert columns.keys() == expected.keys()
    for name, values in columns.items():
        converted = expected[name] * scales.unit_of(kind_of(name))
        np.testing.assert_allclose(values, converted, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(columns["damper_force"], 240e3)


def test_runs_of_a_suite_are_those_of_the_dimensionless_form():
    records = [RECORD, jp.Record(1.5 * RECORD.samples[::-1], 0.02, "backwards")]
    analysis = jp.Analysis(POUNDING, records, GRID)
    stripes = jp.multiple_stripes(analysis, [0.1, 0.3], progress=False)
    row, scales, grid = scaled(PAIR)
    for pga, closings in zip(stripes.intensities, stripes.demands, strict=True):
        for record, closing in zip(records, closings, strict=True):
            shaking = scales.to_dimensionless(record.scaled_to_pga(pga))
            run = jp.demand(row, shaking, grid, only=("min_gap",))
            gap = row.links[0].gap - run.min_gap
            assert closing == pytest.approx(float(gap * scales.length), rel=1e-6)
    assert "required gap (m)" in str(stripes)


def test_modes_of_one_building_have_its_dampers_and_those_of_all_are_of_the_system():
    damper = jp.Rod(jp.ZenerRod(0.5, 0.1, 0.4), 5e6)
    braced = jp.FloorLink(1, 0, damper=damper, next_building=jp.GROUND)
    stated = dataclasses.replace(braced, damper=dataclasses.replace(damper, ends=(1, jp.GROUND)))
    for link in (braced, stated):
        pair = jp.Buildings(PAIR.buildings, (link,))
        alone, both = pair.modes(1), jp.modes(pair)
        assert alone.damping_ratios[0] > PAIR.modes(1).damping_ratios[0] + 0.01
        assert both.si
        np.testing.assert_allclose(sorted(alone.periods)[-1], min(both.periods), rtol=1e-9)
    for wrong in (-1, 2, "x", 0.0):
        refused("^Buildings.modes: building = .* one of the 2 buildings, from 0", PAIR.modes, wrong)


def test_contact_in_newtons_is_run_in_single_precision():
    law = jp.KelvinVoigt(2e9, 0.6)
    pair = jp.Buildings(PAIR.buildings, (jp.FloorLink(0, 0, gap=0.03, contact=law),))
    ground, grid = jp.Ricker(0.1, 1.0, 2.0), jp.TimeGrid.until(8.0, dt=0.01)
    double = jp.demand(pair, ground, grid)
    halves = jax.tree.map(np.float32, (pair, ground))
    with pytest.warns(jp.PlausibilityWarning, match="contact is run in float32"):
        single = jp.demand(*halves, jp.TimeGrid.until(np.float32(8.0), dt=np.float32(0.01)))
    assert single.soft_peak_contact.dtype == np.float32
    assert single.soft_peak_contact == pytest.approx(float(double.soft_peak_contact), rel=1e-3)
    assert single.soft_peak_contact >= single.peak_contact > 1e7


def test_structures_know_their_units():
    row, _ = PAIR.dimensionless()
    assert (PAIR.units["force"], PAIR.units["length"]) == ("N", "m")
    for structures in (row, row.system(), jp.paper.structures()):
        assert (structures.units["force"], structures.units["length"]) == ("m1 g", "g/ω1²")


def test_without_contact_structures_stay_what_they_are():
    for structures in (POUNDING, scaled(POUNDING)[0], POUNDING.system()):
        passing = without_contact(structures)
        assert type(passing) is type(structures)
        assert in_si(passing) == in_si(structures)
        assert passing.system().links[0].contact is None
        assert passing.system().links[0].gap == structures.system().links[0].gap


BOTH, ROD = (LEFT, RIGHT), jp.paper.structures().rod_2
DIMENSIONLESS = jp.Record(RECORD.samples, 0.02, time_unit="1/ω1")
NOISE = jp.FilteredNoise(jp.KanaiTajimi(15.0, 0.6), 100, 0.02, intensity=0.1)
OF_STRUCTURES = "must be in units of 1/ω1, as the structures are.*Buildings takes it unchanged"
OF_LINKS = "floor_links: buildings = .* must be a tuple; .* its field buildings has each building"
SEVERAL = r"Buildings\(\(left, right\), links\) makes"
test_errors_name_the_argument = refusals(
    (jp.demand, PAIR, DIMENSIONLESS, GRID, "must be in seconds, as Buildings are"),
    (jp.demand, jp.paper.structures(), RECORD, GRID, OF_STRUCTURES),
    (jp.Scenarios, PAIR, NOISE, "Scenarios: ground = .*must be in seconds"),
)
test_buildings_name_the_argument = refusals(
    ((), (), r"buildings = \(\) must hold at least one"),
    ((LEFT,), (jp.FloorLink(0, 0, gap=0.1),), "links.0: next_building = 1 must be from 0 to 0"),
    ((LEFT, RIGHT), (jp.FloorLink(0, 0, gap=15),), "links.0.gap = 15 must be between 0 and 10 m"),
    ((LEFT, RIGHT), (), 0.0, "gravity = 0 must be positive"),
    ((LEFT, ROD), "buildings.1 = .* must be of type ShearBuilding or Building"),
    of=jp.Buildings,
    before="Buildings: ",
)
test_one_building_in_the_place_of_several = pytest.mark.unchecked(
    refusals(
        (jp.Buildings, LEFT, RIGHT, f"buildings = .* a tuple; {SEVERAL}"),
        (jp.floor_links, PAIR, OF_LINKS),
        (jp.simulate, BOTH, RECORD, GRID, f"structures = .* Buildings or .*; {SEVERAL}"),
    )
)


def test_tables_are_in_si_and_wavelets_hardly_in_metres_doubted():
    grid, ground, single = jp.TimeGrid(0.01, 100), jp.Ricker(0.02, 0.5, 0.4), jp.Buildings((LEFT,))
    stiffness = float(LEFT.stiffness)
    space = jp.DesignSpace(single, {"buildings.0.stiffness": (0.5 * stiffness, 2 * stiffness)})
    measured = {"x1": jp.simulate(single, ground, grid).x1}
    fit = jp.design.calibrate(space, measured, ground, grid, starts=1)
    assert "parameter (SI)" in str(fit)
    assert float(fit.structures.buildings[0].stiffness) == pytest.approx(stiffness, rel=1e-3)
    assert " m;" in str(jp.design.elasticities(single, ground, grid, demand="peak_x1"))
    uncertain = {"links.0.friction": jp.Uniform(5e4, 1e5), "links.0.gap": jp.Uniform(0.1, 0.2)}
    scenarios = jp.Scenarios(jp.UncertainStructures(PAIR, uncertain), jp.Ricker(30.0, 0.5, 0.2))
    says, grid = "PGA of 100% of the 2 earthquakes looked at, up to", jp.TimeGrid(0.01, 60)
    refused(says, jp.study.sobol_sensitivity, scenarios, grid, n=2, strict=True)


def test_modes_are_in_radians_per_second():
    """Growth takes records in seconds: ``test_divergence.py``."""
    modes, (row, scales) = jp.modes(PAIR), PAIR.dimensionless()
    assert "frequency (rad/s)  period (s)" in str(modes)
    np.testing.assert_allclose(modes.frequencies, jp.modes(row).frequencies * scales.frequency)


def test_units_that_are_hardly_meant_are_warned_of():
    for changes, words in (
        ({"friction": 100.0}, "slip force = 100 N should be 0 or between"),
        ({"gap": 9.0}, "gap = 9 m should be at most 5 times"),
        ({"contact": jp.KelvinVoigt(2e3, 0.65)}, "stiffness = 2000 N/m makes"),
    ):
        with pytest.warns(jp.PlausibilityWarning, match=rf"^Buildings: link 1–2, floor 1: {words}"):
            linked(**changes)
