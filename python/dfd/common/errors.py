"""Errors that name the public function, the argument and the reason."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])

LONGEST_REASON = 500  # characters


class ArgumentError(ValueError):
    """An invalid argument, with the message "function: `argument` reason".

    `argument` is the parameter's name in the public function. `reason` says what the argument must be, and which value
    was found. `function` is the name of the public function, or None until `called` adds it. The reason is cut to one
    line of at most `LONGEST_REASON` characters, because the value found may be a large array or a long text.
    """

    def __init__(self, argument: str, reason: str, function: str | None = None) -> None:
        if "\n" in reason:
            reason = one_line(reason)
        if len(reason) > LONGEST_REASON:
            reason = f"{reason[: LONGEST_REASON - 1]}…"
        super().__init__(argument, reason, function)
        self.argument, self.reason, self.function = argument, reason, function

    def __str__(self) -> str:
        message = f"`{self.argument}` {self.reason}"
        return f"{self.function}: {message}" if self.function else message


def one_line(text: object) -> str:
    """Return a text, or the message of an error, with each run of whitespace replaced by one space."""
    return " ".join(str(text).split())


@contextmanager
def called(function: str) -> Iterator[None]:
    """Add the name of the public `function` to each `ArgumentError` that the `with` block raises."""
    try:
        yield
    except ArgumentError as error:
        raise ArgumentError(error.argument, error.reason, function) from None


def public(function: Function) -> Function:
    """Return `function`, wrapped so that every `ArgumentError` that it raises names the function."""
    return called(function.__qualname__.removesuffix(".__init__"))(function)


@contextmanager
def within(path: str, function: str | None = None) -> Iterator[None]:
    """Add `function`, and the argument's `path`, such as `handles[0]`, to each `ArgumentError` of the `with` block."""
    try:
        yield
    except ArgumentError as error:
        # A handle's place has no key of its own in an edit file: its keys or numbers stand in the entry at `path`.
        argument = path if error.argument in ("at", "place", "region") else f"{path}.{error.argument}"
        raise ArgumentError(argument, error.reason, function) from None
