import errno
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest

import jaxpound as jp
from jaxpound.store import archive
from jaxpound.store.archive import DamagedError, write_archive
from jaxpound.store.store import MANIFEST, Store, _differences, describe
from tests.refusals import refused

IDENTITY = {"chunk_size": 4, "precision": "float64", "columns": ["a", "b"], "grid": {"dt": 0.1}}


def columns(start, n):
    rows = np.arange(start, start + n)
    return {"a": rows / 3, "b": np.sqrt(rows)}


def assert_held(store, chunk, start, n):
    read = store.read(chunk)
    for name, x in columns(start, n).items():
        np.testing.assert_array_equal(read[name], x)


@pytest.fixture
def store(tmp_path):
    store = Store.create(tmp_path / "study", IDENTITY, 10, {"notes": "mine"})
    for chunk in store.chunks():
        store.write(chunk, columns(store.rows(chunk).start, len(store.rows(chunk))))
    return store


def test_what_was_written_is_read_and_a_store_grows_and_serves_fewer(store):
    assert [list(store.rows(k)) for k in store.chunks()] == [[0, 1, 2, 3], [4, 5, 6, 7], [8, 9]]
    again = Store(store.folder)
    assert (again.n, again.manifest["notes"]) == (10, "mine")
    for chunk, start in enumerate((0, 4, 8)):
        assert_held(again, chunk, start, len(store.rows(chunk)))
        for name, x in columns(start, len(store.rows(chunk))).items():
            np.testing.assert_array_equal(again.read(chunk, [name])[name], x)
    assert again.read(3) is None
    with pytest.raises(DamagedError, match=r"chunk 0 is damaged \(it lacks 'c'"):
        again.read(0, ["c"])
    larger = Store.create(store.folder, IDENTITY, 13, {"notes": None})
    assert (Store(store.folder).n, Store(store.folder).manifest["notes"]) == (13, "mine")
    assert [larger.read(k) is not None for k in larger.chunks()] == [True, True, False, False]
    fewer = Store.create(store.folder, IDENTITY, 6, {})
    assert Store(store.folder).n == 13
    assert_held(fewer, 1, 4, 2)


def flipped(path, bits):
    """The file with one bit changed, in every byte those that are asked for in turn."""
    data = path.read_bytes()
    for place in range(len(data)):
        for bit in bits(place):
            path.write_bytes(data[:place] + bytes([data[place] ^ 1 << bit]) + data[place + 1 :])
            yield


def test_no_flipped_bit_goes_unnoticed(tmp_path):
    """Of a chunk, where some bytes are of no consequence, such as a date; and of a manifest."""
    store = Store.create(tmp_path / "study", IDENTITY, 4, {"notes": "mine"})
    store.write(0, columns(0, 4))
    (path,) = store.folder.glob("chunk-*")
    noticed = harmless = 0
    for _ in flipped(path, lambda place: {place % 8, 3 * place % 8}):
        try:
            assert_held(store, 0, 0, 4)
            harmless += 1
        except DamagedError:
            noticed += 1
    assert noticed > 3 * harmless > 0
    whole, noticed = store.manifest, 0
    for _ in flipped(store.folder / MANIFEST, lambda place: range(8)):
        try:
            assert Store(store.folder).manifest == whole  # a space that is another one now
        except ValueError:
            noticed += 1
    assert noticed > 8 * 200


def sealed(store, changed=None, **seal):
    """Chunk 1 as an archive with a good seal, of other columns."""
    about = {"study": store._study, "chunk": 1, "rows": 4} | seal
    write_archive(store.folder / "chunk-000001.npz", columns(4, 4) | (changed or {}), about)


