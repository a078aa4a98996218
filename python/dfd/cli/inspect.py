"""`dfd inspect` and `dfd parts`: what a mesh is made of."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Option

from dfd.cli.arguments import (
    ForceOption,
    MadeFieldOption,
    MeshArgument,
    ResolutionOption,
    ViewsOption,
    check_output,
    shown,
)
from dfd.common.linear_algebra import Float64

if TYPE_CHECKING:
    from dfd.field.field import Field
    from dfd.mesh.mesh import Mesh
    from dfd.symmetry.plane import SymmetryPlane
    from dfd.upright.candidates import Up


def inspect(
    mesh: MeshArgument,
    field: Annotated[
        Path | None,
        Option("--field", metavar="FIELD", help="Also look for symmetry planes and suggest handles, with this."),
    ] = None,
    against: Annotated[
        Path | None,
        Option("--against", metavar="MESH", help="Also measure what was done to the surface to make this of it."),
    ] = None,
    suggestions: Annotated[int, Option(min=1, max=50, help="With --field: at most so many handles are suggested.")] = 8,
    cut: Annotated[bool, Option("--parts", help="With --field: also the parts, as `dfd parts` cuts them.")] = False,
    picture: Annotated[
        Path | None,
        Option(metavar="PNG", help="With --field, --against: draw suggested handles, parts, how areas changed."),
    ] = None,
    up: Annotated[
        str, Option(metavar="DIRECTION", help="Which way is up: auto, file, +y, -z, …, or numbers such as 0,0,1.")
    ] = "auto",
    as_json: Annotated[bool, Option("--json", help="Print JSON, for programs.")] = False,
    force: ForceOption = False,
) -> None:
    """Say what MESH is made of, what is odd about it, which way is up, and how much of it pictures do not show.

    The pictures are those that `dfd distill` takes.
    """
    if picture is not None and field is None and against is None:
        raise ValueError("`--field` or `--against` must be given: `--picture` draws what comes of them")
    if cut and field is None:
        raise ValueError("`--field` must be given: `--parts` are told apart by its features")
    check_output("--picture", picture, (".png",))

    from dfd import Field, load, symmetry_planes
    from dfd.common.files import plain
    from dfd.geometry import topology
    from dfd.geometry.findings import findings
    from dfd.upright.candidates import check_up, explicit_up
    from dfd.views.visibility import unseen

    shape = load(mesh)
    moved = None if against is None else _moved(shape, load(against))
    counts = topology.inspect(shape)
    said = check_up(up)
    found = _found_up(shape) if said == "auto" else explicit_up(shape, said)
    report: dict[str, Any] = {
        "file": str(mesh),
        **asdict(counts),
        "up": {"axis": str(found), "sentence": found.sentence, **found.settings},
        "unseen": asdict(unseen(shape, frame=found.frame)),
        "findings": [asdict(finding) for finding in findings(shape, counts)],
    }
    rows: list[tuple[str, dict[str, Any]]] = []
    if field is not None:
        opened = Field.load(field, mesh=shape, other_shape=force)
        report["field"] = {
            "file": str(field),
            "dimension": opened.dimension,
            "settings": {name: value for name, value in opened.settings.items() if name != "losses"},
        }
        planes = symmetry_planes(opened, shape)
        report["symmetry_planes"] = [asdict(plane) for plane in planes]
        report["suggestions"], row = _suggested(shape, opened, suggestions, planes, force)
        rows.append(row)
        if cut:
            from dfd.pictures.sheet import parts_view
            from dfd.segmentation.parts import cut_document
            from dfd.segmentation.parts import parts as parts_of

            found_parts = parts_of(opened, shape).cut()
            report["cut"] = cut_document(found_parts)
            rows.append((f"{len(found_parts)} parts", parts_view(shape, found_parts)))
    if moved is not None:
        from dfd.geometry.metrics import area_ratios, surface_metrics
        from dfd.pictures.colors import ratio_colors

        report["against"] = {"file": str(against), **asdict(surface_metrics(shape, moved))}
        colors = ratio_colors(area_ratios(shape, moved))
        rows.append(("areas: halved blue, doubled red", {"vertices": moved, "colors": colors}))
    if picture is not None:
        from dfd.pictures.sheet import save_sheet

        save_sheet(picture, shape, rows, views=2, azimuth=25.0, file=mesh, resolution=640)
    if as_json:
        typer.echo(json.dumps(report, indent=2, default=plain))
    else:
        _print_table(report)


def _found_up(shape: Mesh) -> Up:
    from dfd.encoders.encode import load_encoder
    from dfd.encoders.known import DEFAULT_ENCODER
    from dfd.upright.candidates import file_up
    from dfd.upright.find_up import find_up

    try:
        encoder = load_encoder(DEFAULT_ENCODER)
    except OSError:  # no weights at hand: all else can be told
        return file_up()
    return find_up(shape, encoder)


def _moved(shape: Mesh, other: Mesh) -> Float64:
    """The vertices of `other`, if it is a moved `shape`."""
    import numpy as np

    if not np.array_equal(other.faces, shape.faces) or len(other.vertices) != len(shape.vertices):
        raise ValueError(f"`--against` must have the faces of MESH, got {other!r} against {shape!r}")
    return other.vertices


def _suggested(
    shape: Mesh, field: Field, count: int, planes: list[SymmetryPlane], other_shape: bool
) -> tuple[list[dict[str, Any]], tuple[str, dict[str, Any]]]:
    """Handles worth taking, for the report, and a row of a sheet that shows them by their numbers."""
    from dfd import CompactFeatures, Deformer
    from dfd.editing.suggestions import suggest_handles
    from dfd.pictures.colors import feature_colors

    features = Deformer(shape, field, other_shape=other_shape).features
    found = suggest_handles(shape, features, count=count, planes=planes)
    listed = [
        {
            "vertex": each.vertex,
            "position": shape.vertices[each.vertex],
            "share": each.share,
            "alike": [instance.vertex for instance in each.instances[1:]],
        }
        for each in found
    ]
    colors = features.principal(3) if isinstance(features, CompactFeatures) else features
    marks = {
        "colors": feature_colors(colors),
        "handles": [shape.vertices[each.vertex] for each in found],
        "labels": [str(number) for number in range(1, len(found) + 1)],
    }
    return listed, ("suggested handles", marks)


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
            found = [
                f"{plane_text(SymmetryPlane(**plane))}"
                f" (score {plane['score']:.3f}, {plane['relative_score']:.0%} of chance)"
                for plane in value
            ]
            table.add_row("symmetry planes", "\n".join(found) or "none")
        elif name == "up":
            table.add_row("up", value["sentence"])
        elif name == "suggestions":
            table.add_row("handles", "\n".join(_suggestion(number, **each) for number, each in enumerate(value, 1)))
        elif name == "cut":
            for each in value["parts"]:
                table.add_row(f"part {each['part']}", _part(**each).strip())
        elif name == "findings":
            table.add_row("odd", "\n".join(f"{each['what']} {each['means']}" for each in value) or "nothing")
        elif name == "against":
            for measure, line in _measures(value).items():
                table.add_row(measure, line)
        elif name == "unseen":
            table.add_row("unseen", _unseen(**value))
        else:
            table.add_row(name.replace("_", " "), _shown(value))
    Console(highlight=False, markup=False).print(table)


def _suggestion(number: int, vertex: int, position: Any, share: float, alike: list[int]) -> str:
    follow = f", and alike {', '.join(map(str, alike))}" if alike else ""
    return f"{number}: vertex {vertex}, {share:.0%} of the shape{follow}"


def _measures(against: dict[str, Any]) -> dict[str, str]:
    """The surface metrics, one a row."""
    crossing = against["self_intersecting_faces"]
    volume = against["volume"]
    return {
        "against": against["file"],
        "  area": f"{against['area']:.1%} off",
        "  angles": f"{against['angle']:.2f}° off",
        "  edge lengths": f"{against['edge_length']:.1%} off",
        "  volume": "none, the surface is not closed" if volume is None else f"{volume:+.1%}",
        "  flipped faces": f"{against['flipped_faces']:,}",
        "  self-intersecting faces": (
            "not counted: that needs libigl (the extra dfd[metrics]) and at most 200,000 faces"
            if crossing is None
            else f"{crossing:,}, {against['self_intersecting_before']:,} before"
        ),
    }


def _unseen(views: int, area: float, components: int, component_count: int) -> str:
    if component_count == 0:
        return "all of it, for no face has an area"
    if area == 0:
        return f"nothing, in {views} views"
    fraction = f"{area:.1%}" if area >= 0.001 else "less than 0.1%"
    wholly = f", {components:,} of {component_count:,} components wholly" if components else ""
    return f"{fraction} of the surface{wholly}, in {views} views: it takes the nearest seen features"


def _shown(value: Any) -> str:
    value = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(value, list | tuple):
        return ", ".join(map(_shown, value)) or "none"
    return f"{value:,}" if isinstance(value, int) and not isinstance(value, bool) else shown(value)


def parts(
    mesh: MeshArgument,
    field: MadeFieldOption = None,
    output: Annotated[
        Path | None,
        Option(
            "--output",
            "-o",
            metavar="FILE",
            help="A .json with the part of every vertex, an .obj with a group a part, a .glb with a material slot a"
            " part.",
        ),
    ] = None,
    picture: Annotated[Path | None, Option(metavar="PNG", help="Draw them, numbered.")] = None,
    views: ViewsOption = 2,
    resolution: ResolutionOption = 768,
    force: ForceOption = False,
) -> None:
    """Cut MESH into its parts: what looks alike, ends at creases, and would move as one."""
    check_output("--output", output, (".json", ".obj", ".glb", ".gltf"))
    check_output("--picture", picture, (".png",))

    from dfd import Field, distill, load
    from dfd.common.files import atomic_write
    from dfd.common.progress import Stages
    from dfd.export.export_parts import export_parts
    from dfd.segmentation.parts import cut_document
    from dfd.segmentation.parts import parts as parts_of

    stages = Stages()
    with stages.stage("read"):
        shape = load(mesh)
    given = None if field is None else Field.load(field, mesh=shape, other_shape=force)
    opened = given or distill(shape, progress=stages)
    with stages.stage("parts"):
        found = parts_of(opened, shape).cut()
    document = cut_document(found)
    if output is not None and output.suffix.lower() != ".json":
        export_parts(shape, found, output)
    elif output is not None:
        with atomic_write(output) as temporary:
            temporary.write_text(json.dumps(document), "utf-8")
    if picture is not None:
        from dfd.pictures.sheet import parts_view, save_sheet

        rows = [(f"{len(found)} parts", parts_view(shape, found))]
        save_sheet(picture, shape, rows, views=views, azimuth=35.0, resolution=resolution, file=mesh)
    typer.echo("\n".join(f"{row['part']:3d}  {_part(**row)}" for row in document["parts"]))


def _part(part: int, share: float, pieces: int, vertex: int) -> str:
    return f"{share:6.1%} of the surface, {pieces} {'pieces' if pieces > 1 else 'piece'}, at vertex {vertex}"
