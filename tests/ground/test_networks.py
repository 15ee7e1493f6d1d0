"""The formats of the networks: right values, what is refused, and damage that is never misread."""

import gzip
import io
import re
import warnings
import zipfile
from itertools import product

import numpy as np
import pytest

from jaxpound._errors import PlausibilityWarning
from jaxpound.ground.formats.text import OtherKindError
from jaxpound.ground.reader import read_record
from tests.ground.files import TITLE, assert_refuses, refusals
from tests.ground.mutations import data_lines, mutations
from tests.ground.networks import DT, GAL, MS2, NETWORKS, SHEET, SHEETS, N, motion, rows_of, sheet

OPEN = {"eqsig": {"units": "g"}}  # whose unit no header states
SIDE_BY_SIDE = {"AFAD", "UNAM", "CWB"}  # components of one block
SEVERAL = [name for name, network in NETWORKS.items() if len(network.names) > 1]
WITH_VERTICAL = [name for name in SEVERAL if len(NETWORKS[name].names) == 3]
BLOCKS = ["GeoNet V2A", "CSMIP V2", "CSMIP V1", "COSMOS V2c", "SMC", "SLIST"]


def text_of(name, components=None, **options):
    network = NETWORKS[name]
    return network.text(network.printed()[:components], **options)


def assert_gives(record, samples):
    assert record.dt == DT
    np.testing.assert_allclose(record.samples, samples, rtol=1e-12, atol=0)


@pytest.mark.parametrize("name", NETWORKS)
def test_samples_interval_and_components_of_a_network(write, name):
    network, options = NETWORKS[name], OPEN.get(name, {})
    printed = network.printed()
    path = write(network.text(printed), "quake" + network.extension)
    for number, (component, numbers) in enumerate(zip(network.names, printed, strict=True), 1):
        record = read_record(path, column=number, **options)
        assert_gives(record, network.samples(numbers))
        np.testing.assert_allclose(record.samples, motion(number - 1), atol=2e-4)
        assert record.name.startswith("quake")
        if component:
            for called in (component, component.lower(), f" {component.replace('-', '')} "):
                assert_gives(read_record(path, column=called, **options), record.samples)
    if len(printed) == 1:
        assert_gives(read_record(path, **options), network.samples(printed[0]))
    assert read_record(path, column=1, dt=DT, **options).dt == DT


@pytest.mark.parametrize("name", sorted(set(SEVERAL) - SIDE_BY_SIDE))
def test_a_file_of_one_block_needs_no_column(write, name):
    network = NETWORKS[name]
    path = write(text_of(name, 1), "quake" + network.extension)
    record = read_record(path)
    assert_gives(record, network.samples(network.printed()[0]))
    assert record.name == "quake"


@pytest.mark.parametrize("name", SEVERAL)
def test_without_a_column_a_file_of_several_is_refused_with_their_names(write, name):
    network, text = NETWORKS[name], text_of(name)
    path = write(text, "quake" + network.extension)
    n = len(network.names)
    listed = ", ".join(
        rf"{k}: (CANAL-\d |E-W )?{re.escape(x)}" for k, x in enumerate(network.names, 1)
    )
    listed = rf"{n} columns or blocks \({listed}\)"
    line = 1 if "Sim" in name else 1 + data_lines(network, network.printed())[0]
    assert_refuses(path, line, rf"{listed}: choose one by its number or name, as column=1$")
    for column in (n + 1, 0, -1, "N99E", True):
        rule = "must be a number from 1, or a name, of an acceleration among"
        says = rf"column = {column!r} {rule} {listed}$"
        assert_refuses(path, line, says, column=column)


@pytest.mark.parametrize("name", WITH_VERTICAL)
def test_a_vertical_component_is_read_only_if_asked_for(write, name):
    network = NETWORKS[name]
    printed = network.printed()
    path = write(network.text(printed), "quake" + network.extension)
    assert_gives(read_record(path, vertical=True), network.samples(printed[2]))
    if name in SIDE_BY_SIDE:
        return
    path.write_text(network.write(printed[2:], DT, network.names[2:]))
    says = rf"is a vertical component \({network.names[2]}\): pass vertical=True"
    assert_refuses(path, None, says, OtherKindError)
    assert_gives(read_record(path, vertical=True), network.samples(printed[2]))
    assert_gives(read_record(path, column=network.names[2]), network.samples(printed[2]))


