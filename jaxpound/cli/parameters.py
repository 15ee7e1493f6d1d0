"""The parameters of a file that may be random or chosen: their keys, paths, SI values and ranges.

In a row a key says where the parameter is, counted from 1: ``building.1.storey.2.stiffness``,
``building.2.floor.1.mass``, ``link.1.friction_force``; ``*`` stands for any number. Of a pair a key
is the field path of the dimensionless system. What is random or chosen is a factor on the values
of the file.
"""

from __future__ import annotations

import dataclasses
import operator
import re
import warnings
from collections.abc import Mapping, Sequence
from statistics import NormalDist
from typing import Annotated, Any, Literal, NoReturn, TypeVar, cast

import jax
import numpy as np
from msgspec import field

import jaxpound as jp
from jaxpound._checks import Range, did_you_mean
from jaxpound._errors import warn
from jaxpound.buildings import pair_in, scaled_links
from jaxpound.cli.buildings import UNITS, BlockSection, BuildingsLayout, LinkSection
from jaxpound.cli.isolation import device_of
from jaxpound.cli.reading import File, Section, between, by_key, named, ranges, refused, unknown_key
from jaxpound.cli.structures import Shaken
from jaxpound.cli.tables import LAWS, DistributionSpec, drawn
from jaxpound.model.parameters import get, in_words, metadata, paths, put
from jaxpound.model.places import link_places
from jaxpound.model.system import Structures, is_closable
from jaxpound.quantities import unit
from jaxpound.scenarios.distributions import RARE

X = TypeVar("X")

_OF_ROD = ("order", "tau_f", "tau_x")
_OF_LAWS = {f"{name}.{key}": x for name, law in LAWS.items() for key, x in ranges(law).items()}

_RANGES: dict[str, Range] = {  # of a parameter, by the end of its key in a row
    **{key: ranges(BlockSection)[key] for key in ("mass", "stiffness", *_OF_ROD)},
    **{key: ranges(LinkSection)[key] for key in ("friction_force", "gap")},
    **_OF_LAWS,
    **{key: metadata(jp.BoucWen, key).range for key in paths(jp.BoucWen)},
}

_ALIASES = {  # keys of a pair: the table with the parameter, and the end of its key in a row
    "friction": ("[damper]", "friction_force"),
    "initial_gap": ("", "gap"),
    "mass_ratio": ("[building_2]", "mass"),
    "stiffness_ratio": ("[building_2]", "stiffness"),
    **{f"rod_{i}.{key}": (f"[building_{i}]", key) for i in (1, 2) for key in _OF_ROD},
    **{key: ("[contact]", key) for key in _OF_LAWS if key.startswith("contact.")},
}


def by_path(place: str, table: Mapping[str, X], parameters: Parameters) -> dict[str, tuple[str, X]]:
    """What a table states of each path, and by which key; ``*`` stands for any number.

    A key without ``*`` takes precedence over one with it, which leaves out those not above 0.
    """
    by_path: dict[str, tuple[str, X]] = {}
    for key, value in table.items():
        fits = re.compile(re.escape(key).replace(r"\*", r"\d+"))
        if not (matches := [x for x in parameters.keys if fits.fullmatch(x)]):
            parameters.refuse(place, key)
        fitting = [x for x in matches if x == key or x not in table]
        several = [path for x in fitting for path in parameters.keys[x]]
        if not (above_0 := [path for path in several if float(get(parameters.nominal, path)) > 0]):
            raise refused(f"{place} {key}", "must be of a value above 0, for factors on it")
        for path in above_0:
            if path in by_path:
                keys = f"{place} {by_path[path][0]} and {key}"
                raise refused(keys, "must not stand for the same parameter")
            by_path[path] = key, value
    return by_path


