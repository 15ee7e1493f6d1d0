"""Annual rates of pounding: closed forms, quadrature, files of both programs, and a study."""

import re
import warnings

import jax
import matplotlib as mpl
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate, stats

import jaxpound as jp
from jaxpound.plots import hazards
from jaxpound.scenarios.distributions import Distribution, density
from tests.refusals import refusals, refused

mpl.use("Agg")

COVARIANCE = np.array([[0.01, 0.002], [0.002, 0.02]])
CURVE = jp.HazardCurve([0.1, 0.2, 0.21, 0.4, 0.8], [1e-2, 3e-3, 3e-3, 6e-4, 8e-5], "PGA (g)")
SLOPES = -np.diff(np.log(CURVE.annual_rate)) / np.diff(np.log(CURVE.intensity))


def fragility(median, dispersion):
    return jp.study.Fragility(median, dispersion, COVARIANCE)


def rate_at(median, dispersion, *confidence, **options):
    return CURVE.annual_rate_of(fragility(median, dispersion), *confidence, **options)


RATE = rate_at(0.5, 0.4)


@given(st.floats(0.3, 5.0), st.floats(0.1, 2.0), st.floats(0.02, 0.9), st.integers(2, 9))
def test_cornell_s_formula_is_exact(k, median, dispersion, points):
    """For H(a) = k0 a^−k (Cornell et al. 2002): H(θ) exp(k² β² / 2)."""
    im = np.geomspace(0.05, 3.0, points)
    found = jp.HazardCurve(im, 1e-4 * im**-k).annual_rate_of(fragility(median, dispersion))
    cornell = 1e-4 * median**-k * np.exp((k * dispersion) ** 2 / 2)
    assert found.value == pytest.approx(cornell, rel=1e-11)
    slope = np.array([-k, k**2 * dispersion])  # of ln λ by ln θ and β
    assert found.cov == pytest.approx(np.sqrt(slope @ COVARIANCE @ slope), rel=1e-9)
    low, high = found.bounds
    assert low * (1 - 1e-12) <= found.value <= high * (1 + 1e-12)


def test_the_integral_is_that_of_quadrature_and_steps_take_the_curve_s_own_rate():
    curve = fragility(0.5, 0.4)
    found = CURVE.annual_rate_of(curve)

    def part(low, high):
        def integrand(x):
            h = 1e-6
            fall = (CURVE.rate(x * (1 - h)) - CURVE.rate(x * (1 + h))) / (2 * h * x)
            return stats.norm.cdf(np.log(x / 0.5) / 0.4) * fall

        return integrate.quad(integrand, low, high, epsrel=1e-9)[0]

    within = sum(map(part, CURVE.intensity[:-1], CURVE.intensity[1:]))
    assert found.value - found.below - found.above == pytest.approx(within, rel=1e-5)
    assert found.above == pytest.approx(part(0.8, 50.0), rel=1e-5)
    assert found.bounds[0] == pytest.approx(within + 8e-5 * curve.probability(0.8), rel=1e-5)
    assert found.bounds[1] == pytest.approx(within + 8e-5 + found.below, rel=1e-5)
    assert "14.3 % from above 0.8" in repr(found)
    # With β → 0 there is pounding exactly above θ.
    for at in (0.07, 0.15, 0.205, 0.5, 1.5):
        found = rate_at(at, 1e-6)
        assert found.value == pytest.approx(float(CURVE.rate(at)), rel=1e-4)


def by_delta_method(rates, h=1e-5):
    """Standard errors of rates of a fragility, by central differences in ln θ and β."""
    median, dispersion = (0.5 * np.exp(h), 0.5 * np.exp(-h)), (0.4 + h, 0.4 - h)
    pairs = [(fragility(x, 0.4) for x in median), (fragility(0.5, x) for x in dispersion)]
    slope = [np.subtract(*map(rates, pair)) / (2 * h) for pair in pairs]
    return np.sqrt(np.einsum("i...,ij,j...->...", slope, COVARIANCE, slope))


