"""Sphinx: the pages as written, the API from the docstrings, the notebooks with their outputs."""

from __future__ import annotations

import contextlib
import io
import os
import re
import shutil
import sys
from pathlib import Path
from typing import Any
from unittest.mock import patch

from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.ext import autosummary

HERE = Path(__file__).parent
ROOT = HERE.parent
sys.path[:0] = [str(ROOT), str(HERE)]

import jaxpound  # noqa: E402
from jaxpound.cli import main as cli  # noqa: E402
from jaxpound.cli.files import example  # noqa: E402

project = "jaxpound"
author = "The jaxpound developers"
copyright = "The jaxpound developers"
version = release = jaxpound.__version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx.ext.mathjax",
    "myst_nb",
    "from_notebooks",
    "table_of_inputs",
    "tables_of_columns",
    "uses",
]
exclude_patterns = ["_build", "_templates", "jupyter_execute"]
templates_path = ["_templates"]

html_theme = "furo"
html_title = f"jaxpound {version}"
html_static_path = ["_static"]
html_css_files = ["pages.css"]
smartquotes_action = "D"  # dashes only: x1'' is a second derivative

# Committed outputs are shown as they are: a notebook may take minutes and need a network.
nb_execution_mode = "off"
myst_enable_extensions = ["amsmath", "dollarmath", "html_image"]
myst_heading_anchors = 3

napoleon_google_docstring = False
napoleon_use_rtype = False
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_typehints_format = "short"
autodoc_type_aliases = {name: name for name in ("ArrayLike", "GroundLike")}
maximum_signature_line_length = 80

# Or a summary would end at the full stop of "eq. (9)".
autosummary.WELL_KNOWN_ABBREVIATIONS += ("eq.", "eqs.")

# Fields that no Parameters section describes are listed with the class's members.
autosummary_context = {
    "without_parameters": [
        name
        for space in (jaxpound, *(getattr(jaxpound, wing) for wing in jaxpound._WINGS))
        for name in space.__all__
        if isinstance(thing := getattr(space, name), type)
        and "Parameters\n" not in (thing.__doc__ or "")
    ]
}

nitpick_ignore_regex = [
    # Types of other projects: links to them would need the network.
    (
        "py:.*",
        r"(collections|concurrent|jax|jaxlib|jaxtyping|matplotlib|numpy|optax|os|pandas|pathlib"
        r"|typing|xarray)\..*",
    ),
    ("py:class", r"ArrayLike|Axes|GradientTransformation|PathLike|(np\.)?ndarray"),
    ("py:class", r"'[\w ]+'"),  # shapes of arrays
    # What only the package's own code meets, and unions with names of their own.
    (
        "py:class",
        r"jaxpound\._.*|jaxpound\.simulation\.(joints\.friction|time\.history)\..*"
        r"|GroundLike|DemandSpec|Structures|jaxpound\.units\.Timed|jaxpound\..*\._\w+",
    ),
    ("py:class", r"jaxpound\.design\.design\.History"),
]


class CommandHelp(Directive):
    """The ``--help`` of ``jaxpound`` or of one of its commands, from its parser."""

    optional_arguments = 1

    def run(self) -> list[nodes.Node]:
        """A block of text."""
        shown = io.StringIO()
        wide = patch.dict(os.environ, {"COLUMNS": "88", "NO_COLOR": "1"})
        with wide, contextlib.redirect_stdout(shown), contextlib.suppress(SystemExit):
            cli.main([*self.arguments, "--help"])
        return [nodes.literal_block(shown.getvalue(), shown.getvalue(), language="text")]


class ExampleConfig(Directive):
    """The ``--example-config`` of a command, of its form "row" too."""

    required_arguments, optional_arguments = 1, 1

    def run(self) -> list[nodes.Node]:
        """A block of text."""
        text = example(*self.arguments)
        return [nodes.literal_block(text, text, language="toml")]


_as_written: dict[str, list[str]] = {}


def keep_as_written(
    app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]
) -> None:
    """Before napoleon, which takes what stands before a colon for an attribute's type."""
    if what in ("attribute", "data", "property") and not any(x.startswith("---") for x in lines):
        _as_written[name] = list(lines)


def finish(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """After napoleon: in docstrings |x| is a magnitude, not a substitution."""
    lines[:] = _as_written.pop(name, lines)
    if len(lines) <= 2 and lines and lines[0].startswith("Alias for field number"):
        lines.clear()
    for i, line in enumerate(lines):
        if "|" in line and not line.lstrip().startswith(">>>"):
            parts = re.split(r"(``.*?``|:math:`.*?`)", line)
            parts[::2] = [part.replace("|", r"\|") for part in parts[::2]]
            lines[i] = "".join(parts)


def result_signature(
    app: Any, what: str, name: str, obj: Any, options: Any, signature: str | None, returned: Any
) -> tuple[str, None] | None:
    """Protocols, and results that functions put together, have no arguments to be told."""
    if what != "class" or "Parameters\n" in (obj.__doc__ or ""):
        return None
    fields = [*getattr(obj, "__dataclass_fields__", getattr(obj, "_fields", ()))]
    found = len(fields) > 3 or any(name.startswith("_") for name in fields)
    found |= getattr(obj, "_is_protocol", False)
    return ("", None) if found else None


def plain_types(app: Any, domain: str, objtype: str, content: Any) -> None:
    """Leave out what says nothing, and what ``Returns`` says better."""
    for types in app.env.current_document.autodoc_annotations.values():
        types.pop("return", None)
        for name, text in list(types.items()):
            types[name] = re.sub(r"TypeAliasForwardRef\('(\w+)'\)", r"\1", text)
            if text == "Any" or text.endswith(".Any"):
                del types[name]


def serve_idioms(app: Any, exception: Exception | None) -> None:
    """The page for coding assistants as ``llms.txt``, where they look for it."""
    if exception is None and app.builder.format == "html":
        shutil.copyfile(HERE / "llms.md", Path(app.outdir) / "llms.txt")


def setup(app: Any) -> None:
    """Connect the above."""
    app.connect("build-finished", serve_idioms)
    app.add_directive("command-help", CommandHelp)
    app.add_directive("example-config", ExampleConfig)
    app.connect("autodoc-process-docstring", keep_as_written, priority=400)
    app.connect("autodoc-process-docstring", finish, priority=600)
    app.connect("autodoc-process-signature", result_signature)
    app.connect("object-description-transform", plain_types, priority=400)
