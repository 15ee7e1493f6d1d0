"""Incremental dynamic analyses and clouds: what is drawn is what was found."""

import dataclasses

import numpy as np
import pytest

import jaxpound as jp
from jaxpound.plots import ida, studies
from tests.plots.runs import legend, new_axes
from tests.refusals import refused

IM = np.array([0.1, 0.2, 0.4])
DEMANDS = np.array([[0.01, 0.02, 0.04], [0.02, 0.04, 0.08], [0.01, 0.03, 0.05]])
FOUND = jp.hazard.IncrementalDynamicAnalysis(
    *(("a", "b", "c"), np.array([0.3, 0.2, 0.1]), IM, DEMANDS, np.array([np.inf, 0.25, 0.4])),
    *(0.05, "required_gap", "Sa(0.9 s) (g)"),
)


def test_curves_fractiles_and_capacities(ax):
    ida.curves(FOUND, ax)
    *records, low, middle, high, threshold, dots = ax.lines
    np.testing.assert_allclose([line.get_xdata() for line in records], DEMANDS)
    for line, expected in zip((low, middle, high), FOUND.fractiles(), strict=True):
        np.testing.assert_allclose(line.get_xdata(), expected)
        np.testing.assert_allclose(line.get_ydata(), IM)
    assert threshold.get_xdata()[0] == 0.05
    np.testing.assert_allclose(dots.get_ydata(), [0.25, 0.4])
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("required gap (m)", "$S_a$(0.9 s) ($g$)")
    assert legend(ax) == ["3 records", "16 and 84 %", "median", "threshold", "first reached"]
    ax.figure.draw_without_rendering()
    force = dataclasses.replace(FOUND, demand="peak_contact", demands=1e9 * DEMANDS, threshold=5e7)
    ax = ida.curves(force, new_axes())  # in larger units
    assert ax.get_xlabel() == "peak contact force (MN)"
    np.testing.assert_allclose(ax.lines[0].get_xdata(), 1e3 * DEMANDS[0])


@pytest.mark.parametrize(("demand", "limit"), [(0.0, 0.05), (-0.02, 0.0)])
def test_a_single_run_is_a_figure_too(demand, limit, ax):
    """Of a demand that is 0, and of an overlap; a warning of Matplotlib's would be an error."""
    of_one = {"names": ("a",), "unscaled": np.ones(1), "intensities": IM[:1], "threshold": limit}
    of_one |= {"demands": np.array([[demand]]), "capacities": np.array([np.inf])}
    ida.curves(dataclasses.replace(FOUND, **of_one), ax).figure.draw_without_rendering()
    left, right = ax.get_xlim()
    assert left <= demand < right >= limit


def fragility(analysis, ax):
    """Drawn as the command line does."""
    measure = ida.in_symbols(analysis.measure)
    return studies.fragility(analysis.fragility(), ax, measure)


def test_a_cloud_with_its_line_and_the_fragility_of_capacities_with_their_distribution(ax):
    cloud = jp.hazard.fit_cloud(
        *np.array([[0.1, 0.2, 0.3, 0.5], [0.01, 0.03, 0.02, 0.1]]), limit=0.05
    )
    line, records, bounds = ida.cloud(cloud, ax).lines
    np.testing.assert_allclose(line.get_ydata(), cloud.median(line.get_xdata()))
    np.testing.assert_allclose(records.get_ydata(), [0.01, 0.03, 0.02])
    np.testing.assert_allclose(bounds.get_ydata(), [0.05])
    ax.figure.draw_without_rendering()
    refused("analysis = 3 must be of type Incremental", ida.curves, 3)
    refused("found = 3 must be of type Cloud", ida.cloud, 3)
    ax.clear()
    (data,) = fragility(FOUND, ax).containers
    np.testing.assert_allclose(data.lines[0].get_data(), [[0.25, 0.4], [1 / 3, 2 / 3]])
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("$S_a$(0.9 s) ($g$)", "probability of pounding")
    drift = dataclasses.replace(FOUND, demand="peak_drift")
    assert "largest storey drift ≥ 0.05 m" in fragility(drift, new_axes()).get_ylabel()
