"""The requests of the page. The fields of a request are the parameters of its handler, a registered function."""

import json
from collections.abc import Callable, Iterable
from functools import cache
from inspect import getdoc, signature
from typing import Annotated, Any, Literal, TypeVar, Union, get_type_hints

from pydantic import Field, TypeAdapter, ValidationError, create_model

from dfd.app.protocol.messages import Model
from dfd.common.errors import one_line

Handler = TypeVar("Handler", bound=Callable[..., Any])
LARGEST_NUMBER = 2**53  # largest exact integer in JavaScript


class Request(Model):
    """The base class of all requests. The answer has the same `id`."""

    id: Annotated[int, Field(ge=1, le=LARGEST_NUMBER)]
    type: str


class RequestError(ValueError):
    """Raised for a text that is not a valid request. `number` is the text's `id`, or 0 if it has no valid `id`."""

    def __init__(self, number: int, reason: str) -> None:
        super().__init__(f"The message was not understood: {reason}")
        self.number = number


HANDLERS: dict[str, Callable[..., Any]] = {}
MODELS: list[type[Request]] = []


def request(handler: Handler) -> Handler:
    """Register `handler` for requests whose `type` is its name. The fields are its parameters after `session`."""
    name, hints = handler.__name__, get_type_hints(handler, include_extras=True)
    _, *parameters = signature(handler).parameters.values()
    fields: dict[str, Any] = {
        each.name: (hints[each.name], ... if each.default is each.empty else each.default) for each in parameters
    }
    fields["type"] = (Literal[name], ...)
    title = name.title().replace("_", "")
    MODELS.append(create_model(title, __base__=Request, __doc__=getdoc(handler), **fields))
    HANDLERS[name] = handler
    return handler


def union_of(models: Iterable[type[Model]]) -> Any:
    """Return the union of `models`, discriminated by their field `type`."""
    return Annotated[Union[tuple(models)], Field(discriminator="type")]  # noqa: UP007


@cache
def _adapter() -> TypeAdapter[Request]:
    return TypeAdapter(union_of(MODELS))


def read_request(text: str) -> Request:
    """Return the request that a text from the page contains; raise RequestError if the request is not valid."""
    try:
        return _adapter().validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False, include_context=False)[0]
        where, reason = ".".join(map(str, first["loc"])), one_line(first["msg"])[:200]
        raise RequestError(_number_in(text), f"`{where}`: {reason}" if where else reason) from None


def _number_in(text: str) -> int:
    """Return the `id` in a text that is not a valid request, or 0 if the text has no valid `id`."""
    try:
        number = json.loads(text)["id"]
    except (ValueError, TypeError, KeyError, RecursionError):
        return 0
    return number if isinstance(number, int) and 0 < number <= LARGEST_NUMBER else 0
