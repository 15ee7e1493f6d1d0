"""From buildings in SI units to the dimensionless system of eq. (9), and back (paper, eq. 8)."""

from __future__ import annotations

from typing import Any, overload

from jaxpound._checks import (
    Rule,
    enforce,
    finite,
    instance,
    is_traced,
    number,
    positive,
    real,
)
from jaxpound._fields import pytree_dataclass
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import DIMENSIONLESS, SECONDS, Record
from jaxpound.model.building import Building
from jaxpound.model.rod import ZenerRod
from jaxpound.model.structures import AdjacentStructures
from jaxpound.quantities import STANDARD_GRAVITY
from jaxpound.results.response import Demand, Response


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
