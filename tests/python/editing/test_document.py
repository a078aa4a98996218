"""Test that edits are equal after they are written and read, and the errors of invalid files."""

import copy
import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_field import field_of
from sheet import full_edit, grid

import dfd
from dfd.editing.controls import Controls
from dfd.editing.edit import Edit, Handle
from dfd.editing.edit_file import MadeOn, edit_schema, from_document, read_edit, read_made_on, to_document, write_edit
from dfd.editing.points import Place, place_on
from dfd.editing.regions import Box
from dfd.mesh.mesh import Mesh
from dfd.posing.transforms import Transform
from dfd.symmetry.plane import SymmetryPlane


@pytest.fixture(scope="module")
def mesh():
    return grid(9)


@pytest.fixture
def edit(mesh):
    return full_edit(mesh)


@pytest.fixture
def document(edit, mesh):
    return to_document(edit, mesh)


# --- files


def test_an_edit_comes_back_from_its_file_exactly(edit, mesh, tmp_path):
    path = tmp_path / "edit.json"
    write_edit(path, edit, mesh)
    assert read_edit(path, mesh) == edit


numbers = st.floats(-1e6, 1e6)
triples = st.tuples(numbers, numbers, numbers)
points = st.tuples(*[st.floats(-0.5, 0.5)] * 3)  # near the sheet
transforms = st.builds(Transform, triples, triples, triples, st.none() | triples)
controls = st.builds(
    Controls,
    st.just("part") | st.floats(0.01, 2),
    st.sampled_from(["linear", "smooth"]),
    st.floats(0, 1e3),
    strength=st.floats(0, 1),
    follow=st.sampled_from(["all", "mirror", "none"]),
    counterparts=st.sampled_from(["own_pivot", "shared_pivot"]),
    excluded_counterparts=st.lists(points.map(Place), max_size=3).map(tuple),
)


@given(
    handles=st.lists(
        st.tuples(points, transforms, controls, st.none() | st.text(st.characters(codec="utf-8"), min_size=1)),
        max_size=4,
        unique_by=lambda handle: handle[0],
    ),
    default=st.none() | transforms,
    angle=numbers,
    on_plane=st.integers(0, 80),
    band=st.floats(0, 10),
)
def test_any_edit_comes_back_from_its_text(mesh, tmp_path_factory, handles, default, angle, on_plane, band):
    normal = math.cos(angle), math.sin(angle), 0.0
    edit = Edit(
        tuple(Handle(i + 1, Place(place), *rest) for i, (place, *rest) in enumerate(handles)),
        symmetry=SymmetryPlane(normal, float(mesh.vertices[on_plane] @ normal), band=band),
        default=default,
    )
    path = tmp_path_factory.mktemp("any") / "edit.json"
    write_edit(path, edit, mesh)
    assert read_edit(path, mesh) == edit


def test_the_file_is_json_that_people_can_read(edit, mesh, tmp_path):
    path = tmp_path / "edit.json"
    write_edit(path, edit, mesh)
    text = path.read_text(encoding="utf-8")
    assert json.loads(text) == to_document(edit, mesh)
    assert '"translation": [0.0, 0.25, 0.0],\n' in text
    assert "ear, links ◔" in text


def test_a_short_document_by_hand_is_enough(mesh):
    edit = from_document(
        {"format": "dfd-edit", "version": 1, "handles": [{"vertex": 4, "scale": 2}, {"position": [0, 1, 2]}]}, mesh
    )
    assert edit == Edit(
        (Handle(1, place_on(mesh, 4), Transform(scale=(2.0, 2.0, 2.0))), Handle(2, Place((0.0, 1.0, 2.0))))
    )


def test_a_region_alone_is_a_place(mesh):
    box = {"kind": "box", "low": [-9, -9, -9], "high": [9, 9, 9]}
    said = {"format": "dfd-edit", "version": 1, "handles": [{"region": box}]}
    place = from_document(said, mesh).handles[0].place
    assert place.region == Box((-9, -9, -9), (9, 9, 9))
    np.testing.assert_allclose(place.position, mesh.bounds.mean(axis=0))


