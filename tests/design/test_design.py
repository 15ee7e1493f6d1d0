"""The search for a design: known optima of stand-ins, and the paper's case."""

import dataclasses
import json
import re
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from scipy import stats
from tqdm.auto import tqdm

import jaxpound as jp
from jaxpound.cli.design import summary
from jaxpound.cli.files import json_text
from jaxpound.design import search as design_search
from jaxpound.design.lagrangian import AugmentedLagrangian
from jaxpound.design.problem import DesignProblem
from jaxpound.results.named import LIMITABLE_OF_PAIR, kind_of
from tests.design.searches import in_search
from tests.made import OF_CONTACT, in_si
from tests.pickled import assert_survives_pickling
from tests.refusals import refusals, refused
from tests.study.test_demands import linked
from tests.test_tables import assert_shown

PAPER = jp.paper.structures()
GRID = jp.TimeGrid(0.1, 100)
SPACE = jp.DesignSpace(PAPER, {"friction": (0.0, 1.0), "mass_ratio": (0.5, 2.5)})
BLOCKS = [jp.Building.from_period(4e5, period, 0.05) for period in (0.9, 0.6)]
IN_SI = jp.DesignSpace(
    jp.Buildings(BLOCKS, jp.floor_links(BLOCKS, friction=5e4, gap=0.1)),
    {"links.0.friction": (0.0, 1.0), "buildings.0.mass": (2e5, 1e6)},
)
START_IN_SI = {"links.0.friction": 0.25, "buildings.0.mass": 4e5}
# An earthquake of the stand-in is a number: the amplitude of its wave.
AMPLITUDES = np.linspace(-0.2, 0.2, 8)
ENSEMBLE = jp.Ensemble.of([jp.Ricker(a, [1.0], [1.0]) for a in AMPLITUDES], GRID)


def bowl(friction, mass_ratio, a):
    """Highest, 1, at (0.6 + a, 1.5) for an earthquake a."""
    return 1 - (friction - 0.6 - a) ** 2 - 0.5 * (mass_ratio - 1.5) ** 2


MEAN, LOOSE = jp.Objective(), {"damper_force": 0.9}
LIMITED = jp.Objective(limits={"damper_force": 0.5})
ALONE = jp.Ensemble.of([jp.Ricker(0.1, [1.0], [1.0])], GRID)


@pytest.fixture
def stand_in(monkeypatch):
    """Demands by a formula in the place of the simulator's."""

    def install(gap=bowl):
        def demands(self, structures, ground):
            system, a = structures.system(), ground.amplitude[0]
            friction, mass_ratio = system.links[0].friction, system.masses[0] / system.masses[1]
            values = dict.fromkeys(LIMITABLE_OF_PAIR, friction)
            values |= {"peak_x1": mass_ratio, "initial_gap": 2.0}
            values |= {"min_gap": gap(friction, mass_ratio, a)}
            return {name: jnp.asarray(x, float) for name, x in values.items()}

        monkeypatch.setattr(DesignProblem, "demands", demands)

    install()
    return install


def search(objective=MEAN, space=SPACE, ensemble=ENSEMBLE, grid=GRID, **more):
    more = {"progress": False} | in_search({"starts": 3, "iterations": 80} | more)
    return jp.design_damper(space, ensemble, grid, objective=objective, **more)


@cache
def bowl_design():
    """The design of the bowl; for tests with the stand-in."""
    return search()


def test_the_optimum_of_a_bowl(stand_in):
    found = bowl_design()
    assert found.values["friction"] == pytest.approx(0.6, abs=1e-3)
    assert found.values["mass_ratio"] == pytest.approx(1.5, abs=1e-3)
    assert found.objective == pytest.approx(1 - np.mean(AMPLITUDES**2), abs=1e-6)
    assert found.gradient_norm < 1e-2
    assert found.active_bounds == {}
    assert found.structures.rod_1.tau_x == PAPER.rod_1.tau_x
    # All starts end there.
    ends = found.history.shares[-1]
    np.testing.assert_allclose(ends, np.broadcast_to([0.5, 0.6], ends.shape), atol=1e-2)


