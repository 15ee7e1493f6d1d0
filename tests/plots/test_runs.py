"""What the figures show: the response's own numbers, with units, nothing hidden or cut off."""

import dataclasses
import itertools
import pickle
import re

import jax
import matplotlib as mpl
import nbformat
import numpy as np
import pytest
from matplotlib import pyplot, style
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from nbclient import NotebookClient

import jaxpound as jp
from jaxpound import plots
from jaxpound.plots.style import FIGURE_SIZE, in_house_style
from tests.made import changed
from tests.plots.runs import GROUND, SCALES, collide, legend, new_axes
from tests.refusals import refused

PAIRS = [{"structure 1": f"{letter}1", "structure 2": f"{letter}2"} for letter in "xvf"]
OF_RODS = "$f_1$, $f_2$ ($m_1 g$)", "$f_1$, $f_2$ (MN)"
# The series that are drawn by their colours, and the ends of labels, dimensionless and in SI.
DRAWN = {
    plots.ground_motion: ({"ground": "ground_acceleration"}, "$u''$ ($g$)", "$u''$ (m/s²)"),
    plots.displacements: (PAIRS[0], r"$x_1$, $x_2$ ($g/\omega_1^2$)", "$x_1$, $x_2$ (m)"),
    plots.velocities: (PAIRS[1], r"$x_1'$, $x_2'$ ($g/\omega_1$)", "$x_1'$, $x_2'$ (m/s)"),
    plots.gap: ({"damper": "gap"}, r"$\xi$ ($g/\omega_1^2$)", r"$\xi$ (m)"),
    plots.friction_force: ({"damper": "friction"}, "$q$ ($m_1 g$)", "$q$ (kN)"),
    plots.rod_forces: (PAIRS[2], *OF_RODS),
    plots.rod_hysteresis: (None, *OF_RODS),
    plots.friction_hysteresis: (None, "$q$ ($m_1 g$)", "$q$ (kN)"),
    plots.energy: (None, r"$E$ ($m_1 g^2/\omega_1^2$)", "$E$ (MJ)"),
}
DRAWINGS = [*DRAWN]
NAMES = [draw.__name__ for draw in DRAWINGS]


@pytest.fixture(scope="module", params=["dimensionless", "si"])
def either(request, response):
    return SCALES.to_si(response) if request.param == "si" else response


def with_gap(response, initial_gap):
    change = initial_gap - float(response.gap[0])
    demand = changed(response.demand, min_gap=response.demand.min_gap + change)
    return changed(response, gap=response.gap + change, demand=demand)


OF_CONTACT = plots.contact_force, plots.contact_hysteresis
COMPARING = plots.gaps, plots.side_by_side


def collection(ax, label):
    return next((c for c in ax.collections if c.get_label() == label), None)


def assert_stacked(ax, terms, names):
    """Each share of the energy ends at the sum of those up to it, and all at the input."""
    tops = np.cumsum([getattr(terms, name.replace(" ", "_")) for name in names], axis=0)
    for name, top in zip(names, tops, strict=True):
        (path,) = collection(ax, name).get_paths()
        assert np.isin(top, path.vertices[:, 1]).all()
    np.testing.assert_allclose(tops[-1] - terms.residual, terms.input, atol=1e-12)


@pytest.mark.parametrize("draw", DRAWINGS[:6], ids=NAMES[:6])
def test_series_over_time(draw, response, ax):
    series = DRAWN[draw][0]
    assert draw(response, ax=ax) is ax
    lines = [line for line in ax.lines if not line.get_label().startswith(("_", "gap at rest"))]
    assert len(lines) == len(series)
    for line, (colour, name) in zip(lines, series.items(), strict=True):
        np.testing.assert_array_equal(line.get_xdata(), response.time)
        np.testing.assert_array_equal(line.get_ydata(), getattr(response, name))
        assert line.get_color() == plots.COLOURS[colour]
    assert (ax.get_legend() is not None) == (len(series) > 1 or draw in DRAWINGS[3:5])