@pytest.mark.parametrize(
    ("put", "message"),
    [
        (lambda s: sealed(s, {"a": np.ones(4, np.float32)}), "'a' is float32 .* not float64"),
        (lambda s: sealed(s, {"a": np.ones(4) * 1j}), "'a' is complex128"),
        (lambda s: sealed(s, {"a": np.ones(5)}), r"of shape \(5,\), not float64 of shape \(4,\)"),
        (lambda s: sealed(s, {"a": np.ones((4, 1))}), r"of shape \(4, 1\)"),
        (lambda s: sealed(s, {"c": np.ones(4)}), "its columns are others"),
        (lambda s: sealed(s, chunk=2), "chunk is 2 there and 1 here"),
        (lambda s: sealed(s, rows=3), "rows is 3 there and 4 here"),
        (lambda s: sealed(s, study="other"), "study is 'other' there"),
        (lambda s: np.savez(s.folder / "chunk-000001.npz", **columns(4, 4)), "seal.json"),
        (lambda s: os.mkfifo(fresh(s)), "it is no regular file"),
        (lambda s: os.symlink("chunk-000001.npz", fresh(s)), "it is a link to itself"),
        (lambda s: os.symlink("/dev/zero", fresh(s)), "it is no regular file"),
        (lambda s: shutil.copy(s.folder / "chunk-000000.npz", fresh(s)), "chunk is 0 there and 1"),
        # Cut short, or so long that it would fill the memory.
        *[(lambda s, n=n: os.truncate(s._path(1, 4), n), "") for n in (0, 10, 300, 10**11)],
    ],
)
def test_what_is_no_chunk_of_this_place_is_damage_and_made_anew(store, put, message):
    put(store)
    with pytest.raises(DamagedError, match=f"chunk 1 is damaged .*{message}"):
        store.read(1)
    store.write(1, columns(4, 4))
    assert_held(store, 1, 4, 4)


def fresh(store):
    path = store.folder / "chunk-000001.npz"
    path.unlink()
    return path


def test_folders_in_the_place_of_chunks_other_studies_and_other_things_are_left_alone(store):
    again = Store.create, store.folder
    words = r"holds another study: grid.dt is 0.1 there and 0.2 here"
    refused(words, *again, IDENTITY | {"grid": {"dt": 0.2}}, 10, {})
    words = r"holds another study: grid.dt is 0.1 there and 0.2 here; columns is "  # cut lists last
    longer = {"columns": [*map(str, range(20))], "grid": {"dt": 0.2}}
    refused(words, *again, IDENTITY | longer, 10, {})
    kept = IDENTITY | {"rods": [{"k": 1, "ends": [0, 1]}, {"k": 2, "ends": [1, 2]}]}
    current = IDENTITY | {"rods": [{"k": 1, "ends": [0, 1]}, {"k": 3, "ends": [1, 2]}]}
    assert [*_differences(kept, current)] == ["rods.1.k is 2 there and 3 here"]
    words = r"grid.h is absent there and 1 here"
    refused(words, *again, IDENTITY | {"grid": {"dt": 0.1, "h": 1}}, 10, {})
    assert all(store.read(k) is not None for k in store.chunks())
    fresh(store).mkdir()
    with pytest.raises(DamagedError, match="it is no regular file"):
        store.read(1)
    with pytest.raises(OSError, match=r"the store cannot be written \(Is a directory"):
        store.write(1, columns(4, 4))
    folder = store.folder.with_name("home")
    folder.mkdir()
    (folder / "thesis.tex").write_text("years of work")
    refused(r"or hold a manifest.json, but has 'thesis", Store.create, folder, IDENTITY, 10, {})
    assert [p.name for p in folder.iterdir()] == ["thesis.tex"]


