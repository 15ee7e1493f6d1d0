"""The parameters of a file that may be random or chosen: their keys, paths, SI values and ranges.

Of a pair a key is the field path of the dimensionless system. In a row it says where the parameter
is, counted from 1: ``building.1.storey.2.stiffness``, ``building.2.floor.1.mass``,
``link.1.friction_force``; ``*`` stands for any number.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from typing import Any, NoReturn, Protocol, TypeVar

import jaxpound as jp
from jaxpound._checks import did_you_mean
from jaxpound.cli.pair import UNITS, Building, Damper, Pair
from jaxpound.cli.reading import Range, named, ranges, unknown_key
from jaxpound.cli.row import FloorLink, Row
from jaxpound.cli.structures import Structured
from jaxpound.cli.tables import LAWS, Contact
from jaxpound.model.parameters import get, in_words, paths, put
from jaxpound.model.parameters import known as about
from jaxpound.model.places import link_places
from jaxpound.model.rod import ZenerRod
from jaxpound.model.shear_building import in_units
from jaxpound.model.system import Structures
from jaxpound.quantities import unit

X = TypeVar("X")


class Parameters(Protocol):
    """The parameters of a file."""

    @property
    def nominal(self) -> Structures:
        """The dimensionless structures."""

    @property
    def si(self) -> Structures:
        """The same with their parameters in SI units: s^order, N, m.

        Rules are the same in every unit, so that error messages have the units of the file.
        """

    @property
    def keys(self) -> Mapping[str, tuple[str, ...]]:
        """The paths that each key of a file stands for."""

    @property
    def key_of(self) -> Mapping[str, str]:
        """What a file calls the parameter of each path."""

    def refuse(self, place: str, key: str) -> NoReturn:
        """The ``ValueError`` for a key that is none of ``keys``."""

    def require(self, place: str, path: str, at: Any) -> None:
        """A ``ValueError`` for a parameter outside of its key's range; ``at`` are in SI units."""

    def require_periods(self, place: str, path: str, at: Any) -> None:
        """A ``ValueError`` for a building with an implausible period."""

    def unit_of(self, path: str) -> str:
        """The unit of a parameter in a file."""


def parameters_of(form: Pair | Row) -> Parameters:
    """Those of a file."""
    return RowParameters(form) if isinstance(form, Row) else PairParameters(form)


def by_path(place: str, table: Mapping[str, X], known: Parameters) -> dict[str, tuple[str, X]]:
    """What a table states of each path, and by which key; ``*`` stands for any number.

    A key that is given itself goes before one with ``*``, which leaves out parameters that are 0.
    """
    found: dict[str, tuple[str, X]] = {}
    for key, value in table.items():
        fits = re.compile(re.escape(key).replace(r"\*", r"\d+"))
        if not (matched := [one for one in known.keys if fits.fullmatch(one)]):
            known.refuse(place, key)
        many = [
            path for one in matched for path in known.keys[one] if one == key or one not in table
        ]
        above_0 = [path for path in many if float(get(known.nominal, path))]
        if not above_0:
            raise ValueError(f"{place} {key} must be of a value above 0, for factors on it")
        for path in above_0:
            if path in found:
                rule = "must not stand for the same parameter"
                raise ValueError(f"{place} {found[path][0]} and {key} {rule}")
            found[path] = key, value
    return found


# --- of a pair ----------------------------------------------------------------------------------

