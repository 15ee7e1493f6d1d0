"""Files of accelerograms that the tests write, and what reading one must give."""

import re

import numpy as np
import pytest

from jaxpound.ground.reader import read_record
from jaxpound.ground.record import Record

TITLE = "PEER STRONG MOTION DATABASE RECORD\nSOME EARTHQUAKE 1/2/03, STATION #9, 180\n"
KIND = "ACCELERATION TIME HISTORY IN UNITS OF G\n"
VALUES = [-0.0064, 0.25, 0.0012, -0.0031, 0.5, -0.75, 0.0065]
BODY = " -.64E-02  .25E+00  .12E-02 -.31E-02  .50E+00\n -.75E+00  .65E-02\n"


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


def refusals(*rows):
    """A test of each row: the text of a file, line and words of the refusal, and options if any."""

    @pytest.mark.parametrize("row", rows, ids=[repr(row[0])[:60] for row in rows])
    def test(row, write):
        text, line, says, *options = row
        assert_refuses(write(text), line, says, **(options[0] if options else {}))

    return test


SHAKING = np.sin(np.arange(200) / 7) * np.exp(-np.arange(200) / 90)
COUNTS = np.round(7000 + 900 * SHAKING).astype(int)
COUNTS[15:20] = 8700, 9700, 9876, 9300, 8400


def knet_text(counts=COUNTS, rate=100, scale="7845(gal)/8223790", **changed):
    """A file in the layout of NIED's K-NET ASCII format, with what is changed in its header."""
    gal = np.array(counts) * 7845 / 8223790
    fields = {"Origin Time": "2014/12/31 23:49:00", "Lat.": "35.6", "Long.": "140.1"}
    fields |= {"Depth. (km)": "70", "Mag.": "4.0", "Station Code": "XXX001"}
    fields |= {"Station Lat.": "35.7000", "Station Long.": "140.9000", "Station Height(m)": "4"}
    fields |= {"Record Time": "2014/12/31 23:49:30", "Sampling Freq(Hz)": f"{rate}Hz"}
    fields |= {"Duration Time(s)": f"{len(counts) // rate}", "Dir.": "E-W", "Scale Factor": scale}
    fields |= {"Max. Acc. (gal)": f"{np.abs(gal - gal.mean()).max():.3f}"}
    fields |= {"Last Correction": "2014/12/31 23:49:15", "Memo.": ""}
    fields |= {name.replace("_", " "): value for name, value in changed.items()}
    header = [f"{name:17s} {value}" for name, value in fields.items() if value is not None]
    rows = ["".join(f"{n:9d}" for n in counts[k : k + 8]) + " " for k in range(0, len(counts), 8)]
    return "\n".join([*header, *rows, ""])


KNET = knet_text(COUNTS[:100])
