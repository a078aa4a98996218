"""Test the precision that is chosen for a device."""

import pytest

from dfd.encoders import precision
from dfd.encoders.encode import load_encoder
from dfd.encoders.sources import IDENTITY, find_identity

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.mark.parametrize(
    ("flags", "expected"), [({"avx512_bf16"}, "bfloat16"), ({"amx_bf16"}, "bfloat16"), ({"avx2"}, "float32")]
)
def test_it_follows_from_the_processor_s_flags(dinov2, monkeypatch, flags, expected):
    monkeypatch.setattr(precision, "_cpu_flags", lambda: flags)
    encoder = load_encoder(dinov2.folder, device="cpu")
    assert encoder.precision == encoder.settings()["encoder_precision"] == expected


def test_what_an_encoder_will_be_is_known_before_it_is_loaded(dinov2):
    known = find_identity(dinov2.folder, "cpu")
    loaded = load_encoder(dinov2.folder, device="cpu").identity()
    assert known == {name: loaded[name] for name in IDENTITY}
