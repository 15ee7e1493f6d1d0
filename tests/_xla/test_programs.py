"""Compiled programs: whose folder they are kept in, what is removed, and the note on compiling."""

import os
import subprocess
import sys
import time
from functools import reduce
from pathlib import Path
from unittest.mock import Mock

import jax
import jax.monitoring
import jax.numpy as jnp
import pytest
from jax.experimental.compilation_cache import compilation_cache

import jaxpound as jp
from jaxpound._xla import programs
from jaxpound.cli import main as cli

posix = pytest.mark.skipif(os.name == "nt", reason="Windows has no owners and modes")
SETTINGS = ("jax_compilation_cache_dir", "jax_persistent_cache_min_compile_time_secs")


@pytest.fixture(autouse=True)
def without_a_folder(monkeypatch):
    """JAX without a folder of its own, as users have it; what the suite has comes back."""
    before = {name: getattr(jax.config, name) for name in SETTINGS}
    jax.config.update("jax_compilation_cache_dir", None)
    monkeypatch.delenv("JAXPOUND_CACHE", raising=False)
    yield
    for name, value in before.items():
        jax.config.update(name, value)
    compilation_cache.reset_cache()


def compile_anew():
    """A program of a few operations, compiled or read from the folder; the folder's entries."""
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    compilation_cache.reset_cache()
    jax.clear_caches()
    assert jax.jit(lambda x: x * 3 + 1)(2.0) == 7
    return {
        path: path.read_bytes()
        for path in Path(jax.config.jax_compilation_cache_dir).iterdir()
        if path.name.endswith("-cache") and "lambda" in path.name
    }


def test_an_entry_serves_the_next_process(tmp_path):
    jp.runtime.keep_programs(tmp_path)
    (path,) = (whole := compile_anew())
    before = path.stat().st_mtime_ns
    jp.runtime.keep_programs(tmp_path)
    assert compile_anew() == whole
    assert path.stat().st_mtime_ns == before


def test_only_entries_are_removed_and_those_first_that_were_used_longest_ago(tmp_path, monkeypatch):
    folder = jp.runtime.keep_programs(tmp_path)
    (entry,) = compile_anew().values()
    for path in folder.glob("*-cache"):
        path.unlink()
    names = [f"jit_f-{k:064x}-cache" for k in range(4)]
    others = [tmp_path / "thesis.dat", folder / "thesis.dat", folder / "notes-cache"]
    for k, path in enumerate([*others, *(folder / name for name in names)]):
        path.write_bytes(entry)
        os.utime(path, (1e9 + k, 1e9 + k))
    mine = {path: path.read_bytes() for path in others}
    monkeypatch.setattr(programs, "_LARGEST", 2 * len(entry))
    jp.runtime.keep_programs(tmp_path)
    assert {path: path.read_bytes() for path in others} == mine
    assert [name for name in names if (folder / name).exists()] == names[2:]


@posix
def test_the_folder_is_made_for_its_owner_alone(tmp_path):
    before = os.umask(0)
    try:
        folder = jp.runtime.keep_programs(tmp_path / "caches")
    finally:
        os.umask(before)
    assert folder == tmp_path / "caches" / "jaxpound" / "programs"
    assert [path.stat().st_mode & 0o777 for path in (folder, folder.parent)] == [0o700, 0o700]
    assert jax.config.jax_compilation_cache_dir == str(folder)


def refused(folder):
    """What the warning names; nothing is kept."""
    rule = "must be a folder of yours that nobody else may write to: what is in it is executed"
    with pytest.warns(UserWarning, match=f"^keep_programs: .* {rule}; .*; .* not kept$") as caught:
        assert jp.runtime.keep_programs(folder) is None
    assert jax.config.jax_compilation_cache_dir is None
    words = str(caught[0].message).split()
    path = Path(words[1])
    remedy = ["chmod", "go-w", f"{path};"] if "chmod" in words else ["by", "JAXPOUND_CACHE;"]
    assert words[-len(remedy) - 5 : -5] == remedy
    assert ("empty" in words) == ("chmod" in words and "jaxpound" in path.parts)
    return path