PEAK = {"friction": 0.6, "mass_ratio": 1.5}

WORST = jp.Objective(jp.SmallestGap("worst"))
OPTIMA = {
    "line searches": (MEAN, {"optimiser": optax.lbfgs(), "iterations": 12}, PEAK, 1e-6),
    "a penalty": (jp.Objective(penalties={"damper_force": 0.2}), {}, {"friction": 0.5}, 1e-3),
    "the worst earthquake": (WORST, {"iterations": 150}, {"friction": 0.6}, 5e-3),
    # A penalty of any size is no violation.
    "a large penalty": (
        *(jp.Objective(penalties={"peak_x1": 1e7}, limits=LOOSE), {}, {"mass_ratio": 0.5}, 1e-6),
    ),
}


@pytest.mark.parametrize(("objective", "more", "optimum", "within"), OPTIMA.values(), ids=OPTIMA)
def test_known_optima(stand_in, objective, more, optimum, within):
    found = search(objective, **more)
    for path, value in optimum.items():
        assert found.values[path] == pytest.approx(value, abs=within)
    if objective is WORST:  # its optimum is between the extremes
        assert found.objective == pytest.approx(1 - 0.2**2, abs=3e-3)
    assert found.limited_demands.get("damper_force", 0.0) <= 0.9


def test_bounds_that_hold_the_optimum_are_active(stand_in):
    space = jp.DesignSpace(PAPER, {"friction": (0.0, 0.4), "mass_ratio": (1.7, 2.5)})
    found = search(space=space, start={"friction": 0.2, "mass_ratio": 2.0})
    assert found.values == pytest.approx({"mass_ratio": 1.7, "friction": 0.4})
    assert found.active_bounds == {"mass_ratio": "low", "friction": "high"}
    assert found.gradient_norm == 0
    # The objective rises with friction by 2 (0.6 − 0.4) a unit, 0.4 wide; it falls with ρ.
    assert found.gradient["friction"] == pytest.approx(0.4 * 0.4)
    assert found.gradient["mass_ratio"] == pytest.approx(-0.2 * 0.8)


def test_a_damper_that_practically_never_slips_is_named():
    columns = {"damper_force": np.full(2, 0.3), "peak_x1": np.ones(2), "peak_x2": np.full(2, 2.0)}
    topology = jp.paper.structures().system().topology
    for slid, hardly_slipping in ((1.8, ("damper",)), (2.2, ())):
        after = columns | {"slip_distance": np.array([0.0, slid])}
        compared = jp.design.Comparison(after, after, jp.Objective(), False, topology)
        assert compared.hardly_slipping == hardly_slipping


def test_a_link_without_a_gap_is_not_counted_among_those_that_pound():
    """As the brace of a row, which has no column of a gap."""
    gap, still = np.array([0.1, -0.1]), np.zeros(2)
    columns = {"min_gap": gap, "min_gap_1": gap, "initial_gap": np.full(2, 0.3)}
    columns |= {f"{x}_{k}": still for x in ("damper_force", "slip_distance") for k in (1, 2)}
    topology = linked(0.3, np.inf).topology
    compared = jp.design.Comparison(columns, columns, jp.Objective(), False, topology)
    assert "pounding in 50 % of them before, 50 % after" in str(compared)


