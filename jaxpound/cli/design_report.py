"""The report of ``jaxpound design``: numbers for JSON, and a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import jaxpound as jp
from jaxpound._tables import TextTable, rounded
from jaxpound.cli.files import json_safe
from jaxpound.cli.parameters import Parameters
from jaxpound.model.parameters import get, metadata, put
from jaxpound.model.topology import Topology
from jaxpound.quantities import unit
from jaxpound.results.named import in_words, unit_of, viscous_forces

_WHEN = ("before", "after")


def summary(
    design: jp.Design, recorded: Mapping[str, jp.Comparison], parameters: Parameters
) -> dict[str, Any]:
    """Summary of a design for JSON; ``recorded`` are single earthquakes by name.

    ``variables`` are dimensionless; ``answer`` and ``rods`` give them in SI units.
    """
    si, demand = design.trained.si, design.objective_function.demand
    before: Any = put(design.space.nominal, design.start)
    chosen = _chosen(design, before, parameters)
    is_pair = isinstance(before, jp.AdjacentStructures)
    return json_safe(
        {
            "units": "SI" if si else "dimensionless",
            "objective": design.objective,
            "objective_unit": unit(design.objective_function.quantity, si),
            "answer": _answer(design, before, parameters) if is_pair else chosen,
            "rods": chosen if is_pair else None,
            "variables": {
                path: {
                    "before": design.start[path],
                    "after": value,
                    "at_bound": design.active_bounds.get(path),
                }
                for path, value in design.values.items()
            },
            "limits": {
                price: {
                    "unit": unit_of(price, si),
                    **vars(limit),
                    "cov": design.events[price].cov if price in design.events else None,
                    "reached": design.prices[price],
                    "multiplier": design.multipliers[price],
                    "active": price in design.active_limits,
                }
                for price, limit in design.objective_function.limits.items()
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
                name: {
                    f"{demand}_{when}": float(columns[demand][0])
                    for when, columns in zip(_WHEN, (shaken.before, shaken.after), strict=True)
                }
                for name, shaken in recorded.items()
            },
            "demand": demand,
        }
    )


def _answer(design: jp.Design, before: Any, parameters: Parameters) -> list[dict[str, Any]]:
    """The design in an engineer's terms: damper, gap, both buildings as oscillators, contact."""
    of_contact = [path for path in design.space.names if path.startswith("contact.")]
    columns = []
    for structures in (before, design.structures):
        pair: Any = parameters.buildings(structures)
        (left, right), (link,) = pair.buildings, pair.links
        oscillators = [x for b in (left, right) for x in (b.natural_period, 100 * b.damping_ratio)]
        contact = [get(link, path) for path in of_contact]
        of_second = right.mass, right.stiffness
        columns.append([link.friction, link.gap, *oscillators, *of_second, *contact])
    rows = [
        ("slip force of the damper", "N", "friction"),
        ("gap at rest", "m", "initial_gap"),
        ("natural period of building 1", "s", ""),
        ("damping ratio of building 1", "%", ""),
        ("natural period of building 2", "s", ""),
        ("damping ratio of building 2", "%", ""),
        ("mass of building 2", "kg", "mass_ratio"),
        ("stiffness of building 2", "N/m", "stiffness_ratio"),
    ]
    of_path = {path: metadata(design.structures, path) for path in of_contact}
    rows += [(x.words, unit(x.kind, si=True), path) for path, x in of_path.items()]
    return [
        _change(design, words, symbol, old, new, path)
        for (words, symbol, path), old, new in zip(rows, *columns, strict=True)
        if not path.endswith("_ratio") or path in design.space.names
    ]


def _chosen(design: jp.Design, before: Any, parameters: Parameters) -> list[dict[str, Any]]:
    """The chosen parameters in SI units: of a row, with its slip forces, or of a pair's rods."""
    ends, rows = [parameters.in_si(x) for x in (before, design.structures)], []
    is_row = isinstance(before, jp.Row)
    for path in design.space.names:
        if is_row or path.startswith("rod_"):
            words = parameters.in_words(path) if is_row else path
            old, new = (get(structures, path) for structures in ends)
            rows.append(_change(design, words, parameters.unit_of(path), old, new, path))
    if is_row:
        systems = [structures.system() for structures in ends]
        forces = [[*(link.friction for link in x.links), *viscous_forces(x)] for x in systems]
        old, new = map(sum, forces)
        rows.append(_change(design, "forces of all dampers together", "N", old, new))
    return rows


def _change(
    design: jp.Design, words: str, symbol: str, before: Any, after: Any, path: str = ""
) -> dict[str, Any]:
    before, after = float(before), float(after)
    return {
        "quantity": words,
        "unit": symbol,
        "before": before,
        "after": after,
        "change": after - before,
        "relative_change": after / before - 1 if before else None,
        "at_bound": design.active_bounds.get(path),
    }


def _compared(comparison: jp.Comparison) -> dict[str, Any]:
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


