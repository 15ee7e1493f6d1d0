"""Command line: ``jaxpound`` and its commands, such as ``jaxpound simulate``.

JAX, and what needs it, is imported only if the arguments are valid, matplotlib only to draw
figures, so that help and error messages come at once.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import re
import sys
import warnings
from collections.abc import Iterator, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import jaxpound as jp
from jaxpound import _interruption as interruption
from jaxpound.cli.files import FORMS, example

_CLOSED_PIPE = 128 + 13  # exit status of a process that a closed pipe has ended


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return 0, or 2 after one line on stderr that says what is wrong.

    ``argv`` is by default the command line of this process.
    """
    args = argparse.Namespace()
    interruption.report_kept_files(partial(describe_kept, args))
    try:
        try:
            _parser().parse_args(argv, args)
            _run(args, alone=argv is None)
        finally:
            interruption.remove_empty_folders()
            _flush_screen()
    except BrokenPipeError:
        return _CLOSED_PIPE
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        return _refuse(f"{place}{error.strerror or error}")
    except (ValueError, ArithmeticError) as error:
        return _refuse(str(error))
    return 0


def _run(args: argparse.Namespace, *, alone: bool) -> None:
    """Run a command; ``alone`` if the process does nothing else."""
    if alone:  # XLA logs a compilation of minutes as an error; true errors are exceptions
        os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    import jax

    jax.config.update("jax_enable_x64", True)
    with contextlib.suppress(RuntimeError):  # called where JAX runs already
        jp.runtime.use_cores()
        if alone:
            jp.runtime.use_loop_kernels()
    with _short_warnings(strict=getattr(args, "strict", False)):
        if alone:
            jp.runtime.keep_programs()
        import_module(f"jaxpound.cli.{args.command}").run(args)


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


def describe_kept(args: argparse.Namespace) -> str:
    """What an interrupted command leaves behind."""
    names = ("command", "store", "save", "out")
    command, store, save, out = (getattr(args, name, None) for name in names)
    resumed = "the same command goes on from there"
    if store and command == "montecarlo":
        if any(store.glob("chunk-*.npz")):
            return f"finished chunks are kept in {store}, and {resumed}"
        return "no chunk was finished"
    if store and command in ("rare", "ida") and any(store.rglob("*.npz")):
        return f"finished runs are kept in {store}, and {resumed}"
    if save and save.exists():
        return f"the search is kept in {save}, and {resumed}"
    if out and out.is_dir():
        return f"the files that are in {out} are whole"
    return "nothing was written"


@contextlib.contextmanager
def _short_warnings(strict: bool) -> Iterator[None]:
    """Print each warning once, in one line; if ``strict``, implausible input is an error."""

    def as_line(message: Warning | str) -> str:
        return re.sub(r"^[A-Za-z_.]+: ", "", " ".join(str(message).split()))

    printed: set[str] = set()

    def show(message: Warning | str, *_: Any, **__: Any) -> None:
        line = as_line(message)
        # A file names the link of a finding by its [[link]], a run by its ends.
        if (key := re.sub(r"^(\[\[link\]\] .*?|link .*?): ", "", line)) not in printed:
            print("jaxpound: warning:", line, file=sys.stderr)
            printed.add(key)

    with warnings.catch_warnings():
        warnings.simplefilter("error" if strict else "always", jp.PlausibilityWarning)
        warnings.showwarning = show
        try:
            yield
        except jp.PlausibilityWarning as warning:
            raise ValueError(as_line(warning)) from warning


def _refuse(message: str) -> int:
    print("jaxpound: error:", " ".join(message.splitlines()), file=sys.stderr)
    return 2


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise ValueError(f"{message} (see {self.prog} --help)")


class _PrintExample(argparse.Action):
    def __call__(
        self, parser: argparse.ArgumentParser, _: argparse.Namespace, form: Any, *__: Any
    ) -> NoReturn:
        print(example(parser.prog.split()[-1], form or self.const), end="")
        parser.exit()


Argument = tuple[str, dict[str, Any]]  # a name, and the keywords of ``add_argument``


def _path(text: str) -> Path:
    """A path; an empty one, from an unset variable of the shell, is not this folder."""
    if not text:
        raise argparse.ArgumentTypeError("must not be empty")
    return Path(text)


def _file(name: str, words: str, metavar: str = "FILE", **options: Any) -> Argument:
    return name, {"help": words, "type": _path, "metavar": metavar, **options}


def _example(words: str, forms: Sequence[str] = FORMS) -> Argument:
    options: dict[str, Any] = {"nargs": 0}
    if forms[1:]:
        words += ": of two buildings (pair, the default), or of several storeys and buildings (row)"
        options = {"nargs": "?", "choices": forms}
    options |= {"action": _PrintExample, "const": forms[0], "dest": argparse.SUPPRESS}
    return "--example-config", {"help": f"print {words}", **options}


def _configuration(words: str, example: str, forms: Sequence[str] = FORMS) -> list[Argument]:
    """The file that a command reads, and the option that prints an example of it."""
    return [_file("config", words, "CONFIG.toml"), _example(f"{example} and exit", forms)]


