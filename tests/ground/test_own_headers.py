"""Headers that people write themselves, in the languages of the networks."""

import json

import numpy as np
import pytest

from jaxpound._errors import PlausibilityWarning
from jaxpound.ground.formats.text import OtherKindError
from jaxpound.ground.reader import read_record
from tests.ground.files import assert_refuses

G, N, DT = 9.80665, 400, 0.02
TIME = DT * np.arange(N)
MOTION = 0.2 * np.sin(3 * TIME) * np.exp(-(((TIME - 4) / 1.5) ** 2))
MOTION -= MOTION.mean()


def column(factor=1.0):
    return "".join(f"{x:.6f}\n" for x in factor * MOTION)


def table(*columns, separator=";"):
    return "".join(
        separator.join(f"{x:.6f}" for x in row) + "\n" for row in zip(*columns, strict=True)
    )


def assert_is_motion(record, rtol=1e-4):
    np.testing.assert_allclose(record.samples, MOTION, atol=rtol * 0.2 + 1e-6)
    assert record.dt == pytest.approx(DT)


COUNTS = ["N = {}", "Samples: {}", "Number of readings: {}", "Cantidad de datos: {}", "{} points"]
COUNTS += ["Anzahl Messpunkte: {}", "Nombre d'échantillons : {}", "Nokta sayısı: {}", "npts {}"]
COUNTS += ["Number of samples per channel: {}", "Numero punti: {}", "Anzahl der Werte: {}"]


@pytest.mark.parametrize("words", COUNTS)
def test_a_number_of_values_in_prose_is_checked(write, words):
    assert_is_motion(read_record(write(words.format(N) + "\n" + column()), dt=DT, units="g"))
    path = write(words.format(450) + "\n" + column())
    assert_refuses(
        path, 1, "truncated: .*450.* must be the number of values, 400", dt=DT, units="g"
    )


INTERVALS = ["Sampling: 50 Hz", "fs = 50", "sampled at 50 Hz", "sampled every 0.02 s", "50 sps"]
INTERVALS += ["Interval: 0.02 s", "0.02 sec time step", "50 muestras por segundo", "dt = 20 ms"]
INTERVALS += ["Zeitschritt: 0,02 s", "Örnekleme aralığı (sn): 0.02", "Passo temporale: 0,02 s"]


@pytest.mark.parametrize("words", INTERVALS)
def test_an_interval_in_prose_is_taken_and_checked(write, words):
    path = write(words + "\n" + column())
    assert_is_motion(read_record(path, units="g"))
    assert_refuses(path, 1, "dt = 0.01 must agree with the file's own, 0.02", dt=0.01, units="g")


LEVELS = ["Aceleración máxima (g): 0.2", "Ölçüm aralığı (g): 2", "Auslöseschwelle [g]: 0.01"]
LEVELS += ["Offset (g): 0.001", "Design acceleration (g): 0.4", "Trig. thr. [g] .01"]


@pytest.mark.parametrize("words", LEVELS)
def test_the_unit_of_a_stated_value_is_not_that_of_the_data(write, words):
    assert_is_motion(read_record(write(f"{words}\nUnits: gal\n{column(100 * G)}"), dt=DT))
    path = write(f"{words}\n{column(G)}")
    with pytest.warns(PlausibilityWarning, match="no unit is stated"):
        read_record(path, dt=DT)
    assert_is_motion(read_record(path, dt=DT, units="m/s2"))


UNITS = ["gal", "Units - gal", "Aceleración en cm/s2", "İvme (cm/sn2)", "Unità: cm/s²"]


@pytest.mark.parametrize("words", UNITS)
def test_the_unit_of_the_data_is_known_in_many_words(write, words):
    assert_is_motion(read_record(write(f"{words}\n{column(100 * G)}"), dt=DT))


VERTICALS = ["Component: UP", "Componente: Vertical", "Channel: HNZ", "Vertical acceleration (g)"]
VERTICALS += ["Aceleración vertical (g)", "# Estacion: AP01 Componente: HNZ", "Dir. U-D"]


