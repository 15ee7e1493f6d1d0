"""Figures over height: each value stands at its floor or over its storey, in the unit named."""

import dataclasses
from functools import partial

import jax
import numpy as np
import pytest

import jaxpound as jp
from jaxpound import plots
from jaxpound.plots.style import COLOURS, shades
from jaxpound.results.floors import FloorDemands
from tests.plots.runs import legend, new_axes
from tests.refusals import refusals

QUANTITIES = ("displacement", "drift", "acceleration", "shear", "contact_left", "contact_right")


def floors(n, building=0, contact=True, si=True):
    """Demands that no run made: of quantity q at floor i they are q + 1 + i/10."""
    values = {name: q + 1 + np.arange(n) / 10 for q, name in enumerate(QUANTITIES)}
    if not contact:
        values |= dict.fromkeys(QUANTITIES[4:], np.zeros(n))
    return FloorDemands(building=building, masses=tuple(range(n)), **values, si=si)


def test_a_demand_that_only_some_runs_have_is_drawn_for_all_of_them(ax):
    """The elastic run, which has no ductility, may come first: it is grey."""
    weak = dataclasses.replace(floors(2), ductility=np.array([1.5, 0.5]))
    for runs in ({"elastic": floors(2), "weak": weak}, {"weak": weak, "elastic": floors(2)}):
        drawn = plots.envelope({name: (run,) for name, run in runs.items()}, "ductility", ax=ax)
        assert len(drawn.lines) >= 2
        ax.clear()


TOUCHING = {"contact_left": np.array([7.0, 0.0, 1.0]), "contact_right": np.array([2.0, 0.0, 5.0])}


def test_demands_of_a_floor_stand_where_they_are(ax):
    plots.envelope((floors(3),), "acceleration", [[3.0, 6.5, 10.0]], ax)
    (line,) = ax.lines
    np.testing.assert_allclose(line.get_xydata(), [(3.0, 3.0), (3.1, 6.5), (3.2, 10.0)])
    assert line.get_color() == COLOURS["structure 1"]
    assert ax.get_xlabel() == "absolute acceleration\npeak $|a|$ (m/s²)"
    assert ax.get_ylabel() == "height (m)"
    touching = dataclasses.replace(floors(3), **TOUCHING)
    # Zero at the ground; constant over a storey; the larger of both sides, where it acts.
    for demands, quantity, elevations, points in (
        (floors(2), "displacement", None, [(0, 0), (1.0, 1), (1.1, 2)]),
        (floors(2), "drift", [[3.0, 7.0]], [(2.0, 0), (2.0, 3), (2.1, 3), (2.1, 7)]),
        (floors(2), "shear", [[3.0, 7.0]], [(4.0, 0), (4.0, 3), (4.1, 3), (4.1, 7)]),
        (touching, "contact", None, [(7.0, 1.0), (5.0, 3.0)]),
    ):
        ax = plots.envelope((demands,), quantity, elevations, new_axes())
        np.testing.assert_array_equal(ax.lines[0].get_xydata(), points)
        assert ax.get_ylabel() == ("floor" if elevations is None else "height (m)")


def test_a_batch_is_a_median_and_a_band_and_forces_are_in_the_unit_of_their_label(ax):
    rng = np.random.default_rng(1)
    runs = jax.tree.map(lambda x: x * rng.lognormal(size=(2, 20, 1)), floors(2))
    broken = jax.tree.map(lambda x: np.concatenate([x, np.full((2, 1, 2), np.nan)], 1), runs)
    plots.envelope((broken,), "acceleration", ax=ax)
    values = runs.acceleration.reshape(-1, 2)
    low, middle, high = np.quantile(values, [0.16, 0.5, 0.84], axis=0)
    np.testing.assert_allclose(ax.lines[0].get_xdata(), middle)
    (band,) = ax.collections
    corners = band.get_paths()[0].vertices[:, 0]
    assert (corners.min(), corners.max()) == pytest.approx((low.min(), high.max()))
    assert 0 == ax.get_xlim()[0] < high.max() < ax.get_xlim()[1]
    strong = dataclasses.replace(floors(2), shear=np.array([3e6, 2e6]))
    ax = plots.envelope((strong,), "shear", ax=new_axes())
    assert ax.get_xlabel().endswith("(kN)")
    assert ax.lines[0].get_xdata()[0] == pytest.approx(3000.0)
    dimensionless = plots.envelope((floors(2, si=False),), "shear", ax=new_axes())
    assert dimensionless.get_xlabel().endswith("($m_1 g$)")


def drawn_heights(ax):
    """Where the points or steps of each line stand on the page."""
    return [ax.transData.transform(line.get_xydata())[:, 1] for line in ax.lines]


