"""Test the vertices of regions, the texts that name places, and points near to and far from the shape."""

import numpy as np
import pytest
from made_field import field_of, made_field
from sheet import grid

import dfd
from dfd.editing.points import Place, find, nearest_vertex, place_on
from dfd.editing.regions import Ball, Box, Group, HalfSpace, Part, VertexSet, distances_from, members
from dfd.editing.weights.handle_features import HandleFeatures


@pytest.fixture(scope="module")
def mesh():
    return grid(9)


@pytest.fixture(scope="module")
def truck(tmp_path_factory):
    """A scene of two meshes, one of which occurs twice."""
    import trimesh

    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box((4, 1, 2)), geom_name="body", node_name="body")
    wheel = trimesh.creation.icosphere(subdivisions=1, radius=0.5)
    for node, x in (("front", 1.5), ("rear", -1.5)):
        place = np.eye(4)
        place[:3, 3] = (x, -1, 0)
        scene.add_geometry(wheel, geom_name="wheel", node_name=node, transform=place)
    path = tmp_path_factory.mktemp("scene") / "truck.glb"
    scene.export(path)
    return dfd.load(path)


@pytest.fixture
def grouped(tmp_path):
    """A square of two faces in two groups, without a material."""
    path = tmp_path / "square.obj"
    faces = "g floor\nf 1 2 3\ng ceiling tiles\nf 2 4 3\n"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\n" + faces)
    return dfd.load(path)


def everywhere(mesh, condition):
    return np.flatnonzero([condition(*vertex) for vertex in mesh.vertices])


@pytest.mark.parametrize(
    ("said", "region", "condition"),
    [
        ("ball:0,0,0.5,0.3", Ball((0, 0, 0.5), 0.3), lambda x, y, z: x * x + y * y + (z - 0.5) ** 2 <= 0.09),
        ("box:0,-1,0,1,1,0.5", Box((0, -1, 0), (1, 1, 0.5)), lambda x, y, z: x >= 0 and z <= 0.5),
        ("x>0.25", HalfSpace((4, 0, 0), 1), lambda x, y, z: x >= 0.25),
        ("z < 0.4", HalfSpace((0, 0, -1), -0.4), lambda x, y, z: z <= 0.4),
    ],
)
def test_a_region_holds_what_lies_in_it(mesh, said, region, condition):
    held = everywhere(mesh, condition)
    np.testing.assert_array_equal(members(mesh, region), held)
    place, note = find(mesh, said)
    assert place == place_on(mesh, region)
    assert note == f"{said} is {len(held)} vertices"
    low, high = mesh.vertices[held].min(axis=0), mesh.vertices[held].max(axis=0)
    np.testing.assert_allclose(place.position, (low + high) / 2)


def test_a_set_of_vertices_is_named_by_indices_or_by_a_mask(mesh):
    mask = np.zeros(81, bool)
    mask[[30, 4, 7]] = True
    by_indices = place_on(mesh, np.array([30, 4, 7, 4]))
    assert by_indices == place_on(mesh, mask)
    assert hash(by_indices) == hash(place_on(mesh, mask))
    assert by_indices != place_on(mesh, np.array([30, 4, 8]))
    np.testing.assert_array_equal(members(mesh, by_indices.region), [4, 7, 30])
    assert str(by_indices) == "a set of 3 vertices"
    assert place_on(mesh, [30, 4, 7][:0] or (0.1, 0.0, 0.3)).region is None


def test_a_set_holds_on_a_finer_mesh_what_lies_between_its_vertices(mesh):
    finer = grid(33)
    square = VertexSet.of(mesh, everywhere(mesh, lambda x, y, z: -0.3 < x < 0.3 and 0.2 < z < 0.8))
    held = np.zeros(len(finer.vertices), bool)
    held[members(finer, square)] = True
    x, _, z = finer.vertices.T
    spacing = 1 / 8
    assert held[(np.abs(x) < 0.25) & (np.abs(z - 0.5) < 0.25)].all()
    assert not held[(np.abs(x) > 0.25 + spacing) | (np.abs(z - 0.5) > 0.25 + spacing)].any()


