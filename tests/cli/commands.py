"""What the tests of the command line have in common."""

import contextlib
import io
import itertools
import re
from pathlib import Path

import jax
import numpy as np
import pytest
from matplotlib.figure import Figure

import jaxpound as jp
from jaxpound.cli import main as cli
from jaxpound.cli.buildings import as_toml
from jaxpound.cli.reading import File
from jaxpound.cli.simulate import Simulation, shaking
from tests.cli.described import compare_folder

# A pulse of 0.6 s, then rest: 101 samples at .02 s.
PULSE = np.where(np.arange(101) < 30, 0.4 * np.sin(np.pi * np.arange(101) / 15), 0.0)


def run(*arguments: object) -> str:
    """What a command that must succeed prints; its files must be as docs/files.md says."""
    with contextlib.redirect_stdout(io.StringIO()) as screen:
        assert cli.main([str(argument) for argument in arguments]) == 0
    command, *options = map(str, arguments)
    folder = "--store" if command == "montecarlo" else "--out"
    compare_folder(command, Path(options[options.index(folder) + 1]))
    return screen.getvalue()


@contextlib.contextmanager
def unrendered():
    """Figures are drawn, but laying them out and rendering them would take longer than a run."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", lambda figure, file, **how: file.write(b"a picture"))
        yield


def layout_of(text: str, name: str = "row.toml"):
    """Buildings and their links as a configuration has them."""
    return File(name, text).read(Simulation).layout


def written_back(text: str, buildings, links):
    """The links of a layout that is the library's buildings, read again as it is written."""
    layout = layout_of(text)
    assert repr(layout.shear_buildings) == repr(buildings)
    assert repr(layout.buildings.links) == repr(links)
    again = layout_of(as_toml(layout.buildings)).buildings
    assert again.system().topology == layout.buildings.system().topology
    values = [[float(x) for x in jax.tree.leaves(each)] for each in (again, layout.buildings)]
    np.testing.assert_allclose(*values, rtol=1e-12)
    return again.links


def simulated(text: str, record: Path, folder: Path):
    """A run of a row: the screen, the folder, the layout, and its response by the API."""
    path, out = folder / "row.toml", folder / "out"
    path.write_text(text)
    screen = run("simulate", "--record", record, "--config", path, "--out", out)
    given = File("row.toml", text).read(Simulation)
    ground = shaking(File("row.toml", text), given.ground, jp.read_record(record))
    return screen, out, given.layout, jp.simulate(given.layout.buildings, ground, duration=1.6)


def faults(lines: str) -> list[list[str]]:
    """Changes of an example, and what is refused, on either side of => in each line."""
    found = re.findall(r"(?m)^\S.*(?:\n +.*)*", lines)
    return [re.sub(r"\n +", " ", line).split(" => ") for line in found]


def changed(text: str, changes: str) -> str:
    """A configuration with lines replaced, between &, in any white space; ; parts the new lines.

    ``key = value`` replaces the line of the key, ``a -> b`` the line that begins with a.
    """
    for change in filter(None, re.sub(r"\s*\n\s*", " ", changes).split(" & ")):
        old, _, new = change.replace(" ; ", "\n").rpartition(" -> ")
        new = new.removeprefix("nothing")
        key = re.escape(re.match(r'\[\w+\]|[\w".*-]*', new)[0])
        old = re.escape(old) if old else rf"(?:# )?{key}(?: ?=|(?<=]))"
        text, n = re.subn(rf"(?m)^{old}.*$", lambda _, new=new: new, text, count=1)
        assert n, change
    return text


def command_for(name: str, config: Path, record: Path, out: Path) -> list[object]:
    """A command with its configuration and, where it takes one, a record."""
    of_record = ["--record", record, "--config"] if name == "simulate" else []
    return [name, *of_record, config, "--store" if name == "montecarlo" else "--out", out]


def refusal(capsys, *arguments: object) -> str:
    """The one line on stderr of a command that must fail, and make no folder."""
    words = [str(argument) for argument in arguments]
    options = itertools.pairwise(words)
    folders = [Path(word) for option, word in options if option in ("--out", "--store") and word]
    there = [folder.exists() for folder in folders]
    assert cli.main(words) == 2
    assert [folder.exists() for folder in folders] == there
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("jaxpound: error: ")
    assert captured.err.count("\n") == 1
    return captured.err


def example_pair(friction_force: float, gap: float):
    """The example's buildings by the library."""
    blocks = tuple(jp.Building.from_period(*x, 0.05) for x in ((500e3, 0.9), (400e3, 0.6)))
    return jp.Buildings(blocks, (jp.FloorLink(0, 0, friction=friction_force, gap=gap),))
