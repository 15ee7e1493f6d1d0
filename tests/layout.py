"""How the steps of a run are laid out in its program, where a file's tests are not about that.

Steps of few rods are written out one after the other; in a loop, as those of more rods are, they
are compiled in half the time. That both are the same steps: ``simulation/test_scan.py``. Where they
are written out: ``simulation/test_run.py``, which compares scalars of both too, and the tests of
most other folders; ``test_gradients.py`` compares derivatives of both.
"""

import pytest

from jaxpound.simulation import state

WRITTEN_OUT = state.WRITTEN_OUT


@pytest.fixture
def looped():
    """Of all systems in a test."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(state, "WRITTEN_OUT", 0)
        yield


@pytest.fixture(autouse=True, scope="module")
def steps_in_a_loop():
    """Of all systems in the tests of a file that imports this."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(state, "WRITTEN_OUT", 0)
        yield
