"""The command line: one file per command, each a thin front of the Python names.

What takes long to import (torch, trimesh) is imported inside the commands, so that `dfd --help` answers at once.
"""

from __future__ import annotations

import atexit
import gc
from collections.abc import Sequence
from importlib.metadata import version
from typing import Annotated

import typer
from typer import Option

from dfd.cli.app import app as app_command
from dfd.cli.batch import batch
from dfd.cli.deform import deform
from dfd.cli.demo import demo
from dfd.cli.distill import distill
from dfd.cli.errors import CommandGroup
from dfd.cli.export import export
from dfd.cli.handles import HandlesCommand
from dfd.cli.inspect import inspect, parts
from dfd.cli.show import show

app = typer.Typer(
    name="dfd",
    cls=CommandGroup,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"dfd {version('dfd')}")
        raise typer.Exit()


@app.callback()
def root(
    version: Annotated[  # its only use is its callback
        bool, Option("--version", callback=_print_version, is_eager=True, help="Print the version and leave.")
    ] = False,
) -> None:
    """Deep Feature Deformation: grab a point of a mesh, and everything that looks alike follows."""


for command in (demo, distill, deform, show, inspect, parts, export, batch, app_command):
    app.command(cls=HandlesCommand if command is deform else None)(command)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line with `arguments`, by default those of the process, and exit.

    Exit codes: 0 done; 1 of several shapes some could not be done, or what was written did not move; 2 something that
    was given does not work, said in one line on standard error; 130 interrupted.
    """
    atexit.register(gc.freeze)  # a million objects go with the process: to search them for garbage first takes a while
    app(args=None if arguments is None else list(arguments), prog_name="dfd")
