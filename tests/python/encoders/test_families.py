"""Test encoders of every family, loaded from tiny networks with random weights."""

import json

import numpy as np
import pytest
import torch
from tiny_families import CASES, normalized, pictures

from dfd.encoders.encode import load_encoder

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.mark.parametrize("name", CASES)
def test_tokens_are_the_hidden_states_of_the_whole_model(name, saved):
    one = saved(name)
    images = pictures(2, one.case.size)
    for block, patch in ((None, one.case.patch), (one.case.early, one.case.early_patch)):
        encoder = load_encoder(one.folder, block=block, device="cpu", precision="float32")
        assert encoder.block == (block or one.case.block)
        assert encoder.patch == patch
        tokens = encoder.encode(images)
        side = one.case.size // patch
        assert tokens.shape == (2, side, side, encoder.dimension)
        assert tokens.dtype == np.float32
        with torch.no_grad():
            expected = one.case.twin(one.model, normalized(encoder, images), encoder.block).numpy()
        np.testing.assert_allclose(tokens.reshape(expected.shape), expected, atol=1e-4 * np.abs(expected).max())
    assert load_encoder(one.folder, device="cpu").dimension == one.case.dimension


def test_networks_of_one_size_get_it(saved):
    encoder = load_encoder(saved("sam").folder, device="cpu")
    assert encoder.nearest_resolution(518) == 64
    assert encoder.encode(pictures(1, 40)).shape == (1, 4, 4, 8)


@pytest.mark.parametrize("name", CASES)
def test_bfloat16_stays_close_to_float32(name, saved):
    one = saved(name)
    images = pictures(2, one.case.size)
    full = load_encoder(one.folder, device="cpu", precision="float32").encode(images)
    half = load_encoder(one.folder, device="cpu", precision="bfloat16").encode(images)
    assert half.dtype == np.float32
    full /= np.linalg.norm(full, axis=-1, keepdims=True)
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    assert 0 < np.linalg.norm(full - half, axis=-1).mean() < 0.03


def test_settings_tell_encoders_apart(dinov2, saved):
    first = load_encoder(dinov2.folder, device="cpu", precision="float32").settings()
    assert first["encoder_block"] == 3
    assert first["encoder_dimension"] == 16
    assert first["encoder_weights"].startswith("sha256:")
    assert json.loads(json.dumps(first)) == first
    assert load_encoder(dinov2.folder, block=2, device="cpu", precision="float32").settings() != first
    assert load_encoder(dinov2.folder, device="cpu", precision="bfloat16").settings() != first
    other = load_encoder(saved("dinov2-registers").folder, device="cpu", precision="float32").settings()
    assert other["encoder_weights"] != first["encoder_weights"]


@pytest.mark.parametrize("block", [0, -1, 4, 2.0, True, "2"])
def test_blocks_that_are_not_there_are_refused(dinov2, block):
    with pytest.raises(ValueError, match=r"load_encoder: `block` must be a whole number.*, got"):
        load_encoder(dinov2.folder, block=block, device="cpu")
