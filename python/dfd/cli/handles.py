"""Parse several handles on one command line: the options after each `--handle` belong to that handle."""

import re
from typing import Any

import numpy as np
from typer.core import TyperCommand

from dfd.cli.arguments import is_number
from dfd.editing.controls import CONTROLS
from dfd.posing.transforms import MOTIONS

ABOUT = {**MOTIONS, **CONTROLS}
OF_A_HANDLE = ("handle", "name", *ABOUT)
HANDLES = "dfd.handles"  # key of `ctx.meta`; its value is a list with a dict of options for each handle


class HandlesCommand(TyperCommand):
    """A command that accepts several handles with their options. The value of an option may be several numbers."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Store the options of each handle, and parse all others.

        Raises ValueError if an option of a handle stands before its `--handle`, or has the wrong number of values.
        """
        own = {flag: each for each in self.params if each.name in OF_A_HANDLE for flag in each.opts}
        own |= {flag: each for each in own.values() for flag in each.secondary_opts}
        handles: list[dict[str, Any]] = [{}]
        others, rest = [], list(args)
        while rest and rest[0] != "--":
            word = rest.pop(0)
            flag, equals, value = word.partition("=")
            each: Any = own.get(flag)
            if each is None:
                others.append(word)
                continue
            if equals:
                rest.insert(0, value)
            if each.name == "handle" and "handle" in handles[-1]:
                handles.append({})
            elif each.name == "handle" and handles[-1]:
                early = next(each.opts[0] for each in own.values() if each.name in handles[-1])
                raise ValueError(f"`{early}` must follow the `--handle` to which it belongs")
            taken: Any = flag in each.opts if each.is_flag else _value(flag, each.metavar, rest)
            handles[-1][each.name] = [*handles[-1].get(each.name, ()), taken] if each.multiple else taken
        ctx.meta[HANDLES] = handles
        return super().parse_args(ctx, [*others, *rest])


def handles(context: Any) -> list[tuple[str, dict[str, Any]]]:
    """Return for each `--handle` of a command its place, as a text, and a dict of other arguments of `Deformer.add`.

    Raises ValueError if an option of a handle is given without a handle, or a factor of `--scale` is 0.
    """
    found = []
    for texts in context.meta[HANDLES]:
        given = {name: text if name in ("handle", "name") else value_of(text) for name, text in texts.items()}
        if isinstance(given.get("level"), float) and given["level"].is_integer():
            given["level"] = int(given["level"])
        if 0.0 in np.ravel(given.get("scale", 1.0)):
            raise ValueError(f"`--scale` must not be 0, which flattens the held part, got {texts['scale']}")
        place = given.pop("handle", None)
        if place is not None:
            found.append((place, given))
        elif given:
            named = (f"`--{ABOUT[each].option or each}`" if each in ABOUT else f"`--{each}`" for each in given)
            raise ValueError(f"`--handle` must be given with {', '.join(named).replace('_', '-')}")
    return found


def value_of(value: Any) -> Any:
    """Return the numbers of a text such as 1 or 1,2,3. Any other value is returned unchanged."""
    parts = value.split(",") if isinstance(value, str) else []
    if not parts or not all(map(is_number, parts)):
        return value
    numbers = [float(part) for part in parts]
    return numbers if len(numbers) > 1 else numbers[0]


def _value(flag: str, metavar: str, rest: list[str]) -> str:
    """Remove the value of an option from the start of `rest`, and return it. Several numbers become 1,2,3."""
    counts = {len(each.split()) for each in metavar.split("|") if each.isupper()}  # each upper-case word is a number
    numbers = next((i for i, word in enumerate(rest) if not is_number(word)), len(rest)) if 3 in counts else 0
    is_text = numbers == 0 and bool(rest) and not (3 in counts and rest[0].startswith("-"))
    listed = rest[0].split(",") if is_text and 3 in counts else ()
    wrong = [each for each in listed if not is_number(each)]
    if wrong and len(listed) > 1:
        raise ValueError(f"`{flag}` needs numbers, got {rest[0]}, and {wrong[0] or 'nothing'} is no number")
    if wrong and metavar.isupper():
        raise ValueError(f"`{flag}` needs {' or '.join(map(str, sorted(counts)))} numbers, got {rest[0]}")
    if numbers not in counts and not is_text:
        needed = f"{' or '.join(map(str, sorted(counts)))} numbers" if 3 in counts else "a value"
        got = f"{numbers}: {' '.join(rest[:numbers])}" if numbers else "none"
        if 3 in counts and numbers < 3 and rest[numbers:] and not re.match(r"-[-a-z]", rest[numbers]):  # an option
            got += f", and {rest[numbers]} is no number"
        raise ValueError(f"`{flag}` needs {needed}, got {got}")
    value = ",".join(rest[: max(numbers, 1)])
    del rest[: max(numbers, 1)]
    return value
