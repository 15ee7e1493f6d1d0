"""The scalars of contact in tables, in SI units, and read back from columns."""

import dataclasses

import numpy as np
import pytest

import jaxpound as jp
from jaxpound.results.impacts import ImpactSeries
from tests.made import OF_CONTACT, changed, pair_demand, pair_response

SCALES = jp.Scales(mass=500e3, frequency=7.0)
NEVER = np.array([0.5, np.inf, np.inf])
BATCH = changed(pair_demand(np.arange(3.0), contact=True), first_impact_time=NEVER)


def test_scalars_impacts_and_series_of_contact_have_flat_names_and_si_units():
    """Units of the scalars: tests/test_quantities.py."""
    found, without = pair_demand(2.0, contact=True), pair_demand(2.0)
    for name in OF_CONTACT:
        assert getattr(found, name) == getattr(found.links[0], name) == found.scalars()[name]
        assert getattr(without, name) is None
        assert name not in without.scalars()
    in_si = SCALES.to_si(pair_demand(2.0, contact=True))
    # An impulse changes a velocity by itself over the mass.
    velocity = in_si.peak_impulse / SCALES.mass
    assert velocity == pytest.approx(2.0 * SCALES.units["velocity"])
    response, made = pair_response(np.arange(3.0), {}), np.array([0.5, 1.5, np.nan])
    series = ImpactSeries(**{f.name: made for f in dataclasses.fields(ImpactSeries)})
    of_contact = dict.fromkeys(("contact", "contact_stored", "contact_lost"), np.ones(3))
    link = dataclasses.replace(response.links[0], impacts=series, **of_contact)
    in_si = SCALES.to_si(dataclasses.replace(response, links=(link,)))
    first, second = in_si.impacts()
    units = SCALES.units
    assert first.time == pytest.approx(0.5 * units["time"])
    assert second.impulse == pytest.approx(1.5 * units["impulse"])
    assert second.peak_force == pytest.approx(1.5 * units["force"])
    assert second.rebound_velocity == pytest.approx(1.5 * units["velocity"])
    assert in_si.links[0].contact_lost == pytest.approx(units["energy"])
    assert in_si.to_columns()["contact_N"] == pytest.approx(units["force"])


def test_columns_of_contact_are_those_of_links_with_a_law():
    for name, x in BATCH.scalars().items():
        np.testing.assert_array_equal(getattr(BATCH, name), x, err_msg=name)
    (with_law,), (without,) = BATCH.links, pair_demand(np.ones(3)).links
    scalars = dataclasses.replace(BATCH, links=(without, with_law)).scalars()
    assert "peak_contact_1" not in scalars
    assert without.peak_contact is None
    np.testing.assert_array_equal(scalars["first_impact_time_2"], NEVER)
    np.testing.assert_array_equal(scalars["peak_contact_2"], with_law.peak_contact)


def test_contacts_of_several_links_together():
    (link,), (without,) = BATCH.links, pair_demand(np.ones(3)).links
    of_other = {x: 3 - getattr(link, x) for x in OF_CONTACT if x != "first_impact_time"}
    other = dataclasses.replace(link, **of_other)
    both = dataclasses.replace(BATCH, links=(link, without, other))
    for name in ("peak_contact", "peak_impulse", "peak_penetration"):
        np.testing.assert_array_equal(getattr(both, name), [3.0, 2.0, 2.0])
    for name in ("n_impacts", "contact_work"):
        np.testing.assert_array_equal(getattr(both, name), 3.0)
    later = dataclasses.replace(other, first_impact_time=np.array([0.25, 2.0, np.inf]))
    both = dataclasses.replace(BATCH, links=(link, later))
    np.testing.assert_array_equal(both.first_impact_time, [0.25, 2.0, np.inf])
    nowhere = dataclasses.replace(BATCH, links=(without, without))
    with pytest.raises(AttributeError, match=r"links\[i\].n_impacts has it of each of its 2 links"):
        _ = nowhere.n_impacts


def test_a_table_and_a_run_tell_of_impacts(tmp_path):
    shown = repr(SCALES.to_si(BATCH))
    (line,) = (x for x in shown.splitlines() if "first_impact_time" in x)
    assert line.split()[:5] == ["first_impact_time", "0.071429", "inf", "inf", "s"]
    assert line.endswith("  time of the first impact")
    np.testing.assert_array_equal(BATCH.to_pandas()["first_impact_time"], NEVER)
    BATCH.to_csv(tmp_path / "runs.csv")
    header = (tmp_path / "runs.csv").read_text().partition("\n")[0].split(",")
    read = np.loadtxt(tmp_path / "runs.csv", delimiter=",", skiprows=1)
    np.testing.assert_array_equal(read[:, header.index("first_impact_time")], NEVER)
    run = pair_response(np.arange(3.0), {}, demand=pair_demand(1.0, contact=True))
    assert "contact       1 impact, p ≤ 1 m1 g, impulse ≤ 1 m1 g/ω1, lost 1 m1 g²/ω1²" in repr(run)
    assert "contact" not in repr(pair_response(np.arange(3.0), {}))