def test_folders_manifests_and_identities_that_make_no_store_are_refused(tmp_path, monkeypatch):
    many = '{"format": 2, "n": ' + "9" * 5000 + "}"
    for text, message in (
        (None, r"must be a folder with a manifest.json"),
        *((text, r"manifest.json is damaged") for text in ("", "{", "[]", "[" * 100_000, many)),
        ('{"format": 2}', r"manifest.json is damaged \(its checksum is wrong\)"),
        ('{"format": 99}', r"format 99 must be 2; another version"),
        ('{"format": 1, "n": 10, "identity": {}}', r"format 1 must be 2; .* run the study anew"),
    ):
        if text is not None:
            (tmp_path / MANIFEST).write_text(text)
        refused(message, Store, tmp_path)
    missing = tmp_path / "no" / "study"
    refused(f"manifest.json; there is no folder {missing}", jp.Study.open, missing)
    # What is no file: a folder, a pipe, a link to itself, a device.
    to_itself, to_a_device = (lambda p: p.symlink_to(p)), (lambda p: p.symlink_to("/dev/zero"))
    for i, put in enumerate((Path.mkdir, os.mkfifo, to_itself, to_a_device)):
        folder = tmp_path / f"{i}"
        folder.mkdir()
        put(folder / MANIFEST)
        refused(r"manifest.json is damaged \(it is", Store, folder)
        refused(r"manifest.json is damaged \(it is", Store.create, folder, IDENTITY, 10, {})
    for change, message in (
        ({"chunk_size": 0}, "chunk_size = 0 must be from 1"),
        ({"chunk_size": 10**12}, "chunk_size = 1000000000000 must be from 1 to 2,147,483,648"),
        ({"precision": "float16"}, "precision = 'float16' must be float32 or float64"),
        ({"columns": []}, r"columns = \[\] must be names"),
        ({"columns": ["../a"]}, "column '../a' must have a name"),
    ):
        refused(message, Store.create, tmp_path / "study", IDENTITY | change, 10, {})
        assert not (tmp_path / "study").exists()
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="the store cannot be written"):
        Store.create(tmp_path / "file", IDENTITY, 10, {})

    def link(*_):
        """A file system without links will do."""
        raise OSError(errno.EPERM, os.strerror(errno.EPERM))

    monkeypatch.setattr(archive.os, "link", link)
    assert Store.create(tmp_path / "study", IDENTITY, 10, {}).n == 10


def test_a_store_that_asks_for_too_much_is_read_by_its_chunks_or_refused(store, monkeypatch):
    """A stray file asks for 2^31 samples; the last chunk, of a smaller study, is not whole then."""
    (store.folder / "samples-2147483648").touch()
    (store.folder / "chunk-999999999.npz").touch()
    assert [Store(store.folder, *n).held() for n in ((), (6,))] == [[0, 1, 2], [0, 1]]
    assert [*dict(Store(store.folder).undamaged(Store(store.folder).held(), ""))] == [0, 1]
    stray = store.folder / "samples-9999999999"
    stray.touch()
    refused("samples-9999999999 must be at most 2147483648", Store, store.folder)
    stray.unlink()
    os.truncate(store.folder / MANIFEST, 10**11)  # of which nothing is on the disk
    refused(r"manifest.json is damaged \(it is too large\)", Store, store.folder)
    monkeypatch.setattr("jaxpound.store.store._LARGEST_MANIFEST", 1000)
    words, folder = r"must be at most 1,000 bytes with its notes", store.folder.with_name("other")
    refused(f"manifest.json {words}", Store.create, folder, IDENTITY, 10, {"notes": "x" * 1000})


def test_a_file_that_finds_no_more_room_is_given_up(tmp_path):
    """The operating system's own refusal in the middle of a file."""
    resource = pytest.importorskip("resource")
    store = Store.create(tmp_path / "study", IDENTITY | {"chunk_size": 100_000}, 100_004, {})
    small, large = columns(100_000, 4), columns(0, 100_000)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    words = r"cannot be written \(File too large\).* its finished chunks are kept"
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, hard))
    try:
        store.write(1, small)
        with pytest.raises(OSError, match=words) as refusal:
            store.write(0, large)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    path = store.folder / "chunk-000000.npz"
    assert (refusal.value.errno, refusal.value.filename) == (errno.EFBIG, str(path))
    assert not [*store.folder.glob("*.part")]
    assert store.read(1)["a"].tolist() == small["a"].tolist()


