"""Command line: ``jaxpound paper``, ``simulate``, ``montecarlo``, ``report`` and ``design``.

JAX, and what needs it, is imported once the arguments are right, matplotlib where figures are
drawn, so that help and refusals come at once.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import re
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NoReturn

import jaxpound as jp
from jaxpound import _interruption as interruption
from jaxpound.cli import examples

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SIMULATE_FIGURES = (
    "ground_motion",
    "displacements",
    "gap",
    "friction_force",
    "rod_hysteresis",
    "friction_hysteresis",
    "energy",
)

_NOBODY_READS = 128 + 13  # as of a process that a closed pipe has ended


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns 0, or 2 after one line on stderr that says what is wrong.

    Without ``argv`` it is the command line of this process, which then ends at Ctrl-C: a line on
    stderr says what is kept, and the exit status is 130.
    """
    args = argparse.Namespace()
    if argv is None:
        interruption.end_at_a_signal(partial(_kept, args))
    try:
        try:
            _parser().parse_args(argv, args)
            _run(args)
        finally:
            interruption.remove_empty_folders()
            _flush_screen()
    except BrokenPipeError:
        return _NOBODY_READS
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        return _refuse(f"{place}{error.strerror or error}")
    except (ValueError, ArithmeticError) as error:
        return _refuse(str(error))
    return 0


def _run(args: argparse.Namespace) -> None:
    import jax

    jax.config.update("jax_enable_x64", True)
    with contextlib.suppress(RuntimeError):  # called where JAX runs already
        jp.use_cores()
    with _warnings_in_one_line(strict=getattr(args, "strict", False)):
        args.run(args)


def _flush_screen() -> None:
    """Print what is not printed yet: at the process's end a failure could not be told any more."""
    if sys.stdout is None:
        return
    try:
        sys.stdout.flush()
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):
            raise
        raise OSError(error.errno, error.strerror, "standard output") from error


def _kept(args: argparse.Namespace) -> str:
    """What an interrupted command leaves behind."""
    given = vars(args)
    store, save, out = (given.get(name) for name in ("store", "save", "out"))
    again = "the same command goes on from there"
    if store and given.get("run") is _montecarlo:
        if any(store.glob("chunk-*.npz")):
            return f"finished chunks are kept in {store}, and {again}"
        return "no chunk was finished"
    if save and save.exists():
        return f"the search is kept in {save}, and {again}"
    if out and out.is_dir():
        return f"the files that are in {out} are whole"
    return "nothing was written"


@contextlib.contextmanager
def _warnings_in_one_line(strict: bool) -> Iterator[None]:
    """Print warnings as the command line prints errors; input that is not plausible, each time.

    That is an error if ``strict``.
    """

    def in_one_line(message: Warning | str) -> str:
        return re.sub(r"^[A-Za-z_.]+: ", "", " ".join(str(message).split()))

    def show(message: Warning | str, *_: Any, **__: Any) -> None:
        print("jaxpound: warning:", in_one_line(message), file=sys.stderr)

    with warnings.catch_warnings():
        warnings.simplefilter("error" if strict else "always", jp.PlausibilityWarning)
        warnings.showwarning = show
        try:
            yield
        except jp.PlausibilityWarning as warning:
            raise ValueError(in_one_line(warning)) from warning


def _refuse(message: str) -> int:
    print("jaxpound: error:", " ".join(message.splitlines()), file=sys.stderr)
    return 2


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise ValueError(f"{message} (see {self.prog} --help)")


