"""The directive ``columns``: the columns that a class of results has in tables, from the class.

Its argument is the class, by its full name. Columns are those of two masses, two rods and two
links, so that one sees that they are numbered.
"""

from __future__ import annotations

from pkgutil import resolve_name
from typing import Any

from docutils import nodes
from sphinx.util.docutils import SphinxDirective

from jaxpound.quantities import column
from jaxpound.results.elements import columns_of

ONLY = {
    "": "",
    "column": "only of a link at a column",
    "capacity": "only of a link at a column with a capacity",
    "contact": "only with a contact law",
    "storey": "only of a storey between two floors",
    "supports": "only where supports move apart",
    "yielding": "only of a rod that yields",
}


def rows(name: str) -> list[tuple[str, str, str]]:
    """The columns' names with SI units, what they are, and when they are there."""
    found, two_each = [], dict.fromkeys(("masses", "rods", "links"), 2)
    for known, names in columns_of(resolve_name(name), two_each):
        shown = ", ".join(f"`{column(one, known.kind, si=True)}`" for one in names)
        words = known.words.replace("{}", "1, 2, …")
        found.append((f"{shown}, …" if names[1:] else shown, words, ONLY[known.only]))
    return found


class Columns(SphinxDirective):
    """A table of columns."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """The table."""
        lines = ["| column | what it is | when |", "| --- | --- | --- |"]
        lines += [f"| {' | '.join(row)} |" for row in rows(self.arguments[0])]
        return self.parse_text_to_nodes("\n".join(lines) + "\n")


def setup(app: Any) -> dict[str, bool]:
    """Add the directive to Sphinx."""
    app.add_directive("columns", Columns)
    return {"parallel_read_safe": True}
