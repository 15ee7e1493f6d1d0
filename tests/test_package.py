"""The house's own rules: silence on import, one direction of imports, the public names."""

import ast
import collections
import contextlib
import dataclasses
import doctest
import graphlib
import importlib
import io
import keyword
import os
import re
import shlex
import subprocess
import sys
import tokenize
import tomllib
from pathlib import Path

import numpy as np
import pytest

import jaxpound as jp
from jaxpound._extras import EXTRAS
from jaxpound.cli import main as cli

ROOT = Path(__file__).parents[1]
PACKAGE = Path(jp.__file__).parent  # the clone's or, where a release is checked, the wheel's

# From the ground up; a module imports only from its own wing and from below. What is no folder is
# named by its modules.
WINGS = [
    {"_"},  # the helpers at the root: _checks, _fields and so on
    *({"quantities", "grid", "store"}, {"model"}, {"results"}, {"ground"}),
    *({"units", "paper", "scenarios"}, {"buildings"}, {"simulation"}, {"study"}),
    *({"reliability"}, {"hazard"}, {"design"}, {"plots"}, {"runtime"}),
    {""},  # the package itself: the public names, from wherever they are
    *({"cli"}, {"__main__"}),
]

UPWARDS = {("jaxpound.results.response", "jaxpound.plots")}
"""The one import that runs upwards, when it is called: a response draws itself."""


def module_name(path):
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_name(path): path for path in sorted(PACKAGE.rglob("*.py"))}
TREES = {module: ast.parse(path.read_text("utf-8")) for module, path in MODULES.items()}


def wing(module):
    """The wing of a module of ours; of the package itself nothing."""
    name = ".".join(module.split(".")[1:2])
    return "_" if name.startswith("_") and name != "__main__" else name


def imports(module):
    """What a module imports, as modules: ``from jaxpound import x`` is one of x too."""
    nodes = [*ast.walk(TREES[module])]
    tests = [x for x in nodes if isinstance(x, ast.If) and ast.unparse(x.test) == "TYPE_CHECKING"]
    for_types_only = {node for test in tests for node in ast.walk(test)}
    for node in nodes:
        if isinstance(node, ast.ImportFrom) and node not in for_types_only:
            assert node.level == 0, f"{module}: imports are absolute"
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                if (module, node.module) not in UPWARDS:
                    yield whole if whole in MODULES else node.module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def test_no_import_runs_upwards_or_in_a_circle():
    """Within a wing, too."""
    assert {wing(module) for module in MODULES} == set().union(*WINGS)
    graph, below = {}, set()
    for names in WINGS:
        for module in (m for m in MODULES if wing(m) in names):
            of_ours = {m for m in imports(module) if m.partition(".")[0] == "jaxpound"}
            assert {wing(m) for m in of_ours} <= below | {wing(module)}, module
            graph[module] = (of_ours & MODULES.keys()) - {"jaxpound", module}
        below |= names
    del graph["jaxpound"]
    assert list(graphlib.TopologicalSorter(graph).static_order())


PHYSICS = {"rod", "rods", "link", "links", "mass", "masses", "contact", "friction", "Dashpot"}
COMPILER = {"optimization_barrier", "jax.checkpoint", "checkpoint_name", "checkpoint_policies"}
COMPILER |= {"custom_vmap", "shard_map", "default_backend"}


