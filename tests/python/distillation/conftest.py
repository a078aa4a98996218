"""The encoder that the tests of distillation share."""

from pathlib import Path

import pytest

from dfd.encoders.encode import Encoder, load_encoder


@pytest.fixture(scope="module")
def encoder(tiny_encoder: Path) -> Encoder:
    return load_encoder(tiny_encoder, device="cpu", precision="float32")
