"""Bearings, moat walls, tuned masses, links of two faces and dampers by a law in configurations."""

import contextlib
import math
import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

import jaxpound as jp
from jaxpound.cli.buildings import as_toml
from jaxpound.cli.design import DesignConfig, objective_of
from jaxpound.cli.parameters import Parameters, by_path
from jaxpound.cli.reading import File
from jaxpound.model.parameters import get
from jaxpound.model.row import by_face
from tests.cli.commands import layout_of, simulated, written_back
from tests.cli.written import csv_rows, summary
from tests.refusals import refusals, refused

FRAME = jp.ShearBuilding.from_period(3, 3e5, 0.5, 0.03)
STOREYS = "[[building]]\nstoreys = {number = 3, mass = 3e5, period = 0.5, damping_ratio = 0.03}\n"
PENDULUM = jp.FrictionPendulum(2.24, 0.05, fast_friction=0.08, rate=40.0)
LAW = jp.KelvinVoigt(stiffness=2e9, restitution=0.7)
CONTACT = "contact = {law = 'kelvin-voigt', stiffness = 2e9, restitution = 0.7}"
PENDULUMS = "isolation = {type = 'friction pendulum', base_mass = 3.5e5, radius = 2.24"
RATE = "friction = 0.05, fast_friction = 0.08, rate = 40"
ISOLATED = f"{STOREYS}{PENDULUMS}, {RATE}, wall = {{gap = [0.3, inf], {CONTACT}}}}}\n"
LEAD = "isolation = {type = 'lead rubber', base_mass = 3.5e5, period = 2.5, strength = 0.05"
DAMPER = jp.Rod(jp.PowerLaw(8e5, 0.3), 2e8)
FAST = jp.VelocityFriction(1e4, 0.02)
FASTER = "velocity_friction = {increase = 1e4, velocity = 0.02}"
LINK = f"""[[link]]
building = 1\nfloor = 3\nnext_floor = 2\ngap = [0.1, 0.2]\nfriction_force = 2e4
damper = {{law = "power", force = 8e5, exponent = 0.3, stiffness = 2e8}}
{FASTER}\n{CONTACT}
"""


def isolated(bearing=PENDULUM, frame=FRAME, **options):
    building, links = jp.on_bearings(frame, bearing, 3.5e5, **options)
    return building, by_face(links)


def lead_rubber(frame=FRAME, gap=0.3, **options):
    bearing = jp.LeadRubber(2.5, 0.05, ultimate_displacement=0.6)
    return isolated(bearing, frame, wall=jp.MoatWall(gap), **options)


def of_two_faces():
    building, wall = isolated(wall=jp.MoatWall((0.3, np.inf), LAW))
    laws = {"contact": LAW, "damper": DAMPER, "velocity_friction": FAST}
    link = jp.FloorLink(0, 2, 1, friction=2e4, gap=(0.1, 0.2), **laws)
    return (building, FRAME), by_face((link,)) + wall


def one(building, links):
    return (building,), links


TWO_LAWS = jp.Bilinear, jp.BoucWen
WEAK, SMOOTH = (FRAME.yielding(law, yield_force=2e6, hardening=0.1) for law in TWO_LAWS)
YIELDS = "yield_force = 2e6\nhardening = 0.1\n"
LEAD_WALL = f"{LEAD}, ultimate_displacement = 0.6, wall = {{gap = 0.3}}}}\n"


def tuned_inerter(**options):
    """On bearings, where all floors are one higher."""
    building, (link,) = jp.tuned_inerter_damper(FRAME, 0.05, damping_ratio=0.1, **options)
    bearings = jp.LeadRubber(2.5, 0.05)
    on_bearings, (inerter,) = jp.on_bearings(building, bearings, 3.5e5, links=(link,))
    below = link.other_floor + 1  # the base, where it led to the ground
    assert (inerter.floor, inerter.other_floor, inerter.other_building) == (4, below, 0)
    return (on_bearings,), (inerter,)


