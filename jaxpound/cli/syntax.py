"""What is wrong with a line that is not TOML, or that costs too much to read."""

from __future__ import annotations

import re

_NUMBERS = {
    r"=\s*-?\d+,\d": "a decimal point, not a comma: 0.1",
    r"[=\[,]\s*-?\.\d": "a number begins with a digit: 0.1, not .1",
    r"[=\[,]\s*-?\d+\.(?!\d)": "a digit follows the point: 1.0, not 1.",
}
"""How numbers are written in TOML, by what is often written instead."""


_MOST_PARTS = 20
# Texts go on to their end, or to that of the line or file where they have none: nothing is read
# twice. A text of several lines may end in up to two quotes of its own.
_PART = r"""(?:[\w-]++|"(?:[^"\\\n]++|\\[^\n]?+)*+"?+|'[^'\n]*+'?+)"""
_LINES = r"""(?:"{3}(?:[^"\\]++|\\.?+|"{1,2}(?!"))*+"{0,5}|'{3}(?:[^']++|'{1,2}(?!'))*+'{0,5})"""
# A key of too many parts, or what is passed over as a whole: texts, comments and words.
_LONG_KEY = re.compile(
    rf"""(?P<key>(?:{_PART}[ \t]*+\.[ \t]*+){{{_MOST_PARTS}}}[\w"'-])|{_LINES}|{_PART}|\#[^\n]*+""",
    re.DOTALL,
)


def long_key(text: str) -> str:
    """Message for a key of too many parts, with its line; empty if there is none.

    Reading it would take memory as the square of their number.
    """
    for match in _LONG_KEY.finditer(text):
        if match["key"]:
            line = text.count("\n", 0, match.start()) + 1
            return f":{line}: a key must have at most {_MOST_PARTS} parts, between dots"
    return ""


def syntax_error(text: str, message: str) -> str:
    """Message for a line that is not TOML: its number, its table, its key, and the reason."""
    found = re.search(r"at line (\d+)", message)
    lines = text.splitlines()[: int(found[1]) if found else None]
    written = [says for form, says in _NUMBERS.items() if lines and re.search(form, lines[-1])]
    message = "; ".join([message, *written[:1]])
    place, key = f":{found[1]}" if found else "", ""
    if "Unterminated" in message or (lines and lines[-1].lstrip().startswith("[")):
        return f"{place}: {message}"  # where it begins is not known; or the line of a table
    for line in reversed(lines):
        if table := re.match(r"\s*(\[[^][]+\])", line):
            return f"{place}: {table[1]}{key}: {message}"
        if not key and (entry := re.match(r"\s*([\w.\"'-]+)\s*=", line)):
            key = f" {entry[1]}"
    return f"{place}:{key}: {message}" if key else f"{place}: {message}"
