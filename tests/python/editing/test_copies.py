"""Test copies of sessions, meshes, fields and edits: arrays stay read-only, and histories are independent."""

import copy
import pickle

import numpy as np
import pytest
from made_field import field_of
from sheet import full_edit, grid

import dfd
from dfd.field.component_residuals import ComponentResiduals

COPIES = {"deepcopy": copy.deepcopy, "pickle": lambda value: pickle.loads(pickle.dumps(value))}
MESH = grid(9)


def field_with_residuals():
    residuals = ComponentResiduals(
        np.zeros((1, 6), np.float32), MESH.vertices, np.zeros(81, np.int32), np.zeros((81, 16), np.float16)
    )
    return field_of(MESH).with_residuals(residuals).with_surface(MESH)


def mesh_with_properties():
    mesh = grid(9)
    _ = mesh.bounds, mesh.extents, mesh.normals, mesh.parts
    return mesh


VALUES = {
    "mesh": mesh_with_properties,
    "field": field_with_residuals,
    "compact features": lambda: dfd.compact(np.eye(16, dtype=np.float32)),
    "edit": lambda: full_edit(MESH),
}


def arrays_of(value, path=""):
    """Return the arrays in an object's attributes, in the attributes of these, and so on."""
    if isinstance(value, np.ndarray):
        return {path: value}
    if isinstance(value, dict):
        inner = value.items()
    elif isinstance(value, tuple | list):
        inner = enumerate(value)
    else:
        inner = vars(value).items() if type(value).__module__.startswith("dfd.") else ()
    return {key: array for name, each in inner for key, array in arrays_of(each, f"{path}.{name}").items()}


@pytest.mark.parametrize("copied", COPIES)
@pytest.mark.parametrize("name", VALUES)
def test_arrays_of_copies_are_read_only(name, copied):
    value = VALUES[name]()
    before, after = arrays_of(value), arrays_of(COPIES[copied](value))
    assert before.keys() == after.keys()
    assert len(before) >= 3
    for path, array in after.items():
        assert not array.flags.writeable, path
        np.testing.assert_array_equal(array, before[path])


@pytest.mark.parametrize("copied", COPIES)
def test_a_copied_session_gives_the_same_read_only_arrays(copied, mesh, field):
    session = dfd.Deformer(mesh, field)
    session.add(5, translation=(0, 0.2, 0))
    vertices, weights = session.vertices, session.weights
    again = COPIES[copied](session)
    for found, wanted in ((again.vertices, vertices), (again.weights, weights)):
        assert not found.flags.writeable
        np.testing.assert_array_equal(found, wanted)
    again.undo()
    assert not again.vertices.flags.writeable


@pytest.mark.parametrize("copied", [copy.copy, *COPIES.values()])
def test_a_copied_session_has_its_own_history(copied, deformer, mesh):
    deformer.add(5, translation=(0, 0.2, 0))
    deformer.add(900)
    other = copied(deformer)
    other.undo()
    other.add(7, translation=(0.1, 0, 0))
    with other.step():
        other.add(8)
    assert [handle.place.vertex for handle in deformer.handles] == [5, 900]
    assert [handle.place.vertex for handle in other.handles] == [5, 7, 8]
    deformer.undo()
    assert deformer.redo()
    assert [handle.place.vertex for handle in deformer.handles] == [5, 900]
    fresh = dfd.Deformer(mesh, deformer.field, features=deformer.features)
    fresh.apply(other.edit)
    np.testing.assert_array_equal(other.vertices, fresh.vertices)