def test_the_winner_is_polished_and_its_limit_is_worth_its_multiplier(stand_in):
    rough, fine = (search(iterations=8, polish=polish) for polish in (False, True))
    assert rough.values["friction"] != pytest.approx(0.6, abs=1e-3)
    assert fine.values == pytest.approx({"mass_ratio": 1.5, "friction": 0.6}, abs=1e-4)
    assert fine.simulations > rough.simulations
    limited = search(LIMITED, iterations=20)
    assert limited.limited_demands["damper_force"] <= 0.5 * 1.001
    assert limited.values == pytest.approx({"mass_ratio": 1.5, "friction": 0.5}, abs=1e-3)
    # At friction ≤ 0.5 the objective is 0.01 lower; a relative ease of it earns 0.5 · 2 · 0.1.
    kept = search(LIMITED, iterations=200, patience=200)
    assert kept.limited_demands["damper_force"] <= 0.5 * 1.001
    assert kept.values["friction"] == pytest.approx(0.5, rel=1e-3)
    assert kept.values["mass_ratio"] == pytest.approx(1.5, abs=5e-3)
    assert kept.multipliers["damper_force"] == pytest.approx(0.1, rel=1e-2)
    assert kept.active_limits == ("damper_force",)
    assert re.search(r"damper_force +0\.5.* +active limit", str(kept))
    assert kept.gradient_norm < 5e-3
    loose = search(jp.Objective(limits=LOOSE))
    assert loose.values["friction"] == pytest.approx(0.6, abs=2e-3)
    assert loose.multipliers["damper_force"] == 0
    assert loose.active_limits == ()
    assert "active limit" not in str(loose)


def test_a_first_step_to_where_nothing_has_a_slope_does_not_end_polishing(monkeypatch):
    """The limited demand falls with friction at first, and from 0.8 on the damper never slips."""

    def demands(self, structures, ground):
        friction = jnp.minimum(structures.system().links[0].friction, 0.8)
        limited = jnp.where(friction < 0.1, 0.45 - 0.3 * friction, 0.42 + 1.2 * (friction - 0.1))
        values = dict.fromkeys(LIMITABLE_OF_PAIR, limited) | {"initial_gap": 2.0}
        return {name: jnp.asarray(x, float) for name, x in (values | {"min_gap": friction}).items()}

    monkeypatch.setattr(DesignProblem, "demands", demands)
    space = jp.DesignSpace(PAPER, {"friction": (0.0, 1.0)})
    design = search(LIMITED, space, starts=1, iterations=1, start={"friction": 0.02})
    assert design.values["friction"] == pytest.approx(0.1 + 0.08 / 1.2, rel=1e-6)
    assert design.limited_demands["damper_force"] == pytest.approx(0.5, rel=1e-6)


def test_parts_of_the_ensemble_find_the_whole_s_optimum(stand_in):
    def whole(values):
        return np.mean(bowl(values["friction"], values["mass_ratio"], AMPLITUDES))

    found = search(batch=2, iterations=200, patience=100)
    assert found.values["friction"] == pytest.approx(0.6, abs=0.02)
    assert found.simulations == len(found.history.objective) * 3 * 2
    assert found.objective == pytest.approx(whole(found.values))  # that of all earthquakes
    # Fewer iterations than an epoch has: the last designs are judged by all earthquakes too.
    few = search(batch=1, iterations=7)
    ends = [whole(few.space.values(shares)) for shares in few.history.shares[-1]]
    assert few.objective >= max(ends) - 0.02
    assert few.values["friction"] == pytest.approx(0.6, abs=0.2)


def test_single_precision_searches_too(stand_in):
    more = {"limited_demand": "damper_force", "limits": [0.5, 0.3]}
    more["search"] = jp.DesignSearch(starts=2, iterations=40)
    with jax.enable_x64(False):
        found, front = search(LIMITED), jp.pareto_front(SPACE, ENSEMBLE, GRID, **more)
    assert found.history.objective.dtype == np.float32
    assert found.values["friction"] == pytest.approx(0.5, rel=2e-3)
    np.testing.assert_allclose(front.limited_demands, [0.3, 0.5, 0.6], rtol=1e-2)
    assert_survives_pickling((found, found.trained, front))
    assert front.designs[0].objective_function.limits["damper_force"].at_most == pytest.approx(0.3)
    assert not front.designs[-1].objective_function.limits


