"""The house's own rules: silence on import, one direction of imports, the public names."""

import ast
import dataclasses
import doctest
import importlib
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import jaxpound as jp
from jaxpound._extras import EXTRAS

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "jaxpound"

# From the ground floor up; a module imports only from below itself.
FLOORS = [
    {
        *("_pytree", "_checks", "_branches", "_describe", "_extras", "_root", "_tables"),
        *("_version", "examples", "interruption", "quantities"),
    },
    {"columns", "distributions", "estimates", "fragility", "sampling", "archives", "store"},
    {"structures", "ground", "fractional", "friction", "response", "batches"},
    {"record_headers", "rods", "tally"},
    {"scheme"},
    {"intensity"},
    {"plausibility"},
    {"records", "simulation"},
    {"units", "paper", "scenarios"},
    {"buildings"},
    {"study", "sensitivity", "design_space", "ensembles", "objectives"},
    {"chunks", "search", "comparison", "elasticity", "calibration"},
    {"study_run", "design", "first_order", "saved_search"},
    {"design_search"},
    {"pareto"},
    {"figure_style", "config"},
    {
        "plots",
        "study_plots",
        "design_plots",
        "record_plots",
        "convergence_plots",
        "drawing",
        "live_panels",
        "sliders",
    },
    {"animation", "explorer", "earthquake_config"},
    {"study_config", "design_config"},
    {"report", "study_report", "design_report"},
    {"cli"},
    {"__main__"},
]


def imports(module):
    tree = ast.parse((PACKAGE / f"{module}.py").read_text())
    for_types_only = {
        node
        for test in ast.walk(tree)
        if isinstance(test, ast.If) and ast.unparse(test.test) == "TYPE_CHECKING"
        for node in ast.walk(test)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node not in for_types_only:
            yield node.module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def test_every_module_has_its_floor():
    modules = {path.stem for path in PACKAGE.glob("*.py")} - {"__init__"}
    assert modules == set().union(*FLOORS)


@pytest.mark.parametrize("level", range(len(FLOORS)))
def test_no_import_runs_upwards(level):
    below = set().union(*FLOORS[:level])
    for module in FLOORS[level]:
        ours = [m.partition(".")[2] for m in imports(module) if m.startswith("jaxpound.")]
        assert set(ours) <= below | FLOORS[level] - {module}, module


def test_what_the_root_lends_is_imported_when_it_is_used():
    """``Response.plot`` draws by what stands above it: only the root may know both."""
    code = (
        "import sys; import jaxpound.response as response; from jaxpound import _root; "
        "assert response._root.overview.__module__ == 'jaxpound'; "
        "assert not {'jaxpound.plots', 'matplotlib'} & sys.modules.keys()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_no_import_is_hidden():
    """By ``importlib``, ``__import__`` or ``sys.modules``, where this file could not see it."""
    for path in PACKAGE.glob("*.py"):
        names = {
            node.attr if isinstance(node, ast.Attribute) else node.id
            for node in ast.walk(ast.parse(path.read_text()))
            if isinstance(node, ast.Attribute | ast.Name)
        }
        hidden = names & {"import_module", "__import__", "modules"}
        # The root stands above all, and the extras are no modules of ours.
        assert not hidden or path.stem in ("__init__", "_extras"), path.stem
    assert all(not library.startswith("jaxpound") for library in EXTRAS)


def test_only_figures_import_matplotlib():
    drawing = {"figure_style", "drawing", "animation", "live_panels"}
    for path in PACKAGE.glob("*.py"):
        if path.stem not in drawing and not path.stem.endswith("plots"):
            assert not any("matplotlib" in (m or "") for m in imports(path.stem)), path.stem


def test_import_is_silent_and_changes_nothing():
    code = (
        "import jax; before = dict(jax.config.values); import jaxpound, sys; "
        "assert jax.config.values == before; assert 'matplotlib' not in sys.modules"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_only_what_is_used_is_imported():
    """JAX and SciPy take the better part of a second each: neither is paid for by a mere import."""
    code = (
        "import sys, jaxpound\n"
        "assert jaxpound.__version__ and 'simulate' in dir(jaxpound)\n"
        "assert not {'jax', 'numpy', 'scipy'} & {*sys.modules}\n"
        "assert jaxpound.simulate and jaxpound.paper.structures()\n"
        "assert not {'scipy.stats', 'scipy.optimize', 'optax'} & {*sys.modules}\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_public_names_are_there_however_they_are_asked_for():
    assert len(jp.__all__) == len(set(jp.__all__)) > 60
    code = (
        "from jaxpound import *\n"
        "from jaxpound import monte_carlo as study, paper as case\n"
        "import jaxpound as jp, pickle, types\n"
        "assert all(globals()[name] is getattr(jp, name) for name in jp.__all__)\n"
        "assert {*jp.__all__} <= {*dir(jp)}\n"
        "assert study is monte_carlo and case is paper\n"
        "again = pickle.loads(pickle.dumps((simulate, Limit(0.3), paper.structures())))\n"
        "assert again[0] is simulate and str(again[2]) == str(paper.structures())\n"
        "assert isinstance(jp.records, types.ModuleType) and not hasattr(jp, 'plots')\n"
        "from jaxpound import plots\n"
        "assert jp.plots is plots and 'plots' in dir(jp)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_no_module_has_the_name_of_what_another_holds():
    """Its import would put it in the place of the function."""
    modules = {path.stem for path in PACKAGE.glob("*.py")}
    assert modules & set(jp.__all__) == {"paper"}  # a module itself


def test_a_name_that_does_not_exist():
    with pytest.raises(AttributeError, match="module 'jaxpound' has no attribute 'simulat'") as e:
        jp.simulat  # noqa: B018
    assert (e.value.name, e.value.obj) == ("simulat", jp)  # whence Python's "Did you mean"


def test_public_names_are_documented():
    for name in jp.__all__:
        thing = getattr(jp, name)
        if callable(thing) or name == "paper":
            assert thing.__doc__, name


MODULES_WITH_EXAMPLES = [
    "jaxpound" if path.stem == "__init__" else f"jaxpound.{path.stem}"
    for path in sorted(PACKAGE.glob("*.py"))
    if ">>>" in path.read_text(encoding="utf-8")
]


@pytest.mark.parametrize("module", MODULES_WITH_EXAMPLES)
def test_examples_in_docstrings(module):
    known = {"jp": jp, "np": np, "replace": dataclasses.replace}  # as docs/api/index.md says
    assert doctest.testmod(importlib.import_module(module), extraglobs=known).failed == 0


def readme_blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", (ROOT / "README.md").read_text(), re.S)


@pytest.mark.parametrize("number", range(len(readme_blocks("python"))))
def test_readme_s_python_examples_run(number):
    """The first as users compile it, the others as soon as the suite's own programs are."""
    own = {k: v for k, v in os.environ.items() if number or not k.startswith(("XLA_", "JAX_"))}
    block = readme_blocks("python")[number]
    done = subprocess.run([sys.executable, "-c", block], capture_output=True, text=True, env=own)
    assert done.returncode == 0, done.stderr


def test_readme_and_ci_agree_on_the_test_command():
    command = 'pip install -e ".[test]" && pytest'
    assert any(command in block for block in readme_blocks("sh"))


def test_versions_agree():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert "version" in project["project"]["dynamic"]
    assert f"version: {jp.__version__}" in (ROOT / "CITATION.cff").read_text()
    assert f"## {jp.__version__}" in (ROOT / "CHANGELOG.md").read_text()
