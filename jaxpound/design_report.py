"""A design in words and numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import jaxpound as jp


def summary(design: jp.Design, recorded: Mapping[str, jp.Comparison]) -> dict[str, Any]:
    """What was designed, as JSON can hold it; ``recorded`` are single earthquakes by name."""
    limits = design.objective_function.limits
    return _known(
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


def _known(x: Any) -> Any:
    """A tree with None in the place of what is not finite, as JSON can hold it."""
    if isinstance(x, dict):
        return {key: _known(value) for key, value in x.items()}
    if isinstance(x, list):
        return [_known(value) for value in x]
    return None if isinstance(x, float) and not math.isfinite(x) else x


def _cell(x: float | None) -> str:
    return "-" if x is None else f"{x:.4g}"


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
            f"{share['after']:.2%} after; the smallest gap is wider by {_cell(wider['value'])} "
            f"({_cell(wider['low'])} to {_cell(wider['high'])}, 95 %) on average; the objective is "
            f"{_cell(now['value'])} ({_cell(now['low'])} to {_cell(now['high'])}).",
            "",
            "| demand | mean before | after | 95 % before (min gap 5 %) | after |",
            "|---|---|---|---|---|",
        ]
        for name, row in found["demands"].items():
            lines.append(f"| {name} | " + " | ".join(map(_cell, row.values())) + " |")
    for name, row in answers["recorded"].items():
        lines += [
            "",
            f"Recorded earthquake {name}: smallest gap {_cell(row['min_gap_before'])} before, "
            f"{_cell(row['min_gap_after'])} after.",
        ]
    lines += ["", *(f"![{name.replace('_', ' ')}]({name}.png)" for name in figures), ""]
    return "\n".join(lines)