def test_floors_of_all_buildings_align_and_drift_is_that_of_the_table():
    """Two buildings whose first two floors are at the same heights, which therefore collide."""
    both = floors(4), floors(2, 1)
    elevations = [[3.0, 6.0, 9.0, 12.0], [3.0, 6.0]]
    figure = plots.envelopes(both, elevations, labels=["a", "b"])
    figure.draw_without_rendering()
    assert [text.get_text() for text in figure.legends[0].texts] == ["a", "b"]
    assert figure.axes[0].get_ylabel() == "height (m)"
    for ax in figure.axes[:-1]:
        high, low = drawn_heights(ax)
        np.testing.assert_allclose(low, high[: low.size])
        assert [line.get_color() for line in ax.lines] == [
            COLOURS[f"structure {b}"] for b in (1, 2)
        ]
    forces = [line.get_ydata() for line in figure.axes[-1].lines]  # beside those at their height
    np.testing.assert_allclose(forces[1], forces[0][:2] - 0.36)
    for ax in figure.axes:
        ticks = [x for x in ax.get_xticks() if 0 <= x <= ax.get_xlim()[1]]
        assert len(ticks) >= 3
    heights = dataclasses.replace(both[0], heights=(3.0,) * 4)
    (ratio,) = [ax for ax in plots.envelopes((heights,)).axes if "%" in ax.get_xlabel()]
    assert ratio.get_xlabel() == "storey drift\npeak $|d|/h$ (%)"
    np.testing.assert_allclose(ratio.lines[0].get_xdata()[::2], 100 * heights.drift_ratio)
    compared = plots.envelopes({"with": both, "without": both}, elevations)
    assert len({ax.get_ylim() for ax in compared.axes}) == 1
    compared.draw_without_rendering()
    assert np.ptp([ax.get_window_extent().height for ax in compared.axes]) < 0.01


def test_runs_are_compared_by_name_in_a_row_for_each_building():
    without = plots.envelopes((floors(4, contact=False), floors(2, 1, contact=False)))
    assert len(without.axes) == 4
    runs = {name: (floors(3), floors(2, 1)) for name in ("without", "with")}
    figure = plots.envelopes(runs, [[3.0, 6.0, 9.0], [4.0, 8.0]])
    assert [text.get_text() for text in figure.legends[0].texts] == list(runs)
    for ax in figure.axes:
        assert [line.get_color() for line in ax.lines] == shades(2)
    assert figure.axes[0].get_ylabel() == "building 1\nheight (m)"
    ax = plots.envelope({"a": (floors(3),), "b": (floors(3),)}, ax=new_axes())
    assert legend(ax) == ["a", "b"]
    # With and without contact; a warning of a layout that cannot be made would be an error.
    figure = plots.envelopes({"alone": (floors(3, contact=False),), "with": (floors(3),)})
    figure.draw_without_rendering()
    assert [line.get_color() for line in figure.axes[-1].lines] == [shades(2)[1]]


def test_ductility_is_that_of_the_buildings_that_yield(ax):
    yielding = dataclasses.replace(floors(2, 1, contact=False), ductility=np.array([3.0, 0.5]))
    low = dataclasses.replace(floors(1), ductility=np.array([4.0]))
    row = (floors(3, 0, contact=False), yielding, low)
    heights = [[3.0, 6.0, 9.0], [4.0, 8.0], [3.0]]
    assert plots.envelope(row, "ductility", heights, ax) is ax
    lines = [line for line in ax.lines if not line.get_label().startswith("_")]
    np.testing.assert_array_equal(lines[0].get_xydata(), [(3, 0), (3, 4), (0.5, 4), (0.5, 8)])
    np.testing.assert_array_equal(lines[1].get_xydata(), [(4, 0), (4, 3)])
    assert legend(ax) == ["building 2", "building 1"]
    assert ax.get_xlim() == (0, 1.08 * 4)
    assert ax.get_xlabel() == "ductility\npeak $\\mu$"
    figure = plots.envelopes(row[:2], heights[:2])
    assert len(figure.axes) == 5  # the last of the building that yields alone
    assert len(plots.envelopes(row[:1]).axes) == 4


