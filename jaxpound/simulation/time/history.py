"""Grünwald–Letnikov weights (paper, eq. 11) and the history sums S_m = Σ_{j≥1} ω_j c_{m−j}.

The full sum is the reference; the modal sum replaces the weights by a short sum of exponentials,
with an error bound before a run.
"""

from __future__ import annotations

import dataclasses
import math
from functools import cache, lru_cache
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, ArrayLike, Float

from jaxpound._checks import Rule, enforce, number
from jaxpound._errors import InvalidInput

BLOCK = 4  # steps: few, so that the unrolled block compiles fast, but modes are seldom updated
NEAR = 2 * BLOCK - 1  # the longest lag in a block and the one before, which are summed by terms

_GROUP = 16  # modes, whose matrices take 512 bytes: XLA runs loops of them without its scheduler
_MOST_MODES, _LOG_STEP = 48, 0.125
_HORIZON = 2.0  # of the Gramian: decay that is slower than the run need not be resolved


def gl_weights(order: ArrayLike, n: int) -> Float[Array, "... {n}+1"]:
    """Grünwald–Letnikov weights ω_0 … ω_n of a derivative of the given order (paper, eq. 11).

    Examples
    --------
    >>> jp.simulation.gl_weights(0.5, 4).tolist()
    [1.0, -0.5, -0.125, -0.0625, -0.0390625]
    """
    order = jnp.asarray(order, jnp.result_type(order, float))[..., None]
    j = jnp.arange(1, n + 1).reshape(*[1] * (order.ndim - 1), n)
    return jnp.concatenate([jnp.ones_like(order), jnp.cumprod(1 - (order + 1) / j, axis=-1)], -1)


@runtime_checkable
class HistorySum(Protocol):
    """How the history sum S_m = Σ_{j≥1} ω_j c_{m−j} is computed, by blocks of steps.

    The block that starts at step m0 sums c_{m0−BLOCK}, c_{m0−BLOCK+1}, … term by term; all older c
    are in the memory. An order is one number: each rod has its own memory.
    """

    def kernel(self, order: jax.Array, n_steps: int) -> Any:
        """Constants that depend on the order and the number of steps only."""

    def near(self, kernel: Any, order: jax.Array) -> jax.Array:
        """The weights of the terms that a block sums itself, ω_1 … ω_{2 BLOCK − 1}."""

    def empty(self, kernel: Any) -> Any:
        """The memory at rest."""

    def ahead(self, kernel: Any, memory: Any, start: jax.Array) -> jax.Array:
        """Contribution of c_0 … c_{m0−BLOCK−1} to S from m0 = start on, shape (BLOCK,)."""

    def absorb(self, kernel: Any, memory: Any, start: jax.Array, c: jax.Array) -> Any:
        """The memory with c_{m0−BLOCK} … c_{m0−1} added."""


