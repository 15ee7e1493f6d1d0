"""What a run returns: the series of ``Response``, the scalars of ``Demand``, the energy balance."""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxpound._checks import is_traced
from jaxpound._pytree import pytree_dataclass, static

T = TypeVar("T")


def _chosen(results: T, index: Any, batch: tuple[int, ...]) -> T:
    """Results at the index of their batch; an index outside raises (JAX would clamp it)."""
    if not batch:
        raise TypeError(f"{type(results).__name__}: only a batch has an index, this is one run")
    index = np.asarray(index) if isinstance(index, list) else index
    np.empty(batch, bool)[index]
    # What the runs of a batch share has no batch axes.
    return jax.tree.map(lambda x: x[index] if np.ndim(x) >= len(batch) else x, results)


@pytree_dataclass
class Demand:
    """Scalars of a run, as a designer asks for them. A batch has arrays in their place.

    Dimensionless as in eq. (9) (length g/ω1², time 1/ω1, force m1 g), or SI after ``Scales.to_si``.
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
        """All of them by name, with ``pounds``: a row of a table, or the columns of a batch."""
        names = [field.name for field in dataclasses.fields(self) if field.name != "si"]
        values = {name: getattr(self, name) for name in names}
        known = {name: value for name, value in values.items() if value is not None}
        return known | {"pounds": self.pounds}

    def __getitem__(self, index: Any) -> Demand:
        """Runs of a batch by number, slice or mask, as of an array."""
        return _chosen(self, index, jnp.shape(self.min_gap))

    def __repr__(self) -> str:
        units = "SI" if self.si else "dimensionless"
        if is_traced(self) or jnp.ndim(self.min_gap):
            return f"Demand({units}, batch of shape {jnp.shape(self.min_gap)})"
        lines = [f"    {name:20s} {float(x):.8g}\n" for name, x in self.scalars().items()]
        return f"Demand({units}\n{''.join(lines)})"


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
class Response:
    """Time series of a run, each of shape (n_steps+1,), and what follows from them.

    Dimensionless as in eq. (9): time 1/ω1, length g/ω1², force m1 g, acceleration g;
    ``Scales.to_si`` gives the same object in s, m, N and m/s². A batch has a leading axis.
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

    def __repr__(self) -> str:
        shape = jnp.shape(self.time)
        if is_traced(self) or len(shape) != 1:
            return f"Response(batch of shape {shape}: {self.method})"
        if not jnp.isfinite(self.demand.min_gap):
            return f"Response(an invalid run: every result is NaN; {self.method})"
        length, second, force = ("m", "s", "N") if self.si else ("g/ω1²", "1/ω1", "m1 g")
        d, n = self.demand, shape[0] - 1
        step = float(self.time[1] - self.time[0])
        return (
            f"Response({self.method}\n"
            f"    {n} steps of {step:.6g} {second}, until {float(self.time[-1]):.6g} {second}\n"
            f"    min gap      {float(d.min_gap):.6g} {length} at {float(d.min_gap_time):.6g} "
            f"{second}{'   POUNDS' if float(d.min_gap) <= 0 else ''}\n"
            f"    peaks        |x1| {float(d.peak_x1):.4g}, |x2| {float(d.peak_x2):.4g} {length};  "
            f"|f1| {float(d.peak_f1):.4g}, |f2| {float(d.peak_f2):.4g} {force}\n"
            f"    damper       {len(self.phases())} phases, slid {float(d.slip_distance):.4g} "
            f"{length}, offset left {float(d.residual_offset):.4g} {length})"
        )


def _summed(steps: jax.Array) -> Float[Array, "... time"]:
    """Sums until each instant of what belongs to the steps between them."""
    return jnp.concatenate([0 * steps[..., :1], jnp.cumsum(steps, axis=-1)], -1)


def require_single(name: str, response: Response) -> None:
    """A ``ValueError`` in the name where a batch is given."""
    if jnp.ndim(response.time) != 1:
        shape = jnp.shape(response.time)
        raise ValueError(f"{name}: a batch of shape {shape} must be indexed to one response")
