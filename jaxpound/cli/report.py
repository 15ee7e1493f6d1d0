"""``jaxpound report``: the page, the numbers and the figures of a study."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import jaxpound as jp
from jaxpound._tables import TextTable
from jaxpound.cli import files
from jaxpound.model.parameters import in_words as path_in_words
from jaxpound.model.places import link_places
from jaxpound.results.named import in_words, unit_of
from jaxpound.study.fragility import ANY_LINK
from jaxpound.study.gaps import RULES
from jaxpound.study.statistics import Estimate

PROBABILITIES = (0.1, 0.05, 0.01, 0.001)  # of exceedance, for which required gaps are reported

_INTENSITIES = ("pga", "pgv", "spectral_acceleration_")  # starts of the names of columns

_QUANTILES = {0.05: "5 % quantile", 0.5: "median", 0.95: "95 % quantile"}
_MOST_CORRELATIONS = 8

_DEMANDS = ("demand", "unit", "mean", "standard deviation", *_QUANTILES.values(), "largest")
_ERRORS = ("median θ", "standard error of θ", "dispersion β", "standard error of β")


def run(args: argparse.Namespace) -> None:
    """Run the command."""
    study = jp.Study.open(args.store)
    curves, by_link = fragilities(study), fragilities_of_links(study)
    answers = summary(study, curves, by_link)
    files.make_folder(args.out)
    if args.table is not None:
        write_table(study, args.table)

    from jaxpound.plots import studies as plots
    from jaxpound.plots.style import drawn

    figures = {"min_gap": drawn(plots.min_gap, study)}
    figures["convergence"] = drawn(plots.convergence, study)
    if "required_gap" in study.columns:
        rules_at = 0.05 if is_pair(study) else None
        figures["required_gap"] = drawn(plots.exceedance, study, rules_at=rules_at)
    for name, curve in curves.items():
        figures[f"fragility_by_{name}"] = drawn(plots.fragility, curve)
    if by_link:
        pga = str(study.measure("pga"))
        figures["fragility_of_links"] = drawn(plots.fragility, by_link, intensity=pga)
    if study.about["identity"]["parameters"]:
        column = correlated(study)
        figures["correlations"] = drawn(plots.correlations, study, column=column)
        figures["parameters"] = drawn(plots.scatter_matrix, study, [column])
    if "configuration" in (study.about["notes"] or {}):
        files.write_files(args.out, {"study.toml": study.about["notes"]["configuration"]})
    parts = parts_of_page(answers, study.checked_floors)
    files.write_report(args, answers, "Monte Carlo study of buildings", parts, figures)


def write_table(study: jp.Study, path: Path) -> None:
    """Write a row for each sample to a file of the format that its name ends in.

    Raises ``ValueError`` for another ending, or without a library that writes the format.
    """
    formats = {".csv": study.to_csv, ".parquet": study.to_parquet}
    if path.suffix not in formats:
        raise ValueError(f"argument --table: {path} must end in {' or '.join(formats)}")
    try:
        files.write_files(path.parent, {path.name: formats[path.suffix]})
    except ImportError as error:
        raise ValueError(f"argument --table: {error}") from error


def fragilities(study: jp.Study) -> dict[str, jp.study.Fragility]:
    """Pounding against every measure of intensity to which a curve can be fitted."""
    names = [name for name in study.columns if name.startswith(_INTENSITIES)]
    return {name: curve for name in names if (curve := _fragility(study, name))}


def fragilities_of_links(study: jp.Study) -> dict[str, jp.study.Fragility]:
    """Pounding against PGA at each of several links that can close, and at any of them."""
    places, numbers = link_places(study.topology), several_links(study)
    links = {places[k]: k for k in numbers} | ({ANY_LINK: None} if len(numbers) > 1 else {})
    return {name: curve for name, k in links.items() if (curve := _fragility(study, "pga", k))}


def several_links(study: jp.Study) -> tuple[int, ...]:
    """The links that can close, where there are several links."""
    return study.closable_links if study.n_links > 1 else ()


def _fragility(study: jp.Study, name: str, link: int | None = None) -> jp.study.Fragility | None:
    """Of one link or of any; None where the likelihood has no maximum."""
    with contextlib.suppress(ValueError):
        return study.fragility(name, link=link)
    return None


def is_pair(study: jp.Study) -> bool:
    """Whether the study is of two buildings of one storey, to which codes' rules apply."""
    return study.about["oscillators"] is not None


