"""Buildings and what is between them, from configurations to ``jp.Buildings``, and back.

They are in a row ([[building]] and [[link]], counted from 1); two buildings of one storey may be
written as a pair ([building_1], [building_2], gap, [damper], [contact]).
"""

from __future__ import annotations

import dataclasses
import itertools
import json
from collections.abc import Mapping, Sequence
from types import NoneType
from typing import Annotated, Any, Literal, NamedTuple, Self

from msgspec import Meta

import jaxpound as jp
from jaxpound.cli.isolation import (
    IsolationSection,
    SoilSection,
    TunedMassSection,
    device_of,
    soil_keys,
)
from jaxpound.cli.reading import Form, Section, between, each, named, of_field, refused, says, shown
from jaxpound.cli.tables import (
    LAWS,
    ColumnSection,
    ContactSection,
    DamperSection,
    Friction,
    Gaps,
    of_faces,
)
from jaxpound.cli.tables import InerterSection as Inerter
from jaxpound.cli.tables import VelocityFrictionSection as VelocityFriction
from jaxpound.model.building import DAMPING, PERIOD, ROD
from jaxpound.model.parameters import get, paths
from jaxpound.model.places import support_place
from jaxpound.model.row import LinkLabels, by_face, require_floors, require_heights
from jaxpound.model.shear_building import HEIGHT, STRENGTHS, TAPER
from jaxpound.model.system import is_closable

_MOST = 1000  # buildings or floors: more are a typing error
_BY_PERIOD = Form(("mass", "period", "damping_ratio"), ("order", "tau_f", "height"))
_BY_ROD = Form(("mass", "stiffness", "order", "tau_f", "tau_x"), ("height",))
_UNIFORM = Form(
    ("number", "mass", "period", "damping_ratio"), ("order", "tau_f", "taper", "height")
)
_UNIFORM_SPRINGS = Form(("number", "mass", "period", "damping"), ("taper", "height"))
_MORE = ("heights", "tuned_masses", "bearings", "dashpots")
_LISTED = Form(("masses", "stiffnesses", "order", "tau_f", "tau_x"), ("damping", *_MORE))
_LISTED_SPRINGS = Form(("masses", "stiffnesses", "damping"), _MORE)
_LISTED_DASHPOTS = Form(("masses", "stiffnesses", "dashpots"), ("damping", *_MORE[:-1]))
_OF_BUILDING = (*map(Form, (("storeys",), ("published",))), _BY_PERIOD, _BY_ROD)
OF_STOREYS = ("storeys", "published", "isolation", "tuned_mass", "soil", "support")
_FLOOR = Form(("building", "floor"), ("next_building", "next_floor"))
_FLOORS = Form(("building", "floors"), ("next_building",))
_COMMON = Form(("floors",), ("building",))  # "common" ones, of neighbours
_BETWEEN = ("friction_force", "gap", "damper", "velocity_friction", "inerter")

_Mass = Annotated[float, of_field(jp.Building, "mass")]
_Stiffness = Annotated[float, of_field(jp.Building, "stiffness")]
_Order = Annotated[float, of_field(jp.Building, "order")]
_Relaxation = Annotated[float, of_field(jp.Building, "tau_f")]
_Dashpot = Annotated[float, of_field(jp.Building, "dashpot")]
_OrderOfStorey = Annotated[_Order | Literal["spring"], says('a number, or "spring"', alone=_Order)]
_Period = Annotated[float, between(*PERIOD)]
_Damping = Annotated[float, between(*DAMPING)]
_Height = Annotated[float, between(*HEIGHT)]
_Number = Annotated[int, between(1, _MOST)]
_Floors = Annotated[
    Literal["common"] | Annotated[list[_Number], Meta(min_length=1)],
    says('"common" or a list of floors, counted from 1'),
]
_SUPPORT = "support "
_Neighbour = Annotated[
    _Number | Annotated[str, Meta(pattern=rf"^(ground|{_SUPPORT}[1-9]\d*)$")],
    says('the number of a building, "ground", or a support, such as "support 2"'),
]