@pytest.mark.parametrize("words", VERTICALS)
def test_a_vertical_in_a_users_header_is_refused_with_a_word(write, words):
    path = write(f"{words}\n{column()}")
    assert_refuses(path, None, r"is a vertical component \(.*\): pass vertical=True", dt=DT)
    assert_is_motion(read_record(path, dt=DT, units="g", vertical=True))


OTHERS = ["Desplazamiento", "Velocidad", "Vitesse", "Verschiebung", "Velocità", "Deplasman"]


@pytest.mark.parametrize("words", OTHERS)
def test_other_quantities_are_known_in_many_languages(write, words):
    with pytest.raises(OtherKindError, match=f"but the header says {words.lower()}"):
        read_record(write(f"t;{words}\n{table(TIME, MOTION)}"))
    both = write(f"Zeit [s];Beschleunigung [g];{words}\n{table(TIME, MOTION, 5 * MOTION)}")
    assert_is_motion(read_record(both))
    assert_refuses(both, 2, "must be a number from 1, or a name, of an acc", column=words)


@pytest.mark.parametrize("damaged", ["0.OOOO", "1.2.3", "1e", "null", "NA", "n/a", "#N/A", "#NV"])
def test_a_damaged_first_value_is_no_header(write, damaged):
    path = write(f"{damaged}\n{column()}")
    assert_refuses(path, 1, f"'{damaged}' must be a finite number", dt=DT, units="g")


def test_times_may_stand_in_any_column_and_names_may_have_units(write):
    assert_is_motion(read_record(write("acc (g),time (s)\n" + table(MOTION, TIME, separator=","))))
    path = write("EW [g];NS [g];UD [g];Zeit [s]\n" + table(MOTION / 2, MOTION, MOTION / 3, TIME))
    assert_is_motion(read_record(path, column="NS [g]"))
    np.testing.assert_allclose(read_record(path, vertical=True).samples, MOTION / 3, atol=1e-5)


def test_a_value_lost_in_a_blank_line_is_warned_of(write):
    rows = column().split("\n")
    path = write("acc (g);\n" + "\n".join([*rows[:200], ";", *rows[201:]]))
    with pytest.warns(PlausibilityWarning, match="a blank line ahead of line 203"):
        read_record(path, dt=DT)


def test_thousands_and_signs_of_all_countries(write):
    mm = [f"{x:,.2f}" for x in MOTION * 1e3 * G]
    german = [x.replace(",", "#").replace(".", ",").replace("#", ".") for x in mm]
    french = [x.replace(",", "\u202f").replace(".", ",").replace("-", "−") for x in mm]
    whole = [f"{round(x):,}".replace(",", ".") for x in MOTION * 1e3 * G]
    point, comma = ([f"{t:.2f}".replace(".", x) for t in TIME] for x in ".,")
    for times, values, separator in (
        (point, mm, "\t"),
        (comma, german, ";"),
        (comma, french, ";"),
        (comma, whole, ";"),
    ):
        rows = (f"{t}{separator}{x}\n" for t, x in zip(times, values, strict=True))
        record = read_record(write(f"t (s){separator}acc (mm/s2)\n" + "".join(rows)))
        assert_is_motion(record, rtol=1e-3)


def test_prose_on_a_few_points_is_no_number_of_values(write):
    words = "Baseline from 10 points\nTaper of 2 samples of noise\n"
    assert_is_motion(read_record(write(words + column()), dt=DT, units="g"))


def test_times_in_json_are_no_component(write):
    text = json.dumps({"time": TIME.round(4).tolist(), "acceleration": MOTION.tolist()})
    assert_is_motion(read_record(write(text), units="g"))
    says = r"400 columns or blocks \(1, 2, .*\[\.\.\.\]\): choose one"
    assert_refuses(write(json.dumps([[x, x] for x in TIME])), 1, says, dt=DT)
