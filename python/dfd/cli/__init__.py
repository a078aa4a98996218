"""The command line. Each command has a file of its own, and calls the functions of the Python interface.

Slow modules, such as torch and trimesh, are imported only when a command runs. So `dfd --help` starts quickly.
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
from dfd.common.distribution import DISTRIBUTION

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
        typer.echo(f"dfd {version(DISTRIBUTION)}")
        raise typer.Exit()


@app.callback()
def root(
    version: Annotated[  # `root` does not use this value: the callback prints the version
        bool, Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Deep Feature Deformation: grab a point of a mesh, and everything that looks alike follows."""


for command in (demo, distill, deform, show, inspect, parts, export, batch, app_command):
    app.command(cls=HandlesCommand if command is deform else None)(command)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line with `arguments`, by default those of the process, and exit.

    The exit code is 0 for success, 1 if some of several shapes failed or the edit moved nothing, 2 if an argument or a
    file is invalid, and 130 after Ctrl-C.
    """
    atexit.register(gc.freeze)  # skips the garbage collection at exit, which is slow with a million objects
    app(args=None if arguments is None else list(arguments), prog_name="dfd")
