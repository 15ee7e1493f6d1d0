"""The file of a search: what it gives back, and what is no such file."""

import json
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
from tests.refusals import refusals, refused
from tests.store.test_archive import part

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


def met(state):
    best = no_design(state)
    return Iterate(best._replace(scaled=state.scaled / 2), best, state.alive)


@pytest.fixture
def saved(tmp_path, state):
    search = SavedSearch(tmp_path / "search.npz", IDENTITY)
    search.write(state, [met(state)] * 2)
    return search


def test_what_was_saved_is_read_and_what_a_killed_search_left_is_swept(saved, state):
    rewritten(saved)
    held, history = saved.read(begun(SCALED / 2))
    for read, written in zip((held, *history), (state, met(state), met(state)), strict=True):
        jax.tree.map(np.testing.assert_array_equal, read, written)
    other = SavedSearch(saved.path.with_name("none.npz"), IDENTITY)
    assert other.read(state) == (state, [])
    others = saved.path.with_name("other.npz")
    left, other = (part(path, process=9_999_999_999, began="0") for path in (saved.path, others))
    saved.read(state)
    assert not left.exists()
    assert other.exists()


def rewritten(saved, drop=(), about=None, **changed):
    with opened(saved.path) as archive, zipfile.ZipFile(saved.path) as file:
        held = {name: np.load(file.open(f"{name}.npy")) for name in archive.names}
        about = archive.about if about is None else about
    arrays = {name: x for name, x in (held | changed).items() if name not in drop}
    write_archive(saved.path, arrays, about)


FOUR, HERE = np.ones((4, 2)), "'Iterate.here.scaled' is float64"


def read_after(saved, state, change):
    rewritten(saved, **change)
    saved.read(state)


test_what_cannot_be_a_search_is_refused_by_name = refusals(
    ({"drop": ("State.scaled",)}, "it lacks 'State.scaled'"),
    ({"drop": ("Iterate.best.merit",)}, "it lacks 'Iterate.best.merit'"),
    ({"State.scaled": np.ones((3, 2), np.float32)}, "'State.scaled' is float32"),
    ({"State.scaled": FOUR}, r"'State.scaled' is float64 of shape \(4, 2\), not .* \(3, 2\)"),
    ({"iterations": np.array([3])}, rf"{HERE} of shape \(2, 3, 2\), not .* \(3, 3, 2"),
    ({"iterations": np.array([-1])}, HERE),
    ({"Iterate.alive": np.ones((2, 3))}, "'Iterate.alive' is float64"),
    of=read_after,
    before="search.npz holds no search, or a damaged one .",
    fixtures=("saved", "state"),
)


def test_a_file_of_an_earlier_version_is_refused(saved, state):
    for about in (IDENTITY, [1, 2], {"format": 3, **IDENTITY}):
        rewritten(saved, about=about)
        refused("no search, or one of another version of jaxpound; move it away", saved.read, state)
    leaves = {f"state_{i}": np.asarray(x) for i, x in enumerate(jax.tree.leaves(state))}
    np.savez(saved.path, **leaves, identity=np.array(json.dumps(IDENTITY)))
    refused(r"or a damaged one \(.*seal.json.*; move it away", saved.read, state)