@pytest.mark.parametrize("direction", ["U-D", "UD", "Up", "3", "6"])
def test_verticals_of_k_net_and_kik_net_are_refused_by_their_direction(write, direction):
    network = NETWORKS["K-NET"]
    path = write(network.write(network.printed(), DT, (direction,)))
    assert_refuses(path, None, "is a vertical component", OtherKindError)
    assert read_record(path, vertical=True).n_samples == N


@pytest.mark.parametrize("names", ["N (g),E (g),Z (g)", "NS (gal),EW (gal),UD (gal)", "h1,h2,ver"])
def test_the_vertical_among_columns_is_told_by_its_name(write, names):
    rows = zip(*([f"{100 * x:.4f}" for x in motion(k)] for k in range(3)), strict=True)
    path = write(f"{names}\n" + "".join(",".join(row) + "\n" for row in rows))
    units = None if "g" in names else "gal"
    third = read_record(path, column=3, dt=DT, units=units).samples
    np.testing.assert_array_equal(
        read_record(path, vertical=True, dt=DT, units=units).samples, third
    )


@pytest.mark.parametrize("name", NETWORKS)
def test_an_interval_and_a_unit_of_the_caller_must_be_those_of_the_file(write, name):
    network, options = NETWORKS[name], OPEN.get(name, {})
    path = write(text_of(name), "quake" + network.extension)
    for dt in (0.01, 0.021, 0.04):
        with pytest.raises(
            ValueError, match=rf":\d+: dt = {dt} must agree with the file's own, 0.02"
        ):
            read_record(path, column=1, dt=dt, **options)
    if name in OPEN:
        record = read_record(path, units="cm/s2")
        np.testing.assert_allclose(record.samples, network.samples(network.printed()[0]) * GAL)
        return
    with pytest.raises(ValueError, match=r":\d+: units = 'ft/s2' must be the header's own, '"):
        read_record(path, column=1, units="ft/s2")


NO_UNIT = {
    "ESM": (text_of("ESM", unit=""), GAL, "gal"),
    "SLIST": (text_of("SLIST", 1, unit=""), MS2, "m/s2"),
    "GeoCSV": (text_of("GeoCSV").replace("# field_unit: UTC, M/S**2\n", ""), MS2, "m/s2"),
    "SimCenter": (text_of("SimCenter", 1).replace(', "units": "g"', ""), 1.0, "g"),
}


@pytest.mark.parametrize("name", NO_UNIT)
def test_a_unit_that_the_header_leaves_open_is_taken_from_the_caller(write, name):
    text, size, units = NO_UNIT[name]
    path = write(text, "quake" + NETWORKS[name].extension)
    samples = np.array([float(x) for x in NETWORKS[name].printed()[0]])
    assert_gives(read_record(path, units=units), samples * size)
    assert_gives(read_record(path, units="mg"), samples / 1000)


def without(text, begin, end):
    """A text without what stands from one mark to another."""
    return text[: text.index(begin)] + text[text.index(end) :]


