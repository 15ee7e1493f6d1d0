"""Axes, runs and checks that the tests of figures share; each run is made once."""

import itertools

import matplotlib as mpl
import pytest

import jaxpound as jp
from tests.plots.runs import new_axes, paper_run

mpl.use("Agg")


@pytest.fixture
def ax():
    return new_axes()


@pytest.fixture(scope="session")
def response() -> jp.Response:
    return paper_run()


@pytest.fixture(scope="session")
def legible():
    """Assert that texts are inside of a figure and not on one another."""

    def check(figure, texts):
        figure.draw_without_rendering()
        boxes = [text.get_window_extent() for text in texts]
        whole = figure.bbox
        for box, text in zip(boxes, texts, strict=True):
            assert whole.x0 <= box.x0 <= box.x1 <= whole.x1, text
            assert whole.y0 <= box.y0 <= box.y1 <= whole.y1, text
        assert not any(a.overlaps(b) for a, b in itertools.combinations(boxes, 2))

    return check