class Parameters:
    """The parameters of a file.

    ``nominal`` are the dimensionless structures, ``si`` the same in SI units, but for ratios: rules
    are the same in every unit, so that messages on these have the units of the file. ``keys`` has
    the paths that each key of a file stands for, ``key_of`` the key of each path.
    """

    def __init__(self, layout: BuildingsLayout) -> None:
        self._layout, self.nominal = layout, layout.structures
        self.si = self._parameters_of(layout.si)
        of_pair = {path: [path] for path in paths(self.nominal)} if layout.is_pair else None
        self.keys = of_pair or _keys_of_row(layout)
        self.key_of = {path: key for key, several in self.keys.items() for path in several}

    def refuse(self, place: str, key: str) -> NoReturn:
        """The ``ValueError`` for a key that is none of ``keys``."""
        if self._layout.is_pair:
            allowed, fault = [*_ALIASES], ""
            if key in _ALIASES:
                keys = [x.removeprefix("contact.") for x in self.keys if x.startswith("contact.")]
                law = f"which has {', '.join(keys)}" if keys else "and the file has no [contact]"
                fault = f"must be a parameter of the law of contact, {law}"
        else:
            allowed = [*dict.fromkeys(re.sub(r"\.\d+", ".*", x) for x in self.keys)]
            if not (fault := self._links_lack(key)) and re.sub(r"\.\d+", ".*", key) in allowed:
                place_in_row = "building, floor, storey or [[link]]"
                fault = f"must be of a {place_in_row} that is there, counted from 1"
        if fault:
            raise refused(f"{place} {key}", fault)
        meant = did_you_mean(key, allowed) or f"allowed are {', '.join(allowed)}"
        raise ValueError(unknown_key(place, key, meant))

    def _links_lack(self, key: str) -> str:
        """Why the links of a key, which exist, have no such gap or parameter of a law."""
        kinds = "|".join(["gap", *LAWS])
        parts = re.fullmatch(rf"(link\.(?:\d+|\*)\.)({kinds})(\.\w+)?", key)
        if parts is None or "".join(parts.groups("")[1:]) not in _RANGES:
            return ""
        links = re.compile(re.escape(parts[1]).replace(r"\*", r"\d+") + "(.*)")
        ends = dict.fromkeys(match[1] for x in self.keys if (match := links.fullmatch(x)))
        if not ends:
            return ""  # no such link
        law = f"{parts[2]}."
        if of_law := [end.removeprefix(law) for end in ends if end.startswith(law)]:
            return f"must be a parameter of the law of {parts[2]}, which has {', '.join(of_law)}"
        links_have = "links have" if "*" in parts[1] else f"{parts[1][:-1]} has"
        feature = {"gap": "a ", "damper": "a ", "inerter": "an "}.get(parts[2], "") + parts[2]
        return f"must be of a [[link]] with {feature}: {links_have} no {parts[2]}"

    def require_plausible(self, extremes: Sequence[tuple[str, str, Any]]) -> None:
        """A ``ValueError`` for a parameter that can leave the plausible range of its key.

        ``extremes`` are a place in a file, the path of a parameter, and the structures in SI units
        where it has an extreme value. Periods, of all parameters of a building, are checked last,
        and only of a pair: in a row, masses and stiffnesses in their ranges hardly change one.
        """
        tables = [_ALIASES[path][0] if self._layout.is_pair else "" for _, path, _ in extremes]
        first = self._layout.buildings[0]  # of a pair, whose own mass and stiffness are certain
        for (place, path, at), table in zip(extremes, tables, strict=True):
            value, key = get(at, path), self.key_of[path]
            if path.endswith("_ratio"):
                value = first.mass / value if path == "mass_ratio" else first.stiffness * value
            if self._layout.is_pair:
                key = f"{table} {_ALIASES[path][1].removeprefix('contact.')}".lstrip()
            self._range(path).require(f"{place} {key}", value)
        for (place, _, at), table in zip(extremes, tables, strict=True):
            if table.startswith("[building"):
                mass, stiffness, rod = first.mass, first.stiffness, at.rod_1
                if table == "[building_2]":
                    mass, stiffness = mass / at.mass_ratio, stiffness * at.stiffness_ratio
                    rod = at.rod_2
                with named(place, UNITS):
                    building = jp.Building(mass, stiffness, **vars(rod))
                period = ranges(BlockSection)["period"]
                period.require(f"{place} {table} natural period", building.natural_period)

    def in_si(self, structures: Structures) -> Structures:
        """Such structures with their parameters in SI units, but for ratios."""
        return self._parameters_of(self.buildings(structures))

    def _parameters_of(self, buildings: jp.Buildings) -> Structures:
        if not self._layout.is_pair:
            return buildings.row_in(1.0, 1.0, 1.0)
        (left, right), (link,) = cast("Any", buildings.buildings), buildings.links
        return pair_in(left, right, link.friction, link.gap, link.contact, 1.0)

    def buildings(self, structures: Any) -> jp.Buildings:
        """Such structures as buildings in SI units."""
        scales, buildings = self._layout.scales, []
        stiffness = scales.units["stiffness"]
        if self._layout.is_pair:
            left, right, friction_force, gap = scales.buildings(structures)
            law = scales.contact_to_si(structures.contact)
            link = jp.FloorLink(0, 0, friction=friction_force, gap=gap, contact=law)
            return jp.Buildings.of("Buildings", (left, right), (link,))
        for building, stated in zip(structures.buildings, self._layout.buildings, strict=True):
            storeys = [
                scales.storey(rod.material, mass * scales.mass, rod.stiffness * stiffness)
                for mass, rod in zip(building.masses, building.rods, strict=True)
            ]
            buildings.append(dataclasses.replace(stated, storeys=tuple(storeys)))
        links = scaled_links(structures.links, scales, "Buildings", operator.mul)
        return jp.Buildings.of("Buildings", buildings, links)

    def in_si_units(self, path: str) -> tuple[float, float, str]:
        """A parameter's value in SI, the SI value of a dimensionless 1 of it, and its SI unit."""
        unit, value = self.unit_of(path), float(get(self.si, path))
        return value, value / float(get(self.nominal, path)), unit

    def unit_of(self, path: str) -> str:
        """The unit of a parameter in ``si``."""
        if path.endswith("_ratio"):
            return ""
        return self._range(path).unit or unit(metadata(self.nominal, path).kind, si=True)

    def in_words(self, path: str) -> str:
        """What a parameter of a row is, and where: ``slip force, 1–2, floor 2``."""
        if not path.startswith("links."):
            return in_words(path)
        _, k, field = path.split(".", 2)
        words = {"friction": "slip force", "gap": "gap at rest"}
        quantity = words.get(field) or metadata(self.nominal, path).words
        quantity = f"damper's {quantity}" if field.startswith("damper.") else quantity
        return f"{quantity}, {link_places(self.nominal.system().topology)[int(k)]}"

    def _range(self, path: str) -> Range:
        if self._layout.is_pair:
            return _RANGES[_ALIASES[path][1]]
        key = self.key_of[path]
        return _RANGES[".".join(key.split(".")[-2 if key.split(".")[-2] in LAWS else -1 :])]


