"""Incremental dynamic analysis of linear buildings, whose demand is proportional to the factor."""

import dataclasses

import numpy as np
import pytest
from tqdm.auto import tqdm

import jaxpound as jp
from jaxpound.hazard import analysis as analyses
from jaxpound.hazard.ida import Brackets, by_sections
from jaxpound.plots import ida as plots
from tests.ground.test_suite import SUITE
from tests.made import row_of
from tests.pickled import assert_survives_pickling
from tests.refusals import refusals, refused

LEFT = jp.Building.from_period(mass=500e3, period=0.9, damping_ratio=0.05)
RIGHT = jp.Building.from_period(mass=400e3, period=0.6, damping_ratio=0.05)
GAP = 0.02
PAIR = jp.Buildings((LEFT, RIGHT), (jp.FloorLink(0, 0, gap=GAP),))
IN_UNITS = PAIR.scales.to_dimensionless(SUITE[0])
LADDER = [0.05, 0.1, 0.4, 0.8]


def linked(**changes):
    return dataclasses.replace(PAIR, links=(dataclasses.replace(PAIR.links[0], **changes),))


def analysis_of(structures=PAIR, records=SUITE, **changed):
    """An analysis, and what is left: arguments of the function that runs it."""
    names = {field.name for field in dataclasses.fields(jp.Analysis)}
    fields = {name: changed.pop(name) for name in names & changed.keys()}
    return jp.Analysis(structures, records, **fields), changed


def analysed(structures=PAIR, intensities=LADDER, **changed):
    analysis, how = analysis_of(structures, **changed)
    return jp.incremental_dynamic_analysis(analysis, intensities, **how)


def test_demands_of_linear_buildings_are_proportional_and_capacities_those_of_single_runs(linear):
    closing = linear.demands / linear.intensities
    np.testing.assert_allclose(closing, closing[:, :1] * np.ones(4), rtol=1e-10)
    np.testing.assert_allclose(linear.capacities, GAP / closing[:, 0], rtol=1e-10)
    np.testing.assert_allclose(linear.unscaled, SUITE.pgas)
    assert linear.threshold == pytest.approx(GAP)
    assert linear.returning == ()
    assert linear.topology == linear.stripes.topology == PAIR.system().topology
    # By itself: the record scaled by its factor just closes the gap.
    record = SUITE.scaled(linear.factors)[0]
    dt = float(SUITE[1].dt)  # the shortest of the suite is that of the common grid
    single = jp.demand(PAIR, record, jp.TimeGrid.until(float(record.duration), dt))
    assert float(single.min_gap) == pytest.approx(0, abs=1e-6 * GAP)


def test_contact_and_ends_of_the_ladder(linear):
    colliding = analysed(linked(contact=jp.Newton(0.65)))
    np.testing.assert_allclose(colliding.capacities, linear.capacities, rtol=1e-10)
    most = float(np.sort(linear.capacities)[1] * 1.01)
    found = analysed(intensities=[most / 4, most / 3, most / 2, most])
    known = np.isfinite(found.capacities)
    np.testing.assert_array_equal(known, linear.capacities <= most)
    np.testing.assert_allclose(found.capacities[known], linear.capacities[known], rtol=1e-10)
    assert f"above {most:.4g}" in repr(found)
    censored = jp.hazard.fit_capacities(found.capacities, most)
    assert found.fragility().median == censored.median > np.median(found.capacities[known])


def test_any_measure_that_is_proportional(linear):
    """The factor at which buildings pound does not depend on how intensity is measured."""
    spectral = analysed(measure=0.9)
    np.testing.assert_allclose(spectral.unscaled, SUITE.spectra([0.9])[:, 0])
    factors = analysed(measure=np.ones(3), intensities=[0.5, 1.0, 2.0, 4.0])
    for found in (spectral, factors):
        np.testing.assert_allclose(found.factors, linear.factors, rtol=1e-9)
    np.testing.assert_allclose(factors.capacities, factors.factors)
    # Their fragilities know what they are of: curves of other measures are refused for it.
    assert linear.fragility().measure == "PGA (g)"
    assert spectral.fragility().measure == "Sa(0.9 s) (g)"
    in_m = jp.HazardCurve([0.5, 2.0, 10.0], [1e-2, 1e-3, 1e-5], "PGA (m/s²)")
    assert in_m.annual_rate_of(factors.fragility()).value > 0


