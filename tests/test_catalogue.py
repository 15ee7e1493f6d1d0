"""The catalogue of fragilities: its curves, and the files of other programs."""

import runpy
from pathlib import Path

import jax
import numpy as np
import pytest
from scipy.stats import lognorm

import jaxpound as jp

pd = pytest.importorskip("pandas")
CATALOGUE = runpy.run_path(Path(__file__).parents[1] / "examples" / "catalogue.py")
NUMBERS = {"ID": ["pounding_2_2_level_T80_C20_50mm"], "median": [0.6], "dispersion": [0.4]}


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


def test_a_capacity_is_the_lowest_acceleration_that_closes_the_gap():
    levels = CATALOGUE["LEVELS"]
    gaps = np.stack([levels**power for power in (1, 0.5, 0.5, 0.5)], axis=1)  # of four motions
    gaps[0] = 0.2, 0.1, 0.1, 0.1
    gaps[4:, 2] = 0.1  # open again with more shaking
    gaps[:, 3] = 0.1
    reached = CATALOGUE["capacities"](np.log(gaps), 0.3)
    assert reached[0] == pytest.approx(0.3, rel=1e-9)
    assert reached[1] == pytest.approx(0.09, rel=1e-9)  # the root of 0.09 is 0.3
    assert reached[2] == pytest.approx(0.09, rel=1e-9)
    assert reached[3] == np.inf
    elastic = CATALOGUE["capacities"](np.log(gaps), 0.05)
    np.testing.assert_allclose(elastic, levels[0] * 0.05 / gaps[0], rtol=1e-9)


def test_curves_have_the_medians_of_their_capacities():
    """Elastic capacities grow with the gap; a curve needs half of its motions to close it."""
    table = []
    for pga in CATALOGUE["LEVELS"]:
        for motion, size in enumerate((0.8, 1.0, 1.3)):
            table.append({"pga": pga, "motion": motion, "log_gap": np.log(0.3 * size * pga**0.9)})
    pair = {"storeys_left": 2, "storeys_right": 4, "floors": "level", "period_right": 0.32}
    curves = {
        curve["ID"]: curve for curve in CATALOGUE["fragilities"](pd.DataFrame(table).assign(**pair))
    }
    names = [f"pounding_2_4_level_T80_elastic_{gap}mm" for gap in (10, 20, 50, 100, 200)]
    medians = [curves[name]["median"] for name in names]
    np.testing.assert_allclose(np.array(medians) / medians[0], [1, 2, 5, 10, 20], rtol=1e-9)
    strong, weak = (curves[f"pounding_2_4_level_T80_{name}_50mm"] for name in ("C20", "C10"))
    sizes = np.log([0.8, 1.0, 1.3])
    for curve, times in ((strong, 2), (weak, 1)):
        capacities = times * (0.05 / times / (0.3 * np.exp(sizes))) ** (1 / 0.9)
        assert curve["median"] == pytest.approx(np.exp(np.log(capacities).mean()), rel=1e-9)
        assert curve["dispersion"] == pytest.approx(sizes.std(ddof=1) / 0.9, rel=1e-9)
    weak = pd.DataFrame(table).assign(**pair)
    weak["log_gap"] -= np.log(10)  # 0.045, 0.056, 0.073 m at the highest level
    names = {curve["ID"].partition("T80_")[2] for curve in CATALOGUE["fragilities"](weak)}
    assert {"C10_50mm", "C20_100mm"} <= names
    assert not {"C10_100mm", "C20_200mm"} & names


def test_the_peak_of_a_series_is_between_instants_or_at_its_end():
    t = np.linspace(0.0, 1.0, 11)
    assert float(CATALOGUE["peak"](1.0 - (t - 0.33) ** 2)) == pytest.approx(1.0, abs=1e-12)
    assert float(CATALOGUE["peak"](t**2)) == 1.0
    assert float(CATALOGUE["peak"](-(t**2))) == 0.0


@pytest.mark.filterwarnings("ignore::jaxpound.PlausibilityWarning")
def test_the_closing_of_a_link_is_that_of_its_response():
    pair = CATALOGUE["pair"]((1, 2), "unlevel", [0.1, 0.16, 0.05, 0.1])
    weights = CATALOGUE["closing_weights"](pair)
    ground = jp.Record(0.5 * np.sin(np.arange(100) / 2.0), 0.02)
    response = jp.simulate(pair, ground, jp.TimeGrid.until(2.0, dt=0.01))
    closings = weights @ np.stack([mass.x for mass in response.masses])
    np.testing.assert_allclose(closings, np.stack(response.closings), rtol=1e-12, atol=1e-15)


@pytest.mark.filterwarnings("ignore::jaxpound.PlausibilityWarning")
def test_a_needed_gap_grows_with_strength_and_acceleration():
    """Both times two double it, and so does the acceleration while no storey yields."""
    motion, needed = CATALOGUE["MOTION"], CATALOGUE["log_needed_gaps"]((2, 2), "unlevel")
    samples = motion.draw(jax.random.normal(jax.random.key(1), (motion.dimension,))).samples
    samples = np.asarray(samples / abs(samples).max())
    numbers = np.array([0.2, 0.16, 0.05, 0.1])
    assert any(link.column for link in CATALOGUE["pair"]((2, 2), "unlevel", numbers).links)
    step = 1e-6 * np.eye(4)
    cases = [
        (numbers, 0.01),
        (numbers, 0.02),
        (numbers, 0.5),
        (numbers * [1, 1, 1, 2], 1.0),
        *((numbers + sign * h, 0.5) for h in step for sign in (1, -1)),
    ]
    values, slopes = needed(
        np.stack([x for x, _ in cases]), np.stack([level * samples for _, level in cases])
    )
    assert values[1] - values[0] == pytest.approx(np.log(2), rel=1e-9)
    assert slopes[0, 3] == 0.0
    assert values[3] - values[2] == pytest.approx(np.log(2), rel=1e-9)
    assert values[2] - values[0] != pytest.approx(np.log(50), abs=0.1)  # storeys yield
    differences = (values[4::2] - values[5::2]) / 2e-6
    np.testing.assert_allclose(slopes[2], differences, rtol=1e-4)
