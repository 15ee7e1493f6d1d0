"""Studies of scenarios whose demands are known, and what befalls a study on its way."""

import dataclasses
import multiprocessing
import pickle
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import cache
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats

import jaxpound as jp
from jaxpound.results.named import kind_of
from jaxpound.scenarios.sampling import points
from jaxpound.store.store import Store
from jaxpound.study.chunk import Task
from tests.refusals import refusals, refused
from tests.storing import studied

TESTS = Path(__file__).parent
GRID = jp.TimeGrid(0.1, 40)
SLIDING = dataclasses.replace(jp.paper.structures(), friction=0.0)
MEDIAN, SIGMA = 0.3, 0.5


def waves(median):
    def wave(z):
        return jp.Ricker(median * jnp.exp(SIGMA * z[0]), [2.0], [1.5])

    return jp.CustomDraw(wave, 1, ("amplitude",))


# Without friction the response is linear: every peak is the amplitude times that of a unit wave.
LINEAR = jp.Scenarios(SLIDING, waves(MEDIAN))
RANDOM = jp.Scenarios(
    jp.UncertainStructures(jp.paper.structures(), {"friction": jp.LogNormal(0.25, 0.3)}),
    jp.RandomRicker(2, jp.Uniform(0.1, 0.5), jp.Uniform(1.0, 3.0), jp.Uniform(0.0, 3.0)),
)


def study(scenarios=RANDOM, n=50, **more):
    return studied(scenarios, n, GRID, **{"chunk_size": 16} | more)


def assert_same(found, expected, rtol=1e-9, atol=1e-12):
    for name in expected.columns:
        assert_allclose(found[name], expected[name], rtol=rtol, atol=atol, err_msg=name)


@cache
def unit():
    return jp.demand(SLIDING, jp.Ricker(1.0, [2.0], [1.5]), GRID)


def files(folder):
    """Names and contents of finished files."""
    paths = [path for path in sorted(Path(folder).iterdir()) if path.suffix != ".part"]
    return {path.name: path.read_bytes() for path in paths}


@cache
def linear():
    return study(LINEAR, 4000, chunk_size=1000, key=5)


def test_statistics_of_a_linear_response_are_the_lognormal_s_and_rules_of_codes_by_quantiles():
    found, one = linear(), unit()
    for name in ("peak_x1", "peak_f2", "pga", "required_gap"):
        per_amplitude = float(1 - one.min_gap if name == "required_gap" else getattr(one, name))
        known = stats.lognorm(SIGMA, scale=MEDIAN * per_amplitude)
        assert stats.kstest(found[name], known.cdf).pvalue > 0.01, name
        moments = found.moments(name)
        assert moments.n == 4000
        assert moments.mean == pytest.approx(known.mean(), rel=4 * known.std() / known.mean() / 63)
        assert moments.std == pytest.approx(np.std(found[name], ddof=1), rel=1e-12)
        for share in (0.1, 0.5, 0.99):
            estimate = found.quantile(name, share, 0.999)
            assert estimate.low <= known.ppf(share) <= estimate.high
    assert found.correlations("peak_x1")["amplitude"] == pytest.approx(1.0)
    older = {name: x for name, x in found.about.items() if name != "topology"}
    older = dataclasses.replace(found, about=older)  # as a store of an earlier version
    assert "peak displacement of building 1" in repr(older)
    assert str(older.measure("pga")) == str(found.measure("pga"))
    assert older.checked_floors == ""
    found = linear().separation(0.01)
    u1, u2 = (np.quantile(linear()[f"peak_x{i}"], 0.99) for i in (1, 2))
    assert found.absolute_sum == pytest.approx(u1 + u2)
    assert found.srss == pytest.approx(np.hypot(u1, u2))
    squares = u1**2 + u2**2 - 2 * found.correlation * u1 * u2
    assert found.double_difference == pytest.approx(squares**0.5)
    assert found.double_difference < found.srss < found.absolute_sum
    assert found.required_gap == linear().required_gap(0.01)


