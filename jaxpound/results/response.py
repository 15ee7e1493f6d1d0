"""The time series of a run, by mass, rod and link, and what follows from them."""

from __future__ import annotations

import functools
import itertools
import operator
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxpound import _root
from jaxpound._fields import part, pytree_dataclass, quantity, static
from jaxpound._tables import Shown, Table
from jaxpound.model.places import link_places
from jaxpound.model.system import Ends, Topology, elongation, load_on
from jaxpound.quantities import column, unit
from jaxpound.results.columns import Columnar
from jaxpound.results.demand import Demand
from jaxpound.results.elements import ByElement, are_known, chosen, run_numbers
from jaxpound.results.impacts import Impact, ImpactSeries

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Phase(NamedTuple):
    """An interval of 'stick', 'slip right' (x1' > x2') or 'slip left', and its ends."""

    kind: str
    """'stick', 'slip right' or 'slip left'."""
    start: float
    """When it begins."""
    end: float
    """When it ends."""
    contact: bool = False
    """Whether the neighbours are in contact, or at rest in touch by Newton's law; to half a step
    where they are after the impacts that ``impacts`` lists, or were from the start."""


class Energy(NamedTuple):
    """Terms of the energy balance over time (relative motion), each by its own quadrature.

    The terms are cumulative trapezoidal integrals of the powers at the grid's instants (for the
    input, of the momentum over the ground velocity u'), not the scheme's telescoping sums, so that
    ``residual`` is not zero by construction: it measures how well motion, forces and quadrature
    agree (not the rods' law). Of links with a law of contact the terms are those of the motion
    within the steps; in a step with contact, where velocities may jump, work into the rods is
    integrated over their elongation. Shape (n_steps+1,) each; unit
    (m1 g)(g/ω1²), or J in SI.
    """

    input: Any
    """Work of the ground, −∫ u'' Σ m x' dt."""
    kinetic: Any
    """Kinetic energy Σ ½ m x'²."""
    rods: Any
    """Work into the rods, Σ ∫ f e' dt with the elongations e, beside what is in them at t = 0."""
    friction: Any
    """Work into the links' dampers, Σ ∫ q w dt with the slip velocities w."""
    residual: Any
    """rods + friction + kinetic + stored and lost in contact − input − initial."""
    contact_stored: Any = 0.0
    """Energy stored in contact, Σ ∫ p_s w dt with the part p_s of a law's force at speed 0."""
    contact_lost: Any = 0.0
    """Energy lost by contact, Σ ∫ (p − p_s) w dt, and by impacts."""
    initial: Any = 0.0
    """Energy at t = 0, of shape (): kinetic, and Σ ½ f e of rods that start displaced."""

    @property
    def relative_residual(self) -> Any:
        """Largest ``residual`` as a share of the largest energy put in; 0 for a run at rest."""
        supplied = jnp.abs(self.input + jnp.asarray(self.initial)[..., None]).max(-1)
        share = jnp.abs(self.residual).max(-1) / jnp.where(supplied > 0, supplied, 1.0)
        return jnp.where(supplied > 0, share, 0.0)


@pytree_dataclass
class MassResponse:
    """Series of a mass, each of shape (n_steps+1,)."""

    x: Any = quantity("length", column="x{}")
    """Displacement relative to the ground."""
    v: Any = quantity("velocity", column="v{}")
    """Velocity x'."""
    mass: Any = quantity("mass", column="mass_{}")
    """The mass itself, a number, in units of m1 (in SI, kg)."""


@pytree_dataclass
class RodResponse:
    """Series of a rod, each of shape (n_steps+1,)."""

    force: Any = quantity("force", column="f{}")
    """Force f of the rod: positive where it is stretched and pulls mass i back."""
    ends: Ends = static()
    """Masses i and j, or ``GROUND``; the rod is stretched by x_i − x_j."""


