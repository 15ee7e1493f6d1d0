"""What a hazard curve and what it meets must share: the measure, and the draw of intensities."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from jaxpound.ground.measure import Measure
from jaxpound.ground.plausibility import tell
from jaxpound.quantities import DIMENSIONLESS
from jaxpound.risk.hazard_intensity import CurvePoints, HazardIntensity
from jaxpound.risk.rare_event import RareEvent
from jaxpound.study.store import describe
from jaxpound.study.study import Study

_OF_HAZARDS = DIMENSIONLESS["acceleration"]  # the unit of a curve that tells none
_ROUNDING = 1e-6  # of the logarithm of a ratio between points of one curve


def require_measure(owner: str, text: str, of: str, theirs: Measure) -> None:
    """A ``ValueError`` if a curve's measure is another one, or in another unit, than ``of`` has.

    Where the curve tells no unit, and the other is not that of hazard analyses, a warning.
    """
    ours = Measure.of_text(text)
    if not ours.may_be(theirs):
        raise ValueError(f"{owner}: measure = {text!r} must be that of {of}, {theirs}")
    unit = theirs.unit
    must = f"be in the unit of {of}, {unit}: convert the curve's intensities and name them so"
    if ours.unit and unit and not ours.is_in_unit_of(theirs):
        raise ValueError(f"{owner}: measure = {text!r} must {must}")
    if unit not in ("", _OF_HAZARDS) and not ours.unit:
        tell(owner, [f"measure = {text!r} names no unit; it should {must}"], strict=False)


def require_drawn(owner: str, curve: CurvePoints, of: Study | RareEvent, instead: str) -> None:
    """A ``ValueError`` for a study or a rare event whose intensities are not known as a hazard's.

    ``curve`` has the intensities and annual rates of the points, ``instead`` says what to give.
    """
    if not is_drawn(curve, of):
        raise ValueError(
            f"{owner}: intensities of the {'study' if isinstance(of, Study) else 'rare event'} "
            "must be drawn by HazardCurve.distribution of this curve, or weighed by its "
            f"HazardCurve.weights, and are not known to be; give {instead}, or drawn=True if they "
            "follow this curve"
        )


def is_drawn(curve: CurvePoints, of: Study | RareEvent) -> bool:
    """Whether the intensities are known to be this curve's, up to a factor.

    They are if its ``HazardIntensity`` is in the description of the scenarios, or its ``weights``
    are those of the study.
    """
    if isinstance(of, RareEvent):
        return any(_alike(curve, points) for points in _drawn(describe(of.limit_state.scenarios)))
    if of.weighting is not None:
        return of.weighting.curve is not None and _alike(curve, of.weighting.curve)
    return any(_alike(curve, points) for points in _drawn(of.about["identity"]["scenarios"]))


def _alike(curve: Any, other: Any) -> bool:
    """Whether two curves, intensities and rates, are one but for a factor on either."""
    return np.shape(curve) == np.shape(other) and bool(
        (np.ptp(np.log(curve) - np.log(other), axis=1) < _ROUNDING).all()
    )


def _drawn(described: Any) -> Iterator[tuple[list[float], list[float]]]:
    """The points of all curves that draw something in a description."""
    if isinstance(described, dict):
        if described.get("type") == HazardIntensity.__name__:
            yield described["intensity"], described["annual_rate"]
        described = list(described.values())
    if isinstance(described, list):
        for part in described:
            yield from _drawn(part)
