"""The map of gaps: each link in its row, no contact lost."""

import dataclasses

import jax
import numpy as np
import pytest
from matplotlib.colors import to_rgba

import jaxpound as jp
from jaxpound import plots
from tests.made import changed, pair_response, row_of, row_response
from tests.plots.runs import LAW, legend, new_axes
from tests.refusals import refused

TIME = np.linspace(0.0, 20.0, 4001)
LINKS = (
    *jp.floor_links(row_of((2, 2, 1)).buildings, gap=0.5, friction=0.1),
    jp.FloorLink(0, 1, next_building=0, friction=0.1),
)


def swaying(n_floors=(2, 2, 1), links=LINKS, sway=0.1):
    row = row_of(n_floors, links)
    return row_response(row, TIME, lambda i, t: sway * (i + 1) * np.sin((1 + 0.1 * i) * t))


def row_names(ax):
    return [tick.get_text() for tick in ax.get_yticklabels()]


def test_each_link_has_its_named_row_and_each_pixel_the_narrowest_gap_of_its_instants(ax):
    """By buildings, the higher above; links without a gap are left out."""
    run = swaying()
    assert plots.gap_map(run, ax) is ax
    assert row_names(ax) == ["1–2, floor 2", "1–2, floor 1", "2–3, floor 1"]
    (image,) = ax.images
    assert image.get_clim() == (0.0, max(float(run.links[k].gap.max()) for k in range(3)))
    for row, k in zip(image.get_array(), (1, 0, 2), strict=True):
        gap = np.asarray(run.links[k].gap)
        assert row.min() == pytest.approx(gap.min() if gap.min() > 0 else -1.0)
        assert row.max() <= gap.max()
    assert ax.figure.axes[1].get_ylabel() == r"gap $\xi$ ($g/\omega_1^2$)"  # the colour bar
    assert ax.get_xlabel() == r"time $t$ ($1/\omega_1$)"
    ax = new_axes()
    links = (
        jp.FloorLink(0, 1, 0, gap=1.0),
        jp.FloorLink(1, 0, gap=1.0, next_building=jp.GROUND),
        jp.FloorLink(0, 1, gap=1.0, next_building=0),
    )
    run = swaying((2, 1), links)
    plots.gap_map(run, ax)
    assert set(row_names(ax)) == {"1–2, floors 2–1", "2–ground, floor 1", "in 1, floors 1–2"}
    ax = plots.gap_map(dataclasses.replace(run, rods=run.rods[:2]), new_axes())  # no buildings
    assert row_names(ax) == ["masses 2–3", "mass 3–ground", "masses 1–2"]


def test_contacts_of_one_instant_and_newton_s_impacts_are_seen(ax):
    run = pair_response(TIME, {"gap": np.where(np.arange(4001) == 1234, -1e-9, 1.0)})
    plots.gap_map(run, ax)
    (image,) = ax.images
    closed = image.get_array()[0] <= 0
    assert closed.sum() == 1
    assert closed.argmax() * 20.0 / closed.size == pytest.approx(TIME[1234], abs=0.03)
    pixel = image.cmap(image.norm(image.get_array()[0, closed.argmax()]))
    assert pixel == pytest.approx(to_rgba(plots.COLOURS["pounding"]))
    assert "pounding" in legend(ax)[0]
    links = tuple(dataclasses.replace(link, contact=LAW) for link in LINKS[:1])
    run = swaying(links=links, sway=0.0)
    (link,) = run.links
    at = dataclasses.replace(link, touching=(np.arange(4001) == 700).astype(float))
    ax = plots.gap_map(dataclasses.replace(run, links=(at,)), new_axes())
    assert (ax.images[0].get_array() < 0).sum() == 1
    assert "contact" in legend(ax)[0]


def test_wrong_arguments_are_refused(ax):
    run = swaying()
    batch = jax.tree.map(lambda x: np.stack([x, x]), run)
    lost = dataclasses.replace(run, demand=changed(run.demand, pga=np.nan))
    positive = "gap_map: widest = .* must be positive and finite"
    for response, widest, message in (
        *((run, widest, positive) for widest in (0.0, -1.0, np.inf, np.nan)),
        (run, "wide", "gap_map: widest = 'wide' must be a real number"),
        (run, [1.0, 2.0], r"gap_map: widest of shape \(2,\) must be one number"),
        (batch, None, "gap_map: a batch of shape"),
        (lost, None, "gap_map: the run is invalid"),
        (swaying(links=LINKS[-1:]), None, "must have a link with a finite gap"),
        (3, None, "of type Response"),
    ):
        refused(message, plots.gap_map, response, ax, widest)
