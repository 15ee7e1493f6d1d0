"""Damage to the rows of a file of numbers, of the kinds that copying and editing do."""

import re
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from tests.ground.networks import Network

_NUMBER = re.compile(r"[-+]?[0-9]*\.?[0-9]+(?:[Ee][-+][0-9]+|[-+][0-9](?=\D|$))?")


class Mutation(NamedTuple):
    """A damaged file: the kind of damage, what stood there before, and the text."""

    kind: str
    before: str
    after: str
    text: str


def data_lines(network: Network, printed: list[list[str]]) -> list[int]:
    """The indices of the lines that hold the samples: with other samples they are other lines."""
    other = [numbers[1:] + numbers[:1] for numbers in printed]
    pairs = zip(network.text(printed).split("\n"), network.text(other).split("\n"), strict=True)
    return [k for k, (a, b) in enumerate(pairs) if a != b and not a.startswith("Max. Acc.")]


def mutations(
    network: Network, printed: list[list[str]], seed: int, times: int
) -> Iterator[Mutation]:
    """Files with one damage each, ``times`` of every kind."""
    rng = np.random.default_rng(seed)
    text = network.text(printed)
    rows = text.split("\n")
    lines = data_lines(network, printed)
    begin = sum(len(row) + 1 for row in rows[: lines[0]])

    def changed(kind: str, k: int, *new: str) -> Mutation:
        return Mutation(kind, rows[k], "\n".join(new), "\n".join([*rows[:k], *new, *rows[k + 1 :]]))

    for _ in range(times):
        k = int(rng.choice(lines))
        row, numbers = rows[k], list(_NUMBER.finditer(rows[k]))
        number = numbers[int(rng.integers(len(numbers)))]
        start, end = number.span()
        n_cut = int(rng.integers(1, max(2, end - start)))
        at = int(rng.integers(start, end))
        yield changed("a number cut", k, row[: end - n_cut] + row[end:])
        yield changed("a character lost", k, row[:at] + row[at + 1 :])
        yield changed("a character blanked", k, row[:at] + " " + row[at + 1 :])
        yield changed("a letter", k, row[:at] + str(rng.choice([*"OlxnE"])) + row[at + 1 :])
        yield changed("a line lost", k)
        yield changed("a line doubled", k, row, row)
        yield changed("a line cut", k, row[:at])
        gaps = list(re.finditer(r"(?<=[0-9])[ ,;\t]+(?=[-+.0-9])", row))
        if gaps:
            gap = gaps[int(rng.integers(len(gaps)))]
            yield changed("a separator lost", k, row[: gap.start()] + row[gap.end() :])
        cut = int(rng.integers(begin, len(text)))
        yield Mutation("cut", "", text[max(0, cut - 60) : cut], text[:cut])
    half = begin + (len(text) - begin) // 2
    yield Mutation("cut in half", "", text[half - 60 : half], text[:half])
