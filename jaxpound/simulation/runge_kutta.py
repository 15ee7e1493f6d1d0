"""Dormand and Prince's explicit Runge–Kutta method of order 8, DOP853.

Coefficients as in Hairer, Nørsett and Wanner, Solving Ordinary Differential Equations I (1993),
with their estimate of the error by embedded methods of order 5 and 3.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

_ROWS: tuple[tuple[float, ...], ...] = (
    (0.05260015195876773,),
    (
        0.0197250569845379,
        0.0591751709536137,
    ),
    (
        0.02958758547680685,
        0.0,
        0.08876275643042054,
    ),
    (
        0.2413651341592667,
        0.0,
        -0.8845494793282861,
        0.924834003261792,
    ),
    (
        0.037037037037037035,
        0.0,
        0.0,
        0.17082860872947386,
        0.12546768756682242,
    ),
    (
        0.037109375,
        0.0,
        0.0,
        0.17025221101954405,
        0.06021653898045596,
        -0.017578125,
    ),
    (
        0.03709200011850479,
        0.0,
        0.0,
        0.17038392571223998,
        0.10726203044637328,
        -0.015319437748624402,
        0.008273789163814023,
    ),
    (
        0.6241109587160757,
        0.0,
        0.0,
        -3.3608926294469414,
        -0.868219346841726,
        27.59209969944671,
        20.154067550477894,
        -43.48988418106996,
    ),
    (
        0.47766253643826434,
        0.0,
        0.0,
        -2.4881146199716677,
        -0.590290826836843,
        21.230051448181193,
        15.279233632882423,
        -33.28821096898486,
        -0.020331201708508627,
    ),
    (
        -0.9371424300859873,
        0.0,
        0.0,
        5.186372428844064,
        1.0914373489967295,
        -8.149787010746927,
        -18.52006565999696,
        22.739487099350505,
        2.4936055526796523,
        -3.0467644718982196,
    ),
    (
        2.273310147516538,
        0.0,
        0.0,
        -10.53449546673725,
        -2.0008720582248625,
        -17.9589318631188,
        27.94888452941996,
        -2.8589982771350235,
        -8.87285693353063,
        12.360567175794303,
        0.6433927460157636,
    ),
    (
        0.054293734116568765,
        0.0,
        0.0,
        0.0,
        0.0,
        4.450312892752409,
        1.8915178993145003,
        -5.801203960010585,
        0.3111643669578199,
        -0.1521609496625161,
        0.20136540080403034,
        0.04471061572777259,
    ),
)
STAGES = np.array([[*row, *[0.0] * (12 - len(row))] for row in _ROWS])
"""Weights of the slopes before it in each stage after the first; the last stage is the result."""

_ORDER_5 = (
    0.01312004499419488,
    0.0,
    0.0,
    0.0,
    0.0,
    -1.2251564463762044,
    -0.4957589496572502,
    1.6643771824549864,
    -0.35032884874997366,
    0.3341791187130175,
    0.08192320648511571,
    -0.022355307863886294,
)

_THIRD = {0: 0.2440944881889764, 8: 0.7338466882816119, 11: 0.022058823529411766}
_ORDER_3 = STAGES[-1] - [_THIRD.get(i, 0.0) for i in range(12)]
"""Weights of the errors that the embedded methods estimate, by stage."""


def weighted(weights: jax.Array, slopes: jax.Array) -> jax.Array:
    """Sum by weights of slopes along their first axis."""
    return (jnp.expand_dims(weights, range(1, slopes.ndim)) * slopes).sum(0)


def error(slopes: jax.Array) -> jax.Array:
    """Estimated error of a step of length 1, from the slopes of all stages."""
    orders = (_ORDER_5, _ORDER_3)
    fifth, third = (weighted(jnp.asarray(row, slopes.dtype), slopes) for row in orders)
    both = fifth**2 + 0.01 * third**2
    return fifth**2 / jnp.sqrt(jnp.where(both > 0, both, 1.0))