def test_the_probability_of_pounding_at_any_gap_from_one_run():
    """The gap of the scenarios is the default."""
    required = stats.lognorm(SIGMA, scale=MEDIAN * float(1 - unit().min_gap))
    for gap in (0.1, 0.3, 0.8):
        estimate = linear().pounding_probability(gap, 0.999)
        assert estimate.low <= required.sf(gap) <= estimate.high < estimate.low + 0.06
        needed = linear().required_gap(float(required.sf(gap)), 0.999)
        assert needed.low <= gap <= needed.high
    close = dataclasses.replace(SLIDING, initial_gap=0.2)
    wide, narrow = study(LINEAR, 200), study(jp.Scenarios(close, LINEAR.ground), 200)
    assert_allclose(wide["required_gap"], narrow["required_gap"], rtol=1e-9, atol=1e-12)
    assert narrow.pounding_probability() == wide.pounding_probability(0.2)
    assert narrow.pounding_probability().value == np.mean(narrow["pounds"])


def test_answers_in_si_units():
    scales = jp.Scales(2e5, 7.0)
    si = dataclasses.replace(linear(), scales=scales)
    assert si.pounding_probability(0.3 * scales.length) == linear().pounding_probability(0.3)
    needed, bare = si.required_gap(0.1), linear().required_gap(0.1)
    assert_allclose(needed[:3], np.array(bare[:3]) * scales.length)
    assert si.si
    for name in linear().columns:
        values = linear()[name] * float(scales.unit_of(kind_of(name)))
        assert_allclose(si[name], values, rtol=1e-12)
        assert si.moments(name).mean == pytest.approx(float(np.mean(values)))
    assert "(SI)" in repr(si)


def test_a_store_of_dimensionless_structures_with_scales_opens_in_si_and_is_not_resumed(
    tmp_path, monkeypatch
):
    """As earlier versions made them."""
    bare = study()
    with monkeypatch.context() as earlier:
        earlier.setattr("jaxpound.study.run.result_units", lambda _: jp.Scales(1e5, 7.0))
        study(store=tmp_path)
    opened = jp.Study.open(tmp_path)
    assert float(opened.scales.mass) == 1e5
    assert (opened.unit("pga"), "(SI)" in repr(opened)) == ("m/s²", True)
    assert_allclose(opened["pga"], bare["pga"] * 9.80665)
    refused(r"holds another study: scales is \{.*\} there and absent", study, store=tmp_path)


def test_any_object_with_a_dimension_and_a_way_to_realize_will_do():
    class Mine:
        dimension = 2

        def realize(self, z):
            return dataclasses.replace(SLIDING, friction=0.1 * jnp.exp(z[0])), lambda t: z[1] * t

    found = study(Mine(), 20)
    assert list(found.correlations()) == ["z_1", "z_2"]
    peak = jax.jit(jax.vmap(lambda z: jp.demand(*Mine().realize(z), GRID).peak_x2))
    assert_allclose(found["peak_x2"], peak(found.points()), rtol=1e-9)


def test_spectral_acceleration_is_a_measure_for_fragility():
    """Of a linear pair every peak is proportional to the wave's amplitude, and to its spectrum."""

    def sa(structures, ground):
        return jp.spectral_acceleration(ground, GRID, period=structures.natural_frequencies[0])

    at_2 = jp.study.SpectralAcceleration.of(SLIDING, 2.0, GRID)
    found = study(LINEAR, 400, measures={"sa": sa, "sa_2": at_2}, chunk_size=400)
    one, two = (jax.jit(x)(SLIDING, jp.Ricker(1.0, [2.0], [1.5])) for x in (sa, at_2))
    amplitude = MEDIAN * np.exp(SIGMA * found.points()[:, 0])
    assert_allclose(found["sa"], amplitude * float(one), rtol=1e-9)
    assert_allclose(found["sa_2"], amplitude * float(two), rtol=1e-9)
    assert str(found.measure("sa_2")) == "Sa(2 1/ω1) (g)"
    noisy = found["required_gap"] * np.random.default_rng(0).lognormal(0, 0.2, 400)
    threshold = float(np.median(noisy))
    curve = jp.fit_fragility(found["sa"], noisy >= threshold)
    at_half = threshold * float(one) / float(1 - unit().min_gap)
    assert curve.median == pytest.approx(at_half, rel=4 * curve.median_error / curve.median)


