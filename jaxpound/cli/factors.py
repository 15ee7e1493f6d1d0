"""Parameters as factors on the values of a file: their SI values and plausible ranges."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from statistics import NormalDist
from typing import Annotated, Any, Literal

import jax
import numpy as np

import jaxpound as jp
from jaxpound.cli.pair import UNITS, Building, Damper
from jaxpound.cli.reading import Range, Table, between, keyed, named, ranges
from jaxpound.cli.structures import Structured
from jaxpound.cli.tables import LAWS, Contact, Stated
from jaxpound.model.parameters import get, paths, put
from jaxpound.model.rod import ZenerRod
from jaxpound.study.distributions import RARE

FACTOR = Range(0, 1e6, "", "a factor on the value above")
Factor = Annotated[float, between(*FACTOR)]
_OF_CONTACT = tuple(dict.fromkeys(path for law in LAWS.values() for path in paths(law)))
Parameter = Annotated[
    str, keyed((*paths(jp.AdjacentStructures), *(f"contact.{path}" for path in _OF_CONTACT)))
]
"""Path of a parameter of the dimensionless system, and of any law of contact."""


class Bounds(Table):
    """Bounds of a variable, as factors on the value that the file states."""

    low: Factor
    high: Factor
    scale: Literal["linear", "log"] = "linear"

    def __post_init__(self) -> None:
        with named(""):
            self.times(1.0)
        if not self.low <= 1 <= self.high:
            rule = "must hold the factor 1 between them"
            raise ValueError(f"low and high {rule}: the search starts at the buildings as they are")

    def __str__(self) -> str:
        return f'{{low = {self.low:g}, high = {self.high:g}, scale = "{self.scale}"}}'

    def times(self, value: float) -> jp.Bounds:
        """The bounds of the parameter itself, from its stated value."""
        return jp.Bounds(self.low * value, self.high * value, self.scale)


_STANDS_FOR = {
    "friction": ("[damper] friction_force", ranges(Damper)["friction_force"]),
    "initial_gap": ("gap", ranges(Structured)["gap"]),
    "mass_ratio": ("[building_2] mass", ranges(Building)["mass"]),
    "stiffness_ratio": ("[building_2] stiffness", ranges(Building)["stiffness"]),
    **{
        f"rod_{i}.{key}": (f"[building_{i}] {key}", ranges(Building)[key])
        for i in (1, 2)
        for key in ("order", "tau_f", "tau_x")
    },
    **{f"contact.{key}": (f"[contact] {key}", ranges(Contact)[key]) for key in _OF_CONTACT},
}
"""The key in a file that corresponds to each dimensionless parameter, and its range."""


def in_si(structures: jp.AdjacentStructures, scales: jp.Scales) -> jp.AdjacentStructures:
    """The same parameters in SI units: relaxation times in s^order, slip force in N, gap in m.

    Stiffness of contact is in N/m, or N/m^1.5 for laws after Hertz. Rules are the same in every
    unit, so that error messages have the units of the file.
    """
    left, right, friction_force, gap = scales.buildings(structures)
    return dataclasses.replace(
        structures,
        rod_1=ZenerRod(left.order, left.tau_f, left.tau_x),
        rod_2=ZenerRod(right.order, right.tau_f, right.tau_x),
        friction=friction_force,
        initial_gap=gap,
        contact=scales.contact_to_si(structures.contact),
    )


def uncertain_structures(
    place: str,
    table: Mapping[str, Stated],
    nominal: jp.AdjacentStructures,
    scales: jp.Scales,
) -> jp.UncertainStructures:
    """Structures whose parameters are multiples of the nominal ones by random factors."""
    for path, factor in table.items():
        factor.require(f"{place} {path}", FACTOR)
    parameters = in_si(nominal, scales)
    distributions = _multiples(place, table, parameters)
    with named(f"{place}, in SI units:"):
        physical = jp.UncertainStructures(parameters, distributions)
    # Each parameter at both ends of its range, the others at their medians.
    z = NormalDist().inv_cdf(RARE)
    ends = np.array([z, -z])[:, None, None] * np.eye(len(table))
    rows = jax.jit(jax.vmap(jax.vmap(physical.parameters)))(ends)
    extremes = []
    for i, (path, factor) in enumerate(table.items()):
        where = f"{place} {path} = {factor}, once in {1 / RARE:,.0f} draws:"
        for end in (0, 1):
            with named(where):
                at = put(parameters, {x: float(rows[x][end, i]) for x in table})
            extremes.append((where, path, at))
    _require_plausible(extremes, scales)
    return jp.UncertainStructures(nominal, _multiples(place, table, nominal))


def design_space(
    place: str,
    table: Mapping[str, Bounds],
    nominal: jp.AdjacentStructures,
    scales: jp.Scales,
) -> jp.DesignSpace:
    """Structures whose parameters may be chosen between multiples of the nominal ones."""
    # In SI units first, for messages in the units of the file.
    parameters = in_si(nominal, scales)
    bounds = _multiples(place, table, parameters)
    with named(place, UNITS):
        physical = jp.DesignSpace(parameters, bounds)
        start = physical.shares(parameters)
    extremes = []
    for i, path in enumerate(physical.names):
        for end in (0.0, 1.0):
            shares = start.copy()
            shares[i] = end
            values = {x: float(y) for x, y in physical.numbers(shares).items()}
            where = f"{place} {path} = {table[path]}, at a bound:"
            extremes.append((where, path, put(parameters, values)))
    _require_plausible(extremes, scales)
    return jp.DesignSpace(nominal, _multiples(place, table, nominal))


def _multiples(
    place: str, table: Mapping[str, Stated | Bounds], structures: jp.AdjacentStructures
) -> dict[str, Any]:
    """The distributions or bounds of the parameters themselves, by path."""
    made = {}
    for path, factor in table.items():
        if path.startswith("contact.") and path not in (known := paths(structures)):
            own = [x.removeprefix("contact.") for x in known if x.startswith("contact.")]
            what = f"which has {', '.join(own)}" if own else "and the file has no [contact]"
            raise ValueError(f"{place} {path} must be a parameter of the law of contact, {what}")
        if not (value := float(get(structures, path))):
            raise ValueError(f"{place} {path} must be of a value above 0, for factors on it")
        with named(f"{place} {path}:"):
            made[path] = factor.times(value)
    return made


def _require_plausible(
    extremes: Iterable[tuple[str, str, jp.AdjacentStructures]], scales: jp.Scales
) -> None:
    """A ``ValueError`` for a parameter that can leave the plausible range of its key.

    ``extremes`` are a place in a file, the path of a parameter, and the structures in SI units
    (``in_si``) where it has an extreme value. Natural periods, which depend on all parameters of a
    building, are checked last.
    """
    stiffness, periods = scales.mass * scales.frequency**2, []
    for place, path, at in extremes:
        key, allowed = _STANDS_FOR[path]
        with named(place, UNITS):
            buildings = {
                "[building_1]": jp.Building(scales.mass, stiffness, **vars(at.rod_1)),
                "[building_2]": jp.Building(
                    scales.mass / at.mass_ratio, stiffness * at.stiffness_ratio, **vars(at.rod_2)
                ),
            }
        table, _, name = key.rpartition(" ")
        if table in buildings:
            periods.append((f"{place} {table} natural period", buildings[table]))
            value = getattr(buildings[table], name)
        else:
            value = get(at, path)
        allowed.require(f"{place} {key}", value)
    for place, building in periods:
        ranges(Building)["period"].require(place, building.natural_period)
