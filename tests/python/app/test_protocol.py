"""The messages: what is refused, what the published schema says, and that the client's copy of it is this one."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from dfd.app.protocol import client_message, schema

COMMITTED = Path(__file__).parents[3] / "python" / "dfd" / "app" / "client" / "src" / "protocol.schema.json"


def read(**message: Any) -> Any:
    return client_message(json.dumps({"id": 1, **message}))


def test_the_schema_of_the_client_is_current() -> None:
    assert COMMITTED.read_text() == schema(), "run python -m dfd.app.protocol > " + str(COMMITTED)


def test_every_message_has_a_sentence_in_the_schema() -> None:
    definitions = json.loads(schema())["$defs"]
    del definitions["JsonValue"]  # pydantic's own
    assert [name for name, one in definitions.items() if not one.get("description", "").strip().endswith(".")] == []


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
        {"type": "add", "at": {"vertex": 1}, "controls": {"reach": 0}},
        {"type": "add", "at": {"mask": "not base 64"}},
        {"type": "hello", "version": 1, "session": "../../etc/passwd"},
        {"type": "export", "format": "../x"},
        {"type": "set_symmetry", "plane": "w"},
    ],
)
def test_a_message_that_is_none_is_refused(message: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        read(**message)


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_numbers_are_finite(number: str) -> None:
    text = '{"id": 1, "type": "move", "handle": 1, "transform": {"translation": [0, 0, NUMBER]}}'
    client_message(text.replace("NUMBER", "1"))
    with pytest.raises(ValidationError):
        client_message(text.replace("NUMBER", number))
