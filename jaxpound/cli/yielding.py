"""Storeys that yield: their strength, the law by which they yield, and the weight that they carry.

The keys stand beside those of a building: in [[building]], or in [building_1] and [building_2].
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from types import NoneType
from typing import Annotated, Any, Literal

import jaxpound as jp
from jaxpound.cli.reading import Section, between, each, named, of_field, refused, says, shown
from jaxpound.model.parameters import paths
from jaxpound.model.shear_building import STRENGTHS

_LAWS: dict[str, Any] = {"bilinear": jp.Bilinear, "bouc-wen": jp.BoucWen, "elastic": NoneType}
_OF_STOREY = "yield_displacement"  # of each storey, by its strength

_Law = Annotated[
    Literal["bilinear", "bouc-wen"] | list[Literal["bilinear", "bouc-wen", "elastic"]],
    says('"bilinear" or "bouc-wen", or a list of these and "elastic", one for each storey'),
]
_Force = Annotated[float, between(*STRENGTHS["yield_force"])]
_Coefficient = Annotated[float, between(*STRENGTHS["base_shear_coefficient"])]
_Drift = Annotated[float, between(*STRENGTHS["yield_drift"])]
_Hardening = Annotated[float, of_field(jp.BoucWen, "hardening")]
_Ultimate = Annotated[float, of_field(jp.BoucWen, "ultimate_displacement")]
_Exponent = Annotated[float, of_field(jp.BoucWen, "exponent")]
_Beta = Annotated[float, of_field(jp.BoucWen, "beta")]
_Degradation = Annotated[float, of_field(jp.BoucWen, "strength_degradation")]
_Degradations = Annotated[_Degradation | list[_Degradation], each(_Degradation)]


class YieldingSection(Section):
    """A strength, a law and the law's parameters, and whether weights act at drifts."""

    yield_force: Annotated[_Force | list[_Force], each(_Force)] | None = None
    base_shear_coefficient: _Coefficient | None = None
    yield_drift: Annotated[_Drift | list[_Drift], each(_Drift)] | None = None
    law: _Law | None = None
    hardening: Annotated[_Hardening | list[_Hardening], each(_Hardening)] | None = None
    ultimate_displacement: Annotated[_Ultimate | list[_Ultimate], each(_Ultimate)] | None = None
    exponent: Annotated[_Exponent | list[_Exponent], each(_Exponent)] | None = None
    beta: Annotated[_Beta | list[_Beta], each(_Beta)] | None = None
    strength_degradation: _Degradations | None = None
    stiffness_degradation: _Degradations | None = None
    p_delta: bool | None = None

    def yielding(self, building: jp.ShearBuilding) -> jp.ShearBuilding:
        """A building with this strength and under its weight; a ``ValueError`` for a fault."""
        stated = {key: x for key, x in self.stated().items() if key in YIELDING}
        p_delta = stated.pop("p_delta", False)
        if stated:
            law = stated.pop("law", "bilinear")
            laws = law if isinstance(law, list) else [law] * building.n_floors
            if len(laws) != building.n_floors:
                raise refused("law", f"must be one for each of {building.n_floors} storeys")
            keys = {x: [key for key in paths(_LAWS[x]) if key != _OF_STOREY] for x in laws}
            own = dict.fromkeys(itertools.chain(*keys.values()))
            remedy = f"give {', '.join(own)}" if own else "leave law out, or let a storey yield"
            rule = f"must not be given with law = {shown(law)}; {remedy}"
            self.refuse_any({*paths(jp.BoucWen)} - own.keys(), rule)  # which has those of Bilinear
            by_law = {"elastic": building}
            for name in keys.keys() - by_law.keys():
                numbers = {key: x for key, x in stated.items() if key in (*STRENGTHS, *keys[name])}
                with named(""):
                    by_law[name] = building.yielding(_LAWS[name], **numbers)
            storeys = [by_law[name].storeys[i] for i, name in enumerate(laws)]
            storeys += building.storeys[building.n_floors :]
            building = dataclasses.replace(building, storeys=tuple(storeys))
        with named("p_delta:"):
            return building.with_p_delta() if p_delta else building


YIELDING = YieldingSection.__struct_fields__  # keys of a building that yields, or of its weight


def keys_of(storeys: Sequence[jp.Building]) -> dict[str, list[Any]]:
    """The numbers of storeys that yield by key, storey by storey; none where no storey yields.

    Raises ``InvalidInput`` where a file cannot have them: storeys of another law.
    """
    laws: list[Any] = [storey.hysteresis for storey in storeys]
    names = [name for law in laws for name, kind in _LAWS.items() if type(law) is kind]
    if len(names) < len(laws):
        rule = f"must be by a law of a file, {' or '.join(_LAWS)}"
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
