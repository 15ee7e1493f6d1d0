"""Figures of rare events."""

import dataclasses
from functools import partial

import numpy as np
import pytest
from scipy.special import ndtri

import jaxpound as jp
from jaxpound.plots import rare_events
from jaxpound.reliability.design_points import DesignPoints
from jaxpound.reliability.result import Samples
from tests.made import in_si
from tests.plots.runs import legend
from tests.refusals import refused
from tests.reliability.test_rare_event import FEW, HILLS, SHORT

STATE = jp.LimitState(FEW, SHORT, threshold=0.2)
ACCELERATION = dataclasses.replace(STATE, demand="peak_acceleration_1")
SCALES = jp.Scales(mass=1e5, frequency=5.0)
PAIR = in_si(jp.paper.structures(), SCALES)


def in_seconds(z):
    """The motion of ``FEW`` in seconds."""
    return jp.Record(HILLS @ z, 0.1 / 5.0)


IN_SI = jp.Scenarios(PAIR, jp.CustomDraw(in_seconds, 5))
STATE_IN_SI = jp.LimitState(IN_SI, jp.TimeGrid.until(8.0 / 5.0, 0.1 / 5.0), threshold=0.08)


def event(gap, probability, state=STATE, instant=6.0):
    state, point = dataclasses.replace(state, threshold=gap), [1.0, -2.0, 1.0, 1.0, -1.0]
    along, beta = np.array([point]) / 8**0.5, np.array([-ndtri(0.8 * probability)])
    numbers = np.array([round(instant / state.grid.dt)]), np.array([0])
    points = DesignPoints(along * beta, along, beta, *numbers)
    n = round(1 / probability)
    samples = Samples(np.zeros((n, 5)), np.ones(n), np.r_[1.0, -np.ones(n - 1)])
    estimate = samples.probability, samples.cov
    return jp.RareEvent(state, samples, *estimate, points, 1000, 100, method="made up")


def test_a_design_earthquake_and_a_curve_of_probabilities(ax):
    """Of a gap that closes, and of an acceleration, which is in m/s² in SI units."""
    closes, moves = event(0.2, 1e-3), event(0.3, 1e-3, ACCELERATION)
    earthquake = closes.design_earthquakes[0]
    response = jp.simulate(earthquake.structures, earthquake.ground, STATE.grid)
    closing = 1 - np.asarray(response.links[0].gap)
    above, below = rare_events.design_earthquake(closes).axes
    assert above.lines[0].get_ydata() == pytest.approx(np.asarray(response.ground_acceleration))
    assert below.lines[0].get_ydata() == pytest.approx(closing)
    instant = r"$t$ = 6$/\omega_1$, $\beta$ = 3.16"
    assert legend(below) == ["closing, 1–2, floor 1", "threshold", instant]
    in_metres = partial(event, state=STATE_IN_SI, instant=6.0 / 5.0)
    length, unit = float(SCALES.length), float(SCALES.gravity)
    _, below = rare_events.design_earthquake(in_metres(0.2 * length, 1e-3)).axes
    assert below.lines[0].get_ydata() == pytest.approx(closing * length, rel=1e-6, abs=1e-9)
    assert below.lines[0].get_xdata()[-1] == pytest.approx(8.0 / 5.0)
    assert (below.get_xlabel(), below.get_ylabel()) == ("time $t$ (s)", "closing (m)")
    earthquake = moves.design_earthquakes[0]
    response = jp.simulate(earthquake.structures, earthquake.ground, STATE.grid)
    _, below = rare_events.design_earthquake(moves).axes
    series, threshold = (line.get_ydata() for line in below.lines[:2])
    assert series == pytest.approx(np.asarray(response.absolute_accelerations[0]))
    assert threshold[0] == 0.3
    assert below.get_ylabel() == "acceleration ($g$)"
    in_si = dataclasses.replace(STATE_IN_SI, demand="peak_acceleration_1")
    _, below = rare_events.design_earthquake(event(0.3 * unit, 1e-3, in_si, 6.0 / 5.0)).axes
    of_si, threshold = (line.get_ydata() for line in below.lines[:2])
    assert of_si == pytest.approx(unit * series, rel=1e-6, abs=1e-9)
    assert threshold[0] == pytest.approx(0.3 * unit)
    assert below.get_ylabel() == "acceleration (m/s²)"
    refused("number = 1 must be from 0 to 0", rare_events.design_earthquake, closes, 1)
    events = [event(0.4, 1e-5), event(0.2, 1e-3)]
    estimate, form = rare_events.probability_curve(events, ax).lines
    assert estimate.get_xdata().tolist() == [0.2, 0.4]
    assert estimate.get_ydata().tolist() == [1e-3, 1e-5]
    assert form.get_ydata() == pytest.approx([8e-4, 8e-6])
    assert ax.get_xlabel() == r"required gap ($g/\omega_1^2$)"
    metres = np.array([0.2, 0.4]) * length
    rare_events.probability_curve([in_metres(x, 1e-3) for x in metres.tolist()], ax)
    assert ax.lines[-2].get_xdata() == pytest.approx(metres)
    assert ax.get_xlabel() == "required gap (m)"
    refused("two or more", rare_events.probability_curve, events[:1])
