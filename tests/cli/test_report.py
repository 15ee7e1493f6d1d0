"""Tables of reports: header and rows come from one list."""

import pytest

from jaxpound.cli.report import cell, markdown_table, text_table

ROWS = [
    {"demand": "peak |x_1|", "unit": "m", "mean before": 0.1, "mean after": 2},
    {"demand": "force", "unit": "N", "mean before": 1234567.0, "mean after": None},
]


def tables(page):
    """Every table of a page, as rows of cells by the header's names."""
    found, rows = [], []
    for line in [*page.splitlines(), ""]:
        if line.startswith("| "):
            rows.append([cell.strip() for cell in line.strip("|").split(" | ")])
        elif rows:
            header, rule, *body = rows
            assert set(rule) == {"---"}
            found.append([dict(zip(header, row, strict=True)) for row in body])
            rows = []
    return found


def number(cell):
    return float(cell.replace(",", ""))


def test_a_markdown_table_has_every_cell_under_its_name():
    (rows,) = tables("\n".join(markdown_table(ROWS)))
    assert rows == [
        {"demand": r"peak \|x_1\|", "unit": "m", "mean before": "0.1", "mean after": "2"},
        {"demand": "force", "unit": "N", "mean before": "1,235,000", "mean after": "-"},
    ]


def test_a_table_on_the_screen_is_aligned():
    assert text_table(ROWS) == [
        "demand      unit  mean before  mean after",
        "peak |x_1|  m             0.1           2",
        "force       N       1,235,000           -",
    ]


@pytest.mark.parametrize(
    "rows",
    [
        [],
        [{"mean": 1.0, "tail": 2.0}, {"tail": 2.0, "mean": 1.0}],
        [{"mean": 1.0}, {"mean": 1.0, "tail": 2.0}],
    ],
    ids=["none", "another order", "another cell"],
)
@pytest.mark.parametrize("table", [markdown_table, text_table])
def test_rows_that_part_from_the_header_are_refused(table, rows):
    with pytest.raises(ValueError, match="table: "):
        table(rows)


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (None, "-"),
        ("worst", "worst"),
        (0, "0"),
        (0.0123456, "0.01235"),
        (-9999.4, "-9999"),
        (12345.6, "12,350"),
        (-2e9, "-2,000,000,000"),
        (3e12, "3e+12"),
        (float("inf"), "inf"),
    ],
)
def test_cells(value, shown):
    assert cell(value) == shown