@pytest.mark.parametrize("n_floors", [(1,), (3, 2, 3), (10, 10)])
def test_no_label_touches_another(n_floors, legible):
    demands = tuple(floors(n, b) for b, n in enumerate(n_floors))
    figure = plots.envelopes(demands, [3.0 * np.arange(1, n + 1) for n in n_floors])
    figure.draw_without_rendering()
    texts = []
    for axis in (axis for ax in figure.axes for axis in (ax.xaxis, ax.yaxis)):
        low, high = axis.get_view_interval()
        ticks = [tick for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
        drawn = [tick.label1 for tick in ticks if tick.label1.get_visible()]
        texts += [text for text in (axis.label, *drawn) if text.get_text()]
    assert len(texts) > 8
    legible(figure, texts)


ONE, TWO = floors(1), floors(2)
LOST = jax.tree.map(lambda x: x * np.nan, TWO)
AT, OF_FLOORS = r"envelope: elevations\[0\]", "must be the heights of 2 floors above the ground"
BUILDINGS = "floors to be compared must be of the same buildings"
LAST = r"envelopes: elevations\[1\] = \[nan\] must be the heights of 1 floor above"
ROD = jp.Rod(jp.ZenerRod(order=0.5, tau_f=0.01, tau_x=0.05), 5.0)

at_heights = partial(plots.envelope, (TWO,), "drift")
test_wrong_arguments_are_refused = refusals(
    (plots.envelopes, {}, "envelopes: floors must hold at least one run"),
    (plots.envelopes, (), r"envelopes: floors = \(\) must hold at least one building"),
    (plots.envelopes, (3,), r"envelopes: floors\[0\] = 3 must be of type FloorDemands"),
    (plots.envelope, TWO, r"envelope: floors = Building 1.* must be of type Sequence"),
    (plots.envelope, (TWO,), "drfit", "quantity = 'drfit' must be .*drift"),
    (at_heights, [[6.0, 3.0]], rf"{AT} = \[6.0, 3.0\] {OF_FLOORS}"),
    (at_heights, [[3.0, np.inf]], rf"{AT} = \[3.0, inf\] must be .*, finite, from the lowest up"),
    (at_heights, [["3 m", "6 m"]], rf"{AT} = \['3 m', '6 m'\] must be a real number"),
    (plots.envelopes, (TWO,), [[3.0], [3.0]], "elevations, 2 of them, must be"),
    (plots.envelopes, (ONE,), 3.0, "envelopes: elevations = 3.0 must be one for"),
    (plots.envelopes, (TWO, floors(1, 1)), [[3.0, 6.0], [np.nan]], LAST),
    (lambda: plots.envelopes((TWO,), labels=[]), "labels, 0 of them, must be one for"),
    (plots.envelopes, {"a": (TWO,), "b": (floors(3),)}, BUILDINGS),
    (plots.envelope, {"a": (TWO,), "b": (floors(2, si=False),)}, "all in SI units or all dimen"),
    (plots.envelope, {"a": (ONE, TWO), "b": (ONE, TWO)}, "must be of one building; envelopes"),
    (plots.envelope, (TWO,), "ductility", "envelope: floors must be of a building with a ductil"),
    (plots.envelopes, (LOST,), r"envelopes: the run is invalid \(NaN\)"),
    (plots.mode_shapes, jp.Storeys((1.0,), ROD), 0, "mode_shapes: n = 0 must be"),
    (plots.mode_shapes, jp.paper.structures(), "must be of type Storeys"),
)


def test_mode_shapes_have_their_top_to_the_right_over_heights_or_floors(ax):
    building = jp.ShearBuilding.from_period(4, 300e3, period=0.6, damping_ratio=0.05, height=3.5)
    plots.mode_shapes(building, 2, ax)
    for line, shape in zip(ax.lines[:2], building.modes().shapes.T.real, strict=False):
        np.testing.assert_allclose(line.get_xdata()[1:], shape * np.sign(shape[-1]))
        np.testing.assert_array_equal(line.get_ydata(), [0, 3.5, 7, 10.5, 14])
    assert legend(ax)[0] == r"mode 1: $T$ = 0.599 s, $\zeta$ = 5.1 %"
    assert len(legend(ax)) == 2
    assert ax.get_ylabel() == "height (m)"
    ax = plots.mode_shapes(jp.Storeys((1.0, 1.0), ROD), ax=new_axes())  # of which there are two
    assert len(legend(ax)) == 2
    assert r"$/\omega_1$, " in legend(ax)[0]
    np.testing.assert_array_equal(ax.lines[0].get_ydata(), [0, 1, 2])
    tall, low = (jp.ShearBuilding.from_period(n, 2e5, 0.2 * n, 0.05, height=3.0) for n in (3, 2))
    ax = plots.mode_shapes(jp.Buildings((tall, low)), 2, new_axes())
    names = [f"building {b}, mode {j}" for b in (1, 2) for j in (1, 2)]
    assert [words.partition(":")[0] for words in legend(ax)] == names
    assert legend(ax)[2].startswith("building 2, mode 1: $T$ = 0.399 s")
    np.testing.assert_allclose(ax.lines[2].get_ydata(), [0.0, 3.0, 6.0])
    assert ax.get_ylabel() == "height (m)"
    block = jp.Building.from_period(mass=5e5, period=0.9, damping_ratio=0.05)
    ax = plots.mode_shapes(jp.Buildings((block,)), ax=new_axes())
    assert legend(ax)[0].startswith("mode 1: $T$ = 0.899 s")
    assert ax.get_ylabel() == "floor"