_YIELD_LAWS: dict[str, Any] = {"bilinear": jp.Bilinear, "bouc-wen": jp.BoucWen, "elastic": NoneType}
_OF_STOREY = "yield_displacement"  # of each storey, by its strength

_YieldLaw = Annotated[
    Literal["bilinear", "bouc-wen"] | list[Literal["bilinear", "bouc-wen", "elastic"]],
    says('"bilinear" or "bouc-wen", or a list of these and "elastic", one for each storey'),
]
_YieldForce = Annotated[float, between(*STRENGTHS["yield_force"])]
_Coefficient = Annotated[float, between(*STRENGTHS["base_shear_coefficient"])]
_YieldDrift = Annotated[float, between(*STRENGTHS["yield_drift"])]
_Hardening = Annotated[float, of_field(jp.BoucWen, "hardening")]
_Ultimate = Annotated[float, of_field(jp.BoucWen, "ultimate_displacement")]
_Exponent = Annotated[float, of_field(jp.BoucWen, "exponent")]
_Beta = Annotated[float, of_field(jp.BoucWen, "beta")]
_Degradation = Annotated[float, of_field(jp.BoucWen, "strength_degradation")]
_DampingRatio = Annotated[float, of_field(jp.Rayleigh, "ratio")]
_Degradations = Annotated[_Degradation | list[_Degradation], each(_Degradation)]


class DampingSection(Section):
    """Rayleigh's damping, by the ratio of two modes or by its coefficients; or that of modes."""

    rayleigh: _DampingRatio | None = None
    modal: Annotated[_DampingRatio | list[_DampingRatio], each(_DampingRatio)] | None = None
    modes: Annotated[list[_Number], Meta(min_length=2, max_length=2)] | None = None
    mass: Annotated[float, of_field(jp.Rayleigh, "mass")] | None = None
    stiffness: Annotated[float, of_field(jp.Rayleigh, "stiffness")] | None = None

    def __post_init__(self) -> None:
        self.require_form(
            Form(("rayleigh",), ("modes",)), Form(("mass", "stiffness")), Form(("modal",))
        )

    def model(self) -> Any:
        """The library's ``Rayleigh`` or ``ModalDamping``."""
        if self.modal is not None:
            return jp.model.ModalDamping(self.modal)
        stated = self.stated()
        return jp.Rayleigh(stated.pop("rayleigh", None), **stated)


class StoreySection(Section):
    """The storeys of a building: by its period and damping, or each by its mass and rod."""

    number: _Number | None = None
    mass: Annotated[_Mass | list[_Mass], each(_Mass)] | None = None
    period: _Period | None = None
    damping_ratio: _Damping | None = None
    taper: Annotated[float, between(*TAPER)] | None = None
    height: Annotated[_Height | list[_Height], each(_Height)] | None = None

    masses: Annotated[list[_Mass], each(_Mass, alone=False)] | None = None
    stiffnesses: Annotated[_Stiffness | list[_Stiffness], each(_Stiffness)] | None = None
    order: Annotated[_OrderOfStorey | list[_OrderOfStorey], each(_OrderOfStorey)] | None = None
    tau_f: Annotated[_Relaxation | list[_Relaxation], each(_Relaxation)] | None = None
    tau_x: Annotated[_Relaxation | list[_Relaxation], each(_Relaxation)] | None = None
    heights: Annotated[_Height | list[_Height], each(_Height)] | None = None
    dashpots: Annotated[_Dashpot | list[_Dashpot], each(_Dashpot)] | None = None
    damping: DampingSection | None = None
    tuned_masses: _Number | None = None
    bearings: _Number | None = None

    def __post_init__(self) -> None:
        forms = _UNIFORM, _UNIFORM_SPRINGS, _LISTED, _LISTED_SPRINGS, _LISTED_DASHPOTS
        if self.require_form(*forms) is _UNIFORM:
            for key in ("order", "tau_f"):
                if isinstance(getattr(self, key), list):  # all storeys have one rod
                    raise ValueError(f"must not have a list of {key} with number")
        self.model()

    def model(self) -> jp.ShearBuilding:
        """The library's ``ShearBuilding``."""
        values = self.stated()
        if self.damping is not None:
            values["damping"] = self.damping.model()
        if isinstance(self.dashpots, list):
            values["dashpots"] = [x or None for x in self.dashpots]
        if isinstance(self.order, list) and "spring" in self.order:  # without numbers of a rod
            for key in ROD:
                listed = x if isinstance(x := values[key], list) else [x] * len(self.order)
                rods = zip(self.order, listed, strict=False)
                values[key] = [None if order == "spring" else x for order, x in rods]
        if self.order == "spring":
            values["order"] = None
        named_counts = {"n_tuned": "tuned_masses", "n_bearings": "bearings"}
        with named("", {"storey_mass": "mass", "ratios": "modal"} | named_counts):
            if "masses" in values:
                counts = {name: values.pop(key, 0) for name, key in named_counts.items()}
                return dataclasses.replace(jp.ShearBuilding.of_storeys(**values), **counts)
            n, mass = values.pop("number"), values.pop("mass")
            return jp.ShearBuilding.from_period(n, mass, **values)


