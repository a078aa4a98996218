"""Measure how well a handle moves the subtree of a joint, in the rigs of characters and animals.

The subtree of a joint is all vertices of the joint and its descendants. A user who adds a handle in a subtree may mean
this subtree or that of an ancestor. Each counts alone, on both sides, on all limbs, and for all joints of its kind.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order

import dfd
from bench.quality.measures import area_fractions, session_of, soft_iou, weights_of_each
from bench.quality.parts import kind_of_part
from bench.quality.shapes import strongest_joints
from dfd.common.linear_algebra import Bool, Float64, Int64
from dfd.geometry.topology import face_sides
from dfd.mesh.file.gltf.header import objects, parents

LARGEST_MEANT = 0.6  # largest fraction of the surface area in a subtree that a user may mean
SMALLEST_JUDGED, LARGEST_JUDGED = 0.003, 0.4  # a joint gets handles if its subtree has an area fraction between these
HANDLES = 3  # largest number of handles per joint
HELD_WELL = 0.7  # a joint counts as held well if the mean soft IoU of its handles is at least this
STEPS = 2  # a user may choose among the levels from −STEPS to STEPS
LEGEND = {
    "soft IoU": "Σ min(w, t) / Σ max(w, t) over the surface, for weights w and the best set t that a user may mean",
    "left behind": "the fraction of the area of the joint's subtree that does not follow the handle",
    "held well": f"the fraction of joints with a soft IoU of at least {HELD_WELL}",
    "held well at a level": f"the same if the user chooses the best of the levels from -{STEPS} to {STEPS}",
}
# In rigs for inverse kinematics, feet and hands are children of a root. `read_rigged` makes them children of a limb.
FOOT = re.compile(r"foot|toe|hoof|paw|hand|fist|^ff|^ik", re.IGNORECASE)
# Joints of the Unreal mannequin, without sides, each after its parent; used for files in which no joint has a parent.
CHAINS = (
    "root pelvis spine_01 spine_02 spine_03 neck_01 head",
    "spine_03 clavicle upperarm lowerarm hand",
    "pelvis thigh calf foot ball",
)
MANNEQUIN = {child: parent for chain in CHAINS for parent, child in pairwise(chain.split())}


@dataclass(frozen=True, eq=False)
class RiggedShape:
    """A mesh with the tree of its joints, and the strongest joint of each vertex."""

    name: str
    mesh: dfd.Mesh
    areas: Float64  # (V,) fraction of the surface area that belongs to each vertex
    joints: tuple[str, ...]  # (J,) names of the joints
    parent: Int64  # (J,) index of each joint's parent, −1 for a root
    of_vertex: Int64  # (V,) index of the joint with the largest skin weight at each vertex, −1 for none

    def subtree(self, joint: int) -> Bool:
        """Return the mask (V,) of the vertices that belong to a joint or its descendants."""
        below = np.flatnonzero(self.parent >= 0)
        tree = csr_array((np.ones(len(below)), (self.parent[below], below)), shape=(len(self.joints),) * 2)
        return np.isin(self.of_vertex, breadth_first_order(tree, joint, return_predecessors=False))

    def meant(self, vertex: int) -> Iterator[tuple[list[str], Bool]]:
        """Yield every set of joints that a user may mean at a vertex: their names, and their subtrees' mask (V,)."""
        joint = int(self.of_vertex[vertex])
        while joint >= 0 and self.areas @ self.subtree(joint) <= LARGEST_MEANT:
            for kin in self._kin(joint):
                yield [self.joints[each] for each in kin], np.any([self.subtree(each) for each in kin], axis=0)
            joint = int(self.parent[joint])

    def judge(self, vertex: int, weights: Float64) -> tuple[float, float]:
        """Return the soft IoU of `weights` (V,) with the best set of `meant`, and the fraction that is left behind."""
        own = self.subtree(int(self.of_vertex[vertex]))
        best = max((soft_iou(self.areas, weights, meant) for _, meant in self.meant(vertex)), default=0.0)
        return best, 1.0 - float(self.areas[own] @ weights[own] / self.areas[own].sum())

    def handles(self) -> list[Int64]:
        """Return up to `HANDLES` random vertices of each joint that gets handles, see `SMALLEST_JUDGED`."""
        generator = np.random.default_rng(0)
        found = []
        for joint in range(len(self.joints)):
            own = np.flatnonzero(self.of_vertex == joint)
            if len(own) and SMALLEST_JUDGED <= self.areas @ self.subtree(joint) <= LARGEST_JUDGED:
                found.append(generator.choice(own, min(HANDLES, len(own)), replace=False))
        return found

    def _kin(self, joint: int) -> Iterator[list[int]]:
        """Yield the joint alone, then this joint on both sides, then on all limbs, and then all joints of its kind."""
        yield [joint]
        for same in (sides_as_one, _limb, kind_of_part):
            name = same(self.joints[joint])
            if name not in (None, "", "torso"):
                yield [other for other, each in enumerate(self.joints) if same(each) == name]


