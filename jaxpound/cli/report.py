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
from jaxpound.model.parameters import in_words as in_words_of
from jaxpound.model.places import link_places
from jaxpound.results.demand import in_words, kind_of, known_of, unit_of
from jaxpound.study.fragility import ANY_LINK
from jaxpound.study.statistics import Estimate

PROBABILITIES = (0.1, 0.05, 0.01, 0.001)
"""Probabilities of exceedance for which the required gap is reported."""

_SYMBOLS = {"pga": "PGA", "pgv": "PGV"}
_SPECTRAL = "spectral_acceleration_"
"""Start of the names of spectral accelerations at the natural periods, if the study has them."""

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
    curves, by_link = fragilities(study), fragilities_of_links(study)
    answers = summary(study, curves, by_link)
    make_folder(args.out)

    from jaxpound.plots import studies as plots
    from jaxpound.plots.style import drawn

    drawings: dict[str, Callable[[Any], Any]] = {
        "min_gap": plots.min_gap,
        "convergence": plots.convergence,
    }
    if "required_gap" in study.columns:
        rules_at = 0.05 if is_pair(study) else None
        drawings["required_gap"] = partial(plots.exceedance, rules_at=rules_at)
    figures = {name: drawn(draw, study) for name, draw in drawings.items()}
    for name, curve in curves.items():
        figures[f"fragility_by_{name}"] = drawn(_over(study, name), curve)
    if by_link:
        figures["fragility_of_links"] = drawn(_over(study, "pga"), by_link)
    if study.about["identity"]["parameters"]:
        column = correlated(study)
        figures["correlations"] = drawn(plots.correlations, study, column=column)
        figures["parameters"] = drawn(plots.scatter_matrix, study, [column])
    if "configuration" in (study.about["notes"] or {}):
        write_text(args.out / "study.toml", study.about["notes"]["configuration"])
    write_json(args.out / "summary.json", answers)
    write_text(args.out / "summary.md", page(answers, list(figures)))
    write_figures(figures, args.out, args.pdf)


def _over(study: jp.Study, name: str) -> Callable[[Any, Any], Any]:
    """The drawing of fragility over a measure of intensity."""
    from jaxpound.plots import studies as plots
    from jaxpound.plots.style import unit_for

    kind = kind_of(name)
    factor, unit = unit_for(kind, study.scales is not None, 0.0) if kind else (1.0, "")
    return partial(plots.fragility, intensity=f"{_symbol(name)} ({unit})", unit=1 / factor)


# --- the report ---------------------------------------------------------------------------------


def fragilities(study: jp.Study) -> dict[str, jp.Fragility]:
    """Pounding against every measure of intensity to which a curve can be fitted."""
    names = [name for name in study.columns if name in _SYMBOLS or name.startswith(_SPECTRAL)]
    found = {name: _fragility(study, name) for name in names}
    return {name: curve for name, curve in found.items() if curve is not None}


def fragilities_of_links(study: jp.Study) -> dict[str, jp.Fragility]:
    """Pounding against PGA at each of several links that can close, and at any of them.

    Those to which a curve can be fitted, by the name of the link in figures.
    """
    links, places = _closing(study), link_places(study.topology)
    curves = {places[k]: _fragility(study, "pga", k) for k in links}
    if len(links) > 1:
        curves[ANY_LINK] = _fragility(study, "pga")
    return {name: curve for name, curve in curves.items() if curve is not None}


def _closing(study: jp.Study) -> list[int]:
    """Each link of several that has a gap, by number from 0."""
    n = study.n_links
    return [k for k in range(n if n > 1 else 0) if study.finite(f"min_gap_{k + 1}").size]


def _fragility(study: jp.Study, name: str, link: int | None = None) -> jp.Fragility | None:
    """Of one link or of any; None where the likelihood has no maximum."""
    im, pounding = study[name], study.pounding(link=link)
    good = np.isfinite(pounding) & (im > 0)
    with contextlib.suppress(ValueError):
        return jp.fit_fragility(im[good], pounding[good] == 1)
    return None


