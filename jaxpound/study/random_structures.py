"""Structures whose parameters are random."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtr
from jaxtyping import Array, Float

from jaxpound._checks import Rule, enforce, instance, is_traced, real
from jaxpound.model.parameters import expanded, interval, paths, put
from jaxpound.model.system import Structures
from jaxpound.study.distributions import Distribution, truncated

_LEAST = 0.1  # smallest probability of a distribution inside the admissible interval


@dataclasses.dataclass(frozen=True)
class UncertainStructures:
    """Structures some of whose parameters are random, independent of each other or correlated.

    A distribution is truncated to its parameter's admissible interval: order in (0, 1], the rest
    positive, τ_f ≤ τ_x where τ_x is certain, and τ_x ≥ the τ_f drawn. So every draw is valid.

    Parameters
    ----------
    nominal
        The parameters that are certain.
    uncertain
        Distributions by field path: ``{"friction": LogNormal(0.25, 0.2), "rod_1.tau_x": ...}``. In
        a pattern ``*`` stands for any number or name in its place:
        ``{"buildings.0.rods.*.stiffness": ...}`` gives each storey its own draw; a path that is
        given itself goes before a pattern.
    correlation
        That of the standard normal numbers from which parameters are drawn (a Gaussian copula; of
        lognormal ones, the correlation of the logarithms). A number correlates parameters whose
        paths differ in their last index only, such as the stiffness of the storeys of a building;
        all others stay independent. Or a matrix, shape (d, d), in the order of ``uncertain`` with
        its patterns expanded. None, the default: all are independent.

    Raises
    ------
    ValueError
        If a path is unknown or a pattern matches none, a value is not a distribution, there is
        none, or a distribution has less than a tenth of its probability in its parameter's
        admissible interval. If the correlation is not positive definite, no matrix of correlations,
        or a number while no two paths differ in their last index only.

    Notes
    -----
    The point z of a scenario stays one of independent standard normal numbers: with a correlation
    the parameters are drawn from L z, with the Cholesky factor L of its matrix. Number i of z is
    then what parameter i has that those before it in ``uncertain`` do not tell. So it is with the
    Sobol indices of ``sobol_sensitivity``: what storeys share counts for the first of them.

    Examples
    --------
    >>> steel = jp.ZenerRod(order=0.5, tau_f=0.01, tau_x=0.05)
    >>> row = jp.Row(tuple(jp.Storeys((1.0,) * n, jp.Rod(steel, 5.0)) for n in (3, 2)))
    >>> stiffness = {"buildings.*.rods.*.stiffness": jp.LogNormal(5.0, 0.1)}
    >>> structures = jp.UncertainStructures(row, stiffness, correlation=0.7)
    >>> structures.dimension
    5
    >>> structures.correlations[0].tolist()  # of the first storey, with the others of its building
    [1.0, 0.7, 0.7, 0.0, 0.0]
    """

    nominal: Structures
    uncertain: Mapping[str, Distribution]
    correlation: Any = None

    def __post_init__(self) -> None:
        owner = "UncertainStructures"
        instance(owner, "nominal", self.nominal, Structures)
        instance(owner, "uncertain", self.uncertain, Mapping)
        if not self.uncertain:
            raise ValueError(f"{owner}: uncertain = {{}} must name a parameter")
        object.__setattr__(self, "uncertain", expanded(owner, self.nominal, self.uncertain))
        for path, distribution in self.uncertain.items():
            instance(owner, path, distribution, Distribution)
            low, high = self._interval(path, {})
            if not is_traced((low, high)):
                below, upto = (float(ndtr(distribution.to_normal(x))) for x in (low, high))
                if upto - below < _LEAST:
                    raise ValueError(
                        f"{owner}: {path} ~ {distribution} must have at least "
                        f"{_LEAST:.0%} of its probability in [{float(low):.6g}, {float(high):.6g}]"
                    )
        _ = self.correlations

    @property
    def dimension(self) -> int:
        """Number of uncertain parameters."""
        return len(self.uncertain)

    @cached_property
    def correlations(self) -> np.ndarray:
        """Correlations of the normal numbers behind the uncertain parameters, shape (d, d)."""
        names = [*self.uncertain]
        if self.correlation is None:
            return np.eye(len(names))
        return _correlations("UncertainStructures", self.correlation, names)

    def draw(self, z: Float[Array, " d"]) -> Structures:
        """The structures drawn by z."""
        return put(self.nominal, self.parameters(z))

    def parameters(self, z: Float[Array, " d"]) -> dict[str, Any]:
        """The parameters drawn, by field path."""
        if self.correlation is not None:
            z = jnp.asarray(np.linalg.cholesky(self.correlations), z.dtype) @ z
        numbers = dict(zip(self.uncertain, z, strict=True))
        drawn: dict[str, Any] = {}
        for path in paths(self.nominal):
            if path in numbers:
                low, high = self._interval(path, drawn)
                drawn[path] = truncated(self.uncertain[path], numbers[path], low, high)
        return {path: drawn[path] for path in self.uncertain}

    def _interval(self, path: str, drawn: Mapping[str, Any]) -> tuple[Any, Any]:
        """The admissible interval of a parameter, given those drawn before."""
        return interval(self.nominal, path, {**dict.fromkeys(self.uncertain), **drawn})


def _correlations(owner: str, given: Any, uncertain: list[str]) -> np.ndarray:
    """The matrix of correlations, as given or of a number for alike parameters."""
    known = np.asarray(real(owner, "correlation", given), float)
    n = len(uncertain)
    if known.ndim == 0:
        alike = [re.sub(r"\.\d+(?!.*\.\d)", ".*", path) for path in uncertain]
        largest = max(alike.count(one) if "*" in one else 1 for one in alike)
        if largest == 1:
            rule = "must not be given: no two paths differ in their last index only"
            raise ValueError(f"{owner}: correlation = {known:.8g} {rule}")
        least = -1 / (largest - 1)
        rule = f"above {least:.6g} and below 1, with {largest} parameters that are alike"
        enforce(owner, [Rule("correlation", known, (known > least) & (known < 1), rule)])
        same = np.array([[one == other and "*" in one for other in alike] for one in alike])
        return np.where(np.eye(n, dtype=bool), 1.0, np.where(same, known, 0.0))
    if known.shape != (n, n):
        rule = f"a number, or of shape ({n}, {n}): {', '.join(uncertain)}"
        raise ValueError(f"{owner}: correlation of shape {known.shape} must be {rule}")
    right = np.isfinite(known).all() and np.allclose(known, known.T, rtol=0, atol=1e-9)
    if not (right and np.allclose(np.diag(known), 1, rtol=0, atol=1e-9)):
        raise ValueError(f"{owner}: correlation must be symmetric and finite, with a diagonal of 1")
    least = float(np.linalg.eigvalsh(known)[0])
    if not least > _DEFINITE:
        rule = f"positive definite, but its smallest eigenvalue is {least:.3g}"
        raise ValueError(f"{owner}: correlation must be {rule}")
    return known


_DEFINITE = 1e-9  # smallest eigenvalue of a matrix of correlations, above its rounding
