"""Units are those that ``Scales`` converts to; every demand has words."""

import numpy as np
import pytest

import jaxpound as jp
from jaxpound.quantities import DIMENSIONLESS, SI, column, unit
from jaxpound.results.named import LIMITABLE_OF_PAIR, in_words, kind_of, unit_of
from tests.made import SERIES, pair_demand, pair_response

SERIES_KINDS = {"time": "time", "slip_direction": None}
SERIES_KINDS |= dict.fromkeys(("v1", "v2", "ground_velocity"), "velocity")
SERIES_KINDS |= dict.fromkeys(("f1", "f2", "friction"), "force")
LENGTHS = ("min_gap", "soft_min_gap", "peak_x1", "peak_x2", "slip_distance", "residual_offset")
SCALAR_KINDS = {
    **dict.fromkeys((*LENGTHS, "peak_penetration"), "length"),
    **dict.fromkeys(("peak_acceleration_1", "peak_acceleration_2", "pga"), "acceleration"),
    **dict.fromkeys(("peak_f1", "peak_f2", "peak_contact", "soft_peak_contact"), "force"),
    **dict.fromkeys(("friction_work", "contact_work"), "energy"),
    **dict.fromkeys(("min_gap_time", "first_impact_time"), "time"),
    **{"pgv": "velocity", "peak_impulse": "impulse", "n_impacts": None},
}
SCALES = jp.Scales(mass=3.0, frequency=0.7, gravity=11.0)
FACTORS = {"time": SCALES.time, "length": SCALES.length, "velocity": SCALES.length / SCALES.time}
FACTORS |= {"acceleration": SCALES.gravity, "force": SCALES.force, "mass": SCALES.mass}
FACTORS |= {"energy": SCALES.force * SCALES.length, "impulse": SCALES.force * SCALES.time}
FACTORS["stiffness"] = SCALES.mass * SCALES.frequency**2
FACTORS["rigidity"] = SCALES.force * SCALES.length**2
FACTORS["damping"] = SCALES.mass * SCALES.frequency
FACTORS["hertz stiffness"] = FACTORS["stiffness"] * SCALES.frequency / SCALES.gravity**0.5
ONES = pair_demand(1.0, soft=1.0, contact=True)


def test_every_scalar_and_every_series_is_of_the_quantity_that_it_is_converted_by():
    assert FACTORS.keys() == SI.keys() == DIMENSIONLESS.keys()
    assert len(set(FACTORS.values())) == len(FACTORS)
    assert ONES.scalars().keys() - {"pounds"} == SCALAR_KINDS.keys()
    converted = SCALES.to_si(ONES).scalars()
    for name, kind in SCALAR_KINDS.items():
        assert (kind_of(name), unit_of(name, si=True)) == (kind, SI[kind] if kind else "")
        assert converted[name] == pytest.approx(FACTORS[kind] if kind else 1.0, rel=1e-14)
    response = pair_response(np.ones(3), dict.fromkeys(SERIES, np.ones(3)), demand=ONES)
    plain = response.to_columns()
    converted = SCALES.to_si(response).to_columns()
    assert len(plain) == len(converted) == 14
    for (name, values), in_si in zip(plain.items(), converted, strict=True):
        kind = "acceleration" if "acceleration" in name else SERIES_KINDS.get(name, "length")
        factor = FACTORS[kind] if kind else 1.0
        assert in_si == column(name, kind, si=True)
        np.testing.assert_allclose(converted[in_si], factor * values, err_msg=name)


def test_units_and_words_of_every_demand():
    assert [unit("velocity", si) for si in (False, True)] == ["g/ω1", "m/s"]
    assert [unit_of(name, True) for name in ("peak_f1", "pounds")] == ["N", ""]
    assert [kind_of(name) for name in ("damper_force", "initial_gap")] == ["force", "length"]
    assert column("pga", "acceleration", True) == "pga_m_per_s2"
    assert column("peak_impulse", "impulse", True) == "peak_impulse_N_s"
    assert column("pga", "acceleration", False) == column("pga", None, True) == "pga"
    for name in {*ONES.scalars(), "required_gap", *LIMITABLE_OF_PAIR} - {"pounds", "n_impacts"}:
        assert kind_of(name) in SI
        assert in_words(name)[1:2].islower()  # words, no letters
    assert unit_of("peak_f1", si=False) == "m1 g"
    assert (unit_of("own_measure", si=True), in_words("own_measure")) == ("", "own measure")
