"""The time series of a run, by mass, rod and link, and its energy balance."""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxpound._errors import InvalidInput
from jaxpound._fields import Quantity, part, pytree_dataclass, quantity, static
from jaxpound._tables import Shown, TextTable
from jaxpound.model.ends import Element, along, beside_axis, load_on, moving_ends, weighted
from jaxpound.model.places import link_places, mass_places, rod_places
from jaxpound.model.topology import AnyEnds, Topology, footings, soil_spring
from jaxpound.quantities import column, unit
from jaxpound.results.demand import Demand
from jaxpound.results.elements import ByElement, Columnar, are_concrete, kind_in, run_numbers
from jaxpound.results.impacts import FrictionPhase, Impact, ImpactSeries, phases_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@pytree_dataclass
class MassResponse:
    """Series of a mass, each of shape (n_steps+1,)."""

    x: Any = quantity("length", column="x{}", smooth=True)
    """Displacement relative to the ground; where supports move apart, to support 0."""
    v: Any = quantity("velocity", column="v{}", smooth=True)
    """Velocity x'."""
    mass: Any = quantity("mass", column="mass_{}")
    """The mass itself, a number, in units of m1 (in SI, kg)."""
    influence: float = static(default=1.0)
    """The share ι of the ground's motion that it has, a number."""
    damping: Any = quantity("force", column="damping_{}", default=None, smooth=True)
    """Force on it, to the right, by the damping of its building and dashpots beside its storeys and
    tuned masses (``System.damping``); None without any."""
    load: Any = quantity("force", column="load_{}", default=None, smooth=True)
    """Load on it, to the right; None in a run without loads."""


@pytree_dataclass
class SupportResponse:
    """Series of a support, each of shape (n_steps+1,)."""

    displacement: Any = quantity("length", column="support_displacement_{}", smooth=True)
    """Its displacement relative to support 0, as those of the masses are."""
    velocity: Any = quantity("velocity", column="support_velocity_{}", smooth=True)
    """Its velocity relative to support 0."""
    acceleration: Any = quantity("acceleration", column="support_acceleration_{}")
    """Its absolute acceleration u''."""


@pytree_dataclass
class RodResponse:
    """Series of a rod, each of shape (n_steps+1,)."""

    force: Any = quantity("force", column="f{}", smooth=True)
    """Force f of the rod: positive where it is stretched and pulls mass i back."""
    ends: AnyEnds = static()
    """Masses i and j, or ``GROUND`` or a support; the rod is stretched by x_i − x_j. Or masses with
    weights."""
    dissipated: Any = quantity("energy", column="dissipated_{}", default=None)
    """Energy dissipated by yielding or a viscous damper until then; None for other rods."""
    weights: tuple[Any, ...] = ()
    """The weights of masses with weights, numbers; () between two ends."""


@pytree_dataclass
class LinkResponse:
    """Series of a link, each of shape (n_steps+1,)."""

    gap: Any = quantity("length", column="gap", smooth=True)
    """ξ = ξ0 − s with the closing s = x_i − x_j; pounding is ξ ≤ 0."""
    friction: Any = quantity("force", column="friction")
    """Force q of the damper: positive when it pulls mass i back (x_i' > x_j' in slip)."""
    slip_velocity: Any = quantity("velocity", column="slip_velocity", smooth=True)
    """w = s'."""
    phase: Any = quantity(None, column="phase")
    """Direction of slip half a step after each instant: 1, −1, or 0 in stick."""
    change_time: Any = quantity("time", column="change_time")
    """Where ``phase`` differs from the entry before: the instant of the change."""
    ends: AnyEnds = static()
    """Masses i and j, or ``GROUND`` or a support; or masses with weights, whose Σ weight × x closes
    the gap."""
    contact: Any = quantity("force", column="contact", default=None)
    """Contact force p at the instants. None, as all below, for a link without a law of contact."""
    touching: Any = quantity(None, column="touching", default=None)
    """1 where the neighbours are in contact at any time within half a step of the instant."""
    contact_stored: Any = quantity("energy", column="contact_stored", default=None)
    """Energy stored in contact."""
    contact_lost: Any = quantity("energy", column="contact_lost", default=None)
    """Energy lost by contact until then."""
    friction_work: Any = quantity("energy", column="friction_work", default=None)
    """Energy taken by the damper until then."""
    impacts: ImpactSeries | None = part(default=None)
    """The impacts one by one."""
    law: Any = part(default=None)
    """The law of contact, in the units of the series; None where it has no force, or, in SI, is
    user-defined."""
    slip_force: Any = quantity("force", default=0.0)
    """Slip force of the damper, a number, in fast slip; 0 where the link has none."""
    velocity_friction: Any = part(default=None)
    """What the friction gains with the velocity, a ``VelocityFriction`` in the units of the series;
    None for a link without it."""
    inertia: Any = quantity("force", column="inertia", default=None)
    """Force of the inerter, positive as the friction is. None for a link without one."""
    inertance: Any = quantity("mass", default=None)
    """Inertance, a number."""
    weights: tuple[Any, ...] = ()
    """The weights of masses with weights, numbers; () between two ends."""

    @property
    def has_damper(self) -> bool:
        """Whether the slip force is not 0, in any run of a batch."""
        return bool(np.any(self.slip_force > 0))