def test_the_coefficient_of_variation_is_the_delta_method_s_and_probabilities_poisson_s():
    rate, edges = RATE, [0.0, 0.15, 0.205, 0.5, np.inf]
    error = by_delta_method(lambda curve: CURVE.annual_rate_of(curve).value)
    assert rate.cov == pytest.approx(error / rate.value, rel=1e-6)
    reach = stats.norm.ppf(0.975) * rate.cov
    ends = np.log([rate.high / rate.value, rate.value / rate.low])
    assert ends == pytest.approx([reach, reach])
    bands = rate.deaggregation(edges)
    errors = by_delta_method(lambda curve: CURVE.annual_rate_of(curve).deaggregation(edges).rate)
    np.testing.assert_allclose(bands.cov, errors / bands.rate, rtol=1e-5)
    for years in (1.0, 50.0, 475.0):
        found = [CURVE.intensity_at(p, years) for p in CURVE.probability(years)[[0, 3, 4]]]
        assert found == pytest.approx(CURVE.intensity[[0, 3, 4]])
    assert rate.probability(50.0).value == pytest.approx(1 - np.exp(-50 * rate.value))
    assert rate.return_period == pytest.approx(1 / rate.value)
    assert CURVE.probability(50.0) == pytest.approx(1 - np.exp(-50 * CURVE.annual_rate))
    assert float(CURVE.rate(CURVE.intensity_at(0.02, 50.0))) == pytest.approx(-np.log(0.98) / 50)


def fitted(measure):
    """Fragilities of every kind that say what they are of."""
    counts = [0.2, 0.4, 0.6, 0.8, 1.0], [1, 4, 9, 14, 18], [20] * 5
    demands = tuple(np.arange(20) < k for k in counts[1])
    cloud = jp.hazard.fit_cloud([0.2, 0.4, 0.6, 0.8], [0.1, 0.15, 0.3, 0.32], measure=measure)
    return [
        jp.study.Fragility(0.6, 0.4, measure=measure),
        jp.fit_fragility(*counts, measure=measure),
        jp.hazard.fit_capacities([0.2, 0.3, 0.45], measure=measure),
        jp.hazard.Stripes(np.array(counts[0]), demands, 1.0, measure=measure).fragility(),
        cloud.fragility(0.2),
    ]


