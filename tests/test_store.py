import errno
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest

from jaxpound import store as store_module
from jaxpound.store import MANIFEST, Store

IDENTITY = {"chunk_size": 4, "columns": ["a", "b"], "grid": {"dt": 0.1}}


def columns(start, n):
    rows = np.arange(start, start + n)
    return {"a": rows / 3, "b": np.sqrt(rows)}


@pytest.fixture
def store(tmp_path):
    store = Store.create(tmp_path / "study", IDENTITY, 10, {"notes": "mine"})
    for chunk in store.chunks():
        store.write(chunk, columns(store.rows(chunk).start, len(store.rows(chunk))))
    return store


def test_what_was_written_is_read(store):
    assert [list(store.rows(k)) for k in store.chunks()] == [[0, 1, 2, 3], [4, 5, 6, 7], [8, 9]]
    again = Store(store.folder)
    assert (again.n, again.manifest["notes"]) == (10, "mine")
    for chunk, start in enumerate((0, 4, 8)):
        for name, x in columns(start, len(store.rows(chunk))).items():
            np.testing.assert_array_equal(again.read(chunk)[name], x)
            np.testing.assert_array_equal(again.read(chunk, [name])[name], x)
    assert again.read(3) is None
    assert again.read(0, ["c"]) is None


def test_a_store_grows_and_serves_fewer(store):
    larger = Store.create(store.folder, IDENTITY, 13, {"notes": None})
    assert Store(store.folder).n == 13
    assert Store(store.folder).manifest["notes"] == "mine"
    assert [larger.read(k) is not None for k in larger.chunks()] == [True, True, False, False]
    fewer = Store.create(store.folder, IDENTITY, 6, {})
    assert Store(store.folder).n == 13
    assert fewer.read(1)["a"].tolist() == columns(4, 2)["a"].tolist()


@pytest.mark.parametrize("change", [1, 8, 128, 255])
def test_no_damage_of_a_byte_goes_unnoticed(tmp_path, change):
    store = Store.create(tmp_path / "study", IDENTITY, 4, {})
    store.write(0, columns(0, 4))
    (path,) = store.folder.glob("chunk-*")
    data = path.read_bytes()
    noticed = 0
    for place in range(len(data)):
        path.write_bytes(data[:place] + bytes([data[place] ^ change]) + data[place + 1 :])
        read = store.read(0)
        noticed += read is None
        if read is not None:  # a byte of no consequence, such as a date
            for name, x in columns(0, 4).items():
                np.testing.assert_array_equal(read[name], x)
    assert noticed > len(data) / 2


@pytest.mark.parametrize("length", [0, 10, 300])
def test_a_file_cut_short_is_no_chunk(store, length):
    path = store.folder / "chunk-000001.npz"
    path.write_bytes(path.read_bytes()[:length])
    assert store.read(1) is None
    store.write(1, columns(4, 4))
    assert store.read(1) is not None


def test_another_study_is_refused_with_what_differs(store):
    with pytest.raises(ValueError, match=r"holds another study: grid.dt is 0.1 there and 0.2 here"):
        Store.create(store.folder, IDENTITY | {"grid": {"dt": 0.2}}, 10, {})
    with pytest.raises(ValueError, match=r"grid.h is absent there and 1 here"):
        Store.create(store.folder, IDENTITY | {"grid": {"dt": 0.1, "h": 1}}, 10, {})
    assert all(store.read(k) is not None for k in store.chunks())


def test_a_folder_of_other_things_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(ValueError, match=r"must be empty or hold a manifest.json, but has 'thesis"):
        Store.create(tmp_path, IDENTITY, 10, {})
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, r"must be a folder with a manifest.json"),
        ("{", r"manifest.json is damaged"),
        ('{"format": 99}', r"format 99 must be 1; another version"),
    ],
)
def test_a_folder_without_a_good_manifest_is_refused(tmp_path, text, message):
    if text is not None:
        (tmp_path / MANIFEST).write_text(text)
    with pytest.raises(ValueError, match=message):
        Store(tmp_path)


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS, errno.EACCES])
def test_a_disk_that_cannot_be_written_says_so_and_keeps_what_there_is(store, number, monkeypatch):
    def savez(file, **_):
        file.write(b"half a file")
        raise OSError(number, os.strerror(number))

    with monkeypatch.context() as patch:
        patch.setattr(store_module.np, "savez", savez)
        with pytest.raises(
            OSError, match=r"cannot be written .* its finished chunks are kept"
        ) as e:
            store.write(1, columns(4, 4))
    assert (e.value.errno, e.value.filename) == (number, str(store.folder))
    assert not [*store.folder.glob("*.part")]
    assert all(store.read(k) is not None for k in store.chunks())