@pytest.mark.parametrize("sampling", ["plain", "sobol"])
def test_samples_do_not_depend_on_chunks_or_shards_or_where_they_run(tmp_path, sampling):
    whole, sevens = study(sampling=sampling), {"sampling": sampling, "store": tmp_path / "c"}
    drawn = points(sampling, jax.random.key(0), RANDOM.dimension)
    assert_array_equal(whole.points(), drawn(0, 50))
    ways = [study(chunk_size=7, **sevens), study(sampling=sampling, store=tmp_path / "a")]
    assert len(study(n=60, chunk_size=None, **sevens)) == 60  # the store's
    assert len([*(tmp_path / "c").glob("chunk-*")]) == 9
    with ThreadPoolExecutor(3) as threads:
        ways.append(study(sampling=sampling, executor=threads))
    parts = [study(sampling=sampling, store=tmp_path / "b", shard=(i, 3)) for i in (1, 2, 3)]
    assert sorted(np.concatenate([part.indices for part in parts])) == list(range(50))
    ways.append(jp.Study.open(tmp_path / "b"))
    for way in ways:
        assert_array_equal(way.indices, whole.indices)
        assert_same(way, whole)
    for part in parts:
        assert_allclose(part["pga"], whole["pga"][part.indices], rtol=1e-9)
        assert_array_equal(part.points(), whole.points()[part.indices])
    assert files(tmp_path / "a") == files(tmp_path / "b")


def test_a_study_has_eight_chunks_and_ctrl_c_says_which_are_kept(tmp_path, monkeypatch):
    folder, finished, compute = tmp_path / "study", [], Task.compute

    def computed(task, chunk):
        if len(finished) == 2:
            raise KeyboardInterrupt
        finished.append(chunk)
        return compute(task, chunk)

    with monkeypatch.context() as patch:
        patch.setattr(Task, "compute", computed)
        kept = (
            f"^monte_carlo: interrupted; what was finished is kept in {folder}, and the same call"
        )
        with pytest.raises(KeyboardInterrupt, match=kept):
            study(LINEAR, 300, store=folder, chunk_size=None)
        with pytest.raises(KeyboardInterrupt, match="interrupted; nothing is kept, as there is no"):
            study(LINEAR, 300)
    assert len([*folder.glob("chunk-*")]) == 2
    assert len(study(LINEAR, 300, store=folder, chunk_size=None)) == 300
    assert len([*folder.glob("chunk-*")]) == 10  # of 32 samples
    read, chunks = Store.read, []
    monkeypatch.setattr(Store, "read", lambda *x: (chunks.append(x[1]), read(*x))[1])
    wide = study(LINEAR, 300, store=tmp_path / "wide", chunk_size=None, keep_parameters=True)
    chunks.clear()
    assert wide.parameters()["amplitude"].shape == (300,)
    assert chunks == [*range(10)]  # each is opened once, whatever the number of parameters
    assert Store(folder).chunk_size == 32


def test_samples_are_the_same_in_another_process_on_two_devices(tmp_path):
    chunks = {"n": 2000, "chunk_size": 1000}
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, spawn, jp.runtime.use_cores, (2,)) as processes:
        assert processes.submit(jax.device_count).result() == 2
        samples = study(store=tmp_path / "study", executor=processes, **chunks)
    assert jax.device_count() == 1
    assert_same(samples, study(**chunks))


def test_a_key_is_a_seed_or_a_key_and_precision_the_caller_s(tmp_path):
    seeded = study(n=8, key=3)["pga"]
    for key in (jax.random.key(3), jax.random.PRNGKey(3)):
        assert_array_equal(study(n=8, key=key)["pga"], seeded)
    assert np.abs(seeded - study(n=8, key=4)["pga"]).min() > 0
    with jax.enable_x64(False):
        assert study(n=8, store=tmp_path)["pga"].dtype == np.float32
    assert jp.Study.open(tmp_path)["pga"].dtype == np.float32
    refused("precision is 'float32' there and 'float64' here", study, n=8, store=tmp_path)