def test_hysteresis_is_that_of_the_rods_and_encloses_the_work_of_friction(response, ax):
    plots.rod_hysteresis(response, ax)
    expected = [(response.x1, response.f1), (response.x2, response.f2)]
    np.testing.assert_array_equal([line.get_data() for line in ax.lines], expected)
    assert legend(ax) == ["structure 1", "structure 2"]
    ax = plots.friction_hysteresis(response, new_axes())
    slip, force = ax.lines[0].get_data()
    np.testing.assert_array_equal(slip, response.x1 - response.x2)
    area = np.sum((force[1:] + force[:-1]) / 2 * np.diff(slip))
    assert area == pytest.approx(float(response.demand.friction_work), rel=0.02)
    several = dataclasses.replace(response, rods=(*response.rods, response.rods[1]))
    ax = plots.rod_hysteresis(several, new_axes())
    expected = [(response.x1, response.f1), *[(response.x2, response.f2)] * 2]
    np.testing.assert_array_equal([line.get_data() for line in ax.lines], expected)
    assert legend(ax) == ["building 1", "building 2", "rod 2–ground, floor 1"]
    assert ax.get_xlabel() == r"elongation ($g/\omega_1^2$)"


def test_energy_stacks_up_to_the_input(response, collisions, ax):
    plots.energy(response, ax)
    lines = {line.get_label(): line.get_ydata() for line in ax.lines}
    for name in ("input", "residual"):
        np.testing.assert_array_equal(lines[name], getattr(response.energy, name))
    shares = ["friction", "rods", "kinetic"]
    assert_stacked(ax, response.energy, shares)
    ax = plots.energy(collisions[1], new_axes())
    assert_stacked(ax, collisions[1].energy, [*shares, "contact lost", "contact stored"])


@pytest.mark.parametrize("draw", DRAWINGS, ids=NAMES)
def test_labels_say_symbol_and_unit(draw, either, ax):
    draw(either, ax)
    assert ax.get_ylabel().endswith(DRAWN[draw][2 if either.si else 1])
    units = ("m)", r"$g/\omega_1^2$)"), ("s)", r"$1/\omega_1$)")
    of_time = "hysteresis" not in draw.__name__
    assert ax.get_xlabel().rsplit("(", 1)[1] == units[of_time][not either.si]


@pytest.mark.parametrize(("mass", "unit", "factor"), [(1e3, "N", 1), (5e5, "kN", 1e-3)])
def test_forces_are_drawn_in_the_unit_they_are_labelled_with(mass, unit, factor, response, ax):
    si = jp.Scales(mass=mass, frequency=7.0).to_si(response)
    plots.friction_force(si, ax)
    assert f"({unit})" in ax.get_ylabel()
    np.testing.assert_allclose(ax.lines[0].get_ydata(), factor * np.asarray(si.friction))


def test_smallest_gap_is_marked_where_it_is(either, ax):
    plots.gap(either, ax)
    smallest, at = float(either.demand.min_gap), float(either.demand.min_gap_time)
    assert ax.lines[-1].get_data() == (pytest.approx(at), pytest.approx(smallest))
    text = legend(ax)[0]
    assert text.startswith(r"$\xi$, min")
    assert f"{smallest:.4g}" in text
    assert f"{at:.4g}" in text
    units = (" m at", " s") if either.si else (r" $g/\omega_1^2$ at", r"$/\omega_1$")
    assert units[0] in text
    assert text.endswith(units[1])
    # What the smallest gap and the largest closing have to do with each other.
    rest, closing = float(either.gap[0]), float((either.x1 - either.x2).max())
    numbers = re.findall(r"(\d*\.?\d+) (?:m|\$g)", legend(ax)[1])
    assert [float(x) for x in numbers] == pytest.approx([rest, closing], rel=1e-3)
    assert re.match("gap at rest .* − closing ", legend(ax)[1])


