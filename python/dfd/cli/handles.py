"""Several handles on one command line: every `--handle` begins one, and the options after it are its own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from typer import Option
from typer.core import TyperCommand

from dfd.cli.arguments import Command, add_options, controls, is_number
from dfd.editing.presets import CONTROLS

# The options of a handle: which argument of `Deformer.add` each is, its type, what stands for its value, and its help.
TRANSFORM: dict[str, tuple[str, Any, str, str]] = {
    "translate": ("translation", tuple[float, float, float], "X Y Z", "Move the handle, in mesh units."),
    "rotate": ("rotation", tuple[float, float, float], "X Y Z",
               "Turn it: the vector is the axis, its length the angle in degrees."),
    "scale": ("scale", str, "S | X Y Z", "Scale it: one factor, or three along the axes."),
    "pivot": ("pivot", str, "X Y Z|base|middle|point|plane|hinge",
              "What it turns and scales about; by default the base of a limb, and the middle of anything else."),
    "axes": ("axes", str, "normal",
             "The third factor is along the surface's normal there, not z."),
    "bend": ("bend", float, "DEGREES", "Bend what it holds along its own axis: by so much the tip turns."),
    "towards": ("towards", str, "up|down|left|right|front|back|X Y Z",
                "Where --bend takes the tip; by default up, and to the front where the part runs upright."),
    "twist": ("twist", float, "DEGREES", "Twist what it holds about its own axis."),
    "joint": ("joint", str, "spread|auto|here|0…1",
              "Where along the axis: over its length, where it bends or narrows already, at the handle, or from base "
              "(0) to tip (1)."),
    "open_": ("open", float, "DEGREES", "Turn it about its hinge, away from the rest, as a jaw opens."),
}  # fmt: skip
OF_A_HANDLE = ("handle", *TRANSFORM, *CONTROLS, "name")
COUNTS = {"--scale": (1, 3), "--pivot": (3,), "--towards": (3,)}  # of the numbers of options that may also be a word
FURTHER = "dfd.further_handles"
# Stand for what a further handle does not have for itself.
REST = ["MESH", "--field", "FIELD"]


def with_handle_options(command: Command) -> Command:
    """Give a command, behind `handle`, the options with which a handle is moved."""
    options = {
        option: Annotated[kind | None, Option(f"--{name if option == 'open_' else option}", metavar=metavar, help=text)]
        for option, (name, kind, metavar, text) in TRANSFORM.items()
    }
    return add_options(command, options, after="handle")


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
    """What to take hold of, and what `Deformer.add` is told about it, for every handle of a command line.

    `params` and `meta` are those of the command's context.

    Raises ValueError if something is said of a handle and no handle is given, or a factor of `--scale` is none or 0.
    """
    found = []
    for each in (params, *meta[FURTHER]):
        given = {name: each[option] for option, (name, *_) in TRANSFORM.items() if each[option] is not None}
        if "scale" in given:
            given["scale"] = _factors(given["scale"])
        for name in given.keys() & {"pivot", "towards"}:
            parts = given[name].split(",")
            if all(map(is_number, parts)):
                given[name] = [float(part) for part in parts]
        if is_number(given.get("joint", "")):
            given["joint"] = float(given["joint"])
        given |= controls(each)
        if each["name"] is not None:
            given["name"] = each["name"]
        if each["handle"] is not None:
            found.append((each["handle"], given))
        elif given:
            raise ValueError(f"`--handle` must be given: it is what the {', '.join(given)} is for")
    return found


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


def _factors(text: str) -> float | list[float]:
    """The factor or the factors of `--scale`."""
    parts = text.split(",")
    if not all(map(is_number, parts)):
        raise ValueError(f"`--scale` must be one number or three, got {text!r}")
    if len(parts) not in (1, 3):
        raise ValueError(f"`--scale` needs 1 or 3 numbers, got {_listed(parts)}")
    factors = [float(part) for part in parts]
    if 0.0 in factors:
        raise ValueError(f"`--scale` must not be 0, which leaves nothing of what it holds, got {text}")
    return factors if len(factors) == 3 else factors[0]


def _listed(numbers: list[str]) -> str:
    return f"{len(numbers)}: {' '.join(numbers)}" if numbers else "none"