def _keys_of_row(layout: BuildingsLayout) -> dict[str, list[str]]:
    keys: dict[str, list[str]] = {}
    row: Any = layout.structures
    for b, building in enumerate(layout.buildings):
        for i in range(len(building.storeys)):
            rod, storey = f"buildings.{b}.rods.{i}", f"building.{b + 1}.storey.{i + 1}"
            floor = f"building.{b + 1}.floor.{i + 1}"
            if i >= building.n_floors:
                floor = storey = f"building.{b + 1}.tuned_mass"
            keys[f"{floor}.mass"] = [f"buildings.{b}.masses.{i}"]
            keys[f"{storey}.stiffness"] = [f"{rod}.stiffness"]
            material = row.buildings[b].rods[i].material
            fixed = _OF_ROD if layout.bearings[b] and i == 0 else ()  # of bearings, without creep
            for path in paths(material):
                key = path.rpartition(".")[2]
                if key not in fixed and np.isfinite(get(material, path)):  # e_u may be infinite
                    keys[f"{storey}.{key}"] = [f"{rod}.material.{path}"]
    for k, (table, link) in enumerate(zip(layout.tables, layout.si.links, strict=True)):
        ends = {"friction_force": "friction"} | ({"gap": "gap"} if is_closable(link.gap) else {})
        for path in (f"{law}.{path}" for law in LAWS for path in paths(getattr(link, law))):
            ends[path.replace(".material.", ".")] = path
        place = f"link.{table}" if table else f"building.{link.building + 1}.{device_of(link)}"
        for key, path in ends.items():
            keys.setdefault(f"{place}.{key}", []).append(f"links.{k}.{path}")
    return keys