@pytest.mark.parametrize(
    ("initial_gap", "shaded"),
    [(0.5, True), (1.0, True), (3.0, False)],
    ids=["pounds", "near", "far"],
)
def test_smallest_gap_is_above_everything_and_pounding_shaded_only_if_near(
    initial_gap, shaded, response, ax
):
    moved = with_gap(response, initial_gap)
    plots.gap(moved, ax)
    ax.figure.draw_without_rendering()
    assert not ax.texts  # nothing is written where pounding is shaded
    assert f"{float(moved.min_gap):.4g}".replace("-", "−") in legend(ax)[0]
    box = ax.get_legend().texts[0].get_window_extent()
    assert box.y0 > ax.transData.transform((0, float(moved.gap.max())))[1]
    assert ax.bbox.x0 <= box.x0 <= box.x1 <= ax.bbox.x1
    bands = [patch for patch in ax.patches if patch.get_label().startswith("pounding")]
    assert len(bands) == shaded
    bottom, _ = ax.get_ylim()
    assert bottom < float(moved.min_gap)
    if shaded:
        low, high = bands[0].get_extents().transformed(ax.transData.inverted()).intervaly
        assert low <= bottom
        assert high == pytest.approx(0, abs=1e-12)
        assert "pounding" in legend(ax)[-1]
    else:
        assert bottom > 0
        assert len(legend(ax)) == 2


def test_stick_is_shaded_where_the_phases_are(either, ax):
    plots.friction_force(either, ax)
    drawn = [p.vertices[:, 0] for p in collection(ax, "stick").get_paths()]
    sticks = [(p.start, p.end) for p in either.phases() if p.kind == "stick"]
    assert len(sticks) == 2
    np.testing.assert_allclose([(x.min(), x.max()) for x in drawn], sticks, rtol=1e-12)
    sliding = plots.friction_force(changed(either, phase=np.ones_like(either.phase)), new_axes())
    assert collection(sliding, "stick") is None
    assert sliding.get_legend() is None


@pytest.mark.parametrize("draw", DRAWINGS, ids=NAMES)
@pytest.mark.parametrize("size", [FIGURE_SIZE, (6.4, 4.8)], ids=["column", "large"])
def test_nothing_overlaps_or_is_cut_off(draw, size, either, legible):
    axes = draw(either, Figure(figsize=size, layout="constrained").add_subplot())
    box = axes.get_legend()
    texts = [axes.xaxis.label, axes.yaxis.label, *axes.texts, *(box.texts if box else ())]
    legible(axes.figure, texts)
    assert all(text.get_fontsize() >= 8 for text in texts)
    for ticks in (axes.get_xticklabels(), axes.get_yticklabels()):
        extents = [tick.get_window_extent() for tick in ticks if tick.get_text()]
        assert not any(a.overlaps(b) for a, b in itertools.pairwise(extents))
    if box:
        highest = axes.transData.transform([(0, line.get_ydata().max()) for line in axes.lines])
        assert highest[:, 1].max() < box.get_window_extent().y0


def test_drawing_twice_into_the_same_axes_shows_both(response, ax):
    larger = changed(response, x1=3 * response.x1)
    plots.displacements(larger, ax)
    plots.displacements(response, ax)
    low, high = ax.get_ylim()
    assert low < float(larger.x1.min()) < float(larger.x1.max()) < high
    assert len(legend(ax)) == 4


@pytest.mark.parametrize("draw", DRAWINGS, ids=NAMES)
def test_pyplot_and_settings_are_left_alone_and_change_nothing(draw, response, ax):
    def pixels():
        figure = draw(response).figure
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())

    settings, before = dict(mpl.rcParams), pyplot.get_fignums()
    draw(response, ax=ax)
    assert pyplot.get_fignums() == before
    usual = pixels()
    assert len(pyplot.get_fignums()) == len(before) + 1
    assert dict(mpl.rcParams) == settings
    with mpl.rc_context({"lines.linewidth": 5, "legend.fontsize": 20, "legend.frameon": True}):
        np.testing.assert_array_equal(pixels(), usual)


def test_a_notebook_that_turns_interactive_with_its_first_figure_stays_so(response):
    """It does so while the figure is made, and shows the figures of later cells only if it is."""

    def first_figure(response):
        pyplot.ion()
        return plots.displacements(response, new_axes())

    assert not mpl.is_interactive()
    try:
        in_house_style(first_figure)(response)
        assert mpl.is_interactive()
    finally:
        pyplot.ioff()


