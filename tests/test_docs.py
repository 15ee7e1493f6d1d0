"""The documentation's own rules, without building it: nothing public and no page is left out."""

import re
from pathlib import Path

import pytest

import jaxpound as jp
from jaxpound import cli

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
MADE = ("_build", "generated", "jupyter_execute", "notebooks")  # by a build
PAGES = sorted(
    page for page in DOCS.rglob("*.md") if not set(MADE) & set(page.relative_to(DOCS).parts[:-1])
)


def entries(directive, page):
    """The lines in the bodies of a page's directives of one kind, their options left out."""
    body, inside = [], False
    for line in page.read_text(encoding="utf-8").splitlines():
        if re.match(rf"(```\{{{directive}\}}|\.\. {directive}::)", line):
            inside = True
        elif inside and (line.startswith(("```", "..", "#")) or (line and line[0] == "`")):
            inside = False
        elif inside and line.strip() and not line.strip().startswith(":"):
            body.append(line.strip())
    return body


def reference():
    listed = [name for page in PAGES for name in entries("autosummary", page)]
    assert len(listed) == len(set(listed)), "each name once"
    return listed


def test_every_public_name_is_in_the_reference():
    # A constant is listed by the module that documents it.
    assert set(jp.__all__) <= {name.rpartition(".")[2] for name in reference()}


def test_every_module_of_figures_is_in_the_reference():
    modules = {path.stem for path in (ROOT / "jaxpound").glob("*plots.py")}
    modules |= {"drawing", "animation", "explorer"}
    assert {f"jaxpound.{module}" for module in modules} <= set(reference())


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(DOCS).as_posix())
def test_every_page_is_in_a_table_of_contents(page):
    found = {
        (other.parent / entry).with_suffix(".md")
        for other in PAGES
        for entry in entries("toctree", other)
    }
    assert page in found or page == DOCS / "index.md"


def test_no_page_installs_from_an_index():
    """The package is installed from its clone, as the README says."""
    texts = [ROOT / "README.md", *PAGES, *(ROOT / "notebooks").glob("*.ipynb")]
    commands = [
        command
        for path in texts
        for command in re.findall(r"pip install ([^`\n]+)", path.read_text(encoding="utf-8"))
    ]
    assert len(commands) > 4
    assert not [command for command in commands if "jaxpound" in command.partition("&&")[0]]


def test_every_command_has_its_section(capsys):
    with pytest.raises(SystemExit):
        cli.main(["--help"])
    listed = capsys.readouterr().out.partition("COMMAND\n")[2]
    commands = re.findall(r"^    (\w+)", listed, re.M)
    page = (DOCS / "command_line.md").read_text(encoding="utf-8")
    assert commands
    assert re.findall(r"^```\{command-help\} (\w+)$", page, re.M) == commands


def test_the_site_s_measured_tables_are_the_readme_s():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    numerics = (DOCS / "numerics.md").read_text(encoding="utf-8")
    rows = [line for line in numerics.splitlines() if re.match(r"\| [.`]\w*\(?", line)]
    assert rows
    for row in rows:
        numbers = re.findall(r"[−\d.]+e-\d", row)
        assert any(numbers == re.findall(r"[−\d.]+e-\d", line) for line in readme.splitlines()), row
