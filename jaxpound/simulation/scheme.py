"""How the equations of motion are discretised, and the largest stable step."""

from __future__ import annotations

import dataclasses
import itertools
import reprlib
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound._checks import (
    enforce,
    evaluated,
    instance,
    instead,
    is_known_and_single,
    is_traced,
)
from jaxpound._errors import InvalidInput
from jaxpound._fields import rules
from jaxpound.grid import TimeGrid
from jaxpound.model.dampers import PowerLaw
from jaxpound.model.ends import WeightedEnds, along, beside_axis, mobility, weighted
from jaxpound.model.hysteresis import before_yield, zener_of
from jaxpound.model.joint import groups, joints
from jaxpound.model.places import link_places, rod_places
from jaxpound.model.system import Rod, Structures, System, in_si
from jaxpound.model.topology import Topology, WeightedMasses, rod_groups, storey_rods
from jaxpound.simulation.damping import Damping
from jaxpound.simulation.joints.coupled import may_need_flow
from jaxpound.simulation.joints.friction import EventResolved, FrictionLaw, Switching
from jaxpound.simulation.rods.zener import nyquist_stiffness
from jaxpound.simulation.time.history import FullHistory, HistorySum, ModalHistory


@dataclasses.dataclass(frozen=True)
class Scheme:
    """How eq. (9) is discretised. Static: another scheme is another compiled program.

    Parameters
    ----------
    friction
        Friction law: ``EventResolved()``, ``Switching()`` or ``Smoothed(velocity)``.
    order
        Order of accuracy of the rods: 1 (the paper, eq. 10) or 2.
    history
        ``ModalHistory()`` or ``FullHistory()``.
    start
        ``"rest"`` starts with the half kick of a block at rest, second-order accurate;
        ``"paper"`` sets x_0 = x_1 = 0, first-order accurate.
    checkpoint
        For reverse-mode differentiation of long runs: keep the state at about √n_steps instants
        only, and recompute each segment in the backward pass, with the same results.
    extrapolated
        Whether each run is repeated at dt/2, so that errors of second order cancel
        (Richardson 1911): positions, velocities, rods' forces and all scalars are (4 y(dt/2) −
        y(dt))/3; forces and phases of links are those at dt. It takes three times as long, and pays
        from relative errors of some 1e-4 downwards. Derivatives stay of second order. Only for
        schemes of second order and links without contact laws.

    Examples
    --------
    >>> jp.Scheme(jp.Smoothed(0.1)).friction
    Smoothed(velocity=0.1)
    >>> jp.Scheme(history=jp.ModalHistory(tolerance=1e-8), checkpoint=True).order
    2
    """

    friction: FrictionLaw = EventResolved()
    order: int = 2
    history: HistorySum = ModalHistory()
    start: str = "rest"
    checkpoint: bool = False
    extrapolated: bool = False

    def __post_init__(self) -> None:
        is_law = hasattr(self.friction, "slide") and not isinstance(self.friction, type)
        is_history = hasattr(self.history, "kernel") and not isinstance(self.history, type)
        second_order = self.order == 2 and self.start == "rest"
        switches = isinstance(self.friction, Switching)
        extrapolates = not self.extrapolated or (second_order and not switches)
        suitable = 'have order 2, start "rest" and another friction than Switching()'
        for name, holds, rule in (
            ("friction", is_law, "be a friction law"),
            ("order", self.order in (1, 2), "be 1 or 2"),
            ("history", is_history, "be a history"),
            ("start", self.start in ("rest", "paper"), "be 'rest' or 'paper'"),
            ("checkpoint", isinstance(self.checkpoint, bool), "be True or False"),
            ("extrapolated", isinstance(self.extrapolated, bool), "be True or False"),
            ("extrapolated", extrapolates, suitable),
        ):
            if not holds:
                raise InvalidInput(name, repr(getattr(self, name)), f"must {rule}")

    def finest(self, grid: TimeGrid) -> TimeGrid:
        """The finest grid of a run."""
        return grid.halved if self.extrapolated else grid


PAPER_SCHEME = Scheme(Switching(), order=1, history=FullHistory(), start="paper")
"""The paper's scheme (eqs. 10–12): order 1, full history, switching friction, x_0 = x_1 = 0."""


