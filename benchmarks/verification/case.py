"""What every case of the verification suite returns, and how it is measured."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

ROUNDS = 3


@dataclasses.dataclass(frozen=True)
class Errors:
    """Errors of one quantity at several time steps.

    ``constant`` bounds them: no error may exceed constant × step^order, and where there are two
    steps or more the fitted order may fall short of ``order`` by 0.4 at most.
    """

    quantity: str
    steps: tuple[float, ...]
    errors: tuple[float, ...]
    constant: float
    order: float = 2.0
    seconds: tuple[float, ...] = ()
    """Wall time of one run at each step, once compiled."""

    @property
    def fitted_order(self) -> float | None:
        """Slope of log(error) over log(step), by least squares."""
        if len(self.steps) < 2 or not self.order:
            return None
        return float(np.polyfit(np.log(self.steps), np.log(self.errors), 1)[0])

    def faults(self) -> list[str]:
        """What does not hold of these errors."""
        found = [
            f"{self.quantity}: error {error:.1e} at step {step:g}, above {bound:.1e}"
            for step, error in zip(self.steps, self.errors, strict=True)
            if not error <= (bound := self.constant * step**self.order)
        ]
        fitted = self.fitted_order
        if fitted is not None and not fitted > self.order - 0.4:
            found.append(f"{self.quantity}: order {fitted:.2f} instead of {self.order:g}")
        return found


def with_derivative(
    title: str,
    quantity: str,
    steps: tuple[float, ...],
    errors: Sequence[Sequence[float]],
    constants: tuple[float, float],
) -> list[Errors]:
    """Errors of a quantity and of its derivative, each by step, of second order."""
    names = quantity, "derivative"
    rows = zip(names, errors, constants, strict=True)
    return [Errors(f"{title}: {name}", steps, tuple(row), bound) for name, row, bound in rows]


@dataclasses.dataclass(frozen=True)
class Number:
    """A number beside the one that is known, which it must not miss by more than ``within``."""

    quantity: str
    found: float
    known: float
    within: float

    def faults(self) -> list[str]:
        """What does not hold of this number."""
        if abs(self.found - self.known) <= self.within:
            return []
        return [f"{self.quantity}: {self.found:.7g}, not {self.known:.7g} ± {self.within:.1g}"]


@dataclasses.dataclass(frozen=True)
class Curve:
    """Error against the wall time of one run, of one program."""

    panel: str
    program: str
    errors: tuple[float, ...]
    seconds: tuple[float, ...]
    version: str = ""
    """Of the program, where it is not jaxpound."""


@dataclasses.dataclass(frozen=True)
class Case:
    """A problem, what is known of its solution, and how near the runs come to it."""

    title: str
    problem: str
    source: str
    errors: tuple[Errors, ...] = ()
    numbers: tuple[Number, ...] = ()
    curves: tuple[Curve, ...] = ()
    skipped: str = ""
    """Why the case was not run, if it was not."""
    seconds: float = 0.0
    """Wall time of the whole case, compilation and its reference included."""
    made: str = ""
    """When the case was computed, by which versions, and on which machine."""

    def faults(self) -> list[str]:
        """What does not hold; empty for a case that passes or was skipped."""
        return [fault for part in (*self.errors, *self.numbers) for fault in part.faults()]


def timed(call: Callable[[], Any], rounds: int = ROUNDS) -> tuple[Any, float]:
    """What a call returns, and the shortest wall time of some more of it; 0 without any."""
    found = jax.block_until_ready(call())
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        jax.block_until_ready(call())
        times.append(time.perf_counter() - start)
    return found, min(times, default=0.0)


def refine(
    steps: Sequence[float], run: Callable[[float], Callable[[], Any]], rounds: int = ROUNDS
) -> tuple[list[Any], tuple[float, ...]]:
    """Results and wall times by step; ``run(step)`` gives the call to be timed."""
    found = [timed(run(step), rounds) for step in steps]
    return [one for one, _ in found], tuple(seconds for _, seconds in found)
