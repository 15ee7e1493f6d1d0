"""What the tests of studies have in common."""

import pytest


@pytest.fixture(autouse=True, scope="session")
def _programs_of_many_studies_are_kept():
    """Those of four studies by default, so that a later test would trace its program anew."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("jaxpound.study.chunk._MOST_PROGRAMS", 150)
        yield
