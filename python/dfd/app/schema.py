"""`python -m dfd.app.schema` prints the JSON Schema of all messages. The client's types are generated from it."""

import json
from typing import Any

from pydantic import create_model
from pydantic.json_schema import models_json_schema

import dfd.app.session.requests  # noqa: F401  # registers the requests
from dfd.app.protocol.messages import Answer, Model
from dfd.app.protocol.requests import MODELS, union_of


def schema() -> dict[str, Any]:
    """Return the JSON Schema. `Client` describes all messages of the page, and `Server` all messages of the server."""
    answer: Any = union_of(Answer.__subclasses__())
    client = create_model("Client", __base__=Model, __doc__="Any request.", message=(union_of(MODELS), ...))
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
