"""Results as datasets of xarray: labelled, with units, and in NetCDF files."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from tests.refusals import refused

xarray = pytest.importorskip("xarray")

SCALES = jp.Scales(mass=500e3, frequency=7.0)


def test_a_dataset_has_the_series_by_element_with_units_and_survives_a_file(batch, tmp_path):
    run = SCALES.to_si(batch)[1]
    run.to_xarray().to_netcdf(tmp_path / "run.nc")
    with xarray.open_dataset(tmp_path / "run.nc") as data:
        assert data["x"].dims == ("masses", "time")
        assert [*data.masses.values] == ["building 1", "building 2"]
        np.testing.assert_array_equal(data.x.sel(masses="building 2"), run.x2)
        np.testing.assert_array_equal(data.force.isel(rods=0), run.f1)
        np.testing.assert_array_equal(data.gap.isel(links=0), run.gap)
        np.testing.assert_array_equal(data.time, run.time)
        acceleration = data.absolute_acceleration[0]
        np.testing.assert_array_equal(acceleration, run.absolute_accelerations[0])
        units = {name: data[name].units for name in ("x", "time", "force", "gap", "phase")}
        assert units == {"x": "m", "time": "s", "force": "N", "gap": "m", "phase": "1"}
        assert data.attrs == {"source": f"jaxpound {jp.__version__}"}


def test_batches_have_their_runs_as_dimensions(batch):
    data = batch.to_xarray()
    assert dict(data.sizes) == {"run": 3, "time": 41, "masses": 2, "rods": 2, "links": 1}
    np.testing.assert_array_equal(data.v.sel(run=2)[1], batch[2].v2)
    twice = jax.tree.map(lambda x: jnp.stack([x, 2 * x]), batch.demand).to_xarray()
    assert twice["min_gap"].dims == ("run_0", "run_1", "links")
    assert twice["min_gap"].attrs == {"units": "g/ω1²", "long_name": "smallest gap"}
    assert twice["peak_x"].long_name == "peak displacement"
    np.testing.assert_array_equal(
        twice.peak_force[1, 2], [2 * rod.peak_force for rod in batch.demand[2].rods]
    )
    late = dataclasses.replace(batch, time=batch.time + jnp.arange(3.0)[:, None])
    refused("a batch must have the same instants in all its runs", late.to_xarray)


def test_elements_without_a_quantity_have_nan_and_a_quantity_of_none_is_left_out(batch):
    demand = batch[0].demand
    first, second = demand.masses
    some = dataclasses.replace(demand, masses=(first, dataclasses.replace(second, peak_x=None)))
    data = some.to_xarray()
    assert [*np.isnan(data.peak_x.values)] == [False, True]
    assert "peak_contact" not in data
    assert data.peak_x[0] == first.peak_x


def test_a_structure_without_links_is_written_too(tmp_path):
    alone = jp.Storeys((1.0, 1.0), (jp.Rod(jp.ZenerRod(1.0, 1.0, 1.0), 1.0),) * 2)
    demand = jp.demand(jp.Row((alone,), ()), jp.paper.ground(), jp.TimeGrid(0.05, 40))
    demand.to_xarray().to_netcdf(tmp_path / "alone.nc")
    with xarray.open_dataset(tmp_path / "alone.nc") as data:
        assert [*data.masses.values] == ["floor 1 of building 1", "floor 2 of building 1"]
        assert [*np.isnan(data.peak_drift.values)] == [True, False]
