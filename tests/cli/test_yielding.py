"""Buildings that yield in configurations: what they become, and what each command says of them."""

import re

import jax
import numpy as np
import pytest

import jaxpound as jp
from jaxpound._fields import pytree_dataclass
from jaxpound.cli import buildings, montecarlo, reading
from jaxpound.model.parameters import get
from tests.cli.commands import command_for, layout_of, run, simulated
from tests.cli.written import csv_rows, summary
from tests.ground.test_suite import SUITE, at2
from tests.refusals import refusals

STOREYS = "[[building]]\nstoreys = {number = 3, mass = 2e5, period = 0.4, damping_ratio = 0.05}\n"
FRAME = jp.ShearBuilding.from_period(3, 2e5, 0.4, 0.05)
YIELDS = "yield_drift = 0.004\nhardening = 0.05\nultimate_displacement = 0.03\n"
PAIR = f"""gap = 0.05
damper = {{friction_force = 0}}
building_2 = {{mass = 400e3, period = 0.4, damping_ratio = 0.05}}
[building_1]
mass = 400e3\nperiod = 0.6\ndamping_ratio = 0.05
{YIELDS}"""
ALONE = f"""[[building]]
storeys = {{number = 1, mass = 400e3, period = 0.6, damping_ratio = 0.05}}
{YIELDS}"""
COLLAPSE = 0.03 / (0.004 * 3.0)  # the ductility at which building 1 collapses
NOISE = '[earthquakes]\nfilter = "kanai-tajimi"\nfrequency = 1.5\ndamping = 0.6\n'
NOISE += "acceleration = 0.06\nduration = 2.0\ndt = 0.05\n[run]\ndt = 0.02\n"
STRENGTH = '"building.1.storey.1.yield_displacement"'


def close(ours, expected):
    assert jax.tree.structure(ours) == jax.tree.structure(expected)
    np.testing.assert_allclose(jax.tree.leaves(ours), jax.tree.leaves(expected), rtol=1e-15)


LISTED = {"yield_force": [2e6, 1e6, 8e5], "hardening": [0.1, 0.05, 0.02]}
SMOOTH = {"yield_drift": 0.01, "exponent": 3.0, "strength_degradation": [0.0, 0.1, 0.05]}
WEAK = FRAME.yielding(**LISTED, ultimate_displacement=0.1).with_p_delta()
LAWS = {"yield_force": 1e6, "hardening": 0.1}
OF_TWO_LAWS = FRAME.yielding(**LAWS).storeys[0], FRAME.storeys[1]
OF_TWO_LAWS += (FRAME.yielding(jp.BoucWen, **LAWS, exponent=3.0).storeys[2],)
BUILDINGS = (
    ({"yield_force": 1e6}, "", FRAME.yielding(yield_force=1e6)),
    (LISTED, "ultimate_displacement = 0.1\np_delta = true", WEAK),
    (SMOOTH, "law = 'bouc-wen'", FRAME.yielding(jp.BoucWen, **SMOOTH)),
    (
        LAWS,
        "law = ['bilinear', 'elastic', 'bouc-wen']\nexponent = 3.0",
        jp.ShearBuilding(OF_TWO_LAWS),
    ),
)


@pytest.mark.parametrize(("numbers", "more", "building"), BUILDINGS)
def test_the_keys_are_the_library_s_and_are_written_back(numbers, more, building):
    keys = "".join(f"{key} = {value}\n" for key, value in numbers.items())
    layout = layout_of(STOREYS + keys + more)
    assert repr(layout.shear_buildings) == repr((building,))
    close(layout_of(buildings.as_toml(layout.buildings)).buildings, layout.buildings)


def test_a_pair_of_which_one_yields_is_a_row_whose_strengths_and_rods_may_be_random():
    layout = layout_of(PAIR + "height = 4.0\np_delta = true")
    left, right = (jp.Building.from_period(4e5, x, 0.05) for x in (0.6, 0.4))
    numbers = {"hardening": 0.05, "ultimate_displacement": 0.03}
    weak = jp.ShearBuilding((left,), 4.0).yielding(yield_drift=0.004, **numbers).with_p_delta()
    assert repr(layout.shear_buildings) == repr((weak, jp.ShearBuilding((right,))))
    pair = jp.Buildings((weak.storeys[0], right), layout.buildings.links)
    close(layout_of(buildings.as_toml(pair)).shear_buildings[0].storeys, weak.storeys)
    table = f'[uncertain]\n{STRENGTH} = {{lognormal = [1.2, 0.05]}}\n"building.*.storey.*.tau_x" = '
    file = reading.File("row.toml", f"{PAIR}{NOISE}{table}{{lognormal = [1.2, 0.01]}}")
    structures = montecarlo.prepared(file, file.read(montecarlo.StudyConfig))[0].structures
    storeys = [f"buildings.{b}.storeys.0" for b in (0, 1)]
    strength = f"{storeys[0]}.hysteresis.yield_displacement"
    assert {*structures.uncertain} == {strength, *(f"{storey}.tau_x" for storey in storeys)}
    for path, x in structures.parameters(np.zeros(3)).items():
        assert float(x) == pytest.approx(1.2 * float(get(structures.nominal, path)))


