"""Configurations that are wrong: one line with file, table, key, value and rule."""

import re

import numpy as np
import pytest
from msgspec import inspect

from jaxpound.cli.buildings import BuildingSection, Damper
from jaxpound.cli.design import DesignConfig, ObjectiveTable, SearchTable
from jaxpound.cli.files import example
from jaxpound.cli.montecarlo import StudyConfig
from jaxpound.cli.reading import File, entries, ranges
from jaxpound.cli.simulate import RecordSection, Simulation
from jaxpound.cli.tables import ContactSection, Earthquakes, RunSection
from tests.cli.commands import changed, command_for, refusal

NO_TABLE = re.sub(r"(?s)\[run\].*?\[output\]", "[output]", "run = 3\n" + example("simulate"))

DEEP = b"# as it is\n" + b"a." * 2000 + b"b = 1\n"  # would take memory as its length's square
COMMANDS = "simulate", "montecarlo", "design", "ida", "rare", "hazard"


@pytest.mark.parametrize(
    ("command", "content", "says"),
    [
        ("simulate", NO_TABLE.encode(), ": run = 3 must be a table, [run]"),
        ("simulate", b"# more\n" * 200_000, ": must be a configuration of at most 1,048,576 bytes"),
        ("simulate", "# Gebäude\n".encode("latin-1"), ": must be text in UTF-8"),
        *((x, DEEP, ":2: a key must have at most 20 parts, between dots") for x in COMMANDS),
    ],
    ids=["no table", "large", "no text", *COMMANDS],
)
def test_a_file_that_is_no_configuration(command, content, says, pulse, tmp_path, capsys):
    path = tmp_path / "config.toml"
    path.write_bytes(content)
    line = refusal(capsys, *command_for(command, path, pulse, tmp_path / "out"))
    assert f"{path}{says}" in line


SOON = "periods = {uniform = [0.001, 0.002]}"  # with a step of 12 ms
UNRESOLVED = "ground: 100% of the {} earthquakes looked at are not resolved; of one, the "
STRONG = "ground: PGA of 100% of the 64 earthquakes looked at, up to"


@pytest.mark.parametrize(
    ("command", "changes", "says"),
    [
        ("simulate", "mass = 500", "the masses of floors, 500 to 4e+05 kg, should be within"),
        ("simulate", "friction_force = 200", "slip force = 200 N should be 0 or betw"),
        ("simulate", "friction_force = 2e8", "slip force = 2e+08 N should be 0 or be"),
        ("montecarlo", f"samples = 40 & {SOON}", UNRESOLVED.format(40)),
        ("design", f"earthquakes = 12 & {SOON}", UNRESOLVED.format(12)),
        ("rare", "acceleration = 8.0", STRONG),  # of m/s², say
    ],
)
def test_what_is_implausible_is_refused_if_strict(command, changes, says, pulse, tmp_path, capsys):
    path = tmp_path / "config.toml"
    path.write_text(changed(example(command), changes))
    line = refusal(capsys, *command_for(command, path, pulse, tmp_path / "out"), "--strict")
    assert says in line


MANY = "a." * 20 + "a = 1"

LONG = [
    f"[{'a.' * 20}a]",
    "\"a\" . 'a'\t." * 10 + '"a" = 1',
    "a.a.\n" + "a." * 25,
    f'x = """a"""" # \\\n{MANY} # "\n',
    f'x = """a""""" # \\\n{MANY} # "\n',
    f"x = '''a''''' # '\n{MANY}",
    f'x = """a""\\""""\n{MANY}',
    f'x = "a\\\\" # "\n{MANY}',
]
SHORT = [
    "a." * 19 + "a = 1",
    "a = [" + "0.5, " * 30 + "]",
    "# " + ". " * 50,
    "\n".join(f"a.b{i}.c = 1" for i in range(30)),
    *('"' * 100_000, "a" * 100_000, '"' + '\\"' * 100_000, '"""' + '\\"' * 100_000),
    ('"' + '\\"' * 1000 + "\\\n") * 100,
]


def test_keys_of_too_many_parts_are_refused():
    for text in LONG:
        with pytest.raises(ValueError, match="a key must have at most 20 parts"):
            File("long.toml", text).read(Simulation)
    for text in SHORT:
        with pytest.raises(ValueError, match=r"^short.toml:") as told:
            File("short.toml", text).read(Simulation)
        assert "20 parts" not in str(told.value), text[:100]


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
    """But those of limits and penalties, whose rules are the library's."""
    without = dict.fromkeys(("limits", "penalties"), [inspect.FloatType] * 2)
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


KINDS = [BuildingSection, ContactSection, Damper, RunSection, Earthquakes, RecordSection]


@pytest.mark.parametrize("kind", [*KINDS, ObjectiveTable, SearchTable])
def test_a_range_is_one_and_says_why(kind):
    assert ranges(kind)
    for allowed in ranges(kind).values():
        assert allowed.low < allowed.high < np.inf
        assert {allowed.low in allowed, allowed.high in allowed} == {True}
        for beyond in (np.nextafter(allowed.low, -np.inf), np.nan, "1"):
            assert beyond not in allowed
        assert allowed.why or isinstance(allowed.low, int)
        assert allowed.unit in allowed.rule
