"""What ``jaxpound design`` tells of a design: numbers as JSON can hold them, and a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import jaxpound as jp
from jaxpound._tables import Table as Lines
from jaxpound._tables import rounded
from jaxpound.cli.files import known as finite
from jaxpound.cli.pair import UNITS
from jaxpound.cli.parameters import Parameters, RowParameters, in_si
from jaxpound.model.parameters import get, known, put
from jaxpound.model.system import Topology
from jaxpound.quantities import unit
from jaxpound.results.demand import in_words, unit_of


def summary(
    design: jp.Design,
    recorded: Mapping[str, jp.Comparison],
    scales: jp.Scales,
    parameters: Parameters,
) -> dict[str, Any]:
    """Summary of a design, as JSON can hold it; ``recorded`` are single earthquakes by name.

    ``variables`` are dimensionless; ``answer`` and ``rods`` give them in SI units.
    """
    si, demand = design.trained.si, design.objective_function.demand
    before: Any = put(design.space.nominal, design.start)
    return finite(
        {
            "units": "SI" if si else "dimensionless",
            "objective": design.objective,
            "objective_unit": unit(design.objective_function.quantity, si),
            **(
                {"answer": _chosen(design, before, parameters), "rods": None}
                if isinstance(parameters, RowParameters)
                else {
                    "answer": _answer(design, before, scales),
                    "rods": _rods(design, before, scales),
                }
            ),
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
                    for when, columns in (("before", found.before), ("after", found.after))
                }
                for name, found in recorded.items()
            },
            "demand": demand,
        }
    )


def _answer(
    design: jp.Design, before: jp.AdjacentStructures, scales: jp.Scales
) -> list[dict[str, Any]]:
    """The design in an engineer's terms: damper, gap, both buildings as oscillators, contact."""
    of_contact = [path for path in design.space.names if path.startswith("contact.")]
    told = []
    for structures in (before, design.structures):
        left, right, force, gap = scales.buildings(structures)
        oscillators = [x for b in (left, right) for x in (b.natural_period, 100 * b.damping_ratio)]
        contact = [get(in_si(structures, scales), path) for path in of_contact]
        told.append([force, gap, *oscillators, right.mass, right.stiffness, *contact])
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
    for path in of_contact:
        about = known(design.structures, path)
        rows.append((about.words, unit(about.kind, si=True), path))
    return [
        _changed(words, of, old, new, design.active_bounds.get(path))
        for (words, of, path), old, new in zip(rows, *told, strict=True)
        if not path.endswith("_ratio") or path in design.space.names
    ]


def _chosen(design: jp.Design, before: jp.Row, parameters: RowParameters) -> list[dict[str, Any]]:
    """The parameters of a row that were chosen, and the sum of its slip forces, in SI units."""
    first, last = parameters.in_si(before), parameters.in_si(design.structures)
    told = [
        _changed(
            parameters.in_words(path),
            parameters.unit_of(path),
            get(first, path),
            get(last, path),
            design.active_bounds.get(path),
        )
        for path in design.space.names
    ]
    old, new = (sum(float(link.friction) for link in x.links) for x in (first, last))
    return [*told, _changed("slip forces of all dampers together", "N", old, new, None)]


def _rods(
    design: jp.Design, before: jp.AdjacentStructures, scales: jp.Scales
) -> list[dict[str, Any]]:
    """The rods' parameters that were chosen, in SI units."""
    first, last = in_si(before, scales), in_si(design.structures, scales)
    told = []
    for path in design.space.names:
        if path.startswith("rod_"):
            of, bound = UNITS[path.rpartition(".")[2]], design.active_bounds.get(path)
            told.append(_changed(path, of, get(first, path), get(last, path), bound))
    return told


def _changed(words: str, of: str, before: Any, after: Any, bound: str | None) -> dict[str, Any]:
    """A quantity and its unit, before and after, and the bound at which it is."""
    before, after = float(before), float(after)
    return {
        "quantity": words,
        "unit": of,
        "before": before,
        "after": after,
        "change": after - before,
        "relative_change": after / before - 1 if before else None,
        "at_bound": bound,
    }


def _compared(found: jp.Comparison) -> dict[str, Any]:
    gaps = {}
    if found.has_gaps:
        gaps = {
            "share_that_pounds": dict(zip(("before", "after"), found.pounding, strict=True)),
            "min_gap_wider_by": found.difference("min_gap")._asdict(),
        }
    return {
        "earthquakes": len(found),
        "objective": {name: x._asdict() for name, x in found.objective.items()},
        **gaps,
        "hardly_slipping": list(found.hardly_slipping),
        "demand_changes_by": found.difference()._asdict(),
        "demands": {
            name: {"unit": unit_of(name, found.si)} | row for name, row in found.rows().items()
        },
    }


