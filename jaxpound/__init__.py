"""Differentiable simulation of seismic pounding between adjacent structures.

>>> import jaxpound as jp
>>> response = jp.simulate(jp.paper.structures(), jp.paper.ground(), jp.paper.grid())
>>> bool(response.min_gap > 0.3)
True

The stub beside this file lists the names of the first weeks; each wing has all of its own.
"""

import importlib
import sys

import lazy_loader

_WINGS = ("model", "ground", "results", "scenarios", "simulation", "study")
_WINGS += ("reliability", "hazard", "design", "runtime")

_attribute, __dir__, _names = lazy_loader.attach_stub(__name__, __file__)
__all__ = [x for x in _names if x not in (*_WINGS, "contact", "plots") and not x.startswith("_")]

_RENAMED = {  # in version 0.3
    "CVaR": "SmallestGap(over=share)",
    "Growth": "study.PerturbationGrowth",
    "MeanGap": "SmallestGap()",
    "Phase": "results.FrictionPhase",
    "Reached": "reliability.TargetResult",
    "WorstGap": 'SmallestGap(over="worst")',
    "dimensionless": "Buildings((left, right), (FloorLink(0, 0, …),)).dimensionless()",
    "dimensionless_row": "Buildings(buildings, links).dimensionless()",
    "growth": "study.perturbation_growth",
    "simulate_buildings": "simulate(Buildings((left, right), links), record)",
    "simulate_row": "simulate(Buildings(buildings, links), record)",
}


def __getattr__(name: str) -> object:
    if name in _names:
        return _attribute(name)
    message = f"module {__name__!r} has no attribute {name!r}"
    if not name.startswith("_"):
        wings = (x for x in _WINGS if name in importlib.import_module(f".{x}", __name__).__all__)
        moved = next((f"{wing}.{name}" for wing in wings), None)
        if now := _RENAMED.get(name, moved):
            message += f"; it is now jp.{now}"
    raise AttributeError(message, name=name, obj=sys.modules[__name__])