def test_a_folder_that_may_only_be_read_is_read():
    """As somebody without rights, which root is not."""
    with tempfile.TemporaryDirectory() as name:
        folder, root = Path(name), os.geteuid() == 0
        store = Store.create(folder / "study", IDENTITY, 10, {})
        store.write(0, columns(0, 4))
        folder.chmod(0o755)
        store.folder.chmod(0o555)
        if root:
            os.seteuid(65534)
        try:
            again = Store.create(store.folder, IDENTITY, 10, {})
            assert_held(again, 0, 0, 4)
            with pytest.raises(OSError, match=r"cannot be written \(Permission denied\)"):
                again.write(1, columns(4, 4))
            with pytest.raises(OSError, match=r"cannot be written \(Permission denied\)"):
                Store.create(store.folder, IDENTITY, 20, {})
        finally:
            if root:
                os.seteuid(0)
            store.folder.chmod(0o755)
        assert [path.name for path in store.folder.glob("chunk*")] == ["chunk-000000.npz"]


WRITER = """
import sys, time
import numpy as np
from jaxpound.store.store import Store
store = Store(sys.argv[1])
print("ready", flush=True)
while True:
    for chunk in store.chunks():
        rows = np.arange(20_000.0) + 20_000 * chunk
        store.write(chunk, {"a": rows, "b": -rows})
"""


def test_a_process_killed_at_any_moment_leaves_whole_chunks_only(tmp_path):
    random = np.random.default_rng(0)
    store = Store.create(tmp_path, IDENTITY | {"chunk_size": 20_000}, 60_000, {})
    half_written = kills = 0
    while kills < 4 or (not half_written and kills < 40):  # chance may spare all of four
        kills += 1
        arguments = [sys.executable, "-c", WRITER, str(tmp_path)]
        with subprocess.Popen(arguments, stdout=subprocess.PIPE) as writer:
            assert writer.stdout.readline() == b"ready\n"
            time.sleep(random.uniform(0, 0.1))
            writer.kill()
        half_written += len([*tmp_path.glob("*.part")])
        Store.create(tmp_path, store.manifest["identity"], 60_000, {})
        assert not [*tmp_path.glob("*.part")]
        for chunk in store.chunks():
            if store.has(chunk):
                found = store.read(chunk)
                assert found["a"][0] == 20_000 * chunk
                np.testing.assert_array_equal(found["a"], -found["b"])
    assert half_written


MAKER = """
import sys, json
from jaxpound.store.store import Store
for i in range(50):
    Store.create(f'{sys.argv[1]}/{i}', json.loads(sys.argv[2]), 10, {})
"""


def ends(program, *arguments, given=b""):
    """What processes of a program write to stderr that run at once."""
    commands = [[sys.executable, "-c", program, *each] for each in arguments]
    pipes = {"stdin": subprocess.PIPE, "stderr": subprocess.PIPE}
    workers = [subprocess.Popen(command, **pipes) for command in commands]
    return [worker.communicate(given)[1].decode() for worker in workers]


def test_processes_that_make_one_store_at_once_agree_on_it(tmp_path):
    one, other = (json.dumps(IDENTITY | {"chunk_size": k}) for k in (4, 5))
    errors = ends(MAKER, *((tmp_path, kind) for kind in (one, one, other)))
    assert {Store(tmp_path / f"{i}").n for i in range(50)} == {10}
    # One of the two kinds was first, and all of the other were refused.
    assert sum("holds another study: chunk_size" in end for end in errors) in (1, 2, 3)
    assert not [*Path(tmp_path).glob("*/*.part")]


