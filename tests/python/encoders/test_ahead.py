"""Encoders that are loaded beside something else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tiny_families import Saved, pictures

from dfd.encoders.ahead import load_ahead
from dfd.encoders.encode import load_encoder
from dfd.encoders.sources import at_hand


def test_it_is_the_encoder_that_would_be_loaded(dinov2: Saved) -> None:
    loading = load_ahead(dinov2.folder, device="cpu")
    assert loading is not None
    ahead, now = loading.result(), load_encoder(dinov2.folder, device="cpu")
    assert ahead.identity() == now.identity()
    images = pictures(1, 64)
    np.testing.assert_array_equal(ahead.encode(images), now.encode(images))


def test_what_goes_wrong_is_said_to_whoever_asks(tmp_path: Path) -> None:
    loading = load_ahead(tmp_path)
    assert loading is not None
    with pytest.raises(FileNotFoundError, match=r"has no config\.json"):
        loading.result()


@pytest.mark.parametrize("name", ["dinov2-large", "somebody/something", "dino-of-my-own", "./nowhere"])
def test_what_is_not_at_hand_is_not_begun(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_CACHE", str(tmp_path))
    assert not at_hand(name)
    assert load_ahead(name) is None
