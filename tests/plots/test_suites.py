"""Suites: the spectra, mean and target that are drawn are those of the suite."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from jaxpound.plots import suites
from tests.ground.test_scaling import TARGET, scaled
from tests.ground.test_suite import SUITE


def test_spectra_their_mean_and_the_target():
    found, ax = scaled((1e-3, 1e3)), Figure().add_subplot()
    assert suites.spectra(found, ax) is ax
    *records, mean, target, share = ax.lines
    at = records[0].get_xdata()
    expected = found.suite.spectra(at)
    np.testing.assert_allclose([line.get_ydata() for line in records], expected)
    np.testing.assert_allclose(mean.get_ydata(), expected.mean(axis=0))
    np.testing.assert_allclose(target.get_ydata(), TARGET.at(target.get_xdata()))
    np.testing.assert_allclose(share.get_xdata()[[0, -1]], found.range)
    names = [text.get_text() for text in ax.get_legend().get_texts()]
    assert names == ["3 records", "their mean", "target", "90 % of it", "period range"]
    ax.figure.draw_without_rendering()


def test_a_suite_alone():
    ax = suites.spectra(SUITE, Figure().add_subplot(), periods=[0.1, 0.5, 1.0], damping=0.1)
    np.testing.assert_allclose(ax.lines[0].get_ydata(), SUITE.spectra([0.1, 0.5, 1.0], 0.1)[0])
    assert "10 %" in ax.get_ylabel()
    assert "(s)" in ax.get_xlabel()
    with pytest.raises(ValueError, match=r"suite = .* must be of type"):
        suites.spectra(SUITE[0])
