"""Configurations that are wrong: one line with file, table, key, value and rule."""

import re
import tomllib

import numpy as np
import pytest
from msgspec import inspect

from jaxpound.cli.design import Search, Wanted
from jaxpound.cli.files import example
from jaxpound.cli.montecarlo import Study
from jaxpound.cli.objective import Objective
from jaxpound.cli.pair import Building, Damper
from jaxpound.cli.reading import entries, ranges
from jaxpound.cli.simulate import Ground, Simulation
from jaxpound.cli.syntax import long_key
from jaxpound.cli.tables import Contact, Earthquakes, Run
from tests.cli.commands import refusal

CONFIG_FAULTS = [
    ({"period": "perod = 0.9"}, "[building_1] has an unknown key 'perod'; did you mean 'period'?"),
    ({"[damper]": "[dampr]"}, "unknown key 'dampr'; did you mean 'damper'?"),
    (
        {"gap": "colour = 1"},
        "the top level has an unknown key 'colour'; allowed are gap, building_1",
    ),
    ({"[damper]": "[damper]\ngap = 1"}, "unknown key 'gap'; it belongs in the top level"),
    ({"mass": "mass = = 1"}, ":18: [building_1] mass: Invalid value (at line 18, column 8)"),
    ({"mass": "mass = 500,5"}, "column 11); a decimal point, not a comma: 0.1"),
    ({"period": "period = .9"}, "column 10); a number begins with a digit: 0.1, not .1"),
    ({"period": "period = 1."}, "column 11); a digit follows the point: 1.0, not 1."),
    ({"gap": "gap = 0.1.2"}, "gap: Expected newline or end of document"),
    ({"[damper]": "[damper"}, "Expected ']'"),
    ({"[output]": "[damper]"}, "Cannot declare ('damper',) twice"),
    ({"series": "series = ["}, "[output] series: Invalid value (at end of document)"),
    ({"gap": 'gap = """'}, "Unterminated string"),
    ({"mass": 'mass = "5"'}, '[building_1] mass = "5" must be a finite number'),
    ({"mass": "mass = true"}, "[building_1] mass = true must be a finite number"),
    ({"mass": "mass = nan"}, "[building_1] mass = nan must be a finite number"),
    ({"mass": f"mass = 1{'0' * 400}"}, "must be a finite number"),
    ({"mass": "mass = -5"}, "[building_1] mass = -5 kg must be between 0.001 and 1e+10 kg ("),
    ({"period": ""}, "[building_1] lacks period; give mass, period"),
    ({"# tau_f": "stiffness = 1e6"}, "[building_1] must not have stiffness"),
    ({"# order": "order = 1.5"}, "[building_1] order = 1.5 must be between 0.001 and 1 ("),
    ({"damping": "damping_ratio = 0.9"}, "[building_1] damping_ratio = 0.9 must be below"),
    ({"gap": "gap = -0.1"}, "gap = -0.1 m must be between 0 and 10 m ("),
    ({"gap": ""}, "the top level lacks the key 'gap'"),
    ({"friction_force": ""}, "[damper] lacks the key 'friction_force'"),
    ({"friction_force": "", "[damper]": ""}, "the top level lacks the table [damper]"),
    (
        {"friction_force": "friction_force = -1"},
        "[damper] friction_force = -1 N must be between 0 and 1e+10 N (",
    ),
    ({"# pga": "pga = 0.3"}, "[ground] must have scale or pga, not both"),
    ({"scale": "scale = 0"}, "[ground] scale = 0 must not be 0: nothing would shake"),
    ({"scale": "pga = 0"}, "[ground] pga = 0 g must be between 1e-06 and 20 g ("),
    (
        {"scale": "scale = 100"},
        "record: PGA = 39.78 g must be at most 20 g: is [ground] pga or scale right?",
    ),
    ({"baseline": 'baseline = "cubic"'}, '"none", "mean", "linear"'),
    ({"friction =": 'friction = "smoothed"'}, "[run] smoothing_velocity must be given"),
    ({"# smoothing": "smoothing_velocity = 1e-3"}, "[run] smoothing_velocity must be given"),
    (
        {"friction =": 'friction = "smoothed"', "# smoothing": "smoothing_velocity = -1"},
        "[run] smoothing_velocity = -1 m/s must be between 1e-09 and 1 m/s (",
    ),
    ({"order = 2": "order = 3"}, "[run] order = 3 must be from 1 to 2"),
    *(
        ({"order = 2": f"order = {value}"}, f"[run] order = {value} must be a whole number")
        for value in ("1.5", "true", "[2]", '"2"', "inf")
    ),
    ({"# dt": "dt = 0.5"}, "[run] dt = 0.5 s must be positive and below the stability limit"),
    ({"# dt": "dt = 0"}, "[run] dt = 0 s must be between 1e-07 and 10 s ("),
    ({"# dt": "dt = 0.05"}, "[run] dt = 0.05 s must be at most the record's, 0.02 s"),
    ({"# duration": "duration = 1e9"}, "[run] duration = 1e+09 s must be between"),
    ({"# duration": "duration = 0.01"}, "[run] duration = 0.01 s must be between"),
    ({"period": "period = 9e-4"}, "period = 0.0009 s must be between 0.002 and 60 s (models"),
    ({"period": "period = 900"}, "[building_1] period = 900 s must be between 0.002 and 60 s"),
    (
        {"period": "stiffness = 1e14\ntau_f = 1e-3\ntau_x = 2e-3\norder = 0.5", "damping": ""},
        "[building_1] natural period = 0.000",
    ),
    ({"friction_force": "friction_force = 1e300"}, "friction_force = 1e+300 N must be between"),
    ({"scale": "scale = 1e44"}, "[ground] scale = 1e+44 must be between -1000 and 1000"),
    ({"baseline": 'baseline = "liner"'}, "\"linear\"; did you mean 'linear'?"),
    ({"mass": f"mass = {'7' * 5000}"}, "[building_1] mass = a whole number of more than 308 dig"),
    ({"mass": f"mass = 1{'_1' * 5000}"}, "[building_1] mass = a whole number of more than 308"),
    ({"mass": f"mass = 0x1{'0' * 5000}"}, "[building_1] mass = a whole number of more than 308"),
    ({"mass": f"mass = {'[' * 1000}{']' * 1000}"}, "its lists or tables are nested too deeply"),
    ({"gap": f"{'.'.join('a' * 20)} = 1"}, "the top level has an unknown key 'a'"),
    ({"gap": f"gap.{'.'.join('a' * 19)} = 1"}, "gap = {a = {a = {a = ...}}} must be a finite"),
    ({"mass": f"mass = {list(range(5000))}"}, "[building_1] mass = [0, 1, 2, 3, 4, 5, 6, 7, 8"),
    *(
        ({"# [contact]": f"[contact]\n{keys}"}, f"[contact] {says}")
        for keys, says in (
            ("restitution = 0.6", "lacks the key 'law'"),
            (
                'law = "neuton"\nrestitution = 0.6',
                'law = "neuton" must be one of "newton", "kelvin-voigt", "hertz", "hertz-damped", '
                "\"jankowski\"; did you mean 'newton'?",
            ),
            (
                'law = "newton"\nrestitution = 1.5',
                "restitution = 1.5 must be between 0.001 and 1 (",
            ),
            (
                'law = "newton"\nrestitution = 0.0',
                "restitution = 0.0 must be between 0.001 and 1 (",
            ),
            (
                'law = "newton"\nrestituton = 0.6',
                "has an unknown key 'restituton'; did you mean 'res",
            ),
            ('law = "newton"', "lacks the key 'restitution', which law = \"newton\" needs"),
            (
                'law = "newton"\nrestitution = 0.6\nstiffness = 1e9',
                'stiffness must not be given with law = "newton"; give restitution',
            ),
            ('law = "hertz"\nstiffness = 0', "stiffness = 0 must be between 0.001 and 1e+20 (N/m,"),
            (
                'law = "hertz"\nstiffness = 1e9\nrestitution = 0.6',
                'restitution must not be given with law = "hertz"; give stiffness',
            ),
            (
                'law = "kelvin-voigt"\nstiffness = 1e9\nrestitution = 0.6\ntension = 1',
                "tension = 1 must be true or false",
            ),
            (
                'law = "hertz-damped"\nstiffness = 1e9\nrestitution = 0.6\ndamping = "exakt"',
                'damping = "exakt" must be one of "exact", "muthukumar", "ye", "hunt-crossley"; '
                "did you mean 'exact'?",
            ),
            (
                'law = "jankowski"\nstiffness = 1e9\nrestitution = 0.6\ndamping = "exact"',
                'damping must not be given with law = "jankowski"; give stiffness, restitution',
            ),
        )
    ),
    ({"series": 'series = "hdf5"'}, '[output] series = "hdf5" must be one of'),
]


