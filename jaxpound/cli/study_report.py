"""A Monte Carlo study in words and numbers."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from typing import Any

import numpy as np

import jaxpound as jp
from jaxpound.cli.report import cell, known, markdown_table
from jaxpound.results.demand import in_words, unit_of
from jaxpound.study.statistics import Estimate

PROBABILITIES = (0.1, 0.05, 0.01, 0.001)
"""Probabilities of exceedance for which the required gap is told."""

INTENSITIES = {
    "pga": "PGA",
    "pgv": "PGV",
    "spectral_acceleration_1": "$S_a(T_1)$",
    "spectral_acceleration_2": "$S_a(T_2)$",
}
"""Measures of intensity by which fragility is told, where the study has them."""

_QUANTILES = {0.05: "5 % quantile", 0.5: "median", 0.95: "95 % quantile"}
_MOST_CORRELATIONS = 8


def summary(study: jp.Study, curves: Mapping[str, jp.Fragility]) -> dict[str, Any]:
    """The study's answers, with its ``fragilities``, as JSON can hold them."""
    identity = study.about["identity"]
    answers: dict[str, Any] = {
        "made_by": identity["versions"],
        "samples": len(study),
        "samples_asked_for": study.about["n"],
        "failed": study.failed,
        "sampling": identity["sampling"],
        "units": "SI" if study.scales is not None else "dimensionless",
        "grid": {"dt": identity["grid"]["dt"], "n_steps": identity["grid"]["n_steps"]},
        "pounding_probability": _numbers(study.pounding_probability()),
        "required_gap": {},
        "demands": {},
        "correlations_with_required_gap": {},
        "fragility": {
            name: {
                "unit": intensity_unit(study, name),
                "median": curve.median,
                "median_error": curve.median_error,
                "dispersion": curve.dispersion,
                "dispersion_error": curve.dispersion_error,
            }
            for name, curve in curves.items()
        },
    }
    for p in PROBABILITIES:
        found = study.separation(p)
        answers["required_gap"][str(p)] = _numbers(found.required_gap) | {
            "absolute_sum": found.absolute_sum,
            "srss": found.srss,
            "double_difference": found.double_difference,
        }
        answers["double_difference_correlation"] = found.correlation
    for name in study.columns:
        if name in identity["parameters"] or name == "pounds":
            continue
        m = study.moments(name)
        quantiles = np.quantile(study.finite(name), list(_QUANTILES)).tolist()
        row = {
            "unit": unit_of(name, study.scales is not None),
            "mean": m.mean,
            "std": m.std,
            **dict(zip((f"quantile_{q:g}" for q in _QUANTILES), quantiles, strict=True)),
            "largest": m.largest,
        }
        answers["demands"][name] = known(row)
    if identity["parameters"]:
        found_ = {k: v for k, v in study.correlations().items() if np.isfinite(v)}
        ranked = sorted(found_, key=lambda name: -abs(found_[name]))[:_MOST_CORRELATIONS]
        answers["correlations_with_required_gap"] = {name: found_[name] for name in ranked}
    return answers


def fragilities(study: jp.Study) -> dict[str, jp.Fragility]:
    """Pounding against every measure of intensity to which a curve can be fitted."""
    curves, pounds = {}, study["pounds"]
    for name in INTENSITIES:
        if name in study.columns:
            im = study[name]
            good = np.isfinite(pounds) & (im > 0)
            with contextlib.suppress(ValueError):  # pounding never, always, or whatever the shaking
                curves[name] = jp.fit_fragility(im[good], pounds[good] == 1)
    return curves


def intensity_unit(study: jp.Study, name: str) -> str:
    """Unit of a measure of intensity."""
    return unit_of(name, study.scales is not None)


def _numbers(estimate: Estimate) -> dict[str, float | None]:
    """Value and interval; an end that is not known is None."""
    return known({"value": estimate.value, "low": estimate.low, "high": estimate.high})


def as_markdown(answers: dict[str, Any], figures: list[str]) -> str:
    """One page."""
    si = answers["units"] == "SI"
    p = answers["pounding_probability"]
    complete = answers["samples"] == answers["samples_asked_for"]
    lines = [
        "# Monte Carlo study of two adjacent structures",
        "",
        f"{answers['samples']:,} scenarios"
        + ("" if complete else f" of {answers['samples_asked_for']:,} asked for (unfinished)")
        + f", {answers['failed']:,} failed; {answers['sampling']} sampling; "
        f"jaxpound {answers['made_by']['jaxpound']}. Intervals are of 95 %."
        + ("" if si else " Units are those of the dimensionless system."),
        "",
        f"**Probability of pounding: {cell(p['value'])} ({_interval(p)})**",
        "",
        *markdown_table(
            [
                {
                    "exceeded with probability": share,
                    "unit": unit_of("required_gap", si),
                    "required gap": row["value"],
                    "95 % interval": _interval(row),
                    "absolute sum": row["absolute_sum"],
                    "SRSS": row["srss"],
                    "double difference": row["double_difference"],
                }
                for share, row in answers["required_gap"].items()
            ]
        ),
        "",
        "The rules of codes combine the peak displacements that are exceeded with the same "
        "probability; the double difference's correlation coefficient is "
        f"{answers['double_difference_correlation']:.3g}. They were made for buildings without a "
        "damper between them.",
        "",
        *markdown_table(
            [
                {
                    "demand": in_words(name),
                    "unit": row["unit"] or "of the measure",
                    "mean": row["mean"],
                    "standard deviation": row["std"],
                    **{words: row[f"quantile_{q:g}"] for q, words in _QUANTILES.items()},
                    "largest": row["largest"],
                }
                for name, row in answers["demands"].items()
            ]
        ),
    ]
    if correlations := answers["correlations_with_required_gap"]:
        told = ", ".join(f"{name} {value:+.2f}" for name, value in correlations.items())
        lines += ["", f"Rank correlation with the required gap: {told}."]
    if fragility := answers["fragility"]:
        rows = [
            {
                "fragility by": in_words(name),
                "unit": curve["unit"],
                "median θ": curve["median"],
                "standard error of θ": curve["median_error"],
                "dispersion β": curve["dispersion"],
                "standard error of β": curve["dispersion_error"],
            }
            for name, curve in fragility.items()
        ]
        lines += ["", *markdown_table(rows), "", "The dispersion is that of the logarithm."]
    lines += ["", *(f"![{name.replace('_', ' ')}]({name}.png)" for name in figures), ""]
    return "\n".join(lines)


def _interval(estimate: dict[str, Any]) -> str:
    ends = (estimate["low"], estimate["high"])
    return " to ".join("not known" if x is None else cell(x) for x in ends)