ROD = jp.Rod(jp.ZenerRod(0.6, 0.01, 0.3), 4e6)
BRACE = jp.FloorLink(0, 1, next_building=0, damper=ROD)
POLYMER = "damper = {law = 'zener', order = 0.6, tau_f = 0.01, tau_x = 0.3, stiffness = 4e6}"
INERTER = (FRAME, FRAME), (jp.FloorLink(0, 1, gap=0.1, inerter=jp.Inerter(2e5)),)
FACE = {"side": "left", "gap": 0.1, "friction": 1e4, "velocity_friction": FAST}
FACE = jp.FloorLink(0, 0, next_building=jp.GROUND, **FACE)
OF_FACE = f"side = 'left'\ngap = 0.1\nfriction_force = 1e4\n{FASTER}"
SECOND_FLOOR = "[[link]]\nbuilding = 1\nfloor = 2\n"
GROUND = f"{STOREYS}[[link]]\nbuilding = 1\nfloor = 1\nnext_building = 'ground'\n"
HIGH = LEAD_WALL.replace("0.3", "0.8").replace("wall", "height = 1.5, wall")
NUMBERED = (FRAME, lead_rubber(height=1.5)[0]), lead_rubber(gap=0.8, number=1)[1]
TUNED_INERTER = "tuned_mass = {inertance_ratio = 0.05, damping_ratio = 0.1"
TUNED = "tuned_mass = {mass_ratio = 0.05, damping_ratio = 0.1}"
SPRINGS = "[[building]]\n[building.storeys]\nmasses = [3e5, 3e5, 2e5]\nstiffnesses = 2e8\n{}\n"
UNIFORM = "[[building]]\n[building.storeys]\nnumber = 3\nmass = 3e5\nperiod = 0.5\n"
ON_LEAD = 'type = "lead rubber"\nbase_mass = 3.5e5\nperiod = 2.5\nstrength = 0.05\n'
MASSES = [3e5, 3e5, 2e5]
DAMPED = jp.ShearBuilding.of_storeys(MASSES, 2e8, damping=jp.Rayleigh(0.05, (1, 3)))
VISCOUS = jp.ShearBuilding.of_storeys(MASSES, 2e8, dashpots=[1e6, None, 2e6])
ALPHA_BETA = jp.Rayleigh(mass=0.5, stiffness=0.002)
MODAL = jp.model.ModalDamping([0.02, 0.05, 0.1])
MODALLY = jp.ShearBuilding.of_storeys(MASSES, 2e8, damping=MODAL)
UNIFORMLY = jp.ShearBuilding.from_period(3, 3e5, 0.5, damping=ALPHA_BETA)
FORMS = {
    "two faces": (ISOLATED + STOREYS + LINK, of_two_faces()),
    "lead rubber": (STOREYS + LEAD_WALL, one(*lead_rubber())),
    "two laws": (f"{STOREYS}{YIELDS}law = 'bouc-wen'\n{LEAD_WALL}", one(*lead_rubber(SMOOTH))),
    "elastic base": (f"{STOREYS}{YIELDS}{PENDULUMS}, {RATE}}}", one(*isolated(frame=WEAK))),
    "number and height": (STOREYS + STOREYS + HIGH, NUMBERED),
    "tuned mass": (STOREYS + TUNED, one(jp.tuned_mass_damper(FRAME, 0.05, damping_ratio=0.1), ())),
    "viscoelastic": (f"{STOREYS}{SECOND_FLOOR}next_building = 1\n{POLYMER}", one(FRAME, (BRACE,))),
    "inerter": (f"{STOREYS * 2}{SECOND_FLOOR}gap = 0.1\ninerter = {{inertance = 2e5}}", INERTER),
    "tuned inerter": (f"{STOREYS}{TUNED_INERTER}}}\n{LEAD}}}", tuned_inerter()),
    "tuned inerter above a floor": (
        f"{STOREYS}{TUNED_INERTER}, floor = 1, mass_ratio = 0.02}}\n{LEAD}}}",
        tuned_inerter(floor=0, mass_ratio=0.02),
    ),
    "left face": (GROUND + OF_FACE, one(FRAME, (FACE,))),
    "modal": (SPRINGS.format("damping = {modal = [0.02, 0.05, 0.1]}"), one(MODALLY, ())),
    "rayleigh": (SPRINGS.format("damping = {rayleigh = 0.05, modes = [1, 3]}"), one(DAMPED, ())),
    "rayleigh on bearings": (
        f"{UNIFORM}damping = {{mass = 0.5, stiffness = 0.002}}\n[building.isolation]\n{ON_LEAD}",
        one(*jp.on_bearings(UNIFORMLY, jp.LeadRubber(2.5, 0.05), 3.5e5)),
    ),
    "dashpots": (SPRINGS.format("dashpots = [1e6, 0.0, 2e6]"), one(VISCOUS, ())),
    "spring and dashpot": (
        f'{UNIFORM}damping_ratio = 0.05\norder = "spring"\n',
        one(jp.ShearBuilding.from_period(3, 3e5, 0.5, 0.05, None), ()),
    ),
}


