"""A design in words and numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jaxpound as jp
from jaxpound.cli.config import UNITS, in_si
from jaxpound.cli.report import cell, known, markdown_table, text_table
from jaxpound.model import parameters
from jaxpound.results.demand import in_words, unit_of


def summary(
    design: jp.Design, recorded: Mapping[str, jp.Comparison], scales: jp.Scales
) -> dict[str, Any]:
    """What was designed, as JSON can hold it; ``recorded`` are single earthquakes by name.

    ``variables`` are dimensionless; ``answer`` and ``rods`` say in SI units what they mean.
    """
    limits, si = design.objective_function.limits, design.trained.si
    free = getattr(design.objective_function.goal, "size", None) is not None
    before: Any = parameters.put(design.space.nominal, design.start)
    return known(
        {
            "units": "SI" if si else "dimensionless",
            "objective": design.objective,
            "objective_unit": "" if free else unit_of("min_gap", si),
            "answer": _answer(design, before, scales),
            "rods": _rods(design, before, scales),
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
                    "at_most": limit.at_most,
                    "over": limit.over,
                    "reached": design.prices[price],
                    "multiplier": design.multipliers[price],
                }
                for price, limit in limits.items()
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
                    "min_gap_before": float(found.before["min_gap"][0]),
                    "min_gap_after": float(found.after["min_gap"][0]),
                }
                for name, found in recorded.items()
            },
        }
    )


def _answer(
    design: jp.Design, before: jp.AdjacentStructures, scales: jp.Scales
) -> list[dict[str, Any]]:
    """What an engineer asks of the design: damper, gap, and both buildings as oscillators."""
    told = []
    for structures in (before, design.structures):
        *buildings, force, gap = scales.buildings(structures)
        quantities = {
            ("slip force of the damper", "N", "friction"): force,
            ("gap at rest", "m", "initial_gap"): gap,
        }
        for i, building in enumerate(buildings, start=1):
            whose = f"of building {i}"
            quantities |= {
                (f"natural period {whose}", "s", ""): building.natural_period,
                (f"damping ratio {whose}", "%", ""): 100 * building.damping_ratio,
            }
        quantities |= {
            ("mass of building 2", "kg", "mass_ratio"): buildings[1].mass,
            ("stiffness of building 2", "N/m", "stiffness_ratio"): buildings[1].stiffness,
        }
        told.append(quantities)
    chosen = design.space.names
    return [
        _changed(words, unit, told[0][key], told[1][key], design.active_bounds.get(path))
        for key in told[0]
        for words, unit, path in [key]
        if not path.endswith("_ratio") or path in chosen
    ]


def _rods(
    design: jp.Design, before: jp.AdjacentStructures, scales: jp.Scales
) -> list[dict[str, Any]]:
    """The rods' parameters that were chosen, in SI units."""
    first, last = (in_si(structures, scales) for structures in (before, design.structures))
    return [
        _changed(
            path,
            UNITS[path.rpartition(".")[2]],
            parameters.get(first, path),
            parameters.get(last, path),
            design.active_bounds.get(path),
        )
        for path in design.space.names
        if path.startswith("rod_")
    ]


def _changed(words: str, unit: str, before: Any, after: Any, bound: str | None) -> dict[str, Any]:
    before, after = float(before), float(after)
    return {
        "quantity": words,
        "unit": unit,
        "before": before,
        "after": after,
        "change": after - before,
        "relative_change": after / before - 1 if before else None,
        "at_bound": bound,
    }


def _compared(found: jp.Comparison) -> dict[str, Any]:
    before, after = found.pounding
    wider = found.difference()
    return {
        "earthquakes": len(found),
        "objective": {name: x._asdict() for name, x in found.objective.items()},
        "share_that_pounds": {"before": before, "after": after},
        "min_gap_wider_by": wider._asdict(),
        "demands": {
            name: {"unit": unit_of(name, found.si)} | row for name, row in found.rows().items()
        },
    }


def as_text(answers: Mapping[str, Any]) -> str:
    """The answer as text for the screen."""
    return "\n".join(text_table([_shown("quantity", row) for row in answers["answer"]]))