def test_dropped_starts_are_reported_and_never_returned(stand_in):
    stand_in(lambda mu, rho, a: jnp.where(mu > 0.7, jnp.nan, bowl(mu, rho, a)))
    found = search(starts=6)
    assert found.dropped
    assert found.winner not in found.dropped
    assert np.isfinite(found.objective)
    assert found.values["friction"] == pytest.approx(0.6, abs=1e-3)
    for start, iteration in found.dropped.items():
        assert found.history.alive[:iteration, start].all()
        assert not found.history.alive[iteration:, start].any()
        words = f"start {start + 1} dropped at iteration {iteration}: not finite"
        assert words in assert_shown(found)
    # It met the best design of all on its way, and then went where nothing is finite.

    def rising(mu, rho, a):
        finite = jnp.where(rho > 1.2, mu, 0.3 - (mu - 0.3) ** 2)
        return jnp.where(mu > 0.55, jnp.nan, finite)

    stand_in(rising)
    found = search(starts=8, iterations=60)
    assert found.dropped
    assert found.winner not in found.dropped
    # The best is told when the last start is lost.
    stand_in(lambda mu, rho, a: jnp.where(mu > 0.7, jnp.nan, mu))
    with pytest.raises(ValueError, match=r"none is; .*; the best before was 0\.[3-7]\d* at"):
        search(starts=1)


@pytest.mark.filterwarnings("ignore::jaxpound.PlausibilityWarning")
def test_why_no_start_is_finite(stand_in):
    """The simulator has the reason, or a rule that a parameter of an earthquake breaks."""
    stand_in(lambda mu, rho, a: jnp.nan * mu)
    for grid, message in (
        (GRID, r"all 3 starts must be finite.*earthquake 0 of 8 gives no"),
        (jp.TimeGrid(1.5, 20), r"earthquake 0: .*must be positive and below the stability limit"),
    ):
        refused(message, search, grid=grid)
    ensemble = dataclasses.replace(ENSEMBLE, uncertain={"mass_ratio": -np.ones(8)})
    space = jp.DesignSpace(PAPER, {"friction": (0.0, 1.0)})
    reason = DesignProblem(space, ensemble, GRID, jp.Scheme(), MEAN).not_finite(np.array([0.5]))
    assert reason.startswith("earthquake 0: AdjacentStructures: mass_ratio = -1 must be positive")


def test_a_search_goes_on_where_it_was_stopped(stand_in, tmp_path):
    whole, path = search(iterations=60), tmp_path / "search.npz"
    part = search(iterations=60, save=path, callback=lambda told: told.iteration == 25)
    assert part.stopped == "the callback ended it"
    assert len(part.history.objective) == 25
    seen = []
    rest = search(iterations=60, save=path, callback=lambda told: seen.append(told.iteration))
    assert seen[0] == 26
    for one, other in zip(rest.history, whole.history, strict=True):
        np.testing.assert_array_equal(one, other)
    assert rest.values == whole.values
    # A finished one is only read.
    assert search(iterations=60, save=path, callback=lambda told: 1 / 0).values == whole.values
    refused("holds another search: objective, program dif", search, WORST, iterations=60, save=path)
    path.write_text("nothing")
    refused("holds no search", search, iterations=60, save=path)


def test_seeds_repeat_a_search_and_it_ends_without_progress(stand_in):
    batch = partial(search, batch=4, iterations=20)
    shares, same, other = (batch(key=key).history.shares for key in (1, 1, 2))
    np.testing.assert_array_equal(shares, same)
    assert not np.array_equal(shares[:, 1:], other[:, 1:])
    np.testing.assert_array_equal(shares[0, 0], other[0, 0])
    found = search(iterations=500, patience=15, tolerance=1e-3)
    assert found.stopped == "no progress in 15 iterations"
    assert len(found.history.objective) < 300


