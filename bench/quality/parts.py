"""Which kind of part a vertex of a character belongs to, from the name of the joint that moves it."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import dfd

# How a rig's joint names fall into the parts that every character has; the first match counts.
MERGED = (
    ("head", r"head|neck|jaw|eye"),
    ("hand", r"hand|wrist|finger|thumb"),
    ("arm", r"arm|elbow|shoulder|clavicle"),
    ("foot", r"foot|toe|ankle|heel"),
    ("leg", r"leg|knee|thigh|shin|calf"),
    ("torso", r"root|hips|pelvis|spine|chest|torso|body"),
)
# How the joints of animals and people fall into kinds of parts that one would want to move together, such as all legs;
# the first pattern found in a name in small letters counts.
KINDS = (
    ("ear", r"^ear"),
    ("horn", r"horn"),
    ("wing", r"wing|feather"),
    ("tail", r"tail"),
    ("fin", r"fin(_|$)"),
    ("hand", r"hand|wrist|finger|thumb|index|middle|ring|pinky"),
    ("foot", r"foot|toe|ball|hoof|^ff|^ik(front|back)leg|leg_tip|leg_._tip"),
    ("torso", r"clavicle|collar|shoulder|pelvis|hip|spine|torso|chest|back$|body|stomach|root|rib"),
    ("arm", r"arm"),
    ("leg", r"leg|thigh|calf|shin|ankle|knee"),
    ("neck", r"neck"),
    ("head", r"head|mouth|jaw|chin|nose|eye|tongue|brow|face"),
)
FEWEST = 20  # vertices of a kind of part that is judged
TOUCHES = 1e-4  # of the diagonal: a vertex that far from every skinned one has no joint


def sides_as_one(joint: str) -> str:
    """A joint's name without its side and number: "upperarm.l", "LeftUpperArm" and "UpperArm_R" give "upperarm"."""
    name = re.sub(r"(?<=[a-z])[LR](?=$|[^A-Za-z])|^[lr](?=[A-Z])", "", joint).lower()
    name = re.sub(r"left|right|[._\-\s][lr]\b|\b[lr][._\-\s]|[._\-\s][lr](?=[._\-\s])", "", name)
    return re.sub(r"^[._\-\s]+|[._\-\s\d]+$", "", name)


def merged(joint: str) -> str | None:
    """The part that every character has: head, torso, arm, hand, leg or foot; None for a joint of no such part."""
    for part, pattern in MERGED:
        if re.search(pattern, joint.lower()):
            return part
    return None


def kind_of_part(joint: str) -> str | None:
    """The kind of part that a joint of an animal or a person moves, see `KINDS`; None for one of no such part."""
    return next((kind for kind, pattern in KINDS if re.search(pattern, joint.lower())), None)


def without_few(
    labels: NDArray[np.int64], parts: Sequence[str], fewest: int = FEWEST
) -> tuple[NDArray[np.int64], tuple[str, ...]]:
    """The same labels (V,) and parts without those of fewer than `fewest` vertices, whose vertices belong to none."""
    size = np.bincount(labels[labels >= 0], minlength=len(parts))
    kept = np.flatnonzero(size >= fewest)
    number = np.full(len(parts) + 1, -1)  # the last one is that of −1
    number[kept] = np.arange(len(kept))
    return number[labels], tuple(parts[part] for part in kept)


def label_vertices(
    mesh: dfd.Mesh,
    places: NDArray[np.float64],
    joints: Sequence[str],
    kind: Callable[[str], str | None],
) -> tuple[NDArray[np.int64], tuple[str, ...]]:
    """Give every vertex of `mesh` the kind of the joint at its place.

    Parameters
    ----------
    places, joints
        (N, 3) positions of skinned vertices in mesh units, and the joint that moves each the most.
    kind
        From a joint's name to its part; None leaves its vertices without one.

    Returns
    -------
    labels, parts
        (V,) index into `parts`; −1 where nothing skinned is near: a sword or a cape is no part of its bearer.
    """
    kinds = [kind(joint) for joint in joints]
    parts = tuple(sorted({each for each in kinds if each is not None}))
    numbers = np.array([-1 if each is None else parts.index(each) for each in kinds])
    distance, nearest = cKDTree(places).query(mesh.vertices)
    return np.where(distance < TOUCHES * mesh.diagonal, numbers[nearest], -1), parts


def only(mesh: dfd.Mesh, vertices: NDArray[np.bool_]) -> tuple[dfd.Mesh, NDArray[np.int64]]:
    """The faces of `mesh` whose corners are all among `vertices` (V,), with their looks; and its vertices' old indices.

    Raises
    ------
    ValueError
        If no face is left.
    """
    kept = vertices[mesh.faces].all(axis=1)
    old = np.unique(mesh.faces[kept])
    new = np.full(len(mesh.vertices), -1, np.int32)
    new[old] = np.arange(len(old))
    looks = mesh.appearance
    if looks is not None:
        used = np.zeros(len(looks.corners), bool)
        used[looks.corner_faces[kept]] = True
        looks = replace(
            looks,
            corners=np.where(used, new[looks.corners], -1).astype(np.int32),
            corner_faces=looks.corner_faces[kept],
            face_material=looks.face_material[kept],
        )
    return dfd.Mesh(mesh.vertices[old], new[mesh.faces[kept]], appearance=looks), old