def test_a_finished_study_is_read_not_run(tmp_path, monkeypatch):
    stored = {"store": tmp_path}
    first, before = study(**stored, notes={"who": "me"}), files(tmp_path)
    monkeypatch.setattr("jaxpound.study.chunk.Task.finish", None)
    again, opened = study(**stored), jp.Study.open(tmp_path)
    for same in (opened, again):
        assert_same(same, first, 0, 0)
    assert files(tmp_path) == before
    assert opened.about["notes"] == {"who": "me"}
    assert repr(opened) == repr(first)
    refused("keep_parameters=True keeps them", opened.parameters)
    assert next(iter(again.parameters())) == "friction"


def test_a_study_grows_and_serves_fewer_and_makes_a_damaged_chunk_anew(tmp_path):
    folder = tmp_path / "study"
    small, large = (study(n=n, store=folder) for n in (20, 50))
    assert_array_equal(large["pga"][:20], small["pga"])
    assert_array_equal(study(n=20, store=folder)["pga"], small["pga"])
    before = files(folder)
    study(n=50, store=tmp_path / "new")
    assert before == files(tmp_path / "new")
    # Fewer samples than the store is for write whole chunks.
    (folder / "chunk-000001.npz").unlink()
    few = study(n=20, store=folder)
    assert len(few) == few.moments("pga").n == 20
    assert files(folder) == before

    path = folder / "chunk-000001.npz"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    refused(r"chunk 1 is damaged \(.*\); run monte_carlo again", large.__getitem__, "pga")
    with pytest.warns(UserWarning, match=r"study: chunk 1 is damaged \(.*\); damaged chunks are"):
        half = jp.Study.open(folder)
    assert len(half) == 50 - 16
    with pytest.warns(UserWarning, match="chunk 1 is damaged"):
        study(store=folder)
    assert files(folder) == before
    # One worker after the other finds the same.
    path.write_bytes(data)
    with ThreadPoolExecutor(2) as threads, pytest.warns(UserWarning, match="chunk 1 is damaged"):
        study(store=folder, executor=threads)
    assert len(jp.Study.open(folder)) == 50


def test_a_stray_file_keeps_nobody_waiting_and_a_store_all_damaged_is_no_study(tmp_path):
    """The last chunk, of 2 samples, is not whole in a study of so many."""
    there = study(store=tmp_path)
    (tmp_path / "samples-2147483648").touch()
    assert_array_equal(jp.Study.open(tmp_path)["pga"], there["pga"][:48])
    study(n=20, store=tmp_path)
    for path in tmp_path.glob("chunk-*"):
        path.write_bytes(b"")
    with pytest.warns(UserWarning, match="chunk 0 is damaged .*; chunk 1 is damaged"):
        refused("at least one finished chunk", jp.Study.open, tmp_path)


UNCERTAIN, PAIR = "'UncertainStructures'", "'AdjacentStructures'"


def test_another_study_is_refused_with_what_differs(tmp_path):
    stored = {"n": 8, "store": tmp_path / "study"}
    study(**stored)
    before, kind = files(stored["store"]), "scenarios.structures.type"
    of_pair = dataclasses.replace(RANDOM, structures=SLIDING)
    for change, message in (
        ({"key": 1}, "key.numbers is "),
        ({"sampling": "sobol"}, "sampling is 'plain' there and 'sobol' here"),
        ({"scheme": jp.Scheme(order=1)}, "scheme.order is 2 there and 1 here"),
        ({"keep_parameters": True}, "columns is "),
        ({"chunk_size": 8}, "chunk_size is 16 there and 8 here"),
        ({"scenarios": of_pair}, f"{kind} is 'UncertainStructures' there and 'AdjacentStructures'"),
    ):
        refused(f"holds another study: .*{message}", study, **stored | change)
        assert files(stored["store"]) == before

    # A function with other numbers inside, too.
    stored["store"] = tmp_path / "of a function"
    for _ in range(2):
        study(jp.Scenarios(SLIDING, waves(MEDIAN)), **stored)
    refused("holds another study: program", study, jp.Scenarios(SLIDING, waves(0.4)), **stored)


