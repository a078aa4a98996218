"""Requests are what the handlers' signatures say, and the published schema says the same."""

from __future__ import annotations

import json
from typing import Any

import pytest

from dfd.app.protocol.requests import HANDLERS, RequestError, read_request
from dfd.app.schema import schema


def read(**message: Any) -> Any:
    return read_request(json.dumps({"id": 1, **message}))


def test_the_schema_has_every_request_and_says_what_each_message_is() -> None:
    definitions = schema()["$defs"]
    assert [name for name, one in definitions.items() if not one.get("description", "").strip().endswith(".")] == []
    types = {one["properties"]["type"]["const"] for one in definitions.values() if "type" in one["properties"]}
    assert {*HANDLERS, "hello", "state", "mesh"} <= types


def test_a_message_is_read_by_its_type() -> None:
    message = read(type="move", handle=3, transform={"translation": [0, 1, 2.5]}, merge=True)
    assert message.transform.translation == (0.0, 1.0, 2.5)
    assert message.transform.rotation is None
    assert message.merge
    assert not message.settle


@pytest.mark.parametrize(
    "message",
    [
        {"type": "unheard of"},
        {"type": "undo", "more": 1},
        {"type": "undo", "id": 0},
        {"type": "undo", "id": "1"},
        {"type": "move", "handle": 1, "transform": {"translation": [0, 1]}},
        {"type": "move", "handle": 1, "transform": {"translation": [0, 1, "2"]}},
        {"type": "move", "handle": True, "transform": {}},
        {"type": "probe", "at": {"vertex": -1}},
        {"type": "probe", "at": {"vertex": 1, "point": [0, 0, 0]}},
        {"type": "add", "at": {"vertex": 1}, "controls": {"falloff": "none"}},
        {"type": "add", "at": {"vertex": 1}, "session": 1},
        {"type": "add", "at": {"mask": "not base 64"}},
        {"type": "hello", "version": 1},
        {"type": "export", "format": "../x"},
        {"type": "set_symmetry", "plane": "w"},
    ],
)
def test_a_message_that_is_none_is_refused(message: dict[str, Any]) -> None:
    with pytest.raises(RequestError):
        read(**message)


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_numbers_are_finite(number: str) -> None:
    text = '{"id": 1, "type": "move", "handle": 1, "transform": {"translation": [0, 0, NUMBER]}}'
    read_request(text.replace("NUMBER", "1"))
    with pytest.raises(RequestError):
        read_request(text.replace("NUMBER", number))


DEEP = "[" * 50_000 + "]" * 50_000


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ('{"type": "undo", "x": [], "id": 7}', 7),
        ('{"type": "undo", "x": DEEP, "id": 7}', 0),
        ('{"id": 7, "handle": 1' + "0" * 10_000 + "}", 0),
        ('{"x": {"id": 8}}', 0),
        ('{"id": 99999999999999999999}', 0),
        ('{"id": "7"}', 0),
        ("[7]", 0),
        (DEEP, 0),
        ("no json", 0),
    ],
)
def test_what_is_not_understood_is_refused_by_its_number(text: str, number: int) -> None:
    with pytest.raises(RequestError, match="^The message was not understood: ") as refused:
        read_request(text.replace("DEEP", DEEP))
    assert refused.value.number == number
    assert len(str(refused.value)) < 300
