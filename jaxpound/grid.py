"""The instants of a run."""

from __future__ import annotations

import dataclasses

import numpy as np

from jaxpound._checks import Rule, enforce, is_traced, is_whole, number, positive, require_memory
from jaxpound._errors import InvalidInput

_STEP_BYTES = 16  # an instant and its ground acceleration: a lower bound for a run


@dataclasses.dataclass(frozen=True)
class TimeGrid:
    """Instants 0, dt, …, n_steps·dt. Static: another grid is another compiled program.

    The time step ``dt`` > 0 is in units of 1/ω1, or in s for ``Buildings``; ``n_steps`` is at least
    2. Raises ``ValueError`` for others, or if the instants exceed this machine's memory.

    Examples
    --------
    >>> jp.TimeGrid.until(20.0, dt=0.03)
    TimeGrid(dt=0.03, n_steps=667)
    >>> jp.TimeGrid(dt=0.5, n_steps=4).times().tolist()
    [0.0, 0.5, 1.0, 1.5, 2.0]
    """

    dt: float
    n_steps: int

    def __post_init__(self) -> None:
        dt, n = self.dt, self.n_steps
        if is_traced((dt, n)):
            rule = "shape the program and cannot be traced"
            raise InvalidInput("dt and n_steps", "", rule)
        dt = number("dt", dt)
        number("n_steps", n)
        whole = Rule("n_steps", n, is_whole(n) and n >= 2, "a whole number, at least 2")
        enforce([Rule("dt", dt, 0 < dt < np.inf, "positive and finite"), whole])
        require_memory("n_steps", int(n), _STEP_BYTES * int(n))
        vars(self).update(dt=float(dt), n_steps=int(n))

    @classmethod
    def until(cls, duration: float, dt: float) -> TimeGrid:
        """The grid of step ``dt`` whose last instant is the first at or after ``duration``."""
        positive(duration=duration, dt=dt)
        return cls(dt, int(np.ceil(duration / dt * (1 - 1e-12))))

    @property
    def duration(self) -> float:
        """The last instant, n_steps·dt."""
        return self.n_steps * self.dt

    @property
    def halved(self) -> TimeGrid:
        """The grid of half the step, until the same instant."""
        return TimeGrid(self.dt / 2, 2 * self.n_steps)

    def times(self) -> np.ndarray:
        """All instants, shape (n_steps+1,)."""
        return self.dt * np.arange(self.n_steps + 1)
