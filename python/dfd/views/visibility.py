"""The part of a surface that no camera sees, for which pictures give no features."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dfd.common import check
from dfd.common.linear_algebra import Bool, Float32, Float64, Int32, Int64
from dfd.common.threads import get_num_threads
from dfd.geometry.topology import face_areas, face_components, first_at_place, spread_in_triangle
from dfd.mesh.appearance import blend
from dfd.mesh.normalization import box_normalization
from dfd.views.cameras import place_cameras
from dfd.views.raycast import Scene
from dfd.views.render import LARGEST_VIEWS, used_vertices

if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh

POINTS = 1 << 16  # on the whole surface, and at least one on every face
_AT_ONCE = 1 << 15  # points that one thread looks at
# What stands before a point by this share of its distance from the eye hides it; the face that it lies on does not.
_TOLERANCE = 1e-4


@dataclass(frozen=True)
class Unseen:
    """The unseen part of a surface."""

    views: int  # cameras that looked
    area: float  # part of the surface, 0 … 1; 1 where no face has an area
    components: int  # connected components of which no camera sees anything: inner walls, mostly
    component_count: int  # all components that have an area


def unseen(mesh: Mesh, *, views: int = 24, frame: Float64 | None = None) -> Unseen:
    """Measure which part of `mesh` is hidden from all cameras that `dfd.distill` places with its defaults.

    Points spread over all faces count as seen when the straight line from some camera to them meets nothing before,
    be it of glass; a face is seen from both its sides. On unseen parts `dfd.distill` has no features:
    its smoothing fills in those of the nearest seen surface.

    There are `views` cameras; `frame` (3, 3) tells what counts as right, up and front, see `dfd.views.render.render`.

    Raises ValueError if `views` is not at least 1.
    """
    views = check.whole("unseen", "views", views, minimum=1, maximum=LARGEST_VIEWS)
    nothing = Unseen(views, area=1.0, components=0, component_count=0)
    found = box_normalization(*mesh.bounds)
    if found is None:
        return nothing
    center, scale = found
    vertices = ((mesh.vertices - center) * scale).astype(np.float32)
    areas = face_areas(vertices, mesh.faces)
    has_area = areas > 0
    if not has_area.any():
        return nothing
    areas = areas[has_area]
    # Even where every face is large there are many points, and even the smallest face has one.
    counts = np.ceil(areas / areas.sum() * POINTS).astype(np.int64)
    seen = _seen(vertices, mesh.faces[has_area], counts, views, np.eye(3) if frame is None else frame)
    of_face = np.add.reduceat(seen, np.concatenate([[0], np.cumsum(counts)[:-1]]), dtype=np.int64)
    component = face_components(first_at_place(mesh)[mesh.faces[has_area]])
    of_component = np.bincount(component, of_face)
    return Unseen(
        views,
        area=float((areas * (1 - of_face / counts)).sum() / areas.sum()),
        components=int((of_component == 0).sum()),
        component_count=len(of_component),
    )


def _seen(vertices: Float32, faces: Int32, counts: Int64, views: int, axes: Float64) -> Bool:
    """Return which points are seen, face by face, `counts` (F,) of them on each."""
    scene = Scene(vertices, faces)
    placed = place_cameras(views, used_vertices(vertices, faces) @ axes.T, mirrored=True)
    cameras = [camera.in_mesh(axes) for camera in placed]
    # Mirrored cameras come one half after the other: taken by turns, few of them soon see nearly everything.
    eyes = [cameras[number].position for number in sorted(range(views), key=lambda i: i % max(views // 2, 1))]
    ends = np.cumsum(counts)
    seen = np.zeros(ends[-1], bool)

    def look(start: int) -> None:
        number = np.arange(start, min(start + _AT_ONCE, len(seen)))
        face = np.searchsorted(ends, number, side="right")
        points = blend(vertices, faces[face], spread_in_triangle(number - ends[face] + counts[face]))
        for eye in eyes:
            hidden = scene.hides(eye, points, _TOLERANCE)
            seen[number[~hidden]] = True
            number, points = number[hidden], points[hidden]
            if len(points) == 0:
                return

    with ThreadPoolExecutor(get_num_threads()) as threads:
        for _ in threads.map(look, range(0, len(seen), _AT_ONCE)):
            pass
    return seen
