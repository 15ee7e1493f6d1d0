"""What the figures of a study show: its own numbers, with units."""

import dataclasses
import types
from functools import cache

import numpy as np
import pytest
from matplotlib import pyplot

import jaxpound as jp
from jaxpound.plots import studies as plots
from jaxpound.plots.style import COLOURS, parameter_axis, parameter_name
from jaxpound.study.sensitivity import Sensitivity
from jaxpound.study.statistics import Estimate
from tests.plots.runs import legend, new_axes
from tests.refusals import refused
from tests.study.test_run import LINEAR, RANDOM, study

SCALES = jp.Scales(mass=500e3, frequency=7.0)
IN_SI, STOREY = jp.Scales(1.0, 1.0, 1.0), "buildings.1.storeys.0"


@cache
def random_study():
    return study(RANDOM, 50)


@pytest.fixture(scope="module")
def found():
    return study(LINEAR, 400)


def test_min_gap_s_histogram_and_distribution(found, ax, legible):
    assert plots.min_gap(found, ax) is ax
    gaps, bars = found["min_gap"], list(ax.containers[0])
    for bar in (bars[0], bars[-1]):  # nobody is piled up at an end
        low, high = bar.get_x(), bar.get_x() + bar.get_width()
        inside = np.sum((gaps >= low) & (gaps < high)) + (bar is bars[-1])
        assert bar.get_height() * bar.get_width() == pytest.approx(inside / 400)
    assert sum(bar.get_width() * bar.get_height() for bar in bars) == pytest.approx(399 / 400)
    assert "further left: 1 of 400" in ax.get_legend_handles_labels()[1]
    right = next(other for other in ax.figure.axes if other is not ax)
    x, share = right.lines[0].get_data()
    np.testing.assert_array_equal(x, np.sort(found["min_gap"]))
    assert share[-1] == 1
    assert ax.patches[-1].get_label().startswith("pounding")
    assert ax.get_xlim()[1] == found["min_gap"].max()
    # How many keep their gap at rest is told.
    columns = {"min_gap": np.r_[np.full(30, 0.1), np.linspace(-0.1, 0.09, 70)]}
    columns["required_gap"] = 0.1 - columns["min_gap"]
    moments = types.SimpleNamespace(smallest=-0.1, largest=0.1)
    few = {"finite": columns.__getitem__, "moments": lambda column: moments, "weighting": None}
    few |= {"stored_topology": None}
    ax = plots.min_gap(types.SimpleNamespace(**few, si=True, columns=(*columns,)), new_axes())
    assert "min = gap at rest: 30 %" in legend(ax)
    legible(ax.figure, ax.get_legend().texts)


def test_convergence_ends_at_the_estimate_and_exceedance_is_the_share_of_larger_gaps(found, ax):
    plots.convergence(found, ax, gap=0.3)
    n, value = ax.lines[0].get_data()
    assert (n[-1], value[-1]) == (400, found.pounding_probability(0.3).value)
    assert value[0] == np.mean(found["required_gap"][:10] >= 0.3)
    ends = ax.collections[0].get_paths()[0].vertices
    low, high = found.pounding_probability(0.3)[1:3]
    assert {round(low, 12), round(high, 12)} <= {round(y, 12) for x, y in ends if x == 400}
    assert plots.convergence(found).figure.number in pyplot.get_fignums()
    ax = plots.exceedance(found, new_axes(), rules_at=0.1)
    gaps, shares = ax.lines[0].get_data()
    for gap, share in zip(gaps[::7], shares[::7], strict=True):
        assert np.mean(found["required_gap"] >= gap) == pytest.approx(share)
    rules = found.separation(0.1)
    assert set(ax.lines[1].get_ydata()) == {0.1}
    marked = [line.get_xdata()[0] for line in ax.lines[2:]]
    assert marked == [rules.double_difference, rules.srss, rules.absolute_sum]
    drawn = [artist.get_label() for artist in (*ax.lines, *ax.collections)]
    assert {*legend(ax)} == set(drawn)
    assert not any(words.startswith("_") for words in drawn)
    ax.figure.draw_without_rendering()
    box = ax.get_legend().get_window_extent()
    assert box.y0 >= ax.bbox.y1  # nothing drawn is under it
    assert ax.figure.bbox.x0 <= box.x0 <= box.x1 <= ax.figure.bbox.x1
    in_si = dataclasses.replace(found, scales=SCALES)
    assert r"g/\omega_1^2" in ax.get_xlabel()
    assert "(m)" in plots.exceedance(in_si, new_axes()).get_xlabel()
    panel = plots.scatter_matrix(in_si, ["peak_f1"]).axes[0]
    assert "(MN)" in panel.get_ylabel()
    assert panel.lines[0].get_ydata().max() == pytest.approx(in_si["peak_f1"].max() / 1e6)


