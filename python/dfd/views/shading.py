"""Shade pixels with a light at the eye, smooth normals and the color of the surface, on a white background."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dfd.common.linear_algebra import Float32, Int32, UInt8, unit
from dfd.geometry.topology import are_distinct, first_at_place
from dfd.mesh.appearance import GRAY, blend
from dfd.mesh.normals import face_normals, smooth_normals
from dfd.views.raycast import Hits, Scene

if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh
    from dfd.views.cameras import Camera

AMBIENT, DIFFUSE = 0.6, 0.4  # brightness of ambient and diffuse light, as in the paper's public code
_LAYERS = 8  # largest number of surfaces that are blended along a ray
_CANCELLED = 0.2  # an interpolated normal shorter than this is replaced by the normal of the face
_STEP = 1e-4  # distance behind a transparent surface at which a ray continues; the shape lies in [−1, 1]³


class Shading:
    """Draws pictures of one scene."""

    def __init__(self, scene: Scene, mesh: Mesh, vertices: Float32) -> None:
        """Store `scene`, which contains the faces of `mesh` with `vertices` (V, 3) scaled into the cube [−1, 1]³."""
        self._scene = scene
        self._vertices = vertices
        self._faces = mesh.faces
        self._normals = _normals(mesh)
        self._appearance = mesh.appearance

    def picture(self, camera: Camera, resolution: int) -> tuple[UInt8, Hits]:
        """Return a picture (R, R, 3), and the first hit of each pixel on a surface that is at least half opaque.

        `Hits.ray` contains the pixels: row · R + column.
        """
        origin = camera.position.astype(np.float32)
        directions = camera.ray_directions(resolution)
        hits = self._scene.cast(origin, directions)
        rgba = self.colors(hits, directions)
        if (rgba[:, 3] < 1).any():
            hits, color = self._see_through(origin, directions, hits, rgba)
            image = _bytes(color)
        else:
            image = np.full((resolution * resolution, 3), 255, np.uint8)
            image[hits.ray] = _bytes(rgba[:, :3])
        return image.reshape(resolution, resolution, 3), hits

    def colors(self, hits: Hits, directions: Float32) -> Float32:
        """Return the lit color and opacity (K, 4) of each hit, in [0, 1]; `directions` has a row (3,) for each ray."""
        if self._appearance is None:
            rgba = np.full((len(hits.ray), 4), GRAY, np.float32)
            rgba[:, 3] = 1
        else:
            rgba = self._appearance.albedo(hits.face, hits.barycentric)
        light = facing(self._vertices, self._faces, self._normals, hits, directions)
        rgba[:, :3] *= np.float32(AMBIENT) + np.float32(DIFFUSE) * light[:, None]
        return rgba

    def _see_through(self, origin: Float32, directions: Float32, hits: Hits, rgba: Float32) -> tuple[Hits, Float32]:
        """Return the first hit of each ray on a surface that is at least half opaque, and the color (N, 3) of each ray.

        Transparent surfaces are blended from front to back, with white behind them.
        """
        color = np.zeros((len(directions), 3), np.float32)
        light = np.ones(len(directions), np.float32)  # transmittance of the surfaces in front of the next hit
        reached = np.zeros(len(directions), np.float32)
        solid = np.zeros(len(directions), bool)
        kept: list[Hits] = []
        for _ in range(_LAYERS):
            share = light[hits.ray] * rgba[:, 3]
            color[hits.ray] += share[:, None] * rgba[:, :3]
            light[hits.ray] -= share
            first = ~solid[hits.ray] & (rgba[:, 3] >= 0.5)
            kept.append(hits.where(first))
            solid[hits.ray[first]] = True
            reached[hits.ray] += hits.distance + np.float32(_STEP)
            on = hits.ray[light[hits.ray] > 0.01]
            if len(on) == 0:
                break
            further = self._scene.cast(origin + directions[on] * reached[on, None], directions[on])
            hits = Hits(on[further.ray], further.face, further.barycentric, further.distance)
            rgba = self.colors(hits, directions)
        layers = ((hits.ray, hits.face, hits.barycentric, hits.distance) for hits in kept)
        all_hits = Hits(*map(np.concatenate, zip(*layers, strict=True)))
        return all_hits.where(np.argsort(all_hits.ray)), color + light[:, None]


def _normals(mesh: Mesh) -> Float32:
    """Return the unit normals (V, 3) of vertices. Copies of faces add nothing, whichever side the first copy has."""
    if are_distinct(first_at_place(mesh)[mesh.faces]).all():
        return mesh.normals
    from dfd.geometry.body import body_of
    from dfd.geometry.surface_graph import seam_links

    return smooth_normals(mesh.vertices, body_of(mesh, seam_links(mesh)).faces)[mesh.representative]


def facing(
    vertices: Float32,  # (V, 3)
    faces: Int32,  # (F, 3)
    normals: Float32,  # (V, 3) unit normals; 0, 0, 0 if unknown
    hits: Hits,
    directions: Float32,  # (N, 3) unit directions of all rays
) -> Float32:
    """Return |n · d| (K,) of each hit, for the normal n and the ray's direction d: 0 if the ray grazes the surface.

    The normal n is interpolated from the corners' normals. If these nearly cancel, n is the normal of the face.
    """
    corners = faces.take(hits.face, axis=0)
    normal = blend(normals, corners, hits.barycentric)
    length = np.sqrt(np.einsum("kc,kc->k", normal, normal))
    lost = np.flatnonzero(length < _CANCELLED)
    if len(lost):
        normal[lost], length[lost] = unit(face_normals(vertices, corners[lost])), 1
    towards = np.abs(np.einsum("kc,kc->k", normal, directions.take(hits.ray, axis=0)))
    return np.minimum(towards / length, np.float32(1))


def _bytes(color: Float32) -> UInt8:
    """Return the 8-bit values of colors (N, 3), clipped to [0, 1]; NaN gives 0."""
    inside = np.fmin(np.fmax(color, np.float32(0)), np.float32(1))
    return (inside * np.float32(255) + np.float32(0.5)).astype(np.uint8)