@pytest.mark.parametrize("form", FORMS)
def test_a_file_is_the_library_s_buildings_and_is_written_back(form):
    text, (buildings, links) = FORMS[form]
    again = written_back(text, buildings, links)
    assert [link.side for link in again] == [link.side for link in links]


def test_damping_has_keys_and_a_file_s_faults_are_named():
    keys = Parameters(layout_of(FORMS["rayleigh"][0])).keys
    assert keys["building.1.damping.rayleigh"] == ["buildings.0.damping.ratio"]
    keys = Parameters(layout_of(FORMS["modal"][0])).keys
    assert keys["building.1.damping.modal.2"] == ["buildings.0.damping.ratios.1"]
    assert Parameters(layout_of(FORMS["dashpots"][0])).keys["building.1.storey.3.dashpot"]
    faults = {
        "damping = {rayleigh = 1.5}": "rayleigh = 1.5 must be between 0 and 1",
        "damping = {rayleigh = 0.05, modes = [1, 4]}": r"modes = \(1, 4\) must be from 1 to 3",
        "damping = {mass = 1.0}": "damping lacks stiffness",
        "damping = {modal = [0.1, 0.2]}": "damping: modal, 2 of them, must be 3, one for each",
        "order = 0.5": "lacks tau_f, tau_x",
        "dashpots = [1.0, 2.0]": "dashpots, 2 of them, must be 3",
        "damping = {rayleigh = 0.05}\nbearings = 3": "bearings = 3 must be a whole number",
    }
    for text, words in faults.items():
        refused(words, layout_of, SPRINGS.format(text))


def test_a_dashpot_is_written_back():
    damper = jp.Rod(jp.Dashpot(3e5))
    written = as_toml(jp.Buildings((FRAME, FRAME), (jp.FloorLink(0, 1, damper=damper, gap=0.1),)))
    assert 'damper = {law = "dashpot", coefficient = 300000' in written.replace("3e5", "300000")
    (link,) = layout_of(written).buildings.links
    assert (repr(link.damper), link.gap) == (repr(damper), 0.1)


def test_a_damper_to_the_ground_is_written_as_one_and_inertance_may_have_a_budget():
    ground = jp.FloorLink(0, 1, jp.GROUND, friction=2e4)
    written = as_toml(jp.Buildings((FRAME, FRAME), (ground,)))
    assert layout_of(written).buildings.system().topology.links == ((1, jp.GROUND),)
    text = FORMS["inerter"][0] + "\n[earthquakes]\nrecords = ['a']\n[limits]\ntotal_inertance = "
    for limit, says in ((5e5, ""), (-1.0, r"\[limits\] total_inertance = -1 kg must be between")):
        config = File("row.toml", f"{text}{limit}").read(DesignConfig)
        with pytest.raises(ValueError, match=says) if says else contextlib.nullcontext():
            assert objective_of("row.toml", config).limits["total_inertance"].at_most == limit


def test_the_page_on_the_command_line_has_a_file_with_all_of_them():
    page = (Path(__file__).parents[2] / "docs" / "command_line.md").read_text(encoding="utf-8")
    (text,) = re.findall(r"^```toml\n(\[\[.*?)^```", page, re.M | re.S)
    layout = layout_of(text)
    assert [x.n_floors for x in layout.shear_buildings] == [5, 5, 4]  # and a tuned mass
    assert layout.tables == (1, 2, 2, None, None, None)
    said = [key for bearing in layout.bearings if bearing for key in bearing.stated()]
    assert {*said} == {*type(layout.bearings[0]).__struct_fields__}
    told = re.findall(r"`((?:link|building)\.1\.[\w.]+)`", page)
    general = {re.sub(r"\d", "*", key) for key in Parameters(layout).keys}
    assert len(told) > 8
    assert {re.sub(r"\d", "*", key) for key in told} <= general


PLACE, WALL = "damper's force, 1–2, floors 3–2, right", "1–ground, floor 1, left"
SPEED, RESTITUTION = "links.0.velocity_friction.velocity", "links.3.contact.restitution"


