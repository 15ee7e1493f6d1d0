"""Bearings under a building and the moat wall around it; in SI units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from types import NoneType
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxpound._checks import Range, as_tuple, instance, is_whole, positive
from jaxpound._errors import InvalidInput, renamed
from jaxpound._extrema import larger
from jaxpound._fields import BatchInSI, parameter, pytree_dataclass
from jaxpound.model.building import PERIOD, Building
from jaxpound.model.dampers import VelocityFriction
from jaxpound.model.hysteresis import Bilinear
from jaxpound.model.row import FloorLink
from jaxpound.model.shear_building import ShearBuilding
from jaxpound.model.system import is_closable
from jaxpound.model.topology import GROUND
from jaxpound.quantities import STANDARD_GRAVITY

_RADIUS = Range(0.05, 50, "m", "of a sliding surface; 1 to 6 m are usual")
_FRICTION = Range(0, 1, "", "a coefficient; 0.03 to 0.12 is usual of PTFE")
RATE = Range(1, 1e4, "s/m", "20 to 100 s/m is usual of PTFE")
_STRENGTH = Range(1e-4, 1, "", "of the weight; 0.03 to 0.1 is usual")
_LENGTH = Range(1e-5, 1, "m", "at which a bearing yields")


@pytree_dataclass
class FrictionPendulum(BatchInSI):
    r"""Bearings that slide on a spherical surface, in SI units (Zayas, Low and Mahin 1990).

    Under a weight W they are a spring W/R beside a sliding link with the slip force μ W; vertical
    motion does not change W. With a rate a friction grows with the sliding velocity,
    :math:`μ_f - (μ_f - μ) e^{-a |v|}` (Constantinou, Mokha and Reinhorn 1990).

    Parameters
    ----------
    radius
        Effective radius R > 0 of the surface, m.
    friction
        Coefficient of friction μ ≥ 0, in slow slip and in stick.
    fast_friction
        μ_f ≥ μ in fast slip; None, the default, is the same μ at every velocity.
    rate
        a > 0, s/m, beside fast_friction only; 50 by default.
    ultimate_displacement
        Where the slider leaves its surface, m; infinite by default. ``collapsed`` of a run's demand
        says it, and ``ductility`` is the largest displacement over it.

    Examples
    --------
    >>> bearing = jp.FrictionPendulum(radius=2.24, friction=0.06)
    >>> round(float(bearing.period), 3), round(float(bearing.damping_ratio(0.2)), 3)
    (3.003, 0.256)
    """

    radius: Any = parameter("R", above=0, within=_RADIUS)
    friction: Any = parameter(r"\mu", least=0, within=_FRICTION)
    fast_friction: Any = parameter(r"\mu_f", least="friction", within=_FRICTION, default=None)
    rate: Any = parameter("a", above=0, within=RATE, default=None)
    ultimate_displacement: Any = parameter("e_u", above=0, finite=False, default=np.inf)

    def __post_init__(self) -> None:
        if self.fast_friction is None and self.rate is not None:
            rule = "must not be given without fast_friction: friction does not grow"
            raise InvalidInput("rate", f"{self.rate}", rule)
        if self.fast_friction is not None and self.rate is None:
            object.__setattr__(self, "rate", 50.0)
        super().__post_init__()

    @property
    def period(self) -> Any:
        """Period of the building as a pendulum, 2π √(R/g), s: it does not depend on the mass."""
        return 2 * jnp.pi * jnp.sqrt(self.radius / STANDARD_GRAVITY)

    def damping_ratio(self, displacement: Any) -> Any:
        """Equivalent viscous damping ratio in slow cycles to ±``displacement``, m.

        Energy of a cycle over 2π times the secant stiffness times its square: 2/π μ/(μ + D/R).
        """
        (size,) = positive(displacement=displacement)
        return 2 / jnp.pi * self.friction / (self.friction + size / self.radius)

    def storey(self, base_mass: Any, weight: Any, gravity: Any = STANDARD_GRAVITY) -> Building:
        """The base on the restoring spring under a weight, N, whatever the gravity."""
        limit = self.ultimate_displacement
        law = Bilinear(limit, 1.0, limit) if is_closable(limit) else None  # never yields
        return Building(base_mass, weight / self.radius, hysteresis=law)

    def between(self, weight: Any) -> dict[str, Any]:
        """Friction of the link from the base to the ground."""
        friction: dict[str, Any] = {"friction": self.friction * weight}
        if self.fast_friction is not None:
            increase = (self.fast_friction - self.friction) * weight
            friction["velocity_friction"] = VelocityFriction(increase, 1 / self.rate)
        return friction


@pytree_dataclass
class LeadRubber(BatchInSI):
    r"""Lead–rubber bearings, bilinear: a strength Q and the stiffness of the rubber, in SI units.

    Parameters
    ----------
    period
        Period T2 > 0, s, of the building on the stiffness after yield; 2 to 3 s is usual.
    strength
        Q over the weight > 0: the force at displacement 0.
    yield_displacement
        > 0, m.
    ultimate_displacement
        Where the bearings fail, m; infinite by default. ``collapsed`` of a run's demand says it.

    Examples
    --------
    >>> bearing = jp.LeadRubber(period=2.5, strength=0.05)
    >>> round(float(bearing.damping_ratio(0.2)), 3)
    0.169
    """

    period: Any = parameter("T_2", above=0, within=PERIOD)
    strength: Any = parameter("Q", above=0, within=_STRENGTH)
    yield_displacement: Any = parameter("e_y", above=0, within=_LENGTH, default=0.01)
    ultimate_displacement: Any = parameter(
        "e_u", least="yield_displacement", finite=False, default=np.inf
    )

    def damping_ratio(self, displacement: Any, gravity: Any = STANDARD_GRAVITY) -> Any:
        """Equivalent viscous damping ratio in cycles to ±``displacement``, m, beyond yield.

        4 Q (D − e_y) over 2π times the secant stiffness times D²; 0 where they do not yield.
        """
        (size,) = positive(displacement=displacement)
        yields = larger(size - self.yield_displacement, 0.0)
        force = self.strength + size * self._stiffness(gravity)
        return 2 / jnp.pi * self.strength * yields / (force * size)

    def _stiffness(self, gravity: Any) -> Any:
        """Stiffness after yield over the weight, 1/m."""
        return (2 * jnp.pi / self.period) ** 2 / gravity

    def storey(self, base_mass: Any, weight: Any, gravity: Any = STANDARD_GRAVITY) -> Building:
        """The base on the bearings under a weight, N."""
        after = self._stiffness(gravity) * weight
        before = after + self.strength * weight / self.yield_displacement
        law = Bilinear(self.yield_displacement, after / before, self.ultimate_displacement)
        return Building(base_mass, before, hysteresis=law)

    def between(self, weight: Any) -> dict[str, Any]:
        """Friction of the link from the base to the ground: none."""
        return {}


@pytree_dataclass
class MoatWall:
    """The wall around the base of an isolated building, in SI units; rigid.

    Parameters
    ----------
    gap
        Gap ≥ 0 at rest, m; or (left, right), of which one may be infinite.
    contact
        The law of contact with the wall, or one for each side, (left, right); None, the default,
        only measures the gap.
    """

    gap: Any
    contact: Any = None

    def __post_init__(self) -> None:
        with renamed():
            self.link(0)

    def link(self, building: int, **between: Any) -> FloorLink:
        """The link of two faces from the base of a building to the ground."""
        gap = tuple(self.gap) if isinstance(self.gap, list | tuple) else (self.gap, self.gap)
        between |= {"gap": gap, "contact": self.contact}
        return FloorLink(building, 0, next_building=GROUND, **between)


def on_bearings(
    building: Building | ShearBuilding,
    bearing: FrictionPendulum | LeadRubber,
    base_mass: Any,
    *,
    links: Sequence[FloorLink] = (),
    wall: MoatWall | None = None,
    number: int = 0,
    height: float = 0.5,
    gravity: Any = STANDARD_GRAVITY,
) -> tuple[ShearBuilding, tuple[FloorLink, ...]]:
    """A building on bearings, and its links to the ground, both for ``Buildings``.

    The base is its floor 0 and the bearings are its storey 0; all others move up by one. The link
    has the friction of the bearings and the faces of the wall.

    Parameters
    ----------
    building
        The building above the bearings.
    bearing
        All bearings together, ``FrictionPendulum`` or ``LeadRubber``.
    base_mass
        Mass > 0 of the base, kg.
    links
        Links from the building to itself and to the ground, such as that of
        ``tuned_inerter_damper``: they come first in the result, one floor higher, and lead to the
        base in the place of the ground.
    wall
        The moat wall around the base, if there is one.
    number
        The number of the building in ``Buildings``, from 0.
    height
        Height of the bearings, m.
    gravity
        g > 0, m/s².

    Examples
    --------
    Four storeys on friction pendulums, 30 cm from the moat wall on both sides:

    >>> frame = jp.ShearBuilding.from_period(4, 300e3, period=0.5, damping_ratio=0.03)
    >>> law = jp.KelvinVoigt(stiffness=2e9, restitution=0.7)
    >>> base, links = jp.on_bearings(
    ...     frame, jp.FrictionPendulum(2.24, 0.06), 350e3, wall=jp.MoatWall(0.3, law)
    ... )
    >>> hospital = jp.Buildings((base,), links)
    >>> [f"{link.side}: {link.gap} m" for link in hospital.links]
    ['right: 0.3 m', 'left: 0.3 m']
    """
    instance("building", building, ShearBuilding, Building)
    instance("bearing", bearing, FrictionPendulum, LeadRubber)
    instance("wall", wall, MoatWall, NoneType)
    base_mass, gravity = positive(base_mass=base_mass, gravity=gravity)
    if not (is_whole(number) and number >= 0):
        raise InvalidInput("number", repr(number), "must be a whole number from 0 on")
    for k, x in enumerate(as_tuple("links", links)):
        instance(f"links.{k}", x, FloorLink)
    above = building if isinstance(building, ShearBuilding) else ShearBuilding((building,))
    if above.footing is not None:
        rule = "must be put on soil afterwards: on_soil(on_bearings(…)[0], …)"
        raise InvalidInput("building", "", rule)
    weight = gravity * (base_mass + sum(storey.mass for storey in above.storeys))
    with renamed(names={"mass": "base_mass", "heights.0": "height"}):
        base = bearing.storey(base_mass, weight, gravity)
        storeys, heights = (base, *above.storeys), (height, *above.heights)
        n = above.n_bearings + 1
        on_bearings = replace(above, storeys=storeys, heights=heights, n_bearings=n)
    between = bearing.between(weight)
    link = wall.link if wall else partial(FloorLink, floor=0, next_building=GROUND)
    higher = [
        replace(x, floor=x.floor + 1)
        if x.other_floor < GROUND  # another support
        else replace(x, floor=x.floor + 1, next_floor=x.other_floor + 1, next_building=number)
        for x in links  # GROUND is one below floor 0
    ]
    of_base = [link(number, **between)] if wall or between else []
    return on_bearings, (*higher, *of_base)
