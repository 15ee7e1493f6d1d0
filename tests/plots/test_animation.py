"""The animation: what moves is where the run has it."""

import dataclasses

import jax
import numpy as np
import pytest
from matplotlib import style
from matplotlib.patches import Rectangle
from PIL import Image

import jaxpound as jp
from jaxpound.plots.animation import Scene, animate, still
from jaxpound.plots.style import COLOURS
from tests.made import changed, pair_response, row_of, row_response
from tests.plots.runs import GROUND, LAW, PAIR, SCALES, SHORT, legend, new_axes, paper_run
from tests.refusals import refused


def blocks(ax):
    """Left and right end of both blocks."""
    bodies = [p for p in ax.patches if isinstance(p, Rectangle) and p.get_y() > 0]
    return [(b.get_x(), b.get_x() + b.get_width()) for b in bodies]


@pytest.mark.parametrize("si", [False, True])
def test_the_blocks_are_as_far_apart_as_the_gap(si, response, ax):
    if si:
        response = SCALES.to_si(response)
    scene = Scene(response, ax)
    rest = np.array(blocks(ax))
    for i in (0, 150, 374, 700):
        scene.show(i)
        (left, right), moved = blocks(ax), np.array(blocks(ax)) - rest
        assert right[0] - left[1] == pytest.approx(float(response.gap[i]), abs=1e-12)
        np.testing.assert_allclose(moved[0], float(response.x1[i]), atol=1e-12)
        np.testing.assert_allclose(moved[1], float(response.x2[i]), atol=1e-12)
        phase = "stick" if float(response.phase[i]) == 0 else "slip"
        assert ax.texts[0].get_text() == f"damper: {phase}"
    closed = changed(response, gap=response.gap - 0.5 * response.gap[0])
    times = {float(response.demand.min_gap_time): "POUNDING (not modelled)", 0.0: "damper: stick"}
    for time, words in times.items():
        assert still(closed, time, new_axes()).texts[0].get_text() == words


def test_columns_are_red_from_the_first_yield_of_their_storey_on(response, ax):
    first, second = response.demand.rods
    rods = (first, dataclasses.replace(second, first_yield_time=5.0))
    run = dataclasses.replace(response, demand=dataclasses.replace(response.demand, rods=rods))
    scene = Scene(run, ax)
    for i, colour in ((200, "structure 2"), (300, "limit"), (200, "structure 2")):
        scene.show(i)  # at t = 4 and 6
        drawn = [line.get_color() for line in ax.lines[:4]]
        assert drawn == [COLOURS["structure 1"]] * 2 + [COLOURS[colour]] * 2


def test_a_player_and_a_file_have_every_frame_and_of_a_row_its_map_of_gaps(
    response, tmp_path, moved
):
    moving = animate(response, frames=3, seconds=0.6)
    assert moving.to_jshtml().count("data:image/png;base64") == 3
    moving.save(tmp_path / "run.gif", writer="pillow")
    with style.context("jaxpound.house"):  # saved figures are finer, frames are not
        moving.save(tmp_path / "house.gif", writer="pillow")
    assert (tmp_path / "house.gif").read_bytes() == (tmp_path / "run.gif").read_bytes()
    with Image.open(tmp_path / "run.gif") as file:
        assert (file.n_frames, file.info["duration"]) == (3, 200)

    def axes_of(film):
        film.to_jshtml()
        return [ax for ax in film._fig.axes if ax.axison]

    free = row_response(row_of((3, 1)), TIME, lambda i, t: np.sin(t + i))
    for run, expected in (
        (moved, ["displacement", "", "gap"]),  # the map has its colour bar
        (free, ["ground", "displacement"]),
    ):
        axes = axes_of(animate(run, frames=2))
        assert [ax.get_ylabel().partition(" ")[0] for ax in axes] == expected
    both = animate({"a": moved, "b": moved}, frames=2, elevations=[[3, 6, 9], [3, 6], [4]])
    images = [ax.images[0] for ax in axes_of(both) if ax.images and ax.get_xlabel()]
    assert len({image.get_clim() for image in images}) == 1


def test_wrong_arguments_are_refused(response, moved):
    batch = jax.tree.map(lambda x: np.stack([x, x]), response)
    lost, far = (
        dataclasses.replace(response, demand=changed(response.demand, **{name: value}))
        for name, value in (("pga", np.nan), ("min_gap", np.inf))
    )
    three = dataclasses.replace(response, masses=(*response.masses, response.masses[1]))
    short = pair_response(response.time[:900], {"gap": np.ones(900)})
    within = "must be within the run, from 0 to 20"
    floors = "the run must be of shear buildings: floors"
    one = {"ax": new_axes(), "elevations": [[3, 6, 9]]}
    for message, draw, *arguments in (
        (r"animate: a batch of shape \(2, 1001\)", animate, batch),
        (within, still, response, 99.0),
        (within, still, response, np.nan),
        ("still: the run is invalid", still, lost, 0.0),
        (f"^animate: {floors}", animate, three),
        (f"^still: {floors}", still, three, 0.0),
        ("animate: the gap must be finite", animate, far),
        ("must be on the same grid", animate, {"long": response, "short": short}),
        ("animate: responses must hold at least one run", animate, {}),
    ):
        refused(message, draw, *arguments)
    refused("frames = 1, seconds = 10.0 must be", animate, response, frames=1)
    refused("seconds = -1", animate, response, seconds=-1)
    refused("still: elevations, 1 of them, must be one for each", still, moved, 1.0, **one)