def test_thresholds_demands_records_and_fractiles(linear):
    half = analysed(threshold=GAP / 2)
    np.testing.assert_allclose(half.capacities, linear.capacities / 2, rtol=1e-10)
    peaks = analysed(demand="peak_x1", threshold=0.02)
    own = analysed(demand=lambda demand: demand.masses[0].peak_x, threshold=0.02)
    np.testing.assert_allclose(own.capacities, peaks.capacities, rtol=1e-10)

    def required_gap(demand):
        """A user's demand is no closing, whatever its name."""
        return demand.masses[0].peak_x

    by_name = analysed(demand=required_gap, threshold=0.02)
    np.testing.assert_array_equal(by_name.capacities, own.capacities)
    assert (by_name.demand, by_name.fragility().event) == ("demand", "demand ≥ 0.02")
    refused("threshold = None must be a number", analysed, demand=required_gap)
    np.testing.assert_allclose(peaks.demands[:, 1], 2 * peaks.demands[:, 0], rtol=1e-9)
    found = analysed(grid=jp.TimeGrid.until(float(SUITE[1].duration), float(SUITE[1].dt)))
    np.testing.assert_allclose(found.factors, linear.factors, rtol=1e-3)  # of another duration
    low, middle, high = linear.fractiles()
    np.testing.assert_allclose(middle, np.median(linear.demands, axis=0))
    assert ((low < middle) & (middle < high)).all()
    stripes = linear.stripes
    np.testing.assert_array_equal(stripes.trials, [3] * 4)
    expected = (linear.capacities[:, None] <= linear.intensities).sum(axis=0)
    np.testing.assert_array_equal(stripes.pounding, expected)
    curve, fitted = linear.fragility(), jp.hazard.fit_capacities(linear.capacities)
    assert (curve.median, curve.dispersion) == (fitted.median, fitted.dispersion)


class Curves:
    """Runs whose demands over intensity are known: a wave that falls below the threshold again."""

    threshold, bar = 1.0, tqdm(disable=True)

    def run(self, which, im):
        return im + 0.8 * np.sin(np.array([1.0, 1.3])[which] * im)


@pytest.mark.parametrize("batch", [1, 2, 40])
def test_the_first_crossing_is_refined(batch):
    runs, ladder = Curves(), np.array([0.0, 0.5, 1.0, 2.0, 4.0])
    excess = runs.run(np.repeat([0, 1], 5), np.tile(ladder, 2)).reshape(2, -1) - 1.0
    found = by_sections(runs, Brackets.of(ladder, excess), 1e-6, batch)
    fine = np.linspace(0, 2, 200_001)
    for record, capacity in enumerate(found):
        values = runs.run(np.full(fine.size, record), fine)
        assert capacity == pytest.approx(fine[np.argmax(values >= 1.0)], abs=2e-5)


def test_records_that_return_are_strong_or_unfit_are_named(capsys):
    demands = np.array([[0.5, 1.2, 0.9, 1.5], [0.2, 0.4, 1.1, 1.3]])
    found = jp.hazard.IncrementalDynamicAnalysis(
        *(("wave", "line"), np.ones(2), np.arange(1.0, 5.0), demands, np.array([1.7, 2.9])),
        *(1.0, "demand", "PGA (g)"),
    )
    assert found.returning == ("wave",)
    assert "below it again at higher intensities: wave" in repr(found)
    with pytest.warns(jp.PlausibilityWarning, match=r"'slow' times .* has a PGA of 6 g"):
        analysed(records=[SUITE[0]], intensities=[0.1, 6.0])
    refused("PGA of 6 g", analysed, intensities=[0.1, 6.0], strict=True)
    analysed()
    shown = capsys.readouterr().err
    assert "0 of 3 records, brackets within 0." in shown
    assert "3 of 3 records" in shown
    words = "incremental_dynamic_analysis: 'slow' at 0: demand must be finite, but is nan"
    with pytest.raises(FloatingPointError, match=words):
        analysed(demand=lambda demand: np.nan * demand.pga, threshold=1.0)
    fine, long = (jp.Record(np.full(99, 0.1), dt, x) for dt, x in ((1e-5, "fine"), (1, "long")))
    refused(r"'fine', the finest, and 'long', .* 1,000,000 steps", analysed, records=[fine, long])


@pytest.fixture
def counted(monkeypatch):
    """Sizes of the batches that are run; stopped by an interrupt where ``most`` is reached."""
    sizes, in_chunks = [], analyses.in_chunks

    def counting(function, size):
        program = in_chunks(function, size)

        def run(*args):
            if len(sizes) == counting.most:
                raise KeyboardInterrupt
            sizes.append(len(args[0]))
            return program(*args)

        return run

    counting.most = None
    monkeypatch.setattr(analyses, "in_chunks", counting)
    monkeypatch.setattr(analyses, "runs_at_a_time", lambda: 32)
    return counting, sizes


