"""The file of a search: what it gives back, and what is no such file."""

import errno
import json
import os
import zipfile

import jax
import numpy as np
import optax
import pytest

import jaxpound as jp
from jaxpound.design.lagrangian import AugmentedLagrangian
from jaxpound.design.problem import DesignProblem
from jaxpound.design.search import Iterate, SavedSearch, no_design
from jaxpound.store.archive import opened, write_archive
from tests.store.test_archive import part
from tests.store.test_store import flipped

IDENTITY = {"space": {"friction": [0.0, 1.0]}, "limits": [0.5], "key": (0, 1)}
SCALED = np.array([[0.25, 0.5], [0.5, 0.75], [1.0, 0.0]])


def begun(scaled=SCALED):
    space = jp.DesignSpace(jp.paper.structures(), {"friction": (0, 1), "mass_ratio": (1, 2)})
    grid = jp.TimeGrid(0.1, 10)
    ensemble = jp.Ensemble.of([jp.Ricker(0.1, [1.0], [1.0])] * 4, grid)
    objective = jp.Objective(limits={"damper_force": 0.5})
    problem = DesignProblem(space, ensemble, grid, jp.Scheme(), objective)
    optimiser = optax.with_extra_args_support(optax.adam(0.1))
    return AugmentedLagrangian(problem, optimiser, 4).begin(scaled)


@pytest.fixture
def state():
    return begun()


def met(state, n=2):
    best = no_design(state)
    return [Iterate(best._replace(scaled=state.scaled / 2), best, state.alive)] * n


def same(one, other):
    jax.tree.map(np.testing.assert_array_equal, one, other)


@pytest.fixture
def saved(tmp_path, state):
    found = SavedSearch(tmp_path / "search.npz", IDENTITY)
    found.write(state, met(state))
    return found


def test_what_was_saved_is_read_and_what_a_killed_search_left_is_swept(saved, state):
    held, history = saved.read(begun(SCALED / 2))
    same(held, state)
    assert len(history) == 2
    for one in history:
        same(one, met(state)[0])
    other = SavedSearch(saved.path.with_name("none.npz"), IDENTITY)
    assert other.read(state) == (state, [])
    others = saved.path.with_name("other.npz")
    left, other = (part(path, process=9_999_999_999, began="0") for path in (saved.path, others))
    saved.read(state)
    assert not left.exists()
    assert other.exists()


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


def rewritten(saved, drop=(), about=None, **changed):
    with opened(saved.path) as archive, zipfile.ZipFile(saved.path) as file:
        held = {name: np.load(file.open(f"{name}.npy")) for name in archive.names}
        about = archive.about if about is None else about
    arrays = {name: x for name, x in (held | changed).items() if name not in drop}
    write_archive(saved.path, arrays, about)


FOUR, HERE = np.ones((4, 2)), "'Iterate.here.scaled' is float64"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"drop": ("State.scaled",)}, "it lacks 'State.scaled'"),
        ({"drop": ("Iterate.best.merit",)}, "it lacks 'Iterate.best.merit'"),
        ({"State.scaled": np.ones((3, 2), np.float32)}, "'State.scaled' is float32"),
        ({"State.scaled": FOUR}, r"'State.scaled' is float64 of shape \(4, 2\), not .* \(3, 2\)"),
        ({"iterations": np.array([3])}, rf"{HERE} of shape \(2, 3, 2\), not .* \(3, 3, 2"),
        ({"iterations": np.array([-1])}, HERE),
        ({"Iterate.alive": np.ones((2, 3))}, "'Iterate.alive' is float64"),
    ],
)
def test_what_cannot_be_a_search_is_refused_by_name(saved, state, change, message):
    rewritten(saved)
    same(saved.read(state)[0], state)
    rewritten(saved, **change)
    refused = f"search.npz holds no search, or a damaged one .{message}"
    with pytest.raises(ValueError, match=refused):
        saved.read(state)


def test_a_file_of_an_earlier_version_is_refused(saved, state):
    for about in (IDENTITY, [1, 2], {"format": 3, **IDENTITY}):
        rewritten(saved, about=about)
        message = "npz holds no search, or one of another version of jaxpound; move it away"
        with pytest.raises(ValueError, match=message):
            saved.read(state)
    leaves = {f"state_{i}": np.asarray(x) for i, x in enumerate(jax.tree.leaves(state))}
    np.savez(saved.path, **leaves, identity=np.array(json.dumps(IDENTITY)))
    with pytest.raises(ValueError, match=r"or a damaged one \(.*seal.json.*; move it away"):
        saved.read(state)


def test_another_search_is_told(saved, state):
    with pytest.raises(ValueError, match="holds another search: limits differs"):
        SavedSearch(saved.path, IDENTITY | {"limits": [0.6]}).read(state)
    rewritten(saved, about={"format": 2, "space": IDENTITY["space"], "limits": [0.5]})
    with pytest.raises(ValueError, match="holds another search: key differs"):
        saved.read(state)


PUTS = {
    "folder": os.mkdir,
    "pipe": os.mkfifo,
    "loop": lambda path: os.symlink(path, path),
    "device": lambda path: os.symlink("/dev/zero", path),
}


@pytest.mark.parametrize("put", PUTS.values(), ids=PUTS)
def test_what_is_no_file_is_refused(saved, state, put):
    saved.path.unlink()
    put(saved.path)
    with pytest.raises(ValueError, match=r"holds no search, or a damaged one \(it is"):
        saved.read(state)


def test_a_file_that_cannot_be_written_is_named(tmp_path, state):
    path = tmp_path / "gone" / "search.npz"
    with pytest.raises(OSError, match="No such file or directory") as raised:
        SavedSearch(path, IDENTITY).write(state, met(state))
    assert (raised.value.errno, raised.value.filename) == (errno.ENOENT, str(path))
