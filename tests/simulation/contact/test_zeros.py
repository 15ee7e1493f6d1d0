"""Where events are found."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxpound.simulation.contact.zeros import first_zero


def test_the_first_zero_of_a_cubic_is_its_first_root():
    """Against the roots of 4,000 random cubics, those that dip below zero and rise again too."""
    draw = np.random.default_rng(7)
    roots = np.sort(draw.uniform(-0.5, 1.5, (2000, 3)), axis=1)
    three = np.stack([np.poly(row) for row in roots])
    free = draw.normal(size=(2000, 4))
    cubics = np.concatenate([three, free])
    cubics *= np.where(cubics[:, -1:] < 0, -1, 1)  # ≥ 0 at the start
    start, end = cubics[:, 3], cubics.sum(1)
    slope, slope_end = cubics[:, 2], cubics[:, :3] @ [3.0, 2.0, 1.0]
    zero = jax.jit(first_zero)(start, slope, end, slope_end, 1e-9 + 0 * start)
    dips = 0
    for cubic, at in zip(cubics, np.asarray(zero), strict=True):
        crossings = np.roots(cubic)
        crossings = np.sort(crossings[np.abs(crossings.imag) < 1e-9].real)
        crossings = crossings[(crossings > 0) & (crossings < 1)]
        if crossings.size == 0:
            assert not at < 1
            continue
        gaps = np.diff([*crossings, 1.0])
        if gaps.min() < 1e-3:  # grazes zero: it may not fall below the noise
            continue
        dips += crossings.size > 1
        np.testing.assert_allclose(at, crossings[0], atol=2e-3)
    assert dips > 100


def test_a_cubic_that_stays_above_minus_the_noise_has_no_zero():
    assert first_zero(*map(jnp.asarray, (0.25, -1.0, 0.25, 1.0)), 1e-12) == jnp.inf  # (x − ½)²
    assert first_zero(*map(jnp.asarray, (0.0, 1.0, 1.0, 1.0)), 0.0) == jnp.inf
