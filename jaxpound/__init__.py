"""Differentiable simulation of seismic pounding between two adjacent structures.

>>> import jaxpound as jp
>>> response = jp.simulate(jp.paper.structures(), jp.paper.ground(), jp.paper.grid())
>>> bool(response.min_gap > 0.3)
True
"""

from jaxpound import paper
from jaxpound.batches import in_chunks, use_cores
from jaxpound.buildings import simulate_buildings
from jaxpound.calibration import Calibration, calibrate
from jaxpound.comparison import Comparison
from jaxpound.design import Design
from jaxpound.design_search import design_damper
from jaxpound.design_space import Bounds, DesignSpace
from jaxpound.distributions import LogNormal, Normal, Uniform
from jaxpound.elasticities import Elasticities, elasticities
from jaxpound.ensembles import Ensemble
from jaxpound.estimates import Estimate
from jaxpound.fractional import FullHistory, ModalHistory, gl_weights
from jaxpound.fragility import Fragility, fit_fragility
from jaxpound.friction import EventResolved, Smoothed, Switching
from jaxpound.ground import Record, Ricker
from jaxpound.intensity import arias_intensity, pga, pgv, spectral_acceleration
from jaxpound.monte_carlo import monte_carlo
from jaxpound.objectives import (
    CVaR,
    Limit,
    MeanGap,
    Objective,
    Penalty,
    PoundingProbability,
    SoftMinimum,
    WorstGap,
)
from jaxpound.pareto import ParetoFront, pareto_front
from jaxpound.plausibility import PlausibilityWarning
from jaxpound.records import read_record
from jaxpound.response import Demand, Energy, Phase, Response
from jaxpound.rods import rod_force
from jaxpound.scenarios import (
    CustomDraw,
    RandomRecord,
    RandomRicker,
    Scenarios,
    UncertainStructures,
)
from jaxpound.scheme import PAPER_SCHEME, Scheme, TimeGrid, stability_limit
from jaxpound.sensitivity import Sensitivity, sobol_sensitivity
from jaxpound.simulation import demand, simulate
from jaxpound.structures import AdjacentStructures, ZenerRod
from jaxpound.study import Study
from jaxpound.units import STANDARD_GRAVITY, Building, Scales, dimensionless

__version__ = "0.1.0"

__all__ = [
    "PAPER_SCHEME",
    "STANDARD_GRAVITY",
    "AdjacentStructures",
    "Bounds",
    "Building",
    "CVaR",
    "Calibration",
    "Comparison",
    "CustomDraw",
    "Demand",
    "Design",
    "DesignSpace",
    "Elasticities",
    "Energy",
    "Ensemble",
    "Estimate",
    "EventResolved",
    "Fragility",
    "FullHistory",
    "Limit",
    "LogNormal",
    "MeanGap",
    "ModalHistory",
    "Normal",
    "Objective",
    "ParetoFront",
    "Penalty",
    "Phase",
    "PlausibilityWarning",
    "PoundingProbability",
    "RandomRecord",
    "RandomRicker",
    "Record",
    "Response",
    "Ricker",
    "Scales",
    "Scenarios",
    "Scheme",
    "Sensitivity",
    "Smoothed",
    "SoftMinimum",
    "Study",
    "Switching",
    "TimeGrid",
    "UncertainStructures",
    "Uniform",
    "WorstGap",
    "ZenerRod",
    "arias_intensity",
    "calibrate",
    "demand",
    "design_damper",
    "dimensionless",
    "elasticities",
    "fit_fragility",
    "gl_weights",
    "in_chunks",
    "monte_carlo",
    "paper",
    "pareto_front",
    "pga",
    "pgv",
    "read_record",
    "rod_force",
    "simulate",
    "simulate_buildings",
    "sobol_sensitivity",
    "spectral_acceleration",
    "stability_limit",
    "use_cores",
]
