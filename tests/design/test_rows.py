"""Designs of a row: where dampers go within a budget, against all placements; and its kin."""

import dataclasses

import jax
import numpy as np
import pytest

import jaxpound as jp
from jaxpound.cli import design as design_command
from jaxpound.cli import files
from jaxpound.plots import designs as plots
from tests.refusals import refusals, refused
from tests.rows import GAPS, GRID, ROW, STEEL, WAVES
from tests.test_tables import assert_shown

EARTHQUAKES = jp.Ensemble.drawn(jp.Scenarios(ROW, WAVES), 16, sampling="sobol")
DAMPERS = {"links.*.friction": (0.0, 1.0)}
SPACE = jp.DesignSpace(ROW, DAMPERS)
BUDGET = 1.0
SOON = jp.Scheme(jp.simulation.Switching())  # compiled, as friction's events are not located
UPPER_STOREY = "buildings.0.rods.1.stiffness"
SEARCH = {"search": jp.DesignSearch(starts=2, iterations=40), "progress": False}


def with_friction(slip_forces):
    return with_links([{"friction": mu} for mu in slip_forces])


def with_links(changes):
    links = map(lambda link, change: dataclasses.replace(link, **change), ROW.links, changes)
    return dataclasses.replace(ROW, links=tuple(links))


def mean_min_gap(row, earthquakes, scheme):
    run = jax.vmap(lambda ground: jp.demand(row, ground, GRID, scheme).min_gap)
    return run(earthquakes.grounds).mean()


@jax.jit
@jax.vmap
def mean_gap_in_chunk(slip_forces):
    return mean_min_gap(with_friction(tuple(slip_forces)), EARTHQUAKES, jp.Scheme())


