"""The instants of a run."""

from __future__ import annotations

import dataclasses

import numpy as np

from jaxpound._checks import is_traced, positive, require_memory
from jaxpound._errors import InvalidInput
from jaxpound._fields import Checked, parameter

_STEP_BYTES = 16  # an instant and its ground acceleration: a lower bound for a run


@dataclasses.dataclass(frozen=True)
class TimeGrid(Checked):
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

    dt: float = parameter(single=True, above=0)
    n_steps: int = parameter(single=True, whole=True, least=2)

    def __post_init__(self) -> None:
        if is_traced((self.dt, self.n_steps)):
            raise InvalidInput("dt and n_steps", "", "shape the program and cannot be traced")
        super().__post_init__()
        vars(self).update(dt=float(self.dt), n_steps=int(self.n_steps))
        require_memory("n_steps", self.n_steps, _STEP_BYTES * self.n_steps)

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
