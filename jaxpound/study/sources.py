"""What to cite for a run: the sources of its model, laws, ground motion and scheme."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from jaxpound._checks import instance
from jaxpound._version import __version__
from jaxpound.ground.motion import require_ground
from jaxpound.ground.suite import RecordSuite
from jaxpound.model.system import Structures
from jaxpound.scenarios.scenarios import Draw
from jaxpound.simulation.scheme import Scheme
from jaxpound.store.store import describe

_BIBLIOGRAPHY = [  # that of the wheel, or of the clone
    Path(__file__).parents[1] / "bibliography.md",
    Path(__file__).parents[2] / "docs" / "bibliography.md",
]


def citation(structures: Any, ground: Any, scheme: Scheme = Scheme()) -> str:
    """What to cite for runs of these structures: jaxpound, the paper and each law's source.

    A line each, which ends with what it is the source of; then the names of records, and the
    numbers of those of PEER (``RSN953_…``). Structures and ground motion may be random, the ground
    a ``RecordSuite``. Raises ``InvalidInput`` for any other object. See also ``Study.citation``.

    Examples
    --------
    >>> lines = jp.study.citation(jp.paper.structures(), jp.paper.ground()).splitlines()
    >>> print(lines[4].partition(". Geo")[0])
    Ricker, N. (1953): The form and laws of propagation of seismic wavelets
    """
    instance("structures", structures, Structures, Draw)
    if not isinstance(ground, RecordSuite | Draw):
        require_ground("ground", ground)
    instance("scheme", scheme, Scheme)
    return citation_of(describe([structures, ground, scheme]), __version__)


def citation_of(described: Any, version: str) -> str:
    """What to cite for runs by a version, of objects that are described as in a store."""
    nodes = [*_objects(described)]
    names = {x for node in nodes for key, x in node.items() if key != "name" and type(x) is str}
    names |= {f"{x.get('type')}({key}=True)" for x in nodes for key in x if x[key] is True}
    if any(x.get("tau_f") is not None for x in nodes):
        names.add("ZenerRod")  # also as a building states it
    else:
        names -= {"ModalHistory", "FullHistory"}  # of which nothing makes use
    bibliography = next(file for file in _BIBLIOGRAPHY if file.exists()).read_text("utf-8")
    paper, *others = re.findall(r"^- (.*(?:\n  .*)*)", bibliography, re.M)
    code = r"[`\"](?:~jaxpound\.(?:\w+\.)*)?([^`\"]+)[`\"]"  # of a use: classes and options
    cited = [x for x in others if names & {*re.findall(code, x.rpartition("– ")[2])}]
    text = "\n".join(" ".join(entry.split()) for entry in (paper, *cited))
    text = re.sub(r"\[([^]]+)\]\([^)]+\)|(?:\{py:\w+\})?`(?:~(?:\w+\.)*)?|[`*]", r"\1", text)
    records = dict.fromkeys(x["name"] for x in nodes if x.get("type") == "Record" and x["name"])
    numbers = [x for name in records for x in re.findall(r"RSN(\d+)", name)]
    lines = [f"The jaxpound developers: jaxpound, version {version}.", text]
    for heading, entries in (("Records:", [*records]), ("Records of PEER: RSN", numbers)):
        lines += [f"{heading} {', '.join(entries)}."] * bool(entries)
    return "\n".join(lines)


def _objects(tree: Any) -> Iterator[dict[str, Any]]:
    """All objects in a description, from the outside in."""
    if isinstance(tree, dict):
        yield tree
    for entry in tree.values() if isinstance(tree, dict) else tree:
        if isinstance(entry, dict | list):
            yield from _objects(entry)
