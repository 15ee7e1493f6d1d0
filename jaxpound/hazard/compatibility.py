"""Checks that a hazard curve fits a fragility or study: measure, unit and drawn intensities."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from jaxpound._errors import InvalidInput
from jaxpound.ground.measure import Measure
from jaxpound.ground.plausibility import warn
from jaxpound.hazard.points import CurvePoints, HazardIntensity
from jaxpound.quantities import DIMENSIONLESS
from jaxpound.reliability.result import RareEvent
from jaxpound.store.store import describe
from jaxpound.study.study import Study

_DEFAULT_UNIT = DIMENSIONLESS["acceleration"]  # of a curve whose measure has no unit
_ROUNDING = 1e-6  # of the logarithm of a ratio between points of one curve


def require_measure(owner: str, text: str, source: str, measure: Measure) -> None:
    """An ``InvalidInput`` if a curve has another measure or unit than ``source`` has.

    A warning if only one of them has a unit, except where that unit is g, or if only one of two
    spectral accelerations has a period.
    """
    of_curve, unit = Measure.of_text(text), measure.unit
    curve, other = f"measure = {text!r}", f"{source}, {measure}"
    if not of_curve.may_be(measure):
        raise InvalidInput(owner, "measure", repr(text), f"must be that of {other}")
    rule = f"be in the unit of {source}, {unit}: convert the curve's intensities and name them so"
    if of_curve.unit and unit and not of_curve.is_in_unit_of(measure):
        raise InvalidInput(owner, "measure", repr(text), f"must {rule}")
    doubts = []
    if unit not in ("", _DEFAULT_UNIT) and not of_curve.unit:
        doubts.append(f"{curve} names no unit; it should {rule}")
    if measure.name and of_curve.unit and not unit:
        doubts.append(f"{other}, names no unit; it should be that of {curve}")
    if of_curve.name == measure.name and (of_curve.period is None) != (measure.period is None):
        silent, reference = (curve, other) if of_curve.period is None else (f"{other},", curve)
        doubts.append(f"{silent} names no period; it should be that of {reference}")
    warn(owner, doubts, strict=False)


def require_drawn(owner: str, curve: CurvePoints, source: Study | RareEvent, instead: str) -> None:
    """An ``InvalidInput`` that offers ``instead`` unless intensities follow a hazard curve."""
    if not is_drawn(curve, source):
        name = f"intensities of the {'study' if isinstance(source, Study) else 'rare event'}"
        rule = "must be drawn by HazardCurve.distribution of this curve, or weighed by its "
        rule += f"HazardCurve.weights, and are not known to be; give {instead}, or drawn=True if"
        raise InvalidInput(owner, name, "", f"{rule} they follow this curve")


def is_drawn(curve: tuple[np.ndarray, np.ndarray], source: Study | RareEvent) -> bool:
    """Whether a study's weights, or else the scenarios, have this curve, up to a factor."""
    if isinstance(source, RareEvent):
        curves = _drawing(describe(source.limit_state.scenarios))
    elif source.weighting is None:
        curves = _drawing(source.about["identity"]["scenarios"])
    else:
        curves = iter([source.weighting.curve])  # None, of shape (), for weights of no curve
    ratios = (np.log(curve) - np.log(x) for x in curves if np.shape(x) == np.shape(curve))
    return any((np.ptp(ratio, axis=1) < _ROUNDING).all() for ratio in ratios)


def _drawing(described: Any) -> Iterator[Any]:
    """The points of all curves that draw a number in a description."""
    if isinstance(described, dict):
        if described.get("type") == HazardIntensity.__name__:
            yield described["intensity"], described["annual_rate"]
        described = list(described.values())
    if isinstance(described, list):
        for part in described:
            yield from _drawing(part)
