"""Files in the layouts of the networks, of made-up stations: each is written from printed numbers.

The layouts are those of public descriptions and files: GeoNet's "Strong Motion Data Formats";
Shakal & Huang, OSMS 85-03 (V1, V2); "COSMOS strong motion data format" 1.20; the USGS's SMC; "DYNA
1.2" of ESM and ITACA; AFAD's TR-NSMN; "Archivo Estandar de Aceleracion" 2.0 of UNAM; CWB's
free-field text; NIED's K-NET and KiK-net; ASCII and GeoCSV of the FDSN's time-series service;
eqsig; SimCenter.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tests.ground.files import knet_text

DT, N = 0.02, 123  # no multiple of the numbers a row of any layout
GAL, MM, MS2 = 1 / 980.665, 1 / 9806.65, 1 / 9.80665  # in g
Printed = Sequence[str]


def motion(k: int, n: int = N) -> np.ndarray:
    """Component k in g, whose samples differ from each other and have a mean of 0."""
    steps = np.arange(n)
    shaking = np.sin(steps / (5 + k) + 0.3) * (0.05 + 0.15 * np.exp(-steps / n)) * (1 - 0.2 * k)
    return shaking - shaking.mean()


def rows_of(numbers: Printed, per_row: int, separator: str = "") -> str:
    rows = (numbers[at : at + per_row] for at in range(0, len(numbers), per_row))
    return "".join(separator.join(row) + "\n" for row in rows)


def lines(*texts: str) -> str:
    return "".join(text + "\n" for text in texts)


def geonet(components, dt, names, *, corrected=True, integrals=True, width=8):
    text, kind = "", "Corrected" if corrected else "Uncorrected"
    for numbers, name in zip(components, names, strict=False):
        n = len(numbers)
        text += lines(
            f"{kind} accelerogram 20300101_000000_XXXX_20 Example Network",
            "Site XXXX      42 37 10S  173 03 13E     Cusp file:  20300101_000000_XXXX",
            *("Example Farm", "Instrument Cusp_1"),
            "Resolution: 18-bit   Instr Period: 0.0050 s   Damping: 0.700",
            "Accelerogram 20300101_000000_XXXX_20                 Processed 2030 January 09",
            *("5 km south-west of Example", "2030 January 01          00:00:00 UT"),
            "Epicentre  42 41 33S 173 01 19E  Bearing S18W  Dist    9km  Depth   15km Mw 7.00",
            f"Number of points {n:5d}    Duration {n * dt:6.2f} sec",
            f"Instrument corrected data at {dt:.3f} sec intervals"
            if corrected
            else f"Raw readings in units of 1.00 mm/s/s  at intervals of {dt:.3f} s",
            "Band-pass filter transition bands are .10-.25 Hz and 24.50-25.50 Hz",
            f"Component {name}",
            "Acceleration:  peak  -1957.0 mm/s/s at   6.08 sec     rms    548.9 mm/s/s",
            "Velocity:      peak   282.54 mm/s   at   6.58 sec     rms    79.31 mm/s",
            "Displacement:  peak   41.716 mm     at   6.36 sec     rms   11.586 mm",
        )
        text += rows_of([f"{x:8d}" for x in [2030, 1, 1, 0, 0, n, n, n, 2, 20000] * 4], 10)
        text += rows_of([f"{x:8.2f}" for x in [200, 0.7, -42.6, 173.1, dt, 9.8] * 10], 10)
        text += rows_of(numbers, 10)
        if integrals:
            text += rows_of([f"{(k % 17) / 9:{width}.2f}" for k in range(n)], 10)
            text += rows_of([f"{(k % 13) / 70:{width}.3f}" for k in range(n)], 10)
    return text


def _degrees(name):
    return f"{name} Deg" if name.isdigit() else name


CHANNEL_ENDS = "/&  ----------  End of data for channel {}  ----------"


def csmip_v2(components, dt, names):
    text = ""
    for k, (numbers, name) in enumerate(zip(components, names, strict=False), 1):
        n, chan = len(numbers), f"Chan  {k}: {_degrees(name)}"
        title = f"{n:6d} points of {{}} data equally spaced at {dt:6.3f} sec, in {{}}. (8f10.5)"
        text += lines(
            f"Corrected accelerogram   00000-X0001-30001.01       {chan}     from",
            "Uncorrected Accelerogram Data             Processed: 01/01/30, XXX  exa1",
            "Rcrd of Tue Jan 01, 2030 00:00:00.0 PDT               (Avol1 v0.6, 3/14 CSMIP)",
            "                                        (Origin:  To be determined)",
            "00000-X0001-30001.01          Start time:  1/01/30, 00:00:00.0 UTC (GPS)",
            "Station No. 00001   34.009N, 117.951W   Etna2   s/n 1000  (3 Chns of  3 at Sta)",
            f"Example Heights                          XXXX   Data: Acceleration\n{chan}",
            "Rcrd of Tue Jan 01, 2030 00:00:00.0 PDT    Tue Jan 01, 2030 00:00:00.0 PDT",
            "Hypocenter:  To be determined.               ML:  To be determined.",
            "Instr Period =  .0050 sec,  Damping =  .707,  Sensitivity = 5.00 v/g  (Nominal)",
            f"                        Record length = {n * dt:.3f} sec.",
            "                                     Uncor Max  =   .200 g , at   6.000 sec.",
            "RMS accel of (uncor) record  =        .   Chn. metadata effective date:",
            "Accelerogram bandpass filtered with 3 dB pts at   .10 and 23.00 cyc/sec",
            f"{n:6d} points of instrument- and baseline-corrected accel, veloc and displ data",
            f"At equally-spaced intervals of {dt:7.3f}  sec.",
            "Peak acceleration =   -195.700    cm/sec/sec  at    6.080   sec.",
            "Peak   velocity   =    -6.863      cm/sec    at   14.680   sec.",
            "Peak displacement =     -.836        cm      at   17.580   sec.",
            "Initial velocity  =      .000   cm/sec;   Initial displacement =    -.003   cm",
        )
        text += rows_of([f"{x:5d}" for x in [1, 100, 20200, -999, -999] * 20], 16)
        text += rows_of([f"{x:10.5f}" for x in [0.005, -999.0, 1000.5, -999.0] * 25], 8)
        text += title.format("accel", "cm/sec2") + "\n" + rows_of(numbers, 8)
        for quantity, unit in (("veloc", "cm/sec"), ("displ", "cm")):
            text += title.format(quantity, unit) + "\n"
            text += rows_of([f"{(j % 19) / 9 - 1:10.5f}" for j in range(n)], 8)
        text += CHANNEL_ENDS.format(k) + "\n"
    return text


def csmip_v1(components, dt, names, *, pairs=False, rate=True):
    text = ""
    for k, (numbers, name) in enumerate(zip(components, names, strict=False), 1):
        n = len(numbers)
        text += lines(
            "UNCORRECTED ACCELEROGRAM DATA              PROCESSED: 06/30/2030, XXX 00001",
            *("EXAMPLE EARTHQUAKE", "JANUARY 1, 2030 08:05 PDT               (ORIGIN: 01/01/30)"),
            "00001-E0001-30001.06               TRIGGER TIME: 01/01/30, 15:05:37.4 UTC",
            "STATION NO. 00001   34.405N, 117.311W     SSA-1  S/N 0001",
            *("EXAMPLE - 4TH & OAK", f"CHAN  {k}: {_degrees(name).upper()}", "EJEMPLO - EXAMPLE"),
            "HYPOCENTER: 34.201N,116.826W, H=7KM.     MS=6.6, MW=6.4",
            "INSTR PERIOD =  .0186 SEC,  DAMPING =  .660,  SENSITIVITY = 1.26  V/G.",
            f"NO. OF POINTS = {n:6d}  RECORD LENGTH = {n * dt:.3f} SEC"
            + rate * f"   AT {1 / dt:.0f} SAMPLES/SEC",
            f"UNITS OF UNCOR ACCEL {'ARE SEC AND G/10' if pairs else 'IS G'}."
            "                 MAX  =   .058 G, AT   9.425 SEC.",
            "RMS ACCEL OF COMPLETE RECORD =  .008 G.",
        )
        text += rows_of([f"{x:5d}" for x in [1, 1, 12001, 0, 2048] * 20], 16)
        text += rows_of([f"{x:10.3f}" for x in [0.019, 0.66, n * dt, 0.1, 53.7] * 10], 8)
        if pairs:
            timed = [x for j, a in enumerate(numbers) for x in (f"{j * dt:7.3f}", a)]
            text += rows_of(timed, 10)
        else:
            text += f"{n:5d} POINTS OF ACCEL DATA EQUALLY SPACED AT {dt:.3f} SEC.  (UNITS: G)\n"
            text += rows_of(numbers, 8)
        text += CHANNEL_ENDS.format(k).upper() + "\n"
    return text


def cosmos(components, dt, names, *, form="8F10.5", kind="Corrected", in_ms=False):
    text, per_row = "", int(form[: form.index("F" if "F" in form else "E")])
    reals = [-999.0] * 100
    reals[61 if in_ms else 33] = 1000 * dt if in_ms else dt
    reals[33 if not in_ms else 0] = dt if not in_ms else 34.046
    for k, (numbers, name) in enumerate(zip(components, names, strict=False), 1):
        n = len(numbers)
        text += lines(
            f"{kind} acceleration    (Format v01.20 with 13 text lines) Src: example.txt",
            "Somewhere                               Jan  1,2030 00:00 PDT",
            "Hypocenter: 34.0580  -117.0110  H= 12km(XXXX) ML=4.9, Mw=4.8(XXX)",
            "Origin: 01/01/2030, 00:00:26.1 UTC (XXXX)",
            "Statn No: 01-00001  Code:XX-J0000  Example - A & B",
            "Coords: 34.0460 -117.0350  Site Geology:  geology description here",
            "Recorder: SSA-2  s/n 1000 ( 1 Chns of 12  at Sta) Sensor:FBA-11  s/n 1000",
            "Rcrd start time:01/01/2030, 00:00:04.400 UTC (Q=2) RcrdId: 00001",
            f"Sta Cha: {k}: {_degrees(name).lower()} (Rcrdr Chan  1) Location: roof",
            f"Raw record length = {n * dt:.3f}  sec, Uncor max =   -.200 g  at    6.000 sec",
            "Processed: 01/02/2030, 12:01:00 PDT      Max =   -195.700 cm/sec2  at   6.000 sec",
            "Record filtered below 0.30  Hz (periods over  14.5 secs), and above 40.0 Hz",
            "Values used when parameter or data value is unknown/unspecified:   -999, -999.0",
            " 100 Integer-header values follow on  10 lines, Format= (10I8)",
        )
        text += rows_of([f"{x:8d}" for x in [2, 1, 4, 120, -999] * 20], 10)
        text += " 100 Real-header values follow on  17 lines, Format= (6F13.6)\n"
        text += rows_of([f"{x:13.6f}" for x in reals], 6)
        text += lines(
            '  2 Comment line(s) follow, each starting with a "|":', " | comment", " | comment"
        )
        title = f"acceleration pts, approx {n * dt:4.0f} secs, units=cm/sec2(04),Format=({form})"
        text += f"{n:7d}  {title}\n" + rows_of(numbers, per_row)
        text += f"End-of-data for chan   {k}  acceleration\n"
    return text


def smc(components, dt, names, *, kind="2 CORRECTED ACCELEROGRAM"):
    (numbers,), missing = components, -32768
    integers, reals = [missing] * 48, [1.7e38] * 50
    integers[1:4], integers[16], reals[1:4] = [2030, 1, 0], len(numbers), [1 / dt, 37.0, -121.0]
    text = lines(
        *(kind, "*", "EXA0A", "     2030  01  01    0004 Example, XX"),
        "Moment Mag=      7.1 Ms=      7.1 Ml=      7.0",
        f"station = Example, 1 Street             component=  {names[0]:>5}",
        "epicentral dist =     89.0       pk     =    195.7",
        *("inst type=SMA-1      data source = XXXX", "*", "*", "*"),
    )
    text += rows_of([f"{x:10d}" for x in integers], 8)
    text += rows_of([f"{x:15.7E}" for x in reals], 5)
    return text + lines("|", "|ref - example", "|") + rows_of(numbers, 8)


def of_smc(value: float) -> str:
    """A number of ten characters: `` 3.5766E-3``."""
    return f"{value: .4E}".replace("E-0", "E-").replace("E+0", "E+")


def esm(components, dt, names, *, data_type="ACCELERATION", unit="cm/s^2"):
    fields = {"EVENT_NAME": "EXAMPLE", "EVENT_ID": "XXXX-20300101_0000001", "MAGNITUDE_W": ""}
    fields |= {"STATION_CODE": "EX01", "STATION_ELEVATION_M": "34", "VS30_M/S": "350"}
    fields |= {"SAMPLING_INTERVAL_S": f"{dt:.6f}", "NDATA": f"{len(components[0])}"}
    fields |= {"DURATION_S": f"{len(components[0]) * dt:.3f}", "STREAM": names[0], "UNITS": unit}
    fields |= {"INSTRUMENT": "sensor = X [Unknown] | digitizer = Unknown [Unknown]"}
    fields |= {"FULL_SCALE_G": "2", "N_BIT_DIGITAL_CONVERTER": "24", "PGA_CM/S^2": "195.700150"}
    fields |= {"TIME_PGA_S": "6.0", "FILTER_TYPE": "BUTTERWORTH", "LOW_CUT_FREQUENCY_HZ": "0.100"}
    fields |= {"HEADER_FORMAT": "DYNA 1.2", "DATA_TYPE": data_type}
    fields |= {f"USER{k}": "" for k in range(1, 6)}
    return lines(*(f"{name}: {value}" for name, value in fields.items())) + rows_of(
        components[0], 1
    )


def across(components, separator=""):
    """Rows of the components side by side."""
    return lines(*(separator.join(row) for row in zip(*components, strict=True)))


def afad(components, dt, names):
    peaks = " ".join(f"({name}) 195.70015" for name in names)
    fields = {"PLACE": "EXAMPLE", "EARTHQUAKE DATE": "2030/01/01 00:00:00 (GMT)"}
    fields |= {"EPICENTER COORDINATES": "36.91980N-27.44350E", "EARTHQUAKE DEPTH (km)": "19.44"}
    fields |= {"EARTHQUAKE MAGNITUDE": "6.5 Mw", "STATION ID": "0001", "STATION ALTITUDE (m)": "66"}
    fields |= {"RECORDER SERIAL NO": "1", "RECORD TIME": "01/01/2030 00:00:00.000000 (GMT)"}
    fields |= {"NUMBER OF DATA": f"{len(components[0])}", "SAMPLING INTERVAL (sec)": f"{dt}"}
    fields |= {"RAW PGA VALUES (gal)": peaks}
    return lines(
        "STRONG GROUND MOTION RECORDS OF TURKIYE",
        *(f"{name:24s}: {value}" for name, value in fields.items()),
        *("Copyright EARTHQUAKE DEPARTMENT", "DISASTER AND EMERGENCY MANAGEMENT PRESIDENCY"),
        "".join(f"{name:>13s}" for name in names),
    ) + across(components)


def unam(components, dt, names):
    def of_each(value: object) -> str:
        return f"/{value}" * len(names)

    rule = "---------+" * 8
    fields = {"VERSION DEL FORMATO": "2.0", "NOMBRE DEL ARCHIVO": "EXAM3001.011"}
    fields |= {"NUMERO DE CANALES": f"{len(names)}"}
    fields |= {"ORIENTACION C1-C6 (rumbo;orientacion)": "/" + "/".join(names)}
    fields |= {"VEL. DE MUESTREO, C1-C6 (muestras/s)": of_each(f"{1 / dt:g}")}
    fields |= {"ESC. COMPLETA DE SENSORES, C1-C6, (g)": of_each(2)}
    fields |= {"INTERVALO DE MUESTREO, C1-C6 (s)": of_each(dt)}
    fields |= {"UMBRAL DE DISPARO, C1-C6 (Gal)": of_each(0.5)}
    fields |= {"DURACION DEL REGISTRO (s), C1-C6": of_each(f"{len(components[0]) * dt:.2f}")}
    fields |= {"NUM. TOTAL DE MUESTRAS, C1-C6": of_each(len(components[0]))}
    fields |= {"ACEL. MAX.(Gal), C1-C6": of_each(195.7), "UNIDADES DE LOS DATOS": "Gal (cm/s/s)"}
    fields |= {"FACTOR DE DECIMACION": "1", "FORMATO DATOS (FORTRAN,10 campos/dato)": "3F10.4"}
    return lines(
        *("*" * 49, "                       INSTITUTO DE EJEMPLO", "*" * 49),
        "ARCHIVO ESTANDAR DE ACELERACION:",
        *(f"{name:39s}: {value}" for name, value in fields.items()),
        *("=" * 80, "DATOS DE ACELERACION:", rule),
        "".join(f"   CANAL-{k}" for k in range(1, len(names) + 1)),
        "".join(f"{name:>10s}" for name in names),
        rule,
    ) + across(components)


def cwb(components, dt, names):
    n = len(components[0])
    header = lines(
        *("#Earthquake Information", "#Origin Time(GMT+08): 2030/01/01-00:00:42", "#Depth(km): 10"),
        *("", "#Station Information", "#StationCode: EXA", "#InstrumentKind: FBA"),
        *(f"#RecordLength(sec): {n * dt:g}", f"#SampleRate(Hz): {1 / dt:g}"),
        *("#AmplitudeUnit:  gal. DCoffset(corr)", "#AmplitudeMAX. U:    0.658~   -0.837"),
        "#DataSequence: Time " + "; ".join(f"{name}(+)" for name in names),
        f"#Data: {1 + len(names)}F10.3 ",
    )
    return header + across([[f"{k * dt:10.3f}" for k in range(n)], *components])


def knet(components, dt, names):
    direction = {"surface": "5"}.get(names[0], names[0])
    changed = {"Dir.": direction, "Duration Time(s)": f"{len(components[0]) * dt:g}"}
    return knet_text([*map(int, components[0])], rate=round(1 / dt), **changed)


def stamps(n, dt):
    micro = np.datetime64("2030-01-01T00:00:00", "us") + np.arange(n) * round(1e6 * dt)
    return np.datetime_as_string(micro, "us").tolist()


def fdsn(components, dt, names, *, form="SLIST", unit="M/S**2"):
    text = ""
    for numbers, name in zip(components, names, strict=False):
        n = len(numbers)
        text += f"TIMESERIES XX_EXA_00_{name}_M, {n} samples, {1 / dt:g} sps, {stamps(1, dt)[0]}"
        text += f", {form}, FLOAT, {unit}\n"
        if form == "SLIST":
            text += rows_of([f"{number}\t" for number in numbers], 6)
        else:
            text += across([stamps(n, dt), numbers], "  ")
    return text


def geocsv(components, dt, names):
    n = len(components[0])
    rows = zip(stamps(n, dt), components[0], strict=True)
    return lines(
        *("# dataset: GeoCSV 2.0", "# delimiter: ,", f"# SID: XX_EXA_00_{names[0]}"),
        *(f"# sample_count: {n}", f"# sample_rate_hz: {1 / dt:g}", "# field_unit: UTC, M/S**2"),
        *("# field_type: datetime, FLOAT", "Time, Sample"),
        *(f"{time}Z, {number.strip()}" for time, number in rows),
    )


def eqsig(components, dt, names):
    return f"m1\n{len(components[0])} {dt:.4f}\n" + rows_of(components[0], 1)


def _json(tree, components):
    """JSON with the components for 0, 1, ... in their lists, a number a line."""
    text = json.dumps(tree)
    for k, numbers in enumerate(components):
        text = text.replace(f"[{k}]", "[\n" + ",\n".join(x.strip() for x in numbers) + "\n]")
    return text + "\n"


def simcenter(components, dt, names):
    tree = {"name": "EXA1", "dT": dt, "numPoints": len(components[0]), "units": "g"}
    return _json(tree | {f"data_{name}": [k] for k, name in enumerate(names)}, components)


def event(components, dt, names):
    series = [
        {"name": name, "type": "Value", "dT": dt, "data": [k]} for k, name in enumerate(names)
    ]
    pattern = [
        {"type": "UniformAcceleration", "timeSeries": name, "dof": 1 + "xyz".index(name[-1])}
        for name in names
    ]
    inside = {"name": "EXA1", "type": "Seismic", "dT": dt, "numSteps": len(components[0])}
    inside |= {"units": {"acceleration": "g"}, "timeSeries": series, "pattern": pattern}
    return _json({"Events": [inside]}, components)


@dataclass(frozen=True)
class Network:
    """A layout: its writer, how it prints a number of its unit (in g), and its components."""

    write: Callable[..., str]
    form: Callable[[float], str]
    unit: float
    names: tuple[str, ...]
    extension: str
    fixed: bool = False  # whether the reader knows the width of numbers
    counts: bool = False  # whole numbers with an offset

    def printed(self, n: int = N) -> list[list[str]]:
        motions = [motion(k, n) / self.unit for k in range(len(self.names))]
        if self.counts:
            motions = [np.round(samples + 7000).astype(int) for samples in motions]
        return [list(map(self.form, samples.tolist())) for samples in motions]

    def samples(self, numbers: Printed) -> np.ndarray:
        """What reading printed numbers must give, in g."""
        values = np.array([float(number) for number in numbers])
        return (values - values.mean() * self.counts) * self.unit

    def text(self, printed: Sequence[Printed], dt: float = DT, **options: object) -> str:
        return self.write(printed, dt, self.names[: len(printed)], **options)


def _with(writer, **options):
    return lambda components, dt, names, **more: writer(components, dt, names, **(options | more))


F10_5, E15_6, E14_7, F9_6 = "{:10.5f}".format, "{:15.6E}".format, "{: .7e}".format, "{:9.6f}".format
THREE, PER_COUNT = ("N28W", "N62E", "Up"), 7845 / 8223790 * GAL
NETWORKS = {
    "GeoNet V2A": Network(geonet, "{:8.1f}".format, MM, THREE, ".V2A", fixed=True),
    "GeoNet V1A": Network(
        _with(geonet, corrected=False, integrals=False), "{:8.1f}".format, MM, THREE, ".V1A", True
    ),
    "CSMIP V2": Network(csmip_v2, F10_5, GAL, ("90", "180", "Up"), ".V2", fixed=True),
    "CSMIP V1": Network(csmip_v1, F9_6, 1.0, ("90", "0", "UP"), ".V1", fixed=True),
    "RENADIC": Network(
        _with(csmip_v1, pairs=True, rate=False), "{:7.3f}".format, 0.1, ("L", "T", "V"), ".v1", True
    ),
    "COSMOS V2c": Network(cosmos, F10_5, GAL, ("340", "70", "up"), ".V2c", fixed=True),
    "COSMOS V1c": Network(
        _with(cosmos, form="1E15.6", kind="Uncorrected", in_ms=True),
        *(E15_6, GAL, ("340", "70", "up"), ".V1c", True),
    ),
    "SMC": Network(smc, of_smc, GAL, ("360",), ".smc", fixed=True),
    "ESM": Network(esm, "{:.6f}".format, GAL, ("HNE",), ".ASC"),
    "AFAD": Network(afad, "{:13.6f}".format, GAL, ("N-S", "E-W", "U-D"), ".txt"),
    "UNAM": Network(unam, "{:10.4f}".format, GAL, ("N00E", "N90E", "V"), ".011"),
    "CWB": Network(cwb, "{:10.3f}".format, GAL, ("N", "E", "U"), ".dat"),
    "K-NET": Network(knet, "{:d}".format, PER_COUNT, ("E-W",), ".EW", counts=True),
    "KiK-net": Network(knet, "{:d}".format, PER_COUNT, ("surface",), ".EW2", counts=True),
    "SLIST": Network(fdsn, E14_7, MS2, ("HNE", "HNN", "HNZ"), ".txt"),
    "TSPAIR": Network(_with(fdsn, form="TSPAIR"), E14_7, MS2, ("HNE", "HNN", "HNZ"), ".txt"),
    "GeoCSV": Network(geocsv, E14_7, MS2, ("H_N_E",), ".csv"),
    "eqsig": Network(eqsig, "{:.6f}".format, 1.0, ("",), ".txt"),
    "SimCenter": Network(simcenter, "{:.8f}".format, 1.0, ("x", "y", "z"), ".json"),
    "SimCenter event": Network(event, "{:.8f}".format, 1.0, ("accel_x", "accel_y"), ".json"),
}


def sheet(separator=",", header="time (s),acceleration (m/s2)", cell="{}", row=None):
    """Two columns as a spreadsheet exports them, of the values of ``SHEET``."""
    row = row or (lambda k, number: [f"{k * DT:.2f}", number])
    cells = ([cell.format(x) for x in row(k, number)] for k, number in enumerate(SHEET))
    return lines(header.replace(",", separator), *map(separator.join, cells))


def with_comma(text):
    return text.replace(".", ",")


def _stamped(form):
    def row(k, number):
        return [form.format(f"{k * DT:06.3f}"), number]

    return row


SHEET = [f"{10 * x:.4f}" for x in motion(0)]
_GERMAN, _ITALIAN = "Zeit [s];Beschleunigung [m/s²]", "tempo (s);accelerazione (m/s^2)"
SHEETS = {
    "commas": sheet(),
    "semicolons": sheet(";"),
    "tabs": sheet("\t"),
    "byte order mark": b"\xef\xbb\xbf" + sheet().encode(),
    "UTF-16": sheet("\t").encode("utf-16"),
    "sep=": "sep=;\n" + sheet(";"),
    "quotes": sheet(header='"time (s)","acceleration (m/s2)"', cell='"{}"'),
    "decimal commas": with_comma(sheet(";", _GERMAN)),
    "decimal commas, tabs": with_comma(sheet("\t", _GERMAN.replace(";", "\t"))),
    "quoted decimal commas": with_comma(sheet(";", _GERMAN, cell='"{}"')),
    "quoted decimal commas between commas": '"t (s)","acc (m/s2)"\n'
    + with_comma(sheet(";", "", cell='"{}"')).replace(";", ",").lstrip("\n"),
    "Spanish": with_comma(sheet(";", "Tiempo (s);Aceleración (m/s2)")),
    "Italian": with_comma(sheet(";", _ITALIAN)),
    "Turkish": with_comma(sheet(";", "Zaman (s);İvme (m/s2)")),
    "French, Latin-1": with_comma(sheet(";", "Temps (s);Accélération (m/s2)")).encode("latin-1"),
    "date and time": sheet(header="timestamp,acc_ms2", row=_stamped("2030-01-01 00:00:{}")),
    "date, time": sheet(header="date,time,acc_ms2", row=_stamped("2030-01-01,00:00:{}")),
    "German date": with_comma(sheet(";", _GERMAN, row=_stamped("31.01.2030 00:00:{}"))).replace(
        "31,01,2030", "31.01.2030"
    ),
    "index": sheet(header=",time (s),acc (m/s2)", row=lambda k, x: [f"{k}", f"{k * DT:.2f}", x]),
}
