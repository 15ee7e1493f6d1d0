"""What a system may be made of, and what is said of what it may not."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

import jaxpound as jp
from jaxpound import Link, Rod, System
from jaxpound._checks import all_hold
from jaxpound._fields import rules
from jaxpound.model.system import Structures
from jaxpound.model.topology import rod_groups
from tests.refusals import refusals, refused

ROD = jp.ZenerRod(0.5, 0.01, 0.05)


@dataclasses.dataclass(frozen=True)
class Cushion:
    """A law of one's own, which JAX does not know."""

    stiffness: float

    def force(self, penetration, speed, touch_speed):
        return self.stiffness * penetration


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class KnownCushion(Cushion):
    """One that it knows."""


def rods(*ends):
    return tuple(Rod(ROD, 1.0, each) for each in ends)


def links(*ends):
    return tuple(Link(each, 0.1, 1.0) for each in ends)


GROUNDED = rods(*((i, jp.GROUND) for i in range(4)))
TWO, LOOSE, LINK = (1.0, 1.0), rods((0, -1), (1, 0), (2, 3)), links((1, 2))
TWICE, BEARINGS = links((0, 1), (1, 0)), links((0, -1), (1, -1), (0, 1))
RING, NO_RING = links((0, 1), (1, 2), (2, 0)), "must not close a ring"
NEWTON, FREE = jp.Newton(0.5), {"gap": 1.0}
LAW, PUT = "must be of type ContactLaw or Newton or None", "put @jax.tree_util.regist"
BATCH = {"gap": [1.0, np.inf], "contact": jp.Hertz(1e4)}
test_what_no_system_can_be_made_of = refusals(
    ((), (), r"masses = \(\) must hold at least one mass"),
    (1.0, GROUNDED, r"masses = 1.0 must be a tuple"),
    ((1.0, -2.0), GROUNDED[:2], r"masses.1 = -2 must be positive and finite"),
    ((1.0,), (ROD,), r"rods.0 = ZenerRod.* must be of type Rod"),
    ((1.0,), GROUNDED[:1], (ROD,), r"links.0 = ZenerRod.* must be of type Link"),
    (TWO, GROUNDED[:3], r"rods.2.ends = \(2, -1\) must name masses from 0 to 1, or GROUND"),
    (TWO, GROUNDED[:2], links((0, 2)), r"links.0.ends = \(0, 2\) must name masses from 0 to 1"),
    ((1.0,) * 4, LOOSE, LINK, r"masses.2 must be tied to the ground by rods, directly or through"),
    ((1.0,) * 3, GROUNDED[:3], RING, rf"links.2.ends = \(2, 0\) {NO_RING} with links before"),
    (TWO, GROUNDED[:2], TWICE, r"links.1.friction = 0.1 must be that of the link before it"),
    (TWO, GROUNDED[:2], BEARINGS, rf"links.2.ends = \(0, 1\) {NO_RING}"),
    of=System,
    before="System: ",
)

test_what_no_link_can_be_made_of = refusals(
    ((1, 1), {}, r"ends = \(1, 1\) must be two different masses by number"),
    ((-3, -2), {}, r"ends = \(-3, -2\) must be two different masses"),
    ((0, 1.0), {}, r"ends = \(0, 1.0\) must be two different masses"),
    ((0, True), {}, r"ends = \(0, True\) must be two different masses"),
    (3, {}, r"ends = 3 must be two different masses"),
    ((0, 1), {"friction": -0.1}, r"friction = -0.1 must be finite and not negative"),
    ((0, 1), {"friction": 0.1, "gap": -1.0}, r"gap = -1 must be not negative"),
    ((0, 1), {"contact": NEWTON}, r"gap = inf must be finite \(contact needs a finite gap\)"),
    ((0, 1), {"gap": np.nan, "contact": NEWTON}, r"gap = nan must be not negative"),
    ((0, 1), BATCH, r"gap = inf \(at index \[1\]\) must be finite \(contact needs"),
    ((0, 1), FREE | {"contact": 0.65}, f"contact = 0.65 {LAW}"),
    ((0, 1), FREE | {"contact": jp.Hertz}, f"contact = <class .*Hertz'> {LAW}"),
    ((0, 1), FREE | {"contact": Cushion(50.0)}, f"contact of type Cushion must be a pytree: {PUT}"),
    of=lambda ends, options: Link(ends, **options),
    before="Link: ",
)

