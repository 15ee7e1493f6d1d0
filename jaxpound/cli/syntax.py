"""Messages for a line that is not TOML, or that costs too much to read."""

from __future__ import annotations

import re

_NUMBERS = {  # how TOML has numbers, by what is often written instead
    r"=\s*-?\d+,\d": "a decimal point, not a comma: 0.1",
    r"[=\[,]\s*-?\.\d": "a number begins with a digit: 0.1, not .1",
    r"[=\[,]\s*-?\d+\.(?!\d)": "a digit follows the point: 1.0, not 1.",
}
_MOST_PARTS = 20
# A text goes on to its end, or without one to the end of the line or file: nothing is read twice.
# The content of a text of several lines may end in up to two quotes.
_PART = r"""(?:[\w-]++|"(?:[^"\\\n]++|\\[^\n]?+)*+"?+|'[^'\n]*+'?+)"""
_LINES = r"""(?:"{3}(?:[^"\\]++|\\.?+|"{1,2}(?!"))*+"{0,5}|'{3}(?:[^']++|'{1,2}(?!'))*+'{0,5})"""
# A key of too many parts, or what is passed over as a whole: texts, comments and words.
_LONG_KEY = re.compile(
    rf"""(?P<key>(?:{_PART}[ \t]*+\.[ \t]*+){{{_MOST_PARTS}}}[\w"'-])|{_LINES}|{_PART}|\#[^\n]*+""",
    re.DOTALL,
)


def long_key(text: str) -> str:
    """Message for a key whose parts, too many, would take memory as their number squared."""
    for match in _LONG_KEY.finditer(text):
        if match["key"]:
            line = text.count("\n", 0, match.start()) + 1
            return f":{line}: a key must have at most {_MOST_PARTS} parts, between dots"
    return ""


def syntax_error(text: str, message: str) -> str:
    """Message for a line that is not TOML: its number, its table, its key, and the reason."""
    number = re.search(r"at line (\d+)", message)
    lines = text.splitlines()[: int(number[1]) if number else None]
    hints = [hint for form, hint in _NUMBERS.items() if lines and re.search(form, lines[-1])]
    message = "; ".join([message, *hints[:1]])
    place, key = f":{number[1]}" if number else "", ""
    if "Unterminated" in message or (lines and lines[-1].lstrip().startswith("[")):
        return f"{place}: {message}"  # its start is unknown; or the line of a table
    for line in reversed(lines):
        if table := re.match(r"\s*(\[[^][]+\])", line):
            return f"{place}: {table[1]}{key}: {message}"
        if not key and (entry := re.match(r"\s*([\w.\"'-]+)\s*=", line)):
            key = f" {entry[1]}"
    return f"{place}:{key}: {message}" if key else f"{place}: {message}"
