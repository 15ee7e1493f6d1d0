"""A design in words and numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jaxpound as jp
from jaxpound.report import cell, known


def summary(design: jp.Design, recorded: Mapping[str, jp.Comparison]) -> dict[str, Any]:
    """What was designed, as JSON can hold it; ``recorded`` are single earthquakes by name."""
    limits = design.objective_function.limits
    return known(
        {
            "units": "SI" if design.trained.si else "dimensionless",
            "objective": design.objective,
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


def _compared(found: jp.Comparison) -> dict[str, Any]:
    before, after = found.pounding
    wider = found.difference()
    return {
        "earthquakes": len(found),
        "objective": {name: x._asdict() for name, x in found.objective.items()},
        "share_that_pounds": {"before": before, "after": after},
        "min_gap_wider_by": wider._asdict(),
        "demands": found.rows(),
    }


def as_markdown(answers: Mapping[str, Any], figures: list[str]) -> str:
    """One page."""
    lines = [
        "# Design of two adjacent structures",
        "",
        f"Objective {answers['objective']:.5g} after {answers['iterations']} iterations of "
        f"{answers['starts']} starts ({answers['stopped']}); start {answers['winner']} won.",
        "",
        "| variable (dimensionless) | before | after | |",
        "|---|---|---|---|",
    ]
    for path, row in answers["variables"].items():
        bound = f"at its {row['at_bound']} bound" if row["at_bound"] else ""
        lines.append(f"| {path} | {row['before']:.5g} | {row['after']:.5g} | {bound} |")
    if answers["limits"]:
        units = answers["units"]
        lines += ["", f"| limit ({units}) | of | at most | reached |", "|---|---|---|---|"]
    for price, row in answers["limits"].items():
        lines.append(f"| {price} | {row['over']} | {row['at_most']:.5g} | {row['reached']:.5g} |")
    kinds = (("trained", "The earthquakes it was made for"), ("fresh", "Fresh earthquakes"))
    for key, words in kinds:
        found = answers[key]
        if found is None:
            continue
        share, wider = found["share_that_pounds"], found["min_gap_wider_by"]
        now = found["objective"]["after"]
        lines += [
            "",
            f"{words}, {found['earthquakes']:,}: {share['before']:.2%} pounded before, "
            f"{share['after']:.2%} after; the smallest gap is wider by {cell(wider['value'])} "
            f"({cell(wider['low'])} to {cell(wider['high'])}, 95 %) on average; the objective is "
            f"{cell(now['value'])} ({cell(now['low'])} to {cell(now['high'])}).",
            "",
            "| demand | mean before | after | 95 % before (min gap 5 %) | after |",
            "|---|---|---|---|---|",
        ]
        for name, row in found["demands"].items():
            lines.append(f"| {name} | " + " | ".join(map(cell, row.values())) + " |")
    for name, row in answers["recorded"].items():
        lines += [
            "",
            f"Recorded earthquake {name}: smallest gap {cell(row['min_gap_before'])} before, "
            f"{cell(row['min_gap_after'])} after.",
        ]
    lines += ["", *(f"![{name.replace('_', ' ')}]({name}.png)" for name in figures), ""]
    return "\n".join(lines)