_OUT_WORDS = "folder for the results; made if needed, files of the same names are replaced"
_OUT = (
    _file("--out", _OUT_WORDS, "DIR", required=True),
    ("--pdf", {"help": "write every figure as PDF too, for print", "action": "store_true"}),
)
_MOTION = "a random motion of 25 s, a record in the format AT2, and exit"
_EXAMPLE_RECORD: Argument = "--example-record", _example(_MOTION, ("record",))[1]
_RECORD = "accelerogram: a file of a network (PEER, K-NET, ESM, ...), columns, or values with --dt"
_ROWS = "what rows of several values are: history (one after the other), columns (side by side)"
_JOINING = "an accelerogram in g that joins the random earthquakes; may be given several times"
_BUILDINGS = "buildings, dampers and run; without it the example of two buildings is used"
_STUDY = "folder for the results, made if needed; a started study goes on"
_UNITS = "g (where it states none), m/s2, cm/s2, gal, ft/s2, in/s2, mm/s2, mg"
_SAMPLES = "number of samples, instead of the file's"
_SHARD = "run every N-th chunk from the I-th only: N jobs, I = 1 to N, fill one store"
_LINES = "run nothing: print N commands, a line each, that run a shard each, for a job scheduler"
_TABLE = "write a row for each sample to this file too, of all columns: .csv or .parquet"
_STRICT_WORDS = "refuse what is only warned of: unresolved or implausible input"
_STRICT: Argument = ("--strict", {"help": _STRICT_WORDS, "action": "store_true"})


class Command(NamedTuple):
    """A command, which the module ``jaxpound.cli.NAME`` runs; only this module is imported."""

    summary: str
    arguments: Sequence[Argument]
    example: str = "jaxpound {0} --example-config > {0}.toml\n  jaxpound {0} {0}.toml --out results"
    """Of its use; {0} is its name."""


_COMMANDS = {  # in the order of the help
    "paper": Command(
        "the paper's numerical example, compared with an independent reference solution",
        _OUT,
        "jaxpound paper --out results/paper",
    ),
    "simulate": Command(
        "buildings, given in SI units, under a recorded earthquake",
        [
            *_OUT,
            _file("--record", _RECORD, required=True),
            _file("--config", _BUILDINGS),
            _example("the example configuration and exit"),
            _EXAMPLE_RECORD,
            ("--units", {"help": f"of the record: {_UNITS}"}),
            ("--dt", {"help": "its time step in s, for a file that states none", "type": float}),
            ("--column", {"help": "component of a file that has several: its number or name"}),
            ("--vertical", {"help": "take a vertical component", "action": "store_true"}),
            ("--rows", {"help": _ROWS}),
            _STRICT,
        ],
        "jaxpound simulate --example-config row > buildings.toml\n"
        "  jaxpound simulate --example-record > quake.at2\n"
        "  jaxpound simulate --record quake.at2 --config buildings.toml --out results",
    ),
    "montecarlo": Command(
        "a Monte Carlo study of uncertain earthquakes and buildings; goes on where it was stopped",
        [
            *_configuration("what is to be studied", "an example study"),
            _file("--store", _STUDY, "DIR", required=True),
            ("--samples", {"help": _SAMPLES, "type": int, "metavar": "N"}),
            ("--shard", {"help": _SHARD, "default": "1/1", "metavar": "I/N"}),
            ("--commands", {"help": _LINES, "type": int, "metavar": "N"}),
            _STRICT,
        ],
        "jaxpound montecarlo --example-config > study.toml\n"
        "  jaxpound montecarlo study.toml --store study\n"
        "  jaxpound report --store study --out results",
    ),
    "report": Command(
        "a page, a table and figures of a study, also of an unfinished one",
        [
            *_OUT,
            _file("--store", "the study's folder", "DIR", required=True),
            _file("--table", _TABLE),
        ],
        "jaxpound report --store study --out results",
    ),
    "design": Command(
        "dampers and rods that keep buildings apart, chosen by gradients within limits",
        [
            *_OUT,
            *_configuration("what may be chosen", "an example design"),
            _file("--record", _JOINING, action="append", default=[]),
            _file(
                "--save",
                "the search keeps its state in this file, which remains when it is done; without "
                "--save it keeps it in a folder DIR/unfinished-..., which it removes when it is "
                "done",
            ),
            _STRICT,
        ],
        "jaxpound design --example-config > design.toml\n"
        "  jaxpound simulate --example-record > quake.at2\n"
        "  jaxpound design design.toml --record quake.at2 --out results",
    ),
    "ida": Command(
        "an incremental dynamic analysis: records scaled up until buildings pound",
        [
            *_OUT,
            *_configuration("buildings, records and intensities", "an example analysis"),
            _file("--store", "keep finished runs there; a stopped analysis goes on", "DIR"),
            _STRICT,
        ],
    ),
    "rare": Command(
        "the probability of a rare event, however small, and its likeliest earthquake",
        [
            *_OUT,
            *_configuration("buildings, random earthquakes and the event", "an example"),
            _file(
                "--store",
                "keep design points and finished runs there, a stopped search goes on; by default "
                "in the output folder until it is done",
                "DIR",
            ),
            _STRICT,
        ],
    ),
    "hazard": Command(
        "how often buildings pound in years, from a hazard curve and a fragility",
        [*_OUT, *_configuration("the hazard, and a fragility or a study", "an example", FORMS[:1])],
    ),
}


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="jaxpound",
        description="Seismic pounding between adjacent structures joined by friction dampers.",
        epilog="example: jaxpound paper --out results",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"jaxpound {jp.__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, (summary, arguments, example_of_use) in _COMMANDS.items():
        command = commands.add_parser(
            name,
            help=summary,
            description=f"{summary[0].upper()}{summary[1:]}.",
            epilog=f"example:\n  {example_of_use.format(name)}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )
        for argument, options in arguments:
            command.add_argument(argument, **options)
    return parser
