"""The units of the dimensionless system of eq. (9) in SI (paper, eq. 8)."""

from __future__ import annotations

import dataclasses
import operator
from collections.abc import Callable
from types import NoneType
from typing import Any, TypeVar

import jax

from jaxpound._checks import instance, is_traced, number, positive_number
from jaxpound._errors import InvalidInput
from jaxpound._fields import Parameter, converted, parameter, pytree_dataclass, walk
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import GroundMotion, require_seconds
from jaxpound.ground.record import Record
from jaxpound.model.column import Column
from jaxpound.model.contact import ContactLaw, Newton
from jaxpound.model.dampers import Inerter, VelocityFriction
from jaxpound.model.hysteresis import material_in
from jaxpound.model.parameters import put
from jaxpound.model.system import Rod, Structures, in_si
from jaxpound.quantities import STANDARD_GRAVITY
from jaxpound.results.demand import Demand
from jaxpound.results.response import Response

Timed = TypeVar("Timed", bound=Any)
Result = TypeVar("Result", Response, Demand)
Law = TypeVar("Law", bound=ContactLaw | Newton | Rod | VelocityFriction | Inerter | Column | None)


@pytree_dataclass
class Scales:
    """Units of the dimensionless system (eq. 8): mass m1, kg, ω1 = √(k1/m1), rad/s, gravity, m/s².

    Examples
    --------
    >>> scales = jp.Scales(mass=500e3, frequency=7.0)
    >>> round(float(scales.time), 4), round(float(scales.length), 4)  # s, m
    (0.1429, 0.2001)
    >>> scales.grid(duration=12.0, dt=0.005)
    TimeGrid(dt=0.035, n_steps=2400)
    """

    mass: Any = parameter("m_1", words="mass of building 1", above=0)
    frequency: Any = parameter(r"\omega_1", words="frequency of building 1", above=0)
    gravity: Any = parameter("g", words="gravity", above=0, default=STANDARD_GRAVITY)

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

    @property
    def units(self) -> dict[str, Any]:
        """The unit of each kind of quantity in SI (``quantities.SI``)."""
        return {
            "time": self.time,
            "length": self.length,
            "velocity": self.length / self.time,
            "acceleration": self.gravity,
            "force": self.force,
            "energy": self.force * self.length,
            "impulse": self.force * self.time,
            "mass": self.mass,
            "stiffness": self.force / self.length,
            "damping": self.mass / self.time,
            "rigidity": self.force * self.length**2,
            "hertz stiffness": self.force / self.length**1.5,
        }

    def unit_of(self, kind: str | None) -> Any:
        """The unit of a kind of quantity; 1 for pure numbers (None)."""
        return self.units[kind] if kind else 1.0

    def grid(self, duration: float, dt: float) -> TimeGrid:
        """The dimensionless time grid for a duration and a step in seconds, not traced."""
        if is_traced((self.frequency, duration, dt)):
            raise InvalidInput("", "", "a grid shapes the program and cannot be traced")
        omega = float(number("frequency", self.frequency))
        duration, dt = positive_number(duration=duration, dt=dt)
        return TimeGrid.until(float(duration) * omega, float(dt) * omega)

    def contact_to_si(self, law: Law) -> Law:
        """A dimensionless contact law as one in SI units; None stays None.

        Raises ``ValueError`` for a law of one's own, whose numbers have no known dimensions:
        ``units`` has what to multiply them by.

        Examples
        --------
        >>> scales = jp.Scales(mass=500e3, frequency=7.0)
        >>> law = scales.contact_to_si(jp.KelvinVoigt(stiffness=200.0, restitution=0.65))
        >>> f"{law.stiffness:.3g} N/m", law.restitution
        ('4.9e+09 N/m', 0.65)
        """
        return law_in_other_units("law", law, self, operator.mul)

    def to_dimensionless(self, record: Timed) -> Timed:
        """A ground motion in g and seconds, fixed or random, as one in g and units of 1/ω1.

        Raises ``ValueError`` if it is in units of 1/ω1 already, or a part has no unit of time.
        """
        if not callable(getattr(record, "dimensionless", None)) or isinstance(record, type):
            instance("record", record, Record)
        for part in record.parts() if isinstance(record, GroundMotion) else [record]:
            require_seconds("record", part)
        return record.dimensionless(self.frequency)

    def to_si(self, result: Result) -> Result:
        """A dimensionless ``Response`` or ``Demand`` in s, m, N and m/s² (energy in J).

        Raises ``ValueError`` if it is in SI units already.
        """
        instance("result", result, Response, Demand)
        if result.si:
            raise ValueError("to_si: result must be dimensionless, but is in SI units already")
        units = self.units
        known: Any = converted(result, lambda q, x: x * units[q.kind] if q.kind else x)
        if isinstance(known, Response):
            to_si = self.contact_to_si
            laws = [(with_known_units(x.law), x.velocity_friction) for x in known.links]
            both = [{"law": to_si(x), "velocity_friction": to_si(y)} for x, y in laws]
            links = tuple(map(lambda x, y: dataclasses.replace(x, **y), known.links, both))
            demand = dataclasses.replace(known.demand, si=True)
            known = dataclasses.replace(known, demand=demand, links=links)
        return dataclasses.replace(known, si=True)


SI_UNITS = Scales(mass=1.0, frequency=1.0, gravity=1.0)  # of numbers in SI units already


def result_units(structures: Structures) -> Scales | None:
    """The units of results in SI, which those of ``Buildings`` are in; None of others."""
    return SI_UNITS if in_si(structures) else None


def law_in_other_units(
    name: str, law: Law, scales: Scales, convert: Callable[[Any, Any], Any]
) -> Law:
    """A law of a link, or a damper, with each parameter converted by the unit of its kind."""
    if not isinstance(law, Rod | VelocityFriction | Inerter | Column):
        instance(name, law, ContactLaw, Newton, NoneType)
    if law is None:
        return law
    if with_known_units(law) is None:
        rule = "must be a law of this package: the units of a law of one's own are not known"
        raise InvalidInput(name, repr(law), rule)
    units, numbers = scales.units, walk(law, Parameter)
    changes = {path: convert(x, units[p.kind]) for path, p, x in numbers if p.kind}
    if isinstance(law, Rod):
        material = material_in(law.material, convert(1.0, scales.time))
        law = dataclasses.replace(law, material=material)
    return put(law, changes)


def with_known_units(law: Law) -> Law | None:
    """A law of this package, whose fields state their units; None for one of the user's."""
    numbers = list(walk(law, Parameter))
    return law if numbers and len(numbers) == len(jax.tree.leaves(law)) else None
