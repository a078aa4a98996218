"""Tell kinds of parts from the names of joints, and families of shapes from the names of files."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np

import dfd
from dfd.common.linear_algebra import Bool, Int64
from dfd.mesh.file.gltf.header import objects

# Patterns in the names of joints for the parts that every character has; the first match counts.
MERGED = (
    ("head", r"head|neck|jaw|eye"),
    ("hand", r"hand|wrist|finger|thumb"),
    ("arm", r"arm|elbow|shoulder|clavicle"),
    ("foot", r"foot|toe|ankle|heel"),
    ("leg", r"leg|knee|thigh|shin|calf"),
    ("torso", r"root|hips|pelvis|spine|chest|torso|body"),
)
# Patterns for the joints of animals and people, by kinds of parts that move together, such as all legs; the first match
# in lower case counts.
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
# Words in the names of files for families; the first match counts. Learning leaves out the family that is judged.
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
    """Return the part in `MERGED` of a joint, or None."""
    return next((part for part, pattern in MERGED if re.search(pattern, joint.lower())), None)


def kind_of_part(joint: str) -> str | None:
    """Return the kind of part in `KINDS` of a joint, or None."""
    return next((kind for kind, pattern in KINDS if re.search(pattern, joint.lower())), None)


def family_of(name: str) -> str:
    """Return the family in `FAMILIES` of a file's stem or a sample's name, or else the name."""
    return next((family for family, words in FAMILIES if any(word in name.lower() for word in words.split())), name)


def strongest_joints(mesh: dfd.Mesh) -> tuple[tuple[str, ...], Int64]:
    """Return the distinct names (J,) of the joints of a glTF file, and the joint of largest weight per vertex (V,).

    Vertices without a skin have −1. Raises ValueError if a skin's numbers cannot be read.
    """
    found = np.full(len(mesh.vertices), -1)
    if mesh.scene is None or mesh.scene.gltf is None:
        return (), found
    header, data = mesh.scene.gltf.header, mesh.scene.gltf
    nodes = objects(header, "nodes")
    of_skins = [[nodes[joint].get("name", "") for joint in skin["joints"]] for skin in objects(header, "skins")]
    names = tuple(dict.fromkeys(name for of_skin in of_skins for name in of_skin))
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
        strongest = np.take_along_axis(joints, weights.argmax(axis=1)[:, None], axis=1)[:, 0].astype(np.int64)
        numbers = np.array([names.index(name) for name in of_skins[nodes[node]["skin"]]])
        vertices = mesh.scene.vertex[part.rows]
        found[vertices[vertices >= 0]] = numbers[strongest[vertices >= 0]]
    return names, found


def label_vertices(
    names: tuple[str, ...], of_vertex: Int64, kind: Callable[[str], str | None], fewest: int = 1
) -> tuple[Int64, tuple[str, ...]]:
    """Return the index of each vertex's part (V,), and the parts of at least `fewest` vertices.

    `names` (J,) and `of_vertex` (V,) are those of `strongest_joints`; `kind` gives the part of a joint. Vertices of no
    part, such as those of a sword or a cape, have −1.
    """
    kinds = np.array([*map(kind, names), None])  # the last one is that of −1
    of_vertices = kinds[of_vertex]
    counts = Counter(of_vertices.tolist())
    parts = tuple(sorted(part for part, count in counts.items() if part is not None and count >= fewest))
    return np.array([parts.index(part) if part in parts else -1 for part in of_vertices], np.int64), parts


def only(mesh: dfd.Mesh, vertices: Bool) -> tuple[dfd.Mesh, Int64]:
    """Return the faces whose corners are all among `vertices` (V,), with their appearance; and the old indices.

    Raises ValueError if no face is left.
    """
    kept = vertices[mesh.faces].all(axis=1)
    old = np.unique(mesh.faces[kept])
    new = np.full(len(mesh.vertices), -1, np.int32)
    new[old] = np.arange(len(old))
    appearance = mesh.appearance
    if appearance is not None:
        used = np.isin(np.arange(len(appearance.corners)), appearance.corner_faces[kept])
        appearance = replace(
            appearance,
            corners=np.where(used, new[appearance.corners], -1).astype(np.int32),
            corner_faces=appearance.corner_faces[kept],
            face_material=appearance.face_material[kept],
        )
    return dfd.Mesh(mesh.vertices[old], new[mesh.faces[kept]], appearance=appearance), old
