"""Differentiable simulation of seismic pounding between adjacent structures.

>>> import jaxpound as jp
>>> response = jp.simulate(jp.paper.structures(), jp.paper.ground(), jp.paper.grid())
>>> bool(response.min_gap > 0.3)
True
"""

import importlib
import sys

_WINGS = ("model", "ground", "results", "scenarios", "simulation", "study")
_WINGS += ("reliability", "hazard", "design")
"""Packages whose public names are names of this package too; each lists them in its stub."""

_MODULES = {"contact": "model.contact"} | {wing: wing for wing in (*_WINGS, "paper", "plots")}

_NAMES = {  # of modules outside these packages
    **dict.fromkeys(("InvalidInput", "PlausibilityWarning"), "_errors"),
    **dict.fromkeys(("in_chunks", "use_cores"), "_xla.batches"),
    **dict.fromkeys(("keep_programs", "use_loop_kernels"), "_xla.programs"),
    "Buildings": "buildings",
    "Scales": "units",
    "STANDARD_GRAVITY": "quantities",
    "TimeGrid": "grid",
    "__version__": "_version",
}

_FORMER = {  # names of earlier versions, and what takes their place
    "dimensionless": "Buildings((left, right), (FloorLink(0, 0, …),)).dimensionless()",
    "dimensionless_row": "Buildings(buildings, links).dimensionless()",
    "simulate_buildings": "simulate(Buildings((left, right), links), record)",
    "simulate_row": "simulate(Buildings(buildings, links), record)",
}


def _module(name: str) -> object:
    return importlib.import_module(f"{__name__}.{name}")


def __getattr__(name: str) -> object:
    if name == "__all__":
        names = [other for other in _NAMES if not other.startswith("_")]
        return sorted([*names, "paper", *(x for wing in _WINGS for x in _module(wing).__all__)])
    if name in _MODULES:
        return _module(_MODULES[name])
    if name in _NAMES:
        return getattr(_module(_NAMES[name]), name)
    for wing in map(_module, _WINGS):
        if name in wing.__all__:
            return globals().setdefault(name, getattr(wing, name))
    message = f"module {__name__!r} has no attribute {name!r}"
    message += f"; it is now {_FORMER[name]}" if name in _FORMER else ""
    raise AttributeError(message, name=name, obj=sys.modules[__name__])


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULES, "__all__", *__getattr__("__all__")})