def stability_limit(structures: Structures, scheme: Scheme = Scheme()) -> float:
    """Largest stable time step of structures with concrete values: in units of 1/ω1, or in s.

    There the fastest motion of the grid, x_m = (−1)^m, neither grows nor decays: h² λ = 4 with the
    largest eigenvalue λ of M⁻¹ K, where K has each rod's stiffness for that motion (for the paper's
    pair λ is the larger of K1 and ρ K2). Links in stick never raise λ. Accuracy needs shorter
    steps, some 50 in the shortest natural period.

    Parameters
    ----------
    structures
        ``Buildings``, whose limit is in s; ``AdjacentStructures``, a ``System`` or anything else
        with ``system()``, in units of 1/ω1. For a batch, the result is the smallest limit. Traced
        values are a ``ValueError``.
    scheme
        The discretisation.

    Examples
    --------
    >>> structures = jp.paper.structures()
    >>> round(jp.stability_limit(structures), 3)
    0.442
    >>> round(jp.stability_limit(structures, jp.PAPER_SCHEME), 3)
    0.561
    """
    system = system_of(structures)
    if is_traced(system):
        raise InvalidInput("structures", "", "must be known, not traced")
    concrete = jax.tree.map(np.asarray, system)
    at_rest = _largest_eigenvalue(concrete, [*map(_stiffness, concrete.rods)])
    low, high = 0.0, 2 / float(np.max(at_rest)) ** 0.5  # a rod is never softer than at rest
    for _ in range(60):
        middle = (low + high) / 2
        stable = (_courant(concrete, middle, scheme) < 1).all()
        low, high = (middle, high) if stable else (low, middle)
    return float(low)


def system_of(structures: Any) -> System:
    """The system of structures; an ``InvalidInput`` for other objects."""
    if not isinstance(structures, Structures) or isinstance(structures, type):
        types = "AdjacentStructures, a System, Buildings or anything else with system()"
        rule = f"must be {types}{instead(structures, types)}"
        raise InvalidInput("structures", reprlib.repr(structures), rule)
    system = structures.system()
    instance("structures.system()", system, System)
    return system


def single_system(structures: Any) -> System:
    """The system of structures that are no batch; a ``ValueError`` for others, or invalid ones."""
    system = system_of(structures)
    # A system of the user's own making is judged by its parts, ours by their own parameters.
    rules_of_all = rules(structures) or rules(system)
    for rule in rules_of_all:
        if shape := jnp.shape(rule.value):
            says = "must be one number; a batch of structures goes through jax.vmap"
            raise InvalidInput(f"structures: {rule.name}", "", f"of shape {shape} {says}")
    enforce(rule._replace(name=f"structures: {rule.name}") for rule in rules_of_all)
    return system


def imprecise(system: System, grid: TimeGrid, numbers: Any) -> list[str]:
    """Findings for a damper whose brace steps do not resolve, and contact in single precision.

    ``numbers`` are all others of a run.
    """
    with evaluated(system):
        findings = _unresolved(system, grid.dt) + _overdamped(system, grid.dt)
    dtype = jnp.result_type(float, *jax.tree.leaves((system, numbers)))
    if dtype != jnp.float64 and any(link.contact is not None for link in system.links):
        rule = "forces are off by up to 1e-4 of themselves and impacts may be missed"
        remedy = 'jax.config.update("jax_enable_x64", True) first makes it float64'
        findings.append(f"contact is run in {dtype}, in which {rule}: {remedy}")
    return findings


_RESOLVED = 4.0  # steps over c/K from which errors of a damper on its brace are of first order
_NO_LAG = 2.5e-4  # share of the mass below which they are small


def _unresolved(system: System, dt: float) -> list[str]:
    """A finding for the first rod that is a viscous damper on too stiff a brace for the step.

    Its force lags by half a step, which acts as −c dt/2 of mass (the table on the page on dampers).
    """
    for r, (rod, response) in enumerate(zip(system.rods, _mobilities(system), strict=True)):
        law, numbers = rod.material, (rod.material, rod.stiffness, response)
        if not isinstance(law, PowerLaw) or not is_known_and_single(numbers) or not law.force:
            continue
        c, stiffness = float(law.force / law.velocity), float(rod.stiffness)
        lag, steps = c * dt / 2 * float(response), dt * stiffness / c
        if steps > _RESOLVED and lag > _NO_LAG:
            return [
                f"{_part(system.topology, r)}: dt is {steps:.3g} times c/K, with c = F/v of the "
                f"dashpot and K of its brace, and should be at most {_RESOLVED:g} times: the force "
                f"lags by half a step, an error of first order in dt like {lag:.2%} less mass; "
                f"take dt, or the stiffness of the brace, {steps / _RESOLVED:.3g} times smaller"
            ]
    return []


