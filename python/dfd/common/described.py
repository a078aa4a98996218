"""Describe the fields of frozen dataclasses: their meaning, their bounds, and their type in files.

`check_fields` checks values by these descriptions. pydantic reads, writes and documents files by them. The command
line creates its options from them. Importing this module does not import pydantic.
"""

from collections.abc import Callable
from dataclasses import MISSING, dataclass, fields
from functools import cache
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import numpy as np

from dfd.common import check
from dfd.common.errors import ArgumentError


class Brief:
    """Base class for dataclasses with `repr=False`. This `repr` omits fields that have their default values."""

    def __repr__(self) -> str:
        """Return the constructor call that creates an equal object."""
        shown = []
        for each in fields(self):  # type: ignore[arg-type]  # derived classes are dataclasses
            value = getattr(self, each.name)
            default = each.default if each.default_factory is MISSING else each.default_factory()
            if each.repr and (default is MISSING or value != default):
                shown.append(f"{each.name}={value!r}")
        return f"{type(self).__name__}({', '.join(shown)})"


@dataclass(frozen=True)
class About:
    """The description of a dataclass field, as metadata of the field's `Annotated` type."""

    text: str  # one sentence for users
    minimum: float | None = None
    maximum: float | None = None
    exclusive: bool = False  # whether the number must be above `minimum`; if not, it may be equal to `minimum`
    metavar: str | None = None  # placeholder for the value in the command-line help; None for an option without a value
    repeated: bool = False  # whether the command-line option may occur several times
    option: str | None = None  # name of the command-line option, if it differs from the field's name
    # What a number measures. If an edit is transferred to another shape, lengths are scaled and positions are mapped.
    unit: Literal["length", "position", "angle"] | None = None
    # "weights" if the field changes the handle's weights; "pose" if it changes none, or only those in the blend band.
    affects: Literal["weights", "pose"] = "weights"
    of_part: bool = False  # whether the field, such as bend, needs a handle's part; the default transform has no part
    label: str | None = None  # the field's name in panels of the app; None derives it from the field's name
    # Lowest value, highest value and step of the slider in panels; lengths are fractions of the shape's size.
    slider: tuple[float, float, float] | None = None

    def called(self, name: str) -> str:
        """Return the label that panels show for the field `name`."""
        return self.label or name.replace("_", " ").capitalize()

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        """Return the JSON schema of the field, with its description and bounds."""
        low = "exclusiveMinimum" if self.exclusive else "minimum"
        bounds = {low: self.minimum, "maximum": self.maximum}
        return {**handler(schema), "description": self.text, **{k: v for k, v in bounds.items() if v is not None}}


def _listed(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else value


class Written:
    """Metadata of a field's `Annotated` type: the type in files, if it differs from the type in the dataclass.

    `dump` converts a value to the values in files. The default only converts NumPy arrays, to lists.
    """

    def __init__(self, written: Any, dump: Callable[[Any], Any] = _listed) -> None:
        self.written, self.dump = written, dump

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        """Return pydantic's schema of the type in files, which writes values by `dump`."""
        from pydantic_core import core_schema

        plain = core_schema.plain_serializer_function_ser_schema(self.dump)
        return {**handler.generate_schema(self.written), "serialization": plain}


class Tagged:
    """Metadata of a union of dataclasses; in files, the value of the field `name` tells which dataclass to create."""

    def __init__(self, name: str) -> None:
        self.name = name

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        """Return pydantic's schema of the union, discriminated by the field `name`."""
        from pydantic import Field

        return handler.generate_schema(Annotated[source, Field(discriminator=self.name)])


@cache
def about(owner: type) -> dict[str, tuple[Any, About | None]]:
    """Return the type and the description of each field of a dataclass, by the field's name."""
    found: dict[str, tuple[Any, About | None]] = {}
    for name, hint in get_type_hints(owner, include_extras=True).items():
        kind, *extras = get_args(hint) if get_origin(hint) is Annotated else (hint,)
        found[name] = kind, next((extra for extra in extras if isinstance(extra, About)), None)
    return found


def words_of(kind: Any) -> tuple[Any, ...]:
    """Return the values of a Literal type, or of the first Literal in a union; () if there is none."""
    return next((get_args(each) for each in (kind, *get_args(kind)) if get_origin(each) is Literal), ())


def check_fields(value: Any) -> None:
    """Check the values of the fields of a frozen dataclass by the fields' types and descriptions.

    Values of float fields become floats, and 3-vectors become tuples. Without other bounds, the largest absolute value
    is `check.LARGEST`. None is valid if the type of the field allows it.

    Raises ArgumentError, which names the class in place of a function, if a value is invalid.
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
        elif kind == tuple[float, float, float]:
            numbers = check.array(function, name, given, (3,), dtype=np.float64)
            check.bounded(function, name, numbers.tolist())
            object.__setattr__(value, name, tuple(numbers.tolist()))
        elif float in kinds and said is not None:
            if isinstance(given, str) and given in words:
                continue
            if isinstance(given, str) and words:
                bound = f"above {said.minimum:g}" if said.exclusive else f"of at least {said.minimum:g}"
                choices = ", ".join(f'"{word}"' for word in words)
                raise ArgumentError(name, f"must be {choices} or a number {bound}, got {given!r}", function)
            low = -check.LARGEST if said.minimum is None else said.minimum
            high = check.LARGEST if said.maximum is None else said.maximum
            number = check.number(function, name, given, minimum=low, maximum=high, exclusive=said.exclusive)
            object.__setattr__(value, name, number)
        elif int in kinds and said is not None:
            least = None if said.minimum is None else int(said.minimum)
            object.__setattr__(value, name, check.whole(function, name, given, minimum=least))
        elif str in kinds and not (isinstance(given, str) and given):
            raise ArgumentError(name, f"must be a text that is not empty, got {given!r}", function)
        elif words and isinstance(words[0], str):
            check.choice(function, name, given, words)
