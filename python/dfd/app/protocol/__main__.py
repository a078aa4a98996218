"""`python -m dfd.app.protocol`: print the JSON Schema that the client's types are made from."""

from dfd.app.protocol import schema

print(schema(), end="")
