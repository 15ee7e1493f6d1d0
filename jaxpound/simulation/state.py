"""The state of a system between two steps, the constants of its steps, and an instant of it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import jax

from jaxpound.model.system import System
from jaxpound.model.topology import GROUND, Ends, Topology, elongation, link_groups
from jaxpound.simulation.contact.group import ContactState, coupling, needs_flow
from jaxpound.simulation.contact.group_flows import Groups, alike
from jaxpound.simulation.contact.records import Contact
from jaxpound.simulation.friction import LinkMotion
from jaxpound.simulation.inertance import Inerters
from jaxpound.simulation.rods.law import RodLaw, RodStep
from jaxpound.simulation.rods.laws import law_of
from jaxpound.simulation.scan import BlockForm

FEW_RODS = 8  # beyond, batches have no shortcut, and peaks and laws are arrays: it compiles sooner
WRITTEN_OUT = 4  # rods up to which a block is unrolled; a loop compiles in a third of the time


def each(function: Callable[..., Any], *series: Iterable[Any]) -> tuple[Any, ...]:
    """A function of the entries of several series one by one; None where an entry is None."""
    rows = zip(*series, strict=True)
    return tuple(None if any(x is None for x in row) else function(*row) for row in rows)


class StepConstants(NamedTuple):
    """Constants of a run, as its steps use them."""

    topology: Topology
    inverse_masses: tuple[jax.Array, ...]
    rods: tuple[RodLaw, ...]
    frictions: tuple[jax.Array, ...]
    groups: tuple[Groups, ...]  # of links that may need the local flow
    mass_shares: dict[int, dict[int, jax.Array]]  # of these groups, by number: see ``coupling``
    inerters: Inerters | None
    slots: int  # impacts recorded for each link in one step

    @property
    def is_long(self) -> bool:
        """Whether a step is too long for a block to be unrolled (``WRITTEN_OUT``)."""
        return bool(self.groups) or len(self.rods) > WRITTEN_OUT or self.has_long_laws

    @property
    def yield_displacements(self) -> tuple[Any, ...]:
        """Elongations where the rods yield first; None of one that never does."""
        return tuple(rod.yield_displacement for rod in self.rods)

    @property
    def yields(self) -> bool:
        """Whether rods yield."""
        return any(x is not None for x in self.yield_displacements)

    @property
    def has_shortcut(self) -> bool:
        """Whether batches have a shorter program for steps without local flow: on CPUs."""
        always = any(group.coupling.has_resistance for group in self.groups)
        is_short = bool(self.groups) and len(self.rods) <= FEW_RODS
        return is_short and not always and jax.default_backend() == "cpu"

    @property
    def has_many_peaks(self) -> bool:
        """Whether peaks of its series are computed in arrays, which compiles in less time."""
        return bool(self.groups) and len(self.rods) > FEW_RODS

    @property
    def has_long_laws(self) -> bool:
        """Whether rods yield by laws of more operations than ``Bilinear``."""
        return any(rod.is_long for rod in self.rods)

    @property
    def has_laws_in_arrays(self) -> bool:
        """Whether laws of many rods are in arrays: they compile in half the time but run longer."""
        return len(self.rods) > FEW_RODS and self.has_long_laws

    @property
    def block(self) -> BlockForm:
        """How the steps of a block are computed."""
        if self.is_long:
            return "loop"
        return "recomputed" if self.yields else "written out"

    def link_pulls(self, loads: Sequence[Any], acceleration: Any) -> list[jax.Array]:
        """Relative accelerations of the links' ends without these; between masses u'' drops out."""
        pulls, inverse = list[jax.Array](), self.inverse_masses
        for ends in self.topology.links:
            left, right = (acceleration if i == GROUND else loads[i] * inverse[i] for i in ends)
            pulls.append(left - right)
        return pulls if self.inerters is None else self.inerters.reduced(pulls)

    def inerter_forces(
        self, forces: Sequence[Any], acceleration: jax.Array, totals: Sequence[jax.Array]
    ) -> dict[int, jax.Array]:
        """Forces of inerters by link, under forces of rods, and of friction and contact."""
        if self.inerters is None:
            return {}
        pulls = self.link_pulls(self.topology.loads(forces), acceleration)
        return self.inerters.forces(pulls, totals)


class LinkState(NamedTuple):
    """State of a link: its closing at t_m, the rest at t_m − h/2 or t_{m−1}."""

    closing: jax.Array
    velocity: jax.Array
    phase: jax.Array
    pull: jax.Array  # A_{m−1}, the relative acceleration without the link
    contact: ContactState | None  # of a link in a group that may need the local flow


