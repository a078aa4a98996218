"""What the page and the server say to each other over the WebSocket at /ws; the page's types are made from here.

    python -m dfd.app.protocol > python/dfd/app/client/src/protocol.schema.json

The page sends JSON texts, each with a `type` and a number `id` of its own choosing. The server answers every one that
succeeds by one message with the same `id` (`done` unless another is named below) and one that does not by `failure`.
What it sends unasked has the `id` 0: before the answer to any change the `columns` that the page has not got, then
`state`. Numbers are finite, lengths are in mesh units, angles in degrees.

A message of the server is a JSON text, or binary where it carries arrays:

    bytes 0 … 3      N, the length of the header, unsigned, little-endian
    bytes 4 … 4+N    the header, JSON in UTF-8, padded with spaces so that 4 + N is a multiple of 8
    then             the buffers one after the other, each padded with zeros to a multiple of 8, little-endian

`buffers` of the header describes each with its name, type, shape and offset in bytes from the end of the header.

Distances travel, not weights. Of each handle the page has one column of numbers, a value per vertex (`columns`), and of
the edit what it makes of them (`state`), so that reach, falloff and locality act without a new bind:

    kind "distance"   W = f(max(1 − d / reach, 0)), with `falloff` f              Eq. 4 and 5
                      W = max(W − F, 0), F the number in the column of fixed places     Eq. 6
                      W = W (1 − G)^exponent, G in the column's `geodesic`      Eq. 7
                      W = strength · min(gain · W, 1)
    kind "weight"     W is the number itself
    falloff of x      linear x, smooth x² (3 − 2 x), sharp x², root √x, sphere √(x (2 − x)), constant 1 where x > 0

    V' = V + Σ W_k (D_k V − V) + max(1 − Σ W_k, 0) (D₀ V − V)      Eq. 1 in its adding form, where `posing` is "shader"

A column with instances acts through them instead: W_k D_k is the sum of min(gain · share · W_k, 1) times the instance's
own transform M, with the handle's linear part L, translation t and the instance's `frame` F and `pivot` p: M's linear
part is F L Fᵀ, and M maps p to p + F t. Where the handle has a pivot of its own, p is `position` + F (pivot − where the
handle rests) instead. An instance lies on the side of a plane of symmetry where its `position` does.
"""

from __future__ import annotations

import json
from typing import Annotated, Any

from pydantic import Field, TypeAdapter
from pydantic.json_schema import models_json_schema

from dfd.app.protocol.answers import (
    VERSION,
    AlikeMessage,
    DoneMessage,
    DownloadMessage,
    FailureMessage,
    ProgressMessage,
    ReportMessage,
    ScriptMessage,
    SessionMessage,
    StartMessage,
    StateMessage,
    SuggestionsMessage,
)
from dfd.app.protocol.binaries import (
    ColorsMessage,
    ColumnsMessage,
    DetailMessage,
    HeatMessage,
    InstancesMessage,
    MeshMessage,
    PositionsMessage,
)
from dfd.app.protocol.parts import Model
from dfd.app.protocol.requests import ClientMessage

__all__ = ["VERSION", "ClientMessage", "ServerMessage", "client_message", "schema"]

ServerMessage = Annotated[
    SessionMessage
    | StartMessage
    | StateMessage
    | DoneMessage
    | FailureMessage
    | ProgressMessage
    | ReportMessage
    | SuggestionsMessage
    | AlikeMessage
    | DownloadMessage
    | ScriptMessage
    | MeshMessage
    | DetailMessage
    | ColumnsMessage
    | InstancesMessage
    | HeatMessage
    | PositionsMessage
    | ColorsMessage,
    Field(discriminator="type"),
]

_CLIENT: TypeAdapter[Any] = TypeAdapter(ClientMessage)


def client_message(text: str | bytes) -> Any:
    """The message in a text of the page; raises pydantic's `ValidationError` if it is none."""
    return _CLIENT.validate_json(text)


class Client(Model):
    """Any message of the page."""

    message: ClientMessage


class Server(Model):
    """Any message of the server, or the header of one that is binary."""

    message: ServerMessage


def schema() -> str:
    """The JSON Schema of all messages, as the file in the client's sources holds it."""
    _, definitions = models_json_schema([(Client, "validation"), (Server, "serialization")])
    document = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Protocol",
        "type": "object",
        "properties": {
            name: {"$ref": f"#/$defs/{title}"} for name, title in (("client", "Client"), ("server", "Server"))
        },
        "required": ["client", "server"],
        **definitions,
    }
    return json.dumps(document, indent=1, sort_keys=True, ensure_ascii=False) + "\n"