@pytest.mark.parametrize(
    ("changes", "says"), CONFIG_FAULTS, ids=[says[:40] for _, says in CONFIG_FAULTS]
)
def test_a_faulty_configuration(changes, says, pulse, write, tmp_path, capsys):
    path, out = write(changes), tmp_path / "out"
    line = refusal(capsys, "simulate", "--record", pulse, "--config", path, "--out", out)
    assert line.startswith(f"jaxpound: error: {path}:")
    assert says in line
    assert not out.exists()


def test_a_table_that_is_none(pulse, write, tmp_path, capsys):
    text = re.sub(r"(?s)\[run\].*?\[output\]", "[output]", "run = 3\n" + example("simulate"))
    path = write(text=text)
    line = refusal(capsys, "simulate", "--record", pulse, "--config", path, "--out", tmp_path / "x")
    assert "run = 3 must be a table, [run]" in line


def test_a_refusal_is_short(pulse, write, tmp_path, capsys):
    path = write({"mass": f"mass = {list(range(5000))}"})
    line = refusal(capsys, "simulate", "--record", pulse, "--config", path, "--out", tmp_path)
    assert len(line) < 200 + len(str(path))


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        (
            {"mass": "mass = 500"},
            "the masses of floors, 500 to 4e+05 kg, should be within",
        ),
        ({"friction_force": "friction_force = 200"}, "friction_force = 200 N should be 0 or betw"),
        ({"friction_force": "friction_force = 2e8"}, "friction_force = 2e+08 N should be 0 or be"),
    ],
)
def test_buildings_in_other_units_are_refused_if_strict(
    changes, says, pulse, write, tmp_path, capsys
):
    path, out = write(changes), tmp_path / "out"
    line = refusal(
        capsys, "simulate", "--record", pulse, "--config", path, "--strict", "--out", out
    )
    assert says in line
    assert not out.exists()


