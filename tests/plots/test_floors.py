"""Figures over height: each value stands at its floor or over its storey, in the unit named."""

import dataclasses
import itertools
import warnings

import jax
import numpy as np
import pytest
from matplotlib.figure import Figure

import jaxpound as jp
from jaxpound import plots
from jaxpound.plots.style import COLOURS, shades
from jaxpound.quantities import STANDARD_GRAVITY
from jaxpound.results.floors import FloorDemands

QUANTITIES = ("displacement", "drift", "acceleration", "shear", "contact_left", "contact_right")


def floors(n, building=0, contact=True, si=True, shape=()):
    """Demands that no run made: of quantity q at floor i they are q + 1 + i/10."""
    values = {
        name: np.ones((*shape, 1)) * (q + 1 + np.arange(n) / 10)
        for q, name in enumerate(QUANTITIES)
    }
    if not contact:
        values |= dict.fromkeys(QUANTITIES[4:], np.zeros((*shape, n)))
    return FloorDemands(building=building, masses=tuple(range(n)), **values, si=si)


def test_a_floor_s_demand_stands_at_its_height(ax):
    plots.envelope(floors(3), "acceleration", [3.0, 6.5, 10.0], ax)
    (line,) = ax.lines
    in_g = np.array([3.0, 3.1, 3.2]) / STANDARD_GRAVITY
    np.testing.assert_allclose(line.get_xydata(), np.stack([in_g, [3.0, 6.5, 10.0]], 1))
    assert line.get_color() == COLOURS["structure 1"]
    assert ax.get_xlabel() == "absolute acceleration\npeak $|a|$ ($g$)"
    assert ax.get_ylabel() == "height (m)"


def test_displacement_is_zero_at_the_ground(ax):
    plots.envelope(floors(2), "displacement", ax=ax)
    np.testing.assert_array_equal(ax.lines[0].get_xydata(), [(0, 0), (1.0, 1), (1.1, 2)])
    assert ax.get_ylabel() == "floor"


@pytest.mark.parametrize(("quantity", "value"), [("drift", 2.0), ("shear", 4.0)])
def test_a_storey_s_demand_is_constant_over_it(quantity, value, ax):
    plots.envelope(floors(2), quantity, [3.0, 7.0], ax)
    stairs = [(value, 0), (value, 3), (value + 0.1, 3), (value + 0.1, 7)]
    np.testing.assert_array_equal(ax.lines[0].get_xydata(), stairs)


def test_contact_is_the_larger_of_both_sides_and_only_where_it_acts(ax):
    one = floors(3)
    left, right = np.array([7.0, 0.0, 1.0]), np.array([2.0, 0.0, 5.0])
    one = dataclasses.replace(one, contact_left=left, contact_right=right)
    plots.envelope(one, "contact", ax=ax)
    np.testing.assert_array_equal(ax.lines[0].get_xydata(), [(7.0, 1.0), (5.0, 3.0)])


def test_a_batch_is_a_median_and_a_band_of_its_valid_runs(ax):
    rng = np.random.default_rng(1)
    runs = jax.tree.map(lambda x: x * rng.lognormal(size=(2, 20, 1)), floors(2))
    broken = jax.tree.map(lambda x: np.concatenate([x, np.full((2, 1, 2), np.nan)], 1), runs)
    plots.envelope(broken, "acceleration", ax=ax)
    values = runs.acceleration.reshape(-1, 2) / STANDARD_GRAVITY
    low, middle, high = np.quantile(values, [0.16, 0.5, 0.84], axis=0)
    np.testing.assert_allclose(ax.lines[0].get_xdata(), middle)
    (band,) = ax.collections
    corners = band.get_paths()[0].vertices[:, 0]
    assert corners.min() == pytest.approx(low.min())
    assert corners.max() == pytest.approx(high.max())
    assert ax.get_xlim()[0] == 0
    assert ax.get_xlim()[1] > high.max()


def test_forces_are_drawn_in_the_unit_they_are_labelled_with(ax):
    strong = dataclasses.replace(floors(2), shear=np.array([3e6, 2e6]))
    plots.envelope(strong, "shear", ax=ax)
    assert ax.get_xlabel().endswith("(kN)")
    assert ax.lines[0].get_xdata()[0] == pytest.approx(3000.0)
    dimensionless = Figure().add_subplot()
    plots.envelope(floors(2, si=False), "shear", ax=dimensionless)
    assert dimensionless.get_xlabel().endswith("($m_1 g$)")


