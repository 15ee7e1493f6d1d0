"""Guides and lessons run as they stand, and print what they say that they print."""

import re
from contextlib import redirect_stdout
from io import StringIO

import numpy as np
import pytest

import jaxpound as jp
from tests.test_docs import DOCS, code

FOLDER = DOCS / "how_to"
COURSE = DOCS / "course"
PAGES = sorted(
    {*FOLDER.glob("*.md"), *COURSE.glob("*.md"), DOCS / "isolation.md", DOCS / "llms.md"}
    - {FOLDER / "index.md", COURSE / "index.md"}
)


def printed(page):
    """The names of a page's code after a run, the lines it printed, and those it says."""
    source, out, names = code(page.read_text(encoding="utf-8")), StringIO(), {"__name__": page.stem}
    said = re.findall(r"^print\(.*\)  # (.+)$", source, re.M)
    assert said
    assert source.count("print(") == len(said)
    with redirect_stdout(out):
        exec(compile(source, page.name, "exec"), names)
    return names, out.getvalue().splitlines(), said


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_guide_runs_and_prints_what_it_says(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.setattr(jp.runtime, "use_cores", lambda: None)  # JAX runs already
    _, lines, said = printed(page)
    assert lines == said


@pytest.mark.filterwarnings("ignore::jaxpound.PlausibilityWarning")
@pytest.mark.parametrize("page", ["index", "model", "yielding", "chaos", "rare_events"])
def test_the_programs_of_a_page_run(page, tmp_path, monkeypatch):
    """Their comments describe results, and are not compared."""
    monkeypatch.chdir(tmp_path)
    law = jp.BoucWen(yield_displacement=0.02, hardening=0.05)
    cycles = jp.study.cyclic_test(law, [0.0, 0.06, -0.06, 0.06], stiffness=2e6, steps=8)
    measured = np.stack([cycles.displacement, cycles.force], axis=1)
    np.savetxt("column.csv", measured, delimiter=",")
    source = code((DOCS / f"{page}.md").read_text(encoding="utf-8"))
    names = {"jp": jp, "np": np}
    with redirect_stdout(StringIO()):
        exec(compile(source, page, "exec"), names)
    if page == "model":
        assert (float(names["force"]), float(names["slope"])) == pytest.approx(
            (18.29, -50.5), rel=1e-3
        )
    if page == "chaos":  # the numbers of its text
        assert float(names["grown"].end) == pytest.approx(3600, rel=0.05)
        assert float(names["grown"].horizon(1e-3)) == pytest.approx(16.0, abs=0.5)
    if page == "rare_events":
        assert 0 < names["event"].probability < 1e-2
