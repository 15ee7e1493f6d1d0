import dataclasses
import itertools
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from tests.made import changed, pair_demand, pair_response
from tests.refusals import refused
from tests.test_tables import assert_shown

T, PAPER = np.linspace(0, 2, 201), jp.paper.structures()


@pytest.fixture(scope="module")
def run():
    return jax.device_get(jp.simulate(PAPER, jp.paper.ground(), jp.TimeGrid(0.02, 1000)))


def synthetic(**series):
    """A response of block 1 alone, of given series."""
    return pair_response(T, series, masses=(1.0, 4.0))


def test_energy_terms_are_the_integrals_of_the_powers_and_notice_wrong_forces(run):
    """A motion that solves no equation: each term alone against its closed form."""
    t, close = T, {"atol": 2e-4}
    energy_of = jax.jit(lambda response: response.energy)
    response = synthetic(
        **{"v1": np.sin(t), "v2": t, "f1": 3 * np.cos(t), "f2": 2 + 0 * t, "friction": 0.5 + 0 * t},
        **{"ground_acceleration": -1 + 0 * t, "ground_velocity": -t},
    )
    energy = jax.device_get(energy_of(response))
    np.testing.assert_allclose(energy.rods, 1.5 * np.sin(t) ** 2 + t**2, **close)
    np.testing.assert_allclose(energy.friction, 0.5 * (1 - np.cos(t)) - 0.25 * t**2, **close)
    np.testing.assert_allclose(energy.kinetic, np.sin(t) ** 2 / 2 + 2 * t**2, **close)
    np.testing.assert_allclose(energy.input, 1 - np.cos(t) + 2 * t**2, **close)
    balance = energy.rods + energy.friction + energy.kinetic - energy.input
    np.testing.assert_allclose(energy.residual, balance, atol=1e-15)
    wrong = changed(run, f1=run.f1 * 1.1)
    sound, broken = (np.abs(energy_of(r).residual).max() for r in (run, wrong))
    assert broken > 3 * sound


def test_a_link_has_a_damper_where_it_has_a_slip_force():
    """Equal buildings move together: no motion of theirs tells a stuck damper from none."""
    equal = {"rod_2": PAPER.rod_1, "mass_ratio": 1.0, "stiffness_ratio": 1.0}
    for friction in (0.0, 0.3):
        structures = dataclasses.replace(PAPER, **equal, friction=friction)
        run = jp.simulate(structures, jp.paper.ground(), jp.TimeGrid(0.02, 1000))
        assert not run.friction.any()
        assert [phase.kind for phase in run.phases()] == ["stick"]
        assert ("damper" in str(run)) == (friction > 0)
        in_si = jp.Scales(mass=2e5, frequency=7.0).to_si(run)
        assert float(in_si.links[0].slip_force) == pytest.approx(friction * 2e5 * 9.80665)


def test_phases_are_the_runs_of_equal_direction_without_holes(run):
    direction = np.repeat([0, 1, -1, 0], [50, 60, 40, 51]).astype(float)
    phases = synthetic(phase=direction, change_time=T + 0.003).phases()
    assert [p.kind for p in phases] == ["stick", "slip right", "slip left", "stick"]
    starts = [0.0, *(T[[50, 110, 150]] + 0.003)]
    np.testing.assert_allclose([p.start for p in phases], starts)
    np.testing.assert_allclose([p.end for p in phases], [*starts[1:], 2.0])
    phases = run.phases()
    assert (phases[0].start, phases[-1].end) == (0, float(run.time[-1]))
    for one, following in itertools.pairwise(phases):
        assert one.end == following.start > one.start
        assert one.kind != following.kind
    t, w = np.asarray(run.time), np.asarray(run.slip_velocity)
    for phase in phases:
        inside = w[(t > phase.start + 0.02) & (t < phase.end - 0.02)]
        sign = {"stick": 0, "slip right": 1, "slip left": -1}[phase.kind]
        assert (np.sign(inside) == sign).all(), phase


def test_absolute_accelerations_and_pounding_are_those_of_the_blocks(run):
    """Against second differences of x plus the mean of u'' over the step, away from the kinks."""
    t, ground = np.asarray(run.time), np.asarray(run.ground_acceleration)
    mean = ground[1:-1] + np.diff(ground, 2) / 24
    changes = np.array([p.start for p in run.phases()[1:]])
    away = np.abs(t[1:-1, None] - changes).min(axis=1) > 0.04
    for x, a in zip((run.x1, run.x2), run.absolute_accelerations, strict=True):
        seen = np.diff(np.asarray(x), 2) / 0.02**2 + mean
        np.testing.assert_allclose(seen[away], np.asarray(a)[1:-1][away], atol=0.02)
    np.testing.assert_allclose(run.gap, 1 + run.x2 - run.x1, atol=1e-14)

    def pounds(gap):
        structures = jp.AdjacentStructures(PAPER.rod_1, PAPER.rod_2, 1.0, 2.0, 0.25, gap)
        grid, only = jp.TimeGrid(0.02, 500), ("min_gap",)
        return jp.demand(structures, jp.paper.ground(), grid, only=only).pounds

    gaps = np.array([0.5, 0.6, 0.7, 0.8])
    np.testing.assert_array_equal(jax.jit(jax.vmap(pounds))(gaps), [1, 1, 0, 0])
    with pytest.raises(AttributeError, match=r"no attribute 'pounds'; its demand has it: .demand"):
        _ = run.pounds
    with pytest.raises(AttributeError, match=r"no attribute 'pound'$"):
        _ = run.pound