def of_links(study: jp.Study, curves: Mapping[str, jp.study.Fragility]) -> list[dict[str, Any]]:
    """Each link of several that has a gap: its place, its pounding, and its fragility by PGA."""
    places, rows = link_places(study.topology), []
    for k in several_links(study):
        curve = curves.get(places[k])
        row: dict[str, Any] = {"link": k + 1, "between": places[k], **_of_pounding(study, k)}
        row["fragility_by_pga"] = None if curve is None else files.of_fragility(curve)
        if f"n_impacts_{k + 1}" in study.columns:
            row |= {
                "mean_number_of_impacts": study.moments(f"n_impacts_{k + 1}").mean,
                "largest_contact_force": study.moments(f"peak_contact_{k + 1}").largest,
            }
        rows.append(row)
    return rows


def _of_pounding(study: jp.Study, link: int | None = None) -> dict[str, Any]:
    """How likely pounding is, and the gaps against it, at a link or at any."""
    column = "required_gap" if link is None else f"required_gap_{link + 1}"
    asked = PROBABILITIES if column in study.columns else ()
    return {
        "pounding_probability": study.pounding_probability(link=link)._asdict(),
        "required_gap": {str(p): study.required_gap(p, link=link)._asdict() for p in asked},
    }


def correlated(study: jp.Study) -> str:
    """The column whose correlations are reported; with contact there is no required gap."""
    return "required_gap" if "required_gap" in study.columns else "peak_impulse"


def summary(
    study: jp.Study,
    curves: Mapping[str, jp.study.Fragility],
    by_link: Mapping[str, jp.study.Fragility],
) -> dict[str, Any]:
    """The study's statistics, with its ``fragilities`` and ``fragilities_of_links``, for JSON."""
    identity, si = study.about["identity"], study.si
    demands, correlation, pounding = {}, None, _of_pounding(study)
    for p, gap in pounding["required_gap"].items() if is_pair(study) else ():
        separation = study.separation(float(p))
        gap |= {rule: getattr(separation, rule) for rule in RULES}
        correlation = separation.correlation
    for name in (x for x in study.shown_columns() if x != "pounds"):
        moments, finite = study.moments(name), study.finite(name)
        if not finite.size and not is_pair(study):  # the gap of a damper without one
            continue
        quantiles = [float(np.quantile(finite, q)) if finite.size else np.nan for q in _QUANTILES]
        demands[name] = {
            "name": in_words(name, study.topology),
            "unit": unit_of(name, si),
            "mean": moments.mean,
            "std": moments.std,
            **dict(zip((f"quantile_{q:g}" for q in _QUANTILES), quantiles, strict=True)),
            "largest": moments.largest,
        }
    column = correlated(study)
    correlations = study.correlations(column) if identity["parameters"] else {}
    defined = [(name, value) for name, value in correlations.items() if np.isfinite(value)]
    ranked = sorted(defined, key=lambda item: -abs(item[1]))[:_MOST_CORRELATIONS]
    counts = study.counts() if "n_impacts" in study.columns else {}
    return {
        "made_by": identity["versions"],
        "samples": len(study),
        "samples_asked_for": study.about["n"],
        "failed": study.failed,
        "sampling": identity["sampling"],
        "units": "SI" if si else "dimensionless",
        "grid": {"dt": identity["grid"]["dt"], "n_steps": identity["grid"]["n_steps"]},
        **pounding,
        "demands": demands,
        "impacts": {str(k): x._asdict() for k, x in counts.items()},
        f"correlations_with_{column}": dict(ranked),
        "fragility": {
            name: {"unit": unit_of(name, si)} | files.of_fragility(curve)
            for name, curve in curves.items()
        },
        "double_difference_correlation": correlation,
        "links": of_links(study, by_link),
    }


