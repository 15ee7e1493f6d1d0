"""A file to be read as an accelerogram."""

from pathlib import Path

import pytest


@pytest.fixture
def write(tmp_path):
    def write_file(content: str | bytes, name: str = "quake.txt") -> Path:
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write_file