def test_envelopes_have_a_row_for_each_building_and_a_scale_for_each_quantity():
    figure = plots.envelopes((floors(4), floors(2, 1), floors(3, 2)), labels=["a", "b", "c"])
    panels = np.reshape(figure.axes, (3, 5))
    for row, name, colour in zip(panels, "abc", ("structure 1", "structure 2", None), strict=True):
        assert row[0].get_ylabel() == f"{name}\nfloor"
        if colour:
            assert {line.get_color() for ax in row for line in ax.lines} == {COLOURS[colour]}
    for column in panels.T:
        assert len({ax.get_xlim() for ax in column}) == 1
        assert [bool(ax.get_xlabel()) for ax in column] == [False, False, True]
    assert panels[-1, -1].get_xlabel().startswith("contact force")
    without = plots.envelopes((floors(4, contact=False), floors(2, 1, contact=False)))
    assert len(without.axes) == 8
    assert without.axes[4].get_ylabel() == "building 2\nfloor"


def test_runs_with_and_without_contact_are_compared():
    runs = {"alone": (floors(3, contact=False),), "with": (floors(3),)}
    figure = plots.envelopes(runs)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # of a layout that cannot be made
        figure.draw_without_rendering()
    assert [line.get_color() for line in figure.axes[-1].lines] == [shades(2)[1]]


def test_runs_are_compared_by_name():
    runs = {name: (floors(3), floors(2, 1)) for name in ("without", "with")}
    figure = plots.envelopes(runs, [[3.0, 6.0, 9.0], [4.0, 8.0]])
    assert [text.get_text() for text in figure.legends[0].texts] == list(runs)
    for ax in figure.axes:
        assert [line.get_color() for line in ax.lines] == shades(2)
    assert figure.axes[0].get_ylabel() == "building 1\nheight (m)"
    ax = plots.envelope({"a": floors(3), "b": floors(3)}, ax=Figure().add_subplot())
    assert [text.get_text() for text in ax.get_legend().texts] == ["a", "b"]


