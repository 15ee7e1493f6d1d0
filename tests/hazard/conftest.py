"""The analysis that several tests of hazard compare with."""

import pytest

from tests.hazard.test_ida import analysed


@pytest.fixture(scope="session")
def linear():
    return analysed()