def test_missing_ids_are_given_around_those_that_are_there(mesh):
    handles = [{"vertex": 0}, {"vertex": 1, "id": 1}, {"vertex": 2}, {"vertex": 3, "id": 7}]
    edit = from_document({"format": "dfd-edit", "version": 1, "handles": handles}, mesh)
    assert [handle.id for handle in edit.handles] == [2, 1, 3, 7]


def test_a_quaternion_is_read_as_the_rotation_it_is(mesh):
    half = math.sqrt(0.5)
    entry = {"vertex": 4, "rotation": [0, half, 0, half]}
    edit = from_document({"format": "dfd-edit", "version": 1, "handles": [entry]}, mesh)
    np.testing.assert_allclose(edit.handles[0].transform.rotation, (0, 90, 0), atol=1e-12)


def test_a_byte_order_mark_does_no_harm(edit, mesh, tmp_path):
    path = tmp_path / "edit.json"
    path.write_text(json.dumps(to_document(edit, mesh)), encoding="utf-8-sig")
    assert read_edit(path, mesh) == edit


def test_the_schema_says_what_is_read_and_what_is_written(document):
    schema = edit_schema()
    assert schema == dfd.edit_schema()
    assert schema["additionalProperties"] is False
    assert set(schema["properties"]) == set(document)
    handle = schema["$defs"]["Handle"]
    assert set(handle["properties"]) == set(document["handles"][0])
    assert handle["properties"]["falloff"]["enum"][0] == "linear"
    assert handle["additionalProperties"] is False


# --- another mesh


def test_on_another_resolution_handles_stay_where_they_were(edit, mesh, document):
    finer = grid(33)
    with pytest.warns(UserWarning, match="on a mesh of 81 vertices, and this one has 1089: 4 of the edit's vertices"):
        moved = from_document(document, finer)
    for old, new in zip(edit.handles[:2], moved.handles[:2], strict=True):
        assert new == replace(old, place=Place(old.place.position))
    assert moved.fixed[0].place == Place(edit.fixed[0].place.position)
    assert moved.handles[2].place.region == edit.handles[2].place.region
    was, now = (each.handles[2].controls.excluded_counterparts for each in (edit, moved))
    assert now == tuple(Place(place.position) for place in was)
    assert moved.handles[2].place == place_on(finer, edit.handles[2].place.region)
    assert [fixed.place.region for fixed in moved.fixed] == [fixed.place.region for fixed in edit.fixed]


def test_an_edit_of_another_shape_is_refused(document):
    stranger = grid(33)
    stranger = Mesh(stranger.vertices * [1, 1, 2], stranger.faces)
    with pytest.raises(ValueError, match=r"`mesh.bounds` must be those of this mesh.*transfer transfers it"):
        from_document(document, stranger)
    with pytest.warns(UserWarning, match="are found by position"):
        accepted = from_document(document, stranger, other_shape=True)
    assert len(accepted.handles) == len(document["handles"])


def test_a_vertex_without_a_position_holds_only_for_its_own_mesh(mesh, document):
    document["handles"][0]["position"] = None
    other = Mesh(mesh.vertices * [1, 1, 1.001], mesh.faces)
    with pytest.raises(ValueError, match=r"`handles\[0\]` must have a position: the edit was made on another mesh"):
        from_document(document, other)


def test_a_vertex_that_still_lies_there_stays_a_vertex(edit, mesh, document):
    rounded = Mesh(mesh.vertices.astype(np.float32), mesh.faces)
    place = from_document(document, rounded).handles[0].place
    assert place == place_on(rounded, 40)


def test_the_same_number_of_vertices_in_another_order_is_noticed(mesh, document):
    order = np.arange(len(mesh.vertices))[::-1]
    backwards = Mesh(mesh.vertices[order], order.argsort()[mesh.faces])
    # In reverse order, vertex 40 of 81 has the same position, and vertices in the corners have others.
    with pytest.warns(UserWarning, match="3 of the edit's vertices or sets of vertices are found by position"):
        moved = from_document(document, backwards)
    assert moved.fixed[0].place.vertex is None
    assert moved.handles[0].place.vertex == 40
    np.testing.assert_array_equal(np.flatnonzero(moved.handles[2].place.region.inside(backwards)), [75, 76, 77])


