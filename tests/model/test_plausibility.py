"""Numbers in a wrong unit: refused where nothing has them, else told of, in Python as in files."""

import warnings

import jax
import numpy as np
import pytest

import jaxpound as jp
from jaxpound.model.plausibility import _Floors
from tests.refusals import refusals, refused

T = 0.02 * np.arange(300)
RECORD = jp.Record(0.2 * np.sin(10 * T) * np.exp(-((T - 2) ** 2)), dt=0.02)
HERTZ, KELVIN = jp.Hertz(2e10), jp.KelvinVoigt(8.8e8, 0.65)


def pair(masses=(500e3, 400e3), periods=(0.9, 0.6)):
    return [jp.Building.from_period(*x, 0.05) for x in zip(masses, periods, strict=True)]


def beside(pair, friction=200e3, gap=0.1, contact=None):
    return jp.Buildings(pair, jp.floor_links(pair, friction=friction, gap=gap, contact=contact))


TONNES = {"masses": (500.0, 400.0)}
LINK = "link 1–2, floor 1"
DAMPER, LASTS = "slip force = {} N should be 0 or between", "makes a contact last about"
STIFF, SOFT = {"friction": 0.0, "contact": KELVIN}, {"contact": jp.KelvinVoigt(8.8e5, 0.65)}
SHORT = rf"stiffness = 8\.8e\+08 N/m {LASTS} 0\.0016 s, which should be"
LONG = rf"stiffness = 8\.8e\+05 N/m {LASTS} 1\.6 s, which should be be"
OF_HERTZ = rf"stiffness = 8\.8e\+06 N/m\^1\.5 {LASTS} 0\.75 s, .* 0\.3 s"
PERIOD = r"building 2: natural period = 10\.5 s should be between 0\.05 and 10 s"
WRONG = {
    "masses in t, a damper in N": (TONNES, {}, f"{LINK}: {DAMPER.format('2e.05')}"),
    "masses in t, a contact in N/m": (TONNES, STIFF, f"{LINK}: {SHORT}"),
    "one mass in t": ({"masses": (500e3, 400.0)}, {}, "the masses of floors, 400 to 5e.05 kg, sho"),
    "a damper in kN": ({}, {"friction": 200.0}, f"{LINK}: {DAMPER.format(200)}"),
    "ω for a period": ({"periods": (7.0, 10.5)}, {}, PERIOD),
    "a contact in kN/m": ({}, SOFT, f"{LINK}: {LONG}"),
    "Hertz's contact in kN/m": ({}, {"contact": jp.Hertz(8.8e6)}, f"{LINK}: {OF_HERTZ}"),
}


@pytest.mark.parametrize(("buildings", "between", "message"), WRONG.values(), ids=WRONG)
def test_numbers_in_a_wrong_unit_are_told_of_before_a_run(buildings, between, message):
    buildings, between = pair(**buildings), {"friction": 200e3, "gap": 0.1} | between
    links = jp.floor_links(buildings, **between)
    with pytest.warns(jp.PlausibilityWarning, match=f"^Buildings: {message}") as told:
        row = jp.Buildings(buildings, links)
    assert [(len(told), told[0].filename)] == [(1, __file__)]
    refused(f"^simulate: {message}", jp.simulate, row, RECORD, strict=True)


def test_gaps_are_judged_by_static_displacements():
    message = "gap = 10 m should be at most 5 times what the buildings move at an acceleration of 1"
    with pytest.warns(jp.PlausibilityWarning, match=rf"^Buildings: {LINK}: {message} g, 0\.29.* m"):
        beside(pair(), gap=10.0)
    # The top moves 3 + 2 + 1 times what the weight of one floor makes of a storey.
    tower = jp.ShearBuilding.of_storeys([2e5] * 3, 1e8, 1.0, 1e-9, 1e-9)
    alone = jp.Buildings((tower,), gravity=10.0)
    floors = _Floors.of(alone, alone.system())
    np.testing.assert_allclose(floors.moved, 2e5 * 10 / 1e8 * np.array([3, 5, 6]), rtol=0.02)
    np.testing.assert_allclose(floors.first_periods, [tower.natural_period], rtol=1e-9)


