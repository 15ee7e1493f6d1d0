"""Constants of a run, as its steps use them, and the state in which it starts."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, islice
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp

from jaxpound._xla.plan import Plan, Work, choice
from jaxpound.model.ends import WeightedEnds, along, load_on, moving_ends, weighted
from jaxpound.model.joint import Joint, groups, joints
from jaxpound.model.system import System
from jaxpound.simulation.contact.records import SLOTS, Contact
from jaxpound.simulation.damping import Damping
from jaxpound.simulation.joints.coupled import (
    Coupled,
    Group,
    all_coupled,
    joint_group,
    may_need_flow,
)
from jaxpound.simulation.joints.friction import FrictionLaw
from jaxpound.simulation.rods.law import RodLaw, RodStep
from jaxpound.simulation.rods.laws import law_of
from jaxpound.simulation.scheme import Scheme
from jaxpound.simulation.state import Now, RunState


def has_flows(system: System) -> bool:
    """Whether steps of a system may need local flows of its joints."""
    return any(may_need_flow(group, system) for group in groups(joints(system)))


class StepConstants(NamedTuple):
    """Constants of a run, as its steps use them."""

    masses: tuple[jax.Array, ...]
    influence: tuple[Any, ...]  # ι by mass, and 1 of supports: its share of the ground's motion
    rods: tuple[RodLaw, ...]
    rod_ends: tuple[WeightedEnds, ...]
    rod_paths: tuple[WeightedEnds, ...]  # along which they stretch, from supports that move
    joints: tuple[Coupled, ...]  # each one group of joints, or groups of joints of one shape
    friction: FrictionLaw  # of joints that share no mass with others
    dt: float
    slots: int  # impacts recorded for each gap in one step
    starts_at_rest: bool
    plan: Plan
    damping: Damping | None = None  # by pure dashpots
    is_loaded: bool = False

    @property
    def has_forces_on_masses(self) -> bool:
        """Whether forces act on masses that are of no rod and no link."""
        return self.is_loaded or (self.damping is not None and self.damping.inherent is not None)

    @staticmethod
    def of(
        system: System,
        scheme: Scheme,
        dt: float,
        keep: bool = False,
        x: Sequence[jax.Array] | None = None,
        is_loaded: bool = False,
    ) -> StepConstants:
        """Those of a run with steps of ``dt``, which may ``keep`` every instant.

        Masses displaced by x at the start relax the rods there.
        """
        masses, influence = (
            system.masses,
            (*system.influences, *(1.0,) * system.topology.n_supports),
        )
        rod_ends, rod_paths = (tuple(map(ends, system.rods)) for ends in (weighted, moving_ends))
        rods = tuple(
            law_of(rod, dt, scheme.order, None if x is None else along(ends, x))
            for rod, ends in zip(system.rods, rod_ends, strict=True)
        )
        alone, shared = list[Coupled](), list[tuple[Joint, ...]]()
        for group in groups(joints(system)):
            if may_need_flow(group, system):
                shared.append(group)
            else:
                alone.append(joint_group(group, system, masses, influence))
        kinds: Any = (*alone, *all_coupled(shared, system, masses, influence))
        if (damping := Damping.of(system, dt)) is not None:
            mobile = system, masses, influence, damping.inverse
            in_step = [joint_group(kind.of[0].joints, *mobile) for kind in alone]
            in_step += all_coupled(shared, *mobile)
            pairs = zip(kinds, in_step, strict=True)
            kinds = tuple(kind._replace(with_dashpots=other) for kind, other in pairs)
        flows: Literal["never", "sometimes", "always"] = "sometimes" if shared else "never"
        if any(link.velocity_friction for link in system.links):
            flows = "always"
        plan = choice()(Work(len(rods), _length_of(rods), flows, keep))
        slots = SLOTS if keep else 0
        numbers: Any = scheme.friction, dt, slots, x is None, plan, damping, is_loaded
        return StepConstants(masses, influence, rods, rod_ends, rod_paths, kinds, *numbers)

    def start(
        self, zero: jax.Array, x: Sequence[jax.Array] | None, v: Sequence[jax.Array] | None
    ) -> RunState:
        """The state at t = 0: at rest, or of masses displaced by x that move with v."""
        n, n_all = len(self.masses), len(self.influence)
        at_rest = (zero,) * n_all
        x, v = (at_rest if y is None else (*y, *at_rest[n:]) for y in (x, v))
        rods = tuple(
            law.start(along(ends, x), self.dt * along(ends, v))
            for law, ends in zip(self.rods, self.rod_paths, strict=True)
        )
        owed = None if self.damping is None else zero + 0 * self.damping.influence
        return RunState(x, v, rods, tuple(kind.start(zero, x, v) for kind in self.joints), owed)

    def free_accelerations(
        self,
        forces: Sequence[Any],
        more: Sequence[Any] | None = None,
        supports: Sequence[Any] = (),
    ) -> list[Any]:
        """Accelerations −M⁻¹ Bᵀ f of the masses by the forces f of the rods, and by ``more``.

        Behind them are those of ``supports``.
        """
        loads = self.loads(forces, more)
        # As quotients XLA computes them once; it computes products again for each use.
        free = [load / mass for load, mass in zip(loads, self.masses, strict=True)]
        return [*free, *supports]

    def loads(self, forces: Sequence[Any], more: Sequence[Any] | None = None) -> list[Any]:
        """Loads −Bᵀ f on the masses by the forces f of the rods, and ``more`` loads."""
        loads = [load_on(mass, self.rod_ends, forces) for mass in range(len(self.masses))]
        if more is None:
            return loads
        return [load + other for load, other in zip(loads, more, strict=True)]

    def accelerations(
        self, rods: Sequence[RodStep], v: Sequence[Any], owed: Any, now: Now, drag: Any = None
    ) -> tuple[list[Any], Any]:
        """Mean accelerations in a step by rods and loads, and u'' if they are without the ground's.

        ``v`` are velocities before it; dashpots owe accelerations and may ``drag``. Supports have
        their own accelerations.
        """
        forces, moved = [rod.kick for rod in rods], now.mean_supports
        if (damping := self.damping) is None:
            return self.free_accelerations(forces, now.mean_loads, moved), now.mean_ground
        loads, n = self.loads(forces, now.mean_loads), len(self.masses)
        relative = [u - now.mean_ground for u in moved]
        mean = [y + now.kick * self.dt / 2 * a for y, a in zip(v[n:], relative, strict=True)]
        free = damping.accelerations(loads, [*v[:n], *mean], now.mean_ground, owed, drag)
        return [*free, *relative], None

    def follow(
        self, y: Sequence[Any], closings: Sequence[Any], flows: Sequence[Any] = ()
    ) -> tuple[Any, ...]:
        """Motions y of masses that follow those s of joints: y + S (s − C y), S = M⁻¹ Cᵀ G⁻¹.

        In a step with dashpots joints without a flow have the mean mobility P for M⁻¹.
        """
        moved = list(y)
        each = zip(self.joints, closings, flows or [None] * len(closings), strict=True)
        for kind, closing, flow in each:
            missing = closing - kind.along(moved)
            if kind.with_dashpots is None:
                kind.follow(moved, missing)
            elif flow is None:
                kind.in_step.follow(moved, missing)
            else:
                used = jnp.expand_dims(flow.used, -1)
                kind.follow(moved, jnp.where(used, missing, 0.0))
                kind.in_step.follow(moved, jnp.where(used, 0.0, missing))
        return tuple(moved)

    @property
    def with_ground(self) -> list[tuple[Any, ...]]:
        """By mass the share of the ground's motion that it has where its joints do not move.

        Behind it those of the motions of supports, from the last to support 1.
        """
        n, n_all = len(self.masses), len(self.influence)
        units = [[float(k == i) for k in range(n_all)] for i in range(n, n_all)]
        return [self.follow(y, [0.0] * len(self.joints)) for y in (self.influence, *units)]

    @property
    def groups(self) -> list[Group]:
        """All groups of joints that share masses."""
        return [group for kind in self.joints for group in kind.of]

    def inertia(
        self, free: Sequence[Any], ground: jax.Array, forces: Sequence[Sequence[Any]]
    ) -> list[list[Any]]:
        """Forces of inerters, by group and joint, beside other ``forces``; see ``Coupled``."""
        others = iter(forces)
        by_kind = (
            kind.inertia(free, ground, [*islice(others, len(kind.of))]) for kind in self.joints
        )
        return [*chain.from_iterable(by_kind)]


def _length_of(laws: Sequence[RodLaw]) -> Literal["none", "short", "long"]:
    """How many operations laws of rods have that follow their path."""
    if any(law.is_long for law in laws):
        return "long"
    return "none" if all(law.yield_displacement is None for law in laws) else "short"


def contacts(system: StepConstants, state: RunState, n_links: int) -> tuple[Contact | None, ...]:
    """The contact of each link; None for links without a law of contact."""
    by_link: dict[int, Contact] = {}
    for kind, joint in zip(system.joints, state.joints, strict=True):
        by_link |= kind.contacts(joint)
    return tuple(map(by_link.get, range(n_links)))
