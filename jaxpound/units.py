"""From buildings in SI units to the dimensionless system of eq. (9), and back (paper, eq. 8)."""

from __future__ import annotations

from typing import Any, overload

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound._checks import (
    Rule,
    enforce,
    finite,
    instance,
    is_traced,
    number,
    one_batch,
    positive,
    real,
)
from jaxpound._pytree import pytree_dataclass
from jaxpound.ground import DIMENSIONLESS, SECONDS, Record
from jaxpound.quantities import STANDARD_GRAVITY
from jaxpound.response import Demand, Response
from jaxpound.scheme import TimeGrid
from jaxpound.structures import AdjacentStructures, ZenerRod


@pytree_dataclass
class Building:
    """A building as one block on one fractional Zener rod, in SI units.

    Parameters
    ----------
    mass
        Mass > 0, kg.
    stiffness
        Long-time stiffness k > 0, N/m.
    order
        Order of the fractional derivative, in (0, 1].
    tau_f, tau_x
        Relaxation times, s^order, 0 < τ_f ≤ τ_x.

    Raises
    ------
    ValueError
        If a known value breaks its rule.

    Examples
    --------
    >>> building = jp.Building.from_period(mass=500e3, period=0.9, damping_ratio=0.05)
    >>> f"{building.stiffness:.3g} N/m"
    '2.19e+07 N/m'
    >>> round(float(building.natural_period), 6)
    0.9
    """

    mass: Any
    stiffness: Any
    order: Any
    tau_f: Any
    tau_x: Any

    def __post_init__(self) -> None:
        rod = ZenerRod(self.order, self.tau_f, self.tau_x)
        mass, stiffness = positive("Building", mass=self.mass, stiffness=self.stiffness)
        values = {"mass": mass, "stiffness": stiffness, **vars(rod)}
        one_batch("Building", **values)
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @classmethod
    def from_period(
        cls,
        mass: Any,
        period: Any,
        damping_ratio: Any,
        order: Any = 0.5,
        tau_f: Any = None,
    ) -> Building:
        """The building whose equivalent natural period and damping ratio are the given ones.

        At ω = 2π / period the rod's storage modulus carries the mass, k K'(ω) = m ω², and half its
        loss factor is the damping ratio: two equations for stiffness and τ_x.

        Parameters
        ----------
        mass
            Mass > 0, kg.
        period
            Natural period > 0, s.
        damping_ratio
            Equivalent viscous damping ratio ≥ 0 (0.05 is 5 %).
        order
            Order of the fractional derivative, in (0, 1].
        tau_f
            Relaxation time of force, s^order; by default such that τ_f ω^order = 0.01.

        Raises
        ------
        ValueError
            If a known value breaks its rule, or no rod of this order and τ_f damps as much.
        """
        owner = "Building.from_period"
        mass, period = positive(owner, mass=mass, period=period)
        zeta = real(owner, "damping_ratio", damping_ratio)
        rule = Rule("damping_ratio", zeta, (zeta >= 0) & finite(zeta), "finite and not negative")
        enforce(owner, [rule])
        order = ZenerRod(order, 1.0, 1.0).order
        omega = 2 * np.pi / period
        size = omega**order
        tau_f = 0.01 / size if tau_f is None else ZenerRod(order, tau_f, tau_f).tau_f
        one_batch(owner, mass=mass, period=period, damping_ratio=zeta, order=order, tau_f=tau_f)
        xp = jnp if is_traced((period, order)) else np
        c, s = size * xp.cos(np.pi / 2 * order), size * xp.sin(np.pi / 2 * order)
        # Loss − 2ζ storage = 0 is linear in τ_x (numerators of K* over |1 + τ_f (iω)^γ|²).
        gain = s - 2 * zeta * (c + tau_f * size**2)
        largest = s / (c + tau_f * size**2) / 2
        text = "below what a rod of this order and tau_f can give"
        if not is_traced((largest, gain)):
            first = np.argmin(gain > 0)  # the one the message is about
            text += f", {np.broadcast_to(largest, np.shape(gain)).flat[first]:.8g}"
        enforce(owner, [Rule("damping_ratio", zeta, gain > 0, text)])
        # As a sum of positive terms, so that τ_x ≥ τ_f to the last digit.
        tau_x = tau_f + 2 * zeta * (1 + 2 * tau_f * c + (tau_f * size) ** 2) / gain
        below = (1 + tau_f * c) ** 2 + (tau_f * s) ** 2
        storage = (1 + (tau_x + tau_f) * c + tau_x * tau_f * size**2) / below
        return cls(mass, mass * omega**2 / storage, order, tau_f, tau_x)

    @property
    def _rod(self) -> ZenerRod:
        return ZenerRod(self.order, self.tau_f, self.tau_x)

    @property
    def natural_period(self) -> jax.Array:
        """Equivalent natural period, s."""
        return 2 * jnp.pi / self._rod.natural_frequency(self.stiffness, self.mass)

    @property
    def damping_ratio(self) -> jax.Array:
        """Equivalent viscous damping ratio at the natural frequency."""
        return self._rod.damping_ratio(self.stiffness, self.mass)


