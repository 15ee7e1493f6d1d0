"""Signals, sent to real processes; what the command line says: tests/cli/test_main.py."""

import os
import signal
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(os.name == "nt", reason="signals are sent as POSIX has them")

PROGRAM = """
import signal, sys, threading, time
from pathlib import Path
from jaxpound import _interruption as interruption

folder, seconds, ignored = Path(sys.argv[1]), float(sys.argv[2]), sys.argv[3] == "ignored"
signal.signal(signal.SIGINT, signal.SIG_IGN if ignored else signal.default_int_handler)
interruption._PATIENCE = 1.0
interruption.end_at_a_signal()
interruption.report_kept_files(lambda: "a and b are kept")
for name in ("empty/below", "used"):
    interruption.make_folder(folder / name)
(folder / "used" / "file").touch()

def write():
    with interruption.unfinished(folder / "x.part"):
        (folder / "x.part").write_text("whole")
        print("writing", flush=True)
        time.sleep(seconds)
        (folder / "x.part").replace(folder / "x")

threading.Thread(target=write, daemon=True).start()
time.sleep(60)
"""

LATE = """
import os, signal
from jaxpound import _interruption as interruption
signal.signal(signal.SIGINT, signal.default_int_handler)
interruption.end_at_a_signal()
os.kill(os.getpid(), signal.SIGINT)
interruption.end(0)
"""


def end(folder, seconds, *numbers, ignored=False):
    """Exit status and stderr of a process that has begun to write a file, after signals."""
    arguments = [str(folder), str(seconds), "ignored" if ignored else ""]
    command, pipe = [sys.executable, "-c", PROGRAM, *arguments], subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True) as process:
        assert process.stdout.readline() == "writing\n"
        for number in numbers:
            process.send_signal(number)
        return process.wait(30), process.stderr.read()


def test_a_file_that_is_being_written_is_finished_or_after_some_time_removed(tmp_path):
    told = end(tmp_path, 0.1, signal.SIGINT)
    assert told == (130, "jaxpound: interrupted; a and b are kept\n")
    assert (tmp_path / "x").read_text() == "whole"
    # Of the folders that it made, those it had written to stay.
    assert sorted(path.name for path in tmp_path.iterdir()) == ["used", "x"]
    slow = tmp_path / "slow"
    slow.mkdir()
    assert end(slow, 60, signal.SIGINT)[0] == 130
    assert sorted(path.name for path in slow.iterdir()) == ["used"]


def test_signals_that_were_ignored_stay_so_and_late_ones_are_told(tmp_path):
    """Such as Ctrl-C for what a script runs in the background."""
    told = end(tmp_path, 0.1, signal.SIGINT, signal.SIGTERM, ignored=True)
    assert told == (143, "jaxpound: terminated; a and b are kept\n")
    for _ in range(5):
        done = subprocess.run([sys.executable, "-c", LATE], capture_output=True, text=True)
        told = (done.returncode, done.stderr)
        assert told == (130, "jaxpound: interrupted; nothing was written\n")
