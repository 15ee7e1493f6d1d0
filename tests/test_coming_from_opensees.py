"""The pair on the page for those who come from OpenSees: in OpenSees and here the same."""

import os
import re

import numpy as np
import pytest

from benchmarks.opensees_library import load_blas
from tests.test_docs import DOCS, code
from tests.test_how_to import printed

PAGE = DOCS / "coming_from_opensees.md"
TEXT = PAGE.read_text(encoding="utf-8")
NUMBERS, _, _ = code(TEXT).partition("left = ")
SCRIPT = "".join(re.findall(r"^```py\n(.*?)^```", TEXT, re.M | re.S))
GAP = '"ViscoelasticGap", tag, stiffness, dashpot, -gap'
ELASTIC = '"ElasticPPGap", tag, stiffness, -1e12, -gap'
HERTZ = '"Hertzdamp", tag, 2.75e10, 0.75 * (1 - restitution**2), -gap'

# OpenSeesPy 3.7.1: displacements of the five floors, m, and forces at both floors, N, by the page's
# script at a step of 0.01 ms; by the other laws of contact at 0.02 ms.
FINEST = np.array(
    [0.05453507, 0.08535055, 0.09407320, 0.01078751, 0.01816402, 3854584.9, 6212239.7]
)
FORCES = {ELASTIC: (5.1397e6, 7.4039e6), HERTZ: (4.2441e6, 7.1275e6)}


def share(values, exact):
    """Largest differences of displacements and of forces, over their values."""
    off = np.abs(np.asarray(values) / exact - 1)
    return off[:5].max(), off[5:].max()


def impact_material(penetration, k_h=2.75e10, e=0.65, a=0.1):
    """The numbers of ImpactMaterial for an assumed penetration, by the page's equations."""
    effective = k_h * penetration**0.5
    lost = 0.4 * k_h * penetration**2.5 * (1 - e**2)
    k_1 = effective + lost / (a * penetration**2)
    return k_1, effective - lost / ((1 - a) * penetration**2), -a * penetration


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    """The page's names after its code here has run, and what it printed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("page"))
        return printed(PAGE)


def test_the_page_prints_what_it_says(here):
    _, lines, said = here
    assert lines == said


def test_the_run_here_is_that_of_opensees(here):
    names, _, _ = here
    demand = names["demand"]
    peaks = [mass.peak_x for mass in demand.masses]
    moved, pushed = share([*peaks, *(link.peak_contact for link in demand.links)], FINEST)
    assert moved < 6e-4
    assert pushed < 4e-4
    assert "| 2 | 4.9e-4 | 2.6e-4 |" in TEXT
    for law, exact in (("KelvinVoigt", FORCES[ELASTIC]), ("HertzDamped", FORCES[HERTZ])):
        (line,) = re.findall(rf"^print\(forces\(jp\.{law}\(.*# (.*)$", TEXT, re.M)
        forces = [float(number) for number in re.findall(r"([\d.]+) MN", line)]
        assert np.allclose(forces, np.array(exact) / 1e6, rtol=3e-3)


def test_the_numbers_of_impact_material_lead_back_to_the_law(here):
    names, _, _ = here
    for penetration in (1e-3, 4e-3, 1e-2):
        assert np.allclose(names["law_of"](*impact_material(penetration)), (2.75e10, 0.65))
    k_1, k_2, delta_y = impact_material(4e-3)
    numbers = f"{k_1 / 1e9:.3f}e9, {k_2 / 1e9:.3f}e9, {1e4 * delta_y:.0f}e-4"
    assert f"law_of({numbers})" in TEXT


@pytest.fixture(scope="module")
def opensees():
    """The page's script for OpenSees, as a function of step, law of contact and stiffness."""
    load_blas()
    ops = pytest.importorskip("openseespy.opensees", exc_type=(ImportError, RuntimeError))
    ops.logFile(os.devnull, "-noEcho")  # it would report every impact

    def run(step="1e-4", contact=GAP, stiffness="2e9"):
        source = NUMBERS + SCRIPT.replace("analysis(1e-4)", f"analysis({step})")
        assert source.count(GAP) == source.count("0.02, 2e9, 0.65") == 1
        source = source.replace(GAP, contact).replace("0.02, 2e9,", f"0.02, {stiffness},")
        names = {}
        exec(compile(source, PAGE.name, "exec"), names)
        return [*names["moved"], *names["pushed"]]

    return run


def test_the_script_of_opensees_gives_the_peaks_of_its_table(opensees):
    table, _, _ = TEXT.partition("| jaxpound | 5 |")
    for step, row in (("1e-3", "| | 1 |"), ("1e-4", "| | 0.1 |")):
        moved, pushed = share(opensees(step), FINEST)
        (line,) = (line for line in table.splitlines() if line.startswith(row))
        _, _, _, *cells, _ = line.split("|")
        assert np.allclose([moved, pushed], [float(cell) for cell in cells], rtol=0.05)


def test_other_laws_of_contact_in_opensees(opensees):
    for contact, forces in FORCES.items():
        assert np.allclose(opensees(contact=contact)[5:], forces, rtol=2e-3)
    for penetration, force in ((1e-3, "4.2"), (4e-3, "6.3"), (1e-2, "11.0")):
        numbers = ", ".join(map(repr, impact_material(penetration)))
        pushed = opensees(contact=f'"ImpactMaterial", tag, {numbers}, -gap')[5:]
        assert f"{max(pushed) / 1e6:.1f}" == force
        assert f"{force} MN" in TEXT


def test_opensees_does_not_converge_with_a_stiff_contact(opensees):
    for step in ("5e-3", "2e-3"):
        for stiffness in ("2e10", "2e11"):
            with pytest.raises(RuntimeError, match="no convergence at t = "):
                opensees(step, stiffness=stiffness)
