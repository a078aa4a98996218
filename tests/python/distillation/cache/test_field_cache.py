"""The cache of fields: found only for the very same call, sound or redone, bounded, and never in the way."""

import subprocess
import sys
import time
from typing import Any

import pytest
from made_field import same
from tiny_encoder import save_tiny_encoder

import dfd
import dfd.distillation.algorithm
import dfd.encoders.encode
from dfd import Field, Mesh
from dfd.distillation.distill import find_distilled
from dfd.distillation.settings import DistillSettings

SIZES: dict[str, Any] = {"views": 2, "resolution": 32, "steps": 3, "batch": 32}
SMALL: dict[str, Any] = {**SIZES, "progress": False, "device": "cpu"}


pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(autouse=True)
def cache(monkeypatch, tmp_path):
    """The folder of entries, the test's own."""
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    monkeypatch.setenv("DFD_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache" / "fields"


@pytest.fixture(scope="module")
def encoder(tmp_path_factory):
    return save_tiny_encoder(tmp_path_factory.mktemp("encoder") / "tiny")


@pytest.fixture
def work(monkeypatch):
    """What loads an encoder or takes pictures leaves its name here."""
    done: list[str] = []
    for module, name in ((dfd.encoders.encode, "load_encoder"), (dfd.distillation.algorithm, "render")):
        was = getattr(module, name)
        monkeypatch.setattr(
            module, name, lambda *given, _was=was, _name=name, **named: done.append(_name) or _was(*given, **named)
        )
    return done


def test_the_second_call_does_no_work(encoder, mesh, work, cache):
    first = dfd.distill(mesh, encoder, **SMALL)
    assert work == ["load_encoder", "render"]
    start = time.perf_counter()
    again = dfd.distill(Mesh(mesh.vertices, mesh.faces), encoder, **SMALL)  # another object of the same content
    assert time.perf_counter() - start < 1
    assert work == ["load_encoder", "render"]
    assert same(first, again)
    (entry,) = cache.iterdir()
    assert same(Field.load(entry), first)


def test_its_file_is_found_without_torch(encoder, mesh, cache, tmp_path):
    settings = DistillSettings(**SIZES)
    assert find_distilled(mesh, encoder, settings, device="cpu") is None
    first = dfd.distill(mesh, encoder, **SMALL)
    found = find_distilled(mesh, encoder, settings, device="cpu")
    assert (found.dimension, found.settings) == (first.dimension, first.settings)
    found.save(tmp_path / "copy.safetensors")
    assert same(Field.load(tmp_path / "copy.safetensors"), first)
    assert find_distilled(mesh, encoder, DistillSettings(**{**SIZES, "steps": 4}), device="cpu") is None
    assert find_distilled(mesh, tmp_path / "none", settings, device="cpu") is None

    mesh.save(tmp_path / "chair.obj")
    code = (
        "import sys, dfd\nfrom dfd.distillation.distill import find_distilled\n"
        "from dfd.distillation.settings import DistillSettings\n"
        f"mesh = dfd.load({str(tmp_path / 'chair.obj')!r})\n"
        f"found = find_distilled(mesh, {str(encoder)!r}, DistillSettings(**{SIZES!r}), device='cpu')\n"
        "print(found is not None, sorted({'torch', 'transformers', 'huggingface_hub.hf_api'} & sys.modules.keys()))"
    )
    same_mesh = dfd.load(tmp_path / "chair.obj")
    dfd.distill(same_mesh, encoder, **SMALL)
    asked = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert asked.stdout.split(maxsplit=1) == ["True", "[]\n"]


def test_any_other_ingredient_is_another_field(encoder, mesh, work, tmp_path):
    dfd.distill(mesh, encoder, **SMALL)
    changes = (
        {"views": 3},
        {"resolution": 40},
        {"framing": "paper"},
        {"simplify_to": 500},
        {"supervision": "vertex"},
        {"steps": 4},
        {"batch": 33},
        {"learning_rate": 1e-3},
        {"seed": 1},
    )
    for change in changes:
        dfd.distill(mesh, encoder, **{**SMALL, **change})
    moved = Mesh(mesh.vertices + 1e-3, mesh.faces)
    dfd.distill(moved, encoder, **SMALL)
    other = save_tiny_encoder(tmp_path / "other", seed=1)
    dfd.distill(mesh, other, **SMALL)
    save_tiny_encoder(other, seed=2)  # other weights in the same folder
    dfd.distill(mesh, other, **SMALL)
    config = (other / "config.json").read_text()
    (other / "config.json").write_text(config.replace('"layer_norm_eps": 1e-06', '"layer_norm_eps": 0.1'))
    dfd.distill(mesh, other, **SMALL)
    assert work == ["load_encoder", "render"] * (len(changes) + 5)


def test_a_damaged_entry_is_made_again(encoder, mesh, work, cache):
    first = dfd.distill(mesh, encoder, **SMALL)
    (entry,) = cache.iterdir()
    whole = entry.read_bytes()
    for content in (whole[:-20], whole[:-20] + bytes(20), b""):
        entry.write_bytes(content)
        work.clear()
        assert find_distilled(mesh, encoder, DistillSettings(**SIZES), device="cpu") is None
        assert same(dfd.distill(mesh, encoder, **SMALL), first)
        assert work == ["load_encoder", "render"]
        (entry,) = cache.iterdir()
        assert same(Field.load(entry), first)


def test_a_cache_that_cannot_be_written_is_one_warning(encoder, mesh, tmp_path, monkeypatch):
    (tmp_path / "full").write_text("a file where a folder should be")
    monkeypatch.setenv("DFD_CACHE", str(tmp_path / "full"))
    with pytest.warns(RuntimeWarning, match="cache folder .* cannot be written .* DFD_CACHE sets another") as told:
        field = dfd.distill(mesh, encoder, **SMALL)
    assert len(told) == 1
    assert told[0].filename == __file__
    assert same(dfd.distill(mesh, encoder, cache=False, **SMALL), field)
