"""What the figures of a design show: its own numbers, with units."""

from types import SimpleNamespace

import numpy as np
import pytest

import jaxpound as jp
from jaxpound.plots import designs as plots
from tests.design.test_design import (
    ENSEMBLE,
    GRID,
    IN_SI,
    SPACE,
    START_IN_SI,
    bowl,
    search,
    stand_in,
)
from tests.plots.runs import legend, new_axes

assert stand_in  # a fixture


@pytest.fixture
def limited(stand_in):
    return search(jp.Objective(limits={"damper_force": 0.5}), iterations=60)


def test_convergence_has_a_line_for_every_start(limited, ax, legible):
    assert plots.convergence(limited, ax) is ax
    (named,) = (line for line in ax.lines if line.get_label() == "winner")
    history, winner = limited.history, limited.winner
    inside = history.violation[:, winner] <= 1e-3
    expected = np.where(inside, history.objective[:, winner], np.nan)
    np.testing.assert_array_equal(named.get_ydata(), expected)
    assert len(ax.lines) == 2 * 3 + 2
    assert legend(ax) == ["winner", "other starts", "thin: limit exceeded"]
    legible(ax.figure, ax.get_legend().texts)
    ax = plots.convergence(search(iterations=3), new_axes())
    assert legend(ax) == ["winner", "other starts"]


def test_landscape_has_the_path_and_the_design_within_its_limit(limited, ax):
    plots.landscape(limited, ax, limited.landscape("friction", "mass_ratio", 9))
    path, _, design = ax.lines[:3]
    start = limited.space.values(limited.history.shares[0, limited.winner])
    assert path.get_xdata()[0] == pytest.approx(float(start["friction"]))
    assert design.get_ydata()[0] == pytest.approx(limited.values["mass_ratio"])
    assert ax.get_xlabel() == r"friction $\mu$"
    assert "limit exceeded" in ax.get_legend_handles_labels()[1]
    ax = plots.landscape(limited, new_axes(), n=5)
    assert {ax.get_xlabel(), ax.get_ylabel()} == {r"mass ratio $\rho$", r"friction $\mu$"}
    seen = limited.landscape("friction", "mass_ratio", 6)
    friction, ratio = limited.values["friction"], limited.values["mass_ratio"]
    excess = 0.5 * (seen.x_values / friction) ** 8
    ax = plots.landscape(limited, new_axes(), seen._replace(violation=excess / 0.5 - 1))
    ax.figure.canvas.draw()
    (shaded,) = (c for c in ax.collections if "limit" not in str(c.get_label()) and c.get_fill())
    paths = [path for path in shaded.get_paths() if len(path)]
    assert not any(path.contains_point((friction, ratio)) for path in paths)
    assert any(path.contains_point((1.2 * friction, ratio)) for path in paths)


def test_before_and_after_are_distributions_and_a_front_its_prices_and_objectives(stand_in, ax):
    found = search(iterations=40)
    plots.before_and_after(found.trained, ax)
    for line, when in zip(ax.lines, (found.trained.before, found.trained.after), strict=True):
        np.testing.assert_array_equal(line.get_xdata(), np.sort(when["min_gap"]))
        assert line.get_ydata()[-1] == 1
    assert max(ax.get_yticks()) <= 1
    stand_in(lambda mu, rho, a: bowl(mu, rho, a) - 0.9)
    ax = plots.before_and_after(search(iterations=40).trained, new_axes())
    assert any(label.startswith("pounding") for label in ax.get_legend_handles_labels()[1])
    more = {"limited_demand": "damper_force", "limits": [0.5, 0.3]}
    more["search"] = jp.DesignSearch(starts=2, iterations=40)
    front = jp.pareto_front(SPACE, ENSEMBLE, GRID, **more)
    ax = plots.pareto(front, new_axes())
    x, y = ax.lines[0].get_data()
    np.testing.assert_array_equal(x, front.limited_demands)
    np.testing.assert_array_equal(y, front.objectives)
    assert ax.get_xlabel() == "slip force, mean ($m_1 g$)"


@pytest.mark.filterwarnings("ignore::jaxpound.PlausibilityWarning")
def test_units_are_those_of_the_design_and_its_buildings(stand_in, ax):
    in_si = search(space=IN_SI, start=START_IN_SI, iterations=3)
    probable = search(jp.Objective(jp.PoundingProbability(1.0)), iterations=3)
    for design, label in ((in_si, "objective (m)"), (probable, "objective")):
        assert plots.convergence(design, new_axes()).get_ylabel() == label
    ax = plots.before_and_after(in_si.trained, new_axes(), "damper_force")
    assert ax.get_xlabel() == "slip force (N)"
    blocks = [jp.Building.from_period(5e5, period, 0.05) for period in (0.9, 0.6)]
    pair = jp.Buildings(tuple(blocks), (jp.FloorLink(0, 0, friction=1e5, gap=0.05),))
    bounds = {"links.0.friction": (0.0, 400e3), "links.0.gap": (0.02, 0.2)}
    space = jp.DesignSpace(pair, bounds)
    for where, name, high, expected in (
        (space, "links.0.friction", 400e3, (1e-3, "link 1: friction (kN)")),
        (space, "links.0.gap", 0.2, (1.0, "link 1: gap at rest (m)")),
        (SPACE, "friction", 1.0, (1.0, r"friction $\mu$")),
    ):
        assert plots._variable_axis(SimpleNamespace(space=where), name, high) == expected


def test_tornado_has_the_largest_on_top(ax):
    sizes = {"initial_gap": 1.4, "friction": 0.1, "rod_2.order": 0.2, "mass_ratio": -0.3}
    found = jp.design.Elasticities("min_gap", 0.7, dict.fromkeys(sizes, 1.0), sizes)
    plots.tornado(found, ax)
    widths = [bar.get_width() for bar in ax.patches]
    assert widths == sorted(found.values.values(), key=abs)
    assert ax.get_yticklabels()[-1].get_text() == r"gap at rest $\xi_0$"
    assert ax.get_xlabel() == "% of min gap $\\xi$\nper % of the parameter"
