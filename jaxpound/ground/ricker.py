"""Ricker wavelets (paper, eq. 6)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from jaxpound._errors import InvalidInput
from jaxpound._fields import check, parameter, pytree_dataclass
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import Excitation, GroundMotion

# The mean of a sine over an eighth of its period is already 2.6 % less than its middle value.
STEPS_PER_WAVELET = 8


def too_short(name: str, period: float, dt: float) -> list[str]:
    """A sentence if a wavelet's period has too few steps of ``dt``."""
    if not period < STEPS_PER_WAVELET * dt:
        return []
    return [
        f"ground: {name} is {period / dt:.3g} time steps long and should be at least "
        f"{STEPS_PER_WAVELET}: a finer time grid resolves it"
    ]


@pytree_dataclass
class Ricker(GroundMotion):
    r"""A sum of Ricker wavelets, in closed form (paper, eq. 6).

    With :math:`a = π/t_p`, :math:`s = t - t_s` and :math:`v = (a s)^2`, each wavelet is
    :math:`u = u_0 (2v - 1) e^{-v}`.

    Raises ``ValueError`` if the shapes do not match, a period is not positive, or a known value is
    not finite.

    Parameters
    ----------
    amplitude
        u0, the displacement amplitude: one number, as in the paper, or one per wavelet.
    periods, arrivals
        t_p > 0 and t_s, the instants of the centres, one per wavelet, shape (n,); or one number.

    Examples
    --------
    >>> ground = jp.Ricker(amplitude=0.5, periods=2.0, arrivals=3.0)
    >>> round(float(ground.acceleration(3.0)), 4)
    7.4022
    >>> round(float((0.1 * ground + jp.Ricker(0.2, 1.0, 5.0)).acceleration(3.0)), 4)
    0.7402
    """

    amplitude: Any = parameter("u_0", "length", "displacement amplitude")
    periods: Any = parameter("t_p", "time", "period", above=0)
    arrivals: Any = parameter("t_s", "time", "arrival")

    def __post_init__(self) -> None:
        check(self)
        amplitude, periods, arrivals = map(jnp.shape, (self.amplitude, self.periods, self.arrivals))
        if periods != arrivals:
            shapes = f"periods of shape {periods} and arrivals of shape {arrivals}"
            raise InvalidInput("Ricker", shapes, "", "must have one entry per wavelet")
        if len(periods) > 1:
            rule = "must be a number or one-dimensional; a batch of ground motions goes through"
            raise InvalidInput("Ricker", f"periods of shape {periods}", "", f"{rule} jax.vmap")
        if amplitude not in ((), periods):
            rule = f"must be one number or, like periods, of shape {periods}"
            raise InvalidInput("Ricker", f"amplitude of shape {amplitude}", "", rule)

    def displacement(self, t: ArrayLike) -> jax.Array:
        """u(t), of the shape of ``t``."""
        return self._sum(t, lambda a, s, v: 2 * v - 1)

    def velocity(self, t: ArrayLike) -> jax.Array:
        """u'(t), of the shape of ``t``."""
        return self._sum(t, lambda a, s, v: 2 * a**2 * s * (3 - 2 * v))

    def acceleration(self, t: ArrayLike) -> jax.Array:
        """u''(t), of the shape of ``t``."""
        return self._sum(t, lambda a, s, v: 2 * a**2 * (4 * v**2 - 12 * v + 3))

    def excitation(self, grid: TimeGrid, order: int) -> Excitation:
        """Closed forms of u'' and, for a scheme of order 2, its mean to fourth order in dt.

        The mean is u'' + (h²/24) d²u''/dt²; both share the exponentials, most of the work.
        """
        if order == 1:
            return super().excitation(grid, order)
        u0, tp, ts = (jnp.atleast_1d(x) for x in (self.amplitude, self.periods, self.arrivals))
        a = jnp.pi / tp
        size, c = 2 * a**2 * u0, (a * grid.dt) ** 2 / 24
        mean = (3 - 30 * c, 180 * c - 12, 4 - 120 * c, 16 * c)  # times 1, v, v², v³

        def at(t: Any, _: Any) -> tuple[Any, Any]:
            v = (a * (t - ts)) ** 2
            wave = size * jnp.exp(-v)
            averaged = wave * (((mean[3] * v + mean[2]) * v + mean[1]) * v + mean[0])
            return jnp.sum(wave * ((4 * v - 12) * v + 3)), jnp.sum(averaged)

        return Excitation((), at)

    def unresolved(self, dt: float) -> list[str]:
        """A sentence if the shortest wavelet has too few steps of ``dt``."""
        u0, periods = np.broadcast_arrays(np.asarray(self.amplitude), np.asarray(self.periods))
        shortest = float(periods[u0 != 0].min(initial=np.inf))
        return too_short("the shortest of periods", shortest, dt)

    def energy(self, since: float) -> float:
        """∫ u''² dt of the wavelets with centres at or after ``since``."""
        rate, later = np.pi / np.asarray(self.periods), np.asarray(self.arrivals) >= since
        each = 105 / 4 * np.sqrt(np.pi / 2) * np.asarray(self.amplitude) ** 2 * rate**3
        return float(np.sum(each * later))

    def _sum(self, t: ArrayLike, shape: Callable[..., Any]) -> jax.Array:
        t = jnp.asarray(t)
        u0, tp, ts = (
            jnp.expand_dims(jnp.atleast_1d(x), tuple(range(t.ndim)))
            for x in (self.amplitude, self.periods, self.arrivals)
        )
        a, s = jnp.pi / tp, t[..., None] - ts
        v = (a * s) ** 2
        return jnp.sum(u0 * shape(a, s, v) * jnp.exp(-v), axis=-1)
