"""Compare the part at a place with the parts that people drew there.

Beside each mesh `N.off` lies `N_people.npz` with the array `segment` (people, faces): the segment of each face by each
person. Source: Chen, Golovinskiy and Funkhouser, "A benchmark for 3D mesh segmentation", 2009.

A place is drawn as a person grabs a part: a random person, a random segment of theirs, a random place in it by area.
The component of the part at this place is compared with the segment by the IoU of their areas. The segment counts flat,
or with everything that it cuts off from the largest rest of the surface, whichever is nearer.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

import dfd
from bench.quality.shapes import Shape
from dfd.common.linear_algebra import Bool, Float32, Float64, Int64
from dfd.geometry.topology import face_areas, face_sides
from dfd.segmentation.parts import Parts
from dfd.symmetry.search import symmetry_planes

PLACES = 24  # number of places on each mesh
SMALL = 0.05  # a place is small if the area of the person's segment is below this share of the surface
STEPS = 2  # a user may choose among the levels from −STEPS to STEPS
WAVES = 16  # number of random features
LEGEND = {
    "level 0": "mean IoU of the part at level 0 and the person's segment",
    "best of ±1": "the same for the best of the levels -1 to 1",
    "best of ±2": "the same for the best of the levels -2 to 2",
    "another person": "the same for the segments of the other people at this place, as a mean over these people",
    "at least 0.7": "fraction of places where level 0 has an IoU of at least 0.7",
    "random features": "level 0 for features that are cosines of the position, without any encoder",
    "Rand": "1 − Rand index of the whole cut, with instances, and a person's: the fraction of pairs of faces that are"
    " in one part of the one, and in two parts of the other",
    "people: Rand": "the same distance among the people",
    "small: …": f"the same numbers for segments with less than {SMALL:.0%} of the surface",
}


@dataclass(frozen=True, eq=False)
class PeopleShape(Shape):
    """A mesh with the segments that people drew."""

    category: str = ""
    segments: Int64 | None = None  # (people, F) the segment of each face by each person


def people_shapes(folder: Path, *, quick: bool = False) -> Iterator[PeopleShape]:
    """Yield every mesh of `folder` with segments; `quick` reads one mesh of each category.

    Raises ValueError if `folder` has no such mesh.
    """
    paths = sorted(folder.glob("*/*_people.npz"))
    if not paths:
        raise ValueError(f"people: there is no CATEGORY/N_people.npz in {folder}")
    taken: set[str] = set()
    for path in paths:
        category = path.parent.name
        if not (quick and category in taken):
            taken.add(category)
            number = path.name.removesuffix("_people.npz")
            with np.load(path) as arrays:
                segments = arrays["segment"].astype(np.int64)
            mesh = dfd.load(path.with_name(f"{number}.off"))
            yield PeopleShape(f"{category} {number}", mesh, category=category, segments=segments)


@dataclass(frozen=True, eq=False)
class Place:
    """A place that a person grabs."""

    face: int
    flat: Bool  # (F,) the person's segment
    closed: Bool  # (F,) the segment with everything that it cuts off from the largest rest
    others: float  # mean IoU of the other people's segments at this place
    person: int = 0  # index of the person

    def iou(self, areas: Float64, inside: Bool) -> float:
        """Return the IoU of the faces `inside` (F,) with the segment, flat or closed, whichever is larger."""
        return max(
            float(areas[inside & meant].sum() / areas[inside | meant].sum()) for meant in (self.flat, self.closed)
        )


def judged(shape: PeopleShape, field: dfd.Field) -> dict[str, float]:
    """Return the numbers that `LEGEND` explains."""
    mesh = shape.mesh
    areas = face_areas(mesh.vertices, mesh.faces)
    drawn = list(places(shape, areas))
    planes = symmetry_planes(mesh, field)
    parts = Parts(mesh, field.on(mesh).rows, lambda: planes)
    found = _levels(parts, mesh, areas, drawn)
    random = _levels(Parts(mesh, waves(mesh), lambda: planes), mesh, areas, drawn, steps=0)[:, 0]
    small = np.array([areas[place.flat].sum() / areas.sum() for place in drawn]) < SMALL
    rows = {
        "level 0": found[:, STEPS],
        "best of ±1": found[:, STEPS - 1 : STEPS + 2].max(axis=1),
        "best of ±2": found.max(axis=1),
        "another person": np.array([place.others for place in drawn]),
        "at least 0.7": (found[:, STEPS] >= 0.7).astype(np.float64),
        "random features": random,
    }
    numbers = {name: float(row.mean()) for name, row in rows.items()} | _whole(shape, parts)
    return numbers | {
        f"small: {name}": float(row[small].mean()) if small.any() else np.nan for name, row in rows.items()
    }


def _whole(shape: PeopleShape, parts: Parts) -> dict[str, float]:
    """Return the mean distance of the whole cut from the people's, and the mean distance between two people."""
    assert shape.segments is not None
    own, people = parts.face_labels(parts.cut(instances=True)), list(shape.segments)
    among = [rand_distance(one, other) for one, other in combinations(people, 2)]
    ours = [rand_distance(own, each) for each in people]
    return {"Rand": float(np.mean(ours)), "people: Rand": float(np.mean(among)) if among else np.nan}


