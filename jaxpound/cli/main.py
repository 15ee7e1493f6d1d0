"""Command line: ``jaxpound`` and its commands, such as ``jaxpound simulate``.

JAX, and what needs it, is imported only if the arguments are valid, matplotlib only to draw
figures, so that help and error messages come at once.
"""

from __future__ import annotations

import argparse
import contextlib
import logging
import os
import re
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import jaxpound as jp
from jaxpound import _interruption as interruption
from jaxpound.cli.files import FORMS, example

_NOBODY_READS = 128 + 13  # exit status of a process that a closed pipe has ended


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns 0, or 2 after one line on stderr that says what is wrong.

    Without ``argv`` it is the command line of this process.
    """
    args = argparse.Namespace()
    interruption.say_what_is_kept(partial(_kept, args))
    try:
        try:
            _parser().parse_args(argv, args)
            _run(args, alone=argv is None)
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


def _run(args: argparse.Namespace, *, alone: bool) -> None:
    """Run a command, ``alone`` in a process of its own."""
    if alone:  # XLA takes a compilation of minutes for a fault of its own; faults are exceptions
        os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    import jax

    jax.config.update("jax_enable_x64", True)
    with contextlib.suppress(RuntimeError):  # called where JAX runs already
        jp.use_cores()
    with _warnings_in_one_line(strict=getattr(args, "strict", False)):
        if alone:
            jp.keep_programs()
            logging.getLogger("jaxpound").setLevel(logging.ERROR)  # commands have their own notes
        _command(args.command)(args)


def _command(name: str) -> Callable[[argparse.Namespace], None]:
    """The function that runs a command; modules of the other commands are not imported."""
    match name:
        case "paper":
            from jaxpound.cli.paper import run
        case "simulate":
            from jaxpound.cli.simulate import run
        case "montecarlo":
            from jaxpound.cli.montecarlo import run
        case "report":
            from jaxpound.cli.report import run
        case "ida":
            from jaxpound.cli.ida import run
        case "rare":
            from jaxpound.cli.rare import run
        case "hazard":
            from jaxpound.cli.hazard import run
        case _:
            from jaxpound.cli.design import run
    return run


def _flush_screen() -> None:
    """Flush stdout now: at the process's end an error could no longer be reported."""
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
    if store and given.get("command") == "montecarlo":
        if any(store.glob("chunk-*.npz")):
            return f"finished chunks are kept in {store}, and {again}"
        return "no chunk was finished"
    if store and given.get("command") in ("rare", "ida") and any(store.rglob("*.npz")):
        return f"finished runs are kept in {store}, and {again}"
    if save and save.exists():
        return f"the search is kept in {save}, and {again}"
    if out and out.is_dir():
        return f"the files that are in {out} are whole"
    return "nothing was written"


@contextlib.contextmanager
def _warnings_in_one_line(strict: bool) -> Iterator[None]:
    """Print warnings as the command line prints errors, in one line.

    Every ``PlausibilityWarning`` is printed, once; if ``strict``, it is an error.
    """

    def in_one_line(message: Warning | str) -> str:
        return re.sub(r"^[A-Za-z_.]+: ", "", " ".join(str(message).split()))

    shown: set[str] = set()

    def show(message: Warning | str, *_: Any, **__: Any) -> None:
        if (line := in_one_line(message)) not in shown:
            print("jaxpound: warning:", line, file=sys.stderr)
            shown.add(line)

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
    def __init__(
        self, option_strings: Sequence[str], dest: str, help: str, forms: Sequence[str] = FORMS
    ) -> None:
        several: dict[str, Any] = {"nargs": "?", "choices": forms} if forms[1:] else {"nargs": 0}
        super().__init__(option_strings, argparse.SUPPRESS, const=forms[0], help=help, **several)

    def __call__(
        self, parser: argparse.ArgumentParser, _: argparse.Namespace, form: Any, *__: Any
    ) -> NoReturn:
        print(example(parser.prog.split()[-1], form or self.const), end="")
        parser.exit()


# --- arguments ----------------------------------------------------------------------------------


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="jaxpound",
        description="Seismic pounding between adjacent structures joined by friction dampers.",
        epilog="example: jaxpound paper --out results",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"jaxpound {jp.__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for add in _COMMANDS:
        add(commands)
    return parser


def _add_paper(commands: Any) -> None:
    paper = _add_command(
        commands,
        "paper",
        summary="the paper's numerical example, compared with an independent reference solution",
        example="jaxpound paper --out results/paper",
    )
    _add_out(paper)


def _add_simulate(commands: Any) -> None:
    simulate = _add_command(
        commands,
        "simulate",
        summary="buildings, given in SI units, under a recorded earthquake",
        example="jaxpound simulate --example-config row > buildings.toml\n"
        "  jaxpound simulate --record elcentro.at2 --config buildings.toml --out results",
    )
    _add_out(simulate)
    words = "accelerogram: PEER AT2, K-NET, columns of time and acceleration, or values with --dt"
    _add_path(simulate, "--record", words, required=True)
    words = "buildings, dampers and run; without it the example of two buildings is used"
    _add_path(simulate, "--config", words)
    _add_example(simulate, "print the example configuration and exit")
    simulate.add_argument(
        "--units",
        help="of the record: g (where it states none), m/s2, cm/s2, gal, ft/s2, in/s2, mm/s2, mg",
    )
    simulate.add_argument(
        "--dt", type=float, help="the record's time step in s, for a file that states none"
    )
    _add_strict(simulate)


