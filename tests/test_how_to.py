"""Guides run as they stand, and print what they say that they print."""

import re

import pytest

import jaxpound as jp
from tests.test_docs import DOCS, code

FOLDER = DOCS / "how_to"
PAGES = sorted({*FOLDER.glob("*.md"), DOCS / "isolation.md"} - {FOLDER / "index.md"})


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_guide_runs_and_prints_what_it_says(page, capsys, tmp_path, monkeypatch):
    source = code(page.read_text(encoding="utf-8"))
    said = re.findall(r"^print\(.*\)  # (.+)$", source, re.M)
    assert said
    assert source.count("print(") == len(said)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.setattr(jp.runtime, "use_cores", lambda: None)  # JAX runs already
    exec(compile(source, page.name, "exec"), {"__name__": page.stem})
    assert capsys.readouterr().out.splitlines() == said
