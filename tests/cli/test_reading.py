"""Configurations that are wrong: one line with file, table, key, value and rule."""

import re
import tomllib

import numpy as np
import pytest
from msgspec import inspect

from jaxpound.cli.buildings import BlockSection, Damper
from jaxpound.cli.design import DesignConfig, ObjectiveTable, SearchTable
from jaxpound.cli.files import example
from jaxpound.cli.montecarlo import StudyConfig
from jaxpound.cli.reading import entries, ranges
from jaxpound.cli.simulate import RecordSection, Simulation
from jaxpound.cli.syntax import long_key
from jaxpound.cli.tables import ContactSection, Earthquakes, RunSection
from tests.cli.commands import command_for, refusal

NO_TABLE = re.sub(r"(?s)\[run\].*?\[output\]", "[output]", "run = 3\n" + example("simulate"))


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (NO_TABLE.encode(), "run = 3 must be a table, [run]"),
        (b"# more\n" * 200_000, "must be a configuration of at most 1,048,576 bytes"),
        ("# Gebäude\n".encode("latin-1"), "must be text in UTF-8"),
    ],
    ids=["no table", "large", "no text"],
)
def test_a_file_that_is_no_configuration(content, says, pulse, tmp_path, capsys):
    path, out = tmp_path / "config.toml", tmp_path / "out"
    path.write_bytes(content)
    line = refusal(capsys, *command_for("simulate", path, pulse, out))
    assert f"{path}: {says}" in line
    assert not out.exists()


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ("mass = 500", "the masses of floors, 500 to 4e+05 kg, should be within"),
        ("friction_force = 200", "friction_force = 200 N should be 0 or betw"),
        ("friction_force = 2e8", "friction_force = 2e+08 N should be 0 or be"),
    ],
)
def test_buildings_in_other_units_are_refused_if_strict(
    changes, says, pulse, write, tmp_path, capsys
):
    out = tmp_path / "out"
    command = command_for("simulate", write(changes), pulse, out)
    assert says in refusal(capsys, *command, "--strict")
    assert not out.exists()


@pytest.mark.parametrize("command", ["simulate", "montecarlo", "design", "ida", "rare", "hazard"])
def test_a_key_of_many_parts_is_refused_before_it_fills_the_memory(
    command, pulse, tmp_path, capsys
):
    """Reading ``a.a.a ... = 1`` takes memory as the square of its length."""
    path = tmp_path / "deep.toml"
    path.write_text("# as it is\n" + "a." * 2000 + "b = 1\n")
    line = refusal(capsys, *command_for(command, path, pulse, tmp_path / "out"))
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


TEXTS = [
    f'a = """""\n{MANY}\\"""{MANY}""""" # """',
    f"a = '''''\n{MANY}''{MANY}''''' # '''",
    f'a = "\\"{MANY}\\\\" # "',
    f"a = '\\' # {MANY}",
    f'a = """\\\n{MANY}\\\n""" # "',
]


@pytest.mark.parametrize(
    "text",
    [
        *TEXTS,
        "a." * 19 + "a = 1",
        f"# {'a.' * 30}a",
        f'a = "{"b." * 30}b" # "\nb = 1',
        f"a = '{'b.' * 30}b'",
        f'a = """\n{"b." * 30}b\n"""',
        f"a = '''\n{'b.' * 30}b\n'''",
        "a = [" + "0.5, " * 30 + "]",
        "\n".join("a.b.c = 1" for _ in range(30)),
        *('"' * 100_000, "a" * 100_000, '"' + '\\"' * 100_000, '"""' + '\\"' * 100_000),
        ('"' + '\\"' * 1000 + "\\\n") * 100,
    ],
)
def test_what_is_no_key_of_many_parts_passes(text):
    assert long_key(text) == ""
    assert text not in TEXTS or list(tomllib.loads(text)) == ["a"]


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
    without = {"earthquakes": [inspect.FloatType]}
    without |= dict.fromkeys(("limits", "penalties"), [inspect.FloatType] * 2)
    kinds = [
        x for command in (Simulation, StudyConfig, DesignConfig) for x in entries(command).items()
    ]
    for name, kind in kinds:
        found = list(numbers(inspect.type_info(kind)))
        bare = [type(number) for number, said in found if "range" not in said]
        assert bare == without.get(name, []), name
        for number, said in found:
            if allowed := said.get("range"):
                assert (number.ge, number.le or np.inf) == (allowed.low, allowed.high)


KINDS = [BlockSection, ContactSection, Damper, RunSection, Earthquakes, RecordSection]


@pytest.mark.parametrize("kind", [*KINDS, ObjectiveTable, SearchTable])
def test_a_range_is_one_and_says_why(kind):
    assert ranges(kind)
    for allowed in ranges(kind).values():
        assert allowed.low < allowed.high < np.inf
        assert allowed.low in allowed
        assert allowed.high in allowed
        for beyond in (np.nextafter(allowed.low, -np.inf), np.nan, "1"):
            assert beyond not in allowed
        assert allowed.why or isinstance(allowed.low, int)
        assert allowed.unit in allowed.rule