@pytest.mark.parametrize("n_floors", [(1,), (3, 2, 3), (10, 10)])
def test_no_label_touches_another(n_floors):
    demands = tuple(floors(n, b) for b, n in enumerate(n_floors))
    figure = plots.envelopes(demands, [3.0 * np.arange(1, n + 1) for n in n_floors])
    figure.draw_without_rendering()
    boxes = []
    for ax in figure.axes:
        texts = [text for text in (ax.xaxis.label, ax.yaxis.label) if text.get_text()]
        for axis in (ax.xaxis, ax.yaxis):
            low, high = axis.get_view_interval()
            drawn = [
                tick.label1 for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high
            ]
            texts += [text for text in drawn if text.get_visible() and text.get_text()]
        boxes += [text.get_window_extent() for text in texts]
    assert len(boxes) > 8
    assert not any(a.overlaps(b) for a, b in itertools.combinations(boxes, 2))
    for box in boxes:
        assert figure.bbox.x0 <= box.x0 <= box.x1 <= figure.bbox.x1
        assert figure.bbox.y0 <= box.y0 <= box.y1 <= figure.bbox.y1


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: plots.envelopes({}), "envelopes: floors must hold at least one run"),
        (lambda: plots.envelopes(()), r"envelopes: floors = \(\) must hold at least one building"),
        (lambda: plots.envelopes((3,)), r"envelopes: floors\[0\] = 3 must be of type FloorDemands"),
        (lambda: plots.envelope(3), "envelope: floors = 3 must be of type FloorDemands"),
        (lambda: plots.envelope(floors(2), "drfit"), "quantity = 'drfit' must be .*drift"),
        (
            lambda: plots.envelope(floors(2), elevations=[6.0, 3.0]),
            r"envelope: elevations = \[6.0, 3.0\] must be the heights of 2 floors above the ground",
        ),
        (
            lambda: plots.envelope(floors(2), elevations=[3.0, np.inf]),
            r"envelope: elevations = \[3.0, inf\] must be .*, finite, from the lowest up",
        ),
        (
            lambda: plots.envelope(floors(2), elevations=["3 m", "6 m"]),
            r"envelope: elevations = \['3 m', '6 m'\] must be a real number",
        ),
        (lambda: plots.envelopes((floors(2),), [[3.0], [3.0]]), "elevations, 2 of them, must be"),
        (lambda: plots.envelopes((floors(1),), 3.0), "envelopes: elevations = 3.0 must be one for"),
        (
            lambda: plots.envelopes((floors(2), floors(1, 1)), [[3.0, 6.0], [np.nan]]),
            r"envelopes: elevations\[1\] = \[nan\] must be the heights of 1 floor above",
        ),
        (lambda: plots.envelopes((floors(2),), labels=[]), "labels, 0 of them, must be one for"),
        (
            lambda: plots.envelopes({"a": (floors(2),), "b": (floors(3),)}),
            "floors to be compared must be of the same buildings",
        ),
        (
            lambda: plots.envelope({"a": floors(2), "b": floors(2, si=False)}),
            "all in SI units or all dimensionless",
        ),
        (
            lambda: plots.envelopes((jax.tree.map(lambda x: x * np.nan, floors(2)),)),
            r"envelopes: the run is invalid \(NaN\)",
        ),
    ],
)
def test_wrong_arguments_are_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_mode_shapes_are_those_of_the_building_with_its_top_to_the_right(ax):
    building = jp.ShearBuilding.from_period(4, 300e3, period=0.6, damping_ratio=0.05, height=3.5)
    plots.mode_shapes(building, 2, ax)
    found = building.modes()
    for j, line in enumerate(ax.lines[:2]):
        shape = found.shapes[:, j].real
        np.testing.assert_allclose(line.get_xdata()[1:], shape * np.sign(shape[-1]))
        np.testing.assert_array_equal(line.get_ydata(), [0, 3.5, 7, 10.5, 14])
    words = [text.get_text() for text in ax.get_legend().texts]
    assert words[0] == r"mode 1: $T$ = 0.6 s, $\zeta$ = 5 %"
    assert len(words) == 2
    assert ax.get_ylabel() == "height (m)"


def test_modes_of_a_dimensionless_building_are_over_its_floors(ax):
    rod = jp.Rod(jp.ZenerRod(order=0.5, tau_f=0.01, tau_x=0.05), 5.0)
    plots.mode_shapes(jp.Storeys((1.0, 1.0), rod), ax=ax)  # of which there are two
    assert len(ax.get_legend().texts) == 2
    assert r"1/\omega_1" in ax.get_legend().texts[0].get_text()
    np.testing.assert_array_equal(ax.lines[0].get_ydata(), [0, 1, 2])
    with pytest.raises(ValueError, match="mode_shapes: n = 0 must be"):
        plots.mode_shapes(jp.Storeys((1.0,), rod), 0, ax)
    with pytest.raises(ValueError, match="must be of type Storeys"):
        plots.mode_shapes(jp.paper.structures(), ax=ax)


def test_the_modes_of_several_buildings_are_in_si():
    tall, low = (jp.ShearBuilding.from_period(n, 2e5, 0.2 * n, 0.05, height=3.0) for n in (3, 2))
    ax = plots.mode_shapes(jp.Buildings((tall, low)), 2, Figure().add_subplot())
    names = [text.get_text() for text in ax.get_legend().get_texts()]
    assert [name.partition(":")[0] for name in names] == [
        f"building {b}, mode {j}" for b in (1, 2) for j in (1, 2)
    ]
    assert names[2].startswith("building 2, mode 1: $T$ = 0.4 s")
    np.testing.assert_allclose(ax.lines[2].get_ydata(), [0.0, 3.0, 6.0])
    assert ax.get_ylabel() == "height (m)"
    block = jp.Building.from_period(mass=5e5, period=0.9, damping_ratio=0.05)
    ax = plots.mode_shapes(jp.Buildings((block,)), ax=Figure().add_subplot())
    assert ax.get_legend().get_texts()[0].get_text().startswith("mode 1: $T$ = 0.9 s")
    assert ax.get_ylabel() == "floor"
