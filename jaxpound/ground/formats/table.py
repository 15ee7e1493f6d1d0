"""The table of formats, and the components of a file by it."""

from __future__ import annotations

from jaxpound.ground.formats import (
    at2,
    blocks,
    columns,
    cosmos,
    csmip,
    geonet,
    json_events,
    knet,
    smc,
    spreadsheet,
    tables,
)
from jaxpound.ground.formats.layout import Channel
from jaxpound.ground.formats.text import TextFile

LAYOUTS = (
    knet.LAYOUT,
    geonet.LAYOUT,
    csmip.CORRECTED,
    csmip.RAW,
    csmip.BHRC,
    cosmos.LAYOUT,
    smc.LAYOUT,
    tables.SLIST,
    tables.TSPAIR,
    tables.GEOCSV,
    tables.AFAD,
    tables.UNAM,
    tables.CWB,
    tables.ESM,
    at2.LAYOUT,
    tables.COLUMNS,
)


def channels_of(
    file: TextFile, dt: float | None, form: str | None, notes: list[str]
) -> list[Channel]:
    """The components of a file; ``dt`` and ``form``, what its rows are, are those of the user."""
    if json_events.fits(file.lines):
        return json_events.read(file.lines)
    lines = spreadsheet.in_plain_form(file.lines)
    layout = next(layout for layout in LAYOUTS if layout.fits(lines))
    if layout is knet.LAYOUT:
        return [knet.read(lines, notes)]
    if layout.begin:
        return blocks.read(layout, lines)
    return columns.read(layout, lines, dt, form, notes)