def test_a_file_that_finds_no_more_room_is_given_up(store):
    """The operating system's own refusal in the middle of a file."""
    resource = pytest.importorskip("resource")
    small, large = columns(4, 4), columns(4, 100_000)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, hard))
    try:
        with pytest.raises(OSError, match=r"cannot be written \(File too large\)"):
            store.write(1, large)
        store.write(1, small)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert not [*store.folder.glob("*.part")]
    assert store.read(1)["a"].tolist() == small["a"].tolist()


def test_a_folder_that_may_only_be_read_is_read():
    """As somebody without rights, which root is not."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        store = Store.create(folder / "study", IDENTITY, 10, {})
        store.write(0, columns(0, 4))
        folder.chmod(0o755)
        store.folder.chmod(0o555)
        root = os.geteuid() == 0
        if root:
            os.seteuid(65534)
        try:
            again = Store.create(store.folder, IDENTITY, 10, {})
            assert again.read(0)["a"].tolist() == columns(0, 4)["a"].tolist()
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
from jaxpound.store import Store
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
    half_written = 0
    for _ in range(4):
        arguments = [sys.executable, "-c", WRITER, str(tmp_path)]
        with subprocess.Popen(arguments, stdout=subprocess.PIPE) as writer:
            assert writer.stdout.readline() == b"ready\n"
            time.sleep(random.uniform(0, 0.1))
            writer.kill()
        half_written += len([*tmp_path.glob("*.part")])
        for chunk in store.chunks():
            if store.has(chunk):
                found = store.read(chunk)
                assert found["a"][0] == 20_000 * chunk
                np.testing.assert_array_equal(found["a"], -found["b"])
    assert half_written


def test_a_file_in_the_place_of_the_folder_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="the store cannot be written"):
        Store.create(tmp_path / "file", IDENTITY, 10, {})


def test_a_file_system_without_links_will_do(tmp_path, monkeypatch):
    def link(*_):
        raise OSError(errno.EPERM, os.strerror(errno.EPERM))

    monkeypatch.setattr(store_module.os, "link", link)
    assert Store.create(tmp_path / "study", IDENTITY, 10, {}).n == 10


def test_what_killed_processes_left_is_swept_and_what_is_being_written_is_not(store):
    old, new = (store.folder / f"chunk-000001.npz-{name}.part" for name in ("old", "new"))
    for path, age in ((old, 4000), (new, 0)):
        path.write_bytes(b"half")
        os.utime(path, times=(time.time() - age,) * 2)
    store.sweep()
    assert new.exists()
    new.unlink()
    assert sorted(p.name for p in store.folder.iterdir()) == [
        "chunk-000000.npz",
        "chunk-000001.npz",
        "chunk-000002.npz",
        "manifest.json",
    ]


def test_processes_that_make_one_store_at_once_agree_on_it(tmp_path):
    code = (
        "import sys, json; from jaxpound.store import Store; "
        "identity = json.loads(sys.argv[2]); "
        "[Store.create(f'{sys.argv[1]}/{i}', identity, 10, {}) for i in range(50)]"
    )
    kinds = [json.dumps(IDENTITY)] * 2 + [json.dumps(IDENTITY | {"chunk_size": 5})]
    workers = [
        subprocess.Popen([sys.executable, "-c", code, tmp_path, kind], stderr=subprocess.PIPE)
        for kind in kinds
    ]
    ends = [worker.communicate()[1].decode() for worker in workers]
    made = {json.loads((Path(tmp_path) / f"{i}" / MANIFEST).read_text())["n"] for i in range(50)}
    assert made == {10}
    # One of the two kinds was first, and all of the other were refused.
    assert sum("holds another study: chunk_size" in end for end in ends) in (1, 2, 3)
    assert not [*Path(tmp_path).glob("*/*.part")]