def test_words_name_the_outermost_vertices(mesh):
    for word, axis, sign in (("top", 1, 1), ("bottom", 1, -1), ("right", 0, 1), ("left", 0, -1), ("front", 2, 1)):
        place, note = find(mesh, word)
        assert sign * place.position[axis] == (sign * mesh.vertices[:, axis]).max()
        assert note == f"{word} is vertex {place.vertex}"
    assert find(mesh, "back").place.position[2] == 0


def test_a_point_that_is_typed_snaps_to_the_surface_and_says_how_far(mesh):
    x, y, z = mesh.vertices[40]
    place, note = find(mesh, f"{x},{y + 0.1},{z}")
    assert place == place_on(mesh, 40)
    assert note.endswith("is vertex 40, 0.1 away")
    assert find(mesh, "40") == (place_on(mesh, 40), "vertex 40")
    assert nearest_vertex(mesh, (x, y + 0.1, z)) == (40, pytest.approx(0.1))


def test_parts_of_a_scene_are_known_by_name(truck):
    assert {"body", "front", "rear"} <= set(truck.part_names)
    front, rear = (set(truck.part_vertices(name)) for name in ("front", "rear"))
    assert len(front) == len(rear) == 42
    assert not front & rear
    place, note = find(truck, "part:front")
    assert place.region == Part("front")
    assert note == "part:front is 42 vertices"
    assert find(truck, "material:front").place == place  # without face groups, the name is that of a part
    np.testing.assert_allclose(place.position, (1.5, -1, 0), atol=1e-6)


def test_face_groups_of_an_obj_file_are_known_by_name(grouped):
    place, note = find(grouped, "group:ceiling tiles")
    assert place.region == Group("ceiling tiles")
    assert note == "group:ceiling tiles is 3 vertices"
    assert find(grouped, "material:ceiling tiles").place == place
    assert str(place) == "group:ceiling tiles"
    np.testing.assert_array_equal(members(grouped, Group("tiles")), [1, 2, 3])
    np.testing.assert_allclose(distances_from(grouped, Group("tiles")), [1, 0, 0, 0])
    message = r"`at` must be a face group of the file \(floor, ceiling tiles, ceiling, tiles\), got 'wall'"
    with pytest.raises(ValueError, match=message):
        find(grouped, "group:wall")
    with pytest.raises(ValueError, match="`at` must be a vertex index.* group:NAME"):
        find(grouped, "group:")


def test_a_session_holds_a_face_group_and_remembers_it(grouped, tmp_path):
    features = np.eye(4, 16, dtype=np.float32)
    session = dfd.Deformer(grouped, made_field(16), features=features)
    handle = session.add("group:floor", translation=(0, 0, 1), counterparts="shared_pivot", mask="group:floor")
    np.testing.assert_allclose(session.vertices[:, 2], [1, 1, 1, 0])
    session.save(tmp_path / "edit.json")
    again = dfd.Deformer.load(tmp_path / "edit.json", grouped, session.field, features=features)
    assert again.edit == session.edit
    assert again.handle(handle).controls.mask == Group("floor")


@pytest.mark.parametrize(
    ("at", "message"),
    [
        ("group:door", r"`at` must be a face group of the mesh \(it has none\), got 'door'"),
        ("part:door", r"`at` must be a part of the scene \(body, front.*, got 'door'"),
        ("500,500,500", r"`at` must lie near the shape, but 500,500,500 is 86\d.* away, more than the diagonal"),
        ((500, 500, 500), r"`at` must lie near the shape"),
        ("y>7", r"`at` must hold a vertex, but the side \(0, 1, 0\) · p ≥ 7 holds none of the mesh's 92"),
        ("ball:0,0,0,-1", r"`radius` must be above 0, got -1"),
        ("ball:0,0,0", r"`at` must be a vertex index, a point x,y,z, .* got 'ball:0,0,0'"),
        ("box:1,0,0,0,1,1", r"`low` must not exceed `high`, got \(1.0, 0.0, 0.0\) and \(0.0, 1.0, 1.0\)"),
        ("0,0", r"`at` must be 3 numbers, got shape \(2,\)"),
        ("0,0,nan", r"`at` must be finite"),
        ("92", r"`at` must lie in 0 … 91, got 92"),
        (np.array([5, 92]), r"`indices` must lie in 0 … 91, got 92"),
        (np.array([], int), r"`indices` must name at least one vertex"),
        (np.ones(91, bool), r"`indices` must have shape \(92,\), got \(91,\)"),
    ],
)
def test_what_holds_nothing_is_refused_in_one_clear_sentence(truck, at, message):
    with pytest.raises(ValueError, match=message) as caught:
        place_on(truck, at)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("normal", [(-1, 0, -2), (0.3, 0.7, 0.2), (1e-20, 1e-20, 0), (1, 1, 1)])
