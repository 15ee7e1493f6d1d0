"""The plan of a run: how its program is laid out, which changes its results by rounding at most.

What a step computes is stated as ``Work`` by those who know it. A choice, a function from ``Work``
to ``Plan``, decides the rest: ``fast`` is that of users, and ``plain`` the loop of a textbook. The
choice holds for the whole process. A function that is compiled has it as a static argument: then no
program of another choice is taken for it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Literal, NamedTuple

import jax

FEW = 8  # elements; of more, batches have no shortcut, and arrays compile sooner
WRITTEN_OUT = 4  # elements of a step that is written out: a loop compiles in a third of the time


class Work(NamedTuple):
    """What a step computes, as far as its plan depends on it."""

    elements: int  # parts that are alike, each with a law and a peak
    laws: Literal["none", "short", "long"] = "none"  # of elements that follow their path
    inner_loop: Literal["never", "sometimes", "always"] = "never"  # whether a step needs one
    series: bool = False  # whether every step's results are kept


@dataclass(frozen=True)
class Plan:
    """How the program of a run is laid out; by default as a loop over its steps, and no more."""

    block: Literal["loop", "written out", "recomputed"] = "loop"
    """Whether the steps of a block are a loop of their own, so that the program of a long step is
    compiled once; or are written out one after the other; or are written out and recomputed in
    reverse mode, which then keeps the state before each block only."""

    segments: bool = False
    """Whether the blocks are in about √n segments, whose small results a CPU stores faster."""

    shortcut: Literal["none", "loop", "written out"] = "none"
    """Whether batches of loops take the shortcut past the inner loops that no run needs; its steps
    are a loop of their own, or written out."""

    recomputed_steps: bool = False
    """Whether reverse mode computes what is within a step anew, and keeps fewer numbers of it."""

    laws_in_arrays: bool = False
    """Whether laws of many elements are in arrays: half the time to compile, but more to run."""

    peaks_in_arrays: bool = False
    """Whether peaks of many elements are in arrays, which compiles in less time."""


Choice = Callable[[Work], Plan]


def fast(work: Work, all_looped: bool = False) -> Plan:
    """The plan that runs fast and compiles in seconds; all steps may be in loops."""
    are_few, has_inner_loop = work.elements <= FEW, work.inner_loop != "never"
    is_looped = all_looped or work.elements > WRITTEN_OUT or work.laws == "long" or has_inner_loop
    is_for_batches = are_few and not work.series and jax.default_backend() == "cpu"
    may_skip = work.inner_loop == "sometimes" and is_for_batches
    return Plan(
        block="loop" if is_looped else "written out" if work.laws == "none" else "recomputed",
        segments=work.series,
        shortcut="none" if not may_skip else "loop" if all_looped else "written out",
        recomputed_steps=has_inner_loop or (is_looped and work.laws != "none"),
        laws_in_arrays=work.laws == "long" and not are_few,
        peaks_in_arrays=has_inner_loop and not are_few,
    )


looped = partial(fast, all_looped=True)
"""As ``fast``, with all steps in loops: they compile sooner, and run longer."""


def plain(work: Work) -> Plan:
    """The loop of a textbook, whatever a step computes."""
    return Plan()


_choice: Choice = fast


def choice() -> Choice:
    """The choice that holds now."""
    return _choice


def choose(other: Choice) -> Choice:
    """Let another choice hold in this process from now on; returns the one before."""
    global _choice
    before, _choice = _choice, other
    return before


@contextmanager
def chosen(other: Choice) -> Iterator[None]:
    """Another choice, for what is run within."""
    before = choose(other)
    try:
        yield
    finally:
        choose(before)