def test_the_overview_shows_what_it_is_called(response, collisions):
    panels = plots.overview(response).axes
    words = ["ground acceleration", "displacement", "friction force", "gap"]
    for ax, word in zip(panels, words, strict=True):
        assert ax.get_ylabel().startswith(word)
        assert ax.get_xlim() == (0, float(response.time[-1]))
    assert [bool(ax.get_xlabel()) for ax in panels] == [False, False, False, True]
    assert len(plots.overview(collisions[1]).axes) == 5


@pytest.fixture(scope="module")
def batch(response) -> jp.Response:
    twice = changed(response, x1=2 * response.x1, x2=2 * response.x2)
    return jax.tree.map(lambda *x: np.stack(x), response, twice, with_gap(response, 0.5))


@pytest.mark.parametrize("draw", DRAWINGS[:-1], ids=NAMES[:-1])
def test_a_batch_is_drawn_run_upon_run(draw, batch, response, ax):
    draw(batch, ax)
    runs = [c for c in ax.collections if isinstance(c, LineCollection)]
    lines = draw(response, new_axes()).lines
    if "hysteresis" not in draw.__name__:
        lines = [x for x in lines if not x.get_label().startswith(("_", "gap at rest"))]
    assert len(runs) == len(lines)
    for bundle, line in zip(runs, lines, strict=True):
        assert len(bundle.get_segments()) == 3
        np.testing.assert_allclose(bundle.get_segments()[0], np.transpose(line.get_data()))
        assert bundle.get_alpha() < line.get_alpha()
        if draw is not plots.gap:  # which tells the minimum
            assert bundle.get_label() == line.get_label()
    low, high = ax.get_ylim()
    every = np.concatenate([path for c in runs for path in c.get_segments()])[:, 1]
    assert low <= every.min() < every.max() <= high
    if draw is plots.displacements:  # the legend is not faint
        assert {handle.get_alpha() for handle in ax.get_legend().legend_handles} == {1.0}
    if draw is plots.gap:
        smallest = float(np.min(batch.min_gap))
        assert ax.lines[-1].get_ydata() == pytest.approx(smallest)
        assert f"min {smallest:.4g}".replace("-", "−") in legend(ax)[0]
        assert "pounding" in legend(ax)[-1]


def test_runs_to_be_compared_stand_in_one_picture_or_side_by_side(response, ax):
    runs = {"without": with_gap(response, 0.5), "with": response, "wide": with_gap(response, 2.0)}
    plots.gaps(runs, ax)
    lines = {line.get_label(): line for line in ax.lines if ":" in line.get_label()}
    for (name, run), (words, line) in zip(runs.items(), lines.items(), strict=True):
        assert words == f"{name}: min {run.min_gap:.4g} $g/\\omega_1^2$".replace("-", "−")
        np.testing.assert_array_equal(line.get_ydata(), run.gap)
    assert len({line.get_color() for line in lines.values()}) == 3
    assert ax.get_ylim()[0] < float(runs["without"].min_gap)
    runs = {"far": with_gap(response, 3.0), "near": response, "pounds": with_gap(response, 0.5)}
    figure = plots.side_by_side(runs, [plots.displacements, plots.gap])
    figure.draw_without_rendering()
    panels = np.reshape(figure.axes, (2, 3))
    assert [ax.get_title() for ax in panels[0]] == list(runs)
    for row in panels:
        assert len({ax.get_ylim() for ax in row}) == 1
        assert [bool(ax.get_ylabel()) for ax in row] == [True, False, False]
    assert all(not ax.get_xlabel() for ax in panels[0])
    low, high = panels[1, 0].get_ylim()
    assert low < float(runs["pounds"].min_gap)
    assert high > float(runs["far"].gap.max())
    # The region of pounding is shaded down to the bottom in each.
    for ax in panels[1]:
        (region,) = ax.patches
        ends = region.get_extents().transformed(ax.transData.inverted()).intervaly
        assert ends[0] <= low
        assert ends[1] == pytest.approx(0, abs=1e-9)


