"""Figures of systems that are not a pair: every mass, rod and link is drawn, as what it is."""

import dataclasses

import jax
import numpy as np
import pytest
from matplotlib.figure import Figure

import jaxpound as jp
from jaxpound import plots
from jaxpound.plots.curves import is_pair
from tests.made import pair_response, row_of, row_response
from tests.plots.runs import legend, new_axes
from tests.refusals import refused

TIME = np.linspace(0.0, 1.0, 5)
X = [np.sin((i + 1) * TIME) for i in range(4)]
DAMPER = {"friction": 0.1}
LINKS = (
    jp.FloorLink(0, 1, 0, gap=0.8, **DAMPER),
    jp.FloorLink(0, 0, next_building=jp.GROUND, **DAMPER),
    jp.FloorLink(1, 0, gap=0.6, **DAMPER),
)


def linked(n_floors, links=None, displacement=lambda i, t: i * np.sin(t)):
    """The response of a row; if nothing is said, of links between all floors."""
    if links is None:
        links = jp.floor_links(row_of(n_floors).buildings, gap=0.5, friction=0.1)
    return row_response(row_of(n_floors, links), TIME, displacement)


def response(links=LINKS):
    """Of a building of two storeys and two of one, whose rod has its ends the other way round."""
    run = linked((2, 1, 1), links, lambda i, t: X[i])
    *rods, last = run.rods
    turned = dataclasses.replace(last, force=-last.force, ends=last.ends[::-1])
    return dataclasses.replace(run, rods=(*rods, turned))


def by_floor(what):
    return [f"{what} {floor} of building {b}" for b, floor in ((1, 1), (1, 2), (2, 1), (3, 1))]


NAMES = {
    "mass": by_floor("floor"),
    "rod": by_floor("storey"),
    "link": ["1–2, floors 2–1", "1–ground, floor 1", "2–3, floor 1"],
}


def drawn(ax):
    named = {name for names in NAMES.values() for name in names}
    return {line.get_label(): line.get_xydata().T for line in ax.lines if line.get_label() in named}


@pytest.mark.parametrize(
    ("draw", "what", "series", "y"),
    [
        (plots.displacements, "mass", "x", "displacement $x$"),
        (plots.velocities, "mass", "v", "velocity $x'$"),
        (plots.rod_forces, "rod", "force", "rod force $f$"),
        (plots.friction_force, "link", "friction", "friction force $q$"),
    ],
)
def test_every_mass_rod_and_link_is_drawn_over_time(draw, what, series, y, ax):
    elements = getattr(response(), {"mass": "masses"}.get(what, f"{what}s"))
    draw(response(), ax)
    lines = drawn(ax)
    assert list(lines) == legend(ax) == NAMES[what]
    for (x, values), element in zip(lines.values(), elements, strict=True):
        np.testing.assert_array_equal(x, TIME)
        np.testing.assert_array_equal(values, getattr(element, series))
    assert ax.get_ylabel().startswith(f"{y} (")
    assert len({line.get_color() for line in ax.lines}) == len(elements)


def test_rods_and_links_are_drawn_over_their_elongation_and_slip_and_gaps_over_time(ax):
    plots.rod_hysteresis(response(), ax)
    assert ax.get_xlabel().startswith("elongation")
    elongations = X[0], X[1] - X[0], X[2], -X[3]
    for name, elongation in zip(NAMES["rod"], elongations, strict=True):
        np.testing.assert_array_equal(drawn(ax)[name], [elongation, 5.0 * elongation])
    ax = plots.friction_hysteresis(response(), new_axes())
    for name, slip in zip(NAMES["link"], (X[1] - X[2], X[0], X[2] - X[3]), strict=True):
        np.testing.assert_array_equal(drawn(ax)[name][0], slip)
    assert ax.get_xlabel().startswith("slip $x_i - x_j$")
    run = response()
    ax = plots.gap(run, new_axes())
    assert list(drawn(ax)) == NAMES["link"][::2]
    np.testing.assert_array_equal(drawn(ax)["2–3, floor 1"][1], run.links[2].gap)
    smallest = float(run.min_gap)
    assert ax.lines[-1].get_ydata() == smallest
    assert legend(ax)[2].replace("−", "-").startswith(f"min {smallest:.4g} $g/")
    both = plots.gaps({"one": run, "other": response(LINKS[:1])}, new_axes())
    assert sum(np.size(line.get_ydata()) == 5 for line in both.lines) == 3


