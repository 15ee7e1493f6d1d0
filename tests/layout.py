"""How the steps of a run are laid out in its program while the suite runs.

Steps of few rods are written out one after the other; in a loop, as those of more rods are, they
are compiled in half the time. That both are the same steps: ``simulation/test_scan.py``. The tests
of ``simulation/test_run.py`` have them written out and compare scalars of both; those of
``test_gradients.py`` compare derivatives of both. Programs of commands have them written out.
"""

import pytest

from jaxpound.simulation import constants as state

WRITTEN_OUT = state.WRITTEN_OUT
"""Rods up to which users' programs have steps written out."""

state.WRITTEN_OUT = 0


@pytest.fixture(autouse=True, scope="module")
def written_out():
    """In the programs of a file that imports this, as in users'."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(state, "WRITTEN_OUT", WRITTEN_OUT)
        yield


@pytest.fixture
def looped():
    """In a loop in a test of such a file."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(state, "WRITTEN_OUT", 0)
        yield
