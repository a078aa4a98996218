"""Edits as values and as JSON documents: what survives a file, and what a file must not hold."""

import copy
import json
import math
import os
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dfd.editing.edit import Edit, Handle, Place, Transform, place_on, symmetry_on
from dfd.editing.edit_file import from_document, read_edit, to_document, write_edit
from dfd.editing.history import History
from dfd.mesh.mesh import Mesh
from dfd.symmetry.plane import SymmetryPlane


def grid(size):
    """A wavy sheet of size × size vertices over the unit square, centred on x = 0."""
    x, z = (axis.ravel() for axis in np.meshgrid(np.linspace(-0.5, 0.5, size), np.linspace(0, 1, size)))
    corner = (np.arange(size - 1)[:, None] * size + np.arange(size - 1)).ravel()
    faces = np.concatenate(
        [np.stack([corner, corner + 1, corner + size], 1), np.stack([corner + 1, corner + size + 1, corner + size], 1)]
    )
    return Mesh(np.stack([x, 0.1 * np.cos(3 * x) * z, z], axis=1), faces)


@pytest.fixture(scope="module")
def mesh():
    return grid(9)


def vertex(mesh, index):
    return place_on(mesh, "test", "at", index)


@pytest.fixture
def edit(mesh):
    """An edit that uses everything an edit can hold."""
    turned = Transform((0.0, 0.25, 0.0), (0.0, 0.0, 30.0), (1.0, 2.0, 0.5), (0.5, 0.5, 0.5))
    return Edit(
        handles=(
            Handle(3, vertex(mesh, 40), turned, locality=2.5, name="ear, links ◔"),
            Handle(1, Place((0.1, 0.2, 1 / 3))),
        ),
        fixed=(vertex(mesh, 7), Place((9.0, 9.0, 9.0))),
        symmetry=SymmetryPlane((1.0, 0.0, 0.0), 0.01, band=0.05),
        default=Transform(scale=(2.0, 2.0, 2.0)),
    )


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
transforms = st.builds(Transform, triples, triples, triples, st.none() | triples)


@given(
    handles=st.lists(
        st.tuples(
            triples, transforms, st.floats(0, 1e3), st.none() | st.text(st.characters(codec="utf-8"), min_size=1)
        ),
        max_size=4,
        unique_by=lambda handle: handle[0],
    ),
    default=st.none() | transforms,
    angle=numbers,
    band=st.floats(0, 10),
)
@settings(max_examples=50, deadline=None)
def test_any_edit_comes_back_from_its_text(mesh, tmp_path_factory, handles, default, angle, band):
    edit = Edit(
        tuple(Handle(i + 1, Place(place), *rest) for i, (place, *rest) in enumerate(handles)),
        symmetry=SymmetryPlane((math.cos(angle), math.sin(angle), 0.0), angle, band=band),
        default=default,
    )
    path = tmp_path_factory.mktemp("any") / "edit.json"
    write_edit(path, edit, mesh)
    assert read_edit(path, mesh) == edit


def test_an_empty_edit_comes_back(mesh, tmp_path):
    write_edit(tmp_path / "edit.json", Edit(), mesh)
    assert read_edit(tmp_path / "edit.json", mesh) == Edit()


def test_the_file_is_json_that_people_can_read(edit, mesh, tmp_path):
    path = tmp_path / "edit.json"
    write_edit(path, edit, mesh)
    text = path.read_text(encoding="utf-8")
    assert json.loads(text) == to_document(edit, mesh)
    assert '"translation": [0.0, 0.25, 0.0],\n' in text
    assert "ear, links ◔" in text


def test_the_example_of_the_documentation_is_read(mesh):
    import dfd.editing.edit_file

    example = re.search(r"^    \{.*?^    \}", dfd.editing.edit_file.__doc__, re.DOTALL | re.MULTILINE)[0]
    edit = from_document(json.loads(example), mesh)
    assert edit.handles[0].name == "left horn"
    assert edit.handles[0].transform == Transform((0.0, 0.2, 0.0), (0.0, 0.0, 30.0))
    assert edit.symmetry == SymmetryPlane((1.0, 0.0, 0.0), 0.0, band=0.05)
    # Every key of the example is one that is written, and the other way round.
    assert to_document(edit, mesh).keys() == json.loads(example).keys()
    assert to_document(edit, mesh)["handles"][0].keys() == json.loads(example)["handles"][0].keys()