test_faults = refusals(
    ("yield_force = 1e6\nyield_drift = 0.01", "a strength by yield_force and yield_drift must be"),
    ("hardening = 0.1", "a strength by nothing must be by one of yield_force, base_shear_coef"),
    ("yield_force = 1e6\nbeta = 0.5", 'beta must not be given with law = "bilinear"; give harden'),
    ("yield_force = [1e6]", "yield_force, 1 of them, must be 3, a number for each storey"),
    ("yield_force = [1e6, -1, 1e6]", "yield_force: storey 2 = -1 N must be between 1e-06 and"),
    ("yield_force = 1e6\nlaw = ['bilinear']", "law must be one for each of 3 storeys"),
    ("yield_force = 1e6\nlaw = 'linear'", 'law = "linear" must be "bilinear" or "bouc-wen", or a'),
    ("yield_force = 1e6\nhardening = -0.1", "ultimate_displacement = inf must be finite where"),
    (
        "yield_drift = 0.01\np_delta = true",
        "p_delta: hysteresis.ultimate_displacement = inf must be finite where hardening is below",
    ),
    (
        "yield_force = 1e6\nlaw = ['elastic', 'elastic', 'elastic']\nbeta = 0.5",
        "beta must not be given with law = .*; leave law out",
    ),
    ("yield_drift = 0.01\nultimate_displacement = 0.02", "ultimate_displacement = 0.02 must be "),
    of=lambda keys: layout_of(STOREYS + keys),
    before=r"row.toml: \[\[building\]\] 1 ",
)


@pytest.mark.usefixtures("without_pictures")
@pytree_dataclass
class OwnLaw(jp.Bilinear):
    """A law that files do not have."""


OWN = FRAME.yielding(OwnLaw, yield_force=1e6).storeys
OF_FILES = "hysteresis must be by a law of a file, bilinear"
test_laws_of_no_file = refusals((buildings.keys_of, OWN, OF_FILES))


def test_simulate_says_what_the_library_does(pulse, tmp_path):
    _, out, _, response = simulated(f"{PAIR}[run]\nduration = 1.6\n", pulse, tmp_path)
    demand = response.demand
    left, right = summary(out)["results"]["buildings"]
    (storey,), (floor, elastic) = left["yielding"], csv_rows(out / "floors.csv")
    for key in ("ductility", "residual_drift_m", "dissipated_energy_J", "first_yield_time_s"):
        expected = float(getattr(demand.rods[0], re.sub("_[mJs]$", "", key)))
        assert storey[key] == float(floor[key]) == expected
        assert elastic[key] == ""
    assert storey["collapsed"] is bool(demand.collapsed) is (storey["ductility"] > COLLAPSE)
    assert right["yielding"] == []


def folder_of_run(folder, command, text):
    path = folder / "config.toml"
    path.write_text(text)
    run(*command_for(command, path, "", folder / command))
    return folder / command


@pytest.mark.usefixtures("without_pictures")
@pytest.mark.filterwarnings("ignore::jaxpound.PlausibilityWarning")
def test_a_building_collapses_at_the_ductility_of_collapse(tmp_path):
    (tmp_path / "records").mkdir()
    (tmp_path / "records" / "a.AT2").write_text(at2(SUITE[0].samples, SUITE[0].dt))
    ladder = '[suite]\nfolder = "records"\n[ida]\nintensities = [0.1, 0.4]\n'
    text = f"{PAIR}{NOISE}[study]\nsamples = 64\n"  # a study is of gaps
    study = jp.Study.open(folder_of_run(tmp_path, "montecarlo", text))
    answers = []
    for demand, threshold in (("ductility", COLLAPSE), ("collapsed", 1)):
        limit = f'demand = "{demand}"\nthreshold = {threshold}\n'
        text = f"{ALONE}{NOISE}[limit]\n{limit}"
        probability = summary(folder_of_run(tmp_path, "rare", text))["probability"]
        capacities = summary(folder_of_run(tmp_path, "ida", ALONE + ladder + limit))["capacities"]
        median = study.fragility("pga", demand=demand, threshold=threshold).median
        answers.append([probability, median, capacities["a"]])
    assert answers[0] == pytest.approx(answers[1], rel=0.01)  # of capacities, which are bisected


@pytest.mark.usefixtures("without_pictures", "without_elasticities")
def test_a_design_may_choose_the_strength(tmp_path):
    search = "[search]\nearthquakes = 2\nfresh = 2\nstarts = 1\niterations = 2\n[limits]\n"
    goal = 'residual_drift = 1.0\n[objective]\ngoal = "least demand"\ndemand = "ductility"\n'
    variables = f"[variables]\n{STRENGTH} = {{low = 0.5, high = 2.0}}\n"
    out = folder_of_run(tmp_path, "design", f"{ALONE}{NOISE}{search}{goal}{variables}")
    assert summary(out)["answer"][0]["quantity"] == "building 1, storey 1, yield displacement"
    designed = layout_of((out / "buildings.toml").read_text()).shear_buildings[0].storeys[0]
    assert float(designed.hysteresis.yield_displacement) == pytest.approx(0.024)  # its bound
