"""What results show of themselves: the same words as text and, well formed, as HTML."""

import dataclasses
import re
from xml.etree import ElementTree

import numpy as np
import pytest

import jaxpound as jp
from jaxpound._tables import TextTable, rounded
from tests.cli.written import tables
from tests.refusals import refused
from tests.study.test_run import LINEAR, study

CELLS = [("a<b", 1234567, "one", "m/s²"), ("longer name", -0.00012345678, "2", "")]
CELLS += [("c", float("nan"), "", "g & more")]
HEADER, NOTES = ("of", "number", "words", ""), ["a note with <b>tags</b>"]
TABLE = TextTable('R & D of <script>alert("1")</script>', HEADER, CELLS, NOTES, digits=4)


def assert_shown(result):
    """Its HTML holds the words of its text, well formed, and leaves all colours to the notebook."""
    html = result._repr_html_()
    tree = ElementTree.fromstring(f"<body>{html}</body>")  # every tag closed, every & escaped
    tags = {part.tag for part in tree.iter()} - {"body"}
    assert tags <= {"div", "table", "thead", "tbody", "tr", "th", "td"}
    assert not re.search(r"colou?r|background|class=|<style", html)
    shown = [part.text for part in tree.iter() if part.text]
    assert "".join("".join(shown).split()) == "".join(repr(result).split())
    return shown


def test_rows_as_text_and_html():
    assert TABLE.text().splitlines() == [
        TABLE.title,
        "    of               number  words",
        "    a<b           1,234,567  one    m/s²",
        "    longer name  -0.0001235  2",
        "    c                   nan         g & more",
        "    a note with <b>tags</b>",
    ]
    html = TABLE.html()
    assert not any(tag in html for tag in ("<script", "<b>"))
    tree = ElementTree.fromstring(html)
    title, note = tree.findall("div")
    assert (title.text, note.text) == (TABLE.title, TABLE.notes[0])
    assert [cell.text or "" for cell in tree.findall("table/thead/tr/th")] == [*TABLE.columns]
    rows = [[cell.text or "" for cell in row] for row in tree.findall("table/tbody/tr")]
    assert rows[0] == ["a<b", "1,234,567", "one", "m/s²"]
    assert [row[0] for row in rows] == [row[0] for row in TABLE.rows]
    sides = [cell.get("style") for cell in tree.findall("table/tbody/tr")[0]]
    assert sides == [f"text-align: {side}" for side in ("left", "right", "left", "left")]
    empty = TextTable("nothing & no one", ("a", "b"))
    assert empty.text() == "nothing & no one"
    assert empty.html() == "<div><div>nothing &amp; no one</div></div>"


def test_a_study_a_fragility_and_their_answers_show_themselves():
    scales = jp.Scales(mass=500e3, frequency=7.0)
    found = study(LINEAR, 64, measures={"<i>my measure": lambda s, g: s.friction})
    for result, units in (
        (found, ("g/ω1²", "m1 g")),
        (dataclasses.replace(found, scales=scales), ("m", "N")),
    ):
        shown = assert_shown(result)
        assert set(units) < set(shown)
        assert "<i>my measure" in shown
        assert f"{result.moments('min_gap').mean:.4g}" in shown
    assert_shown(found.separation(0.1))
    estimate = found.pounding_probability(0.3)
    assert str(estimate) in estimate._repr_html_()
    for trials in ([20] * 5, None):
        pounding = [1, 4, 9, 14, 18] if trials else [0, 1, 0, 1, 1]
        curve = jp.fit_fragility([0.2, 0.4, 0.6, 0.8, 1.0], pounding, trials)
        shown = assert_shown(curve)
        assert f"{curve.median:.4g}" in shown
        assert f"{curve.dispersion_error:.4g}" in shown
        runs, intensities = (100, " at 5 intensities") if trials else (5, "")
        assert f"fitted to {runs} runs{intensities}, {np.sum(pounding)} with pounding" in shown


@pytest.mark.parametrize("mean", [0.0, 0.4])
def test_a_comparison_shows_itself_with_units(mean):
    gaps = mean + np.linspace(-0.1, 0.3, 9)
    before = {"min_gap": gaps, "initial_gap": np.ones(9), "damper_force": np.full(9, 2.0)}
    after = before | {"min_gap": gaps + 0.05}
    for si, units in ((True, ("m", "N")), (False, ("g/ω1²", "m1 g"))):
        found = jp.design.Comparison(before, after, jp.Objective(), si)
        shown = assert_shown(found)
        assert set(units) < set(shown)
        assert f"pounding in {100 * np.mean(gaps <= 0):.4g} % of them before" in "".join(shown)
        assert f"{np.mean(gaps) + 0.05:.4g}" in shown
    chance = jp.Objective(jp.PoundingProbability(0.1))
    assert assert_shown(jp.design.Comparison(before, after, chance, True))[-1][-1] == ")"


ROWS = [("peak |x_1|", "m", 0.1, 2), ("force", "N", 1234567.0, None)]
REPORT = TextTable.of(("demand", "unit", "mean before", "mean after"), ROWS)


def test_a_markdown_table_has_every_cell_under_its_name_and_text_without_a_title_no_indent():
    (rows,) = tables(REPORT.markdown())
    assert rows == [
        {"demand": r"peak \|x_1\|", "unit": "m", "mean before": "0.1", "mean after": "2"},
        {"demand": "force", "unit": "N", "mean before": "1,235,000", "mean after": "-"},
    ]
    assert REPORT.text().splitlines() == [
        "demand      unit  mean before  mean after",
        "peak |x_1|  m             0.1           2",
        "force       N       1,235,000           -",
    ]


def test_rows_are_as_long_as_the_header_and_numbers_are_rounded():
    for row in (("one",), ("one", 2.0, 3.0)):
        refused("table: the cells of a row", TextTable.of, ("words", "number"), [row])
    shown = {None: "-", "worst": "worst", 0: "0", 0.0123456: "0.01235", -9999.4: "-9999"}
    shown |= {12345.6: "12,350", -2e9: "-2,000,000,000", 3e12: "3e+12", float("inf"): "inf"}
    assert {value: rounded(value) for value in shown} == shown
