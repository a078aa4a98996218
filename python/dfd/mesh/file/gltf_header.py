"""The JSON header of a glTF file: judged before any buffer is read, so that no number in it can ask for the moon.

The format: Khronos Group, "glTF 2.0 Specification", 2021.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, cast

__all__ = ["MODES_READ", "base_color_texture", "primitives", "read", "wrap"]

Wrap = Literal["repeat", "mirror", "clamp"]
Header = dict[str, Any]

_MAGIC = b"glTF"
_JSON_CHUNK = 0x4E4F534A
_COMPONENT_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_WRAPS: dict[int, Wrap] = {33071: "clamp", 33648: "mirror", 10497: "repeat"}
_UNREADABLE = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression")
MODES_READ = (0, 1, 4, 5)  # the primitives that trimesh makes something of: points, lines, triangles, strips
_DEEPEST = 1000  # nodes below nodes
_MOST_OVERLAP = 8  # times the length of its buffers that a file's views may add up to
_SMALL = 2**24  # bytes that nobody misses, whatever a small file's views add up to


def read(path: Path, data: bytes) -> Header:
    """Return the header of the GLB or glTF file whose bytes are `data`.

    Raises
    ------
    ValueError
        If it cannot be read, uses a compression that cannot be read, or its views, accessors or nodes cannot be right.
    """
    try:
        text = _json_chunk(data) if data[:4] == _MAGIC else data
        header = json.loads(text.decode())
        if not isinstance(header, dict):
            raise ValueError(f"its JSON is a {type(header).__name__}, not an object")
        _check_extensions(header)
        _check_buffers(header, glb=data[:4] == _MAGIC)
        _check_views(header)
        _check_accessors(header)
        _check_primitives(header)
        _check_nodes(header)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"load: `path` {path} is not a well-formed {path.suffix[1:].upper()} file: {error}") from error
    return cast(Header, header)


def primitives(header: Header) -> Iterator[Header]:
    """Yield the primitives from which trimesh makes geometries, in its order."""
    for mesh in _objects(header, "meshes"):
        yield from (each for each in _objects(mesh, "primitives") if each.get("mode", 4) in MODES_READ)


def base_color_texture(header: Header, primitive: Header) -> Header | None:
    """Return the texture that colours a primitive, or None."""
    material = _item(header, "materials", primitive.get("material"))
    metallic = material.get("pbrMetallicRoughness") if material else None
    reference = metallic.get("baseColorTexture") if isinstance(metallic, dict) else None
    return _item(header, "textures", reference.get("index")) if isinstance(reference, dict) else None


def wrap(header: Header, texture: Header) -> tuple[Wrap, Wrap]:
    """Return what lies beyond a texture along u and v."""
    sampler = _item(header, "samplers", texture.get("sampler")) or {}
    across, down = sampler.get("wrapS"), sampler.get("wrapT")
    return (
        _WRAPS.get(across, "repeat") if isinstance(across, int) else "repeat",
        _WRAPS.get(down, "repeat") if isinstance(down, int) else "repeat",
    )


def _json_chunk(data: bytes) -> bytes:
    if len(data) < 20:
        raise ValueError(f"it is cut off after {len(data)} bytes")
    length, kind = struct.unpack("<II", data[12:20])
    if kind != _JSON_CHUNK:
        raise ValueError("its first chunk is not JSON")
    if 20 + length > len(data):
        raise ValueError(f"its header should have {length} bytes, but {len(data) - 20} are there")
    return data[20 : 20 + length]


def _check_extensions(header: Header) -> None:
    required = header.get("extensionsRequired", [])
    for name in required if isinstance(required, list) else []:
        if name in _UNREADABLE:
            raise ValueError(f"it is compressed with {name}, which cannot be read; save it without compression")


def _check_buffers(header: Header, glb: bool) -> None:
    for i, buffer in enumerate(_objects(header, "buffers")):
        if not isinstance(buffer.get("uri"), str) and not (glb and i == 0):
            raise ValueError(f"buffer {i} does not say where its data is")


def _check_views(header: Header) -> None:
    lengths = [_count(buffer, "byteLength", "buffer", i) for i, buffer in enumerate(_objects(header, "buffers"))]
    total = 0
    for i, view in enumerate(_objects(header, "bufferViews")):
        buffer = _count(view, "buffer", "bufferView", i)
        if buffer >= len(lengths):
            raise ValueError(f"bufferView {i} names buffer {buffer}, but there are {len(lengths)}")
        length = _count(view, "byteLength", "bufferView", i)
        end = _count(view, "byteOffset", "bufferView", i, default=0) + length
        if end > lengths[buffer]:
            raise ValueError(f"bufferView {i} ends at byte {end} of a buffer of {lengths[buffer]}")
        total += length
    if total > max(_MOST_OVERLAP * sum(lengths), _SMALL):
        raise ValueError(f"its bufferViews add up to {total} bytes of {sum(lengths)}")


def _check_accessors(header: Header) -> None:
    views = _objects(header, "bufferViews")
    if views and "accessors" not in header:
        raise ValueError("it has data, but no accessors and so no faces")
    total, longest, unfilled = 0, 0, []
    for i, accessor in enumerate(_objects(header, "accessors")):
        count = _count(accessor, "count", "accessor", i)
        component, kind = accessor.get("componentType"), accessor.get("type")
        if not isinstance(component, int) or component not in _COMPONENT_BYTES:
            raise ValueError(f"accessor {i} has the unknown componentType {component!r}")
        if not isinstance(kind, str) or kind not in _COMPONENTS:
            raise ValueError(f"accessor {i} has the unknown type {kind!r}")
        size = _COMPONENT_BYTES[component] * _COMPONENTS[kind]
        if "bufferView" not in accessor:
            unfilled.append((i, count))
            continue
        place = _count(accessor, "bufferView", "accessor", i)
        if place >= len(views):
            raise ValueError(f"accessor {i} names bufferView {place}, but there are {len(views)}")
        stride = _count(views[place], "byteStride", "bufferView", place, default=size)
        end = _count(accessor, "byteOffset", "accessor", i, default=0) + max(count - 1, 0) * stride + size * (count > 0)
        if end > views[place]["byteLength"]:
            raise ValueError(f"accessor {i} has {count} items up to byte {end} of {views[place]['byteLength']}")
        total, longest = total + count * size, max(longest, count)
    stored = sum(view["byteLength"] for view in views)
    if total > max(_MOST_OVERLAP * stored, _SMALL):
        raise ValueError(f"its accessors add up to {total} bytes of {stored}")
    for i, count in unfilled:
        if count > max(longest, 1000):
            raise ValueError(f"accessor {i} has {count} items but no data")


def _check_primitives(header: Header) -> None:
    accessors = _objects(header, "accessors")
    for primitive in primitives(header):
        attributes = primitive.get("attributes")
        position = attributes.get("POSITION") if isinstance(attributes, dict) else None
        for name, index in (("positions", position), ("indices", primitive.get("indices"))):
            if index is None and name == "indices":
                continue
            if not _is_index(index, len(accessors)):
                raise ValueError(f"a primitive names accessor {index!r} for its {name}, but there are {len(accessors)}")
            accessor = accessors[cast(int, index)]
            if "sparse" in accessor or "bufferView" not in accessor:
                what = "is sparse, which cannot be read" if "sparse" in accessor else "has no data"
                raise ValueError(f"accessor {index}, of {name}, {what}")
            if accessor.get("normalized") and name == "positions":
                raise ValueError(f"accessor {index}, of positions, is normalized (quantized), which cannot be read")


def _check_nodes(header: Header) -> None:
    nodes = _objects(header, "nodes")
    children: list[list[int]] = []
    for i, node in enumerate(nodes):
        below = node.get("children", [])
        if not isinstance(below, list) or not all(_is_index(child, len(nodes)) for child in below):
            raise ValueError(f"node {i} has children that are not there")
        children.append(below)
    parents = [0] * len(nodes)
    for child in (child for below in children for child in below):
        parents[child] += 1
    if (many := next((i for i, count in enumerate(parents) if count > 1), None)) is not None:
        raise ValueError(f"node {many} is the child of more than one node")
    layer, reached = [i for i, count in enumerate(parents) if count == 0], 0
    for _ in range(_DEEPEST):
        reached += len(layer)
        layer = [child for i in layer for child in children[i]]
    if layer:
        raise ValueError(f"its nodes are nested more than {_DEEPEST} deep")
    if reached < len(nodes):
        raise ValueError("its nodes are their own ancestors")


def _objects(owner: Header, name: str) -> list[Header]:
    values = owner.get(name, [])
    if not isinstance(values, list) or not all(isinstance(value, dict) for value in values):
        raise ValueError(f"its {name!r} must be a list of objects")
    return values


def _item(header: Header, name: str, index: object) -> Header | None:
    values = _objects(header, name)
    return values[cast(int, index)] if _is_index(index, len(values)) else None


def _is_index(value: object, count: int) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < count


def _count(owner: Header, name: str, kind: str, index: int, default: int | None = None) -> int:
    value = owner.get(name, default)
    if isinstance(value, float) and value.is_integer():  # some writers put 12.0
        value = int(value)
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise ValueError(f"{kind} {index} has {name} {value!r}")
    return value