COSMOS_VELOCITY = (
    text_of("COSMOS V2c")
    .replace("Corrected acceleration ", "Corrected velocity ")
    .replace("acceleration pts", "velocity pts")
    .replace("cm/sec2(04)", "cm/sec(05)")
)
VELOCITY = "VELOCITY TIME HISTORY IN UNITS OF CM/S\nNPTS= 2, DT= .1 SEC\n1 2\n"
OTHER_KINDS = {
    "ESM velocity": (text_of("ESM", data_type="VELOCITY", unit="cm/s"), "says velocity"),
    "ESM displacement": (text_of("ESM", data_type="DISPLACEMENT", unit="cm"), "displacement"),
    "V2 without acceleration": (
        without(text_of("CSMIP V2", 1), "   123 points of accel", "   123 points of veloc"),
        "must be accelerations",
    ),
    "V3": (
        "Response and Fourier amplitude spectra (86 periods)\n" + text_of("CSMIP V2", 1),
        "must be accelerations",
    ),
    "COSMOS velocity": (COSMOS_VELOCITY, "must be accelerations"),
    "SMC velocity": (text_of("SMC", kind="3 VELOCITY"), "SMC file of another quantity"),
    "SMC spectra": (text_of("SMC", kind="5 RESPONSE SPECTRA"), "SMC file of another quantity"),
    "SLIST velocity": (text_of("SLIST", 1, unit="M/S"), "'M/S' must be a unit of acc"),
    "SLIST displacement": (text_of("TSPAIR", 1, unit="M"), "'M' must be a unit of acc"),
    "event of velocities": (
        text_of("SimCenter event").replace("UniformAcceleration", "UniformVelocity"),
        "its type is UniformVelocity",
    ),
    "VT2": (TITLE + VELOCITY, "says velocity"),
    "DT2": (TITLE + VELOCITY.replace("VELOCITY", "DISPLACEMENT"), "says displacement"),
    "columns": ("time (s), velocity (m/s)\n0,1\n.1,2\n", "says velocity"),
}


@pytest.mark.parametrize("name", OTHER_KINDS)
def test_velocities_displacements_and_spectra_are_refused_by_their_kind(write, name):
    text, says = OTHER_KINDS[name]
    path = write(text, "quake.asc")
    for options in ({}, {"column": 1}):
        with pytest.raises(OtherKindError, match=rf"^{re.escape(str(path))}(:\d+)?: .*{says}") as e:
            read_record(path, **options)
        assert "\n" not in str(e.value)


def _changed(name, old, new, says):
    text = text_of(name)
    assert old in text
    changed = text.replace(old, new, 1)
    line = 1 if "Sim" in name else text[: text.index(old)].count("\n") + 1
    return changed, line, says, {"column": 1} | OPEN.get(name, {})


AGREE, TRUNCATED, SURPLUS = "must agree with", "truncated: ", "surplus values: "
test_counts_and_intervals_that_disagree_are_refused = refusals(
    _changed("AFAD", "NUMBER OF DATA          : 123", "NUMBER OF DATA          : 124", TRUNCATED),
    _changed("AFAD", "NUMBER OF DATA          : 123", "NUMBER OF DATA          : 122", SURPLUS),
    _changed("ESM", "NDATA: 123", "NDATA: 122", SURPLUS),
    _changed("ESM", "NDATA: 123", "NDATA: 246", TRUNCATED),
    _changed("UNAM", "/123/", "/800/", "must be one number for all channels"),
    _changed("UNAM", "/0.02/0.02/0.02", "/0.01/0.01/0.01", AGREE),
    _changed("CWB", "RecordLength(sec): 2.46", "RecordLength(sec): 4.92", TRUNCATED),
    _changed("GeoCSV", "sample_count: 123", "sample_count: 128", TRUNCATED),
    _changed("SLIST", "123 samples", "124 samples", TRUNCATED),
    _changed("TSPAIR", "123 samples", "124 samples", TRUNCATED),
    _changed("eqsig", "123 0.0200", "122 0.0200", SURPLUS),
    _changed("eqsig", "123 0.0200", "123 0", "the time step 0 must be positive"),
    _changed("eqsig", "123 0.0200", "123 -0.02", "the time step -0.02 must be positive"),
    _changed("SimCenter", '"numPoints": 123', '"numPoints": 124', TRUNCATED),
    _changed("SimCenter event", '"numSteps": 123', '"numSteps": 122', SURPLUS),
    _changed("CSMIP V2", "intervals of   0.020", "intervals of   0.010", AGREE),
    _changed("K-NET", "Duration Time(s)  2.46", "Duration Time(s)  2.44", SURPLUS),
)
INTERVALS = {  # of which the other statement is named, in another line
    "CSMIP V2": ("spaced at  0.020", "spaced at  0.022"),
    "CSMIP V1": ("SPACED AT 0.020", "SPACED AT 0.010"),
    "CWB": ("SampleRate(Hz): 50", "SampleRate(Hz): 51"),
    "TSPAIR": ("50 sps", "100 sps"),
    "GeoCSV": ("rate_hz: 50", "rate_hz: 40"),
}