def test_studies_survive_pickling_in_memory_and_from_a_store(tmp_path):
    scenarios = jp.Ensemble.drawn(RANDOM, 3)
    for kept in (study(), study(store=tmp_path / "kept"), jp.Study.open(tmp_path / "kept")):
        again = pickle.loads(pickle.dumps(kept))
        assert again.columns == kept.columns
        assert_array_equal(again["min_gap"], kept["min_gap"])
    again = pickle.loads(pickle.dumps(scenarios))
    both = [jax.tree.leaves(x.fresh(2).grounds) for x in (scenarios, again)]
    jax.tree.map(assert_array_equal, *both)


FILLING = """
import sys
import jax
jax.config.update("jax_enable_x64", True)
from jaxpound._xla import plan
plan.choose(plan.looped)
from tests.study.test_run import study
study(n=12_000, store=sys.argv[1], chunk_size=1000, shard=(int(sys.argv[2]), 2))
"""


def test_processes_that_fill_one_store_and_are_killed_go_on_to_the_same_files(tmp_path):
    """Two shards of a study at once; SIGKILL at a random moment of each."""
    both, whole, random = tmp_path / "both", tmp_path / "whole", np.random.default_rng(0)

    def written(shard):
        return [x for x in both.glob("chunk-*.npz") if int(x.name[6:12]) % 2 == shard - 1]

    command = [sys.executable, "-c", FILLING, str(both)]
    workers = [subprocess.Popen([*command, i], stderr=subprocess.PIPE) for i in "12"]
    for i, worker in enumerate(workers, 1):
        while worker.poll() is None and not written(i):
            time.sleep(0.01)
        time.sleep(random.uniform(0, 0.05))
        worker.send_signal(signal.SIGKILL)
        _, errors = worker.communicate()
        assert written(i), errors
    assert len([*both.glob("chunk-*.npz")]) < 12
    study(n=12_000, chunk_size=1000, store=both)
    study(n=12_000, chunk_size=1000, store=whole)
    assert_array_equal(jp.Study.open(both).indices, np.arange(12_000))
    assert len(files(whole)) == 12 + 2  # the manifest, and how many samples are asked for
    assert files(both) == files(whole)
    assert not [*both.glob("*.part")]
    few = study(n=2500, chunk_size=1000, store=both)
    assert_array_equal(few["pga"], jp.Study.open(both)["pga"][:2500])


def failing(z):
    """Orders above 1 in one tail, stiffnesses for which the step is too long in the other."""
    rod = jp.ZenerRod(jnp.where(z[0] > 1.5, 2.0, 0.5), 0.1, 1.0)
    stiffness = jnp.where(z[0] < -1.5, 1e4, 1.0)
    return dataclasses.replace(SLIDING, rod_1=rod, stiffness_ratio=stiffness)


FAILING = jp.Scenarios(jp.CustomDraw(failing, 1, ("z",)), jp.Ricker(0.3, [2.0], [1.5]))


def test_scenarios_that_fail_are_named_or_kept_and_left_out(tmp_path):
    words = r"scenario \d+ fails: "
    order = r".*order = 2 must be in \(0, 1\]"
    refused(words + order, study, FAILING, store=tmp_path / "study")
    refused(f"{words}.*must be positive and below the stability limit", study, FAILING, key=10)
    # An error in a worker reaches the caller and stops the rest.
    with ThreadPoolExecutor(1) as threads:
        refused("fails", study, FAILING, executor=threads, store=tmp_path / "threads")
    found = study(FAILING, keep_failures=True)
    bad = np.abs(found.points()[:, 0]) > 1.5
    assert 0 < found.failed == bad.sum() < 20
    assert_array_equal(np.isnan(found["min_gap"]), bad)
    assert np.isnan(found["pounds"][bad]).all()
    assert found.moments("peak_x1").n == 50 - bad.sum()
    good = found["required_gap"][~bad]
    assert found.required_gap(0.5).value == pytest.approx(np.median(good))
    assert found.pounding_probability(0.1).value == pytest.approx(np.mean(good >= 0.1))


