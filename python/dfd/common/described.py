"""Fields of frozen dataclasses, described once: what they mean, their bounds, and how they are written in files.

The dataclass checks itself by it, pydantic reads, writes and describes files by it, and the command line makes its
options of it. Nothing of pydantic is imported here.
"""

from __future__ import annotations

from dataclasses import MISSING, dataclass, fields
from functools import cache
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import numpy as np

from dfd.common import check
from dfd.common.errors import ArgumentError


class Brief:
    """A dataclass, `repr=False`, that shows only what differs from its defaults."""

    def __repr__(self) -> str:
        """Say it as Python makes it."""
        told = []
        for each in fields(self):  # type: ignore[arg-type]  # derived classes are dataclasses
            value = getattr(self, each.name)
            default = each.default if each.default_factory is MISSING else each.default_factory()
            if each.repr and (default is MISSING or value != default):
                told.append(f"{each.name}={value!r}")
        return f"{type(self).__name__}({', '.join(told)})"


@dataclass(frozen=True)
class About:
    """What a field means."""

    text: str  # one sentence for people, wherever the field is named
    # minimum, maximum, exclusive: the bounds of a number; with `exclusive` it lies above the minimum
    minimum: float | None = None
    maximum: float | None = None
    exclusive: bool = False
    metavar: str | None = None  # what the command line shows in the place of its value; None for a switch
    repeated: bool = False  # whether the command line takes one of them after the other
    option: str | None = None  # what the command line calls it, where that is not the field's name
    # unit: what its numbers are. On another shape a length is scaled, and a position is carried along.
    unit: Literal["length", "position", "angle"] | None = None
    # affects: the handle's own column of weights, or only what is made of that
    affects: Literal["weights", "pose"] = "weights"
    of_part: bool = False  # whether it is for a handle alone, because it needs the part that the handle holds
    # label, slider: what panels call it; the ends and the step of a slider, of a length as parts of the shape's size
    label: str | None = None
    slider: tuple[float, float, float] | None = None

    def called(self, name: str) -> str:
        """Return what panels call the field of that `name`."""
        return self.label or name.replace("_", " ").capitalize()

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        """The JSON schema of the field, with its description and bounds."""
        low = "exclusiveMinimum" if self.exclusive else "minimum"
        bounds = {low: self.minimum, "maximum": self.maximum}
        return {**handler(schema), "description": self.text, **{k: v for k, v in bounds.items() if v is not None}}


class Written:
    """The type that a field has in a file, where its dataclass turns it into another one."""

    def __init__(self, written: Any) -> None:
        self.written = written

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        """That of the type in files; arrays are written as lists."""
        from pydantic_core import core_schema

        plain = core_schema.plain_serializer_function_ser_schema(
            lambda value: value.tolist() if isinstance(value, np.ndarray) else value
        )
        return {**handler.generate_schema(self.written), "serialization": plain}


class Tagged:
    """A union of dataclasses that files tell apart by one of their fields."""

    def __init__(self, name: str) -> None:
        self.name = name

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        """That of the union, by its tag."""
        from pydantic import Field

        return handler.generate_schema(Annotated[source, Field(discriminator=self.name)])


@cache
def about(owner: type) -> dict[str, tuple[Any, About | None]]:
    """The type and the description of each field of a dataclass, by its name."""
    found: dict[str, tuple[Any, About | None]] = {}
    for name, hint in get_type_hints(owner, include_extras=True).items():
        kind, *extras = get_args(hint) if get_origin(hint) is Annotated else (hint,)
        found[name] = kind, next((extra for extra in extras if isinstance(extra, About)), None)
    return found


def words_of(kind: Any) -> tuple[Any, ...]:
    """Return the words that a value of a type may be."""
    return next((get_args(each) for each in (kind, *get_args(kind)) if get_origin(each) is Literal), ())


def check_fields(value: Any) -> None:
    """Refuse what the fields of a frozen dataclass may not be: numbers, names and switches, each once.

    Numbers become floats; what is None where a field may be None is left.

    Raises ArgumentError in the name of the class.
    """
    owner: type = type(value)
    function = owner.__name__
    for name, (kind, said) in about(owner).items():
        given, kinds, words = getattr(value, name), (kind, *get_args(kind)), words_of(kind)
        if given is None and type(None) in kinds:
            continue
        if bool in kinds:
            if not isinstance(given, bool):
                raise ArgumentError(name, f"must be True or False, got {given!r}", function)
        elif float in kinds and said is not None:
            if isinstance(given, str) and given in words:
                continue
            if isinstance(given, str) and words:
                bound = f"above {said.minimum:g}" if said.exclusive else f"of at least {said.minimum:g}"
                choices = ", ".join(f'"{word}"' for word in words)
                raise ArgumentError(name, f"must be {choices} or a number {bound}, got {given!r}", function)
            number = check.number(
                function, name, given, minimum=said.minimum, maximum=said.maximum, exclusive=said.exclusive
            )
            object.__setattr__(value, name, number)
        elif words and isinstance(words[0], str):
            check.choice(function, name, given, words)
