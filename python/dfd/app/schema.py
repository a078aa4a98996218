"""`python -m dfd.app.schema`: print the JSON Schema of all messages, which the client's types are made from."""

from __future__ import annotations

import json
from typing import Annotated, Any, Union

from pydantic import Field, create_model
from pydantic.json_schema import models_json_schema

import dfd.app.session.requests  # noqa: F401  # what the page can ask
from dfd.app.protocol import answers, binary_messages
from dfd.app.protocol.parts import Model
from dfd.app.protocol.requests import Hello, request_union


def schema() -> dict[str, Any]:
    """The schema: `Client` is any message of the page, `Server` any of the server, or its header where it is binary."""
    answer_types = [
        each
        for each in (*vars(answers).values(), *vars(binary_messages).values())
        if isinstance(each, type) and issubclass(each, answers.Answer) and "type" in each.model_fields
    ]
    answer: Any = Annotated[Union[tuple(dict.fromkeys(answer_types))], Field(discriminator="type")]  # noqa: UP007
    client = create_model("Client", __base__=Model, __doc__="Any request.", message=(Hello | request_union(), ...))
    server = create_model("Server", __base__=Model, __doc__="Any answer.", message=(answer, ...))
    _, definitions = models_json_schema([(client, "validation"), (server, "serialization")])
    return {
        "title": "Protocol",
        "type": "object",
        "properties": {name.lower(): {"$ref": f"#/$defs/{name}"} for name in ("Client", "Server")},
        "required": ["client", "server"],
        **definitions,
    }


if __name__ == "__main__":
    print(json.dumps(schema()))
