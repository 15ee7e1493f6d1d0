"""K-NET's ASCII format."""

import numpy as np
import pytest

from jaxpound.ground.reader import read_record
from tests.ground import files
from tests.ground.files import COUNTS, assert_refuses, knet_text


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
    assert_refuses(path, 11, "dt = 0.02 must agree", dt=0.02)


def test_knet_as_its_own_description_prints_it(write):
    text = knet_text().replace("Max. Acc. (gal)  ", "Max Acc. (gal)   ").replace("Long.", "Lon. ")
    assert read_record(write(text.replace("\n", "\r\n"))).n_samples == 200


SCALE, RATE, TIME, MOST = "Scale Factor", "Sampling Freq(Hz)", "Duration Time(s)", "Max. Acc. (gal)"
HEADERS = [
    (SCALE, "7845(m)/8223790", 14, "Scale Factor = '7845.m./8223790' must be positive"),
    (SCALE, "7845(gal)/0", 14, "must be positive, as in 3920"),
    (SCALE, "7845", 14, "Scale Factor = '7845'"),
    (SCALE, None, None, "must state Scale Factor"),
    (RATE, "100", 11, "Sampling Freq.Hz. = '100' must be positive, as in 100Hz"),
    (RATE, "0.01s", 11, "as in 100Hz"),
    (TIME, "3", 12, "truncated: 100 Hz for 3 s, 300, must be .* 200"),
    (TIME, "1", 12, "surplus values: 100 Hz for 1 s, 100, must be .* 200"),
    (TIME, None, None, "must state Duration"),
    (MOST, "2.123", 15, "Max. Acc. = 2.123 gal must be that of the counts"),
    (MOST, None, None, "must state Max. Acc."),
    ("Memo.", None, None, "must end with its line 'Memo.'"),
]
HEADER, ROWS = knet_text().split("Memo.")
SCALE_LINE = "".join(line + "\n" for line in HEADER.split("\n") if "Scale" in line)
test_knet_headers_that_are_not_understood_and_damaged_files_are_refused = files.refusals(
    *((knet_text(**{name: value}), line, says) for name, value, line, says in HEADERS),
    (SCALE_LINE + ROWS, None, "K-NET header must end", {"dt": 0.01, "units": "gal"}),
    (knet_text().replace(" 9876", " 8976"), 15, "the file is damaged"),
    (knet_text().replace(" 9876", " 9.76"), 20, "9.76 must be a whole number"),
)