class YieldingSection(Section):
    """A strength, a law and the law's parameters, and whether weights act at drifts.

    They stand beside the keys of a building, in [[building]], [building_1] and [building_2].
    """

    yield_force: Annotated[_YieldForce | list[_YieldForce], each(_YieldForce)] | None = None
    base_shear_coefficient: _Coefficient | None = None
    yield_drift: Annotated[_YieldDrift | list[_YieldDrift], each(_YieldDrift)] | None = None
    law: _YieldLaw | None = None
    hardening: Annotated[_Hardening | list[_Hardening], each(_Hardening)] | None = None
    ultimate_displacement: Annotated[_Ultimate | list[_Ultimate], each(_Ultimate)] | None = None
    exponent: Annotated[_Exponent | list[_Exponent], each(_Exponent)] | None = None
    beta: Annotated[_Beta | list[_Beta], each(_Beta)] | None = None
    strength_degradation: _Degradations | None = None
    stiffness_degradation: _Degradations | None = None
    p_delta: bool | None = None

    def yielding(self, building: jp.ShearBuilding) -> jp.ShearBuilding:
        """A building with this strength and under its weight; a ``ValueError`` for a fault."""
        keys_here = YieldingSection.__struct_fields__  # not those of the building
        stated = {key: x for key, x in self.stated().items() if key in keys_here}
        p_delta = stated.pop("p_delta", False)
        if stated:
            law = stated.pop("law", "bilinear")
            laws = law if isinstance(law, list) else [law] * building.n_floors
            if len(laws) != building.n_floors:
                raise refused("law", f"must be one for each of {building.n_floors} storeys")
            keys = {x: [key for key in paths(_YIELD_LAWS[x]) if key != _OF_STOREY] for x in laws}
            allowed = dict.fromkeys(itertools.chain(*keys.values()))
            remedy = "leave law out, or let a storey yield"
            if allowed:
                remedy = f"give {', '.join(allowed)}"
            rule = f"must not be given with law = {shown(law)}; {remedy}"
            self.refuse_any({*paths(jp.BoucWen)} - allowed.keys(), rule)  # and so of Bilinear
            by_law = {"elastic": building}
            for name in keys.keys() - by_law.keys():
                numbers = {key: x for key, x in stated.items() if key in (*STRENGTHS, *keys[name])}
                with named(""):
                    by_law[name] = building.yielding(_YIELD_LAWS[name], **numbers)
            storeys = [by_law[name].storeys[i] for i, name in enumerate(laws)]
            storeys += building.storeys[building.n_floors :]
            building = dataclasses.replace(building, storeys=tuple(storeys))
        with named("p_delta:"):
            return building.with_p_delta() if p_delta else building


