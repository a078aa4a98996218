"""A rig in UsdSkel: a skeleton with its pose over time, and the joint influences of each mesh."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from pxr import Gf, Tf, Usd, UsdSkel, Vt

from dfd.common.linear_algebra import Int64
from dfd.export.influences import Influences
from dfd.export.joints import Local
from dfd.export.rig import Rig
from dfd.mesh.file.primitives import UniqueNames

RATE = 24.0  # time codes in a second
Moment = Usd.TimeCode


def identifiers(names: Sequence[str]) -> list[str]:
    """Valid USD names: letters, digits and underscores, all different."""
    unique = UniqueNames()
    return [unique.unique(Tf.MakeValidIdentifier(name)) for name in names]


def stored(local: Local) -> Local:
    """Round a pose to the precision of UsdSkel, which stores scales as 16-bit floats."""
    return Local(local.translation, local.rotation, local.scale.astype(np.float16).astype(np.float64))


def add_skeleton(stage: Usd.Stage, path: str, rig: Rig) -> Any:
    """Define the skeleton of a rig: the root, and all other joints below it."""
    skeleton = UsdSkel.Skeleton.Define(stage, path)
    skeleton.CreateJointsAttr(_tokens(rig))
    skeleton.CreateJointNamesAttr([joint.name for joint in rig.joints])
    # The root is the identity, so its children are in the mesh's coordinates.
    frames = Vt.Matrix4dArray([Gf.Matrix4d(joint.frame.T.tolist()) for joint in rig.joints])
    skeleton.CreateBindTransformsAttr(frames)
    skeleton.CreateRestTransformsAttr(frames)
    return skeleton


def add_animation(
    stage: Usd.Stage, path: str, rig: Rig, moments: Sequence[tuple[Any, Sequence[Local]]], skeleton: Any
) -> Any:
    """Define the poses of a skeleton at time codes, the first of which is the default one."""
    animation = UsdSkel.Animation.Define(stage, path)
    animation.CreateJointsAttr(_tokens(rig))
    for time, locals_ in moments:
        turns = [Gf.Quatf(float(q[3]), *(float(x) for x in q[:3])) for q in (each.rotation for each in locals_)]
        shifts = np.array([each.translation for each in locals_], np.float32)
        animation.CreateTranslationsAttr().Set(Vt.Vec3fArray.FromNumpy(shifts), time)
        animation.CreateRotationsAttr().Set(Vt.QuatfArray(turns), time)
        scales = [Gf.Vec3h(*(float(x) for x in each.scale)) for each in locals_]
        animation.CreateScalesAttr().Set(Vt.Vec3hArray(scales), time)
    binding = UsdSkel.BindingAPI.Apply(skeleton.GetPrim())
    binding.CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    return animation


def bind_mesh(mesh: Any, skeleton: Any, influences: Influences, vertices: Int64) -> None:
    """Bind the points of a mesh, which are `vertices` (N,), to a skeleton."""
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    binding.CreateGeomBindTransformAttr(Gf.Matrix4d(1.0))
    width = influences.joints.shape[1]
    joints = np.ascontiguousarray(influences.joints[vertices].ravel(), np.int32)
    weights = np.ascontiguousarray(influences.weights[vertices].ravel(), np.float32)
    binding.CreateJointIndicesPrimvar(False, width).Set(Vt.IntArray.FromNumpy(joints))
    binding.CreateJointWeightsPrimvar(False, width).Set(Vt.FloatArray.FromNumpy(weights))


def _tokens(rig: Rig) -> list[str]:
    root, *others = identifiers([joint.name for joint in rig.joints])
    return [root, *(f"{root}/{name}" for name in others)]
