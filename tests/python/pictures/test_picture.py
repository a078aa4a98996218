"""Test pictures of shapes."""

import numpy as np
import pytest

import dfd.pictures.picture
from dfd.mesh.appearance import Appearance, Material
from dfd.mesh.mesh import Mesh
from dfd.pictures.colors import CLAY, weight_colors
from dfd.pictures.picture import picture

FRONT = {"azimuth": 0.0, "elevation": 0.0}


def box(center=(0, 0, 0), half=1.0):
    """Return the eight corners of a cube, of which the first four have the lower x, and its twelve faces."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]
    return corners * half + center, np.array(faces)


def quad(z=0.0):
    return np.array([[-1, -1, z], [1, -1, z], [1, 1, z], [-1, 1, z]], float), np.array([[0, 1, 2], [0, 2, 3]])


def joined(*parts):
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    faces = [faces + start for (_, faces), start in zip(parts, starts, strict=False)]
    return np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces)


def covered(image):
    return (image < 250).any(axis=-1)


def test_a_square_from_the_front_fills_the_frame():
    image = picture(Mesh(*quad()), **FRONT, resolution=100)
    assert image.shape == (100, 100, 3)
    assert image.dtype == np.uint8
    rows, columns = np.nonzero(covered(image))
    # The margin is a few pixels wide and the same on all sides.
    assert (rows.min(), columns.min()) == (99 - rows.max(), 99 - columns.max())
    assert 1 <= rows.min() == columns.min() <= 6
    assert covered(image)[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1].all()
    assert (image[0] == 255).all()


@pytest.mark.parametrize(
    ("angles", "axis"), [((90, 0), 0), ((-90, 0), 0), ((0, 90), 1), ((0, -90), 1), ((0, 0), 2), ((180, 0), 2)]
)
def test_azimuth_and_elevation_choose_the_visible_side(angles, axis):
    vertices, faces = box()
    sign = -1 if min(angles) < 0 or max(angles) == 180 else 1
    towards = np.flatnonzero(vertices[:, axis] * sign > 0)
    colors = np.zeros((8, 3))
    colors[towards] = (1, 0, 0)
    image = picture(Mesh(vertices, faces), colors=colors, azimuth=angles[0], elevation=angles[1], resolution=40)
    assert image[20, 20, 0] > 150
    assert image[20, 20, 1:].max() < 40


def test_weights_are_drawn_as_heat_and_none_as_clay():
    mesh = Mesh(*box())
    clay = picture(mesh, resolution=48)
    np.testing.assert_array_equal(picture(mesh, weights=np.zeros(8), resolution=48), clay)
    np.testing.assert_array_equal(picture(mesh, colors=np.tile(CLAY, (8, 1)), resolution=48), clay)
    weights = np.linspace(0, 1, 8)
    np.testing.assert_array_equal(
        picture(mesh, weights=weights, resolution=48), picture(mesh, colors=weight_colors(weights), resolution=48)
    )


def test_edges_are_sharp_and_concave_corners_are_darker():
    # The floor is darker near the box than far from it, and the front of the box is evenly lit.
    floor = np.array([[-6, -1, -6], [6, -1, -6], [6, -1, 6], [-6, -1, 6]], float), np.array([[0, 2, 1], [0, 3, 2]])
    mesh = Mesh(*joined(floor, box()))
    image = picture(mesh, azimuth=0, elevation=40, resolution=160)[:, :, 0].astype(int)
    center, bottom = 80, np.nonzero(covered(image[:, :, None])[:, 80])[0].max()
    column = image[:, center]
    edge = int(np.abs(np.diff(column[70:110])).argmax()) + 70  # between the front of the box and the floor
    beside, far = column[edge + 2], column[bottom - 4]
    assert far - beside > 15
    alone = picture(Mesh(*box()), **FRONT, resolution=64)[20:44, 20:44].astype(int)
    assert np.ptp(alone[:, :, 0]) <= 2


def test_a_pair_shares_its_camera():
    still, other = box((-3, 0, 0), 0.5), box((1, 0, 0), 0.5)
    mesh = Mesh(*joined(still, other))
    moved = mesh.vertices.copy()
    moved[8:] += (4, 2, 0)
    before = picture(mesh, frame=[moved], **FRONT, resolution=96)
    after = picture(mesh, vertices=moved, frame=[mesh.vertices], **FRONT, resolution=96)
    half = 36  # columns of the box that does not move
    np.testing.assert_array_equal(covered(before)[:, :half], covered(after)[:, :half])
    assert covered(before)[:, :half].any()
    assert (covered(before)[:, half:] != covered(after)[:, half:]).any()
    assert not covered(after)[0].any()
    assert not covered(after)[:, -1].any()


def two_sheets(material):
    vertices, faces = joined(quad(1.0), quad(-1.0))
    opaque = Material(color=(0.1, 0.2, 0.9, 1.0))
    appearance = Appearance(
        corners=np.arange(8, dtype=np.int32),
        corner_faces=faces.astype(np.int32),
        face_material=np.array([0, 0, 1, 1], np.int32),
        materials=(material, opaque),
    )
    return Mesh(vertices, faces, appearance=appearance)


def test_surfaces_behind_a_transparent_surface_are_visible():
    solid, half, cut = (
        picture(two_sheets(Material(color=(0.9, 0.1, 0.1, alpha), alpha_mode=mode)), **FRONT, resolution=48)[24, 24]
        for alpha, mode in ((0.3, "OPAQUE"), (0.5, "BLEND"), (0.3, "MASK"))
    )
    assert solid[0] > 150 > 60 > solid[2]
    assert cut[2] > 150 > 60 > cut[0]
    assert 60 < half[0] < solid[0]
    assert 60 < half[2] < cut[2]


def test_handles_are_blue_dots_and_fixed_points_dark_squares():
    mesh = Mesh(*quad())
    plain = picture(mesh, **FRONT, resolution=200).astype(int)
    marked = picture(mesh, handles=[[0.0, 0.0, 0.0]], fixed=[[0.5, 0.5, 0.0]], **FRONT, resolution=200).astype(int)
    red, _, blue = marked[99, 99]
    assert blue > 200 > 60 > red
    changed = np.abs(marked - plain).sum(axis=-1) > 30
    rows, columns = np.nonzero(changed[70:130, 70:130])
    assert abs(np.mean(rows) - 29.5) < 0.6
    assert abs(np.mean(columns) - 29.5) < 0.6
    dark = (marked.max(axis=-1) < 60).nonzero()
    assert np.ptp(dark[0]) == np.ptp(dark[1])
    assert len(dark[0]) == (np.ptp(dark[0]) + 1) ** 2  # a square with filled corners
    assert dark[0].mean() < 60  # above the center
    assert dark[1].mean() > 140  # right of the center


def test_vertices_and_their_positions_mark_the_same_place():
    mesh = Mesh(*box())
    by_index = picture(mesh, handles=[7], fixed=np.array([5]), resolution=64)
    by_place = picture(mesh, handles=mesh.vertices[[7]], fixed=[mesh.vertices[5]], resolution=64)
    np.testing.assert_array_equal(by_index, by_place)
    plain = picture(mesh, resolution=64)
    assert (by_index != plain).any()
    np.testing.assert_array_equal(picture(mesh, handles=[], fixed=np.zeros((0, 3)), resolution=64), plain)


def test_a_hidden_mark_is_faint():
    mesh = Mesh(*box())
    seen = picture(mesh, handles=[[0.0, 0.0, 1.0]], **FRONT, resolution=100)[49, 49].astype(int)
    hidden = picture(mesh, handles=[[0.0, 0.0, -1.0]], **FRONT, resolution=100)[49, 49].astype(int)
    plain = picture(mesh, **FRONT, resolution=100)[49, 49].astype(int)
    assert np.abs(seen - plain).sum() > 2 * np.abs(hidden - plain).sum() > 20


def test_size_and_position_of_the_shape_do_not_matter():
    vertices, faces = box()
    here = picture(Mesh(vertices, faces), resolution=64).astype(int)
    for factor, offset in ((1e-9, 0.0), (1e12, 0.0), (1.0, 1e6)):
        there = picture(Mesh(vertices * factor + offset, faces), resolution=64)
        assert np.abs(there - here).mean() < 0.1


def test_threads_and_bands_change_nothing_visible(monkeypatch):
    mesh = Mesh(*box())
    dfd.set_num_threads(1)
    one = picture(mesh, resolution=80)
    dfd.set_num_threads(3)
    monkeypatch.setattr(dfd.pictures.picture, "BAND", 2 * 2 * 80 * 20)
    several = picture(mesh, resolution=80)
    dfd.set_num_threads(1)
    np.testing.assert_array_equal(picture(mesh, resolution=80), several)
    assert np.abs(one.astype(int) - several).max() <= 1


def test_one_pixel_and_faces_without_area():
    vertices, faces = box()
    assert picture(Mesh(vertices, faces), resolution=1).shape == (1, 1, 3)
    flat = Mesh(vertices, np.concatenate([faces, [[0, 0, 0], [1, 1, 2]]]))
    np.testing.assert_array_equal(picture(flat, resolution=32), picture(Mesh(vertices, faces), resolution=32))
    line = Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]])
    assert (picture(line, resolution=32) == 255).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"vertices": np.zeros((3, 3))}, r"`vertices` must have shape \(8, 3\), got \(3, 3\)"),
        ({"vertices": np.zeros((8, 3))}, "all points have one position"),
        ({"weights": np.zeros(7)}, r"`weights` must have shape \(8,\)"),
        ({"weights": np.zeros(8), "colors": np.zeros((8, 3))}, "`colors` and `weights` cannot both be given"),
        ({"handles": [8]}, r"`handles` must lie in 0 … 7, got 8"),
        ({"fixed": [[0.0, 1.0]]}, "`fixed` must have shape"),
        ({"frame": [np.zeros((2, 2))]}, "`frame` must have shape"),
        ({"elevation": 91}, "`elevation` must be at most 90"),
        ({"resolution": 0}, "`resolution` must be a whole number from 1 to 8192, got 0"),
        ({"resolution": 10**6}, "`resolution` must be a whole number from 1 to 8192"),
    ],
)
def test_refusals(options, message):
    with pytest.raises(ValueError, match=message):
        picture(Mesh(*box()), **options)