FACTOR = Range(0, 1e6, "", "a factor on the value above")
Factor = Annotated[float, between(*FACTOR)]


class VariableBounds(Section):
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


def uncertain_structures(
    place: str, table: Mapping[str, Any], parameters: Parameters, correlation: float | None = None
) -> jp.UncertainStructures:
    """Structures whose parameters are multiples of the stated ones by random factors."""
    for key, factor in table.items():
        factor.require(f"{place} {key}", FACTOR)
    stated = by_path(place, table, parameters)
    in_si = f"{place}, in SI units:"
    with named(in_si, keys=parameters.key_of), warnings.catch_warnings(record=True) as doubts:
        warnings.simplefilter("always", jp.PlausibilityWarning)
        physical = jp.UncertainStructures(parameters.si, _multiples(place, stated, parameters.si))
    said = [by_key(str(x.message), parameters.key_of).partition(": ")[2] for x in doubts]
    warn("configuration", [f"{in_si} {x}" for x in said], strict=False)
    # Each parameter at both ends of its range, the others at their medians.
    z = NormalDist().inv_cdf(RARE)
    ends = np.array([z, -z])[:, None, None] * np.eye(len(stated))
    rows = jax.jit(jax.vmap(jax.vmap(physical.parameters)))(ends)
    extremes = []
    for i, (path, (key, factor)) in enumerate(stated.items()):
        key_place = f"{place} {key} = {factor}, once in {1 / RARE:,.0f} draws:"
        for end in (0, 1):
            with named(key_place, keys=parameters.key_of):
                at = put(parameters.si, {x: float(rows[x][end, i]) for x in stated})
            extremes.append((key_place, path, at))
    parameters.require_plausible(extremes)
    unwarned = warnings.catch_warnings(action="ignore", category=jp.PlausibilityWarning)
    with named(f"{place}:", keys=parameters.key_of), unwarned:
        multiples = _multiples(place, stated, parameters.nominal)
        return jp.UncertainStructures(parameters.nominal, multiples, correlation)


class Uncertain(Shaken, kw_only=True):
    """Buildings under random earthquakes, some of whose parameters may be random too."""

    uncertain: dict[str, Annotated[DistributionSpec, drawn(*FACTOR)]] = field(default_factory=dict)

    def scenarios(
        self, file: File, correlation: float | None = None
    ) -> tuple[jp.Scenarios, jp.TimeGrid]:
        """The structures in the random earthquakes, with what is uncertain; and the grid."""
        structures: Any = self.structures
        ground, grid = self.shaking(file)
        if self.uncertain:
            place, parameters = f"{file.name}: [uncertain]", Parameters(self.layout)
            structures = uncertain_structures(place, self.uncertain, parameters, correlation)
        elif not ground.dimension:
            rule = "[uncertain], a factor on the record, or several records"
            raise ValueError(f"{file.name}: nothing is random; it must have {rule}")
        return jp.Scenarios(structures, ground), grid


def design_space(place: str, table: Mapping[str, Any], parameters: Parameters) -> jp.DesignSpace:
    """Structures whose parameters may be chosen between multiples of the stated ones."""
    # In SI units first, for messages in the units of the file.
    stated = by_path(place, table, parameters)
    bounds = _multiples(place, stated, parameters.si)
    with named(place, UNITS, parameters.key_of):
        physical = jp.DesignSpace(parameters.si, bounds)
        start = physical.shares(parameters.si)
    extremes = []
    for i, path in enumerate(physical.names):
        key, factors = stated[path]
        for end in (0.0, 1.0):
            numbers = physical.numbers(np.where(np.arange(len(start)) == i, end, start))
            at = put(parameters.si, {x: float(y) for x, y in numbers.items()})
            extremes.append((f"{place} {key} = {factors}, at a bound:", path, at))
    parameters.require_plausible(extremes)
    return jp.DesignSpace(parameters.nominal, _multiples(place, stated, parameters.nominal))


def _multiples(place: str, stated: Mapping[str, Any], structures: Structures) -> dict[str, Any]:
    multiples = {}
    for path, (key, factor) in stated.items():
        with named(f"{place} {key}:"):
            multiples[path] = factor.times(float(get(structures, path)))
    return multiples
