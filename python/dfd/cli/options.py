"""What is said of a handle and of the whole shape on the command line: an option for each control that there is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from inspect import Parameter, signature
from typing import Annotated, Any

import typer

from dfd.common import check
from dfd.common.described import About
from dfd.common.preset import Preset
from dfd.editing.presets import CONTROLS, PRESETS, WHOLE_SHAPE

__all__ = [
    "FixOption",
    "PresetOption",
    "add_options",
    "chosen_preset",
    "controls",
    "number_or",
    "shown",
    "with_controls",
]

Command = Callable[..., None]

PresetOption = Annotated[
    str | None,
    typer.Option(
        metavar="default|paper",
        help="What nothing else says: dfd's own, or the paper's equations to the letter; by default as --edit has it.",
    ),
]
FixOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="PLACE[:S]", help="Hold this, and what looks like it, by a strength S from 0 to 1; repeatable."
    ),
]


def add_options(command: Command, options: Mapping[str, Any], *, after: str | None = None) -> Command:
    """Let `command`, which takes `**` keywords, have these options, by their annotations; None is not given.

    They come behind the parameter `after`, by default behind all others.
    """
    own = [
        each for each in signature(command, eval_str=True).parameters.values() if each.kind is not Parameter.VAR_KEYWORD
    ]
    added = [Parameter(name, Parameter.KEYWORD_ONLY, default=None, annotation=kind) for name, kind in options.items()]
    place = len(own) if after is None else [each.name for each in own].index(after) + 1
    keywords = [each.replace(kind=Parameter.KEYWORD_ONLY) for each in own[place:]]
    parameters = [*own[:place], *added, *keywords]
    command.__signature__ = signature(command).replace(parameters=parameters)  # type: ignore[attr-defined]
    command.__annotations__ = {each.name: each.annotation for each in parameters}
    return command


def with_controls(*settings: str) -> Callable[[Command], Command]:
    """Give a command, behind `preset`, an option for each control of a handle and for these `settings` of the shape."""
    described = {**CONTROLS, **{name: WHOLE_SHAPE[name] for name in settings}}
    options = {name: _option(name, about) for name, about in described.items()}
    return lambda command: add_options(command, options, after="preset")


def _option(name: str, about: About) -> Any:
    """The option of a control or a setting, with what each preset has in its place."""
    flag = name.replace("_", "-")
    new, paper = (shown(getattr(PRESETS[preset], name, None)) for preset in ("default", "paper"))
    text = about.text
    if new != "none":
        text += f" By itself {new}" + (f", the paper's is {paper}." if paper != new else ".")
    if about.metavar is None:
        return Annotated[bool | None, typer.Option(f"--{flag}/--no-{flag}", help=text)]
    if about.repeated:
        return Annotated[list[str] | None, typer.Option(f"--{flag[:-1]}", metavar=about.metavar, help=text)]
    number = about.minimum is not None and "|" not in about.metavar
    return Annotated[(float if number else str) | None, typer.Option(f"--{flag}", metavar=about.metavar, help=text)]


def shown(value: Any) -> str:
    """A default as the help of a command says it."""
    if isinstance(value, bool) or value is None:
        return {None: "none", True: "yes", False: "no"}[value]
    return f"{value:g}" if isinstance(value, float) else str(value)


def controls(values: Mapping[str, Any]) -> dict[str, Any]:
    """What of `values`, a command's parameters, `Deformer.add` takes as controls; what was not given is left out.

    Raises
    ------
    ValueError
        If `--reach` is neither auto, nor part, nor a number.
    """
    given = {name: values[name] for name in CONTROLS if values[name] not in (None, [], ())}
    if "reach" in given and given["reach"] not in ("auto", "part"):
        given["reach"] = number_or("auto, part", "--reach", given["reach"], "a number above 0")
    return given


def chosen_preset(preset: str | None) -> Preset | None:
    """The preset of that name, or None where none was named.

    Raises
    ------
    ValueError
        If there is none of that name.
    """
    return None if preset is None else check.choice(None, "--preset", preset, Preset)


def number_or(word: str, option: str, text: str, number: str) -> Any:
    """The number that `text` is, or `word`; `number` describes what is wanted.

    Raises
    ------
    ValueError
        In the name of `option`, if it is neither.
    """
    if text == word:
        return word
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"`{option}` must be {word} or {number}, got {text!r}") from None