def test_a_callback_is_told_where_every_start_is(stand_in):
    told = []
    found = search(iterations=5, callback=told.append, polish=False)
    assert [one.iteration for one in told] == [1, 2, 3, 4, 5]
    for one, objective in zip(told, found.history.objective, strict=True):
        np.testing.assert_array_equal(one.objective, objective)
        mu, rho = one.values["friction"], one.values["mass_ratio"]
        np.testing.assert_allclose(one.objective, bowl(mu, rho, AMPLITUDES[:, None]).mean(0))
    assert told[-1].best == found.objective == found.history.objective.max()
    ended = search(callback=lambda progress: progress.objective.max() > 0)  # a bool of NumPy
    assert len(ended.history.objective) == 1


def test_si_units_are_those_of_the_demands():
    """Of the paper's case with every force and displacement a hundredth."""
    scales, paper = jp.Scales(mass=500e3, frequency=7.0), jp.paper.ground()
    length, time = 0.01 * float(scales.length), float(scales.time)
    made = dataclasses.replace(PAPER, friction=0.004, initial_gap=0.01)
    pair = in_si(made, scales)
    ground = jp.Ricker(0.01 * paper.amplitude, paper.periods, paper.arrivals)
    same = jp.Ricker(length * paper.amplitude, time * paper.periods, time * paper.arrivals)

    def demands(space, structures, ground, grid):
        ensemble = jp.Ensemble.of([ground], grid)
        problem = DesignProblem(space, ensemble, grid, jp.Scheme(), MEAN)
        return problem.demands(structures, ground)

    plain = demands(SPACE, made, ground, GRID)
    space = jp.DesignSpace(pair, {"links.0.friction": (0.0, 2 * pair.links[0].friction)})
    si = demands(space, pair, same, jp.TimeGrid(GRID.dt * time, GRID.n_steps))
    names = {"min_gap", "initial_gap", "damper_force", *LIMITABLE_OF_PAIR} - {*OF_CONTACT}
    assert names == plain.keys() == si.keys()
    for name in names:  # of kinds that tests/test_quantities.py states
        unit = float(scales.units[kind_of(name)])
        assert float(si[name]) == pytest.approx(unit * float(plain[name]), rel=1e-9), name
    run = jp.demand(made, ground, GRID)
    assert float(plain["peak_f2"]) == pytest.approx(float(run.peak_f2))
    assert float(plain["residual_offset"]) == pytest.approx(abs(float(run.residual_offset)))
    assert float(plain["damper_force"]) == pytest.approx(0.004)


@pytest.mark.filterwarnings("ignore::jaxpound.PlausibilityWarning")
def test_limits_and_penalties_are_in_si_units_too(stand_in):
    found = search(LIMITED, IN_SI, start=START_IN_SI)
    assert found.trained.si
    assert "(SI)" in repr(found.trained)
    shown = assert_shown(found)
    at = shown.index("damper_force")
    assert shown[at + 1 : at + 4] == [f"{found.limited_demands['damper_force']:.5g}", "0.5", "N"]
    before, after = found.start["links.0.friction"], found.values["links.0.friction"]
    at = shown.index("links.0.friction")
    assert shown[at + 3] == f"{100 * (after / before - 1):+.3g} %"
    assert f"objective {found.objective:.6g} m (" in shown[0]
    assert after == pytest.approx(0.5, rel=2e-3)


def test_the_paper_s_case_from_several_starts_to_one_optimum():
    """With a price on base shear; the optimum against a grid of designs, and against SciPy's."""
    tau_x = jp.design.Bounds(0.2, 10.0, "log")
    space = jp.DesignSpace(PAPER, {"friction": (0.0, 1.0), "rod_1.tau_x": tau_x})
    objective = jp.Objective(penalties={"peak_f1": 0.6, "damper_force": 0.5})
    grid = jp.TimeGrid.until(14.0, 0.05)
    ensemble = jp.Ensemble.of([jp.paper.ground()], grid)
    found = search(objective, space, ensemble, grid, starts=4, iterations=120)
    first, last = found.history.objective[0], found.history.objective[-1]
    assert (last > first).all()
    assert np.ptp(last) < 2e-3
    assert found.objective > found.trained.objective["before"].value + 0.05
    seen = found.landscape("friction", "rod_1.tau_x", 13)
    assert found.objective >= seen.objective.max() - 1e-9
    middle = space.structures(jnp.array([0.5, 0.5]))
    run = jp.demand(middle, jp.paper.ground(), grid)
    expected = float(run.min_gap - 0.6 * run.peak_f1) - 0.5 * middle.friction
    assert seen.objective[6, 6] == pytest.approx(expected)