def _symbol(name: str) -> str:
    """A measure of intensity as figures have it."""
    return _SYMBOLS.get(name) or f"$S_a(T_{name.removeprefix(_SPECTRAL)})$"


def is_pair(study: jp.Study) -> bool:
    """Whether the study is of two buildings of one storey, to which codes' rules apply."""
    return study.about["oscillators"] is not None


def of_links(study: jp.Study, curves: Mapping[str, jp.Fragility]) -> list[dict[str, Any]]:
    """Each link of several that has a gap: its place, its pounding and its fragility by PGA.

    ``curves`` are ``fragilities_of_links``.
    """
    known_gaps, places = study.columns, link_places(study.topology)
    told = []
    for k in _closing(study):
        curve = curves.get(places[k])
        row: dict[str, Any] = {
            "link": k + 1,
            "between": places[k],
            "pounding_probability": _interval(study.pounding_probability(link=k)),
            "fragility_by_pga": None if curve is None else _of_curve(curve),
            "required_gap": {
                str(p): _interval(study.required_gap(p, link=k))
                for p in (PROBABILITIES if f"required_gap_{k + 1}" in known_gaps else ())
            },
        }
        if f"n_impacts_{k + 1}" in known_gaps:
            row |= {
                "mean_number_of_impacts": study.moments(f"n_impacts_{k + 1}").mean,
                "largest_contact_force": study.moments(f"peak_contact_{k + 1}").largest,
            }
        told.append(row)
    return told


def _of_curve(curve: jp.Fragility) -> dict[str, float]:
    return {
        "median": curve.median,
        "median_error": curve.median_error,
        "dispersion": curve.dispersion,
        "dispersion_error": curve.dispersion_error,
    }


def correlated(study: jp.Study) -> str:
    """The column whose correlations are reported; with contact there is no required gap."""
    return "required_gap" if "required_gap" in study.columns else "peak_impulse"


def summary(
    study: jp.Study, curves: Mapping[str, jp.Fragility], by_link: Mapping[str, jp.Fragility]
) -> dict[str, Any]:
    """The study's statistics, with its ``fragilities`` and ``fragilities_of_links``, for JSON."""
    identity, si = study.about["identity"], study.scales is not None
    required_gap, demands, correlation = {}, {}, None
    for p in PROBABILITIES if "required_gap" in study.columns else ():
        required_gap[str(p)] = _interval(study.required_gap(p))
        if is_pair(study):
            found = study.separation(p)
            required_gap[str(p)] |= {rule: getattr(found, rule) for rule in _RULES}
            correlation = found.correlation
    for name in study.told():
        if name == "pounds":
            continue
        m, finite = study.moments(name), study.finite(name)
        if not finite.size and not is_pair(study):  # the gap of a damper without one
            continue
        quantiles = [float(np.quantile(finite, q)) if finite.size else np.nan for q in _QUANTILES]
        demands[name] = {
            "name": in_words(name, study.topology),
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
                name: {"unit": unit_of(name, si)} | _of_curve(curve)
                for name, curve in curves.items()
            },
            "double_difference_correlation": correlation,
            "links": of_links(study, by_link),
        }
    )


def _interval(estimate: Estimate) -> dict[str, float]:
    return {"value": estimate.value, "low": estimate.low, "high": estimate.high}