def mean_gap(every):
    """Mean gap of each placement; one program of 21 runs them all."""
    chunks = np.resize(every, (-(-len(every) // 21), 21, 2))
    return np.concatenate([mean_gap_in_chunk(chunk) for chunk in chunks])[: len(every)]


@pytest.fixture(scope="module")
def placements():
    mu = np.linspace(0, BUDGET, 21)
    every = np.stack(np.meshgrid(mu, mu), -1).reshape(-1, 2)
    return every, mean_gap(every)


@pytest.fixture(scope="module")
def design():
    within = jp.Objective(limits={"total_damper_force": BUDGET})
    return jp.design_damper(SPACE, EARTHQUAKES, GRID, objective=within, fresh=None, **SEARCH)


def best_within(placements, budget):
    """The best placement on the grid, its mean gap, and how far the grid is from the optimum."""
    every, gaps = placements
    inside = every.sum(axis=1) <= budget + 1e-9
    best = np.argmax(np.where(inside, gaps, -np.inf))
    return every[best], gaps[best]


def test_a_budget_is_placed_where_it_is_best(design, placements):
    where, gap = best_within(placements, BUDGET)
    assert ((where > 0.1) & (where < 0.9)).all()  # neither has all of it
    found = np.array([*design.values.values()])
    np.testing.assert_allclose(found, where, atol=0.06)  # the grid's spacing is 0.05
    assert design.objective >= gap - 1e-9
    assert float(mean_gap(found[None])[0]) == pytest.approx(design.objective, rel=1e-9)
    assert design.limited_demands["total_damper_force"] == pytest.approx(BUDGET, rel=1e-3)
    assert design.multipliers["total_damper_force"] > 0
    after = design.trained.after
    np.testing.assert_allclose(after["damper_force_2"], found[1])
    np.testing.assert_allclose(after["total_damper_force"], found.sum())


def test_a_comparison_tells_of_each_link_and_goals_of_the_closest(design):
    after = design.trained.after
    each = np.stack([after["min_gap_1"], after["min_gap_2"]])
    np.testing.assert_array_equal(after["min_gap"], each.min(axis=0))
    np.testing.assert_allclose(after["initial_gap"], np.mean(GAPS))
    shown = assert_shown(design.trained)
    for words in (
        "smallest gap, 1–2, floor 2",
        "slip force of the damper, 1–2, floor 1",
        "peak displacement of floor 1 of building 2",
        "peak drift of storey 2 of building 1",
        "peak shear of storey 2 of building 2",
        "forces of all dampers together",
        "largest storey drift",
    ):
        assert words in shown
    columns = design.trained.before
    hit = np.mean((columns["min_gap_1"] <= 0) | (columns["min_gap_2"] <= 0))
    assert 0 < hit < 1
    gaps = columns["min_gap"], columns["initial_gap"]
    assert float(jp.PoundingProbability(width=1e-9)(*gaps)) == -hit
    assert float(jp.design.GapAtRest()(*gaps)) == pytest.approx(-np.mean(GAPS))


SHARES = np.linspace(0, 1, 21)


def placed(path, total, with_devices, earthquakes, scheme):
    """The design that divides a budget between the links, and mean gaps by the first's share."""
    space = jp.DesignSpace(with_devices((0.3, 0.3)), {path: (0.0, BUDGET)})
    within = jp.Objective(limits={total: BUDGET})
    design = jp.design_damper(space, earthquakes, GRID, scheme, within, fresh=None, **SEARCH)
    assert sum(design.values.values()) <= BUDGET * 1.001

    @jax.jit
    @jax.vmap
    def mean(share):
        row = with_devices((share * BUDGET, (1 - share) * BUDGET))
        return mean_min_gap(row, earthquakes, scheme)

    return design, mean


def test_a_budget_of_inertance_is_placed_where_it_is_best():
    def with_inerters(inertances):
        return with_links([{"friction": 0.0, "inerter": jp.Inerter(b)} for b in inertances])

    earthquakes = jp.Ensemble.drawn(jp.Scenarios(ROW, WAVES), 4, sampling="sobol")
    path = "links.*.inerter.inertance"
    design, mean = placed(path, "total_inertance", with_inerters, earthquakes, jp.Scheme())
    inertances = sum(design.values.values())
    assert design.limited_demands["total_inertance"] == pytest.approx(inertances, rel=1e-6)
    placements = mean(SHARES)
    assert placements.max() - placements.min() > 0.01
    assert design.objective >= placements.max() - 1e-3


def test_a_budget_of_viscous_dampers_is_placed_where_it_is_best():
    def with_dampers(forces):
        dampers = [jp.Rod(jp.PowerLaw(force, 0.4), 5.0) for force in forces]
        return with_links([{"friction": 0.0, "damper": damper} for damper in dampers])

    path = "links.*.damper.material.force"
    design, mean = placed(path, "total_damper_force", with_dampers, EARTHQUAKES, SOON)
    assert design.objective >= mean(SHARES).max() - 1e-6
    first, _ = design.values.values()
    at_design = mean(np.resize(first / BUDGET, 21))[0]
    assert float(at_design) == pytest.approx(design.objective, abs=2e-3)


def test_a_front_over_budgets(design, placements):
    budgets = {"limited_demand": "total_damper_force", "over": "worst", "limits": [BUDGET, 0.6]}
    front = jp.pareto_front(SPACE, EARTHQUAKES, GRID, **budgets, **SEARCH)
    within = {
        round(float(x), 2): y for x, y in zip(front.limited_demands, front.objectives, strict=True)
    }
    for budget in (0.6, BUDGET):
        assert within[budget] >= best_within(placements, budget)[1] - 1e-9
    assert within[BUDGET] == pytest.approx(design.objective, rel=1e-4)


def test_elasticities_by_a_damper_and_a_storey_of_a_row():
    def row(friction, stiffness):
        upper = jp.Rod(STEEL, stiffness)
        left = jp.Storeys((1.0, 0.8), (jp.Rod(STEEL, 12.0), upper))
        right = jp.Storeys((1.0,), jp.Rod(STEEL, 30.0))
        return jp.Row((left, right), (jp.FloorLink(0, 0, friction=friction, gap=0.06),))

    @jax.jit
    @jax.vmap
    def mean(friction, stiffness):
        return mean_min_gap(row(friction, stiffness), EARTHQUAKES, jp.Scheme())

    found = jp.design.elasticities(row(0.03, 12.0), EARTHQUAKES, GRID, demand="min_gap")
    h = 1e-5 * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
    gap, *gaps = mean(*(np.array([0.03, 12.0]) * (1 + h)).T)
    assert found.value == pytest.approx(float(gap))
    slopes = np.subtract(gaps[::2], gaps[1::2]) / 2e-5 / abs(found.value)
    for path, slope in zip(("links.0.friction", UPPER_STOREY), slopes, strict=True):
        assert found.values[path] == pytest.approx(slope, rel=1e-4)
    assert {"buildings.1.rods.0.stiffness", "links.0.gap"} <= {*found.values}


@pytest.mark.filterwarnings("ignore:.*the energy balance leaves")  # the steps are coarse
def test_a_row_from_recorded_floors():
    """Slip forces and the stiffness of a storey, from two accelerations and a gap with noise."""
    truth = with_friction((0.2, 0.3))
    ground, random = jp.paper.ground(), np.random.default_rng(0)
    run = jp.simulate(truth, ground, GRID, SOON)
    exact = {"a2": run.absolute_accelerations[1], "x4": run.masses[3].x, "gap_2": run.links[1].gap}
    noise = {"a2": 0.02, "x4": 0.002, "gap_2": 0.002}
    measured = {name: x + noise[name] * random.normal(size=61) for name, x in exact.items()}
    values = {"links.0.friction": 0.2, "links.1.friction": 0.3, UPPER_STOREY: 12.0}
    space = jp.DesignSpace(ROW, {**DAMPERS, UPPER_STOREY: (6.0, 20.0)})
    how = {"noise": noise, "start": {"links.*.friction": 0.25, UPPER_STOREY: 11.0}, "starts": 1}
    found = jp.design.calibrate(space, measured, ground, GRID, SOON, **how)
    for path, value in values.items():
        estimate = found.parameters[path]
        assert abs(estimate.value - value) < estimate.high - estimate.low < 0.2 * value
    assert found.structures.links[1].friction == found.parameters["links.1.friction"].value
    assert found.noise == pytest.approx(noise, rel=0.4)
    says, gap = r"measured\['gap'\] must be one of x1, .*a4, gap_1, gap", {"gap": measured["gap_2"]}
    refused(says, jp.design.calibrate, space, gap, ground, GRID)


def test_a_brace_of_least_acceleration_and_what_is_told_of_it():
    """A building that stands alone has no gap; a brace that is too strong only stiffens it."""
    buildings = (jp.ShearBuilding.from_period(1, 300e3, period=0.6, damping_ratio=0.05),)
    links = (jp.FloorLink(0, 0, next_building=0, friction=100e3),)
    row = jp.Buildings(buildings, links)
    metre, second, newton = (float(row.scales.units[x]) for x in ("length", "time", "force"))
    grid = jp.TimeGrid(0.15 * second, 80)
    waves = [
        jp.Ricker(a * metre, [p * second], [4.0 * second])
        for a, p in ((0.1, 4.0), (0.2, 5.0), (0.15, 6.0))
    ]
    ensemble = jp.Ensemble.of(waves, grid)

    def brace(mu):
        return dataclasses.replace(row, links=(dataclasses.replace(row.links[0], friction=mu),))

    at = newton * np.linspace(0, 0.8, 81)
    run = jax.jit(jax.vmap(lambda mu, g: jp.demand(brace(mu), g, grid), (0, None)))
    scanned = np.mean([run(at, wave).peak_acceleration_1 for wave in waves], axis=0)
    least = int(np.argmin(scanned))
    assert 2 < least < 78
    space = jp.DesignSpace(row, {"links.0.friction": (0.0, 0.8 * newton)})
    search = jp.DesignSearch(starts=1, iterations=30)
    how = {"search": search, "fresh": None, "progress": False}
    how["objective"] = jp.Objective(jp.design.LeastDemand("peak_acceleration_1"))
    found = jp.design_damper(space, ensemble, grid, **how)
    assert -scanned[least] - 1e-3 <= found.objective
    assert found.values["links.0.friction"] == pytest.approx(at[least], abs=0.02 * newton)
    compared = found.trained
    assert compared.pounding == (0.0, 0.0)
    assert compared.difference().value < 0
    shown = "".join(assert_shown(compared))
    assert "peak absolute acceleration of building 1 changed by -" in shown
    assert "gap" not in shown
    assert plots.convergence(found).get_ylabel() == "objective (m/s²)"
    assert plots.before_and_after(compared).get_xlabel() == "peak $|a_1|$ (m/s²)"
    others = {"shake": found.compare(jp.Ensemble.of(waves[:1], grid))}
    answers = files.json_text(design_command.summary(found, [], others))
    told = files.page("Design", design_command.tables_of(found, [], others), [])
    assert "gap" not in told + answers
    assert "pound" not in told + answers
    assert "Peak absolute acceleration of building 1 changed by -" in told
    assert "peak absolute acceleration of building 1 before" in told


NO_CONTACT = ".*; links have no contact$"
test_paths_that_a_row_lacks_are_refused = refusals(
    ("links.*.frction", r"no path matches 'links\.\*\.frction'"),
    ("links.*.contact.stiffness", NO_CONTACT),
    ("links.1.contact.restitution", NO_CONTACT),
    of=lambda path: jp.DesignSpace(ROW, {path: (0.5, 1.0)}),
    before="^DesignSpace: ",
)
