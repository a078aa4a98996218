"""Test that the arrays in a file of weights reproduce the posed shape of the session."""

import json

import numpy as np
import pytest
from safetensors import safe_open

import dfd
from dfd.editing.edit_file import to_document


def read(path):
    """Return the arrays and texts of a file, read without code of dfd."""
    if path.suffix == ".npz":
        with np.load(path, allow_pickle=False) as file:
            arrays = dict(file)
        texts = {name: str(arrays.pop(name)) for name in list(arrays) if arrays[name].dtype.kind == "U"}
        return arrays, texts
    with safe_open(path, "numpy") as file:
        return {name: file.get_tensor(name) for name in file.keys()}, file.metadata()  # noqa: SIM118


@pytest.mark.parametrize("ending", ["npz", "safetensors"])
def test_the_file_makes_the_shape_again(ending, session, tmp_path):
    session.add(40, translation=(0.1, 0.2, 0), rotation=(0, 60, 0), name="leg")
    session.add(900, scale=1.5, counterparts="shared_pivot")
    session.set_symmetry("x", band=0.1)
    session.set_default(translation=(0, 0, 0.1))
    dfd.export_weights(session, tmp_path / f"weights.{ending}")
    arrays, texts = read(tmp_path / f"weights.{ending}")
    edit = json.loads(texts["edit"])
    plane = dfd.SymmetryPlane(**edit["symmetry"])
    posed = dfd.pose(
        arrays["vertices"],
        arrays["weights"],
        arrays["transforms"],
        default=arrays["default"],
        symmetry=plane,
        handles=arrays["handles"],
        overlap=session.edit.rules.overlap,
    )
    np.testing.assert_allclose(posed, session.vertices, atol=1e-9)
    np.testing.assert_array_equal(arrays["faces"], session.mesh.faces)
    names = json.loads(texts["names"])
    assert len(names) == len(set(names)) == arrays["weights"].shape[1] == len(arrays["handle_ids"])
    assert names[0] == "leg"
    assert names[-1] == "handle 2"
    assert (texts["format"], texts["version"], texts["mesh"]) == ("dfd-weights", "1", session.mesh.content_hash)
    assert edit == json.loads(json.dumps(to_document(session.edit, session.mesh)))
    assert json.loads(texts["field"]) == session.field.settings


def test_bad_input_is_named(session, tmp_path):
    with pytest.raises(ValueError, match="export_weights: `session` must have a handle, got none"):
        dfd.export_weights(session, tmp_path / "weights.npz")
    session.add(40)
    with pytest.raises(ValueError, match=r"`path` must end in \.npz, \.safetensors, got .*weights\.csv"):
        dfd.export_weights(session, tmp_path / "weights.csv")
    with pytest.raises(OSError, match="does not exist"):
        dfd.export_weights(session, tmp_path / "missing" / "weights.npz")
    assert list(tmp_path.iterdir()) == []