def _page_of_links(links: list[dict[str, Any]], si: bool) -> list[str]:
    """Pounding link by link, for the page."""
    of_gap, of_force = unit_of("required_gap", si), unit_of("peak_contact", si)
    columns: dict[str, list[Any]] = {
        "link": [str(one["link"]) for one in links],
        "between": [one["between"] for one in links],
        "probability of pounding": [one["pounding_probability"]["value"] for one in links],
        "95 % interval": [_ends(one["pounding_probability"]) for one in links],
    }
    for share in map(str, PROBABILITIES[:3]):
        if any(one["required_gap"] for one in links):
            columns[f"gap ({of_gap}) at {share}"] = [
                one["required_gap"].get(share, {}).get("value") for one in links
            ]
    if any("mean_number_of_impacts" in one for one in links):
        columns |= {
            "mean number of impacts": [one.get("mean_number_of_impacts") for one in links],
            f"largest force ({of_force})": [one.get("largest_contact_force") for one in links],
        }
    if any(one["fragility_by_pga"] for one in links):
        curves = [one["fragility_by_pga"] or {} for one in links]
        columns |= {
            f"median θ by PGA ({unit_of('pga', si)})": [one.get("median") for one in curves],
            "dispersion β": [one.get("dispersion") for one in curves],
        }
    told = []
    if any(one["required_gap"] for one in links):
        told += ["A gap at a probability is that at which the link pounds so often.", ""]
    if not all(one["fragility_by_pga"] for one in links):
        told += ["No fragility curve fits a link that pounds always, never or at random.", ""]
    table = Table.of([*columns], [*zip(*columns.values(), strict=True)]).markdown()
    return [table, "", *told]


def page(answers: dict[str, Any], figures: list[str]) -> str:
    """One page."""
    si = answers["units"] == "SI"
    p = answers["pounding_probability"]
    complete = answers["samples"] == answers["samples_asked_for"]
    of = unit_of("required_gap", si)
    by_rules = answers["double_difference_correlation"] is not None
    gaps = [
        (share, of, row["value"], _ends(row), *(row[rule] for rule in _RULES if by_rules))
        for share, row in answers["required_gap"].items()
    ]
    heading = _GAPS if by_rules else _GAPS[: -len(_RULES)]
    links = answers["links"]
    demands = [
        (words, unit or ("-" if known_of(name) else "of the measure"), *numbers)
        for name, (words, unit, *numbers) in (
            (x, y.values()) for x, y in answers["demands"].items()
        )
    ]
    lines = [
        f"# Monte Carlo study of {'buildings in a row' if links else 'two adjacent structures'}",
        "",
        f"{answers['samples']:,} scenarios"
        + ("" if complete else f" of {answers['samples_asked_for']:,} asked for (unfinished)")
        + f", {answers['failed']:,} failed; {answers['sampling']} sampling; "
        f"jaxpound {answers['made_by']['jaxpound']}. Intervals are of 95 %."
        + ("" if si else " Units are those of the dimensionless system."),
        "",
        f"**Probability of pounding{' at any link' if links else ''}: {rounded(p['value'])} "
        f"({_ends(p)})**",
        "",
    ]
    if gaps:
        lines += [
            Table.of(heading, gaps).markdown(),
            "",
        ]
    if gaps and by_rules:
        lines += [
            "The rules of codes combine the peak displacements that are exceeded with the same "
            "probability; the double difference's correlation coefficient is "
            f"{answers['double_difference_correlation']:.3g}. They were made for buildings without "
            "a damper between them.",
            "",
        ]
    if links:
        lines += _page_of_links(links, si)
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
            told = ", ".join(f"{_parameter(x)} {value:+.2f}" for x, value in correlations.items())
            lines += ["", f"Rank correlation with the {in_words(column)}: {told}."]
    if fragility := answers["fragility"]:
        rows = [(in_words(name), *curve.values()) for name, curve in fragility.items()]
        table = Table.of(_FRAGILITY, rows).markdown()
        lines += ["", table, "", "The dispersion is that of the logarithm."]
    lines += ["", *(f"![{name.replace('_', ' ')}]({name}.png)" for name in figures), ""]
    return "\n".join(lines)


def _parameter(path: str) -> str:
    """Where a parameter of a row is, in words; other paths as they are."""
    of_row = path.startswith(("buildings.", "links."))
    return in_words_of(path).replace(", ", " ") if of_row else path


def _ends(estimate: dict[str, Any]) -> str:
    ends = (estimate["low"], estimate["high"])
    return " to ".join("not known" if x is None else rounded(x) for x in ends)
