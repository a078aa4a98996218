"""The command `dfd deform`: deform a shape by handles."""

import json
import re
from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Argument, Option

from dfd.batch.inputs import MESH_ENDINGS, has_magic
from dfd.cli import options
from dfd.cli.arguments import check_output, file_in, hold, open_mesh, open_session
from dfd.cli.errors import say
from dfd.cli.handles import handles, value_of
from dfd.cli.rehearsal import check_edit, check_plane
from dfd.editing.controls import CONTROLS
from dfd.encoders.known import DEFAULT_ENCODER
from dfd.posing.transforms import MOTIONS

NOTHING_MOVED = 1  # exit code if the edit moves nothing
FAR = 10  # a motion of more diagonals than this is probably in wrong units


def deform(
    context: typer.Context,
    meshes: Annotated[list[str], Argument(metavar="MESH", help="OBJ, PLY, STL, OFF, GLB or glTF file.")],
    field: options.MadeField = None,
    preset: options.PresetOfEdit = None,
    handle: Annotated[
        str | None,
        Option(metavar=options.PLACE, help="The place of a handle, before the options of this handle; repeatable."),
    ] = None,
    name: Annotated[str | None, Option(metavar="TEXT", help="The name of the handle in the edit.")] = None,
    fix: options.Fix = None,
    symmetry: Annotated[
        str | None, Option(metavar="auto|x|x=0.1|NX,NY,NZ,OFFSET", help="Plane of symmetry that mirrors all motions.")
    ] = None,
    band: Annotated[
        float | None,
        Option(metavar="WIDTH", help="Half width, in mesh units, of the band in which both sides blend; 0: no band."),
    ] = None,
    symmetry_candidates: Annotated[
        str | None, Option(metavar="any|axes", help="Planes that --symmetry auto tries; axes: only the paper's three.")
    ] = None,
    symmetry_threshold: Annotated[
        str | None,
        Option(
            metavar="ε|relative",
            help="--symmetry auto accepts planes with a score below ε: the mean feature difference between both sides."
            " relative (dfd's default) compares the difference with the spread of the features.",
        ),
    ] = None,
    fit: Annotated[
        Path | None,
        Option(
            metavar="JSON|MESH",
            help="Move the handles so that places arrive at targets: a JSON object of places and positions, such as"
            ' {"top": [0, 2, 0]}, or a mesh file with the points of a scan, which attract the nearest surface.',
            **options.READ,
        ),
    ] = None,
    fit_motion: Annotated[
        str, Option(metavar="rigid|scale|affine", help="The motion of each handle with --fit.")
    ] = "rigid",
    edit: Annotated[Path | None, Option(metavar="JSON", help="An edit file to start from.", **options.READ)] = None,
    force: options.ForceReplacing = False,
    encoder: options.Encoder = DEFAULT_ENCODER,
    output: Annotated[
        Path | None, Option("--output", "-o", metavar="MESH|FOLDER", help="The mesh to write, or its folder.")
    ] = None,
    picture: Annotated[Path | None, Option(metavar="PNG", help="A picture of the shape before and after.")] = None,
    azimuth: options.Azimuth = None,
    elevation: options.Elevation = 18.0,
    zoom: options.Zoom = 1.0,
    save_edit: Annotated[Path | None, Option(metavar="JSON", help="Write the edit, to use it with --edit.")] = None,
    **described: Any,
) -> None:
    """Deform MESH by handles from options, from an edit, or from both.

    `dfd batch --edit` deforms several shapes by an edit.
    """
    held = handles(context)
    if len(meshes) > 1 or has_magic(meshes[0]):
        raise ValueError("`MESH` must be one file: `dfd batch --edit` deforms several shapes")
    mesh = Path(meshes[0])
    if not held and edit is None:
        raise ValueError("`--handle` or `--edit` must be given: without them nothing moves")
    auto = {"band": band, "candidates": symmetry_candidates, "threshold": symmetry_threshold}
    if symmetry is None and any(value is not None for value in auto.values()):
        raise ValueError("`--band` and `--symmetry-…` need `--symmetry`")
    if output is None and picture is None and save_edit is None:
        raise ValueError("`--output`, `--picture` or `--save-edit` must be given: otherwise nothing is kept")
    output = None if output is None else file_in(output, mesh, replace=force)
    check_output("--output", output, MESH_ENDINGS)
    check_output("--picture", picture, (".png",))
    check_output("--save-edit", save_edit)

    from dfd.common.progress import Stages

    stages = Stages()
    shape = open_mesh(mesh, stages)
    check_edit(shape, held, fix, edit=edit, preset=preset, other_shape=force)
    wanted = None if fit is None else read_targets(fit)
    plane = None if symmetry is None else re.sub("^([^=]*,[^=]*,[^=]*),([^=]*)$", r"\1=\2", symmetry)
    mirror = {name: value_of(value) for name, value in auto.items()}
    if plane is not None:
        check_plane(shape, plane, **mirror)
    deformer = open_session(shape, field, stages, edit, preset, force=force, encoder=encoder)
    hold(deformer, held, fix)
    if plane is not None:
        deformer.set_symmetry(plane, **mirror)
    with stages.stage("features", len(shape.vertices)) as advance:
        deformer.prepare(advance)
    if wanted is not None:
        with stages.stage("fit"):
            found = deformer.fit(wanted, motion=fit_motion)  # type: ignore[arg-type]
        say(f"dfd: fitted to {fit}: {found}")
    with stages.stage("deform"):
        vertices = deformer.vertices
    report = deformer.report()
    if output is not None and report.warning is not None:
        say(f"dfd: {report.warning}, so nothing is written")
        raise typer.Exit(NOTHING_MOVED)
    if report.farthest > FAR * shape.diagonal:
        far = f"{report.farthest:.3g}, {report.farthest / shape.diagonal:.0f} times its diagonal"
        say(f"dfd: warning: the shape moved by {far}: motions are in the units of the mesh")

    replaced = output is not None and output.exists() and output.samefile(mesh)
    if output is not None:
        shape.save(output, vertices)
    if save_edit is not None:
        deformer.save(save_edit)
    if picture is not None:
        from dfd.pictures.sheet import save_before_after

        with stages.stage("draw"):
            save_before_after(picture, deformer, azimuth=azimuth, elevation=elevation, zoom=zoom)
    written = ", ".join(str(path) for path in (output, picture, save_edit) if path is not None)
    say(f"{written}: {report}{'; the input was replaced' if replaced else ''}")


