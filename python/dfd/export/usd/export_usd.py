"""A rig as a USD file: UsdSkel with all influences, or blend shapes, or the moved shape.

The format: Pixar, "Universal Scene Description", UsdSkel and UsdPreviewSurface.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dfd.common.files import atomic_write
from dfd.export.gltf.morph import MorphTargets, targets_of
from dfd.export.report import RigReport, rig_report
from dfd.export.rig import Rig
from dfd.export.skinning import skin_of
from dfd.mesh.mesh import MeshPart

try:
    from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, UsdUtils, Vt

    from dfd.export.usd import skeleton
    from dfd.export.usd.materials import TextureFiles, add_materials, bind_materials
    from dfd.export.usd.surfaces import Surfaces, read_surfaces
except ImportError as missing:
    raise ValueError(f"export_rig: USD files need more packages ({missing.name}): pip install 'dfd[export]'") from None


def export_usd(rig: Rig, target: Path, form: str, most: int | None) -> RigReport:
    """Write a rig as a "skin" of at most `most` influences a vertex, "morph" targets or "baked"; textures beside it.

    Raises what `export_rig` raises.
    """
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)  # as in glTF
    files = TextureFiles(target.stem)
    root = (UsdGeom.Xform if form == "baked" else UsdSkel.Root).Define(stage, "/shape")
    stage.SetDefaultPrim(root.GetPrim())
    surfaces = read_surfaces(rig.mesh)
    meshes = _meshes(stage, rig, surfaces, files)
    if form == "skin":
        report = _skin(stage, rig, target, most, meshes)
    elif form == "morph":
        report = _morph(stage, rig, target, meshes)
    else:
        for mesh, part in meshes:
            _set_points(mesh, rig.posed(rig.edit)[part.vertices])
        report = rig_report(rig, (target,), form)
    return replace(report, paths=_write(stage, target, files.files), notes=(*report.notes, *_lost(rig, surfaces)))


def _lost(rig: Rig, surfaces: Surfaces) -> tuple[str, ...]:
    """Sentences about colors that USD cannot store."""
    known = rig.mesh.appearance
    if known is None or known.colors is None or all(each.texture is None for each in known.materials):
        return surfaces.notes
    return (*surfaces.notes, "vertex colors do not tint textures in USD")


def _meshes(stage: Any, rig: Rig, surfaces: Surfaces, files: TextureFiles) -> list[tuple[Any, MeshPart]]:
    """A mesh for each part of the scene, at rest."""
    appearance, materials = rig.mesh.appearance, []
    if appearance is not None:
        materials = add_materials(stage, "/shape/materials", appearance, surfaces, files)
    found = []
    names = skeleton.identifiers(["materials", "skeleton", *(part.name for part in rig.mesh.parts)])[2:]
    for name, part in zip(names, rig.mesh.parts, strict=True):
        mesh = UsdGeom.Mesh.Define(stage, f"/shape/{name}")
        corners = np.searchsorted(part.vertices, rig.mesh.faces[part.faces]).astype(np.int32)
        mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(corners), 3, np.int32)))
        mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(np.ascontiguousarray(corners.ravel())))
        mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        mesh.CreateDoubleSidedAttr(True)
        _set_points(mesh, rig.mesh.vertices[part.vertices])
        normals = np.ascontiguousarray(rig.mesh.normals[part.vertices])
        mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(normals))
        mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
        if appearance is not None:
            bind_materials(mesh, part, appearance, surfaces, materials)
        found.append((mesh, part))
    return found


def _set_points(mesh: Any, points: np.ndarray[Any, Any]) -> None:
    array = Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(points, np.float32))
    mesh.CreatePointsAttr(array)
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(array))


def _skin(stage: Any, rig: Rig, target: Path, most: int | None, meshes: list[tuple[Any, MeshPart]]) -> RigReport:
    found = skin_of(rig, most, skeleton.stored)
    bones = skeleton.add_skeleton(stage, "/shape/skeleton", rig)
    timed = list(zip(_times(stage, rig), found.moments, strict=True))
    skeleton.add_animation(stage, "/shape/skeleton/animation", rig, timed, bones)
    for mesh, part in meshes:
        skeleton.bind_mesh(mesh, bones, found.influences, part.vertices)
    return rig_report(rig, (target,), "skin", found.difference, found.influences)


def _morph(stage: Any, rig: Rig, target: Path, meshes: list[tuple[Any, MeshPart]]) -> RigReport:
    targets = targets_of(rig)
    names = skeleton.identifiers(targets.names)
    bones = UsdSkel.Skeleton.Define(stage, "/shape/skeleton")
    bones.CreateJointsAttr(["root"])
    for attribute in (bones.CreateBindTransformsAttr(), bones.CreateRestTransformsAttr()):
        attribute.Set(Vt.Matrix4dArray([Gf.Matrix4d(1.0)]))
    animation = UsdSkel.Animation.Define(stage, "/shape/skeleton/animation")
    animation.CreateBlendShapesAttr(names)
    for time, weights in zip(_times(stage, rig), targets.weights, strict=True):
        animation.CreateBlendShapeWeightsAttr().Set(Vt.FloatArray(weights.tolist()), time)
    UsdSkel.BindingAPI.Apply(bones.GetPrim()).CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    for mesh, part in meshes:
        _add_targets(stage, mesh, part, rig, targets, names, bones)
    return rig_report(rig, (target,), "morph", targets.difference(rig), targets=len(names))


def _add_targets(
    stage: Any, mesh: Any, part: MeshPart, rig: Rig, targets: MorphTargets, names: Sequence[str], bones: Any
) -> None:
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateSkeletonRel().SetTargets([bones.GetPath()])
    own = []
    for name, shape in zip(names, targets.shapes, strict=True):
        moved = (shape - rig.mesh.vertices)[part.vertices].astype(np.float32)
        there = np.flatnonzero(moved.any(axis=1)).astype(np.int32)
        if len(there) == 0:
            continue
        blend = UsdSkel.BlendShape.Define(stage, f"{mesh.GetPath()}/{name}")
        blend.CreateOffsetsAttr(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(moved[there])))
        blend.CreatePointIndicesAttr(Vt.IntArray.FromNumpy(there))
        own.append((name, blend.GetPath()))
    binding.CreateBlendShapesAttr([name for name, _ in own])
    binding.CreateBlendShapeTargetsRel().SetTargets([path for _, path in own])


def _times(stage: Any, rig: Rig) -> list[Any]:
    """The time code of the edit, the default one, and of each key pose."""
    if rig.poses:
        stage.SetTimeCodesPerSecond(skeleton.RATE)
        stage.SetFramesPerSecond(skeleton.RATE)
        stage.SetStartTimeCode(rig.poses[0].seconds * skeleton.RATE)
        stage.SetEndTimeCode(rig.poses[-1].seconds * skeleton.RATE)
    return [Usd.TimeCode.Default(), *(Usd.TimeCode(pose.seconds * skeleton.RATE) for pose in rig.poses)]


def _write(stage: Any, target: Path, images: dict[str, bytes]) -> tuple[Path, ...]:
    """Write the file, and its textures next to it or, in a .usdz, inside; return the paths."""
    with tempfile.TemporaryDirectory(prefix="dfd-") as folder:
        ending = target.suffix.lower()
        layer = Path(folder) / f"{target.stem}{'.usdc' if ending == '.usdz' else ending}"
        stage.GetRootLayer().Export(str(layer))
        for name, data in images.items():
            (Path(folder) / name).write_bytes(data)
        made = layer
        if ending == ".usdz":
            made = Path(folder) / "package.usdz"
            if not UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(layer)), str(made)):
                raise OSError(5, f"export_rig: {target} could not be packed")
            images = {}
        with ExitStack() as stack:
            for path, source in [(target, made), *((target.with_name(name), Path(folder) / name) for name in images)]:
                stack.enter_context(atomic_write(path)).write_bytes(source.read_bytes())
    return (target, *(target.with_name(name) for name in images))
