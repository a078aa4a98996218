"""bfloat16 on the CPU: where it pays, and attention that reaches the speed its instructions allow.

torch's fused attention multiplies bfloat16 no faster than float32 unless the CPU has AMX. Plain batched products of a
few heads and a few hundred rows at a time, small enough for the cache, take half its time.
"""

from __future__ import annotations

import time
from functools import cache
from typing import Any

import torch
from torch import Tensor, nn

from dfd.common.torch_threads import one_thread

__all__ = ["choose_precision", "use_blocked_attention"]

FASTER = 0.8  # of float32's time, for bfloat16 to be worth what it rounds off
_NAME = "dfd_blocked"
_ROWS = 256


def choose_precision(device: torch.device) -> str:
    """Return "bfloat16" where `device` computes with it faster than with float32, else "float32"."""
    if device.type == "cuda":
        return "bfloat16" if torch.cuda.get_device_capability(device) >= (8, 0) else "float32"
    has = device.type == "cpu" and (_cpu_has("avx512_bf16") or _cpu_has("amx_tile"))
    return "bfloat16" if has and _bfloat16_pays() else "float32"


def use_blocked_attention(network: Any) -> None:
    """Let `network`, a transformers model to be run in bfloat16 on the CPU, use the attention of this module."""
    if _cpu_has("amx_tile"):
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


@cache
def _bfloat16_pays() -> bool:
    """Whether products of the size that vision transformers are made of are clearly faster in bfloat16.

    Processors that have the instructions differ fourfold in what they make of them, so this is measured: by the
    thread's own time, which other programs do not count in, and to a margin that chance does not bridge.
    """

    def seconds(kind: torch.dtype) -> float:
        rows, columns = torch.ones(512, 384, dtype=kind), torch.ones(384, 1536, dtype=kind)
        taken = []
        for _ in range(5):
            start = time.thread_time()
            torch.mm(rows, columns)
            taken.append(time.thread_time() - start)
        return min(taken)

    with one_thread():
        return seconds(torch.bfloat16) < FASTER * seconds(torch.float32)


def _cpu_has(feature: str) -> bool:
    """Whether torch says that this CPU has `feature`; False where this version of torch does not tell."""
    ask = getattr(torch.cpu, f"_is_{feature}_supported", None)
    return bool(ask and ask())