def test_a_side_of_a_plane_keeps_its_exact_values(normal):
    side = HalfSpace(normal, 0.3 * np.linalg.norm(normal))
    assert np.linalg.norm(side.normal) == pytest.approx(1)
    assert side.offset == pytest.approx(0.3)
    assert HalfSpace(side.normal, side.offset) == side


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: HalfSpace((0, 0, 0), 1), r"HalfSpace: `normal` must have a length, got \(0.0, 0.0, 0.0\)"),
        (lambda: HalfSpace((0, 0, 1), np.inf), r"HalfSpace: `offset` must be finite"),
        (lambda: HalfSpace((1e300, 0, 0), 1), r"HalfSpace: `normal` must be numbers of at most 1e\+38, got 1e\+300"),
        (lambda: Ball((0, 0, 0), 1e39), r"Ball: `radius` must be at most 1e\+38, got 1e\+39"),
        (lambda: Group(""), r"Group: `name` must be a text that is not empty, got ''"),
        (lambda: VertexSet([1, 1], [(0, 0, 0)] * 2), r"VertexSet: `indices` names vertex 1 more than once"),
        (lambda: VertexSet([1], [(0, 0, 1e39)]), r"VertexSet: `positions` must be numbers of at most 1e\+38"),
        (lambda: VertexSet([1, 2], [(0, 0, 0)]), r"VertexSet: `positions` must have shape \(2, 3\), got \(1, 3\)"),
    ],
)
def test_what_is_no_region_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_a_region_holds_the_places_whose_vertices_it_contains():
    mesh = grid(9)
    rows = HandleFeatures(mesh, field_of(mesh))
    whole, middle = (place_on(mesh, Box((-x, -1, 0), (x, 1, 1))) for x in (0.6, 0.3))
    corner = place_on(mesh, int(mesh.vertices[:, 0].argmin()))
    for place, other, held in (
        (whole, middle, True),
        (middle, whole, False),
        (whole, corner, True),
        (middle, corner, False),
        (whole, Place(tuple(mesh.vertices[3] + 1e-3)), False),  # a point in space has no vertex
        (corner, corner, False),  # no region
    ):
        assert rows.holds(place, other) == held


def test_a_set_lies_where_its_positions_are_up_to_a_hundred_thousandth_of_the_size(mesh):
    for size in (1e-9, 1.0, 1e9):
        own = dfd.Mesh(size * mesh.vertices, mesh.faces)
        chosen = VertexSet.of(own, [3, 17])
        for share, lies in ((0.9e-5, True), (1.1e-5, False)):
            moved = own.vertices.copy()
            moved[17] += (0, share * own.diagonal, 0)
            assert chosen.lies_on(dfd.Mesh(moved, mesh.faces)) == lies
        assert not chosen.lies_on(dfd.Mesh(own.vertices[:17], mesh.faces[:4]))


def test_a_negative_index_counts_from_the_end(mesh):
    count = len(mesh.vertices)
    assert place_on(mesh, -2) == place_on(mesh, count - 2)
    assert place_on(mesh, np.array([-2, 5])) == place_on(mesh, np.array([5, count - 2]))
    with pytest.raises(ValueError, match="`at` must lie in 0"):
        place_on(mesh, "-2")  # a text names a vertex of a file
