"""A building as one block on one rod, in SI units."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound._checks import Range, Rule, enforce, is_traced, not_negative, positive, require_batch
from jaxpound._errors import InvalidInput
from jaxpound._fields import BatchInSI, like, parameter, part, pytree_dataclass, unchecked
from jaxpound.model.dampers import COEFFICIENT, Dashpot
from jaxpound.model.hysteresis import HysteresisLaw, YieldingZener, before_yield, material_in
from jaxpound.model.rod import Spring, ZenerRod

# Wide enough for laboratory models and the tallest towers, narrow enough to catch a wrong unit.
PERIOD = Range(2e-3, 60, "s", "models shake at a hundredth of a second, towers in ten")
DAMPING = Range(0, 1, "", "of the critical damping; 0.05 is 5 %")
_MASS = Range(1e-3, 1e10, "kg", "from a model of a gram to ten times the heaviest tower")
_STIFFNESS = Range(1e-6, 1e16, "N/m", "what such masses and periods make")
_ORDER = Range(1e-3, 1, "", "of a fractional derivative, 1 for a classical one")
_RELAXATION = Range(1e-12, 1e6, "s^order", "a relaxation time to the power of the order")
ORDER_BY_DEFAULT = 0.5
ROD = ("order", "tau_f", "tau_x")
"""The numbers of a fractional rod; a spring has none of them."""


@pytree_dataclass
class Building(BatchInSI):
    """A building as one block on one fractional Zener rod, or on a spring, in SI units.

    Raises ``ValueError`` if a known value breaks its rule, or some numbers of the rod are stated
    without the others.

    Parameters
    ----------
    mass
        Mass > 0, kg.
    stiffness
        Long-time stiffness k > 0, N/m.
    order
        Order of the fractional derivative, in (0, 1].
    tau_f, tau_x
        Relaxation times, s^order, 0 < τ_f ≤ τ_x. Without these three the rod is a spring.
    hysteresis
        The law by which the rod's spring yields, ``Bilinear``, ``BoucWen`` or any
        ``HysteresisLaw``, with its displacements in m; None, the default, does not yield.
    dashpot
        Coefficient ≥ 0 of a dashpot beside the rod, N s/m; None, the default, for none. Its force
        is not in that of the rod.

    Examples
    --------
    >>> building = jp.Building.from_period(mass=500e3, period=0.9, damping_ratio=0.05)
    >>> f"{building.stiffness:.3g} N/m"
    '2.19e+07 N/m'
    >>> round(float(building.natural_period), 6)
    0.9
    """

    mass: Any = parameter("m", words="mass", above=0, within=_MASS)
    stiffness: Any = parameter("k", words="stiffness", above=0, within=_STIFFNESS)
    order: Any = like(ZenerRod, "order", _ORDER, default=None)
    tau_f: Any = like(ZenerRod, "tau_f", _RELAXATION, default=None)
    tau_x: Any = like(ZenerRod, "tau_x", _RELAXATION, default=None)
    hysteresis: Any = part(HysteresisLaw, traced=True, default=None)
    dashpot: Any = like(Dashpot, "coefficient", COEFFICIENT, default=None)
    n_floors, n_ends, n_tuned, n_bearings = 1, 1, 0, 0  # as a ``ShearBuilding`` has them
    footing = None

    def __post_init__(self) -> None:
        stated = [name for name in ROD if getattr(self, name) is not None]
        if missing := [name for name in ROD if name not in stated] if stated else []:
            rule = f"must be stated beside {' and '.join(stated)}; without all three it is a spring"
            raise InvalidInput(missing[0], "None", rule)
        super().__post_init__()

    @classmethod
    def from_period(
        cls,
        mass: Any,
        period: Any,
        damping_ratio: Any,
        order: Any = ORDER_BY_DEFAULT,
        tau_f: Any = None,
    ) -> Building:
        """The building with this equivalent natural period and damping ratio.

        At ω = 2π / period the rod's storage modulus carries the mass, k K'(ω) = m ω², and half its
        loss factor is the damping ratio: two equations for stiffness and τ_x. So m ω² is the
        ``dynamic_stiffness``. The ``stiffness`` k under a permanent load is smaller, since a
        fractional rod creeps: at order 0.5 by 10 % at a damping ratio of 5 %, by 30 % at 15 %. With
        ``order=None`` the building is the viscous one of other programs (Kelvin and Voigt's): a
        spring of m ω² beside a dashpot of c = 2 ζ m ω.

        Raises ``ValueError`` if no rod of this order and τ_f damps as much.

        Parameters
        ----------
        mass
            Mass > 0, kg.
        period
            Natural period > 0, s.
        damping_ratio
            Equivalent viscous damping ratio ≥ 0 (0.05 is 5 %); None for a block on a spring,
            without damping.
        order
            Order of the fractional derivative, in (0, 1]; None for a spring beside a dashpot.
        tau_f
            Relaxation time of force, s^order; by default such that τ_f ω^order = 0.01.

        Examples
        --------
        >>> fractional = jp.Building.from_period(500e3, period=0.9, damping_ratio=0.05)
        >>> viscous = jp.Building.from_period(500e3, 0.9, 0.05, order=None)
        >>> [f"{b.stiffness:.4g} N/m" for b in (fractional, viscous)]
        ['2.19e+07 N/m', '2.437e+07 N/m']
        >>> [f"{b.dynamic_stiffness:.4g} N/m" for b in (fractional, viscous)]
        ['2.437e+07 N/m', '2.437e+07 N/m']
        """
        mass, period = positive(mass=mass, period=period)
        if damping_ratio is None:
            for name, x, default in (("order", order, ORDER_BY_DEFAULT), ("tau_f", tau_f, None)):
                if x is not default and x is not None:
                    rule = "must be left out without a damping ratio: the block is on a spring"
                    raise InvalidInput(name, str(x), rule)
            enforce([PERIOD.of("period", period)])
            return cls(mass, mass * (2 * np.pi / period) ** 2)
        (zeta,) = not_negative(damping_ratio=damping_ratio)
        enforce([PERIOD.of("period", period), DAMPING.of("damping_ratio", zeta)])
        omega = 2 * np.pi / period
        if order is None:
            if tau_f is not None:
                raise InvalidInput("tau_f", str(tau_f), "must be left out where order is None")
            require_batch(mass=mass, period=period, damping_ratio=zeta)
            return cls(mass, mass * omega**2, dashpot=2 * zeta * mass * omega)
        order = ZenerRod(order, 1.0, 1.0).order
        size = omega**order
        tau_f = 0.01 / size if tau_f is None else ZenerRod(order, tau_f, tau_f).tau_f
        require_batch(mass=mass, period=period, damping_ratio=zeta, order=order, tau_f=tau_f)
        xp = jnp if is_traced((period, order)) else np
        c, s = size * xp.cos(np.pi / 2 * order), size * xp.sin(np.pi / 2 * order)
        # Loss − 2ζ storage = 0 is linear in τ_x (numerators of K* over |1 + τ_f (iω)^γ|²).
        gain = s - 2 * zeta * (c + tau_f * size**2)
        largest = s / (c + tau_f * size**2) / 2
        rule = "below what a rod of this order and tau_f can give"
        if not is_traced((largest, gain)):
            first = np.argmin(gain > 0)  # the building that the message names
            rule += f", {np.broadcast_to(largest, np.shape(gain)).flat[first]:.8g}"
        enforce([Rule("damping_ratio", zeta, gain > 0, rule)])
        # A sum of positive terms keeps τ_x ≥ τ_f to the last digit.
        tau_x = tau_f + 2 * zeta * (1 + 2 * tau_f * c + (tau_f * size) ** 2) / gain
        below = (1 + tau_f * c) ** 2 + (tau_f * s) ** 2
        storage = (1 + (tau_x + tau_f) * c + tau_x * tau_f * size**2) / below
        return cls(mass, mass * omega**2 / storage, order, tau_f, tau_x)

    @property
    def storeys(self) -> tuple[Building, ...]:
        """Its only storey, the building itself."""
        return (self,)

    def zener(self, frequency: Any = 1.0) -> ZenerRod:
        """The fractional rod with relaxation times in units of 1/frequency^order; rad/s."""
        return before_yield(self.material(frequency))

    def material(self, frequency: Any = 1.0, length: Any = 1.0) -> Any:
        """The rod's law in units of 1/frequency^order, rad/s, and of a length, m."""
        if self.order is None:
            return material_in(self.hysteresis or Spring(), frequency, length)
        rod = unchecked(ZenerRod, order=self.order, tau_f=self.tau_f, tau_x=self.tau_x)
        law = self.hysteresis
        material = rod if law is None else unchecked(YieldingZener, zener=rod, hysteresis=law)
        return material_in(material, frequency, length)

    @property
    def dynamic_stiffness(self) -> jax.Array:
        """Stiffness of a vibration at the natural frequency, m ω² = k K'(ω), N/m."""
        return self.mass * self.zener().natural_frequency(self.stiffness, self.mass) ** 2

    @property
    def natural_period(self) -> jax.Array:
        """Equivalent natural period, s."""
        return 2 * jnp.pi / self.zener().natural_frequency(self.stiffness, self.mass)

    @property
    def damping_ratio(self) -> jax.Array:
        """Equivalent viscous damping ratio at the natural frequency, with that of the dashpot."""
        ratio = self.zener().damping_ratio(self.stiffness, self.mass)
        if self.dashpot is None:
            return ratio
        frequency = self.zener().natural_frequency(self.stiffness, self.mass)
        return ratio + self.dashpot / (2 * self.mass * frequency)
