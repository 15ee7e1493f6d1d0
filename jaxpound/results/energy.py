"""The energy balance of a run over time."""

from __future__ import annotations

import functools
import operator
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxpound.model.system import elongation

if TYPE_CHECKING:
    from jaxpound.results.response import Response


class Energy(NamedTuple):
    """Terms of the energy balance over time (relative motion), shape (n_steps+1,) each.

    In (m1 g)(g/ω1²), or J in SI. The terms are cumulative trapezoidal integrals of the powers at
    the grid's instants (for the input, of the momentum over the ground velocity u'), not the
    scheme's telescoping sums: so ``residual`` measures how well motion, forces and quadrature agree
    (not the rods' law). Of links with a law of contact the terms are those of the motion within the
    steps; in a step with contact, where velocities may jump, work into the rods is integrated over
    their elongation.
    """

    input: Any
    """Work of the ground, −∫ u'' Σ m x' dt."""
    kinetic: Any
    """Kinetic energy Σ ½ m x'²."""
    rods: Any
    """Work into the rods, Σ ∫ f e' dt with the elongations e, besides their energy at t = 0."""
    friction: Any
    """Work into the links' dampers, Σ ∫ q w dt with the slip velocities w."""
    residual: Any
    """rods + friction + kinetic + stored and lost in contact − input − initial."""
    contact_stored: Any = 0.0
    """Energy stored in contact, Σ ∫ p_s w dt with the part p_s of a law's force at speed 0."""
    contact_lost: Any = 0.0
    """Energy lost by contact, Σ ∫ (p − p_s) w dt, and by impacts."""
    initial: Any = 0.0
    """Energy at t = 0, of shape (): kinetic, and Σ ½ f e of rods that start displaced."""

    @property
    def relative_residual(self) -> Any:
        """Largest ``residual`` as a share of the largest energy put in; 0 for a run at rest."""
        supplied = jnp.abs(self.input + jnp.asarray(self.initial)[..., None]).max(-1)
        share = jnp.abs(self.residual).max(-1) / jnp.where(supplied > 0, supplied, 1.0)
        return jnp.where(supplied > 0, share, 0.0)


def energy_of(response: Response) -> Energy:
    """The energy balance of a response."""
    x, v = [mass.x for mass in response.masses], [mass.v for mass in response.masses]
    masses = [jnp.asarray(mass.mass)[..., None] for mass in response.masses]
    momentum = _total(map(operator.mul, masses, v))
    kinetic = _total(m * v_of_mass**2 for m, v_of_mass in zip(masses, v, strict=True)) / 2
    steps = jnp.diff(response.time, axis=-1)
    works = steps * _means(_total(r.force * elongation(r.ends, v) for r in response.rods))
    if touching := [link.touching for link in response.links if link.touching is not None]:
        of_motion = (_means(r.force) * jnp.diff(elongation(r.ends, x)) for r in response.rods)
        met = _total(touching) > 0
        works = jnp.where(met[..., 1:] | met[..., :-1], _total(of_motion), works)
    rods = _summed(works)
    friction = stored = lost = 0 * rods
    for link in response.links:
        work = link.friction_work
        if work is None:
            work = _summed(steps * _means(link.friction * link.slip_velocity))
        friction = friction + work
        if link.contact is not None:
            stored, lost = stored + link.contact_stored, lost + link.contact_lost
    # Integrated over u', which includes what u'' does between the instants.
    supplied = _summed(-jnp.diff(response.ground_velocity, axis=-1) * _means(momentum))
    at_start = _total(r.force[..., 0] * elongation(r.ends, x)[..., 0] for r in response.rods) / 2
    rods, initial = rods + at_start[..., None], kinetic[..., 0] + at_start
    residual = rods + friction + kinetic + stored + lost - supplied - initial[..., None]
    return Energy(supplied, kinetic, rods, friction, residual, stored, lost, initial)


def _means(series: Any) -> Any:
    """Means over the steps between the instants, by the trapezoidal rule."""
    return (series[..., 1:] + series[..., :-1]) / 2


def _total(terms: Iterable[Any]) -> Any:
    """Sum of one term or more, without adding them to zero."""
    return functools.reduce(operator.add, terms)


def _summed(steps: jax.Array) -> Float[Array, "... time"]:
    """Cumulative sums at the instants, from values of the steps between them."""
    return jnp.concatenate([0 * steps[..., :1], jnp.cumsum(steps, axis=-1)], -1)
