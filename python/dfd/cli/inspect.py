"""`dfd inspect` and `dfd parts`: what a mesh is made of."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from dfd.cli import options
from dfd.cli.arguments import check_output, open_field
from dfd.cli.errors import say

if TYPE_CHECKING:
    from dfd.field.field import Field
    from dfd.mesh.mesh import Mesh
    from dfd.views.visibility import Unseen

# A topic: its part of the report, lines for people, and a row of a sheet, its title and the arguments of `picture`.
Topic = tuple[dict[str, Any], list[str], tuple[str, dict[str, Any]]]


def inspect(
    mesh: options.Mesh,
    field: Annotated[
        Path | None, Option(metavar="FIELD", help="Also find symmetry planes and suggest handles.")
    ] = None,
    against: Annotated[Path | None, Option(metavar="MESH", help="Also measure how this deformed the surface.")] = None,
    suggestions: Annotated[int, Option(min=1, max=50, help="With --field: at most so many handles are suggested.")] = 8,
    picture: Annotated[
        Path | None, Option(metavar="PNG", help="With --field, --against: draw suggested handles, how areas changed.")
    ] = None,
    up: Annotated[
        str, Option(metavar="DIRECTION", help="Which way is up: auto, file, +y, -z, …, or numbers such as 0,0,1.")
    ] = "auto",
    as_json: Annotated[bool, Option("--json", help="Print everything as JSON.")] = False,
    force: options.Force = False,
) -> None:
    """Say what MESH is made of, what is odd about it, which way is up, and how much of it pictures do not show.

    The pictures are those that `dfd distill` takes.
    """
    if picture is not None and field is None and against is None:
        raise ValueError("`--field` or `--against` must be given: `--picture` draws what comes of them")
    check_output("--picture", picture, (".png",))

    from dfd import load
    from dfd.common.files import plain
    from dfd.encoders.encode import load_encoder
    from dfd.encoders.known import DEFAULT_ENCODER
    from dfd.geometry import topology
    from dfd.geometry.findings import findings
    from dfd.upright.candidates import check_up, explicit_up, file_up
    from dfd.upright.find_up import find_up
    from dfd.views.visibility import unseen

    shape = load(mesh)
    opened = None if field is None else open_field(shape, field, force=force)
    counts, said = topology.inspect(shape), check_up(up)
    try:
        found = find_up(shape, load_encoder(DEFAULT_ENCODER)) if said == "auto" else explicit_up(shape, said)
    except OSError:  # without weights, all else can still be told
        found = file_up()
    hidden = unseen(shape, frame=found.frame)
    odd = findings(shape, counts)
    report: dict[str, Any] = {
        "file": str(mesh),
        **asdict(counts),
        "up": {"axis": str(found), "sentence": found.sentence, **found.settings},
        "unseen": asdict(hidden),
        "findings": [asdict(finding) for finding in odd],
    }
    size = " × ".join(f"{length:g}" for length in counts.extents)
    border = f"{counts.boundary_edges:,} boundary edges" if counts.boundary_edges else "closed"
    components = f"{counts.components:,} component{'' if counts.components == 1 else 's'}"
    lines = [
        f"{mesh}: {counts.vertex_count:,} vertices, {counts.face_count:,} faces, {components}, {border}, {size}",
        f"up: {found.sentence}",
        *_unseen(hidden),
        *(f"odd: {finding.what} {finding.means}" for finding in odd),
    ]
    topics = [] if field is None or opened is None else [_of_field(field, opened, shape, suggestions, force)]
    topics += [] if against is None else [_of_deformed(against, load(against), shape)]
    for told, more, _ in topics:
        report |= told
        lines += more
    if picture is not None:
        from dfd.pictures.sheet import save_sheet

        save_sheet(picture, shape, [row for *_, row in topics], views=2, azimuth=25.0, resolution=640)
    say(json.dumps(report, indent=2, default=plain) if as_json else "\n".join(lines), result=True)


def _unseen(found: Unseen) -> list[str]:
    """Say how much of the surface no camera sees."""
    if found.component_count == 0:
        return ["unseen: all of it, for no face has an area"]
    if found.area == 0:
        return []
    fraction = f"{found.area:.1%}" if found.area >= 0.001 else "less than 0.1%"
    wholly = f", {found.components:,} of {found.component_count:,} components wholly" if found.components else ""
    return [f"unseen: {fraction} of the surface{wholly}, in {found.views} views: it takes the nearest seen features"]


def _of_field(path: Path, field: Field, shape: Mesh, count: int, other_shape: bool) -> Topic:
    """Tell the field, the symmetry planes and suggested handles; draw these with their numbers."""
    from dfd import Deformer, symmetry_planes
    from dfd.editing.suggestions import suggest_handles
    from dfd.pictures.colors import feature_colors
    from dfd.symmetry.plane import plane_text

    settings = {name: value for name, value in field.settings.items() if name != "losses"}
    planes = symmetry_planes(field, shape)
    features = Deformer(shape, field, other_shape=other_shape).features
    found = suggest_handles(shape, features, count=count, planes=planes)
    handles = [
        {
            "vertex": each.vertex,
            "position": shape.vertices[each.vertex],
            "share": each.share,
            "alike": [counterpart.vertex for counterpart in each.counterparts[1:]],
        }
        for each in found
    ]
    report = {
        "field": {"file": str(path), "dimension": field.dimension, "settings": settings},
        "symmetry_planes": [asdict(plane) for plane in planes],
        "suggestions": handles,
    }
    made = "".join(f", {settings[name]}" for name in ("encoder", "preset") if name in settings)
    scores = [(plane_text(each), f"score {each.score:.3f}, {each.relative_score:.0%} of chance") for each in planes]
    alike = [f", alike {' '.join(map(str, each['alike']))}" if each["alike"] else "" for each in handles]
    shares = [f"vertex {each.vertex} ({each.share:.0%}{others})" for each, others in zip(found, alike, strict=True)]
    lines = [
        f"field: {path}, {field.dimension} dimensions{made}",
        f"symmetry planes: {', '.join(f'{plane} ({score})' for plane, score in scores) or 'none'}",
        f"handles: {', '.join(shares)}",
    ]
    marks = {
        "colors": feature_colors(features),
        "handles": [each["position"] for each in handles],
        "labels": [str(number) for number in range(1, len(found) + 1)],
    }
    return report, lines, ("suggested handles", marks)


def _of_deformed(path: Path, other: Mesh, shape: Mesh) -> Topic:
    """Tell the metrics of `other`, a deformation of `shape`; draw its areas."""
    import numpy as np

    from dfd.geometry.metrics import area_ratios, surface_metrics
    from dfd.pictures.colors import ratio_colors

    moved = other.vertices
    if not np.array_equal(other.faces, shape.faces) or len(moved) != len(shape.vertices):
        raise ValueError(f"`--against` must have the faces of MESH, got {other!r} against {shape!r}")
    found = surface_metrics(shape, moved)
    volume = "no volume, the surface is not closed" if found.volume is None else f"volume {found.volume:+.1%}"
    crossing = "not counted: that needs libigl (the extra dfd[metrics]) and at most 200,000 faces"
    if found.self_intersecting_faces is not None:
        crossing = f"{found.self_intersecting_faces:,}, {found.self_intersecting_before:,} before"
    line = (
        f"against {path}: area {found.area:.1%} off, angles {found.angle:.2f}° off, "
        f"edge lengths {found.edge_length:.1%} off, {volume}, "
        f"flipped faces {found.flipped_faces:,}, self-intersecting faces {crossing}"
    )
    drawn = {"vertices": moved, "colors": ratio_colors(area_ratios(shape, moved))}
    report = {"against": {"file": str(path), **asdict(found)}}
    return report, [line], ("areas: halved blue, doubled red", drawn)


def parts(
    mesh: options.Mesh,
    field: options.MadeField = None,
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
    views: options.Views = 2,
    resolution: options.Resolution = 768,
    force: options.Force = False,
) -> None:
    """Cut MESH into its parts: what looks alike, ends at creases, and would move as one."""
    check_output("--output", output, (".json", ".obj", ".glb", ".gltf"))
    check_output("--picture", picture, (".png",))

    from dfd import load
    from dfd.common.files import atomic_write
    from dfd.common.progress import Stages
    from dfd.export.export_parts import export_parts
    from dfd.segmentation.parts import cut_document
    from dfd.segmentation.parts import parts as parts_of

    stages = Stages()
    with stages.stage("read"):
        shape = load(mesh)
    opened = open_field(shape, field, force=force, progress=stages)
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
