"""The page of the documentation and the command that writes it."""

import pytest

from benchmarks.verification import command, figure, page
from benchmarks.verification.batch import BATCH, OURS
from benchmarks.verification.case import Case, Curve, Errors, Number
from benchmarks.verification.cases import CASES
from benchmarks.verification.equal_error import ratios

OF_X = Errors("x", (0.2, 0.1), (0.04, 0.01), 1.1, 2.0, (0.01, 0.02))
ERRORS = OF_X, Errors("v", (0.1,), (0.02,), 2.1)
CURVE = Curve("A panel", "OpenSees, one run", (0.04, 0.01), (0.01, 0.02))
RESULTS = {"errors": ERRORS, "numbers": (Number("peak", 2.674, 2.67, 0.005),), "curves": (CURVE,)}
CASE = Case("A title", "A problem.", "A source.", **RESULTS, seconds=3.0, made="by hand")


def test_the_page_is_made_of_the_results_on_file():
    cases = page.results()
    assert [*cases] == [*CASES]
    assert (page.DOCS / "verification.md").read_text(encoding="utf-8") == page.text(cases)
    assert [case.faults() for case in cases.values() if case.faults()] == []


def test_a_section_has_problem_source_errors_order_and_time_and_the_figure_a_panel():
    section = page.section(CASE)
    assert "| error of | h = 0.2 | h = 0.1 | order | time |" in section
    assert "| x | 4.0e-02 | 1.0e-02 | 2.00 | 10 ms to 20 ms |" in section
    assert "| error of | h = 0.1 |\n|---|---|\n| v | 2.0e-02 |" in section
    assert "| peak | 2.674 | 2.67 | 0.005 |" in section
    for part in ("## A title", "A problem.", "A source.", "The whole case: 3 s"):
        assert part in section
    ax, corner = figure.accuracy_against_time(CASE.curves).axes
    assert ax.get_title() == "A panel"
    assert [text.get_text() for text in corner.get_legend().get_texts()] == ["OpenSees, one run"]
    (line,) = ax.lines
    assert list(line.get_xdata()) == [10.0, 20.0]


def test_times_at_equal_errors():
    """The other's error falls as its time grows; jaxpound's last error is out of its range."""
    curves = [
        Curve("A", OURS, (0.1, 0.01, 1e-4), (0.5, 1.0, 2.0)),
        Curve("A", BATCH, (0.1, 0.01, 1e-4), (0.05, 0.1, 0.2)),
        Curve("A", "peer, one run", (0.4, 0.04, 0.004), (10.0, 100.0, 1000.0)),
        Curve("B", "default scheme", (0.1, 0.01), (1.0, 2.0)),
    ]
    first, second = ratios(curves)
    assert (first.error, second.error) == (0.1, 0.01)
    assert [first.seconds, second.seconds] == pytest.approx([40, 400])
    assert [first.of_run, second.of_run] == pytest.approx([80, 400])
    assert [first.of_batch, second.of_batch] == pytest.approx([800, 4000])
    assert ratios(curves[:1]) == []
    assert ratios([curves[0], curves[2]])[0].of_batch is None
    crowd = Curve("A", "peer, a run of a batch", (0.4, 0.04, 0.004), (1.0, 10.0, 100.0))
    both = ratios([*curves, crowd])
    assert [x.of_batch for x in both] == pytest.approx([80, 400])
    assert [x.of_run for x in both] == pytest.approx([80, 400])


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    """Results and page in another folder; the only case there is ``CASE``."""
    monkeypatch.setattr(page, "RESULTS", tmp_path / "results.json")
    monkeypatch.setattr(page, "DOCS", tmp_path)
    for cases in (page.CASES, command.CASES):
        monkeypatch.setitem(cases, "rods", lambda: CASE)
    return tmp_path


def test_the_command_writes_what_holds(elsewhere, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["verification", "rods"])
    assert command.main() == 0
    (kept,) = page.results().values()
    assert kept.errors == CASE.errors
    assert kept.made.startswith("20")
    assert "## A title" in (elsewhere / "verification.md").read_text(encoding="utf-8")
    assert (elsewhere / "verification.png").stat().st_size > 5000
    assert "order 2.00" in capsys.readouterr().out


def test_the_command_names_what_does_not_hold_and_an_unknown_case(elsewhere, monkeypatch, capsys):
    wrong = Case("A title", "A problem.", "A source.", numbers=(Number("peak", 3.0, 2.0, 0.1),))
    monkeypatch.setitem(command.CASES, "rods", lambda: wrong)
    monkeypatch.setattr("sys.argv", ["verification", "rods"])
    assert command.main() == 1
    assert "FAILS: peak: 3, not 2 ± 0.1" in capsys.readouterr().out
    assert page.results() == {}
    monkeypatch.setattr("sys.argv", ["verification", "beams"])
    with pytest.raises(SystemExit):
        command.main()
    assert "no case beams: there are rods, el_centro" in capsys.readouterr().err