def rigged_shapes(folder: Path, *, quick: bool = False) -> Iterator[RiggedShape]:
    """Yield the rigs of the GLB files in a folder, except rigs whose joints get no handles; `quick` reads two files.

    Raises ValueError if the folder has no GLB file.
    """
    paths = sorted(folder.glob("*.glb"))
    if not paths:
        raise ValueError(f"anatomy: there is no GLB file in {folder}")
    for path in paths[: 2 if quick else None]:
        shape = read_rigged(path)
        if shape.handles():
            yield shape


def judged(shape: RiggedShape, field: dfd.Field) -> dict[str, float]:
    """Return the numbers that `LEGEND` explains, as means over the joints."""
    session, of_joints = session_of(shape.mesh, field), []
    for each in shape.handles():
        levels = [weights_of_each(session, each, level=level) for level in range(-STEPS, STEPS + 1)]
        of_joints.append(np.array([[*map(shape.judge, each.tolist(), weights)] for weights in levels]))
    overlap, left = np.transpose([each[STEPS].mean(axis=0) for each in of_joints])
    best = np.array([each[..., 0].max(axis=0).mean() for each in of_joints])
    numbers = overlap.mean(), left.mean(), (overlap >= HELD_WELL).mean(), (best >= HELD_WELL).mean()
    return dict(zip(LEGEND, map(float, numbers), strict=True))


def read_rigged(path: Path) -> RiggedShape:
    """Read a rig from a skinned GLB file."""
    mesh = dfd.load(path)
    joints, of_vertex = strongest_joints(mesh)
    parent = _tree(mesh, joints)
    shape = RiggedShape(path.stem, mesh, area_fractions(mesh), joints, parent, of_vertex)
    for joint, name in enumerate(joints):
        owner = parent[joint]
        if FOOT.search(name) and (owner < 0 or (parent[owner] < 0 and not (of_vertex == owner).any())):
            parent[joint] = _bordering(shape, joint)
    return shape


def _tree(mesh: dfd.Mesh, joints: tuple[str, ...]) -> Int64:
    """Return the parent (J,) of each joint from the nodes of the file, or from `MANNEQUIN` if no joint has a parent."""
    header = mesh.scene.gltf.header
    nodes, above = objects(header, "nodes"), parents(header)
    number = {name: index for index, name in enumerate(joints)}
    found = np.full(len(joints), -1)
    for skin in objects(header, "skins"):
        for node in skin["joints"]:
            parent = above.get(node)
            while parent is not None and nodes[parent].get("name", "") not in number:
                parent = above.get(parent)
            if parent is not None:
                found[number[nodes[node].get("name", "")]] = number[nodes[parent]["name"]]
    if (found >= 0).any():
        return found
    small = {name.lower(): index for name, index in number.items()}
    for name, index in small.items():
        side = name[-2:] if name.endswith(("_l", "_r")) else ""
        stem = name.removesuffix(side)
        if finger := re.fullmatch(r"(index|middle|ring|pinky|thumb)_0(\d)", stem):
            stem_above = "hand" if finger[2] == "1" else f"{finger[1]}_0{int(finger[2]) - 1}"
        else:
            stem_above = MANNEQUIN.get(stem, "")
        found[index] = small.get(stem_above + side, small.get(stem_above, -1))
    return found


def _bordering(shape: RiggedShape, joint: int) -> int:
    """Return the joint to which most edges lead from the subtree of `joint`, or the parent if no edge leaves it."""
    inside = shape.subtree(joint)
    edges = face_sides(shape.mesh.faces)
    edges = np.concatenate([edges, edges[:, ::-1]])
    beyond = shape.of_vertex[edges[inside[edges[:, 0]] & ~inside[edges[:, 1]], 1]]
    beyond = beyond[beyond >= 0]
    return int(np.bincount(beyond).argmax()) if len(beyond) else int(shape.parent[joint])


def sides_as_one(joint: str) -> str:
    """Return a joint's name without its side and number: "upperarm.l", "LeftUpperArm", "UpperArm_R" → "upperarm"."""
    name = re.sub(r"(?<=[a-z])[LR](?=$|[^A-Za-z])|^[lr](?=[A-Z])", "", joint).lower()
    name = re.sub(r"left|right|[._\-\s][lr]\b|\b[lr][._\-\s]|[._\-\s][lr](?=[._\-\s])", "", name)
    return re.sub(r"^[._\-\s]+|[._\-\s\d]+$", "", name)


def _limb(joint: str) -> str:
    """Return a joint's name without its side, its number, and words such as "front" or "hind"."""
    return re.sub(r"front|fore|back|hind|rear|mid(dle)?", "", sides_as_one(joint)).strip("._- ")
