"""``jaxpound report``: a study in words, numbers and figures."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

import jaxpound as jp
from jaxpound._tables import Table, rounded
from jaxpound.cli.files import known, make_folder, write_figures, write_json, write_text
from jaxpound.results.demand import in_words, known_of, unit_of
from jaxpound.study.statistics import Estimate

PROBABILITIES = (0.1, 0.05, 0.01, 0.001)
"""Probabilities of exceedance for which the required gap is reported."""

INTENSITIES = {
    "pga": "PGA",
    "pgv": "PGV",
    "spectral_acceleration_1": "$S_a(T_1)$",
    "spectral_acceleration_2": "$S_a(T_2)$",
}
"""Measures of intensity for which fragility is reported, if the study has them."""

_QUANTILES = {0.05: "5 % quantile", 0.5: "median", 0.95: "95 % quantile"}
_MOST_CORRELATIONS = 8

_RULES = {"absolute_sum": "absolute sum", "srss": "SRSS", "double_difference": "double difference"}
_IMPACTS = ("number of impacts", "probability", "95 % interval")
_GAPS = ("exceeded with probability", "unit", "required gap", "95 % interval", *_RULES.values())
_DEMANDS = ("demand", "unit", "mean", "standard deviation", *_QUANTILES.values(), "largest")
_ERRORS = ("median θ", "standard error of θ", "dispersion β", "standard error of β")
_FRAGILITY = ("fragility by", "unit", *_ERRORS)


# --- the command --------------------------------------------------------------------------------


def run(args: argparse.Namespace) -> None:
    """Run the command."""
    study = jp.Study.open(args.store)
    curves = fragilities(study)
    answers = summary(study, curves)
    make_folder(args.out)

    from jaxpound.plots import studies as plots
    from jaxpound.plots.style import figure

    drawn: dict[str, Callable[[Any, Any], Any]] = {
        "min_gap": plots.min_gap,
        "convergence": plots.convergence,
    }
    if "required_gap" in study.columns:
        drawn["required_gap"] = partial(plots.exceedance, rules_at=0.05)
    figures = {name: figure(draw, study) for name, draw in drawn.items()}
    for name, curve in curves.items():
        words = f"{INTENSITIES[name]} ({unit_of(name, study.scales is not None)})"
        figures[f"fragility_by_{name}"] = figure(partial(plots.fragility, intensity=words), curve)
    if study.about["identity"]["parameters"]:
        column = correlated(study)
        figures["correlations"] = figure(partial(plots.correlations, column=column), study)
        figures["parameters"] = plots.scatter_matrix(study, [column])
    if "configuration" in (study.about["notes"] or {}):
        write_text(args.out / "study.toml", study.about["notes"]["configuration"])
    write_json(args.out / "summary.json", answers)
    write_text(args.out / "summary.md", page(answers, list(figures)))
    write_figures(figures, args.out, args.pdf)


# --- the report ---------------------------------------------------------------------------------


def fragilities(study: jp.Study) -> dict[str, jp.Fragility]:
    """Pounding against every measure of intensity to which a curve can be fitted."""
    curves, pounds = {}, study["pounds"]
    for name in INTENSITIES:
        if name in study.columns:
            im = study[name]
            good = np.isfinite(pounds) & (im > 0)
            with contextlib.suppress(ValueError):  # the likelihood has no maximum
                curves[name] = jp.fit_fragility(im[good], pounds[good] == 1)
    return curves


def correlated(study: jp.Study) -> str:
    """The column whose correlations are reported; with contact there is no required gap."""
    return "required_gap" if "required_gap" in study.columns else "peak_impulse"


def summary(study: jp.Study, curves: Mapping[str, jp.Fragility]) -> dict[str, Any]:
    """The study's statistics, with its ``fragilities``, as JSON can hold them."""
    identity, si = study.about["identity"], study.scales is not None
    required_gap, demands, correlation = {}, {}, None
    for p in PROBABILITIES if "required_gap" in study.columns else ():
        found = study.separation(p)
        rules = {rule: getattr(found, rule) for rule in _RULES}
        required_gap[str(p)] = _interval(found.required_gap) | rules
        correlation = found.correlation
    for name in study.columns:
        if name in identity["parameters"] or name == "pounds":
            continue
        m, finite = study.moments(name), study.finite(name)
        quantiles = [float(np.quantile(finite, q)) if finite.size else np.nan for q in _QUANTILES]
        demands[name] = {
            "unit": unit_of(name, si),
            "mean": m.mean,
            "std": m.std,
            **dict(zip((f"quantile_{q:g}" for q in _QUANTILES), quantiles, strict=True)),
            "largest": m.largest,
        }
    column = correlated(study)
    correlations = study.correlations(column) if identity["parameters"] else {}
    certain = {name: value for name, value in correlations.items() if np.isfinite(value)}
    ranked = sorted(certain, key=lambda name: -abs(certain[name]))[:_MOST_CORRELATIONS]
    counts = study.counts() if "n_impacts" in study.columns else {}
    return known(
        {
            "made_by": identity["versions"],
            "samples": len(study),
            "samples_asked_for": study.about["n"],
            "failed": study.failed,
            "sampling": identity["sampling"],
            "units": "SI" if si else "dimensionless",
            "grid": {"dt": identity["grid"]["dt"], "n_steps": identity["grid"]["n_steps"]},
            "pounding_probability": _interval(study.pounding_probability()),
            "required_gap": required_gap,
            "demands": demands,
            "impacts": {str(k): _interval(x) for k, x in counts.items()},
            f"correlations_with_{column}": {name: certain[name] for name in ranked},
            "fragility": {
                name: {
                    "unit": unit_of(name, si),
                    "median": curve.median,
                    "median_error": curve.median_error,
                    "dispersion": curve.dispersion,
                    "dispersion_error": curve.dispersion_error,
                }
                for name, curve in curves.items()
            },
            "double_difference_correlation": correlation,
        }
    )


