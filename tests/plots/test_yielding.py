"""Figures of what yields: cyclic tests and pushover curves, with their units."""

import numpy as np
import pytest

import jaxpound as jp
from jaxpound import plots
from tests.plots.runs import legend, new_axes
from tests.refusals import refused

TEST = jp.study.cyclic_test(jp.Bilinear(0.02, 0.05), [0.0, 0.06, -0.06], 2e6, 8)


def test_cyclic_tests_over_what_was_measured_and_pushover_curves_with_first_yields(ax):
    measured = np.asarray(TEST.force) + 1e3
    plots.cyclic_test(TEST, measured, ax)
    points, line = ax.lines
    np.testing.assert_allclose(line.get_data(), [TEST.displacement, TEST.force / 1e3])
    np.testing.assert_allclose(points.get_ydata(), measured / 1e3)
    assert legend(ax) == ["measured", "law"]
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("displacement $e$ (m)", "force $f$ (kN)")
    ax = plots.cyclic_test(TEST, ax=new_axes(), si=False)
    names = r"displacement $e$ ($g/\omega_1^2$)", "force $f$ ($m_1 g$)"
    assert (ax.get_xlabel(), ax.get_ylabel()) == names
    assert not legend(ax)
    refused(r"measured of shape \(3,\) must be \(17,\)", plots.cyclic_test, TEST, measured[:3])
    frame = jp.ShearBuilding.from_period(2, 300e3, period=0.5, damping_ratio=0.05)
    weak = frame.yielding(yield_force=[1e6, 0.9e6], hardening=0.1)
    ax = plots.pushover(weak, 6.0, new_axes())
    pushed = jp.pushover(weak, 6.0)
    line, points = ax.lines
    np.testing.assert_allclose(line.get_data(), [pushed.drifts.sum(1), pushed.base_shear / 1e3])
    assert points.get_ydata() == pytest.approx([1e3, 1.5 * 0.9e3])
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("roof displacement (m)", "base shear $V$ (kN)")
    plots.pushover(weak.with_p_delta(), 6.0, ax)
    strong = frame.yielding(yield_force=[4e6, 3e6], hardening=0.1)
    plots.pushover(strong, 6.0, ax)
    assert len({line.get_color() for line in ax.lines}) == 3
    pushed = jp.pushover(strong, 6.0)
    ends = pushed.drifts.sum(1).max(), pushed.base_shear.max() / 1e3
    for (least, most), end in zip((ax.get_xlim(), ax.get_ylim()), ends, strict=True):
        assert least == 0
        assert end < most < 1.2 * end
