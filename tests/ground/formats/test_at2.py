"""PEER's AT2 files."""

import pytest

from jaxpound.ground.reader import read_record
from tests.ground import files
from tests.ground.files import BODY, KIND, TITLE, VALUES, assert_reads, assert_refuses

NPTS_LINES = ["NPTS=  7, DT= .01000 SEC", "NPTS=   7, DT=   .0100 SEC,           "]
NPTS_LINES += ["NPTS=   7, dt=  .01000", "npts=7,dt=0.01", "NPTS=7 DT=.01SEC"]
NPTS_LINES += ["NPTS= 7, DT= 1.0D-02 SEC", "7 0.0100 NPTS, DT ", "   7    0.0100    NPTS, DT"]
IN_MS = ["7 10 NPTS, DT (MS)", "NPTS= 7, DT= 10 MSEC", "NPTS= 7, DT=10ms"]
IN_MS += ["NPTS= 7, DT= 10.0 (ms)", "NPTS= 7, dt: 10 milliseconds,"]
BODIES = [
    " ".join(map(str, VALUES)),
    "\n".join(map(str, VALUES)),
    "-0.0064, 0.25, 0.0012, -0.0031, 0.5,\n-0.75, 0.0065,\n",
    "-.64E-02 .25E+00 .12E-02-.31E-02 .50E+00-.75E+00 .65E-02",
    "-0.0064 0.2500 0.0012-0.0031 0.5000-0.7500+0.0065",
    "-.64D-02 .25d+00 .12D-02-.31D-02 .50D+00-.75D+00 .65D-02",
    "\n" + BODY.replace("\n", "\n\n") + "\n\n\x1a",
    "*** Begin data ***\n" + BODY + "*** End Data ***\n\nend of file 1 2 3\n",
]
NPTS = "NPTS= 7, DT= .01 SEC\n"
TURNED = "H1 for rotation\nrotation angle -37.0\nazimuth = 233.0\nAcceleration in g\n"
HEADERS = [
    NPTS,
    TITLE + KIND + NPTS,
    TITLE + "7 points at 0.01 sec\nFormat 8F10.5\nThe units are (g)\n*** Begin data ***\n" + NPTS,
    TITLE + TURNED + "7 0.01 NPTS, DT\n",
    TITLE + KIND + NPTS + "FILTER POINTS: HP=0.2 Hz LP=15.0 Hz\nSome note\nEnd\n",
]


@pytest.mark.parametrize(
    "text",
    [
        *(TITLE + KIND + line + "\n" + BODY for line in NPTS_LINES + IN_MS),
        *(line + "\n" + BODY for line in IN_MS),
        *(TITLE + KIND + NPTS + body for body in BODIES),
        *(header + BODY for header in HEADERS),
    ],
)
def test_every_form_of_an_at2_is_read(write, text):
    assert_reads(write(text), VALUES, 0.01)


@pytest.mark.parametrize("name", ["quake.AT2", "quake.at2", "quake.txt", "quake"])
def test_at2_is_told_by_its_npts_line_and_named_by_its_stem(write, name):
    path = write("NPTS= 7, DT= .01\n" + BODY, name)
    assert_reads(path, VALUES, 0.01)
    assert read_record(str(path)).name == "quake"
    # In a comment it makes no AT2.
    assert_reads(write("# NPTS= 2, DT= .1\n0 1\n0.1 2\n"), [1, 2], 0.1)


@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r\r\n", "\r"])
def test_line_ends_of_every_kind_count_as_one_line(write, newline):
    good = TITLE + KIND + "NPTS= 7, DT= .01\n" + BODY
    assert_reads(write(good.replace("\n", newline)), VALUES, 0.01)
    bad = good.replace("-.75E+00", "oops")
    assert_refuses(write(bad.replace("\n", newline)), 6, "'oops'")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1"])
def test_encodings_are_told_apart(write, encoding):
    assert_reads(write("0,.1\n1,.2\n".encode(encoding)), [0.1, 0.2], 1)
    assert_refuses(write(("0,.1\n" + "México,.2\n").encode(encoding)), 2, "'México'")


NO_NUMBERS = ["NPTS= , DT= .01 SEC", "NPTS= seven, DT= .01 SEC", "NPTS= 7x, DT= .01 SEC"]
NO_NUMBERS += [f"NPTS= {npts}, DT= .01 SEC" for npts in ("0", "-7", "6.5")]
NO_NUMBERS += [*(f"NPTS= 7, DT= {dt} SEC" for dt in ("0.0", "-.01")), "7 1e999 NPTS, DT"]
NO_NUMBERS += ["NPTS= 7, DT= SEC", "NPTS= 7, DT= .0l SEC", "x 0.01 NPTS, DT"]
LINES = [
    *((line, "must state NPTS, a positive whole number, and DT > 0") for line in NO_NUMBERS),
    ("NPTS= 4000, DT= .01 SEC", r"truncated: npts= 4000 \D*, 7$"),
    ("NPTS= 5, DT= .01 SEC", r"surplus values: npts= 5 \D*, 7$"),
]
test_npts_and_dt_must_be_positive_numbers_and_those_of_the_values = files.refusals(
    *((f"{TITLE}{KIND}{line}\n{BODY}", 4, says) for line, says in LINES),
    (TITLE + KIND + NPTS, 4, "no data"),
)
