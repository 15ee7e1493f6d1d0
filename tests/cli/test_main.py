"""The command line: its arguments, its help, its refusals, its end."""

import os
import re
import signal
import subprocess
import sys
import warnings
from time import sleep

import pytest

import jaxpound as jp
from jaxpound.cli import main as cli
from jaxpound.cli.files import example
from jaxpound.store.store import Store
from tests.cli.commands import changed, refusal

SIMULATE = ["simulate", "--record", "PULSE", "--out", "OUT"]
STUDY = ["montecarlo", "STUDY", "--store", "OUT"]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "COMMAND"),
        (["papper"], "invalid choice: 'papper'"),
        (["paper"], "--out"),
        (["simulate", "--out", "OUT"], "--record"),
        (["simulate", "--record", "missing.at2", "--out", "OUT"], "missing.at2: no such file"),
        ([*SIMULATE, "--config", "no.toml"], "no.toml: No such"),
        ([*SIMULATE, "--units", "ell"], "units = 'ell'"),
        ([*SIMULATE, "--dt", "x"], "--dt: invalid float"),
        ([*SIMULATE, "--dt", "0.1"], "dt = 0.1 must agree"),
        ([*SIMULATE, "--scale", "2"], "--scale"),
        (["paper", "--out", ""], "argument --out: must not be empty"),
        ([*STUDY, "--samples", "0"], "n = 0 must be a positive whole number"),
        ([*STUDY, "--shard", "1-2"], "--shard: '1-2' must be I/N"),
        ([*STUDY, "--shard", "3/2"], "'3/2' must be I/N with I from 1 to N"),
        ([*STUDY, "--commands", "0"], "argument --commands = 0 must be a positive whole"),
        ([*STUDY, "--commands", "2", "--shard", "1/2"], "--commands: not allowed with --shard 1/2"),
        ([*STUDY, "--commands", "64"], "the study has 10; a smaller chunk_size makes more"),
        ([*STUDY, "--commands", "2", "--samples", "0"], "n = 0 must be a positive whole number"),
        (["montecarlo", "none.toml", "--store", "OUT"], "none.toml: No such file"),
        (["report", "--store", "none", "--out", "OUT"], "must be a folder with a manifest.json"),
    ],
)
def test_faulty_arguments(arguments, says, pulse, tmp_path, capsys):
    places = {"OUT": tmp_path / "out", "PULSE": pulse, "STUDY": tmp_path / "study.toml"}
    places["STUDY"].write_text(example("montecarlo"))
    assert says in refusal(capsys, *(places.get(word, word) for word in arguments))


@pytest.mark.parametrize("command", ["paper", "simulate"])
@pytest.mark.parametrize("below", ["", "folder"])
def test_an_output_folder_that_cannot_be_made(command, below, pulse, tmp_path, capsys):
    (tmp_path / "file").write_text("mine")
    out = tmp_path / "file" / below
    record = ["--record", pulse] if command == "simulate" else []
    line = refusal(capsys, command, *record, "--out", out)
    assert f"argument --out: {out} must be a folder" in line
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.parametrize(
    "command", ["", "paper", "simulate", "montecarlo", "report", "design", "ida", "rare", "hazard"]
)
def test_help_has_an_example(command, capsys):
    with pytest.raises(SystemExit, match="0"):
        cli.main([*command.split(), "--help"])
    assert re.search(rf"example:\s+jaxpound {command}", capsys.readouterr().out)


def python(*arguments, **options):
    """A new process of Python, when it has ended."""
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, **options)


JUDGED = """
import atexit, sys, time; from jaxpound.cli.main import main
def judge():
    assert not {'jax', 'numpy'} & {*sys.modules}
    assert time.process_time() < 0.5
    print('soon', flush=True)
atexit.register(judge)
sys.exit(main())
"""
ENDED = {"--help": 0, "design --help": 0, "--version": 0, "montecarlo --example-config": 0}


@pytest.mark.parametrize(("arguments", "status"), [*ENDED.items(), ("paper", 2), ("papper", 2)])
def test_help_and_faulty_arguments_need_no_jax(arguments, status):
    done = python("-c", JUDGED, *arguments.split())
    assert (done.returncode, done.stdout.splitlines()[-1]) == (status, "soon")


def test_the_command_line_uses_every_core():
    program = (
        "import os, jax; from jaxpound.cli.main import main; "
        "assert main(['simulate', '--record', 'missing.at2', '--out', 'none']) == 2; "
        "assert len(jax.devices('cpu')) == len(os.sched_getaffinity(0)), jax.devices()"
    )
    done = python("-c", program)
    assert done.returncode == 0, done.stderr


# A process that Ctrl-C reaches even where whoever runs the tests ignores it.
PROGRAM = (
    "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
    "from jaxpound.__main__ import main; main()"
)
posix = pytest.mark.skipif(os.name == "nt", reason="signals are sent as POSIX has them")


