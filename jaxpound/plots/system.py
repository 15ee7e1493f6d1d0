"""A drawing of the mechanical system: two blocks on fractional Zener rods, joined by friction."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Polygon, Rectangle

from jaxpound._errors import InvalidInput
from jaxpound.model.structures import AdjacentStructures
from jaxpound.plots.style import COLOURS, FONT_SIZE, arrow, in_house_style, new_axes, text_at

_LINE = 1.0


@in_house_style
def mechanical_system(structures: AdjacentStructures | None = None, ax: Axes | None = None) -> Axes:
    """The system of eqs. (1) to (5): blocks, rods, damper, gap, ground and the signs of motion.

    Each rod is a spring in parallel with a spring and a springpot (the diamond) in series, which is
    the fractional Zener solid; the damper is two plates pressed together. Forces and motions are
    positive as the arrows show. The dimensionless numbers of ``structures``, a single pair, are
    written beside the symbols.
    """
    if any(np.ndim(leaf) for leaf in jax.tree.leaves(structures)):
        raise InvalidInput("structures", "", "must be a single pair, not a batch")
    ax = new_axes(ax, 2.0, 0.95 if structures is None else 1.2)
    ink = COLOURS["ground"]

    # Ground: a frame that moves with u, on which everything stands.
    ax.plot([0, 0, 20, 20], [5.4, 0.8, 0.8, 5.4], color=ink, linewidth=_LINE)
    for x, width, height in ((-0.6, 21.2, 0.5), (-0.6, 0.6, 5.1), (20, 0.6, 5.1)):
        hatch: Any = {"facecolor": "0.85", "hatch": "////", "edgecolor": "0.6"}
        ax.add_patch(Rectangle((x, 0.3), width, height, **hatch))

    _rod(ax, 0, 5, COLOURS["structure 1"])
    _rod(ax, 20, 15, COLOURS["structure 2"])
    _block(ax, 5, "$m_1$", COLOURS["structure 1"])
    _block(ax, 12, "$m_2$", COLOURS["structure 2"])

    # Damper: a plate on either block, pressed together between them.
    plate: Any = {"color": COLOURS["damper"], "linewidth": 3, "solid_capstyle": "butt"}
    ax.plot([8, 10.7], [3.22, 3.22], **plate)
    ax.plot([9.3, 12], [2.98, 2.98], **plate)
    for start, end in ((4.1, 3.4), (2.1, 2.8)):
        arrow(ax, (10, start), (10, end), COLOURS["damper"], 7, linewidth=0.9)

    # Gap, motions, ground.
    arrow(ax, (8, 1.35), (12, 1.35), ink, 7, "<|-|>", linewidth=0.9)
    for x, name, colour in ((6.5, "$x_1$", "structure 1"), (13.5, "$x_2$", "structure 2")):
        ax.plot([x, x], [4.7, 5.5], color=COLOURS[colour], linewidth=0.6)
        arrow(ax, (x, 5.3), (x + 1.6, 5.3), COLOURS[colour], 7, linewidth=0.9)
        text_at(ax, x + 1.8, 5.3, name, COLOURS[colour], "left")
    arrow(ax, (8.2, -0.3), (10.2, -0.3), ink, 7, linewidth=0.9)
    text_at(ax, 10.4, -0.3, "ground $u(t)$", ink, "left")

    text_at(ax, 10, 1.75, r"$\xi = \xi_0 + x_2 - x_1$", ink)
    text_at(ax, 10, 4.5, r"$q \in \mu\,\mathrm{Sgn}(x_1' - x_2')$", COLOURS["damper"])
    for x, i, order in ((2.5, 1, r"\alpha"), (17.5, 2, r"\beta")):
        symbols = order, rf"\bar\tau_{{f{i}}}", rf"\bar\tau_{{x{i}}}"
        words = rf"$f_{i}:\ " + r",\ ".join(symbols) + "$"
        text_at(ax, x, 4.75, words, COLOURS[f"structure {i}"])
        if structures is not None:
            rod = (structures.rod_1, structures.rod_2)[i - 1]
            lines = map(_equation, symbols, (rod.order, rod.tau_f, rod.tau_x))
            text_at(ax, x, -1.4, "\n".join(lines), COLOURS[f"structure {i}"])
    if structures is not None:
        friction = _equation(r"\mu", structures.friction)
        gap = _equation(r"\xi_0", structures.initial_gap)
        masses = _equation(r"\rho = m_1/m_2", structures.mass_ratio)
        stiffnesses = _equation(r"\varepsilon = k_2/k_1", structures.stiffness_ratio)
        text_at(ax, 10, -1.75, f"{friction},  {gap}\n{masses},  {stiffnesses}", ink)

    low = -0.8 if structures is None else -2.7
    ax.set(xlim=(-0.8, 20.8), ylim=(low, 5.8), aspect="equal")
    ax.set_axis_off()
    return ax


def _equation(symbol: str, number: Any) -> str:
    return f"${symbol} = {float(number):.3g}$"


def _block(ax: Axes, left: float, name: str, colour: str) -> None:
    ax.add_patch(Rectangle((left, 1.15), 3, 3.2, facecolor=colour, alpha=0.25, linewidth=0))
    ax.add_patch(Rectangle((left, 1.15), 3, 3.2, fill=False, edgecolor=colour, linewidth=_LINE))
    text_at(ax, left + 1.5, 2.75, name, colour, fontsize=FONT_SIZE + 3)
    for x in (left + 0.6, left + 2.4):  # rollers
        ax.add_patch(Circle((x, 0.975), 0.175, fill=False, linewidth=0.8))


def _rod(ax: Axes, wall: float, block: float, colour: str) -> None:
    """A spring above; below it, in series, a spring and a springpot."""

    def line(along: list[float], up: list[float]) -> None:
        x = wall + (block - wall) * np.asarray(along)
        ax.plot(x, up, color=colour, linewidth=_LINE, solid_joinstyle="miter")

    line([0, 0.1], [2.75, 2.75])
    line([0.9, 1], [2.75, 2.75])
    line([0.1, 0.1], [1.95, 3.55])
    line([0.9, 0.9], [1.95, 3.55])
    teeth: list[float] = [0.0, *[0.3 * (-1) ** k for k in range(8)], 0.0]

    def spring(start: float, end: float, up: float) -> None:
        along = np.linspace(start + 0.06, end - 0.06, len(teeth)).tolist()
        line([start, *along, end], [up, *(up + tooth for tooth in teeth), up])

    spring(0.1, 0.9, 3.55)
    spring(0.1, 0.5, 1.95)
    line([0.5, 0.58], [1.95, 1.95])
    line([0.82, 0.9], [1.95, 1.95])
    corners = [(0.58, 1.95), (0.7, 2.4), (0.82, 1.95), (0.7, 1.5)]
    diamond = [(wall + (block - wall) * x, y) for x, y in corners]
    ax.add_patch(Polygon(diamond, closed=True, fill=False, edgecolor=colour, linewidth=_LINE))
