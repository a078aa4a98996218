"""`dfd inspect`."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from dfd.cli.arguments import MeshArgument

__all__ = ["inspect"]


def inspect(
    mesh: MeshArgument,
    field: Annotated[
        Path | None, typer.Option("--field", metavar="FIELD", help="Also look for symmetry planes, with this field.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, for programs.")] = False,
) -> None:
    """Say what MESH is made of, what is odd about it, and how much of it the pictures of `dfd distill` do not show."""
    from dfd import Field, load, symmetry_planes
    from dfd.geometry import topology
    from dfd.views.visibility import unseen

    shape = load(mesh)
    report: dict[str, Any] = {"file": str(mesh), **asdict(topology.inspect(shape)), "unseen": asdict(unseen(shape))}
    if field is not None:
        opened = Field.load(field, mesh=shape)
        report["field"] = {
            "file": str(field),
            "dimension": opened.dimension,
            "settings": {name: value for name, value in opened.settings.items() if name != "losses"},
        }
        report["symmetry_planes"] = [asdict(plane) for plane in symmetry_planes(opened, shape)]
    if as_json:
        typer.echo(json.dumps(report, indent=2, default=_plain))
    else:
        _print_table(report)


def _print_table(report: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.table import Table

    from dfd.symmetry.plane import SymmetryPlane, plane_text

    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="bold")
    table.add_column(overflow="fold")
    for name, value in report.items():
        if name == "field":
            table.add_row("field", f"{value['file']}, {value['dimension']} dimensions")
            for setting, chosen in value["settings"].items():
                table.add_row(f"  {setting.replace('_', ' ')}", _shown(chosen))
        elif name == "symmetry_planes":
            planes = [
                f"{plane_text(SymmetryPlane(**plane))}"
                f" (score {plane['score']:.3f}, {plane['relative_score']:.0%} of chance)"
                for plane in value
            ]
            table.add_row("symmetry planes", "\n".join(planes) or "none")
        elif name == "unseen":
            table.add_row("unseen", _unseen(**value))
        else:
            table.add_row(name.replace("_", " "), _shown(value))
    Console(highlight=False, markup=False).print(table)


def _unseen(views: int, area: float, components: int, component_count: int) -> str:
    if component_count == 0:
        return "all of it, for no face has an area"
    if area == 0:
        return f"nothing, in {views} views"
    share = f"{area:.1%}" if area >= 0.001 else "less than 0.1%"
    wholly = f", {components:,} of {component_count:,} components wholly" if components else ""
    return f"{share} of the surface{wholly}, in {views} views: it takes the nearest seen features"


def _shown(value: Any) -> str:
    value = _plain(value) if hasattr(value, "tolist") else value
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: "none"}[value]
    if isinstance(value, int):
        return f"{value:,}"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list | tuple):
        return ", ".join(_shown(item) for item in value) or "none"
    return str(value)


def _plain(value: Any) -> Any:
    """Arrays and paths as JSON has them."""
    return value.tolist() if hasattr(value, "tolist") else str(value)
