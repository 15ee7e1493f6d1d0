"""Strictness of the whole suite: float64 unless a test says otherwise, no silent rank promotion."""

import jax
import pytest
from hypothesis import HealthCheck, settings

jax.config.update("jax_enable_x64", True)

# Every example may compile a program: time is no measure of a test here, and runs must repeat.
settings.register_profile(
    "jaxpound",
    deadline=None,
    derandomize=True,
    max_examples=25,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("jaxpound")


@pytest.fixture(autouse=True)
def _no_rank_promotion():
    with jax.numpy_rank_promotion("raise"):
        yield
