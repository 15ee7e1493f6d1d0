"""The example files that ``--example-config`` prints."""

from __future__ import annotations

from importlib import resources

SIMULATE, STUDY, DESIGN = "example_config.toml", "example_study.toml", "example_design.toml"


def example(name: str = SIMULATE) -> str:
    """A documented example configuration, as text."""
    return (resources.files("jaxpound.cli") / name).read_text(encoding="utf-8")
