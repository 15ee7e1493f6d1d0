"""The report of ``jaxpound design``: numbers for JSON, and tables beside those of the design."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import zip_longest
from typing import Any

import jaxpound as jp
from jaxpound._tables import TextTable
from jaxpound.cli.parameters import Parameters
from jaxpound.model.parameters import put
from jaxpound.quantities import unit
from jaxpound.results.named import in_words, unit_of, viscous_forces

_WHEN = ("before", "after")


def answer_of(design: jp.design.Design, parameters: Parameters) -> list[dict[str, Any]]:
    """The design in words: what was chosen, and what follows for dampers and buildings."""
    ends: list[Any] = [put(design.space.nominal, design.start), design.structures]
    rows: list[tuple[Any, ...]] = [
        (parameters.in_words(path), parameters.unit_of(path), before, design.values[path])
        for path, before in design.start.items()
    ]
    systems = [buildings.system() for buildings in ends]
    forces = [[*(link.friction for link in x.links), *viscous_forces(x)] for x in systems]
    rows.append(("forces of all dampers together", "N", *map(sum, forces)))
    names = [path.split(".") for path in design.space.names]
    for b in sorted({int(number) for kind, number, *_ in names if kind == "buildings"}):
        of_both = [x.buildings[b] for x in ends]
        periods = [building.natural_period for building in of_both]
        rows.append((f"natural period of building {b + 1}", "s", *periods))
        percent = [100 * building.modes().damping_ratios[0] for building in of_both]
        rows.append((f"damping ratio of the first mode of building {b + 1}", "%", *percent))
    bounds = [design.active_bounds.get(path) for path in design.start]
    pairs = zip_longest(rows, bounds)
    return [_change(*row) | {"at_bound": bound} for row, bound in pairs]


def _change(words: str, symbol: str, *ends: Any) -> dict[str, Any]:
    before, after = map(float, ends)
    return {
        "quantity": words,
        "unit": symbol,
        "before": before,
        "after": after,
        "change": after - before,
        "relative_change": after / before - 1 if before else None,
    }


def summary(
    design: jp.design.Design,
    answer: Sequence[Mapping[str, Any]],
    recorded: Mapping[str, jp.design.Comparison],
) -> dict[str, Any]:
    """Summary of a design for JSON; ``recorded`` are single earthquakes by name."""
    si, demand, bounds = design.trained.si, design.objective_function.demand, design.active_bounds
    return {
        "units": "SI",
        "objective": design.objective,
        "objective_unit": unit(design.objective_function.quantity, si),
        "answer": [*answer],
        "variables": {
            path: {"before": before, "after": design.values[path], "at_bound": bounds.get(path)}
            for path, before in design.start.items()
        },
        "limits": {
            name: {
                "unit": unit_of(name, si),
                **vars(limit),
                "cov": design.events[name].cov if name in design.events else None,
                "reached": design.limited_demands[name],
                "multiplier": design.multipliers[name],
                "active": name in design.active_limits,
            }
            for name, limit in design.objective_function.limits.items()
        },
        "gradient_within_bounds": design.gradient_norm,
        "winner": design.winner + 1,
        "starts": design.history.objective.shape[1],
        "dropped_starts": [i + 1 for i in design.dropped],
        "iterations": design.history.objective.shape[0],
        "stopped": design.stopped,
        "simulations_with_gradient": design.simulations,
        "trained": _compared(design.trained),
        "fresh": None if design.fresh is None else _compared(design.fresh),
        "recorded": {
            name: {f"{demand}_{x}": float(getattr(shaken, x)[demand][0]) for x in _WHEN}
            for name, shaken in recorded.items()
        },
        "demand": demand,
    }


def _compared(comparison: jp.design.Comparison) -> dict[str, Any]:
    objective = {name: x._asdict() for name, x in comparison.objective.items()}
    answers: dict[str, Any] = {"earthquakes": len(comparison), "objective": objective}
    if comparison.has_gaps:
        answers["share_that_pounds"] = dict(zip(_WHEN, comparison.pounding, strict=True))
        answers["min_gap_wider_by"] = comparison.difference("min_gap")._asdict()
    demands = comparison.rows().items()
    return answers | {
        "hardly_slipping": list(comparison.hardly_slipping),
        "demand_changes_by": comparison.difference()._asdict(),
        "demands": {name: {"unit": unit_of(name, comparison.si)} | row for name, row in demands},
    }


def tables_of(
    design: jp.design.Design,
    answer: Sequence[Mapping[str, Any]],
    recorded: Mapping[str, jp.design.Comparison],
) -> list[TextTable]:
    """The tables of the screen and the page: what changed, the design's own, and the recorded."""
    keys, cells = ("unit", "before", "after", "change"), []
    for row in answer:
        share, bound = row["relative_change"], row["at_bound"]
        relative = "-" if share is None else f"{share:+.1%}"
        at_bound = f"the {bound} one" if bound else "no"
        cells.append((row["quantity"], *(row[key] for key in keys), relative, at_bound))
    changes = TextTable.of(("quantity", *keys, "relative change", "at a bound"), cells)
    demand, of_design = design.objective_function.demand, design.trained
    ends = [f"{in_words(demand, of_design.topology)} {when}" for when in _WHEN]
    symbol = unit_of(demand, of_design.si)
    rows: list[Any] = [
        (name, symbol, *(float(getattr(x, when)[demand][0]) for when in _WHEN))
        for name, x in recorded.items()
    ]
    shaken = [TextTable.of(("recorded earthquake", "unit", *ends), rows)] if rows else []
    return [changes, *design._tables(), *shaken]