def test_the_compiler_and_the_physics_live_apart():
    """No file of ``_xla`` names a part of a model; no other one decides how XLA compiles it."""
    for module, tree in TREES.items():
        names = {getattr(node, "id", getattr(node, "attr", None)) for node in ast.walk(tree)}
        names |= {ast.unparse(node) for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
        is_xla = module.startswith("jaxpound._xla")
        assert not names & (PHYSICS if is_xla else COMPILER), module
        if is_xla:
            ours = [m for m in imports(module) if m.startswith("jaxpound.")]
            assert all(m.startswith("jaxpound._") for m in ours), module


def test_figures_alone_import_matplotlib_and_no_import_is_hidden():
    for module in MODULES:
        if wing(module) != "plots":
            assert not any("matplotlib" in m for m in imports(module)), module
    # By ``importlib``, ``__import__`` or ``sys.modules``, where this file could not see it.
    for module, tree in TREES.items():
        nodes = [node for node in ast.walk(tree) if isinstance(node, ast.Attribute | ast.Name)]
        names = {x.attr if isinstance(x, ast.Attribute) else x.id for x in nodes}
        hidden = names & {"import_module", "__import__", "modules"}
        # The root stands above all, the command line's table of commands above every command; the
        # extras are other packages, and errors look up whether a class is a public name.
        above = ("jaxpound", "jaxpound.cli.main")
        assert not hidden or module in (*above, "jaxpound._extras", "jaxpound._errors"), module
    importing = {module for module in MODULES if "jaxpound.cli.main" in imports(module)}
    assert importing <= {"jaxpound.__main__", "jaxpound.cli.main"}
    assert all(not library.startswith("jaxpound") for library in EXTRAS)


IMPORT = """
import sys, jaxpound
assert jaxpound.__version__ and 'simulate' in dir(jaxpound)
assert not {'jax', 'numpy', 'scipy'} & {*sys.modules}
assert jaxpound.simulate and jaxpound.paper.structures()
assert not {'scipy.stats', 'scipy.optimize', 'optax'} & {*sys.modules}
import jaxpound.results.response
assert not {'jaxpound.plots', 'matplotlib'} & sys.modules.keys()
"""
"""JAX and SciPy take the better part of a second each: neither is paid for by a mere import."""

NAMES = """
import jax
before = dict(jax.config.values)
import jaxpound, sys
assert jax.config.values == before and 'matplotlib' not in sys.modules
from jaxpound import *
from jaxpound import monte_carlo as study, paper as case
import jaxpound as jp, pickle, types
assert all(globals()[name] is getattr(jp, name) for name in jp.__all__)
assert {*jp.__all__} <= {*dir(jp)}
assert study is monte_carlo and case is paper
again = pickle.loads(pickle.dumps((simulate, jp.design.Limit(0.3), paper.structures())))
assert again[0] is simulate and str(again[2]) == str(paper.structures())
assert isinstance(jp.ground, types.ModuleType) and jp.contact.Newton is jp.Newton
assert jp.hazard.HazardCurve is jp.HazardCurve and jp.ground.Ricker is jp.Ricker
from jaxpound import plots
assert jp.plots is plots and 'plots' in dir(jp)
"""


def ran(program, **options):
    """What a program printed in a process of its own."""
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, check=False, **options)
    assert done.returncode == 0, done.stderr
    return done


def test_imports_are_silent_change_nothing_and_bring_all_public_names_when_they_are_used():
    assert 60 < len(jp.__all__) == len(set(jp.__all__)) <= 100
    for done in map(ran, (IMPORT, NAMES)):
        assert (done.stdout, done.stderr) == ("", "")


def test_public_names_are_documented_and_hidden_by_no_module():
    """Its import would put it in the place of the function."""
    assert {wing(module) for module in MODULES} & set(jp.__all__) == {"paper"}  # a module itself
    for module, tree in TREES.items():
        held = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
        assert module.rpartition(".")[2] not in held - {"main"}, module
    with pytest.raises(AttributeError, match="module 'jaxpound' has no attribute 'simulat'") as e:
        jp.simulat  # noqa: B018
    assert (e.value.name, e.value.obj) == ("simulat", jp)  # whence Python's "Did you mean"
    for old, new in (("Limit", "design.Limit"), ("growth", "study.perturbation_growth")):
        with pytest.raises(AttributeError, match=f"no attribute '{old}'; it is now jp.{new}$"):
            getattr(jp, old)
    with pytest.raises(AttributeError, match=r"'simulate_row'; it is now jp.simulate\(Buildings\("):
        jp.simulate_row  # noqa: B018
    for name in jp.__all__:
        thing = getattr(jp, name)
        if callable(thing) or name == "paper":
            assert thing.__doc__, name


PRONOUNS = {
    *("found", "one", "ones", "given", "known", "own", "ours", "theirs", "told", "tell", "tells"),
    *("said", "say", "here", "there", "wanted", "asked", "thing", "things", "those", "these"),
    *("this", "that", "what", "which", "whose"),
}
"""Names that say that something is there, and not what it is."""


def test_names_say_what_they_hold_and_classes_have_names_of_their_own():
    """At most 3 of 1,000 identifiers are such names."""
    names = [
        token.string.strip("_")
        for path in MODULES.values()
        for token in tokenize.generate_tokens(io.StringIO(path.read_text()).readline)
        if token.type == tokenize.NAME and not keyword.iskeyword(token.string)
    ]
    counts = collections.Counter(name for name in names if name in PRONOUNS)
    assert counts.total() <= 3e-3 * len(names), counts.most_common()
    nodes = (node for tree in TREES.values() for node in ast.walk(tree))
    classes = collections.Counter(x.name.strip("_") for x in nodes if isinstance(x, ast.ClassDef))
    assert not {name for name, times in classes.items() if times > 1}


MODULES_WITH_EXAMPLES = [module for module, path in MODULES.items() if ">>>" in path.read_text()]