def _estimate(answer: Mapping[str, float]) -> str:
    """An estimate of the summary with its interval, as the library prints it."""
    return str(Estimate(*(answer[key] for key in Estimate._fields)))


def _links_parts(links: list[dict[str, Any]], si: bool) -> list[str | TextTable]:
    rows, force, pga = [], f"({unit_of('peak_contact', si)})", f"({unit_of('pga', si)})"
    for link in links:
        gaps, curve = link["required_gap"], link["fragility_by_pga"] or {}
        row = {"link": str(link["link"]), "between": link["between"]}
        row["probability of pounding"] = _estimate(link["pounding_probability"])
        for p in PROBABILITIES[:3]:
            gap = gaps.get(str(p), {}).get("value")
            row[f"gap ({unit_of('required_gap', si)}) at {p}"] = gap
        row["mean number of impacts"] = link.get("mean_number_of_impacts")
        row[f"largest force {force}"] = link.get("largest_contact_force")
        row[f"median θ by PGA {pga}"] = curve.get("median")
        rows.append(row | {"dispersion β": curve.get("dispersion")})
    parts: list[str | TextTable] = [files.table_of(rows)]
    if any(link["required_gap"] for link in links):
        parts.append("A gap at a probability is that at which the link pounds so often.")
    if not all(link["fragility_by_pga"] for link in links):
        parts.append("No fragility curve fits a link that pounds always, never or at random.")
    return parts


def parts_of_page(answers: dict[str, Any], checked_floors: str) -> list[str | TextTable]:
    """The paragraphs and tables on a study, from its summary; as ``Study.checked_floors``."""
    si, links, asked_for = answers["units"] == "SI", answers["links"], answers["samples_asked_for"]
    unfinished = f" of {asked_for:,} asked for (unfinished)"
    parts: list[str | TextTable] = [
        f"{answers['samples']:,} scenarios{unfinished if answers['samples'] != asked_for else ''}, "
        f"{answers['failed']:,} failed; {answers['sampling']} sampling; "
        f"jaxpound {answers['made_by']['jaxpound']}."
        + ("" if si else " Units are those of the dimensionless system."),
        f"**Probability of pounding{' at any link' if links else ''}{checked_floors}: "
        f"{_estimate(answers['pounding_probability'])}**",
    ]
    if gaps := answers["required_gap"]:
        correlation = answers["double_difference_correlation"]
        rules = RULES if correlation is not None else {}
        rows = [(p, _estimate(gap), *(gap[rule] for rule in rules)) for p, gap in gaps.items()]
        heading = f"required gap ({unit_of('required_gap', si)})"
        parts.append(TextTable.of(("exceeded with probability", heading, *rules.values()), rows))
        if rules:
            parts.append(
                "The rules of codes combine the peak displacements that are exceeded with the same "
                f"probability; the double difference's correlation coefficient is "
                f"{correlation:.3g}. They were made for buildings without a damper between them."
            )
    if links:
        parts += _links_parts(links, si)
    if impacts := answers["impacts"]:
        counts = [(n, _estimate(share)) for n, share in impacts.items()]
        parts += [
            TextTable.of(("number of impacts", "probability"), counts),
            "The gap that would be required cannot be told from buildings that meet: leave out "
            "[contact] for it. The time of the first impact is that of the scenarios with one.",
        ]
    demands = [
        (name, unit or "-", *x) for name, unit, *x in map(dict.values, answers["demands"].values())
    ]
    parts.append(TextTable.of(_DEMANDS, demands))
    for column in ("required_gap", "peak_impulse"):
        if correlations := answers.get(f"correlations_with_{column}"):
            words = (path_in_words(path).replace(", ", " ") for path in correlations)
            values = [f"{x} {y:+.2f}" for x, y in zip(words, correlations.values(), strict=True)]
            parts.append(f"Rank correlation with the {in_words(column)}: {', '.join(values)}.")
    if fragility := answers["fragility"]:
        curves = [(in_words(name), *curve.values()) for name, curve in fragility.items()]
        table = TextTable.of(("fragility by", "unit", *_ERRORS), curves)
        parts += [table, "The dispersion is that of the logarithm."]
    return parts
