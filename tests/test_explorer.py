"""The explorer: sliders move the run, the picture shows it, what breaks a rule changes nothing."""

import base64
import builtins
import io
from dataclasses import replace

import jax
import matplotlib as mpl
import numpy as np
import pytest
from matplotlib import style
from PIL import Image

import jaxpound as jp
from jaxpound.explorer import Explorer
from jaxpound.live_panels import LivePanels

mpl.use("Agg")

S, GROUND, GRID = jp.paper.structures(), jp.paper.ground(), jp.TimeGrid.until(20.0, dt=0.04)
TIME = np.arange(0, 20, 0.05)
RECORD = jp.Record(0.5 * np.exp(-((TIME - 4) ** 2)) * np.sin(6 * TIME), 0.05, time_unit="1/ω1")
SCALES = jp.Scales(mass=5e5, frequency=7.0)


def pixels(png):
    with Image.open(io.BytesIO(png)) as image:
        return np.asarray(image.convert("RGB")).astype(int)


@pytest.fixture
def explorer():
    return Explorer(S, GROUND, GRID)


def test_a_slider_for_every_parameter_and_wavelet(explorer):
    expected = {"friction", "initial_gap", "mass_ratio", "stiffness_ratio", "strength"}
    expected |= {f"rod_{i}.{name}" for i in (1, 2) for name in ("order", "tau_f", "tau_x")}
    expected |= {f"{kind}_{i}" for kind in ("amplitude", "period", "arrival") for i in range(1, 6)}
    assert set(explorer.sliders) == expected
    assert all(slider.continuous_update for slider in explorer.sliders.values())


@pytest.mark.parametrize(
    ("name", "value", "structures"),
    [
        ("friction", 0.6, replace(S, friction=0.6)),
        ("rod_2.order", 0.8, replace(S, rod_2=replace(S.rod_2, order=0.8))),
        ("rod_1.tau_x", 2.0, replace(S, rod_1=replace(S.rod_1, tau_x=2.0))),
        ("mass_ratio", 0.5, replace(S, mass_ratio=0.5)),
        ("initial_gap", 0.5, replace(S, initial_gap=0.5)),
    ],
)
def test_a_slider_moves_the_run_and_the_picture(name, value, structures, explorer):
    before = explorer.picture.value
    explorer.sliders[name].value = value
    expected = jp.simulate(structures, GROUND, GRID)
    np.testing.assert_allclose(explorer.response.gap, expected.gap, atol=1e-12)
    assert f"{float(expected.min_gap):.4g}" in explorer.words.value
    assert ("pound" in explorer.words.value) == (float(expected.min_gap) <= 0)
    assert (pixels(explorer.picture.value) != pixels(before)).any()


def test_wavelets_move_the_ground(explorer):
    explorer.sliders["strength"].value = 0.5
    explorer.sliders["period_3"].value = 2.6
    explorer.sliders["arrival_5"].value = 7.0
    explorer.sliders["amplitude_2"].value = -0.3
    ground = jp.Ricker(
        [0.25, -0.15, 0.25, 0.25, 0.25], [1.25, 1.0, 2.6, 3.5, 3.8], [1.5, 2.0, 3.0, 4.0, 7.0]
    )
    expected = jp.simulate(S, ground, GRID)
    np.testing.assert_allclose(explorer.response.gap, expected.gap, atol=1e-12)


def test_what_breaks_a_rule_is_said_and_nothing_is_lost(explorer):
    shown = explorer.picture.value
    explorer.sliders["rod_1.tau_f"].value = 0.9
    explorer.sliders["rod_1.tau_x"].value = 0.05
    assert "tau_x = 0.05" in explorer.words.value
    assert "second law" in explorer.words.value
    assert float(explorer.structures.rod_1.tau_f) == 0.9
    assert float(explorer.structures.rod_1.tau_x) == pytest.approx(S.rod_1.tau_x)
    explorer.reset()
    assert "second law" not in explorer.words.value
    np.testing.assert_allclose(explorer.response.gap, jp.simulate(S, GROUND, GRID).gap, atol=1e-12)
    assert pixels(explorer.picture.value).shape == pixels(shown).shape


def test_a_record_in_si_units_has_its_strength():
    found = Explorer(S, RECORD, GRID, scales=SCALES)
    assert "period_1" not in found.sliders
    found.sliders["strength"].value = 2.0
    expected = SCALES.to_si(jp.simulate(S, 2.0 * RECORD, GRID))
    np.testing.assert_allclose(found.response.gap, expected.gap, atol=1e-12)
    assert " m at t = " in found.words.value


def test_the_cell_shows_the_widget_and_a_picture_where_widgets_do_not_live(explorer):
    bundle = explorer._repr_mimebundle_()
    assert "application/vnd.jupyter.widget-view+json" in bundle
    assert base64.b64decode(bundle["image/png"]) == explorer.picture.value


def test_what_is_kept_and_what_is_drawn_anew_give_the_same_picture():
    panels = LivePanels(jp.simulate(S, GROUND, GRID))
    runs = [jp.simulate(replace(S, friction=mu), GROUND, GRID) for mu in (0.25, 0.27, 0.0, 0.26)]
    drawn = [panels.png(run) for run in runs]
    again = LivePanels(runs[0])
    again.png(runs[0])
    assert (pixels(again.png(runs[1])) == pixels(drawn[1])).all()
    # A stronger run widens the axes; every run stays inside them.
    louder = jp.simulate(S, jp.Ricker(1.5, GROUND.periods, GROUND.arrivals), GRID)
    assert (pixels(panels.png(louder)) != pixels(drawn[3])).any()
    for low, high, lines in panels.limits():
        for line in lines:
            assert low <= line.min() <= line.max() <= high


def test_other_settings_change_nothing():
    run = jp.simulate(S, GROUND, GRID)
    plain = LivePanels(run).png(run)
    with style.context("jaxpound.house"):
        assert (pixels(LivePanels(run).png(run)) == pixels(plain)).mean() > 0.9


def test_arguments_are_checked():
    with pytest.raises(ValueError, match=r"ground = .* must be of type"):
        Explorer(S, lambda t: 0 * t, GRID)
    with pytest.raises(ValueError, match="structures = 3 must be of type"):
        Explorer(3, GROUND, GRID)
    with pytest.raises(ValueError, match=r"grid = 0.02 must be of type"):
        Explorer(S, GROUND, 0.02)
    with pytest.raises(ValueError, match="scales = 3 must be of type"):
        Explorer(S, GROUND, GRID, scales=3)
    batch = jax.tree.map(lambda x: np.array([x, x]), S)
    with pytest.raises(ValueError, match="must be a single pair, not a batch"):
        Explorer(batch, GROUND, GRID)


def test_forces_keep_to_the_unit_of_their_axis():
    found = Explorer(replace(S, friction=0.0), GROUND, GRID, scales=SCALES)
    found.sliders["friction"].value = 0.5
    again = Explorer(replace(S, friction=0.5), GROUND, GRID, scales=SCALES)
    shown = [pixels(one.picture.value) for one in (found, again)]
    friction = np.s_[shown[0].shape[0] // 2 :, : shown[0].shape[1] // 2]  # below, on the left
    assert (shown[0][friction] == shown[1][friction]).all()


def test_without_ipywidgets_the_extra_is_named(monkeypatch):
    real = builtins.__import__

    def without(name, *args, **kwargs):
        if name == "ipywidgets":
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ImportError, match=r"jaxpound\[notebooks\]"):
        Explorer(S, GROUND, GRID)
