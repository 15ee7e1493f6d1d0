"""Footings on soil: sway and rocking with radiation of waves, by the cone model; in SI units."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp

from jaxpound._checks import Range, Rule, enforce
from jaxpound._errors import InvalidInput
from jaxpound._extrema import larger, smaller
from jaxpound._fields import BatchInSI, parameter, part, pytree_dataclass
from jaxpound._tables import Shown, TextTable

_VELOCITY = Range(20, 1e4, "m/s", "100 of soft clay, 300 of gravel, 800 and more of rock")
_DENSITY = Range(500, 5000, "kg/m³", "1,500 to 2,200 of soils")
_SIZE = Range(0.05, 500, "m", "of a footing, of models too")
_DEPTH = Range(0, 100, "m", "below the surface")
_MASS = Range(1e-3, 1e10, "kg", "about that of a floor")
_INERTIA = Range(1e-6, 1e14, "kg m²", "m r²/4 of a disk")
_MASSLESS = "steps follow the footing's own motion, and that of a massless one is infinitely fast"
_LIGHTEST = 1e-4  # of the mass on it: steps shorten with the square root


@pytree_dataclass
class Soil(BatchInSI):
    """A uniform elastic halfspace, in SI units.

    Raises ``ValueError`` if a known value breaks its rule.

    Parameters
    ----------
    shear_wave_velocity
        V_s > 0, m/s, at the strains of strong shaking.
    density
        ρ > 0, kg/m³.
    poisson_ratio
        ν, from 0 to 0.5 of saturated clay. Above 1/3 a mass of soil rocks along with a footing,
        which is left out, and V_p stays 2 V_s.

    Examples
    --------
    >>> sand = jp.Soil(shear_wave_velocity=200, density=1800, poisson_ratio=0.3)
    >>> f"{sand.shear_modulus / 1e6:.0f} MPa"
    '72 MPa'
    """

    shear_wave_velocity: Any = parameter("V_s", above=0, within=_VELOCITY)
    density: Any = parameter(r"\rho", above=0, within=_DENSITY)
    poisson_ratio: Any = parameter(r"\nu", least=0, most=0.5)

    @property
    def shear_modulus(self) -> Any:
        """G = ρ V_s², Pa."""
        return self.density * self.shear_wave_velocity**2

    @property
    def axial_wave_velocity(self) -> Any:
        """V_p of waves below a footing that rocks, m/s: at most 2 V_s (Wolf 1994)."""
        ratio = smaller(jnp.asarray(self.poisson_ratio), 1 / 3)
        return self.shear_wave_velocity * jnp.sqrt(2 * (1 - ratio) / (1 - 2 * ratio))


@pytree_dataclass
class Footing(BatchInSI):
    r"""A rigid footing on soil, a disk or a rectangle, in SI units; ``on_soil`` makes one.

    Stiffnesses of a disk are :math:`K_h = 8 G r/(2-ν)` and :math:`K_r = 8 G r^3/(3(1-ν))`, those of
    a rectangle after Pais and Kausel (1988; NIST GCR 12-917-21, tables 2-2a and 2-2b). Its dashpots
    are those of waves below it, :math:`C_h = ρ V_s A` and :math:`C_r = ρ V_p I` with area and
    second moment of area of its base (Wolf 1994). They do not depend on the frequency.

    Raises ``ValueError`` if a known value breaks its rule, or the base is not one of the two.

    Parameters
    ----------
    soil
        The soil.
    mass
        Mass > 0, kg.
    radius
        Radius > 0 of a disk, m.
    length, width
        In its place, sides > 0 of a rectangle along and across the motion, m.
    embedment
        Depth ≥ 0 of the base of a rectangle, whose sides are in contact, m; 0 by default. It adds
        to stiffness only.
    inertia
        Of the footing alone about its axis, kg m²; by default that of a thin plate, m r²/4 of a
        disk.

    Examples
    --------
    >>> sand = jp.Soil(shear_wave_velocity=200, density=1800, poisson_ratio=0.3)
    >>> footing = jp.model.Footing(sand, 200e3, radius=6.0)
    >>> f"{footing.sway_stiffness:.4g} N/m, {footing.rocking_stiffness:.4g} N m"
    '2.033e+09 N/m, 5.925e+10 N m'
    """

    soil: Soil = part(Soil)
    mass: Any = parameter("m_f", above=0, within=_MASS, why=_MASSLESS)
    radius: Any = parameter("r", above=0, within=_SIZE, default=None)
    length: Any = parameter("L", above=0, within=_SIZE, default=None)
    width: Any = parameter("B", above=0, within=_SIZE, default=None)
    embedment: Any = parameter("D", least=0, within=_DEPTH, default=None)
    inertia: Any = parameter("I_f", above=0, within=_INERTIA, default=None, why=_MASSLESS)

    def __post_init__(self) -> None:
        for name in ("length", "width"):
            if ((side := getattr(self, name)) is None) == (self.radius is None):
                rule = "must be stated, or radius: a rectangle has both sides"
                rule = rule if side is None else "must be left out beside radius"
                raise InvalidInput(name, str(side), rule)
        if self.embedment is not None and self.radius is not None:
            rule = "must be left out beside radius: it is that of a rectangle"
            raise InvalidInput("embedment", str(self.embedment), rule)
        super().__post_init__()

    def require_below(self, masses: Sequence[Any]) -> None:
        """An ``InvalidInput`` for a footing that is too light for the masses on it, kg.

        Or of less inertia than a thin plate of the lightest footing has.
        """
        least = _LIGHTEST * sum(masses)
        share = f"{_LIGHTEST:g} times the mass of floors and tuned masses ({_MASSLESS})"
        rules = [Rule("footing.mass", self.mass, self.mass >= least, f"at least {share}")]
        if self.inertia is not None:
            plate = least * self.second_moment / self.area
            says = f"at least that of a thin plate of {share}"
            rules.append(Rule("footing.inertia", self.inertia, self.inertia >= plate, says))
        enforce(rules)

    @property
    def area(self) -> Any:
        """A of the base, m²."""
        return self.length * self.width if self.radius is None else math.pi * self.radius**2

    @property
    def second_moment(self) -> Any:
        """Second moment of area of the base about the axis of rocking, m⁴."""
        if self.radius is None:
            return self.width * self.length**3 / 12
        return math.pi * self.radius**4 / 4

    @property
    def rotational_inertia(self) -> Any:
        """Of the footing about the axis of rocking, kg m²."""
        thin = self.mass * self.second_moment / self.area
        return thin if self.inertia is None else self.inertia

    @property
    def sway_stiffness(self) -> Any:
        """K_h, N/m."""
        if self.radius is not None:
            return 8 * self._stiffness(2) * self.radius
        half, slender, is_along = self._rectangle
        along = 6.8 * slender**0.65 + 2.4
        across = 6.8 * slender**0.65 + 0.8 * slender + 1.6
        deeper = 0.33 + 1.34 / (1 + slender)
        shape = jnp.where(is_along, along, across)
        return self._stiffness(2) * half * shape * (1 + deeper * self._depth(half, 0.8))

    @property
    def rocking_stiffness(self) -> Any:
        """K_r, N m."""
        if self.radius is not None:
            return 8 / 3 * self._stiffness(1) * self.radius**3
        half, slender, is_along = self._rectangle
        shape = jnp.where(is_along, 3.73 * slender**2.4 + 0.27, 3.2 * slender + 0.8)
        deeper = 1.6 / (0.35 + jnp.where(is_along, slender**4, slender))
        factor = 1 + self._depth(half, 1) + deeper * self._depth(half, 2)
        return self._stiffness(1) * half**3 * shape * factor

    @property
    def sway_damping(self) -> Any:
        """C_h, N s/m."""
        return self.soil.density * self.soil.shear_wave_velocity * self.area

    @property
    def rocking_damping(self) -> Any:
        """C_r, N m s."""
        return self.soil.density * self.soil.axial_wave_velocity * self.second_moment

    def _stiffness(self, times: int) -> Any:
        """G/(times − ν)."""
        return self.soil.shear_modulus / (times - self.soil.poisson_ratio)

    @property
    def _rectangle(self) -> tuple[Any, Any, Any]:
        """Half of the shorter side, the longer over it, and whether motion is along the longer."""
        length, width = jnp.asarray(self.length), jnp.asarray(self.width)
        shorter = smaller(length, width)
        return shorter / 2, larger(length, width) / shorter, length >= width

    def _depth(self, half: Any, power: float) -> Any:
        """A power of the depth over half of the shorter side; 0 where there is none."""
        if self.embedment is None:
            return 0.0
        depth = jnp.where(self.embedment > 0, self.embedment, 1.0)
        return jnp.where(self.embedment > 0, (depth / half) ** power, 0.0)


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class SoilEffect(Shown):
    """The first mode of a building on soil beside that on rigid ground."""

    fixed_period: float
    """Natural period on rigid ground, s."""
    fixed_damping_ratio: float
    """Damping ratio on rigid ground."""
    period: float
    """Natural period on soil, s."""
    damping_ratio: float
    """Damping ratio on soil."""
    own_damping_ratio: float
    """Damping ratio on soil without the soil's dashpots: what is left of the building's own."""

    @property
    def period_ratio(self) -> float:
        """The period on soil over that on rigid ground."""
        return self.period / self.fixed_period

    @property
    def added_damping(self) -> float:
        """What radiation of waves adds to the damping ratio that is left of the building's own.

        Of a viscous oscillator on a light footing, that on rigid ground is left over the cube of
        the ratio of periods (Veletsos and Nair 1975; NIST GCR 12-917-21, equation 2-6).
        """
        return self.damping_ratio - self.own_damping_ratio

    def _tables(self) -> list[TextTable]:
        rows = [
            ("period (s)", self.fixed_period, self.period),
            ("damping ratio", self.fixed_damping_ratio, self.damping_ratio),
        ]
        notes = [
            f"ratio of periods {self.period_ratio:.5g}, "
            f"damping ratio added by radiation {self.added_damping:.2g}"
        ]
        columns = "", "on rigid ground", "on soil"
        return [TextTable("First mode on soil", columns, rows, notes, digits=4)]
