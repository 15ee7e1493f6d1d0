"""Figures of rods and buildings that yield: cyclic tests and pushover."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from jaxpound._checks import array, instance
from jaxpound.model.capacity_curve import pushover as pushed_over
from jaxpound.model.shear_building import ShearBuilding
from jaxpound.plots import style as house
from jaxpound.plots.style import COLOURS, in_house_style, label, new_axes
from jaxpound.study.rod_tests import CyclicTest


@in_house_style
def cyclic_test(
    test: CyclicTest, measured: Any = None, ax: Axes | None = None, *, si: bool = True
) -> Axes:
    """Force over displacement of a single cyclic test, in N and m, or dimensionless without ``si``.

    ``measured`` are forces at its displacements, shape (n,); a ``ValueError`` for another shape.
    """
    instance("test", test, CyclicTest)
    ax, x, series = new_axes(ax), test.displacement, dict[str, Any]()
    if measured is not None:
        series["measured"] = array("measured", measured, x.shape)
    series["law"] = test.force
    factor, up = house.with_unit("force $f$", "force", si, float(np.abs(test.force).max()))
    for name, force in series.items():
        style, colour = ("-", "rods") if name == "law" else (".", "residual")
        ax.plot(x, factor * force, style, markersize=3, color=COLOURS[colour], label=name)
    label(ax, house.with_unit("displacement $e$", "length", si)[1], up)
    if measured is not None:
        house.legend(ax)
    return ax


@in_house_style
def pushover(building: ShearBuilding, ductility: float = 6.0, ax: Axes | None = None) -> Axes:
    """Base shear over roof displacement of a building, by ``jp.pushover``; errors are its own.

    Points mark where a storey yields. In the axes of another building the colour is the next one.
    """
    curve = pushed_over(building, ductility)
    x, y, ax = curve.drifts.sum(1), curve.base_shear / 1e3, new_axes(ax)
    at = curve.yields[curve.yields >= 0]
    (line,) = ax.plot(x, y)
    ax.plot(x[at], y[at], "o", color=line.get_color(), markersize=4)
    for edges in (line.sticky_edges.x, line.sticky_edges.y):  # no margin at 0, where curves start
        edges.append(0.0)
    label(ax, "roof displacement (m)", "base shear $V$ (kN)")
    return ax
