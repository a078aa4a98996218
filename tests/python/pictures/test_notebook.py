"""Test pictures and progress bars in notebooks."""

import io
from unittest import mock

import numpy as np
import pytest
from made_field import field_of
from mesh_files import CORNERS, CUBE
from PIL import Image

import dfd
from dfd.common.progress import Stages
from dfd.mesh.mesh import Mesh
from dfd.pictures.picture import picture

MESH = Mesh(CORNERS, CUBE)


def test_a_mesh_is_shown_by_a_notebook():
    shown = dfd.show(MESH, resolution=64, azimuth=10)
    np.testing.assert_array_equal(np.asarray(shown), picture(MESH, resolution=64, azimuth=10))
    with Image.open(io.BytesIO(shown._repr_png_())) as image:
        np.testing.assert_array_equal(np.asarray(image), np.asarray(shown))


def test_a_session_is_shown_as_it_is_posed():
    field = field_of(MESH)
    session = dfd.Deformer(MESH, field)
    resting = np.asarray(dfd.show(session, resolution=64, azimuth=20))
    session.add(3, translation=(0, 1, 0))
    moved = np.asarray(dfd.show(session, resolution=64, azimuth=20))
    assert np.abs(resting.astype(int) - moved).max() > 50
    assert "\n" not in repr(session) + repr(field) + repr(MESH)


def test_bars_need_no_widgets_in_a_notebook():
    with mock.patch("rich.console._is_jupyter", return_value=True), Stages().stage("work", 2) as advance:
        advance(2)  # without ipywidgets, rich warns, and warnings are errors here


@pytest.mark.parametrize("terminal", [True, False])
def test_bars_are_only_drawn_in_a_terminal(terminal, capsys, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1") if terminal else monkeypatch.delenv("FORCE_COLOR", raising=False)
    with Stages().stage("work", 2) as advance:
        advance(2)
    assert ("work" in capsys.readouterr().err) == terminal


def test_meshes_sessions_and_fields_show_themselves(monkeypatch):
    field = field_of(MESH)
    session = dfd.Deformer(MESH, field)
    for shape in (MESH, session, field, field.with_surface(MESH)):
        if shape is field:
            with pytest.raises(ValueError, match="samples of its surface"):
                dfd.show(shape)
            continue
        with Image.open(io.BytesIO(shape._repr_png_())) as image:
            np.testing.assert_array_equal(np.asarray(image), np.asarray(dfd.show(shape)))
            assert np.unique(np.asarray(image)).size > 20, "the picture is not blank"
    rows = np.eye(len(MESH.vertices), dtype=np.float32)
    assert len(np.unique(np.asarray(dfd.show(dfd.VertexField(MESH, rows))).reshape(-1, 3), axis=0)) > 20