def test_a_configuration_larger_than_any(pulse, tmp_path, capsys):
    path = tmp_path / "large.toml"
    path.write_bytes(b"# more\n" * 200_000)
    line = refusal(capsys, "simulate", "--record", pulse, "--config", path, "--out", tmp_path)
    assert f"{path}: must be a configuration of at most 1,048,576 bytes" in line


@pytest.mark.parametrize("command", ["simulate", "montecarlo", "design", "ida", "rare", "hazard"])
def test_a_key_of_many_parts_is_refused_before_it_fills_the_memory(
    command, pulse, tmp_path, capsys
):
    """Reading ``a.a.a ... = 1`` takes memory as the square of its length."""
    path = tmp_path / "deep.toml"
    path.write_text("# as it is\n" + "a." * 2000 + "b = 1\n")
    record = ["--record", pulse] if command == "simulate" else []
    config = ["--config", path] if command == "simulate" else [path]
    out = ["--store" if command == "montecarlo" else "--out", tmp_path / "out"]
    line = refusal(capsys, command, *record, *config, *out)
    assert f"{path}:2: a key must have at most 20 parts, between dots" in line


MANY = "a." * 20 + "a = 1"


@pytest.mark.parametrize(
    "text",
    [
        f"[{'a.' * 20}a]",
        "\"a\" . 'a'\t." * 10 + '"a" = 1',
        "a.a.\n" + "a." * 25,
        f'x = """a"""" # \\\n{MANY} # "\n',
        f'x = """a""""" # \\\n{MANY} # "\n',
        f"x = '''a''''' # '\n{MANY}",
        f'x = """a""\\""""\n{MANY}',
        f'x = "a\\\\" # "\n{MANY}',
    ],
)
def test_parts_of_keys_are_counted_as_toml_has_them(text):
    assert "a key must have at most 20 parts" in long_key(text)


