"""Suites: files of a folder, spectra of records of different lengths and steps."""

from functools import partial

import jax
import numpy as np
import pytest

import jaxpound as jp
from jaxpound.ground.stations import pairs_of
from tests.ground.files import knet_text
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


def at2(values, dt, component="000", kind="ACCELERATION TIME SERIES IN UNITS OF G"):
    rows = [" ".join(f"{x: .7E}" for x in values[i : i + 5]) for i in range(0, len(values), 5)]
    head = ["PEER STRONG MOTION DATABASE RECORD", f"MADE UP, 1/1/1990, HERE, {component}", kind]
    return "\n".join([*head, f"NPTS=  {len(values)}, DT= {dt:.5f} SEC", *rows, ""])


def test_a_folder_is_read_in_the_order_of_names(tmp_path):
    for record in SUITE:
        (tmp_path / f"{record.name}.AT2").write_text(at2(record.samples, record.dt))
    (tmp_path / ".hidden").write_text("not a record")
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
    refused(r"factors of shape \(2,\) must be one number or \(3,\)", SUITE.scaled, [1.0, 2.0])


def test_errors_name_the_file(tmp_path):
    read, good = jp.read_suite, at2([0.1, 0.2, 0.1], 0.02)
    refused(r"folder = .*none' must be a folder", read, tmp_path / "none")
    refused(r"must fit a file in .*: it is empty", read, tmp_path)
    (tmp_path / "good.AT2").write_text(good)
    (tmp_path / "short.AT2").write_text(good.replace("NPTS=  3", "NPTS=  4"))
    refused(r"read_suite: .*short\.AT2", read, tmp_path)
    refused(r"pattern = '\*\.csv' must fit .*: it has \*\.AT2$", read, tmp_path, "*.csv")
    refused("component = True must be 'both', 'larger', 1 or 2", read, tmp_path, component=True)
    refused(r"^read_suite: units = 'oz' must be", read, tmp_path, units="oz")
    (tmp_path / "good.txt").write_text(good)
    assert read(tmp_path, "good*").names == ("good AT2", "good txt")


def motion(size, n=200):
    """A motion of a given PGA, without an offset."""
    samples = np.sin(np.arange(n) / 5) * np.exp(-(((np.arange(n) - 90) / 30) ** 2))
    samples -= samples.mean()
    return size / np.abs(samples).max() * samples


def columns(sizes, names, dt=0.02):
    rows = np.column_stack([dt * np.arange(200), *map(motion, sizes)])
    lines = [",".join(f"{x:.7f}" for x in row) for row in rows]
    return "\n".join(["Accelerations in g", ",".join(["time", *names]), *lines, ""])


def test_a_download_of_peer_is_the_suite_of_its_horizontal_components(tmp_path):
    def folder(name, texts):
        (tmp_path / name).mkdir()
        for file, text in texts.items():
            content = text if isinstance(text, bytes) else text.encode()
            (tmp_path / name / file).write_bytes(content)
        return tmp_path / name

    stem, velocity = "RSN6_IMPVALL.I_I-ELC", "VELOCITY TIME SERIES IN UNITS OF CM/S"
    horizontal = {f"{stem}{x:03d}.AT2": at2(motion(x / 1e3), 0.01) for x in (180, 270)}
    beside = {f"{stem}-UP.AT2": at2(motion(0.4), 0.01, "UP"), "RSN6_X_3.AT2": at2([1, 2], 1, "UP")}
    beside |= {f"{stem}{x}T2": at2(motion(9), 0.01, kind=velocity) for x in ("180.V", "180.D")}
    spectrum, words = "T (s),Sa (g)\n0.01,.2\n.02,.3\n.03,.4\n.05,.3\n", "Terms of use.\n"
    beside |= {"_SearchResults.csv": "Result ID, Scale Factor\n1, 2.0\n0.01, 0.2\n"}
    beside |= {"spectrum.csv": spectrum, "README.txt": words, "ida.toml": "gap = 1"}
    beside |= {"spectra.png": b"\x89PNG\r\n\x1a\n\0", "all.zip": b"PK\3\4..."}
    alone = jp.read_suite(folder("alone", horizontal))
    whole = folder("whole", horizontal | beside)
    with pytest.warns(jp.PlausibilityWarning, match="left out") as caught:
        suite = jp.read_suite(whole)
    assert suite.names == alone.names == (f"{stem}180", f"{stem}270")
    for record, other in zip(suite, alone, strict=True):
        np.testing.assert_array_equal(record.samples, other.samples)
    (message,) = (str(warning.message) for warning in caught)
    for words in ("(UP)", "picture", "zip archive", "the header says sa", "by the name no record"):
        assert words in message
    for words in ("RSN6_X_3.AT2", "spectrum.csv", "ida.toml: by the name", "header says velocity"):
        assert words in message
    refused("left out are", jp.read_suite, whole, strict=True)
    refused(r"must hold a horizontal acceleration, but has .*-UP", jp.read_suite, whole, "*UP*")
    assert suite.stations == {"RSN6_*": suite.names}
    for component, name in ((1, "180"), (2, "270"), ("larger", "270")):
        one = jp.read_suite(whole, "*0.at2", component=component)
        assert one.names == (stem + name,)
        assert one.stations == {"RSN6_*": one.names}
    (whole / "cut.AT2").write_text(horizontal[f"{stem}180.AT2"][:-40])
    with pytest.raises(ValueError, match=r"^read_suite: .*cut\.AT2"):
        jp.read_suite(whole)