class BuildingSection(YieldingSection):
    """A building: its storeys, one of the literature, or a block by its period or its rod."""

    mass: _Mass | None = None
    period: _Period | None = None
    damping_ratio: _Damping | None = None
    stiffness: _Stiffness | None = None
    order: _OrderOfStorey | None = None
    tau_f: _Relaxation | None = None
    tau_x: _Relaxation | None = None
    height: _Height | None = None
    storeys: StoreySection | None = None
    published: str | None = None
    isolation: IsolationSection | None = None
    tuned_mass: TunedMassSection | None = None
    soil: SoilSection | None = None
    support: _Number | None = None

    def __post_init__(self) -> None:
        self.require_form(*_OF_BUILDING)
        PERIOD.require("natural period", self.shear().natural_period)
        self.standing(0)

    def standing(self, number: int) -> tuple[jp.ShearBuilding, tuple[jp.FloorLink, ...]]:
        """Building ``number``, from 0, with tuned mass, on bearings and soil; and their links."""
        standing: tuple[Any, tuple[Any, ...]] = self.shear(), ()
        if self.tuned_mass is not None:
            standing = self.tuned_mass.on(standing[0], number)
        building, links = self.isolation.under(*standing, number) if self.isolation else standing
        return (self.soil.under(building) if self.soil else building), links

    def shear(self) -> jp.ShearBuilding:
        """The library's ``ShearBuilding``."""
        if self.storeys is not None:
            return self.yielding(self.storeys.model())
        if self.published is not None:
            with named("published:"):
                building = jp.ShearBuilding.published(self.published)
            return self.yielding(building)
        values = {
            key: x for key, x in self.stated().items() if key in _BY_PERIOD.keys + _BY_ROD.keys
        }
        if self.order == "spring":
            values["order"] = None
        heights = () if (height := values.pop("height", None)) is None else ((height,),)
        with named(""):
            block = (jp.Building.from_period if "period" in values else jp.Building)(**values)
        return self.yielding(jp.ShearBuilding((block,), *heights))


class Damper(Section):
    """The friction damper between the buildings."""

    friction_force: Friction


class LinkSection(Section):
    """What is between two floors, or between several floors of neighbouring buildings."""

    building: _Number | None = None
    floor: _Number | None = None
    floors: _Floors | None = None
    next_building: _Neighbour | None = None
    next_floor: _Number | None = None
    friction_force: Friction | None = None
    gap: Gaps | None = None
    side: Literal["left", "right"] | None = None
    contact: ContactSection | None = None
    damper: DamperSection | None = None
    velocity_friction: VelocityFriction | None = None
    inerter: Inerter | None = None
    column: ColumnSection | None = None

    def __post_init__(self) -> None:
        self.require_form(*((_COMMON, _FLOOR) if self.floors == "common" else (_FLOOR, _FLOORS)))
        if isinstance(self.next_building, str):
            self.refuse_any(("next_floor",), f"must not be given with {self.next_building}")
        if self.contact is not None:
            self.require_all(("gap",), ", which contact needs")
        if self.stated().keys().isdisjoint(_BETWEEN):
            raise ValueError(f"must have one of {', '.join(_BETWEEN)}")
        if isinstance(self.gap, list):
            self.refuse_any(("side",), "must not be given with gap = [left, right], which has both")
        of_faces(self.gap)

    def links(self, buildings: Sequence[jp.ShearBuilding]) -> list[jp.FloorLink]:
        """The library's ``FloorLink``, of each floor and face."""
        between: Any = {key: x.model() for key, x in self.stated().items() if key in LAWS}
        between |= {"friction": self.friction_force or 0.0, "gap": of_faces(self.gap)}
        between["side"] = self.side or "right"
        if self.floors == "common":
            left, last = None if self.building is None else self.building - 1, len(buildings) - 1
            if left is not None and not left < last:
                rule = f"must be from 1 to {last}, with another building to the right"
                raise refused("building", rule, str(self.building))
            columns = between.pop("column", None)
            common = jp.floor_links(buildings, gap=between["gap"], building=left, columns=columns)
            return [*by_face([dataclasses.replace(link, **between) for link in common])]
        stated: Any = self  # with a building, and one floor or several
        next_floor = None if self.next_floor is None else self.next_floor - 1
        between |= {"next_floor": next_floor, "next_building": _end_of(self.next_building)}
        floors = stated.floors or [stated.floor]
        return [*by_face([jp.FloorLink(stated.building - 1, i - 1, **between) for i in floors])]


