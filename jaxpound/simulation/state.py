"""The state of a system between two steps, the constants of its steps, and an instant of it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Literal, NamedTuple

import jax

from jaxpound._xla.plan import Plan, Work, choice
from jaxpound.model.dampers import Dashpot, PowerLaw
from jaxpound.model.hysteresis import hysteresis_of, zener_of
from jaxpound.model.system import System
from jaxpound.model.topology import GROUND, Ends, Topology, elongation, link_groups
from jaxpound.simulation.contact.group import ContactState, coupling, needs_flow
from jaxpound.simulation.contact.group_flows import Groups, alike
from jaxpound.simulation.contact.records import SLOTS, Contact
from jaxpound.simulation.friction import LinkMotion
from jaxpound.simulation.inertance import Inerters
from jaxpound.simulation.rod import RodLaw, SpringLaw, rod_law
from jaxpound.simulation.slider import has_slider
from jaxpound.simulation.yielding import HysteresisConstants, HysteresisState


def each(function: Callable[..., Any], *series: Iterable[Any]) -> tuple[Any, ...]:
    """A function of the entries of several series one by one; None where an entry is None."""
    rows = zip(*series, strict=True)
    return tuple(None if any(x is None for x in row) else function(*row) for row in rows)


class StepConstants(NamedTuple):
    """Constants of a run, as its steps use them."""

    topology: Topology
    inverse_masses: tuple[jax.Array, ...]
    rods: tuple[RodLaw | SpringLaw, ...]  # as they are before they yield
    hysteresis: tuple[HysteresisConstants | None, ...]  # of the rods
    frictions: tuple[jax.Array, ...]
    groups: tuple[Groups, ...]  # of links that may need the local flow
    mass_shares: dict[int, dict[int, jax.Array]]  # of these groups, by number: see ``coupling``
    inerters: Inerters | None
    slots: int  # impacts recorded for each link in one step
    plan: Plan = Plan()

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
    # K e_{m−1} − f_{m−1} of each rod with elongation e, by its force before yield
    excess: tuple[Any, ...]  # None of a spring
    yielding: tuple[HysteresisState | None, ...]
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
    forces: tuple[jax.Array, ...]  # of the rods
    dissipated: tuple[jax.Array | None, ...]  # energy, by rods that yield
    links: tuple[LinkInstant, ...]
    needs_flow: jax.Array | None  # of a step without local flows: whether it needs one


def step_constants(system: System, dt: float, order: int, keep: bool) -> StepConstants:
    """The constants of a run with steps of ``dt``, which may ``keep`` every instant."""
    topology, inverse = system.topology, tuple(1 / m for m in system.masses)
    rods = tuple(
        SpringLaw(rod.stiffness)
        if (viscoelastic := zener_of(rod.material)) is None
        else rod_law(viscoelastic, rod.stiffness, dt, order)
        for rod in system.rods
    )
    laws = [
        rod.material.for_steps(rod.stiffness, dt)
        if isinstance(rod.material, PowerLaw)
        else hysteresis_of(rod.material)
        for rod in system.rods
    ]
    hysteresis = each(HysteresisConstants, laws, [rod.stiffness for rod in system.rods])
    groups, links = dict(enumerate(link_groups(topology))), system.links
    inerters = Inerters.of(system, inverse)
    couplings, mass_shares = {}, {}
    for n, group in groups.items():
        if needs_flow(group, links):
            couplings[n], mass_shares[n] = coupling(topology, group, links, inverse, inerters)
    frictions = tuple(link.friction for link in links)
    flowing, slots = alike(groups, couplings), SLOTS if keep else 0
    plan = choice()(Work(len(rods), _length_of(laws), _need_of(flowing), keep))
    of_links = frictions, flowing, mass_shares, inerters, slots
    return StepConstants(topology, inverse, rods, hysteresis, *of_links, plan)


def _length_of(laws: Sequence[Any]) -> Literal["none", "short", "long"]:
    """How many operations the laws of hysteresis have: ``Bilinear`` few, all others many."""
    yielding = [law for law in laws if law is not None and not isinstance(law, Dashpot)]
    if not yielding:
        return "none"
    return "short" if all(map(has_slider, yielding)) else "long"


def _need_of(groups: Sequence[Groups]) -> Literal["never", "sometimes", "always"]:
    """How often a step needs a local flow, the loop over the events within a step."""
    if any(group.coupling.has_resistance for group in groups):
        return "always"
    return "sometimes" if groups else "never"


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

    def of_rod(rod: HysteresisConstants, ends: Ends) -> HysteresisState:
        length, speed = (zero if y is None else elongation(ends, y) for y in (x, v))
        return HysteresisState(rod.law.start(length), rod.within(length), dt * speed)

    yielding = each(of_rod, constants.hysteresis, topology.rods)
    excess = tuple(None if isinstance(law, SpringLaw) else zero for law in constants.rods)
    return RunState(of_free(x), of_free(v), excess, yielding, tuple(links))


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
