"""The directives ``inputs`` and ``quantity-units``: what each class takes, and in which unit.

Each line in the body of ``inputs`` is a subject and its classes, as ``Contact: Newton, Hertz``.
Symbol, unit, default and rule are those of the class. Here is what its metadata do not say: what is
usual, the source, and units of numbers that are of no kind of quantity.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Iterator
from pkgutil import resolve_name
from types import NoneType
from typing import Any, NamedTuple

from docutils import nodes
from sphinx.util.docutils import SphinxDirective

from jaxpound._checks import Range
from jaxpound._fields import _ROLE, _SPEC, Parameter, Quantity
from jaxpound.model.building import DAMPING, PERIOD
from jaxpound.model.shear_building import HEIGHT, STRENGTHS, TAPER
from jaxpound.quantities import SI, unit
from jaxpound.simulation import Scheme

NONE = "–"
DIMENSIONLESS = "AdjacentStructures", "Storeys", "Row", "System"

ARGUMENTS: dict[str, dict[str, dict[str, Range]]] = {
    "Building": {"from_period": {"period": PERIOD, "damping_ratio": DAMPING}},
    "ShearBuilding": {"from_period": {"taper": TAPER, "height": HEIGHT}, "yielding": STRENGTHS},
}
"""Arguments of constructors that are no fields, with their ranges."""

UNITS = {
    "Analysis.distances": "m",
    "Analysis.rest": "s",
    "Analysis.velocity": "m/s",
    "CloughPenzien.frequency": "rad/s",
    "CloughPenzien.high_pass": "rad/s",
    "FilteredNoise.dt": "s",
    "FilteredNoise.high_pass": "Hz",
    "FilteredNoise.intensity": "g",
    "FilteredNoise.spectral_density": "g² s/rad",
    "KanaiTajimi.frequency": "rad/s",
    "LimitState.threshold": "that of the demand",
    "MoatWall.gap": "m",
    "NonstationaryNoise.arias_intensity": "g s",
    "NonstationaryNoise.dt": "s",
    "NonstationaryNoise.duration": "s",
    "NonstationaryNoise.frequency": "Hz",
    "NonstationaryNoise.frequency_slope": "Hz/s",
    "NonstationaryNoise.high_pass": "Hz",
    "NonstationaryNoise.mid_time": "s",
    "PlateauEnvelope.decay": "1/s",
    "Pulse.phase": "rad",
    "RandomPulse.amplitude": "m/s",
    "RandomPulse.arrival": "s",
    "RandomPulse.period": "s",
    "RandomPulse.phase": "rad",
    "RandomRicker.amplitude": "m",
    "RandomRicker.arrivals": "s",
    "RandomRicker.periods": "s",
    "Record.samples": "g",
    "Scales.frequency": "rad/s",
    "Scales.gravity": "m/s²",
    "Scales.mass": "kg",
    "ShearBuilding.heights": "m",
    "SiteBasedNoise.distance": "km",
    "SiteBasedNoise.dt": "s",
    "SiteBasedNoise.high_pass": "Hz",
    "SiteBasedNoise.vs30": "m/s",
    "Storeys.heights": "g/ω1²",
    "FrictionPendulum.ultimate_displacement": "m",
    "LeadRubber.ultimate_displacement": "m",
    "TargetSpectrum.accelerations": "g",
    "TargetSpectrum.periods": "s",
    "TimeGrid.dt": "s",
    "ZenerRod.tau_f": "1/ω1^order",
    "ZenerRod.tau_x": "1/ω1^order",
}
"""Units of numbers whose class states none: its numbers may be in others, too."""

_DAMPING = (
    "0.02 to 0.03 of welded steel, 0.03 to 0.05 of cracked concrete, twice that and more near yield"
)
_CAPACITY = "from the maker of the bearing"
_OF_DESIGN = "from the design of the columns"
_OF_ELEVATIONS = "left out between `ShearBuilding`: it follows from the elevations"
_OF_ENDS = "left out: they follow from `ends`"
_OF_PERIOD = "`from_period` computes it"
_HERTZ = "3e9 (Jankowski 2005) to 3e10 (Muthukumar and DesRoches 2006) between floors of concrete"
_OF_FOOTPRINT = "that of the building"
_SAMPLES = "500 to 3,000"
_STEP = "0.01 to 0.02"
_ANY = "any"

USUAL = {
    "Analysis.distances": "from 0 of the first support",
    "Analysis.measure": "the mean period of the buildings",
    "Analysis.rest": "until the buildings are at rest: 10 periods and more",
    "Analysis.velocity": "1,000 to 3,000",
    "Bilinear.hardening": "0.02 to 0.1",
    "Bilinear.ultimate_displacement": "that of a cyclic test",
    "Bilinear.yield_displacement": "0.005 times the height of a storey of concrete frames, 0.01 of "
    "steel frames",
    "BoucWen.beta": "0.5 unloads along the elastic line",
    "BoucWen.exponent": "1 to 2 for concrete, 2 to 5 for steel",
    "BoucWen.hardening": "0.02 to 0.1",
    "BoucWen.ultimate_displacement": "that of a cyclic test",
    "BoucWen.yield_displacement": "0.005 times the height of a storey of concrete frames, 0.01 of "
    "steel frames",
    "Building.dashpot": "2 ζ √(k m) for the damping ratio ζ",
    "Building.from_period(damping_ratio)": _DAMPING,
    "Building.from_period(period)": "0.1 s for each storey of a frame of up to 12",
    "Building.mass": "1 t for each m² of floor",
    "Building.stiffness": _OF_PERIOD,
    "Building.tau_f": _OF_PERIOD,
    "Building.tau_x": _OF_PERIOD,
    "Buildings.gravity": "9.8",
    "CloughPenzien.damping": "0.6 of firm soil",
    "CloughPenzien.frequency": "15.6 of firm soil",
    "CloughPenzien.high_pass": "a tenth of `frequency`",
    "CloughPenzien.high_pass_damping": "0.6",
    "Column.capacity": _OF_DESIGN,
    "Column.height": _OF_ELEVATIONS,
    "Column.position": _OF_ELEVATIONS,
    "Column.rigidity": "3e7 of a cracked column of 0.4 m by 0.4 m",
    "Dashpot.coefficient": "2 ζ √(k m) for the damping ratio ζ",
    "FilteredNoise.dt": _STEP,
    "FilteredNoise.high_pass": "0.1",
    "FilteredNoise.intensity": "0.05 to 0.2; a third of the peak",
    "FilteredNoise.samples": _SAMPLES,
    "FilteredNoise.spectral_density": "0.01 m²/s³ over 9.8²",
    "FloorLink.friction": "0 without a damper; some 0.1 times the weight of a floor",
    "FloorLink.gap": "0.02 to 0.2 m; codes ask for `asce_7_gap`, `en_1998_gap`",
    "Footing.embedment": "3 m for each basement",
    "Footing.length": _OF_FOOTPRINT,
    "Footing.radius": "that of a disk of the building's area",
    "Footing.width": _OF_FOOTPRINT,
    "FrictionPendulum.ultimate_displacement": _CAPACITY,
    "GammaEnvelope.peak": "2 to 10",
    "GammaEnvelope.power": "1 to 5: the larger, the shorter",
    "Hertz.stiffness": _HERTZ,
    "HertzDamped.stiffness": _HERTZ,
    "Inerter.inertance": "0.01 to 1 times the mass of the floors",
    "InitialState.displacements": "left out: at rest",
    "InitialState.velocities": "left out: at rest",
    "Jankowski.stiffness": _HERTZ,
    "KanaiTajimi.damping": "0.6 of firm soil",
    "KanaiTajimi.frequency": "15.6 of firm soil",
    "KelvinVoigt.stiffness": "20 times the stiffness of the stiffer storey, or E A/L of the floor: "
    "`contact_stiffness`",
    "LeadRubber.period": "2 to 3",
    "LeadRubber.ultimate_displacement": _CAPACITY,
    "LeadRubber.yield_displacement": "about 0.01",
    "LimitState.threshold": "left out: the gap at rest closes",
    "Link.friction": "0 without a damper",
    "Link.gap": "inf without a neighbour",
    "Link.weights": _OF_ENDS,
    "LogNormal.median": _ANY,
    "LogNormal.sigma": "0.2 to 0.6",
    "ModalDamping.ratios": _DAMPING,
    "MoatWall.gap": "1 to 1.5 times the displacement that the code expects: 0.3 to 0.8",
    "NonstationaryNoise.arias_intensity": "a median of 0.013",
    "NonstationaryNoise.damping": "0.02 to 1, with a mean of 0.22",
    "NonstationaryNoise.dt": _STEP,
    "NonstationaryNoise.duration": "5 to 45",
    "NonstationaryNoise.frequency": "a mean of 5.9",
    "NonstationaryNoise.frequency_slope": "−2 to 0.5",
    "NonstationaryNoise.high_pass": "0.1",
    "NonstationaryNoise.mid_time": "0.5 to 40",
    "NonstationaryNoise.samples": "2 to 3 times mid-time and duration, over `dt`",
    "Normal.mean": _ANY,
    "Normal.std": "0.1 to 0.3 times the mean",
    "PlateauEnvelope.decay": "0.3 at magnitude 5 to 0.04 at 8",
    "PlateauEnvelope.end": "4 at magnitude 5 to 35 at 8",
    "PlateauEnvelope.rise": "2 to 4",
    "PowerLaw.exponent": "0.2 to 0.5 of dampers in buildings",
    "PowerLaw.force": "from the maker of the damper; some 0.1 times the weight of a floor",
    "PowerLaw.velocity": "1, with the force at 1 m/s",
    "Pulse.amplitude": "0.3 to 1.5 near faults",
    "Pulse.arrival": "later than half of the duration",
    "Pulse.cycles": "1 to 3",
    "Pulse.phase": "0 to π",
    "Pulse.period": "1 to 8: it grows with the magnitude",
    "RandomPulse.amplitude": "0.3 to 1.5 near faults, of both signs by `TwoSided`",
    "RandomPulse.arrival": "later than half of the duration",
    "RandomPulse.period": "1 to 8: it grows with the magnitude",
    "RandomPulse.phase": "0 to π",
    "RandomRicker.amplitude": "0.01 to 0.1",
    "RandomRicker.arrivals": "later than the period",
    "RandomRicker.periods": "0.5 to 4",
    "RandomRicker.negative": "0.5",
    "RandomRicker.wavelets": "5",
    "Rayleigh.ratio": _DAMPING,
    "Record.dt": "0.005 to 0.02",
    "Record.samples": "a peak of 0.05 to 1",
    "Ricker.amplitude": "6 π² u0/t_p² is the peak acceleration: 0.05 m at 1 s make 0.3 g",
    "Ricker.arrivals": "later than the period: the ground starts at rest",
    "Ricker.periods": "0.5 to 4",
    "Rod.stiffness": "that of a storey, or of the brace of a damper",
    "Rod.weights": _OF_ENDS,
    "Scaled.factor": _ANY,
    "Scales.frequency": "2π over the natural period of building 1",
    "Scales.gravity": "9.8",
    "Scales.mass": "that of building 1",
    "ShearBuilding.from_period(height)": "3 to 4",
    "ShearBuilding.from_period(taper)": "0.3 to 1",
    "ShearBuilding.heights": "3 to 4",
    "ShearBuilding.yielding(base_shear_coefficient)": "0.05 to 0.3: the elastic one over the "
    "behaviour factor",
    "ShearBuilding.yielding(yield_drift)": "0.005 of concrete frames, 0.01 of steel frames",
    "ShearBuilding.yielding(yield_force)": "from the design, or a pushover",
    "SiteBasedNoise.distance": "10 to 100",
    "SiteBasedNoise.dt": _STEP,
    "SiteBasedNoise.high_pass": "0.1",
    "SiteBasedNoise.magnitude": "6 to 8",
    "SiteBasedNoise.samples": _SAMPLES,
    "SiteBasedNoise.vs30": "600 and more: firm ground",
    "Soil.poisson_ratio": "0.3 of sand, 0.45 to 0.5 of saturated clay",
    "Storage.chunk_size": "an eighth of the samples, from 32 to 16,384",
    "Storeys.masses": "1",
    "System.masses": "1",
    "TargetSpectrum.accelerations": "up to 2",
    "TargetSpectrum.damping": "0.05",
    "TargetSpectrum.periods": "0 to 4",
    "TimeGrid.dt": "0.005 to 0.02; a fiftieth of the shortest period, and below `stability_limit`",
    "TimeGrid.n_steps": "the duration over `dt`: `TimeGrid.until`",
    "TwoSided.negative": "0.5",
    "Uniform.high": _ANY,
    "Uniform.low": _ANY,
    "VelocityFriction.increase": "the difference of the coefficients times the weight",
    "VelocityFriction.velocity": "0.01 to 0.05",
}
"""What is usual, in words and in the unit of the row; else it is in the metadata."""

_MODEL, _NUMERICS = "[The model](model.md)", "[The numerics](numerics.md)"
_ISOLATION, _STUDIES = "[Isolation](isolation.md)", "[Monte Carlo](api/monte_carlo.md)"
_ANALYSES, _DESIGN = "[From records](api/from_records.md)", "[Design](api/design.md)"
_CHOPRA = "Chopra (2012)"
_OF_CODE = "ASCE/SEI 7-16"
_EC8 = "EN 1998-1 (2004)"

SOURCES = {
    "Analysis": _ANALYSES,
    "AdjacentStructures": "Žigić and Grahovac, [the paper](bibliography.md#the-paper)",
    "Bilinear": "Iwan (1966)",
    "BoucWen": "Wen (1976)",
    "BoucWen.stiffness_degradation": "Baber and Noori (1985)",
    "BoucWen.strength_degradation": "Baber and Noori (1985)",
    "Building": "[The model](model.md#the-rods)",
    "Building.dashpot": _CHOPRA,
    "Building.from_period(damping_ratio)": _CHOPRA,
    "Building.from_period(period)": _OF_CODE,
    "Buildings": _MODEL,
    "CloughPenzien": "Clough and Penzien (1975)",
    "CloughPenzien.damping": "Kanai (1957)",
    "CloughPenzien.frequency": "Kanai (1957)",
    "Column": "[Floors and columns](how_to/floor_to_column.md)",
    "Dashpot": _ISOLATION,
    "DesignSpace": _DESIGN,
    "FilteredNoise": "Amin and Ang (1968)",
    "FloorLink": "[Storeys and rows](model.md#storeys-and-rows)",
    "Footing": "Wolf (1994)",
    "Footing.embedment": "Pais and Kausel (1988)",
    "Footing.length": "Pais and Kausel (1988)",
    "Footing.width": "Pais and Kausel (1988)",
    "FrictionPendulum": "Zayas, Low and Mahin (1990)",
    "FrictionPendulum.fast_friction": "Constantinou, Mokha and Reinhorn (1990)",
    "FrictionPendulum.rate": "Constantinou, Mokha and Reinhorn (1990)",
    "GammaEnvelope": "Rezaeian and Der Kiureghian (2008)",
    "Hertz": "Hertz (1882)",
    "Hertz.stiffness": "Jankowski (2005)",
    "HertzDamped": "Hunt and Crossley (1975)",
    "HertzDamped.stiffness": "Jankowski (2005)",
    "Inerter": "Smith (2002)",
    "InitialState": "[Initial states](model.md#initial-states)",
    "Jankowski": "Jankowski (2005)",
    "KanaiTajimi": "Kanai (1957)",
    "KelvinVoigt": "Anagnostopoulos (1988)",
    "LeadRubber": "Robinson (1982)",
    "LimitState": "[Rare events](rare_events.md)",
    "Link": "[Masses, rods and links](model.md#masses-rods-and-links)",
    "LogNormal": _STUDIES,
    "MoatWall": _ISOLATION,
    "ModalDamping": "Wilson and Penzien (1972)",
    "ModalDamping.ratios": _CHOPRA,
    "Newton": "[Contact](model.md#contact)",
    "NonstationaryNoise": "Rezaeian and Der Kiureghian (2010)",
    "Normal": _STUDIES,
    "Objective": _DESIGN,
    "PlateauEnvelope": "Jennings, Housner and Tsai (1968)",
    "PowerLaw": "Reinhorn, Li and Constantinou (1995)",
    "Pulse": "Mavroeidis and Papageorgiou (2003)",
    "RandomPulse": "Mavroeidis and Papageorgiou (2003)",
    "RandomRecord": "[Your record](how_to/own_record.md)",
    "RandomRicker": "[The ground](model.md#the-ground)",
    "Rayleigh": "Hall (2006)",
    "Rayleigh.ratio": _CHOPRA,
    "Record": "[Your record](how_to/own_record.md)",
    "Ricker": "Ricker (1953)",
    "Rod": "[Masses, rods and links](model.md#masses-rods-and-links)",
    "Row": "[Storeys and rows](model.md#storeys-and-rows)",
    "Scaled": "[The ground](model.md#the-ground)",
    "Scales": "[Equations of motion](model.md#equations-of-motion)",
    "Scheme": _NUMERICS,
    "ShearBuilding": "[Storeys and rows](model.md#storeys-and-rows)",
    "ShearBuilding.yielding(base_shear_coefficient)": _EC8,
    "ShearBuilding.yielding(yield_drift)": "[Rods that yield](yielding.md)",
    "ShearBuilding.yielding(yield_force)": "[Rods that yield](yielding.md)",
    "SiteBasedNoise": "Rezaeian and Der Kiureghian (2010)",
    "Soil": "Wolf (1994)",
    "Storage": _STUDIES,
    "Storeys": "[Storeys and rows](model.md#storeys-and-rows)",
    "System": "[Masses, rods and links](model.md#masses-rods-and-links)",
    "TargetSpectrum": _OF_CODE,
    "TimeGrid": _NUMERICS,
    "TwoSided": _STUDIES,
    "UncertainStructures": _STUDIES,
    "Uniform": _STUDIES,
    "VelocityFriction": "Constantinou, Mokha and Reinhorn (1990)",
    "YieldingZener": "[Rods that yield](yielding.md)",
    "ZenerRod": "Zener (1948)",
}
"""The source of each class, or of one of its numbers: in the bibliography, or a page."""

MUST = {
    "Analysis.rest": "not negative, with `mainshock`",
    "Analysis.mainshock": "a ground motion, or None",
    "Analysis.strict": "whether scaled records that are implausible are refused",
    "Analysis.velocity": "a number, with `distances`; or None",
    "Analysis.distances": "a number for each support, with `velocity`; or None",
    "FilteredNoise.envelope": "`GammaEnvelope`, `PlateauEnvelope`, a function of t or None",
    "FilteredNoise.intensity": "not negative, or a `Distribution`",
    "RandomPulse": "a number or a `Distribution`",
    "RandomRecord.records": "one `Record` or more, of one unit of time",
    "RandomRecord.weights": "a number for each record, not negative",
    "Record.samples": "finite, shape (n,)",
    "Scheme.order": "1 (the paper's) or 2",
    "Scaled.ground": "a ground motion",
    "SiteBasedNoise.fault": '"strike-slip" or "reverse"',
    "UncertainStructures.correlation": "between −1 and 1, a positive definite matrix or None",
    "UncertainStructures.nominal": "any structures",
    "UncertainStructures.uncertain": "a `Distribution` by the path of each random number",
    "name": "a text",
    "scheme": "a `Scheme`",
    "time_unit": '"1/ω1" or "s"',
}
"""Rules of fields, by class or by name, that neither metadata nor docstrings state for each."""


class Row(NamedTuple):
    """A line of the table, as MyST."""

    name: str
    symbol: str
    unit: str
    default: str
    must: str
    usual: str
    source: str


def shown(value: Any) -> str:
    """A default."""
    if value is dataclasses.MISSING:
        return "required"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Scheme):
        return f"`{type(value).__name__}()`"
    return f"`{value!r}`".replace("'", '"')


def number(value: float) -> str:
    """A bound, ``1e10``."""
    return re.sub(r"e(-?)\+?0?", r"e\1", f"{value:g}").replace("-", "−")


def entries(cls: type) -> dict[str, str]:
    """The first sentence on each field that the docstring lists, as MyST."""
    listed = re.search(
        r"^Parameters\n-+\n(.*?)(?=^\w+\n-+$|\Z)", inspect.getdoc(cls) or "", re.M | re.S
    )
    texts: dict[str, str] = {}
    for names, text in re.findall(
        r"^(\S.*)\n((?:[ ]+.*\n?|\n)+)", f"{listed[1]}\n" if listed else "", re.M
    ):
        sentence = re.split(r"(?<=[^.])\.(?: |$)", " ".join(text.split()))[0]
        if re.match(r"[A-Z]([a-z]| )", sentence):
            sentence = sentence[0].lower() + sentence[1:]
        texts |= dict.fromkeys(names.split(", "), as_myst(sentence))
    return texts


def as_myst(text: str) -> str:
    """Text of a docstring."""
    text = re.sub(r":math:`(.*?)`", r"$\1$", text)
    return re.sub(r":py:\w+:`~?[\w.]*?(\w+)`", r"`\1`", text).replace("``", "`")


def bounds(spec: Parameter) -> str:
    """Completes "must be"."""
    if isinstance(spec.low, str):
        words = f"{'at least' if spec.above is None else 'above'} `{spec.low}`"
    elif spec.whole:
        words = f"a whole number from {spec.least or 1:g}"
    else:
        words = spec._bounds(spec.low).replace("-", "−") or "a number"
    within = spec.within
    if within and within.high < float("inf"):
        words += f"; {number(within.low)} to {number(within.high)}"
    return words + (" or None" if spec.optional else "")


def usual_of(path: str, spec: Parameter) -> str:
    """What is usual, of a dimensionless system too if that has another unit."""
    words = USUAL.get(path) or (spec.within.why if spec.within else "")
    if spec.usual and (spec.kind or path not in USUAL):
        low, high = map(number, spec.usual)
        interval = f"{low} to {high} {unit(spec.kind, si=False)}".strip()
        parts = (words, interval) if spec.kind else (interval, words)
        words = "; ".join(filter(None, parts))
    return words


def kinds_of(field: dataclasses.Field[Any]) -> str:
    """What objects a field takes."""
    kinds = field.metadata.get("kinds", ())
    names = ["None" if kind is NoneType else f"`{kind.__name__}`" for kind in kinds]
    words = " or ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))
    return f"{words}, each" if field.metadata.get("each") else words


def rows(name: str) -> Iterator[Row]:
    """The lines of a class, by its public name."""
    cls = resolve_name(f"jaxpound.{name}")
    cls_name = name.rpartition(".")[2]
    texts = entries(cls)
    for field in dataclasses.fields(cls):
        spec, path = field.metadata.get(_SPEC), f"{cls_name}.{field.name}"
        if field.metadata.get(_ROLE) == "label" or isinstance(spec, Quantity) or not field.init:
            continue
        default = field.default
        if field.default_factory is not dataclasses.MISSING:
            default = field.default_factory()
        source = SOURCES.get(path) or SOURCES[cls_name]
        label, plain = f"`{field.name}`", shown(default)
        if isinstance(spec, Parameter):
            if spec.words and spec.words != field.name.replace("_", " "):
                label += f": {spec.words}"
            if cls_name in DIMENSIONLESS:
                its_unit = unit(spec.kind, si=False)
            else:
                its_unit = unit(spec.kind, si=True) or (spec.within.unit if spec.within else "")
            symbol = f"${spec.symbol}$" if spec.symbol else NONE
            its_unit = UNITS.get(path) or its_unit or NONE
            usual = usual_of(path, spec) or NONE
            yield Row(label, symbol, its_unit, plain, bounds(spec), usual, source)
        else:
            stated = MUST.get(path) or MUST.get(field.name)
            must = stated or kinds_of(field) or texts.get(field.name) or MUST[cls_name]
            usual = USUAL.get(path, NONE)
            source = SOURCES.get(path) or (NONE if usual == NONE else source)
            yield Row(label, NONE, UNITS.get(path, NONE), plain, must, usual, source)
    for function, ranges in ARGUMENTS.get(name, {}).items():
        signature = inspect.signature(getattr(cls, function)).parameters
        for argument, within in ranges.items():
            path = f"{cls_name}.{function}({argument})"
            default = signature[argument].default
            default = dataclasses.MISSING if default is inspect.Parameter.empty else default
            must = f"{number(within.low)} to {number(within.high)}"
            source = SOURCES.get(path) or SOURCES[cls_name]
            label, its_unit = f"`{function}({argument})`", within.unit or NONE
            yield Row(label, NONE, its_unit, shown(default), must, USUAL[path], source)


def subjects(lines: list[str]) -> dict[str, list[str]]:
    """The names of classes by subject, from the body of the directive."""
    pairs = (line.split(": ", 1) for line in lines if line.strip())
    return {subject: names.split(", ") for subject, names in pairs}


def heading(name: str) -> str:
    """A class with what it is."""
    cls = resolve_name(f"jaxpound.{name}")
    first = " ".join((inspect.getdoc(cls) or "").partition("\n\n")[0].split())
    return f"{{py:class}}`~jaxpound.{name}` – {as_myst(first)}"


class Units(SphinxDirective):
    """The units of quantities, in SI and of a dimensionless system."""

    def run(self) -> list[nodes.Node]:
        """The table."""
        lines = ["| quantity | SI | dimensionless |", "| --- | --- | --- |"]
        lines += [f"| {kind} | {unit(kind, True)} | {unit(kind, False)} |" for kind in SI]
        return self.parse_text_to_nodes("\n".join(lines) + "\n")


class Inputs(SphinxDirective):
    """One table of the inputs of classes."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """The table, in which subjects and classes have lines of their own."""
        columns = "input", "symbol", "unit", "default", "must be", "usual", "source"
        n, whole = len(columns), []
        lines = [f"| {' | '.join(columns)} |", "| --- " * n + "|"]

        def add(cells: tuple[str, ...]) -> None:
            lines.append(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |")

        for subject, names in subjects(list(self.content)).items():
            whole.append(len(lines) - 2)
            add((f"**{subject}**", *[""] * (n - 1)))
            for name in names:
                whole.append(len(lines) - 2)
                add((heading(name), *[""] * (n - 1)))
                for row in rows(name):
                    add(row)
        made = self.parse_text_to_nodes("\n".join(lines) + "\n")
        body = next(iter(made[0].findall(nodes.tbody)))
        for line in whole:
            row = body[line]
            del row[1:]
            row[0]["morecols"] = n - 1
            row["classes"].append("heading")
        made[0]["classes"].append("inputs")
        return made


def setup(app: Any) -> dict[str, bool]:
    """Add the directives to Sphinx."""
    app.add_directive("inputs", Inputs)
    app.add_directive("quantity-units", Units)
    return {"parallel_read_safe": True}
