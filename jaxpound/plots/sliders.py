"""A slider with a text field for one number, which stays exactly what it was set to.

The float sliders of ipywidgets send the browser's rounding of a value back as the new value. Here
the browser's slider counts marks, whole numbers that are not rounded: it sends a value only when a
user moves it. The number itself is kept in Python, and shown in the text field with all its digits.
"""

from __future__ import annotations

from typing import Any

import ipywidgets as widgets
import numpy as np
import traitlets
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from jaxpound._checks import Rule, enforce, finite


class ExactSlider(widgets.HBox):
    """Words, a slider and a text field in a row; ``value`` is the number, which can be observed.

    The slider can be dragged to ``marks``, increasing, shape (n,). ``value`` need not be a mark,
    nor lie between them: the slider then shows the nearest. A ``ValueError`` if it is not finite.
    """

    value = traitlets.CFloat()

    def __init__(self, words: str, value: float, marks: NDArray[np.float64]) -> None:
        self._marks, self._words, self.first = marks, words, value
        fixed = {"flex": "0 0 auto"}  # neither grows nor shrinks with the number of rows
        name = widgets.Label(words, layout=fixed | {"width": "12em"})
        place, track = self._nearest(value), {"flex": "1 1 auto", "width": "auto"}
        self.position = widgets.IntSlider(place, 0, len(marks) - 1, readout=False, layout=track)
        self.number = widgets.FloatText(value, layout=fixed | {"width": "7.5em"})
        super().__init__([name, self.position, self.number], value=value, layout=fixed)
        self.position.observe(self._dragged, names="value")
        traitlets.link((self, "value"), (self.number, "value"))

    @traitlets.validate("value")
    def _check(self, proposal: Any) -> float:
        value: float = proposal["value"]
        enforce([Rule(self._words, value, finite(value), "finite")])
        return value

    def _nearest(self, value: float) -> int:
        return int(np.searchsorted((self._marks[1:] + self._marks[:-1]) / 2, value))

    @traitlets.observe("value")
    def _show(self, _: Any) -> None:
        self.position.value = self._nearest(self.value)

    def _dragged(self, _: Any) -> None:
        if self.position.value != self._nearest(self.value):  # else it shows the number already
            self.value = float(self._marks[self.position.value])


def even_marks(low: float, high: float) -> NDArray[np.float64]:
    """Multiples of 1, 2 or 5 times a power of ten that reach from low to high, 100 to 250 of them.

    >>> print(even_marks(0.0, 1.5)[[0, 1, 2, -1]])
    [0.   0.01 0.02 1.5 ]
    """
    # A pixel or so each.
    marks = MaxNLocator(250, steps=[1, 2, 5, 10]).tick_values(low, high)
    return np.round(marks, 12)  # with no more than their own digits


def ratio_marks(low: float, high: float) -> NDArray[np.float64]:
    """Values of three digits that reach from low to high > 0, a hundred for each factor of ten.

    >>> print(ratio_marks(0.2, 5.0)[[0, 1, 70, -1]])
    [0.2   0.204 1.    5.01 ]
    """
    first, last = 100 * np.log10([low, high])  # included but for rounding
    powers = np.arange(np.floor(first + 1e-6), np.ceil(last - 1e-6) + 1) / 100
    return np.array([float(f"{10**power:.3g}") for power in powers])
