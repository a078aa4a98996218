"""Test which weights in a folder are accepted and refused."""

import json

import numpy as np
import pytest
import safetensors.torch
import torch
import transformers
from tiny_families import tokens

from dfd.encoders.encode import load_encoder

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ("{", "cannot be read"),
        ("[]", "contains no JSON object"),
        ("{}", "must have a config.json with a `model_type`"),
        ('{"model_type": "abacus"}', "must be a model that the installed transformers has, got the type 'abacus'"),
        ('{"model_type": "dinov2", "hidden_size": "wide"}', "valid config.json of a dinov2 model, got `hidden_size`"),
    ],
)
def test_configurations_that_make_no_sense_are_refused(folder, config, message):
    (folder / "config.json").write_text(config)
    with pytest.raises((ValueError, OSError), match=f"load_encoder: .*{message}"):
        load_encoder(folder)


@pytest.mark.parametrize("kept", [0, 5, 1000, -100])
def test_weights_cut_short_are_refused(folder, kept):
    path = folder / "model.safetensors"
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(OSError, match="load_encoder: `encoder`: the weights in .* cannot be read"):
        load_encoder(folder)


def _change(folder, change):
    path = folder / "model.safetensors"
    tensors = safetensors.torch.load_file(path)
    change(tensors)
    safetensors.torch.save_file(tensors, path, metadata={"format": "pt"})


def test_weights_of_the_wrong_shape_are_refused(folder):
    _change(folder, lambda tensors: tensors.update({"encoder.layer.1.mlp.fc1.weight": torch.zeros(32, 12)}))
    with pytest.raises(ValueError, match=r"must have .*fc1\.weight of shape \(32, 16\), got \(32, 12\)"):
        load_encoder(folder)
    _change(folder, lambda tensors: tensors.update({"encoder.layer.1.mlp.fc1.weight": torch.zeros(32, 16)}))
    config = json.loads((folder / "config.json").read_text())
    (folder / "config.json").write_text(json.dumps({**config, "hidden_size": 32}))
    with pytest.raises(ValueError, match="of shape"):
        load_encoder(folder)


def test_missing_weights_are_refused_unless_they_are_not_used(folder):
    expected = tokens(load_encoder(folder, block=2, device="cpu"))
    _change(folder, lambda tensors: tensors.pop("embeddings.mask_token"))
    _change(folder, lambda tensors: tensors.pop("encoder.layer.2.norm1.weight"))
    assert np.array_equal(tokens(load_encoder(folder, block=2, device="cpu")), expected)
    with pytest.raises(ValueError, match=r"lacks 1 tensors of a dinov2 .*, such as encoder\.layer\.2\.norm1\.weight"):
        load_encoder(folder)
    _change(folder, lambda tensors: [tensors.pop(name) for name in list(tensors)[1:]])
    with pytest.raises(ValueError, match="lacks .* tensors"):
        load_encoder(folder, block=1)


def test_sharded_weights_are_read_and_counted(folder, tmp_path):
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


def test_a_folder_says_how_its_pictures_are_normalized(folder):
    plain = load_encoder(folder, device="cpu", precision="float32")
    assert plain._model.channels.mean == (0.485, 0.456, 0.406)
    (folder / "preprocessor_config.json").write_text('{"image_mean": [0.5, 0.5, 0.5], "image_std": [0.25, 0.25, 0.25]}')
    own = load_encoder(folder, device="cpu", precision="float32")
    assert own._model.channels.std == (0.25, 0.25, 0.25)
    assert not np.array_equal(tokens(plain), tokens(own))
