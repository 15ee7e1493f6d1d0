"""Rare events with failures that are hard to find: they are found, or the estimate says so."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.special import ndtr, ndtri

import jaxpound as jp
from tests.refusals import refused
from tests.reliability.searches import event_of

KEYS = range(10)


class Analytic:
    """A limit state of forty numbers in closed form: ``demanded`` has values with gradients."""

    dimension, series, level, threshold = 40, (), 0.0, 0.0
    demand = staticmethod(lambda scalars: scalars)
    discrete_names, searches_overlaps, grid = "", False, jp.TimeGrid.until(8.0, dt=0.1)
    time_step = grid.dt

    def values(self, z):
        return self.demanded(z)[0]

    def values_and_times(self, z):
        return self.values(z), np.full(len(z), np.nan)

    def gradients(self, z, instants, series):
        (values, parts), slopes = self.demanded(z), np.zeros_like(z)
        for number, slope in parts.items():
            slopes[:, number] = slope
        return values, slopes


class Samples(Analytic):
    """The peak of forty independent samples, either of which may be of either sign."""

    probability = 1e-3

    def demanded(self, z):
        largest = np.abs(z).argmax(axis=1)
        peaks = np.take_along_axis(z, largest[:, None], axis=1)[:, 0]
        slopes = {number: np.sign(peaks) * (largest == number) for number in range(40)}
        return np.abs(peaks) + ndtri((1 - (1 - self.probability) ** (1 / 40)) / 2), slopes


class Flat(Analytic):
    """Two ways to fail; the second, three times as likely, is flat up to 3.23 from the origin."""

    probability = 1 - ndtr(4.0) * ndtr(3.73)

    def demanded(self, z):
        first, second = z[:, 0], 8 * np.maximum(z[:, 1] - 3.23, 0)
        slopes = {0: first >= second, 1: 8.0 * (second > first)}
        return np.maximum(first, second) - 4, slopes


class Regime(Analytic):
    """A closing at every instant, 3.5 times as large where another number is above 3.1."""

    series = ("closing",)
    high = 3.1
    probability = ndtr(-5.0) + ndtr(-3.1) * ndtr(-5 / 3.5)

    def demanded(self, z):
        factor = 1 + 2.5 * ndtr(40 * (z[:, 1] - self.high))
        steep = 100 * np.exp(-((40 * (z[:, 1] - self.high)) ** 2) / 2) / np.sqrt(2 * np.pi)
        return factor * z[:, 0] - 5, {0: factor, 1: steep * z[:, 0]}


class Unlikely(Regime):
    """The same, with a regime that is out of reach."""

    high, probability = 9.0, ndtr(-5.0)


class Beyond(Analytic):
    """So flat at the origin that every gradient there points beyond what is sought."""

    series = ("closing",)
    probability = 2 * ndtr(-4.5)

    def demanded(self, z):
        rise = np.exp(np.minimum(6 * (np.abs(z[:, 0]) - 4.5), 30))
        return rise - 1, {0: 6 * rise * np.sign(z[:, 0])}


@dataclass
class Impacts(Analytic):
    """Impacts of five numbers, one after the other over the run; a number's begins at 3."""

    threshold: float = 1.0

    series, searches_overlaps, stiffness = ("overlap",), True, 50.0

    @property
    def beta(self):
        return 3 + (self.threshold / self.stiffness) ** (2 / 3)

    @property
    def probability(self):
        return 1 - ndtr(self.beta) ** 5

    def values(self, z):
        overlap = np.maximum(z[:, :5].max(axis=1) - 3, 0)
        return self.stiffness * overlap**1.5 - self.threshold

    def gradients(self, z, instants, series):
        slopes = np.eye(40)[instants * 5 // (self.grid.n_steps + 1)]
        return (z * slopes).sum(axis=1) - 3 - self.threshold, slopes


def by_points(event, rows):
    """The event with some of its design points alone."""
    return replace(event, design_points=event.design_points.rows(rows))


def is_right(event, probability):
    return abs(event.probability / probability - 1) < 3 * event.cov


def assert_sampled(event, state):
    """The event of a state is right, and has nothing to warn of."""
    assert is_right(event, state.probability)
    assert event.warnings == ()
    assert event.method.startswith("importance sampling")


@pytest.mark.parametrize(("state", "points"), [(Samples(), 60), (Unlikely(), 1)])
def test_nothing_is_hidden(state, points):
    """Of eighty ways to fail, and of one that is out of reach: nothing is said of either."""
    for key in KEYS:
        event = event_of(state, key=key, progress=False)
        assert_sampled(event, state)
        assert len(event.design_points) > points


def test_a_start_does_not_vouch_for_its_points():
    """Random starts count them again: those that a start lacks are found, from few starts more."""
    cold = event_of(Samples(), key=100, progress=False)
    warm = event_of(Samples(), key=1, start=cold, progress=False)
    assert warm.gradients < 0.5 * cold.gradients
    few = by_points(cold, slice(10))
    for event in (warm, event_of(Samples(), start=few, progress=False)):
        assert len(event.design_points) > 60
        assert_sampled(event, Samples)


def test_overlaps_lead_to_impacts():
    """To each of the five, from all instants, though forces have no slope before blocks meet."""
    likelier, rarer = Impacts(1.0), Impacts(30.0)
    for key in KEYS:
        event = event_of(likelier, key=key, progress=False)
        later = event_of(rarer, key=key, start=event, progress=False)
        assert later.gradients < 0.7 * event.gradients
        for state, known in ((likelier, event), (rarer, later)):
            assert_sampled(known, state)
            assert len(known.instants) == 26
            assert known.design_points.z.max(axis=1) == pytest.approx(state.beta, abs=0.03)
            assert {*known.design_points.z.argmax(axis=1)} == {*range(5)}
            # The runs on the ways to overlaps are counted.
            assert known.runs > len(known.samples.values) + 512


@pytest.mark.parametrize("state", [Flat(), Regime()])
def test_failures_in_a_direction_without_a_slope(state):
    for key in KEYS:
        event = event_of(state, key=key, method="design points", max_runs=2000, progress=False)
        assert is_right(event, state.probability) or "fail far from all" in event.warnings[0]
    event = event_of(state, cov=0.2, progress=False)
    assert "fail far from all design points: subset simulation" in event.method
    assert is_right(event, state.probability)


def test_no_design_point_is_no_bound():
    state, words = Beyond(), "gradients must lead to the limit state"
    by_points = {"method": "design points", "progress": False}
    for unreached in (state, Impacts(5000.0)):
        refused(f"{words}, but none of", event_of, unreached, **by_points)
    event = event_of(state, progress=False)
    assert event.method.startswith("no gradients lead to the limit state: subset simulation")
    assert is_right(event, state.probability)


def test_a_bar_says_what_is_compiled(capsys):
    compiled = "compiling the runs", "compiling the gradients", "P = "
    for method, words in (("design points", compiled), ("subset", compiled[::2])):
        event_of(Unlikely(), method=method, cov=0.5)
        screen = capsys.readouterr().err
        places = [screen.find(x) for x in words]
        assert places == sorted(places)
        assert places[0] >= 0
