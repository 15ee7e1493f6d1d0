"""Grünwald–Letnikov weights (paper, eq. 11) and the history sums S_m = Σ_{j≥1} ω_j c_{m−j}.

The full sum is the reference; the modal sum replaces the weights by a short sum of exponentials,
with an error bound that is known before a run.
"""

from __future__ import annotations

import dataclasses
from functools import lru_cache
from typing import Any, NamedTuple, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, ArrayLike, Float

from jaxpound._checks import Rule, enforce, number


def gl_weights(order: ArrayLike, n: int) -> Float[Array, "... n+1"]:
    """Grünwald–Letnikov weights ω_0 … ω_n of a derivative of the given order (paper, eq. 11)."""
    order = jnp.asarray(order, jnp.result_type(order, float))[..., None]
    j = jnp.arange(1, n + 1).reshape(*[1] * (order.ndim - 1), n)
    return jnp.concatenate([jnp.ones_like(order), jnp.cumprod(1 - (order + 1) / j, axis=-1)], -1)


class History(Protocol):
    """How S_m = Σ_{j≥1} ω_j c_{m−j} is kept: a kernel fixed for the run, and a memory.

    Orders, c and S have any shape, such as (2,) for two rods.
    """

    def kernel(self, order: jax.Array, n_steps: int) -> Any:
        """What depends on the order and the number of steps only."""

    def empty(self, kernel: Any) -> Any:
        """The memory at rest."""

    def total(self, kernel: Any, memory: Any) -> jax.Array:
        """S_m, from the memory of c_0 … c_{m−1}."""

    def push(self, kernel: Any, memory: Any, c: jax.Array) -> Any:
        """The memory with c_m added."""


@dataclasses.dataclass(frozen=True)
class FullHistory:
    """The sum as it stands (eq. 10): O(n) work a step and O(n) memory; the reference.

    Reverse-mode differentiation stores the memory of every step, O(n²) numbers.
    """

    def kernel(self, order: jax.Array, n_steps: int) -> jax.Array:
        """Weights ω_n … ω_0 followed by zeros, so that each step's weights are one window of it."""
        weights = gl_weights(order, n_steps)[..., ::-1]
        return jnp.concatenate([weights, jnp.zeros_like(weights[..., 1:])], -1)

    def empty(self, kernel: jax.Array) -> tuple[jax.Array, jax.Array]:
        """All c_m of the run to come, and m."""
        n_steps = kernel.shape[-1] // 2
        return jnp.zeros_like(kernel[..., : n_steps + 1]), jnp.zeros((), jnp.int32)

    def total(self, kernel: jax.Array, memory: tuple[jax.Array, jax.Array]) -> jax.Array:
        """S_m; weights past the present meet entries of c that are still zero."""
        c, m = memory
        n = c.shape[-1]
        window = lax.dynamic_slice_in_dim(kernel, n - 1 - m, n, axis=-1)
        return jnp.vecdot(c, window)

    def push(
        self, kernel: jax.Array, memory: tuple[jax.Array, jax.Array], c: jax.Array
    ) -> tuple[jax.Array, jax.Array]:
        """Write c_m in its place."""
        past, m = memory
        return past.at[..., m].set(c), m + 1


class _ModalKernel(NamedTuple):
    first: jax.Array  # ω_1
    decay: jax.Array  # s_k
    weight: jax.Array  # W_k, with ω_j ≈ Σ_k W_k s_k^{j−2} for j ≥ 2


@dataclasses.dataclass(frozen=True)
class ModalHistory:
    """A sum of real exponentials in the place of the weights: O(modes) work and memory a step.

    Parameters
    ----------
    modes
        Number of exponentials; None chooses the smallest that keeps ``error_bound`` below
        ``tolerance`` for every order in (0, 1) over the steps of the run.
    tolerance
        Largest Σ_j |Δω_j| allowed when ``modes`` is None.

    Raises
    ------
    ValueError
        If modes is not a positive whole number or tolerance not in [1e-9, 1).
    """

    modes: int | None = None
    tolerance: float = 1e-6

    def __post_init__(self) -> None:
        tolerance = number("ModalHistory", "tolerance", self.tolerance)
        rules = [Rule("tolerance", tolerance, 1e-9 <= tolerance < 1, "in [1e-9, 1)")]
        if self.modes is not None:
            whole = isinstance(self.modes, int) and 1 <= self.modes <= _MOST_MODES
            text = f"a whole number from 1 to {_MOST_MODES}"
            rules.append(Rule("modes", self.modes, whole, text))
        enforce("ModalHistory", rules)

    def n_modes(self, n_steps: int) -> int:
        """Number of exponentials used in a run of ``n_steps`` steps."""
        return self.modes or _modes_for(n_steps, self.tolerance)

    def error_bound(self, order: float, n_steps: int) -> float:
        """Σ_{j=1}^{n_steps} |Δω_j|, so that |error of S_m| ≤ error_bound · max |c| in any run."""
        j = np.arange(2, n_steps + 1)
        return float(_weight_errors(np.array([order]), n_steps, self.n_modes(n_steps), j).sum())

    def kernel(self, order: jax.Array, n_steps: int) -> _ModalKernel:
        """Exponents and weights for a run of ``n_steps`` steps; differentiable in the order."""
        rates, fit = _modes(n_steps, self.n_modes(n_steps))
        spectrum = _spectrum(order, n_steps, jnp).astype(order.dtype)
        weight = spectrum @ jnp.asarray(fit.T, order.dtype)
        decay = jnp.broadcast_to(jnp.asarray(rates, order.dtype), weight.shape)
        return _ModalKernel(-order, decay, weight)

    def empty(self, kernel: _ModalKernel) -> tuple[jax.Array, jax.Array]:
        """The last c and the modes y_k."""
        return jnp.zeros_like(kernel.first), jnp.zeros_like(kernel.weight)

    def total(self, kernel: _ModalKernel, memory: tuple[jax.Array, jax.Array]) -> jax.Array:
        """S_m = ω_1 c_{m−1} + W·y."""
        last, y = memory
        return kernel.first * last + jnp.sum(kernel.weight * y, axis=-1)

    def push(
        self, kernel: _ModalKernel, memory: tuple[jax.Array, jax.Array], c: jax.Array
    ) -> tuple[jax.Array, jax.Array]:
        """Y ← s y + c_{m−1}; the last c becomes c_m."""
        last, y = memory
        return c, kernel.decay * y + last[..., None]