def test_stations_of_mixed_formats(tmp_path):
    for axis, size in (("EW", 0.1), ("NS", 0.3)):
        for sensor in ("", "1", "2"):
            counts = np.round(motion(size) * jp.STANDARD_GRAVITY * 100 / 7845 * 8223790)
            text = knet_text(counts.astype(int), **{"Dir.": axis[0] + "-" + axis[1]})
            (tmp_path / f"AOM{sensor}.{axis}{sensor}").write_text(text)
        (tmp_path / f"four_H{1 + (axis == 'NS')}.csv").write_text(columns([size], "a"))
    (tmp_path / "three.csv").write_text(columns([0.2, 0.1, 0.4], ["N-S", "E-W", "U-D"]))
    (tmp_path / "quake_001.csv").write_text(columns([0.2], "a"))
    (tmp_path / "quake_002.csv").write_text(columns([0.1], "a"))
    with pytest.warns(jp.PlausibilityWarning, match=r"left out are three\.csv: components U-D"):
        suite = jp.read_suite(tmp_path)
    assert suite.stations == {
        "AOM.*": ("AOM EW", "AOM NS"),
        "AOM1.*1": ("AOM1 EW1", "AOM1 NS1"),
        "AOM2.*2": ("AOM2 EW2", "AOM2 NS2"),
        "four_*.csv": ("four_H1", "four_H2"),
        "quake_001": ("quake_001",),
        "quake_002": ("quake_002",),
        "three": ("three N-S", "three E-W"),
    }
    larger = ("AOM NS", "AOM1 NS1", "AOM2 NS2", "four_H2", "quake_001", "quake_002", "three N-S")
    with pytest.warns(jp.PlausibilityWarning, match="U-D"):
        assert jp.read_suite(tmp_path, component="larger").names == larger
    says = "component = 2 must be there .*: 'quake_001' has"
    with pytest.warns(jp.PlausibilityWarning, match="U-D"):
        refused(says, jp.read_suite, tmp_path, component=2)
    left = suite.chosen(["three E-W", "AOM NS"])
    assert left.stations == {"AOM.*": ("AOM NS",), "three": ("three E-W",)}
    assert suite.scaled(2.0).stations == suite.stations
    (tmp_path / "array.csv").write_text(columns([0.2, 0.1, 0.4], "abc"))
    with pytest.warns(jp.PlausibilityWarning, match=r"array\.csv: none of its 3 components"):
        assert jp.read_suite(tmp_path, "arr*").stations == {
            f"array {x}": (f"array {x}",) for x in "abc"
        }


@pytest.mark.parametrize(
    ("files", "stations"),
    [
        ("H-E06140.AT2 H-E06230.AT2", "H-E06*.AT2"),
        ("A-ELC000.AT2 A-ELC090.AT2", "A-ELC*.AT2"),
        ("C02090.AT2 C02360.AT2", "C02*.AT2"),
        ("E06FN.txt E06FP.txt", "E06*.txt"),
        ("RSN8119_X_PRPCS.AT2 RSN8119_X_PRPCW.AT2", "RSN8119_*"),
        ("IV.AMT..HNE.D.1.ACC.MP.ASC IV.AMT..HNN.D.1.ACC.MP.ASC", "IV.AMT..HN*.D.1.ACC.MP.ASC"),
        ("2023_4614_E.asc 2023_4614_N.asc", "2023_4614_*.asc"),
        ("XX_EXA_00_HNE XX_EXA_00_HNN", "XX_EXA_00_HN*"),
        ("CE.583..HNE.--.V2c CE.583..HNN.--.V2c", "CE.583..HN*.--.V2c"),
        ("55461EW.AT2 55461NS.AT2", "55461*.AT2"),
        ("a_N00E.dat a_N90E.dat", "a_*.dat"),
        ("GDLCN55W.AT2 GDLCS35W.AT2", "GDLC*.AT2"),
        ("b-L.txt b-T.txt", "b-*.txt"),
        ("x_E-W.csv x_N-S.csv", "x_*.csv"),
        ("ELC180-hor1.txt ELC270-hor2.txt", "ELC*.txt"),
        ("a000.txt a090.txt a180.txt", ""),
        ("RSN1_A_1.AT2 RSN1_A_2.AT2 RSN1_A_3.AT2", ""),
        ("a010.txt a030.txt", ""),
        ("a_N.txt a_N.csv", ""),
        ("a_N.txt b_E.txt", ""),
        ("quake.txt quake2.txt", ""),
        ("IV.AMT..HNE.D.1.ASC IV.AMT..HNN.D.2.ASC", ""),
    ],
)
def test_two_files_are_a_station_by_their_names(files, stations):
    names = files.split()
    assert pairs_of(names) == (dict.fromkeys(names, stations) if stations else {})


def test_stations_of_a_suite_by_hand():
    one = jp.Record([0.1, 0.2], 0.1)
    assert jp.RecordSuite([one, one]).stations == {f"record {i}": (f"record {i}",) for i in (1, 2)}
    suite = jp.RecordSuite([one, one], {"here": ["record 1", "record 2"]})
    assert suite.stations == {"here": ("record 1", "record 2")}
    refused("stations = .* must have each of the records once", jp.RecordSuite, [one], {"x": ["a"]})


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
