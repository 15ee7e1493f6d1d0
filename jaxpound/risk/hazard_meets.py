"""What a hazard curve and what it meets must share: the unit, and the draw of the intensities."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from jaxpound.ground import envelope, record
from jaxpound.ground.plausibility import tell
from jaxpound.risk.hazard_intensity import HazardIntensity
from jaxpound.study import (
    distributions,
    ground_draw,
    random_ground,
    random_noise,
    random_pulse,
    site_noise,
)
from jaxpound.study.scenarios import CustomDraw
from jaxpound.study.study import Study

_UNITS = ("g", "m/s²", "cm/s²", "m/s", "cm/s", "g/ω1")  # in which hazards and studies tell motions
_OF_HAZARDS = "g"  # what a curve is taken to be in that tells no unit


def require_unit(owner: str, measure: str, of: str, unit: str) -> None:
    """A ``ValueError`` if the curve's measure names another unit than ``of`` is in.

    Where the measure names none, and the unit is not that of hazard analyses, a warning.
    """
    told = measure.rpartition("(")[2].rstrip(")").replace("2", "²")
    must = f"be in the unit of {of}, {unit}: convert the curve's intensities and name them so"
    if unit and told in _UNITS and told != unit:
        raise ValueError(f"{owner}: measure = {measure!r} must {must}")
    if unit not in ("", _OF_HAZARDS) and told not in _UNITS:
        tell(owner, [f"measure = {measure!r} names no unit; it should {must}"], strict=False)


def doubt_drawn(owner: str, study: Study, instead: str) -> None:
    """A warning for a study whose intensities are certainly not those of a hazard.

    No error: its earthquakes may be those of a source that has the rate of the curve's beginning.
    """
    if not may_be_drawn(study):
        rule = (
            "the study's intensities should be drawn by HazardCurve.distribution or weighed by "
            f"HazardCurve.weights, and are not; of any other study give {instead}"
        )
        tell(owner, [rule], strict=False)


def may_be_drawn(study: Study) -> bool:
    """Whether a hazard may have drawn or weighed a study's intensities.

    What a user's own distribution or function draws may be; the library's own are known.
    """
    described = study.about["identity"]["scenarios"]
    ground = described.get("ground") if isinstance(described, dict) else None
    return study.weighting is not None or ground is None or not set(_types(ground)) <= _certain()


def _types(described: Any) -> Iterator[str]:
    """The types of all objects in the description of a ground motion; functions have none."""
    if isinstance(described, dict):
        if "type" in described and "sha256" not in described:
            yield described["type"]
        described = list(described.values())
    if isinstance(described, list):
        for part in described:
            yield from _types(part)


def _certain() -> set[str]:
    """Names of the library's own classes for random ground motions, none of which is a hazard's."""
    files = (distributions, envelope, ground_draw, random_ground, random_noise, random_pulse)
    own = [x for of in (*files, record, site_noise) for x in vars(of).values()]
    names = {
        x.__name__ for x in own if isinstance(x, type) and x.__module__.startswith("jaxpound.")
    }
    return names - {CustomDraw.__name__, HazardIntensity.__name__}