@pytree_dataclass
class Response(ByElement, Columnar, Shown):
    """Time series of a run, each of shape (n_steps+1,).

    Dimensionless as in eq. (9): time 1/ω1, length g/ω1², force m1 g, acceleration g;
    ``Scales.to_si`` gives the same object in s, m, N and m/s². A batch has a leading axis.

    Series of a mass, rod or link are in ``masses[i]``, ``rods[r]`` and ``links[k]``; each has a
    flat name as well, numbered from 1: ``x1``, ``v1``, ``f1`` and ``mass_1``, and for a single link
    ``gap``, ``friction``, ``slip_velocity``, ``phase`` and ``change_time`` (for several ``gap_1``
    and so on). As a table (``to_pandas``, ``to_csv``, ``to_parquet``) it has a row for each
    instant, for a batch of each run; ``to_xarray`` has the masses, rods and links as dimensions.

    Examples
    --------
    >>> scales = jp.Scales(mass=500e3, frequency=7.0)
    >>> response = jp.simulate(jp.paper.structures(), jp.paper.ground(), jp.paper.grid())
    >>> table = scales.to_si(response).to_pandas()
    >>> table.index.name, *table.columns[:4]
    ('time_s', 'ground_acceleration_m_per_s2', 'x1_m', 'x2_m', 'v1_m_per_s')
    >>> bool((response.x2 == response.masses[1].x).all())
    True
    """

    _elements: ClassVar = {
        "masses": MassResponse,
        "rods": RodResponse,
        "links": LinkResponse,
        "supports": SupportResponse,
    }

    time: Any = quantity("time")
    """Instants t of the grid."""
    ground_acceleration: Any = quantity("acceleration")
    """Ground acceleration u''."""
    ground_velocity: Any = quantity("velocity")
    """Ground velocity u'."""
    masses: tuple[MassResponse, ...] = part()
    """Series of each mass."""
    rods: tuple[RodResponse, ...] = part()
    """Series of each rod."""
    links: tuple[LinkResponse, ...] = part()
    """Series of each link."""
    demand: Demand = part()
    """The scalars of the run."""
    supports: tuple[SupportResponse, ...] = part(default=())
    """Series of each support by its number; () where all structures stand on one ground."""
    method: str = static(default="")
    """The scheme in words."""
    si: bool = static(default=False)
    """Whether the numbers are SI."""

    @property
    def min_gap(self) -> Any:
        """Smallest gap of the run, also between instants of the grid."""
        return self.demand.min_gap

    @property
    def batch(self) -> tuple[int, ...]:
        """Shape of the batch; () for a single run."""
        return self.demand.batch

    @property
    def topology(self) -> Topology:
        """Number of masses, and the ends of rods and links."""
        rods = tuple(rod.ends for rod in self.rods)
        tuned = self.demand.topology.tuned if self.demand.topology else ()
        return Topology(len(self.masses), rods, tuple(link.ends for link in self.links), tuned)

    @property
    def absolute_accelerations(self) -> tuple[Any, ...]:
        """Absolute acceleration x'' + ι u'' of each mass, in g (m/s² in SI): force over mass."""
        return self.accelerations(*self._forces_in_elements)

    def accelerations(self, elements: Sequence[Element], forces: Sequence[Any]) -> tuple[Any, ...]:
        """Acceleration of each mass by forces in elements, by damping and by its load."""
        ends = [beside_axis(weighted(element)) for element in elements]
        return tuple(
            _total(
                [
                    load_on(i, ends, forces),
                    *(x for x in (mass.damping, mass.load) if x is not None),
                ]
            )
            / jnp.asarray(mass.mass)[..., None]
            for i, mass in enumerate(self.masses)
        )

    @property
    def closings(self) -> tuple[Any, ...]:
        """Closing s of each link: its gap is that at rest less s."""
        x = self.displacements
        return tuple(along(beside_axis(moving_ends(link)), x) for link in self.links)

    @property
    def elongations(self) -> tuple[Any, ...]:
        """Elongation of each rod; ``rods[r].force`` over it are the rod's loops of hysteresis."""
        x = self.displacements
        return tuple(along(beside_axis(moving_ends(rod)), x) for rod in self.rods)

    @property
    def displacements(self) -> list[Any]:
        """Displacements of the masses, and behind them of supports from the last to support 1."""
        supports = self.supports[:0:-1]
        return [*(mass.x for mass in self.masses), *(y.displacement for y in supports)]

    @property
    def _forces_in_elements(self) -> tuple[tuple[Element, ...], list[Any]]:
        """Rods and links, and the forces in them."""
        forces = [rod.force for rod in self.rods]
        for link in self.links:
            more = (force for force in (link.contact, link.inertia) if force is not None)
            forces.append(sum(more, link.friction))
        return (*self.rods, *self.links), forces

    @property
    def energy(self) -> Energy:
        """Energy balance over time."""
        return _energy_balance(self)

    def impacts(self, link: int | None = None) -> list[Impact]:
        """Impacts of one link or, in order of time, of all; empty without a law of contact.

        A response keeps the first 256 of each link, at most 4 of those that end within one step;
        ``n_impacts`` of its ``demand`` counts all. Errors are those of ``phases``.
        """
        numbers = range(len(self.links)) if link is None else [link]
        self._require_links(numbers)
        places, impacts = link_places(self.topology), list[Impact]()
        for k in numbers:
            if (series := self.links[k].impacts) is not None:
                impacts += series.entries(k, places[k])
        return sorted(impacts, key=lambda impact: impact.time)

    def first_contact(self, link: int = 0) -> float:
        """When a link's gap first closes; NaN if it never does.

        That of the first impact, or by linear interpolation between the instants. Errors are those
        of ``phases``.
        """
        self._require_links([link])
        demand = self.demand.links[link]
        if not float(demand.min_gap) <= 0:
            return math.nan
        if impacts := self.impacts(link):
            return impacts[0].time
        time, gap = np.asarray(self.time), np.asarray(self.links[link].gap)
        if not (closed := np.flatnonzero(gap <= 0)).size:  # it opens again before the next instant
            return float(demand.min_gap_time)
        around = [closed[0], max(closed[0] - 1, 0)]
        return float(np.interp(0.0, gap[around], time[around]))

    def phases(self, link: int = 0) -> list[FrictionPhase]:
        """Intervals of stick and slip of a link in order, with ends resolved within the steps.

        A ``ValueError`` for a batch, an invalid run, and a link that does not exist.
        """
        self._require_links([link])
        return phases_of(self.links[link], self.time)

    def _require_links(self, links: Iterable[int]) -> None:
        """An ``InvalidInput`` for a batch, a link that does not exist, and an invalid run."""
        require_single(self)
        for link in links:
            if link not in range(len(self.links)):
                rule = f"must be the number of one of the {len(self.links)} links, from 0"
                raise InvalidInput("link", repr(link), rule)
            if not np.isfinite(self.links[link].phase).all():
                raise InvalidInput("the run", "", "is invalid (its results are NaN)")

    def plot(self) -> Figure:
        """Ground motion, displacements, friction force and gap over time (``plots.overview``).

        For a batch, all runs over each other; a ``ValueError`` for an invalid run.
        """
        from jaxpound.plots import overview  # upwards: drawn by the layer that imports Matplotlib

        return overview(self)

    def _by_field(self) -> dict[str, tuple[str, Quantity, list[Any]]]:
        series = super()._by_field()
        del series["mass"]  # a number
        accelerations = "masses", Quantity("acceleration"), [*self.absolute_accelerations]
        return series | {"absolute_acceleration": accelerations}

    def _series(self) -> dict[str, tuple[str | None, Any]]:
        """Kind and values of every series by flat name, in the order of tables; first time."""

        def of_elements(*fields: str) -> dict[str, tuple[str | None, Any]]:
            flat = {name: y for field in fields for name, y in self.flat(field).items()}
            return {name: (kind_in(Response, name), y) for name, y in flat.items() if y is not None}

        accelerations = enumerate(self.absolute_accelerations, 1)
        directions = self.flat("phase").items()
        return {
            "time": ("time", self.time),
            "ground_acceleration": ("acceleration", self.ground_acceleration),
            **of_elements("x", "v"),
            **{f"absolute_acceleration_{i}": ("acceleration", a) for i, a in accelerations},
            **of_elements("force", "friction", "contact", "inertia", "gap"),
            "ground_velocity": ("velocity", self.ground_velocity),
            # Plus zero: no −0 in a file.
            **{name.replace("phase", "slip_direction"): (None, y + 0.0) for name, y in directions},
            **of_elements("contact_stored", "contact_lost", "friction_work", "touching"),
            **of_elements("dissipated", "damping", "load"),
            **of_elements("displacement", "velocity", "acceleration"),
        }

    def _index_and_columns(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        batch, n = self.batch, jnp.shape(self.time)[-1]
        series = {
            column(name, kind, self.si): np.broadcast_to(values, (*batch, n)).ravel()
            for name, (kind, values) in self._series().items()
        }
        runs, time = run_numbers(batch, n) if batch else {}, next(iter(series))
        return runs | {time: series.pop(time)}, series

    def _tables(self) -> list[TextTable]:
        has_rows = are_concrete(self) and not self.batch and jnp.isfinite(self.demand.pga)
        title = f"Response of {self.method}" if self.method else "Response"
        return [self.demand._table(title, self._rows() if has_rows else [])]

    def _rows(self) -> list[tuple[str, str]]:
        """Summary of a single run: names and values."""
        kinds = ("length", "time", "acceleration", "force", "energy", "impulse")
        length, second, acceleration, force, energy, impulse = (unit(x, self.si) for x in kinds)
        d, time = self.demand, np.asarray(self.time)
        steps = f"{time.size - 1} steps of {time[1] - time[0]:.6g} {second}"
        rows = [("time", f"{steps}, until {time[-1]:.6g} {second}")]
        if d.links:
            closest = f"{d.min_gap:.6g} {length} at {d.min_gap_time:.6g} {second}"
            rows.append(("min gap", closest + ("   POUNDS" if d.pounds else "") + d.checked_floors))
        rotations = [*footings(self.topology).values()]  # with other units than the floors
        masses, rods = mass_places(self.topology), rod_places(self.topology)
        rocking = [soil_spring(self.topology, mass) for mass in rotations]
        peaks = d.flat("peak_acceleration"), d.flat("peak_x"), d.flat("peak_force")
        accelerations = _largest("a", peaks[0], acceleration, masses, rotations)
        rows += [
            ("displacement", _largest("x", peaks[1], length, masses, rotations)),
            ("acceleration", f"{accelerations}; of the ground {d.pga:.4g} {acceleration}"),
            ("rod force", _largest("f", peaks[2], force, rods, rocking)),
        ]
        for k, (link, place) in enumerate(zip(d.links, link_places(self.topology), strict=True)):
            where = f" {place}" if len(d.links) > 1 else ""
            if self.links[k].has_damper:
                damper = f"{len(self.phases(k))} phases, slid {link.slip_distance:.4g} {length}, "
                damper += f"took {link.friction_work:.4g} {energy}, "
                damper += f"offset left {link.residual_offset:.4g} {length}"
                rows.append((f"damper{where}", damper))
            if link.n_impacts is not None:
                contact = f"{link.n_impacts:.0f} impact{'s' if link.n_impacts != 1 else ''}, "
                contact += f"p ≤ {link.peak_contact:.4g} {force}, "
                contact += f"impulse ≤ {link.peak_impulse:.4g} {impulse}, "
                contact += f"lost {link.contact_work:.4g} {energy}"
                rows.append((f"contact{where}", contact))
        return rows


def _largest(
    letter: str,
    by_name: dict[str, Any],
    of_unit: str,
    places: tuple[str, ...],
    left_out: Sequence[int],
) -> str:
    """Peaks of a pair one by one; of more elements only the largest, and where it is."""
    numbered = [(i, x) for i, x in enumerate(by_name.values()) if i not in left_out]
    if len(numbered) <= 2:
        both = ", ".join(f"|{letter}{i + 1}| ≤ {peak:.4g}" for i, peak in numbered)
        return f"{both} {of_unit}"
    i, peak = numbered[int(np.argmax([x for _, x in numbered]))]
    return f"largest {peak:.4g} {of_unit}, {places[i]}"


def require_single(response: Response) -> None:
    """An ``InvalidInput`` for a batch."""
    if jnp.ndim(response.time) != 1:
        rule = f"of shape {jnp.shape(response.time)} must be indexed to one response"
        raise InvalidInput("a batch", "", rule)


class Energy(NamedTuple):
    """Terms of the energy balance over time (relative motion), shape (n_steps+1,) each.

    In (m1 g)(g/ω1²), or J in SI. The terms are cumulative trapezoidal integrals of the powers at
    the grid's instants (for the input, of the momentum over the ground velocity u'), not the
    scheme's telescoping sums: so ``residual`` measures how well motion, forces and quadrature agree
    (not the rods' law). Of links with a law of contact the terms are those of the motion within the
    steps; in a step with contact, where velocities may jump, work into the rods is integrated over
    their elongation, and that of the ground over what the masses move.
    """

    input: Any
    """Work of the ground, −∫ u'' Σ m x' dt, of loads p, Σ ∫ p x' dt, and of supports that move
    relative to support 0, by the forces of rods and links."""
    kinetic: Any
    """Kinetic energy Σ ½ m x'², and ½ b w² of inerters."""
    rods: Any
    """Work into the rods, Σ ∫ f e' dt with the elongations e, besides their energy at t = 0."""
    friction: Any
    """Work into the links' dampers, Σ ∫ q w dt with the slip velocities w."""
    residual: Any
    """rods + damping + friction + kinetic + stored and lost in contact − input − initial."""
    contact_stored: Any = 0.0
    """Energy stored in contact, Σ ∫ p_s w dt with the part p_s of a law's force at speed 0."""
    contact_lost: Any = 0.0
    """Energy lost by contact, Σ ∫ (p − p_s) w dt, and by impacts."""
    initial: Any = 0.0
    """Energy at t = 0, of shape (): kinetic, and Σ ½ f e of rods that start displaced."""
    yielding: Any = 0.0
    """Energy dissipated by rods that yield and by viscous dampers, a part of ``rods``."""
    damping: Any = 0.0
    """Work into the damping of the buildings, and dashpots beside storeys (``System.damping``);
    where supports move apart, less what these put into it."""

    @property
    def relative_residual(self) -> Any:
        """Largest ``residual`` as a share of the largest energy put in; 0 for a run at rest."""
        supplied = jnp.abs(self.input + jnp.asarray(self.initial)[..., None]).max(-1)
        share = jnp.abs(self.residual).max(-1) / jnp.where(supplied > 0, supplied, 1.0)
        return jnp.where(supplied > 0, share, 0.0)


@jax.jit  # one program in the place of some sixty small ones
def _energy_balance(response: Response) -> Energy:
    x, v = [mass.x for mass in response.masses], [mass.v for mass in response.masses]
    masses = [jnp.asarray(mass.mass)[..., None] for mass in response.masses]
    driven = [m * mass.influence for m, mass in zip(masses, response.masses, strict=True)]
    momentum = _means(_total(map(operator.mul, driven, v)))
    inerters = [link for link in response.links if link.inertia is not None]
    inertias = [*masses, *(jnp.asarray(link.inertance)[..., None] for link in inerters)]
    speeds = [*v, *(link.slip_velocity for link in inerters)]
    kinetic = _total(m * speed**2 for m, speed in zip(inertias, speeds, strict=True)) / 2
    steps, elongations = jnp.diff(response.time, axis=-1), response.elongations
    met = None
    if touching := [link.touching for link in response.links if link.touching is not None]:
        met = _total(touching) > 0
        met = met[..., 1:] | met[..., :-1]
        moved = jnp.diff(_total(map(operator.mul, driven, x)))
        momentum = jnp.where(met, moved / steps, momentum)  # which the ground's blows change

    def work(forces: Sequence[Any], paths: Iterable[Any], rates: Iterable[Any]) -> Any:
        works = steps * _means(_total(map(operator.mul, forces, rates)))
        if met is not None:
            pairs = zip(forces, paths, strict=True)
            of_motion = _total(_means(force) * jnp.diff(path) for force, path in pairs)
            works = jnp.where(met, of_motion, works)
        return _summed(works)

    supports = response.supports[:0:-1]
    rates = [*v, *(support.velocity for support in supports)]
    speeds = [along(beside_axis(moving_ends(rod)), rates) for rod in response.rods]
    rods = work([rod.force for rod in response.rods], elongations, speeds)
    against = [-mass.damping for mass in response.masses if mass.damping is not None]
    damping = work(against, x, v) if against else 0 * rods
    loads = [mass.load for mass in response.masses if mass.load is not None]
    friction = stored = lost = 0 * rods
    for link in response.links:
        if (taken := link.friction_work) is None:
            taken = _summed(steps * _means(link.friction * link.slip_velocity))
        friction = friction + taken
        if link.contact is not None:
            stored, lost = stored + link.contact_stored, lost + link.contact_lost
    # Integrated over u', which includes what u'' does between the instants.
    supplied = _summed(-jnp.diff(response.ground_velocity, axis=-1) * momentum)
    if loads:
        supplied = supplied + work(loads, x, v)
    if supports:
        paths = [response.displacements[len(x) :], rates[len(x) :]]
        supplied = supplied + work(_holding(response), *paths) + _work_of_blows(response)
    pairs = zip(response.rods, elongations, strict=True)
    at_start = _total(rod.force[..., 0] * y[..., 0] for rod, y in pairs) / 2
    rods, initial = rods + at_start[..., None], kinetic[..., 0] + at_start
    taken = rods + damping + friction + stored + lost
    residual = taken + kinetic - supplied - initial[..., None]
    yielding = sum((r.dissipated for r in response.rods if r.dissipated is not None), 0.0)
    terms = stored, lost, initial, yielding, damping
    return Energy(supplied, kinetic, rods, friction, residual, *terms)


def _holding(response: Response) -> list[Any]:
    """Forces of supports on rods and links, from the last support to support 1."""
    elements, forces = response._forces_in_elements
    ends = [beside_axis(moving_ends(element)) for element in elements]
    return [-load_on(-k, ends, forces) for k in range(len(response.supports) - 1, 0, -1)]


def _work_of_blows(response: Response) -> Any:
    """Work until each instant of supports by impacts without duration, of ``Newton``'s law."""
    time, work = jnp.asarray(response.time), 0 * jnp.asarray(response.time)
    for link in response.links:
        support, weight = moving_ends(link)[0]
        if link.impacts is None or support >= 0:
            continue
        speed, touch = response.supports[-support].velocity, link.impacts.time
        past = time[..., None, :] >= touch[..., :, None]
        after = jnp.clip(time.shape[-1] - past.sum(-1), 1, time.shape[-1] - 1)
        ends = [jnp.take_along_axis(y, k, -1) for k in (after - 1, after) for y in (time, speed)]
        t_0, v_0, t_1, v_1 = ends
        then = v_0 + (v_1 - v_0) * (touch - t_0) / (t_1 - t_0)
        blows = jnp.isposinf(link.impacts.peak_force) & jnp.isfinite(touch)
        works = jnp.where(blows, weight * link.impacts.impulse * then, 0.0)
        work = work + jnp.where(past, works[..., None], 0.0).sum(-2)
    return work


def _means(series: Any) -> Any:
    """Means over the steps between the instants, by the trapezoidal rule."""
    return (series[..., 1:] + series[..., :-1]) / 2


def _total(terms: Iterable[Any]) -> Any:
    """Sum of one term or more, without adding them to zero."""
    return functools.reduce(operator.add, terms)


def _summed(steps: jax.Array) -> Float[Array, "... time"]:
    """Cumulative sums at the instants, from values of the steps between them."""
    return jnp.concatenate([0 * steps[..., :1], jnp.cumsum(steps, axis=-1)], -1)
