"""What a run returns: the series of ``Response``, the scalars of ``Demand``, the energy balance."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxpound import _root
from jaxpound._checks import is_traced
from jaxpound._pytree import pytree_dataclass, static
from jaxpound._tables import Shown, Table
from jaxpound.columns import Columnar
from jaxpound.quantities import column, kind_of, unit, unit_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

T = TypeVar("T")

SERIES = {
    "time": "time",
    "ground_acceleration": "acceleration",
    "x1": "length",
    "x2": "length",
    "v1": "velocity",
    "v2": "velocity",
    "absolute_acceleration_1": "acceleration",
    "absolute_acceleration_2": "acceleration",
    "f1": "force",
    "f2": "force",
    "friction": "force",
    "gap": "length",
    "ground_velocity": "velocity",
    "slip_direction": None,
}
"""Quantity of each series of a run, as ``Response.to_columns`` names them."""


def _are_known(results: Any) -> bool:
    """Whether all values are numbers: not traced, and not what JAX puts in their place."""
    leaves = jax.tree.leaves(results)
    numbers = (float, int, np.generic, np.ndarray, jax.Array)
    return bool(leaves) and not is_traced(leaves) and all(isinstance(x, numbers) for x in leaves)


def _run_numbers(batch: tuple[int, ...], each: int = 1) -> dict[str, np.ndarray]:
    """The number of every run along each axis of a batch, ``each`` rows a run."""
    names = ["run"] if len(batch) == 1 else [f"run_{axis}" for axis in range(len(batch))]
    numbers = np.indices(batch)
    return {name: np.repeat(x.ravel(), each) for name, x in zip(names, numbers, strict=True)}


def _chosen(results: T, index: Any, batch: tuple[int, ...]) -> T:
    """Results at the index of their batch; an index outside raises (JAX would clamp it)."""
    if not batch:
        raise TypeError(f"{type(results).__name__}: only a batch has an index, this is one run")
    index = np.asarray(index) if isinstance(index, list) else index
    np.empty(batch, bool)[index]
    # What the runs of a batch share has no batch axes.
    return jax.tree.map(lambda x: x[index] if np.ndim(x) >= len(batch) else x, results)


@pytree_dataclass
class Demand(Columnar, Shown):
    """Scalars of a run, as a designer asks for them. A batch has arrays in their place.

    Dimensionless as in eq. (9) (length g/ω1², time 1/ω1, force m1 g), or SI after ``Scales.to_si``.
    As a table (``to_pandas``, ``to_csv``, ``to_parquet``) it has a row a run.

    Examples
    --------
    >>> found = jp.demand(jp.paper.structures(), jp.paper.ground(), jp.paper.grid())
    >>> table = found.to_pandas()
    >>> table.index.name, round(float(table["min_gap"][0]), 3)
    ('run', 0.305)
    """

    min_gap: Any
    """Smallest gap ξ, where the slip velocity vanishes or at an end of the run."""
    min_gap_time: Any
    """When the gap is smallest."""
    peak_x1: Any
    """Largest |x1|, displacement of block 1 relative to the ground."""
    peak_x2: Any
    """Largest |x2|."""
    peak_f1: Any
    """Largest |f1|, rod force (base shear) of structure 1."""
    peak_f2: Any
    """Largest |f2|, in the units of f1 (m1 g)."""
    peak_acceleration_1: Any
    """Largest absolute acceleration |x1'' + u''| of block 1."""
    peak_acceleration_2: Any
    """Largest absolute acceleration |x2'' + u''| of block 2."""
    slip_distance: Any
    """Distance slid by the damper, ∫ |x1' − x2'| dt."""
    friction_work: Any
    """Energy taken by the damper, ∫ q (x1' − x2') dt."""
    residual_offset: Any
    """x2 − x1 at the end of the run: by how much the gap has changed."""
    pga: Any
    """Peak ground acceleration, largest |u''| at the instants of the run."""
    pgv: Any
    """Peak ground velocity, largest |u'| there, from rest by the trapezoidal rule."""
    soft_min_gap: Any = None
    """−T log of the mean of e^(−ξ/T) over the run, for the temperature T given to ``demand``."""
    si: bool = static(default=False)
    """Whether the numbers are SI."""

    @property
    def pounds(self) -> Any:
        """1.0 where the gap closes (min_gap ≤ 0), else 0.0; NaN where the run is invalid."""
        gap = jnp.asarray(self.min_gap)
        return jnp.where(jnp.isnan(gap), jnp.nan, (gap <= 0).astype(gap.dtype))

    def scalars(self) -> dict[str, Any]:
        """All of them by name, with ``pounds``: a row of a table, or the columns of a batch.

        Python's numbers for a single run, arrays for a batch; under ``jit``, ``vmap`` or ``grad``
        what JAX traces.
        """
        names = [field.name for field in dataclasses.fields(self) if field.name != "si"]
        values = {name: getattr(self, name) for name in names}
        known = {name: value for name, value in values.items() if value is not None}
        known["pounds"] = self.pounds
        if not _are_known(self) or any(map(jnp.ndim, known.values())):
            return known
        return {name: float(value) for name, value in known.items()}

    def _index_and_columns(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        batch = jnp.shape(self.min_gap)
        values = {
            column(name, kind_of(name), self.si): np.broadcast_to(value, batch).ravel()
            for name, value in self.scalars().items()
        }
        return _run_numbers(batch or (1,)), values

    def __getitem__(self, index: Any) -> Demand:
        """Runs of a batch by number, slice or mask, as of an array."""
        return _chosen(self, index, jnp.shape(self.min_gap))

    def _tables(self) -> list[Table]:
        return [self._table("Demand", [])]

    def _table(self, title: str, rows: list[tuple[str, str]]) -> Table:
        """The scalars of a single run, or rows that say more of it; of a batch their range."""
        batch, about = np.shape(self.min_gap), "SI" if self.si else "dimensionless"
        if batch:
            about += f", batch of shape {batch}"
        if not _are_known(self):
            return Table(f"{title} ({about}, traced: not known before the program runs)")
        scalars = self.scalars()
        good = np.isfinite(self.min_gap)
        if not batch:
            if not good:
                return Table(f"{title} ({about}): an invalid run, every result is NaN")
            numbers = [(name, x, unit_of(name, self.si)) for name, x in scalars.items()]
            return Table(f"{title} ({about})", (), rows or numbers, digits=8)
        pounding = int(np.count_nonzero(scalars.pop("pounds") == 1))
        notes = [f"pounding in {pounding:,} of {good.sum():,} valid runs"]
        if not good.all():
            notes.append(f"{(~good).sum():,} invalid, with NaN for every result")
        ranges = [
            (name, *_range(np.broadcast_to(x, batch)[good]), unit_of(name, self.si))
            for name, x in scalars.items()
            if good.any()
        ]
        return Table(
            f"{title} ({about})", ("", "smallest", "median", "largest", "unit"), ranges, notes
        )

    __repr__ = Shown.__repr__  # else a dataclass makes its own


def _range(values: np.ndarray) -> tuple[float, float, float]:
    return float(values.min()), float(np.median(values)), float(values.max())


class Phase(NamedTuple):
    """An interval of 'stick', 'slip right' (x1' > x2') or 'slip left', and its ends."""

    kind: str
    """'stick', 'slip right' or 'slip left'."""
    start: float
    """When it begins."""
    end: float
    """When it ends."""


class Energy(NamedTuple):
    """Terms of the energy balance over time (relative motion), each by its own quadrature.

    The terms are cumulative trapezoidal integrals of the powers at the grid's instants (of the
    ground's, of the momentum over its velocity u'), not the scheme's telescoping sums, so that
    ``residual`` = rods + friction + kinetic − input can fail: it measures how well motion, forces
    and quadrature agree (not the rods' law). Shape (n_steps+1,) each; unit (m1 g)(g/ω1²), or J in
    SI.
    """

    input: Any
    """Work of the ground, −∫ u'' (x1' + x2'/ρ) dt."""
    kinetic: Any
    """Kinetic energy ½ x1'² + ½ x2'²/ρ."""
    rods: Any
    """Work into the rods, ∫ f1 x1' dt + ∫ f2 x2' dt."""
    friction: Any
    """Work into the damper, ∫ q (x1' − x2') dt."""
    residual: Any
    """rods + friction + kinetic − input."""


@pytree_dataclass
class Response(Columnar, Shown):
    """Time series of a run, each of shape (n_steps+1,), and what follows from them.

    Dimensionless as in eq. (9): time 1/ω1, length g/ω1², force m1 g, acceleration g;
    ``Scales.to_si`` gives the same object in s, m, N and m/s². A batch has a leading axis.
    As a table (``to_pandas``, ``to_csv``, ``to_parquet``) it has a row an instant, and of a batch a
    row for every instant of every run, by the run's number.

    Examples
    --------
    >>> scales = jp.Scales(mass=500e3, frequency=7.0)
    >>> response = jp.simulate(jp.paper.structures(), jp.paper.ground(), jp.paper.grid())
    >>> table = scales.to_si(response).to_pandas()
    >>> table.index.name, *table.columns[:4]
    ('time_s', 'ground_acceleration_m_per_s2', 'x1_m', 'x2_m', 'v1_m_per_s')
    """

    time: Any
    """Instants t of the grid."""
    x1: Any
    """Displacement of block 1 relative to the ground, towards block 2."""
    x2: Any
    """Displacement of block 2 relative to the ground, away from block 1."""
    v1: Any
    """Velocity x1'."""
    v2: Any
    """Velocity x2'."""
    f1: Any
    """Force of rod 1 (base shear)."""
    f2: Any
    """Force of rod 2, in the units of f1."""
    friction: Any
    """Force q of the damper: positive when it pulls block 1 back (x1' > x2' in slip)."""
    ground_acceleration: Any
    """Ground acceleration u''."""
    ground_velocity: Any
    """Ground velocity u'."""
    gap: Any
    """ξ = ξ0 + x2 − x1; pounding is ξ ≤ 0."""
    phase: Any
    """Direction of slip half a step after each instant: 1, −1, or 0 in stick."""
    change_time: Any
    """Where ``phase`` differs from the entry before: when it changed."""
    mass_1: Any
    """Mass of block 1 in units of m1 (in SI, kg)."""
    mass_2: Any
    """Mass of block 2 in units of m1 (in SI, kg)."""
    demand: Demand
    """The scalars of the run."""
    method: str = static(default="")
    """The scheme in words."""
    si: bool = static(default=False)
    """Whether the numbers are SI."""

    @property
    def min_gap(self) -> Any:
        """Smallest gap of the run (not only of its grid)."""
        return self.demand.min_gap

    @property
    def slip_velocity(self) -> Any:
        """x1' − x2'."""
        return self.v1 - self.v2

    @property
    def absolute_accelerations(self) -> tuple[Any, Any]:
        """x1'' + u'' and x2'' + u'' of eq. (9), in g (m/s² in SI)."""
        m1, m2 = (jnp.asarray(m)[..., None] for m in (self.mass_1, self.mass_2))
        return (-self.f1 - self.friction) / m1, (self.friction - self.f2) / m2

    @property
    def energy(self) -> Energy:
        """Energy balance over time."""
        m1, m2 = (jnp.asarray(m)[..., None] for m in (self.mass_1, self.mass_2))
        rods = self._integral(self.f1 * self.v1 + self.f2 * self.v2)
        friction = self._integral(self.friction * self.slip_velocity)
        kinetic = (m1 * self.v1**2 + m2 * self.v2**2) / 2
        # Over a step by the change of u', which has what u'' does between the instants.
        momentum = m1 * self.v1 + m2 * self.v2
        between = (momentum[..., 1:] + momentum[..., :-1]) / 2
        supplied = _summed(-jnp.diff(self.ground_velocity, axis=-1) * between)
        return Energy(supplied, kinetic, rods, friction, rods + friction + kinetic - supplied)

    def phases(self) -> list[Phase]:
        """Intervals of stick and slip in order, with the instants found within the steps.

        Raises
        ------
        ValueError
            For a batch (take one response of it first) and for an invalid run.
        """
        require_single("phases", self)
        time, phase = np.asarray(self.time), np.asarray(self.phase)
        if not np.isfinite(phase).all():
            raise ValueError("phases: the run is invalid (its results are NaN)")
        changes = np.flatnonzero(np.diff(phase)) + 1
        instants = np.clip(np.asarray(self.change_time)[changes], time[0], time[-1])
        kinds = {0: "stick", 1: "slip right", -1: "slip left"}
        bounds = [float(time[0]), *instants.tolist(), float(time[-1])]
        directions = [int(phase[0]), *phase[changes].tolist()]
        return [
            Phase(kinds[direction], start, end)
            for direction, start, end in zip(directions, bounds[:-1], bounds[1:], strict=True)
        ]

    def __getitem__(self, index: Any) -> Response:
        """Runs of a batch by number, slice or mask, as of an array: ``batch[3]`` is one run."""
        return _chosen(self, index, jnp.shape(self.min_gap))

    def _integral(self, power: Any) -> Float[Array, "... time"]:
        return _summed(jnp.diff(self.time, axis=-1) * (power[..., 1:] + power[..., :-1]) / 2)

    def plot(self) -> Figure:
        """Ground motion, displacements, friction force and gap over time (``plots.overview``).

        Of a batch all runs, line upon line.

        Raises
        ------
        ValueError
            If a run is invalid.
        """
        return _root.overview(self)

    def _index_and_columns(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        batch, n = jnp.shape(self.min_gap), jnp.shape(self.time)[-1]
        a1, a2 = self.absolute_accelerations
        elsewhere = {
            "absolute_acceleration_1": a1,
            "absolute_acceleration_2": a2,
            "slip_direction": self.phase + 0.0,  # no −0 in a file
        }
        series = {
            column(name, quantity, self.si): np.broadcast_to(
                elsewhere[name] if name in elsewhere else getattr(self, name), (*batch, n)
            ).ravel()
            for name, quantity in SERIES.items()
        }
        runs = _run_numbers(batch, n) if batch else {}
        time = column("time", SERIES["time"], self.si)
        return runs | {time: series.pop(time)}, series

    def _tables(self) -> list[Table]:
        known = _are_known(self) and not jnp.ndim(self.min_gap) and jnp.isfinite(self.min_gap)
        title = f"Response of {self.method}" if self.method else "Response"
        return [self.demand._table(title, self._rows() if known else [])]

    def _rows(self) -> list[tuple[str, str]]:
        """What a single run is known by."""
        length, second, acceleration, force, energy = (
            unit(quantity, self.si)
            for quantity in ("length", "time", "acceleration", "force", "energy")
        )
        d, time = self.demand.scalars(), np.asarray(self.time)
        pounds = "   POUNDS" if d["pounds"] else ""
        return [
            (
                "time",
                f"{time.size - 1} steps of {time[1] - time[0]:.6g} {second}, "
                f"until {time[-1]:.6g} {second}",
            ),
            (
                "min gap",
                f"{d['min_gap']:.6g} {length} at {d['min_gap_time']:.6g} {second}{pounds}",
            ),
            ("displacement", f"|x1| ≤ {d['peak_x1']:.4g}, |x2| ≤ {d['peak_x2']:.4g} {length}"),
            (
                "acceleration",
                f"|a1| ≤ {d['peak_acceleration_1']:.4g}, |a2| ≤ {d['peak_acceleration_2']:.4g} "
                f"{acceleration}; of the ground {d['pga']:.4g} {acceleration}",
            ),
            ("rod force", f"|f1| ≤ {d['peak_f1']:.4g}, |f2| ≤ {d['peak_f2']:.4g} {force}"),
            (
                "damper",
                f"{len(self.phases())} phases, slid {d['slip_distance']:.4g} {length}, "
                f"took {d['friction_work']:.4g} {energy}, "
                f"offset left {d['residual_offset']:.4g} {length}",
            ),
        ]

    __repr__ = Shown.__repr__  # else a dataclass makes its own


def _summed(steps: jax.Array) -> Float[Array, "... time"]:
    """Sums until each instant of what belongs to the steps between them."""
    return jnp.concatenate([0 * steps[..., :1], jnp.cumsum(steps, axis=-1)], -1)


def require_single(name: str, response: Response) -> None:
    """A ``ValueError`` in the name where a batch is given."""
    if jnp.ndim(response.time) != 1:
        shape = jnp.shape(response.time)
        raise ValueError(f"{name}: a batch of shape {shape} must be indexed to one response")
