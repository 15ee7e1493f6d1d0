"""What ``jaxpound rare`` prints and writes."""

from __future__ import annotations

import csv
import dataclasses
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import jaxpound as jp
from jaxpound._tables import Table
from jaxpound.cli.files import known, write_figures, write_json, write_text
from jaxpound.cli.reading import File
from jaxpound.quantities import unit
from jaxpound.results.demand import in_words, kind_of


class Target(NamedTuple):
    """The parameter at which the event has the wanted probability."""

    found: jp.Reached
    key: str
    """The parameter as the file has it."""
    scale: float
    """The unit of the dimensionless parameter in SI."""
    unit: str
    before: float
    """The value that the file states."""


@dataclasses.dataclass(frozen=True)
class Found:
    """What a search has found."""

    event: jp.RareEvent
    curve: Sequence[jp.RareEvent]
    """Events at other thresholds, which rise."""
    level: float | None
    """The threshold in SI units; None for pounding."""
    scales: jp.Scales
    target: Target | None = None

    @property
    def unit(self) -> float:
        """The unit of the demand in SI."""
        return float(self.scales.unit_of(kind_of_demand(self.event.limit_state)))

    def threshold(self, event: jp.RareEvent) -> float | None:
        """The threshold of an event in SI units."""
        at = event.limit_state.threshold
        return None if at is None else at * self.unit


def kind_of_demand(state: jp.LimitState) -> str | None:
    """Kind of quantity of the demand; None for a pure number."""
    return kind_of(str(state.demand))


def write_report(file: File, found: Found, out: Path, pdf: bool) -> None:
    """Print the results and write them to a folder."""
    print("\n".join(table.text() for table in tables(found)))

    from jaxpound.plots import rare_events
    from jaxpound.plots.style import drawn

    figures, motion = {}, None
    if len(found.event.design_points):
        figures["design_earthquake"] = drawn(
            rare_events.design_earthquake, found.event, scales=found.scales
        )
        motion = _motion(found)
    if found.curve:
        figures["probability"] = drawn(
            rare_events.probability_curve, found.curve, scales=found.scales
        )
    answers = summary(file, found)
    write_json(out / "summary.json", answers)
    write_text(out / "summary.md", page(found, figures))
    if found.curve:
        write_text(out / "curve.csv", _csv(answers["curve"]))
    if motion is not None:
        write_text(out / "design_earthquake.csv", motion)
    write_figures(figures, out, pdf)


# --- numbers ------------------------------------------------------------------------------------


def summary(file: File, found: Found) -> dict[str, Any]:
    """The search in numbers, for JSON; lengths, times and forces are in SI units."""
    event, time = found.event, float(found.scales.time)
    earthquakes = [
        {"reliability_index": float(np.linalg.norm(z)), "time_s": float(at) * time}
        for z, at in zip(event.design_points, event.instants, strict=True)
    ]
    times, shares = event.failures_by_instant
    answers: dict[str, Any] = known(
        {
            **file.origin,
            "event": event_in_words(found),
            "demand": str(event.limit_state.demand),
            "unit": unit(kind_of_demand(event.limit_state), si=True),
            "random_numbers": event.limit_state.dimension,
            **_numbers(found, event),
            "threshold": found.level,
            "method": event.method,
            "warnings": list(event.warnings),
            "largest_share_of_a_sample": event.largest_share,
            "share_where_samples_are_thin": event.thin,
            "mean_time_of_failure_s": float(times @ shares) * time if len(times) else None,
            "design_earthquakes": earthquakes,
            "curve": [_numbers(found, one) for one in found.curve],
            "design": None if found.target is None else _of_target(found.target),
        }
    )
    return answers


def _numbers(found: Found, event: jp.RareEvent) -> dict[str, Any]:
    estimate = event.estimate
    return {
        "threshold": found.threshold(event),
        "probability": event.probability,
        "low": estimate.low,
        "high": estimate.high,
        "cov": event.cov,
        "reliability_index": event.beta,
        "probability_by_form": event.form,
        "runs": event.runs,
        "gradients": event.gradients,
    }


