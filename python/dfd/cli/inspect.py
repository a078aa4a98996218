"""`dfd inspect` and `dfd parts`: what a mesh is made of."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from dfd.cli.arguments import (
    ForceOption,
    MadeFieldOption,
    MeshArgument,
    ResolutionOption,
    ViewsOption,
    check_output,
    open_or_distill,
    open_shape,
)
from dfd.cli.errors import say

if TYPE_CHECKING:
    from dfd.field.field import Field
    from dfd.mesh.mesh import Mesh
    from dfd.symmetry.plane import SymmetryPlane
    from dfd.upright.candidates import Up

Row = tuple[str, dict[str, Any]]  # of a sheet: its title, and the arguments of `picture`


def inspect(
    mesh: MeshArgument,
    field: Annotated[
        Path | None, Option("--field", metavar="FIELD", help="Also find symmetry planes and suggest handles.")
    ] = None,
    against: Annotated[
        Path | None, Option("--against", metavar="MESH", help="Also measure how this deformed the surface.")
    ] = None,
    suggestions: Annotated[int, Option(min=1, max=50, help="With --field: at most so many handles are suggested.")] = 8,
    picture: Annotated[
        Path | None, Option(metavar="PNG", help="With --field, --against: draw suggested handles, how areas changed.")
    ] = None,
    up: Annotated[
        str, Option(metavar="DIRECTION", help="Which way is up: auto, file, +y, -z, …, or numbers such as 0,0,1.")
    ] = "auto",
    as_json: Annotated[bool, Option("--json", help="Print everything as JSON.")] = False,
    force: ForceOption = False,
) -> None:
    """Say what MESH is made of, what is odd about it, which way is up, and how much of it pictures do not show.

    The pictures are those that `dfd distill` takes.
    """
    if picture is not None and field is None and against is None:
        raise ValueError("`--field` or `--against` must be given: `--picture` draws what comes of them")
    check_output("--picture", picture, (".png",))

    from dfd import load, symmetry_planes
    from dfd.common.files import plain
    from dfd.common.progress import Stages
    from dfd.geometry import topology
    from dfd.geometry.findings import findings
    from dfd.upright.candidates import check_up, explicit_up
    from dfd.views.visibility import unseen

    shape, opened = open_shape(mesh, field, Stages(show=False), force=force)
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
    rows: list[Row] = []
    if opened is not None:
        settings = {name: value for name, value in opened.settings.items() if name != "losses"}
        report["field"] = {"file": str(field), "dimension": opened.dimension, "settings": settings}
        planes = symmetry_planes(opened, shape)
        report["symmetry_planes"] = [asdict(plane) for plane in planes]
        report["suggestions"], row = _suggested(shape, opened, suggestions, planes, force)
        rows.append(row)
    if against is not None:
        measured, row = _compared(shape, load(against))
        report["against"] = {"file": str(against), **measured}
        rows.append(row)
    if picture is not None:
        from dfd.pictures.sheet import save_sheet

        save_sheet(picture, shape, rows, views=2, azimuth=25.0, resolution=640)
    say(json.dumps(report, indent=2, default=plain) if as_json else "\n".join(_lines(report)), result=True)


def _found_up(shape: Mesh) -> Up:
    from dfd.encoders.encode import load_encoder
    from dfd.encoders.known import DEFAULT_ENCODER
    from dfd.upright.candidates import file_up
    from dfd.upright.find_up import find_up

    try:
        encoder = load_encoder(DEFAULT_ENCODER)
    except OSError:  # without weights, all else can still be told
        return file_up()
    return find_up(shape, encoder)


def _compared(shape: Mesh, other: Mesh) -> tuple[dict[str, Any], Row]:
    """The metrics of `other` against `shape`, which it is a deformation of, and a row that draws its areas."""
    import numpy as np

    from dfd.geometry.metrics import area_ratios, surface_metrics
    from dfd.pictures.colors import ratio_colors

    moved = other.vertices
    if not np.array_equal(other.faces, shape.faces) or len(moved) != len(shape.vertices):
        raise ValueError(f"`--against` must have the faces of MESH, got {other!r} against {shape!r}")
    drawn = {"vertices": moved, "colors": ratio_colors(area_ratios(shape, moved))}
    return asdict(surface_metrics(shape, moved)), ("areas: halved blue, doubled red", drawn)


def _suggested(
    shape: Mesh, field: Field, count: int, planes: list[SymmetryPlane], other_shape: bool
) -> tuple[list[dict[str, Any]], Row]:
    """Handles worth taking, for the report, and a row that draws them with their numbers."""
    from dfd import Deformer
    from dfd.editing.suggestions import suggest_handles
    from dfd.pictures.colors import feature_colors

    features = Deformer(shape, field, other_shape=other_shape).features
    found = suggest_handles(shape, features, count=count, planes=planes)
    listed = [
        {
            "vertex": each.vertex,
            "position": shape.vertices[each.vertex],
            "share": each.share,
            "alike": [counterpart.vertex for counterpart in each.counterparts[1:]],
        }
        for each in found
    ]
    marks = {
        "colors": feature_colors(features),
        "handles": [shape.vertices[each.vertex] for each in found],
        "labels": [str(number) for number in range(1, len(found) + 1)],
    }
    return listed, ("suggested handles", marks)


def _lines(report: dict[str, Any]) -> Iterator[str]:
    """The report for people: one line a topic."""
    from dfd.symmetry.plane import SymmetryPlane, plane_text

    size = " × ".join(f"{length:g}" for length in report["extents"])
    border = f"{report['boundary_edges']:,} boundary edges" if report["boundary_edges"] else "closed"
    components = f"{report['components']:,} component{'' if report['components'] == 1 else 's'}"
    counts = f"{report['vertex_count']:,} vertices, {report['face_count']:,} faces, {components}"
    yield f"{report['file']}: {counts}, {border}, {size}"
    yield f"up: {report['up']['sentence']}"
    if hidden := _unseen(**report["unseen"]):
        yield f"unseen: {hidden}"
    for each in report["findings"]:
        yield f"odd: {each['what']} {each['means']}"
    if "field" in report:
        settings = report["field"]["settings"]
        made = "".join(f", {settings[name]}" for name in ("encoder", "preset") if name in settings)
        yield f"field: {report['field']['file']}, {report['field']['dimension']} dimensions{made}"
        planes = [
            f"{plane_text(SymmetryPlane(**each))} (score {each['score']:.3f}, {each['relative_score']:.0%} of chance)"
            for each in report["symmetry_planes"]
        ]
        yield f"symmetry planes: {', '.join(planes) or 'none'}"
        handles = [
            f"vertex {each['vertex']} ({each['share']:.0%}"
            + (f", alike {' '.join(map(str, each['alike']))})" if each["alike"] else ")")
            for each in report["suggestions"]
        ]
        yield f"handles: {', '.join(handles)}"
    if "against" in report:
        yield f"against {report['against']['file']}: {_measures(report['against'])}"


def _measures(found: dict[str, Any]) -> str:
    """The surface metrics in words."""
    volume, crossing = found["volume"], found["self_intersecting_faces"]
    return (
        f"area {found['area']:.1%} off, angles {found['angle']:.2f}° off, edge lengths {found['edge_length']:.1%} off, "
        + ("no volume, the surface is not closed, " if volume is None else f"volume {volume:+.1%}, ")
        + f"flipped faces {found['flipped_faces']:,}, self-intersecting faces "
        + (
            "not counted: that needs libigl (the extra dfd[metrics]) and at most 200,000 faces"
            if crossing is None
            else f"{crossing:,}, {found['self_intersecting_before']:,} before"
        )
    )


def _unseen(views: int, area: float, components: int, component_count: int) -> str:
    """How much of the surface no camera sees, in words; empty if all of it is seen."""
    if component_count == 0:
        return "all of it, for no face has an area"
    if area == 0:
        return ""
    fraction = f"{area:.1%}" if area >= 0.001 else "less than 0.1%"
    wholly = f", {components:,} of {component_count:,} components wholly" if components else ""
    return f"{fraction} of the surface{wholly}, in {views} views: it takes the nearest seen features"


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

    from dfd.common.files import atomic_write
    from dfd.common.progress import Stages
    from dfd.export.export_parts import export_parts
    from dfd.segmentation.parts import cut_document
    from dfd.segmentation.parts import parts as parts_of

    stages = Stages()
    shape, opened = open_or_distill(mesh, field, stages, force=force)
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
        save_sheet(picture, shape, rows, views=views, azimuth=35.0, resolution=resolution)
    for row in document["parts"]:
        pieces = f"{row['pieces']} {'pieces' if row['pieces'] > 1 else 'piece'}"
        say(f"{row['part']:3d}  {row['share']:6.1%} of the surface, {pieces}, at vertex {row['vertex']}", result=True)
