"""Random ground motions for an earthquake and a site, with published coefficients.

Rezaeian and Der Kiureghian (2010) fitted the six parameters of their model to records of the far
field on firm ground, and transformed each to a standard normal number ν by its distribution. They
give the regression of ν on mechanism, magnitude, distance and soil, its standard deviations between
and within earthquakes, and the correlations of its errors: these numbers are used. The
distributions have the digits of the public implementation in the Southern California Earthquake
Center's Broadband Platform (module ``rzz2015_gmpe``). Its ln I_a is that of ∫ u''² dt; ln(π/2) is
added here, which gives mean and standard deviation of the paper's figure, −4.39 and 1.43.
"""

from __future__ import annotations

import dataclasses
import math
from functools import cache
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtr
from jaxtyping import Array, Float
from scipy import special

from jaxpound._checks import require_one_of
from jaxpound._extrema import larger, smaller
from jaxpound._fields import like, parameter, part
from jaxpound.ground.evolving import ChebyshevFit
from jaxpound.ground.motion import SECONDS
from jaxpound.ground.record import Record
from jaxpound.scenarios.random_noise import NoiseDraw, NonstationaryNoise

FAULTS = {"strike-slip": 0.0, "reverse": 1.0}  # mechanisms, and F of the regression


class Regression(NamedTuple):
    """Coefficients of 1, F, M/7, R/25 km and V/750 m/s in ν, and its standard deviations."""

    coefficients: tuple[float, float, float, float, float]
    between: float
    within: float


REGRESSIONS = {  # by the parameter of ``NonstationaryNoise``
    "arias_intensity": Regression((-1.844, -0.071, 2.944, -1.356, -0.265), 0.274, 0.594),
    "duration": Regression((-6.195, -0.703, 6.792, 0.219, -0.523), 0.457, 0.569),
    "mid_time": Regression((-5.011, -0.345, 4.638, 0.348, -0.185), 0.511, 0.414),
    "frequency": Regression((2.253, -0.081, -1.810, -0.211, 0.012), 0.692, 0.723),
    "frequency_slope": Regression((-2.489, 0.044, 2.408, 0.065, -0.081), 0.129, 0.953),
    "damping": Regression((-0.258, -0.477, 0.905, -0.289, 0.316), 0.682, 0.760),
}

CORRELATIONS = (  # of the errors of ν, in the same order
    (1.00, -0.36, 0.01, -0.15, 0.13, -0.01),
    (-0.36, 1.00, 0.67, -0.13, -0.16, -0.20),
    (0.01, 0.67, 1.00, -0.28, -0.20, -0.22),
    (-0.15, -0.13, -0.28, 1.00, -0.20, 0.28),
    (0.13, -0.16, -0.20, -0.20, 1.00, -0.01),
    (-0.01, -0.20, -0.22, 0.28, -0.01, 1.00),
)

_FAR = 9.0  # largest |ν|; the probability beyond, 1e-19, is concentrated there