@pytree_dataclass
class Scales:
    """Units of the dimensionless system (eq. 8): ω1 = √(k1/m1), m1 and gravity.

    Parameters
    ----------
    mass
        m1, kg.
    frequency
        ω1, rad/s.
    gravity
        g, m/s².

    Examples
    --------
    >>> scales = jp.Scales(mass=500e3, frequency=7.0)
    >>> round(float(scales.time), 4), round(float(scales.length), 4)  # s, m
    (0.1429, 0.2001)
    >>> scales.grid(duration=12.0, dt=0.005)
    TimeGrid(dt=0.035, n_steps=2400)
    """

    mass: Any
    frequency: Any
    gravity: Any = STANDARD_GRAVITY

    def __post_init__(self) -> None:
        values = vars(self).copy()
        for name, value in zip(values, positive("Scales", **values), strict=True):
            object.__setattr__(self, name, value)

    @property
    def time(self) -> Any:
        """Unit of time 1/ω1, s."""
        return 1 / self.frequency

    @property
    def length(self) -> Any:
        """Unit of length g/ω1², m."""
        return self.gravity / self.frequency**2

    @property
    def force(self) -> Any:
        """Unit of force m1 g, N."""
        return self.mass * self.gravity

    def grid(self, duration: float, dt: float) -> TimeGrid:
        """The dimensionless time grid for a duration and a step in seconds.

        Raises
        ------
        ValueError
            If duration or dt is not a positive number, or anything is traced: a grid is static.
        """
        if is_traced((self.frequency, duration, dt)):
            raise ValueError("Scales.grid: a grid shapes the program and cannot be traced")
        omega = float(number("Scales.grid", "frequency", self.frequency))
        positive(
            "Scales.grid",
            duration=number("Scales.grid", "duration", duration),
            dt=number("Scales.grid", "dt", dt),
        )
        return TimeGrid.until(float(duration) * omega, float(dt) * omega)

    def buildings(self, structures: AdjacentStructures) -> tuple[Building, Building, Any, Any]:
        """Dimensionless structures in SI: both buildings, slip force (N) and gap (m).

        The inverse of ``dimensionless``, for these scales.
        """
        instance("Scales.buildings", "structures", structures, AdjacentStructures)
        stiffness = self.mass * self.frequency**2
        s = structures
        rods = [
            (
                rod.order,
                rod.tau_f / self.frequency**rod.order,
                rod.tau_x / self.frequency**rod.order,
            )
            for rod in (s.rod_1, s.rod_2)
        ]
        return (
            Building(self.mass, stiffness, *rods[0]),
            Building(self.mass / s.mass_ratio, stiffness * s.stiffness_ratio, *rods[1]),
            s.friction * self.force,
            s.initial_gap * self.length,
        )

    def to_dimensionless(self, record: Record) -> Record:
        """A record in g and seconds as a record in g and units of 1/ω1.

        Raises
        ------
        ValueError
            If the record is in units of 1/ω1 already.
        """
        owner = "Scales.to_dimensionless"
        instance(owner, "record", record, Record)
        if record.time_unit != SECONDS:
            rule = f"must be in seconds, but is in units of {record.time_unit} already"
            raise ValueError(f"{owner}: record = {record!r} {rule}")
        return Record(record.samples, record.dt * self.frequency, record.name, DIMENSIONLESS)

    @overload
    def to_si(self, result: Response) -> Response: ...

    @overload
    def to_si(self, result: Demand) -> Demand: ...

    def to_si(self, result: Response | Demand) -> Response | Demand:
        """A dimensionless ``Response`` or ``Demand`` in s, m, N and m/s² (energy in J).

        Raises
        ------
        ValueError
            If the result is in SI units already.
        """
        instance("Scales.to_si", "result", result, Response, Demand)
        if result.si:
            raise ValueError("to_si: result must be dimensionless, but is in SI units already")
        if isinstance(result, Demand):
            return self._demand_to_si(result)
        time, length, force, gravity = self.time, self.length, self.force, self.gravity
        speed = length / time
        return Response(
            time=result.time * time,
            x1=result.x1 * length,
            x2=result.x2 * length,
            v1=result.v1 * speed,
            v2=result.v2 * speed,
            f1=result.f1 * force,
            f2=result.f2 * force,
            friction=result.friction * force,
            ground_acceleration=result.ground_acceleration * gravity,
            ground_velocity=result.ground_velocity * speed,
            gap=result.gap * length,
            phase=result.phase,
            change_time=result.change_time * time,
            mass_1=result.mass_1 * self.mass,
            mass_2=result.mass_2 * self.mass,
            demand=self._demand_to_si(result.demand),
            method=result.method,
            si=True,
        )

    def _demand_to_si(self, demand: Demand) -> Demand:
        length, force = self.length, self.force
        return Demand(
            min_gap=demand.min_gap * length,
            min_gap_time=demand.min_gap_time * self.time,
            peak_x1=demand.peak_x1 * length,
            peak_x2=demand.peak_x2 * length,
            peak_f1=demand.peak_f1 * force,
            peak_f2=demand.peak_f2 * force,
            peak_acceleration_1=demand.peak_acceleration_1 * self.gravity,
            peak_acceleration_2=demand.peak_acceleration_2 * self.gravity,
            slip_distance=demand.slip_distance * length,
            friction_work=demand.friction_work * force * length,
            residual_offset=demand.residual_offset * length,
            pga=demand.pga * self.gravity,
            pgv=demand.pgv * length / self.time,
            soft_min_gap=None if demand.soft_min_gap is None else demand.soft_min_gap * length,
            si=True,
        )


