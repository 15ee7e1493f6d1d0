"""What needs a library that is not there says which extra brings it."""

import sys
import tomllib
from pathlib import Path

import pytest

from jaxpound._extras import EXTRAS, require
from tests.made import pair_demand

DEMAND = pair_demand(1.0)


def test_extras_bring_what_they_say_and_broken_libraries_say_so(tmp_path, monkeypatch):
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())
    extras = project["project"]["optional-dependencies"]
    for library, extra in EXTRAS.items():
        assert any(wanted.startswith(f"{library}>") for wanted in extras[extra]), library
    (tmp_path / "pandas.py").write_text("import what_pandas_needs")
    monkeypatch.delitem(sys.modules, "pandas", raising=False)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ModuleNotFoundError, match="what_pandas_needs"):
        require("pandas")


ALL = r"to_pandas needs pandas, which the extra 'tables' brings: pip install '\.\[tables\]'"
MISSING = [
    ("pandas", lambda path: DEMAND.to_pandas(), ALL),
    ("pandas", DEMAND.to_parquet, r"to_parquet needs pandas, .*\[tables\]"),
    ("xarray", lambda path: DEMAND.to_xarray(), r"to_xarray needs xarray, .*\[xarray\]"),
    ("pyarrow", DEMAND.to_parquet, r"to_parquet needs pyarrow, .*\[tables\]"),
]


@pytest.mark.parametrize(("library", "call", "message"), MISSING)
def test_the_extra_is_named(library, call, message, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(ImportError, match=message):
        call(tmp_path / "table")
    assert not any(tmp_path.iterdir())
