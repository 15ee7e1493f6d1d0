"""The explorer: sliders move the run, the picture shows it, what breaks a rule changes nothing."""

import base64
import io
import math
import sys
from dataclasses import replace

import jax
import numpy as np
import pytest
from matplotlib import style
from PIL import Image

import jaxpound as jp
from jaxpound.plots.explorer import Explorer, LivePanels
from jaxpound.plots.sliders import ExactSlider, even_marks, ratio_marks
from tests.plots.runs import GRID, GROUND, LAW, SCALES, SHORT, paper_run
from tests.plots.runs import PAIR as S
from tests.refusals import refusals

TIME = np.arange(0, 20, 0.05)
RECORD = jp.Record(0.5 * np.exp(-((TIME - 4) ** 2)) * np.sin(6 * TIME), 0.05, time_unit="1/ω1")


ALONE = jp.Buildings((jp.Building.from_period(500e3, 0.9, 0.05),))


def pixels(png):
    with Image.open(io.BytesIO(png)) as image:
        return np.asarray(image.convert("RGB")).astype(int)


def differ(png, other):
    return (pixels(png) != pixels(other)).any()


def assert_gap(explorer, structures, ground=GROUND):
    expected = jp.simulate(structures, ground, GRID)
    np.testing.assert_allclose(explorer.response.gap, expected.gap, atol=1e-12)
    return expected


@pytest.fixture
def explorer():
    return Explorer(S, GROUND, GRID)


class Browser:
    """What ipywidgets' sliders answer as they are shown and whenever code sets them.

    As noUiSlider has it, a value becomes percent of the range, goes to the nearest step and comes
    back. Where that is another, it is sent to the kernel, which hears of it in ``answer``.
    """

    def __init__(self, widget):
        self._answers = []
        self._show(widget)

    def _show(self, widget):
        for child in getattr(widget, "children", ()):
            self._show(child)
        if hasattr(widget, "step") and hasattr(widget, "readout"):
            self._hear(widget)
            widget.observe(lambda change: self._hear(change.owner), "value")

    def _hear(self, slider):
        low, high = float(slider.min), float(slider.max)
        log = "Log" in slider._view_name
        value = math.log(slider.value, slider.base) if log else slider.value
        percent = 100 * (value - low) / (high - low)
        step = 100 * slider.step / (high - low)
        percent = min(max(math.floor(percent / step + 0.5) * step, 0.0), 100.0)
        value = percent * (high - low) / 100 + low
        if "Int" in slider._view_name:
            value = math.floor(value + 0.5)
        value = slider.base**value if log else value
        if value != slider.value:
            self._answers.append((slider, value))

    def answer(self):
        for slider, value in self._answers:
            send(slider, value)


def send(widget, value):
    """A user's value comes from the browser."""
    data = {"method": "update", "state": {"value": value}, "buffer_paths": []}
    widget._handle_msg({"content": {"data": data}, "buffers": []})


def test_a_slider_for_every_parameter_and_what_the_cell_shows(explorer):
    expected = {"friction", "initial_gap", "mass_ratio", "stiffness_ratio", "strength"}
    expected |= {f"rod_{i}.{name}" for i in (1, 2) for name in ("order", "tau_f", "tau_x")}
    expected |= {f"{kind}_{i}" for kind in ("amplitude", "period", "arrival") for i in range(1, 6)}
    assert set(explorer.sliders) == expected  # and none of a law of contact
    assert all(slider.position.continuous_update for slider in explorer.sliders.values())
    bundle = explorer._repr_mimebundle_()
    assert "application/vnd.jupyter.widget-view+json" in bundle
    assert base64.b64decode(bundle["image/png"]) == explorer.picture.value


def test_a_slider_moves_the_run_and_the_picture(explorer):
    for name, value, structures in (
        ("friction", 0.6, replace(S, friction=0.6)),
        ("rod_2.order", 0.8, replace(S, rod_2=replace(S.rod_2, order=0.8))),
        ("rod_1.tau_x", 2.0, replace(S, rod_1=replace(S.rod_1, tau_x=2.0))),
        ("mass_ratio", 0.5, replace(S, mass_ratio=0.5)),
        ("initial_gap", 0.5, replace(S, initial_gap=0.5)),
    ):
        explorer.reset()
        before = explorer.picture.value
        explorer.sliders[name].value = value
        smallest = float(assert_gap(explorer, structures).min_gap)
        assert f"{smallest:.6g}" in explorer.words.value
        assert ("POUNDS" in explorer.words.value) == (smallest <= 0)
        assert differ(explorer.picture.value, before)


