"""Test the files of the field cache, and the keys by which they are found."""

import os
import time
from pathlib import Path

import numpy as np
import pytest
from made_field import made_field, same
from mesh_files import CORNERS, CUBE

import dfd
from dfd.field import cache as field_cache
from dfd.field.cache_key import cache_key, hash_arrays, hash_key


@pytest.fixture(autouse=True)
def cache(monkeypatch, tmp_path):
    """Return the folder of entries, the test's own."""
    monkeypatch.setenv("DFD_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache" / "fields"


def store(name, cache, age=0.0, seed=0):
    """Store a field that was used `age` seconds ago, and return its file."""
    before = set(cache.glob("*")) if cache.exists() else set()
    field_cache.store({"name": name}, made_field(4, width=8, layers=1, seed=seed))
    (entry,) = set(cache.glob("*")) - before
    os.utime(entry, (time.time() - age,) * 2)
    return entry


def test_a_damaged_entry_is_not_found_and_goes_when_its_field_is_stored_again(cache):
    damaged, other = store("a", cache), store("b", cache)
    damaged.write_bytes(damaged.read_bytes()[:-4] + b"1234")
    assert field_cache.find({"name": "a"}) is None
    store("a", cache, seed=1)
    assert not damaged.exists()
    assert other.exists()
    assert same(field_cache.find({"name": "a"}), made_field(4, width=8, layers=1, seed=1))


def test_no_file_stays_if_the_field_cannot_be_written(cache, monkeypatch):
    replace = Path.replace

    def full(path, target):
        if not Path(target).name.startswith("."):
            raise OSError(28, "No space left on device")
        return replace(path, target)

    monkeypatch.setattr(Path, "replace", full)
    with pytest.warns(RuntimeWarning, match="No space left on device"):
        field_cache.store({"name": "a"}, made_field(4, width=8, layers=1))
    assert list(cache.iterdir()) == []


def test_entries_longest_unused_go_first(cache, monkeypatch):
    old, older, oldest = (store(name, cache, age) for name, age in (("a", 100), ("b", 200), ("c", 300)))
    assert field_cache.find({"name": "c"}) is not None  # used: now the newest
    monkeypatch.setattr(field_cache, "LIMIT", 3 * old.stat().st_size + 10)
    litter, recent = cache / ".0123.safetensors", cache / ".4567.safetensors"
    for path, age in ((litter, 4000), (recent, 3000)):  # unfinished files: abandoned, and perhaps being written
        path.write_bytes(b"half")
        os.utime(path, (time.time() - age,) * 2)
    newest = store("d", cache)
    assert set(cache.iterdir()) == {old, oldest, newest, recent}
    assert not older.exists()
    monkeypatch.setattr(field_cache, "LIMIT", 1)
    assert store("e", cache).exists()  # what was just made stays, however large
    assert not newest.exists()


def test_a_key_depends_on_the_mesh_and_on_each_setting_and_not_on_their_order():
    mesh = dfd.Mesh(CORNERS, CUBE)
    keys = [
        cache_key(mesh, views=3, encoder="a"),
        cache_key(dfd.Mesh(CORNERS * 2, CUBE), views=3, encoder="a"),
        cache_key(mesh, views=4, encoder="a"),
        cache_key(mesh, views=3),
    ]
    assert len({hash_key(key) for key in keys}) == 4
    assert hash_key(cache_key(dfd.Mesh(CORNERS, CUBE), encoder="a", views=np.int64(3))) == hash_key(keys[0])
    assert len(hash_key(keys[0])) == 64


def test_the_hash_of_arrays_depends_on_types_shapes_and_values():
    values = np.arange(6, dtype=np.int32)
    others = [values + 1, values.reshape(2, 3), values.view(np.uint32), values[::-1]]
    assert len({hash_arrays(each) for each in (values, *others)}) == 5
    assert hash_arrays(values, values) != hash_arrays(values)
    assert hash_arrays(np.asfortranarray(others[1])) == hash_arrays(others[1])
