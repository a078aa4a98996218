"""Check that a field belongs to a mesh, by the box and the surface points that the field stores of its own shape."""

import warnings
from typing import Protocol

import numpy as np

from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float32, Float64
from dfd.mesh.mesh import Mesh

# Largest ratio of the longest sides of both shapes. Cut or simplified shapes have smaller ratios. Inch and centimeter,
# the nearest units that people confuse, have the ratio 2.54.
LARGEST_RATIO = 2.0
# Largest extent of a mesh from the field's center, in halves of the field's longest side. A slightly posed shape has
# less. A shape that stands on the ground with another up axis has 2.
FARTHEST_REACH = 1.5
POINTS = 512  # surface samples that a field stores
SAMPLES = 4096  # surface samples of a mesh, which are compared with the field's points
FAR = 0.02  # distance above which a point is far from a surface, beside the spacing of samples, in diagonals of the box
# Largest share of a mesh's samples far from the field's points, and of the field's points far from the mesh. Copies of
# 36 real meshes passed (noise, subdivision, a tenth of the faces, halves), except a boat with faces that simplification
# tore apart. Of 536 pairs of shapes with equal boxes 4 passed; 3 of them are two files of one body.
MOST_BEYOND, MOST_MISSING = 0.1, 0.6


class KnownShape(Protocol):
    """The data that a `Field` stores about the shape from which it was distilled, in mesh units."""

    center: Float64  # (3,) center of the box
    scale: float  # 2 over the longest side of the box
    surface: Float32 | None  # (512, 3) surface samples


def surface_points(mesh: Mesh) -> Float32 | None:
    """Return (512, 3) evenly spaced surface samples of `mesh`, in mesh units; None if no face has an area.

    Each point is the sample farthest from all previous points (Gonzalez 1985).
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
    """Raise ValueError if a field was distilled from another shape than `mesh`.

    Accepted are other resolutions of the shape, and parts with at least half of its surface. A field without surface
    samples, such as `VertexField`, is compared by its box alone. The message names `allowed_by`, the argument that
    accepts all fields.

    Raises ValueError if the longest sides differ by more than a factor of 2, or the mesh's box lies outside the cube
    around the field's shape. Raises ValueError if more than 10 % of the mesh's surface is far from the field's shape,
    or more than 60 % of the field's shape is far from the mesh. Warns if the mesh extends beyond the cube by more than
    a quarter of the cube's side, because features there are extrapolated.
    """
    center, scale = field.center, field.scale
    low, high = (np.asarray(mesh.bounds) - center) * scale  # the field's shape lies in the cube [-1, 1]³
    ratio = float((high - low).max()) / 2.0
    reach = float(max(-low.min(), high.max()))
    outside = bool((low > 1).any() or (high < -1).any())
    sizes = (
        f"a shape with a longest side of {2 / scale:.4g} around {_point(center)}, "
        f"and this mesh has one of {np.max(mesh.extents):.4g} around {_point(np.mean(mesh.bounds, axis=0))}"
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
    if reach > FARTHEST_REACH:
        message = f"`field` was distilled from {sizes}: weights beyond that shape's box are extrapolated: {remedy}"
        warnings.warn(message, UserWarning, stacklevel=4)


def _differences(field: KnownShape, mesh: Mesh) -> tuple[float, float]:
    """Return the shares of the mesh's surface far from the field's points, and of these points far from the mesh."""
    samples, spacing = _samples(mesh)
    if field.surface is None or samples is None:
        return 0.0, 0.0
    from scipy.spatial import cKDTree  # slow to import, and not needed for other fields

    far = FAR * float(np.linalg.norm(np.ptp(field.surface, axis=0)))
    known = cKDTree(field.surface)
    between = known.query(field.surface, k=2)[0][:, 1].min()
    beyond = known.query(samples)[0] > far + between
    missing = cKDTree(samples).query(field.surface)[0] > far + spacing
    return float(beyond.mean()), float(missing.mean())


def _samples(mesh: Mesh) -> tuple[Float64 | None, float]:
    """Return evenly spaced surface samples (4096, 3) of `mesh`, and their spacing, in mesh units."""
    from dfd.geometry.topology import even_points, face_areas

    areas = face_areas(mesh.vertices, mesh.faces)
    if not areas.any():
        return None, 0.0
    face, barycentric = even_points(areas, SAMPLES)
    points = np.einsum("nk,nkd->nd", barycentric, mesh.vertices[mesh.faces[face]])
    return points, 1.5 * float(np.sqrt(areas.sum() / SAMPLES))


def _point(position: Float64) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in position) + ")"
