"""What codes ask for: the correlation of the double difference combination."""

import numpy as np
import pytest
from scipy.integrate import quad

from jaxpound.study.gaps import double_difference_correlation


@pytest.mark.parametrize(
    ("t1", "z1", "t2", "z2"), [(1.0, 0.05, 0.7, 0.05), (2.0, 0.02, 1.9, 0.1), (1.0, 0.3, 3.0, 0.1)]
)
def test_the_double_difference_s_correlation_is_that_of_two_oscillators_in_white_noise(
    t1, z1, t2, z2
):
    """ρ = Re ∫ H1 H2* dω over √(∫ |H1|² ∫ |H2|²), by quadrature."""

    def h(w, t, z):
        w0 = 2 * np.pi / t
        return 1 / (w0**2 - w**2 + 2j * z * w0 * w)

    def integral(a, b):
        peaks = sorted({2 * np.pi / t1, 2 * np.pi / t2})
        return sum(
            quad(lambda w: (h(w, *a) * np.conj(h(w, *b))).real, low, high, limit=500)[0]
            for low, high in zip([0, *peaks], [*peaks, np.inf], strict=True)
        )

    one, two = (t1, z1), (t2, z2)
    rho = integral(one, two) / np.sqrt(integral(one, one) * integral(two, two))
    assert double_difference_correlation(*one, *two) == pytest.approx(rho, rel=1e-6)
    assert double_difference_correlation(*two, *one) == pytest.approx(rho, rel=1e-6)


def test_equal_oscillators_move_together():
    assert double_difference_correlation(1.0, 0.05, 1.0, 0.05) == pytest.approx(1.0)
    assert double_difference_correlation(1.0, 0.0, 1.0, 0.0) == 1.0
    assert double_difference_correlation(1.0, 0.0, 2.0, 0.0) == 0.0
