"""An argument that cannot be taken, as an error that says which one and why."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import ParamSpec, TypeVar

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")


LONGEST_REASON = 500  # characters


class ArgumentError(ValueError):
    """An argument cannot be taken: "function: `argument` reason".

    `argument` is its name, as the caller knows it; `reason` what it must be and what was found; `function` the public
    function that was called, None where nobody knows it yet. What was found may be an array, or a text of many pages:
    the reason is one line, and no longer than a person reads.
    """

    def __init__(self, argument: str, reason: str, function: str | None = None) -> None:
        if "\n" in reason:
            reason = one_line(reason)
        if len(reason) > LONGEST_REASON:
            reason = f"{reason[: LONGEST_REASON - 1]}…"
        super().__init__(argument, reason, function)
        self.argument, self.reason, self.function = argument, reason, function

    def __str__(self) -> str:
        said = f"`{self.argument}` {self.reason}"
        return f"{self.function}: {said}" if self.function else said


def one_line(text: object) -> str:
    """Return a text, or the message of an error, on one line."""
    return " ".join(str(text).split())


@contextmanager
def called(function: str) -> Iterator[None]:
    """Let an `ArgumentError` inside begin with the name of the public `function`, whichever of its parts raised it."""
    try:
        yield
    except ArgumentError as error:
        raise ArgumentError(error.argument, error.reason, function) from None


def public(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """`function`, `called` by its own name."""
    name = function.__qualname__.removesuffix(".__init__")

    @wraps(function)
    def named(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
        with called(name):
            return function(*args, **kwargs)

    return named


@contextmanager
def within(path: str, function: str | None = None) -> Iterator[None]:
    """Let an argument that is refused inside be called by its `path` in a larger value, and by the `function`."""
    try:
        yield
    except ArgumentError as error:
        # A place is no key of its own: what it says stands beside the rest of its owner.
        argument = path if error.argument in ("at", "place", "region") else f"{path}.{error.argument}"
        raise ArgumentError(argument, error.reason, function) from None
