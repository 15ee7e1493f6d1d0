"""Structures whose parameters are random."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxpound._checks import Rule, enforce, instance, real
from jaxpound._errors import InvalidInput
from jaxpound.model.parameters import expanded, interval, paths, put
from jaxpound.model.system import Structures
from jaxpound.scenarios.distributions import Distribution, require_inside, truncated

_DEFINITE = 1e-9  # smallest eigenvalue of a matrix of correlations, above its rounding


@dataclasses.dataclass(frozen=True)
class UncertainStructures:
    """Structures some of whose parameters are random, independent of each other or correlated.

    A distribution is truncated to its parameter's admissible interval, in which it must have a
    tenth of its probability: order in (0, 1], the rest positive, τ_f ≤ τ_x where τ_x is certain,
    and τ_x ≥ the τ_f drawn. So every draw is valid. A ``PlausibilityWarning`` names what loses more
    than 0.1 % of its probability; a normal distribution of positive numbers with a standard
    deviation of 0.3 of its mean loses 0.04 %.

    Raises ``ValueError`` if a pattern matches no path.

    Parameters
    ----------
    nominal, uncertain
        The structures that have all other parameters, and distributions by field path:
        ``{"friction": LogNormal(0.25, 0.2), "rod_1.tau_x": ...}``. Patterns are as in
        ``DesignSpace``: ``{"buildings.0.rods.*.stiffness": ...}`` draws each storey's stiffness.
    correlation
        Correlation of the standard normal numbers from which parameters are drawn (a Gaussian
        copula; for lognormal parameters, the correlation of the logarithms). A number correlates
        parameters whose paths differ in their last index only, such as the stiffness of the storeys
        of a building; all others are independent. Or a positive definite matrix, shape (d, d), in
        the order of ``uncertain`` with its patterns expanded. None: all are independent. The
        parameters are drawn from L z, with the Cholesky factor L of the matrix and independent z:
        number i of z is the part of parameter i that does not follow from those before it, also in
        Sobol indices (``Sensitivity``).

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
        instance("nominal", self.nominal, Structures)
        instance("uncertain", self.uncertain, Mapping)
        if not self.uncertain:
            raise InvalidInput("uncertain", "{}", "must name a parameter")
        object.__setattr__(self, "uncertain", expanded(self.nominal, self.uncertain))
        for path, distribution in self.uncertain.items():
            instance(path, distribution, Distribution)
            require_inside(path, distribution, *self._interval(path, {}))
        _ = self.correlations

    @property
    def dimension(self) -> int:
        """Number of uncertain parameters."""
        return len(self.uncertain)

    @cached_property
    def correlations(self) -> np.ndarray:
        """Correlations of the normal numbers behind the uncertain parameters, shape (d, d)."""
        uncertain, n = [*self.uncertain], self.dimension
        if self.correlation is None:
            return np.eye(n)
        matrix = np.asarray(real("correlation", self.correlation), float)
        if matrix.ndim == 0:  # of parameters of one group
            groups = [re.sub(r"\.\d+(?!.*\.\d)", ".*", path) for path in uncertain]
            largest = max(groups.count(group) if "*" in group else 1 for group in groups)
            if largest == 1:
                rule = "must not be given: no two paths differ in their last index only"
                raise InvalidInput("correlation", f"{matrix:.8g}", rule)
            least = -1 / (largest - 1)
            rule = f"above {least:.6g} and below 1, with {largest} parameters that are alike"
            enforce([Rule("correlation", matrix, (matrix > least) & (matrix < 1), rule)])
            same = np.array([[x == other and "*" in x for other in groups] for x in groups])
            return np.where(np.eye(n, dtype=bool), 1.0, np.where(same, matrix, 0.0))
        if matrix.shape != (n, n):
            rule = f"must be a number, or of shape ({n}, {n}): {', '.join(uncertain)}"
            raise InvalidInput("correlation", "", f"of shape {matrix.shape} {rule}")
        symmetric = np.isfinite(matrix).all() and np.allclose(matrix, matrix.T, rtol=0, atol=1e-9)
        if not (symmetric and np.allclose(np.diag(matrix), 1, rtol=0, atol=1e-9)):
            rule = "must be symmetric and finite, with a diagonal of 1"
            raise InvalidInput("correlation", "", rule)
        if not (least := float(np.linalg.eigvalsh(matrix)[0])) > _DEFINITE:
            rule = f"must be positive definite, but its smallest eigenvalue is {least:.3g}"
            raise InvalidInput("correlation", "", rule)
        return matrix

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
        """Admissible interval of a parameter, which depends on those drawn before."""
        return interval(self.nominal, path, {**dict.fromkeys(self.uncertain), **drawn})