def test_fragilities_of_other_measures_are_refused_and_what_one_side_alone_states_is_told():
    words = r"measure = 'PGA \(g\)' must be .* of the fragility, "
    in_si = jp.HazardCurve(jp.STANDARD_GRAVITY * CURVE.intensity, CURVE.annual_rate, "PGA (m/s²)")
    for measure in ("PGA (m/s²)", "peak ground velocity (m/s)", "Sa(0.9 s) (g)"):
        named = jp.HazardCurve(CURVE.intensity, CURVE.annual_rate, measure)
        for curve, unknown in zip(fitted(measure), fitted(""), strict=True):
            assert named.annual_rate_of(curve).value == CURVE.annual_rate_of(unknown).value
            if measure.startswith("PGA"):  # in another unit
                rate = CURVE.annual_rate_of(curve).value
                assert rate == pytest.approx(in_si.annual_rate_of(curve).value, rel=1e-12)
            else:
                refused(words, CURVE.annual_rate_of, curve)
    curve = jp.study.Fragility(1, 1, measure="PGA (m/s2)")
    assert (curve.unit, curve.measure) == ("m/s²", "PGA (m/s²)")
    in_si = jp.HazardCurve(10 * CURVE.intensity, CURVE.annual_rate, "PGA (m/s2)")
    tenth = rate_at(0.1, 1.0)  # the same in units of 10 m/s²
    assert in_si.annual_rate_of(curve).value == pytest.approx(tenth.value, rel=1e-12)
    in_g = curve.in_unit("g")
    assert (in_g.median, in_g.measure) == (1 / jp.STANDARD_GRAVITY, "PGA (g)")
    assert in_g.in_unit("m/s2").median == pytest.approx(1.0)
    refused("unit = 'cm/s' must be one of g, m/s²", curve.in_unit, "cm/s")
    no_period = r"measure = 'Sa \(g\)' names no period; .* Sa\(0.9 s\) \(g\)"
    for of_curve, of_fragility, doubts in (
        ("SA(0.2)", "spectral acceleration at period 1 (g)", ["period 1 \\(g\\), names no period"]),
        ("Sa (g)", "Sa(0.9 s) (g)", [no_period]),
        ("SA(0.9) (g)", "Sa", ["Sa, names no unit; it should be that of", "Sa, names no period"]),
        ("PGA (g)", "PGA", ["the fragility, PGA, names no unit"]),
        ("im (g)", "", []),
        ("Sa(T1) (g)", "Sa(T1) (g)", []),
        ("SA(0.9)", "Sa(0.9 s) (g)", []),
    ):
        hazard = jp.HazardCurve(CURVE.intensity, CURVE.annual_rate, of_curve)
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            hazard.annual_rate_of(jp.study.Fragility(0.5, 0.4, measure=of_fragility))
        assert len(warned) == len(doubts)
        for warning, words in zip(warned, doubts, strict=True):
            assert re.search(words, str(warning.message))
    words = "annual_rate.*of probabilities p within years"
    for intensity, rates, measure in (
        ([0.005, 0.02, 0.1, 0.4], [0.999, 0.97, 0.3, 0.02], "im"),
        ([0.1, 0.2, 0.4, 0.8], [0.39, 0.14, 0.03, 0.004], "PGA (g)"),
        ([6.0, 9.0], [0.03, 0.01], "PGA (m/s²)"),
    ):
        with pytest.warns(jp.PlausibilityWarning, match=words):
            jp.HazardCurve(intensity, rates, measure)


def test_a_rate_says_whose_it_is_and_tells_its_bounds_and_estimates_are_scaled():
    curve = jp.study.Fragility(0.5, 0.4, COVARIANCE, event="largest ductility ≥ 4")
    assert "Mean annual rate of pounding" in repr(RATE)
    assert "Rate of pounding by intensity" in repr(RATE.deaggregation())
    rate = CURVE.annual_rate_of(curve)
    assert rate.value == RATE.value
    assert "Mean annual rate of largest ductility ≥ 4" in repr(rate)
    assert "Rate of largest ductility ≥ 4 by intensity" in repr(rate.deaggregation())
    labels = hazards.pounding(CURVE, rate).axes[1].get_legend().get_texts()
    assert any(label.get_text().startswith("largest ductility ≥ 4, ") for label in labels)
    # A fragility of low intensities: nearly every earthquake beyond the curve's end pounds.
    sure = repr(rate_at(0.3, 0.05))
    assert "beyond" not in sure
    assert "between" not in sure
    assert "whatever it is there, the rate is" in sure
    rate = CURVE.annual_rate_of(jp.study.Estimate(0.1, 0.08, 0.125, 0.9))
    numbers = (rate.value, rate.low, rate.high, rate.confidence)
    assert numbers == pytest.approx((1e-3, 8e-4, 1.25e-3, 0.9))
    assert rate.cov == pytest.approx(np.log(1.25) / stats.norm.ppf(0.95))
    assert np.isnan(CURVE.annual_rate_of(jp.study.Estimate(0.1, 0.0, 0.2)).cov)


