"""`dfd demo`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dfd.cli.options import PresetOption, chosen_preset

__all__ = ["demo"]


def demo(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for meshes and pictures.")] = Path("demo"),
    preset: PresetOption = None,
) -> None:
    """Make shapes, distill them, deform them, and draw the story."""
    from dfd.demo import run

    run(output, preset=chosen_preset(preset) or "default")