@pytest.mark.parametrize("name", INTERVALS)
def test_two_intervals_that_disagree_are_refused(write, name):
    text = text_of(name).replace(*INTERVALS[name])
    if name == "CWB":  # else the number of values of its length is the first to disagree
        text = text.replace("#RecordLength(sec): 2.46\n", "")
    with pytest.raises(ValueError, match=r":\d+: '.*', 0.0\d+ s, must agree with '.*', 0.0\d+ s$"):
        read_record(write(text), column=1)


@pytest.mark.parametrize("name", BLOCKS)
def test_only_zeros_may_fill_the_last_row(write, name):
    network = NETWORKS[name]
    (numbers,) = network.printed()[:1]
    per_row, tab = (10 if "Geo" in name else 8), ""
    if name == "SLIST":
        per_row, tab = 6, "\t"
    begin = "".join(number + tab for number in numbers[-(N % per_row) :])
    text, n_more = text_of(name, 1), per_row - N % per_row
    assert text.count(begin) == 1
    for number, reads in ((network.form(0.0), True), (numbers[3], False)):
        path = write(text.replace(begin, begin + (number + tab) * n_more))
        if reads:
            assert_gives(read_record(path), network.samples(numbers))
            continue
        with pytest.raises(
            ValueError, match=rf"quake\.txt:\d+: (.* must be {N % per_row} numbers|sur)"
        ):
            read_record(path)


def test_numbers_ahead_of_the_first_header_are_refused(write):
    text = text_of("SLIST", 2)
    without_first = text[text.index("\n") + 1 :]
    assert_refuses(write(without_first), 1, "must be behind a header", column=1)


# A number without its sign, or without digits ahead of its decimal point, is a number still.
_SILENT = re.compile(r"[-+0-9][0-9]*\.[0-9]")


def is_silent(network, mutation):
    """Whether nothing in a file speaks of its damage, which is noticed in all other cases.

    Nothing does where a number has lost one character, its sign or a digit ahead of its decimal
    point, and kept all its decimals: where columns have a fixed width, only if a blank stands there
    now. Files that are cut, lines that are lost or doubled, letters, separators, decimals and
    exponents are never silent, but for the first and the last line of CWB, which states a length
    in s and no count.
    """
    before, after = mutation.before, mutation.after
    if network is NETWORKS["CWB"] and mutation.kind in ("a line lost", "a line cut"):
        return float(before.split()[0]) in (0.0, round((DAMAGED - 1) * DT, 3)) and not after.strip()
    if mutation.kind not in ("a character lost", "a character blanked"):
        return False
    if network.fixed and len(after) < len(before):
        return False
    pairs = zip(before, after + " ", strict=False)
    at = next((k for k, (old, new) in enumerate(pairs) if old != new), 0)
    return _SILENT.match(before, at) is not None


DAMAGED = 203  # samples
OUTCOMES = {"refused", "warned of", "whole", "misread"}


