"""`dfd deform`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from dfd.cli.arguments import FieldOption, MeshArgument, check_output, place

__all__ = ["DeformCommand", "deform"]


class DeformCommand(TyperCommand):
    """A command whose `--scale` takes one number or three, as a parser of options with fixed lengths cannot."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Write `--scale 1 2 1` as the one text `1,2,1`."""
        joined: list[str] = []
        rest = list(args)
        while rest:
            joined.append(rest.pop(0))
            if joined[-1] == "--scale":
                count = 3 if len(rest) >= 3 and all(map(_is_number, rest[:3])) else 1
                joined.append(",".join(rest[:count]))
                del rest[:count]
        return super().parse_args(ctx, joined)


def deform(
    mesh: MeshArgument,
    field: FieldOption,
    handle: Annotated[
        str | None, typer.Option(metavar="VERTEX|X,Y,Z", help="What to take hold of: a vertex, or a point in space.")
    ] = None,
    translate: Annotated[
        tuple[float, float, float] | None, typer.Option(metavar="X Y Z", help="Move the handle, in mesh units.")
    ] = None,
    rotate: Annotated[
        tuple[float, float, float] | None,
        typer.Option(metavar="X Y Z", help="Turn it: the vector is the axis, its length the angle in degrees."),
    ] = None,
    scale: Annotated[
        str | None, typer.Option(metavar="S | X Y Z", help="Scale it: one factor, or three along the axes.")
    ] = None,
    pivot: Annotated[
        tuple[float, float, float] | None,
        typer.Option(metavar="X Y Z", help="The point it turns and scales about; by default the handle itself."),
    ] = None,
    locality: Annotated[
        float | None, typer.Option(metavar="λ", help="0 reaches all that looks alike, more stays nearer.")
    ] = None,
    fix: Annotated[
        list[str] | None, typer.Option(metavar="VERTEX|X,Y,Z", help="Hold this, and what looks like it; repeatable.")
    ] = None,
    symmetry: Annotated[
        str | None, typer.Option(metavar="x|y|z|auto", help="Act mirrored on the other side of this axis's plane.")
    ] = None,
    band: Annotated[
        float | None,
        typer.Option(metavar="WIDTH", help="Half width of the blend at that plane, mesh units; 0 is a hard cut."),
    ] = None,
    edit: Annotated[
        Path | None, typer.Option(metavar="JSON", help="Start from an edit with any number of handles.")
    ] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", metavar="MESH", help="The mesh to write.")] = None,
    picture: Annotated[Path | None, typer.Option(metavar="PNG", help="Draw it before and after.")] = None,
    save_edit: Annotated[Path | None, typer.Option(metavar="JSON", help="Keep the edit, for --edit.")] = None,
) -> None:
    """Deform MESH: one handle by options, several by an edit."""
    numbers = {"translation": translate, "rotation": rotate, "scale": _factors(scale), "pivot": pivot}
    given: dict[str, Any] = {
        name: value for name, value in (*numbers.items(), ("locality", locality)) if value is not None
    }
    if handle is None and edit is None:
        raise ValueError("`--handle` or `--edit` must be given: without them nothing moves")
    if handle is None and given:
        raise ValueError(f"`--handle` must be given: it is what the {', '.join(given)} is for")
    if band is not None and symmetry is None:
        raise ValueError("`--symmetry` must be given: it is what `--band` is for")
    if output is None and picture is None and save_edit is None:
        raise ValueError("`--output`, `--picture` or `--save-edit` must be given: otherwise nothing is kept")
    check_output("--output", output, (".obj", ".ply", ".stl", ".off", ".glb", ".gltf"))
    check_output("--picture", picture, (".png",))
    check_output("--save-edit", save_edit)

    from dfd import Deformer, Field, load
    from dfd.common.progress import Stages

    stages = Stages()
    with stages.stage("read"):
        shape = load(mesh)
        opened = Field.load(field, mesh=shape)
        deformer = Deformer.load(edit, shape, opened) if edit else Deformer(shape, opened)
    if handle is not None:
        deformer.add(place(shape, "--handle", handle), **given)
    for text in fix or ():
        deformer.fix(place(shape, "--fix", text))
    if symmetry is not None:
        deformer.set_symmetry(symmetry, band=band)
    with stages.stage("features", len(shape.vertices)) as advance:
        deformer.prepare(advance)
    with stages.stage("deform"):
        vertices = deformer.vertices

    if output is not None:
        shape.save(output, vertices)
    if save_edit is not None:
        deformer.save(save_edit)
    if picture is not None:
        from dfd.pictures.before_after import save_before_after

        with stages.stage("draw"):
            save_before_after(picture, deformer)
    written = ", ".join(str(path) for path in (output, picture, save_edit) if path is not None)
    count = len(deformer.handles)
    typer.echo(f"{written}: {count} handle{'' if count == 1 else 's'} on {len(vertices)} vertices", err=True)


def _factors(text: str | None) -> float | list[float] | None:
    """The factor or the factors in what `DeformCommand` made of `--scale`."""
    if text is None:
        return None
    parts = text.split(",")
    if len(parts) not in (1, 3) or not all(map(_is_number, parts)):
        raise ValueError(f"`--scale` must be one number or three, got {text!r}")
    factors = [float(part) for part in parts]
    return factors if len(factors) == 3 else factors[0]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
