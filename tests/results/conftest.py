"""Runs that several tests of results look at."""

import dataclasses

import jax
import jax.numpy as jnp
import pytest

import jaxpound as jp


@pytest.fixture(scope="session")
def batch():
    """Three short runs of the paper's structures, which differ in their friction."""

    def run(friction):
        structures = dataclasses.replace(jp.paper.structures(), friction=friction)
        return jp.simulate(structures, jp.paper.ground(), jp.TimeGrid(0.05, 40))

    return jax.jit(jax.vmap(run))(jnp.array([0.1, 0.2, 0.3]))
