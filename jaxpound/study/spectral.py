"""Spectral accelerations of the ground motions of a study, as further columns."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax

from jaxpound._checks import instance, positive_number
from jaxpound.grid import TimeGrid
from jaxpound.ground.intensity import spectral_acceleration
from jaxpound.ground.measure import Measure
from jaxpound.ground.motion import GroundLike
from jaxpound.ground.run_input import as_run
from jaxpound.model.system import Structures, gravity_of, in_si
from jaxpound.quantities import unit


@dataclasses.dataclass(frozen=True)
class SpectralAcceleration:
    """Pseudo-spectral acceleration at a period, with 5 % of damping: one of ``measures``.

    Of ``Buildings`` it is in m/s², else in g; ``period`` is in the unit of time of the run.

    Examples
    --------
    >>> grid, steel = jp.TimeGrid.until(8.0, dt=0.1), jp.paper.structures()
    >>> wavelets = jp.RandomRicker(1, jp.Uniform(0.01, 0.1), jp.Uniform(2, 3), jp.Uniform(2, 4))
    >>> at_2 = jp.study.SpectralAcceleration.of(steel, period=2.0, grid=grid)
    >>> scenarios, kept = jp.Scenarios(steel, wavelets), jp.Storage(measures={"sa": at_2})
    >>> study = jp.monte_carlo(scenarios, 16, grid, store=kept, progress=False)
    >>> str(study.measure("sa")), bool((study["sa"] > 0).all())
    ('Sa(2 1/ω1) (g)', True)
    """

    measure: str
    """The measure of intensity with its unit, by which curves and hazards know it."""
    period: float
    grid: TimeGrid

    @classmethod
    def of(cls, structures: Any, period: float, grid: TimeGrid) -> SpectralAcceleration:
        """That of a study of these structures, whose runs have this grid.

        Raises ``ValueError`` for a period that is not positive, and for another grid or structures.
        """
        instance("structures", structures, Structures)
        (period,) = positive_number(period=period)
        instance("grid", grid, TimeGrid)
        of_time, of_acceleration = (unit(x, in_si(structures)) for x in ("time", "acceleration"))
        measure = Measure.spectral_acceleration(period, of_time, of_acceleration)
        return cls(str(measure), period, grid)

    def __call__(self, structures: Any, ground: GroundLike) -> jax.Array:
        """The value in a scenario."""
        motion = as_run(ground, self.grid, gravity_of(structures))
        return spectral_acceleration(motion, self.grid, period=self.period)