@posix
@pytest.mark.parametrize("mode", [0o777, 0o770, 0o702])
@pytest.mark.parametrize("below", ["", "jaxpound", "jaxpound/programs"])
def test_a_folder_that_others_may_write_to_is_refused(tmp_path, below, mode):
    (tmp_path / "jaxpound" / "programs").mkdir(parents=True, mode=0o700)
    (tmp_path / "jaxpound").chmod(0o700)
    (tmp_path / below).chmod(mode)
    assert refused(tmp_path) == tmp_path / below


@posix
def test_a_folder_below_one_for_all_is_refused_unless_sticky_and_a_link_in_its_place(tmp_path):
    caches = tmp_path / "of all" / "mine" / "caches"
    caches.mkdir(parents=True)
    caches.parents[1].chmod(0o777)
    with pytest.warns(UserWarning, match="run chmod go-w '.*/of all'; compiled programs are not"):
        assert jp.runtime.keep_programs(caches) is None
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "jaxpound").symlink_to(tmp_path / "elsewhere")
    assert refused(tmp_path) == tmp_path / "jaxpound"
    caches.parents[1].chmod(0o1777)
    assert jp.runtime.keep_programs(caches) == caches / "jaxpound" / "programs"


@posix
def test_folders_of_others_in_a_folder_for_all_are_refused(tmp_path, monkeypatch):
    """As ``/tmp``, where everybody may make folders, and nobody replaces those of others."""
    tmp_path.chmod(0o1777)
    folder = jp.runtime.keep_programs(tmp_path)
    assert folder is not None
    jax.config.update("jax_compilation_cache_dir", None)
    user = os.getuid()
    monkeypatch.setattr(os, "getuid", lambda: user + 1)
    assert refused(tmp_path) == (tmp_path if user else folder.parent)