def test_deaggregation_adds_up_in_bands_that_hold_the_rate_wherever_it_comes_from():
    whole = RATE.deaggregation(np.r_[0.0, CURVE.intensity, np.inf])
    assert whole.rate.sum() == pytest.approx(RATE.value, rel=1e-12)
    assert (whole.rate[0], whole.rate[-1]) == (RATE.below, RATE.above)
    assert whole.rate[2] == 0  # no earthquake is between 0.2 and 0.21
    split, joint = map(RATE.deaggregation, ([0.2, 0.3, 0.4, 0.6], [0.2, 0.4, 0.6]))
    assert split.rate[:2].sum() == pytest.approx(joint.rate[0], rel=1e-12)
    usual = RATE.deaggregation(bands=40)
    assert 0.997 < usual.share.sum() < 1
    assert 0.4 < usual.mean < 0.6
    assert "outside these bands 0.2 %" in repr(RATE.deaggregation())
    wide = jp.study.Fragility(0.5, 0.4, np.diag([1e10, 1e-2]))
    assert "(no 95% interval)" in repr(CURVE.annual_rate_of(wide))
    assert np.isnan(RATE.deaggregation([0.0, np.inf]).mean)
    for median in (1e-6, 1e-3, 0.3, 30.0, 1e6):
        found = rate_at(median, 0.4).deaggregation(bands=60)
        assert 0.997 < found.share.sum() < 1
        k = SLOPES[0 if median < 0.1 else -1]
        if not 0.05 < median < 1.6:  # within one power law the intensity at pounding has this mean
            assert found.mean == pytest.approx(median * np.exp(1 / k - k * 0.4**2), rel=0.1)
    # Of a curve so flat that even the farthest fragilities have a rate.
    flat = jp.HazardCurve([0.1, 10.0], [1e-2, 0.99e-2])
    for median in (1e-290, 1e300):
        rate = flat.annual_rate_of(fragility(median, 5.0))
        assert rate.value > 0
        assert np.isfinite(rate.deaggregation(bands=7).edges).all()


def test_the_distribution_draws_by_the_hazard():
    drawn = CURVE.distribution()
    assert isinstance(drawn, Distribution)
    z, to_normal = np.linspace(-3, 6, 40), jax.jit(drawn.to_normal)
    im = jax.jit(drawn.from_normal)(z)
    np.testing.assert_allclose(CURVE.rate(np.asarray(im)), 1e-2 * stats.norm.sf(z), rtol=1e-12)
    steep = (np.asarray(im) < 0.2) | (np.asarray(im) > 0.21)
    np.testing.assert_allclose(to_normal(im)[steep], z[steep], atol=1e-9)
    assert to_normal(0.05) == -np.inf
    assert np.isfinite(jax.jit(jax.vmap(jax.grad(drawn.from_normal)))(z)).all()
    u = np.log([np.geomspace(*ends, 2000) for ends in ((0.1, 0.2), (0.21, 100.0))])
    *densities, below, between = density(drawn, [*np.exp(u).ravel(), 0.05, 0.205])
    np.testing.assert_allclose([below, between], 0, atol=1e-12)
    densities = np.reshape(densities, u.shape)
    assert np.trapezoid(densities * np.exp(u), u).sum() == pytest.approx(1, 1e-3)


def test_weights_turn_other_intensities_into_those_of_the_hazard():
    """λ by samples of another distribution, and by stripes, is that of the integral."""
    curve, other = fragility(0.5, 0.4), jp.LogNormal(0.4, 0.8)
    exact = (RATE.value - RATE.below) / 1e-2
    im = np.asarray(other.from_normal(stats.norm.ppf((np.arange(40_000) + 0.5) / 40_000)))
    weights = CURVE.weights(im, drawn_from=other)
    assert weights.mean() == pytest.approx(1.0, abs=0.02)
    assert np.mean(weights * curve.probability(im)) == pytest.approx(exact, rel=0.01)
    stripes = np.repeat(np.geomspace(0.1, 5.0, 60), [3, 5] * 30)
    weights = CURVE.weights(stripes)
    assert weights.mean() == pytest.approx(1.0)
    assert np.mean(weights * curve.probability(stripes)) == pytest.approx(exact, rel=0.02)
    one, *_, last = (weights[stripes == x].sum() / weights.sum() for x in np.unique(stripes))
    edge = np.sqrt(stripes[0] * stripes[3])
    assert one == pytest.approx(1 - float(CURVE.rate(edge)) / 1e-2)
    assert 0 < last < 1e-3