@pytest.mark.parametrize("module", MODULES_WITH_EXAMPLES)
def test_examples_in_docstrings(module):
    known = {"jp": jp, "np": np, "replace": dataclasses.replace}  # as docs/api/index.md says
    assert doctest.testmod(importlib.import_module(module), extraglobs=known).failed == 0


def readme_blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", (ROOT / "README.md").read_text(), re.S)


@pytest.mark.parametrize("number", range(len(readme_blocks("python"))))
def test_readme_s_python_examples_run(number, monkeypatch):
    """With fewer earthquakes, where there are ten thousand."""
    monkeypatch.setattr(jp.runtime, "use_cores", lambda: None)  # JAX runs already
    exec(readme_blocks("python")[number].replace("10_000", "500"), {"__name__": "readme"})


def test_readme_s_commands_run_as_they_stand(tmp_path, monkeypatch, capsys):
    """In a folder without any file; those that install it are run by CI."""
    monkeypatch.chdir(tmp_path)
    blocks = [block for block in readme_blocks("sh") if "pip install" not in block]
    commands = [line for block in blocks for line in block.splitlines()]
    assert len(commands) > 2
    for command in commands:
        command, _, file = command.partition(" > ")
        program, *arguments = shlex.split(command)
        assert program == "jaxpound"
        with contextlib.suppress(SystemExit):  # of an example that is printed
            assert cli.main(arguments) == 0
        shown = capsys.readouterr()
        if file:
            Path(file).write_text(shown.out, encoding="utf-8")
    assert "min gap " in shown.out
    assert (tmp_path / "results" / "summary.json").exists()


START = """
import jax, jaxpound as jp
from dataclasses import replace
jax.config.update("jax_enable_x64", True)
"""

PAIR = """
pair = replace(jp.paper.structures(), initial_gap=0.3, contact=jp.Newton(0.65))
print(jp.demand(pair, jp.paper.ground(), jp.TimeGrid(0.05, 200), only=["peak_x1"]).peak_x1)
"""

LINKS = """
def system(*links):
    n = 1 + max(end for link in links for end in link.ends)
    law = jp.ZenerRod(0.5, 0.05, 0.2)
    rods = (jp.Rod(law, 1.0 + i, (i, jp.GROUND)) for i in range(n))
    return jp.System((1.0,) * n, tuple(rods), links)

fast = {"friction": 0.1, "velocity_friction": jp.VelocityFriction(0.1, 0.1)}
law, harder = jp.KelvinVoigt(4e3, 0.65), jp.Jankowski(4e3, 0.65)
brace = jp.Rod(jp.PowerLaw(0.1, 0.5, 0.1), 5.0)
walls = system(jp.Link((0, jp.GROUND), gap=(0.3, 0.3), contact=law, **fast))
kinds = system(
    jp.Link((0, 1), friction=0.1, gap=0.2, contact=law),
    jp.Link((1, 2), gap=0.2, contact=jp.Newton(0.65)),
    jp.Link((2, jp.GROUND), gap=(0.2, 0.3), contact=harder, inerter=jp.Inerter(0.1)),
    jp.Link((3, 4), friction=0.1, damper=brace),
)
for structures in (walls, kinds):
    grid = jp.TimeGrid(0.05, 60)
    demand = jp.demand(structures, jp.Ricker(0.5, 2.0, 1.5), grid, only=["peak_x1"])
    print(demand.peak_x1)
"""


PROGRAMS = {"pair": PAIR, "every kind of link": LINKS}


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_program_gives_the_suite_s_numbers_as_users_compile_it(name, capsys):
    """Without the suite's options of XLA; a slow machine notes on stderr that it compiles."""
    environment = {k: x for k, x in os.environ.items() if not k.startswith(("XLA_", "JAX_"))}
    shown = ran(START + PROGRAMS[name], env=environment).stdout
    exec(PROGRAMS[name], {"jp": jp, "replace": dataclasses.replace})
    here = [float(line) for line in capsys.readouterr().out.split()]
    np.testing.assert_allclose([float(line) for line in shown.split()], here, rtol=1e-9)


def test_versions_agree():
    command = 'pip install -e ".[test]" && pytest'
    assert any(command in block for block in readme_blocks("sh"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert "version" in project["dynamic"]
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.findall(r"^version: (.*)$", citation, re.M) == [jp.__version__]
    (released,) = re.findall(r"^date-released: (.*)$", citation, re.M)
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.findall(r"^## (.*)$\n\n(.*)\.$", changes, re.M)[0] == (jp.__version__, released)
    assert (PACKAGE / "py.typed").exists()
    named = re.findall(r"Python :: (3\.\d+)", " ".join(project["classifiers"]))
    assert f">={named[0]}" == project["requires-python"]