def page(answers: Mapping[str, Any], figures: list[str], topology: Topology | None) -> str:
    """One page; ``topology`` says where the demands of the structures are."""
    of_row = answers["rods"] is None
    of_objective, demand = answers["objective_unit"], answers["demand"]
    of_demand = unit_of(demand, answers["units"] == "SI")
    lines = [
        f"# Design of {'buildings in a row' if of_row else 'two adjacent structures'}",
        "",
        f"Objective {_with(answers['objective'], of_objective)} after {answers['iterations']} "
        f"iterations of {answers['starts']} starts ({answers['stopped']}); start "
        f"{answers['winner']} won.",
        "",
        changes("quantity", answers["answer"]).markdown(),
    ]
    if not of_row:
        words = "Natural periods and damping ratios are those of an equivalent viscous oscillator."
        lines += ["", words]
    if answers["rods"]:
        lines += ["", changes("parameter of a rod", answers["rods"]).markdown()]
    if answers["limits"]:
        rows = [
            (
                in_words(price, topology),
                x["unit"],
                _over(x["over"]),
                x["at_most"],
                x["reached"],
                f"{x['reached'] / x['at_most']:.1%}",
                "yes" if x["active"] else "no",
            )
            if x["probability"] is None
            else (
                _rarely(price, x, topology),
                "",
                "a random earthquake",
                f"{x['probability']:.3g}",
                f"{x['reached']:.3g}",
                f"{x['reached'] / x['probability']:.1%}",
                "yes" if x["active"] else "no",
            )
            for price, x in answers["limits"].items()
        ]
        columns = ("limit", "unit", "of", "at most", "reached", "reached / at most", "active")
        lines += ["", Lines.of(columns, rows).markdown()]
    kinds = (("trained", "The earthquakes it was made for"), ("fresh", "Fresh earthquakes"))
    for key, words in kinds:
        if answers[key] is not None:
            lines += ["", _sentence(words, answers[key], answers, topology)]
            lines += _demands(answers[key]["demands"], topology)
    if answers["recorded"]:
        ends = [f"{in_words(demand, topology)} {when}" for when in ("before", "after")]
        rows = [(name, of_demand, *row.values()) for name, row in answers["recorded"].items()]
        lines += ["", Lines.of(("recorded earthquake", "unit", *ends), rows).markdown()]
    lines += ["", *(f"![{name.replace('_', ' ')}]({name}.png)" for name in figures), ""]
    return "\n".join(lines)


def _rarely(price: str, limit: Mapping[str, Any], topology: Topology | None) -> str:
    """An event whose probability is limited, in words."""
    if limit["at_most"] is None:
        return "probability of pounding"
    words = f"{in_words(price, topology)} >= {limit['at_most']:g} {limit['unit']}"
    return f"probability of {words}"


def _sentence(
    words: str, found: Mapping[str, Any], answers: Mapping[str, Any], topology: Topology | None
) -> str:
    """What became of the earthquakes that ``words`` name."""
    demand, si = answers["demand"], answers["units"] == "SI"
    parts = []
    if share := found.get("share_that_pounds"):
        parts.append(f"{share['before']:.2%} pounded before, {share['after']:.2%} after")
        wider = _estimated(found["min_gap_wider_by"], unit_of("min_gap", si))
        parts.append(f"the smallest gap is wider by {wider} on average")
    if demand != "min_gap":
        change = _estimated(found["demand_changes_by"], unit_of(demand, si))
        parts.append(f"the {in_words(demand, topology)} changes by {change} on average")
    parts += [f"the {damper} practically never slips" for damper in found["hardly_slipping"]]
    objective = _estimated(found["objective"]["after"], answers["objective_unit"])
    parts.append(f"the objective is {objective}")
    return f"{words}, {found['earthquakes']:,}: {'; '.join(parts)}."


def _demands(demands: Mapping[str, Any], topology: Topology | None) -> list[str]:
    """Tables of demands before and after, of gaps and of all others."""
    lines = []
    # For a gap the unfavourable tail is the lower one.
    for tail, of_gaps in (("5 % quantile", True), ("95 % quantile", False)):
        rows = [
            (in_words(name, topology), *row.values())
            for name, row in demands.items()
            if name.startswith("min_gap") == of_gaps
        ]
        ends = [f"{what} {when}" for what in ("mean", tail) for when in ("before", "after")]
        if rows:
            lines += ["", Lines.of(("demand", "unit", *ends), rows).markdown()]
    return lines


def changes(what: str, rows: Sequence[Mapping[str, Any]]) -> Lines:
    """What changed, for the screen and the page."""
    columns = (what, "unit", "before", "after", "change", "relative change", "at a bound")
    numbers = ("quantity", "unit", "before", "after", "change")
    told = [
        (
            *(row[key] for key in numbers),
            "-" if row["relative_change"] is None else f"{row['relative_change']:+.1%}",
            f"the {row['at_bound']} one" if row["at_bound"] else "no",
        )
        for row in rows
    ]
    return Lines.of(columns, told)


def _over(over: str | float) -> str:
    named = {"worst": "the worst earthquake", "mean": "the mean"}
    return named[over] if isinstance(over, str) else f"the mean of the worst {over:.0%}"


def _with(number: float | None, of: str) -> str:
    return f"{rounded(number)} {of}".rstrip()


def _estimated(estimate: Mapping[str, Any], of: str) -> str:
    value = _with(estimate["value"], of)
    if estimate["low"] is None and estimate["high"] is None:
        return f"{value} (no 95 % interval)"
    return f"{value} (95 % interval {rounded(estimate['low'])} to {_with(estimate['high'], of)})"
