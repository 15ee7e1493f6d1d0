"""The page of the documentation, its tables and its figure, from the results on file."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path

import msgspec

from benchmarks.verification import figure, jaxonomy_peer, siconos_peer
from benchmarks.verification.batch import LANES
from benchmarks.verification.case import Case, Errors
from benchmarks.verification.cases import CASES
from benchmarks.verification.equal_error import ratios
from benchmarks.verification.maxwell import BRANCHES

RESULTS = Path(__file__).parent / "results.json"
DOCS = Path(__file__).parents[2] / "docs"

INTRODUCTION = """\
# Verification

Every case on this page is a problem with a known solution: a closed form, an inverse Laplace
transform, an event-driven solver that shares no code with jaxpound, another program or a book. Each
case states the problem, the reference solution, the errors for decreasing time steps h and the
fitted order (2 for the default scheme). The time is the wall time after compilation of the run, or
of the small batch of runs, for the longest and for the shortest step. One command in a clone writes
this page:

```sh
pip install -e ".[test,bench]"
python -m benchmarks.verification
```

It takes some twenty minutes, most of it compilation. `python -m benchmarks.verification rods rows`
runs only some cases, and `--list` lists them. The exit status is 1 if an error exceeds its bound or
an order is too low. The tests of the package (`tests/verification`) contain smaller versions of the
cases. Errors do not depend on the machine; times do, and were taken on a machine that was busy with
other work.

"""

PEERS = """\
## Accuracy against time

![Error against wall time of a run, of jaxpound, OpenSees, Siconos and jaxonomy](verification.png)

The points of a line are runs with decreasing steps, or tolerances of jaxonomy; lower and further
left is better. A run of a batch is one of {lanes} earthquakes, or slip forces beside jaxonomy, in
one call: on all cores for the pair with OpenSees, else on one. All other runs use one core. The
result of the paper's case, of the batch and beside jaxonomy is the smallest gap. The other runs of
jaxpound keep all time series, those of OpenSees the compared displacements, and those of Siconos
the displacements and velocities of both blocks. The times of Siconos are those of the loop over the
steps, without the assembly of the model. Errors of the row are relative to the largest
displacement; all others are dimensionless as in eq. (9).

The table compares times at equal errors: the time of the other program, interpolated between its
runs (without those that take longer than one whose error is as small), over the time of one run of
jaxpound, and over that of a run of a batch, beside a run of a batch of the other program if it has
batches.

{ratios}

## OpenSees, Siconos and jaxonomy

All are optional: without one of them the suite skips its case and says so.