def test_a_short_document_by_hand_is_enough(mesh):
    edit = from_document(
        {"format": "dfd-edit", "version": 1, "handles": [{"vertex": 4, "scale": 2}, {"position": [0, 1, 2]}]}, mesh
    )
    assert edit == Edit(
        (Handle(1, vertex(mesh, 4), Transform(scale=(2.0, 2.0, 2.0))), Handle(2, Place((0.0, 1.0, 2.0))))
    )


def test_missing_ids_are_given_around_those_that_are_there(mesh):
    handles = [{"vertex": 0}, {"vertex": 1, "id": 1}, {"vertex": 2}, {"vertex": 3, "id": 7}]
    edit = from_document({"format": "dfd-edit", "version": 1, "handles": handles}, mesh)
    assert [handle.id for handle in edit.handles] == [2, 1, 3, 7]


def test_a_quaternion_is_read_as_the_rotation_it_is(mesh):
    half = math.sqrt(0.5)
    entry = {"vertex": 4, "rotation": [0, half, 0, half]}
    edit = from_document({"format": "dfd-edit", "version": 1, "handles": [entry]}, mesh)
    np.testing.assert_allclose(edit.handles[0].transform.rotation, (0, 90, 0), atol=1e-12)


def test_an_axis_stands_for_its_plane_through_the_box(mesh):
    edit = from_document({"format": "dfd-edit", "version": 1, "symmetry": "z"}, mesh)
    assert edit.symmetry == symmetry_on(mesh, "test", "z", None)
    assert edit.symmetry.offset == pytest.approx(0.5)
    assert edit.symmetry.band == pytest.approx(0.03)


def test_a_byte_order_mark_does_no_harm(edit, mesh, tmp_path):
    path = tmp_path / "edit.json"
    path.write_text(json.dumps(to_document(edit, mesh)), encoding="utf-8-sig")
    assert read_edit(path, mesh) == edit


# --- another resolution


def test_on_another_resolution_handles_stay_where_they_were(edit, mesh, document):
    finer = grid(33)
    moved = from_document(document, finer)
    for old, new in zip(edit.handles, moved.handles, strict=True):
        assert new == replace(old, place=Place(old.place.position))
    assert moved.fixed[0] == Place(edit.fixed[0].position)


def test_a_vertex_that_still_lies_there_stays_a_vertex(edit, mesh, document):
    rounded = Mesh(mesh.vertices.astype(np.float32), mesh.faces)
    place = from_document(document, rounded).handles[0].place
    assert place == vertex(rounded, 40)


def test_the_same_number_of_vertices_in_another_order_is_noticed(edit, mesh, document):
    order = np.arange(len(mesh.vertices))[::-1]
    backwards = Mesh(mesh.vertices[order], order.argsort()[mesh.faces])
    # The middle vertex of 81 keeps its place, the one in a corner does not.
    assert [place.vertex for place in from_document(document, backwards).fixed] == [None, None]
    assert from_document(document, backwards).handles[0].place.vertex == 40


def test_a_vertex_without_a_position_holds_only_for_its_own_resolution(mesh):
    document = {"format": "dfd-edit", "version": 1, "mesh": {"vertices": 500}, "handles": [{"vertex": 4}]}
    message = r"`handles\[0\]` must have a position: the edit counts 500 vertices, the mesh 81"
    with pytest.raises(ValueError, match=message):
        from_document(document, mesh)


# --- what is refused


MISSING = object()