def rand_distance(one: Int64, other: Int64) -> float:
    """Return the fraction of pairs of N faces on which two labelings (N,) disagree, whether both are in one part."""
    both = np.unique(np.stack([one, other]), axis=1, return_counts=True)[1].astype(np.float64)
    alone = [np.unique(each, return_counts=True)[1].astype(np.float64) for each in (one, other)]
    differ = sum(float((counts**2).sum()) for counts in alone) - 2 * float((both**2).sum())
    return differ / (len(one) * (len(one) - 1)) if len(one) > 1 else 0.0


def _levels(parts: Parts, mesh: dfd.Mesh, areas: Float64, places: list[Place], steps: int = STEPS) -> Float64:
    """Return the IoU (N, 2 · `steps` + 1) of each of N places at the levels from −`steps` to `steps`."""
    found = np.empty((len(places), 2 * steps + 1))
    for row, place in zip(found, places, strict=True):
        vertex = int(mesh.faces[place.face, 0])
        low, high = parts.levels(vertex)
        for column, level in enumerate(range(-steps, steps + 1)):
            mask = parts.part(vertex, min(max(level, low), high), follow="none").mask
            row[column] = place.iou(areas, mask[mesh.faces].sum(axis=1) >= 2)
    return found


def places(shape: PeopleShape, areas: Float64) -> Iterator[Place]:
    """Yield `PLACES` random places of a shape."""
    assert shape.segments is not None
    generator, people = np.random.default_rng(0), shape.segments
    beside = neighbors(shape.mesh)
    for _ in range(PLACES):
        person = int(generator.integers(len(people)))
        own = people[person]
        flat = own == generator.choice(np.unique(own))
        face = int(generator.choice(np.flatnonzero(flat), p=areas[flat] / areas[flat].sum()))
        place = Place(face, flat, closed_segment(flat, areas, beside), 0.0, person)
        others = [place.iou(areas, each == each[face]) for i, each in enumerate(people) if i != person]
        yield replace(place, others=float(np.mean(others)))


def neighbors(mesh: dfd.Mesh) -> csr_array:
    """Return which faces share an edge, as a sparse matrix (F, F)."""
    sides = np.sort(face_sides(mesh.faces), axis=1)
    order = np.lexsort(sides.T)
    same = (np.diff(sides[order], axis=0) == 0).all(axis=1)
    one, other = order[:-1][same] // 3, order[1:][same] // 3
    return csr_array((np.ones(len(one)), (one, other)), shape=(len(mesh.faces),) * 2)


def closed_segment(flat: Bool, areas: Float64, beside: csr_array) -> Bool:
    """Return `flat` (F,) with all components of the rest but the largest."""
    out = np.flatnonzero(~flat)
    if len(out) == 0:
        return flat
    component = connected_components(beside[out][:, out], directed=False)[1]
    result = flat.copy()
    result[out[component != np.bincount(component, areas[out]).argmax()]] = True
    return result


def waves(mesh: dfd.Mesh) -> Callable[[Int64], Float32]:
    """Return random features of vertices: cosines of their positions, with about three waves along the shape."""
    generator = np.random.default_rng(0)
    waves, phases = generator.normal(size=(3, WAVES)), generator.uniform(0, 2 * np.pi, WAVES)
    rows = np.cos(2 * np.pi * 3 / mesh.diagonal * (mesh.vertices @ waves) + phases)
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    return lambda vertices: rows[vertices].astype(np.float32)
