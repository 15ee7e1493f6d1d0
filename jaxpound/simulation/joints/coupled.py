"""Groups of joints that may need the local flow, those of the same shape together.

Groups between the floors of two buildings, with contact laws of one class, have one shape. A step
of a group takes seconds to compile, here once instead of for every group; it runs as fast.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound._xla.alike import by_kind, in_array, stacked, unstacked
from jaxpound.model.contact import with_mass
from jaxpound.model.ends import along, less_ground
from jaxpound.model.joint import Joint
from jaxpound.model.system import System
from jaxpound.model.topology import WeightedMasses, joined_ends
from jaxpound.simulation.contact.forces import inverse_of
from jaxpound.simulation.contact.records import Contact, Coupling, GapStep, times
from jaxpound.simulation.joints import group as functions
from jaxpound.simulation.joints.friction import FrictionLaw
from jaxpound.simulation.joints.group import Flow
from jaxpound.simulation.state import JointState, Jump, LinkInstant, Moved, Now, SeenGroup


class Inerters(NamedTuple):
    """Inerters of n joints, which add b s'' to the forces q of their joints.

    From s'' = A − G (q + b s'') follows s'' = (1 + G b)⁻¹ (A − G q), the law of joints without
    inerters with another pull and another G.
    """

    inertances: jax.Array  # b (n,), 0 without
    reduction: jax.Array  # (1 + G b)⁻¹, (n, n)


class Group(NamedTuple):
    """Joints that share masses, directly or through other joints, or a joint alone."""

    joints: tuple[Joint, ...]
    links: tuple[int, ...]  # of the gaps
    shares: dict[int, jax.Array]  # by mass its row, (n,), of S = M⁻¹ Cᵀ G⁻¹
    influence: tuple[Any, ...]  # C ι, by joint
    has_inerter: tuple[bool, ...]  # by joint


class Coupled(NamedTuple):
    """Groups of one shape, each of n joints and g gaps; several have arrays with a leading axis.

    A joint alone that never needs a flow has numbers in the place of arrays of length one, of which
    gradients would take longer.
    """

    of: tuple[Group, ...]
    coupling: Coupling
    inerters: Inerters | None
    with_dashpots: Coupled | None = None  # with the mean mobility P of a step for M⁻¹

    @property
    def in_step(self) -> Coupled:
        """The groups as they move in a step without flow, with all dashpots."""
        return self.with_dashpots or self

    def _map(self, function: Callable[..., Any], *values: Any) -> Any:
        """A function of the numbers of one group, applied to each group."""
        return jax.vmap(function)(*values) if len(self.of) > 1 else function(*values)

    def _times(self, matrix: jax.Array, y: jax.Array) -> jax.Array:
        """The matrix of each group times a vector of its joints."""
        product: jax.Array = matrix * y if not jnp.ndim(y) else self._map(times, matrix, y)
        return product

    def _array(self, by_joint: Sequence[Any]) -> Any:
        """Numbers of all joints as an array, (n,), or (groups, n) of several groups."""
        if not self.coupling.may_need_flow:
            return by_joint[0]
        flat, several = in_array(by_joint), len(self.of)
        return flat.reshape(several, -1) if several > 1 else flat

    def _by_group(self, tree: Any) -> list[Any]:
        return unstacked(tree) if len(self.of) > 1 else [tree]

    def _by_joint(self, tree: Any) -> list[list[Any]]:
        """By group the numbers of each joint."""
        if not self.coupling.may_need_flow:
            return [[tree]]
        return [unstacked(group) for group in self._by_group(tree)]

    def start(self, zero: jax.Array, x: Sequence[Any], v: Sequence[Any]) -> JointState:
        """Their state at the start of a run."""
        closing, velocity = (self.along([zero + z for z in y]) for y in (x, v))
        rest = 0 * closing
        state = JointState(closing, velocity, jax.lax.stop_gradient(rest), rest)
        if not self.coupling.may_need_flow:
            return state
        shape = *closing.shape[:-1], len(self.coupling.gaps)
        apart = Contact(*(jnp.broadcast_to(zero, shape),) * len(Contact._fields))
        return state._replace(half=closing, contact=apart)

    def along(self, y: Sequence[Any] | jax.Array) -> Any:
        """C y: closings, velocities or accelerations of the joints from those of the masses."""
        joints = (joint for group in self.of for joint in group.joints)
        return self._array([along(joint.path, y) for joint in joints])

    def pull(self, free: Sequence[Any], ground: jax.Array | None) -> jax.Array:
        """A = C (a − ι u''), relative accelerations of joints from the free ones of the masses."""
        pulls = [
            less_ground(along(joint.path, free), iota, ground)
            for group in self.of
            for joint, iota in zip(group.joints, group.influence, strict=True)
        ]
        pull = self._array(pulls)
        return pull if self.inerters is None else self._times(self.inerters.reduction, pull)

    def follow(self, y: list[Any], missing: Any) -> None:
        """Add S times missing closings to the motions of masses, so that their joints have them."""
        for group, closings in zip(self.of, self._by_group(missing), strict=True):
            for mass, share in group.shares.items():
                y[mass] = y[mass] + (share * closings).sum()

    def stop(self, v: list[Any], stop: Any) -> None:
        """Add to velocities what the last end of a joint, or with weights all, make of a change."""
        ((joint,),), ((change,),) = [group.joints for group in self.of], self._by_joint(stop)
        mass, weight = joint.ends[-1]
        if isinstance(weight, int):
            v[mass] = v[mass] + change / weight
            return
        for mass, share in self.of[0].shares.items():  # as a weight may be 0
            v[mass] = v[mass] + share * change

    def deviation(self, before: JointState, flow: Flow, now: Now, h: float) -> Any:
        """How the joints have deviated from smooth motion in a flow."""
        of_group = partial(functions.deviation, now=now, h=h)
        return self._map(of_group, before, flow)

    def dragged(self, moved: Moved, flow: Flow | None, pull: Any, drag: Any, h: float) -> Moved:
        """Joints after a step, of which dashpots ``drag`` those with a flow; see ``group``."""
        if flow is None:
            return moved
        drags = [self.along(y) for y in (drag.mean, drag.position, drag.end)]
        of_group = partial(functions.dragged, h=h)
        result: Moved = self._map(of_group, self.coupling, flow, moved, pull, *drags)
        return result

    def kink(self, moved: Moved, h: float) -> Any:
        """Mean velocity in a step without flow less the mean of both ends, as forces jumped."""
        share, (first, last) = moved.turns.farthest_time / h + 0.5, moved.turn_forces
        mobility = self.coupling.delassus
        if jnp.ndim(mobility):
            mobility = jnp.diagonal(mobility, axis1=-2, axis2=-1)
        kink = mobility * (last - first) * share * (1 - share) * h / 2
        return jnp.where(moved.turns.exist > 0, kink, 0.0)

    def flow(
        self, before: JointState, pull: jax.Array, now: Now, h: float, slots: int
    ) -> Flow | None:
        """The joints after their local flow; None where none ever needs one."""
        if not self.coupling.may_need_flow:
            return None
        follow = partial(functions.followed, now=now, h=h, slots=slots)
        moved: Flow = self._map(follow, self.coupling, self.in_step.coupling, before, pull)
        return moved

    def needs_flow(self, before: JointState, pull: jax.Array, now: Now, h: float) -> jax.Array:
        """Whether any group needs its local flow."""
        if not self.coupling.may_need_flow:
            return jnp.zeros((), bool)
        needed = partial(functions.is_flow_needed, now=now, h=h)
        return jnp.ravel(self._map(needed, self.in_step.coupling, before, pull)).any()

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
        step = partial(functions.without_flow, now=now, law=law, h=h)
        moved: Moved = self._map(step, self.in_step.coupling, before, pull)
        if flow is not None:
            step = partial(functions.after_flow, h=h)
            moved = self._map(step, self.coupling, before, flow, moved, pull)
        return moved

    def seen(self, moved: Moved, flow: Flow | None, inertia: Callable[..., Any]) -> list[SeenGroup]:
        """The groups as they are observed; ``inertia`` has forces of inerters beside others."""
        gaps, of_joints = self.coupling.gaps, moved.state._replace(contact=None)
        joints = self._by_joint(moved._replace(state=of_joints))
        steps, used = [list[GapStep]()] * len(self.of), [jnp.zeros((), bool)] * len(self.of)
        if flow is not None:
            used = self._by_group(flow.used)
            if gaps:
                steps = [*map(unstacked, self._by_group(flow.result.gaps))]
        forces = [[joint.force for joint in of_group] for of_group in joints]
        for of_group, of_gaps in zip(forces, steps, strict=True):
            for (joint, side), step in zip(gaps, of_gaps, strict=bool(of_gaps)):
                of_group[joint] = of_group[joint] + side * step.force
        columns = zip(self.of, joints, steps, used, forces, inertia(forces), strict=True)
        return [_seen(gaps, *column) for column in columns]

    def contacts(self, state: JointState) -> dict[int, Contact]:
        """The contact of each link that has a law of contact."""
        by_gap: dict[int, Contact] = {}
        if self.coupling.gaps:
            for group, contact in zip(self.of, self._by_group(state.contact), strict=True):
                by_gap |= zip(group.links, unstacked(contact), strict=True)
        return by_gap

    def inertia(
        self, free: Sequence[Any], ground: jax.Array, forces: Sequence[Sequence[Any]]
    ) -> list[list[Any]]:
        """The forces b s'' of inerters beside other forces; None of joints without one."""
        if self.inerters is None:
            return [[None] * len(group.joints) for group in self.of]
        total = self._array([q for group in forces for q in group])
        others = self._times(self.coupling.delassus, total)
        inert = self._by_joint(self.inerters.inertances * (self.pull(free, ground) - others))
        return [
            [force if has else None for has, force in zip(group.has_inerter, row, strict=True)]
            for group, row in zip(self.of, inert, strict=True)
        ]


def _seen(
    gaps: Sequence[tuple[int, int]],
    group: Group,
    joints: Sequence[Moved],
    steps: Sequence[GapStep],
    used: jax.Array,
    forces: Sequence[jax.Array],
    inertia: Sequence[Any],
) -> SeenGroup:
    """A group as it is observed, with its joints after a step, of which a flow may be ``used``.

    ``steps`` are those of its gaps in a step with a flow; ``forces`` and ``inertia`` are forces of
    friction and contact, and of inerters, by joint.
    """
    jumps, links = list[Jump](), dict[int, LinkInstant]()
    for number, moved in enumerate(joints):
        exists, time = moved.turns.exist & ~used, moved.turns.farthest_time
        for force in moved.turn_forces:
            after = [*forces]
            after[number] = jnp.where(exists, force, forces[number])
            jumps.append(Jump(jnp.where(exists, time, 0.0), after))
    for log in [step.log for step in steps]:
        hits, pairs = log.highest > 0, zip(log.highest_forces, forces, strict=True)
        highest = [jnp.where(hits, force, now) for force, now in pairs]
        jumps.append(Jump(jnp.where(hits, log.highest_time, 0.0), highest))
    by_link = dict(zip(group.links, steps, strict=bool(steps)))
    for joint, moved, inert in zip(group.joints, joints, inertia, strict=True):
        touch = [by_link[link].log for link, _ in joint.faces if link in by_link]
        jumped = [used & (log.highest_time != 0) for log in touch]
        for link, side in joint.faces:  # each with the closing as this face sees it
            links[link] = LinkInstant(
                closing=side * moved.now,
                velocity=side * moved.velocity_now,
                friction=moved.force if side > 0 else 0 * moved.force,
                phase=side * moved.state.phase,
                change_time=moved.change_time,
                turns=moved.turns if side > 0 else moved.turns.reversed,
                jumps=jnp.stack(jumped).any() if jumped else False,
                inertia=inert if side > 0 else None,
                gap=by_link.get(link),
            )
    return SeenGroup(forces, inertia, jumps, links)


def _inverse(delassus: jax.Array, joints: Sequence[Joint], system: System) -> jax.Array:
    """G⁻¹, by which masses follow joints; where links close a ring, the pseudo-inverse of G.

    The closings in a ring are C x = L C_1 x with those of the joints 1 that close none, so that
    G = L G_1 Lᵀ.
    """
    all_ends = [system.links[joint.link].ends for joint in joints]
    if any(isinstance(ends, WeightedMasses) for ends in all_ends):
        return inverse_of(delassus)  # weights are checked: no closing follows from others
    _, first = joined_ends(len(system.masses), all_ends)
    if len(first) == len(joints):
        return inverse_of(delassus)
    unit_motions = [*np.eye(len(system.masses))]
    rows = np.stack([along(joint.ends, unit_motions) for joint in joints])
    whole = np.linalg.pinv(rows @ np.linalg.pinv(rows[first]))
    independent = inverse_of(delassus[np.ix_(first, first)])
    return jnp.asarray(whole.T, delassus.dtype) @ independent @ jnp.asarray(whole, delassus.dtype)


def may_need_flow(joints: Sequence[Joint], system: System) -> bool:
    """Whether steps of joints that share masses may need the local flow."""
    links = [system.links[link] for joint in joints for link, _ in joint.faces]
    return len(joints) > 1 or any(link.contact or link.velocity_friction for link in links)


def all_coupled(
    groups: Sequence[Sequence[Joint]],
    system: System,
    masses: Sequence[jax.Array],
    influence: Sequence[Any],
    mobility: jax.Array | None = None,
) -> list[Coupled]:
    """The constants of groups of joints, those together whose numbers have the same shapes."""
    alone = [joint_group(joints, system, masses, influence, mobility) for joints in groups]
    together = []
    for numbers in by_kind([kind[1:] for kind in alone]):
        same = [alone[n] for n in numbers]
        constants = same[0][1:] if len(same) == 1 else stacked([kind[1:] for kind in same])
        together.append(Coupled(tuple(kind.of[0] for kind in same), *constants))
    return together


def joint_group(
    joints: Sequence[Joint],
    system: System,
    masses: Sequence[jax.Array],
    influence: Sequence[Any],
    mobility: jax.Array | None = None,
) -> Coupled:
    """The constants of one group of joints of a system, with M⁻¹ or another ``mobility``."""
    links, dtype = [system.links[joint.link] for joint in joints], masses[0].dtype
    numbers = sorted({mass for joint in joints for mass, _ in joint.ends})
    weights = {
        mass: jnp.stack([jnp.asarray(dict(joint.ends).get(mass, 0.0), dtype) for joint in joints])
        for mass in numbers
    }
    if mobility is None:
        parts = [jnp.outer(row, row) / masses[mass] for mass, row in weights.items()]
        delassus = sum(parts[1:], parts[0])
        inverse = _inverse(delassus, joints, system)
        shares = {mass: (row @ inverse) / masses[mass] for mass, row in weights.items()}
    else:
        moved = mobility[:, jnp.array(numbers)] @ jnp.stack([weights[mass] for mass in numbers])
        delassus = jnp.stack([weights[mass] for mass in numbers]).T @ moved[jnp.array(numbers)]
        shares = dict(enumerate(moved @ _inverse(delassus, joints, system)))
    has_inerter = tuple(link.inerter is not None for link in links)
    driven = tuple(along(joint.path, influence) for joint in joints)
    inerters = None
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
    sizes = [system.links[link].gap for _, _, link in gaps]
    coupling = Coupling(
        delassus=delassus,
        frictions=jnp.stack([link.friction for link in links]),
        resistances=tuple(link.velocity_friction for link in links),
        sizes=jnp.stack(sizes) if sizes else jnp.zeros((0,), dtype),
        laws=tuple(with_mass(system.links[k].contact, 1 / delassus[n, n]) for n, _, k in gaps),
        gaps=tuple((number, side) for number, side, _ in gaps),
    )
    if not coupling.may_need_flow:  # a joint alone
        coupling, inerters, shares = jax.tree.map(jnp.squeeze, (coupling, inerters, shares))
    of_gaps = tuple(link for *_, link in gaps)
    group = Group(tuple(joints), of_gaps, shares, driven, has_inerter)
    return Coupled((group,), coupling, inerters)
