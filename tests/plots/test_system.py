"""The drawing of the system: every symbol of the model, the pair's own numbers, nothing outside."""

import jax
import numpy as np
import pytest
from matplotlib.figure import Figure

import jaxpound as jp
from jaxpound.plots.system import mechanical_system

SYMBOLS = ["m_1", "m_2", "x_1", "x_2", "u(t)", r"\mu", r"\xi", r"\alpha", r"\beta"]
NUMBERS = ["0.23", "0.004", "1.18", "0.53", "0.2", "= 4", r"\mu = 0.25", "= 2"]


@pytest.mark.parametrize("structures", [None, jp.paper.structures()], ids=["symbols", "numbers"])
def test_every_symbol_stands_in_the_picture_and_none_on_another(structures, legible):
    ax = Figure(figsize=(7.1, 2.9), layout="constrained").add_subplot()
    assert mechanical_system(structures, ax) is ax
    words = " ".join(text.get_text() for text in ax.texts)
    for symbol in SYMBOLS + ([] if structures is None else NUMBERS):
        assert symbol in words
    legible(ax.figure, ax.texts)


def test_a_batch_is_refused(ax):
    batch = jax.tree.map(lambda x: np.array([x, x]), jp.paper.structures())
    with pytest.raises(ValueError, match="must be a single pair, not a batch"):
        mechanical_system(batch, ax)
