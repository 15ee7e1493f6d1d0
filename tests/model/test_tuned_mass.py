"""The default tuning of a tuned mass has the lowest peak of the harmonic response (Den Hartog)."""

import numpy as np
import pytest

import jaxpound as jp

MASS_RATIO = 0.2
FREQUENCIES = np.linspace(0.5, 1.5, 20_001)  # over that of the building


def amplification(tuned):
    """Largest displacement of an undamped building of one storey over its static one."""
    mass, top = (float(storey.mass) for storey in tuned.storeys)
    stiffness = float(tuned.storeys[0].stiffness)
    w = FREQUENCIES * np.sqrt(stiffness / mass)
    rod = tuned.storeys[1]
    at = 1j * w
    spring = float(rod.stiffness) * (1 + at * float(rod.tau_x)) / (1 + at * float(rod.tau_f))
    held = spring * top * w**2 / (spring - top * w**2)
    return np.abs(stiffness / (stiffness - mass * w**2 - held)).max()


def test_the_peak_is_den_hartog_s_and_rises_with_every_other_damping():
    block = jp.Building(500e3, 2e7, order=1.0, tau_f=1e-6, tau_x=1e-6)
    best = amplification(jp.tuned_mass_damper(block, MASS_RATIO))
    assert best == pytest.approx(np.sqrt((2 + MASS_RATIO) / MASS_RATIO), rel=0.01)
    damping = np.sqrt(3 * MASS_RATIO / (8 * (1 + MASS_RATIO)))
    for factor in (0.85, 1.15):
        other = jp.tuned_mass_damper(block, MASS_RATIO, damping_ratio=factor * damping)
        assert amplification(other) > 1.02 * best