# The format of OpenQuake's exporter; the numbers are the first site of its own test
# classical/case_15, engine 3.7.
OPENQUAKE = """\
#,,,,,"generated_by='OpenQuake engine 3.7.0', kind='mean', investigation_time=50.0, imt='PGA'"
lon,lat,depth,poe-0.0001000,poe-0.0500000,poe-0.1000000,poe-0.1500000,poe-0.2000000,poe-9.0000000
-0.10000,0.00000,0.00000,1.000000E+00,6.135122E-01,5.289103E-01,4.375274E-01,3.509940E-01,0.0
"""
# Two sites of the example 3-sites-file of the USGS's nshmp-haz.
USGS = """\
name,lon,lat,0.005,0.103,0.145,0.203,0.284,0.397,0.556
Oakland CA,-122.25,37.8,2.8528077e-03,1.286985e-03,5.740355e-04,1.745759e-04,3.254657e-05,9.5e-07,0
San Jose CA,-121.9,37.35,2.8522064e-03,4.0021704e-06,0.0,0.0,0.0,0.0,0.0
"""


def test_files_of_openquake_and_the_usgs_are_read(tmp_path):
    path = tmp_path / "hazard_curve-mean-PGA_12.csv"
    path.write_text(OPENQUAKE)
    curve = jp.HazardCurve.read(path)
    np.testing.assert_array_equal(curve.intensity, [0.05, 0.1, 0.15, 0.2])
    assert curve.probability(50.0) == pytest.approx([0.6135122, 0.5289103, 0.4375274, 0.350994])
    path = tmp_path / "SA0P2" / "total.csv"
    path.parent.mkdir()
    path.write_text(USGS)
    of_site = jp.HazardCurve.read(path, "Oakland CA")
    assert of_site.intensity.tolist() == [0.005, 0.103, 0.145, 0.203, 0.284, 0.397]
    assert of_site.annual_rate[1] == 1.286985e-3
    assert (curve.measure, of_site.measure) == ("PGA (g)", "SA(0.2) (g)")
    assert jp.HazardCurve.read(path, 1).annual_rate[-1] == 4.0021704e-06


RISING = USGS.replace("5.740355e-04", "5")


def read(folder, text, site):
    (folder / "a.csv").write_text(text)
    jp.HazardCurve.read(folder / "a.csv", site)


test_files_that_are_no_hazard_curve_say_why = refusals(
    (USGS, None, r"a\.csv: site must be one of 2, from 0: Oakland CA, San Jose CA"),
    (USGS, "San Jos CA", "site = 'San Jos CA' must be .* did you mean 'San Jose CA'"),
    (USGS, 2, "site = 2 must be a row from 0 to 1"),
    (OPENQUAKE.replace("investigation_time", "time"), None, "investigation_time must be given"),
    (OPENQUAKE.replace("5.289103E-01", "much"), None, "'much' must be a number"),
    (OPENQUAKE.replace("5.289103E-01", "1.5"), None, "probabilities must be from 0 to 1"),
    (OPENQUAKE.replace(",0.0\n", "\n"), None, "8 numbers and names must have one for each"),
    (OPENQUAKE.replace("6.135122E-01", "0.4"), None, "annual_rate = .* a hazard curve falls"),
    (USGS.replace("4.0021704e-06", "0"), 1, r"a\.csv: the site must have two intensities or more"),
    (RISING, 0, r"HazardCurve\.read: .*a\.csv: annual_rate = 5 .* curve falls"),
    ("lon,lat\n1,2\n", None, "must hold a line of names, lon and lat and the intensities"),
    ("", None, "must hold a line of names"),
    of=read,
    fixtures=("tmp_path",),
)