_STRONG = 0.2  # c dt/2 over the mass from which flows are inexact


def _overdamped(system: System, dt: float) -> list[str]:
    """A finding for the first link with a local flow beside dashpots too strong for the step.

    The flow knows nothing of what dashpots do within it, which is added to its end.
    """
    flowing = [group for group in groups(joints(system)) if may_need_flow(group, system)]
    damping = Damping.of(system, dt) if flowing and is_known_and_single(system) else None
    if damping is None:
        return []
    for group in flowing:
        for joint in group:
            row = np.asarray(along(joint.ends, [*np.eye(len(system.masses))]))
            share = float(mobility(joint.ends, system.masses) / (row @ damping.inverse @ row)) - 1
            if share > _STRONG:
                return [
                    f"link {link_places(system.topology)[joint.link]}: dt c/m is {2 * share:.3g}, "
                    f"with c of the dashpots and m of the masses at its ends, and should be at "
                    f"most {2 * _STRONG:g} where links touch or share masses: friction and contact "
                    f"are inexact else; take dt {share / _STRONG:.3g} times smaller"
                ]
    return []


def require_stable(structures: Structures, scheme: Scheme, dt: float, place: str = "grid:") -> None:
    """An ``InvalidInput`` for a step with which concrete structures diverge."""
    system = structures.system()
    if is_traced(system):
        return
    concrete = jax.tree.map(np.asarray, system)
    if dt > 0 and _courant(concrete, dt, scheme) < 1:
        return
    unit = " s" if in_si(structures) else "/ω1"
    limit = stability_limit(system, scheme)
    rule = f"must be positive and below the stability limit {limit:.8g}{unit} of these "
    rule += f"structures, set by {stiffest_rod(concrete, limit, scheme, unit)[0]}"
    raise InvalidInput(f"{place} dt".lstrip(), f"{dt:.8g}{unit}", rule)


def require_local_flow(system: System, scheme: Scheme) -> None:
    """An ``InvalidInput`` for a scheme that cannot run the local flow of a system's links."""
    for k, link in enumerate(system.links if scheme.extrapolated else ()):
        if link.contact is not None:
            rule = "must have no contact: impacts leave no error that extrapolation could take out"
            raise InvalidInput(f"scheme: extrapolated = True: links.{k}", "", rule)
    if isinstance(scheme.friction, EventResolved) and scheme.start == "rest":
        return
    for group in groups(joints(system)):
        links = [system.links[face.link] for joint in group for face in joint.faces]
        fields = itertools.product(links, ("contact", "velocity_friction"))
        laws = [f"{x} = {type(law).__name__}" for link, x in fields if (law := getattr(link, x))]
        if len(group) > 1 or laws:
            reason = "links that share masses" if len(group) > 1 else laws[0]
            where = f"links.{group[0].link} with {reason}"
            value = f"{scheme.friction} with start {scheme.start!r}"
            rule = f'must be friction EventResolved() and start "rest" for {where}'
            raise InvalidInput("scheme: friction", value, rule)


def is_stable(system: System, dt: Any, scheme: Scheme) -> Any:
    """Whether explicit stepping is stable, traceable (see ``stability_limit``).

    M − (h²/4) K is then positive definite, which elimination shows. Not ``eigvalsh``: concurrent
    LAPACK calls, one for each building of a row, deadlock in XLA's CPU thread pool.
    """
    stable: Any = True
    for mass, stiffness in _scaled_matrices(system, _nyquist(system, dt, scheme), jnp):
        remaining = jax.lax.stop_gradient(mass - dt**2 / 4 * stiffness)  # needs no derivative
        while remaining.shape[-1]:
            pivot, column = remaining[0, 0], remaining[1:, 0]
            stable &= pivot > 0  # false for NaN
            divisor = jnp.where(pivot > 0, pivot, 1.0)
            remaining = remaining[1:, 1:] - jnp.outer(column, column) / divisor
    return stable


def _courant(system: System, dt: Any, scheme: Scheme) -> Any:
    """h² λ / 4 of a concrete system, below 1 where explicit stepping is stable."""
    return dt**2 / 4 * _largest_eigenvalue(system, _nyquist(system, dt, scheme))


_STIFFENED = 2.0  # times as stiff as at rest: a larger tau_f would allow longer steps


