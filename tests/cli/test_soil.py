"""Buildings on soil in files: what they are in the library, are written as, and do in a run."""

import numpy as np
import pytest

import jaxpound as jp
from jaxpound.cli.parameters import Parameters
from tests.cli.commands import layout_of, simulated, written_back
from tests.cli.test_isolation import FRAME, ISOLATED, STOREYS, isolated, one
from tests.cli.written import csv_rows, summary
from tests.refusals import refusals

SOIL = jp.Soil(150.0, 1800.0, 0.3)
CLAY = "soil = {shear_wave_velocity = 150, density = 1800, poisson_ratio = 0.3, footing_mass = 2e5"
DISK = {"radius": 6.0, "footing_mass": 2e5}
SIDES = {"length": 12.0, "width": 9.0, "embedment": 1.5, "footing_inertia": 3e6}
RECTANGLE = ", ".join(f"{key} = {x}" for key, x in SIDES.items())
LAW = jp.KelvinVoigt(stiffness=2e9, restitution=0.7)
BASE, WALL = isolated(
    jp.FrictionPendulum(2.24, 0.05, fast_friction=0.08, rate=40.0),
    wall=jp.MoatWall((0.3, np.inf), LAW),
)
DAMPER = "damper = {law = 'dashpot', coefficient = 4e6, stiffness = 1e8}"
BETWEEN = f"[[link]]\nbuilding = 1\nfloor = 4\n{DAMPER}"
THROUGH = jp.FloorLink(0, 3, damper=jp.Rod(jp.Dashpot(4e6), 1e8))
ON_DISK = jp.on_soil(FRAME, SOIL, **DISK)
FORMS = {
    "disk": (f"{STOREYS}{CLAY}, radius = 6}}", one(ON_DISK, ())),
    "rectangle under bearings": (
        f"{ISOLATED}{CLAY}, {RECTANGLE}}}",
        one(jp.on_soil(BASE, SOIL, footing_mass=2e5, **SIDES), WALL),
    ),
    "pair": (f"{STOREYS}{CLAY}, radius = 6}}\n" * 2 + BETWEEN, ((ON_DISK,) * 2, (THROUGH,))),
}


@pytest.mark.parametrize("form", FORMS)
def test_a_file_is_the_library_s_buildings_and_is_written_back(form):
    text, buildings_and_links = FORMS[form]
    written_back(text, *buildings_and_links)


def test_numbers_of_the_soil_have_keys():
    keys = Parameters(layout_of(FORMS["disk"][0])).keys
    owner, path = "building.1.soil.", "buildings.0.footing."
    assert keys[f"{owner}shear_wave_velocity"] == [f"{path}soil.shear_wave_velocity"]
    assert keys[f"{owner}footing_mass"] == [f"{path}mass"]
    assert f"{owner}footing_inertia" not in keys


def test_a_run_says_what_the_soil_does(pulse, tmp_path):
    text = (
        FORMS["pair"][0]
        + "\n[[link]]\nbuilding = 1\nfloor = 1\ngap = 0.02\n[run]\nduration = 1.6\n"
    )
    _, out, _, response = simulated(text, pulse, tmp_path)
    results, demand = summary(out)["results"], response.demand
    for number, building in enumerate(results["buildings"]):
        effect, soil, first = ON_DISK.soil_effect(), building["soil"], 5 * number
        assert soil["period_ratio"] == pytest.approx(effect.period_ratio)
        assert soil["added_damping"] == pytest.approx(effect.added_damping)
        assert soil["footing_displacement_m"] == float(demand.masses[first + 3].peak_x) > 0
        assert soil["rotation_rad"] == float(demand.masses[first + 4].peak_x) > 0
        assert soil["sway_force_N"] == float(demand.rods[first + 3].peak_force)
        assert soil["rocking_moment_N_m"] == float(demand.rods[first + 4].peak_force)
        assert building["base_shear_N"] == float(demand.rods[first].peak_force)
        assert building["series"] == [first + 1, first + 2, first + 3]
    rocking, forces = (4, 9), [float(x.peak_force) for x in demand.rods]
    others = [x for k, x in enumerate(forces) if k not in rocking]
    assert max(forces[k] for k in rocking) > max(others)  # in N m
    assert f"largest {max(others):.4g} N, " in str(response)
    between = results["links"][0]
    assert between["between"] == "1–2, footing"
    assert between["viscous_force_N"] == float(demand.rods[11].peak_force)
    assert [row["floor"] for row in csv_rows(out / "floors.csv")] == ["1", "2", "3"] * 2


test_faults_are_named = refusals(
    (f"{CLAY}}}", "lacks radius; give shear_wave_velocity, density, poisson_ratio"),
    (f"{CLAY}, radius = 6, width = 3}}", "must not have width here"),
    (f"{CLAY}, radius = 6, embedment = 3}}", "must not have embedment here"),
    (
        f"{CLAY.replace('150', '1')}, radius = 6}}",
        "shear_wave_velocity = 1 m/s must be between 20 and",
    ),
    (f"{CLAY.replace('2e5', '10')}, radius = 6}}", "footing_mass = 10 must be at least 0.0001"),
    of=lambda table: layout_of(STOREYS + table),
    before=r"row.toml: \[\[building\]\] 1 soil:? ?",
)
