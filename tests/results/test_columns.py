"""Results as columns, data frames and files: the names say the units, the numbers stay the same."""

import csv
import dataclasses
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from jaxpound.results.elements import without_idle_dampers
from tests.pickled import assert_survives_pickling
from tests.refusals import refused
from tests.study.test_run import LINEAR, study

SCALES = jp.Scales(mass=500e3, frequency=7.0)


def test_a_run_is_a_row_an_instant_in_a_folder_that_is_there(batch, tmp_path):
    run = batch[1]
    columns, si = run.to_columns(), SCALES.to_si(run).to_columns()
    assert [*columns][:4] == ["time", "ground_acceleration", "x1", "x2"]
    first = "time_s ground_acceleration_m_per_s2 x1_m x2_m v1_m_per_s v2_m_per_s"
    assert " ".join([*si][:6]) == first
    assert [*si][-4:] == ["friction_N", "gap_m", "ground_velocity_m_per_s", "slip_direction"]
    np.testing.assert_array_equal(columns["v2"], run.v2)
    np.testing.assert_array_equal(columns["absolute_acceleration_2"], run.absolute_accelerations[1])
    np.testing.assert_allclose(si["gap_m"], run.gap * SCALES.length)
    np.testing.assert_array_equal(si["slip_direction"], run.phase)
    assert not np.signbit(si["slip_direction"][si["slip_direction"] == 0]).any()
    file = tmp_path / "no" / "run.csv"
    for write in (batch.to_csv, batch.to_parquet, jp.read_record):
        with pytest.raises(FileNotFoundError, match=f"{file}: the folder {file.parent} is missing"):
            write(file)


def test_runs_and_batches_survive_pickling(batch):
    assert_survives_pickling((batch, batch[1], batch[1].demand, batch[1].energy, SCALES))


def test_a_batch_of_runs_has_their_numbers_and_a_batch_of_batches_one_an_axis(batch):
    table = batch.to_pandas()
    assert (table.index.names, len(table)) == (["run", "time"], 3 * 41)
    for i in range(3):
        one = batch[i].to_pandas()
        assert one.index.name == "time"
        np.testing.assert_array_equal(table.loc[i], one)
    demands = batch.demand.to_pandas()
    assert (demands.index.name, list(demands.index)) == ("run", [0, 1, 2])
    np.testing.assert_array_equal(demands["peak_f1"], batch.demand.peak_f1)
    one = SCALES.to_si(batch[2].demand).to_pandas()
    assert one.shape == (1, len(batch.demand.scalars()))
    assert one["peak_f1_N"][0] == pytest.approx(float(batch.demand.peak_f1[2]) * SCALES.force)
    twice = jax.tree.map(lambda x: jnp.stack([x, 2 * x]), batch)
    table = twice.to_pandas()
    assert table.index.names == ["run_0", "run_1", "time"]
    np.testing.assert_array_equal(table.loc[1, 2]["x1"], 2 * batch.x1[2])
    demands = twice.demand.to_pandas()
    assert demands.index.names == ["run_0", "run_1"]
    assert demands.loc[(1, 2), "peak_x1"] == 2 * float(batch.demand.peak_x1[2])


RESULTS = {
    "response": lambda runs, _: runs[1],
    "response of a batch": lambda runs, _: runs,
    "demand": lambda runs, _: runs[1].demand,
    "batch": lambda runs, _: runs.demand,
    "study": lambda _, of_study: dataclasses.replace(of_study, scales=SCALES),
}


@pytest.mark.parametrize("result_of", RESULTS.values(), ids=RESULTS)
def test_files_hold_the_same_numbers(batch, of_study, result_of, tmp_path, monkeypatch):
    pandas = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    result = result_of(SCALES.to_si(batch), of_study)
    table = result.to_pandas()
    result.to_parquet(tmp_path / "table.parquet")
    pandas.testing.assert_frame_equal(pandas.read_parquet(tmp_path / "table.parquet"), table)
    monkeypatch.setitem(sys.modules, "pandas", None)  # text needs NumPy only
    result.to_csv(tmp_path / "table.csv")
    read = np.genfromtxt(tmp_path / "table.csv", delimiter=",", names=True, ndmin=1)
    assert read.dtype.names == (*table.index.names, *table.columns)
    for name in table.columns:
        np.testing.assert_array_equal(read[name], table[name])
    for name in table.index.names:
        np.testing.assert_array_equal(read[name], table.index.get_level_values(name))


@pytest.fixture(scope="module")
def of_study():
    measures = {"mu": lambda structures, ground: structures.friction}
    return study(LINEAR, 64, measures=measures, keep_parameters=True)


def test_a_study_is_a_row_a_sample(of_study):
    in_si = dataclasses.replace(of_study, scales=SCALES)
    table = in_si.to_pandas()
    assert table.index.name == "sample"
    units = dict(zip(in_si.columns, table.columns, strict=True))
    assert (units["min_gap"], units["pga"]) == ("min_gap_m", "pga_m_per_s2")
    assert units["required_gap"] == "required_gap_m"
    # Pure numbers, and what is not ours, are what they are.
    assert all(units[name] == name for name in ("pounds", "mu", *in_si.parameters()))
    for name, heading in units.items():
        np.testing.assert_array_equal(table[heading], in_si[name])


def test_a_study_is_a_dataset_along_its_samples(of_study):
    pytest.importorskip("xarray")
    in_si = dataclasses.replace(of_study, scales=SCALES)
    data = in_si.to_xarray()
    assert (dict(data.sizes), {*data.data_vars}) == ({"sample": 64}, {*in_si.columns})
    np.testing.assert_array_equal(data.min_gap, in_si["min_gap"])
    assert data.min_gap.attrs == {"units": "m", "long_name": "smallest gap"}
    assert data.mu.attrs == {"units": "1", "long_name": "mu"}


def test_names_that_users_gave_stay_apart(of_study, tmp_path):
    for name, scales in (("μ, the friction", None), ("sample", None), ("min_gap_m", SCALES)):
        moments = {name if x == "mu" else x: m for x, m in of_study._moments.items()}
        parts = lambda x, name=name: of_study._parts("mu" if x == name else x)  # noqa: E731
        renamed = dataclasses.replace(of_study, _moments=moments, _parts=parts, scales=scales)
        if name.startswith("μ"):
            renamed.to_csv(tmp_path / "study.csv")
            with open(tmp_path / "study.csv", encoding="utf-8", newline="") as file:
                assert next(csv.reader(file)) == ["sample", *renamed.columns]
        else:
            refused(f"column '{name}' must differ from every other", renamed.to_columns)


def test_links_without_friction_do_not_tell_of_slip():
    largest = {"slip_distance_1": 0.2, "friction_work_1": 0.0}  # moves, and takes no energy
    largest |= {"slip_distance_2": 0.2, "friction_work_2": 0.1}
    largest |= {"slip_distance_3": 0.0, "friction_work_3": 0.0}  # sticks throughout
    names = [*largest, "damper_force_1", "damper_force_2", "residual_offset_1", "min_gap_1"]
    left_out = {"slip_distance_1", "friction_work_1", "damper_force_1"}
    kept = without_idle_dampers(names, largest.__getitem__)
    assert kept == [name for name in names if name not in left_out]
    alone = {"slip_distance": 0.2, "friction_work": 0.0}
    assert without_idle_dampers([*alone, "pga"], alone.__getitem__) == ["pga"]