test_bad_values_are_named = refusals(
    (lambda: jp.HazardCurve([0.1, 0.2], [1e-3]), r"intensity \(2,\) and annual_rate \(1,\)"),
    (lambda: jp.HazardCurve([0.1], [1e-3]), "one length m ≥ 2"),
    (lambda: jp.HazardCurve("abc", [1e-3]), "HazardCurve: intensity = 'abc' must be a real"),
    (lambda: jp.HazardCurve([0.1, 0.2], [1e-3, 2e-3]), r"annual_rate = 0.002 .*curve falls"),
    (lambda: jp.HazardCurve([0.2, 0.1], [1e-3, 1e-4]), "intensity = 0.1 .* larger than"),
    (lambda: jp.HazardCurve([0.1, 0.2], [1e-3, 0.0]), "annual_rate = 0 .* must be from"),
    (lambda: jp.HazardCurve([0.1, 1e300], [1e-2, 1e-3]), "intensity = 1e.300 .* to 1e.12"),
    (lambda: jp.HazardCurve([0.1, 0.2], [3e7, 1e-3]), "annual_rate = 30000000 .* to 1000 a y"),
    (lambda: jp.HazardCurve([0.1, 0.2], [1e-3, 1e-300]), "annual_rate = 1e-300 .* from 1e-100"),
    (lambda: rate_at(1e-290, 1), "median = 1e-290 .* nearer to"),
    (lambda: CURVE.annual_rate_of(0.1), "pounding = 0.1 must be of type Fragility or Estimate"),
    (lambda: CURVE.annual_rate_of(fragility(1, 1), 1.0), "confidence = 1 must be between"),
    (lambda: CURVE.intensity_at(0.001), "must be one of the curve's, 8e-05 to 0.01"),
    (lambda: CURVE.probability(-1.0), "years = -1 must be positive"),
    (lambda: CURVE.weights([0.3, 0.3]), "intensity of 1 stripe must be of two"),
    (lambda: CURVE.probability([1.0, 50.0]), r"years of shape \(2,\) must be one number"),
    (lambda: rate_at(1, 1).probability([1, 50]), "AnnualRate.probability: years of shape"),
    (lambda: CURVE.annual_rate_of(fragility(1, 1), gap=0.1), "gap = 0.1 must be None: pound"),
    (lambda: CURVE.weights([0.3, 5.0], jp.Uniform(0, 1)), "intensity = 5 .* can draw"),
    (lambda: CURVE.weights([0.3], 2.0), "drawn_from = 2.0 must be of type Distribution"),
    (lambda: jp.HazardCurve([1, 2], [1e-3, 1e-3]).distribution(), "must be smaller than that"),
    (
        lambda: CURVE.annual_rate_of(jp.study.Estimate(0.1, 0.0, 0.2)).deaggregation(),
        "not of an est",
    ),
    (lambda: rate_at(1, 1).deaggregation([2, 1]), "bands = 1 .* larger"),
    (lambda: RATE.deaggregation(intensity="pga"), "intensity must be None: a fragility has its"),
    (lambda: rate_at(1e300, 0.1).deaggregation(), "the rate, 0 a year, must be positive"),
    (lambda: rate_at(1, 1).deaggregation([2]), "bands: number of edges = 1 must be 2 or more"),
)


def test_the_figure_has_the_curve_above_its_deaggregation():
    figure, bands = hazards.pounding(CURVE, RATE), RATE.deaggregation()
    above, below = figure.axes
    np.testing.assert_array_equal(above.lines[0].get_xdata(), CURVE.intensity)
    np.testing.assert_array_equal(above.lines[0].get_ydata(), CURVE.annual_rate)
    assert above.lines[2].get_ydata()[0] == pytest.approx(-np.log(0.98) / 50)
    shares = [bar.get_height() for bar in below.containers[0]]
    np.testing.assert_allclose(shares, 100 * bands.share)
    assert above.get_xlim() == below.get_xlim()
    assert below.get_xlabel() == "PGA (g)"
    lines = below.containers[1].lines[2][0].get_segments()
    top = [line[1, 1] for line in lines]
    np.testing.assert_allclose(top, 100 * bands.share * (1 + bands.cov))
    figure.draw_without_rendering()
