"""The fractional Zener rod, its material law and its modulus in frequency; and a spring."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import ArrayLike

from jaxpound._checks import positive
from jaxpound._fields import Batch, parameter, pytree_dataclass


@pytree_dataclass
class ZenerRod(Batch):
    r"""A fractional Zener rod, :math:`f + τ_f D^γ f = K (x + τ_x D^γ x)`, per unit of stiffness K.

    Parameters
    ----------
    order
        Order γ of the Riemann–Liouville derivative, in (0, 1]; 1 is the classical Zener solid.
    tau_f, tau_x
        Relaxation times of force and displacement in (unit of time)^order, dimensionless in
        eq. (9) (τ̄ = τ ω1^γ). The second law of thermodynamics requires 0 < τ_f ≤ τ_x; equality is
        the elastic rod. An array makes a batch of rods.

    Examples
    --------
    >>> rod = jp.ZenerRod(order=0.23, tau_f=0.004, tau_x=1.183)
    >>> round(float(rod.natural_frequency()), 4)  # of a unit mass on a unit stiffness
    1.4844
    >>> round(float(rod.damping_ratio()), 4)
    0.1027
    """

    order: Any = parameter(words="order", above=0, most=1, usual=(0.05, 1.0))
    tau_f: Any = parameter(
        r"\bar\tau_f", words="relaxation time of force", above=0, usual=(0.001, 1.0)
    )
    tau_x: Any = parameter(
        r"\bar\tau_x",
        words="relaxation time of displacement",
        least="tau_f",
        why="second law of thermodynamics",
        usual=(0.02, 20.0),
    )

    @property
    def instantaneous_modulus(self) -> Any:
        """Relaxation modulus for t → 0, in units of K: τ_x / τ_f."""
        return self.tau_x / self.tau_f

    def complex_modulus(self, omega: ArrayLike) -> jax.Array:
        """K*(iω) = (1 + τ_x (iω)^γ) / (1 + τ_f (iω)^γ) in units of K, for ω > 0."""
        return lax.complex(*self._moduli(omega))

    def storage_modulus(self, omega: ArrayLike) -> jax.Array:
        """Real part of K*(iω), in units of K."""
        return self._moduli(omega)[0]

    def loss_modulus(self, omega: ArrayLike) -> jax.Array:
        """Imaginary part of K*(iω), in units of K."""
        return self._moduli(omega)[1]

    def loss_factor(self, omega: ArrayLike) -> jax.Array:
        """Loss modulus over storage modulus."""
        storage, loss = self._moduli(omega)
        return loss / storage

    def natural_frequency(self, stiffness: ArrayLike = 1.0, mass: ArrayLike = 1.0) -> jax.Array:
        """Frequency ω_n of a block on the rod: mass ω_n² = stiffness Re K*(iω_n)."""
        stiffness, mass = positive(stiffness=stiffness, mass=mass)
        return _natural_frequency(self, stiffness / mass)

    def damping_ratio(self, stiffness: ArrayLike = 1.0, mass: ArrayLike = 1.0) -> jax.Array:
        """Equivalent viscous damping ratio at the natural frequency: half the loss factor there."""
        return self.loss_factor(self.natural_frequency(stiffness, mass)) / 2

    def _moduli(self, omega: ArrayLike) -> tuple[jax.Array, jax.Array]:
        # K* = 1 + (τ_x − τ_f) z / (1 + τ_f z) with z = (iω)^γ. With a = 1/(1 + τ_f |z|) and
        # b = 1 − a nothing overflows, and the elastic rod has exactly no loss.
        angle = jnp.pi / 2 * self.order
        size = jnp.asarray(omega) ** self.order
        a = 1 / (1 + self.tau_f * size)
        b = self.tau_f * size * a
        excess = (self.tau_x - self.tau_f) * (size * a)
        below = a**2 + 2 * a * b * jnp.cos(angle) + b**2
        storage = 1 + excess * (b + a * jnp.cos(angle)) / below
        loss = excess * a * jnp.sin(angle) / below
        return storage, loss


@pytree_dataclass
class Spring:
    """An elastic rod, f = K e: a material without parameters and without damping."""


@jax.jit
def _natural_frequency(rod: ZenerRod, ratio: jax.Array) -> jax.Array:
    """The root ω of ω² = ratio K'(ω), with its derivatives up to the third."""
    fixed_rod, fixed_ratio = jax.tree.map(lax.stop_gradient, (rod, ratio))

    def halve(bracket: tuple[jax.Array, jax.Array], _: None) -> tuple[Any, None]:
        low, high = bracket
        middle = jnp.sqrt(low * high)
        above = middle**2 > fixed_ratio * fixed_rod.storage_modulus(middle)
        return (jnp.where(above, low, middle), jnp.where(above, middle, high)), None

    # K'(ω)/ω² falls with ω, and 1 ≤ K' ≤ τ_x/τ_f brackets the root; 60 bisections reach rounding.
    elastic = jnp.sqrt(fixed_ratio)
    low = elastic * jnp.ones_like(fixed_rod.storage_modulus(elastic))
    high = low * jnp.sqrt(fixed_rod.instantaneous_modulus)
    (low, high), _ = lax.scan(halve, (low, high), length=60)
    omega = jnp.sqrt(low * high)

    # Newton's steps from the result of the bisection carry the derivatives.
    def excess(w: jax.Array) -> jax.Array:
        return w**2 - ratio * rod.storage_modulus(w)

    for _ in range(2):
        value, slope = jax.jvp(excess, (omega,), (jnp.ones_like(omega),))
        omega = omega - value / slope
    return omega
