"""The catalogue of fragilities: its curves, and the files of other programs."""

import runpy
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import lognorm

import jaxpound as jp

pd = pytest.importorskip("pandas")
CATALOGUE = runpy.run_path(Path(__file__).parents[1] / "examples" / "catalogue.py")
NUMBERS = {"ID": ["pounding_2_2_level_T80_50mm"], "median": [0.6], "dispersion": [0.4]}


def test_openquake_s_numbers_are_those_of_the_capacity():
    """Its curve has the mean and the standard deviation of the lognormal variable itself."""
    root = CATALOGUE["openquake"](pd.DataFrame(NUMBERS)).getroot()
    (function,) = root.iter("fragilityFunction")
    assert function.get("id") == NUMBERS["ID"][0]
    numbers = function.find("params")
    mean, deviation = (float(numbers.get(name)) for name in ("mean", "stddev"))
    capacity = lognorm(0.4, scale=0.6)
    assert (mean, deviation) == pytest.approx((capacity.mean(), capacity.std()), rel=1e-7)


def test_pelicun_s_numbers_are_median_and_dispersion():
    table = CATALOGUE["pelicun"](pd.DataFrame(NUMBERS)).iloc[0]
    assert (table["LS1-Theta_0"], table["LS1-Theta_1"]) == (0.6, 0.4)
    assert table["Demand-Unit"] == "g"


def test_spectra_are_those_of_each_motion():
    samples = CATALOGUE["motions"](2)
    np.testing.assert_allclose(abs(samples).max(1), 1.0)
    table = CATALOGUE["spectra"](samples)
    record = jp.Record(samples[1], CATALOGUE["MOTION"].dt, units="g")
    sa = float(jp.spectral_acceleration(record, period=0.5))
    assert table["sa_0.5_s"][1] == pytest.approx(sa, rel=1e-9)
    assert table["arias"][1] == pytest.approx(float(jp.ground.arias_intensity(record)), rel=1e-9)
    assert list(table["motion"]) == [0, 1]


@pytest.mark.filterwarnings("ignore::jaxpound.PlausibilityWarning")
def test_a_needed_gap_is_that_of_every_scale_of_the_motion():
    """At the capacity of a gap it is just closed; the slopes are those of differences."""
    motion = CATALOGUE["MOTION"]
    samples = motion.draw(jax.random.normal(jax.random.key(1), (motion.dimension,))).samples
    samples = samples / abs(samples).max()
    numbers = jnp.array([0.2, 0.16, 0.05])
    needed = CATALOGUE["log_needed_gaps"]
    values, slopes = needed((2, 2), "unlevel", numbers, samples[None])
    pair = CATALOGUE["pair"]((2, 2), "unlevel", numbers)
    assert sum(link.column is not None for link in pair.links) > 0
    scale = 0.05 / float(jnp.exp(values[0]))  # at which a gap of 5 cm closes
    record = jp.Record(scale * samples, motion.dt)
    closed = 1.0 - float(jp.demand(pair, record, CATALOGUE["GRID"]).min_gap)
    assert closed == pytest.approx(0.05, rel=1e-9)
    ends = [
        needed((2, 2), "unlevel", numbers.at[1].add(s * 1e-6), samples[None])[0][0] for s in (1, -1)
    ]
    assert float(slopes[0, 1]) == pytest.approx(float(ends[0] - ends[1]) / 2e-6, rel=1e-4)
    np.testing.assert_array_equal(np.isfinite(slopes), True)
