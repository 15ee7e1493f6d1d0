"""What a run asks of a rod: its force at each instant, from its state and its elongation."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import jax


class RodStep(NamedTuple):
    """A rod at t_m."""

    force: Any
    kick: Any  # the mean force over the kick, from t_m − h/2 to t_m + h/2
    state: Any
    remembered: Any = None  # c_m, of a rod with a history
    kinked: Any = None  # whether its slope may jump among the last three samples; None if never
    reached: tuple[tuple[Any, Any], ...] = ()  # (steps after t_m, force) since t_{m−1}, at kinks


class RodLaw:
    """The law of a rod over one step, a pytree.

    ``modulus`` is its stiffness K. ``order`` is that of the derivative of c whose history the rod
    remembers; None of a rod without a history. ``viscosity`` is c of a dashpot, whose force c e'
    follows from the velocities (``simulation.damping``); else None. ``yield_displacement`` is the
    elongation where it yields first; None of a rod that never does. ``is_long`` says that a step
    has many operations, ``peaks_at_kinks`` that the force peaks nowhere but where
    ``RodStep.reached`` has it.
    """

    modulus: Any
    order: Any = None
    viscosity: Any = None
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
        displaced or moving; it is None for runs from rest. After a local flow the force is that of
        the ``mean`` elongation over the step.
        """
        raise NotImplementedError

    def dissipated(self, state: Any) -> Any:
        """Energy that the rod has dissipated, if its state says it, else None."""
        return None

    def scalars(self, end: Any, largest: jax.Array, last: jax.Array) -> dict[str, jax.Array]:
        """The scalars of a run, from the state at its end, and largest and last elongation."""
        energy = self.dissipated(end)
        return {} if energy is None else {"dissipated_energy": energy}
