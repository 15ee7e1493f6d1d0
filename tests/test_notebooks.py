"""What a reader of the notebooks may rely on; nbmake runs them, small, beside these tests."""

import ast
import re
from pathlib import Path

import nbformat
import pytest

ROOT = Path(__file__).parents[1]
PATHS = sorted((ROOT / "notebooks").glob("*.ipynb"))
LARGEST = 3_000_000  # bytes; the player of the animation holds every frame


def test_they_are_numbered_from_one_on():
    assert len(PATHS) >= 7
    assert [path.name[:2] for path in PATHS] == [f"{i:02}" for i in range(1, len(PATHS) + 1)]


@pytest.fixture(params=PATHS, ids=lambda path: path.stem)
def path(request):
    return request.param


@pytest.fixture
def notebook(path):
    return nbformat.read(path, as_version=4)


def test_purpose_run_time_and_small_sizes_come_first(notebook):
    first = notebook.cells[0]
    assert first.cell_type == "markdown"
    assert first.source.startswith("# ")
    assert "**Purpose:**" in first.source
    assert re.search(r"Runs in about \d+ s on two cores", first.source)
    code = next(cell for cell in notebook.cells if cell.cell_type == "code")
    sizes = {target.id for line in ast.parse(code.source).body for target in line.targets}
    assert set(code.metadata["nbmake"]["mock"]) <= sizes
    assert all(name.isupper() for name in sizes)


def test_outputs_are_those_of_a_run_from_top_to_bottom(path, notebook):
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    outputs = [output for cell in cells for output in cell.outputs]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    for output in outputs:
        assert output.output_type != "error"
        assert output.get("name") != "stderr", output.text
        # Exported pages cannot run sliders, and leave their place blank instead of the picture.
        assert not [kind for kind in output.get("data", {}) if "widget" in kind]
    assert "widgets" not in notebook.metadata
    assert path.stat().st_size < LARGEST


def test_nothing_tells_of_a_machine_and_links_lead_somewhere(path, notebook):
    text = path.read_text()
    for words in (r"/home/", r"/tmp/", r"/root/", r"/work/", r"site-packages", r"C:\\\\"):
        assert not re.search(words, text), words
    links = re.findall(r"\]\(([^)#:]+)\)", "".join(c.source for c in notebook.cells))
    for link in links:
        assert (path.parent / link).exists(), link
    if path != PATHS[-1]:
        assert PATHS[PATHS.index(path) + 1].name in links
    assert f"(notebooks/{path.name})" in (ROOT / "README.md").read_text()
