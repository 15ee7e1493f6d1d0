"""The records of an analysis: their intensity, and the time grid on which all of them are run."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jaxpound._checks import Rule, enforce, instance, positive
from jaxpound.grid import TimeGrid
from jaxpound.ground.measure import Measure
from jaxpound.ground.motion import DIMENSIONLESS, SECONDS
from jaxpound.ground.suite import RecordSuite
from jaxpound.model.row import Row
from jaxpound.model.structures import AdjacentStructures
from jaxpound.model.system import Structures
from jaxpound.simulation.buildings import record_grid
from jaxpound.simulation.scheme import Scheme
from jaxpound.units import Scales


class Intensity(NamedTuple):
    """A measure of intensity that grows in proportion to a record's factor."""

    words: str
    """With its unit."""
    unscaled: Float[np.ndarray, " n"]
    """That of each record as it is."""

    @classmethod
    def of(cls, owner: str, suite: RecordSuite, measure: Any) -> Intensity:
        """By ``measure``: "pga", a natural period, or the intensity of each record itself.

        Raises
        ------
        ValueError
            If it is none of these, or not positive and finite.
        """
        if isinstance(measure, str):
            if measure != "pga":
                rule = "'pga', a natural period or a number for each record"
                raise ValueError(f"{owner}: measure = {measure!r} must be {rule}")
            return cls("PGA (g)", suite.pgas)
        (known,) = positive(owner, measure=measure)
        if np.ndim(known) == 0:
            found = suite.spectra(np.array([float(known)]))[:, 0]
            measure = Measure.spectral_acceleration(float(known), suite.time_unit)
            return cls(str(measure), found)
        if np.shape(known) != (len(suite),):
            rule = f"a number for each of {len(suite)} records"
            raise ValueError(f"{owner}: measure of shape {np.shape(known)} must be {rule}")
        return cls("intensity", np.asarray(known, float))


def levels(owner: str, intensities: Any) -> Float[np.ndarray, " k"]:
    """Rising intensities > 0; a ``ValueError`` for anything else."""
    (known,) = positive(owner, intensities=intensities)
    found = np.asarray(known, float)
    if found.ndim != 1 or not found.size:
        raise ValueError(f"{owner}: intensities of shape {found.shape} must be (k,) with k ≥ 1")
    rises = np.append(True, np.diff(found) > 0)
    enforce(owner, [Rule("intensities", found, rises, "rising")])
    return found


def dimensionless_suite(owner: str, suite: RecordSuite, scales: Scales | None) -> RecordSuite:
    """The records in the structures' unit of time.

    Raises
    ------
    ValueError
        If they are in seconds and there are no scales, or the other way round.
    """
    if scales is None:
        if suite.time_unit != DIMENSIONLESS:
            rule = f"given for records in {suite.time_unit}: dimensionless makes them"
            raise ValueError(f"{owner}: scales = None must be {rule}")
        return suite
    instance(owner, "scales", scales, Scales)
    if suite.time_unit != SECONDS:
        rule = f"None for records in units of {suite.time_unit}"
        raise ValueError(f"{owner}: scales = {scales!r} must be {rule}")
    return RecordSuite(tuple(scales.to_dimensionless(record) for record in suite))


def grid_for(
    owner: str,
    structures: Structures,
    suite: RecordSuite,
    scales: Scales | None,
    scheme: Scheme,
) -> TimeGrid:
    """One grid for all records: its step is a part of the shortest sample interval.

    It lasts as long as the longest record.

    Raises
    ------
    ValueError
        If there are no scales or the structures are a ``System``, whose periods are not known; if
        the records together ask for too many steps.
    """
    if scales is None or not isinstance(structures, AdjacentStructures | Row):
        rule = "a TimeGrid: it is chosen only for buildings with scales"
        raise ValueError(f"{owner}: grid = None must be {rule}")
    finest = min(suite, key=lambda record: float(record.dt))
    longest = max(suite, key=lambda record: float(record.duration))
    place = (
        f"{owner}: records: with {finest.name!r}, the finest, and {longest.name!r}, the longest,"
    )
    return record_grid(place, structures, scales, scheme, finest, float(longest.duration))
