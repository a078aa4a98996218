"""Binary messages: what is packed comes back, and lies where the protocol says."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray

from dfd.app.protocol.binary_messages import HeatMessage, PositionsMessage, pack, unpack

DTYPES = ["uint8", "int8", "uint16", "int16", "uint32", "int32", "float32"]


@given(
    st.lists(
        st.sampled_from(DTYPES).flatmap(
            lambda name: arrays.arrays(name, arrays.array_shapes(max_dims=3, min_side=0, max_side=5))
        ),
        max_size=4,
    )
)
def test_what_is_packed_comes_back(given: list[NDArray[Any]]) -> None:
    named = {f"a{index}": array for index, array in enumerate(given)}
    message = pack(PositionsMessage, named, id=7)
    header, back = unpack(message)
    assert header["id"] == 7
    assert list(back) == list(named)
    for name, array in named.items():
        assert back[name].dtype == array.dtype
        np.testing.assert_array_equal(back[name], array)


def test_everything_lies_at_multiples_of_eight() -> None:
    message = pack(
        HeatMessage, {"values": np.arange(3, dtype=np.uint16), "b": np.ones(1, np.float32)}, vertex=1, scale=2.0
    )
    length = int.from_bytes(message[:4], "little")
    assert (4 + length) % 8 == 0
    header, _ = unpack(message)
    assert [each["offset"] for each in header["buffers"]] == [0, 8]
    assert message[4 + length : 4 + length + 6] == b"\0\0\1\0\2\0"
    assert len(message) % 8 == 0


def test_big_endian_arrays_travel_little_endian() -> None:
    _, back = unpack(pack(PositionsMessage, {"a": np.array([1.5, 2.5], ">f4")}))
    np.testing.assert_array_equal(back["a"], [1.5, 2.5])


def test_types_that_the_protocol_has_not_are_refused() -> None:
    with pytest.raises(ValueError, match="float64"):
        pack(PositionsMessage, {"a": np.zeros(2)})