class RunState(NamedTuple):
    """Positions at t_m, velocities at t_m − h/2, and the state of rods and links.

    A mass that hangs on a link has no position and velocity of its own (None).
    """

    x: tuple[jax.Array | None, ...]
    v: tuple[jax.Array | None, ...]
    rods: tuple[Any, ...]  # as their laws have them
    links: tuple[LinkState, ...]


class LinkInstant(NamedTuple):
    """A link at an instant t_m, and its motion around it."""

    closing: jax.Array
    velocity: jax.Array
    motion: LinkMotion
    inertia: jax.Array | None  # force of its inerter

    @property
    def total_force(self) -> jax.Array:
        """The force of friction, contact and inerter."""
        total = self.motion.total_force
        return total if self.inertia is None else total + self.inertia


class Instant(NamedTuple):
    """A system at an instant t_m. Hanging masses are left out, as in ``RunState``."""

    time: jax.Array
    ground_acceleration: jax.Array
    x: tuple[jax.Array | None, ...]
    v: tuple[jax.Array | None, ...]
    rods: tuple[RodStep, ...]
    dissipated: tuple[jax.Array | None, ...]  # energy, by rods that yield
    links: tuple[LinkInstant, ...]
    needs_flow: jax.Array | None  # of a step without local flows: whether it needs one

    @property
    def forces(self) -> tuple[jax.Array, ...]:
        """The forces of the rods."""
        return tuple(rod.force for rod in self.rods)


def step_constants(
    system: System, dt: float, order: int, slots: int, x: Sequence[jax.Array] | None = None
) -> StepConstants:
    """The constants of a run with steps of ``dt`` that records up to ``slots`` impacts in each.

    Masses displaced by x at the start relax the rods there.
    """
    topology, inverse = system.topology, tuple(1 / m for m in system.masses)
    rods = tuple(
        law_of(rod, dt, order, None if x is None else elongation(ends, x))
        for rod, ends in zip(system.rods, topology.rods, strict=True)
    )
    groups, links = dict(enumerate(link_groups(topology))), system.links
    inerters = Inerters.of(system, inverse)
    couplings, mass_shares = {}, {}
    for n, group in groups.items():
        if needs_flow(group, links):
            couplings[n], mass_shares[n] = coupling(topology, group, links, inverse, inerters)
    frictions = tuple(link.friction for link in links)
    of_links = frictions, alike(groups, couplings), mass_shares, inerters, slots
    return StepConstants(topology, inverse, rods, *of_links)


def start_state(
    system: System,
    constants: StepConstants,
    zero: jax.Array,
    dt: float,
    x: Sequence[jax.Array] | None = None,
    v: Sequence[jax.Array] | None = None,
) -> RunState:
    """The state before the first step; or at t = 0, of masses displaced by x that move with v."""
    topology, groups = system.topology, link_groups(system.topology)
    hanging = {far for group in groups for _, _, far in group.hanging}
    flowing = {k for of_shape in constants.groups for k in of_shape.links}
    links = []
    for k, ends in enumerate(topology.links):
        closing, velocity = (zero if y is None else elongation(ends, y) for y in (x, v))
        apart = Contact(*(zero,) * len(Contact._fields))
        contact = ContactState(closing, apart) if k in flowing else None
        links.append(LinkState(closing, velocity, jax.lax.stop_gradient(zero), zero, contact))

    def of_free(y: Sequence[jax.Array] | None) -> tuple[jax.Array | None, ...]:
        values = [zero] * topology.n_masses if y is None else y
        return tuple(None if mass in hanging else value for mass, value in enumerate(values))

    lengths, speeds = (
        [zero if y is None else elongation(ends, y) for ends in topology.rods] for y in (x, v)
    )
    rods = tuple(
        law.start(length, dt * speed)
        for law, length, speed in zip(constants.rods, lengths, speeds, strict=True)
    )
    return RunState(of_free(x), of_free(v), rods, tuple(links))


def of_all_masses(
    topology: Topology, free: Sequence[Any], relative: Sequence[Any]
) -> tuple[Any, ...]:
    """Positions (or velocities) of all masses, from the free ones' and the links' closings."""
    positions = list(free)
    for group in link_groups(topology):
        for k, near, far in group.hanging:
            left, s = topology.links[k][0] == near, relative[k]
            if near == GROUND:
                positions[far] = -s if left else s
            else:
                positions[far] = positions[near] - s if left else positions[near] + s
    return tuple(positions)


def link_inverse_mass(ends: Ends, inverse: Sequence[Any]) -> Any:
    """Relative acceleration of a link's ends under a unit force in the link."""
    i, j = ends
    if j == GROUND:
        return inverse[i]
    return inverse[j] if i == GROUND else inverse[i] + inverse[j]
