"""Units are those that ``Scales`` converts to; every number of a configuration has a range."""

import dataclasses

import numpy as np
import pytest

import jaxpound as jp
from jaxpound.cli import config, design_config, study_config
from jaxpound.design import objective as objectives
from jaxpound.quantities import (
    DEMANDS,
    DIMENSIONLESS,
    RANGES,
    SI,
    Range,
    column,
    in_words,
    kind_of,
    unit,
    unit_of,
)
from jaxpound.results.response import SERIES

SCALES = jp.Scales(mass=3.0, frequency=0.7, gravity=11.0)
FACTORS = {
    "time": SCALES.time,
    "length": SCALES.length,
    "velocity": SCALES.length / SCALES.time,
    "acceleration": SCALES.gravity,
    "force": SCALES.force,
    "energy": SCALES.force * SCALES.length,
}
ONES = jp.Demand(*np.ones(14))


def test_every_scalar_is_of_the_quantity_that_it_is_converted_by():
    assert FACTORS.keys() == SI.keys() == DIMENSIONLESS.keys()
    assert len(set(FACTORS.values())) == len(FACTORS)
    converted = SCALES.to_si(ONES)
    for field in dataclasses.fields(ONES):
        if field.name != "si":
            assert getattr(converted, field.name) == pytest.approx(FACTORS[kind_of(field.name)])


def test_every_series_is_of_the_quantity_that_it_is_converted_by():
    one, names = np.ones(3), {field.name for field in dataclasses.fields(jp.Response)}
    numbers = dict.fromkeys(names - {"demand", "method", "si", "mass_1", "mass_2"}, one)
    response = jp.Response(**numbers, mass_1=1.0, mass_2=1.0, demand=ONES)
    plain = response.to_columns()
    converted = SCALES.to_si(response).to_columns()
    assert [*plain] == [*SERIES]
    for (name, quantity), values in zip(SERIES.items(), converted.values(), strict=True):
        factor = FACTORS[quantity] if quantity else 1.0
        np.testing.assert_allclose(values, factor * plain[name], err_msg=name)


def test_units_in_words_and_in_names():
    assert [unit("velocity", si) for si in (False, True)] == ["g/ω1", "m/s"]
    assert [unit_of(name, True) for name in ("peak_f1", "pounds")] == ["N", ""]
    assert column("pga", "acceleration", True) == "pga_m_per_s2"
    assert column("pga", "acceleration", False) == column("pga", None, True) == "pga"


@pytest.mark.parametrize("name", RANGES)
def test_a_range_is_one_and_says_why(name):
    allowed = RANGES[name]
    assert allowed.low < allowed.high < np.inf
    assert allowed.low in allowed
    assert allowed.high in allowed
    assert np.nextafter(allowed.low, -np.inf) not in allowed
    assert np.nan not in allowed
    assert "1" not in allowed
    assert allowed.why
    assert allowed.unit in allowed.rule


@pytest.mark.parametrize("module", [config, study_config, design_config])
def test_every_number_of_a_configuration_has_a_range(module):
    for table, keys in module._KEYS.items():
        for key, kind in keys.items():
            assert isinstance(kind, Range | tuple) or callable(kind), (table, key)


def test_every_demand_has_a_unit_and_words():
    demands = {field.name for field in dataclasses.fields(jp.Demand)} - {"si"}
    assert demands | {"required_gap", *objectives.PRICES} <= {*DEMANDS}
    assert {*SI} == {*DIMENSIONLESS} == {kind for kind, _ in DEMANDS.values()}
    assert (unit_of("peak_f1", si=True), unit_of("peak_f1", si=False)) == ("N", "m1 g")
    assert (unit_of("own_measure", si=True), in_words("own_measure")) == ("", "own measure")