@pytest.mark.parametrize(
    ("keys", "value", "message"),
    [
        (("format",), "gltf", r'`format` must be "dfd-edit", got "gltf"'),
        (("format",), MISSING, r'`format` must be "dfd-edit", got null'),
        (("version",), 2, r"`version` must be 1, got 2"),
        (("version",), True, r"`version` must be 1, got true"),
        (("units",), {"length": "inch"}, r'`units` must be \{"length": "mesh", "angle": "degree"\}, got'),
        (("mesh",), 9, r"`mesh` must be an object, got 9"),
        (("mesh",), {}, r"`mesh.vertices` is missing"),
        (("mesh", "vertices"), 0, r"`mesh.vertices` must be a whole number of at least 1, got 0"),
        (("colour",), 1, r"`colour` is an unknown key"),
        (("handles",), {}, r"`handles` must be a list, got \{\}"),
        (("handles", 0), 5, r"`handles\[0\]` must be an object, got 5"),
        (("handles", 0, "rotaton"), [0, 0, 0], r"`handles\[0\].rotaton` is an unknown key; known are id, name"),
        (("handles", 0, "id"), 0, r"`handles\[0\].id` must be a whole number of at least 1, got 0"),
        (("handles", 0, "id"), 1.0, r"`handles\[0\].id` must be a whole number of at least 1, got 1.0"),
        (("handles", 0, "id"), 1, r"`handles` must have distinct ids, got 1 twice"),
        (("handles", 0, "name"), "", r"`handles\[0\].name` must be a text that is not empty, or null"),
        (("handles", 0, "name"), 3, r"`handles\[0\].name` must be a text"),
        (("handles", 0, "vertex"), -1, r"`handles\[0\].vertex` must be a whole number of at least 0, got -1"),
        (("handles", 0, "vertex"), "40", r'`handles\[0\].vertex` must be a whole number of at least 0, got "40"'),
        (("handles", 0, "position"), [0, 0], r"`handles\[0\].position` must be 3 numbers, got \[0, 0\]"),
        (("handles", 0, "position"), [0, 0, "1"], r'`handles\[0\].position\[2\]` must be a finite number, got "1"'),
        (("handles", 0, "translation"), None, r"`handles\[0\].translation` must be 3 numbers, got null"),
        (("handles", 0, "translation"), [0, math.nan, 0], r"`handles\[0\].translation\[1\]` must be a finite number"),
        (("handles", 0, "translation"), [0, 10**400, 0], r"`handles\[0\].translation\[1\]` must be a finite number"),
        (("handles", 0, "translation"), [0, True, 0], r"`handles\[0\].translation\[1\]` must be a finite number"),
        (("handles", 0, "rotation"), [1, 2], r"`handles\[0\].rotation` must be 3 numbers, or the 4 of a quaternion"),
        (("handles", 0, "rotation"), [0, 0, 0, 0], r"`handles\[0\].rotation` must be .* a quaternion other than 0"),
        (("handles", 0, "scale"), [1, 2], r"`handles\[0\].scale` must be a number or 3, got \[1, 2\]"),
        (("handles", 0, "scale"), "big", r'`handles\[0\].scale` must be a finite number, got "big"'),
        (("handles", 0, "pivot"), 1, r"`handles\[0\].pivot` must be 3 numbers, got 1"),
        (("handles", 1), {"position": [10, 0, 0], "scale": 1e308}, r"`handles\[1\]` must have a finite matrix"),
        (("handles", 0, "locality"), -1, r"`handles\[0\].locality` must be a finite number of at least 0, got -1"),
        (("handles", 1, "position"), None, r"`handles\[1\]` must have a vertex or a position"),
        (("fixed",), 5, r"`fixed` must be a list, got 5"),
        (("fixed", 0, "vertex"), 1.5, r"`fixed\[0\].vertex` must be a whole number"),
        (("fixed", 0, "locality"), 1, r"`fixed\[0\].locality` is an unknown key"),
        (("fixed", 1, "position"), [0.1, 0.2, 1 / 3], r"`fixed` must be free places, but 0.1,0.2,0.333333 is handle 1"),
        (("symmetry",), "w", r'`symmetry` must be "x", "y", "z", a plane or null, got "w"'),
        (("symmetry",), {"normal": [1, 0, 0]}, r"`symmetry.offset` is missing"),
        (("symmetry", "normal"), [1, 1, 0], r"`symmetry.normal` must have length 1, got \[1, 1, 0\]"),
        (("symmetry", "band"), -0.1, r"`symmetry.band` must be a finite number of at least 0, got -0.1"),
        (("symmetry", "ofset"), 0, r"`symmetry.ofset` is an unknown key"),
        (("default", "locality"), 0, r"`default.locality` is an unknown key"),
        (("default",), [], r"`default` must be an object, got \[\]"),
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
    assert "\n" not in str(caught.value)


def test_an_index_out_of_range_is_named(mesh):
    document = {"format": "dfd-edit", "version": 1, "fixed": [{"vertex": 81}]}
    with pytest.raises(ValueError, match=r"`fixed\[0\].vertex` must lie in 0 … 80, got 81"):
        from_document(document, mesh)


@pytest.mark.parametrize("document", [None, [], "edit", 3, True])
def test_what_is_no_object_is_no_edit(document, mesh):
    with pytest.raises(ValueError, match="`document` must be an edit, got"):
        from_document(document, mesh)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no whole JSON document: Expecting value: line 1 column 1"),
        ("{}", "`format` must be"),
        ('{"version": 1, "version": 1}', "`version` is given twice"),
        ('{"version": NaN}', "numbers must be finite, got NaN"),
        ('{"version": -Infinity}', "numbers must be finite, got -Infinity"),
        ("[" * 100_000, "nested too deeply|no whole JSON document"),
    ],
)
def test_odd_files_are_refused_in_the_name_of_their_path(mesh, tmp_path, text, message):
    path = tmp_path / "odd.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=message) as caught:
        read_edit(path, mesh)
    assert str(caught.value).startswith(f"{path}: ")


