"""The command line: one file per command, which calls the functions of the Python interface.

Slow modules (torch, trimesh) are imported inside the commands, so `dfd --help` answers at once.
"""

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
    version: Annotated[  # only its callback is used
        bool, Option("--version", callback=_print_version, is_eager=True, help="Print the version and leave.")
    ] = False,
) -> None:
    """Deep Feature Deformation: grab a point of a mesh, and everything that looks alike follows."""


for command in (demo, distill, deform, show, inspect, parts, export, batch, app_command):
    app.command(cls=HandlesCommand if command is deform else None)(command)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line with `arguments`, by default those of the process, and exit.

    Exit codes: 0 success; 1 some of several shapes failed, or the edit moved nothing; 2 an argument is wrong, with one
    line on standard error; 130 interrupted.
    """
    atexit.register(gc.freeze)  # without it, a last garbage collection of a million objects would delay the exit
    app(args=None if arguments is None else list(arguments), prog_name="dfd")
