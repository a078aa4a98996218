"""Test component residuals: overlapping components have different features, and other meshes have no residuals."""

import pickle

import numpy as np
import pytest
from made_field import made_field
from safetensors.numpy import load_file, save_file

import dfd
from dfd.distillation.fit import fit_component_residuals
from dfd.distillation.targets import PointTargets
from dfd.field.component_residuals import ComponentResiduals, components_of_vertices

WIDTH = 12


def shells(detail=12):
    """Return two open tubes around one axis, one just inside the other, like a sleeve and an arm."""
    turn = np.linspace(0, 2 * np.pi, detail, endpoint=False)
    height = np.linspace(-1, 1, detail)
    vertices, faces = [], []
    for tube, radius in enumerate((0.30, 0.29)):
        ring = np.stack([radius * np.cos(turn), np.zeros(detail), radius * np.sin(turn)], axis=1)
        vertices += [ring + [0, each * (1 - 0.03 * tube), 0] for each in height]
        for row in range(detail - 1):
            for at in range(detail):
                corners = [(tube * detail + row + up) * detail + (at + on) % detail for up in (0, 1) for on in (0, 1)]
                faces += [[corners[0], corners[2], corners[1]], [corners[1], corners[2], corners[3]]]
    return dfd.Mesh(np.concatenate(vertices), np.array(faces))


def kept(mesh):
    """Return a field with residuals, and its target features: each tube has a unit vector of its own."""
    component, boxes = components_of_vertices(mesh)
    wanted = np.eye(WIDTH, dtype=np.float32)[component]
    field = made_field(dimension=WIDTH, width=16, layers=2, octaves=2, scale=1.0)
    targets = PointTargets(mesh.vertices.astype(np.float32), wanted, None, component, boxes)
    return fit_component_residuals(field, targets), wanted


def test_overlapping_components_have_different_features():
    mesh = shells()
    field, wanted = kept(mesh)
    network = field(mesh.vertices)
    features = field.features(mesh)
    np.testing.assert_allclose(np.linalg.norm(features, axis=1), 1, atol=1e-5)
    assert (features * wanted).sum(axis=1).min() > 0.95
    # A component with n points has n / (n + 10) of what the network misses.
    count = np.bincount(wanted.argmax(axis=1))[wanted.argmax(axis=1), None]
    np.testing.assert_allclose(field.residuals.differences, (wanted - network) * count / (count + 10), atol=1e-3)
    assert (network * wanted).sum(axis=1).max() < 0.9  # the network alone does not separate the tubes
    assert field.with_residuals(None).features(mesh).tobytes() == network.tobytes()
    np.testing.assert_allclose(field.on(mesh).at(mesh.vertices + 1e-5), features, atol=1e-3)
    np.testing.assert_array_equal(field.with_residuals(None).on(mesh).at(mesh.vertices), network)
    placed = dfd.Field(field.parameters, octaves=2, center=(3, 1, 0), scale=0.5, residuals=field.residuals)
    larger = dfd.Mesh(2 * mesh.vertices + [3, 1, 0], mesh.faces)
    np.testing.assert_allclose(placed.features(larger), features, atol=1e-4)
    np.testing.assert_allclose(placed.on(larger).at(larger.vertices), features, atol=1e-4)


def test_a_handle_moves_only_its_own_component():
    mesh = shells()
    field, _ = kept(mesh)
    half = len(mesh.vertices) // 2
    session = dfd.Deformer(mesh, field)
    session.add(5, translation=(0, 0.2, 0), reach=1.0, falloff="linear", counterparts="shared_pivot")
    assert session.weights[5, 0] == 1
    assert session.weights[:half].min() > 0.6
    assert session.weights[half:].max() < 0.2


def test_residuals_apply_to_other_resolutions_and_not_to_other_shapes():
    field, _ = kept(shells())
    finer = shells(31)
    component, _ = components_of_vertices(finer)
    assert (field.features(finer) * np.eye(WIDTH)[component]).sum(axis=1).min() > 0.9
    np.testing.assert_array_equal(field.residuals.known(field.residuals.boxes + 0.015), [0, 1])
    np.testing.assert_array_equal(field.residuals.known(field.residuals.boxes + 0.025), [-1, -1])
    for count in (0, 1):
        few = ComponentResiduals(
            field.residuals.boxes[:count], np.zeros((count, 3)), range(count), np.zeros((count, 1))
        )
        np.testing.assert_array_equal(few.known(field.residuals.boxes), [[-1, -1], [0, -1]][count])
        np.testing.assert_array_equal(few.known(np.zeros((0, 6))), np.zeros(0, int))
    moved = dfd.Mesh(finer.vertices + [0.5, 0, 0], finer.faces)
    assert field.features(moved).tobytes() == field(moved.vertices).tobytes()


def test_residuals_are_continuous():
    random = np.random.default_rng(0)
    points = random.uniform(-1, 1, (300, 3)).astype(np.float32)
    differences = random.normal(size=(300, WIDTH)).astype(np.float16)
    pieces = ComponentResiduals(np.array([[-1, -1, -1, 1, 1, 1]]), points, np.zeros(300, np.int32), differences)
    steps = 20_000
    line = np.linspace([-0.9, -0.8, -0.7], [0.9, 0.7, 0.8], steps)
    rows = np.tile(np.eye(WIDTH, dtype=np.float32)[0] * 1, (steps, 1))
    told = pieces.add_residuals(rows, line, np.zeros(steps, np.int64))
    assert np.linalg.norm(np.diff(told, axis=0), axis=1).max() < 0.02
    np.testing.assert_array_equal(rows, np.tile(np.eye(WIDTH)[0], (steps, 1)))  # the inputs stay unchanged
    assert pieces.add_residuals(rows, line, np.full(steps, -1)).tobytes() == rows.tobytes()


