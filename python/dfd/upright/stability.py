"""Measure cues for the up direction on the surface: stable poses, the base on which a shape stands, and mirror planes.

Stability and base are from Fu, Cohen-Or, Dror, Sheffer, "Upright orientation of man-made objects" (SIGGRAPH 2008).
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError, cKDTree

from dfd.common.linear_algebra import Float64, Int32, unit
from dfd.geometry.topology import sample_surface
from dfd.mesh.normals import face_normals
from dfd.symmetry.fit import SurfaceSamples, fitted_planes
from dfd.symmetry.plane import SymmetryPlane

EVIDENCE = ("stable", "facing up", "base", "near the base", "middle", "mirrors upright", "mirrors flat")
POINTS = 2000  # number of surface samples
REFLECTED = 500  # number of surface samples whose mirror images are compared with the surface
BASE = 0.03  # height of the base above the lowest vertex, as a fraction of the bounding box's diagonal
FACES_UP = 0.9  # a normal faces up if its cosine with up is larger than this
ALIGNED = 1.25  # an axis of the file is a mirror normal if its error is at most this times the smallest error
LEAST_ERROR = 0.004  # `mirror_error` of an exact mirror plane, which is above 0 because samples are random
LEAST_HEIGHT = 1e-6  # smallest divisor of heights, as a fraction of the box's diagonal; flat shapes have height 0
RESTS = 4  # largest number of stable poses that become candidates for up
_NEARLY_PARALLEL = np.cos(np.radians(8))  # cosine of 8°; directions at a smaller angle are nearly parallel


class StabilityCues:
    """Cues of a surface with `vertices` (V, 3) in any unit and `faces` (F, 3). At least one face must have an area."""

    def __init__(self, vertices: NDArray[np.floating], faces: Int32) -> None:
        generator = np.random.default_rng(0)
        self.points, face = sample_surface(vertices, faces, POINTS, generator)
        self.normals = unit(face_normals(vertices, faces[face]))
        used = np.unique(vertices[np.unique(faces)].astype(np.float64), axis=0)
        hull = _hull_of(used)
        self.hull = used if hull is None else used[hull.vertices]  # all vertices if they are coplanar
        self.middle = self.points.mean(axis=0)
        self.diagonal = float(np.linalg.norm(np.ptp(self.hull, axis=0)))
        self._tree = cKDTree(self.points)
        self._reflected = self.points[generator.permutation(POINTS)[:REFLECTED]]
        self._mirror_errors: dict[tuple[float, ...], float] = {}

    def evidence(self, frame: Float64) -> Float64:
        """Return the values (7,) of the cues in `EVIDENCE`. The rows of `frame` (3, 3) are right, up and front."""
        right, up, front = frame
        height = self.hull @ up
        feet = self.hull[height < height.min() + BASE * self.diagonal]
        ground = np.stack([right, front], axis=1)
        base = _hull_of(feet @ ground)
        shadow = _hull_of(self.hull @ ground)
        stable = base is not None and bool((base.equations @ [*(self.middle @ ground), 1.0]).max() < 0)
        points = self.points @ up
        mirrored = min(self.mirror_error(right), self.mirror_error(front))
        return np.array(
            [
                float(stable),  # whether the middle of the surface lies above the base
                float((self.normals @ up > FACES_UP).mean()),
                base.volume / shadow.volume if base is not None and shadow is not None else 0.0,  # ratio of both areas
                float((points < height.min() + BASE * self.diagonal).mean()),
                float((np.median(points) - height.min()) / max(np.ptp(height), LEAST_HEIGHT * self.diagonal)),
                mirrored,  # mirror error of the better vertical plane
                self.mirror_error(up),  # mirror error of the horizontal plane
            ]
        )

    def mirror_error(self, normal: Float64) -> float:
        """Return the mirror error: the mean distance of mirror images from the surface, divided by the box's diagonal.

        The mirror plane has the normal `normal` (3,) and passes through the mean of the surface samples.
        """
        key = tuple(np.round(normal * np.sign(normal[np.abs(normal).argmax()]), 9))  # equal for `normal` and −`normal`
        if key not in self._mirror_errors:
            images = SymmetryPlane(tuple(normal), normal @ self.middle).reflect(self._reflected)
            self._mirror_errors[key] = float(self._tree.query(images)[0].mean()) / self.diagonal
        return self._mirror_errors[key]

    def mirror_normal(self) -> Float64:
        """Return the unit normal (3,) of the plane with the smallest mirror error."""
        samples = SurfaceSamples(self.points, self.normals, self._tree, self.diagonal)
        planes = fitted_planes(samples, (self.hull.min(axis=0) + self.hull.max(axis=0)) / 2)
        return min((np.array(plane.normal) for plane in planes), key=self.mirror_error)

    def stable_ups(self, frame: Float64) -> Float64:
        """Return the up directions (K, 3) of at most `RESTS` stable poses, no two of them nearly parallel.

        The outline is the convex hull of the shape, projected along the first row of `frame` (3, 3). In a stable pose,
        the shape rests on an edge of the outline, and its middle is above the edge. Poses on long edges come first. If
        fewer than `RESTS` poses are found, the second and third rows of `frame` are added.
        """
        plane = frame[1:]
        kept: list[Float64] = []
        for up in [*_resting_ups(self.hull @ plane.T, self.middle @ plane.T), *np.eye(2)]:
            if len(kept) < RESTS and all(abs(up @ other) < _NEARLY_PARALLEL for other in kept):
                kept.append(up)
        return np.stack(kept) @ plane

    def frame(self) -> Float64:
        """Return the axes (3, 3) of the shape, in rows.

        If one axis of the file is a mirror normal, the rows are the axes of the file. Otherwise, they are the normal of
        the best mirror plane, and the sides of the smallest rectangle around the shape's projection onto this plane.
        """
        normal = self.mirror_normal()
        least = max(self.mirror_error(normal), LEAST_ERROR)
        if min(self.mirror_error(axis) for axis in np.eye(3)) <= ALIGNED * least:
            return np.eye(3)
        one = _across(normal)
        other = np.cross(normal, one)
        flat = self.hull @ np.stack([one, other], axis=1)
        angles = np.radians(np.arange(0, 90, 1.5))
        turned = [np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]]) for a in angles]
        best = min(turned, key=lambda turn: float(np.prod(np.ptp(flat @ turn.T, axis=0))))
        up, _ = best @ np.stack([one, other])
        return np.stack([normal, up, np.cross(normal, up)])


def _resting_ups(outline: Float64, middle: Float64) -> list[Float64]:
    """Return inward normals (2,) of the hull edges of `outline` onto which `middle` projects, longest edge first."""
    hull = _hull_of(outline)
    found = []
    for edge, equation in zip(hull.simplices, hull.equations, strict=True) if hull is not None else ():
        start, end = outline[edge]
        length = float(np.linalg.norm(end - start))
        if 0 < (middle - start) @ (end - start) < length**2:
            found.append((length, -equation[:2]))
    return [normal for _, normal in sorted(found, key=lambda each: -each[0])]


def _across(normal: Float64) -> Float64:
    """Return a unit vector perpendicular to `normal`."""
    across = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    return across / np.linalg.norm(across)


def _hull_of(points: Float64) -> ConvexHull | None:
    """Return the convex hull of `points` (N, 2 or 3); None if they are collinear, or coplanar in space."""
    try:
        return ConvexHull(points)
    except (QhullError, ValueError):
        return None
