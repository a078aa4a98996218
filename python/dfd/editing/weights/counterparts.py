"""Find the counterparts of a handle: the components of the part at the handle, each with its own pivot and frame.

If all legs rotated about the handle's pivot, the distant legs would move along wide arcs. So each leg rotates about its
own pivot, which corresponds to the handle's pivot. If two legs are mirror images, their motions are mirror images too.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dfd.common.linear_algebra import Bool, Float32, Float64, Int64
from dfd.editing.weights.fill import Counterpart
from dfd.geometry.coarse import nodes_of
from dfd.geometry.part_axis import ROUND
from dfd.mesh.mesh import Mesh
from dfd.symmetry.fit import SurfaceSamples, samples_of
from dfd.symmetry.pair import isometry
from dfd.symmetry.plane import SymmetryPlane

# The vertex at the mirror image of a handle corresponds to the handle if its weight is at most this much below the
# largest weight of the component.
IMAGE_TOLERANCE = 0.05


def find_counterparts(
    mesh: Mesh,
    component: Int64,
    vertex: int,
    position: Sequence[float],
    similar: Float32,
    planes: Sequence[SymmetryPlane],
) -> list[tuple[int, Counterpart]]:
    """Find the counterparts of a handle at `position` (3,), in mesh units. `vertex` is the vertex nearest to it.

    `component` (N,) is the component of the part that contains each mesh node; the handle lies on component 0. Return
    the number and the counterpart of each component, by decreasing similarity. `similar` and `planes` are as in `hold`.
    """
    x, y, z = (float(value) for value in position)
    found = [Counterpart(vertex, (x, y, z), np.eye(3))]
    nodes, weights = nodes_of(mesh), similar
    on_nodes = np.maximum.reduceat(weights[nodes.members], nodes.starts)
    best = np.full(component.max() + 2, -np.inf)  # the last entry is for nodes outside the part
    np.maximum.at(best, component, on_nodes)
    best[[0, -1]] = -np.inf
    others = np.argsort(-best, kind="stable")[: int(np.isfinite(best).sum())].tolist()
    surfaces = _surfaces(mesh, component[nodes.of_vertex], [0, *others])
    for index, number in enumerate(others, 1):
        image = _image(surfaces[index], surfaces, found, planes)
        if image is not None:
            x, y, z = (image[:, :3] @ np.asarray(position, np.float64) + image[:, 3]).tolist()
            peak, frame = int(nodes.nearest((x, y, z), component == number)[0]), image[:, :3]
        else:
            most = int(np.where(component == number, on_nodes, -np.inf).argmax())
            members = nodes.members[nodes.starts[most] : nodes.ends[most]]
            peak = int(members[weights[members].argmax()])
            peak, frame = _corresponding(mesh, component == number, weights, peak, found, planes)
            x, y, z = mesh.vertices[peak].tolist()
            one, other = surfaces[0], surfaces[index]
            if one is not None and other is not None and _is_round(one) and _is_round(other):
                # The centers correspond. So a round component, such as a wheel, turns about its own center.
                offset = np.asarray(position, np.float64) - one.points.mean(axis=0)
                x, y, z = (other.points.mean(axis=0) + frame @ offset).tolist()
        found.append(Counterpart(peak, (x, y, z), frame, image))
    return list(zip([0, *others], found, strict=True))


def _surfaces(mesh: Mesh, component: Int64, chosen: Sequence[int]) -> list[SurfaceSamples | None]:
    """Return samples of the surface of each component in `chosen`. `component` (V,) is the component of each vertex."""
    of_corner = component[mesh.faces]
    of_face = np.where((of_corner == of_corner[:, :1]).all(axis=1), of_corner[:, 0], -1)
    return [samples_of(mesh.vertices, mesh.faces[of_face == number]) for number in chosen]


def _image(
    surface: SurfaceSamples | None,
    surfaces: Sequence[SurfaceSamples | None],
    found: Sequence[Counterpart],
    planes: Sequence[SymmetryPlane],
) -> Float64 | None:
    """Return the isometry (3, 4) from the handle's component to `surface`; None if no isometry was found.

    The planes of the whole shape are tried first, then a plane fitted to two components, and a translation. `surface`
    can also be the image of another image in `found`: of those without a plane of the shape, the nearest is tried
    first. The first items of `surfaces` are the surfaces of `found`.
    """
    if surface is None:
        return None
    middle = surface.points.mean(axis=0)
    known = [(one, its) for one, its in zip(found, surfaces, strict=False) if its is not None]
    near = sorted(known, key=lambda each: float(np.linalg.norm(each[1].points.mean(axis=0) - middle)))
    for tried, pairs in ((planes, known), (None, near)):
        for earlier, its_surface in pairs:
            to_earlier = np.eye(3, 4) if earlier is found[0] else earlier.image
            if to_earlier is None:
                continue
            step = isometry(its_surface, surface, tried)
            # Across a plane of the shape, motions are mirrored also if a translation fits, as with wheels.
            if step is not None and not (np.linalg.det(step[:, :3]) > 0 and _apart(planes, middle, its_surface)):
                return np.column_stack([step[:, :3] @ to_earlier[:, :3], step[:, :3] @ to_earlier[:, 3] + step[:, 3]])
    return None


def _apart(planes: Sequence[SymmetryPlane], middle: Float64, other: SurfaceSamples) -> bool:
    """Return whether one of `planes` lies between the place `middle` (3,) and the middle of a surface."""
    sides = (plane.signed_distance([middle, other.points.mean(axis=0)]) for plane in planes)
    return any(one * another < 0 for one, another in sides)


def _is_round(surface: SurfaceSamples) -> bool:
    """Return whether a component is a disk or a ball: its two largest principal variances are about equal."""
    values = np.linalg.eigvalsh(np.cov(surface.points.T))
    return bool(values[1] > ROUND * values[2])


def _corresponding(
    mesh: Mesh,
    inside: Bool,
    weights: NDArray[np.floating],
    peak: int,
    found: Sequence[Counterpart],
    planes: Sequence[SymmetryPlane],
) -> tuple[int, Float64]:
    """Return the vertex of a component that corresponds to the handle, and its frame (3, 3).

    `inside` (N,) is True for the component's mesh nodes. `peak` is the component's vertex with the highest weight. The
    result is the vertex at the mirror image of a counterpart in `found`, if this vertex has nearly the weight of
    `peak`. Otherwise, it is `peak`, with a frame that is reflected in each plane between `peak` and the handle.
    """
    nodes = nodes_of(mesh)
    for plane in planes:
        images = plane.reflect([other.position for other in found])
        for other, nearest in zip(found, nodes.nearest(images).tolist(), strict=True):
            if inside[nodes.of_vertex[nearest]] and weights[nearest] >= weights[peak] - IMAGE_TOLERANCE:
                return nearest, plane.reflection[:3, :3] @ other.frame
    frame = np.eye(3)
    for plane in planes:
        ours, theirs = plane.signed_distance([found[0].position, mesh.vertices[peak]])
        if ours * theirs < 0:
            frame = plane.reflection[:3, :3] @ frame
    return peak, frame
