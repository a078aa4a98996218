"""New skin weights for a rigged character, from feature similarity and distance to the bones."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dfd.common import check
from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float64
from dfd.export.bone_weights import BoneDistances, bone_weights
from dfd.export.bones import Bones, bones_of
from dfd.export.gltf.document import GltfDocument
from dfd.export.gltf.skin import weigh
from dfd.export.influences import Influences, heaviest
from dfd.field.field import Field
from dfd.mesh.mesh import Mesh

FAR = 0.1  # of the diagonal: weight bleeds where its bone is farther along the surface than the nearest by this
OUTSIDE = 0.25  # of the diagonal: a bone farther than that from every vertex is outside the mesh


@dataclass(frozen=True)
class Bleed:
    """Defects of skin weights."""

    # far: the part of all weight, in [0, 1], on vertices whose distance along the surface from the region around its
    # bone exceeds that from the region around their nearest bone by more than 10 % of the diagonal of the skinned
    # parts
    far: float
    unweighted: int  # how many vertices follow no joint

    def __str__(self) -> str:
        """Return it in a few words."""
        without = f", {self.unweighted} vertices without weight" if self.unweighted else ""
        return f"{100 * self.far:.2g} % of the weight far from its bone{without}"


@dataclass(frozen=True)
class SkinReport:
    """What was written."""

    path: Path  # the file
    joints: int  # how many joints have weights
    left_out: tuple[str, ...]  # the names of joints that have none, since they lie outside the mesh
    # before, after: defects of the file's weights, and of those that were written
    before: Bleed
    after: Bleed
    changed: float  # how much of a vertex's weight went to other joints on average, in [0, 1]

    def __str__(self) -> str:
        """Return one sentence."""
        sentences = [f"{self.joints} joints", f"before: {self.before}", f"after: {self.after}"]
        if self.left_out:
            sentences.append(f"outside the mesh and left out: {', '.join(self.left_out)}")
        return "; ".join(sentences)


def weigh_skin(mesh: Mesh, field: Field, path: str | os.PathLike[str], *, influences: int = 4) -> SkinReport:
    """Write a skinned character with new skin weights and everything else unchanged.

    A vertex follows a joint by feature similarity to the surface around its bone and by distance to it.
    Distances are those of the bind pose, in which limbs are apart; features are those of the given mesh.
    Joints that no vertex of the file follows, such as targets of inverse kinematics, get no weight, unless none has
    any: then all get some.

    `mesh` is from a .glb or .gltf file with a skin, and `path` of such an ending; `influences` is how many joints a
    vertex follows at most.

    Raises ValueError if the ending is another, the mesh has no skin, several, or a broken one, or no bone lies near it.
    Raises OSError if the file cannot be written; what was there before stays.
    """
    target = Path(path)
    check.ending("weigh_skin", "path", target, (".glb", ".gltf"))
    most = check.whole("weigh_skin", "influences", influences, minimum=1)
    bones = bones_of(mesh)
    distances = BoneDistances(bones)
    wanted = np.flatnonzero(bones.weights.any(axis=0)) if bones.weights.any() else np.arange(len(bones.names))
    inside = distances.straight[bones.skinned].min(axis=0) <= OUTSIDE
    joints = wanted[inside[wanted]]
    if len(joints) == 0:
        raise ArgumentError("mesh", "must have bones near its surface, got all of them far outside", "weigh_skin")
    along = distances.along[bones.skinned][:, wanted]
    order, single, _ = heaviest(bone_weights(mesh, field, distances, joints), min(most, len(bones.names)))
    _write(mesh, bones, Influences(order, single, 0.0, 0), target)
    after = np.zeros_like(bones.weights)
    np.add.at(after, (np.arange(len(order))[:, None], order), single)
    return SkinReport(
        target,
        len(joints),
        tuple(bones.names[joint] for joint in wanted[~inside[wanted]]),
        bleed(bones.weights[bones.skinned][:, wanted], along),
        bleed(after[bones.skinned][:, wanted], along),
        float(np.abs(_whole(bones.weights[bones.skinned]) - after[bones.skinned]).sum(axis=1).mean() / 2),
    )


def bleed(weights: Float64, along: Float64) -> Bleed:
    """Measure the defects of weights (V, J) whose bones are at distances `along` (V, J) the surface, in diagonals.

    A part without a bone, such as a horn, may be far from all of them: weight of the nearest one is not a defect.
    """
    total = weights.sum()
    far = along > along.min(axis=1, keepdims=True) + FAR
    return Bleed(float(weights[far].sum() / total) if total > 0 else 0.0, int((weights.sum(axis=1) <= 0).sum()))


def _whole(weights: Float64) -> Float64:
    total = weights.sum(axis=1, keepdims=True)
    return np.divide(weights, total, out=np.zeros_like(weights), where=total > 0)


def _write(mesh: Mesh, bones: Bones, influences: Influences, target: Path) -> None:
    document = GltfDocument(mesh)
    skinned = {each.source[0] for each in bones.primitives}
    for node, primitives in document.parts():
        if node in skinned:
            weigh(document, node, primitives, influences, len(bones.names), 0)
    document.write(target)
