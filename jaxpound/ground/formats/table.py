"""The table of formats, and the components of a file by it.

PEER's AT2, COSMOS V1.20 and SMC keep count or interval among numbers of the header.

Sources: Shakal & Huang (1985) for CSMIP, the readers of gmprocess (Hearne et al., 2019), "COSMOS
strong motion data format, version 1.20" (2001), the USGS's description of SMC.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from jaxpound.ground.formats import blocks, columns, json_events, knet, rows, units
from jaxpound.ground.formats.layout import Channel, Layout
from jaxpound.ground.formats.spreadsheet import in_plain_form
from jaxpound.ground.formats.statements import Stated, Statement, interval, rate, state_numbers
from jaxpound.ground.formats.text import (
    NUMBER,
    MisreadError,
    OtherKindError,
    TextFile,
    TextLine,
    plain,
    shown,
)

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


_PEER_LINE = re.compile(r"(?!\s*(?:#|%|//))(?=.*\bDT\b).*\bNPTS\b", re.I)
_NUMBERS_FIRST = re.compile(rf"\s*({NUMBER})[ ,]{{1,3}}({NUMBER})[ ,]{{1,3}}NPTS,? ?DT(.*)", re.I)


def _state_peer(header: Sequence[TextLine], stated: Stated) -> None:
    """Replace what the header states by what the line of NPTS and DT does."""
    number, text = next(line for line in header if _PEER_LINE.match(line.text))
    in_order = _NUMBERS_FIRST.sub(r"NPTS = \1, DT = \2 \3", plain(text))
    stated.counts.clear()
    stated.intervals.clear()
    state_numbers([TextLine(number, in_order)], stated)
    if not (stated.counts and stated.intervals):
        rule = "must state NPTS, a positive whole number, and DT > 0, in s or ms"
        raise MisreadError(number, f"{shown(text.strip())} {rule}")


_COSMOS_REALS = re.compile(
    r" *\d+ +Real-header values follow on +(\d+) lines, Format *= *\((\d+)[FE](\d+)", re.I
)
_OF_RECORDER, _OF_SERIES = 33, 61  # indices of intervals in the real header: in s, and in ms
_APPROXIMATE = re.compile(rf"pts, approx +({NUMBER}) +secs?", re.I)


def _state_cosmos(header: Sequence[TextLine], stated: Stated) -> None:
    """Add the interval of the real header that agrees with the number of values in the title."""
    titles = (i for i, line in enumerate(header) if _COSMOS_REALS.match(line.text))
    if (at := next(titles, None)) is None:
        return
    title = _COSMOS_REALS.match(header[at].text)
    n_lines, *form = (int(number) for number in title.groups())  # type: ignore[union-attr]
    block = header[at + 1 : at + 1 + n_lines]
    reals = rows.numbers_of(block, (form[0], form[1]))
    duration = _APPROXIMATE.search(header[-1].text)
    for index, unit in ((_OF_SERIES, 1e-3), (_OF_RECORDER, 1.0)):
        if index < len(reals) and float(reals[index]) > 0:
            statement = interval(block[0].number, "the real header", reals[index], unit)
            length, most = statement.value * stated.counts[-1].value, 1 + 2 * statement.value
            if duration is None or abs(length - float(duration[1])) <= most:
                stated.intervals.append(statement)
                return


_INTEGERS, _REALS = (6, 8, 10), (10, 5, 15)  # rows, values a row, characters of each
_COUNT, _RATE, _UNDEFINED = 16, 1, 0  # indices


def _state_smc(header: Sequence[TextLine], stated: Stated) -> None:
    lines = [line for line in header if not line.text.startswith("|")]
    integers, reals = lines[-16:-10], lines[-10:]
    counts, numbers = rows.numbers_of(integers, _INTEGERS[1:]), rows.numbers_of(reals, _REALS[1:])
    if (len(counts), len(numbers)) != (48, 50) or not float(counts[_COUNT]) > 0:
        rule = "48 and 50 numbers, one of which is that of the values"
        raise MisreadError(header[0].number, f"the header of SMC must have {rule}")
    if float(numbers[_RATE]) == float(numbers[_UNDEFINED]) or not float(numbers[_RATE]) > 0:
        rule = "is undefined, as of values at uneven times, which must be resampled first"
        raise MisreadError(reals[0].number, f"sampling rate = {numbers[_RATE]} {rule}")
    stated.counts[:] = [Statement(integers[2].number, "the integer header", float(counts[_COUNT]))]
    stated.intervals.append(rate(reals[0].number, "the real header", f"{float(numbers[_RATE]):g}"))


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
    Layout(
        name="COSMOS V1.20",
        begin=r".*\(Format v0?1\.\d+",
        component=r"Sta Cha[n:] *(?:\S+ *:|\S+:) *([^(]+?)(?: deg)? *(?:\(|$)",
        state=_state_cosmos,
        title=r" *\d+ +\S.*?\bpts, approx",
    ),
    Layout(
        name="SMC",
        begin=r"[12] (?:un)?corrected accelerogram",
        component=r".*\bcomponent= *(\S+)",
        unit="cm/s2",
        state=_state_smc,
        numbers=(_INTEGERS, _REALS),
        form=(8, 10),
    ),
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
    Layout(
        name="PEER AT2",
        signature=_PEER_LINE.pattern,
        component=r"(?!.*NPTS)[^,]*,[^,]*,.*?([^,(\s][^,(]{0,11}?) *(?:\([^()]*\) *)?$",
        state=_state_peer,
        behind=_PEER_LINE.pattern,
        history=True,
    ),
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
