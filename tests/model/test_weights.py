"""Ends with weights and shares of the ground's motion: what they are, and which are refused."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from jaxpound import Link, Rod, System
from jaxpound.model import parameters
from tests.refusals import refusals, refused

G = jp.GROUND
STEEL = jp.ZenerRod(0.5, 0.01, 0.05)
THREE = (1.0, 0.5, 0.3)


def rods(*ends):
    return tuple(Rod(STEEL, 1.0, each) for each in ends)


def links(*ends):
    return tuple(Link(each, 0.1) for each in ends)


STOREY, SWAY, ROCKING = ((0, 1.0), (1, -1.0), (2, -3.0)), (1, G), ((2, 1.0),)
HELD = rods(STOREY, SWAY, ROCKING)

EDGES = ((1, 1.0), (2, 0.5)), ((1, 1.0), (2, -0.5)), ((1, 3.0), (2, 0.1))
LEFT_FACE = Link(EDGES[0], gap=(0.1, 0.2)).faces()[1]
RULE = r"must be \(\(mass, weight\), …\), of different masses by number, from 0"
test_what_no_ends_of_a_rod_can_be = refusals(
    ((), rf"ends = \(\) {RULE}"),
    (((0, 1.0), (0, -1.0)), rf"ends = .* {RULE}"),
    (((0, 1.0), (G, -1.0)), rf"ends = .* {RULE}; the ground has no weight"),
    (((0.0, 1.0),), rf"ends = .* {RULE}"),
    (((0, 1.0, 2.0),), rf"ends = .* {RULE}"),
    (((True, 1.0),), rf"ends = .* {RULE}"),
    (((0, np.nan),), r"weights.0 = nan"),
    (((0, 1.0), (1, -np.inf)), r"weights.1 = -inf"),
    (((0, "1"),), r"weights.0 = '1'"),
    ((0, (1, 1.0)), r"ends = \(0, \(1, 1.0\)\) must be two different masses .* or \(\(mass"),
    of=lambda ends: Rod(STEEL, 1.0, ends),
    before="Rod: ",
)

test_what_no_ends_of_a_link_can_be = refusals(
    ((), rf"ends = \(\) {RULE}"),
    (((0, 1.0), (0, -1.0)), rf"ends = .* {RULE}"),
    (((0, np.nan),), r"weights.0 = nan"),
    of=Link,
    before="Link: ",
)

test_what_no_system_with_weights_can_be_made_of = refusals(
    (THREE, rods(STOREY, SWAY, ((3, 1.0),)), (), None, r"rods.2.ends = .* must name masses from 0"),
    (THREE, HELD, links(((3, 1.0),)), None, r"links.0.ends = .* must name masses from 0 to 2"),
    (THREE, rods(STOREY, SWAY), (), None, r"rods must hold all masses: in some motion of them"),
    (THREE, rods(STOREY, STOREY, SWAY), (), None, r"rods must hold all masses"),
    (THREE, HELD, links(*EDGES), None, r"links.2.ends = .* must have a closing that does not"),
    (THREE, HELD, links(SWAY, ((1, -2.0),)), None, r"links.1.ends = .* must have a closing that"),
    (THREE, HELD, (), (1, 0), r"influence of 2 numbers must be one number for each of 3 masses"),
    (THREE, HELD, (), (1, np.inf, 0), r"influence.1 = inf must be a finite number"),
    (THREE, HELD, (), (1, np.nan, 0), r"influence.1 = nan must be a finite number"),
    (THREE, HELD, (), (1, "1", 0), r"influence.1 = '1'"),
    (THREE, HELD, (), 1.0, r"influence = 1.0 must be a tuple"),
    (THREE, HELD, (LEFT_FACE,), None, r"links.0, a left face, must be behind the right face"),
    of=lambda m, r, k, shares: System(m, r, k, influence=() if shares is None else shares),
    before="System: ",
)


def test_an_influence_is_known():
    with pytest.raises(ValueError, match=r"influence.0 = .* must be a finite number that is known"):
        jax.jit(lambda x: System(THREE, HELD, influence=(x, 1, 0)))(1.0)
    assert System(THREE, HELD, influence=(1, 1, 1)).influences == (1.0, 1.0, 1.0)
    assert System(THREE, HELD).influences == (1.0, 1.0, 1.0)


def test_ends_with_weights_are_masses_and_numbers_that_are_traced():
    """A rod that is made again keeps them, and they are parameters like others."""
    system = System(THREE, HELD, (Link(EDGES[0], 0.1, gap=(0.1, 0.2)),), influence=(1, 1, 0))
    storey, _, rocking = system.rods
    assert (storey.ends.masses, storey.weights) == ((0, 1, 2), (1.0, -1.0, -3.0))
    assert (rocking.ends.masses, rocking.weights) == ((2,), (1.0,))
    assert system.rods[1].ends == (1, -1)
    assert system.rods[1].weights == ()
    right, left = system.links
    assert [link.gap for link in system.links] == [0.2, 0.1]
    assert (right.weights, left.weights) == ((1.0, 0.5), ())
    stiffer = dataclasses.replace(storey, stiffness=2.0)
    assert (stiffer.ends, stiffer.weights) == (storey.ends, storey.weights)
    doubled = jax.tree.map(lambda x: 2 * x, system)
    assert doubled.rods[0].weights == (2.0, -2.0, -6.0)
    assert doubled.influence == system.influence == (1.0, 1.0, 0.0)
    assert doubled.topology == system.topology

    path = "rods.0.weights.2"
    assert path in parameters.paths(system)
    assert parameters.get(system, path) == -3.0
    changed = parameters.put(system, {path: -4.0})
    assert changed.rods[0].weights == (1.0, -1.0, -4.0)
    assert changed.influence == (1.0, 1.0, 0.0)
    with pytest.raises(ValueError, match=r"weights\.2 = nan"):
        parameters.put(system, {path: np.nan})


def test_traced_weights_are_refused_by_no_rank():
    """Which their numbers alone tell; the run then has the numbers that follow."""

    @jax.jit
    def made(weight):
        edges = links(EDGES[0], ((1, 1.0), (2, weight)))
        return System(THREE, rods(STOREY, SWAY, ((2, weight),)), edges).rods[2].weights[0]

    assert float(made(2.0)) == 2.0
    jax.vmap(made)(jnp.ones(3))


def test_batches_of_weights_are_held_each():
    both = np.array([1.0, -1.0])
    System(THREE, rods(STOREY, SWAY, ((2, both),)))
    rule = "rods must hold all masses"
    same = rods(((0, 1.0), (1, both)), ((0, 1.0), (1, 1.0)))
    refused(rule, System, (1.0, 1.0), same)


def test_figures_of_rows_refuse_weights():
    """Also those of which two ends alone make buildings."""
    edge, floors = Link(EDGES[0], 0.1), rods((0, G), (1, 0), (2, G))
    for system in (System(THREE, HELD, influence=(1, 1, 0)), System(THREE, floors, (edge,))):
        refused("^(structures|row): .* must be", jp.plots.row, system)
