"""What to cite for a run follows from its objects, and from the bibliography alone."""

from dataclasses import replace

import pytest

import jaxpound as jp
from tests.refusals import refused
from tests.study.test_run import LINEAR, study

BLOCK = jp.Building.from_period(500e3, 0.9, 0.05, order=None)
SAMPLES = [0.0, 0.1, 0.0]


def authors(structures, ground=SAMPLES, scheme=jp.PAPER_SCHEME):
    ground = jp.Record(SAMPLES, 0.02, "RSN953_made_up") if ground is SAMPLES else ground
    lines = jp.study.citation(structures, ground, scheme).splitlines()
    return [line.partition(":")[0].partition(" (")[0] for line in lines]


def pair(contact=None, **link):
    return jp.Buildings((BLOCK,) * 2, (jp.FloorLink(0, 0, gap=0.1, contact=contact, **link),))


ALWAYS = ["The jaxpound developers", "Žigić, M. and Grahovac, N."]
RECORD = ["Records", "Records of PEER"]

HUNT = "Hunt, K. H. and Crossley, F. R. E."
YE = "Ye, K., Li, L. and Zhu, H."
FLORES = "Flores, P., Machado, M., Silva, M. T. and Martins, J. M."
JANKOWSKI = "Jankowski, R."
LAWS = {
    "none": (None, []),
    "Newton": (jp.Newton(0.6), []),
    "Kelvin–Voigt": (jp.KelvinVoigt(1e8, 0.6), ["Anagnostopoulos, S. A."]),
    "Hertz": (jp.Hertz(1e9), ["Hertz, H."]),
    "damped": (jp.HertzDamped(1e9, 0.6), [HUNT]),
    "Ye": (jp.HertzDamped(1e9, 0.6, damping="ye"), [HUNT, YE, FLORES]),
    "Jankowski": (jp.Jankowski(1e9, 0.6), [JANKOWSKI, JANKOWSKI]),
}


@pytest.mark.parametrize(("law", "expected"), LAWS.values(), ids=LAWS)
def test_each_law_of_contact_brings_its_sources(law, expected):
    assert authors(pair(law)) == [*ALWAYS, *expected, *RECORD]


def test_dampers_soil_grounds_and_schemes_bring_theirs():
    soil = jp.Soil(shear_wave_velocity=200.0, density=1800.0, poisson_ratio=0.3)
    storeys = jp.ShearBuilding.of_storeys([1e5] * 3, [1e8] * 3, damping=jp.Rayleigh(0.05))
    standing = jp.on_soil(storeys, soil, radius=8.0, footing_mass=2e5, footing_inertia=2e6)
    named = authors(jp.Buildings((standing,), ()))
    assert {"Hall, J. F.", "Wolf, J. P.", "Pais, A. and Kausel, E."} <= {*named}
    fractional = jp.Buildings((jp.Building.from_period(500e3, 0.9, 0.05),), ())
    for structures in (jp.paper.structures(), fractional):
        assert "Zener, C." in authors(structures, jp.paper.ground())
        assert "Moore, B. C." in authors(structures, scheme=jp.Scheme())
    assert {"Zener, C.", "Moore, B. C."}.isdisjoint(authors(pair(), scheme=jp.Scheme()))
    assert authors(pair(), jp.paper.ground())[-1] == "Ricker, N."
    extrapolated = jp.Scheme(jp.Smoothed(0.1), extrapolated=True)
    named = authors(pair(), jp.paper.ground(), extrapolated)
    assert {"Alexander, R.", "Richardson, L. F."} <= {*named}
    named = authors(pair(), jp.paper.ground(), replace(extrapolated, extrapolated=False))
    assert "Alexander, R." in named
    assert "Richardson, L. F." not in named


def test_records_are_listed_by_name_and_lines_are_plain_text():
    records = [jp.Record(SAMPLES, 0.02, name) for name in ("RSN953_b", "Hertz", "RSN6_a")]
    lines = jp.study.citation(pair(), jp.RecordSuite(records)).splitlines()
    assert lines[0] == f"The jaxpound developers: jaxpound, version {jp.__version__}."
    assert lines[-2:] == ["Records: RSN953_b, Hertz, RSN6_a.", "Records of PEER: RSN 953, 6."]
    assert not any(mark in line for line in lines for mark in ("`", "*", "{py", "]("))
    assert not any(line.startswith("Hertz") for line in lines)


def test_a_study_is_cited_by_what_it_holds_and_the_version_that_ran():
    of_study = study(LINEAR, 8)
    identity = of_study.about["identity"]
    identity["versions"]["jaxpound"] = "0.1.9"
    first, *others = of_study.citation().splitlines()
    assert first == "The jaxpound developers: jaxpound, version 0.1.9."
    assert [line.partition(",")[0] for line in others][:2] == ["Žigić", "Zener"]


def test_what_is_no_part_of_a_run_is_refused():
    refused("structures = 3 must be", jp.study.citation, 3, jp.paper.ground())
    refused("ground = 3 must have", jp.study.citation, pair(), 3)
    refused("scheme = 3 must be", jp.study.citation, pair(), jp.paper.ground(), 3)
