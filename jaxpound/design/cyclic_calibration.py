"""Parameters of a law of hysteresis from a measured cyclic test."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound._checks import Rule, enforce, instance, real
from jaxpound._errors import InvalidInput
from jaxpound._tables import Shown, TextTable
from jaxpound.design.least_squares import estimates_table, fitted, spread
from jaxpound.design.space import DesignSpace
from jaxpound.model.system import GROUND, Rod, System
from jaxpound.simulation.cyclic import CyclicTest, cyclic_test
from jaxpound.study.statistics import Estimate


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class CyclicCalibration(Shown):
    """A calibrated law of hysteresis, with confidence intervals of the parameters."""

    law: Any
    """Of the kind of the nominal law."""
    stiffness: float
    """K before yield, in the unit of forces over that of displacements."""
    parameters: dict[str, Estimate]
    """Value and interval by name, from the linearised least squares (Student's t)."""
    correlation: np.ndarray
    """Correlation matrix of the estimates, shape (d, d)."""
    noise: float
    """Standard deviation of the residuals, in the unit of forces."""
    test: CyclicTest
    """The cyclic test of the calibrated law, at the measured displacements."""
    residuals: np.ndarray
    """Measured − calculated force, shape (n,); NaN where nothing was measured."""
    at_bounds: tuple[str, ...]
    """Parameters at a bound: their intervals mean nothing."""
    simulations: int
    """Tests that were calculated, each with its derivatives."""

    def _tables(self) -> list[TextTable]:
        about = self.parameters, self.at_bounds, self.simulations
        noise = TextTable("", (), [("standard deviation of the force", self.noise)])
        return [estimates_table("parameter", *about), noise]


def calibrate_cyclic(
    law: Any,
    bounds: Mapping[str, Any],
    displacements: Any,
    forces: Any,
    stiffness: Any = 1.0,
    *,
    noise: float | None = None,
    starts: int = 4,
    key: int = 0,
    confidence: float = 0.95,
    steps: int = 1,
) -> CyclicCalibration:
    """The parameters of a law of hysteresis that fit a measured cyclic test best.

    Raises ``ValueError`` if an argument breaks its rule, or the measured forces are not more than
    the parameters or do not determine them.

    Parameters
    ----------
    law, stiffness
        ``Bilinear`` or ``BoucWen`` with the parameters that are known, and K: the others start
        here, within their bounds.
    bounds
        Two numbers or ``Bounds`` of each parameter to be found, by name: "stiffness",
        "yield_displacement", "hardening", "exponent" and so on.
    displacements, forces
        Measured, shape (n,) each; forces are NaN where nothing was measured.
    noise, starts, key, confidence
        As in ``calibrate``; ``noise`` is of the forces.
    steps
        As in ``cyclic_test``, for displacements that were measured far apart.

    Examples
    --------
    >>> turns = np.concatenate([np.linspace(a, b, 30) for a, b in ((0, 0.3), (0.3, -0.3))])
    >>> measured = jp.cyclic_test(jp.Bilinear(0.1, 0.05), turns, 5.0, steps=1).force
    >>> bounds = {"stiffness": (1.0, 20.0), "yield_displacement": (0.02, 0.2)}
    >>> fit = jp.calibrate_cyclic(jp.Bilinear(0.05, 0.05), bounds, turns, measured, stiffness=2.0)
    >>> round(fit.stiffness, 4), round(fit.law.yield_displacement, 4)
    (5.0, 0.1)
    """
    owner, rod = "calibrate_cyclic", "rods.0."
    instance(owner, "bounds", bounds, Mapping)
    x, f = (
        np.asarray(real(owner, name, values), float)
        for name, values in (("displacements", displacements), ("forces", forces))
    )
    if f.shape != x.shape:
        rule = f"of shape {f.shape} must be {x.shape}, as displacements"
        raise InvalidInput(owner, "forces", "", rule)
    enforce(owner, [Rule("forces", f, ~np.isinf(f), "finite, or NaN for no number")])
    nominal = System((1.0,), (Rod(law, stiffness, (0, GROUND)),))
    cyclic_test(law, x, stiffness, steps)  # refuses what is wrong with them
    paths = {name: rod + ("" if name == "stiffness" else "material.") + name for name in bounds}
    space = DesignSpace(nominal, {paths[name]: limits for name, limits in bounds.items()})

    def test(shares: Any) -> CyclicTest:
        tested = space.structures(shares).rods[0]
        every = cyclic_test(tested.material, x, tested.stiffness, steps)
        return jax.tree.map(lambda y: y[::steps], every)

    fit = fitted(
        owner,
        space,
        lambda shares: {"force": test(shares).force},
        {"force": f},
        noise=None if noise is None else {"force": noise},
        start=None,
        starts=starts,
        key=key,
        confidence=confidence,
    )
    best, calculated = space.structures(jnp.asarray(fit.shares)).rods[0], test(fit.shares)
    residuals = f - np.asarray(calculated.force)
    names = {path: name for name, path in paths.items()}
    return CyclicCalibration(
        law=jax.tree.map(float, best.material),
        stiffness=float(best.stiffness),
        parameters={names[path]: estimate for path, estimate in fit.parameters.items()},
        correlation=fit.correlation,
        noise=spread(residuals[np.isfinite(f)]),
        test=calculated,
        residuals=residuals,
        at_bounds=tuple(names[path] for path in fit.at_bounds),
        simulations=fit.runs,
    )