def test_a_number_too_large_for_a_float_is_refused(document, mesh, tmp_path):
    path = tmp_path / "large.json"
    path.write_text(json.dumps(document).replace("0.25", "1e999"))
    with pytest.raises(ValueError, match=r"`handles\[0\].translation\[1\]` must be a finite number"):
        read_edit(path, mesh)


def test_a_file_cut_short_anywhere_is_refused(document, mesh, tmp_path):
    text = json.dumps(document)
    path = tmp_path / "cut.json"
    for length in range(0, len(text) - 1, 17):
        path.write_text(text[:length])
        with pytest.raises(ValueError, match="no whole JSON document"):
            read_edit(path, mesh)


def test_bytes_that_are_no_text_are_refused(mesh, tmp_path):
    path = tmp_path / "edit.json"
    path.write_bytes(b'{"format": "\xff"}')
    with pytest.raises(ValueError, match="must be UTF-8 text, but byte 12 is none"):
        read_edit(path, mesh)


def test_a_missing_file_and_a_folder_are_named(mesh, tmp_path):
    for path in (tmp_path / "none.json", tmp_path):
        with pytest.raises(OSError, match=f"{re.escape(str(path))}: the edit could not be read"):
            read_edit(path, mesh)


def test_a_failed_write_leaves_the_old_file_and_nothing_else(edit, mesh, tmp_path, monkeypatch):
    path = tmp_path / "edit.json"
    path.write_text("precious")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match=r"edit.json could not be written: No space left on device"):
        write_edit(path, edit, mesh)
    assert path.read_text() == "precious"
    assert list(tmp_path.iterdir()) == [path]


# --- values


def test_two_handles_at_one_place_are_refused(mesh):
    with pytest.raises(ValueError, match="`handles` must lie at distinct places, got two at 4: handle 1 and handle 2"):
        Edit((Handle(1, vertex(mesh, 4)), Handle(2, vertex(mesh, 4))))


def test_a_place_is_fixed_once(mesh):
    with pytest.raises(ValueError, match="`fixed` must be free places, but 4 is fixed already"):
        Edit(fixed=(vertex(mesh, 4), vertex(mesh, 4)))


def test_places_are_named_as_the_command_line_takes_them(mesh):
    assert str(vertex(mesh, 4)) == "4"
    assert str(Place((0.5, -1.0, 2.0))) == "0.5,-1,2"


def test_a_place_follows_its_vertex_to_the_mesh_at_hand(mesh):
    assert place_on(mesh, "test", "at", Place((0.0, 0.0, 0.0), 4)) == vertex(mesh, 4)


