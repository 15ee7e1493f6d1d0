"""The notebooks among the pages: copies of them, and directives that show their pictures.

``gallery`` has a line ``NOTEBOOK | code | caption.`` for each picture: the one below the only cell
whose code contains these words (``NOTEBOOK 2`` is the second below it). ``pictures.py`` stands for
the script beside this file; in the place of the code is then the picture, such as ``chaos.png``,
which the function of the same name draws. ``notebook-list`` has a line ``NOTEBOOK | code`` for each
notebook; what it says of a notebook is the notebook's own title and purpose.

``python docs/from_notebooks.py`` takes live sliders out of the notebooks that have just been run:
an exported page, which cannot run them, leaves their place blank, and shows the picture beside them
once they are gone. It also takes out the notes on compilation, which depend on the machine.
"""

from __future__ import annotations

import base64
import os
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import nbformat
from docutils import nodes
from sphinx.util.docutils import SphinxDirective

HERE = Path(__file__).parent
ROOT = HERE.parent
NOTEBOOKS = ROOT / "notebooks"
COPIES = HERE / "notebooks"
PAGES = {  # what a file at the repository's top is among the pages
    ROOT / "README.md": HERE / "index.md",
    ROOT / "CHANGELOG.md": HERE / "changelog.md",
    ROOT / "CONTRIBUTING.md": HERE / "contributing.md",
}
SCRIPT = "pictures.py"
COMPILING = "jaxpound: tracing and compiling a program"
SLIDERS = "application/vnd.jupyter.widget-view+json"
_LINK = re.compile(r"(\]\(\s*<?|\bsrc=\")(?![a-zA-Z][\w+.-]*:|[#/])([^)\s>\"#]+)")


class Picture(NamedTuple):
    """A picture of a notebook."""

    name: str
    """Of the file, without its ending."""
    code: str
    """Of the cell above it."""
    number: int
    """Among the pictures of that cell, from 1."""
    heading: str
    """Of the section that it is in."""
    content: bytes


@cache
def read(path: Path) -> Any:
    """A notebook of the repository."""
    return nbformat.read(path, as_version=4)


@cache
def pictures(stem: str) -> tuple[Picture, ...]:
    """The pictures of a notebook, from top to bottom."""

    def found() -> Iterator[Picture]:
        heading = ""
        for i, cell in enumerate(read(NOTEBOOKS / f"{stem}.ipynb").cells):
            if cell.cell_type == "markdown":
                heading = (re.findall(r"^#+ (.+)$", cell.source, re.M) or [heading])[-1]
                continue
            shown = [x.data["image/png"] for x in cell.outputs if "image/png" in x.get("data", {})]
            for k, content in enumerate(shown, 1):
                name = f"{stem}-{i}-{k}"
                yield Picture(name, cell.source, k, heading, base64.b64decode(content))

    return tuple(found())


def picture(stem: str, code: str, number: int = 1) -> Picture:
    """The picture below the one cell with this code; a ``ValueError`` if there is not one."""
    fitting = [x for x in pictures(stem) if code in x.code and x.number == number]
    if len(fitting) != 1:
        raise ValueError(f"{stem}: {code!r} must be in one cell with a picture, not {len(fitting)}")
    return fitting[0]


def title_and_purpose(stem: str) -> tuple[str, str]:
    """What a notebook is called, and what it is for: its question, or the first sentence."""
    text = read(NOTEBOOKS / f"{stem}.ipynb").cells[0].source
    title, purpose = (re.search(x, text, re.M) for x in (r"^# (.+)$", r"\*\*Purpose:\*\* (.+)"))
    assert title
    assert purpose
    asked, mark, _ = purpose[1].rpartition("?")
    first = asked + mark or re.split(r"(?<=[.]) (?=[A-Z])", purpose[1])[0]
    return title[1], first[0].upper() + first[1:]


