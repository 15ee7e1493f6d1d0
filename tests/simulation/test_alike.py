"""Functions of many arguments of few kinds."""

import jax
import jax.numpy as jnp
import numpy as np

import jaxpound as jp
from jaxpound.simulation.alike import by_kind, map_alike
from jaxpound.simulation.yielding import HysteresisConstants, HysteresisState, hysteresis_step


def rods():
    """Rods that yield, of two laws: arguments of their steps."""
    laws = [jp.BoucWen(0.1 * i, 0.05, 1.5, 0.4, 0.02) for i in (1.0, 2.0, 3.0)]
    laws.insert(1, jp.Bilinear(0.1, 0.05))
    cast = jax.tree.map(jnp.asarray, laws)
    states = [HysteresisState(law.start(0.2), jnp.asarray(0.2), jnp.asarray(0.06)) for law in cast]
    moduli = (2.0, 3.0, 4.0, 5.0)
    constants = [
        HysteresisConstants(law, jnp.asarray(k)) for law, k in zip(cast, moduli, strict=True)
    ]
    ends = (0.27, 0.1, 0.19, 0.3)
    return [(*rod, jnp.asarray(x)) for *rod, x in zip(constants, states, ends, strict=True)]


def test_rods_of_one_law_are_a_program_that_steps_as_each_of_them_does():
    def step(constants, before, elongation):
        return hysteresis_step(constants, before, elongation, None)

    assert by_kind(rods()) == [[0, 2, 3], [1]]
    together, apart = (jax.tree.leaves(map_alike(step, rods(), x)) for x in (True, False))
    np.testing.assert_allclose(together, apart, rtol=1e-14)