def test_usual_numbers_are_not_told_of_and_traced_ones_not_judged():
    """The suite makes errors of warnings; a model's masses, forces and lengths are small."""
    for law in (None, KELVIN, HERTZ, jp.Newton(0.65), jp.Jankowski(3e9, 0.65)):
        beside(pair(), contact=law)
        beside(pair(masses=(50.0, 40.0), periods=(0.2, 0.15)), friction=20.0, gap=0.005)
        left, right = map(jp.ShearBuilding.published, ("jankowski-left", "jankowski-right"))
        literature = jp.Jankowski(2.75e9, 0.65)  # with the force in N, of the same paper
        links = jp.floor_links((left, right), gap=0.02, contact=literature)
        jp.Buildings((left, right), links)

    jax.jit(lambda force, law: beside(pair(), force, contact=law).links[0].gap)(1.0, jp.Hertz(1.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        many = jp.Building.from_period(500.0, np.array([0.5, 0.9]), 0.05)
        beside((many, many), 1e9)


OF_BLOCK, OF_STOREYS = jp.Building.from_period, jp.ShearBuilding.from_period
OWNER, OF_ROW, ROD = "Building.from_period: ", r"Buildings: links\.0", (1e8, 0.5, 0.01, 0.1)
STRONG = jp.floor_links(pair(), friction=1e12)
NO_NUMBER = r"must be a real number \(0 stands for none\)"
test_numbers_that_no_building_has_are_refused = refusals(
    (lambda: pair(periods=(900.0, 600.0)), "Building.from_period: period = 900 must be betwe"),
    (OF_BLOCK, 5e5, 0.9, 5, rf"{OWNER}damping_ratio = 5 must be between 0 and 1 .*0\.05 is 5 %"),
    (OF_STOREYS, 2, 5e5, 900, 0.05, "ShearBuilding.from_period: period = 900 must be between"),
    (jp.Building, 5e11, *ROD, r"Building: mass = 5e\+11 must be between 0\.001 and 1e\+10 kg"),
    (lambda: jp.ShearBuilding(tuple(pair()), 3000), "heights.0 = 3000 must be between 0.01 an"),
    (lambda: beside(pair(), 0.0, 100.0), rf"{OF_ROW}\.gap = 100 must be between 0 and 10 m"),
    (jp.Buildings, pair(), STRONG, rf"{OF_ROW}\.friction = 1e\+12 must be between 0 and 1e\+10 N"),
    (lambda: beside(pair(), None), rf"friction = None {NO_NUMBER}"),
)


def storeys(mass=300e3, period=0.5, n=3):
    return jp.ShearBuilding.from_period(n, mass, period, 0.05)


HEAVIEST = r"the heaviest floor, of {} kg, should be at {} kg: are masses in kg, not in t, and no"
AT_YIELD = r"storey {} of building 1: the force at yield, {} N, should be between {}"
LIGHT, SHORT_ONE = HEAVIEST.format(300, "least 9000"), storeys(period=0.3, n=2)
OF_UNITS = {
    "masses in t": (storeys(300.0), storeys(250.0), LIGHT),
    "weights in kN": (storeys(2942.0), storeys(2452.0), HEAVIEST.format(2942, "least 9000")),
    "weights in N": (
        storeys(300e3 * 9.81),
        storeys(250e3 * 9.81),
        HEAVIEST.format(r"2\.943e\+06", r"most 2\.5e\+06"),
    ),
    "weights of a tower in N": (
        storeys(1.1e7, 6.0, 60),
        HEAVIEST.format(r"1\.1e\+07", r"most 1e\+07"),
    ),
    "a force in kN": (
        storeys().yielding(yield_force=3000.0),
        AT_YIELD.format(1, 3000, "4.413e.04"),
    ),
    "forces in kN": (
        SHORT_ONE.yielding(yield_force=[800.0, 500.0]),
        AT_YIELD.format(1, 800, "2.9"),
    ),
    "half a newton": (storeys().yielding(yield_force=0.5), AT_YIELD.format(1, 0.5, "4.413e.04")),
    "a tera": (
        storeys().yielding(yield_force=1e12),
        AT_YIELD.format(1, "1e.12", r"4.* 2\.648e.07"),
    ),
    "a coefficient in %": (
        storeys().yielding(base_shear_coefficient=12),
        AT_YIELD.format(1, ".*", 4),
    ),
}


@pytest.mark.parametrize("case", OF_UNITS.values(), ids=OF_UNITS)
def test_masses_and_strengths_in_a_wrong_unit_are_told_of(case):
    *buildings, message = case
    with pytest.warns(jp.PlausibilityWarning, match=f"^Buildings: {message}") as told:
        alone = jp.Buildings(buildings)
    assert len(told) == 1
    refused(f"^simulate: {message}", jp.simulate, alone, RECORD, strict=True)


def test_a_huge_inertance_is_told_of():
    inerter = jp.FloorLink(0, 0, inerter=jp.Inerter(1e12))
    message = r"inertance = 1e\+12 kg should be at most 9e\+06 kg, 10 times the mass of all floors"
    with pytest.warns(jp.PlausibilityWarning, match=f"^Buildings: {message}"):
        jp.Buildings(tuple(pair()), (inerter,))


def test_real_buildings_of_all_sizes_are_not_told_of():
    """The suite makes errors of warnings: sheds, a footbridge, towers, a silo, a tuned mass."""
    jp.Buildings((storeys(10e3, 0.3, 1), storeys(10e3, 1.1, 3)))  # the least that a floor may weigh
    for mass, period in ((25e3, 0.5), (3e6, 0.7)):
        jp.Buildings((jp.Building.from_period(mass, period, 0.01),))
    tower = storeys(5e6, 6.0, 60)
    jp.Buildings((tower.yielding(base_shear_coefficient=0.03), storeys(2e6, 1.0, 8)))
    jp.Buildings((jp.tuned_mass_damper(jp.Building.from_period(3e8, 6.8, 0.01), 0.01),))
    weak = storeys(n=2).yielding(yield_force=0.5 * 2 * 300e3 * 9.81)  # the same on both storeys
    for bearing in (jp.FrictionPendulum(2.24, 0.05, 0.08, 50.0, 0.4), jp.LeadRubber(2.5, 0.03)):
        jp.Buildings(jp.on_bearings(weak, bearing, 350e3)[:1])
