"""Damage valid files: the bytes of any file, or the values of a JSON document."""

import copy
import json
from typing import Any

from hypothesis import strategies as st

__all__ = ["damaged_bytes", "damaged_json"]

VALUES: list[Any] = [
    *(0, -1, 1, 5, 1e9, 2**31, 2**62, -(2**40), 1.5, 1e39, True, None, "", "x", "\udc80"),
    *([], {}, [1], [[0]], {"index": 0}, [1e308] * 3),
]
LETTERS = b'0123456789-./ \n\tvfe#\\{}[]":,\xff\x00'


@st.composite
def damaged_bytes(draw: st.DrawFn, good: bytes) -> bytes:
    """Draw `good` with up to six changed bytes, or removed, inserted or repeated runs of bytes."""
    data = bytearray(good)
    for _ in range(draw(st.integers(1, 6))):
        place = draw(st.integers(0, max(len(data) - 1, 0)))
        kind = draw(st.sampled_from(["change", "cut", "put", "repeat", "end"]))
        if kind == "change" and data:
            data[place] = draw(st.integers(0, 255))
        elif kind == "cut":
            del data[place : place + draw(st.integers(1, 30))]
        elif kind == "put":
            data[place:place] = bytes(draw(st.lists(st.sampled_from(LETTERS), min_size=1, max_size=6)))
        elif kind == "repeat":
            start = draw(st.integers(0, len(data)))
            data[place:place] = data[start : start + 40]
        else:
            del data[place:]
    return bytes(data)


@st.composite
def damaged_json(draw: st.DrawFn, good: Any) -> Any:
    """Draw `good` with up to three of its values replaced, removed or repeated."""
    document = json.loads(json.dumps(good))
    for _ in range(draw(st.integers(1, 3))):
        node = document
        while isinstance(node, dict | list) and node:
            keys = list(node) if isinstance(node, dict) else list(range(len(node)))
            key = draw(st.sampled_from(keys))
            child: Any = node[key]
            if isinstance(child, dict | list) and child and draw(st.integers(0, 3)):
                node = child
                continue
            kind = draw(st.sampled_from(["exchange", "exchange", "remove", "repeat"]))
            if kind == "exchange":
                node[key] = copy.deepcopy(draw(st.sampled_from(VALUES)))
            elif kind == "remove":
                del node[key]
            elif isinstance(node, list):
                node.append(copy.deepcopy(child))
            break
    return document