@dataclasses.dataclass(frozen=True)
class FullHistory:
    """The sum as it stands (eq. 10): O(n) work a step and O(n) memory; the reference.

    Reverse-mode differentiation stores the memory of every block, O(n²) numbers.
    """

    def kernel(self, order: jax.Array, n_steps: int) -> jax.Array:
        """Weights in reverse order, then zeros: each step's weights are one window of it."""
        weights = gl_weights(order, n_steps + BLOCK)[::-1]
        return jnp.concatenate([weights, jnp.zeros_like(weights)])

    def near(self, kernel: jax.Array, order: jax.Array) -> jax.Array:
        """The exact weights."""
        return gl_weights(order, NEAR)[1:]

    def empty(self, kernel: jax.Array) -> jax.Array:
        """All c_m of the run to come, from c_{−BLOCK} on."""
        return jnp.zeros_like(kernel[1 : kernel.size // 2])

    def ahead(self, kernel: jax.Array, memory: jax.Array, start: jax.Array) -> jax.Array:
        """Future entries of c are still zero, so that their weights do not matter."""
        n = memory.size
        first = [n - BLOCK - start - i for i in range(BLOCK)]
        return jnp.stack([lax.dynamic_slice(kernel, (i,), (n,)) @ memory for i in first])

    def absorb(
        self, kernel: jax.Array, memory: jax.Array, start: jax.Array, c: jax.Array
    ) -> jax.Array:
        """Write c in its place; c before the start is zero, so that its place does not matter."""
        return lax.dynamic_update_slice(memory, c, (start,))


class _ModeGroup(NamedTuple):
    weight: jax.Array  # W_k, with ω_j ≈ Σ_k W_k s_k^{j−BLOCK−1} for j > BLOCK
    decay: jax.Array  # s_k over a block
    ahead: jax.Array  # s_k^i, shape (modes, BLOCK)
    absorb: jax.Array  # the same backwards, transposed


@dataclasses.dataclass(frozen=True)
class ModalHistory:
    """A sum of real exponentials in the place of the weights: O(modes) work and memory a step.

    The first four weights are exact. The approximate sum is a convolution too, the same at every
    step, so that its error is as smooth in time as the motion.

    Parameters
    ----------
    modes
        Number of exponentials, from 1 to 48; None chooses the smallest that keeps both numbers of
        ``error_bounds`` below ``tolerance`` for every order in (0, 1] over the steps of the run.
    tolerance
        Largest Σ_j |Δω_j|, and largest Σ_j |dΔω_j/dγ|, allowed when modes is None; in [1e-9, 1).

    Examples
    --------
    >>> history = jp.ModalHistory()
    >>> history.n_modes(500), history.n_modes(10_000)
    (16, 24)
    >>> history.error_bound(0.23, 500) < 1e-6
    True
    """

    modes: int | None = None
    tolerance: float = 1e-6

    def __post_init__(self) -> None:
        tolerance = number("tolerance", self.tolerance)
        rules = [Rule("tolerance", tolerance, 1e-9 <= tolerance < 1, "in [1e-9, 1)")]
        if self.modes is not None:
            whole = isinstance(self.modes, int) and 1 <= self.modes <= _MOST_MODES
            text = f"a whole number from 1 to {_MOST_MODES}"
            rules.append(Rule("modes", self.modes, whole, text))
        enforce(rules)

    def n_modes(self, n_steps: int) -> int:
        """Number of exponentials used in a run of ``n_steps`` steps."""
        return self.modes or _modes_for(n_steps, self.tolerance)

    def error_bound(self, order: float, n_steps: int) -> float:
        """Σ_{j=1}^{n_steps} |Δω_j|, so that |error of S_m| ≤ error_bound · max |c| in any run."""
        return self.error_bounds(order, n_steps)[0]

    def error_bounds(self, order: float, n_steps: int) -> tuple[float, float]:
        """Σ_j |Δω_j|, and Σ_j |dΔω_j/dγ|, which bounds a derivative by the order γ likewise."""
        j = np.arange(BLOCK + 1, n_steps + 1)
        value, slope = _weight_errors(np.array([order]), n_steps, self.n_modes(n_steps), j)
        return float(value.sum()), float(slope.sum())

    def kernel(self, order: jax.Array, n_steps: int) -> list[_ModeGroup]:
        """Exponents and weights for a run of ``n_steps`` steps; differentiable in the order."""
        decay, fit = _modes(n_steps, self.n_modes(n_steps))
        widest = jax.dtypes.canonicalize_dtype(float)
        spectrum = _spectrum(order.astype(widest), n_steps, jnp).astype(widest)
        weight = jnp.asarray(fit, widest) @ spectrum
        powers = decay[:, None] ** np.arange(BLOCK)
        ahead, absorb = jnp.asarray(powers, order.dtype), jnp.asarray(powers[:, ::-1], order.dtype)
        far = jnp.asarray(decay**BLOCK, order.dtype)
        weight = weight.astype(order.dtype)
        groups = np.array_split(np.arange(decay.size), -(-decay.size // _GROUP))
        parts = [slice(group[0], group[-1] + 1) for group in groups]
        return [_ModeGroup(weight[k], far[k], ahead[k], absorb[k].T) for k in parts]

    def near(self, kernel: list[_ModeGroup], order: jax.Array) -> jax.Array:
        """The first weights exact, the others from the modes, as in later blocks."""
        parts = [m.weight @ m.ahead[:, : NEAR - BLOCK] for m in kernel]
        return jnp.concatenate([gl_weights(order, BLOCK)[1:], sum(parts[1:], parts[0])])

    def empty(self, kernel: list[_ModeGroup]) -> list[jax.Array]:
        """The modes y_k = Σ_{j>BLOCK} s_k^{j−BLOCK−1} c_{m0−j}."""
        return [jnp.zeros_like(modes.weight) for modes in kernel]

    def ahead(self, kernel: list[_ModeGroup], memory: list[Any], start: jax.Array) -> jax.Array:
        """Σ_k W_k s_k^i y_k for i = 0 … BLOCK − 1."""
        parts = [(m.weight * y) @ m.ahead for m, y in zip(kernel, memory, strict=True)]
        return sum(parts[1:], parts[0])

    def absorb(
        self, kernel: list[_ModeGroup], memory: list[jax.Array], start: jax.Array, c: jax.Array
    ) -> list[jax.Array]:
        """Let the modes decay over a block, and add its c."""
        return [m.decay * y + c @ m.absorb for m, y in zip(kernel, memory, strict=True)]


@lru_cache(maxsize=256)
def _decay_rates(n_steps: int) -> np.ndarray:
    return np.exp(np.arange(np.log(1 / n_steps) - 30, np.log(40.0), _LOG_STEP))


def _spectrum(order: Any, n_steps: int, xp: Any) -> Any:
    """Weights (..., dense) of e^{−u(j−BLOCK−1)} for u of ``_decay_rates``, at any order."""
    # For j ≥ 2, ω_j = −(sin πγ/π) ∫_0^∞ e^{−u(j−2)} e^{−u(2−γ)} (1 − e^{−u})^γ du. The trapezoidal
    # rule in log u is exact to rounding; a balanced truncation of it leaves a few exponentials,
    # which stand for j > BLOCK only, where the weights are smooth in j.
    order = xp.expand_dims(order, -1)
    u = _decay_rates(n_steps).reshape(*[1] * (order.ndim - 1), -1)
    shape = np.exp(-(BLOCK + 1) * u) * u * _LOG_STEP / np.pi
    growth = np.log(np.expm1(u))
    # sin π(1−γ) rather than sin πγ, so that the classical limit γ = 1 is exactly zero.
    return -xp.sin(np.pi * (1 - order)) * xp.exp(order * growth) * shape


@lru_cache(maxsize=256)
def _principal_directions(n_steps: int) -> np.ndarray:
    """Eigenvectors of the dense sum's Gramian at γ = 1/2, the most important last."""
    u, shift = _decay_rates(n_steps), _HORIZON / n_steps
    b = np.sqrt(-_spectrum(0.5, n_steps, np))
    return np.linalg.eigh(np.outer(b, b) / -np.expm1(-(u[:, None] + u) - 2 * shift))[1]


def _lags(n_steps: int, count: int) -> np.ndarray:
    """At most ``count`` lags j from BLOCK + 1 to n_steps, evenly spaced in the logarithm."""
    last = max(n_steps, BLOCK + 2)
    return np.unique(np.round(np.geomspace(BLOCK + 1, last, count)).astype(int))


@lru_cache(maxsize=256)
def _modes(n_steps: int, modes: int) -> tuple[np.ndarray, np.ndarray]:
    """Exponents s (K,) and the map (K, dense) from dense to modal weights, for any order."""
    u, shift = _decay_rates(n_steps), _HORIZON / n_steps
    leading = _principal_directions(n_steps)[:, -modes:]
    reduced = leading.T @ (np.exp(-u - shift)[:, None] * leading)
    decay = np.minimum(np.linalg.eigvalsh(reduced) * np.exp(shift), 1.0)

    j = _lags(n_steps, 400)
    importance = j * np.sqrt(np.gradient(j.astype(float)) / j)
    short = importance[:, None] * decay ** (j[:, None] - BLOCK - 1)
    dense = importance[:, None] * np.exp(-u * (j[:, None] - BLOCK - 1))
    return decay, np.linalg.lstsq(short, dense, rcond=None)[0]


def _weight_errors(
    orders: np.ndarray, n_steps: int, modes: int, j: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """|Δω_j| and |dΔω_j/dγ| at lags j > BLOCK, for each order: shape (j, orders) each."""
    decay, fit = _modes(n_steps, modes)
    step = 1e-30  # complex step: the derivative without any cancellation
    shifted = orders + 1j * step
    weights = fit @ _spectrum(shifted, n_steps, np).T
    exact = np.cumprod(1 - (shifted + 1) / np.arange(1, j.max(initial=1) + 1)[:, None], axis=0)
    error = exact[j - 1] - decay ** (j[:, None] - BLOCK - 1) @ weights
    return np.abs(error.real), np.abs(error.imag) / step


@lru_cache(maxsize=256)
def _modes_for(n_steps: int, tolerance: float) -> int:
    orders = np.array([0.0, 0.01, 0.05, 0.15, 0.3, 0.5, 0.7, 0.85, 0.95, 1.0])
    # The error oscillates over log j: a few thousand lags give its sum within a percent.
    j = _lags(n_steps, 4000)
    spacing = np.gradient(j.astype(float))

    @cache
    def enough(modes: int) -> bool:
        errors = _weight_errors(orders, n_steps, modes, j)
        return all(bool((spacing @ error <= 0.98 * tolerance).all()) for error in errors)

    # Every trial takes a fit: start from a count that is right to within one or two.
    digits, log_steps = -math.log10(tolerance), math.log(n_steps)
    guess = round(-2.4 + 1.27 * log_steps + (0.29 + 0.227 * log_steps) * digits)
    modes = min(max(guess, 1), _MOST_MODES)
    while not enough(modes):
        if modes == _MOST_MODES:
            rule = f"cannot be kept over n_steps = {n_steps} with {_MOST_MODES} modes"
            raise InvalidInput("tolerance", str(tolerance), rule)
        modes += 1
    while modes > 1 and enough(modes - 1):  # of a guess that was too many
        modes -= 1
    return modes