def _interval(estimate: Estimate) -> dict[str, float]:
    return {"value": estimate.value, "low": estimate.low, "high": estimate.high}


def page(answers: dict[str, Any], figures: list[str]) -> str:
    """One page."""
    si = answers["units"] == "SI"
    p = answers["pounding_probability"]
    complete = answers["samples"] == answers["samples_asked_for"]
    of = unit_of("required_gap", si)
    gaps = [
        (share, of, row["value"], _ends(row), *(row[rule] for rule in _RULES))
        for share, row in answers["required_gap"].items()
    ]
    demands = [
        (in_words(name), unit or ("-" if known_of(name) else "of the measure"), *numbers)
        for name, (unit, *numbers) in ((x, y.values()) for x, y in answers["demands"].items())
    ]
    lines = [
        "# Monte Carlo study of two adjacent structures",
        "",
        f"{answers['samples']:,} scenarios"
        + ("" if complete else f" of {answers['samples_asked_for']:,} asked for (unfinished)")
        + f", {answers['failed']:,} failed; {answers['sampling']} sampling; "
        f"jaxpound {answers['made_by']['jaxpound']}. Intervals are of 95 %."
        + ("" if si else " Units are those of the dimensionless system."),
        "",
        f"**Probability of pounding: {rounded(p['value'])} ({_ends(p)})**",
        "",
    ]
    if gaps:
        lines += [
            Table.of(_GAPS, gaps).markdown(),
            "",
            "The rules of codes combine the peak displacements that are exceeded with the same "
            "probability; the double difference's correlation coefficient is "
            f"{answers['double_difference_correlation']:.3g}. They were made for buildings without "
            "a damper between them.",
            "",
        ]
    if impacts := answers["impacts"]:
        rows = [(k, x["value"], _ends(x)) for k, x in impacts.items()]
        lines += [
            Table.of(_IMPACTS, rows).markdown(),
            "",
            "The gap that would be required cannot be told from buildings that meet: leave out "
            "[contact] for it. The time of the first impact is that of the scenarios with one.",
            "",
        ]
    lines.append(Table.of(_DEMANDS, demands).markdown())
    for column in ("required_gap", "peak_impulse"):
        if correlations := answers.get(f"correlations_with_{column}"):
            told = ", ".join(f"{name} {value:+.2f}" for name, value in correlations.items())
            lines += ["", f"Rank correlation with the {in_words(column)}: {told}."]
    if fragility := answers["fragility"]:
        rows = [(in_words(name), *curve.values()) for name, curve in fragility.items()]
        table = Table.of(_FRAGILITY, rows).markdown()
        lines += ["", table, "", "The dispersion is that of the logarithm."]
    lines += ["", *(f"![{name.replace('_', ' ')}]({name}.png)" for name in figures), ""]
    return "\n".join(lines)


def _ends(estimate: dict[str, Any]) -> str:
    ends = (estimate["low"], estimate["high"])
    return " to ".join("not known" if x is None else rounded(x) for x in ends)
