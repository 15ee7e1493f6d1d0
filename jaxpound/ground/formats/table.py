"""The table of formats, and the components of a file by it.

Sources: Shakal & Huang (1985) for CSMIP, the readers of gmprocess (Hearne et al., 2019).
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from jaxpound.ground.formats import blocks, columns, json_events, knet, numbered, units
from jaxpound.ground.formats.layout import Channel, Layout
from jaxpound.ground.formats.spreadsheet import in_plain_form
from jaxpound.ground.formats.statements import Stated, Statement
from jaxpound.ground.formats.text import NUMBER, MisreadError, OtherKindError, TextFile, TextLine

_FACTOR = re.compile(r"Raw readings in units of (?!1\.0*[ ])(\S+ \S+)", re.I)
_LENGTH = re.compile(rf"#?RecordLength\(sec\): *({NUMBER})", re.I)
_CHANNEL = r"(?:CHAN +\d+:|COMP) *(UP|DOWN|[^\s(]+)"
_TITLE = r" *\d+ +(?:\w+ )?(?:points?|pts)\b"


def _require_factor_1(header: Sequence[TextLine], _stated: Stated) -> None:
    for number, text in header:
        if factor := _FACTOR.match(text):
            raise MisreadError(number, f"units of {factor[1]} must be units of 1.00 mm/s/s")


def _state_length(header: Sequence[TextLine], stated: Stated) -> None:
    """Add the number of samples of a length in s."""
    for number, text in header:
        if (length := _LENGTH.match(text)) and stated.intervals:
            count = round(float(length[1]) / stated.intervals[0].value)
            stated.counts.append(Statement(number, text.strip(), count))


def _state_unit(header: Sequence[TextLine], stated: Stated) -> None:
    """Add the unit in the last cell of the header, which must be one of accelerations."""
    unit = header[0].text.split(",")[-1].strip()
    if name := units.whole_unit(unit):
        units.state(stated.units, name, header[0].number)
    elif unit not in ("", "FLOAT", "INTEGER") and not stated.units:
        raise OtherKindError(header[0].number, f"{unit!r:.60} must be a unit of accelerations")


LAYOUTS = (
    knet.LAYOUT,
    Layout(
        name="GeoNet",
        begin=r"(?:un)?corrected accelerogram \d{8}_\d{6}_",
        component=r"Component +(\S+)",
        unit="mm/s2",
        state=_require_factor_1,
        numbers=((10, 10, 8),),
        form=(10, 8),
        integrals=True,
    ),
    Layout(
        name="CSMIP V2",
        begin="CORRECTED ACCELEROGRAM  ",
        component=_CHANNEL,
        unit="cm/s2",
        title=_TITLE,
        form=(8, 10),
    ),
    Layout(
        name="CSMIP V1 or RENADIC",
        begin="(?:FILE +[0-9]+ OF )?UNCORRECTED ACCELEROGRAM DATA",
        component=_CHANNEL,
        numbers=((7, 16, 5), (7, 8, 10)),
        title=_TITLE,
        form=(8, 9),
        pairs=(10, 7),
    ),
    numbered.COSMOS,
    numbered.SMC,
    *(
        Layout(
            name=name,
            signature=rf"TIMESERIES .*\b{name}",
            begin="TIMESERIES ",
            component=r"TIMESERIES (?:\w*_)?([A-Z]\w[A-Z0-9])_\w,",  # channel and quality
            state=_state_unit,
            pairs=pairs,
        )
        for name, pairs in (("SLIST", None), ("TSPAIR", (2, 0)))
    ),
    Layout(name="GeoCSV", signature="# ?dataset: GeoCSV", component=r"# ?SID: .*?(\w_\w_\w)$"),
    Layout(
        name="AFAD",
        signature="STRONG GROUND MOTION RECORDS OF T",
        component=r"(?:RAW )?PGA VALUES.*?: *\(([^()]+)\)[^()]*\(([^()]+)\)[^()]*\(([^()]+)\)",
        unit="gal",
    ),
    Layout(name="UNAM", signature="ARCHIVO ESTANDAR DE ACELERACION", behind="DATOS DE ACELERACION"),
    Layout(
        name="CWB",
        signature="#(?:Earthquake|Station) ?Information|#StationCode",
        component=r"#DataSequence: *Time *([A-Z])\(\+\); *([A-Z])\(\+\); *([A-Z])\(\+\)",
        state=_state_length,
    ),
    Layout(name="ESM", signature="EVENT_NAME:", component=r"STREAM: *(\S+)", behind="USER5:"),
    numbered.PEER,
    Layout(
        name="columns",
        component=r".*\b(?:component|componente|composante|komponente|canal|channel|orientation|"
        r"dir)\b\.?[^:=]{0,15}[:=]? *(\w[\w-]*)"
        r"|(?=.*(?:acc|acel|beschl|ivme))(?!.*horizontal).*\b(vertic\w*|vertik\w*|düşey)",
    ),
)


def channels_of(
    file: TextFile, dt: float | None, form: str | None, notes: list[str]
) -> list[Channel]:
    """The components of a file; ``dt`` and ``form``, what its rows are, are those of the user."""
    if file.lines[0].text.lstrip()[:1] in ("{", "["):
        return json_events.read(file.lines)
    lines = in_plain_form(file.lines)
    layout = next(layout for layout in LAYOUTS if layout.fits(lines))
    if layout is knet.LAYOUT:
        return [knet.read(lines, notes)]
    if layout.begin:
        return blocks.read(layout, lines)
    return columns.read(layout, lines, dt, form, notes)
