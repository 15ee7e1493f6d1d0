"""What a header states in prose: units of accelerations and times."""

import re

import numpy as np
import pytest

from jaxpound._errors import PlausibilityWarning
from jaxpound.ground.reader import read_record
from tests.ground import files
from tests.ground.files import assert_reads, assert_refuses

UNITS = [
    ("g", 1.0),
    *((units, 9.80665) for units in ("m/s2", "m/s^2", "m/s²", "M/S/S")),
    *((units, 980.665) for units in ("cm/s2", "gal")),
    ("ft/s2", 9.80665 / 0.3048),
    ("in/s2", 9.80665 / 0.0254),
]


@pytest.mark.parametrize(("units", "one_g"), UNITS)
def test_units_of_the_file_are_converted_to_g(write, units, one_g):
    assert_reads(write(f"0 {one_g!r}\n.1 {-one_g / 2!r}\n"), [1, -0.5], 0.1, units=units)


STATED = {
    "g": [
        "ACCELERATION TIME SERIES IN UNITS OF G. FILTER POINTS: HP=0.2 Hz",
        *("The units are (g)", "time,acc (g)"),
        "Units of uncor data are sec and g .        Max  =   .086 g , at  14.830 sec.",
    ],
    "cm/s2": [
        *("ACCELERATION TIME HISTORY IN UNITS OF CM/S/S", "# UNITS OF CM/SEC**2", "t acc_cm_s2"),
        *("Acceleration in cm/sec^2", "UNITS OF CM S-2", "Acceleration in centimeters/sec^2"),
        "UNITS: CM/SEC/SEC. PEAK 341.7",
        "2  acceleration pts, approx 70 secs, units=cm/sec2(04),Format=(8F10.5)",
    ],
    "gal": [
        *("units: gal", "UNITS OF GALS", "Time(s), NS(gal)", "#AmplitudeUnit:  gal. DCoffset(corr)")
    ],
    "m/s2": [
        *("t (s), a (m/s2)", "time; accel [m/s²]", "accelerations in meters per second squared"),
        *("ACCELERATION TIME HISTORY IN [m/s^2]", "t,acc_ms2", "acc (m·s⁻²)"),
    ],
    "mg": ["UNITS OF MG", "ACCELERATION TIME HISTORY IN MILLI-G", "t (s), acc [mg]"],
    "mm/s2": ["ACCELERATION TIME HISTORY IN UNITS OF MM/S2"],
    "in/s2": ["Units of in/sec/sec"],
    "ft/s2": ["acceleration, units of ft/s2"],
    "g/10": [
        "UNITS OF UNCOR ACCEL ARE SEC AND G/10.     MAX  =  0.471 G, AT  31.7 SEC",
        "Units: G/10",
    ],
}
HEADERS = [(header, stated) for stated, headers in STATED.items() for header in headers]


@pytest.mark.parametrize("body", ["NPTS= 2, DT= .1 SEC\n1 2\n", "0 1\n.1 2\n"])
@pytest.mark.parametrize(("header", "stated"), HEADERS)
def test_units_must_be_those_the_header_states(write, header, stated, body):
    path = write(f"a title\n{header}\n{body}")
    record = read_record(path, units=stated)
    np.testing.assert_array_equal(read_record(path).samples, record.samples)
    bare = read_record(write(body, "bare.txt"), units=stated)
    assert record.samples[0] == pytest.approx(bare.samples[0])
    other = "m/s2" if stated != "m/s2" else "g"
    assert_refuses(path, 2, f"units = '{other}' .*'{stated}'", units=other)


UNKNOWN = [  # what is named stands between bars
    *("UNITS OF |G/12|", "UNITS ARE |SECONDS AND G/12|", "units: |% of g|", "Units: |furlong|"),
    *("units = |g x 1000|", "UNITS OF |CM/S|", "In |SI| units", "UNITS ARE |SEC AND KINE|"),
    *("ACCELERATION TIME HISTORY (|% g|)", "Amplitude [|um/s2|]", "Data in |yd/s2|", "acc [|V|]"),
    *("acc in |0.01 m/s2|", "acc [|0.1 g|]", "acc (|mgal|)", "acc (|cm/min2|)", "t,acc_|ug|"),
    *("ACCELERATION TIME HISTORY IN |COUNTS|", "ACCELERATION TIME HISTORY IN |G/100|"),
    *("acceleration in |% g|", "acceleration, |tenths of g|"),
]


@pytest.mark.parametrize("units", ["g", None])
@pytest.mark.parametrize(
    ("header", "says"),
    [
        *((text.replace("|", ""), f"'{text.split('|')[1]}'") for text in UNKNOWN),
        ("UNITS OF UNCOR ACCEL ARE SEC AND G/12.     MAX  =  0.000 G, AT -20.000 SEC", "G/12'"),
        ("Raw readings in units of 1.00 mm/s/s  at intervals of 0.005 s", "'1.00 mm/s/s"),
        ("Scale Factor = 7845/8223790", "speaks of 'Scale Factor'"),
        ("DIGITIZER COUNTS", "speaks of 'COUNTS'"),
        ("Instr Period = .0050 sec, Sensitivity = 5.00 v/g", "speaks of 'Sensitivity'"),
        ("UNITS OF G; acc [gal]", "both 'g' and 'gal'"),
    ],
)
def test_units_and_scales_that_are_not_known_are_refused_by_name(write, header, says, units):
    for body in ("NPTS= 2, DT= .1 SEC\n1 2\n", "0 1\n.1 2\n"):
        assert_refuses(write(f"a title\n{header}\n{body}"), 2, re.escape(says), units=units)