def test_a_key_stands_for_both_faces_and_a_damper_for_its_link():
    parameters = Parameters(layout_of(ISOLATED + STOREYS + LINK))
    for key, path, value, unit, words in (
        ("link.1.damper.force", "links.0.damper.material.force", 8e5, "N", PLACE),
        ("link.1.damper.stiffness", "links.0.damper.stiffness", 2e8, "N/m", "damper's stiffn"),
        ("link.*.velocity_friction.velocity", SPEED, 0.02, "m/s", "velocity of the increase"),
        ("link.1.gap", "links.0.gap links.1.gap", (0.2, 0.1), "m", "gap at rest, "),
        ("link.1.friction_force", "links.0.friction", 2e4, "N", "slip force, 1–2, f"),
        ("building.*.isolation.gap", "links.3.gap", 0.3, "m", f"gap at rest, {WALL}"),
        ("building.1.isolation.contact.restitution", RESTITUTION, 0.7, "", "restitution"),
    ):
        paths = path.split()
        assert [*by_path("", {key: 1}, parameters)] == paths
        for path_of_face, of_face in zip(paths, np.atleast_1d(value), strict=True):
            assert parameters.unit_of(path_of_face) == unit
            assert parameters.in_words(path_of_face).startswith(words)
            assert float(get(parameters.buildings, path_of_face)) == of_face
    assert "building.1.storey.1.stiffness" in parameters.keys
    assert not {f"building.1.storey.1.{x}" for x in ("order", "tau_x")} & parameters.keys.keys()


def refuse_key(key):
    by_path("[uncertain]", {key: 1}, Parameters(layout_of(ISOLATED + STOREYS + LINK + SECOND)))


SECOND = "[[link]]\nbuilding = 2\nfloor = 1\nnext_building = 'ground'\nfriction_force = 1e4\n"
test_keys = refusals(
    ("link.2.damper.force", r"link.2.damper.force must be a parameter of link.2: friction_force"),
    (
        "link.2.velocity_friction.increase",
        r"increase must be a parameter of link.2: friction_force",
    ),
    ("building.2.isolation.gap", r"must be a parameter of building.2: floor.\*.mass, storey"),
    ("building.1.isolation.radius", "has an unknown key 'building.1.isolation.radius'"),
    of=refuse_key,
    before=r"\[uncertain\].*",
)