@pytest.mark.parametrize(
    "text",
    [
        "a." * 19 + "a = 1",
        f"# {'a.' * 30}a",
        f'a = "{"b." * 30}b" # "\nb = 1',
        f"a = '{'b.' * 30}b'",
        f'a = """\n{"b." * 30}b\n"""',
        f"a = '''\n{'b.' * 30}b\n'''",
        "a = [" + "0.5, " * 30 + "]",
        "\n".join("a.b.c = 1" for _ in range(30)),
        '"' * 100_000,
        "a" * 100_000,
        '"' + '\\"' * 100_000,
        ('"' + '\\"' * 1000 + "\\\n") * 100,
        '"""' + '\\"' * 100_000,
    ],
)
def test_what_is_no_key_of_many_parts_passes(text):
    assert long_key(text) == ""


@pytest.mark.parametrize(
    "text",
    [
        f'a = """""\n{MANY}\\"""{MANY}""""" # """',
        f"a = '''''\n{MANY}''{MANY}''''' # '''",
        f'a = "\\"{MANY}\\\\" # "',
        f"a = '\\' # {MANY}",
        f'a = """\\\n{MANY}\\\n""" # "',
    ],
)
def test_what_toml_reads_as_text_is_no_key(text):
    assert list(tomllib.loads(text)) == ["a"]
    assert long_key(text) == ""


def test_a_configuration_that_is_not_text(pulse, tmp_path, capsys):
    path = tmp_path / "latin.toml"
    path.write_bytes("# Gebäude\n".encode("latin-1"))
    line = refusal(capsys, "simulate", "--record", pulse, "--config", path, "--out", tmp_path)
    assert f"{path}: must be text in UTF-8" in line


def numbers(kind):
    """Every number of a configuration, with what is said of it."""
    info, said = kind, {}
    if isinstance(info, inspect.Metadata):
        info, said = info.type, info.extra or {}
    if isinstance(info, inspect.FloatType | inspect.IntType):
        yield info, said
    for part in ("types", "item_types"):
        for one in getattr(info, part, ()):
            yield from numbers(one)
    for field in getattr(info, "fields", ()):
        yield from ((x, said | y) for x, y in numbers(field.type))
    for part in ("item_type", "value_type"):
        if hasattr(info, part):
            yield from numbers(getattr(info, part))


def test_every_number_of_a_configuration_has_a_range():
    """But those of limits and penalties, whose ranges depend on what is limited.

    The strength of noise, a number or a distribution, is held to its range by its table.
    """
    without = {
        "earthquakes": [inspect.FloatType],
        "limits": [inspect.FloatType, inspect.FloatType],
        "penalties": [inspect.FloatType, inspect.FloatType],
    }
    for command in (Simulation, Study, Wanted):
        for name, kind in entries(command).items():
            found = list(numbers(inspect.type_info(kind)))
            bare = [type(number) for number, said in found if "range" not in said]
            assert bare == without.get(name, []), name
            for number, said in found:
                if allowed := said.get("range"):
                    assert (number.ge, number.le) == (allowed.low, allowed.high)


@pytest.mark.parametrize(
    "kind", [Building, Contact, Damper, Run, Earthquakes, Ground, Objective, Search]
)
def test_a_range_is_one_and_says_why(kind):
    assert ranges(kind)
    for allowed in ranges(kind).values():
        assert allowed.low < allowed.high < np.inf
        assert allowed.low in allowed
        assert allowed.high in allowed
        assert np.nextafter(allowed.low, -np.inf) not in allowed
        assert np.nan not in allowed
        assert "1" not in allowed
        assert allowed.why or isinstance(allowed.low, int)
        assert allowed.unit in allowed.rule