def test_wavelets_and_records_move_the_ground(explorer):
    values = {"strength": 0.5, "period_3": 2.6, "arrival_5": 7.0, "amplitude_2": -0.3}
    for name, value in values.items():
        explorer.sliders[name].value = value
    amplitudes, periods = [0.25, -0.15, 0.25, 0.25, 0.25], [1.25, 1.0, 2.6, 3.5, 3.8]
    assert_gap(explorer, S, jp.Ricker(amplitudes, periods, [1.5, 2.0, 3.0, 4.0, 7.0]))
    explorer = Explorer(S, RECORD, GRID)
    assert "period_1" not in explorer.sliders
    explorer.sliders["strength"].value = 2.0
    assert_gap(explorer, S, 2.0 * RECORD)
    assert " g/ω1² at " in explorer.words.value


def test_a_browser_s_rounding_changes_nothing():
    def chosen():
        return {name: slider.value for name, slider in explorer.sliders.items()}

    odd = replace(S, mass_ratio=1.002, stiffness_ratio=2 / 3, rod_1=replace(S.rod_1, tau_x=1.18349))
    explorer = Explorer(odd, GROUND, GRID)
    values, gap, words = chosen(), explorer.response.gap, explorer.words.value
    assert (values["mass_ratio"], values["rod_1.tau_x"]) == (1.002, 1.18349)
    Browser(explorer.widget).answer()
    assert chosen() == values
    assert (explorer.response.gap == gap).all()
    assert explorer.words.value == words


def test_what_code_sets_stays_whenever_the_browser_answers(explorer):
    browser = Browser(explorer.widget)  # all cells are run: its answers wait for the last
    wanted = {"friction": 0.4, "rod_2.tau_x": 4.05, "mass_ratio": 1 / 3, "amplitude_2": -0.1234567}
    wanted |= {"initial_gap": 12.5}  # beyond the slider's end
    for name, value in wanted.items():
        explorer.sliders[name].value = value
    browser.answer()
    assert {name: explorer.sliders[name].value for name in wanted} == wanted
    assert float(explorer.structures.mass_ratio) == 1 / 3
    explorer.reset()
    browser.answer()
    assert explorer.sliders["friction"].value == S.friction
    assert jax.tree.leaves(explorer.structures) == jax.tree.leaves(S)


def test_a_user_drags_to_round_numbers_and_types_any_and_what_breaks_a_rule_is_said(explorer):
    friction, tau = explorer.sliders["friction"], explorer.sliders["rod_1.tau_x"]
    send(friction.position, friction.position.value + 5)
    assert friction.value == friction.number.value == 0.3
    send(tau.position, tau.position.value + 1)
    assert tau.value == tau.number.value == 1.2
    for value in (1.2345678901234567, 31.0, 0.01):
        send(tau.number, value)
        assert tau.value == float(explorer.structures.rod_1.tau_x) == value
    assert tau.position.value == 0  # the nearest mark
    with pytest.raises(ValueError, match=r"friction μ \(m1 g\) = nan must be finite"):
        friction.value = float("nan")
    assert friction.value == 0.3
    explorer.reset()
    shape = pixels(explorer.picture.value).shape
    explorer.sliders["rod_1.tau_f"].value = 0.9
    explorer.sliders["rod_1.tau_x"].value = 0.05
    assert "tau_x = 0.05" in explorer.words.value
    assert "second law" in explorer.words.value
    assert float(explorer.structures.rod_1.tau_f) == 0.9
    assert float(explorer.structures.rod_1.tau_x) == pytest.approx(S.rod_1.tau_x)
    explorer.reset()
    assert "second law" not in explorer.words.value
    assert_gap(explorer, S)
    assert pixels(explorer.picture.value).shape == shape


MARKS = [even_marks(0.0, 1.5), even_marks(-1.0, 1.0), even_marks(0.0, 20.013)]


@pytest.mark.parametrize("marks", [*MARKS, ratio_marks(0.001, 1.0)])
def test_every_mark_is_shown_where_it_is(marks):
    assert 100 <= len(marks) <= 302
    slider = ExactSlider("", float(marks[0]), marks)
    for place, value in enumerate(marks):
        slider.value = value
        assert slider.position.value == place
        assert float(f"{value:.4g}") == value