def test_a_comparison_is_paired_and_of_one_earthquake_has_no_interval(stand_in):
    found = bowl_design()
    compared = found.trained
    d = compared.after["min_gap"] - compared.before["min_gap"]
    low, high = stats.ttest_1samp(d, 0).confidence_interval(0.95)
    wider = compared.difference()
    assert (wider.value, wider.low, wider.high) == pytest.approx((d.mean(), low, high))
    values = compared.objective
    assert values["after"].value == pytest.approx(found.objective)
    difference = values["after"].value - values["before"].value
    assert values["difference"].value == pytest.approx(difference)
    assert values["difference"].low <= difference <= values["difference"].high
    slip = compared.difference("damper_force")  # the same of all earthquakes
    more = found.values["friction"] - found.start["friction"]
    assert (slip.value, slip.low, slip.high) == pytest.approx((more, more, more), rel=1e-12)
    mean_after = np.mean(d) + 1 - np.mean(1 - compared.before["min_gap"])
    assert compared.rows()["min_gap"]["mean_after"] == pytest.approx(mean_after)
    assert found.fresh is None
    other = found.compare(ALONE)
    expected = bowl(found.values["friction"], found.values["mass_ratio"], 0.1)
    assert other.after["min_gap"][0] == pytest.approx(expected)
    refused("'gap' must be one of min_gap", compared.difference, "gap")
    found = search(iterations=3, fresh=ALONE)
    for estimate in (found.fresh.difference(), *found.fresh.objective.values()):
        assert np.isfinite(estimate.value)
        assert np.isnan([estimate.low, estimate.high]).all()
    assert "(no 95% interval) g/ω1² on average" in repr(found.fresh)
    assert "inf" not in repr(found.fresh)
    answers = summary(found, [], {"alone": bowl_design().trained})
    read = json.loads(json_text(answers))
    assert read["fresh"]["min_gap_wider_by"]["low"] is None
    assert read["recorded"]["alone"]["min_gap_after"] == bowl_design().trained.after["min_gap"][0]


WAVES = partial(jp.RandomRicker, 1, periods=jp.Uniform(1, 2), arrivals=jp.Uniform(0, 1))


def test_a_drawn_ensemble_has_fresh_earthquakes(stand_in):
    waves = WAVES(jp.Normal(0.0, 0.1), negative=0.0)
    ensemble = jp.Ensemble.drawn(jp.Scenarios(PAPER, waves), 64, 7)
    found = search(ensemble=ensemble, starts=2, iterations=60, fresh=500)
    assert len(found.fresh) == 500
    amplitudes = ensemble.fresh(500).grounds.amplitude[:, 0]
    mu, rho = found.values["friction"], found.values["mass_ratio"]
    np.testing.assert_allclose(found.fresh.after["min_gap"], bowl(mu, rho, amplitudes))
    assert found.fresh.difference().low > 0


@pytest.mark.usefixtures("stand_in")
def test_no_best_is_shown_until_there_is_one(monkeypatch, capsys):
    monkeypatch.setattr(design_search, "tqdm", partial(tqdm, mininterval=0, miniters=1))
    objective = jp.Objective(limits={"damper_force": 0.05})
    start, told = {"friction": 0.9, "mass_ratio": 1.0}, []
    search(objective, start=start, starts=1, iterations=40, callback=told.append, progress=True)
    assert told[0].best == -np.inf
    shown = capsys.readouterr().err
    assert "inf" not in shown
    assert f"objective={told[-1].best:.5g}" in shown