def pounding(found):
    """Made up: the stronger the ground, the likelier."""
    return np.arange(400) % 7 < 4 * found["pga"] / found["pga"].max()


def test_a_fragility_has_its_data_and_its_curve_or_a_curve_alone(found, ax):
    for curve, runs in (
        (jp.fit_fragility(found["pga"], pounding(found)), np.full(12, 400 / 12)),
        (jp.fit_fragility([0.1, 0.2, 0.4], [1, 5, 9], [10, 10, 10]), [10, 10, 10]),
    ):
        ax = plots.fragility(curve, new_axes(), "PGA ($g$)")
        im, p = ax.lines[0].get_data()
        np.testing.assert_allclose(p, curve.probability(im))
        _, share = ax.containers[0][0].get_data()
        assert share @ runs == pytest.approx(curve.pounding.sum(), rel=0.02)
        assert ax.get_xlabel() == "PGA ($g$)"
    curve = jp.study.Fragility(0.6, 0.4)
    ax = plots.fragility(curve, new_axes())
    (line,) = ax.lines
    np.testing.assert_allclose(line.get_ydata(), curve.probability(line.get_xdata()))
    assert not ax.containers
    assert not ax.collections
    assert ax.get_xlabel() == "im"
    plots.fragility(jp.study.Fragility(0.6, 0.4, np.diag([0.01, 0.01]), measure="PGA (g)"), ax)
    assert len(ax.collections) == 1
    assert ax.get_xlabel() == "PGA (g)"
    assert ax.lines[1].get_label() == r"$\theta$ = 0.6 g, $\beta$ = 0.4"


def curves(n):
    """Of links of which each is more fragile than the one before, and of any of them."""
    pga, runs = [0.1, 0.2, 0.4, 0.8], [20] * 4
    links = {f"link {k + 1}": jp.fit_fragility(pga, [0, 2, 5 + k, 9 + k], runs) for k in range(n)}
    return links | {"any link": jp.fit_fragility(pga, [1, 4, 15, 20], runs)}


def test_fragility_of_links_and_of_any_link_in_one_figure(ax):
    drawn = curves(3)
    plots.fragility(drawn, ax, "PGA ($g$)")
    for line, (name, curve) in zip(ax.lines, drawn.items(), strict=True):
        assert line.get_label() == name
        np.testing.assert_allclose(line.get_ydata(), curve.probability(line.get_xdata()))
    assert len({line.get_color() for line in ax.lines}) == 4
    (black,) = (line for line in ax.lines if line.get_color() == COLOURS["ground"])
    assert (black.get_label(), black.get_linestyle()) == ("any link", "--")
    assert legend(ax) == [*drawn, "95 % band"]
    ax.figure.draw_without_rendering()
    assert ax.get_ylim() == (0, 1)
    assert ax.get_legend().get_window_extent().y0 > ax.get_window_extent().y1
    assert ax.get_window_extent().height > 0.55 * ax.figure.bbox.height
    assert sum(bool(band.get_paths()) for band in ax.collections) == 4
    ax = plots.fragility(curves(9), new_axes())
    assert legend(ax) == ["link 1", "link 9", "any link", "95 % band"]
    assert len({line.get_color() for line in ax.lines}) == 10
    refused(r"fragility: curve = {} must hold at least one curve", plots.fragility, {}, ax)
    refused(r"curve\['link 1'\] = 0.4 must be of type Fragil", plots.fragility, {"link 1": 0.4}, ax)