@pytest.mark.parametrize(("count", "others"), [(1, 30), (8, 30), (30, 30), (30, 0)])
def test_a_residual_is_a_mean_of_the_nearest_samples_on_the_own_component(count, others):
    random = np.random.default_rng(count)
    points = random.uniform(-1, 1, (count + others, 3)).astype(np.float32)
    component = np.repeat([1, 0], [count, others])
    differences = random.normal(size=(len(points), WIDTH)).astype(np.float16)
    residuals = ComponentResiduals(random.random((2, 6)), points, component, differences)
    places = np.concatenate([random.uniform(-1, 1, (20, 3)), points[:1]])
    rows = np.tile(np.eye(WIDTH, dtype=np.float32)[0], (len(places), 1))
    found = residuals.add_residuals(rows, places, np.ones(len(places), np.int64))
    for place, row in zip(places, found, strict=True):
        distances = np.linalg.norm(points[:count] - place, axis=1)
        nearest = distances.argsort()[:9]
        end = distances[nearest[8]] if count > 8 else max(2 * distances[nearest[-1]], 1e-9)
        shares = np.square(1 - distances[nearest[:8]] / end)
        wanted = np.eye(WIDTH)[0] + shares @ differences[nearest[:8]].astype(np.float64) / shares.sum()
        np.testing.assert_allclose(row, wanted / np.linalg.norm(wanted), atol=1e-5)


@pytest.mark.parametrize("at", [(0, 0, 0), (9, 0, 0)])
def test_where_residuals_say_nothing_the_feature_of_the_network_stays(at):
    """Nine samples at one distance say the same, residuals can cancel a feature, and components can have no samples."""
    points = [(x * a, y * b, 0) for a, b in ((3, 4), (4, 3)) for x in (-1, 1) for y in (-1, 1)] + [(5, 0, 0)]
    rows = np.eye(WIDTH, dtype=np.float32)[:1]
    cancelling = ComponentResiduals(np.zeros((2, 6)), points, np.zeros(9, int), np.tile(-rows, (9, 1)))
    for component in (0, 1):
        np.testing.assert_array_equal(cancelling.add_residuals(rows, np.array([at]), np.array([component])), rows)
    turning = ComponentResiduals(np.zeros((1, 6)), points, np.zeros(9, int), np.tile(np.eye(WIDTH)[1], (9, 1)))
    wanted = (np.eye(WIDTH)[:1] + np.eye(WIDTH)[1]) / np.sqrt(2)
    np.testing.assert_allclose(turning.add_residuals(rows, np.array([at]), np.array([0])), wanted, atol=1e-6)


def test_components_join_seams_and_leave_out_vertices_without_faces():
    vertices = [
        [0, 0, 0],
        [1, 0, 0],
        [0, 1, 0],
        [1, 0, 0],
        [0, 1, 0],
        [1, 1, 0],
        [5, 5, 5],
        [6, 5, 5],
        [5, 6, 5],
        [9, 9, 9],
    ]
    component, boxes = components_of_vertices(dfd.Mesh(vertices, [[0, 1, 2], [3, 5, 4], [6, 7, 8]]))
    np.testing.assert_array_equal(component, [0, 0, 0, 0, 0, 0, 1, 1, 1, -1])
    np.testing.assert_array_equal(boxes, [[0, 0, 0, 1, 1, 0], [5, 5, 5, 6, 6, 5]])


def test_a_file_keeps_residuals_and_equal_fields_give_equal_files(tmp_path):
    mesh = shells()
    field, _ = kept(mesh)
    field.save(tmp_path / "one.safetensors")
    again = dfd.Field.load(tmp_path / "one.safetensors")
    again.save(tmp_path / "two.safetensors")
    assert (tmp_path / "one.safetensors").read_bytes() == (tmp_path / "two.safetensors").read_bytes()
    assert again.features(mesh).tobytes() == field.features(mesh).tobytes()
    assert pickle.loads(pickle.dumps(field)).features(mesh).tobytes() == field.features(mesh).tobytes()
    field.with_residuals(None).save(tmp_path / "plain.safetensors")
    assert dfd.Field.load(tmp_path / "plain.safetensors").residuals is None


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("residuals.points", lambda array: array[:-1], "must have"),
        ("residuals.component", lambda array: array + 1000, "component"),
        ("residuals.boxes", lambda array: array[:, :5], "boxes"),
        ("residuals.differences", lambda array: array * np.float16(np.nan), "finite"),
        ("residuals.differences", lambda array: array[:, :3].copy(), "12 wide"),
        ("residuals.differences", lambda array: array[:, :, None].repeat(2, axis=2), "must have a row for each of the"),
        ("residuals.boxes", lambda array: None, "'boxes'"),
    ],
)
def test_damaged_residuals_are_refused(tmp_path, name, change, said):
    from safetensors import safe_open

    field, _ = kept(shells())
    path = tmp_path / "field.safetensors"
    field.save(path)
    arrays = load_file(path)
    with safe_open(path, "numpy") as opened:
        metadata = opened.metadata()
    changed = change(arrays.pop(name))
    save_file(arrays if changed is None else {**arrays, name: np.ascontiguousarray(changed)}, path, metadata)
    with pytest.raises(ValueError, match=r"Field\.load: `path`") as raised:
        dfd.Field.load(path)
    assert said in str(raised.value)
