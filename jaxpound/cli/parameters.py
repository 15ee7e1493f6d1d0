"""The parameters of a file that may be random or chosen: their keys, and paths in its buildings.

A key says where the parameter is, counted from 1: ``building.1.storey.2.stiffness``,
``building.2.floor.1.mass``, ``link.1.friction_force``; ``*`` stands for any number. Those of two
buildings of one storey have shorter keys too. What is random or chosen is a factor on the value of
the file.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping
from typing import Annotated, Any, Literal, NoReturn, TypeVar

import numpy as np
from msgspec import field

import jaxpound as jp
from jaxpound._checks import Range, did_you_mean
from jaxpound._errors import warn
from jaxpound.cli.buildings import BuildingsLayout
from jaxpound.cli.isolation import device_of, soil_keys
from jaxpound.cli.reading import File, Section, between, by_key, named, ranges, refused, unknown_key
from jaxpound.cli.structures import Shaken
from jaxpound.cli.tables import LAWS, ContactSection, DistributionSpec, drawn
from jaxpound.model.building import ROD
from jaxpound.model.parameters import get, in_words, metadata, paths
from jaxpound.model.places import link_places
from jaxpound.model.system import is_closable
from jaxpound.quantities import unit
from jaxpound.results.named import PAIR

X = TypeVar("X")

_INVERSE = "mass_ratio"  # m1 over m2: a factor on it is one over that on its parameter, m2

_OF_PAIR = {  # shorter keys of two buildings of one storey
    "friction": "link.1.friction_force",
    "initial_gap": "link.1.gap",
    _INVERSE: "building.2.floor.1.mass",
    "stiffness_ratio": "building.2.storey.1.stiffness",
    **{f"rod_{b}.{key}": f"building.{b}.storey.1.{key}" for b in (1, 2) for key in ROD},
    **{f"contact.{key}": f"link.1.contact.{key}" for key in ranges(ContactSection)},
}


def by_path(place: str, table: Mapping[str, X], parameters: Parameters) -> dict[str, tuple[str, X]]:
    """What a table states of each path, and by which key; ``*`` stands for any number.

    A key without ``*`` takes precedence over one with it, which leaves out those not above 0.
    """
    by_path: dict[str, tuple[str, X]] = {}
    short, stated = parameters.short, dict[str, Any](table)
    exact = {short.get(key, key) for key in table}
    for key, value in stated.items():
        fits = re.compile(re.escape(key).replace(r"\*", r"\d+"))
        matches = [short.get(x, x) for x in (*parameters.keys, *short) if fits.fullmatch(x)]
        if not matches:
            parameters.refuse(place, key)
        fitting = [x for x in matches if "*" not in key or x not in exact]
        several = [path for x in fitting for path in parameters.keys[x]]
        of_parameter = parameters.buildings
        if not (above_0 := [path for path in several if float(get(of_parameter, path)) > 0]):
            raise refused(f"{place} {key}", "must be of a value above 0, for factors on it")
        if key == _INVERSE and value is not None:
            if (inverse := value.inverse) is None:
                rule = "must have low above 0" if hasattr(value, "low") else "must be lognormal"
                rule += f"; {short[key]} takes any factor"
                raise refused(f"{place} {key}", rule, str(value))
            value = inverse
        for path in above_0:
            if path in by_path:
                keys = f"{place} {by_path[path][0]} and {key}"
                raise refused(keys, "must not stand for the same parameter")
            by_path[path] = key, value
    return by_path


class Parameters:
    """The parameters of a file's buildings, in SI units.

    ``keys`` has the paths that each key of a file stands for, ``short`` the key that a shorter one
    of two buildings stands for, ``key_of`` the key of each path.
    """

    def __init__(self, layout: BuildingsLayout) -> None:
        self.buildings, self.keys = layout.buildings, _keys(layout)
        self.key_of = {path: key for key, several in self.keys.items() for path in several}
        is_pair = self.buildings.system().topology == PAIR
        self.short = {x: key for x, key in _OF_PAIR.items() if is_pair and key in self.keys}

    def refuse(self, place: str, key: str) -> NoReturn:
        """The ``ValueError`` for a key that is none of ``keys``."""
        allowed = [*self.short, *dict.fromkeys(re.sub(r"\.\d+", ".*", x) for x in self.keys)]
        longer = _OF_PAIR.get(key, key) if self.short else key
        if owner := re.match(r"(?:\w+\.(?:\d+|\*)\.)+", longer):
            fits = re.compile(re.escape(owner[0]).replace(r"\*", r"\d+") + r"([a-z_].*)")
            matches = filter(None, map(fits.fullmatch, self.keys))
            ends = dict.fromkeys(re.sub(r"\d+", "*", match[1]) for match in matches)
            meant = did_you_mean(longer[owner.end() :], ends)
            if ends and not meant:
                rule = f"must be a parameter of {owner[0][:-1]}: {', '.join(ends)}"
                raise refused(f"{place} {key}", rule)
        if re.sub(r"\.\d+", ".*", longer) in allowed:
            rule = "must be of a building, floor, storey or [[link]] that is there, counted from 1"
            raise refused(f"{place} {key}", rule)
        meant = did_you_mean(key, allowed) or f"allowed are {', '.join(allowed)}"
        raise ValueError(unknown_key(place, key, meant))

    def unit_of(self, path: str) -> str:
        """The SI unit of a parameter."""
        parameter = metadata(self.buildings, path)
        within = parameter.within.unit if parameter.within else ""
        return within or unit(parameter.kind, si=True)

    def in_words(self, path: str) -> str:
        """What a parameter is, and where: ``slip force, 1–2, floor 2``."""
        if not path.startswith("links."):
            return in_words(path)
        _, k, field = path.split(".", 2)
        words = {"friction": "slip force", "gap": "gap at rest"}
        quantity = words.get(field) or metadata(self.buildings, path).words
        quantity = f"damper's {quantity}" if field.startswith("damper.") else quantity
        return f"{quantity}, {link_places(self.buildings.system().topology)[int(k)]}"


def _keys(layout: BuildingsLayout) -> dict[str, list[str]]:
    keys: dict[str, list[str]] = {}
    for b, building in enumerate(layout.shear_buildings):
        for i, of_storey in enumerate(building.storeys):
            floor, storey = (f"building.{b + 1}.{x}.{i + 1}" for x in ("floor", "storey"))
            if i >= building.n_floors:
                floor = storey = f"building.{b + 1}.tuned_mass"
            for path in paths(of_storey):
                key = path.rpartition(".")[2]
                if np.isfinite(get(of_storey, path)):  # e_u may be infinite
                    owner = floor if key == "mass" else storey
                    keys[f"{owner}.{key}"] = [f"buildings.{b}.storeys.{i}.{path}"]
        below = {f"soil.{key}": f"footing.{x}" for key, x in soil_keys(building.footing).items()}
        for path in paths(building.damping):
            name, _, number = path.partition(".")
            key = {"ratio": "rayleigh", "ratios": f"modal.{int(number or 0) + 1}"}.get(name, name)
            below[f"damping.{key}"] = f"damping.{path}"
        keys |= {f"building.{b + 1}.{key}": [f"buildings.{b}.{x}"] for key, x in below.items()}
    for k, (table, link) in enumerate(zip(layout.tables, layout.buildings.links, strict=True)):
        ends = {"friction_force": "friction"} | ({"gap": "gap"} if is_closable(link.gap) else {})
        for path in (f"{law}.{path}" for law in LAWS for path in paths(getattr(link, law))):
            ends[path.replace(".material.", ".")] = path
        place = f"link.{table}" if table else f"building.{link.building + 1}.{device_of(link)}"
        for key, path in ends.items():
            keys.setdefault(f"{place}.{key}", []).append(f"links.{k}.{path}")
    return keys


FACTOR = Range(0, 1000, "", "a factor on the value above")
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

    def times(self, value: float) -> jp.design.Bounds:
        """The bounds of the parameter itself, from its stated value."""
        return jp.design.Bounds(self.low * value, self.high * value, self.scale)

    @property
    def inverse(self) -> VariableBounds | None:
        """The bounds of 1 over the factor; None if it may be 0."""
        return VariableBounds(1 / self.high, 1 / self.low, self.scale) if self.low else None


class Uncertain(Shaken, kw_only=True):
    """Buildings under random earthquakes, some of whose parameters may be random too."""

    uncertain: dict[str, Annotated[DistributionSpec, drawn(*FACTOR)]] = field(default_factory=dict)

    def scenarios(
        self, file: File, correlation: float | None = None
    ) -> tuple[jp.Scenarios, jp.TimeGrid]:
        """The buildings in the random earthquakes, with what is uncertain; and the grid."""
        ground, grid = self.shaking(file)
        if not self.uncertain:
            if not ground.dimension:
                rule = "[uncertain], a factor on the record, or several records"
                raise ValueError(f"{file.name}: nothing is random; it must have {rule}")
            return jp.Scenarios(self.buildings, ground), grid
        place = f"{file.name}: [uncertain]"
        multiples, keys = multiples_of(place, self.uncertain, Parameters(self.layout))
        with named(place, keys), warnings.catch_warnings(record=True) as doubts:
            warnings.simplefilter("always", jp.PlausibilityWarning)
            structures = jp.UncertainStructures(self.buildings, multiples, correlation)
        said = [by_key(str(x.message), keys).partition(": ")[2] for x in doubts]
        warn([f"{place} {x}" for x in said])
        return jp.Scenarios(structures, ground), grid


def design_space(place: str, table: Mapping[str, Any], parameters: Parameters) -> jp.DesignSpace:
    """Buildings whose parameters may be chosen between multiples of the stated ones."""
    multiples, keys = multiples_of(place, table, parameters)
    with named(place, keys):
        return jp.DesignSpace(parameters.buildings, multiples)


def multiples_of(
    place: str, table: Mapping[str, Any], parameters: Parameters
) -> tuple[dict[str, Any], dict[str, str]]:
    """The multiples of stated values by a table's factors, and the keys, by path."""
    multiples, keys = {}, dict(parameters.key_of)
    for path, (key, factor) in by_path(place, table, parameters).items():
        if isinstance(factor, DistributionSpec):
            factor.require(f"{place} {key}", FACTOR)
        with named(f"{place} {key}:"):
            multiples[path] = factor.times(float(get(parameters.buildings, path)))
        if "*" not in key and key != _INVERSE:
            keys[path] = key
    return multiples, keys