def bring(app: Any) -> None:
    """Copy the notebooks among the pages, where their relative links must lead to the same files.

    Copies, as symbolic links are not to be had on every platform; their pictures are beside them.
    """
    wanted = sorted(NOTEBOOKS.glob("*.ipynb"))
    files: dict[Path, bytes] = {}
    for path in wanted:
        files[COPIES / path.name] = _moved(path, wanted).encode()
        for one in pictures(path.stem):
            files[COPIES / "pictures" / f"{one.name}.png"] = one.content
    for old in COPIES.rglob("*.*"):
        if old.suffix in (".ipynb", ".png") and old not in files:
            old.unlink()
    for path, content in files.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_bytes() != content:
            path.write_bytes(content)


def _moved(path: Path, wanted: list[Path]) -> str:
    """A notebook with the links that it must have as a page."""

    def moved(link: re.Match[str]) -> str:
        target = Path(os.path.normpath(NOTEBOOKS / link[2]))
        if target in wanted or not target.exists():
            return link[0]
        return link[1] + Path(os.path.relpath(PAGES.get(target, target), COPIES)).as_posix()

    notebook = nbformat.read(path, as_version=4)
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            cell.source = _LINK.sub(moved, cell.source)
    text: str = nbformat.writes(notebook)
    return text


class _Cards(SphinxDirective):
    """Pictures beside each other, each with its words below it."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """A card for each line."""
        cards = nodes.container(classes=["cards", self.name])
        for line in filter(None, map(str.strip, self.content)):
            try:
                text = self.card(*(part.strip() for part in line.split(" | ")))
            except (TypeError, ValueError, OSError) as error:
                raise self.error(f"{line}: {error}") from error
            cards += nodes.container("", *self.parse_text_to_nodes(text), classes=["card"])
        return [cards]

    def card(self, *parts: str) -> str:
        """A card in Markdown."""
        raise NotImplementedError


class Gallery(_Cards):
    """Pictures, each with a link to the code that made it."""

    def card(self, source: str, code: str, caption: str) -> str:
        """The picture, what it shows, and where its code is."""
        if source == SCRIPT:
            if not (HERE / code).exists():
                raise ValueError("must be a picture that is there")
            image, link = code, f"pictures.md#{Path(code).stem.replace('_', '-')}"
            where = f"[`{SCRIPT}`]({link})"
        else:
            stem, _, number = source.partition(" ")
            one = picture(stem, code, int(number or 1))
            image = f"notebooks/pictures/{one.name}.png"
            link = f"notebooks/{stem}.ipynb#{slug(one.heading)}"
            where = f"`{code}` in [{title_and_purpose(stem)[0]}]({link})"
        alt = re.sub(r"[`*$\\]", "", caption)
        return f"[![{alt}]({image})]({link})\n\n{caption}\n\n{where}\n"


class NotebookList(_Cards):
    """Every notebook with a picture, its title and its purpose."""

    def card(self, stem: str, code: str) -> str:
        """The notebook's picture, title and purpose."""
        one, (title, purpose) = picture(stem, code), title_and_purpose(stem)
        link = f"notebooks/{stem}.ipynb"
        image = f"[![{title}](notebooks/pictures/{one.name}.png)]({link})"
        return f"{image}\n\n**[{stem[:2]} {title}]({link})**\n\n{purpose}\n"


def slug(heading: str) -> str:
    """The anchor of a heading, as MyST makes it."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


def still(notebook: Any) -> Any:
    """The notebook without notes on compilation, and with a picture for each live slider."""
    notebook.metadata.pop("widgets", None)
    for cell in notebook.cells:
        if "outputs" in cell:
            cell.outputs = [x for x in cell.outputs if COMPILING not in x.get("text", "")]
        for output in cell.get("outputs", []):
            if output.get("data", {}).pop(SLIDERS, None) and "image/png" not in output.data:
                raise ValueError(f"{cell.source!r} must have a picture beside its sliders")
    return notebook


def setup(app: Any) -> dict[str, bool]:
    """Add the above to Sphinx."""
    app.connect("builder-inited", bring, priority=1)
    app.add_directive("gallery", Gallery)
    app.add_directive("notebook-list", NotebookList)
    return {"parallel_read_safe": True}


if __name__ == "__main__":
    for path in sorted(NOTEBOOKS.glob("*.ipynb")):
        nbformat.write(still(nbformat.read(path, as_version=4)), path)