**OpenSees.** `pip install -e ".[bench]"` installs
[OpenSeesPy](https://openseespydoc.readthedocs.io), which needs a BLAS library;
`benchmarks/README.md` describes what to do if it finds none. More steps, friction springs and
integrators: `python benchmarks/opensees.py` and `python benchmarks/opensees_rows.py`.

**Siconos.** [Siconos](https://github.com/siconos/siconos) solves the same inclusions (unilateral
contact, impacts, Coulomb's friction) by event-capturing time stepping. It is not on the Python
package index. Debian and Ubuntu have it (`apt install python3-siconos`, in Debian 12 the package
4.4.0, which calls itself 4.5.0) for the Python of the system, so the suite runs it in a process of
that interpreter, which needs no part of jaxpound. It tries its own interpreter, the `python3` of
the path and `/usr/bin/python3`, and takes the first that can import Siconos; the environment
variable {python} names another.
Python's part of the loop is 2.5 µs a step. The time of Siconos itself grows with the number of
Maxwell branches: a step takes 6 µs with one branch for each rod, 30 µs with 16 and 40 µs with
{branches}. The fit alone causes errors of 5e-5 with 16 and of 3e-6 with {branches} branches. As a
system of first order (EulerMoreauOSI) the pair has the same motion and takes 1.3 times as long.

**jaxonomy.** `pip install jaxonomy` in an environment of its own, as it asks for an older JAX than
jaxpound does; the environment variable {other} names its interpreter. It has no fractional rod. In
a batch every lane pays for each event and step of the others.
"""


def results() -> dict[str, Case]:
    """Cases on file, in the order of the suite."""
    if not RESULTS.exists():
        return {}
    found = msgspec.json.decode(RESULTS.read_bytes(), type=dict[str, Case])
    return {name: found[name] for name in CASES if name in found}


def keep(name: str, case: Case) -> None:
    """Put a case on file."""
    text = msgspec.json.encode({**results(), name: case})
    RESULTS.write_bytes(msgspec.json.format(text) + b"\n")


def _duration(seconds: float) -> str:
    if seconds < 0.0995:
        return f"{1e3 * seconds:.2g} ms"
    return f"{seconds:.2g} s" if seconds < 9.95 else f"{seconds:.0f} s"


def _table(parts: list[Errors]) -> list[str]:
    """Errors at the same steps."""
    steps = [f"h = {step:g}" for step in parts[0].steps]
    with_order = any(part.fitted_order is not None for part in parts)
    with_time = any(part.seconds for part in parts)
    heads = ["error of", *steps, *["order"] * with_order, *["time"] * with_time]
    lines = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for part in parts:
        cells = [part.quantity, *(f"{error:.1e}" for error in part.errors)]
        if with_order:
            cells.append("" if part.fitted_order is None else f"{part.fitted_order:.2f}")
        if with_time:
            ends = sorted({_duration(part.seconds[i]) for i in (0, -1)} if part.seconds else ())
            both = [_duration(part.seconds[i]) for i in (0, -1)] if len(ends) > 1 else ends
            cells.append(" to ".join(both))
        lines.append("| " + " | ".join(cells) + " |")
    return [*lines, ""]


def section(case: Case) -> str:
    """A case as a section of the page."""
    lines = [f"## {case.title}", "", f"*Problem.* {case.problem}", ""]
    lines += [f"*Reference.* {case.source}", ""]
    for _, parts in groupby(case.errors, key=lambda part: part.steps):
        lines += _table(list(parts))
    if case.numbers:
        lines += ["| | jaxpound | reference | tolerance |", "|---|---|---|---|"]
        lines += [
            f"| {x.quantity} | {x.found:.5g} | {x.known:.5g} | {x.within:.1g} |"
            for x in case.numbers
        ]
        lines.append("")
    lines += [f"The whole case: {_duration(case.seconds)} with compilation ({case.made}).", ""]
    return "\n".join(lines)


def _ratios(cases: dict[str, Case]) -> str:
    """Times at equal errors as a table."""
    heads = "", "error", "program", "its time", "over one run", "over a run of a batch", "measured"
    lines = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    for case in cases.values():
        for ratio in ratios(case.curves):
            program = f"{ratio.program.partition(',')[0]} {ratio.version}".strip()
            times = f"{ratio.of_run:.1f}" if ratio.of_run < 9.95 else f"{ratio.of_run:,.0f}"
            batch = f"{ratio.of_batch:,.0f}" if ratio.of_batch else ""
            error, seconds = f"{ratio.error:.1e}", _duration(ratio.seconds)
            cells = ratio.panel, error, program, seconds, times, batch, case.made
            lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def text(cases: dict[str, Case]) -> str:
    """The whole page."""
    sections = "\n".join(section(case) for case in cases.values())
    python, other = (f"`{peer.PYTHON}`" for peer in (siconos_peer, jaxonomy_peer))
    peers = PEERS.format(
        lanes=LANES, ratios=_ratios(cases), python=python, other=other, branches=BRANCHES
    )
    return INTRODUCTION + sections + "\n" + peers


def write() -> None:
    """The page and its figure."""
    cases = results()
    (DOCS / "verification.md").write_text(text(cases), encoding="utf-8")
    curves = [curve for case in cases.values() for curve in case.curves]
    figure.accuracy_against_time(curves).savefig(DOCS / "verification.png", dpi=150)
