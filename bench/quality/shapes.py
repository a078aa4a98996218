"""Provide shapes with labelled parts: samples of dfd, and rigs whose joints name the parts."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import dfd
from bench.quality.parts import KINDS, MERGED, kind_of_part
from dfd.common.linear_algebra import Bool, Int64
from dfd.mesh.file.gltf.header import objects

FEWEST = 20  # smallest number of vertices of a part; smaller parts get no label
SAMPLES = {make.__name__: make for make in (dfd.samples.chair, dfd.samples.quadruped, dfd.samples.robot)}
UNREADABLE = (ValueError, OSError, KeyError, IndexError, TypeError)  # errors that files with a broken skin raise


@dataclass(frozen=True, eq=False)
class Shape:
    """A mesh, with the part of each vertex if the parts are known."""

    name: str
    mesh: dfd.Mesh
    labels: NDArray[np.integer] | None = None  # (V,) index of each vertex's part in `parts`, −1 for none
    parts: tuple[str, ...] = ()


def made(faces: int) -> list[Shape]:
    """Return the labelled samples of dfd, with about `faces` faces each."""
    samples = {name: make(faces) for name, make in SAMPLES.items()}
    return [Shape(name, sample.mesh, sample.labels, sample.parts) for name, sample in samples.items()]


def characters(folder: Path) -> Iterator[Shape]:
    """Yield the shape of each skinned GLB in `folder`, whole and without accessories, with the parts of `MERGED`."""
    for name, whole, names, joints in _skinned(folder):
        if (joints < 0).all():
            continue
        labels, parts = label_vertices(names, joints, MERGED)
        yield Shape(f"{name}, merged names", whole, labels, parts)
        bare, old = submesh(whole, joints >= 0)
        if len(old) < len(whole.vertices):
            yield Shape(f"{name} without accessories, merged names", bare, labels[old], parts)


def rigs(folder: Path) -> Iterator[Shape]:
    """Yield the shape of every skinned GLB in `folder`, with the parts of `KINDS`.

    If a file has fewer than two kinds of parts, print its name and skip it.
    """
    for name, mesh, names, joints in _skinned(folder):
        labels, parts = label_vertices(names, joints, KINDS, FEWEST)
        if len(parts) > 1:
            yield Shape(name, mesh, labels, parts)
        else:
            print(f"{name}: fewer than two kinds of parts, got {', '.join(parts) or 'none'}")


def _skinned(folder: Path) -> Iterator[tuple[str, dfd.Mesh, tuple[str, ...], Int64]]:
    """Yield every GLB in `folder`: its stem, its mesh in the bind pose, and the results of `strongest_joints`.

    If a file cannot be read, print the error and skip the file.
    """
    for path in sorted(folder.glob("*.glb")):
        try:
            mesh = dfd.load(path, pose="bind")
            found = strongest_joints(mesh)
        except UNREADABLE as error:
            print(f"{path.name}: {error}")
        else:
            yield path.stem, mesh, *found


def strongest_joints(mesh: dfd.Mesh) -> tuple[tuple[str, ...], Int64]:
    """Return the distinct names (J,) of a glTF file's joints, and the index (V,) of each vertex's strongest joint.

    Vertices without a skin have the joint −1. Raises ValueError if the joints or weights of a skin cannot be read.
    """
    data, found = mesh.scene.gltf, np.full(len(mesh.vertices), -1)
    header, nodes = data.header, objects(data.header, "nodes")
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
    names: tuple[str, ...], of_vertex: Int64, patterns: Sequence[tuple[str, str]], fewest: int = 1
) -> tuple[Int64, tuple[str, ...]]:
    """Return the index (V,) of each vertex's part, and the parts of `patterns` that have at least `fewest` vertices.

    `names` (J,) and `of_vertex` (V,) are the results of `strongest_joints`. Vertices of no part, such as those of a
    sword or a cape, have −1.
    """
    kinds = np.array([*(kind_of_part(name, patterns) for name in names), None])[of_vertex]  # −1 selects the last: None
    parts = tuple(sorted(part for part, count in Counter(kinds).items() if part is not None and count >= fewest))
    return np.array([parts.index(part) if part in parts else -1 for part in kinds], np.int64), parts


def submesh(mesh: dfd.Mesh, vertices: Bool) -> tuple[dfd.Mesh, Int64]:
    """Return the mesh of the faces with all corners in the mask `vertices` (V,), and its vertices' old indices (W,).

    Raises ValueError if no face is left.
    """
    kept = vertices[mesh.faces].all(axis=1)
    old, faces = np.unique(mesh.faces[kept], return_inverse=True)
    appearance = mesh.appearance
    if appearance is not None:
        used = np.isin(np.arange(len(appearance.corners)), appearance.corner_faces[kept])
        appearance = replace(
            appearance,
            corners=np.where(used, np.searchsorted(old, appearance.corners), -1).astype(np.int32),
            corner_faces=appearance.corner_faces[kept],
            face_material=appearance.face_material[kept],
        )
    return dfd.Mesh(mesh.vertices[old], faces.reshape(-1, 3), appearance=appearance), old
