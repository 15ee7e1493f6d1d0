"""Parameters as factors on the values of a file: random ones, and bounds of those to be chosen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import NormalDist
from typing import Annotated, Any, Literal

import jax
import numpy as np

import jaxpound as jp
from jaxpound.cli.pair import UNITS
from jaxpound.cli.parameters import Parameters, by_path, parameters_of
from jaxpound.cli.reading import File, Range, Table, between, named
from jaxpound.cli.structures import Structured
from jaxpound.cli.tables import Stated
from jaxpound.model.parameters import get, put
from jaxpound.model.system import Structures
from jaxpound.study.distributions import RARE

FACTOR = Range(0, 1e6, "", "a factor on the value above")
Factor = Annotated[float, between(*FACTOR)]


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


def uncertain_structures(
    place: str, table: Mapping[str, Stated], known: Parameters, correlation: float | None = None
) -> jp.UncertainStructures:
    """Structures whose parameters are multiples of the stated ones by random factors."""
    for key, factor in table.items():
        factor.require(f"{place} {key}", FACTOR)
    stated = by_path(place, table, known)
    with named(f"{place}, in SI units:", keys=known.key_of):
        physical = jp.UncertainStructures(known.si, _multiples(place, stated, known.si))
    # Each parameter at both ends of its range, the others at their medians.
    z = NormalDist().inv_cdf(RARE)
    ends = np.array([z, -z])[:, None, None] * np.eye(len(stated))
    rows = jax.jit(jax.vmap(jax.vmap(physical.parameters)))(ends)
    extremes = []
    for i, (path, (key, factor)) in enumerate(stated.items()):
        where = f"{place} {key} = {factor}, once in {1 / RARE:,.0f} draws:"
        for end in (0, 1):
            with named(where, keys=known.key_of):
                at = put(known.si, {x: float(rows[x][end, i]) for x in stated})
            extremes.append((where, path, at))
    _require_plausible(extremes, known)
    with named(f"{place}:", keys=known.key_of):
        return jp.UncertainStructures(
            known.nominal, _multiples(place, stated, known.nominal), correlation
        )


def random_scenarios(
    file: File,
    given: Structured,
    ground: Any,
    uncertain: Mapping[str, Stated],
    correlation: float | None = None,
) -> jp.Scenarios:
    """The structures of a file under a random ground motion, with what is uncertain of them."""
    structures: Any = given.structures
    if uncertain:
        place = f"{file.name}: [uncertain]"
        structures = uncertain_structures(place, uncertain, parameters_of(given.form), correlation)
    elif not ground.dimension:
        rule = "[uncertain], a factor on the record, or several records"
        raise ValueError(f"{file.name}: nothing is random; it must have {rule}")
    return jp.Scenarios(structures, ground)


def design_space(place: str, table: Mapping[str, Bounds], known: Parameters) -> jp.DesignSpace:
    """Structures whose parameters may be chosen between multiples of the stated ones."""
    # In SI units first, for messages in the units of the file.
    stated = by_path(place, table, known)
    bounds = _multiples(place, stated, known.si)
    with named(place, UNITS, known.key_of):
        physical = jp.DesignSpace(known.si, bounds)
        start = physical.shares(known.si)
    extremes = []
    for i, path in enumerate(physical.names):
        key, factors = stated[path]
        for end in (0.0, 1.0):
            shares = start.copy()
            shares[i] = end
            values = {x: float(y) for x, y in physical.numbers(shares).items()}
            where = f"{place} {key} = {factors}, at a bound:"
            extremes.append((where, path, put(known.si, values)))
    _require_plausible(extremes, known)
    return jp.DesignSpace(known.nominal, _multiples(place, stated, known.nominal))


def _multiples(
    place: str, stated: Mapping[str, tuple[str, Stated | Bounds]], structures: Structures
) -> dict[str, Any]:
    """The distributions or bounds of the parameters themselves, by path."""
    made = {}
    for path, (key, factor) in stated.items():
        with named(f"{place} {key}:"):
            made[path] = factor.times(float(get(structures, path)))
    return made


def _require_plausible(extremes: Sequence[tuple[str, str, Any]], known: Parameters) -> None:
    """A ``ValueError`` for a parameter that can leave the plausible range of its key.

    ``extremes`` are a place in a file, the path of a parameter, and the structures in SI units
    where it has an extreme value. Natural periods, which depend on all parameters of a building,
    are checked last.
    """
    for place, path, at in extremes:
        known.require(place, path, at)
    for place, path, at in extremes:
        known.require_periods(place, path, at)
