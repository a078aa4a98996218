"""What names say: a vertex's kind of part, by the joint that moves it, and a shape's family, by its file."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

import dfd
from dfd.common.linear_algebra import Bool, Int64
from dfd.mesh.file.gltf.header import objects

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
    ("tail", r"tail|^main6"),
    ("fin", r"fin([_.]|$)|flipper"),
    ("hand", r"hand|wrist|finger|thumb|index|middle|ring|pinky|palm|fist"),
    ("foot", r"foot|toe|ball|hoof|^ff|^ik(front|back)leg|leg_tip|leg_._tip"),
    ("torso", r"clavicle|collar|shoulder|pelvis|hip|spine|torso|chest|back$|body|stomach|root|rib"),
    ("torso", r"abdomen|thorax|belly|^main[2-5]"),
    ("arm", r"arm"),
    ("leg", r"leg|thigh|calf|shin|ankle|knee"),
    ("neck", r"neck"),
    ("head", r"head|mouth|jaw|chin|nose|eye|tongue|brow|face|^main1"),
)
FEWEST = 20  # vertices of a kind of part that is judged
# Shapes of one family: what is learned from some of them is judged on the others only.
# By words in a file's name; the first one found counts.
FAMILIES = (
    ("seats", "chair couch bench bed stool"),
    ("fish", "fish shark whale"),
    ("four-legged", "alpaca dog fox horse shibainu wolf spot koala quadruped stegosaurus triceratops _rat"),
    ("dinosaurs", "kaiju velociraptor parasaurolophus"),
    ("mechs", "mech cyberpunk_pack_enemy"),
    ("people", "man robot knightcharacter modular male game_pack_character punk_pack_character"),
    ("helmets", "helmet skull"),
    ("people", "knight"),
    ("insects", "wasp scorpion spider _bee"),
    ("birds", "bird duck"),
    ("snakes", "snake"),
    ("plants", "pumpkin"),
    ("lights", "light lamp lantern candle"),
    ("streets", "street_pack"),
    ("plants", "plant tree bush cactus willow hay"),
    ("vehicles", "truck plane boat ship _car_ _cart tank_pack"),
    ("cabinets", "shelf nightstand oven table chest cabinet drawer fridge counter machine"),
    ("graves", "grave coffin plaque crypt"),
    ("houses", "house_3 houses well building tower sawmill gazebo market archery _port_ farm"),
    ("vessels", "sink cauldron jar ketchup pot bottle barrel crate dumpster"),
)


def merged(joint: str) -> str | None:
    """The part that every character has, see `MERGED`; None for a joint of no such part."""
    return next((part for part, pattern in MERGED if re.search(pattern, joint.lower())), None)


def kind_of_part(joint: str) -> str | None:
    """The kind of part that a joint of an animal or a person moves, see `KINDS`; None for one of no such part."""
    return next((kind for kind, pattern in KINDS if re.search(pattern, joint.lower())), None)


def without_few(labels: Int64, parts: Sequence[str], fewest: int = FEWEST) -> tuple[Int64, tuple[str, ...]]:
    """The same labels (V,) and parts without those of fewer than `fewest` vertices, whose vertices belong to none."""
    size = np.bincount(labels[labels >= 0], minlength=len(parts))
    kept = np.flatnonzero(size >= fewest)
    number = np.full(len(parts) + 1, -1)  # the last one is that of −1
    number[kept] = np.arange(len(kept))
    return number[labels], tuple(parts[part] for part in kept)


def strongest_joints(mesh: dfd.Mesh) -> list[str | None]:
    """(V,) the name of the joint that moves each vertex of a glTF file the most; None where nothing is skinned.

    Raises ValueError if a skin's numbers cannot be read.
    """
    found: list[str | None] = [None] * len(mesh.vertices)
    if mesh.scene is None or mesh.scene.gltf is None:
        return found
    header, data = mesh.scene.gltf.header, mesh.scene.gltf
    nodes = objects(header, "nodes")
    for part in mesh.scene.primitives:
        node, of_mesh, number = part.source
        if "skin" not in nodes[node]:
            continue
        primitive = header["meshes"][of_mesh]["primitives"][number]
        sets = sorted(name for name in primitive["attributes"] if name.startswith("WEIGHTS_"))
        if not sets:
            raise ValueError(f"strongest_joints: the skinned part {part.part!r} has no WEIGHTS_0")
        weights, joints = (
            np.concatenate([data.attribute(primitive, name.replace("WEIGHTS", kind)) for name in sets], axis=1)
            for kind in ("WEIGHTS", "JOINTS")
        )
        strongest = np.take_along_axis(joints, weights.argmax(axis=1)[:, None], axis=1)[:, 0]
        of_skin = header["skins"][nodes[node]["skin"]]["joints"]
        for vertex, joint in zip(mesh.scene.vertex[part.rows], strongest, strict=True):
            if vertex >= 0:
                found[vertex] = nodes[of_skin[int(joint)]].get("name", "")
    return found


def label_vertices(joints: Sequence[str | None], kind: Callable[[str], str | None]) -> tuple[Int64, tuple[str, ...]]:
    """For every vertex the index (V,) of the kind of the joint that moves it the most, and the kinds.

    `joints` (V,) see `strongest_joints`; `kind` gives a joint's name its part, None leaves its vertices without one.
    They have −1: a sword or a cape is no part of its bearer.
    """
    kinds = [None if joint is None else kind(joint) for joint in joints]
    parts = tuple(sorted({each for each in kinds if each is not None}))
    return np.array([-1 if each is None else parts.index(each) for each in kinds], np.int64), parts


def only(mesh: dfd.Mesh, vertices: Bool) -> tuple[dfd.Mesh, Int64]:
    """The faces whose corners are all among `vertices` (V,), with their appearance; and the vertices' old indices.

    Raises ValueError if no face is left.
    """
    kept = vertices[mesh.faces].all(axis=1)
    old = np.unique(mesh.faces[kept])
    new = np.full(len(mesh.vertices), -1, np.int32)
    new[old] = np.arange(len(old))
    appearance = mesh.appearance
    if appearance is not None:
        used = np.zeros(len(appearance.corners), bool)
        used[appearance.corner_faces[kept]] = True
        appearance = replace(
            appearance,
            corners=np.where(used, new[appearance.corners], -1).astype(np.int32),
            corner_faces=appearance.corner_faces[kept],
            face_material=appearance.face_material[kept],
        )
    return dfd.Mesh(mesh.vertices[old], new[mesh.faces[kept]], appearance=appearance), old


def family_of(name: str) -> str:
    """The family of a file's stem or a sample's name; of a stranger its own name."""
    return next((family for family, words in FAMILIES if any(word in name.lower() for word in words.split())), name)
