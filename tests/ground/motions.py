"""Ground motions that several tests use, and their values by one program."""

from functools import partial

import jax
import numpy as np

import jaxpound as jp

GRID = jp.TimeGrid(0.1, 5)
SAMPLES = np.array([0.5, 1.0, -3.0, 2.0])
RECORD = jp.Record(SAMPLES, 0.5, "quake")


def sine(t):
    return 0.3 * np.sin(2 * t)


@partial(jax.jit, static_argnames="quantity")
def values(ground, quantity, t):
    return getattr(ground, quantity)(t)
