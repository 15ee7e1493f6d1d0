"""Design variables: parameters of the structures by path, each between two bounds.

An optimiser works on scaled variables (``shares``), from 0 to 1 between their bounds;
``DesignSpace`` turns them into structures. So every iterate is physical.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from jaxpound._checks import Rule, enforce, instance, number
from jaxpound._errors import InvalidInput, renamed
from jaxpound._extrema import larger, smaller
from jaxpound._fields import Checked, parameter
from jaxpound.model.parameters import expanded, get, interval, lower, paths, put, require_paths
from jaxpound.model.system import Structures

_SLACK = 1e-6  # relative to a bound: rounding in single precision of a value and its inverse
_APART = 1.001  # least ratio of a parameter to its lower bound, if that is a parameter


@dataclasses.dataclass(frozen=True)
class Bounds(Checked):
    """The interval of a design variable, and whether its scale is logarithmic.

    Parameters
    ----------
    low, high
        Smallest and largest value, low < high.
    scale
        "log" for ratios (low > 0), "linear" for differences.

    Examples
    --------
    >>> bounds = jp.design.Bounds(0.1, 10.0, "log")
    >>> round(float(bounds.value(0.5, bounds.low)), 6)  # half way, by ratio
    1.0
    """

    low: float = parameter(single=True)
    high: float = parameter(above="low", single=True)
    scale: str = "linear"

    def __post_init__(self) -> None:
        if self.scale not in ("linear", "log"):
            raise InvalidInput("scale", repr(self.scale), "must be 'linear' or 'log'")
        super().__post_init__()
        for name in ("low", "high"):
            object.__setattr__(self, name, float(getattr(self, name)))
        positive = self.low > 0 or self.scale == "linear"
        enforce([Rule("low", self.low, positive, "positive for a log scale")])

    def value(self, share: Any, low: Any) -> Any:
        """The value of a scaled variable, 0 at ``low`` (or a higher bound) and 1 at high."""
        if self.scale == "log":
            value = low * jnp.exp(share * jnp.log(self.high / low))
        else:
            value = low + share * (self.high - low)
        return smaller(value, self.high)  # which rounding may exceed

    def share(self, value: Any, low: Any) -> Any:
        """Inverse of ``value``."""
        if self.scale == "log":
            return np.log(value / low) / np.log(self.high / low)
        return (value - low) / (self.high - low)


@dataclasses.dataclass(frozen=True)
class DesignSpace:
    """Structures with the parameters that a search may choose.

    Raises ``ValueError`` if a path or pattern matches no parameter, bounds are outside of what the
    parameter may be, there is no variable, or a rod's τ_f could reach the largest τ_x.

    Parameters
    ----------
    nominal
        The parameters that are not variables, and the default start of a search.
    variables
        Bounds by field path: ``{"friction": (0.05, 1.0), "rod_1.tau_x": Bounds(0.5, 20, "log")}``;
        two numbers are ``Bounds`` of linear scale. In a pattern ``*`` stands for any number or name
        in its place: ``{"links.*.friction": (0.0, 0.5)}`` makes the friction of every link a
        variable; a path goes before a pattern that matches it. Of τ_f and τ_x of
        one rod, τ_x is always the larger: where its lower bound is below τ_f, τ_f is its bound.

    Examples
    --------
    >>> bounds = {"friction": (0.0, 1.0), "rod_1.tau_x": jp.design.Bounds(0.2, 10.0, "log")}
    >>> space = jp.DesignSpace(jp.paper.structures(), bounds)
    >>> space.names
    ('rod_1.tau_x', 'friction')
    >>> round(float(space.structures(np.array([0.5, 0.5])).rod_1.tau_x), 4)
    1.4142
    """

    nominal: Structures
    variables: Mapping[str, Bounds]

    def __post_init__(self) -> None:
        instance("nominal", self.nominal, Structures)
        instance("variables", self.variables, Mapping)
        if not self.variables:
            raise InvalidInput("variables", "{}", "must name a parameter")
        unset = dict.fromkeys(paths(self.nominal))
        bounds = {
            path: _bounds(path, limits, *interval(self.nominal, path, unset))
            for path, limits in expanded(self.nominal, self.variables).items()
        }
        ordered = {path: bounds[path] for path in paths(self.nominal) if path in bounds}
        object.__setattr__(self, "variables", ordered)
        for path in paths(self.nominal):
            below = lower(self.nominal, path)
            if below is not None and {path, below} & ordered.keys():
                largest, ceiling = (
                    ordered[x].high if x in ordered else float(get(self.nominal, x))
                    for x in (below, path)
                )
                if not largest * _APART < ceiling:
                    value = f"{largest:.8g}, as large as it may be,"
                    rule = f"must be below {path.rpartition('.')[2]} = {ceiling:.8g}"
                    raise InvalidInput(below, value, rule)

    @property
    def names(self) -> tuple[str, ...]:
        """Paths of the variables, in the order of the scaled variables."""
        return tuple(self.variables)

    @property
    def dimension(self) -> int:
        """Number d of variables."""
        return len(self.variables)

    def values(self, shares: ArrayLike) -> dict[str, Any]:
        """The variables by path, (...) each, from scaled variables between 0 and 1, (..., d)."""
        values: dict[str, Any] = {}
        for path, share in zip(self.names, jnp.moveaxis(jnp.asarray(shares), -1, 0), strict=True):
            values[path] = self.variables[path].value(share, self._low(path, values))
        return values

    def structures(
        self, shares: Float[Array, " d"], others: Mapping[str, Any] | None = None
    ) -> Any:
        """Structures from scaled variables; ``others`` replace nominal parameters."""
        return put(self.nominal, {**(others or {}), **self.values(shares)})

    def shares(self, design: Structures | Mapping[str, float]) -> np.ndarray:
        """Scaled variables of a design within the bounds, shape (d,): the inverse of ``values``.

        A mapping has every variable and may have patterns, as ``variables``.
        """
        instance("design", design, Structures, Mapping)
        if not isinstance(design, Mapping):
            require_paths(design, self.names)
            values = {path: float(get(design, path)) for path in self.names}
        else:
            if any("*" in path for path in design):
                design = expanded(self.nominal, design)
            if lacking := [path for path in self.names if path not in design]:
                raise InvalidInput("design", "", f"lacks {lacking[0]!r}")
            if others := [path for path in design if path not in self.names]:
                rule = f"has {others[0]!r}, which is none of {', '.join(self.names)}"
                raise InvalidInput("design", "", rule)
            values = {path: float(number(path, design[path])) for path in self.names}
        shares = []
        for path, value in values.items():
            low, high = float(self._low(path, values)), self.variables[path].high
            slack = _SLACK * max(abs(low), abs(high))
            rule = f"between its bounds, {low:.8g} and {high:.8g}"
            enforce([Rule(path, value, low - slack <= value <= high + slack, rule)])
            shares.append(self.variables[path].share(value, low))
        return np.clip(shares, 0.0, 1.0)

    def require_certain(self, uncertain: Iterable[str]) -> None:
        """Refuse uncertain parameters that are variables, bound one or are bounded by one."""
        for path in uncertain:
            if path in self.names:
                raise InvalidInput(path, "", "must not be both chosen and uncertain")
            for other in self.names:
                if path == lower(self.nominal, other) or other == lower(self.nominal, path):
                    raise InvalidInput(other, "", f"must not be chosen where {path} is uncertain")

    def _low(self, path: str, values: Mapping[str, Any]) -> Any:
        """The lower bound, raised to the parameter that bounds this one from below."""
        low, below = self.variables[path].low, lower(self.nominal, path)
        if below is None:
            return low
        return larger(low, _APART * values.get(below, get(self.nominal, below)))


def _bounds(path: str, limits: Any, low: float, high: float) -> Bounds:
    """Bounds, as given or as two numbers, within what a parameter may be."""
    if not isinstance(limits, Bounds):
        if not (isinstance(limits, tuple | list) and len(limits) == 2):
            raise InvalidInput(path, repr(limits), "must be Bounds or (low, high)")
        with renamed(f"{path}: Bounds"):
            limits = Bounds(*limits)
    rules = [
        Rule(f"{path}: low", limits.low, limits.low >= low, f"at least {low:.6g}"),
        Rule(f"{path}: high", limits.high, limits.high <= high, f"at most {high:.6g}"),
    ]
    enforce(rules)
    return limits


def spread_shares(first: np.ndarray, n: int, key: int) -> np.ndarray:
    """Starts of n searches, shape (n, d): the given one, others spread over the space."""
    from scipy.stats import qmc  # only here: it takes a second to import

    power = int(np.ceil(np.log2(max(n - 1, 1))))
    sobol = qmc.Sobol(first.size, rng=np.random.default_rng(key))
    return np.concatenate([first[None], 0.05 + 0.9 * sobol.random_base2(power)[: n - 1]])


def start_shares(space: DesignSpace, start: Structures | Mapping[str, float] | None) -> np.ndarray:
    """Scaled variables of a search's start; a ``ValueError`` outside the bounds."""
    with renamed("start"):
        return space.shares(space.nominal if start is None else start)