def _add_montecarlo(commands: Any) -> None:
    study = _add_command(
        commands,
        "montecarlo",
        summary="a Monte Carlo study of uncertain earthquakes and buildings; goes on where it "
        "was stopped",
        example="jaxpound montecarlo --example-config > study.toml\n"
        "  jaxpound montecarlo study.toml --store study\n"
        "  jaxpound report --store study --out results",
    )
    _add_path(study, "config", "what is to be studied", "CONFIG.toml")
    _add_example(study, "print an example study and exit")
    words = "folder for the results, made if needed; a started study goes on"
    _add_path(study, "--store", words, "DIR", required=True)
    study.add_argument(
        "--samples", type=_count, metavar="N", help="number of samples, instead of the file's"
    )
    study.add_argument(
        "--shard",
        default="1/1",
        metavar="I/N",
        help="run every N-th chunk from the I-th only: N jobs, I = 1 to N, fill one store",
    )
    _add_strict(study)


def _add_report(commands: Any) -> None:
    report = _add_command(
        commands,
        "report",
        summary="a page, a table and figures of a study, also of an unfinished one",
        example="jaxpound report --store study --out results",
    )
    _add_out(report)
    _add_path(report, "--store", "the study's folder", "DIR", required=True)


def _add_design(commands: Any) -> None:
    design = _add_configured(
        commands,
        "design",
        "dampers and rods that keep buildings apart, chosen by gradients within limits",
        config="what may be chosen",
        prints="an example design",
        more="--record elcentro.at2 ",
    )
    words = "an accelerogram in g that joins the random earthquakes; may be given several times"
    _add_path(design, "--record", words, action="append", default=[])
    words = (
        "the search keeps its state in this file, which remains when it is done; without --save it "
        "keeps it in a folder DIR/unfinished-..., which it removes when it is done"
    )
    _add_path(design, "--save", words)
    _add_strict(design)


def _add_ida(commands: Any) -> None:
    ida = _add_configured(
        commands,
        "ida",
        "an incremental dynamic analysis: records scaled up until buildings pound",
        config="buildings, records and intensities",
        prints="an example analysis",
    )
    _add_path(ida, "--store", "keep finished runs there; a stopped analysis goes on", "DIR")
    _add_strict(ida)


def _add_rare(commands: Any) -> None:
    rare = _add_configured(
        commands,
        "rare",
        "the probability of a rare event, however small, and its likeliest earthquake",
        config="buildings, random earthquakes and the event",
        prints="an example",
    )
    words = (
        "keep design points and finished runs there, a stopped search goes on; by default in the "
    )
    words += "output folder until it is done"
    _add_path(rare, "--store", words, "DIR")
    _add_strict(rare)


def _add_hazard(commands: Any) -> None:
    _add_configured(
        commands,
        "hazard",
        "how often buildings pound in years, from a hazard curve and a fragility",
        config="the hazard, and a fragility or a study",
        prints="an example",
        forms=FORMS[:1],
    )


_COMMANDS = (
    _add_paper,
    _add_simulate,
    _add_montecarlo,
    _add_report,
    _add_design,
    _add_ida,
    _add_rare,
    _add_hazard,
)
"""In the order of the help."""


def _add_command(commands: Any, name: str, summary: str, example: str) -> argparse.ArgumentParser:
    command: argparse.ArgumentParser = commands.add_parser(
        name,
        help=summary,
        description=f"{summary[0].upper()}{summary[1:]}.",
        epilog=f"example:\n  {example}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    return command


def _add_configured(
    commands: Any,
    name: str,
    summary: str,
    *,
    config: str,
    prints: str,
    more: str = "",
    forms: Sequence[str] = FORMS,
) -> argparse.ArgumentParser:
    """A command that reads a configuration, of which it prints an example, and fills a folder.

    ``more`` is what its example of use has beside these.
    """
    command = _add_command(
        commands,
        name,
        summary,
        example=f"jaxpound {name} --example-config > {name}.toml\n"
        f"  jaxpound {name} {name}.toml {more}--out results",
    )
    _add_out(command)
    _add_path(command, "config", config, "CONFIG.toml")
    _add_example(command, f"print {prints} and exit", forms)
    return command


def _add_out(command: argparse.ArgumentParser) -> None:
    words = "folder for the results; made if needed, files of the same names are replaced"
    _add_path(command, "--out", words, required=True, metavar="DIR")
    words = "write every figure as PDF too, for print"
    command.add_argument("--pdf", action="store_true", help=words)


def _add_example(
    command: argparse.ArgumentParser, words: str, forms: Sequence[str] = FORMS
) -> None:
    if forms[1:]:
        words += ": of two buildings (pair, the default), or of several storeys and buildings (row)"
    command.add_argument("--example-config", action=_PrintExample, forms=forms, help=words)


def _add_strict(command: argparse.ArgumentParser) -> None:
    words = "refuse what is only warned of: unresolved or implausible input"
    command.add_argument("--strict", action="store_true", help=words)


def _add_path(
    command: argparse.ArgumentParser, name: str, words: str, metavar: str = "FILE", **more: Any
) -> None:
    command.add_argument(name, type=_path, metavar=metavar, help=words, **more)


def _path(text: str) -> Path:
    """A path; an empty one, of a variable that the shell does not know, is not this folder."""
    if not text:
        raise argparse.ArgumentTypeError("must not be empty")
    return Path(text)


def _count(text: str) -> int:
    if not re.fullmatch(r"0*[1-9]\d{0,17}", text):
        raise argparse.ArgumentTypeError(f"{text!r} must be a positive whole number")
    return int(text)
