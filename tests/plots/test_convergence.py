"""Errors by step: the order written beside a line is that of its errors."""

import numpy as np

from jaxpound.plots.convergence import errors_by_step
from tests.plots.runs import legend, new_axes

STEPS = np.array([0.04, 0.02, 0.01, 0.005])


def test_orders_are_fitted_where_errors_fall():
    ax = new_axes()
    errors = {"good": -3 * STEPS**2, "fair": 0.1 * STEPS, "stuck": [0.1, 0.12, 0.09, 0.1]}
    errors |= {"slow": STEPS**0.1, "ragged": STEPS**1.5 * [1, 2, 0.4, 1.5], "none": 0 * STEPS}
    assert errors_by_step(STEPS, errors, ax, "error of min gap ($g/\\omega_1^2$)") is ax
    orders = ["good (order 2.00)", "fair (order 1.00)"]
    assert legend(ax) == [*orders, "stuck", "slow", "ragged", "none"]
    np.testing.assert_allclose(ax.lines[0].get_ydata(), 3 * STEPS**2)
    assert ax.get_xscale() == ax.get_yscale() == "log"
    assert ax.get_ylabel().startswith("error of min gap")
