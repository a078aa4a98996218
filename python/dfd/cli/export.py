"""The command `dfd export`: write a mesh with the handles of an edit as joints."""

from pathlib import Path
from typing import Annotated, Literal

from typer import Option

from dfd.cli import options
from dfd.cli.arguments import check_output, file_in, open_mesh, open_session
from dfd.cli.errors import say
from dfd.cli.rehearsal import check_edit
from dfd.encoders.known import DEFAULT_ENCODER


def export(
    mesh: options.Mesh,
    edit: Annotated[Path, Option(metavar="JSON", help="The edit whose handles become joints.", **options.READ)],
    field: options.MadeField = None,
    output: Annotated[
        Path | None,
        Option("--output", "-o", metavar="FILE", help="A .glb or .gltf file; if baked, also .obj, .ply, .stl or .off."),
    ] = None,
    form: Annotated[
        Literal["skin", "morph", "baked"] | None,
        Option(
            "--as",
            metavar="FORM",
            help="skin: handles as joints; morph: handles as morph targets; baked: the moved shape only. The default is"
            " skin, or morph if MESH already has a skin.",
        ),
    ] = None,
    influences: Annotated[
        str | None, Option(metavar="N|all", help="Largest number of joints that a vertex follows; 4 if left out.")
    ] = None,
    poses: Annotated[
        Path | None,
        Option(
            metavar="JSON",
            help="An edit whose key poses become the animation, instead of those of --edit.",
            **options.READ,
        ),
    ] = None,
    weights: Annotated[
        Path | None, Option(metavar="FILE", help="An .npz or .safetensors file for the weights as arrays.")
    ] = None,
    preset: options.PresetOfEdit = None,
    encoder: options.Encoder = DEFAULT_ENCODER,
    force: options.ForceReplacing = False,
) -> None:
    """Write MESH with the handles of an edit as joints, for Blender, game engines and other programs."""
    if output is None and weights is None:
        raise ValueError("`--output` or `--weights` must be given: otherwise nothing is kept")
    output = None if output is None else file_in(output, mesh, ending=".glb", replace=force)
    most: int | str | None = influences
    if influences is not None and influences != "all":
        if not influences.isdecimal() or int(influences) < 1:
            raise ValueError(f"`--influences` must be a whole number of at least 1, or all, got {influences}")
        most = int(influences)
    plain = (".obj", ".ply", ".stl", ".off") if form == "baked" else ()
    check_output("--output", output, (".glb", ".gltf", *plain))
    check_output("--weights", weights, (".npz", ".safetensors"))

    from dfd import export_rig, export_weights
    from dfd.common.progress import Stages
    from dfd.editing.edit_file import read_edit
    from dfd.export.export_rig import form_for

    stages = Stages()
    shape = open_mesh(mesh, stages)
    if output is not None:
        form_for(shape, output, form)  # raises an error before slow work begins
    check_edit(shape, (), (), edit=edit, other_shape=force)
    moments = None if poses is None else read_edit(poses, shape).poses
    session = open_session(shape, field, stages, edit, preset, force=force, encoder=encoder)
    with stages.stage("features", len(shape.vertices)) as advance:
        session.prepare(advance)
    if output is not None:
        with stages.stage("export"):
            report = export_rig(session, output, form=form, influences=most, poses=moments)
        say(f"{report.path}: {report}")
    if weights is not None:
        export_weights(session, weights)
        count = len(session.handles)
        say(f"{weights}: weights of {count} {'handle' if count == 1 else 'handles'}")
