"""Two blocks on fractional Zener rods, joined by a friction link: the system of eq. (9)."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import ArrayLike

from jaxpound._checks import (
    Rule,
    enforce,
    finite,
    instance,
    is_traced,
    one_batch,
    positive,
    real,
)
from jaxpound._pytree import pytree_dataclass


@pytree_dataclass
class ZenerRod:
    r"""A fractional Zener rod, :math:`f + τ_f D^γ f = K (x + τ_x D^γ x)`, per unit of stiffness K.

    Parameters
    ----------
    order
        Order γ of the Riemann–Liouville derivative, in (0, 1]; 1 is the classical Zener solid.
    tau_f, tau_x
        Relaxation times of force and displacement in (unit of time)^order, dimensionless in
        eq. (9) (τ̄ = τ ω1^γ). The second law of thermodynamics asks 0 < τ_f ≤ τ_x; equality is the
        elastic rod. Each may be an array, which makes a batch of rods.

    Raises
    ------
    ValueError
        If a known value breaks one of these rules. Traced values cannot raise: a run with an
        invalid rod returns NaN in every result.

    Examples
    --------
    >>> rod = jp.ZenerRod(order=0.23, tau_f=0.004, tau_x=1.183)
    >>> round(float(rod.natural_frequency()), 4)  # of a unit mass on a unit stiffness
    1.4844
    >>> round(float(rod.damping_ratio()), 4)
    0.1027
    """

    order: Any
    tau_f: Any
    tau_x: Any

    def __post_init__(self) -> None:
        for name in ("order", "tau_f", "tau_x"):
            object.__setattr__(self, name, real("ZenerRod", name, getattr(self, name)))
        one_batch("ZenerRod", order=self.order, tau_f=self.tau_f, tau_x=self.tau_x)
        enforce("ZenerRod", self.rules())

    def rules(self, prefix: str = "") -> list[Rule]:
        """The rules of a rod, as (name, value, whether it holds, text)."""
        order, tau_f, tau_x = self.order, self.tau_f, self.tau_x
        return [
            Rule(prefix + "order", order, (order > 0) & (order <= 1), "in (0, 1]"),
            Rule(prefix + "tau_f", tau_f, (tau_f > 0) & finite(tau_f), "positive and finite"),
            Rule(
                prefix + "tau_x",
                tau_x,
                (tau_x >= tau_f) & finite(tau_x),
                f"finite and at least tau_f{_shown(tau_f)} (second law of thermodynamics)",
            ),
        ]

    @property
    def static_modulus(self) -> float:
        """Relaxation modulus for t → ∞, in units of K: 1."""
        return 1.0

    @property
    def instantaneous_modulus(self) -> Any:
        """Relaxation modulus for t → 0, in units of K: τ_x / τ_f."""
        return self.tau_x / self.tau_f

    def complex_modulus(self, omega: ArrayLike) -> jax.Array:
        """K*(iω) = (1 + τ_x (iω)^γ) / (1 + τ_f (iω)^γ) in units of K, for ω > 0."""
        storage, loss = self._moduli(omega)
        return lax.complex(storage, loss)

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
        stiffness, mass = positive("natural_frequency", stiffness=stiffness, mass=mass)
        return _natural_frequency(self, stiffness / mass)

    def damping_ratio(self, stiffness: ArrayLike = 1.0, mass: ArrayLike = 1.0) -> jax.Array:
        """Equivalent viscous damping ratio at the natural frequency: half the loss factor there."""
        return self.loss_factor(self.natural_frequency(stiffness, mass)) / 2

    def _moduli(self, omega: ArrayLike) -> tuple[jax.Array, jax.Array]:
        # K* = 1 + (τ_x − τ_f) z / (1 + τ_f z) with z = (iω)^γ. With a = 1/(1 + τ_f |z|) and
        # b = 1 − a nothing overflows, and the elastic rod is elastic to the last digit.
        angle = jnp.pi / 2 * self.order
        size = jnp.asarray(omega) ** self.order
        a = 1 / (1 + self.tau_f * size)
        b = self.tau_f * size * a
        excess = (self.tau_x - self.tau_f) * (size * a)
        below = a**2 + 2 * a * b * jnp.cos(angle) + b**2
        storage = 1 + excess * (b + a * jnp.cos(angle)) / below
        loss = excess * a * jnp.sin(angle) / below
        return storage, loss


@jax.jit
def _natural_frequency(rod: ZenerRod, ratio: jax.Array) -> jax.Array:
    """The root ω of ω² = ratio K'(ω), with its derivatives up to the third."""
    known_rod, known_ratio = jax.tree.map(lax.stop_gradient, (rod, ratio))

    def halve(bracket: tuple[jax.Array, jax.Array], _: None) -> tuple[Any, None]:
        low, high = bracket
        middle = jnp.sqrt(low * high)
        above = middle**2 > known_ratio * known_rod.storage_modulus(middle)
        return (jnp.where(above, low, middle), jnp.where(above, middle, high)), None

    # K'(ω)/ω² falls with ω, and 1 ≤ K' ≤ τ_x/τ_f brackets the root; 60 halvings reach rounding.
    elastic = jnp.sqrt(known_ratio)
    low = elastic * jnp.ones_like(known_rod.storage_modulus(elastic))
    high = low * jnp.sqrt(known_rod.instantaneous_modulus)
    (low, high), _ = lax.scan(halve, (low, high), length=60)
    omega = jnp.sqrt(low * high)

    # A bracket cannot be differentiated; Newton's steps from its end can.
    def excess(w: jax.Array) -> jax.Array:
        return w**2 - ratio * rod.storage_modulus(w)

    for _ in range(2):
        value, slope = jax.jvp(excess, (omega,), (jnp.ones_like(omega),))
        omega = omega - value / slope
    return omega


