"""``jaxpound paper``: the paper's numerical example beside an independent reference solution."""

from __future__ import annotations

import argparse
from itertools import zip_longest

import jaxpound as jp
from jaxpound._tables import TextTable
from jaxpound.cli.files import images, make_folder, write_files

_FIGURES = ("ground_motion", "displacements", "velocities", "gap", "friction_force", "rod_forces")

PAPER_SCHEME_ERROR = -6.4e-4  # of min(x2 − x1) by the paper's own scheme at its own step


def run(args: argparse.Namespace) -> None:
    """Run the command."""
    from jaxpound import plots
    from jaxpound.plots.style import drawn

    make_folder(args.out)
    case = jp.paper.structures(), jp.paper.ground(), jp.paper.grid()
    response = jp.simulate(*case)
    by_paper_scheme = float(jp.demand(*case, jp.PAPER_SCHEME).min_gap) - case[0].initial_gap
    print(page(response, by_paper_scheme, case[0].initial_gap))
    figures = {name: drawn(getattr(plots, name), response) for name in ("overview", *_FIGURES)}
    write_files(args.out, images(figures, args.pdf))


def page(response: jp.Response, by_paper_scheme: float, initial_gap: float) -> str:
    """The paper's case beside the reference: smallest gap, phase changes, energy residual."""
    reference = jp.paper.reference()
    lowest, smallest = float(response.min_gap) - initial_gap, initial_gap + reference.min_gap_change
    changes = [(phase.start, phase.kind) for phase in response.phases()[1:]]
    rows = [
        row("min of x2 - x1", lowest, reference.min_gap_change),
        row("  at t", float(response.demand.min_gap_time), reference.min_gap_time),
        row(f"smallest gap = {initial_gap:g} at rest + min", initial_gap + lowest, smallest),
        row("phase changes", len(changes), len(reference.phase_changes)),
    ]
    pairs = zip_longest(changes, reference.phase_changes, fillvalue=(None, ""))
    for (time, kind), (expected_time, expected) in pairs:
        rows.append(row(f"  {kind or expected} from t", time, expected_time))
    rows += [
        row("energy residual / input", float(response.energy.relative_residual), None),
        row("min by the paper's scheme", by_paper_scheme, reference.min_gap_change),
    ]
    return "\n".join(
        [
            f"The paper's case: {response.time.size - 1} steps of {float(response.time[1]):.6g}",
            response.method,
            "Dimensionless: length g/omega1^2, time 1/omega1. The reference is an independent",
            "event-driven solver. The paper gives no initial gap; pounding is x2 - x1 <= -gap.",
            "",
            TextTable.of(("", "jaxpound", "reference", "difference"), rows).text(),
            "",
            "The paper's scheme (order 1, switching friction) is known to miss the minimum by "
            f"{PAPER_SCHEME_ERROR:.1e}.",
        ]
    )


def row(name: str, value: float | None, reference: float | None) -> tuple[str, ...]:
    """A number beside its reference; either may be missing."""
    difference = "-" if value is None or reference is None else f"{value - reference:.1e}"
    both = value, reference
    cells = ("-" if x is None else f"{x:.8f}" if isinstance(x, float) else str(x) for x in both)
    return name, *cells, difference
