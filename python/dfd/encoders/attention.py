"""Attention in bfloat16 on the CPU, at the speed that its instructions allow.

torch's fused attention multiplies bfloat16 no faster than float32 unless the CPU has AMX. Plain batched products of a
few heads and a few hundred rows at a time, small enough for the cache, take half its time.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from dfd.encoders.precision import cpu_has

__all__ = ["use_blocked_attention"]

_NAME = "dfd_blocked"
_ROWS = 256


def use_blocked_attention(network: Any) -> None:
    """Let `network`, a transformers model to be run in bfloat16 on the CPU, use the attention of this module."""
    if cpu_has("amx_tile"):
        return
    from transformers import AttentionInterface

    AttentionInterface.register(_NAME, blocked_attention)
    network.set_attn_implementation(_NAME)


def blocked_attention(
    module: nn.Module,
    query: Tensor,
    key: Tensor,
    value: Tensor,
    attention_mask: Tensor | None = None,
    scaling: float | None = None,
    **_: Any,
) -> tuple[Tensor, None]:
    """Return softmax(scaling · query · keyᵀ) · value, shape (n, rows, heads, d), from inputs (n, heads, rows, d).

    The mean key is taken off every key first: it adds the same to all scores of a row, which the softmax ignores, and
    scores nearer to 0 lose less when they are rounded to bfloat16.
    """
    count, heads, rows, width = query.shape
    scale = width**-0.5 if scaling is None else scaling
    if attention_mask is not None or key.shape[1] != heads:
        mixed = nn.functional.scaled_dot_product_attention(
            query, key, value, attn_mask=attention_mask, scale=scale, enable_gqa=key.shape[1] != heads
        )
        return mixed.transpose(1, 2), None
    # (n · heads, rows, d)
    queries = (query * scale).to(torch.bfloat16).flatten(0, 1)
    keys = key.float()
    keys = (keys - keys.mean(dim=2, keepdim=True)).to(torch.bfloat16).flatten(0, 1).transpose(1, 2)
    values = value.to(torch.bfloat16).flatten(0, 1)
    result = torch.empty(count * heads, rows, value.shape[3], dtype=torch.bfloat16, device=query.device)
    at_once = torch.get_num_threads()
    for head in range(0, count * heads, at_once):
        some = slice(head, head + at_once)
        for row in range(0, rows, _ROWS):
            scores = torch.bmm(queries[some, row : row + _ROWS], keys[some])
            result[some, row : row + _ROWS] = torch.bmm(torch.softmax(scores, dim=-1), values[some])
    return result.reshape(count, heads, rows, -1).transpose(1, 2), None