@dataclasses.dataclass(frozen=True)
class SiteBasedNoise(NoiseDraw):
    """Random ground motions for an earthquake and a site (Rezaeian and Der Kiureghian 2010).

    The first six standard normal numbers draw the six parameters of ``NonstationaryNoise``, with
    their fitted distributions and (by a Cholesky factor) correlations; the others, ``noise_1`` to
    ``noise_n``, draw the noise.

    Motions are horizontal and of the far field, without pulses. Outside its data the regression is
    evaluated, but means little. A motion costs some 80 Fourier transforms of 2 n numbers: for n
    above 1,000 they take most of a study's time. Raises ``ValueError`` as ``FilteredNoise``.

    Parameters
    ----------
    magnitude, distance, fault
        Moment magnitude M > 0; closest distance to the rupture, km, > 0, with data from 10 on;
        "strike-slip" or "reverse".
    vs30, samples, dt, high_pass
        Velocity of shear waves in the upper 30 m of the site, m/s, > 0, with data from firm ground;
        the others as in ``NonstationaryNoise``.

    Examples
    --------
    >>> site = {"vs30": 600.0, "fault": "reverse"}
    >>> noise = jp.scenarios.SiteBasedNoise(6.6, 20.0, **site, samples=1000, dt=0.02)
    >>> drawn = noise.parameters(np.zeros(noise.dimension))
    >>> round(float(drawn["duration"]), 2), round(float(drawn["frequency"]), 2)  # s, Hz
    (10.02, 6.29)
    """

    magnitude: Any = parameter("M", words="magnitude", above=0, single=True)
    distance: Any = parameter("R", words="distance", above=0, single=True)
    vs30: Any = parameter("V_{S30}", words="velocity of shear waves", above=0, single=True)
    fault: str = part(str)
    samples: int = parameter(whole=True, least=2)
    dt: float = parameter(above=0, single=True)
    high_pass: float | None = like(NonstationaryNoise, "high_pass", default=0.1)
    time_unit = SECONDS

    def __post_init__(self) -> None:
        require_one_of(self.fault, [*FAULTS], "fault")
        super().__post_init__()

    @property
    def dimension(self) -> int:
        """Six numbers for the parameters, and one for each sample."""
        return len(REGRESSIONS) + self.samples

    def noise(self, z: Float[Array, " 6"]) -> NonstationaryNoise:
        """The noise whose six parameters are drawn by z."""
        return NonstationaryNoise(
            **self._drawn(z), samples=self.samples, dt=self.dt, high_pass=self.high_pass
        )

    def draw(self, z: Float[Array, " d"]) -> Record:
        """The record drawn by z, in g and seconds."""
        z, n = self._reals(z, self.dimension), len(REGRESSIONS)
        return self.noise(z[:n]).draw(z[n:])

    def parameters(self, z: Float[Array, " d"]) -> dict[str, Any]:
        """The six parameters, and the numbers of the noise."""
        return self._drawn(z[: len(REGRESSIONS)]) | super().parameters(z[len(REGRESSIONS) :])

    def _drawn(self, z: Any) -> dict[str, Any]:
        z = self._reals(z, len(REGRESSIONS))
        distance, soil = self.distance / 25, self.vs30 / 750
        linear = 1.0, FAULTS[self.fault], self.magnitude / 7, distance, soil
        logarithmic = *linear[:3], jnp.log(distance), jnp.log(soil)
        means = []
        for name, regression in REGRESSIONS.items():
            terms = logarithmic if name == "arias_intensity" else linear
            means.append(sum(b * x for b, x in zip(regression.coefficients, terms, strict=True)))
        scales = np.array([math.hypot(r.between, r.within) for r in REGRESSIONS.values()])
        factor = scales[:, None] * np.linalg.cholesky(np.array(CORRELATIONS))
        nu = jnp.stack(means) + jnp.asarray(factor, z.dtype) @ z
        return {
            name: value(larger(smaller(x, _FAR), -_FAR))
            for (name, value), x in zip(_distributions().items(), nu, strict=True)
        }


@cache
def _distributions() -> dict[str, Any]:
    """Each parameter as a function of ν, in the order of ``REGRESSIONS``."""
    location, spread = -4.8255 + math.log(math.pi / 2), 1.4318
    return {
        "arias_intensity": lambda nu: jnp.exp(location + spread * nu),
        "duration": _beta(1.1314, 2.4474, 5.0, 45.0),
        "mid_time": _beta(1.5792, 3.6405, 0.5, 40.0),
        "frequency": _gamma(4.0982, 1.4330),
        "frequency_slope": _two_exponentials(6.7729, 17.095, -2.0, 0.5),
        "damping": _beta(1.4250, 5.7208, 0.02, 1.0),
    }


def _beta(a: float, b: float, low: float, high: float) -> Any:
    """A beta distribution between two bounds, by the logit of the share of their distance."""

    def logit(nu: Any) -> Any:
        share = np.where(nu < 0, special.betaincinv(a, b, special.ndtr(nu)), 0.5)
        complement = np.where(nu < 0, 1 - share, special.betaincinv(b, a, special.ndtr(-nu)))
        return np.log(np.where(nu < 0, share, 1 - complement)) - np.log(complement)

    smooth = ChebyshevFit(logit, -_FAR, _FAR, 40)
    return lambda nu: low + (high - low) / (1 + jnp.exp(-smooth(nu)))


def _gamma(shape: float, scale: float) -> Any:
    """A gamma distribution, by its logarithm."""

    def logarithm(nu: Any) -> Any:
        lower = special.gammaincinv(shape, special.ndtr(nu))
        return np.log(np.where(nu < 0, lower, special.gammainccinv(shape, special.ndtr(-nu))))

    smooth = ChebyshevFit(logarithm, -_FAR, _FAR, 40)
    return lambda nu: scale * jnp.exp(smooth(nu))


def _two_exponentials(rise: float, fall: float, low: float, high: float) -> Any:
    """Density in proportion to e^(rise x) below 0 and e^(−fall x) above, between two bounds."""
    below, above = -math.expm1(rise * low) / rise, -math.expm1(-fall * high) / fall
    whole = below + above

    def value(nu: Any) -> Any:
        left = larger(smaller(ndtr(nu) * whole, below), 0.0)
        right = larger(smaller(ndtr(-nu) * whole, above), 0.0)
        down = jnp.log(left * rise + math.exp(rise * low)) / rise
        up = -jnp.log(right * fall + math.exp(-fall * high)) / fall
        return jnp.where(ndtr(nu) * whole < below, down, up)

    return value
