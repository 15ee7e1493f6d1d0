"""Parameters by path: in any nesting, known or traced, in whatever order they are put."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from jaxpound.model import parameters
from tests.refusals import refusals, refused
from tests.rows import ROW

PAPER = jp.paper.structures()
STEEL, RUBBER = jp.ZenerRod(0.5, 0.01, 0.05), jp.ZenerRod(0.2, 0.1, 2.0)

KINDS = {"friction": "force", "links.0.friction": "force", "masses.1": "mass"}
KINDS |= {"buildings.1.masses.0": "mass", "buildings.0.rods.1.stiffness": "stiffness"}
TOWER = jp.System(
    masses=(1.0, 0.5),
    rods=(jp.Rod(STEEL, 1.0, (0, jp.GROUND)), jp.Rod(RUBBER, 0.8, (1, 0))),
    links=(jp.Link((1, jp.GROUND), 0.3),),
)
POUNDING = dataclasses.replace(PAPER, contact=jp.KelvinVoigt(400.0, 0.65))
WALL = jp.Link((1, jp.GROUND), 0.3, gap=1.0, contact=jp.Newton(0.5))
BUMPER = dataclasses.replace(TOWER, links=(WALL,))


def test_paths_are_those_of_the_leaves_what_bounds_another_first():
    for tree in (PAPER, TOWER, POUNDING, BUMPER):
        leaves = jax.tree_util.tree_flatten_with_path(tree)[0]
        expected = {jax.tree_util.keystr(path, simple=True, separator=".") for path, _ in leaves}
        assert set(parameters.paths(tree)) == expected
    assert parameters.paths(jp.AdjacentStructures) == parameters.paths(PAPER)
    assert parameters.paths(PAPER) == (
        *("rod_1.order", "rod_2.order", "rod_1.tau_f", "rod_2.tau_f", "rod_1.tau_x", "rod_2.tau_x"),
        *("mass_ratio", "stiffness_ratio", "friction", "initial_gap"),
    )
    for tree in (PAPER, TOWER):
        paths = parameters.paths(tree)
        bounded = {path: parameters.lower(tree, path) for path in paths}
        assert {path.rpartition(".")[2] for path, low in bounded.items() if low} == {"tau_x"}
        assert all(paths.index(low) < paths.index(path) for path, low in bounded.items() if low)


def test_values_are_got_and_put_and_nothing_else_changes():
    for tree, path, value in (
        (PAPER, "friction", PAPER.friction),
        (PAPER, "rod_2.tau_x", PAPER.rod_2.tau_x),
        (TOWER, "masses.1", 0.5),
        (TOWER, "rods.1.stiffness", 0.8),
        (TOWER, "rods.1.material.tau_x", 2.0),
        (TOWER, "links.0.friction", 0.3),
        (POUNDING, "contact.stiffness", 400.0),
        (BUMPER, "links.0.contact.restitution", 0.5),
    ):
        assert parameters.get(tree, path) == value
        changed = parameters.put(tree, {path: 0.9 * value})
        for other in parameters.paths(tree):
            factor = 0.9 if other == path else 1.0
            assert parameters.get(changed, other) == factor * parameters.get(tree, other)
        assert jax.tree.structure(changed) == jax.tree.structure(tree)
    for tau_f in (0.0001, 3.0):
        values = {"rod_1.tau_f": tau_f, "rod_1.tau_x": 1.5 * tau_f}
        for given in (values, dict(reversed(values.items()))):
            rod = parameters.put(PAPER, given).rod_1
            assert (rod.tau_f, rod.tau_x) == (tau_f, 1.5 * tau_f)


def test_what_is_put_is_checked_or_traced_and_the_rest_stays_itself():
    tau_x, restitution = "rods.0.material.tau_x", "links.0.contact.restitution"
    for tree, path, value, words in (
        (TOWER, tau_x, 0.001, "tau_x = 0.001 must be finite and at least tau_f = 0.01"),
        (TOWER, "masses.1", -1, r"masses\.1 = -1 must be positive and finite"),
        (BUMPER, restitution, 1.5, r"Newton: restitution = 1\.5 must be in \(0, 1\]"),
        (BUMPER, "links.0.gap", np.inf, r"Link: gap = inf must be finite \(contact needs"),
    ):
        refused(words, parameters.put, tree, {path: value})

    def total(x):
        changed = parameters.put(TOWER, {"rods.1.material.tau_x": x, "masses.0": 2 * x})
        assert parameters.get(changed, "rods.1.material.tau_x") is x
        return sum(jnp.sum(leaf) for leaf in jax.tree.leaves(changed))

    assert jax.jit(jax.grad(total))(2.5) == 3.0
    batch = jax.vmap(lambda x: parameters.put(TOWER, {"masses.0": x}))(jnp.arange(1.0, 4.0))
    np.testing.assert_array_equal(parameters.get(batch, "masses.0"), [1, 2, 3])
    changed = parameters.put(TOWER, {"rods.1.stiffness": 2.0})
    assert changed.rods[0] is TOWER.rods[0]
    assert changed.rods[1].material is RUBBER
    assert dataclasses.replace(changed).rods == changed.rods


def test_intervals_are_what_a_parameter_may_be_given_the_others():
    least = parameters.SMALLEST
    for tree, path, expected in (
        (PAPER, "friction", (0, np.inf)),
        (PAPER, "mass_ratio", (least, np.inf)),
        (PAPER, "rod_2.order", (least, 1)),
        (TOWER, "masses.0", (least, np.inf)),
        (TOWER, "rods.1.material.tau_f", (least, 2.0)),
        (TOWER, "rods.1.material.tau_x", (0.1, np.inf)),
        (TOWER, "links.0.friction", (0, np.inf)),
        (POUNDING, "contact.stiffness", (least, np.inf)),
        (BUMPER, "links.0.contact.restitution", (least, 1)),
    ):
        assert parameters.interval(tree, path) == expected
        for end in expected:
            if np.isfinite(end):
                parameters.put(tree, {path: end})
    others = {"rod_1.tau_f": 0.5, "rod_2.tau_f": None, "rod_2.tau_x": None}
    assert parameters.interval(PAPER, "rod_1.tau_x", others) == (0.5, np.inf)
    assert parameters.interval(PAPER, "rod_2.tau_x", others) == (least, np.inf)
    assert parameters.interval(PAPER, "rod_2.tau_f", others) == (least, np.inf)

    def ends(tau):
        low = parameters.interval(parameters.put(PAPER, {"rod_1.tau_f": tau}), "rod_1.tau_x")[0]
        high = parameters.interval(PAPER, "rod_1.tau_f", {"rod_1.tau_x": tau})[1]
        return low, high

    assert jax.jit(ends)(0.3) == (0.3, 0.3)


def test_names_and_kinds_need_no_more_than_the_class_but_a_contact_law_s():
    for tree, path, name in (
        (PAPER, "friction", r"friction $\mu$"),
        (PAPER, "rod_1.tau_x", r"rod 1: $\bar\tau_x$"),
        (PAPER, "rod_2.order", "rod 2: order"),
        (TOWER, "masses.1", "mass 2 $m$"),
        (TOWER, "links.0.friction", r"link 1: $\mu$"),
        (TOWER, "rods.1.material.tau_f", r"rod 2: $\bar\tau_f$"),
        (ROW, "buildings.0.rods.1.stiffness", "building 1, storey 2: $K$"),
        (ROW, "buildings.1.masses.0", "building 2, floor 1: $m$"),
    ):
        for owner in (tree, type(tree)):
            assert parameters.name(owner, path) == name
            assert parameters.metadata(owner, path).kind == KINDS.get(path)
    for tree, path, name, kind in (
        (POUNDING, "contact.stiffness", "contact: $k$", "stiffness"),
        (BUMPER, "links.0.contact.restitution", "link 1, contact: $e$", None),
    ):
        assert (parameters.name(tree, path), parameters.metadata(tree, path).kind) == (name, kind)
        refused(f"unknown path '{path}'", parameters.metadata, type(tree), path)
    soft = dataclasses.replace(PAPER, contact=jp.Hertz(1e4))
    assert parameters.metadata(soft, "contact.stiffness").kind == "hertz stiffness"
    refused(r"unknown path 'contact\.restitution'", parameters.get, soft, "contact.restitution")


def test_a_pattern_stands_for_all_paths_that_it_matches():
    stiffness = [path for path in parameters.paths(ROW) if path.endswith("stiffness")]
    first = [path for path in stiffness if path.startswith("buildings.0.")]
    assert len(first) == 2
    for pattern, matched in (
        ("buildings.0.rods.*.stiffness", first),
        ("*.*.rods.*.stiffness", stiffness),
        ("links.*.friction", ["links.0.friction", "links.1.friction"]),
    ):
        assert parameters.expanded(ROW, {pattern: 1.0}) == dict.fromkeys(matched, 1.0)
    orders = dict.fromkeys(("rod_1.order", "rod_2.order"), 1)
    assert parameters.expanded(PAPER, {"rod_*.order": 1}) == orders
    both = {"links.1.friction": 2.0, "links.*.friction": 1.0}
    frictions = {"links.0.friction": 1.0, "links.1.friction": 2.0}
    for values in (both, dict(reversed(both.items()))):
        assert parameters.expanded(ROW, values) == frictions
    faces = jp.Link((0, jp.GROUND), friction=0.1, gap=(0.2, 0.3))  # the left one has no friction
    system = jp.System((1.0,), [jp.Rod(ROW.system().rods[0].material, 1.0, (0, -1))], [faces])
    assert [*parameters.expanded(system, {"links.*.friction": 1})] == ["links.0.friction"]
    space = jp.DesignSpace(system, {"links.*.friction": (0.0, 1.0)})
    assert space.structures([0.5]).links[0].friction == 0.5


test_patterns_that_match_nothing_or_twice_are_named = refusals(
    (["links.*.frction"], r"no path matches 'links\.\*\.frction'; did you mean 'links\.\*\.f"),
    (["links.7*.gap"], r"no path matches 'links\.7\*\.gap'; did you mean 'links\.\*\.gap'"),
    (["*"], r"no path matches '\*'; allowed: buildings\.\*\.rods\.\*\.material\.order, "),
    (["links.*.gap", "links.0.*"], r"'links\.\*\.gap' and 'links\.0\.\*' must not both match"),
    (["links.2.gap"], r"unknown path 'links\.2\.gap'; did you mean 'links\.1\.gap'"),
    of=lambda given: parameters.expanded(ROW, dict.fromkeys(given, 1.0)),
    before="^expanded: ",
)


def test_an_unknown_path_is_told_with_what_was_meant():
    calls = (
        lambda path: parameters.get(PAPER, path),
        lambda path: parameters.put(PAPER, {"mass_ratio": 1.0, path: 1.0}),
        lambda path: parameters.interval(PAPER, path),
        lambda path: parameters.name(PAPER, path),
        lambda path: parameters.metadata(jp.AdjacentStructures, path),
    )
    for call in calls:
        refused("unknown path 'frction'; did you mean 'friction'", call, "frction")
        for path in ("rod_1", "rod_1.natural_frequency", "rods.0.tau_x", "friction.0", ""):
            refused(f"unknown path '{path}'", call, path)
    refused(r"unknown path 'zeta'; allowed: rod_1\.order, ", parameters.get, PAPER, "zeta")
    words = r"unknown path 'rods\.2\.stiffness'; did you mean 'rods"
    refused(words, parameters.get, TOWER, "rods.2.stiffness")


def test_parameters_of_any_structures_may_be_random_chosen_or_elastic():
    tau_x, tau_f = jp.Uniform(0.5, 3.0), jp.Normal(1, 0.3)
    of_rod = {"rods.1.material.tau_x": tau_x, "rods.1.material.tau_f": tau_f}
    uncertain = jp.UncertainStructures(TOWER, of_rod)
    for z in np.random.default_rng(0).normal(size=(20, 2)):
        material = uncertain.draw(z).rods[1].material
        assert 0 < material.tau_f <= material.tau_x <= 3
    contact = {"contact.stiffness": (100.0, 900.0), "contact.restitution": (0.4, 0.8)}
    middle = jp.DesignSpace(POUNDING, contact).structures(np.full(2, 0.5)).contact
    assert (float(middle.stiffness), float(middle.restitution)) == pytest.approx((500.0, 0.6))
    uncertain = jp.UncertainStructures(POUNDING, {"contact.restitution": jp.Uniform(0.4, 0.8)})
    assert float(uncertain.draw(np.zeros(1)).contact.restitution) == pytest.approx(0.6)
    grid, demand = jp.TimeGrid(0.05, 40), "peak_acceleration_1"
    found = jp.design.elasticities(TOWER, jp.paper.ground(), grid, demand=demand)
    assert tuple(found.parameters) == parameters.paths(TOWER)
    assert all(np.isfinite(x) for x in found.values.values())
    assert found.values["rods.0.stiffness"] != 0
    assert found.parameters["links.0.gap"] == np.inf
    assert "links.0.gap" not in found.values
