import jax
import numpy as np
import pytest
from scipy import stats

from jaxpound.scenarios.sampling import SAMPLINGS, points

KEY = jax.random.key(3)


@pytest.mark.parametrize("sampling", SAMPLINGS)
def test_points_depend_on_their_index_alone_and_are_standard_normals(sampling):
    whole = points(sampling, KEY, 5)(0, 100)
    for starts in ([0, 40, 41], [41, 0, 40]):
        draw = points(sampling, KEY, 5)
        for start in starts:
            np.testing.assert_array_equal(draw(start, start + 30), whole[start : start + 30])
    assert np.abs(whole - points(sampling, jax.random.key(4), 5)(0, 100)).min() > 0
    z = points(sampling, KEY, 4)(0, 4096)
    assert np.isfinite(z).all()
    for column in z.T:
        assert stats.kstest(column, "norm").pvalue > 0.01
    correlation = np.corrcoef(z.T) - np.eye(4)
    assert np.abs(correlation).max() < 0.05
    assert z.dtype == np.float64  # the precision is the caller's
    with jax.enable_x64(False):
        assert points(sampling, KEY, 2)(0, 4).dtype == np.float32


def test_sobol_points_integrate_a_smooth_function_at_a_higher_order():
    """Error of the mean of Σ z² + z1 z2 over keys: of order 1/2 for plain, 1 for Sobol points."""
    sizes = [2**8, 2**12]
    errors = {}
    for sampling in SAMPLINGS:
        off = np.zeros((8, 2))
        for seed in range(8):
            z = points(sampling, jax.random.key(seed), 3)(0, sizes[-1])
            values = (z**2).sum(axis=1) + z[:, 0] * z[:, 1]
            off[seed] = [values[:n].mean() - 3 for n in sizes]
        errors[sampling] = np.sqrt((off**2).mean(axis=0))
    orders = {k: np.log(e[0] / e[1]) / np.log(sizes[1] / sizes[0]) for k, e in errors.items()}
    assert 0.25 < orders["plain"] < 0.75
    assert orders["sobol"] > 0.75
    assert errors["sobol"][1] < errors["plain"][1] / 5
