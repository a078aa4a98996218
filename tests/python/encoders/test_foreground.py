"""Test that encoders skip the background if their network can."""

import numpy as np
import pytest
import torch
from tiny_families import normalized, pictures

from dfd.encoders.dinov2 import Dinov2, _checked, build_dinov2
from dfd.encoders.encode import load_encoder
from dfd.encoders.weight_files import EncoderWeights

pytestmark = pytest.mark.usefixtures("one_thread")


def square(count, size):
    """Return which pixels a rectangle at the left covers: 3 × 2 patches of 8 pixels, and one more row of pixels."""
    covered = np.zeros((count, size, size), bool)
    covered[:, 16:41, 0:16] = True
    return covered


@pytest.mark.parametrize("name", ["dinov2"])
def test_the_background_does_not_change_tokens(name, saved):
    encoder = load_encoder(saved(name).folder, device="cpu", precision="float32")
    images = pictures(2, 64)
    tokens = encoder.encode(images, covered=square(2, 64))
    kept = np.zeros((8, 8), bool)
    kept[1:7, 0:3] = True  # the patches with covered pixels, 4 × 2 of them, and their neighbors
    assert (tokens[:, ~kept] == 0).all()
    # The expected tokens are those of transformers for the sequence without the skipped patches.
    network = saved(name).model
    with torch.no_grad():
        sequence = network.embeddings(normalized(encoder, images))
        prefix = sequence.shape[1] - 64
        chosen = torch.from_numpy(np.concatenate([np.arange(prefix), prefix + np.flatnonzero(kept)]))
        expected = network.layernorm(network.encoder(sequence[:, chosen]).last_hidden_state)[:, prefix:].numpy()
    np.testing.assert_allclose(tokens[:, kept], expected, atol=1e-4 * np.abs(expected).max())
    changed = np.where(np.kron(kept, np.ones((8, 8)))[None, :, :, None] > 0, images, 255 - images).astype(np.uint8)
    np.testing.assert_array_equal(encoder.encode(changed, covered=square(2, 64)), tokens)
    assert not np.array_equal(encoder.encode(changed), encoder.encode(images))


def test_every_picture_has_its_own_foreground(dinov2):
    encoder = load_encoder(dinov2.folder, device="cpu", precision="float32")
    images, covered = pictures(3, 64), square(3, 64)
    covered[1] = covered[1].T
    covered[2] = False
    tokens = encoder.encode(images, covered=covered)
    assert not np.array_equal(tokens[0] == 0, tokens[1] == 0)
    for one in range(2):
        alone = encoder.encode(images[one : one + 1], covered=covered[one : one + 1])
        np.testing.assert_allclose(tokens[one], alone[0], atol=1e-5)
    assert (tokens[2] == 0).all()  # no pixel shows the shape


@pytest.mark.parametrize("name", ["dinov3", "clip", "sam"])
def test_networks_that_cannot_skip_the_background_encode_it(name, saved):
    one = saved(name)
    encoder = load_encoder(one.folder, device="cpu", precision="float32")
    images = pictures(1, one.case.size)
    covered = np.zeros(images.shape[:3], bool)
    covered[0, 0, 0] = True
    np.testing.assert_array_equal(encoder.encode(images, covered=covered), encoder.encode(images))
    assert encoder.settings()["encoder_foreground_only"] is False


@pytest.mark.parametrize("width", [768, 776])
def test_wide_networks_encode_the_background(width):
    sizes = {"hidden_size": width, "num_hidden_layers": 1, "num_attention_heads": 8, "image_size": 32, "patch_size": 8}
    config = {**sizes, "model_type": "dinov2"}
    names = Dinov2(_checked(config), 1).state_dict()
    weights = EncoderWeights(config, "made", "none", tensors={name: each.numpy() for name, each in names.items()})
    assert build_dinov2(weights, None).takes_patches is (width <= 768)


@pytest.mark.parametrize(
    "covered", [np.ones((2, 48, 48), np.uint8), np.ones((2, 48, 47), bool), np.ones((1, 48, 48), bool)]
)
def test_a_foreground_of_another_form_is_refused(dinov2, covered):
    with pytest.raises(ValueError, match=r"encode: `covered` must be bool of shape \(2, 48, 48\), got"):
        load_encoder(dinov2.folder, device="cpu").encode(pictures(2, 48), covered=covered)
