"""Compare the weights and parts of handles with parts that people labelled.

A folder for each category has files `N.off` and `N_labels.txt`. A file of labels has two lines for each part: its name,
and the indices of its faces, from 1. Source: Kalogerakis et al., "Learning 3D Mesh Segmentation and Labeling", 2010.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import dfd
from bench.quality import measures
from bench.quality.shapes import Shape, made
from dfd.common.linear_algebra import Int64
from dfd.geometry.topology import face_areas
from dfd.segmentation.parts import Parts
from dfd.symmetry.search import symmetry_planes

EACH = 4  # largest number of handles for each label
FEW_FACES, FACES = 4_000, 20_000  # number of faces of a sample in a quick and in a full run
LEGEND = {
    "precision": "average precision with which a ranking of vertices by weight or distance finds the handle's label",
    "part": "IoU between the labelled part and the part, with its counterparts, that dfd finds at the handle",
    "grip": "soft IoU Σ min(w, t) / Σ max(w, t) of the handle's weights w; t is 1 on the labelled part and 0 elsewhere",
    "paper's grip": 'the same number as grip, but for a session with the preset "paper"',
}


@dataclass(frozen=True, eq=False)
class LabelledShape(Shape):
    """A mesh with labelled parts. A vertex has the label with the largest area among its faces."""

    category: str = ""  # such as "Ant"


def judged(shape: LabelledShape, field: dfd.Field) -> dict[str, float]:
    """Return the numbers of the table: means over the handles of each label, then over the labels."""
    mesh, labels = shape.mesh, shape.labels
    features, areas = field.features(mesh), measures.area_fractions(mesh)
    handles = measures.draw_handles(labels, EACH)
    truths = labels == labels[handles, None]  # (H, V)
    apart = np.linalg.norm(mesh.vertices[:, None] - mesh.vertices[handles], axis=2)
    rankings = {
        "precision": dfd.bind(features, handles),
        "Euclidean precision": 1 - apart / np.maximum(apart.max(axis=0), 1e-300),
        "geodesic precision": 1 - dfd.Geodesics(mesh).distances(handles).T,
    }
    found = {name: measures.handle_precision(each, labels, handles) for name, each in rankings.items()}
    parts = Parts(mesh, field.on(mesh).rows, lambda: symmetry_planes(mesh, field))
    moved = {"part": [parts.part(handle).mask for handle in handles.tolist()]}
    sessions = {"grip": measures.session_of(mesh, field), "paper's grip": dfd.Deformer(mesh, field, preset="paper")}
    moved |= {name: measures.weights_of_each(session, handles) for name, session in sessions.items()}
    for name, masks in moved.items():
        found[name] = [measures.soft_iou(areas, *each) for each in zip(masks, truths, strict=True)]
    return {name: measures.mean_over_labels(labels[handles], values) for name, values in found.items()}


def labelled_shapes(folder: Path | None, *, quick: bool = False) -> Iterator[LabelledShape]:
    """Yield every labelled mesh of `folder`, or the samples of dfd if `folder` is None.

    `quick` reads one mesh of each category, and makes samples with fewer faces.

    Raises ValueError if `folder` has no labelled mesh, or if a file has another layout.
    """
    if folder is None:
        for shape in made(FEW_FACES if quick else FACES):
            yield LabelledShape(shape.name, shape.mesh, shape.labels, shape.parts, shape.name)
        return
    categories = sorted(path for path in folder.iterdir() if any(path.glob("*_labels.txt")))
    if not categories:
        raise ValueError(f"labelled: there is no CATEGORY/N_labels.txt in {folder}")
    for category in categories:
        paths = sorted(category.glob("*.off"), key=lambda path: (len(path.stem), path.stem))
        for path in [paths[len(paths) // 2]] if quick else paths:
            yield _read(path)


def _read(path: Path) -> LabelledShape:
    mesh = dfd.load(path)
    names, of_face = face_labels(path.with_name(f"{path.stem}_labels.txt"), len(mesh.faces))
    votes = np.zeros((len(mesh.vertices), len(names)))
    areas = face_areas(mesh.vertices, mesh.faces)
    np.add.at(votes, (mesh.faces.T, of_face), areas)
    category = path.parent.name
    return LabelledShape(f"{category} {path.stem}", mesh, votes.argmax(axis=1), names, category)


def face_labels(path: Path, count: int) -> tuple[tuple[str, ...], Int64]:
    """Return the names of the parts, and the index (F,) of each face's part."""
    lines = [line.strip() for line in path.read_text("utf-8").splitlines() if line.strip()]
    labels = np.full(count, -1)
    for number, faces in enumerate(lines[1::2]):
        chosen = np.array(faces.split(), np.int64) - 1
        if chosen.min() < 0 or chosen.max() >= count:
            raise ValueError(f"labelled: {path} names a face that the mesh does not have")
        labels[chosen] = number
    if len(lines) % 2 or (labels < 0).any():
        raise ValueError(f"labelled: {path} leaves faces without a name")
    return tuple(lines[::2]), labels