def _end_of(next_building: int | str | None) -> int | None:
    """The other end of a link as ``FloorLink`` has it, from 0."""
    if isinstance(next_building, str):
        return jp.support(int(next_building.removeprefix(_SUPPORT).replace("ground", "1")) - 1)
    return None if next_building is None else next_building - 1


def end_in_file(link: jp.FloorLink) -> int | str:
    """``next_building`` of a link in a file: a building, from 1, the ground or another support."""
    if (end := link.other_floor) >= 0:
        return link.other_building + 1
    return support_place(end)


class BuildingsLayout(NamedTuple):
    """The buildings of a file, and what its tables say of them."""

    buildings: jp.Buildings
    tables: tuple[int | None, ...]  # number of each link's [[link]]; None of a building's own
    bearings: tuple[IsolationSection | None, ...]  # of each building

    @classmethod
    def of(cls, buildings: Sequence[BuildingSection], links: Sequence[LinkSection]) -> Self:
        """Buildings in a row; a ``ValueError`` for a link that cannot be."""
        standing = [building.standing(b) for b, building in enumerate(buildings)]
        models = tuple(model for model, _ in standing)
        by_table: list[tuple[int | None, jp.FloorLink]] = []
        for number, link in enumerate(links, 1):
            with named(f"[[link]] {number}"):
                by_table += [(number, floor_link) for floor_link in link.links(models)]
        by_table += [(None, link) for _, of_bearings in standing for link in of_bearings]
        tables, floor_links = tuple(x for x, _ in by_table), tuple(link for _, link in by_table)
        names = [
            f"[[link]] {n}" if n else f"[[building]] {link.building + 1} {device_of(link)}"
            for n, link in by_table
        ]
        labels = LinkLabels(names.__getitem__, " ", first=1)
        require_floors([model.n_ends for model in models], floor_links, labels)
        require_heights(models, floor_links, labels)
        bearings = tuple(building.isolation for building in buildings)
        supports = tuple((building.support or 1) - 1 for building in buildings)
        return cls(jp.Buildings.of(models, floor_links, supports=supports), tables, bearings)

    @property
    def shear_buildings(self) -> tuple[jp.ShearBuilding, ...]:
        """The buildings, each of them of storeys, as files have them."""
        return self.buildings.buildings  # type: ignore[return-value]

    @property
    def has_contact(self) -> bool:
        """Whether a link has a law of contact."""
        return any(link.contact is not None for link in self.buildings.links)

    @property
    def gaps(self) -> list[float]:
        """The gaps of the links that have one, in m."""
        return [float(link.gap) for link in self.buildings.links if is_closable(link.gap)]


