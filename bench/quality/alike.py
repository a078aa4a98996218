"""Compare the part at a place, with all its counterparts, with the segments that a person would call alike.

A place is drawn as in `bench.quality.people`. The set that the person means is the segment at the place, with all other
segments of the same person that have the same label and a similar area. Labels are those of the labelled benchmark
(`N_labels.txt`), so `N_people.npz` alone is not enough. The label of a segment is the one with the largest area in it.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.sparse import csr_array

import dfd
from bench.quality.labelled import face_labels
from bench.quality.people import SMALL, PeopleShape, Place, closed_segment, neighbors, people_shapes, places, waves
from dfd.common.linear_algebra import Bool, Float32, Float64, Int64
from dfd.geometry.topology import face_areas
from dfd.segmentation.parts import Parts
from dfd.symmetry.search import symmetry_planes

SIMILAR_AREA = 2.5  # segments are alike up to this ratio of their areas
OURS = ("set", "follows", "right", "alone", "component")
LEGEND = {
    "set": "mean IoU of the whole part at level 0, with its counterparts, and the person's set",
    "person's set": "the same for the sets of the other people at this place",
    "follows": "fraction of the area of the set's other segments that follows",
    "right": "fraction of the area that follows beyond the component, in segments of the same label",
    "alone": "fraction of the moved area that is the component, at places whose segment has no others",
    "component": "mean IoU of the component at the place and the segment",
    "small: …": f"the same numbers for segments with less than {SMALL:.0%} of the surface",
    "others: …": "the same numbers for places whose segment has others",
    "random: …": "the same numbers for features that are cosines of the position, with the field's mirror planes",
    "random, no planes: …": "the same without mirror planes",
}


@dataclass(frozen=True, eq=False)
class AlikeShape(PeopleShape):
    """A mesh with the segments that people drew, and labels."""

    of_face: Int64 | None = None  # (F,) the label of each face


def alike_shapes(folder: Path, *, quick: bool = False) -> Iterator[AlikeShape]:
    """Yield every mesh of `folder` with segments and labels. The labels `finger1`, `finger2`, … are one label.

    Raises ValueError if `folder` has no such mesh.
    """
    for shape in people_shapes(folder, quick=quick):
        path = folder / shape.category / f"{shape.name.split()[-1]}_labels.txt"
        names, of_face = face_labels(path, len(shape.mesh.faces))
        kinds = [re.sub(r"\d+$", "", name) for name in names]
        merged = np.array([kinds.index(kind) for kind in kinds])[of_face]
        yield AlikeShape(shape.name, shape.mesh, category=shape.category, segments=shape.segments, of_face=merged)


@dataclass(frozen=True, eq=False)
class Meant:
    """The set that a person means at a place."""

    place: Place
    flat: Bool  # (F,) the segments of the set
    closed: Bool  # (F,) each with everything that it cuts off from the largest rest
    others: Bool  # (F,) the segments of the set without the one at the place
    label: Bool  # (F,) all segments with the label of the one at the place
    people: float  # mean IoU of the sets that the other people mean at this place

    def iou(self, areas: Float64, inside: Bool) -> float:
        """Return the IoU of the faces `inside` (F,) with the set, flat or closed, whichever is larger."""
        return max(float(areas[inside & one].sum() / areas[inside | one].sum()) for one in (self.flat, self.closed))


def meant(shape: AlikeShape, areas: Float64) -> Iterator[Meant]:
    """Yield the sets that people mean at the places of `bench.quality.people`."""
    assert shape.segments is not None
    assert shape.of_face is not None
    beside = neighbors(shape.mesh)
    for place in places(shape, areas):
        sets = [_set_at(person, shape.of_face, areas, beside, place.face) for person in shape.segments]
        own = sets[place.person]
        others = [own.iou(areas, each.flat) for i, each in enumerate(sets) if i != place.person]
        yield replace(own, place=place, people=float(np.mean(others)))


def _set_at(segment: Int64, of_face: Int64, areas: Float64, beside: csr_array, face: int) -> Meant:
    """Return the set that the person with the segments `segment` (F,) means at a face."""
    count = int(segment.max()) + 1
    by_label = np.zeros((count, int(of_face.max()) + 1))
    np.add.at(by_label, (segment, of_face), areas)
    label, size, here = by_label.argmax(axis=1), by_label.sum(axis=1), int(segment[face])
    alike = (label == label[here]) & (size >= size[here] / SIMILAR_AREA) & (size <= size[here] * SIMILAR_AREA)
    numbers = np.flatnonzero(alike & (size > 0))
    flat = np.isin(segment, numbers)
    closed = np.any([closed_segment(segment == number, areas, beside) for number in numbers], axis=0)
    same_label = np.isin(segment, np.flatnonzero(label == label[here]))
    nowhere = Place(face, flat, closed, 0.0)
    return Meant(nowhere, flat, closed, flat & (segment != here), same_label, 0.0)


def judged(shape: AlikeShape, field: dfd.Field) -> dict[str, float]:
    """Return the numbers that `LEGEND` explains."""
    mesh = shape.mesh
    areas = face_areas(mesh.vertices, mesh.faces)
    sets = list(meant(shape, areas))
    planes = symmetry_planes(mesh, field)
    rows = _numbers(Parts(mesh, field.on(mesh).rows, lambda: planes), mesh, areas, sets)
    rows["person's set"] = np.array([each.people for each in sets])
    rows = {name: rows[name] for name in LEGEND if name in rows}
    small = np.array([areas[each.place.flat].sum() / areas.sum() for each in sets]) < SMALL
    others = np.array([each.others.any() for each in sets])
    numbers = {name: _mean(row) for name, row in rows.items()}
    for word, some in (("small", small), ("others", others)):
        numbers |= {f"{word}: {name}": _mean(row[some]) for name, row in rows.items()}
    random: Callable[[Int64], Float32] = waves(mesh)
    for word, parts in (("random", Parts(mesh, random, lambda: planes)), ("random, no planes", Parts(mesh, random))):
        numbers |= {f"{word}: {name}": _mean(row) for name, row in _numbers(parts, mesh, areas, sets).items()}
    return numbers


def _numbers(parts: Parts, mesh: dfd.Mesh, areas: Float64, sets: list[Meant]) -> dict[str, Float64]:
    """Return the numbers `OURS` (N,) of each of N places. NaN stands for a number that a place does not have."""
    found = np.full((len(OURS), len(sets)), np.nan)
    for column, each in zip(found.T, sets, strict=True):
        vertex = int(mesh.faces[each.place.face, 0])
        whole, one = (_faces(mesh, parts.part(vertex, follow=follow).mask) for follow in ("all", "none"))
        beyond = whole & ~one
        column[0], column[4] = each.iou(areas, whole), each.place.iou(areas, one)
        if each.others.any():
            column[1] = areas[whole & each.others].sum() / areas[each.others].sum()
        elif whole.any():
            column[3] = areas[whole & one].sum() / areas[whole].sum()
        if beyond.any():
            column[2] = areas[beyond & each.label].sum() / areas[beyond].sum()
    return dict(zip(OURS, found, strict=True))


def _faces(mesh: dfd.Mesh, mask: Bool) -> Bool:
    return np.asarray(mask[mesh.faces].sum(axis=1) >= 2)


def _mean(values: Float64) -> float:
    return float(np.nanmean(values)) if np.isfinite(values).any() else np.nan
