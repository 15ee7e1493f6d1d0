"""Records of files with several components: options of ``simulate``, and tables of files."""

import numpy as np
import pytest

from jaxpound.cli import simulate
from jaxpound.cli.structures import read_records
from jaxpound.cli.tables import RecordFile
from tests.cli.commands import refusal
from tests.ground.test_suite import columns

SIZES = dict(zip(("N-S", "E-W", "U-D"), (0.2, 0.3, 0.1), strict=True))


@pytest.fixture
def three(tmp_path):
    path = tmp_path / "three.txt"
    path.write_text(columns(SIZES.values(), SIZES))
    return path


@pytest.mark.parametrize(
    ("options", "size"),
    [
        (["--column", "2"], 0.3),
        (["--column", "E-W"], 0.3),
        (["--column", "u-d"], 0.1),
        (["--vertical"], 0.1),
    ],
)
def test_the_component_of_simulate(options, size, three, tmp_path, capsys, monkeypatch):
    def stop(_file, _ground, record):
        raise ValueError(f"PGA {abs(record.samples).max():.4f}")

    monkeypatch.setattr(simulate, "shaking", stop)
    out = tmp_path / "out"
    assert f"PGA {size:.4f}" in refusal(
        capsys, "simulate", "--record", three, *options, "--out", out
    )


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([], "three.txt:3: 3 columns or blocks (1: N-S, 2: E-W, 3: U-D): choose one"),
        (["--column", "4"], "three.txt:3: column = '4' must be a number from 1, or a name, of"),
        (["--rows", "down"], "rows = 'down' must be 'history'"),
        (["--column", "1", "--rows", "history"], "three.txt:3: "),
    ],
)
def test_simulate_refuses_components_that_are_not_there(options, words, three, tmp_path, capsys):
    line = refusal(capsys, "simulate", "--record", three, *options, "--out", tmp_path / "out")
    assert words in line


def test_doubts_of_a_record_are_refused_with_strict(tmp_path, capsys):
    path = tmp_path / "coarse.csv"
    path.write_text("\n".join(f"{i},{0.1 * np.sin(i):.5f}" for i in range(40)) + "\n")
    options = ["--record", path, "--strict", "--units", "g", "--out", tmp_path / "out"]
    assert "coarse.csv: the time step is 1 s" in refusal(capsys, "simulate", *options)


def test_records_of_configurations_choose_components(three):
    (three.parent / "bare.txt").write_text("".join(f"{20 * np.sin(i):.3f}\n" for i in range(40)))
    files = ["three.txt", RecordFile("three.txt", column="E-W"), RecordFile("three.txt", column=1)]
    files += [RecordFile("bare.txt", dt=0.02, units="gal")]
    records = read_records("place", three.parent, files[1:], "g")
    assert [record.name for record in records] == ["three E-W", "three N-S", "bare"]
    peaks = [abs(record.samples).max() for record in records]
    np.testing.assert_allclose(peaks, [0.3, 0.2, 20 / 980.665], rtol=1e-3)
    with pytest.raises(ValueError, match=r"^place: .*three\.txt:3: 3 columns or blocks"):
        read_records("place", three.parent, files[:1], "g")