@pytree_dataclass
class LinkResponse:
    """Series of a link, each of shape (n_steps+1,)."""

    gap: Any = quantity("length", column="gap")
    """ξ = ξ0 − (x_i − x_j); pounding is ξ ≤ 0."""
    friction: Any = quantity("force", column="friction")
    """Force q of the damper: positive when it pulls mass i back (x_i' > x_j' in slip)."""
    slip_velocity: Any = quantity("velocity", column="slip_velocity")
    """w = x_i' − x_j'."""
    phase: Any = quantity(None, column="phase")
    """Direction of slip half a step after each instant: 1, −1, or 0 in stick."""
    change_time: Any = quantity("time", column="change_time")
    """Where ``phase`` differs from the entry before: the instant of the change."""
    ends: Ends = static()
    """Masses i and j, or ``GROUND``."""
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
    of one's own."""

    @property
    def has_damper(self) -> bool:
        """Whether the slip force is not 0: a free link moves without any friction force."""
        return bool(np.any(self.friction != 0) or not np.any(self.slip_velocity != 0))

    def phases(self, time: Any) -> list[Phase]:
        """Intervals of stick and slip in order, of a single valid run with these instants."""
        time, phase = np.asarray(time), np.asarray(self.phase)
        changes = np.flatnonzero(np.diff(phase)) + 1
        instants = np.clip(np.asarray(self.change_time)[changes], time[0], time[-1])
        kinds = {0: "stick", 1: "slip right", -1: "slip left"}
        bounds = [float(time[0]), *instants.tolist(), float(time[-1])]
        directions = [int(phase[0]), *phase[changes].tolist()]
        phases = [
            Phase(kinds[direction], start, end)
            for direction, start, end in zip(directions, bounds[:-1], bounds[1:], strict=True)
        ]
        contacts = self._contacts(time)
        return [part for phase in phases for part in _split(phase, contacts)]

    def _contacts(self, time: np.ndarray) -> list[tuple[float, float]]:
        """Beginnings and ends of contact: of impacts exactly, of all else to half a step."""
        if self.impacts is None:
            return []
        last = float(time[-1])
        entries = self.impacts.entries(0)
        contacts = [(one.time, last if np.isnan(one.end) else one.end) for one in entries]
        ends = np.clip(time[:, None] + np.array([-0.5, 0.5]) * (time[1] - time[0]), time[0], last)
        known = np.zeros(time.shape, bool)
        for begin, end in contacts:
            known |= (begin <= ends[:, 1]) & (end >= ends[:, 0])
        other = np.pad((np.asarray(self.touching) > 0) & ~known, 1).astype(int)
        first, after = np.flatnonzero(np.diff(other) == 1), np.flatnonzero(np.diff(other) == -1)
        runs = zip(ends[first, 0].tolist(), ends[after - 1, 1].tolist(), strict=True)
        return [*contacts, *runs]


def _split(phase: Phase, contacts: list[tuple[float, float]]) -> list[Phase]:
    """A phase cut where contact begins and ends."""
    cuts = {t for contact in contacts for t in contact if phase.start < t < phase.end}
    parts: list[Phase] = []
    for start, end in itertools.pairwise([phase.start, *sorted(cuts), phase.end]):
        touching = any(a <= (start + end) / 2 < b for a, b in contacts)
        if parts and parts[-1].contact == touching:
            parts[-1] = parts[-1]._replace(end=end)
        else:
            parts.append(Phase(phase.kind, start, end, touching))
    return parts