_OF_CONTACT = tuple(dict.fromkeys(path for law in LAWS.values() for path in paths(law)))

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
    """The parameters of a pair in SI units, but the ratios.

    Stiffness of contact is in N/m, or N/m^1.5 for laws after Hertz.
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


class PairParameters:
    """Those of two buildings: a key is a path."""

    def __init__(self, form: Pair) -> None:
        self.nominal = form.structures
        self.scales = form.scales
        self.si = in_si(self.nominal, self.scales)
        self.keys = {path: (path,) for path in paths(self.nominal)}
        self.key_of = {path: path for path in self.keys}

    def refuse(self, place: str, key: str) -> NoReturn:
        """As ``Parameters.refuse``."""
        if key in _STANDS_FOR:  # of a law of contact
            own = [x.removeprefix("contact.") for x in self.keys if x.startswith("contact.")]
            what = f"which has {', '.join(own)}" if own else "and the file has no [contact]"
            raise ValueError(f"{place} {key} must be a parameter of the law of contact, {what}")
        _refuse(place, key, [*_STANDS_FOR])

    def require(self, place: str, path: str, at: jp.AdjacentStructures) -> None:
        """As ``Parameters.require``."""
        key, allowed = _STANDS_FOR[path]
        mass, stiffness = self.scales.mass, self.scales.mass * self.scales.frequency**2
        of_second = {"mass_ratio": mass / at.mass_ratio}
        of_second["stiffness_ratio"] = stiffness * at.stiffness_ratio
        allowed.require(f"{place} {key}", of_second[path] if path in of_second else get(at, path))

    def require_periods(self, place: str, path: str, at: jp.AdjacentStructures) -> None:
        """As ``Parameters.require_periods``."""
        table = _STANDS_FOR[path][0].rpartition(" ")[0]
        if building := self._buildings(place, at).get(table):
            period = ranges(Building)["period"]
            period.require(f"{place} {table} natural period", building.natural_period)

    def unit_of(self, path: str) -> str:
        """As ``Parameters.unit_of``: that of the number in ``si``."""
        if path.endswith("_ratio"):
            return ""
        return _STANDS_FOR[path][1].unit or unit(about(self.nominal, path).kind, si=True)

    def _buildings(self, place: str, at: jp.AdjacentStructures) -> dict[str, jp.Building]:
        mass = self.scales.mass
        stiffness = mass * self.scales.frequency**2
        second = mass / at.mass_ratio, stiffness * at.stiffness_ratio
        with named(place, UNITS):
            return {
                "[building_1]": jp.Building(mass, stiffness, **vars(at.rod_1)),
                "[building_2]": jp.Building(*second, **vars(at.rod_2)),
            }


# --- of a row -----------------------------------------------------------------------------------

_RANGES: dict[str, Range] = {
    **{key: ranges(Building)[key] for key in ("mass", "stiffness", "order", "tau_f", "tau_x")},
    **{key: ranges(FloorLink)[key] for key in ("friction_force", "gap")},
    **{f"contact.{key}": ranges(Contact)[key] for key in _OF_CONTACT},
}
"""Range of a parameter by the end of its key."""


class RowParameters:
    """Those of a row: keys are counted from 1, those of links by their tables."""

    def __init__(self, form: Row) -> None:
        self.nominal = form.structures
        self.si = jp.Row(tuple(in_units(b, 1.0, 1.0, 1.0) for b in form.buildings), form.links)
        made: dict[str, list[str]] = {}
        for b, building in enumerate(form.buildings):
            for i in range(building.n_floors):
                rod, storey = f"buildings.{b}.rods.{i}", f"building.{b + 1}.storey.{i + 1}"
                made[f"building.{b + 1}.floor.{i + 1}.mass"] = [f"buildings.{b}.masses.{i}"]
                made[f"{storey}.stiffness"] = [f"{rod}.stiffness"]
                for key in ("order", "tau_f", "tau_x"):
                    made[f"{storey}.{key}"] = [f"{rod}.material.{key}"]
        for k, (table, link) in enumerate(zip(form.tables, form.links, strict=True)):
            own = {"friction_force": "friction"} | (
                {"gap": "gap"} if link.gap < float("inf") else {}
            )
            if link.contact is not None:
                own |= {f"contact.{path}": f"contact.{path}" for path in paths(link.contact)}
            for key, path in own.items():
                made.setdefault(f"link.{table}.{key}", []).append(f"links.{k}.{path}")
        self.keys = {key: tuple(one) for key, one in made.items()}
        self.key_of = {path: key for key, several in made.items() for path in several}

    def refuse(self, place: str, key: str) -> NoReturn:
        """As ``Parameters.refuse``."""
        numbers = re.sub(r"\.\d+", ".*", key)
        general = dict.fromkeys(re.sub(r"\.\d+", ".*", one) for one in self.keys)
        if numbers in general:
            rule = "must be of a building, floor, storey or [[link]] that is there, counted from 1"
            raise ValueError(f"{place} {key} {self._lacking(key) or rule}")
        if lacking := self._lacking(key):
            raise ValueError(f"{place} {key} {lacking}")
        _refuse(place, key, [*general])

    def _lacking(self, key: str) -> str:
        """Why the links of a key, which are there, have no such gap or parameter of contact."""
        found = re.fullmatch(r"(link\.(?:\d+|\*)\.)(gap|contact)(\.\w+)?", key)
        if found is None or "".join(found.groups("")[1:]) not in _RANGES:
            return ""
        links = re.compile(re.escape(found[1]).replace(r"\*", r"\d+") + "(.*)")
        ends = dict.fromkeys(own[1] for one in self.keys if (own := links.fullmatch(one)))
        if not ends:
            return ""  # no such link
        of_law = [end.removeprefix("contact.") for end in ends if end.startswith("contact.")]
        if found[2] == "contact" and of_law:
            return f"must be a parameter of the law of contact, which has {', '.join(of_law)}"
        whose = "links have" if "*" in found[1] else f"{found[1][:-1]} has"
        what = "a gap" if found[2] == "gap" else "contact"
        return f"must be of a [[link]] with {what}: {whose} no {found[2]}"

    def require(self, place: str, path: str, at: jp.Row) -> None:
        """As ``Parameters.require``."""
        _RANGES[self._end(path)].require(f"{place} {self.key_of[path]}", get(at, path))

    def in_si(self, structures: jp.Row) -> jp.Row:
        """Such structures in SI units: every parameter differs from its SI value by a factor."""
        values = {
            path: float(get(structures, path)) * float(get(self.si, path)) / float(stated)
            for path in self.key_of
            if (stated := get(self.nominal, path))
        }
        return put(self.si, values)

    def in_words(self, path: str) -> str:
        """What a parameter is, and where: ``slip force, 1–2, floor 2``."""
        if not path.startswith("links."):
            return in_words(path)
        _, k, of_link = path.split(".", 2)
        words = {"friction": "slip force", "gap": "gap at rest"}
        told = words.get(of_link) or about(self.nominal, path).words
        return f"{told}, {link_places(self.nominal.system().topology)[int(k)]}"

    def unit_of(self, path: str) -> str:
        """The unit of a parameter in a file."""
        end = self._end(path)
        return _RANGES[end].unit or unit(about(self.nominal, path).kind, si=True)

    def _end(self, path: str) -> str:
        key = self.key_of[path]
        return ".".join(key.split(".")[-2 if ".contact." in key else -1 :])

    def require_periods(self, place: str, path: str, at: jp.Row) -> None:
        """Nothing: masses and stiffnesses in their ranges change a period by their square roots."""


def _refuse(place: str, key: str, allowed: list[str]) -> NoReturn:
    words = did_you_mean(key, allowed) or f"allowed are {', '.join(allowed)}"
    raise ValueError(unknown_key(place, key, words))