RUN = "[run]\nfriction = 'switching'"
PAIR = """gap = 0.1
damper = {friction_force = 0}
building_2 = {mass = 4e5, period = 0.5, damping_ratio = 0.05}
[building_1]\nmass = 4e5\nperiod = 1\ndamping_ratio = 0.05
"""
POWER = "damper = {law = 'power', force = 1, stiffness = 1e6"
TWO = r"must be a number, or two, \[left, right\], of which one may be inf"
test_links = refusals(
    ("gap = [1, 2, 3]", rf"gap = \[1, 2, 3\] {TWO}"),
    ("gap = [0.1, 'a']", rf'gap = \[0.1, "a"\] {TWO}'),
    ("gap = inf", f"gap = inf {TWO}"),
    ("gap = [inf, inf]", "gap: left = inf m must be between 0 and 10 m"),
    ("gap = [0.1, 20]", "gap: right = 20 m must be between 0 and 10 m"),
    ("gap = [0.1, 0.2]\nside = 'left'", "side must not be given with gap = .left, right.,"),
    ("gap = 0.1\nside = 'up'", 'side = "up" must be one of "left", "right"'),
    (f"{POWER}, exponent = 0}}", "damper exponent = 0 must be in .0, 1"),
    (f"{POWER}, exponent = 1.5}}", "damper exponent = 1.5 must be from 0 to 1"),
    (f"{POWER}}}", "damper lacks the key 'exponent', which law = \"power\" needs"),
    (POWER.replace("r'", "s'") + "}", 'damper law = "powes" must be one of "dashpot", "power", "z'),
    (
        "damper = {law = 'dashpot'}",
        "damper lacks the key 'coefficient', which law = .dashpot. needs",
    ),
    ("damper = {law = 'power', force = 1, exponent = 1}", "damper lacks the key 'stiffness'"),
    ("inerter = {}", "inerter lacks the key 'inertance'"),
    ("inerter = {inertance = -1}", "inerter inertance = -1 kg must be between 0 and 1e.12"),
    ("velocity_friction = {increase = 1}", "velocity_friction lacks the key 'velocity'"),
    (
        f"gap = 0.1\nside = 'left'\n{SECOND.replace('2', '1')}",
        "2 friction = 10000.0 must be that of",
    ),
    of=lambda keys: layout_of(GROUND + keys),
    before=r"row.toml: \[\[link\]\] 1? ?",
)
test_bearings = refusals(
    ("isolation = {type = 'rubber', base_mass = 1e5}", 'type = "rubber" must be one of "frict'),
    (f"{PENDULUMS.replace('base_mass = 3.5e5, ', '')}}}", "lacks the key 'base_mass'"),
    (f"{PENDULUMS}}}", "lacks the key 'friction', which type = \"friction pendulum\" needs"),
    (f"{PENDULUMS}, friction = 0.1, period = 2}}", "period must not be given with type = "),
    (f"{PENDULUMS}, friction = 0.1, fast_friction = 0.05}}", "fast_friction = 0.05 must be fini"),
    (f"{LEAD}, wall = {{{CONTACT}}}}}", "wall lacks the key 'gap'"),
    (f"{LEAD}, wall = {{gap = [inf, inf]}}}}", "wall gap: left = inf m must be between 0 a"),
    (f"{LEAD}, height = 0}}", "height = 0 m must be between 0.01 and 100 m"),
    of=lambda keys: layout_of(STOREYS + keys),
    before=r"row.toml: \[\[building\]\] 1 isolation ",
)
test_masses = refusals(
    ("{}", "lacks mass_ratio; give mass_ratio, or inertance_ratio"),
    ("{mass_ratio = 0}", "mass_ratio = 0 must be between 0.0001 and 10"),
    ("{inertance_ratio = 20}", "inertance_ratio = 20 must be between 0.0001 and 10"),
    (
        "{mass_ratio = 0.1, floor = 1}",
        "lacks inertance_ratio; give inertance_ratio .mass_ratio, floor",
    ),
    of=lambda table: layout_of(f"{STOREYS}tuned_mass = {table}"),
    before=r"row.toml: \[\[building\]\] 1 tuned_mass ",
)
test_forms = refusals(
    (f"{PAIR}{LEAD}}}", r"isolation in \[building_1\] belongs in \[\[building\]\]; two bui"),
    (
        f"{STOREYS}tuned_mass = {{inertance_ratio = 0.1, floor = 3}}",
        r"\[\[building\]\] 1 tuned_mass: floor = 3 must be below the roof, from 1 to 2",
    ),
    (f"{PAIR}{TUNED}", r"tuned_mass in \[building_1\] belongs in \[\[building\]\]"),
    (
        f"{GROUND}velocity_friction = {{increase = 1e3, velocity = 0.02}}\n{RUN}",
        "where a link has contact or velocity_friction, or floors",
    ),
    (
        ISOLATED + GROUND.removeprefix(STOREYS) + "friction_force = 1.0",
        r"isolation \(1–ground, floor 1\) must not stand where \[\[link\]\] 1 does",
    ),
    of=layout_of,
)


SHORT = f"""[[building]]
storeys = {{number = 1, mass = 3e5, period = 0.3, damping_ratio = 0.03}}
{PENDULUMS}, friction = 0.03, wall = {{gap = [0.06, 0.08], {CONTACT}}}}}
[[link]]
building = 1\nfloor = 2\nnext_building = 1
damper = {{law = "power", force = 4e5, exponent = 0.3, stiffness = 7e7}}
[run]
duration = 1.6
"""


def test_the_row_of_a_building_leaves_out_its_tuned_mass_whose_stroke_stands_apart(pulse, tmp_path):
    text = f"{STOREYS}{TUNED}\n[run]\nduration = 1.6\n"
    screen, out, _, response = simulated(text, pulse, tmp_path)
    demand = response.demand
    (building,) = summary(out)["results"]["buildings"]
    assert (building["storeys"], building["height_m"], building["series"]) == (3, 9.0, [1, 2, 3])
    roof, tuned = demand.masses[2:]
    assert building["peak_displacement_m"] == float(roof.peak_x) < float(tuned.peak_x)
    accelerations = [float(mass.peak_acceleration) for mass in demand.masses[:3]]
    assert building["peak_absolute_acceleration_m_per_s2"] == max(accelerations)
    drifts = [float(demand.masses[0].peak_x), *(float(x.peak_drift) for x in demand.rods[1:])]
    assert building["peak_drift_m"] == max(drifts[:3]) < drifts[3]
    assert building["peak_drift_ratio"] == pytest.approx(max(drifts[:3]) / 3)
    assert building["tuned_mass_strokes_m"] == [drifts[3]]
    assert sum(mode["share_of_mass"] for mode in building["modes"]) == pytest.approx(1)
    assert f"floor by floor; tuned mass: stroke {drifts[3]:.4g} m" in screen
    assert [row["floor"] for row in csv_rows(out / "floors.csv")] == ["1", "2", "3"]