def test_what_is_kept_and_what_is_drawn_anew_give_the_same_picture():
    runs = [paper_run(friction) for friction in (0.25, 0.27, 0.0, 0.26)]
    panels, again = LivePanels(runs[0]), LivePanels(runs[0])
    drawn = [panels.png(run) for run in runs]
    again.png(runs[0])
    assert not differ(again.png(runs[1]), drawn[1])
    # A stronger run widens the axes; every run stays inside them.
    louder = jp.simulate(S, jp.Ricker(1.5, GROUND.periods, GROUND.arrivals), GRID)
    assert differ(panels.png(louder), drawn[3])
    for ax in panels.figure.axes:
        low, high = ax.get_ylim()
        for line in ax.lines:
            assert low <= line.get_ydata().min() <= line.get_ydata().max() <= high
    with style.context("jaxpound.house"):  # other settings change nothing
        of_house = LivePanels(runs[0]).png(runs[0])
    assert (pixels(of_house) == pixels(drawn[0])).mean() > 0.9


def test_buildings_and_their_response_are_in_si():
    left, right = (jp.Building.from_period(*x, 0.05) for x in ((500e3, 0.9), (400e3, 0.6)))
    link = jp.FloorLink(0, 0, friction=2e5, gap=0.1, contact=jp.KelvinVoigt(2e9, 0.65))
    pair, grid = jp.Buildings((left, right), (link,)), jp.TimeGrid.until(5.0, 0.01)
    wave = jp.Ricker(0.03, 0.8, 2.0)
    explorer = Explorer(pair, wave, grid)
    expected = {f"buildings.{i}.{name}" for i in (0, 1) for name in ("order", "tau_f", "tau_x")}
    expected |= {f"buildings.{i}.{name}" for i in (0, 1) for name in ("mass", "stiffness")}
    expected |= {"links.0.friction", "links.0.gap", "links.0.contact.stiffness", "strength"}
    expected |= {"links.0.contact.restitution", "amplitude_1", "period_1", "arrival_1"}
    assert {*explorer.sliders} == expected
    slider = explorer.sliders["links.0.friction"]
    assert slider.children[0].value == "link 1: μ (N)"
    units = pair.scales.units
    assert slider._marks[-1] == pytest.approx(1.5 * float(units["force"]), rel=0.03)
    assert explorer.sliders["arrival_1"]._marks[-1] == pytest.approx(5.0, rel=0.03)
    assert explorer.sliders["buildings.0.mass"]._marks[[0, -1]] == pytest.approx(
        [1e5, 2.5e6], rel=0.01
    )
    slider.value = 3e5
    stronger = replace(pair, links=(replace(link, friction=3e5),))
    run = jp.simulate(stronger, wave, grid)
    np.testing.assert_allclose(explorer.response.gap, run.gap, atol=1e-12)
    assert " m at " in explorer.words.value
    record = jp.Record(0.2 * np.sin(6 * TIME[:40]), 0.05)
    assert Explorer(pair, record, grid).response.si


test_arguments_are_checked = refusals(
    ({"ground": lambda t: 0 * t}, r"ground = .* must be of type"),
    ({"structures": 3}, "structures = 3 must be of type"),
    ({"grid": 0.02}, "grid = 0.02 must be of type"),
    ({"structures": replace(S, friction=np.ones(2))}, "must be a single pair, not a batch"),
    ({"structures": ALONE}, "must be two buildings of one storey with one link"),
    of=lambda change: Explorer(**{"structures": S, "ground": GROUND, "grid": GRID} | change),
)


def test_without_ipywidgets_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "ipywidgets", None)
    with pytest.raises(ImportError, match="Explorer needs ipywidgets, which the extra 'notebooks'"):
        Explorer(S, GROUND, GRID)


def test_forces_keep_to_the_unit_of_their_axis():
    runs = (jp.simulate(replace(S, friction=x), GROUND, GRID) for x in (0.0, 0.5))
    before, after = map(SCALES.to_si, runs)
    shown = [pixels(LivePanels(first).png(after)) for first in (before, after)]
    friction = np.s_[shown[0].shape[0] // 2 :, : shown[0].shape[1] // 2]  # below, on the left
    assert (shown[0][friction] == shown[1][friction]).all()


def test_a_law_of_contact_has_sliders():
    explorer = Explorer(replace(S, initial_gap=0.3, contact=LAW), GROUND, SHORT)
    before = float(explorer.response.demand.peak_contact)
    assert {"initial_gap", "contact.stiffness", "contact.restitution"} <= {*explorer.sliders}
    slider = explorer.sliders["contact.stiffness"]
    assert slider.children[0].value == "contact: k (m1 ω1²)"
    assert slider._marks[[0, -1]] == pytest.approx([50, 1000], rel=0.03)
    slider.value = 400.0
    assert explorer.structures.contact.stiffness == 400.0
    assert explorer.response.demand.peak_contact > 1.2 * before
    assert "POUNDS" in explorer.words.value
    assert "impact" in explorer.words.value
