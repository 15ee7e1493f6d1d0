"""Shares of the way between bounds: maps, inverses, and what they keep physical."""

import dataclasses

import jax
import numpy as np
import pytest
from hypothesis import given, strategies

import jaxpound as jp
from jaxpound import DesignSpace
from jaxpound._fields import rules
from jaxpound.design import Bounds
from tests.refusals import refusals

PAPER = jp.paper.structures()
ALL = {
    "friction": (0.0, 1.0),
    "rod_1.order": (0.05, 0.95),
    **{"rod_1.tau_f": Bounds(0.001, 2.0, "log"), "rod_1.tau_x": Bounds(0.5, 20.0, "log")},
    **{"rod_2.tau_f": (0.01, 3.0), "rod_2.tau_x": (1.0, 10.0)},
    **{"stiffness_ratio": Bounds(0.5, 4.0, "log"), "mass_ratio": (0.5, 2.0)},
}
SPACE = DesignSpace(PAPER, ALL)
structures_at, values_at = jax.jit(SPACE.structures), jax.jit(SPACE.values)
shares = strategies.lists(strategies.floats(0.0, 1.0), min_size=8, max_size=8).map(np.array)


@given(shares)
def test_every_share_is_physical_and_within_its_bounds(at):
    structures = structures_at(at)
    for rule in rules(structures):
        assert rule.holds, rule
    for rod in (structures.rod_1, structures.rod_2):
        assert 0 < rod.tau_f < rod.tau_x
        assert 0 < rod.order < 1
    for path, value in values_at(at).items():
        bounds = SPACE.variables[path]
        slack = 1e-12 * bounds.high
        assert bounds.low - slack <= value <= bounds.high + slack


@given(shares)
def test_values_and_shares_are_inverse(at):
    there = values_at(at)
    np.testing.assert_allclose(SPACE.shares({k: float(x) for k, x in there.items()}), at, atol=1e-9)
    np.testing.assert_allclose(SPACE.shares(structures_at(at)), at, atol=1e-9)


def test_values_follow_their_scales_and_rules_and_all_else_is_nominal():
    space = DesignSpace(PAPER, {"friction": (0.1, 0.5), "rod_2.tau_x": Bounds(1.0, 100.0, "log")})
    middle = space.values(np.array([0.5, 0.5]))
    assert float(middle["friction"]) == pytest.approx(0.3)
    assert float(middle["rod_2.tau_x"]) == pytest.approx(10.0)
    both = DesignSpace(PAPER, {"rod_1.tau_x": (0.01, 5.0), "rod_1.tau_f": (0.001, 1.0)})
    assert both.names == ("rod_1.tau_f", "rod_1.tau_x")
    assert float(both.values(np.array([1.0, 0.0]))["rod_1.tau_x"]) == pytest.approx(1.001)
    one = DesignSpace(PAPER, {"rod_2.tau_x": (0.01, 5.0)})
    assert float(one.values(np.array([0.0]))["rod_2.tau_x"]) == pytest.approx(0.2 * 1.001)
    space = DesignSpace(PAPER, {"friction": (0.0, 1.0)})
    made = space.structures(np.array([0.5]), {"mass_ratio": 1.5})
    assert (made.friction, made.mass_ratio, made.rod_2.tau_x) == (0.5, 1.5, 4.0)


def test_derivatives_are_those_of_the_map():
    at = np.full(8, 0.3)
    slopes = jax.jit(jax.jacfwd(SPACE.values))(at)
    h = 1e-6
    for i in range(8):
        up, down = (values_at(at + h * np.eye(8)[i] * k) for k in (1, -1))
        for name in SPACE.names:
            difference = float(up[name] - down[name]) / (2 * h)
            assert float(slopes[name][i]) == pytest.approx(difference, rel=1e-5, abs=1e-7)


LARGEST = "rod_2.tau_f = {0}, as large as it may be, must be below tau_x = {0}"
BEYOND = dataclasses.replace(PAPER, friction=1.5)
test_bad_spaces_are_named = refusals(
    (lambda: Bounds(1.0, 1.0), "high = 1 must be finite and above low = 1"),
    (lambda: Bounds(2.0, 1.0), "high = 1 must be finite and above low = 2"),
    (lambda: Bounds(np.nan, 1.0), "low = nan must be finite"),
    (lambda: Bounds(0.0, 1.0, "log"), "low = 0 must be positive for a log scale"),
    (lambda: Bounds(0.0, 1.0, "cubic"), "scale = 'cubic' must be 'linear' or 'log'"),
    (lambda: DesignSpace(PAPER, {}), "must name a parameter"),
    (lambda: DesignSpace(PAPER, {"fricton": (0, 1)}), "did you mean 'friction'"),
    (lambda: DesignSpace(PAPER, {"friction": 0.3}), "friction = 0.3 must be Bounds or"),
    (lambda: DesignSpace(PAPER, {"friction": (1, 0)}), "friction: Bounds: high = 0 must"),
    (lambda: DesignSpace(PAPER, {"friction": (-1, 0)}), "friction: low = -1 must be at"),
    (lambda: DesignSpace(PAPER, {"rod_1.order": (0.1, 2)}), "high = 2 must be at most 1"),
    (lambda: DesignSpace(PAPER, {"rod_2.tau_f": (0.1, 4.0)}), LARGEST.format(4)),
    (lambda: DesignSpace(PAPER, {"rod_2.tau_x": (0.1, 0.2)}), LARGEST.format(0.2)),
    (lambda: SPACE.shares(BEYOND), "friction = 1.5 must be between its bounds, 0 and 1"),
    (lambda: SPACE.shares({"friction": 0.5}), "design lacks 'rod_1.order'"),
)
