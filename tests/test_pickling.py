"""What users hold comes back from a pickle; results that take a run are tested with their own."""

import numpy as np
import pytest

import jaxpound as jp
from tests.pickled import assert_survives_pickling

FRAME = jp.ShearBuilding.from_period(3, 300e3, period=0.5, damping_ratio=0.05)
LOW = jp.ShearBuilding.from_period(2, 300e3, period=0.3, damping_ratio=0.05)
WEAK = FRAME.yielding(yield_drift=0.005)
LINKS = jp.floor_links((FRAME, LOW), friction=1e4, gap=0.05, contact=jp.KelvinVoigt(1e9, 0.6))
BUILDINGS, PAPER, GROUND = (
    jp.Buildings((FRAME, LOW), LINKS),
    jp.paper.structures(),
    jp.paper.ground(),
)
ROW, SCALES = BUILDINGS.dimensionless()
BEARING, WALL = jp.FrictionPendulum(2.24, 0.04, 0.08), jp.MoatWall(0.35)
GRID, ZENER = jp.TimeGrid(0.1, 40), jp.ZenerRod(0.5, 0.01, 0.05)
RECORD = jp.Record(0.3 * np.sin(0.05 * np.pi * np.arange(200)), 0.02)
U, TWO_SIDED = jp.Uniform(1.0, 2.0), jp.scenarios.TwoSided(jp.LogNormal(0.1, 0.5))
RICKER = jp.RandomRicker(2, TWO_SIDED, U, U)
SCENARIOS = jp.Scenarios(PAPER, RICKER)
STIFFNESS = {"buildings.*.rods.*.stiffness": jp.LogNormal(5.0, 0.1)}
HAZARD = jp.HazardCurve([0.1, 0.2, 0.4], [1e-2, 2e-3, 1e-4], "PGA (g)")
FRAGILITY = jp.hazard.fit_capacities([0.1, 0.2, 0.3, 0.25])
SERIES = 0.3 * np.arange(5.0)

HELD = {
    "buildings": (jp.Building.from_period(5e5, 0.9, 0.05), FRAME, WEAK, LINKS, BUILDINGS, SCALES),
    "isolated": (BEARING, WALL, jp.on_bearings(FRAME, BEARING, 350e3, wall=WALL)),
    "tuned": jp.tuned_mass_damper(FRAME, 0.02),
    "structures": (PAPER, ROW, PAPER.system(), ROW.system()),
    "contact": (jp.Hertz(1e9), jp.HertzDamped(1e9, 0.6), jp.Jankowski(1e9, 0.6), jp.Newton(0.6)),
    "yielding": (
        jp.model.YieldingZener(ZENER, jp.Bilinear(0.1, 0.05)),
        jp.BoucWen(0.1, 0.05, 2.0, 0.4),
    ),
    "dampers": (jp.PowerLaw(1.0, 1.0, 1.0), jp.Inerter(1.0), jp.VelocityFriction(0.1, 0.1)),
    "schemes": (jp.PAPER_SCHEME, jp.Scheme(jp.Smoothed(0.1)), jp.ModalHistory(), GRID),
    "ground": (GROUND, GROUND + jp.Ricker(0.1, 1.0, 1.0), 2 * GROUND, jp.Pulse(1.0, 1.0, 1.0)),
    "records": (RECORD, jp.RecordSuite([RECORD, RECORD])),
    "noise": (jp.KanaiTajimi(15.0, 0.6), jp.ground.PlateauEnvelope(1.0, 4.0, 0.8)),
    "random ground": (RICKER, jp.scenarios.RandomPulse(0.1, jp.LogNormal(1.0, 0.1), 1.0)),
    "random structures": jp.UncertainStructures(ROW, STIFFNESS, correlation=0.4),
    "scenarios": SCENARIOS,
    "space": jp.DesignSpace(PAPER, {"friction": (0.0, 1.0)}),
    "objective": jp.Objective(jp.SmallestGap(0.1), limits={"damper_force": 0.5}),
    "goals": (jp.SmallestGap(), jp.design.SoftMinimum(0.1), jp.design.Limit(0.3)),
    "hazard": (HAZARD, HAZARD.distribution(), FRAGILITY, HAZARD.annual_rate_of(FRAGILITY)),
}


@pytest.mark.parametrize("name", HELD)
def test_what_users_hold_survives_pickling(name):
    assert_survives_pickling(HELD[name])


COMPUTED = {
    "modes": lambda: (jp.modes(ROW), jp.modes(PAPER)),
    "tests": lambda: (jp.pushover(WEAK), jp.study.cyclic_test(jp.Bilinear(0.1, 0.05), SERIES)),
    "ensembles": lambda: (jp.Ensemble.drawn(SCENARIOS, 3), jp.Ensemble.of([GROUND], GRID)),
    "limit state": lambda: jp.LimitState(SCENARIOS, GRID, threshold=0.1),
}
"""What a program of JAX makes, when it is asked for."""


@pytest.mark.parametrize("name", COMPUTED)
def test_what_was_computed_survives_pickling(name):
    assert_survives_pickling(COMPUTED[name]())
