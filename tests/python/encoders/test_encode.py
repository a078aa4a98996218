"""Test the encoding of images: accepted and refused arguments, and the settings of an encoder."""

import numpy as np
import pytest
import torch
from tiny_families import pictures

import dfd
import dfd.encoders.encode
from dfd.encoders.encode import Encoder, load_encoder

pytestmark = pytest.mark.usefixtures("one_thread")


def test_images_are_not_changed_and_results_repeat(dinov2):
    images = pictures(3, 48)
    before = images.copy()
    encoder = load_encoder(dinov2.folder, device="cpu")
    first = encoder.encode(images)
    assert np.array_equal(images, before)
    assert np.array_equal(first, encoder.encode(images))
    assert np.array_equal(first, load_encoder(dinov2.folder, device="cpu").encode(images))


def test_threads_do_not_show(dinov2):
    images = pictures(5, 48)
    encoder = load_encoder(dinov2.folder, device="cpu", precision="float32")
    dfd.set_num_threads(1)
    alone = encoder.encode(images)
    dfd.set_num_threads(3)
    assert np.array_equal(encoder.encode(images), alone)


@pytest.mark.parametrize(("given", "used"), [(50, 48), (52, 56), (3, 8)])
def test_other_resolutions_are_resized(dinov2, given, used):
    encoder = load_encoder(dinov2.folder, device="cpu")
    assert encoder.nearest_resolution(given) == used
    tokens = encoder.encode(pictures(1, given))
    assert tokens.shape == (1, used // 8, used // 8, 16)


def test_unknown_precision_and_device_are_refused(dinov2):
    with pytest.raises(ValueError, match="`precision` must be one of auto, float32, bfloat16, got 'half'"):
        load_encoder(dinov2.folder, precision="half")
    for device in ("abacus", "cuda:99"):
        with pytest.raises(ValueError, match=f"`device` must be a usable torch device, got '{device}'"):
            load_encoder(dinov2.folder, device=device)


@pytest.mark.parametrize(
    ("images", "found"),
    [
        (np.zeros((1, 32, 32, 3), np.float32), "float32 of shape"),
        (np.zeros((32, 32, 3), np.uint8), r"\(32, 32, 3\)"),
        (np.zeros((1, 32, 32, 4), np.uint8), r"\(1, 32, 32, 4\)"),
        (np.zeros((1, 0, 0, 3), np.uint8), r"\(1, 0, 0, 3\)"),
        (np.zeros((1, 32, 40, 3), np.uint8), "square, got 40 × 32"),
    ],
)
def test_images_that_are_no_pictures_are_refused(dinov2, images, found):
    encoder = load_encoder(dinov2.folder, device="cpu")
    with pytest.raises(ValueError, match=f"encode: `images` must be .*{found}"):
        encoder.encode(images)


def test_tokens_that_are_not_finite_are_refused(dinov2):
    encoder = load_encoder(dinov2.folder, device="cpu")
    with torch.no_grad():
        encoder._model.network.layernorm.bias[3] = torch.nan
    with pytest.raises(ValueError, match="gave NaN or infinity"):
        encoder.encode(pictures(1, 32))


@pytest.mark.parametrize("error", [torch.cuda.OutOfMemoryError(), RuntimeError("can't allocate memory: you tried")])
def test_too_little_memory_for_one_image_says_what_to_lower(dinov2, monkeypatch, error):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr(Encoder, "_forward", fail)
    with pytest.raises(MemoryError, match="lower the resolution"):
        load_encoder(dinov2.folder, device="cpu").encode(pictures(5, 32))