def test_the_environment_names_the_folder_and_without_one_nothing_is_kept(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    with pytest.warns(UserWarning, match=r"keep_programs: .*file.*; compiled programs are not kep"):
        assert jp.runtime.keep_programs(tmp_path / "file") is None
    for caches in (tmp_path / "file", Path("~no-such-user")):  # of a user without a home
        monkeypatch.setattr(programs, "user_cache_path", lambda caches=caches: caches)
        assert jp.runtime.keep_programs() is None
    monkeypatch.setenv("JAXPOUND_CACHE", "off")
    assert jp.runtime.keep_programs() is None
    monkeypatch.setenv("JAXPOUND_CACHE", str(tmp_path))
    folder = tmp_path / "jaxpound" / "programs"
    assert jp.runtime.keep_programs() == folder
    monkeypatch.setenv("JAXPOUND_CACHE", str(tmp_path / "other"))
    assert jp.runtime.keep_programs() == folder  # JAX's own, by now


@posix
@pytest.mark.filterwarnings("default")
def test_the_command_line_goes_on_without_a_folder_that_it_refuses(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("JAXPOUND_CACHE", str(tmp_path / "caches"))
    monkeypatch.delenv("TF_CPP_MIN_LOG_LEVEL")  # which JAX has set
    (tmp_path / "caches").mkdir()
    (tmp_path / "caches").chmod(0o777)
    arguments = f"jaxpound simulate --record missing.at2 --out {tmp_path}/out".split()
    monkeypatch.setattr("sys.argv", arguments)
    assert cli.main() == 2
    warning, error = capsys.readouterr().err.splitlines()
    assert warning.startswith(f"jaxpound: warning: {tmp_path}/caches must be a folder of yours")
    assert "missing.at2: no such file" in error
    assert os.environ["TF_CPP_MIN_LOG_LEVEL"] == "3"  # no alarm of XLA's at a long compilation


def test_a_wait_is_noted_once_over_its_phases_and_a_short_one_is_not(monkeypatch, caplog, tmp_path):
    def notes():
        return [text for name, _, text in caplog.record_tuples if name == "jaxpound"]

    def phase(name, seconds):
        """Of JAX, one within another, as a function that calls a compiled one is traced."""
        event = f"/jax/core/compile/{name}_duration"
        for part in (0.0, seconds, 0.0):
            jax.monitoring.record_scalar(event, time.time(), fun_name="f")
            time.sleep(part)
            jax.monitoring.record_event_duration_secs(event, part)

    monkeypatch.setattr(programs, "AFTER", 0.2)
    monkeypatch.setattr(programs, "_PAUSE", 0.1)
    programs.note_long_compilations()
    time.sleep(0.15)
    phase("jaxpr_trace", 0.01)
    time.sleep(0.3)  # as a run of the program
    assert notes() == []
    for seconds in (0.12, 0.3):  # the wait is longer than any phase; nor is a second line printed
        for name in programs._PHASES:
            phase(name, seconds)
        (line,) = notes()
        assert line.startswith("jaxpound: tracing and compiling a program, for 0.2 s so far; later")
        assert line.endswith("reuse it, and later processes after jaxpound.runtime.keep_programs()")
        caplog.clear()
        time.sleep(0.15)
    slow = jax.jit(lambda x: reduce(lambda x, k: jax.lax.sort(jnp.sin(x * k)), range(60), x))
    x = jax.block_until_ready(jnp.arange(3.0))
    time.sleep(0.15)
    caplog.clear()
    monkeypatch.setattr(programs, "AFTER", 0.01)
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    slow(x)
    (line,) = notes()  # of JAX's own events
    assert line.endswith("so far; later runs of the same kind and time grid reuse it")


def test_runs_see_to_the_note(monkeypatch):
    """Whatever program they are in, and before it is compiled."""
    note, grid = Mock(), jp.TimeGrid.until(20.0, dt=0.05)
    monkeypatch.setattr("jaxpound.simulation.run.note_long_compilations", note)
    jax.eval_shape(lambda: jp.demand(jp.paper.structures(), jp.paper.ground(), grid))
    assert note.called


HAS_KERNELS = jax.__version_info__ >= (0, 12)
"""Whether XLA compiles small loops as kernels by itself."""

DROP = """
import os, jax, jax.numpy as jnp, jaxpound as jp
os.environ["XLA_FLAGS"] = "--xla_cpu_enable_fast_math=false"
{call}
def drop(height):
    building = jp.System((1.0,), (jp.Rod(jp.ZenerRod(0.5, 0.1, 0.2), 1.0, (0, jp.GROUND)),))
    return jp.demand(building, jp.Ricker(height, 2.0, 3.0), jp.TimeGrid(0.1, 200)).peak_x1

program = jax.jit(drop).lower(1.0).compile().as_text()
assert ("xla_cpu_small_call" in program) == {kernels}
"""

LOOP_KERNELS = """
devices = jax.config.jax_num_cpu_devices
jp.runtime.use_loop_kernels()
jp.runtime.use_loop_kernels()  # once is enough
assert os.environ["XLA_FLAGS"].startswith("--xla_cpu_enable_fast_math=false ")
assert os.environ["XLA_FLAGS"].count("small_while_loop") == 1
assert jax.config.jax_num_cpu_devices == devices
"""


@pytest.mark.skipif(HAS_KERNELS, reason="this version needs no option")
def test_a_loop_is_one_kernel_if_it_is_asked_for_before_jax_starts(monkeypatch):
    monkeypatch.delenv("XLA_FLAGS", raising=False)
    program = DROP.format(call=LOOP_KERNELS, kernels=True)
    subprocess.run([sys.executable, "-c", program], check=True)
    jnp.zeros(1).block_until_ready()
    with pytest.raises(RuntimeError, match="use_loop_kernels must be called before JAX computes"):
        jp.runtime.use_loop_kernels()


def test_newer_versions_of_jax_make_kernels_by_themselves(monkeypatch):
    """There the call does nothing, also after JAX has started."""
    monkeypatch.delenv("XLA_FLAGS", raising=False)
    program = DROP.format(call="", kernels=HAS_KERNELS)
    subprocess.run([sys.executable, "-c", program], check=True)
    jnp.zeros(1).block_until_ready()
    monkeypatch.setattr(jax, "__version_info__", (0, 12, 0))
    jp.runtime.use_loop_kernels()
    assert "small_while_loop" not in os.environ.get("XLA_FLAGS", "")
