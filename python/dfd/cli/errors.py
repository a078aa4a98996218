"""Report wrong input to the command line as one line on standard error and an exit code, without a traceback."""

import os
import re
import sys
import warnings
from collections.abc import Sequence
from typing import Any

import typer
from typer.core import TyperGroup

from dfd.common.errors import ArgumentError, one_line

BAD_INPUT = 2  # exit code
INTERRUPTED = 130  # exit code


def say(text: str, *, result: bool = False) -> None:
    """Print `text` on standard error, or on standard output if it is a `result`.

    Control characters, which a terminal would interpret, and characters that are not UTF-8 are escaped.
    """
    escaped = (each if each.isprintable() or each == "\n" else each.encode("unicode_escape").decode() for each in text)
    typer.echo("".join(escaped), err=not result)


class CommandGroup(TyperGroup):
    """A group of commands that prints each error as one line."""

    def main(self, args: Sequence[str] | None = None, prog_name: str | None = None, *rest: Any, **options: Any) -> Any:
        """Run a command, and exit the process with the exit code of the command."""
        options["standalone_mode"] = False
        with warnings.catch_warnings():
            warnings.showwarning = _show_warning
            try:
                code = super().main(args, prog_name, *rest, **options)
            except _Interrupted as stop:
                code = _fail(": ".join(["interrupted", *stop.args]), INTERRUPTED)
            except MemoryError as error:
                code = _fail(": ".join(["out of memory", *filter(None, [str(error)])]), BAD_INPUT)
            except BrokenPipeError:  # the program that reads the output has closed the pipe
                os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
                code = 1
            except OSError as error:
                said = [str(each) for each in (error.filename, error.strerror) if each is not None]
                code = _fail(": ".join(said) or str(error), BAD_INPUT)
            except ValueError as error:
                code = _fail(str(error), BAD_INPUT)
            except Exception as error:
                # Only usage errors of Typer have this method. The name of their class depends on the version of Typer.
                if not hasattr(error, "format_message"):
                    raise
                code = _fail(_usage(error), BAD_INPUT)
        sys.exit(code if isinstance(code, int) else 0)

    def invoke(self, ctx: Any) -> Any:
        """Run the command that `ctx` names."""
        try:
            return super().invoke(ctx)
        except (ValueError, OSError) as error:
            if isinstance(error, ArgumentError):
                function, said = error.function, f"`{error.argument}` {error.reason}"
            elif named := CALLED.fullmatch(getattr(error, "strerror", None) or str(error)):
                function, said = named.groups()
            else:
                raise
            command = self.get_command(ctx, ctx.invoked_subcommand or "")
            raise ValueError(_in_options(function, said, () if command is None else command.params)) from None
        except Exception as error:
            if getattr(error, "ctx", ctx) is None:  # the parser does not tell the command whose option lacks a value
                command = self.get_command(ctx, ctx.invoked_subcommand or "")
                error.ctx = type(ctx)(command, parent=ctx, info_name=ctx.invoked_subcommand)  # type: ignore[attr-defined]
            raise
        except KeyboardInterrupt as stop:  # caught here, because Typer's own `main` prints another message
            raise _Interrupted(*stop.args) from None


def _usage(error: Any) -> str:
    """Return one line for a usage error of Typer: what is wrong, the value, and the command whose help to read."""
    said = one_line(error.format_message()).replace("Value error, ", "") or "give a command"
    for found in getattr(error.__cause__, "errors", list)():  # pydantic's message does not contain the value
        said += "" if found["type"] == "value_error" else f", got {found['input']}"
    command = getattr(getattr(error, "ctx", None), "command_path", "dfd")
    return f"{said} (see {command} --help)"


# Python arguments, and the parameters of commands that set them, if both names differ.
PARAMETERS = {"path": "output", "features": "field", "plane": "symmetry"}
PATHS = {"load": "MESH", "Field.load": "--field"}  # the option that sets the argument `path` of a Python function
CALLED = re.compile(r"(load|load_encoder|distill|Field\.load): (.*)", re.DOTALL)  # messages that begin with a function
REMEDIES = {"dfd.editing.transfer": "`dfd batch --edit`", "other_shape=True": "`--force`"}  # by remedies for Python


def _in_options(function: str | None, said: str, parameters: Sequence[Any]) -> str:
    """Return the message `said` of a Python function with command-line options in place of Python arguments."""
    known = {each.name: each.opts[0] if each.opts[0].startswith("-") else each.metavar for each in parameters}

    def option(name: str) -> str:
        if name == "path" and function in PATHS:
            return PATHS[function]
        if function is not None and function.endswith("set_symmetry"):
            name = f"symmetry_{name}" if f"symmetry_{name}" in known else name
        return str(known.get(PARAMETERS.get(name, name)) or known.get(name) or name)

    said = re.sub(r"`(\w+)", lambda found: f"`{option(found[1])}", said)
    for theirs, ours in REMEDIES.items():
        said = said.replace(theirs, ours)
    return said


class _Interrupted(Exception):  # noqa: N818  # not an error: the user pressed Ctrl-C
    pass


def _fail(message: str, code: int) -> int:
    say(f"dfd: {one_line(message)}")
    return code


def _show_warning(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, file: Any = None, line: Any = None
) -> None:
    if not issubclass(category, DeprecationWarning | PendingDeprecationWarning | ResourceWarning):
        say(f"dfd: {one_line(message)}")