def test_scatter_has_a_panel_for_each_pair_in_the_unit_of_the_study():
    found = random_study()
    figure = plots.scatter_matrix(found, ["required_gap", "peak_f1"], ["friction", "period_1"])
    assert len(figure.axes) == 4
    x, y = figure.axes[3].lines[0].get_data()
    np.testing.assert_array_equal(x, found.parameters()["period_1"])
    np.testing.assert_array_equal(y, found["peak_f1"])
    rank = found.correlations("peak_f1")["period_1"]
    assert figure.axes[3].get_title() == f"rank corr. {rank:+.2f}".replace("-", "−")
    medians, order = figure.axes[3].lines[1].get_ydata(), np.argsort(x)
    ends = np.median(y[order[:5]]), np.median(y[order[-5:]])
    np.testing.assert_allclose(medians[[0, -1]], ends)
    # What chance alone gives is left out.
    chosen = plots.scatter_matrix(found).axes
    ranks = sorted(map(abs, found.correlations().values()), reverse=True)
    assert len(chosen) == min(4, sum(rank > 1.96 / 50**0.5 for rank in ranks)) < len(ranks)
    refused("'mass' must be one of friction, amplitud", plots.scatter_matrix, found, names=["mass"])
    units = {
        "friction": (r"friction $\mu$ ($m_1 g$)", "friction (kN)", 1e-3 * SCALES.force),
        "amplitude_1": (r"amplitude 1 ($g/\omega_1^2$)", "amplitude 1 (m)", SCALES.length),
        "period_1": (r"period 1 ($1/\omega_1$)", "period 1 (s)", SCALES.time),
    }
    for seen, place in ((found, 0), (dataclasses.replace(found, scales=SCALES), 1)):
        panels = plots.scatter_matrix(seen, names=list(units)).axes
        for ax, (name, told) in zip(panels, units.items(), strict=True):
            assert ax.get_xlabel() == told[place]
            drawn = (told[2] if place else 1.0) * found.parameters()[name]
            np.testing.assert_allclose(ax.lines[0].get_xdata(), drawn)
    for name, scales, size, expected in (
        ("rod_1.order", SCALES, 1.0, (1.0, "rod 1: order")),
        ("intensity", SCALES, 1.0, (1.0, "intensity")),
        (f"{STOREY}.stiffness", IN_SI, 2e7, (1.0, "building 2, storey 1: stiffness (N/m)")),
        (
            f"{STOREY}.tau_x",
            IN_SI,
            0.1,
            (1.0, "building 2, storey 1: relaxation time of displacement (s^order)"),
        ),
        ("links.1.friction", SCALES, 1e-6, (SCALES.force, "link 2: friction (N)")),
        ("links.1.gap", None, 1.0, (1.0, r"link 2: $\xi_0$ ($g/\omega_1^2$)")),
        ("initial_gap", SCALES, 1.0, (SCALES.length, "gap at rest (m)")),
    ):
        assert parameter_axis(name, scales, size) == expected
    assert parameter_name("buildings.0.rods.1.stiffness") == "building 1, storey 2: $K$"
    assert parameter_name("links.0.contact.stiffness") == "link 1, contact, stiffness"


def test_bars_are_the_correlations_and_indices_largest_on_top(ax):
    found = random_study()
    plots.correlations(found, ax)
    names = [text.get_text() for text in ax.get_yticklabels()]
    expected = found.correlations()
    ranked = sorted(expected, key=lambda name: abs(expected[name]))
    assert names == [parameter_name(name) for name in ranked]
    assert r"friction $\mu$" in names
    assert [bar.get_width() for bar in ax.patches] == [expected[name] for name in ranked]
    shares = {"none": (0.0, 0.01), "two": (0.2, 0.25), "one": (0.7, 0.8)}
    first, total = (
        {name: Estimate(pair[i], pair[i] - 0.1, pair[i] + 0.1) for name, pair in shares.items()}
        for i in range(2)
    )
    indices = Sensitivity("peak_x1", 64, first, dict(reversed(total.items())))
    ax = plots.sensitivity(indices, new_axes())
    assert [text.get_text() for text in ax.get_yticklabels()] == [*shares]
    bars = [container for container in ax.containers if hasattr(container, "patches")]
    widths = [[bar.get_width() for bar in container.patches] for container in bars]
    assert widths == [[pair[i] for pair in shares.values()] for i in range(2)]


def test_weights_are_drawn(found, ax):
    """Of weights that leave samples out, every figure is that of the others."""
    those = np.arange(400) % 2 == 0
    some = found.weighted(np.where(those, 3.0, 0.0))
    plots.min_gap(some, ax)
    area = sum(bar.get_width() * bar.get_height() for bar in ax.containers[0])
    assert area == pytest.approx(1, abs=0.006)
    share = next(other for other in ax.figure.axes if other is not ax).lines[0].get_ydata()
    assert share[-1] == pytest.approx(1)
    line = plots.convergence(some, new_axes(), gap=0.3).lines[0]
    assert line.get_ydata()[-1] == pytest.approx(some.pounding_probability(0.3).value)
    gaps, shares = plots.exceedance(some, new_axes()).lines[0].get_data()
    assert shares[-5] == pytest.approx(np.mean(found["required_gap"][those] >= gaps[-5]))
    curve = jp.fit_fragility(found["pga"], pounding(found), weights=1.0 * those)
    _, share = plots.fragility(curve, new_axes()).containers[0][0].get_data()
    assert share.mean() == pytest.approx(curve.pounding[those].mean(), abs=0.04)
