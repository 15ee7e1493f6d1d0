"""Groups of joints that may need the local flow, those of the same shape together.

Groups between the floors of two buildings, with contact laws of one class, have one shape. A step
of a group takes seconds to compile, here once instead of for every group; it runs as fast.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxpound._xla.alike import by_kind, stacked, unstacked
from jaxpound._xla.derivatives import kept
from jaxpound.model.contact import with_mass
from jaxpound.model.ends import along, less_ground
from jaxpound.model.joint import Joint
from jaxpound.model.system import System
from jaxpound.simulation.contact.forces import inverse_of, times
from jaxpound.simulation.contact.records import Contact, FlowResult
from jaxpound.simulation.joints import group as functions
from jaxpound.simulation.joints.friction import FrictionLaw
from jaxpound.simulation.joints.group import Coupling, Flow, Gaps
from jaxpound.simulation.state import (
    GapStep,
    Inertia,
    JointState,
    Jump,
    LinkInstant,
    Moved,
    Now,
    SeenGroup,
    link_instants,
)


class Inerters(NamedTuple):
    """Inerters of n joints, which add b s'' to the forces q of their joints.

    From s'' = A − G (q + b s'') follows s'' = (1 + G b)⁻¹ (A − G q), the law of joints without
    inerters with another pull and another G.
    """

    inertances: jax.Array  # b (n,), 0 without
    reduction: jax.Array  # (1 + G b)⁻¹, (n, n)


class Group(NamedTuple):
    """Joints that share masses, directly or through other joints."""

    joints: tuple[Joint, ...]
    shares: dict[int, jax.Array]  # by mass its row, (n,), of S = M⁻¹ Cᵀ G⁻¹
    influence: tuple[Any, ...]  # C ι, by joint
    has_inerter: tuple[bool, ...]  # by joint


class Coupled(NamedTuple):
    """Groups of one shape, each of n joints and g gaps; several have arrays with a leading axis."""

    of: tuple[Group, ...]
    gaps: Gaps  # the same of all
    links: tuple[tuple[int, ...], ...]  # of the gaps, by group
    coupling: Coupling
    inerters: Inerters | None

    @property
    def groups(self) -> list[tuple[list[Joint], dict[int, Any]]]:
        """The joints of each group, and how its masses share their motions."""
        return [([*group.joints], group.shares) for group in self.of]

    def _map(self, function: Callable[..., Any], *values: Any) -> Any:
        """A function of the numbers of one group, applied to each group."""
        return jax.vmap(function)(*values) if len(self.of) > 1 else function(*values)

    def _array(self, by_joint: Sequence[Any]) -> jax.Array:
        """Numbers of all joints as an array, (n,), or (groups, n) of several groups."""
        flat, several = jnp.stack(by_joint), len(self.of)
        return flat.reshape(several, -1) if several > 1 else flat

    def _by_group(self, tree: Any) -> list[Any]:
        return unstacked(tree) if len(self.of) > 1 else [tree]

    def start(self, zero: jax.Array, x: Sequence[Any], v: Sequence[Any]) -> JointState:
        """Their state at the start of a run."""
        closing, velocity = (self.along([zero + z for z in y]) for y in (x, v))
        rest, shape = 0 * closing, (*closing.shape[:-1], len(self.gaps))
        apart = Contact(*(jnp.broadcast_to(zero, shape),) * len(Contact._fields))
        return JointState(closing, velocity, jax.lax.stop_gradient(rest), rest, closing, apart)

    def along(self, y: Sequence[Any]) -> jax.Array:
        """C y: closings, velocities or accelerations of the joints from those of the masses."""
        joints = (joint for group in self.of for joint in group.joints)
        return self._array([along(joint.ends, y) for joint in joints])

    def pull(self, free: Sequence[Any], ground: jax.Array) -> jax.Array:
        """A = C (a − ι u''), relative accelerations of joints from the free ones of the masses."""
        pulls = [
            less_ground(along(joint.ends, free), iota, ground)
            for group in self.of
            for joint, iota in zip(group.joints, group.influence, strict=True)
        ]
        pull = self._array(pulls)
        return pull if self.inerters is None else self._map(times, self.inerters.reduction, pull)

    def follow(self, y: list[Any], missing: Any) -> None:
        """Add S times missing closings to the motions of masses, so that their joints have them."""
        for group, closings in zip(self.of, self._by_group(missing), strict=True):
            for mass, share in group.shares.items():
                y[mass] = y[mass] + (share * closings).sum()

    def flow(self, before: JointState, pull: jax.Array, now: Now, h: float, slots: int) -> Flow:
        """The joints after their local flow."""

        def run(coupling: Coupling, before: JointState, pull: jax.Array) -> Any:
            return functions.run_flow(coupling, self.gaps, before, pull, now, h, slots)

        def samples(result: FlowResult, used: jax.Array, before: JointState) -> Any:
            return functions.samples(result, used, before, now, h)

        result, used = kept(self._map(run, self.coupling, before, pull))
        return Flow(pull, result, used, *self._map(samples, result, used, before))

    def needs_flow(self, before: JointState, pull: jax.Array, now: Now, h: float) -> jax.Array:
        """Whether any group needs its local flow."""

        def needs(coupling: Coupling, before: JointState, pull: jax.Array) -> jax.Array:
            return functions.is_flow_needed(coupling, self.gaps, before, pull, now, h)

        return jnp.ravel(self._map(needs, self.coupling, before, pull)).any()

    def after(
        self,
        before: JointState,
        flow: Flow | None,
        pull: jax.Array,
        now: Now,
        law: FrictionLaw,
        h: float,
    ) -> Moved:
        """The joints after a step."""

        def finish(coupling: Coupling, before: JointState, pull: jax.Array, *flow: Any) -> Moved:
            motion = functions.motion_without_flow(coupling, before, pull, now, law, h)
            moved = functions.after_none(coupling, before, pull, motion, now, h)
            if not flow:
                return moved
            return functions.after_flow(coupling, self.gaps, before, flow[0], moved, pull, h)

        flows = [] if flow is None else [flow]
        return self._map(finish, self.coupling, before, pull, *flows)

    def seen(self, moved: Moved, flow: Flow | None, inertia: Inertia) -> list[SeenGroup]:
        """The groups as they are observed."""
        flows = [None] * len(self.of) if flow is None else self._by_group(flow)
        columns = zip(self.links, self._by_group(moved), flows, strict=True)
        events = [_GroupEvents.of(self.gaps, *column) for column in columns]
        inert, groups = inertia([group.forces for group in events]), list[SeenGroup]()
        for group, seen, forces in zip(self.of, events, inert, strict=True):
            links, joints = dict[int, LinkInstant](), zip(group.joints, seen.moved, strict=True)
            for number, (joint, joint_moved) in enumerate(joints):
                of_joint = seen.jumped[number], forces[number], seen.gaps
                links |= link_instants(joint, joint_moved, *of_joint)
            groups.append(SeenGroup(seen.forces, forces, seen.jumps, links))
        return groups

    def contacts(self, state: JointState) -> dict[int, Contact]:
        """The contact of each link that has a law of contact."""
        by_gap: dict[int, Contact] = {}
        if self.gaps:
            for links, contact in zip(self.links, self._by_group(state.contact), strict=True):
                by_gap |= zip(links, unstacked(contact), strict=True)
        return by_gap

    def inertia(
        self, free: Sequence[Any], ground: jax.Array, forces: Sequence[Sequence[Any]]
    ) -> list[list[Any]]:
        """The forces b s'' of inerters beside other forces; None of joints without one."""
        if self.inerters is None:
            return [[None] * len(group.joints) for group in self.of]
        others = self._map(
            times, self.coupling.delassus, self._array([q for group in forces for q in group])
        )
        inert = iter((self.inerters.inertances * (self.pull(free, ground) - others)).ravel())
        return [
            [force if has else None for has, force in zip(group.has_inerter, inert, strict=False)]
            for group in self.of
        ]


class _GroupEvents(NamedTuple):
    """What happens in a group in a step; lists have an entry for each joint, in order."""

    moved: list[Moved]
    forces: list[jax.Array]  # of friction and contact
    jumped: list[Any]  # whether forces of its gaps have jumped in a flow
    gaps: dict[int, GapStep]  # by link
    jumps: tuple[Jump, ...]

    @staticmethod
    def of(gaps: Gaps, links: Sequence[int], moved: Moved, flow: Flow | None) -> _GroupEvents:
        """The joints of a group after a step, with its gaps, which belong to these links."""
        joints = unstacked(moved._replace(state=None))  # which has also numbers of the gaps
        steps, used = list[GapStep](), jnp.zeros((), bool)
        if flow is not None:
            used = flow.used
            steps = unstacked(GapStep.of(flow.result)) if gaps else []
        forces, jumped = [joint.motion.force for joint in joints], [False & used] * len(joints)
        for (joint, side), step in zip(gaps, steps, strict=bool(steps)):
            forces[joint] = forces[joint] + side * step.force
            jumped[joint] = jumped[joint] | (used & (step.highest_time != 0))
        jumps = []
        for number, joint in enumerate(joints):
            turns, time = joint.motion.turns & ~used, joint.motion.turn_time
            for force in joint.motion.turn_forces:
                after = [*forces]
                after[number] = jnp.where(turns, force, forces[number])
                jumps.append(Jump(jnp.where(turns, time, 0.0), after))
        for step in steps:
            hits = step.highest > 0
            pairs = zip(step.highest_forces, forces, strict=True)
            highest = [jnp.where(hits, force, now) for force, now in pairs]
            jumps.append(Jump(jnp.where(hits, step.highest_time, 0.0), highest))
        by_link = dict(zip(links, steps, strict=bool(steps)))
        return _GroupEvents(joints, forces, jumped, by_link, tuple(jumps))


def may_need_flow(joints: Sequence[Joint], system: System) -> bool:
    """Whether steps of joints that share masses may need the local flow."""
    links = [system.links[link] for joint in joints for link, _ in joint.faces]
    return len(joints) > 1 or any(link.contact or link.velocity_friction for link in links)


def all_coupled(
    groups: Sequence[Sequence[Joint]],
    system: System,
    masses: Sequence[jax.Array],
    influence: Sequence[Any],
) -> list[Coupled]:
    """The constants of groups of joints, those together whose numbers have the same shapes."""
    alone = [_coupled(joints, system, masses, influence) for joints in groups]
    # As keys, since values of numbers are not compared.
    kinds = by_kind([{kind.gaps: (kind.coupling, kind.inerters)} for kind in alone])
    together = []
    for numbers in kinds:
        same = [alone[n] for n in numbers]
        constants = same[0].coupling, same[0].inerters
        if len(same) > 1:
            constants = stacked([(kind.coupling, kind.inerters) for kind in same])
        of = tuple(group for kind in same for group in kind.of)
        links = tuple(links for kind in same for links in kind.links)
        together.append(Coupled(of, same[0].gaps, links, *constants))
    return together


def _coupled(
    joints: Sequence[Joint],
    system: System,
    masses: Sequence[jax.Array],
    influence: Sequence[Any],
) -> Coupled:
    """The constants of one group of joints of a system."""
    links, dtype = [system.links[joint.link] for joint in joints], masses[0].dtype
    numbers = sorted({mass for joint in joints for mass, _ in joint.ends})
    weights = {
        mass: jnp.stack([jnp.asarray(dict(joint.ends).get(mass, 0.0), dtype) for joint in joints])
        for mass in numbers
    }
    parts = [jnp.outer(row, row) / masses[mass] for mass, row in weights.items()]
    delassus = sum(parts[1:], parts[0])
    inverse = inverse_of(delassus)
    shares = {mass: (row @ inverse) / masses[mass] for mass, row in weights.items()}
    has_inerter = tuple(link.inerter is not None for link in links)
    driven = tuple(along(joint.ends, influence) for joint in joints)
    group, inerters = Group(tuple(joints), shares, driven, has_inerter), None
    if any(has_inerter):
        b = [0.0 if link.inerter is None else link.inerter.inertance for link in links]
        inertances = jnp.stack([jnp.asarray(x, dtype) for x in b])
        reduction = inverse_of(jnp.eye(len(joints), dtype=dtype) + delassus * inertances[None])
        delassus = reduction @ delassus
        inerters = Inerters(inertances, reduction)
    gaps = [
        (number, side, link)
        for number, joint in enumerate(joints)
        for link, side in joint.faces
        if system.links[link].contact is not None
    ]
    laws = tuple(with_mass(system.links[link].contact, 1 / delassus[n, n]) for n, _, link in gaps)
    sizes = [system.links[link].gap for _, _, link in gaps]
    coupling = Coupling(
        delassus=delassus,
        frictions=jnp.stack([link.friction for link in links]),
        resistances=tuple(link.velocity_friction for link in links),
        sizes=jnp.stack(sizes) if sizes else jnp.zeros((0,), dtype),
        laws=laws,
    )
    sides = tuple((n, side) for n, side, _ in gaps)
    return Coupled((group,), sides, (tuple(link for *_, link in gaps),), coupling, inerters)