def read_targets(path: Path) -> Any:
    """Return the targets of `Deformer.fit` in a file: a dict of places and positions, or the points of a mesh (N, 3).

    Raises OSError if `path` cannot be read, and ValueError if it is neither a mesh nor such a JSON object.
    """
    if path.suffix.lower() in MESH_ENDINGS:
        from dfd.mesh.mesh import load

        return load(path).vertices
    try:
        found = json.loads(path.read_text("utf-8"))
    except ValueError as error:
        raise ValueError(f"`--fit` {path} is no JSON file: {error}") from None
    numbers = isinstance(found, dict) and all(
        isinstance(to, list) and len(to) == 3 and all(isinstance(each, int | float) for each in to)
        for to in found.values()
    )
    if not numbers or not found:
        raise ValueError(f'`--fit` {path} must be an object of places and positions, such as {{"top": [0, 2, 0]}}')
    return found


_tables = options.from_table(MOTIONS, panel="Motion of a handle") | options.from_table(
    CONTROLS, panel="Controls of a handle"
)
options.add_options(deform, _tables, after="name")
options.group_options(
    deform,
    {
        "Handle": ("handle", "name", "fix"),
        "Fit": ("fit", "fit_motion"),
        "Symmetry": ("symmetry", "band", "symmetry_candidates", "symmetry_threshold"),
        "Output": ("output", "picture", "azimuth", "elevation", "zoom", "save_edit"),
    },
)
