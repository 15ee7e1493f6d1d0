"""The drawing of the system: every symbol of the model, the pair's own numbers, nothing outside."""

import jax
import numpy as np
import pytest
from matplotlib.figure import Figure

import jaxpound as jp
from jaxpound.plots.system import mechanical_system


@pytest.mark.parametrize("structures", [None, jp.paper.structures()], ids=["symbols", "numbers"])
def test_every_symbol_stands_in_the_picture_and_none_on_another(structures, legible):
    figure = Figure(figsize=(7.1, 2.9), layout="constrained")
    ax = figure.add_subplot()
    assert mechanical_system(structures, ax) is ax
    words = " ".join(text.get_text() for text in ax.texts)
    for symbol in ("m_1", "m_2", "x_1", "x_2", "u(t)", r"\mu", r"\xi", r"\alpha", r"\beta"):
        assert symbol in words
    legible(figure, ax.texts)


def test_numbers_are_the_structures_own():
    ax = Figure().add_subplot()
    mechanical_system(jp.paper.structures(), ax)
    words = " ".join(text.get_text() for text in ax.texts)
    for number in ("0.23", "0.004", "1.18", "0.53", "0.2", "= 4", r"\mu = 0.25", "= 2"):
        assert number in words


def test_a_batch_is_refused():
    batch = jax.tree.map(lambda x: np.array([x, x]), jp.paper.structures())
    with pytest.raises(ValueError, match="must be a single pair, not a batch"):
        mechanical_system(batch, Figure().add_subplot())