def _shown(value: Any) -> str:
    return f" = {float(value):.8g}" if not is_traced(value) and jnp.ndim(value) == 0 else ""


@pytree_dataclass
class AdjacentStructures:
    """Two adjacent structures joined by a friction damper, dimensionless (paper, eq. 9).

    Parameters
    ----------
    rod_1, rod_2
        The rods; rod 1 has stiffness 1, rod 2 has stiffness ``stiffness_ratio``.
    mass_ratio
        ρ = m1 / m2 > 0.
    stiffness_ratio
        ε = k2 / k1 > 0.
    friction
        μ ≥ 0, the damper's slip force in units of m1 g.
    initial_gap
        ξ0 ≥ 0, the gap at rest in units of g/ω1².

    Raises
    ------
    ValueError
        If a known value breaks one of these rules. Traced values cannot raise: a run of invalid
        structures returns NaN in every result.

    Examples
    --------
    >>> rod_1 = jp.ZenerRod(order=0.23, tau_f=0.004, tau_x=1.183)
    >>> rod_2 = jp.ZenerRod(order=0.53, tau_f=0.2, tau_x=4.0)
    >>> structures = jp.AdjacentStructures(
    ...     rod_1, rod_2, mass_ratio=1.0, stiffness_ratio=2.0, friction=0.25, initial_gap=1.0
    ... )
    >>> [round(float(omega), 3) for omega in structures.natural_frequencies]
    [1.484, 3.341]
    """

    rod_1: ZenerRod
    rod_2: ZenerRod
    mass_ratio: Any
    stiffness_ratio: Any
    friction: Any
    initial_gap: Any

    def __post_init__(self) -> None:
        for name in ("rod_1", "rod_2"):
            instance("AdjacentStructures", name, getattr(self, name), ZenerRod)
        for name in ("mass_ratio", "stiffness_ratio", "friction", "initial_gap"):
            object.__setattr__(self, name, real("AdjacentStructures", name, getattr(self, name)))
        enforce("AdjacentStructures", self._own_rules())

    def rules(self) -> list[Rule]:
        """The rules of both rods and of the pair."""
        return [*self.rod_1.rules("rod_1."), *self.rod_2.rules("rod_2."), *self._own_rules()]

    def _own_rules(self) -> list[Rule]:
        positive, not_negative = "positive and finite", "finite and not negative"
        rho, epsilon, mu, gap = (
            self.mass_ratio,
            self.stiffness_ratio,
            self.friction,
            self.initial_gap,
        )
        return [
            Rule("mass_ratio", rho, (rho > 0) & finite(rho), positive),
            Rule("stiffness_ratio", epsilon, (epsilon > 0) & finite(epsilon), positive),
            Rule("friction", mu, (mu >= 0) & finite(mu), not_negative),
            Rule("initial_gap", gap, (gap >= 0) & finite(gap), not_negative),
        ]

    @property
    def natural_frequencies(self) -> tuple[jax.Array, jax.Array]:
        """Natural frequencies of the two uncoupled structures, in units of ω1 = √(k1/m1)."""
        return (
            self.rod_1.natural_frequency(),
            self.rod_2.natural_frequency(self.stiffness_ratio, 1 / self.mass_ratio),
        )

    @property
    def damping_ratios(self) -> tuple[jax.Array, jax.Array]:
        """Equivalent viscous damping ratios of the two uncoupled structures."""
        return (
            self.rod_1.damping_ratio(),
            self.rod_2.damping_ratio(self.stiffness_ratio, 1 / self.mass_ratio),
        )
