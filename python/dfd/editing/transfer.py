"""Find corresponding places on another shape of the same class, such as chairs, and transfer edits to them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from dfd.common.described import about
from dfd.common.errors import ArgumentError, public
from dfd.common.linear_algebra import Float32, Float64, Int64, unit
from dfd.common.read_only import ReadOnlyArrays
from dfd.editing.agreement import between, log_odds
from dfd.editing.controls import Controls
from dfd.editing.edit import Edit, Handle
from dfd.editing.key_pose import KeyPose
from dfd.editing.points import Place, place_on
from dfd.editing.regions import HalfSpace, Region, VertexSet
from dfd.field.field import Field
from dfd.geometry.coarse import nodes_of
from dfd.geometry.topology import face_areas, sample_surface
from dfd.mesh.mesh import Mesh, MeshLike, as_mesh
from dfd.posing.transforms import Transform, Vector, vector
from dfd.segmentation.parts import Parts
from dfd.symmetry.plane import SymmetryPlane

# A handle moves to one of several candidates: vertices whose feature distance exceeds the smallest one by at most this
# number. The candidate at the most similar position is chosen, because left and right legs have nearly equal features.
CANDIDATE_MARGIN = 0.1
# With the parts of both shapes, a handle that holds a part has up to MOST_PLACES candidates: vertices whose feature
# distance exceeds the smallest one by at most PLACE_MARGIN, and which are SPACING · diagonal apart. Of the parts of all
# levels at the usual place, and of the handle's level at the others, the one with the largest log-odds of
# `dfd.editing.agreement` is chosen. Of 195 handles on 20 pairs of labelled shapes, 117 are then accepted and right (the
# IoU with the same label is at least 0.5), and 22 accepted and wrong. Without parts, the numbers are 94 and 13. On six
# of the pairs, the numbers with one place are 47 and 8, with four 51 and 8 (all with earlier, less strict constants).
MOST_PLACES, PLACE_MARGIN, SPACING = 4, 0.2, 0.06
MOST_POSITIONS = 2048  # largest number of transferred vertices of a vertex set; they are evenly spaced in the set
SAMPLE = 4096  # number of surface samples from which the mean feature of a shape is computed
# The settings in which two fields must agree. Otherwise, their features cannot be compared.
OF_FEATURES = ("encoder_family", "encoder_weights", "encoder_block", "metric_hash")
TOO_SHORT = 1e-4  # features within this distance of the mean feature count as equal to it; their similarities are 0
MOST_VERTICES = 16_384  # largest number of vertices of the other shape that are compared; they are evenly spaced
ROWS = 512  # number of vertices that are compared together, which limits the memory
FAR = 0.25  # length of a way there and back, as a fraction of the diagonal, from which on the confidence is 0

Scaled = TypeVar("Scaled", bound="Controls | Transform | Region")


@dataclass(frozen=True)
class Transferred:
    """An edit on another shape, and how similar its places are to the places on the first shape.

    A similarity, in [0, 1], is the cosine between two features after the mean feature of each shape is subtracted.
    """

    edit: Edit  # the edit on the other mesh
    similarity: dict[int, float]  # the similarity of each handle, by its id
    fixed_similarity: tuple[float, ...]  # the similarity of each fixed point, in the order of `edit.fixed`


@public
def transfer(
    edit: Edit,
    mesh_from: Mesh,
    field_from: Field,
    mesh_to: Mesh,
    field_to: Field,
    *,
    parts: tuple[Parts, Parts] | None = None,
) -> Transferred:
    """Transfer `edit` from the shape `mesh_from` to the shape `mesh_to`, which should be of the same class.

    A handle moves to the vertex with the most similar feature. Among vertices of nearly equal similarity, it moves to
    the one with the most similar position in the bounding box. The mean feature of each shape is subtracted first,
    because it describes the style of the whole shape. Lengths, such as translations and radii, are multiplied by the
    longest side of the new bounding box divided by that of the old one. Rotations and scales do not change. Balls,
    boxes and half spaces are scaled and translated like the bounding box. At most 2,048 vertices of a vertex set are
    transferred, one by one. Parts and groups keep their names.

    With the `parts` of both shapes, a handle that holds a part goes to the similar place, and gets the level, at which
    the part is most like the first one: in its share of the surface, and in the place of its center.

    Raises ValueError if the fields have different encoders, two handles move to the same vertex, or a region contains
    no vertex of `mesh_to`.
    """
    check_fields(field_from, field_to)
    return EditTransfer(mesh_from, field_from, mesh_to, field_to, parts).of(edit)


def check_fields(field_from: Field, field_to: Field) -> None:
    """Raise ValueError if the features of two fields cannot be compared."""
    if field_from.dimension != field_to.dimension:
        raise ArgumentError(
            "field_to",
            f"must have features of width {field_from.dimension} as `field_from` has, "
            f"got {field_to.dimension}: were they distilled with another `encoder` or another `metric`?",
        )
    for key in OF_FEATURES:
        was, found = field_from.settings.get(key), field_to.settings.get(key)
        if was is not None and found is not None and was != found:
            raise ArgumentError("field_to", f"must have the same {key} as `field_from`, {was}, got {found}")


class EditTransfer:
    """Transfer edits from one shape to another; `transfer` explains the rules."""

    def __init__(
        self, mesh_from: Mesh, field_from: Field, mesh: Mesh, field_to: Field, parts: tuple[Parts, Parts] | None = None
    ) -> None:
        self.mesh_from, self.mesh, self.parts = mesh_from, mesh, parts
        self.here, self.there = _Side(mesh_from, field_from), _Side(mesh, field_to)
        self.ratio = float(field_from.scale) / float(field_to.scale)

    def of(self, edit: Edit) -> Transferred:
        """Return `edit` on the other shape, with similarities."""
        handles, similarity = [], {}
        for handle in edit.handles:
            place, similarity[handle.id] = self.place(handle.place)
            level = handle.controls.level
            if self.parts is not None and handle.controls.reach == "part" and handle.place.region is None:
                place, similarity[handle.id], level = self.part(self.parts, handle.place, level)
            found = self.handle(handle, place)
            handles.append(replace(found, controls=replace(found.controls, level=level)))
        fixed = [self.place(one.place) for one in edit.fixed]
        plane = edit.symmetry
        transferred = replace(
            edit,
            handles=tuple(handles),
            fixed=tuple(replace(one, place=place) for one, (place, _) in zip(edit.fixed, fixed, strict=True)),
            symmetry=plane and SymmetryPlane(plane.normal, self.offset(plane), band=self.ratio * plane.band),
            default=edit.default and self.scaled(edit.default, self.point),
            poses=tuple(self.pose(pose, edit, handles) for pose in edit.poses),
        )
        return Transferred(transferred, similarity, tuple(similar for _, similar in fixed))

    def point(self, position: Vector) -> Vector:
        """Return the position in the other shape's box that corresponds to `position`."""
        centers = self.here.field.center, self.there.field.center
        return vector("position", centers[1] + self.ratio * (np.asarray(position) - centers[0]))

    def place(self, place: Place) -> tuple[Place, float]:
        """Return the corresponding place on the other shape, and its similarity."""
        if place.region is None or isinstance(place.region, VertexSet):
            positions = np.array([place.position]) if place.region is None else place.region.positions
            vertices, cosines = self.nearest(positions)
            found: Any = int(vertices[0]) if place.region is None else VertexSet.of(self.mesh, np.unique(vertices))
        else:
            found = place_on(self.mesh, self.region(place.region))
            cosines = (self.here.at([place.position]) * self.there.at([found.position])).sum(axis=1)
        return place_on(self.mesh, found), float(np.clip(cosines, 0.0, 1.0).mean())

    def part(self, parts: tuple[Parts, Parts], place: Place, level: int) -> tuple[Place, float, int]:
        """Return the place and the level at which the other shape has the part that is most like one of this shape.

        Also return the similarity of the place.
        """
        before, after = parts
        at = place.position if place.vertex is None else place.vertex
        own = _surface(self.mesh_from, before, at, level)
        vertices, cosines = self.alternatives(place)
        lowest, highest = after.levels(int(vertices[0]))
        candidates = [(0, other) for other in range(lowest, highest + 1)]
        candidates += [(number, level) for number in range(1, len(vertices))]
        odds = [-np.inf] * len(candidates)
        for i, (number, other) in enumerate(candidates):
            found = _surface(self.mesh, after, int(vertices[number]), other)
            if own is not None and found is not None:
                odds[i] = float(log_odds(between(*own, *found))[0])
        number, other = candidates[int(np.argmax(odds))]
        return (
            place_on(self.mesh, int(vertices[number])),
            float(cosines[number]),
            other if max(odds) > -np.inf else level,
        )

    def alternatives(self, place: Place) -> tuple[Int64, Float64]:
        """Return at most `MOST_PLACES` similar vertices (N,), first that of `nearest`, and their similarities (N,)."""
        (row,), meant = self.here.at([place.position]), self.here.place(place.position)
        cosines = self.there.rows @ row
        apart = np.sqrt(np.maximum(2 - 2 * cosines, 0))
        first = self.nearest(np.array([place.position]))[0]
        chosen = np.searchsorted(self.there.sample, first).tolist()
        places = self.there.places / (self.there.field.scale * self.mesh.diagonal)
        cost = apart + np.linalg.norm(places - meant / (self.there.field.scale * self.mesh.diagonal), axis=1) / 2
        cost[apart > apart.min() + PLACE_MARGIN] = np.inf
        for _ in range(MOST_PLACES - 1):
            cost[np.linalg.norm(places - places[chosen[-1]], axis=1) < SPACING] = np.inf
            if not np.isfinite(cost).any():
                break
            chosen.append(int(cost.argmin()))
        return self.there.sample[chosen], np.clip(cosines[chosen], 0, 1)

    def region(self, region: Region) -> Region:
        """Return the corresponding region of the other shape."""
        if isinstance(region, VertexSet):
            return VertexSet.of(self.mesh, np.unique(self.nearest(region.positions)[0]))
        if isinstance(region, HalfSpace):
            return HalfSpace(region.normal, self.offset(region))
        return self.scaled(region, self.point)

    def beside(self, before: Place, after: Place) -> Callable[[Vector], Vector]:
        """Return a function that maps a position near `before` to one near `after`, and scales the vector between."""

        def moved(position: Vector) -> Vector:
            offset = np.subtract(position, before.position)
            return vector("pivot", np.asarray(after.position) + self.ratio * offset)

        return moved

    def pose(self, pose: KeyPose, edit: Edit, handles: Sequence[Handle]) -> KeyPose:
        """Return `pose` of `edit` for the transferred `handles`."""
        moved = {
            after.id: self.beside(before.place, after.place)
            for before, after in zip(edit.handles, handles, strict=True)
        }
        transforms = {handle: self.scaled(transform, moved[handle]) for handle, transform in pose.transforms.items()}
        return replace(pose, transforms=transforms)

    def handle(self, handle: Handle, place: Place) -> Handle:
        """Return `handle` at `place` on the other shape."""
        moved_pivot = self.beside(handle.place, place)
        mask = handle.controls.mask and self.region(handle.controls.mask)
        # Counterparts that do not move are not transferred, because they are places on the first shape.
        controls = replace(self.scaled(handle.controls, moved_pivot), excluded_counterparts=(), mask=mask)
        return replace(handle, place=place, transform=self.scaled(handle.transform, moved_pivot), controls=controls)

    def scaled(self, value: Scaled, move: Callable[[Vector], Vector]) -> Scaled:
        """Return `value` with its lengths multiplied by `self.ratio`, and its positions mapped by `move`."""
        found: dict[str, Any] = {}
        owner: type = type(value)
        for name, (_, said) in about(owner).items():
            given = getattr(value, name)
            if given is not None and said is not None and said.unit == "length":
                found[name] = (self.ratio * np.asarray(given)).tolist()
            elif given is not None and said is not None and said.unit == "position":
                found[name] = move(given)
        return replace(value, **found)

    def offset(self, plane: SymmetryPlane | HalfSpace) -> float:
        """Return the offset of the plane of the other shape that corresponds to `plane`."""
        on_plane = self.point(vector("normal", plane.offset * np.asarray(plane.normal)))
        return float(np.dot(on_plane, plane.normal))

    def nearest(self, positions: Float64) -> tuple[Int64, Float64]:
        """Return the most similar vertices (N,) and their similarities (N,), for at most `MOST_POSITIONS` positions."""
        chosen = positions[:: -(-len(positions) // MOST_POSITIONS)]
        return self.there.nearest(self.here.at(chosen), self.here.place(chosen))


def _surface(mesh: Mesh, parts: Parts, at: Any, level: int) -> tuple[Float64, Float64] | None:
    """Return the share (1,) of the area and the center (1, 3) of a part with its counterparts; None without a part.

    The center is relative to that of the bounding box, in diagonals.
    """
    component, nodes = parts.components(at, level), nodes_of(mesh)
    if component is None:
        return None
    area = nodes.area * (component >= 0)
    middle = area @ (nodes.center - mesh.bounds.mean(axis=0)) / max(area.sum(), 1e-300)
    return np.array([area.sum() / max(nodes.area.sum(), 1e-300)]), middle[None] / max(mesh.diagonal, 1e-300)


@dataclass(frozen=True, eq=False)
class Correspondence(ReadOnlyArrays):
    """The corresponding vertex of another shape for each vertex, and its confidence."""

    vertices: Int64  # (V,) vertices of the other shape
    #: (V,) in [0, 1]: `similarity`, multiplied by 1 − d / (`FAR` · diagonal), where d is the distance between a vertex
    #: and the vertex that corresponds to its corresponding vertex
    confidence: Float32
    similarity: Float32  # (V,) in [0, 1]: the cosine between both features, each minus the mean of its shape


@public
def correspond(mesh_a: MeshLike, field_a: Field, mesh_b: MeshLike, field_b: Field) -> Correspondence:
    """Return the corresponding vertex of `mesh_b` for each vertex of `mesh_a`, a shape of the same class.

    It is the vertex with the most similar feature. Among vertices of nearly equal similarity, it is the one at the most
    similar position in the bounding box, so that left legs correspond to left legs. Both shapes must therefore stand
    upright and face the same direction. The mean feature of each shape is subtracted first. If a shape has more than
    16,384 vertices, as many of them can be corresponding vertices.

    Raises ValueError if the fields have different encoders or dimensions.

    Parameters
    ----------
    mesh_a, field_a
        The first shape and its feature field.
    mesh_b, field_b
        The other shape and its feature field, which was distilled with the same encoder.

    Returns
    -------
    correspondence
        (V,) `vertices` of `mesh_b`, and their `confidence` and `similarity`, (V,) in [0, 1].
    """
    check_fields(field_a, field_b)
    a, b = _Side(mesh_a, field_a), _Side(mesh_b, field_b)
    there, similarity = b.nearest(a.of_vertices(slice(None)), a.place(a.mesh.vertices))
    used, inverse = np.unique(there, return_inverse=True)
    back = a.nearest(b.of_vertices(used), b.place(b.mesh.vertices[used]))[0][inverse]
    apart = np.linalg.norm(a.mesh.vertices[back] - a.mesh.vertices, axis=1)
    confidence = similarity * np.clip(1 - apart / (FAR * a.mesh.diagonal), 0, 1)
    return Correspondence(there, confidence.astype(np.float32), similarity.astype(np.float32))


class _Side:
    """One of both shapes. Features are compared minus the mean feature of their shape, at unit length."""

    def __init__(self, mesh: MeshLike, field: Field) -> None:
        self.mesh, self.field = as_mesh(mesh), field

    @cached_property
    def mean(self) -> Float64:
        """Return the mean feature (D,) of surface samples; 0 for a mesh without area."""
        if not face_areas(self.mesh.vertices, self.mesh.faces).sum() > 0:
            return np.zeros(self.field.dimension)
        points, _ = sample_surface(self.mesh.vertices, self.mesh.faces, SAMPLE, np.random.default_rng(0))
        return np.asarray(np.asarray(self.field(points), np.float64).mean(axis=0))

    def at(self, points: Any) -> Float32:
        """Return the features (N, D) at `points` (N, 3)."""
        return self._compared(self.field(np.asarray(points)))

    def of_vertices(self, vertices: Any) -> Float32:
        """Return the features (N, D) of `vertices`, an array (N,) or a slice."""
        return self._compared(self.field.on(self.mesh).rows(vertices))

    def _compared(self, rows: Float32) -> Float32:
        return unit(np.asarray(rows, np.float64) - self.mean, least=TOO_SHORT).astype(np.float32)

    def place(self, points: Any) -> Float64:
        """Return the positions (N, 3) of points (N, 3) in the bounding box of the shape."""
        return np.asarray((np.asarray(points) - self.field.center) * self.field.scale, np.float64)

    @cached_property
    def sample(self) -> Int64:
        """Return the vertices (S,) that can correspond to places of the other shape, ascending."""
        step = -(-len(self.mesh.vertices) // MOST_VERTICES)
        return np.unique(self.mesh.representative[::step]).astype(np.int64)

    @cached_property
    def rows(self) -> Float32:
        """Return the features (S, D) of `sample`."""
        return self.of_vertices(self.sample)

    @cached_property
    def places(self) -> Float64:
        """Return the positions (S, 3) of `sample` in the bounding box."""
        return self.place(self.mesh.vertices[self.sample])

    def nearest(self, rows: Float32, meant: Float64) -> tuple[Int64, Float64]:
        """Return the most similar vertices (N,) to the features `rows` (N, D), and the similarities (N,) in [0, 1].

        Among nearly equal ones, they are nearest to the positions `meant` (N, 3) in the bounding box.
        """
        found, similarity = np.empty(len(rows), np.int64), np.empty(len(rows))
        places = self.places.astype(np.float32)
        squares = np.square(places).sum(axis=1)
        for start in range(0, len(rows), ROWS):
            some = slice(start, start + ROWS)
            cosines = rows[some] @ self.rows.T
            apart = np.sqrt(np.maximum(2 - 2 * cosines, 0))
            distances = squares - 2 * meant[some].astype(np.float32) @ places.T
            distances[apart > apart.min(axis=1, keepdims=True) + CANDIDATE_MARGIN] = np.inf
            best = distances.argmin(axis=1)
            found[some] = self.sample[best]
            similarity[some] = np.clip(np.take_along_axis(cosines, best[:, None], axis=1)[:, 0], 0, 1)
        return found, similarity