def test_a_scale_factor_is_applied_already_and_gal_are_cm_per_s2(write):
    header = "Orig PEER filename = IMPVALL/H-EMO_233_FN.acc, Scale factor = 2.4072\n"
    text = header + "Acceleration in g\n2 0.0050 NPTS, DT\n.5 .25\n"
    assert_reads(write(text), [0.5, 0.25], 0.005)
    assert read_record(write("units: gal\n0 1\n.1 2\n"), units="cm/s2").n_samples == 2


TIMES = {"time [ms], acc (g)": 1e-3, "Time(msec) Acc(g)": 1e-3, "t_ms,acc_g": 1e-3, "ms\tg": 1e-3}
TIMES |= {"Time in milliseconds": 1e-3, "UNITS ARE MSEC AND G": 1e-3, "time (sec); acc": 1.0}
TIMES |= {"Origin time (UTC), station": 1.0, "Time, Northridge": 1.0}


@pytest.mark.parametrize(("header", "factor"), TIMES.items())
def test_times_are_in_the_units_that_the_header_states(write, header, factor):
    body = "".join(f"{20 * k},{0.1 * (-1) ** k}\n" for k in range(9))
    assert_reads(write(f"{header}\n{body}"), [0.1 * (-1) ** k for k in range(9)], 20 * factor)


NOT_KNOWN = {
    **{f"NPTS= 2, DT= {dt}\n1 2\n": "DT > 0, in s or ms" for dt in ("10 MIN", "100 FURLONG")},
    "time (min), acc (g)\n0,1\n1,2\n": "units = 'min' must be one of the known ones: s, ms",
    "t, NS (counts)\n0,1\n1,2\n": "speaks of 'counts'",
    "Time [h], acc\n0,1\n1,2\n": "units = 'h'",
    **{f"time,{unit}\n0,1\n1,2\n": f"units = '{unit}'" for unit in ("g/12", "m/ms2")},
    **{f"t, NS ({unit})\n0,1\n1,2\n": f"units = '{unit}'" for unit in ("V", "mm")},
}
test_units_of_time_and_of_columns_that_are_not_known_are_refused = files.refusals(
    *((text, 1, re.escape(says)) for text, says in NOT_KNOWN.items())
)


def test_a_long_time_step_is_warned_of(write):
    path = write("".join(f"{20 * k},{0.1 * (-1) ** k}\n" for k in range(10)))
    with pytest.warns(PlausibilityWarning, match="the time step is 20 s: are the times in seconds"):
        assert read_record(path).dt == 20


OTHER_TEXTS = [
    *("EL CENTRO (G STREET)", "acceleration gain 2", "spun up to a g level"),
    *("peak velocity (cm/s) 3", "SAN ONOFRE - SO CAL EDISON, UNIT 1", "Unit 3 building"),
    *("Recorder unit: 12345", "UNITED STATES, COUNTY HOSPITAL", "PGA (cm/s2): 341"),
    *("Max. Acc. (m/s2)   4.078", "Max =  -161.962 m/s2  at  27.850 sec", "acc_ns", "VS30_M/S:"),
    "Peak acceleration =    82.584    cm/sec/sec  at   14.840   sec.",
    *("Acceleration in the N-S direction, 10 ft below", "Acceleration (horizontal)"),
    *("acceleration (filtered 0.1-25 Hz)", "Depth units: km", "RICHTER SCALE 6.9"),
    "Initial velocity  =      .000   cm/sec;   Initial displacement =    -.003   cm",
    "INSTR PERIOD =  .019 SEC   DAMPING =  .640",
]


@pytest.mark.parametrize("header", OTHER_TEXTS)
def test_other_header_text_states_no_units(write, header):
    assert_reads(write(f"{header}\nmore text\n0 980.665\n.1 0\n"), [1, 0], 0.1, units="gal")


@pytest.mark.parametrize("text", ["NPTS= 2, DT= .02\n1 2\n", "time,a\n0,1\n0.02,2\n"])
def test_dt_must_agree_with_the_files_own(write, text):
    path = write(text)
    assert_reads(path, [1, 2], 0.02, dt=0.02 * (1 + 5e-7))
    with pytest.warns(PlausibilityWarning, match="dt = 0.02001 s is taken for '.*', 0.02 s"):
        assert_reads(path, [1, 2], 0.02001, dt=0.02001)
    assert_refuses(path, 1 + text.startswith("t"), "dt = 0.021 .*0.02", dt=0.021)
