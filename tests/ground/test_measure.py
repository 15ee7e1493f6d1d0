"""Measures of intensity by their names, as programs for hazard and people write them."""

import pytest

from jaxpound.ground.measure import Measure, measure_unit, units_like


@pytest.mark.parametrize(
    ("text", "words", "unit", "name", "period"),
    [
        ("PGA (g)", "PGA", "g", "PGA", None),
        ("peak ground acceleration (m/s2)", "peak ground acceleration", "m/s²", "PGA", None),
        ("PGA, rock [cm/s^2]", "PGA, rock", "cm/s²", "PGA", None),
        ("PGV (g/ω1)", "PGV", "g/ω1", "PGV", None),
        ("PGV (cm/s)", "PGV", "cm/s", "PGV", None),
        ("SA(0.2)", "SA(0.2)", "", "Sa", (0.2, "s")),
        ("Sa(0.9 s) (g)", "Sa(0.9 s)", "g", "Sa", (0.9, "s")),
        ("Sa(0.9 1/ω1) (g)", "Sa(0.9 1/ω1)", "g", "Sa", (0.9, "1/ω1")),
        ("spectral acceleration at .5 s", "spectral acceleration at .5 s", "", "Sa", (0.5, "s")),
        ("Sa(T1 = 0.7 s) (gal)", "Sa(T1 = 0.7 s)", "gal", "Sa", (0.7, "s")),
        ("Sa(900 ms) (g)", "Sa(900 ms)", "g", "Sa", (0.9, "s")),
        ("Sa(T1) at 5 % (g)", "Sa(T1) at 5 %", "g", "Sa", None),
        ("Sa(15 %, 0.9 s) (g)", "Sa(15 %, 0.9 s)", "g", "Sa", (0.9, "s")),
        ("spectral_acceleration_1", "spectral_acceleration_1", "", "Sa", None),
        ("AvgSA (g)", "AvgSA", "g", "AvgSA", None),
        ("im", "im", "", "", None),
        ("sauce (kg)", "sauce (kg)", "", "", None),
    ],
)
def test_what_a_text_tells(text, words, unit, name, period):
    told = Measure.of_text(text)
    assert (told.words, told.unit, told.name, told.period) == (words, unit, name, period)


@pytest.mark.parametrize(
    ("one", "other", "alike"),
    [
        ("PGA (g)", "peak ground acceleration (m/s²)", True),
        ("PGA (g)", "PGV (g)", False),
        ("PGA (g)", "Sa(0.9 s) (g)", False),
        ("SA(0.9)", "Sa(0.9 s) (g)", True),
        ("SA(0.87)", "Sa(0.9 s) (g)", False),
        ("SA(0.9)", "Sa(0.9 1/ω1) (g)", False),
        ("Sa (g)", "Sa(0.9 s) (g)", True),
        ("Sa(0.9 s, 2 %)", "Sa(0.9 s) (g)", False),
        ("im", "PGA (g)", True),
        ("shaking of the year", "PGA (g)", True),
    ],
)
def test_which_may_be_one(one, other, alike):
    assert Measure.of_text(one).may_be(Measure.of_text(other)) is alike
    assert Measure.of_text(other).may_be(Measure.of_text(one)) is alike


def test_units_of_two_spellings_are_one():
    gal, *others = (Measure.of_text(f"PGA{x}") for x in (" (gal)", " (cm/s2)", " (g)", ""))
    assert [gal.is_in_unit_of(other) for other in others] == [True, False, False]
    assert measure_unit("inches") == "" == measure_unit("g/10")
    assert set(units_like("cm/s")) == {"m/s", "cm/s"}
    spectral = Measure.spectral_acceleration(0.87, "s")
    assert Measure.of_text(str(spectral)) == spectral
