"""What a run asks of a rod: its force at each instant, from its state and its elongation."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import jax
from jax.tree_util import register_dataclass


class RodStep(NamedTuple):
    """A rod at t_m."""

    force: Any
    kick: Any  # the mean force over the kick, from t_m − h/2 to t_m + h/2
    state: Any
    remembered: Any = None  # c_m, of a rod with a history
    kinked: Any = None  # whether its slope may jump among the last three samples; None if never
    reached: tuple[tuple[Any, Any], ...] = ()  # (steps after t_m, force) since t_{m−1}, at kinks


class RodLaw:
    """The law of a rod over one step, a pytree; without further members it is elastic.

    ``order`` is that of the derivative of c whose history the rod remembers; None of a rod without
    a history. ``yield_displacement`` is the elongation where it yields first; None of a rod that
    never does. ``is_long`` says that a step has many operations, ``peaks_at_kinks`` that the force
    peaks nowhere but where ``RodStep.reached`` has it.
    """

    order: Any = None
    yield_displacement: Any = None
    is_long = False
    peaks_at_kinks: ClassVar[bool] = False

    def start(self, elongation: jax.Array, change: jax.Array) -> Any:
        """The state before the first step of a run that begins with an elongation.

        ``change`` is that of the elongation in one step.
        """
        return None

    def step(
        self,
        before: Any,
        elongation: jax.Array,
        total: jax.Array | None,
        is_first: jax.Array | None,
        mean: jax.Array | None = None,
    ) -> RodStep:
        """The rod at t_m, from its state ``before``, at t_{m−1}, and its elongation at t_m.

        ``total`` is the sum S_m of its history. ``is_first`` says whether the run begins at t_m
        displaced or moving; it is None for runs from rest. After an impact the force is that of the
        ``mean`` elongation over the kick.
        """
        raise NotImplementedError

    def dissipated(self, state: Any) -> Any:
        """Energy that the rod has dissipated, if its state says it, else None."""
        return None

    def scalars(self, end: Any, largest: jax.Array, last: jax.Array) -> dict[str, jax.Array]:
        """The scalars of a run, from the state at its end, and largest and last elongation."""
        return {}


@register_dataclass
@dataclass(frozen=True)
class Spring(RodLaw):
    """An elastic spring, f_m = K e_m."""

    modulus: Any  # K

    def step(
        self, before: Any, elongation: Any, total: Any, is_first: Any, mean: Any = None
    ) -> RodStep:
        """The spring at t_m."""
        force = self.modulus * (elongation if mean is None else mean)
        return RodStep(force, force, None)


@register_dataclass
@dataclass(frozen=True)
class Parallel(RodLaw):
    """Laws beside each other, of which one may have a history and one may yield.

    Its state has those of the parts, and the force of all that are smooth.
    """

    parts: tuple[RodLaw, ...]

    @property
    def order(self) -> Any:
        """The order of the part that has a history."""
        return _single(part.order for part in self.parts)

    @property
    def yield_displacement(self) -> Any:
        """The elongation where the part that yields does so first."""
        return _single(part.yield_displacement for part in self.parts)

    @property
    def is_long(self) -> bool:  # type: ignore[override]
        """Whether one of the parts has many operations."""
        return any(part.is_long for part in self.parts)

    def start(self, elongation: jax.Array, change: jax.Array) -> Any:
        """The states of all parts."""
        return tuple(part.start(elongation, change) for part in self.parts), 0 * elongation

    def step(
        self, before: Any, elongation: Any, total: Any, is_first: Any, mean: Any = None
    ) -> RodStep:
        """All parts at t_m; smooth forces are linear between samples, to second order."""
        states, last = before
        steps = [
            part.step(state, elongation, total, is_first, mean)
            for part, state in zip(self.parts, states, strict=True)
        ]
        smooth = sum(step.force for step in steps if step.kinked is None)
        return RodStep(
            force=sum(step.force for step in steps),
            kick=sum(step.kick for step in steps),
            state=(tuple(step.state for step in steps), smooth),
            remembered=_single(step.remembered for step in steps),
            kinked=_single(step.kinked for step in steps),
            reached=tuple(
                (late, force + smooth + (smooth - last) * late)
                for step in steps
                for late, force in step.reached
            ),
        )

    def dissipated(self, state: Any) -> Any:
        """What the parts dissipate that know it."""
        energies = [part.dissipated(x) for part, x in zip(self.parts, state[0], strict=True)]
        return sum(energy for energy in energies if energy is not None)

    def scalars(self, end: Any, largest: jax.Array, last: jax.Array) -> dict[str, jax.Array]:
        """The scalars of all parts."""
        scalars = dict[str, jax.Array]()
        for part, state in zip(self.parts, end[0], strict=True):
            scalars |= part.scalars(state, largest, last)
        return scalars


def _single(numbers: Iterable[Any]) -> Any:
    """The number that is not None, if there is one."""
    return next((x for x in numbers if x is not None), None)