test_bad_arguments_are_named = refusals(
    ({"n": 0}, "n = 0 must be a positive whole number"),
    ({"n": 2**31 + 1}, "n = 2147483649 must be at most 2,147,483,648 for plain"),
    ({"scenarios": jp.paper.structures()}, "scenarios = .* must be of type ScenarioSet"),
    ({"sampling": "halton"}, "sampling = 'halton' must be one of plain, sobol"),
    ({"key": -1}, "key = -1 must be a whole number from 0"),
    ({"key": "seed"}, "key = 'seed' must be a whole number or a key"),
    ({"key": jax.random.key(3, impl="rbg")}, "key of kind rbg must be of kind threefry2x32"),
    ({"chunk_size": 0}, "chunk_size = 0 must be a positive whole number"),
    ({"notes": {1, 2}}, "notes must be what JSON can hold"),
    ({"key": jnp.asarray(3.0)}, "must be a whole number or a key"),
    ({"key": jax.random.split(jax.random.key(0))}, "must be a whole number or a key"),
    ({"scheme": "fast"}, "scheme = 'fast' must be of type Scheme"),
    ({"chunk_size": 2.5}, "chunk_size = 2.5 must be a positive whole number"),
    ({"shard": (0, 2)}, r"shard = \(0, 2\) must be \(i, k\)"),
    ({"shard": (1, 2)}, r"shard = \(1, 2\) must come with a folder"),
    ({"store": 3}, "folder = 3 must be of type str or PathLike or None"),
    ({"measures": {"pga": lambda s, g: 1.0}}, "'pga' is the name of a demand"),
    ({"measures": {"two": lambda s, g: jnp.ones(2)}}, r"'two' of shape \(2,\) must be one"),
    ({"measures": {"a/b": lambda s, g: 1.0}}, "column 'a/b' must have a name of 1 to 200"),
    ({"measures": {"a\0": lambda s, g: 1.0}}, r"column 'a\\x00' must have a name"),
    ({"measures": {3: lambda s, g: 1.0}}, "column 3 must have a name"),
    ({"measures": {"two": 3}}, r"measures\['two'\] = 3 must be a function"),
    ({"shard": (5, 5), "store": "never made"}, r"leave a chunk for each shard: the study has 4"),
    of=lambda change: study(**change),
)


@pytest.mark.usefixtures("small_machine")
def test_what_memory_has_no_room_for_is_refused_before_it_is_asked_for():
    for change, message in (
        ({}, r"n \(without a store\) = 2,147,483,648 would take \d+ GB of memory; this .* 24 GB"),
        ({"chunk_size": 2**31, "store": "never"}, r"samples of a chunk = 2,147,483,648 would take"),
        ({"chunk_size": 1, "store": "never"}, r"number of chunks = 2,147,483,648 would take .* TB"),
        ({"chunk_size": 2**40, "store": "never", "n": 4}, "chunk_size = .* must be from 1 to"),
    ):
        refused(message, study, **{"n": 2**31} | change)
        assert not Path("never").exists()


CONFIDENCE = "pounding_probability: confidence = 95 must be between 0 and 1"
test_questions_that_make_no_sense_are_refused = refusals(
    (lambda: linear()["gap"], "column 'gap' must be one of min_gap"),
    (lambda: linear().pounding_probability(-1.0), "gap = -1 must be finite and not negative"),
    (lambda: linear().pounding_probability(0.1, 95), CONFIDENCE),
    (lambda: linear().required_gap(0.0), "probability = 0 must be between 0 and 1"),
    (lambda: linear().required_gap(0.1, 95), "required_gap: confidence = 95 must be between"),
    (lambda: linear().separation(1.0), "separation: probability = 1 must be between 0 and 1"),
    (lambda: linear().correlations(kind="fancy"), "kind = 'fancy' must be one of rank, linear"),
)