def assert_same(found, expected):
    for name in ("demands", "capacities"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


def test_a_stopped_analysis_goes_on(counted, tmp_path):
    """Stopped within the ladder and after it."""
    counting, sizes = counted
    how = {"progress": False}
    whole, needed = analysed(**how), len(sizes)
    assert needed > 2
    for _ in range(2):
        counting.most = len(sizes) + 1
        with pytest.raises(KeyboardInterrupt, match="analysis: interrupted; what was finished is"):
            analysed(**how, store=tmp_path / "ida")
    counting.most = len(sizes) + needed - 2  # what is left
    assert_same(analysed(**how, store=tmp_path / "ida"), whole)
    assert len(sizes) == counting.most
    assert_same(analysed(**how, store=tmp_path / "ida"), whole)  # from its files alone


def test_a_store_serves_other_questions_of_the_same_runs_and_damage_is_told(counted, tmp_path):
    counting, sizes = counted
    stored = {"store": tmp_path / "ida", "progress": False}
    first = analysed(**stored)
    counting.most = len(sizes)
    assert_same(analysed(**stored, measure=SUITE.pgas), first)
    strip = jp.multiple_stripes(jp.Analysis(PAIR, SUITE), LADDER, **stored)
    np.testing.assert_array_equal(strip.demands, first.demands.T)
    assert_survives_pickling((first, first.fragility(), strip))
    for changed, words in (
        ({"demand": "peak_x1", "threshold": 0.02}, "demand is 'required_gap' there and 'peak_x1'"),
        ({"records": SUITE.scaled([1.0, 1.0, 2.0])}, "records.* there and .* here"),
        ({"structures": linked(friction=1e4)}, "structures.links.*friction"),
    ):
        refused(f"holds another study: .*{words}", analysed, **stored, **changed)
    files, counting.most = sorted(stored["store"].glob("chunk-*.npz")), len(sizes) + 1
    files[1].write_bytes(b"damaged")
    with pytest.warns(UserWarning, match=r"ida: chunk 1 is damaged .*; its runs are made anew"):
        assert_same(analysed(**stored), first)
    assert len(sizes) == counting.most
    assert sorted(stored["store"].glob("chunk-*.npz")) == files
    assert_same(analysed(**stored), first)


test_wrong_arguments_are_named = refusals(
    ({"intensities": [0.2, 0.1]}, r"intensities = 0.1 \(at index \[1\]\) must be rising"),
    ({"intensities": [0.0]}, "intensities = 0 .* must be positive"),
    ({"tolerance": 0}, "tolerance = 0 must be"),
    ({"measure": "sa"}, "measure = 'sa' must be 'pga', a natural period"),
    ({"measure": [1.0]}, r"measure of shape \(1,\) must be one number or \(3,\)"),
    ({"demand": "peak_x1"}, "threshold = None must be a number: demand is 'peak_x1'"),
    ({"demand": "peak_x9", "threshold": 1.0}, "unknown demand 'peak_x9'"),
    ({"threshold": 0.0}, "threshold = 0 must be above 0, what the demand is without shaking"),
    ({"structures": PAIR.dimensionless()[0]}, "structures = Row must be jp.Buildings, as records"),
    ({"structures": linked(gap=np.inf)}, "structures must have a link whose gap is finite"),
    ({"records": [IN_UNITS]}, r"records = Record\(.* must be in seconds, as Buildings are"),
    ({"records": "folder"}, "records = 'folder' must be a RecordSuite or records|Record"),
    ({"records": [SUITE, SUITE]}, "records = 2 suites must be one: multiple_stripes takes several"),
    ({"grid": 0.1}, "grid = 0.1 must be of type TimeGrid"),
    ({"scheme": "fast"}, "scheme = 'fast' must be of type Scheme"),
    of=lambda changed: analysed(**changed),
    before="^(incremental_dynamic_analysis|Analysis|RecordSuite): .*",
)


def test_a_demand_of_a_row_is_told_by_its_floor(linear):
    topology = row_of((3, 2), ()).system().topology
    of_row = dataclasses.replace(linear, demand="peak_x5", topology=topology)
    words = "peak displacement of floor 2 of building 2"
    event = f"{words} ≥ 0.02 m"
    assert f"demand: {words} (m)" in str(of_row)
    assert of_row.fragility().event == of_row.stripes.fragility().event == event
    assert plots.curves(of_row).get_xlabel() == f"{words} (m)"