def parts_of_page(answers: Mapping[str, Any], topology: Topology | None) -> list[str | TextTable]:
    """Paragraphs and tables on a design, from its summary; ``topology`` has places of demands."""
    of_row, demand = answers["rods"] is None, answers["demand"]
    parts: list[str | TextTable] = [
        f"Objective {_with(answers['objective'], answers['objective_unit'])} after "
        f"{answers['iterations']} iterations of {answers['starts']} starts "
        f"({answers['stopped']}); start {answers['winner']} won.",
        changes("quantity", answers["answer"]),
    ]
    if not of_row:
        parts.append(
            "Natural periods and damping ratios are those of an equivalent viscous oscillator."
        )
    if answers["rods"]:
        parts.append(changes("parameter of a rod", answers["rods"]))
    if answers["limits"]:
        rows = [_limit_row(price, x, topology) for price, x in answers["limits"].items()]
        columns = ("limit", "unit", "of", "at most", "reached", "reached / at most", "active")
        parts.append(TextTable.of(columns, rows))
    kinds = {"trained": "The earthquakes it was made for", "fresh": "Fresh earthquakes"}
    for key, words in kinds.items():
        if answers[key] is not None:
            parts.append(_sentence(words, key, answers, topology))
            parts += _demands(answers[key]["demands"], topology)
    if answers["recorded"]:
        ends = [f"{in_words(demand, topology)} {when}" for when in _WHEN]
        of_demand = unit_of(demand, answers["units"] == "SI")
        records = [(name, of_demand, *row.values()) for name, row in answers["recorded"].items()]
        parts.append(TextTable.of(("recorded earthquake", "unit", *ends), records))
    return parts


def _limit_row(price: str, limit: Mapping[str, Any], topology: Topology | None) -> tuple[Any, ...]:
    words, reached, probability = in_words(price, topology), limit["reached"], limit["probability"]
    active = "yes" if limit["active"] else "no"
    if probability is None:
        share = f"{reached / limit['at_most']:.1%}"
        of = {"worst": "the worst earthquake", "mean": "the mean"}.get(limit["over"])
        of = of or f"the mean of the worst {limit['over']:.0%}"
        return words, limit["unit"], of, limit["at_most"], reached, share, active
    event = "pounding"
    if limit["at_most"] is not None:
        event = f"{words} >= {limit['at_most']:g} {limit['unit']}"
    numbers = f"{probability:.3g}", f"{reached:.3g}", f"{reached / probability:.1%}"
    return f"probability of {event}", "", "a random earthquake", *numbers, active


def _sentence(words: str, key: str, answers: Mapping[str, Any], topology: Topology | None) -> str:
    """The changes in the earthquakes of a comparison, which ``words`` name."""
    comparison = answers[key]
    demand, si = answers["demand"], answers["units"] == "SI"
    parts = []
    if share := comparison.get("share_that_pounds"):
        parts.append(f"{share['before']:.2%} pounded before, {share['after']:.2%} after")
        wider = _estimated(comparison["min_gap_wider_by"], unit_of("min_gap", si))
        parts.append(f"the smallest gap is wider by {wider} on average")
    if demand != "min_gap":
        change = _estimated(comparison["demand_changes_by"], unit_of(demand, si))
        parts.append(f"the {in_words(demand, topology)} changes by {change} on average")
    parts += [f"the {damper} practically never slips" for damper in comparison["hardly_slipping"]]
    objective = _estimated(comparison["objective"]["after"], answers["objective_unit"])
    parts.append(f"the objective is {objective}")
    return f"{words}, {comparison['earthquakes']:,}: {'; '.join(parts)}."


def _demands(demands: Mapping[str, Any], topology: Topology | None) -> list[TextTable]:
    parts = []
    # For a gap the unfavourable tail is the lower one.
    for tail, of_gaps in (("5 % quantile", True), ("95 % quantile", False)):
        selected = {x: row for x, row in demands.items() if x.startswith("min_gap") == of_gaps}
        ends = [f"{statistic} {when}" for statistic in ("mean", tail) for when in _WHEN]
        if rows := [(in_words(name, topology), *row.values()) for name, row in selected.items()]:
            parts.append(TextTable.of(("demand", "unit", *ends), rows))
    return parts


def changes(heading: str, rows: Sequence[Mapping[str, Any]]) -> TextTable:
    """What changed, for the screen and the page."""
    keys, cells = ("unit", "before", "after", "change"), []
    for row in rows:
        share, bound = row["relative_change"], row["at_bound"]
        relative = "-" if share is None else f"{share:+.1%}"
        at_bound = f"the {bound} one" if bound else "no"
        cells.append((row["quantity"], *(row[key] for key in keys), relative, at_bound))
    return TextTable.of((heading, *keys, "relative change", "at a bound"), cells)


def _with(number: float | None, unit: str) -> str:
    return f"{rounded(number)} {unit}".rstrip()


def _estimated(estimate: Mapping[str, Any], unit: str) -> str:
    value = _with(estimate["value"], unit)
    if estimate["low"] is None and estimate["high"] is None:
        return f"{value} (no 95 % interval)"
    return f"{value} (95 % interval {rounded(estimate['low'])} to {_with(estimate['high'], unit)})"