# For j ≥ 2, ω_j = −(sin πγ/π) ∫_0^∞ e^{−u(j−2)} e^{−u(2−γ)} (1 − e^{−u})^γ du. The trapezoidal rule
# in log u is exact to rounding; a balanced truncation of it leaves a few exponentials.
_LOG_STEP = 0.125
_MOST_MODES = 48


@lru_cache(maxsize=256)
def _decay_rates(n_steps: int) -> np.ndarray:
    return np.exp(np.arange(np.log(1 / n_steps) - 30, np.log(40.0), _LOG_STEP))


def _spectrum(order: Any, n_steps: int, xp: Any) -> Any:
    """Weights (..., dense) of the dense sum of exponentials over ``_decay_rates``, at any order."""
    order = xp.expand_dims(order, -1)
    u = _decay_rates(n_steps).reshape(*[1] * (order.ndim - 1), -1)
    shape = np.exp(-2 * u) * u * _LOG_STEP / np.pi
    growth = np.log(np.expm1(u))
    # sin π(1−γ) rather than sin πγ, so that the classical limit γ = 1 is exactly zero.
    return -xp.sin(np.pi * (1 - order)) * xp.exp(order * growth) * shape


@lru_cache(maxsize=256)
def _principal_directions(n_steps: int) -> np.ndarray:
    """Eigenvectors of the dense sum's Gramian at γ = 1/2, the most important last."""
    u = _decay_rates(n_steps)
    b = np.sqrt(-_spectrum(0.5, n_steps, np))
    return np.linalg.eigh(np.outer(b, b) / -np.expm1(-(u[:, None] + u) - 2 * _shift(n_steps)))[1]


def _shift(n_steps: int) -> float:
    """A finite horizon: balance for decay rates that it can tell apart."""
    return 2.0 / n_steps


def _places(n_steps: int, count: int) -> np.ndarray:
    """At most ``count`` whole numbers from 2 to n_steps (or 3), evenly spaced in the logarithm."""
    return np.unique(np.round(np.geomspace(2, max(n_steps, 3), count)).astype(int))


@lru_cache(maxsize=256)
def _modes(n_steps: int, modes: int) -> tuple[np.ndarray, np.ndarray]:
    """Exponents s (K,) and the map (K, dense) from dense to modal weights, for any order."""
    u = _decay_rates(n_steps)
    leading = _principal_directions(n_steps)[:, -modes:]
    reduced = leading.T @ (np.exp(-u - _shift(n_steps))[:, None] * leading)
    decay = np.minimum(np.linalg.eigvalsh(reduced) * np.exp(_shift(n_steps)), 1.0)

    j = _places(n_steps, 400)
    importance = j * np.sqrt(np.gradient(j.astype(float)) / j)
    short = importance[:, None] * decay ** (j[:, None] - 2)
    dense = importance[:, None] * np.exp(-u * (j[:, None] - 2))
    return decay, np.linalg.lstsq(short, dense, rcond=None)[0]


def _weight_errors(orders: np.ndarray, n_steps: int, modes: int, j: np.ndarray) -> np.ndarray:
    """|Δω_j| at the given j ≥ 2, for each order: shape (j, orders)."""
    decay, fit = _modes(n_steps, modes)
    weights = fit @ _spectrum(orders, n_steps, np).T
    exact = np.cumprod(1 - (orders + 1) / np.arange(1, j[-1] + 1)[:, None], axis=0)[j - 1]
    return np.abs(exact - decay ** (j[:, None] - 2) @ weights)


@lru_cache(maxsize=256)
def _modes_for(n_steps: int, tolerance: float) -> int:
    orders = np.array([0.05, 0.15, 0.3, 0.5, 0.7, 0.85, 0.95])
    # The error wavers with log j: a few thousand places measure its sum within a percent.
    j = _places(n_steps, 4000)
    spacing = np.gradient(j.astype(float))

    def enough(modes: int) -> bool:
        error = spacing @ _weight_errors(orders, n_steps, modes, j)
        return bool((error <= 0.98 * tolerance).all())

    few, many = 1, _MOST_MODES
    if not enough(many):
        raise ValueError(
            f"ModalHistory: tolerance = {tolerance} cannot be kept over n_steps = {n_steps} "
            f"with {_MOST_MODES} modes"
        )
    while many - few > 1:
        middle = (few + many) // 2
        few, many = (few, middle) if enough(middle) else (middle, many)
    return many
