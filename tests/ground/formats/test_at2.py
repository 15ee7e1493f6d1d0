"""PEER's AT2 files."""

from __future__ import annotations

import re

import pytest

from jaxpound.ground.reader import read_record
from tests.ground.files import BODY, KIND, TITLE, VALUES, assert_reads, assert_refuses


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


def test_an_at2_header_without_values_is_refused(write):
    assert_refuses(write(TITLE + KIND + "NPTS= 7, DT= .01 SEC\n"), 4, "no data")


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