# --- invalid documents


MISSING = object()


@pytest.mark.parametrize(
    ("keys", "value", "message"),
    [
        (("format",), "gltf", r'`format` must be "dfd-edit", got "gltf"'),
        (("format",), MISSING, r'`format` must be "dfd-edit", got null'),
        (("version",), 6, r"`version` must be 1, got 6"),
        (("version",), True, r"`version` must be 1, got true"),
        (("units",), {"length": "inch"}, r"`units.length` must be 'mesh', got .inch."),
        (("mesh", "vertices"), 0.5, r"`mesh.vertices` must be a whole number, got 0.5"),
        (("color",), 1, r"`color` is an unknown key"),
        (("handles", 0, "rotaton"), [0, 0, 0], r"`handles\[0\].rotaton` is an unknown key; known are id, name, .*"),
        (("handles", 0, "id"), 1, r"`handles` must have distinct ids, got 1 twice"),
        (("handles", 0, "translation"), None, r"`handles\[0\].translation` must be a list, got null"),
        (("handles", 0, "translation"), [0, math.nan, 0], r"`handles\[0\].translation\[1\]` must be a finite number"),
        (("handles", 0, "scale"), [1, 2], r"`handles\[0\].scale\[2\]` is missing in \[1, 2\]"),
        (("handles", 1, "position"), [0, 0, 1e39], r"`handles\[1\].position` must be numbers of at most 1e\+38"),
        (("handles", 1, "position"), [0, 0, 1e6], r"`handles\[1\]` must lie near the shape, but 0,0,1e\+06 is"),
        (
            ("handles", 2, "excluded_counterparts", 1, "position"),
            [7, 0, 0],
            r"`handles\[2\].excluded_counterparts\[1\]` must lie near the shape, but 7,0,0 is",
        ),
        (("symmetry", "offset"), 1e308, r"`symmetry.offset` must be at most 1e\+38, got 1e\+308"),
        (("symmetry", "offset"), -1.5, r"`symmetry` must cut the shape, but all vertices lie 1 to 2 from it"),
        (("default", "scale"), [1, 1e39, 1], r"`default.scale` must be numbers of at most 1e\+38, got 1,1e\+39,1"),
        (("x" * 100_000,), 1, r"`x{199}…` is an unknown key"),
        (("handles", 0, "two\nlines"), 1, r"`handles\[0\].two lines` is an unknown key"),
        (("handles", 1, "position"), None, r"`handles\[1\]` must have a vertex, a position or a region"),
        (("handles", 0, "reach"), "far", r"`handles\[0\].reach` must be 'part', got .far."),
        (("handles", 0, "falloff"), "steep", r"`handles\[0\].falloff` must be 'linear', .*, got .steep."),
        (
            ("handles", 0, "radius"),
            0.5,
            r"`handles\[0\].radius` and `locality` must not be given both, got 0.5 and 2.5",
        ),
        (
            ("handles", 2, "excluded_counterparts", 0, "vertex"),
            -4,
            r"`handles\[2\].excluded_counterparts\[0\].vertex` must be a whole number of at least 0, got -4",
        ),
        (("handles", 2, "region", "kind"), "cone", r"`handles\[2\].region.kind` must be one of 'ball', .*, got 'cone'"),
        (("handles", 2, "mask", "radius"), -1, r"`handles\[2\].mask.radius` must be above 0, got -1"),
        (("handles", 2, "mask", "radius"), 1e-9, r"`handles\[2\].mask` must hold a vertex, but the ball"),
        (("fixed", 0, "locality"), 1, r"`fixed\[0\].locality` is an unknown key"),
        (("symmetry", "normal"), [1, 1, 0], r"`symmetry.normal` must have length 1, got 1.41421"),
        (("default", "locality"), 0, r"`default.locality` is an unknown key"),
        (("default", "bend"), [0, 0, 9], r"`default.bend` is an unknown key; known are translation, .*, axes$"),
    ],
)
def test_every_odd_value_is_named(document, mesh, keys, value, message):
    changed = copy.deepcopy(document)
    entry = changed
    for key in keys[:-1]:
        entry = entry[key]
    if value is MISSING:
        del entry[keys[-1]]
    else:
        entry[keys[-1]] = value
    with pytest.raises(ValueError, match=message) as caught:
        from_document(changed, mesh, name="some.json")
    assert str(caught.value).startswith("some.json: ")
    assert len(str(caught.value).splitlines()) == 1
    assert len(str(caught.value)) < 800


