"""The commands `dfd inspect` and `dfd parts`: describe a mesh and its parts."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from typer import Option

from dfd.cli import options
from dfd.cli.arguments import check_output, file_in, open_field, open_mesh
from dfd.cli.errors import say

if TYPE_CHECKING:
    from dfd.common.linear_algebra import Float64
    from dfd.symmetry.plane import SymmetryPlane

WORDS = ("`left` and `right`", "`top` and `bottom`", "`front` and `back`")  # the words for places along x, y and z
NEARLY = 0.94  # a direction lies along an axis if the cosine of the angle between both is at least this, for 20°


def inspect(
    mesh: options.Mesh,
    field: Annotated[Path | None, Option(metavar="FIELD", help="Also describe this field and find symmetry.")] = None,
    up: Annotated[
        str, Option(metavar="DIRECTION", help="Which way is up: auto, file, +y, -z, …, or numbers such as 0,0,1.")
    ] = "auto",
    as_json: Annotated[bool, Option("--json", help="Print everything as JSON.")] = False,
    picture: Annotated[Path | None, Option(metavar="PNG", help="Draw the mesh.")] = None,
    at: Annotated[
        tuple[int, int] | None,
        Option(metavar="X Y", help="Name the vertex and the point at this pixel of the picture, from the upper left."),
    ] = None,
    azimuth: options.Azimuth = None,
    elevation: options.Elevation = 15.0,
    zoom: options.Zoom = 1.0,
    resolution: options.Resolution = 768,
    force: options.Force = False,
) -> None:
    """Describe MESH: its size, its defects, and which way is up. The picture is the one that `dfd show MESH` draws."""
    if at is not None and not all(0 <= each < resolution for each in at):
        raise ValueError(f"`--at` must lie in 0 … {resolution - 1}, got {at[0]} {at[1]}")
    check_output("--picture", picture, (".png",))

    from dfd import symmetry_planes
    from dfd.common.files import plain
    from dfd.encoders.encode import load_encoder
    from dfd.encoders.known import DEFAULT_ENCODER
    from dfd.geometry import topology
    from dfd.geometry.findings import findings
    from dfd.pictures.pick import pick
    from dfd.pictures.sheet import save_sheet
    from dfd.pictures.viewpoint import azimuth_towards
    from dfd.symmetry.plane import plane_text
    from dfd.upright.candidates import Up, check_up, explicit_up
    from dfd.upright.find_up import find_up

    shape = open_mesh(mesh)
    opened = None if field is None else open_field(shape, field, force=force)
    counts, said = topology.inspect(shape), check_up(up)
    try:
        found = find_up(shape, load_encoder(DEFAULT_ENCODER)) if said == "auto" else explicit_up(shape, said)
    except OSError:  # the encoder's weights are missing: report everything else
        found = Up()
    odd = findings(shape, counts)
    low, high = shape.bounds.tolist()
    report: dict[str, Any] = {
        "file": str(mesh),
        **asdict(counts),
        "box": {"minimum": low, "maximum": high},
        "up": {"axis": str(found), "sentence": found.sentence, **found.settings},
        "findings": [asdict(finding) for finding in odd],
    }
    size = " × ".join(f"{length:g}" for length in counts.extents)
    border = f"{counts.boundary_edges:,} boundary edges" if counts.boundary_edges else "closed"
    components = f"{counts.components:,} component{'' if counts.components == 1 else 's'}"
    lines = [
        f"{mesh}: {counts.vertex_count:,} vertices, {counts.face_count:,} faces, {components}, {border}, {size}",
        f"box: from {_numbers(low)} to {_numbers(high)}",
        f"up: {found.sentence}",
        *(f"odd: {finding.what} {finding.means}" for finding in odd),
    ]
    look: dict[str, Any] = {"elevation": elevation, "zoom": zoom, "resolution": resolution}
    look["azimuth"] = azimuth_towards(shape, []) if azimuth is None else azimuth
    if picture is not None:
        save_sheet(picture, shape, [("the mesh", {})], **look)
        lines.append(f"picture: {picture}")
    if at is not None:
        picked = pick(shape, *at, **look)
        report["at"] = None if picked is None else asdict(picked)
        shown = "no surface" if picked is None else f"vertex {picked.vertex}, at point {_numbers(picked.point)}"
        lines.append(f"pixel {at[0]} {at[1]}: {shown}")
    if opened is not None:
        settings = {name: value for name, value in opened.settings.items() if name != "losses"}
        planes = symmetry_planes(shape, opened)
        report["field"] = {"file": str(field), "dimension": opened.dimension, "settings": settings}
        report["symmetry_planes"] = [asdict(plane) for plane in planes]
        made = "".join(f", {settings[name]}" for name in ("encoder", "preset") if name in settings)
        lines.append(f"field: {field}, {opened.dimension} dimensions{made}")
        scores = [
            f"{plane_text(each)} (score {each.score:.3f}, relative score {each.relative_score:.2f})" for each in planes
        ]
        lines.append(f"symmetry planes: {', '.join(scores) or 'none'}")
        if sides := sides_and_ends(planes, found.direction):
            report["sides"], report["ends"] = ("xyz"[axis] for axis in sides)
            lines.append(f"sides, by the upright symmetry plane: {WORDS[sides[0]]}; ends: {WORDS[sides[1]]}")
    say(json.dumps(report, indent=2, default=plain) if as_json else "\n".join(lines), result=True)


def sides_and_ends(planes: Sequence[SymmetryPlane], up: Float64) -> tuple[int, int] | None:
    """Return the indices of the axes across and along the only upright plane of a shape; None if no axis is near.

    The shape faces along this plane, in one of both directions. Of 96 rigs, people, animals, vehicles and furniture, 88
    have one upright plane, and all 88 face along it: 79 along z, and 9 along x. No cue of the surface tells the sign:
    with ten cues, learned without a shape's family, it is right for 85 % of 145 shapes, and for 55 % of animals.
    """
    upright = [np.asarray(plane.normal) for plane in planes if abs(np.dot(plane.normal, up)) < 1 - NEARLY]
    if len(upright) != 1:
        return None
    cosines = np.abs([upright[0], np.cross(upright[0], up)])
    across, along = cosines.argmax(axis=1).tolist()
    return (across, along) if cosines.max(axis=1).min() >= NEARLY else None


def _numbers(point: Sequence[float]) -> str:
    return ",".join(f"{each:.4g}" for each in point)


def parts(
    mesh: options.Mesh,
    field: options.MadeField = None,
    output: Annotated[
        Path | None,
        Option(
            "--output",
            "-o",
            metavar="FILE",
            help="A .json file with the part of every vertex, an .obj file with one group per part, or a .glb file with"
            " one material slot per part. A .png file is a picture, as with --picture.",
        ),
    ] = None,
    picture: Annotated[Path | None, Option(metavar="PNG", help="Draw the parts with numbers.")] = None,
    views: options.Views = 2,
    resolution: options.Resolution = 768,
    force: options.Force = False,
) -> None:
    """Cut MESH into its parts, such as legs and wheels. A part ends at creases, and a handle moves a whole part."""
    output = None if output is None else file_in(output, mesh, replace=force)
    if output is not None and output.suffix.lower() == ".png" and picture is None:
        output, picture = None, output
    check_output("--output", output, (".json", ".obj", ".glb", ".gltf", ".png"))
    check_output("--picture", picture, (".png",))

    from dfd.common.files import write_file
    from dfd.common.progress import Stages
    from dfd.export.export_parts import export_parts
    from dfd.segmentation.parts import cut_document
    from dfd.segmentation.parts import parts as parts_of

    stages = Stages()
    shape = open_mesh(mesh, stages)
    opened = open_field(shape, field, force=force, progress=stages)
    with stages.stage("parts"):
        found = parts_of(shape, opened).cut()
    document = cut_document(found)
    if output is not None and output.suffix.lower() != ".json":
        export_parts(shape, found, output)
    elif output is not None:
        write_file(output, json.dumps(document))
    if picture is not None:
        from dfd.pictures.sheet import parts_view, save_sheet

        rows = [(f"{len(found)} parts", parts_view(shape, found))]
        save_sheet(picture, shape, rows, views=views, azimuth=35.0, resolution=resolution)
    for row in document["parts"]:
        count = f"{row['components']} component{'s' if row['components'] > 1 else ''}"
        say(f"{row['part']:3d}  {row['share']:6.1%} of the surface, {count}, at vertex {row['vertex']}", result=True)