AT_RANDOM = {"optimiser": optax.add_noise(0.1, 0.5, jax.random.key(0)), "save": "x.npz"}
NARROW = jp.DesignSpace(PAPER, {"friction": (0.2, 1.0), "mass_ratio": (0.5, 2.5)})
LOW = jp.Objective(limits={"damper_force": 0.1})
test_bad_arguments_are_named = refusals(
    ({"start": {"friction": 2.0, "mass_ratio": 1.0}}, "start: .*friction = 2 must be between"),
    ({"start": dataclasses.replace(PAPER, mass_ratio=3.0)}, "mass_ratio = 3 must be between"),
    ({"space": PAPER}, "space = .* must be of type DesignSpace"),
    ({"objective": "gap"}, "objective = 'gap' must be of type Objective"),
    ({"optimiser": "adam"}, "optimiser = 'adam' must be of type GradientTransformation"),
    ({"starts": 0}, "starts = 0 must be a positive whole number"),
    ({"iterations": 0}, "iterations = 0 must be"),
    ({"batch": 9}, "batch = 9 must be at most the ensemble's 8"),
    ({"patience": 0}, "patience = 0 must be"),
    ({"key": -1}, "key = -1 must be a whole number"),
    ({"limit_tolerance": 0.0}, "limit_tolerance = 0 must be positive"),
    ({"tolerance": -1.0}, "tolerance = -1 must be positive"),
    ({"fresh": "x"}, "fresh = 'x' must be a positive whole number"),
    ({"fresh": -5}, "fresh = -5 must be a positive"),
    ({"save": "no/such/folder.npz"}, "save = .* must be in a folder that exists"),
    ({"start": PEAK | {"mu": 1}}, "design has 'mu', which is none"),
    ({"start": 0.5}, "design_damper: start: design = 0.5 must be of type"),
    (AT_RANDOM, "save cannot keep an optimiser that draws at random"),
    ({"starts": 10**9}, r"starts = 1,000,000,000 would take \d+ GB of memory"),
    # What nothing meets is refused with the least excess.
    ({"objective": LOW, "space": NARROW}, r"has damper_force = 0.2, 100.00% above its limit 0.1"),
    of=lambda _, __, change: search(**change),
    fixtures=("stand_in", "small_machine"),
)


def test_a_search_is_an_object():
    wrong = {"objective": MEAN, "search": {"starts": 2}}
    words, problem = "search = .* must be of type DesignSearch", (SPACE, ENSEMBLE, GRID)
    refused(words, jp.design_damper, *problem, **wrong)
    more = {"limited_demand": "damper_force", "search": 80}
    refused(words, jp.pareto_front, *problem, **more)


def test_what_is_uncertain_cannot_be_chosen():
    space = jp.DesignSpace(PAPER, {"friction": (0, 1), "rod_1.tau_x": (0.5, 5.0)})
    for path, message in (
        ("friction", "friction must not be both chosen and uncertain"),
        ("rod_1.tau_f", "rod_1.tau_x must not be chosen where rod_1.tau_f is uncertain"),
    ):
        drawn = jp.UncertainStructures(PAPER, {path: jp.Uniform(0.003, 0.3)})
        ensemble = jp.Ensemble.drawn(jp.Scenarios(drawn, WAVES(jp.Uniform(0.1, 0.2))), 4)
        for earthquakes in ({"ensemble": ensemble}, {"fresh": ensemble}):
            refused(message, search, space=space, **earthquakes)


def test_landscapes_ask_for_two_variables(stand_in):
    found = bowl_design()
    refused("x = 'mu' must be one of mass_ratio, friction", found.landscape, "mu", "friction")
    refused("must be two variables", found.landscape, "friction", "friction")
    seen = found.landscape("mass_ratio", "friction", 5)
    friction, ratio = np.asarray(seen.y_values), np.asarray(seen.x_values)
    expected = bowl(friction, ratio, AMPLITUDES[:, None, None]).mean(0)
    np.testing.assert_allclose(seen.objective, expected)


