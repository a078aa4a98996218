"""Arrays that the page asks for once in a while: the kernel's own positions, and the features as colors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dfd.app.framing import pack
from dfd.app.protocol.binaries import ColorsMessage, PositionsMessage
from dfd.app.surface import center_of, packed_normals
from dfd.mesh.normals import smooth_normals
from dfd.pictures.colors import feature_colors
from dfd.weights.compact import CompactFeatures

if TYPE_CHECKING:
    from dfd.editing.deformer import Deformer

__all__ = ["feature_colors_message", "positions_message"]


def positions_message(deformer: Deformer, *, request: int) -> bytes:
    """The answer to `compute`."""
    posed = deformer.vertices
    normals = smooth_normals(posed, deformer.mesh.faces)
    arrays: dict[str, NDArray[Any]] = {
        "positions": (posed - center_of(deformer.mesh)).astype(np.float32),
        "normals": packed_normals(normals),
    }
    return pack(PositionsMessage, arrays, id=request)


def feature_colors_message(deformer: Deformer, *, request: int) -> bytes:
    """The answer to `features`: as pictures color them."""
    features = deformer.features
    colors = feature_colors(features.principal(3) if isinstance(features, CompactFeatures) else features)
    packed = np.full((len(colors), 4), 255, np.uint8)
    packed[:, :3] = np.rint(colors * 255)
    return pack(ColorsMessage, {"colors": packed}, id=request)