class _PrintExample(argparse.Action):
    def __init__(self, option_strings: Sequence[str], dest: str, const: str, help: str) -> None:
        super().__init__(option_strings, dest=argparse.SUPPRESS, nargs=0, const=const, help=help)

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        print(examples.example(str(self.const)), end="")
        parser.exit()


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="jaxpound",
        description="Seismic pounding between two adjacent structures joined by a friction damper.",
        epilog="example: jaxpound paper --out results",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"jaxpound {jp.__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    _add_command(
        commands,
        _paper,
        summary="the paper's numerical example, compared with an independent reference solution",
        example="jaxpound paper --out results/paper",
    )
    simulate = _add_command(
        commands,
        _simulate,
        summary="two buildings, given in SI units, under a recorded earthquake",
        example="jaxpound simulate --example-config > buildings.toml\n"
        "  jaxpound simulate --record elcentro.at2 --config buildings.toml --out results",
    )
    simulate.add_argument(
        "--record",
        type=Path,
        required=True,
        metavar="FILE",
        help="accelerogram: PEER AT2, K-NET, columns of time and acceleration, or values with --dt",
    )
    simulate.add_argument(
        "--config",
        type=Path,
        metavar="FILE",
        help="buildings, damper and run; without it the example configuration is used",
    )
    _add_example(simulate, examples.SIMULATE, "print the example configuration and exit")
    simulate.add_argument(
        "--units",
        help="of the record: g (where it states none), m/s2, cm/s2, gal, ft/s2, in/s2, mm/s2, mg",
    )
    simulate.add_argument(
        "--dt", type=float, help="the record's time step in s, for a file that states none"
    )
    _add_strict(simulate)
    study = _add_command(
        commands,
        _montecarlo,
        summary="a Monte Carlo study of uncertain earthquakes and buildings; goes on where it "
        "was stopped",
        example="jaxpound montecarlo --example-config > study.toml\n"
        "  jaxpound montecarlo study.toml --store study\n"
        "  jaxpound report --store study --out results",
        out=False,
    )
    study.add_argument("config", type=Path, metavar="CONFIG.toml", help="what is to be studied")
    _add_example(study, examples.STUDY, "print an example study and exit")
    _add_store(study, "folder for the results, made if needed; a started study goes on")
    study.add_argument(
        "--samples", type=int, metavar="N", help="number of samples, instead of the file's"
    )
    study.add_argument(
        "--shard",
        default="1/1",
        metavar="I/N",
        help="run every N-th chunk from the I-th only: N jobs, I = 1 to N, fill one store",
    )
    _add_strict(study)
    told = _add_command(
        commands,
        _report,
        summary="a page, a table and figures of a study, also of an unfinished one",
        example="jaxpound report --store study --out results",
    )
    _add_store(told, "the study's folder")
    design = _add_command(
        commands,
        _design,
        summary="damper and rods that keep two buildings apart, chosen by gradients within limits",
        example="jaxpound design --example-config > design.toml\n"
        "  jaxpound design design.toml --record elcentro.at2 --out results",
    )
    design.add_argument("config", type=Path, metavar="CONFIG.toml", help="what may be chosen")
    _add_example(design, examples.DESIGN, "print an example design and exit")
    design.add_argument(
        "--record",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help="an accelerogram in g that joins the random earthquakes; may be given several times",
    )
    design.add_argument(
        "--save",
        type=Path,
        metavar="FILE",
        help="keep the search's state there, and go on from it where it was stopped",
    )
    _add_strict(design)
    return parser


def _add_example(command: argparse.ArgumentParser, name: str, words: str) -> None:
    command.add_argument("--example-config", action=_PrintExample, const=name, help=words)


def _add_strict(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--strict",
        action="store_true",
        help="refuse what is only warned of: unresolved or implausible input",
    )


def _add_store(command: argparse.ArgumentParser, words: str) -> None:
    command.add_argument("--store", type=Path, required=True, metavar="DIR", help=words)


