"""Two columns, and values without times."""

import re

import numpy as np
import pytest

from jaxpound._errors import PlausibilityWarning
from jaxpound.ground.reader import read_record
from tests.ground import files
from tests.ground.files import assert_reads, assert_refuses

SUMMED = np.cumsum(np.full(3000, 0.01)) - 0.01


@pytest.mark.parametrize("separator", [",", ", ", ";", " ; ", "\t", " ", "    "])
@pytest.mark.parametrize(
    "header", ["", "time,acc (g)\n", "Northridge 1994\n\nt (s); a\n", "# c 1\n% c 2\n// c 3\n\n"]
)
def test_two_columns_are_time_and_acceleration(write, separator, header):
    rows = [("0", "0.1"), ("0.02", "-6.00E-05"), ("0.04", ".3"), ("0.06", "0")]
    text = header + "\n".join(separator.join(row) for row in rows) + "\n"
    assert_reads(write(text), [0.1, -6e-5, 0.3, 0], 0.02)


def test_comments_blanks_and_empty_cells_are_skipped_and_several_columns_refused(write):
    path = write("0,1,\n\n# note 5,5\n.1,2,,\n  // note\n,,\n.2,3\n%\n")
    with pytest.warns(PlausibilityWarning, match=r"quake\.txt: data follow the comment of line 3"):
        assert_reads(path, [1, 2, 3], 0.1)
    path = write("0.00 5 6\n0.01 7 8\n0.02 9 0\n")
    assert_refuses(path, 1, r"2 columns or blocks \(1, 2\): choose one", dt=0.01)
    assert_reads(path, [6, 8, 0], 0.01, dt=0.01, column=2)
    history = [0, 5, 6, 0.01, 7, 8, 0.02, 9, 0]
    assert_reads(path, history, 0.011, dt=0.011, rows="history")


@pytest.mark.parametrize(
    ("text", "values", "step"),
    [
        ("0.00-0.5\n0.01+0.25\n0.02-1.E-2\n", [-0.5, 0.25, -0.01], 0.01),  # stuck together
        ("-0.02 1\n-0.01 2\n0.00 3\n", [1, 2, 3], 0.01),  # a first time other than zero
        ("10.5 1\n11 2\n11.5 3\n", [1, 2, 3], 0.5),
        (
            "".join(f"{t!r} 1\n{u!r} -1\n" for t, u in SUMMED.reshape(-1, 2).tolist()),
            [1, -1] * 1500,
            0.01,
        ),
    ],
    ids=["stuck", "negative", "late", "summed"],
)
def test_times_of_other_kinds_are_read(write, text, values, step):
    assert SUMMED[-1] != 29.99
    assert_reads(write(text), values, step)


@pytest.mark.parametrize("times", ["{:.2f}", "{:.3f}", "{:.4g}", "{:.4E}", "{!r}"])
def test_times_may_be_rounded_in_print(write, times):
    dt, n = 1 / 16, 200
    text = "".join(f"{times.format(k * dt)} {k % 10 - 4.5}\n" for k in range(n))
    record = read_record(write(text), units="g")
    assert record.dt == pytest.approx(dt, rel=1e-3)
    assert record.n_samples == n


UNEVEN = {"0 .01 .02 .04 .05 .06": 4, "0 .01 .02 .03 .03 .04": 5, "0 .01 .02 .01 .02 .03": 4}
UNEVEN |= {"0.000 0.010 0.020 0.032 0.040 0.050": 4, "0.00 0.00 0.01 0.01 0.02 0.02": 3}
UNEVEN |= {"0.03 0.02 0.01 0.00": 2, "1 1 1 1": 2}
NO_HISTORIES = {
    "Time, Arias intensity": "but the header says arias",
    "Time (s), Sa (g)": "but the header says sa",
    "t;Spectral acceleration": "but the header says spectral",
    "period, Sa": "must be times, but the header says period",
    "Frequency (Hz) Acc (g)": "must be times, but the header says frequency",
    "index,acc": "must be times, but the header says index",
    "# No. acc": "must be times, but the header says no",
    "period,PSA\ns,g": "must be times, but the header says period",
}
UNEQUAL = {"0 1\n.1 2\n.2\n.3 4\n": 3, "0 1\n.1 2 3\n": 2, "1 2 3\n4 5\n6 7 8\n": 2, "1\n2 3\n": 2}
test_what_is_no_history_is_refused = files.refusals(
    *((x.replace(" ", " 1\n") + " 1\n", n, "must be uniform") for x, n in UNEVEN.items()),
    *((f"{x}\n0,.1\n1,.2\n2,.1\n", 1, says) for x, says in NO_HISTORIES.items()),
    *((text, line, "must have [123]$", {"dt": 0.1}) for text, line in UNEQUAL.items()),
)


