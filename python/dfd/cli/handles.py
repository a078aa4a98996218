"""Several handles on one command line: every `--handle` begins one, and the options after it are its own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from typer import Option
from typer.core import TyperCommand

from dfd.cli.arguments import Command, add_options, is_number, shown
from dfd.common.described import About
from dfd.editing.presets import CONTROLS, PRESETS
from dfd.posing.transforms import MOTIONS

# The parameters of a command that are a motion, by the name of that; no built-in function's name is one.
TRANSFORM = {"open_" if name == "open" else said.option or name: name for name, said in MOTIONS.items()}
OF_A_HANDLE = ("handle", *TRANSFORM, *CONTROLS, "name")
COUNTS = {"--scale": (1, 3), "--pivot": (3,), "--towards": (3,)}  # of the numbers of options that may also be a word
FURTHER = "dfd.further_handles"
# Stand for what a further handle does not have for itself.
REST = ["MESH", "--field", "FIELD"]


def with_handle_options(command: Command) -> Command:
    """Give a command, behind `handle`, the options with which a handle is moved."""
    options = {parameter: _option(name, MOTIONS[name], MOTIONS[name].text) for parameter, name in TRANSFORM.items()}
    return add_options(command, options, after="handle")


def with_controls(command: Command) -> Command:
    """Give a command, behind `preset`, an option for each control of a handle, with the value of each preset."""
    options: dict[str, Any] = {}
    for name, about in CONTROLS.items():
        default, paper = (shown(getattr(PRESETS[preset], name, None)) for preset in ("default", "paper"))
        text = about.text
        if default != "none":
            text += f" By itself {default}" + (f", the paper's is {paper}." if paper != default else ".")
        options[name] = _option(name, about, text)
    return add_options(command, options, after="preset")


def _option(name: str, about: About, text: str) -> Any:
    """The annotation of a command's parameter."""
    flag, metavar = (about.option or name).replace("_", "-"), about.metavar
    kind: Any = str
    if metavar is None:
        kind, flag = bool, f"{flag}/--no-{flag}"
    elif about.repeated:
        kind, flag = list[str], flag[:-1]
    elif metavar == "X Y Z":
        kind = tuple[float, float, float]
    elif "|" not in metavar and (about.unit == "angle" or about.minimum is not None):
        kind = float
    return Annotated[kind | None, Option(f"--{flag}", metavar=metavar, help=text)]


def controls(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the controls among `values`, a command's parameters, as `Deformer.add` takes them; None is left out."""
    return {name: value_of(values[name]) for name in CONTROLS if values[name] not in (None, [], ())}


class HandlesCommand(TyperCommand):
    """A command that takes `--handle` repeatedly, each with options of its own, and counts the numbers they need."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the options of the whole shape and of the first handle as usual, and put the others' beside them."""
        common, groups = self._grouped(args)
        ctx.meta[FURTHER] = [
            self.make_context(ctx.info_name, [*REST, *group], parent=ctx.parent).params for group in groups[1:]
        ]
        return super().parse_args(ctx, [*common, *(groups[0] if groups else [])])

    def _grouped(self, args: list[str]) -> tuple[list[str], list[list[str]]]:
        """The arguments of the whole shape, and those of each handle; what precedes the first belongs to it."""
        own = {spelling: option for option in self.params if option.name in OF_A_HANDLE for spelling in option.opts}
        own |= {spelling: option for option in own.values() for spelling in option.secondary_opts}
        common: list[str] = []
        groups: list[list[str]] = [[]]
        rest = list(args)
        held = False
        while rest:
            token = rest.pop(0)
            name, equals, value = token.partition("=")
            option: Any = own.get(name)
            if token == "--":
                common += [token, *rest]
                break
            if option is None:
                common.append(token)
                continue
            if name == "--handle":
                if held:
                    groups.append([])
                held = True
            if equals:
                rest.insert(0, value)
            values = [] if option.is_flag else _values(name, option.nargs, rest)
            del rest[: len(values)]
            groups[-1] += [name, ",".join(values)] if name in COUNTS and values else [name, *values]
        return common, groups


def handles(params: Mapping[str, Any], meta: Mapping[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    """Return the place of every handle of a command line, and the arguments of `Deformer.add` for it.

    `params` and `meta` are those of the command's context.

    Raises ValueError if an option of a handle is given without a handle, or a factor of `--scale` is 0.
    """
    found = []
    for each in (params, *meta[FURTHER]):
        given = {name: value_of(each[option]) for option, name in TRANSFORM.items() if each[option] is not None}
        if 0.0 in np.ravel(given.get("scale", 1.0)):
            raise ValueError(f"`--scale` must not be 0, which leaves nothing of what it holds, got {each['scale']}")
        given |= controls(each)
        if each["name"] is not None:
            given["name"] = each["name"]
        if each["handle"] is not None:
            found.append((each["handle"], given))
        elif given:
            raise ValueError(f"`--handle` must be given: it is what the {', '.join(given)} is for")
    return found


def value_of(value: Any) -> Any:
    """Return the number or the numbers that a text holds, or the value as it is."""
    parts = value.split(",") if isinstance(value, str) else []
    if not parts or not all(map(is_number, parts)):
        return value
    numbers = [float(part) for part in parts]
    return numbers if len(numbers) > 1 else numbers[0]


def _values(name: str, count: int, rest: list[str]) -> list[str]:
    """The values at the beginning of `rest` that belong to an option.

    Raises ValueError if it needs three numbers, or one or three, and has another number of them.
    """
    numbers = next((i for i, token in enumerate(rest) if not is_number(token)), len(rest))
    if name in COUNTS:
        text = numbers == 0 and bool(rest) and not rest[0].startswith("-")  # such as 1,2,3
        if numbers not in COUNTS[name] and not text:
            raise ValueError(
                f"`{name}` needs {' or '.join(map(str, COUNTS[name]))} numbers, got {_listed(rest[:numbers])}"
            )
        return rest[: max(numbers, 1)]
    if count == 3 and numbers < 3 and (numbers == len(rest) or rest[numbers].startswith("-")):
        raise ValueError(f"`{name}` needs 3 numbers, got {_listed(rest[:numbers])}")
    return rest[:count]


def _listed(numbers: list[str]) -> str:
    return f"{len(numbers)}: {' '.join(numbers)}" if numbers else "none"