def test_wrong_arguments_are_refused(response, batch):
    lost = changed(batch.demand, pga=np.array([0.1, np.nan, np.nan]))
    broken = dataclasses.replace(batch, demand=lost)
    two = {"a": response, "b": SCALES.to_si(response)}
    for draw, argument, message in (
        (plots.energy, batch, r"energy: a batch of shape \(3, 1001\)"),
        (plots.gap, broken, "2 of 3 runs are invalid"),
        (plots.gaps, {"a": 3}, r"responses\['a'\] = 3 must be of type Response"),
        (plots.side_by_side, response, r"side_by_side: responses = .* must be of type"),
        *((draw, {}, "must hold at least one run") for draw in COMPARING),
        *((draw, two, "must all be in SI units") for draw in COMPARING),
        *((draw, response, "must have a link with a law of contact") for draw in OF_CONTACT),
    ):
        refused(message, draw, argument)


def test_figures_are_saved_as_they_are(response, tmp_path, caplog):
    response.plot().savefig(tmp_path / "own.png")
    pyplot.savefig(tmp_path / "pyplots.png")
    assert (tmp_path / "own.png").read_bytes() == (tmp_path / "pyplots.png").read_bytes()
    with style.context("jaxpound.house"):
        assert mpl.rcParams["figure.figsize"] == list(FIGURE_SIZE)
        figure = plots.displacements(response).figure
        figure.axes[0].set_title("under $u''$")  # the prime is of a font from before 1970
        for kind in ("svg", "pdf"):
            figure.savefig(tmp_path / f"own.{kind}")
    assert "displacement" in (tmp_path / "own.svg").read_text()
    assert b"/Type3" not in (tmp_path / "own.pdf").read_bytes()
    assert not [x for x in caplog.records if x.levelname == "WARNING" and "font" in x.name]


SETUP = """
import pickle
import re
from pathlib import Path
from jaxpound import plots
response = pickle.loads(Path({!r}).read_bytes())
"""


def test_a_notebook_shows_each_figure_once_as_a_plain_one(response, tmp_path, monkeypatch):
    """It shows every value of a cell, and every figure that pyplot has at the cell's end."""
    monkeypatch.delenv("MPLBACKEND", raising=False)  # the kernel's own shows figures in cells
    (tmp_path / "run.pickle").write_bytes(pickle.dumps(response))
    cells = [
        (SETUP.format(str(tmp_path / "run.pickle")), 0),
        *(("response.plot()", 1), ("plots.gap(response)", 1), ("plots.gap(response);", 1)),
        (f"response.plot().savefig({str(tmp_path / 'saved.png')!r})", 0),
        ("plots.gap(response); plots.displacements(response); response.plot()", 3),
    ]
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(c) for c, _ in cells])
    NotebookClient(notebook).execute()
    for cell, (source, n) in zip(notebook.cells, cells, strict=True):
        shown = [o.data for o in cell.outputs if "image/png" in o.get("data", {})]
        assert len(shown) == n, source
        assert all(data["text/plain"].startswith("<Figure size") for data in shown)
    assert (tmp_path / "saved.png").stat().st_size > 10_000


def test_a_run_at_rest_can_be_drawn(response):
    nothing = jax.tree.map(np.zeros_like, response)
    rest = changed(nothing, time=response.time, mass_1=1.0, mass_2=1.0)
    for draw in DRAWINGS:
        draw(rest).figure.draw_without_rendering()


@pytest.fixture(scope="module")
def collisions():
    return jax.tree.map(lambda *x: np.stack(x), collide(0.0), collide(0.25))


