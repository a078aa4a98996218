"""The field that the code makes of a mesh: when it changes, fields in the cache must not be found.

The numbers hold to 1e-3 on any machine.
"""

from typing import Any

import numpy as np
import pytest
from tiny_encoder import save_tiny_encoder

import dfd
from dfd.distillation import smoothing
from dfd.encoders.encode import load_encoder

pytestmark = pytest.mark.usefixtures("one_thread")

# A box, pulled askew.
VERTICES = [[0, 0, 0], [2, 0, 0.1], [0, 1, 0], [2.4, 1.2, 0], [0, 0, 1], [2, 0.2, 1.3], [0, 1, 0.8], [2, 1, 1]]
FACES = [[0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4], [2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6]]
FACES += [[1, 3, 5], [3, 7, 5]]
CHANGED = "fields come out otherwise than before: raise FIELD_VERSION in dfd/field/cache_key.py, and then these numbers"
# The first four numbers of the features of four vertices.
GOLDEN: dict[str, list[list[float]]] = {
    "default": [
        [0.0855, -0.4277, 0.2382, 0.0398],
        [0.1745, -0.4205, 0.3498, -0.1181],
        [0.0128, -0.4678, 0.3305, -0.0279],
        [0.1242, -0.4404, 0.4029, -0.1786],
    ],
    "paper": [
        [0.0562, -0.4202, 0.3670, -0.0422],
        [0.0443, -0.4134, 0.3834, -0.1207],
        [0.0870, -0.4008, 0.3245, -0.0337],
        [0.0447, -0.4097, 0.3514, -0.1267],
    ],
}
SETTINGS: dict[str, dict[str, Any]] = {"default": {"steps": 40, "batch": 128}, "paper": {"epochs": 2, "batch": 256}}


@pytest.mark.parametrize("preset", ["default", "paper"])
def test_the_golden_field(preset, tmp_path, monkeypatch):
    monkeypatch.setattr(smoothing, "SURFACE_SAMPLES", 600)
    encoder = load_encoder(
        save_tiny_encoder(tmp_path / "tiny"), device="cpu", precision="float32", background=preset == "paper"
    )
    mesh = dfd.Mesh(VERTICES, FACES)
    field = dfd.distill(
        mesh, encoder, preset=preset, views=4, resolution=32, progress=False, cache=False, **SETTINGS[preset]
    )
    np.testing.assert_allclose(field.features(mesh)[::2, :4], GOLDEN[preset], atol=1e-3, err_msg=CHANGED)
