"""A process of its own that reads an FBX file by the library ufbx: the file on its input, numbers on its output.

ufbx's binding for Python can end its process where a file is damaged, so it never runs in the caller's. What comes
out is an archive of NumPy's: `header`, JSON as bytes, and the arrays that it names by numbers.
"""

from __future__ import annotations

import io
import json
import os
import sys
from typing import Any

import numpy as np
import ufbx
from numpy.typing import NDArray

# The binding takes a reference away whenever it gives out a mesh, node, material or texture again: here each has one
# more, and the process ends without counting.
_ALIVE: list[Any] = []


def _kept(element: Any) -> Any:
    _ALIVE.append(element)
    return element


class _Arrays:
    """Arrays, by the numbers under which they are written."""

    def __init__(self) -> None:
        self.kept: list[NDArray[Any]] = []

    def add(self, values: Any) -> int | None:
        """The number of a copy of the library's array; None of an empty one, which the binding crashes on."""
        return None if len(values) == 0 else self.add_array(np.array(values))

    def add_array(self, values: NDArray[Any]) -> int:
        self.kept.append(values)
        return len(self.kept) - 1

    def corners(self, attribute: Any) -> dict[str, int | None] | None:
        """Values, and which of them each corner has; None where the mesh has none."""
        if not attribute.exists:
            return None
        return {"values": self.add(attribute.values), "indices": self.add(attribute.indices)}


def main() -> None:
    data = sys.stdin.buffer.read()
    scene = ufbx.load_memory(
        data,
        file_format=ufbx.FileFormat.FBX,
        no_format_from_content=True,
        ignore_animation=True,
        evaluate_skinning=True,
        clean_skin_weights=True,
        index_error_handling=ufbx.IndexErrorHandling.ABORT_LOADING,
        target_axes=ufbx.axes_right_handed_y_up,
        target_unit_meters=1.0,
    )
    arrays = _Arrays()
    header = {
        "meshes": [_mesh(_kept(each), arrays) for each in scene.meshes],
        "nodes": [_node(each) for each in map(_kept, scene.nodes) if _kept(each.mesh) is not None],
        "materials": [_material(_kept(each), arrays) for each in scene.materials],
    }
    arrays.add_array(np.frombuffer(json.dumps(header).encode(), np.uint8))
    stream = io.BytesIO()
    np.savez(stream, **{str(number): each for number, each in enumerate(arrays.kept)})  # type: ignore[arg-type]
    sys.stdout.buffer.write(stream.getvalue())
    sys.stdout.buffer.flush()
    os._exit(0)


def _mesh(mesh: Any, arrays: _Arrays) -> dict[str, Any]:
    deformed = len(mesh.all_deformers) > 0 and mesh.skinned_position.exists
    return {
        "name": mesh.name,
        "faces": arrays.add(mesh.faces),  # (P, 2) first corner and how many corners
        "face_material": arrays.add(mesh.face_material),
        "positions": arrays.corners(mesh.vertex_position),
        "normals": arrays.corners(mesh.vertex_normal),
        "colors": arrays.corners(mesh.vertex_color),
        "uv": [{"name": each.name, **(arrays.corners(each.vertex_uv) or {})} for each in mesh.uv_sets],
        # where skins and blend shapes put it: in its own coordinates, or the scene's
        "posed": arrays.corners(mesh.skinned_position) if deformed else None,
        "posed_normals": arrays.corners(mesh.skinned_normal) if deformed else None,
        "posed_is_local": bool(mesh.skinned_is_local),
    }


def _node(node: Any) -> dict[str, Any]:
    return {
        "name": node.name,
        "mesh": _kept(node.mesh).typed_id,
        "matrix": _columns(node.geometry_to_world),
        "visible": bool(node.visible),
        "materials": [_kept(each).typed_id for each in node.materials],
    }


def _columns(matrix: Any) -> list[list[float]]:
    return [list(column) for column in matrix]


def _material(material: Any, arrays: _Arrays) -> dict[str, Any]:
    base, factor, opacity = material.pbr.base_color, material.pbr.base_factor, material.pbr.opacity
    texture = _kept(base.texture) if base.texture_enabled else None
    scale = factor.value_vec4[0] if factor.has_value else 1.0
    return {
        "name": material.name,
        "color": [scale * part for part in base.value_vec4[:3]] if base.has_value else None,
        "opacity": opacity.value_vec4[0] if opacity.has_value else 1.0,
        "cut_out": _kept(opacity.texture) is not None,
        "texture": None if texture is None else _texture(texture, arrays),
    }


def _texture(texture: Any, arrays: _Arrays) -> dict[str, Any]:
    file = next(map(_kept, texture.file_textures), texture)  # of a texture of layers the first
    content = bytes(file.content)
    return {
        "content": arrays.add_array(np.frombuffer(content, np.uint8)) if content else None,
        "names": [file.relative_filename, file.filename],
        "uv_set": file.uv_set,
        "clamp": [int(file.wrap_u) == 1, int(file.wrap_v) == 1],
        "matrix": _columns(file.uv_to_texture) if file.has_uv_transform else None,
    }


if __name__ == "__main__":
    try:
        main()
    except Exception as error:
        sys.exit(" ".join(str(error).split()) or type(error).__name__)