def stiffest_rod(system: System, limit: float, scheme: Scheme, unit: str) -> tuple[str, float]:
    """In words the rod with the largest stiffness at the limit over the masses at its ends.

    The number is by how many times a small τ_f makes it stiffer than at rest.
    """
    topology, stiffness = system.topology, _nyquist(system, limit, scheme)
    r = int(np.argmax([k * x for k, x in zip(stiffness, _mobilities(system), strict=True)]))
    part, law = _part(topology, r), zener_of(system.rods[r].material)
    times = float(stiffness[r] / system.rods[r].stiffness)
    if law is None or times < _STIFFENED:
        return part, 1.0
    order = float(law.order)
    tau = f"{float(law.tau_f):.4g}{f'{unit}^{order:.4g}' if unit == ' s' else ''}"
    tau = tau.removesuffix("^1")
    stiffer = f"{part}, which its small tau_f = {tau} makes {times:.3g} times as stiff as at rest: "
    return f"{stiffer}a larger one allows longer steps", times


def _mobilities(system: System) -> list[Any]:
    """The relative acceleration of each rod's ends under a unit force in it."""
    return [mobility(weighted(rod), system.masses) for rod in system.rods]


def _part(topology: Topology, rod: int) -> str:
    """A rod in words: a storey, or the damper of a link."""
    ends = topology.rods[rod]
    is_damper = ends in topology.links and not isinstance(ends, WeightedMasses)
    if rod in storey_rods(topology) or not is_damper:
        return rod_places(topology)[rod]
    return f"the damper of link {link_places(topology)[topology.links.index(ends)]}"


def _nyquist(system: System, dt: Any, scheme: Scheme) -> list[Any]:
    """The stiffness of each rod at the highest frequency that steps resolve."""
    return [
        nyquist_stiffness(before_yield(rod.material), _stiffness(rod), dt, scheme.order)
        for rod in system.rods
    ]


def _stiffness(rod: Rod) -> Any:
    """The stiffness of a rod; 0 of a dashpot."""
    return 0.0 if rod.stiffness is None else rod.stiffness


def _largest_eigenvalue(system: System, stiffness: list[Any]) -> Any:
    """The largest eigenvalue of M⁻¹ K of a concrete system, with a stiffness for each rod."""
    largest = []
    for mass, matrix in _scaled_matrices(system, stiffness, np):
        root = np.linalg.inv(np.linalg.cholesky(mass))
        largest.append(np.linalg.eigvalsh(root @ matrix @ np.swapaxes(root, -1, -2))[..., -1])
    return np.max(np.broadcast_arrays(*largest), axis=0)


def _scaled_matrices(system: System, stiffness: list[Any], xp: Any) -> list[tuple[Any, Any]]:
    """D^(−1/2) M D^(−1/2) and D^(−1/2) K D^(−1/2) of each group of masses that is coupled.

    D are the masses, and M these with the inertances.
    """
    topology, matrices = system.topology, []
    rods = list(zip(map(weighted, system.rods), stiffness, strict=True))
    links = [(link, link.inerter) for link in system.links if link.inerter]
    inerters = [(weighted(link), inerter.inertance) for link, inerter in links]
    joined = topology._replace(rods=(*topology.rods, *(link.ends for link, _ in links)))
    for masses in rod_groups(joined):
        stiff = _scaled(system, masses, rods, xp)
        inertia = _scaled(system, masses, inerters, xp)
        matrices.append((xp.eye(len(masses), dtype=stiff.dtype) + inertia, stiff))
    return matrices


def _scaled(
    system: System, masses: tuple[int, ...], parts: list[tuple[WeightedEnds, Any]], xp: Any
) -> Any:
    """D^(−1/2) S D^(−1/2) with the matrix S of parts between ends, each with its number."""
    own = [(ends, number) for ends, number in parts if {*dict(ends)} & {*masses}]
    if not own:
        return 0.0
    numbers = xp.stack(xp.broadcast_arrays(*[number for _, number in own]), -1)
    m = xp.stack(xp.broadcast_arrays(*[system.masses[i] for i in masses]), -1)
    unit_motions = np.eye(len(system.masses), dtype=numbers.dtype)[:, list(masses)]
    by_part = [along(beside_axis(ends), [*unit_motions]) for ends, _ in own]
    known = all(isinstance(y, np.ndarray) for y in by_part)  # weights of 1 and −1 are no operations
    lib = np if known else xp
    root = lib.stack(lib.broadcast_arrays(*by_part), -1) / xp.sqrt(m)[..., None]
    return (root * numbers[..., None, :]) @ xp.swapaxes(root, -1, -2)
