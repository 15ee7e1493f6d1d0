"""What commands write, as the tests look at it."""

import csv
import json
import re
from pathlib import Path

from matplotlib.image import imread


def is_figure(path: Path) -> bool:
    height, width, _ = imread(path).shape
    return (width, height) == ((2124, 2336) if path.stem == "overview" else (1062, 708))


def summary(folder: Path) -> dict:
    return json.loads((folder / "summary.json").read_text())


def csv_rows(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def tables(page):
    """Every table of a page, as rows of cells by the header's names."""
    every = []
    for table in re.findall(r"(?m)(?:^\| .*\n?)+", page):
        lines = table.splitlines()
        cells = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines]
        header, rule, *body = cells
        assert set(rule) == {"---"}
        every.append([dict(zip(header, row, strict=True)) for row in body])
    return every


def page_of(folder: Path) -> str:
    """The page of a folder; every figure that it shows is there."""
    page = (folder / "summary.md").read_text()
    for name in re.findall(r"\((\w+\.png)\)", page):
        assert imread(folder / name).size
    return page


def number(cell):
    return float(cell.replace(",", ""))