def ended(*arguments: object, when: str, number: int = signal.SIGINT, **env: str) -> list[str]:
    """Run a command, signal once a line on stderr has ``when``; what stderr says after that."""
    own = {name: x for name, x in os.environ.items() if not name.startswith("JAX_")}
    command = [sys.executable, "-X", "importtime", "-c", PROGRAM, *map(str, arguments)]
    out, err = subprocess.DEVNULL, subprocess.PIPE
    with subprocess.Popen(command, stdout=out, stderr=err, text=True, env=own | env) as process:
        assert any(when in line for line in process.stderr)
        process.send_signal(number)
        rest = process.stderr.read()
        assert process.wait(60) == 128 + number
    return [line for line in rest.splitlines() if not line.startswith("import time:")]


COMMANDS = {
    "paper": ["--out", "OUT"],
    "simulate": ["--record", "record.at2", "--out", "OUT"],
    "montecarlo": ["study.toml", "--store", "STORE"],
    "report": ["--store", "STORE", "--out", "OUT"],
    "design": ["design.toml", "--save", "state.npz", "--out", "OUT"],
}


@posix
@pytest.mark.parametrize("command", COMMANDS)
def test_interrupted_while_jax_is_imported(command, tmp_path):
    """Where an exception may end in a crash of what is being loaded."""
    places = {"OUT": tmp_path / "new" / "out", "STORE": tmp_path / "store"}
    said = ended(command, *(places.get(word, word) for word in COMMANDS[command]), when="jaxlib")
    kept = "no chunk was finished" if command == "montecarlo" else "nothing was written"
    assert said == [f"jaxpound: interrupted; {kept}"]
    assert not list(tmp_path.iterdir())


@posix
@pytest.mark.parametrize(
    ("number", "when"),
    [(signal.SIGINT, "argparse"), (signal.SIGTERM, "argparse"), (signal.SIGTERM, "jaxlib")],
)
def test_interrupted_before_anything_is_imported(number, when, tmp_path):
    """What the command line itself needs, such as argparse."""
    said = ended("paper", "--out", tmp_path / "out", when=when, number=number)
    word = "interrupted" if number == signal.SIGINT else "terminated"
    assert said == [f"jaxpound: {word}; nothing was written"]


def test_the_process_ends_when_all_is_written():
    """What else would run, JAX's shutdown of seconds, no longer heeds signals."""
    program = (
        "import atexit, sys; sys.argv = ['jaxpound', '--version']\n"
        "atexit.register(print, 'an orderly exit')\n"
        "from jaxpound.__main__ import main; main()"
    )
    done = python("-c", program)
    assert (done.returncode, done.stdout) == (0, f"jaxpound {jp.__version__}\n")


@posix
def test_interrupted_while_xla_compiles(tmp_path):
    """At once: not when it has compiled, nor with a crash in what it clears up then."""
    out = tmp_path / "new" / "out"
    started = "Finished jaxpr to MLIR module conversion jit(_simulate)"
    said = ended("paper", "--out", out, when=started, JAX_LOG_COMPILES="1")
    assert said[-1] == "jaxpound: interrupted; nothing was written"
    assert not any("Finished XLA compilation" in line for line in said)
    assert not list(tmp_path.iterdir())


@posix
def test_an_interrupted_study_keeps_its_finished_chunks(tmp_path):
    path, folder = tmp_path / "study.toml", tmp_path / "store"
    changes = "chunk_size = 16 & arrivals = {uniform = [0.5, 1.0]} & duration = 2.0"
    path.write_text(changed(example("montecarlo"), changes))
    command = [sys.executable, "-c", PROGRAM, "montecarlo", str(path), "--store", str(folder)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        while process.poll() is None and not (folder / "chunk-000001.npz").exists():
            sleep(0.01)
        process.send_signal(signal.SIGINT)
        said = process.stderr.read()
        assert process.wait(60) == 130
    again = "the same command goes on from there"
    # On a busy machine a note before it says that compilation takes long.
    told = f"jaxpound: interrupted; finished chunks are kept in {folder}, and {again}"
    assert said.splitlines()[-1] == told
    store = Store(folder)
    found = [chunk for chunk in store.chunks() if store.has(chunk)]
    assert 2 <= len(found) < len(store.chunks())
    assert all(store.read(chunk) is not None for chunk in found)
    assert not [*folder.glob("*.part")]


@pytest.mark.parametrize("options", [[], ["-u"]])
def test_nobody_reads_what_is_printed(options):
    """As ``jaxpound simulate --example-config | true``."""
    own = {name: x for name, x in os.environ.items() if name != "PYTHONUNBUFFERED"}
    command = [sys.executable, *options, "-m", "jaxpound", "simulate", "--example-config"]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, env=own) as process:
        process.stdout.close()
        assert process.stderr.read() == ""
        assert process.wait(60) == 141


def test_a_link_is_warned_of_once_by_its_table_in_the_file(capsys):
    with cli._short_warnings(strict=False):
        for name in ("configuration: [[link]] 3 (1–2, floor 5)", "simulate: link 1–2, floor 5"):
            warnings.warn(jp.PlausibilityWarning(f"{name}: gap = 9 m"), stacklevel=1)
    error = capsys.readouterr().err
    assert error == "jaxpound: warning: [[link]] 3 (1–2, floor 5): gap = 9 m\n"