def test_a_run_says_and_draws_what_bearings_walls_and_dampers_do(pulse, tmp_path):
    screen, out, _, response = simulated(SHORT, pulse, tmp_path)
    demand = response.demand
    results = summary(out)["results"]
    (building,) = results["buildings"]
    base = float(demand.masses[0].peak_x)
    assert building["isolation"]["displacement_m"] == base
    period = 2 * math.pi * math.sqrt(2.24 / 9.80665)
    assert building["isolation"]["restoring_period_s"] == pytest.approx(period)
    ratio = 2 / math.pi * 0.03 / (0.03 + base / 2.24)
    assert building["isolation"]["damping_ratio"] == pytest.approx(ratio)
    assert building["peak_drift_m"] == float(demand.rods[1].peak_drift)  # not of the bearings
    brace, right, left = results["links"]
    assert (right["table"], brace["table"]) == (None, 1)
    between = [f"1–ground, floor 1, {side}" for side in ("right", "left")]
    assert [right["between"], left["between"]] == between
    assert right["viscous_force_N"] is left["viscous_energy_J"] is None
    assert brace["viscous_force_N"] == float(demand.rods[2].peak_force) > 0
    assert brace["viscous_energy_J"] == float(demand.rods[2].dissipated_energy) > 0
    assert "viscous dampers" in screen
    assert (right["gap_m"], left["gap_m"]) == (0.08, 0.06)
    for link, scalars in zip((right, left), demand.links[1:], strict=True):
        assert link["contact"]["n_impacts"] == float(scalars.n_impacts) > 0
    assert right["slip_distance_m"] == float(demand.links[1].slip_distance) > 0
    assert brace["slip_distance_m"] is left["slip_distance_m"] is None
    assert re.search(r"contact 1–ground, floor 1, left +[1-9]\d* impact", screen)
    words = re.search(r"bearings of .*\n +1 +(\S+) +(\S+) +(\S+)", screen)
    numbers = [float(word) for word in words.groups()]
    assert numbers == pytest.approx([3.003, base, ratio], rel=1e-3)
    floors = [float(link["contact"]["peak_contact_N"]) for link in (left, right)]
    base, *_ = csv_rows(out / "floors.csv")
    assert [float(base[f"contact_{side}_N"]) for side in ("left", "right")] == floors
    names = {path.stem for path in out.glob("*.png")}
    assert {"friction_force", "friction_hysteresis", "contact_force", "row"} <= names
    height, width, _ = imread(out / "row.png").shape
    assert height < 2 * width  # bearings are no storey of which all others are multiples


DAMPERS = (
    'damper = {law = "power", force = 6e4, exponent = 1.0, stiffness = 1e7}',
    'damper = {law = "dashpot", coefficient = 6e4}',
)


@pytest.mark.parametrize("damper", DAMPERS)
def test_modes_of_a_building_count_the_dampers_between_it_and_the_ground(damper, pulse, tmp_path):
    """Not those to its neighbour."""
    rod = "order = 1.0, tau_f = 1e-6, tau_x = 1e-6"
    storey = f"storeys = {{masses = [1e5], stiffnesses = 4e6, {rod}}}"
    links = "".join(
        f"[[link]]\nbuilding = {building}\nfloor = 1\n{other}{damper}\n"
        for building, other in ((1, ""), (2, 'next_building = "ground"\n'))
    )
    text = f"{f'[[building]]{chr(10)}{storey}{chr(10)}' * 2}{links}[run]\nduration = 1.6\n"
    _, out, _, _ = simulated(text, pulse, tmp_path)
    (left,), (right,) = (x["modes"] for x in summary(out)["results"]["buildings"])
    assert left["damping_ratio"] == pytest.approx(0, abs=1e-4)
    assert right["damping_ratio"] == pytest.approx(6e4 / (2 * math.sqrt(1e5 * 4e6)), rel=0.01)