@pytest.mark.parametrize("stiffness", [100.0, 1e4])
def test_the_largest_drawn_force_is_that_of_the_table(stiffness, ax):
    """The stiffer contact lasts a step and a half, so that instants miss a third of its force."""
    run = collide(0.25, stiffness)
    peak = float(run.demand.peak_contact)
    if stiffness > 100:
        assert run.contact.max() < 0.9 * peak
    plots.contact_force(run, ax)
    line, dots = ax.lines
    assert line.get_ydata().max() == pytest.approx(peak, rel=1e-6)
    # Nor does the line jump at the instants that all of it passes through, between them in contact.
    pressed = run.contact[1:-1].astype(bool) & (run.contact[2:] > 0) & (run.contact[:-2] > 0)
    for before, after in ((-1e-9, 1e-9), (-1e-9, 0.0)):
        sides = [np.interp(run.time[1:-1] + d, *line.get_data()) for d in (before, after)]
        np.testing.assert_allclose(sides[0][pressed], sides[1][pressed], rtol=1e-4)
    for impact, time, force in zip(run.impacts(), *dots.get_data(), strict=True):
        assert impact.time <= time
        assert force == impact.peak_force
        assert np.interp(time, *line.get_data()) == pytest.approx(force, rel=1e-6)
    depth, force = plots.contact_hysteresis(run, new_axes()).lines[0].get_data()
    assert force.max() == pytest.approx(peak, rel=1e-3)
    assert depth.max() == pytest.approx(float(run.demand.peak_penetration), rel=2e-3)
    several = jax.tree.map(lambda *x: np.stack(x), collide(0.0, stiffness), run)
    (both,) = plots.contact_hysteresis(several, new_axes()).collections
    highest = [path.vertices[:, 1].max() for path in both.get_paths()]
    assert highest == pytest.approx(several.demand.peak_contact, rel=1e-3)


def test_contact_of_links_that_share_masses_is_drawn_with_all_that_acts_in_them():
    """Walls on both sides of the first mass, which also meets the second; in SI the same."""
    steel, law = jp.ZenerRod(0.6, 0.01, 0.05), jp.HertzDamped(3e3, 0.65)
    rods = jp.Rod(steel, 1.0, (0, jp.GROUND)), jp.Rod(steel, 4.0, (1, jp.GROUND))
    fast = jp.VelocityFriction(0.1, 0.5)
    between = jp.Link((0, 1), 0.05, 0.02, law, velocity_friction=fast, inerter=jp.Inerter(0.3))
    links = between, jp.Link((0, jp.GROUND), 0.02, (0.6, 0.5), law)
    run = jp.simulate(jp.System((1.0, 0.7), rods, links), GROUND, jp.TimeGrid(0.02, 400))
    peaks = [float(link.peak_contact) for link in run.demand.links]
    assert min(peaks) > 0
    for response, unit in ((run, 1.0), (SCALES.to_si(run), SCALES.force / 1e6)):
        lines = plots.contact_hysteresis(response, new_axes()).lines
        highest = [line.get_ydata().max() / unit for line in lines]
        assert highest == pytest.approx(peaks, rel=1e-3)


def test_contact_shows_its_forces_within_the_steps_and_encloses_what_it_loses(
    collisions, ax, response
):
    one = collisions[1]
    plots.contact_force(one, ax)
    line, peaks = ax.lines
    times, forces = line.get_data()
    assert (np.diff(times) >= -1e-12).all()
    np.testing.assert_allclose(np.interp(one.time, times, forces), one.contact, rtol=0, atol=2e-3)
    assert len(peaks.get_xdata()) == one.demand.n_impacts > 1
    assert peaks.get_ydata().max() == pytest.approx(one.demand.peak_contact, rel=1e-14)
    assert ax.get_ylabel() == "contact force $p$ ($m_1 g$)"
    several = plots.contact_force(collisions, new_axes())
    assert not several.lines
    assert len(several.collections[0].get_paths()) == 2
    ax = plots.contact_hysteresis(one, new_axes())
    (loops,) = ax.lines
    depth, force = loops.get_data()
    area = np.sum((force[1:] + force[:-1]) / 2 * np.diff(depth))
    assert area == pytest.approx(float(one.demand.contact_work), rel=1e-3)
    assert ax.get_xlabel() == r"penetration $\delta$ ($g/\omega_1^2$)"
    ax = plots.gap(collisions[1], new_axes())
    marks = [line for line in ax.lines if line.get_label() == "impact"]
    times = [impact.time for impact in collisions[1].impacts()]
    np.testing.assert_array_equal(marks[0].get_xdata(), times)
    np.testing.assert_allclose(np.interp(times, *ax.lines[0].get_data()), 0, atol=5e-3)
    for other in (response, collisions):
        assert "impact" not in plots.gap(other, new_axes()).get_legend_handles_labels()[1]