def _of_target(target: Target) -> dict[str, Any]:
    found, scale = target.found, target.scale
    return {
        "parameter": target.key,
        "unit": target.unit,
        "before": target.before,
        "value": found.value * scale,
        "standard_error": found.error * scale,
        "wanted_probability": found.target,
        "probability": found.event.probability,
        "cov": found.event.cov,
        "runs": found.runs,
        "gradients": found.gradients,
        "warnings": list(found.event.warnings),
        "steps": [
            {
                "value": step.value * scale,
                "probability": step.probability,
                "cov": step.cov,
                "slope_of_ln_probability": step.slope.value / scale,
                "slope_error": step.slope.error / scale,
            }
            for step in found.steps
        ],
    }


def _csv(rows: Sequence[Mapping[str, Any]]) -> str:
    """Rows of one set of keys; what is not known is empty."""
    text = io.StringIO()
    writer = csv.DictWriter(text, [*rows[0]], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _motion(found: Found) -> str:
    """The likeliest earthquake, as ``jaxpound simulate --record`` reads it."""
    first, state = found.event.design_earthquakes[0], found.event.limit_state
    response = jp.simulate(first.structures, first.ground, state.grid, state.scheme)
    time = np.asarray(response.time) * float(found.scales.time)
    rows = zip(time, np.asarray(response.ground_acceleration), strict=True)
    return "".join(f"{t:.9g},{a:.9g}\n" for t, a in rows)


# --- words --------------------------------------------------------------------------------------


def event_in_words(found: Found) -> str:
    """The event, with its threshold in SI units."""
    state, level = found.event.limit_state, found.level
    if level is None:
        return "pounding"
    words = in_words(str(state.demand))
    return f"{words} of {level:g} {unit(kind_of_demand(state), si=True)}".rstrip() + " or more"


def tables(found: Found) -> list[Table]:
    """The results for people, in SI units."""
    (of_event,) = found.event._tables()
    parts = [of_event._replace(title=f"Rare event: {event_in_words(found)}")]
    if found.curve:
        kind = kind_of_demand(found.event.limit_state)
        words = in_words(str(found.event.limit_state.demand))
        columns = (
            f"{words} ({unit(kind, si=True)})" if kind else words,
            "probability", "95 % from", "to", "by FORM", "runs", "gradients",
        )  # fmt: skip
        rows = [
            (found.threshold(one), *one.estimate[:3], one.form, one.runs, one.gradients)
            for one in found.curve
        ]
        notes = [
            f"at {found.threshold(one):.4g}: warning: {said}"
            for one in found.curve
            for said in one.warnings
        ]
        table = Table.of(columns, rows)
        parts.append(table._replace(title="Probability by threshold", notes=notes))
    if found.target is not None:
        parts.append(_table_of_target(found.target))
    return parts


def _table_of_target(target: Target) -> Table:
    found, scale = target.found, target.scale
    of = f" {target.unit}" if target.unit else ""
    columns = ("step", f"{target.key} ({target.unit or '-'})", "probability", "c.o.v.")
    rows = [
        (str(i), step.value * scale, step.probability, step.cov)
        for i, step in enumerate(found.steps, 1)
    ]
    value = f"{found.value * scale:.5g} ± {found.error * scale:.2g}{of}"
    notes = [
        f"{found.runs:,} runs, {found.gradients:,} gradients",
        *(f"warning: {said}" for said in found.event.warnings),
    ]
    title = f"For a probability of {found.target:g}: {target.key} = {value}"
    return Table.of(columns, rows)._replace(title=title, notes=notes)


def page(found: Found, figures: Mapping[str, Any]) -> str:
    """One page."""
    lines = ["# Probability of a rare event", "", f"jaxpound {jp.__version__}.", ""]
    for part in tables(found):
        notes = [f"{note[0].upper()}{note[1:]}." for note in part.notes]
        table = part if any(part.columns) else part._replace(columns=("quantity", "value"))
        lines += [f"## {part.title}", "", table.markdown(), ""]
        lines += [x for note in notes for x in (note.replace("..", "."), "")]
    if "design_earthquake" in figures:
        lines += [
            "The design earthquake is the likeliest ground motion that brings the event about. "
            "design_earthquake.csv has it (time in s, acceleration in g), as "
            "`jaxpound simulate --record design_earthquake.csv --units g` reads it.",
            "",
        ]
    lines += [*(f"![{name.replace('_', ' ')}]({name}.png)" for name in figures), ""]
    return "\n".join(lines)
