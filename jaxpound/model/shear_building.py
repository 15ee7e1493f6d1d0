"""A building of several storeys in SI units."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxpound import _checks
from jaxpound._checks import (
    Range,
    Rule,
    as_tuple,
    count,
    enforce,
    is_traced,
    is_whole,
    number,
    positive_number,
)
from jaxpound._errors import InvalidInput, renamed
from jaxpound._fields import check, part, pytree_dataclass, static, unchecked
from jaxpound.model.building import ORDER_BY_DEFAULT, ROD, Building
from jaxpound.model.dampers import Dashpot
from jaxpound.model.damping import ModalDamping, Rayleigh, normal_modes
from jaxpound.model.hysteresis import Bilinear
from jaxpound.model.rod import Spring
from jaxpound.model.soil import Footing, SoilEffect
from jaxpound.model.strength import storey_shears, with_weight
from jaxpound.model.structures import Storeys, require_storeys, storey_ends
from jaxpound.model.system import Rod
from jaxpound.model.topology import GROUND, Ends
from jaxpound.model.vibration import Modes, first_frequency, modes
from jaxpound.quantities import STANDARD_GRAVITY

TAPER = Range(1e-3, 1e3, "", "top storey's over first's")
HEIGHT = Range(0.01, 100, "m", "of a storey, of models too")
STRENGTHS = {
    "yield_force": Range(1e-6, 1e12, "N", "from models to ten times the weight of a tower"),
    "base_shear_coefficient": Range(1e-4, 100, "", "of the weight of the building"),
    "yield_drift": Range(1e-6, 1, "", "of the height of a storey; 0.005 is 0.5 %"),
}
"""Ranges of the strength of storeys that yield, by the argument that states it."""


@pytree_dataclass
class ShearBuilding:
    """A building of storeys with rigid floors, in SI units, from the ground up.

    Each storey is a ``Building`` of one block: the mass of its floor, on the rod of the storey
    below that floor. ``of_storeys`` makes one from lists of numbers, ``from_period`` from a period
    and a damping ratio, ``published`` has examples of the literature.

    Raises ``ValueError`` if there is no storey, or there are not as many heights as storeys.

    Parameters
    ----------
    storeys
        The storeys, from the ground up.
    heights
        Height > 0 of each storey, m, or one for all; 3 m by default. They decide which floors of
        neighbours meet, and figures draw them; the motion they affect on soil only.
    n_tuned
        How many of the last storeys are tuned masses (``tuned_mass_damper``) on their rods: these
        are no floors and no storeys of the building. None by default. A link names the first as the
        floor above the roof.
    damping
        ``Rayleigh``'s or ``ModalDamping``, beside that of the storeys' rods; None by default. It
        leaves out tuned masses and bearings.
    n_bearings
        How many of the first storeys are bearings (``on_bearings``), which ``damping`` leaves out:
        it acts on what stands on them as if that stood on the ground. None by default.
    footing
        The ``Footing`` on soil (``on_soil``); None, the default, for rigid ground. ``damping`` then
        acts on velocities relative to the rigid motion of the footing; its α and β are those by the
        modes on rigid ground. Periods and modes are those on soil, whose last two numbers of a
        shape are the footing and its rotation, the displacement of a lever of 1 m. A link names the
        footing as the floor above all others.

    Examples
    --------
    >>> building = jp.ShearBuilding.from_period(5, 300e3, period=0.6, damping_ratio=0.05)
    >>> building.elevations.tolist()
    [3.0, 6.0, 9.0, 12.0, 15.0]
    >>> modes = building.modes()  # of free vibrations; the period of steady ones is 0.6 s
    >>> round(float(modes.periods[0]), 4), round(float(modes.damping_ratios[0]), 4)
    (0.5992, 0.0512)
    """

    storeys: tuple[Building, ...] = part(Building, each=True)
    heights: tuple[float, ...] = static(default=3.0)
    n_tuned: int = static(default=0, listed=bool)
    damping: Any = part(Rayleigh, ModalDamping, default=None, listed=bool)
    n_bearings: int = static(default=0, listed=bool)
    footing: Footing | None = part(Footing, default=None, listed=bool)

    def __post_init__(self) -> None:
        check(self)
        require_storeys("storeys", self.storeys, self.n_tuned)
        if not (is_whole(self.n_bearings) and 0 <= self.n_bearings < self.n_floors):
            rule = f"must be a whole number from 0 to {self.n_floors - 1}"
            raise InvalidInput("n_bearings", repr(self.n_bearings), rule)
        if self.damping is not None:
            with renamed("damping"):
                self.damping.require_modes(self.n_floors - self.n_bearings)
        if self.footing is not None:
            self.footing.require_below([storey.mass for storey in self.storeys])
        heights = _each("heights", self.heights, len(self.storeys))
        for i, height in enumerate(heights):
            name = f"heights.{i}"
            if is_traced(positive_number(**{name: height})):
                rule = "must be known, not traced: it decides which floors meet"
                raise InvalidInput(name, "", rule)
            enforce([HEIGHT.of(name, height)])
        object.__setattr__(self, "heights", tuple(map(float, heights)))

    @classmethod
    def of_storeys(
        cls,
        masses: Any,
        stiffnesses: Any,
        order: Any = None,
        tau_f: Any = None,
        tau_x: Any = None,
        heights: Any = 3.0,
        *,
        yield_force: Any = None,
        hardening: Any = 0.0,
        dashpots: Any = None,
        damping: Any = None,
    ) -> ShearBuilding:
        """A building from its floors' masses and its storeys' rods.

        Raises ``ValueError`` if lengths differ.

        Parameters
        ----------
        masses
            Mass of each floor, kg, from the ground up.
        stiffnesses
            Long-time stiffness of each storey, N/m, or one for all.
        order, tau_f, tau_x
            The rods, as in ``Building``: a number for each storey, or one for all. Without them the
            storeys are springs.
        heights, damping
            As in ``ShearBuilding``.
        dashpots
            Of each storey, or one for all, N s/m, as in ``Building``; by default there are none.
        yield_force, hardening
            Of each storey, or one for all, if they yield (``yielding``); by default they do not.

        Examples
        --------
        >>> masses, stiffnesses = [300e3, 300e3, 250e3], [4e8, 3.5e8, 3e8]
        >>> jp.ShearBuilding.of_storeys(masses, stiffnesses, 0.5, 1e-3, 0.05).n_floors
        3
        """
        masses = as_tuple("masses", masses)
        n = len(masses)
        rods = {"stiffnesses": stiffnesses, "order": order, "tau_f": tau_f, "tau_x": tau_x}
        listed = [_each(name, value, n) for name, value in rods.items()]
        listed += [(None,) * n, _each("dashpots", dashpots, n)]
        storeys = []
        for i, numbers in enumerate(zip(masses, *listed, strict=True)):
            with renamed(f"storeys.{i}"):
                storeys.append(Building(*numbers))
        building = cls(tuple(storeys), _each("heights", heights, n), damping=damping)
        if yield_force is None:
            return building
        return building.yielding(yield_force=yield_force, hardening=hardening)

    @classmethod
    def from_period(
        cls,
        n_storeys: int,
        storey_mass: Any,
        period: Any,
        damping_ratio: Any = None,
        order: Any = ORDER_BY_DEFAULT,
        tau_f: Any = None,
        *,
        taper: float = 1.0,
        height: Any = 3.0,
        damping: Any = None,
    ) -> ShearBuilding:
        """A building with this period and damping ratio of the first mode.

        The stiffnesses of the storeys, in the ratios that ``taper`` states, are scaled to the
        period. All storeys have the order and the relaxation times of the rod of
        ``Building.from_period``, on which one block has the same period and damping ratio. With
        ``order=None`` they are springs and dashpots; the damping is proportional to the stiffness.

        Raises ``ValueError`` if there are not as many masses or heights as storeys, if not one of
        ``damping_ratio`` and ``damping`` is stated, or as ``Building.from_period``.

        Parameters
        ----------
        n_storeys
            Number of storeys, at least 1.
        storey_mass
            Mass > 0 of each floor, kg, from the ground up, or one for all.
        period, damping_ratio, order, tau_f
            As in ``Building.from_period``; period and ratio of the first mode.
        taper
            Stiffness of the top storey over that of the first > 0; those between vary linearly.
        height
            Height > 0 of each storey, m, from the ground up, or one for all.
        damping
            As in ``ShearBuilding``, in the place of a ratio; the storeys are then springs.

        Examples
        --------
        Seven floors of 300 t and a lighter roof, on a first storey that is higher:

        >>> masses, heights = [300e3] * 7 + [200e3], [4.0] + [3.2] * 7
        >>> frame = jp.ShearBuilding.from_period(8, masses, 1.1, 0.05, height=heights)
        >>> round(float(frame.natural_period), 6), round(float(frame.elevations[-1]), 6)
        (1.1, 26.4)
        """
        n = count("n_storeys", n_storeys)
        floors = enumerate(_each("storey_mass", storey_mass, n))
        masses = positive_number(**{f"storey_mass.{i}": mass for i, mass in floors})
        heights = _each("height", height, n)
        taper = number("taper", taper)
        if is_traced(taper):
            rule = "must be known, not traced: the modes' shapes follow"
            raise InvalidInput("taper", "", rule)
        positive = Rule("taper", taper, (taper > 0) & np.isfinite(taper), "positive, finite")
        enforce([positive, TAPER.of("taper", taper)])
        shares = np.linspace(1.0, float(taper), n)
        if (damping is None) == (damping_ratio is None):
            rule = "must be one of damping_ratio and damping: the other is None"
            raise InvalidInput("damping_ratio", str(damping_ratio), rule)
        with renamed(names={"mass": "storey_mass"}):
            block = Building.from_period(masses[0], period, damping_ratio, order, tau_f)
            frequencies, _ = normal_modes([m / masses[0] for m in masses], [*shares])
            unit = block.stiffness / frequencies[..., 0] ** 2
            rod: dict[str, Any] = {name: getattr(block, name) for name in ROD}
            storeys = [Building(m, unit * x, **rod) for m, x in zip(masses, shares, strict=True)]
            if block.dashpot is not None:
                time = block.dashpot / block.stiffness
                storeys = [dataclasses.replace(x, dashpot=time * x.stiffness) for x in storeys]
        return cls(tuple(storeys), heights, damping=damping)

    @classmethod
    def published(cls, name: str) -> ShearBuilding:
        """A building of the literature, with fractional rods of 5 % damping in the first mode.

        Raises ``ValueError`` if there is no such building.

        Parameters
        ----------
        name
            "chopra-5": the uniform five-storey shear frame of Chopra, Dynamics of Structures,
            section 12.8 (100 kips a floor, 31.54 kips/in. a storey, storeys of 12 ft; 2 s).
            "jankowski-left" and "jankowski-right": the two three-storey buildings of Jankowski
            (Earthquake-induced pounding between equal height buildings with substantially
            different dynamic properties, Engineering Structures 30, 2008), of 25 t a floor
            (1.2 s) and 1,000 t a floor (0.3 s); heights are not those of the paper, but 3 m.
            The first period is that of the source; higher ones are shorter than those of its
            elastic frame, since fractional rods stiffen with the frequency.

        Examples
        --------
        >>> jp.ShearBuilding.published("chopra-5").modes().periods.round(4).tolist()
        [1.9977, 0.6585, 0.408, 0.3128, 0.2718]
        """
        if not isinstance(name, str) or name not in _PUBLISHED:
            rule = f"unknown name {name!r}; {_checks.hint(str(name), _PUBLISHED)}"
            raise InvalidInput("", "", rule)
        n, mass, stiffness, height = _PUBLISHED[name]
        elastic = 2 * np.sin(np.pi / (4 * n + 2)) * np.sqrt(stiffness / mass)
        return cls.from_period(n, mass, 2 * np.pi / elastic, 0.05, height=height)

    def yielding(
        self,
        law: Any = Bilinear,
        *,
        yield_force: Any = None,
        base_shear_coefficient: Any = None,
        yield_drift: Any = None,
        gravity: Any = STANDARD_GRAVITY,
        **numbers: Any,
    ) -> ShearBuilding:
        """The building with storeys that yield, at one of three strengths.

        Raises ``ValueError`` if not exactly one strength is given, or a number breaks its rule.

        Parameters
        ----------
        law
            ``Bilinear``, ``BoucWen`` or another class of a ``HysteresisLaw``.
        yield_force
            f_y > 0 of each storey, N, or one for all: its yield displacement is f_y over its
            stiffness.
        base_shear_coefficient
            f_y of the first storey over the weight of the building; those above are in proportion
            to their shears under loads that grow with mass and height.
        yield_drift
            Drift at yield over the height of the storey: about .005 of concrete frames, .01 of
            steel frames.
        gravity
            g > 0, m/s², of the weight.
        **numbers
            Further parameters of the law, such as ``hardening``: of each storey, or one for all.

        Examples
        --------
        >>> frame = jp.ShearBuilding.from_period(3, 300e3, period=0.5, damping_ratio=0.05)
        >>> weak = frame.yielding(base_shear_coefficient=0.12, hardening=0.03)
        >>> [round(s.stiffness * s.hysteresis.yield_displacement / 1e3) for s in weak.storeys]
        [1059, 883, 530]
        """
        strengths = zip(STRENGTHS, (yield_force, base_shear_coefficient, yield_drift), strict=True)
        if len(stated := {name: x for name, x in strengths if x is not None}) != 1:
            name = f"a strength by {' and '.join(stated) or 'nothing'}"
            raise InvalidInput(name, "", f"must be by one of {', '.join(STRENGTHS)}")
        ((name, value),), n = stated.items(), self.n_floors
        yielding, tuned = self.storeys[:n], self.storeys[n:]
        if self.n_bearings and (isinstance(value, str) or not isinstance(value, Sequence)):
            rule = "must be a list with a number for each storey of a building on bearings, which "
            raise InvalidInput(name, str(value), rule + "are a storey; or of it before on_bearings")
        values = [_checks.real(name, x) for x in _each(name, value, n)]
        enforce([STRENGTHS[name].of(name, x) for x in values])
        if base_shear_coefficient is not None:
            weight = gravity * sum(storey.mass for storey in yielding)
            values = storey_shears(yielding, self.elevations, values[0] * weight)
        if yield_drift is not None:
            lengths = [x * height for x, height in zip(values, self.heights, strict=False)]
        else:
            lengths = [force / x.stiffness for force, x in zip(values, yielding, strict=True)]
        listed = {key: _each(key, x, n) for key, x in numbers.items()}
        listed["yield_displacement"] = tuple(lengths)
        laws = [law(**{key: x[i] for key, x in listed.items()}) for i in range(n)]
        storeys = map(lambda x, y: dataclasses.replace(x, hysteresis=y), yielding, laws)
        return dataclasses.replace(self, storeys=(*storeys, *tuned))

    def with_p_delta(self, gravity: Any = STANDARD_GRAVITY) -> ShearBuilding:
        """The building under its own weight, which acts at the drift of its storeys (P–Δ).

        The weight above each storey over its height is taken from the stiffness before and after
        yield; the forces of the storeys include it. On soil it does not act at the rotation of the
        footing. Raises ``ValueError`` if the weight buckles a storey, or hardening becomes negative
        and the law has no finite ``ultimate_displacement``.
        """
        above = np.cumsum([storey.mass for storey in self.storeys][::-1])[::-1]
        if is_traced(above):
            raise InvalidInput("masses", "", "must be known, not traced")
        n = self.n_floors
        lighter = self._with_own_dashpots()
        storeys = map(with_weight, lighter.storeys[:n], gravity * above, self.heights)
        return dataclasses.replace(lighter, storeys=(*storeys, *self.storeys[n:]))

    def _with_own_dashpots(self) -> ShearBuilding:
        """The same, where a change of stiffness leaves β K of ``damping`` as it is."""
        if not isinstance(self.damping, Rayleigh):
            return self
        first, n = self.n_bearings, self.n_floors
        alpha, beta = self.damping.coefficients(*self._above_bearings())
        dashpots = [0.0 if x.dashpot is None else x.dashpot for x in self.storeys[first:n]]
        pairs = zip(self.storeys[first:n], dashpots, strict=True)
        damped = [dataclasses.replace(x, dashpot=c + beta * x.stiffness) for x, c in pairs]
        storeys = *self.storeys[:first], *damped, *self.storeys[n:]
        return dataclasses.replace(self, storeys=storeys, damping=Rayleigh(mass=alpha))

    def _above_bearings(self) -> tuple[list[Any], list[Any]]:
        """Masses and stiffnesses of the storeys that ``damping`` is of."""
        storeys = self.storeys[self.n_bearings : self.n_floors]
        return [x.mass for x in storeys], [x.stiffness for x in storeys]

    @property
    def n_floors(self) -> int:
        """Number of floors and of storeys."""
        return len(self.storeys) - self.n_tuned

    @property
    def n_ends(self) -> int:
        """Number of masses that links may join: floors, tuned masses and a footing."""
        return len(self.storeys) + (self.footing is not None)

    @property
    def elevations(self) -> np.ndarray:
        """Height of each floor above the ground, m, shape (n_floors,)."""
        return np.cumsum(self.heights)[: self.n_floors]

    @property
    def natural_period(self) -> float:
        """Equivalent natural period of the first mode, in steady vibration, s."""
        return 2 * np.pi / first_frequency(in_units(self, 1.0, 1.0, 1.0))

    def modes(self) -> Modes:
        """Natural frequencies, damping ratios and shapes (``jp.modes``); in rad/s."""
        return dataclasses.replace(modes(in_units(self, 1.0, 1.0, 1.0)), si=True)

    def soil_effect(self) -> SoilEffect:
        """The first mode on soil beside that on rigid ground; prints as a table.

        Overdamped modes, as those of light footings on soft soil are, do not count. Raises
        ``ValueError`` if the building is not on soil, traced, a batch, or no mode vibrates.

        Examples
        --------
        >>> frame = jp.ShearBuilding.of_storeys([500e3], 19.74e6, heights=10, dashpots=314e3)
        >>> clay = jp.Soil(shear_wave_velocity=150, density=1800, poisson_ratio=1 / 3)
        >>> jp.on_soil(frame, clay, radius=6, footing_mass=200e3).soil_effect()
        First mode on soil
                           on rigid ground  on soil
            period (s)                   1    1.036
            damping ratio          0.04997  0.04869
            ratio of periods 1.0361, damping ratio added by radiation 0.0038
        """
        if self.footing is None:
            raise InvalidInput("footing", "None", "must be stated: on_soil(building, soil, …)")
        on_soil = in_units(self, 1.0, 1.0, 1.0)
        without = dataclasses.replace(on_soil, damping=on_soil.damping[:-2])  # sway and rocking
        fixed = dataclasses.replace(self, footing=None).modes()
        (fixed_period, fixed_ratio), (period, ratio), (_, own) = (
            _first_that_vibrates(x) for x in (fixed, modes(on_soil), modes(without))
        )
        return SoilEffect(fixed_period, fixed_ratio, period, ratio, own)


def in_units(
    building: Building | ShearBuilding, mass: Any, stiffness: Any, frequency: Any, length: Any = 1.0
) -> Storeys:
    """A building in SI in units of a mass, kg, stiffness, N/m, frequency, rad/s, and length, m."""
    storeys = building.storeys
    numbers = [(s.material(frequency, length), s.stiffness / stiffness) for s in storeys]
    masses, dashpots = [s.mass / mass for s in storeys], _dashpots(building)
    parts: dict[str, Any] = {"n_tuned": building.n_tuned}
    if isinstance(building, ShearBuilding) and (footing := building.footing) is not None:
        parts["heights"], n = building.heights, len(storeys)
        masses += [footing.mass / mass, footing.rotational_inertia / mass]  # of 1 m
        springs = footing.sway_stiffness / stiffness, footing.rocking_stiffness / stiffness
        numbers += [(Spring(), k) for k in springs]
        radiation = footing.sway_damping, footing.rocking_damping
        dashpots += [
            ((n + x, GROUND), unchecked(Dashpot, coefficient=c)) for x, c in enumerate(radiation)
        ]
    rods = (unchecked(Rod, material=law, stiffness=k, ends=None) for law, k in numbers)
    parts |= {"masses": tuple(masses), "rods": tuple(rods)}
    undamped = unchecked(Storeys, **parts, damping=())
    unit, damping = mass * frequency, list[Rod]()
    for ends, dashpot in dashpots:
        material = unchecked(type(dashpot), coefficient=dashpot.coefficient / unit)
        damping.append(unchecked(Rod, material=material, **undamped.between(*ends)))
    return unchecked(Storeys, **parts, damping=tuple(damping))


def _first_that_vibrates(modes: Modes) -> tuple[float, float]:
    """Period and damping ratio of the first mode that is not overdamped."""
    if modes.overdamped.all():
        raise InvalidInput("building", "", "must vibrate: all its modes are overdamped")
    first = int(modes.overdamped.argmin())
    return float(modes.periods[first]), float(modes.damping_ratios[first])


def _dashpots(building: Building | ShearBuilding) -> list[tuple[Ends, Any]]:
    """Ends by floor, from 0, and material of the dashpots in a building, in N s/m."""
    dashpots = [
        (storey_ends(i), unchecked(Dashpot, coefficient=storey.dashpot))
        for i, storey in enumerate(building.storeys)
        if storey.dashpot is not None
    ]
    if isinstance(building, ShearBuilding) and building.damping is not None:
        first = building.n_bearings
        inherent = building.damping.dashpots(*building._above_bearings())
        dashpots += [((first + i, first + j), x) for (i, j), x in inherent]  # GROUND is below 0
    return dashpots


_KIP = 4448.2216  # N
_INCH = 0.0254  # m

# Number of storeys, mass of a floor (kg), stiffness of a storey (N/m), its height (m).
_PUBLISHED: dict[str, tuple[int, float, float, float]] = {
    "chopra-5": (5, 100 * _KIP / 9.80665, 31.54 * _KIP / _INCH, 144 * _INCH),
    "jankowski-left": (3, 25e3, 3.46e6, 3.0),
    "jankowski-right": (3, 1000e3, 2.215e9, 3.0),
}


def _each(name: str, value: Any, n: int) -> tuple[Any, ...]:
    """A number for each of n storeys, from a list or from one number for all."""
    if value is None or (not isinstance(value, Sequence) and jnp.ndim(value) == 0):
        return (value,) * n
    if len(listed := as_tuple(name, value)) != n:
        rule = f"must be {n}, a number for each storey, or one for all"
        raise InvalidInput(f"{name}, {len(listed)} of them,", "", rule)
    return listed