def test_an_index_out_of_range_is_named(mesh):
    document = {"format": "dfd-edit", "version": 1, "fixed": [{"vertex": 81}]}
    with pytest.raises(ValueError, match=r"`fixed\[0\].vertex` must lie in 0 … 80, got 81"):
        from_document(document, mesh)


# --- invalid files


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no whole JSON document: Expecting value: line 1 column 1"),
        ("{}", "`format` must be"),
        ('{"version": 1, "version": 1}', "`version` is given twice"),
        ('{"format": "dfd-edit", "version": NaN}', "`version` must be 1, got NaN"),
        ("[" * 100_000, "nested too deeply|no whole JSON document"),
    ],
)
def test_odd_files_are_refused_in_the_name_of_their_path(mesh, tmp_path, text, message):
    path = tmp_path / "odd.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=message) as caught:
        read_edit(path, mesh)
    assert str(caught.value).startswith(f"{path}: ")


def test_a_missing_file_and_a_folder_are_named(mesh, tmp_path):
    for path in (tmp_path / "none.json", tmp_path):
        with pytest.raises(OSError, match=f"{re.escape(str(path))}: the edit could not be read"):
            read_edit(path, mesh)


def test_bytes_that_are_no_text_are_refused_with_the_place_of_the_first(mesh, tmp_path):
    path = tmp_path / "bytes.json"
    path.write_bytes(b'{"format": "\xff"}')
    with pytest.raises(ValueError, match=f"{re.escape(str(path))}: an edit must be UTF-8 text, but byte 12 is not"):
        read_edit(path, mesh)


# --- the files on which an edit was made


def test_a_file_names_the_mesh_and_the_field_relative_to_its_folder(edit, mesh, tmp_path):
    mesh.save(tmp_path / "shape.ply")
    field_of(mesh).save(tmp_path / "near.safetensors")
    (tmp_path / "edits").mkdir()
    shape, field = dfd.load(tmp_path / "shape.ply"), dfd.Field.load(tmp_path / "near.safetensors")
    for path, expected in (("one.json", "shape.ply"), ("edits/one.json", str(tmp_path.resolve() / "shape.ply"))):
        write_edit(tmp_path / path, edit, shape, field)
        made_on = json.loads((tmp_path / path).read_text())["made_on"]
        assert made_on["mesh"] == expected
        assert made_on["field"] == expected.replace("shape.ply", "near.safetensors")
        assert read_made_on(tmp_path / path)[0].samefile(tmp_path / "shape.ply")
        assert made_on["field_sha256"] == read_made_on(tmp_path / path)[2] == field.source.sha256


def test_a_mesh_from_memory_and_names_that_are_no_text_are_left_out(edit, mesh, tmp_path):
    field_of(mesh).save(tmp_path / "near.safetensors")
    write_edit(tmp_path / "one.json", edit, mesh, dfd.Field.load(tmp_path / "near.safetensors"))
    assert json.loads((tmp_path / "one.json").read_text())["made_on"]["mesh"] is None
    write_edit(tmp_path / "one.json", edit, mesh, made_on=MadeOn("odd\udc80.ply", "near.safetensors"))
    made_on = json.loads((tmp_path / "one.json").read_text())["made_on"]
    assert (made_on["mesh"], Path(made_on["field"]).name) == (None, "near.safetensors")
    assert read_made_on(tmp_path / "one.json")[0] is None


def test_the_files_of_an_edit_are_known_without_its_mesh(tmp_path):
    plane = {"normal": [1, 0, 0], "offset": 0}
    made_on = {"mesh": "cow.glb"}
    document = {"format": "dfd-edit", "version": 1, "symmetry": plane, "made_on": made_on}
    (tmp_path / "edit.json").write_text(json.dumps(document))
    assert read_made_on(tmp_path / "edit.json") == (tmp_path / "cow.glb", None, None)