def test_several_runs_move_side_by_side_to_one_scale(response):
    bare = paper_run(friction=0.0)
    moving = animate({"without": bare, "with": response}, frames=2)
    moving.to_jshtml()
    scenes = [ax for ax in moving._fig.axes if not ax.axison]
    assert [ax.get_title() for ax in scenes] == ["without", "with"]
    assert scenes[0].get_xlim() == scenes[1].get_xlim()
    last = [(blocks(ax)[1][0] - blocks(ax)[0][1]) for ax in scenes]
    np.testing.assert_allclose(last, [float(r.gap[-1]) for r in (bare, response)], atol=1e-12)
    assert [ax.texts[0].get_text() for ax in scenes] == ["", "damper: stick"]
    dampers = [line for ax in scenes for line in ax.lines if line.get_marker() == "s"]
    assert [line.get_visible() for line in dampers] == [False, True]
    over_time = [ax for ax in moving._fig.axes if ax.axison]
    assert over_time[0].get_ylim() == over_time[1].get_ylim()


@pytest.fixture(scope="module")
def collisions():
    pair = dataclasses.replace(PAIR, initial_gap=0.3, contact=jp.Newton(0.65))
    return jp.simulate(pair, GROUND, SHORT)


def stars(ax):
    return [line for line in ax.lines if isinstance(line.get_marker(), tuple)]


def test_a_star_flashes_at_each_impact_and_the_legend_leaves_the_curve_free(collisions, ax):
    scene = Scene(collisions, ax)
    (star,) = stars(ax)
    hits = np.searchsorted(collisions.time, [impact.time for impact in collisions.impacts()])
    assert len(hits) > 1
    for hit in hits:
        scene.show(int(hit))
        left, right = blocks(ax)
        assert left[1] <= right[0] + 1e-9
        assert star.get_visible()
        assert left[1] - 0.1 < star.get_xdata()[0] < right[0] + 0.1
    for before in (0, int(hits[0]) - 1):
        scene.show(before)
        assert not star.get_visible()
    film = animate(collisions, frames=2)
    film.to_jshtml()
    (ax,) = (ax for ax in film._fig.axes if ax.get_ylabel().startswith("gap"))
    assert legend(ax)[1:] == ["impact"]
    box = ax.get_legend().get_window_extent().transformed(ax.transData.inverted())
    assert box.y0 > float(np.max(collisions.gap))


TIME = np.linspace(0.0, 20.0, 401)
BETWEEN = (
    jp.FloorLink(0, 0, friction=0.1, gap=0.5),
    jp.FloorLink(0, 1, friction=0.1, gap=0.45, contact=LAW),
    jp.FloorLink(1, 0, gap=0.3, contact=LAW),
    jp.FloorLink(0, 2, friction=0.2, next_building=0),
    jp.FloorLink(2, 0, friction=0.2, next_building=jp.GROUND),
)


@pytest.fixture(scope="module")
def moved():
    row = row_of((3, 2, 1), BETWEEN)
    return row_response(row, TIME, lambda i, t: 0.1 * (i + 1) * np.sin((1 + 0.2 * i) * t))


def test_floors_of_a_row_are_as_far_apart_as_their_gaps_and_contacts_flash(moved, ax):
    scene = Scene(moved, ax)
    scene.show(0)
    rest = np.array(blocks(ax))
    for i in (0, 60, 203, 400):
        scene.show(i)
        now = np.array(blocks(ax))  # left and right end of each floor, in the order of the masses
        assert len(now) == 6
        for k, (left, right) in enumerate([(0, 3), (1, 4), (3, 5)]):
            assert now[right, 0] - now[left, 1] == pytest.approx(moved.links[k].gap[i], abs=1e-12)
        shift = [float(mass.x[i] - mass.x[0]) for mass in moved.masses]
        np.testing.assert_allclose(now - rest, np.transpose([shift] * 2), atol=1e-12)
        feet = [line.get_data() for line in ax.lines[:2]]  # columns of the lowest floor
        assert all(y[0] == 0 and y[-1] > 0 for _, y in feet)
        assert feet[0][0][-1] - feet[0][0][0] == pytest.approx(float(moved.masses[0].x[i]))
    ax.clear()
    scene = Scene(moved, ax)
    seen = set()
    for i, time in enumerate(TIME):
        scene.show(i)
        closed = [bool(link.gap[i] <= 0) for link in moved.links]
        free = not any(closed[k] for k in (0, 3, 4))
        what = "contact" if free else "POUNDING (not modelled)"
        words = f"{what} at {sum(closed)} of 5 links" if any(closed) else ""
        assert ax.texts[0].get_text() == words
        for k, star in enumerate(stars(ax)):
            begun = [hit for hit in moved.impacts(k) if 0 <= time - hit.time < 20.0 / 30]
            assert star.get_visible() == bool(begun)
            seen |= {k} if begun else set()
    assert seen == {1, 2}
