"""What is plausible, and that every number which a configuration may hold is held to it."""

import dataclasses

import numpy as np
import pytest

import jaxpound as jp
from jaxpound import config, design_config, objectives, study_config
from jaxpound.quantities import DEMANDS, DIMENSIONLESS, RANGES, SI, Range, in_words, unit_of


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