@pytest.mark.parametrize("lost", [1, 50, 100, 198])
@pytest.mark.parametrize(("dt", "decimals"), [(0.01, 2), (0.02, 2), (0.0125, 3), (0.005, 4)])
def test_one_lost_sample_is_noticed_at_its_line_whatever_the_rounding(write, dt, decimals, lost):
    times = [k * dt for k in range(200) if k != lost]
    path = write("".join(f"{time:.{decimals}f},1\n" for time in times))
    assert_refuses(path, lost + 1, "must be uniform")


WITHOUT_TIMES = ["1\n2\n3\n4\n5\n6\n7\n", "acc in g\n1 2 3\n4 5 6\n7\n", "1,2,3,4,5\n6,7\n"]


@pytest.mark.parametrize("text", [*WITHOUT_TIMES, "1.-2.+3. 4 5 6 7"])
def test_values_without_times_need_dt(write, text):
    values = [1, 2 if "-" not in text else -2, 3, 4, 5, 6, 7]
    path = write(text)
    assert_reads(path, values, 0.005, dt=0.005, rows="history")
    assert_refuses(path, 2 if text.startswith("acc") else 1, "pass dt", rows="history")


def test_columns_are_not_taken_for_one_history(write):
    rows = [(k, 0.005 * k, np.sin(k / 9)) for k in range(60)]
    indexed = "".join(f"{k} {t:.3f} {a:.5f}\n" for k, t, a in rows)
    turned = "".join(f"{a:.5f} {-a:.5f} {t:.2f}\n" for _, t, a in rows)
    three = "".join(f"{a:.5f},{-a:.5f},{a / 9:.5f}\n" for *_, a in rows)
    assert_reads(write(indexed), [round(a, 5) for *_, a in rows], 0.005, units="g")
    assert_refuses(write(turned), 1, "column 3 rises evenly .* must be the first", dt=0.005)
    for text, names in (
        (three, "(1, 2, 3)"),
        (f"NS,EW,UD\n{three}", "(1: NS, 2: EW, 3: UD)"),
        (f"long. (g), tran. (g), vert. (g)\n{three}", "(1: long., 2: tran., 3: vert.)"),
        ("  N-S   E-W   U-D\n" + three.replace(",", "   "), "(1: N-S, 2: E-W, 3: U-D)"),
    ):
        says = re.escape(f"3 columns or blocks {names}: choose one by its number or name")
        assert_refuses(write(text), 1 + (text != three), says, dt=0.005)
        second = read_record(write(text), dt=0.005, units="g", column=2)
        np.testing.assert_allclose(second.samples, [round(-a, 5) for *_, a in rows])
    five = "".join(f"{a:.5f} {-a:.5f} {a / 9:.5f} {-a / 9:.5f} 0.0\n" for *_, a in rows)
    with pytest.warns(
        PlausibilityWarning, match="rows of 5 values seem to be columns side by side"
    ):
        assert read_record(write(five), dt=0.005, units="g").n_samples == 300
    fourth = read_record(write(five), dt=0.005, units="g", rows="columns", column=4)
    np.testing.assert_allclose(fourth.samples, [round(-a / 9, 5) for *_, a in rows])


COLUMNS = [range(100), range(10, 30), np.arange(80) / 200, range(0, 90, 5)]


@pytest.mark.parametrize("column", COLUMNS)
def test_one_column_of_times_or_of_an_index_is_refused(write, column):
    path = write("".join(f"{value:.3f}\n" for value in column))
    assert_refuses(path, 1, "the only column rises evenly .* must hold accelerations", dt=0.005)
    for few in ("0.00\n0.01\n0.02\n0.03\n", "0\n10\n20\n30\n"):
        assert_refuses(write(few), 1, "rises evenly", dt=0.01)


def test_a_long_line_is_read_in_proportion_to_its_length(write):
    """Half a million characters with a letter at the end; a quarter of their square is a day."""
    assert_refuses(write("1,2 " * 125_000 + "x\n" + "0.1,0.2\n" * 30), 1, "'x' must be a finite")
