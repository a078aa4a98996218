"""Test views: the surface point of each pixel (Eq. 2), and pictures that depend only on the shape."""

import numpy as np
import pytest

import dfd
from dfd import Mesh, samples
from dfd.views.render import Views, render

MIRROR = np.array([-1.0, 1.0, 1.0], np.float32)


@pytest.fixture(scope="module")
def robot():
    return dfd.samples.robot(faces=4000).mesh


@pytest.fixture(scope="module")
def seen(robot):
    return render(robot, views=6, resolution=40)


def lopsided():
    """Return a tetrahedron with four different sides."""
    return Mesh(
        [[0, 0, 0], [1, 0.1, 0], [0.2, 0.7, 0.1], [0.3, 0.2, 0.9]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]
    )


def same(one, other, tolerance):
    """Assert that two sets of views are equal, except for rounding at a few pixels of outlines."""
    differs = np.abs(one.images.astype(int) - other.images).max(axis=-1) > 1
    assert differs.mean() < 2e-3
    assert abs(len(one.points) - len(other.points)) < 2e-3 * len(one.points)
    keys = [
        np.ravel_multi_index((views.view, views.row.astype(int), views.column.astype(int)), views.images.shape[:3])
        for views in (one, other)
    ]
    _, first, second = np.intersect1d(*keys, return_indices=True)
    apart = np.abs(one.points[first] - other.points[second]).max(axis=1)
    assert (apart > tolerance).mean() < 2e-3


def test_points_lie_on_the_nearest_triangle():
    mesh = lopsided()
    views = render(mesh, views=5, resolution=24)
    places = (mesh.vertices - views.center) * views.scale
    for index, camera in enumerate(views.cameras):
        directions = camera.ray_directions(24).astype(np.float64)
        nearest = np.full(len(directions), np.inf)
        for corners in places[mesh.faces]:  # solve o + t d = B·T for each ray
            system = np.stack(
                np.broadcast_arrays(corners[1] - corners[0], corners[2] - corners[0], -directions), axis=-1
            )
            right = np.broadcast_to(camera.position - corners[0], directions.shape)
            u, v, t = np.linalg.solve(system, right[..., None])[..., 0].T
            inside = (np.minimum(u, v) >= 0) & (u + v <= 1) & (t > 0)
            nearest[inside] = np.minimum(nearest[inside], t[inside])
        here = views.view == index
        pixel = (views.row[here] * 24 + views.column[here]).astype(int)
        hit = np.isfinite(nearest)
        assert np.setxor1d(pixel, np.flatnonzero(hit)).size <= 1  # one pixel can be exactly on the outline
        pixel_hit = hit[pixel]
        expected = camera.position + nearest[pixel[pixel_hit], None] * directions[pixel[pixel_hit]]
        assert views.points[here][pixel_hit] == pytest.approx(expected, abs=1e-5)


def test_points_are_in_the_box_and_center_and_scale_bring_them_back(robot, seen):
    assert np.abs(seen.points).max() <= 1 + 1e-6
    back = seen.points / seen.scale + seen.center
    assert (back >= robot.bounds[0] - 1e-6).all()
    assert (back <= robot.bounds[1] + 1e-6).all()


@pytest.mark.parametrize(("offset", "scale"), [(1e6, 1.0), (0.0, 1e-12), (0.0, 1e-200), (0.0, 1e200), (-3e8, 1e6)])
def test_place_and_size_do_not_matter(robot, seen, offset, scale):
    moved = render(Mesh(robot.vertices * scale + offset, robot.faces), views=6, resolution=40)
    same(seen, moved, 1e-3)


def test_equal_calls_give_equal_bytes(robot, seen):
    dfd.set_num_threads(1)
    again = render(robot, views=6, resolution=40)
    for name in ("images", "points", "view", "row", "column"):
        assert getattr(seen, name).tobytes() == getattr(again, name).tobytes()


def test_mirrored_views_of_a_mirrored_shape_are_the_same(robot):
    half = Mesh(robot.vertices + [0.3, 0, 0], robot.faces)
    both = Mesh(
        np.concatenate([half.vertices, half.vertices * MIRROR]),
        np.concatenate([half.faces, half.faces[:, ::-1] + len(half.vertices)]),
    )
    views = render(both, views=8, resolution=60, mirrored=True)

    def part(start):
        here = views.view // 2 == start // 2
        points = views.points[here] * (MIRROR if start else 1)
        place = (views.view[here] - start, views.row[here], views.column[here], views.face[here])
        shape = (views.vertices, views.faces, views.center, views.scale)
        return Views(views.images[start : start + 2], views.covered[start : start + 2], [], points, *place, *shape)

    same(part(0), part(2), 1e-4)


def test_vertex_supervision_returns_the_visible_vertices_only():
    mesh = lopsided()
    views = render(mesh, views=12, resolution=64, supervision="vertex")
    places = ((mesh.vertices - views.center) * views.scale).astype(np.float32)
    for index, camera in enumerate(views.cameras):
        here = views.view == index
        # A vertex of a convex shape is visible if one of its faces faces the camera.
        corners = places[mesh.faces].astype(np.float64)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        fronts = np.einsum("fc,fc->f", normals, camera.position - corners[:, 0]) > 0
        expected = np.unique(mesh.faces[fronts])
        found = [int(np.abs(places - point).sum(axis=1).argmin()) for point in views.points[here]]
        assert sorted(found) == expected.tolist()
        row, column = camera.project(views.points[here].astype(np.float64), 64)
        assert row == pytest.approx(views.row[here], abs=1e-3)
        assert column == pytest.approx(views.column[here], abs=1e-3)


def test_a_shape_without_area_is_refused():
    line = Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2], [0, 0, 1]])
    for supervision in ("barycentric", "vertex"):
        with pytest.raises(ValueError, match="render: no camera ray hits `mesh`"):
            render(line, views=3, resolution=16, supervision=supervision)
    with pytest.raises(ValueError, match="`mesh` must have some extent"):
        render(Mesh(np.ones((3, 3)), [[0, 1, 2]]))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"views": 0}, "`views` must be a whole number from 1 to 32767, got 0"),
        ({"resolution": 100_000}, "`resolution` must"),
        ({"framing": "wide"}, "`framing` must be one of shape, paper, got 'wide'"),
        ({"supervision": "pixel"}, "`supervision` must be one of barycentric, vertex, got 'pixel'"),
        ({"simplify_to": 0}, "`simplify_to` must be a whole number of at least 4, got 0"),
    ],
)
def test_bad_arguments_are_named(options, message):
    with pytest.raises(ValueError, match=f"render: {message}"):
        render(lopsided(), **options)


@pytest.mark.parametrize("supervision", ["barycentric", "vertex"])
def test_covered_pixels_are_those_that_show_something(supervision):
    views = render(samples.robot(4000).mesh, views=3, resolution=70, supervision=supervision)
    place = (views.view, np.rint(views.row).astype(int), np.rint(views.column).astype(int))
    assert views.covered[place].all()
    assert (views.images[~views.covered] == 255).all()
    if supervision == "barycentric":
        assert views.covered.sum() == len(views.points)