test_what_no_rod_can_be_made_of = refusals(
    (ROD, 0.0, (0, -1), r"stiffness = 0 must be positive and finite"),
    (1.0, 1.0, (0, -1), r"material = 1.0 must be of type ZenerRod"),
    (ROD, 1.0, (-1, -1), r"ends = \(-1, -1\) must be two different"),
    of=Rod,
    before="Rod: ",
)


def test_systems_are_forests_of_links_with_laws_of_contact():
    system = System((1.0,) * 4, GROUNDED, links((0, 1), (2, jp.GROUND), (jp.GROUND, 3)))
    assert system.topology.links == ((0, 1), (2, -1), (-1, 3))
    assert system.system() is system
    assert isinstance(system, Structures)
    towers = rods((0, -1), (1, 0), (2, -1), (3, 2))
    assert rod_groups(System((1.0,) * 4, towers).topology) == [(0, 1), (2, 3)]
    bridge = (*towers, *rods((3, 1)))
    assert rod_groups(System((1.0,) * 4, bridge).topology) == [(0, 1, 2, 3)]
    ends = tuple(np.array([1, 0]))
    whole = (Rod(ROD, 2, (0, -1)), Rod(ROD, np.float32(3), ends))
    system = System([1, np.float32(2)], whole)
    assert system.rods[1].ends == (1, 0)
    assert all(type(end) is int for end in system.rods[1].ends)
    assert len(jax.tree.leaves(system)) == 2 + 2 * 4
    doubled = jax.tree.map(lambda x: 2 * x, system)
    assert (doubled.masses, doubled.rods[0].ends) == ((2.0, 4.0), (0, -1))
    for law in (jp.Newton(0.5), jp.KelvinVoigt(100.0, 0.5), KnownCushion(50.0)):
        bare = Link((0, 1), 0.1, 1.0)
        link = dataclasses.replace(bare, contact=law)
        assert jax.tree.leaves(link) == [*jax.tree.leaves(bare), *jax.tree.leaves(law)]
        assert type(jax.tree.map(lambda x: 2 * x, link).contact) is type(law)
        assert bare.contact is None

    @jax.jit
    def valid(gap, law):
        system = System((1.0,) * 2, GROUNDED[:2], (Link((0, 1), 0.1, gap, law),))
        return all_hold(rules(system))

    for law, finite in ((None, False), (jp.Newton(0.5), True), (KnownCushion(50.0), True)):
        assert bool(valid(1.0, law))
        assert bool(valid(jnp.inf, law)) is not finite
    assert not valid(1.0, jax.tree.map(lambda _: -1.0, jp.Newton(0.5)))


def test_a_run_refuses_what_is_no_structure():
    grid = jp.TimeGrid(0.1, 10)
    for wrong in (ROD, 3.0, System, None):
        words = "structures = .* must be AdjacentStructures, a System"
        refused(words, jp.demand, wrong, jp.paper.ground(), grid)
        refused(r"stability_limit: structures = .* must be Adj", jp.stability_limit, wrong)
    system = System((1.0, np.ones(3)), GROUNDED[:2])
    words = r"structures: masses.1 of shape \(3,\) must be one num"
    refused(words, jp.demand, system, jp.paper.ground(), grid)
    broken = dataclasses.replace(System((1.0,), GROUNDED[:1]))
    object.__setattr__(broken, "masses", (float("nan"),))
    refused(r"structures: masses\.0 = nan must be posi", jp.demand, broken, jp.paper.ground(), grid)
