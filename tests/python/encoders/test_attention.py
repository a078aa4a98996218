"""Attention in bfloat16 on the CPU."""

from __future__ import annotations

import pytest
import torch
from tiny_families import Saved

from dfd.encoders.attention import blocked_attention, use_blocked_attention
from dfd.encoders.encode import load_encoder

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.mark.parametrize("rows", [1, 255, 256, 700])
def test_blocked_attention_is_attention(rows: int) -> None:
    generator = torch.Generator().manual_seed(0)
    query, key, value = (torch.randn(2, 3, rows, 8, generator=generator) for _ in range(3))
    key += 4.0  # what all keys share is taken off, and must make no difference
    expected = torch.nn.functional.scaled_dot_product_attention(query, key, value)
    result, _ = blocked_attention(torch.nn.Identity(), query, key, value, None, 8**-0.5)
    assert (result.float().transpose(1, 2) - expected).abs().max() < 0.03


def test_blocked_attention_heeds_masks_and_shared_keys() -> None:
    generator = torch.Generator().manual_seed(0)
    query, key, value = (torch.randn(1, 4, 6, 8, generator=generator) for _ in range(3))
    mask = torch.ones(1, 1, 6, 6, dtype=torch.bool).tril()
    result, _ = blocked_attention(torch.nn.Identity(), query, key, value, mask)
    expected = torch.nn.functional.scaled_dot_product_attention(query, key, value, attn_mask=mask)
    torch.testing.assert_close(result.transpose(1, 2), expected)
    result, _ = blocked_attention(torch.nn.Identity(), query, key[:, :2], value[:, :2])
    expected = torch.nn.functional.scaled_dot_product_attention(query, key[:, :2], value[:, :2], enable_gqa=True)
    torch.testing.assert_close(result.transpose(1, 2), expected)


def test_blocked_attention_leaves_amx_to_torch(dinov2: Saved, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dfd.encoders.attention.cpu_has", lambda feature: feature == "amx_tile")
    network = load_encoder(dinov2.folder, device="cpu", precision="float32")._network.network
    use_blocked_attention(network)
    assert network.config._attn_implementation == "sdpa"
