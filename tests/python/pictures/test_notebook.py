"""Pictures and bars in notebooks."""

from __future__ import annotations

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


def test_a_mesh_is_shown_by_a_notebook(tmp_path) -> None:
    shown = dfd.show(MESH, resolution=64, azimuth=10)
    np.testing.assert_array_equal(shown.pixels, picture(MESH, resolution=64, azimuth=10))
    with Image.open(io.BytesIO(shown._repr_png_())) as image:
        np.testing.assert_array_equal(np.asarray(image), shown.pixels)
    assert repr(shown) == "Shown(64 x 64 pixels)"
    shown.save(tmp_path / "cube.png")
    with pytest.raises(ValueError, match="`path` must end in .png"):
        shown.save(tmp_path / "cube.jpg")


def test_a_session_is_shown_as_it_is_posed() -> None:
    field = field_of(MESH)
    session = dfd.Deformer(MESH, field)
    resting = dfd.show(session, resolution=64, azimuth=20).pixels
    session.add(3, translation=(0, 1, 0))
    moved = dfd.show(session, resolution=64, azimuth=20).pixels
    assert np.abs(resting.astype(int) - moved).max() > 50
    assert "\n" not in repr(session) + repr(field) + repr(MESH)


def test_bars_need_no_widgets_in_a_notebook() -> None:
    with mock.patch("rich.console._is_jupyter", return_value=True), Stages().stage("work", 2) as advance:
        advance(2)  # without ipywidgets rich would warn, which is an error here
