"""Errors that name the public function, the argument and the reason."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])

LONGEST_ARGUMENT, LONGEST_REASON = 200, 500  # characters


class ArgumentError(ValueError):
    """An invalid argument, with the message "function: `argument` reason".

    `argument` is the parameter's name in the public function. `reason` says what the argument must be, and which value
    was found. `function` is the name of the public function, or None until `called` adds it. Both texts are cut to one
    line of at most `LONGEST_ARGUMENT` and `LONGEST_REASON` characters, because the value found may be a large array or
    a long text, and the argument may be a key of a file.
    """

    def __init__(self, argument: str, reason: str, function: str | None = None) -> None:
        argument, reason = _cut(argument, LONGEST_ARGUMENT), _cut(reason, LONGEST_REASON)
        super().__init__(argument, reason, function)
        self.argument, self.reason, self.function = argument, reason, function

    def __str__(self) -> str:
        message = f"`{self.argument}` {self.reason}"
        return f"{self.function}: {message}" if self.function else message


def _cut(text: str, most: int) -> str:
    """Return the first `most` characters of `text` in one line."""
    line = one_line(text) if len(text.splitlines()) > 1 else text
    return line if len(line) <= most else f"{line[: most - 1]}…"


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
