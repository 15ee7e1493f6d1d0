"""The pages on other libraries: each runs as it stands, and asserts what it must give."""

from pathlib import Path

import pytest

from tests.test_docs import code

FOLDER = Path(__file__).parents[1] / "docs" / "beside"
PAGES = sorted(page for page in FOLDER.glob("*.md") if page.stem != "index")


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning")
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_page_runs(page):
    library = "SALib" if page.stem == "salib" else page.stem
    pytest.importorskip(library)
    text = code(page.read_text(encoding="utf-8"))
    assert library in text
    assert "assert" in text
    exec(text, {"__name__": page.stem})