@pytest.mark.parametrize("at", [81, -1, 2.0, True, "4", (1, 2), (1, 2, math.nan), None, [[1, 2, 3]]])
def test_what_is_no_place_is_refused(mesh, at):
    with pytest.raises(ValueError, match="test: `at` must"):
        place_on(mesh, "test", "at", at)


@pytest.mark.parametrize(
    ("plane", "band", "message"),
    [
        ("w", None, "`plane` must be x, y, z or a SymmetryPlane, got 'w'"),
        (1, None, "`plane` must be x, y, z or a SymmetryPlane, got int"),
        ("x", -1, "`band` must be at least 0, got -1"),
        ("x", math.nan, "`band` must be finite"),
    ],
)
def test_what_is_no_plane_is_refused(mesh, plane, band, message):
    with pytest.raises(ValueError, match=message):
        symmetry_on(mesh, "test", plane, band)


def test_a_band_of_zero_is_the_paper_s_hard_cut(mesh):
    assert symmetry_on(mesh, "test", "x", 0).band == 0.0


# --- history


def states(count):
    return [Edit(fixed=(Place((float(i), 0.0, 0.0)),)) for i in range(count)]


def test_undo_walks_back_to_the_start_and_redo_to_the_end():
    start, *later = states(500)
    history = History(start)
    for state in later:
        history.commit(state)
    for state in [*later[-2::-1], start]:
        assert history.undo()
        assert history.present == state
    assert not history.can_undo
    assert not history.undo()
    while history.redo():
        pass
    assert history.present == later[-1]
    assert not history.can_redo


def test_a_new_step_forgets_what_was_undone():
    first, second, third = states(3)
    history = History(first)
    history.commit(second)
    history.undo()
    history.commit(third)
    assert not history.can_redo
    history.undo()
    assert history.present == first


def test_no_change_is_no_step():
    (only,) = states(1)
    history = History(only)
    history.commit(Edit(fixed=only.fixed))
    assert not history.can_undo


def test_merged_commits_about_one_topic_are_one_step():
    first, second, third, fourth = states(4)
    history = History(first)
    history.commit(second, topic=1)
    history.commit(third, topic=1, merge=True)
    history.commit(fourth, topic=1, merge=True)
    history.undo()
    assert history.present == first
    history.redo()
    assert history.present == fourth


@pytest.mark.parametrize("between", ["another topic", "undo and redo", "a plain repetition", "a step"])
def test_a_merge_joins_only_an_unbroken_run(between):
    first, second, third, fourth = states(4)
    history = History(first)
    history.commit(second, topic=1)
    if between == "another topic":
        history.commit(third, topic=2)
    elif between == "undo and redo":
        history.undo()
        history.redo()
    elif between == "a plain repetition":  # the start of a new drag, before the pointer moved
        history.commit(second, topic=1)
    else:
        with history.step():
            pass
    before = history.present
    history.commit(fourth, topic=1, merge=True)
    history.undo()
    assert history.present == before


def test_a_step_is_undone_whole():
    first, second, third = states(3)
    history = History(first)
    with history.step():
        history.commit(second)
        history.commit(third)
    history.undo()
    assert history.present == first
    history.redo()
    assert history.present == third


def test_a_step_that_fails_never_happened():
    first, second, third, fourth = states(4)
    history = History(first)
    history.commit(second)
    history.commit(third)
    history.undo()

    def fail():
        with history.step():
            history.commit(fourth)
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert history.present == second
    history.redo()
    assert history.present == third


def test_undo_inside_a_step_stays_inside_it():
    first, second, third = states(3)
    history = History(first)
    history.commit(second)
    with history.step():
        assert not history.can_undo
        history.commit(third)
        assert history.undo()
        assert not history.undo()
        assert history.present == second
    assert history.can_undo
    assert history.undo()
    assert history.present == first


def test_steps_inside_steps_are_part_of_the_outer_one():
    first, second, third = states(3)
    history = History(first)
    with history.step():
        history.commit(second)
        with history.step():
            history.commit(third)
    history.undo()
    assert history.present == first