def test_a_front_of_limits_runs_one_program(stand_in, monkeypatch):
    """Against the closed form: at a slip force p < 0.6 the objective is (0.6 − p)² lower."""
    programs = []
    make = AugmentedLagrangian.begin
    monkeypatch.setattr(AugmentedLagrangian, "begin", lambda a, x: programs.append(a) or make(a, x))
    more = {"limited_demand": "damper_force", "limits": [0.5, 0.2, 0.35]}
    more["search"] = jp.DesignSearch(starts=2, iterations=100)
    front = jp.pareto_front(SPACE, ENSEMBLE, GRID, **more)
    first, *others = programs
    assert others == [first] * 3
    assert first.gradient._cache_size() == first.update._cache_size() == 1
    np.testing.assert_allclose(front.limited_demands, [0.2, 0.35, 0.5, 0.6], rtol=5e-3)
    best = 1 - np.mean(AMPLITUDES**2) - (0.6 - front.limited_demands) ** 2
    np.testing.assert_allclose(front.objectives, best, atol=2e-4)
    assert (np.diff(front.objectives) > 0).all()
    shown = assert_shown(front)
    assert shown[:3] == [
        "Pareto front of 4 designs",
        "slip force of the damper (m1 g)",
        "objective (g/ω1²)",
    ]
    numbers = [front.limited_demands[0], front.objectives[0], *front.designs[0].values.values()]
    assert shown[5:9] == [f"{x:.5g}" for x in numbers]


def test_a_front_ends_where_limits_cannot_be_met(stand_in):
    space = jp.DesignSpace(PAPER, {"friction": (0.3, 1.0), "mass_ratio": (0.5, 2.5)})
    front_of = partial(jp.pareto_front, space, ENSEMBLE, GRID)
    start = {"friction": 0.5, "mass_ratio": 1.0}
    more = {"search": jp.DesignSearch(start, starts=2, iterations=40)}
    more["limited_demand"] = "damper_force"
    assert front_of(limits=[0.4, 0.2], over="worst", **more).infeasible == (0.2,)
    limited_demands = front_of(limits=4, **more).limited_demands
    assert limited_demands.max() == pytest.approx(0.6, abs=0.01)
    assert 0.3 <= limited_demands.min() < 0.5
    limited = jp.Objective(limits={"peak_f1": 1.0})
    for change, message in (
        ({"limited_demand": "peak_f3"}, "limited_demand = 'peak_f3' must be one of"),
        ({"limited_demand": "peak_f1", "limits": 0}, "limits = 0 must be"),
        ({"limited_demand": "peak_f1", "limits": [-1.0]}, "limits = -1 "),
        (
            {"limited_demand": "peak_f1", "objective": limited},
            "must not be limited by the objective",
        ),
    ):
        refused(message, front_of, **change)


@pytest.mark.parametrize("limits", [2, [0.5, 0.01]])
def test_a_front_shows_one_bar_for_all_its_searches(limits, stand_in, capsys):
    space = jp.DesignSpace(PAPER, {"friction": (0.2, 1.0)})
    front_of = partial(jp.pareto_front, space, ENSEMBLE, GRID, limited_demand="damper_force")
    refused("start: .* lacks 'friction'", front_of, search=jp.DesignSearch({}))
    assert capsys.readouterr().err == ""
    seen = []
    search = jp.DesignSearch(starts=1, iterations=5, callback=seen.append)
    more = {"limits": limits, "search": search}
    front_of(**more)
    shown = capsys.readouterr().err.split("\r")
    n = 5 * (2 if limits == 2 else 3)
    assert len(seen) == n
    best = r"[\d.]+" if limits == 2 else "none yet"  # of the last search
    assert re.search(rf"^100%.* {n}/{n} .*objective={best}\]\s*\n$", shown[-1])
    assert "\n" not in "".join(shown[:-1])
    front_of(progress=False, **more)
    assert capsys.readouterr().err == ""