def outcome(path, samples, **options):
    """Whether a damaged file is refused, warned of, or read; ``misread`` if to other samples."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            read = read_record(path, column=1, **options).samples
    except PlausibilityWarning:
        return "warned of"
    except ValueError as error:
        named = re.fullmatch(rf"{re.escape(str(path))}(:\d+)?: .*", str(error))
        return "refused" if named else str(error)
    whole = len(read) == len(samples) and np.allclose(read, samples, rtol=1e-12, atol=0)
    return "whole" if whole else "misread"


@pytest.mark.parametrize("name", NETWORKS)
def test_damage_to_rows_is_never_misread(write, name):
    network = NETWORKS[name]
    printed = network.printed(DAMAGED)
    if name not in SIDE_BY_SIDE:
        printed = printed[: 1 + (name == "GeoNet V1A")]
    samples = network.samples(printed[0])
    path = write("", "quake" + network.extension)
    damaged = list(mutations(network, printed, seed=len(name), times=20))
    outcomes = []
    for mutation in damaged:
        path.write_text(mutation.text)
        outcomes.append(outcome(path, samples, **OPEN.get(name, {})))
    misread = [x for x, y in zip(damaged, outcomes, strict=True) if y == "misread"]
    loud = [x[:3] for x in misread if not is_silent(network, x)]
    assert not loud
    assert set(outcomes) <= OUTCOMES
    assert len(misread) <= len(damaged) // 10
    assert outcomes.count("refused") > len(damaged) // 2


@pytest.mark.parametrize("seed", range(4))
def test_a_digit_lost_inside_a_long_record_of_k_net_is_noticed(write, seed):
    counts = np.round(2000 * np.sin(np.arange(8000) / 9 + seed)).astype(int).tolist()
    text = NETWORKS["K-NET"].text([list(map(str, counts))])
    number = next(f" {x} " for x in counts[4000 + seed :] if 10 < abs(x) < 100)
    assert len(read_record(write(text)).samples) == 8000
    for lost in (number[:-2] + " ", number[:-2] + "  "):
        path = write(text.replace(number, lost, 1))
        with pytest.raises(ValueError, match=r"quake\.txt:\d+: the counts '.*' must end below"):
            read_record(path)


@pytest.mark.parametrize("name", ["UNAM", "CWB", "AFAD"])
def test_a_digit_lost_in_columns_flush_right_is_noticed(write, name):
    network = NETWORKS[name]
    printed = network.printed(DAMAGED)
    number = next(x.strip() for x in printed[0] if len(x.strip().split(".")[0]) > 2)
    text = network.text(printed).replace(number, number[0] + number[2:], 1)
    path = write(text, "quake" + network.extension)
    assert outcome(path, network.samples(printed[0])) in ("refused", "warned of")


@pytest.mark.parametrize("name", NETWORKS)
def test_a_line_lost_or_doubled_in_a_header_is_never_misread(write, name):
    """It is not needed, or is missed; units are stated in one line, which the caller may state."""
    network = NETWORKS[name]
    printed = network.printed()
    if name not in SIDE_BY_SIDE:
        printed = printed[:1]
    rows = network.text(printed).split("\n")
    path = write("", "quake" + network.extension)
    first = next(k for k, row in enumerate(rows) if printed[0][0].strip() in row)
    if name in ("SMC", "COSMOS V1c"):
        first = min(first, 60)
    outcomes = []
    for k, new in product(range(first), (0, 2)):
        path.write_text("\n".join([*rows[:k], *rows[k : k + 1] * new, *rows[k + 1 :]]))
        outcomes.append(outcome(path, network.samples(printed[0]), **OPEN.get(name, {})))
    assert set(outcomes) <= OUTCOMES - {"misread"}


# What is not read, and spreadsheets --------------------------------------------------------------


def _zip(*members):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for member in members:
            archive.writestr(member, "1 2\n")
    return file.getvalue()


_SAC = np.full(158, -12345, "<i4").tobytes()
NOT_READ = {
    "quake.sac": (_SAC[:304] + b"\6\0\0\0" + _SAC[308:] + b"\0" * 800, "SAC", "obspy.read"),
    "big-endian.sac": (_SAC[:304] + b"\0\0\0\6" + _SAC[308:], "SAC", "obspy.read"),
    "quake.mseed": (b"000001D EXA  00HNEXX" + b"\7\xee\0\1" * 100, "miniSEED", "obspy.read"),
    "three.mseed": (b"MS\x03\4" + b"\0" * 60, "miniSEED", "obspy.read"),
    "quake.gse": (b"WID2 2030/01/01 00:00:00.000 EXA   HNE\n", "GSE", "obspy.read"),
    "quake.h5": (b"\x89HDF\r\n\x1a\n" + b"\0" * 90, "HDF5", "h5py"),
    "quake.npy": (b"\x93NUMPY\1\0v\0", "NumPy", "numpy.load"),
    "quake.mat": (b"MATLAB 5.0 MAT-file" + b"\0" * 90, "MATLAB", "scipy.io.loadmat"),
    "quake.gz": (gzip.compress(b"1 2\n"), "compressed", "unpack it"),
    "quake.zip": (_zip("a/one.AT2", "two.VT2"), "zip archive", r"a/one\.AT2, two\.VT2"),
    "many.zip": (_zip(*(f"{k}.AT2" for k in range(9))), "zip archive", r"5\.AT2, \.\.\."),
    "cut.zip": (_zip("one.AT2")[:40], "damaged zip", "unpack"),
    "book.xlsx": (_zip("[Content_Types].xml", "xl/workbook.xml"), "Excel", "as CSV"),
    "book.xls": (b"\xd0\xcf\x11\xe0" + b"\0" * 90, "Excel", "as CSV"),
    "page.V2": (b"\n<!DOCTYPE html>\n<html>", "web page", "download the file"),
    "page.html": (b"<HTML><body>", "web page", "download the file"),
    "event.xml": (b"<?xml version='1.0'?>", "XML", "accelerations"),
    "paper.pdf": (b"%PDF-1.4", "PDF", "numbers"),
}


@pytest.mark.parametrize("name", NOT_READ)
def test_a_known_format_that_is_not_read_is_named_with_advice(write, name):
    content, kind, advice = NOT_READ[name]
    assert_refuses(write(content, name), None, f"is an? .*{kind}.*: .*{advice}", OtherKindError)


@pytest.mark.parametrize("name", SHEETS)
def test_spreadsheets_of_all_countries(write, name):
    assert_gives(read_record(write(SHEETS[name], "quake.csv")), np.array(SHEET, float) * MS2)


def test_thousands_marks_in_quotes(write):
    values = [f"{1e4 * x:,.2f}" for x in motion(0)]
    assert any("," in value for value in values)
    rows = "".join(f'{k * DT:.2f},"{value}"\n' for k, value in enumerate(values))
    samples = [float(value.replace(",", "")) / 9806.65 for value in values]
    assert_gives(read_record(write("time (s),acc (mm/s2)\n" + rows)), samples)
    points = rows.replace(",", ";").replace(".", ",")  # 1.234,56
    points = re.sub(r"(?<=[0-9]);(?=[0-9]{3},)", ".", points)
    assert_gives(read_record(write("Zeit (s);a (mm/s2)\n" + points)), samples)


test_ambiguous_and_damaged_cells_are_refused = refusals(
    (sheet().replace(".", ","), 2, "commas seem to separate columns and to mark decimals"),
    (sheet().replace("\n0.20,", "\n0.20,#N/A,"), 12, "'#N/A' must be a finite number"),
    (sheet(";").replace("\n0.20;", "\n0.20;#DIV/0!;"), 12, "'#DIV/0!' must be a finite number"),
    (sheet().replace("\n0.20,", "\n,"), 12, "must be a finite number|must have 2"),
    (sheet().replace("\n0.20,", "\n0.20,,"), 12, "must be a finite number"),
)


# Values without a header, and headers of a few words ---------------------------------------------

VALUES = [f"{x:.6f}" for x in motion(0, 160)]
COLUMN = rows_of(VALUES, 1)


@pytest.mark.parametrize(
    ("first", "options"),
    [("160 0.0200\n", {}), ("160\n0.02\n", {}), ("160\n", {"dt": DT}), ("0.02\n", {"dt": DT})],
    ids=repr,
)
def test_a_count_and_an_interval_ahead_of_the_values_are_no_samples(write, first, options):
    path = write(first + COLUMN)
    assert_gives(read_record(path, units="g", **options), np.array(VALUES, float))
    if options == {}:
        line = first.count("\n")
        assert_refuses(path, line, "dt = 0.01 must agree with the file's own", dt=0.01)
    wrong = first.replace("160", "161")
    if wrong != first:
        assert_refuses(write(wrong + COLUMN), 1, "truncated: the first line", dt=DT)


def test_a_lone_first_number_like_a_time_step_is_refused_without_dt(write):
    still = "".join(f"{x:.6f}\n" for x in 1e-4 * motion(0, 50)) + COLUMN
    says = r"0\.02 stands apart .* pass dt=0\.02 if it is one"
    assert_refuses(write("0.02\n" + still), 1, says)
    assert_refuses(write(COLUMN), 1, "1 value.s. a row and no times: pass dt")


def test_rows_are_columns_or_a_history_as_the_caller_says(write):
    components = [[f"{x:.5f}" for x in motion(k)] for k in range(3)]
    rows = ["  ".join(row) for row in zip(*components, strict=True)]
    path = write("\n".join(rows) + "\n")
    assert_refuses(path, 1, r"3 columns or blocks \(1, 2, 3\): choose one", dt=DT)
    for column, numbers in enumerate(components, 1):
        record = read_record(path, dt=DT, column=column, units="g")
        assert_gives(record, np.array(numbers, float))
    history = read_record(path, dt=DT, rows="history", units="g")
    assert_gives(history, np.array(components, float).T.ravel())
    five = write(rows_of(VALUES, 5, " "))
    assert_gives(read_record(five, dt=DT, units="g"), np.array(VALUES, float))
    first = read_record(five, dt=DT, rows="columns", column=1, units="g")
    assert_gives(first, np.array(VALUES[::5], float))
    with pytest.raises(ValueError, match=r"rows = 'blocks' must be 'history', .* or 'columns'"):
        read_record(five, dt=DT, rows="blocks")


def test_velocities_behind_accelerations_without_a_header_are_refused(write):
    values = 1000 * motion(0, 400)
    velocity = np.concatenate([[0], np.cumsum((values[1:] + values[:-1]) / 2)]) * DT
    numbers = [f"{x:8.1f}" for x in [*values, *velocity, *np.cumsum(velocity) * DT]]
    says = "velocities seem to follow 400 accelerations"
    assert_refuses(write(rows_of(numbers, 10)), 41, says, dt=DT, units="mm/s2")
    assert_refuses(write(rows_of(numbers[:800], 10)), 41, says, dt=DT, units="mm/s2")
    record = read_record(write(rows_of(numbers[:400], 10)), dt=DT, units="mm/s2")
    assert record.n_samples == 400


ONE_COLUMN = {  # lines of a header of one column, and the unit that they state of the data
    "Sensor full scale (g): 2\nData unit m/s^2": "m/s2",
    "ESCALA COMPLETA DEL SENSOR (g) : 2\nUNIDADES DE LOS DATOS : m/s2": "m/s2",
    "Sensor range [g]: 2\nUNITS: m/s^2": "m/s2",
    "ISTASYON: ORNEK\nBIRIM: gal": "gal",
    "ESTACION: EJEMPLO\nUNIDADES: cm/s/s": "cm/s2",
    "STAZIONE: ESEMPIO\nunità: cm/s^2": "cm/s2",
    "Einheit: m/s²\nBereich [g]: 4": "m/s2",
    "Trigger level (gal): 1\nSampling rate 50 Hz": None,
    "Sensor full scale (g): 2\nSampling rate 50 Hz": None,
    "UMBRAL DE DISPARO (Gal): 0.5\nINTERVALO DE MUESTREO (s): 0.02": None,
    "Corner frequency (Hz): 25\nPeak acceleration (m/s2): 1.9": None,
}
ONE_G = {"m/s2": 9.80665, "gal": 980.665, "cm/s2": 980.665}


@pytest.mark.parametrize("header", ONE_COLUMN)
def test_a_range_a_level_or_a_peak_states_no_unit_of_the_data(write, header):
    unit = ONE_COLUMN[header]
    path = write(f"Station: Example\n{header}\n{COLUMN}")
    if unit:
        record = read_record(path, dt=DT)
        assert_gives(record, np.array(VALUES, float) / ONE_G[unit])
        with pytest.raises(ValueError, match=f"units = 'mg' must be the header's own, '{unit}'"):
            read_record(path, dt=DT, units="mg")
        return
    for units in ("m/s2", "gal"):
        record = read_record(path, dt=DT, units=units)
        assert_gives(record, np.array(VALUES, float) / ONE_G[units])


def test_another_unit_in_a_header_of_a_format_with_its_own_is_refused(write):
    text = text_of("AFAD").replace("NUMBER OF DATA", "UNITS : m/s2\nNUMBER OF DATA")
    assert_refuses(write(text), 1, "the header states both 'm/s2' and 'gal'", column=1)