def dimensionless(
    building_1: Building,
    building_2: Building,
    friction_force: Any,
    gap: Any,
    gravity: Any = STANDARD_GRAVITY,
) -> tuple[AdjacentStructures, Scales]:
    """Two buildings with a friction damper between them, as eq. (9) has them (paper, eq. 8).

    Parameters
    ----------
    building_1, building_2
        The buildings; building 1 sets the scales. Positive displacement is towards building 2.
    friction_force
        Slip force of the damper ≥ 0, N.
    gap
        Gap between the buildings at rest ≥ 0, m.
    gravity
        g > 0, m/s².

    Returns
    -------
    The dimensionless structures, and the scales that bring results back to SI.

    Raises
    ------
    ValueError
        If a known value breaks its rule.

    Examples
    --------
    >>> left = jp.Building.from_period(mass=500e3, period=0.9, damping_ratio=0.05)
    >>> right = jp.Building.from_period(mass=400e3, period=0.6, damping_ratio=0.05)
    >>> structures, scales = jp.dimensionless(left, right, friction_force=200e3, gap=0.10)
    >>> round(float(structures.mass_ratio), 4), round(float(structures.friction), 4)
    (1.25, 0.0408)
    >>> round(float(structures.initial_gap * scales.length), 6)  # back in m
    0.1
    """
    instance("dimensionless", "building_1", building_1, Building)
    instance("dimensionless", "building_2", building_2, Building)
    friction_force = real("dimensionless", "friction_force", friction_force)
    gap = real("dimensionless", "gap", gap)
    rules = [
        Rule(name, value, (value >= 0) & finite(value), "finite and not negative")
        for name, value in (("friction_force", friction_force), ("gap", gap))
    ]
    enforce("dimensionless", rules)
    scales = Scales(building_1.mass, (building_1.stiffness / building_1.mass) ** 0.5, gravity)
    rod_1, rod_2 = (
        ZenerRod(b.order, b.tau_f * scales.frequency**b.order, b.tau_x * scales.frequency**b.order)
        for b in (building_1, building_2)
    )
    structures = AdjacentStructures(
        rod_1=rod_1,
        rod_2=rod_2,
        mass_ratio=building_1.mass / building_2.mass,
        stiffness_ratio=building_2.stiffness / building_1.stiffness,
        friction=friction_force / scales.force,
        initial_gap=gap / scales.length,
    )
    return structures, scales
