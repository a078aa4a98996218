"""`python -m dfd.app.schema`: print the JSON Schema of all messages, from which the client's types are generated."""

from __future__ import annotations

import json
from typing import Annotated, Any, Union

from pydantic import Field, create_model
from pydantic.json_schema import models_json_schema

import dfd.app.session.requests  # noqa: F401  # registers the requests
from dfd.app.protocol.answers import Answer
from dfd.app.protocol.parts import Model
from dfd.app.protocol.requests import request_union


def schema() -> dict[str, Any]:
    """Return the schema: `Client` is any message of the page, `Server` any message of the server without arrays."""
    answer: Any = Annotated[Union[tuple(Answer.__subclasses__())], Field(discriminator="type")]  # noqa: UP007
    client = create_model("Client", __base__=Model, __doc__="Any request.", message=(request_union(), ...))
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
