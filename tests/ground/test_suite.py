"""Suites: files of a folder, spectra of records of different lengths and steps."""

from functools import partial

import jax
import numpy as np
import pytest

import jaxpound as jp
from tests.refusals import refused


def burst(frequency, n=400, dt=0.02, size=0.2):
    t = dt * np.arange(n)
    return size * np.sin(frequency * t) * np.exp(-(((t - 3) / 1.5) ** 2))


DRIFT = 0.02 * np.cos(np.linspace(0, np.pi, 350))  # without a mean
SLOW, FAST = (
    jp.Record(burst(4.0), 0.02, "slow"),
    jp.Record(burst(15.0, n=350) + DRIFT, 0.02, "fast"),
)
SUITE = jp.RecordSuite([SLOW, jp.Record(burst(7.0, n=900, dt=0.01), 0.01, "medium"), FAST])


def at2(values, dt):
    rows = [" ".join(f"{x: .7E}" for x in values[i : i + 5]) for i in range(0, len(values), 5)]
    head = ["PEER STRONG MOTION DATABASE RECORD", "MADE UP", "ACCELERATION IN UNITS OF G"]
    return "\n".join([*head, f"NPTS=  {len(values)}, DT= {dt:.5f} SEC", *rows, ""])


def test_a_folder_is_read_in_the_order_of_names(tmp_path):
    for record in SUITE:
        (tmp_path / f"{record.name}.AT2").write_text(at2(record.samples, record.dt))
    (tmp_path / "README.md").write_text("not a record")
    (tmp_path / "older.at2").mkdir()
    found = jp.read_suite(tmp_path)
    assert found.names == ("fast", "medium", "slow")
    for record in found:
        np.testing.assert_allclose(record.samples, SUITE[record.name].samples, atol=1e-8)
        assert record.dt == SUITE[record.name].dt
    assert jp.read_suite(tmp_path, "*o*.at2").names == ("slow",)
    (tmp_path / "pulse.csv").write_text("1.0\n2.0\n0.5\n")
    (pulse,) = jp.read_suite(tmp_path, "*.csv", dt=0.1, units="m/s2")
    np.testing.assert_allclose(pulse.samples * jp.STANDARD_GRAVITY, [1.0, 2.0, 0.5])
    np.testing.assert_allclose(SUITE.scaled([2.0, 1.0, 0.5]).pgas, SUITE.pgas * [2.0, 1.0, 0.5])
    np.testing.assert_allclose(SUITE.scaled(3.0).spectra([0.5]), 3 * SUITE.spectra([0.5]))
    refused(r"damping of shape \(2,\) must be one numb", SUITE.spectra, [0.5], damping=[0.02, 0.05])
    refused(r"factors of shape \(2,\) must be \(3,\)", SUITE.scaled, [1.0, 2.0])


def test_errors_name_the_file(tmp_path):
    read, good = jp.read_suite, at2([0.1, 0.2, 0.1], 0.02)
    refused(r"folder = .*none' must be a folder", read, tmp_path / "none")
    refused(r"must fit a file in .*: it is empty", read, tmp_path)
    (tmp_path / "good.AT2").write_text(good)
    (tmp_path / "short.AT2").write_text(good.replace("NPTS=  3", "NPTS=  4"))
    refused(r"read_suite: .*short\.AT2", read, tmp_path)
    refused(r"pattern = '\*\.csv' must fit .*: it has \*\.AT2$", read, tmp_path, "*.csv")
    (tmp_path / "good.txt").write_text(good)
    refused("name = 'good' must be that of one record only", read, tmp_path, "good*")


def test_a_suite_is_of_records_that_go_together():
    one = jp.Record([0.1, 0.2], 0.1)
    suite = jp.RecordSuite((one, one))
    assert suite.names == ("record 1", "record 2")
    assert suite["record 2"] is suite[1]
    assert suite.chosen(["record 2"]).names == suite.chosen(np.array([-1])).names == ("record 2",)
    assert "record 2" in repr(suite)
    for records, words in (
        ((), "must hold at least one record"),
        ((one, 3), r"records\[1\] = 3 must be of type Record"),
        ((one, jp.Record([0.0, 0.0], 0.1, "still")), "'still'.* must move"),
        ((one, jp.Record([0.1, 0.2], 0.1, "a", "1/ω1")), "'a'.* must be in the same unit of time"),
        ((jp.Record([0.1, 0.2], 0.1, "record 2"), one), "name = 'record 2' must be that of one"),
    ):
        refused(words, jp.RecordSuite, records)
    refused("name = 'x' must be one of record 1, record 2", suite.__getitem__, "x")
    for which, words in (
        ([2], "chosen: 2 must be a record's number, from 0 to 1, or its name"),
        ([0.5], "chosen: 0.5 must be"),
        (["x"], "name = 'x' must be one of"),
        ([], "must hold at least one record"),
    ):
        refused(words, suite.chosen, which)


def test_spectra_are_those_of_each_record_alone():
    alone = jax.jit(partial(jp.spectral_acceleration, damping=0.02))
    for periods in ((0.1, 0.7, 2.5), (0.03, 0.2)):
        for record, row in zip(SUITE, SUITE.spectra(periods, damping=0.02), strict=True):
            expected = [float(alone(record, period=period)) for period in periods]
            assert row == pytest.approx(expected, rel=1e-9)