def _add_command(
    commands: Any, run: Any, summary: str, example: str, out: bool = True
) -> argparse.ArgumentParser:
    command: argparse.ArgumentParser = commands.add_parser(
        run.__name__.removeprefix("_"),
        help=summary,
        description=f"{summary[0].upper()}{summary[1:]}.",
        epilog=f"example:\n  {example}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    command.set_defaults(run=run)
    if out:
        command.add_argument(
            "--out",
            type=Path,
            required=True,
            metavar="DIR",
            help="folder for the results; made if needed, files of the same names are replaced",
        )
        command.add_argument(
            "--pdf", action="store_true", help="write every figure as PDF too, for print"
        )
    return command


def _make_folder(out: Path) -> None:
    """Make the output folder once the input is checked, so that no run is made in vain."""
    try:
        interruption.make_folder(out)
        with tempfile.TemporaryFile(dir=out):
            pass
    except OSError as error:
        rule = f"must be a folder that can be made and written to ({error.strerror})"
        raise ValueError(f"argument --out: {out} {rule}") from error


# --- paper --------------------------------------------------------------------------------------


def _paper(args: argparse.Namespace) -> None:
    from jaxpound import plots
    from jaxpound.cli import report

    _make_folder(args.out)
    case = jp.paper.structures(), jp.paper.ground(), jp.paper.grid()
    response = jp.simulate(*case)
    papers_own = float(jp.demand(*case, jp.PAPER_SCHEME).min_gap) - case[0].initial_gap
    print(report.paper_table(response, papers_own, case[0].initial_gap))
    _write_figures({"overview": plots.overview(response)}, args)
    _write_figures(plots.paper_figures(response), args)


# --- simulate -----------------------------------------------------------------------------------


def _simulate(args: argparse.Namespace) -> None:
    from jaxpound.cli import config, report

    configuration = config.read_config(args.config)
    record = configuration.shaking(jp.read_record(args.record, dt=args.dt, units=args.units))
    response = configuration.response(record, strict=args.strict)
    _make_folder(args.out)

    if args.config is None:
        print("No --config given: these are the buildings of jaxpound simulate --example-config.")
    summary = report.summary(configuration, args.record, record, response)
    text = json.dumps(summary, indent=2, allow_nan=False)
    print(report.as_text(summary))

    from jaxpound import plots
    from jaxpound.plots.style import figure

    _write_text(args.out / "summary.json", text + "\n")
    _write_series(response, args.out, configuration.series)
    figures = {name: figure(getattr(plots, name), response) for name in _SIMULATE_FIGURES}
    _write_figures({"overview": plots.overview(response)} | figures, args)


# --- montecarlo, report -------------------------------------------------------------------------


def _montecarlo(args: argparse.Namespace) -> None:
    from jaxpound.cli import study_config

    study = study_config.read_study(args.config)
    found = jp.monte_carlo(
        study.scenarios,
        study.samples if args.samples is None else args.samples,
        study.grid,
        study.scheme,
        study.seed,
        sampling=study.sampling,
        store=args.store,
        chunk_size=study.chunk_size,
        measures=study.measures,
        keep_parameters=True,
        keep_failures=study.keep_failures,
        scales=study.scales,
        notes={"configuration": study.text},
        shard=_shard(args.shard),
        strict=args.strict,
        progress=sys.stderr.isatty(),
    )
    print(found)
    part = "" if args.shard == "1/1" else f" by shard {args.shard} alone"
    print(f"probability of pounding{part} {found.pounding_probability()}")
    print(f"jaxpound report --store {args.store} --out DIR says more")


def _shard(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d+)/(\d+)", text)
    if not match:
        raise ValueError(f"argument --shard: {text!r} must be I/N, such as 2/8")
    return int(match[1]), int(match[2])


def _report(args: argparse.Namespace) -> None:
    from jaxpound.cli import study_report

    study = jp.Study.open(args.store)
    curves = study_report.fragilities(study)
    answers = study_report.summary(study, curves)
    text = json.dumps(answers, indent=2, allow_nan=False)
    _make_folder(args.out)

    from jaxpound.plots import studies as study_plots
    from jaxpound.plots.style import figure

    drawn: dict[str, Callable[[Any, Any], Any]] = {
        "min_gap": study_plots.min_gap,
        "convergence": study_plots.convergence,
        "required_gap": partial(study_plots.exceedance, rules_at=0.05),
    }
    figures = {name: figure(draw, study) for name, draw in drawn.items()}
    for name, curve in curves.items():
        words = f"{study_report.INTENSITIES[name]} ({study_report.intensity_unit(study, name)})"
        draw = partial(study_plots.fragility, intensity=words)
        figures[f"fragility_by_{name}"] = figure(draw, curve)
    if study.about["identity"]["parameters"]:
        figures["correlations"] = figure(study_plots.correlations, study)
        figures["parameters"] = study_plots.scatter_matrix(study)
    if "configuration" in (study.about["notes"] or {}):
        _write_text(args.out / "study.toml", study.about["notes"]["configuration"])
    _write_text(args.out / "summary.json", text + "\n")
    _write_text(args.out / "summary.md", study_report.as_markdown(answers, list(figures)))
    _write_figures(figures, args)


# --- design -------------------------------------------------------------------------------------


def _design(args: argparse.Namespace) -> None:
    from jaxpound.cli import design_config, design_report

    wanted = design_config.read_design(args.config, args.record)
    _make_folder(args.out)
    design = jp.design_damper(
        wanted.space,
        wanted.ensemble,
        wanted.grid,
        wanted.scheme,
        wanted.objective,
        scales=wanted.scales,
        fresh=wanted.fresh or None,
        save=args.save,
        strict=args.strict,
        progress=sys.stderr.isatty(),
        **wanted.search,
    )
    recorded = {name: design.compare(one) for name, one in wanted.recorded.items()}
    answers = design_report.summary(design, recorded, wanted.scales)
    print(design_report.as_text(answers))
    print(design)
    text = json.dumps(answers, indent=2, allow_nan=False)
    _write_text(args.out / "design.toml", wanted.text)
    designed = design_config.designed_toml(design.structures, wanted.scales)
    _write_text(args.out / "buildings.toml", designed)
    _write_text(args.out / "summary.json", text + "\n")

    from jaxpound.plots import designs as design_plots
    from jaxpound.plots.style import figure

    compared = design.trained if design.fresh is None else design.fresh
    figures = {
        "convergence": figure(design_plots.convergence, design),
        "before_and_after": figure(design_plots.before_and_after, compared),
    }
    with contextlib.suppress(ValueError):  # a mean gap of zero has no elasticity
        slopes = jp.elasticities(design.structures, wanted.ensemble, wanted.grid, wanted.scheme)
        figures["elasticities"] = figure(design_plots.tornado, slopes)
    if design.space.dimension > 1:
        figures["landscape"] = design_plots.figure_of_landscape(design)
    _write_text(args.out / "summary.md", design_report.as_markdown(answers, list(figures)))
    _write_figures(figures, args)


# --- files --------------------------------------------------------------------------------------


def _write(path: Path, write: Callable[[BinaryIO], Any]) -> None:
    """Write a whole file or none, and print its path."""
    from jaxpound.study.archives import replace_file

    try:
        replace_file(path, write)
    except OSError as error:
        what = f"cannot be written ({error.strerror or error})"
        raise OSError(error.errno, what, str(path)) from error
    print(path)


def _write_text(path: Path, text: str) -> None:
    _write(path, lambda file: file.write(text.encode()))


def _write_figures(figures: dict[str, Figure], args: argparse.Namespace) -> None:
    for name, figure in figures.items():
        # A figure unknown to pyplot is drawn by Agg, whatever backend is set.
        for kind in ("png", "pdf") if args.pdf else ("png",):
            path = args.out / f"{name}.{kind}"
            _write(path, partial(figure.savefig, format=kind, dpi=300))


def _write_series(response: jp.Response, out: Path, kind: str) -> None:
    import numpy as np

    path = out / f"series.{kind}"
    if kind == "npz":
        _write(path, lambda file: np.savez(file, **response.to_columns()))  # type: ignore[arg-type]
    elif kind == "csv":
        _write(path, response.to_csv)
