"""Below each public name of the API, the pages and notebooks whose code uses it."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import nbformat

HERE = Path(__file__).parent
MOST = 6
"""Pages that are named, those that use the name most."""
SCRIPTS = {"regional_risk": "catalogue.py", "how_to/cluster": "many_processes.py"}
"""Programs that pages include."""


def _programs() -> Iterator[tuple[str, str]]:
    """Each page with code, and its code."""
    for path in sorted(HERE.rglob("*.md")):
        page = path.relative_to(HERE).with_suffix("").as_posix()
        blocks = re.findall(r"^```python\n(.*?)^```", path.read_text(encoding="utf-8"), re.M | re.S)
        if blocks and not page.startswith(("_build", "changelog", "notebooks/")):
            yield page, "\n".join(blocks)
    for page, script in SCRIPTS.items():
        yield page, (HERE.parent / "examples" / script).read_text(encoding="utf-8")
    for path in sorted((HERE.parent / "notebooks").glob("*.ipynb")):
        cells = nbformat.read(path, as_version=4).cells
        code = "\n".join(cell.source for cell in cells if cell.cell_type == "code")
        yield f"notebooks/{path.stem}", code


@cache
def uses() -> dict[str, Counter[str]]:
    """How often each page uses each name below ``jp``, such as ``results.Energy``."""
    pages: dict[str, Counter[str]] = {}
    for page, code in _programs():
        for match in re.finditer(r"\b(?:jp\.)?(plots\.[\w.]+\w)|\bjp\.([\w.]+\w)", code):
            parts = (match[1] or match[2]).split(".")  # TimeGrid.until is a use of TimeGrid, too
            for end in range(1, len(parts) + 1):
                pages.setdefault(".".join(parts[:end]), Counter())[page] += 1
    return pages


def users(name: str) -> list[str]:
    """The pages that use a public name most, such as ``jaxpound.results.Energy``."""
    *wings, last = name.removeprefix("jaxpound.").split(".")
    spellings = {
        ".".join([*wings, last]),
        ".".join([*wings[:1], last]) if "plots" in wings else last,
    }
    counts = sum((uses().get(spelling, Counter()) for spelling in spellings), Counter())
    return [page for page, _ in counts.most_common(MOST)]


def list_users(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """The end of the description of a class or function."""
    pages = users(name) if what in ("class", "function") else []
    if pages:
        links = ", ".join(f":doc:`/{page}`" for page in pages)
        lines += ["", ".. rubric:: Examples that use this", "", links, ""]


def setup(app: Any) -> dict[str, bool]:
    """Connect the above."""
    app.connect("autodoc-process-docstring", list_users, priority=700)
    return {"parallel_read_safe": True}
