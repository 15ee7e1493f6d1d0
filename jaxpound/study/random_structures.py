"""Structures whose parameters are random."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from jax.scipy.special import ndtr
from jaxtyping import Array, Float

from jaxpound._checks import instance, is_traced
from jaxpound.model.parameters import interval, paths, put, require_paths
from jaxpound.model.system import Structures
from jaxpound.study.distributions import Distribution, truncated

_LEAST = 0.1  # smallest probability of a distribution inside the admissible interval


@dataclasses.dataclass(frozen=True)
class UncertainStructures:
    """Structures some of whose parameters are random, independently of each other.

    A distribution is truncated to its parameter's admissible interval: order in (0, 1], the rest
    positive, τ_f ≤ τ_x where τ_x is certain, and τ_x ≥ the τ_f drawn. So every draw is valid.

    Parameters
    ----------
    nominal
        The parameters that are certain.
    uncertain
        Distributions by field path: ``{"friction": LogNormal(0.25, 0.2), "rod_1.tau_x": ...}``.

    Raises
    ------
    ValueError
        If a path is unknown, a value is not a distribution, there is none, or a distribution has
        less than a tenth of its probability in its parameter's admissible interval.
    """

    nominal: Structures
    uncertain: Mapping[str, Distribution]

    def __post_init__(self) -> None:
        owner = "UncertainStructures"
        instance(owner, "nominal", self.nominal, Structures)
        instance(owner, "uncertain", self.uncertain, Mapping)
        if not self.uncertain:
            raise ValueError(f"{owner}: uncertain = {{}} must name a parameter")
        require_paths(owner, self.nominal, self.uncertain)
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
        object.__setattr__(self, "uncertain", dict(self.uncertain))

    @property
    def dimension(self) -> int:
        """Number of uncertain parameters."""
        return len(self.uncertain)

    def draw(self, z: Float[Array, " d"]) -> Structures:
        """The structures drawn by z."""
        return put(self.nominal, self.parameters(z))

    def parameters(self, z: Float[Array, " d"]) -> dict[str, Any]:
        """The parameters drawn, by field path."""
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
