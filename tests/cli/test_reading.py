"""Configurations that are wrong: one line with file, table, key, value and rule."""

import re
import tomllib

import numpy as np
import pytest
from msgspec import inspect

from jaxpound.cli.buildings import BlockSection, Damper
from jaxpound.cli.design import DesignConfig, SearchTable
from jaxpound.cli.files import example
from jaxpound.cli.montecarlo import StudyConfig
from jaxpound.cli.objective import ObjectiveTable
from jaxpound.cli.reading import entries, ranges
from jaxpound.cli.simulate import RecordSection, Simulation
from jaxpound.cli.syntax import long_key
from jaxpound.cli.tables import ContactSection, Earthquakes, RunSection
from tests.cli.commands import refusal


def test_a_table_that_is_none(pulse, write, tmp_path, capsys):
    text = re.sub(r"(?s)\[run\].*?\[output\]", "[output]", "run = 3\n" + example("simulate"))
    path = write(text=text)
    line = refusal(capsys, "simulate", "--record", pulse, "--config", path, "--out", tmp_path / "x")
    assert "run = 3 must be a table, [run]" in line


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"mass": "mass = 500"}, "the masses of floors, 500 to 4e+05 kg, should be within"),
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
    for command in (Simulation, StudyConfig, DesignConfig):
        for name, kind in entries(command).items():
            found = list(numbers(inspect.type_info(kind)))
            bare = [type(number) for number, said in found if "range" not in said]
            assert bare == without.get(name, []), name
            for number, said in found:
                if allowed := said.get("range"):
                    assert (number.ge, number.le) == (allowed.low, allowed.high)


@pytest.mark.parametrize(
    "kind",
    [
        BlockSection,
        ContactSection,
        Damper,
        RunSection,
        Earthquakes,
        RecordSection,
        ObjectiveTable,
        SearchTable,
    ],
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
