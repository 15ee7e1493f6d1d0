"""Figures of rods and buildings that yield: cyclic tests, and pushover curves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from jaxpound._checks import instance, real
from jaxpound._errors import InvalidInput
from jaxpound.model.pushover import pushover as pushed_over
from jaxpound.model.shear_building import ShearBuilding
from jaxpound.plots import style as house
from jaxpound.plots.style import COLOURS, in_house_style, label, new_axes
from jaxpound.simulation.cyclic import CyclicTest


@in_house_style
def cyclic_test(
    test: CyclicTest, measured: Any = None, ax: Axes | None = None, *, si: bool = True
) -> Axes:
    """Force over displacement of a cyclic test, over what was measured.

    ``measured`` are forces, shape (n,), at the displacements of the test, or a pair of
    displacements and forces. Lengths are in m and forces in N, or dimensionless without ``si``.
    A ``ValueError`` if the test is a batch, or the numbers measured are of other shapes.

    Examples
    --------
    >>> from jaxpound import plots
    >>> test = jp.cyclic_test(jp.BoucWen(0.02, 0.05), [0.0, 0.06, -0.06, 0.06], stiffness=2e6)
    >>> plots.cyclic_test(test).get_ylabel()
    'force $f$ (kN)'
    """
    instance("cyclic_test", "test", test, CyclicTest)
    if np.ndim(test.force) != 1:
        raise InvalidInput("cyclic_test", "test", "", "must be a single one, not a batch")
    ax = new_axes(ax)
    factor, up = house.with_unit("force $f$", "force", si, float(np.abs(test.force).max()))
    if measured is not None:
        pair = measured if isinstance(measured, tuple) else (test.displacement, measured)
        x, f = (np.asarray(real("cyclic_test", "measured", y)) for y in pair)
        if x.shape != f.shape:
            rule = f"of shape {f.shape} must be {x.shape}, as displacements"
            raise InvalidInput("cyclic_test", "measured", "", rule)
        ax.plot(x, factor * f, ".", markersize=3, color=COLOURS["residual"], label="measured")
    ax.plot(test.displacement, factor * test.force, color=COLOURS["rods"], label="law")
    label(ax, house.with_unit("displacement $e$", "length", si)[1], up)
    if measured is not None:
        house.legend(ax)
    return ax


@in_house_style
def pushover(
    buildings: ShearBuilding | Mapping[str, ShearBuilding],
    ductility: float = 6.0,
    loads: str = "height",
    ax: Axes | None = None,
) -> Axes:
    """Base shear over roof displacement under growing static loads (``jp.pushover``).

    A point marks where a storey yields; of a single building with its number, or how many yield
    there. ``buildings`` are one, or several by name; ``ductility`` and ``loads`` are those of
    ``jp.pushover``, which says what is refused.

    Examples
    --------
    >>> from jaxpound import plots
    >>> frame = jp.ShearBuilding.from_period(5, 300e3, period=0.6, damping_ratio=0.05)
    >>> weak = frame.yielding(yield_force=2e6, hardening=0.03)
    >>> ax = plots.pushover({"without weight": weak, "with weight": weak.with_p_delta()})
    """
    runs = dict(buildings) if isinstance(buildings, Mapping) else {"": buildings}
    if not runs:
        raise InvalidInput("pushover", "buildings", "{}", "must hold at least one building")
    curves = {name: pushed_over(building, ductility, loads) for name, building in runs.items()}
    ax = new_axes(ax)
    strongest = max(float(curve.base_shear.max()) for curve in curves.values())
    factor, up = house.with_unit("base shear $V$", "force", True, strongest)
    for b, (name, curve) in enumerate(curves.items()):
        colour, x, y = house.building_colour(b), curve.roof_displacement, factor * curve.base_shear
        ax.plot(x, y, color=colour, label=name)
        at = sorted((i, storey) for storey, i in enumerate(curve.yields, 1) if i is not None)
        ax.plot(*([z[i] for i, _ in at] for z in (x, y)), "o", color=colour, markersize=4)
        while at and len(runs) == 1:
            near = [storey for i, storey in at if x[i] - x[at[0][0]] < 0.25 * x.max()]
            i, at = at[len(near) - 1][0], at[len(near) :]
            words = f"{len(near)} storeys"
            if len(near) < 4:
                words = f"storey {', '.join(map(str, near))}"
            right = x[i] > 0.75 * x.max()
            style: Any = {"textcoords": "offset points", "ha": "right" if right else "left"}
            ax.annotate(words, (x[i], y[i]), (3, -6), va="top", color=colour, **style)
    ax.set(xlim=(0, None), ylim=(0, None))
    label(ax, house.with_unit("roof displacement", "length", True)[1], up)
    if len(runs) > 1:
        house.legend(ax, bottom=0.0)
    return ax