def test_a_gap_first_closes_between_instants_or_never():
    closing = pair_response(T, {"gap": 0.995 - T}, demand=pair_demand(0.995 - T[-1]))
    assert closing.first_contact() == pytest.approx(0.995, abs=1e-12)
    open_again = changed(closing, gap=1 + T)  # between two instants
    assert open_again.first_contact() == float(open_again.demand.min_gap_time)
    assert np.isnan(pair_response(T, {"gap": 1 + T}, demand=pair_demand(1.0)).first_contact())
    refused("link = 1 must be the number of one of the 1 links", closing.first_contact, 1)


def test_results_show_themselves(run):
    text = repr(run)
    assert_shown(run)
    smallest = f"{float(run.min_gap):.6g}"
    for words in ("EventResolved", "1000 steps of 0.02", smallest, "12 phases"):
        assert words in text
    assert "POUNDS" not in text
    assert "POUNDS" in repr(jax.tree.map(lambda x: -x, run))
    shown = assert_shown(run.demand)
    for name, value in run.demand.scalars().items():
        assert shown[shown.index(name) + 1] == f"{value:.8g}"
    assert shown[shown.index("peak_f2") + 2] == "m1 g"
    si = jp.Scales(mass=500e3, frequency=7.0).to_si(run)
    assert " m at " in "".join(assert_shown(si))
    shown = assert_shown(si.demand)
    assert shown[shown.index("peak_f2") + 2] == "N"
    jax.jit(lambda result: assert_shown(result) and result.min_gap)(run.demand)
    for leaf in (None, object(), jax.ShapeDtypeStruct((3,), float)):
        empty = jax.tree.map(lambda _, leaf=leaf: leaf, run)
        assert "not known before the program runs" in repr(empty)
        assert "not known before the program runs" in repr(empty.demand)


def test_a_batch_shows_its_range(run):
    batch = jax.tree.map(lambda x: np.stack([x, 3 * x, -x, np.nan * x]), run)
    invalid = "1 invalid, with NaN for every result"
    for result, owner in ((batch, "Response"), (batch.demand, "Demand")):
        shown = assert_shown(result)
        assert shown[0].startswith(owner)
        assert "(dimensionless, batch of shape (4,))" in shown[0]
        at = shown.index("peak_x1")
        peak = float(run.demand.peak_x1)
        assert shown[at + 1 : at + 5] == [f"{k * peak:.5g}" for k in (-1, 1, 3)] + ["g/ω1²"]
        assert shown[-2:] == ["pounding in 1 of 3 valid runs", invalid]
    assert assert_shown(batch[3:])[1:] == ["pounding in 0 of 0 valid runs", invalid]
    for result in (batch[3], batch[3].demand):
        assert "an invalid run, every result is NaN" in assert_shown(result)[0]


def test_scalars_of_one_run_are_python_s_numbers_and_stay_traced(run):
    scalars = run.demand.scalars()
    assert {type(x) for x in scalars.values()} == {float}
    assert json.loads(json.dumps(scalars)) == scalars
    batch = jax.tree.map(lambda x: np.stack([x, x]), run.demand)
    assert batch.scalars()["peak_x1"] is batch.peak_x1

    def doubled(demand):
        return {name: 2 * x for name, x in demand.scalars().items()}

    expected = {name: 2 * x for name, x in run.demand.scalars().items()}
    assert jax.jit(doubled)(run.demand) == expected
    assert {name: float(x[1]) for name, x in jax.vmap(doubled)(batch).items()} == expected
    slope = jax.grad(lambda demand: demand.scalars()["pgv"] ** 2)(run.demand)
    assert float(slope.pgv) == pytest.approx(2 * float(run.demand.pgv))


def test_a_run_draws_itself_and_a_batch_and_an_invalid_run_have_no_phases(run):
    figure = run.plot()
    times, gap = figure.axes[-1].lines[0].get_data()
    np.testing.assert_array_equal(times, run.time)
    np.testing.assert_array_equal(gap, run.gap)
    batch = jax.tree.map(lambda x: np.stack([x, x]), run)
    assert len(batch.plot().axes) == len(figure.axes)
    refused(r"batch of shape \(2, 1001\) must be indexed", batch.phases)
    invalid = jax.tree.map(lambda x: x * jnp.nan, run)
    for method in (invalid.plot, invalid.phases):
        refused("the run is invalid", method)


@pytest.mark.parametrize(
    "index", [0, -1, slice(1, 3), np.array([True, False, True]), [2, 0]], ids=str
)
def test_runs_of_a_batch_by_index(batch, index):
    one = batch[index]
    np.testing.assert_array_equal(one.gap, np.asarray(batch.gap)[index])
    np.testing.assert_array_equal(one.demand.min_gap, np.asarray(batch.demand.min_gap)[index])
    np.testing.assert_array_equal(batch.demand[index].peak_f1, one.demand.peak_f1)
    assert one.method == batch.method
    with pytest.raises(IndexError):
        batch[3]
    assert [float(r.min_gap) for r in batch] == [float(x) for x in batch.min_gap]
    if isinstance(index, int):
        assert one.phases()
        with pytest.raises(TypeError, match="Response: only a batch has an index"):
            one[0]
