"""Test that requests have the fields of their handlers' signatures, and the layout of binary messages."""

import json
from typing import Any

import numpy as np
import pytest
from app_page import unpack
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray

from dfd.app.protocol.messages import PositionsMessage, pack
from dfd.app.protocol.requests import HANDLERS, RequestError, read_request
from dfd.app.schema import schema


def test_the_schema_has_every_request_and_says_what_each_message_is() -> None:
    definitions = schema()["$defs"]
    assert [name for name, one in definitions.items() if not one.get("description", "").strip().endswith(".")] == []
    types = {one["properties"]["type"]["const"] for one in definitions.values() if "type" in one["properties"]}
    assert {*HANDLERS, "session", "state", "mesh"} <= types


def test_a_message_is_read_by_its_type() -> None:
    text = '{"id": 1, "type": "move", "handle": 3, "transform": {"translation": [0, 1, 2.5]}, "merge": true}'
    message: Any = read_request(text)
    assert message.transform.translation == (0.0, 1.0, 2.5)
    assert message.transform.rotation is None
    assert message.merge
    assert not message.settle


DEEP = "[" * 50_000 + "]" * 50_000
MOVE = '"type": "move", "handle": 1, "transform": {"translation": [0, 0, NUMBER]}'


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ('"type": "unheard of"', 7),
        ('"type": "clear", "more": 1', 7),
        *((MOVE.replace("NUMBER", number), 7) for number in ("NaN", "Infinity", "-Infinity", "1e999", '"2"')),
        ('"type": "move", "handle": true, "transform": {}', 7),
        ('"type": "probe", "vertex": -1', 7),
        ('"type": "add", "at": {"vertex": 1}', 7),
        ('"type": "change", "handle": 1, "controls": {"falloff": "none"}', 7),
        ('"type": "change", "handle": 1, "controls": {"more": {"self": 3}}', 7),
        ('"type": "add", "at": {"mask": "not base 64"}', 7),
        ('"type": "export", "format": "../x"', 7),
        (f'"type": "clear", "x": {DEEP}', 0),
        (f'"handle": 1{"0" * 10_000}', 0),
    ],
)
def test_what_is_no_request_is_refused_by_its_number(text: str, number: int) -> None:
    with pytest.raises(RequestError, match="^The message was not understood: ") as refused:
        read_request(f'{{"id": 7, {text}}}')
    assert refused.value.number == number
    assert len(str(refused.value)) < 300


@pytest.mark.parametrize("text", ['{"x": {"id": 8}}', '{"id": 99999999999999999999}', '{"id": "7"}', "[7]", DEEP, "no"])
def test_what_has_no_number_is_refused_by_0(text: str) -> None:
    with pytest.raises(RequestError) as refused:
        read_request(text)
    assert refused.value.number == 0


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
    header, back = unpack(pack(PositionsMessage(id=7), **named))
    assert header["id"] == 7
    assert back.keys() == named.keys()
    for name, array in named.items():
        assert back[name].dtype == array.dtype.newbyteorder("=")
        np.testing.assert_array_equal(back[name], array)


def test_every_array_lies_where_a_browser_can_view_it() -> None:
    """A typed array of JavaScript must begin at a multiple of the size of its numbers."""
    given = {"a": np.arange(3, dtype=np.uint8), "b": np.arange(3, dtype=np.uint16).T[::-1], "c": np.ones(1, np.float32)}
    message = pack(PositionsMessage(id=7), **given)
    length = int.from_bytes(message[:8], "little")
    assert length % 8 == 0
    header = json.loads(message[8 : 8 + length])
    assert all(header[name]["data_offsets"][0] % array.itemsize == 0 for name, array in given.items())
    np.testing.assert_array_equal(unpack(message)[1]["b"], [2, 1, 0])