def as_markdown(answers: Mapping[str, Any], figures: list[str]) -> str:
    """One page."""
    unit = answers["objective_unit"]
    gap_unit = unit_of("min_gap", answers["units"] == "SI")
    lines = [
        "# Design of two adjacent structures",
        "",
        f"Objective {_with(answers['objective'], unit)} after {answers['iterations']} iterations "
        f"of {answers['starts']} starts ({answers['stopped']}); start {answers['winner']} won.",
        "",
        *markdown_table([_shown("quantity", row) for row in answers["answer"]]),
        "",
        "Natural periods and damping ratios are those of an equivalent viscous oscillator.",
    ]
    if answers["rods"]:
        lines += [
            "",
            *markdown_table([_shown("parameter of a rod", row) for row in answers["rods"]]),
        ]
    if answers["limits"]:
        rows = [
            {
                "limit": in_words(price),
                "unit": row["unit"],
                "of": _over(row["over"]),
                "at most": row["at_most"],
                "reached": row["reached"],
                "reached / at most": f"{row['reached'] / row['at_most']:.1%}",
            }
            for price, row in answers["limits"].items()
        ]
        lines += ["", *markdown_table(rows)]
    kinds = (("trained", "The earthquakes it was made for"), ("fresh", "Fresh earthquakes"))
    for key, words in kinds:
        if (found := answers[key]) is None:
            continue
        share, wider = found["share_that_pounds"], found["min_gap_wider_by"]
        lines += [
            "",
            f"{words}, {found['earthquakes']:,}: {share['before']:.2%} pounded before, "
            f"{share['after']:.2%} after; the smallest gap is wider by "
            f"{_estimated(wider, gap_unit)} on average; the objective is "
            f"{_estimated(found['objective']['after'], unit)}.",
        ]
        for tail, names in _tails(found["demands"]).items():
            rows = [
                {
                    "demand": in_words(name),
                    "unit": row["unit"],
                    "mean before": row["mean_before"],
                    "mean after": row["mean_after"],
                    f"{tail} before": row["tail_before"],
                    f"{tail} after": row["tail_after"],
                }
                for name, row in names.items()
            ]
            lines += ["", *markdown_table(rows)]
    if answers["recorded"]:
        rows = [
            {
                "recorded earthquake": name,
                "unit": gap_unit,
                "smallest gap before": row["min_gap_before"],
                "smallest gap after": row["min_gap_after"],
            }
            for name, row in answers["recorded"].items()
        ]
        lines += ["", *markdown_table(rows)]
    lines += ["", *(f"![{name.replace('_', ' ')}]({name}.png)" for name in figures), ""]
    return "\n".join(lines)


def _shown(what: str, row: Mapping[str, Any]) -> dict[str, Any]:
    """A row of what changed, for a table."""
    relative, bound = row["relative_change"], row["at_bound"]
    return {
        what: row["quantity"],
        "unit": row["unit"],
        "before": row["before"],
        "after": row["after"],
        "change": row["change"],
        "relative change": "-" if relative is None else f"{relative:+.1%}",
        "at a bound": f"the {bound} one" if bound else "no",
    }


def _tails(demands: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Demands by the quantile that is their bad end: a gap is bad where it is small."""
    gap = {name: row for name, row in demands.items() if name == "min_gap"}
    others = {name: row for name, row in demands.items() if name not in gap}
    return {"5 % quantile": gap, "95 % quantile": others}


def _over(over: str | float) -> str:
    named = {"worst": "the worst earthquake", "mean": "the mean"}
    return named[over] if isinstance(over, str) else f"the mean of the worst {over:.0%}"


def _with(number: float | None, unit: str) -> str:
    return f"{cell(number)} {unit}".rstrip()


def _estimated(estimate: Mapping[str, Any], unit: str) -> str:
    value = _with(estimate["value"], unit)
    if estimate["low"] is None and estimate["high"] is None:
        return f"{value} (no 95 % interval)"
    ends = f"{cell(estimate['low'])} to {_with(estimate['high'], unit)}"
    return f"{value} (95 % interval {ends})"