@pytree_dataclass
class Response(ByElement, Columnar, Shown):
    """Time series of a run, each of shape (n_steps+1,), and what follows from them.

    Dimensionless as in eq. (9): time 1/ω1, length g/ω1², force m1 g, acceleration g;
    ``Scales.to_si`` gives the same object in s, m, N and m/s². A batch has a leading axis.

    Series of a mass, rod or link are in ``masses[i]``, ``rods[r]`` and ``links[k]``; each has a
    flat name as well, numbered from 1: ``x1``, ``v1``, ``f1`` and ``mass_1``, and for a single link
    ``gap``, ``friction``, ``slip_velocity``, ``phase`` and ``change_time`` (for several ``gap_1``
    and so on). As a table (``to_pandas``, ``to_csv``, ``to_parquet``) it has a row for each
    instant, and for a batch, where runs are numbered, for each instant of each run.

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

    _elements: ClassVar[dict[str, type]] = {
        "masses": MassResponse,
        "rods": RodResponse,
        "links": LinkResponse,
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
        rods, links = (tuple(one.ends for one in each) for each in (self.rods, self.links))
        return Topology(len(self.masses), rods, links)

    @property
    def absolute_accelerations(self) -> tuple[Any, ...]:
        """Absolute acceleration x'' + u'' of each mass, in g (m/s² in SI): force over mass."""
        ends = [*(rod.ends for rod in self.rods), *(link.ends for link in self.links)]
        between = [
            link.friction if link.contact is None else link.friction + link.contact
            for link in self.links
        ]
        forces = [*(rod.force for rod in self.rods), *between]
        return tuple(
            load_on(ends, i, forces) / jnp.asarray(mass.mass)[..., None]
            for i, mass in enumerate(self.masses)
        )

    @property
    def energy(self) -> Energy:
        """Energy balance over time."""
        masses = [jnp.asarray(m.mass)[..., None] for m in self.masses]
        v = [one.v for one in self.masses]
        momentum = _total(m * one.v for m, one in zip(masses, self.masses, strict=True))
        kinetic = _total(m * one.v**2 for m, one in zip(masses, self.masses, strict=True)) / 2
        x = [one.x for one in self.masses]
        rods = self._integral(_total(rod.force * elongation(rod.ends, v) for rod in self.rods))
        touching = [link.touching for link in self.links if link.touching is not None]
        if touching:
            powers = self._steps(_total(r.force * elongation(r.ends, v) for r in self.rods))
            works = _total(
                (r.force[..., 1:] + r.force[..., :-1]) / 2 * jnp.diff(elongation(r.ends, x))
                for r in self.rods
            )
            met = _total(touching) > 0
            rods = _summed(jnp.where(met[..., 1:] | met[..., :-1], works, powers))
        friction = 0 * rods
        for link in self.links:
            work = link.friction_work
            if work is None:
                work = self._integral(link.friction * link.slip_velocity)
            friction = friction + work
        stored = sum((n.contact_stored for n in self.links if n.contact is not None), 0 * rods)
        lost = sum((n.contact_lost for n in self.links if n.contact is not None), 0 * rods)
        # Integrated over u', which includes what u'' does between the instants.
        between = (momentum[..., 1:] + momentum[..., :-1]) / 2
        supplied = _summed(-jnp.diff(self.ground_velocity, axis=-1) * between)
        at_start = _total(r.force[..., 0] * elongation(r.ends, x)[..., 0] for r in self.rods) / 2
        rods, initial = rods + at_start[..., None], kinetic[..., 0] + at_start
        residual = rods + friction + kinetic + stored + lost - supplied - initial[..., None]
        return Energy(supplied, kinetic, rods, friction, residual, stored, lost, initial)

    def impacts(self, link: int | None = None) -> list[Impact]:
        """Impacts of one link or, in order of time, of all; empty without a law of contact.

        A response keeps the first 256 of each link, of those that end within the same step the
        first 4; ``n_impacts`` of its ``demand`` counts all.

        Raises
        ------
        ValueError
            As ``phases``.
        """
        self._require_links("impacts", range(len(self.links)) if link is None else [link])
        numbers = range(len(self.links)) if link is None else [link]
        places = link_places(self.topology)
        found = [
            impact
            for k in numbers
            if (series := self.links[k].impacts) is not None
            for impact in series.entries(k, places[k])
        ]
        return sorted(found, key=lambda impact: impact.time)

    def phases(self, link: int = 0) -> list[Phase]:
        """Intervals of stick and slip of a link in order, with ends resolved within the steps.

        Raises
        ------
        ValueError
            For a batch (take one response of it first), for an invalid run, and for a link that
            does not exist.
        """
        self._require_links("phases", [link])
        return self.links[link].phases(self.time)

    def _require_links(self, name: str, links: Iterable[int]) -> None:
        """A ``ValueError`` for a batch, a link that does not exist, and an invalid run."""
        require_single(name, self)
        for link in links:
            if link not in range(len(self.links)):
                rule = f"the number of one of the {len(self.links)} links, from 0"
                raise ValueError(f"{name}: link = {link!r} must be {rule}")
            if not np.isfinite(self.links[link].phase).all():
                raise ValueError(f"{name}: the run is invalid (its results are NaN)")

    def __getitem__(self, index: Any) -> Response:
        """Runs of a batch by number, slice or mask, as in an array: ``batch[3]`` is one run."""
        return chosen(self, index, self.batch)

    def _integral(self, power: Any) -> Float[Array, "... time"]:
        return _summed(self._steps(power))

    def _steps(self, power: Any) -> Any:
        """Trapezoidal integrals over the steps between the instants."""
        return jnp.diff(self.time, axis=-1) * (power[..., 1:] + power[..., :-1]) / 2

    def plot(self) -> Figure:
        """Ground motion, displacements, friction force and gap over time (``plots.overview``).

        For a batch, all runs over each other.

        Raises
        ------
        ValueError
            If a run is invalid.
        """
        return _root.overview(self)

    def _series(self) -> dict[str, tuple[str | None, Any]]:
        """Kind and values of every series by flat name, in the order of tables."""
        own = {
            f"absolute_acceleration_{i + 1}": ("acceleration", a)
            for i, a in enumerate(self.absolute_accelerations)
        }
        found: dict[str, tuple[str | None, Any]] = {
            "time": ("time", self.time),
            "ground_acceleration": ("acceleration", self.ground_acceleration),
        }
        for field, kind in (("x", "length"), ("v", "velocity")):
            found |= {name: (kind, y) for name, y in self.flat(field).items()}
        found |= own
        of_links = (("friction", "force"), ("contact", "force"), ("gap", "length"))
        for field, kind in (("force", "force"), *of_links):
            series = self.flat(field).items()
            found |= {name: (kind, y) for name, y in series if y is not None}
        found["ground_velocity"] = ("velocity", self.ground_velocity)
        for name, phase in self.flat("phase").items():  # no −0 in a file
            found[name.replace("phase", "slip_direction")] = (None, phase + 0.0)
        for field in ("contact_stored", "contact_lost", "friction_work", "touching"):
            energy = None if field == "touching" else "energy"
            series = self.flat(field).items()
            found |= {name: (energy, y) for name, y in series if y is not None}
        return found

    def _index_and_columns(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        batch, n = self.batch, jnp.shape(self.time)[-1]
        series = {
            column(name, kind, self.si): np.broadcast_to(values, (*batch, n)).ravel()
            for name, (kind, values) in self._series().items()
        }
        runs = run_numbers(batch, n) if batch else {}
        time = column("time", "time", self.si)
        return runs | {time: series.pop(time)}, series

    def _tables(self) -> list[Table]:
        known = are_known(self) and not self.batch and jnp.isfinite(self.demand.pga)
        title = f"Response of {self.method}" if self.method else "Response"
        return [self.demand._table(title, self._rows() if known else [])]

    def _rows(self) -> list[tuple[str, str]]:
        """Summary of a single run: names and values."""
        length, second, acceleration, force, energy = (
            unit(quantity, self.si)
            for quantity in ("length", "time", "acceleration", "force", "energy")
        )
        d, time = self.demand, np.asarray(self.time)
        peaks = {field: list(d.flat(field).values()) for field in ("peak_x", "peak_force")}
        accelerations = list(d.flat("peak_acceleration").values())
        closest = f"{d.min_gap:.6g} {length} at {d.min_gap_time:.6g} {second}"
        rows = [
            (
                "time",
                f"{time.size - 1} steps of {time[1] - time[0]:.6g} {second}, "
                f"until {time[-1]:.6g} {second}",
            ),
            ("min gap", closest + ("   POUNDS" if d.pounds else "")),
            ("displacement", f"{_largest('x', peaks['peak_x'])} {length}"),
            (
                "acceleration",
                f"{_largest('a', accelerations)} {acceleration}; "
                f"of the ground {d.pga:.4g} {acceleration}",
            ),
            ("rod force", f"{_largest('f', peaks['peak_force'])} {force}"),
        ]
        several = len(d.links) > 1
        for k, (link, place) in enumerate(zip(d.links, link_places(self.topology), strict=True)):
            where = f" {place}" if several else ""
            if self.links[k].has_damper:
                rows.append(
                    (
                        f"damper{where}",
                        f"{len(self.phases(k))} phases, slid {link.slip_distance:.4g} {length}, "
                        f"took {link.friction_work:.4g} {energy}, "
                        f"offset left {link.residual_offset:.4g} {length}",
                    )
                )
            if link.n_impacts is not None:
                impulse = unit("impulse", self.si)
                n = f"{link.n_impacts:.0f} impact{'s' if link.n_impacts != 1 else ''}"
                rows.append(
                    (
                        f"contact{where}",
                        f"{n}, p ≤ {link.peak_contact:.4g} {force}, "
                        f"impulse ≤ {link.peak_impulse:.4g} {impulse}, "
                        f"lost {link.contact_work:.4g} {energy}",
                    )
                )
        return rows if d.links else [row for row in rows if row[0] != "min gap"]

    __repr__ = Shown.__repr__  # else a dataclass makes its own


def _total(terms: Iterable[Any]) -> Any:
    """Sum of one term or more, without adding them to zero."""
    return functools.reduce(operator.add, terms)


def _largest(letter: str, peaks: list[Any]) -> str:
    """Peaks of a few elements one by one; of more only the largest."""
    if len(peaks) <= 4:
        return ", ".join(f"|{letter}{i}| ≤ {peak:.4g}" for i, peak in enumerate(peaks, 1))
    i = int(np.argmax(peaks))
    return f"|{letter}{i + 1}| ≤ {peaks[i]:.4g} is the largest,"


def _summed(steps: jax.Array) -> Float[Array, "... time"]:
    """Cumulative sums at the instants, from values of the steps between them."""
    return jnp.concatenate([0 * steps[..., :1], jnp.cumsum(steps, axis=-1)], -1)


def require_single(name: str, response: Response) -> None:
    """A ``ValueError`` that begins with ``name`` if the response is a batch."""
    if jnp.ndim(response.time) != 1:
        shape = jnp.shape(response.time)
        raise ValueError(f"{name}: a batch of shape {shape} must be indexed to one response")