def as_toml(buildings: jp.Buildings) -> str:
    """Buildings as a configuration of ``jaxpound simulate``.

    Raises ``InvalidInput`` for storeys of a building that do not yield by one law of a file.
    """
    lines, plural = [], {"mass": "masses", "stiffness": "stiffnesses"}
    for number, building in enumerate(buildings.buildings):
        storeys = building.storeys
        springs = [storey.order is None for storey in storeys]
        keys = ("mass", "stiffness") if all(springs) else _BY_ROD.needed
        series = {plural.get(key, key): [getattr(x, key) for x in storeys] for key in keys}
        for key in keys[2:]:
            none = "spring" if key == "order" else 1.0  # which the file does not read
            series[key] = [none if x else y for x, y in zip(springs, series[key], strict=True)]
        if any(storey.dashpot is not None for storey in storeys):
            series["dashpots"] = [storey.dashpot or 0.0 for storey in storeys]
        if isinstance(building, jp.ShearBuilding):
            series["heights"] = [*building.heights]
        yields, footing = _lists(keys_of(storeys[: building.n_floors])), building.footing
        soil = [f"{x} = {_written(get(footing, path))}" for x, path in soil_keys(footing).items()]
        yields += [f"soil = {{{', '.join(soil)}}}"] if soil else []
        stands_on = [f"support = {buildings.supports[number] + 1}"] if buildings.supports else []
        lines += ["[[building]]", *stands_on, *yields, "[building.storeys]", *_lists(series)]
        damping = getattr(building, "damping", None)
        if damping is not None or (all(springs) and "dashpots" not in series):
            lines.append(f"damping = {{{', '.join(_damping(damping))}}}")
        lines += [f"tuned_masses = {n}  # the last of these"] if (n := building.n_tuned) else []
        lines += [f"bearings = {n}  # the first of these"] if (n := building.n_bearings) else []
        lines.append("")
    for link in buildings.links:
        lines += ["[[link]]", f"building = {link.building + 1}", f"floor = {link.floor + 1}"]
        lines.append(f"next_building = {json.dumps(end_in_file(link))}")
        if link.other_floor >= 0:
            lines.append(f"next_floor = {link.other_floor + 1}")
        lines += ['side = "left"'] * (link.side == "left")
        lines.append(f"friction_force = {_written(link.friction)}  # N")
        if is_closable(link.gap):
            lines.append(f"gap = {_written(link.gap)}  # m")
        laws = {key: getattr(link, key) for key in LAWS}
        lines += [f"{key} = {{{', '.join(_law(x))}}}" for key, x in laws.items() if x is not None]
        lines.append("")
    return "\n".join(lines)


def keys_of(storeys: Sequence[jp.Building]) -> dict[str, list[Any]]:
    """The numbers of storeys that yield by key, storey by storey; none where no storey yields.

    Raises ``InvalidInput`` where a file cannot have them: storeys of another law.
    """
    laws: list[Any] = [storey.hysteresis for storey in storeys]
    names = [name for law in laws for name, kind in _YIELD_LAWS.items() if type(law) is kind]
    if len(names) < len(laws):
        rule = f"must be by a law of a file, {' or '.join(_YIELD_LAWS)}"
        raise jp.InvalidInput("hysteresis", "", rule, owner="Buildings")
    if {*names} == {"elastic"}:
        return {}
    numbers: dict[str, list[Any]] = {}
    for key in paths(jp.BoucWen):  # a storey without such a number gets that of another
        of_key = [getattr(law, key) for law in laws if hasattr(law, key)]
        numbers |= {key: [getattr(law, key, of_key[0]) for law in laws]} if of_key else {}
    lengths = numbers.pop(_OF_STOREY)
    forces = [x.stiffness * length for x, length in zip(storeys, lengths, strict=True)]
    return {"law": names, "yield_force": forces, **numbers}


def _lists(series: Mapping[str, Sequence[Any]]) -> list[str]:
    return [f"{key} = [{', '.join(map(_written, x))}]" for key, x in series.items()]


def _damping(damping: Any) -> list[str]:
    if isinstance(damping, jp.model.ModalDamping):
        return _lists({"modal": damping.ratios})
    if damping is not None and damping.ratio is not None:
        return [f"rayleigh = {_written(damping.ratio)}", f"modes = {[*damping.modes]}"]
    numbers = {x: damping and getattr(damping, x) for x in ("mass", "stiffness")}
    return [f"{key} = {_written(x or 0.0)}" for key, x in numbers.items()]


def _law(law: Any) -> list[str]:
    if isinstance(law, jp.Rod):
        brace = [] if law.stiffness is None else [f"stiffness = {_written(law.stiffness)}"]
        return [*_law(law.material), *brace]
    classes = ContactSection.CLASSES | DamperSection.CLASSES
    names = [f'law = "{name}"' for name, kind in classes.items() if isinstance(law, kind)]
    return names + [f"{key} = {_written(x)}" for key, x in vars(law).items() if x is not None]


def _written(value: Any) -> str:
    """A number, word or truth as TOML has it."""
    return json.dumps(value) if isinstance(value, bool | str) else repr(float(value))