def test_a_smaller_study_leaves_what_a_larger_one_made_and_its_parts_until_then(tmp_path):
    """They start together, and either may be first to write the chunk that both have a part of."""
    folder = tmp_path / "study"
    small = Store.create(folder, IDENTITY, 6, {})
    large = Store.create(folder, IDENTITY, 11, {})
    larger = Store.create(folder, IDENTITY, 13, {})
    larger.write(2, columns(8, 4))
    larger.write(1, columns(4, 4))
    small.write(1, columns(4, 2))
    large.write(2, columns(8, 3))
    assert (Store(folder).n, small.n, large.n) == (13, 6, 11)
    assert_held(small, 1, 4, 2)
    assert_held(large, 2, 8, 3)
    assert_held(larger, 1, 4, 4)
    larger.write(0, columns(0, 4))
    larger.write(3, columns(12, 1))
    Store.create(folder, IDENTITY, 6, {})  # sweeps
    names = [*(f"chunk-00000{i}.npz" for i in range(3)), "chunk-000003-1.npz"]
    assert sorted(path.name for path in folder.iterdir()) == [*names, MANIFEST, "samples-13"]
    assert_held(small, 1, 4, 2)
    folder = tmp_path / "parts"
    store = Store.create(folder, IDENTITY, 6, {})
    store.write(1, columns(4, 2))
    larger = Store.create(folder, IDENTITY, 8, {})
    (folder / "chunk-000001.npz").write_bytes(b"damaged")
    larger.sweep()
    assert_held(store, 1, 4, 2)
    with pytest.raises(DamagedError):
        larger.read(1)
    larger.write(1, columns(4, 4))
    larger.sweep()
    assert not (folder / "chunk-000001-2.npz").exists()


GROWER = """
import json, sys
import numpy as np
from jaxpound.store.store import Store
identity = json.loads(sys.argv[2])
numbers = range(*map(int, sys.argv[3:]))
sys.stdin.readline()
for n in numbers:
    store = Store.create(sys.argv[1], identity, n, {})
    for chunk in store.chunks():
        if store.read(chunk) is None:
            most = Store(sys.argv[1]).rows(chunk)
            rows = np.arange(most.start, most.stop)
            store.write(chunk, {"a": rows / 3, "b": np.sqrt(rows)})
    store.sweep()
    for chunk in store.chunks():
        rows = np.arange(store.rows(chunk).start, store.rows(chunk).stop)
        assert store.read(chunk)["a"].tolist() == (rows / 3).tolist(), (n, chunk)
"""


def test_processes_that_grow_one_store_to_other_sizes_do_not_disturb_each_other(tmp_path):
    folder, identity = tmp_path / "study", json.dumps(IDENTITY)
    sizes = ("2", "80", "3"), ("3", "80", "2")
    assert ends(GROWER, *((folder, identity, *x) for x in sizes), given=b"go\n") == ["", ""]
    Store.create(folder, IDENTITY, 79, {})
    names = [f"chunk-{i:06d}{'-3' * (i == 19)}.npz" for i in range(20)]
    assert sorted(path.name for path in folder.iterdir()) == [*names, MANIFEST, "samples-79"]


def test_fields_that_came_later_make_no_other_study():
    """Where they are at their defaults; the reasons of a record's warnings never."""
    building = jp.ShearBuilding.from_period(2, 2e5, period=0.3, damping_ratio=0.05)
    assert [*describe(building)] == ["type", "storeys", "heights"]
    storeys = jp.Storeys((1.0,), jp.Rod(jp.ZenerRod(0.5, 0.01, 0.05), 5.0))
    row = describe(jp.Row((storeys, storeys), ()))
    assert [*row["buildings"][0]] == ["type", "masses", "rods"]
    assert [*describe(storeys.system())] == ["type", "masses", "rods", "links"]
    record = jp.Record([0.0, 0.1, -0.1], 0.02).scaled_to_pga(0.2)
    assert [*describe(record)] == ["type", "samples", "dt", "name", "time_unit"]
    tuned = jp.tuned_mass_damper(building, mass_ratio=0.05)
    assert describe(tuned)["n_tuned"] == 1