def test_loops_are_chosen_by_number_and_stand_in_panels_to_one_scale(legible):
    """Of the first building alone the unit is still that of the largest force of all."""
    run = linked((4, 3), displacement=lambda i, t: 1e4 * (i + 1) * np.sin(t))
    run = dataclasses.replace(run, si=True, demand=dataclasses.replace(run.demand, si=True))
    ax = plots.rod_hysteresis(run, new_axes(), [0, 5])
    assert legend(ax) == ["storey 1 of building 1", "storey 2 of building 2"]
    expected = np.array([run.rods[k].force for k in (0, 5)]) * 1e-3
    np.testing.assert_allclose([line.get_ydata() for line in ax.lines], expected)
    figure = plots.hysteresis(run)
    names = [f"storey {s} of building {b}" for b, n in ((1, 4), (2, 3)) for s in range(1, n + 1)]
    assert [ax.get_title() for ax in figure.axes] == names
    assert len({(ax.get_xlim(), ax.get_ylim()) for ax in figure.axes}) == 1
    assert not any(ax.get_legend() for ax in figure.axes)
    for ax, rod, x in zip(figure.axes, run.rods, run.elongations, strict=True):
        (loop,) = ax.lines
        np.testing.assert_allclose(loop.get_data(), [x, 1e-3 * rod.force])
    assert figure.get_supylabel() == "rod force $f$ (kN)"
    legible(figure, [ax.title for ax in figure.axes])
    links = plots.hysteresis(run, "friction", [2, 0])
    assert [ax.get_title() for ax in links.axes] == ["1–2, floor 3", "1–2, floor 1"]
    slip = links.axes[0].lines[0].get_xdata()
    np.testing.assert_array_equal(slip, run.masses[2].x - run.masses[6].x)
    many = linked((21, 21), ())
    assert len(plots.hysteresis(many).axes) == 20  # of 42
    bare = dataclasses.replace(run.links[0], slip_force=0.0)
    half = dataclasses.replace(run, links=(bare, *run.links[1:]))
    rule = r"rods = .* must be a list of the rods to be drawn, from 0: \[0"
    for chosen in ([7], [], [0.0], 2):
        refused(rule, plots.rod_hysteresis, run, None, chosen)
        refused(rule, plots.hysteresis, run, "rod", chosen)
    refused(
        r"links = \[0\] must be a list of the links", plots.friction_hysteresis, half, None, [0]
    )
    refused("kind = 'rods' must be one of rod, friction", plots.hysteresis, run, "rods")


def test_runs_and_batches_without_links_or_gaps_are_valid(ax):
    free, open_ = response(()), response(LINKS[1:2])
    assert [len(run.plot().axes) for run in (free, open_)] == [2, 3]
    plots.energy(free, ax)
    for draw in (plots.friction_force, plots.friction_hysteresis):
        refused(f"{draw.__name__}: response must have a link", draw, free, ax)
    for run in (free, open_):
        refused("gap: response must have a link with a finite gap", plots.gap, run, ax)
    runs = response(LINKS[:1]), response([dataclasses.replace(LINKS[0], gap=np.inf)])
    ax = plots.gap(jax.tree.map(lambda *x: np.stack(x), *runs), new_axes())
    assert np.isfinite(ax.get_ylim()).all()
    assert f"{float(runs[0].min_gap):.4g}" in legend(ax)[0]


def test_a_pair_is_known_by_its_topology():
    pair = pair_response(TIME, {})
    turned = dataclasses.replace(pair, rods=pair.rods[::-1])
    others = response(), dataclasses.replace(pair, links=()), turned
    assert [is_pair(run) for run in (pair, *others)] == [True, False, False, False]


def test_many_masses_have_colours_and_a_narrow_legend_that_names_their_buildings(ax):
    run = response()
    plots.displacements(dataclasses.replace(run, masses=run.masses * 5), ax)
    assert len({line.get_color() for line in ax.lines}) == 20
    run = linked((4, 3, 4), ())
    for width in (2.2, 3.54, 7.0):
        ax = Figure(figsize=(width, 2.4), layout="constrained").add_subplot()
        plots.displacements(run, ax).figure.draw_without_rendering()
        assert ax.get_legend().get_window_extent().x0 > ax.get_window_extent().x0 - 1

    run = linked((4, 3), displacement=lambda i, t: 0.1 * i * np.sin(t))
    for draw in (plots.displacements, plots.rod_forces, plots.rod_hysteresis):
        each = draw(run, new_axes())
        assert legend(each) == ["building 1", "building 2"]
        assert len({line.get_color() for line in each.lines}) == 7
        tops = [each.lines[i].get_color() for i in (3, 6)]
        assert tops == [plots.COLOURS[f"structure {b}"].lower() for b in (1, 2)]
    assert "1–2, floor 3" in legend(plots.friction_force(run, new_axes()))


def test_many_links_share_names_and_those_without_a_damper_have_no_friction(ax):
    run = linked((3, 3, 2))
    plots.friction_force(run, ax)
    assert legend(ax) == ["1–2", "2–3"]
    every = plots.gap(run, new_axes())
    assert legend(every)[:2] == ["1–2", "2–3"]
    assert len([line for line in every.lines if np.size(line.get_xdata()) == TIME.size]) == 5
    # They are told apart from others between.
    within = jp.FloorLink(0, 1, friction=0.1, next_building=0)
    to_ground = jp.FloorLink(1, 1, friction=0.1, next_building=jp.GROUND)
    first, *others = (jp.FloorLink(0, floor, friction=0.1) for floor in range(3))
    ax = plots.friction_force(linked((3, 3), (first, within, *others, to_ground)), new_axes())
    assert legend(ax) == ["in 1", "1–2", "2–ground"]
    run = linked((2, 2), displacement=lambda i, t: i**2 * np.sin(t))
    bare = [dataclasses.replace(link, slip_force=0.0) for link in run.links]
    half = dataclasses.replace(run, links=(bare[0], run.links[1]))
    ax = plots.friction_force(half, new_axes())
    (line,) = ax.lines
    assert line.get_label() == "1–2, floor 2"
    (loop,) = plots.friction_hysteresis(half).lines
    np.testing.assert_array_equal(loop.get_ydata(), run.links[1].friction)
    free = dataclasses.replace(run, links=tuple(bare))
    assert len(free.plot().axes) == len(run.plot().axes) - 1
    assert "friction" not in legend(plots.energy(free))
    assert "damper" not in str(free)
    assert "damper 1–2, floor 1" in str(run)
