"""Whole files, sealed archives, and what killed processes leave."""

import os
import subprocess
import sys
import time

import numpy as np
import pytest

from jaxpound.store import archive
from jaxpound.store.archive import DamagedError, opened, write_archive
from tests.refusals import refused

ARRAYS = {"numbers": np.linspace(0, 1, 5), "table": np.asfortranarray(np.arange(6).reshape(2, 3))}
ARRAYS |= {"one": np.array(3), "none": np.zeros((4, 0)), "flags": np.array([True, False])}
# Words that NumPy's own savez and load have a meaning for.
ARRAYS |= {"file": np.ones(2), "allow_pickle": np.ones(1), "γ of a.b": np.ones(1)}


def test_what_was_written_is_read_and_numpy_reads_it_too(tmp_path):
    path = tmp_path / "all.npz"
    write_archive(path, ARRAYS, {"who": "me"})
    with opened(path) as whole:
        assert whole.about == {"who": "me"}
        for name, x in ARRAYS.items():
            np.testing.assert_array_equal(whole.read(name, x.shape, x.dtype), x)
        with pytest.raises(DamagedError, match="it lacks 'other'"):
            whole.read("other", (), float)
    with np.load(path) as held:
        for name in ("numbers", "file"):
            np.testing.assert_array_equal(held[name], ARRAYS[name])
    first = path.read_bytes()
    write_archive(path, ARRAYS, {"who": "me"})
    assert path.read_bytes() == first


@pytest.mark.parametrize("name", ["", "a/b", "..\\b", "a\0b", "a\nb", "\ud800", "x" * 201, 3, None])
def test_what_cannot_name_an_array_is_refused(name):
    refused(r"column .* must have a name of 1 to 200", archive.require_name, name)


def part(path, *, host=None, process=None, began=None, age=0.0):
    """What a process that writes a file leaves if it is killed."""
    process = os.getpid() if process is None else process
    began = archive._start_time(process) if began is None else began
    left = path.with_name(f"{path.name}-{host or archive._host()}-{process}-{began}-0123abcd.part")
    left.write_bytes(b"half")
    os.utime(left, times=(time.time() - age,) * 2)
    assert archive.is_part(left.name)
    return left


def test_a_file_is_written_under_a_name_that_tells_its_writer(tmp_path):
    names = []
    archive.replace_file(tmp_path / "a", lambda file: names.append(file.name))
    assert names == [str(part(tmp_path / "a")).replace("0123abcd", names[0][-13:-5])]
    assert (tmp_path / "a").read_bytes() == b""


@pytest.mark.skipif(os.name != "posix", reason="the system does not say who is alive")
def test_what_processes_that_are_gone_left_is_swept(tmp_path):
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as alive:
        written = [
            part(tmp_path / "a"),
            part(tmp_path / "a", process=alive.pid, age=10_000),  # a slow one
            part(tmp_path / "a", host="0" * 12, age=3000),
        ]
        left = [
            part(tmp_path / "a", process=alive.pid, began="1"),  # another had its number
            part(tmp_path / "b", process=2**22 + 1),  # more than Linux gives
            part(tmp_path / "b", process=9_999_999_999, began="0"),
            part(tmp_path / "b", host="0" * 12, age=4000),
        ]
        mine = tmp_path / "download.part"
        mine.write_bytes(b"a user's own")
        os.utime(mine, times=(0, 0))
        archive.sweep_parts(tmp_path, "b")
        assert left[0].exists()
        archive.sweep_parts(tmp_path)
        assert sorted(tmp_path.iterdir()) == sorted([*written, mine])
        alive.kill()
        # It has ended, though nobody has asked how.
        while archive._start_time(alive.pid) != "0":
            time.sleep(0.01)
        archive.sweep_parts(tmp_path)
        assert sorted(tmp_path.iterdir()) == sorted([written[0], written[2], mine])
