"""Check that a field belongs to a mesh: compare bounding boxes and samples of the mesh and of the distilled shape."""

import warnings
from typing import Protocol

import numpy as np

from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float32, Float64
from dfd.mesh.mesh import Mesh

# A mesh is accepted only if the longest side of its bounding box is at most this factor longer or shorter than that of
# the distilled shape. For the same shape in inches and in centimeters, a frequent mistake, the factor is 2.54.
LARGEST_RATIO = 2.0
# A warning is given if a normalized coordinate of the mesh exceeds this. The normalization moves the center of
# the distilled shape's bounding box to 0, and scales the longest side of this box to 2.
WARNED_COORDINATE = 1.5
POINTS = 512  # number of surface samples that a field stores
SAMPLES = 4096  # number of surface samples of a mesh that are compared with the field's points
# A point is far if its nearest sample is farther than the samples' spacing plus this fraction of the shape's diagonal.
FAR = 0.02
# MOST_BEYOND is the largest accepted share of mesh samples that are far from the field's points. MOST_MISSING is the
# largest accepted share of the field's points that are far from the mesh.
MOST_BEYOND, MOST_MISSING = 0.1, 0.6


class KnownShape(Protocol):
    """The data that a `Field` stores about the shape from which it was distilled, in mesh units."""

    center: Float64  # (3,) center of the bounding box
    scale: float  # 2 divided by the longest side of the box
    surface: Float32 | None  # (512, 3) surface samples


def surface_points(mesh: Mesh) -> Float32 | None:
    """Return evenly spaced surface points of `mesh`, (512, 3) in mesh units, or None if no face has an area.

    The points are chosen from 4096 samples, each as far as possible from all points chosen before (Gonzalez 1985).
    """
    samples, _ = _samples(mesh)
    if samples is None:
        return None
    chosen = [0]
    apart = np.full(len(samples), np.inf)
    while len(chosen) < POINTS:
        np.minimum(apart, np.square(samples - samples[chosen[-1]]).sum(axis=1), out=apart)
        chosen.append(int(apart.argmax()))
    return samples[chosen].astype(np.float32)


def check_compatible(field: KnownShape, mesh: Mesh, *, allowed_by: str = "") -> None:
    """Raise ValueError if `field` was distilled from another shape than `mesh`.

    The check accepts other resolutions of the shape, and pieces with at least 40 % of its surface. A field without
    surface samples, such as a `VertexField`, is compared by its bounding box only. The error message names
    `allowed_by`, the public argument that disables this check.

    Raises ValueError if the longest sides of the two bounding boxes differ by more than a factor of 2, or if the whole
    mesh lies outside the smallest cube around the distilled shape. Raises ValueError if more than 10 % of the mesh is
    far from the distilled shape, or more than 60 % of the distilled shape is far from the mesh. Warns if the mesh
    extends beyond the cube by more than a quarter of the cube's side, because features there are extrapolated.
    """
    center, scale = field.center, field.scale
    low, high = (np.asarray(mesh.bounds) - center) * scale  # the distilled shape lies in the cube [-1, 1]³
    ratio = float((high - low).max()) / 2.0
    farthest = float(max(-low.min(), high.max()))
    outside = bool((low > 1).any() or (high < -1).any())
    sizes = (
        f"a shape with a longest side of {2 / scale:.4g} around {_point(center)}, "
        f"and this mesh has a longest side of {np.max(mesh.extents):.4g} around {_point(np.mean(mesh.bounds, axis=0))}"
    )
    remedy = "give the mesh the units, axes and position of that shape, or distill a field from this mesh"
    override = f"; {allowed_by} accepts it anyway" if allowed_by else ""
    if outside or not 1 / LARGEST_RATIO <= ratio <= LARGEST_RATIO:
        reason = f"must belong to this mesh, but it was distilled from {sizes}"
        raise ArgumentError("field", f"{reason}: {remedy}{override}")
    beyond, missing = _differences(field, mesh)
    if beyond > MOST_BEYOND or missing > MOST_MISSING:
        shares = (
            f"{beyond:.0%} of the mesh is far from that shape, and {missing:.0%} of that shape is far from the mesh"
        )
        reason = f"must belong to this mesh, but was distilled from another shape: {shares}"
        raise ArgumentError("field", f"{reason}: distill a field from this mesh{override}")
    if farthest > WARNED_COORDINATE:
        message = f"`field` was distilled from {sizes}: weights beyond that shape's box are extrapolated: {remedy}"
        warnings.warn(message, UserWarning, stacklevel=4)


def _differences(field: KnownShape, mesh: Mesh) -> tuple[float, float]:
    """Return the share of mesh samples far from the field's points, and the share of field points far from the mesh."""
    samples, spacing = _samples(mesh)
    if field.surface is None or samples is None:
        return 0.0, 0.0
    from scipy.spatial import cKDTree  # slow to import, and not needed by fields without surface samples

    far = FAR * float(np.linalg.norm(np.ptp(field.surface, axis=0)))
    known = cKDTree(field.surface)
    between = known.query(field.surface, k=2)[0][:, 1].min()
    beyond = known.query(samples)[0] > far + between
    missing = cKDTree(samples).query(field.surface)[0] > far + spacing
    return float(beyond.mean()), float(missing.mean())


def _samples(mesh: Mesh) -> tuple[Float64 | None, float]:
    """Return evenly spaced samples of `mesh`, (4096, 3), and 1.5 times their spacing; None and 0 if the area is 0."""
    from dfd.geometry.topology import even_points, face_areas

    areas = face_areas(mesh.vertices, mesh.faces)
    if not areas.any():
        return None, 0.0
    corners, barycentric = even_points(mesh.vertices, mesh.faces, SAMPLES)
    points = np.einsum("nk,nkd->nd", barycentric, mesh.vertices[corners])
    return points, 1.5 * float(np.sqrt(areas.sum() / SAMPLES))


def _point(position: Float64) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in position) + ")"
