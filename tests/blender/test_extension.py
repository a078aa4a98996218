"""Test the extension as Blender installs it: from its ZIP file, which contains the wheels."""

import os
import shutil
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest

MODULE = "bl_ext.user_default.dfd_weights"


@pytest.fixture(scope="session", autouse=True)
def _installed() -> None:
    bpy.ops.extensions.package_install_files(
        filepath=os.environ["DFD_EXTENSION"], repo="user_default", enable_on_install=True
    )
    assert MODULE in bpy.context.preferences.addons


@pytest.fixture(scope="session")
def field_file(tmp_path_factory) -> Path:
    """Return the file of a field with random parameters, for a shape in the box [-1, 1]³."""
    import dfd
    from dfd.field.architecture import Architecture

    random = np.random.default_rng(0)
    parameters = {
        name: (random.standard_normal(shape) / np.sqrt(shape[-1])).astype(np.float32)
        for name, shape in Architecture(8, 32, 2, 4).shapes().items()
    }
    path = tmp_path_factory.mktemp("field") / "ball.field.safetensors"
    dfd.Field(parameters, octaves=4).save(path)
    return path


@pytest.fixture
def ball() -> bpy.types.Object:
    """Return an egg-shaped object inside the field's box, longest along Blender's z axis."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.preferences.addon_enable(module=MODULE)
    bpy.ops.mesh.primitive_uv_sphere_add(segments=24, ring_count=16, radius=1)
    of = bpy.context.object
    for vertex in of.data.vertices:
        vertex.co.x *= 0.5
        vertex.co.y *= 0.6 if vertex.co.y > 0 else 0.5
    for each in (*of.data.vertices, *of.data.edges, *of.data.polygons):
        each.select = False
    return of


def coordinates(of: bpy.types.Object) -> np.ndarray:
    found = np.empty((len(of.data.vertices), 3), np.float32)
    of.data.vertices.foreach_get("co", found.ravel())
    return found.astype(float)


def group_weights(of: bpy.types.Object, name: str) -> np.ndarray:
    index = of.vertex_groups[name].index
    found = np.zeros(len(of.data.vertices))
    for vertex in of.data.vertices:
        for each in vertex.groups:
            if each.group == index:
                found[vertex.index] = each.weight
    return found


def expected(of: bpy.types.Object, field_file: Path, vertex: int, **how) -> np.ndarray:
    import dfd

    return weights(dfd.Field.load(field_file), coordinates(of), vertex, **how)


def weights(field, vertices, vertex: int, reach: float | None = None, falloff: str | None = None) -> np.ndarray:
    """Return the weights (V,) of a handle on `ball`, by default those of a shape without parts."""
    import dfd
    from dfd.editing.presets import PARTLESS_REACH, PRESETS

    falloff = falloff or PRESETS["default"].falloff
    return dfd.bind(field(vertices), [vertex], reach=reach or PARTLESS_REACH, falloff=falloff)[:, 0]


def triangles(of: bpy.types.Object) -> np.ndarray:
    of.data.calc_loop_triangles()
    found = np.empty((len(of.data.loop_triangles), 3), np.int32)
    of.data.loop_triangles.foreach_get("vertices", found.ravel())
    return found


def select(of: bpy.types.Object, *vertices: int) -> None:
    for vertex in vertices:
        of.data.vertices[vertex].select = True


def test_each_selected_vertex_gets_a_group_of_its_weights(ball, field_file):
    ball.dfd.axes, ball.dfd.field = "SAME", str(field_file)
    select(ball, 3, 40)
    assert bpy.ops.dfd.weigh() == {"FINISHED"}
    assert [handle.vertex for handle in ball.dfd.handles] == [3, 40]
    for handle in ball.dfd.handles:
        np.testing.assert_allclose(
            group_weights(ball, handle.name), expected(ball, field_file, handle.vertex), atol=1e-6
        )
        assert group_weights(ball, handle.name)[handle.vertex] == 1


def test_sliders_weigh_anew(ball, field_file):
    import dfd

    ball.dfd.axes, ball.dfd.field = "SAME", str(field_file)
    select(ball, 7)
    bpy.ops.dfd.weigh()
    (handle,) = ball.dfd.handles
    before = group_weights(ball, handle.name)
    handle.reach_part, handle.reach, handle.falloff = False, 0.4, "sharp"
    wanted = expected(ball, field_file, 7, reach=handle.reach, falloff="sharp")
    np.testing.assert_allclose(group_weights(ball, handle.name), wanted, atol=1e-6)
    assert (wanted < before - 0.05).any()
    handle.locality = 3
    mesh = dfd.Mesh(coordinates(ball), triangles(ball))
    wanted = wanted * (1 - dfd.Geodesics(mesh).distances([7])[0]) ** 3
    np.testing.assert_allclose(group_weights(ball, handle.name), wanted, atol=1e-5)


def test_a_preset_sets_reach_and_falloff_of_every_handle(ball, field_file):
    ball.dfd.axes, ball.dfd.field = "SAME", str(field_file)
    select(ball, 7)
    bpy.ops.dfd.weigh()
    ball.dfd.preset = "paper"
    bpy.ops.dfd.weigh()
    wanted = expected(ball, field_file, 7, reach=1.0, falloff="linear")
    for handle in ball.dfd.handles:
        np.testing.assert_allclose(group_weights(ball, handle.name), wanted, atol=1e-6)
    assert np.abs(wanted - expected(ball, field_file, 7)).max() > 0.01


def test_a_file_that_blender_turned_finds_its_field(ball, field_file, tmp_path):
    """In glTF y is up, and in Blender z is up. The field has the coordinates of the file."""
    import dfd

    field = dfd.Field.load(field_file)
    of_file = coordinates(ball)[:, [0, 2, 1]] * [1, 1, -1]
    low, high = of_file.min(axis=0), of_file.max(axis=0)
    turned = dfd.Field(field.parameters, octaves=4, center=(low + high) / 2, scale=2 / (high - low).max())
    turned.save(tmp_path / "turned.field.safetensors")
    ball.dfd.field = str(tmp_path / "turned.field.safetensors")
    select(ball, 11)
    bpy.ops.dfd.weigh()
    wanted = weights(turned, of_file, 11)
    np.testing.assert_allclose(group_weights(ball, "dfd 11"), wanted, atol=1e-6)


def test_the_group_whose_slider_moved_is_the_active_one(ball, field_file):
    ball.dfd.axes, ball.dfd.field = "SAME", str(field_file)
    select(ball, 3, 40)
    bpy.ops.dfd.weigh()
    assert ball.vertex_groups.active.name == "dfd 40"
    ball.dfd.handles[0].reach = 0.7
    assert ball.vertex_groups.active.name == "dfd 3"
    ball.dfd.field = ""
    assert ball.vertex_groups.active.name == "dfd 3"


def test_edit_mode_is_left_as_it_was(ball, field_file):
    ball.dfd.axes, ball.dfd.field = "SAME", str(field_file)
    select(ball, 5)
    bpy.ops.object.mode_set(mode="EDIT")
    assert bpy.ops.dfd.weigh() == {"FINISHED"}
    assert ball.mode == "EDIT"
    bpy.ops.object.mode_set(mode="OBJECT")
    assert group_weights(ball, "dfd 5").max() == 1


def test_a_moved_mesh_is_weighed_as_it_is_now(ball, field_file):
    ball.dfd.axes, ball.dfd.field = "SAME", str(field_file)
    select(ball, 5)
    bpy.ops.dfd.weigh()
    for vertex in ball.data.vertices:
        vertex.co.z *= 0.8
    ball.dfd.handles[0].reach_part, ball.dfd.handles[0].reach = False, 0.9
    np.testing.assert_allclose(
        group_weights(ball, "dfd 5"), expected(ball, field_file, 5, reach=ball.dfd.handles[0].reach), atol=1e-6
    )


def test_removed_handles_take_their_group_along(ball, field_file):
    ball.dfd.axes, ball.dfd.field = "SAME", str(field_file)
    select(ball, 5, 9)
    bpy.ops.dfd.weigh()
    bpy.ops.dfd.remove(index=0)
    assert [group.name for group in ball.vertex_groups] == ["dfd 9"]
    with pytest.raises(RuntimeError, match="There is no handle 4"):
        bpy.ops.dfd.remove(index=4)


class Session:
    """The edit of a session, computed by the modules that need no package that Blender lacks."""

    def __init__(self, of: bpy.types.Object, field_file: Path) -> None:
        import dfd
        from dfd.editing.edit import Edit
        from dfd.editing.weights.session_weights import SessionWeights

        self.field = dfd.Field.load(field_file)
        self.mesh = dfd.Mesh(coordinates(of), triangles(of))
        self.bound, self.edit = SessionWeights(self.mesh, self.field), Edit()

    def add(self, at, name=None, **given) -> None:
        from dfd.editing.verbs import add

        self.edit = add(self.edit, self.bound, len(self.edit.handles) + 1, at, name=name, **given)

    def move(self, handle: int, **given) -> None:
        from dfd.editing.verbs import move

        self.edit = move(self.edit, self.bound, handle, given)

    def change(self, handle: int, **controls) -> None:
        from dfd.editing.verbs import change

        self.edit = change(self.edit, self.bound, handle, None, None, controls)

    @property
    def vertices(self) -> np.ndarray:
        from dfd.editing.shape import PosedShape

        return PosedShape(self.bound).of(self.edit)

    @property
    def weights(self) -> np.ndarray:
        from dfd.editing.weights.of_handles import weights_of

        return weights_of(self.bound, self.edit)

    def save(self, path: Path) -> None:
        from dfd.editing.edit_file import write_edit

        write_edit(path, self.edit, self.mesh, self.field)


@pytest.fixture
def session(ball, field_file) -> Session:
    """Return an edit of the ball with a handle at a vertex, one at a region, a fixed point and two key poses."""
    from dfd.editing.edit import Fixed
    from dfd.editing.key_pose import KeyPose
    from dfd.editing.points import place_on
    from dfd.posing.transforms import Transform

    session = Session(ball, field_file)
    session.add(7, reach=0.4, falloff="sharp", translation=(0, 0, 0.5), name="tip")
    session.add(np.arange(30, 34), reach=0.02, rotation=(0, 0, 40))
    poses = (KeyPose(0.5, {1: Transform(translation=(0.4, 0, 0))}, "left"), KeyPose(1.5))
    session.edit = replace(session.edit, fixed=(Fixed(place_on(session.mesh, 200)),), poses=poses)
    return session


@pytest.fixture
def edit_file(session, tmp_path) -> Path:
    session.save(tmp_path / "ball.json")
    return tmp_path / "ball.json"


def key(of: bpy.types.Object, name: str) -> np.ndarray:
    points = of.data.shape_keys.key_blocks[name].points
    found = np.empty((len(points), 3), np.float32)
    points.foreach_get("co", found.ravel())
    return found.astype(float)


def test_an_edit_file_becomes_groups_and_shape_keys(ball, field_file, session, edit_file):
    ball.dfd.axes, ball.dfd.field = "SAME", str(field_file)
    assert bpy.ops.dfd.apply(filepath=str(edit_file)) == {"FINISHED"}
    assert [handle.name for handle in ball.dfd.handles] == ["tip", "dfd handle 2"]
    assert ball.dfd.handles[0].vertex == 7
    for column, handle in enumerate(ball.dfd.handles):
        np.testing.assert_allclose(group_weights(ball, handle.name), session.weights[:, column], atol=1e-6)
    np.testing.assert_allclose(key(ball, "dfd edit"), session.vertices, atol=1e-6)
    assert not ball.dfd.handles[0].reach_part
    assert ball.dfd.handles[0].reach == pytest.approx(0.4)
    assert ball.dfd.handles[1].reach == pytest.approx(0.02)
    assert ball.dfd.handles[0].falloff == "sharp"


def test_key_poses_are_animated(ball, field_file, session, edit_file):
    ball.dfd.axes, ball.dfd.field = "SAME", str(field_file)
    bpy.context.scene.render.fps = 24
    bpy.ops.dfd.apply(filepath=str(edit_file))
    session.move(1, translation=(0.4, 0, 0))
    session.move(2, rotation=(0, 0, 0))
    rest = coordinates(ball)
    for frame, shown in ((0, 1), (12, 1), (18, 0.75), (24, 0.5), (36, 0), (50, 0)):
        bpy.context.scene.frame_set(frame)
        evaluated = ball.evaluated_get(bpy.context.evaluated_depsgraph_get())
        np.testing.assert_allclose(coordinates(evaluated), rest + shown * (session.vertices - rest), atol=1e-5)


def test_sliders_of_an_edit_change_its_pose(ball, field_file, session, edit_file):
    ball.dfd.axes, ball.dfd.field = "SAME", str(field_file)
    bpy.ops.dfd.apply(filepath=str(edit_file))
    ball.dfd.handles[0].reach = 0.8
    session.change(1, reach=ball.dfd.handles[0].reach)
    np.testing.assert_allclose(key(ball, "dfd edit"), session.vertices, atol=1e-6)
    np.testing.assert_allclose(group_weights(ball, "tip"), session.weights[:, 0], atol=1e-6)
    bpy.ops.dfd.remove(index=1)
    session.edit = session.edit.removed(2)
    np.testing.assert_allclose(key(ball, "dfd edit"), session.vertices, atol=1e-6)
    assert [group.name for group in ball.vertex_groups] == ["tip"]


def test_another_edit_replaces_the_first_one(ball, field_file, session, edit_file):
    ball.dfd.axes, ball.dfd.field = "SAME", str(field_file)
    select(ball, 3)
    bpy.ops.dfd.weigh()
    bpy.ops.dfd.apply(filepath=str(edit_file))
    session.edit = replace(session.edit.removed(2), poses=())
    session.save(edit_file)
    bpy.ops.dfd.apply(filepath=str(edit_file))
    assert [group.name for group in ball.vertex_groups] == ["dfd 3", "tip"]
    assert [each.name for each in ball.data.shape_keys.key_blocks] == ["Basis", "dfd edit"]
    assert ball.data.shape_keys.key_blocks["dfd edit"].value == 1
    evaluated = ball.evaluated_get(bpy.context.evaluated_depsgraph_get())
    np.testing.assert_allclose(coordinates(evaluated), session.vertices, atol=1e-5)


def test_an_edit_brings_its_field(ball, field_file, edit_file):
    ball.dfd.axes = "SAME"
    assert bpy.ops.dfd.apply(filepath=str(edit_file)) == {"FINISHED"}
    assert Path(ball.dfd.field) == field_file


def test_an_edit_that_cannot_be_read_changes_nothing(ball, field_file, edit_file, tmp_path):
    ball.dfd.axes, ball.dfd.field = "SAME", str(field_file)
    with pytest.raises(RuntimeError, match=r"none\.json"):
        bpy.ops.dfd.apply(filepath=str(tmp_path / "none.json"))
    broken = tmp_path / "broken.json"
    broken.write_text(edit_file.read_text().replace('"version": 1', '"version": 99'))
    with pytest.raises(RuntimeError, match="version"):
        bpy.ops.dfd.apply(filepath=str(broken))
    assert not ball.vertex_groups
    assert not ball.dfd.handles
    assert ball.data.shape_keys is None


def test_what_is_missing_is_said_and_nothing_is_left(ball, field_file, tmp_path):
    select(ball, 5)
    with pytest.raises(RuntimeError, match="Choose a field, or distill one"):
        bpy.ops.dfd.weigh()
    ball.dfd.field = str(tmp_path / "none.field.safetensors")
    with pytest.raises(RuntimeError, match=r"none\.field"):
        bpy.ops.dfd.weigh()
    ball.dfd.axes, ball.dfd.field = "SAME", str(field_file)
    ball.data.vertices[5].select = False
    with pytest.raises(RuntimeError, match="Select at least one vertex"):
        bpy.ops.dfd.weigh()
    for vertex in ball.data.vertices:
        vertex.co *= 100
    select(ball, 5)
    with pytest.raises(RuntimeError, match="must belong to this mesh"):
        bpy.ops.dfd.weigh()
    assert not ball.vertex_groups
    assert not ball.dfd.handles


def test_a_slider_without_a_field_says_so_beside_it(ball, field_file):
    ball.dfd.axes, ball.dfd.field = "SAME", str(field_file)
    select(ball, 5)
    bpy.ops.dfd.weigh()
    before = group_weights(ball, "dfd 5")
    ball.dfd.field = ""
    assert "Choose a field" in ball.dfd.handles[0].note
    np.testing.assert_array_equal(group_weights(ball, "dfd 5"), before)
    ball.dfd.field = str(field_file)
    assert not ball.dfd.handles[0].note


@pytest.mark.skipif("DFD_COMMAND" not in os.environ, reason="DFD_COMMAND is to be the path of dfd")
def test_a_field_is_distilled_by_a_process(ball, tmp_path):
    import dfd

    ball.location = (5, 0, 0)
    bpy.context.preferences.addons[MODULE].preferences.command = os.environ["DFD_COMMAND"]
    path = tmp_path / "egg.field.safetensors"
    small = "--views 4 --resolution 112 --steps 20 --no-cache"
    assert bpy.ops.dfd.distill(output=str(path), options=small) == {"FINISHED"}
    field = dfd.Field.load(path)
    center = coordinates(ball)
    np.testing.assert_allclose(field.center, (center.min(axis=0) + center.max(axis=0)) / 2, atol=1e-5)
    assert ball.dfd.field == str(path)
    select(ball, 5)
    bpy.ops.dfd.weigh()
    assert group_weights(ball, "dfd 5")[5] == 1
    assert [each.name for each in bpy.data.objects] == [ball.name]


def test_a_command_that_is_not_there_or_fails_is_told(ball, tmp_path):
    preferences = bpy.context.preferences.addons[MODULE].preferences
    preferences.command = str(tmp_path / "nothing")
    with pytest.raises(RuntimeError, match="did not start"):
        bpy.ops.dfd.distill(output=str(tmp_path / "x.field.safetensors"))
    preferences.command = shutil.which("false")
    with pytest.raises(RuntimeError, match="no output"):
        bpy.ops.dfd.distill(output=str(tmp_path / "x.field.safetensors"))
    assert not list(tmp_path.iterdir())
