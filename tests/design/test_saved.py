"""The file of a search: what it gives back, and what is no such file."""

import errno
import json
import os

import jax
import numpy as np
import optax
import pytest

import jaxpound as jp
from jaxpound.design.saved import Met, SavedSearch
from jaxpound.design.search import Search, Setting
from jaxpound.study.archives import write_archive
from tests.study.test_archives import part
from tests.study.test_store import flipped

IDENTITY = {"space": {"friction": [0.0, 1.0]}, "limits": [0.5], "key": (0, 1)}
SHARES = np.array([[0.25, 0.5], [0.5, 0.75], [1.0, 0.0]])


def begun(shares=SHARES):
    space = jp.DesignSpace(jp.paper.structures(), {"friction": (0, 1), "mass_ratio": (1, 2)})
    setting = Setting(jp.TimeGrid(0.1, 10), jp.Scheme(), None)
    objective = jp.Objective(limits={"damper_force": 0.5})
    optimiser = optax.with_extra_args_support(optax.adam(0.1))
    return Search(space, setting, objective, optimiser, 4, 4).begin(shares)


@pytest.fixture
def state():
    return begun()


def met(state, n=2):
    return [jax.device_get(Met.at(state.best, state.alive, state.best)) for _ in range(n)]


def same(one, other):
    jax.tree.map(np.testing.assert_array_equal, one, other)


@pytest.fixture
def saved(tmp_path, state):
    found = SavedSearch(tmp_path / "search.npz", IDENTITY)
    found.write(state, met(state))
    return found


def test_what_was_saved_is_read(saved, state):
    held, history = saved.read(begun(SHARES / 2))
    same(held, state)
    assert len(history) == 2
    for one in history:
        same(one, met(state)[0])
    other = SavedSearch(saved.path.with_name("none.npz"), IDENTITY)
    assert other.read(state) == (state, [])


def test_no_flipped_bit_goes_unnoticed(saved, state):
    noticed = harmless = 0
    for _ in flipped(saved.path, lambda place: {place % 8} if place % 11 == 0 else {}):
        try:
            held, history = saved.read(state)
        except ValueError:
            noticed += 1
            continue
        harmless += 1
        same(held, state)
        same(history[1], met(state)[1])
    assert noticed > 3 * harmless > 0


def rewritten(saved, state, drop=(), about=IDENTITY, **changed):
    leaves = {f"state_{i}": np.asarray(x) for i, x in enumerate(jax.tree.leaves(state))}
    rows = {
        name: np.stack(x)
        for name, x in zip(Met._fields, zip(*met(state), strict=True), strict=True)
    }
    arrays = leaves | rows | {"iterations": np.array([2], np.int64)} | changed
    write_archive(saved.path, {k: x for k, x in arrays.items() if k not in drop}, about)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"drop": ("state_0",)}, "it lacks 'state_0'"),
        ({"drop": ("merit",)}, "it lacks 'merit'"),
        ({"about": [1, 2]}, "it does not say which search it holds"),
        ({"about": {"space": 1}}, "it does not say which search it holds"),
        ({"state_0": np.ones((3, 2), np.float32)}, "'state_0' is float32"),
        ({"state_0": np.ones((4, 2))}, r"'state_0' is float64 of shape \(4, 2\), not .* \(3, 2\)"),
        (
            {"iterations": np.array([3])},
            r"'shares' is float64 of shape \(2, 3, 2\), not .* \(3, 3, 2",
        ),
        ({"iterations": np.array([-1])}, "'shares' is float64"),
        ({"alive": np.ones((2, 3))}, "'alive' is float64"),
    ],
)
def test_what_cannot_be_a_search_is_refused_by_name(saved, state, change, message):
    rewritten(saved, state)
    same(saved.read(state)[0], state)
    rewritten(saved, state, **change)
    with pytest.raises(
        ValueError, match=f"search.npz holds no search, or a damaged one .{message}"
    ):
        saved.read(state)


def test_a_file_of_an_earlier_version_is_refused(saved, state):
    leaves = {f"state_{i}": np.asarray(x) for i, x in enumerate(jax.tree.leaves(state))}
    np.savez(saved.path, **leaves, identity=np.array(json.dumps(IDENTITY)))
    with pytest.raises(ValueError, match=r"or a damaged one \(.*seal.json.*; move it away"):
        saved.read(state)


@pytest.mark.parametrize(
    "put",
    [os.mkdir, os.mkfifo, lambda p: os.symlink(p, p), lambda p: os.symlink("/dev/zero", p)],
    ids=["folder", "pipe", "loop", "device"],
)
def test_what_is_no_file_is_refused(saved, state, put):
    saved.path.unlink()
    put(saved.path)
    with pytest.raises(ValueError, match=r"holds no search, or a damaged one \(it is"):
        saved.read(state)


def test_another_search_is_told(saved, state):
    with pytest.raises(ValueError, match="holds another search: limits differs"):
        SavedSearch(saved.path, IDENTITY | {"limits": [0.6]}).read(state)


def test_what_a_killed_search_left_is_swept(saved, state):
    left = part(saved.path, process=9_999_999_999, began="0")
    other = part(saved.path.with_name("other.npz"), process=9_999_999_999, began="0")
    saved.read(state)
    assert not left.exists()
    assert other.exists()


def test_a_file_that_cannot_be_written_is_named(tmp_path, state):
    with pytest.raises(OSError, match="No such file or directory") as raised:
        SavedSearch(tmp_path / "gone" / "search.npz", IDENTITY).write(state, met(state))
    assert (raised.value.errno, raised.value.filename) == (
        errno.ENOENT,
        str(tmp_path / "gone" / "search.npz"),
    )
