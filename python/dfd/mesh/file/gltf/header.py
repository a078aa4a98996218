"""The GLB container, and the JSON header of a glTF file, which is checked before buffers are read or allocated.

The format: Khronos Group, "glTF 2.0 Specification", 2021.
"""

import codecs
import importlib.util
import json
import struct
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import chain
from types import MappingProxyType
from typing import Any, NamedTuple, TypeGuard, cast

import numpy as np

from dfd.common.distribution import pip_install
from dfd.mesh.file.text import shortened

Header = dict[str, Any]

_MAGIC = b"glTF"  # the first bytes of a GLB file
_JSON_CHUNK, DATA_CHUNK = 0x4E4F534A, 0x004E4942

COMPONENT_TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
MODES_READ = (4, 5, 6)  # primitives with faces: triangles, strips, fans
DRACO = "KHR_draco_mesh_compression"
MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
_LIBRARIES = {DRACO: "DracoPy", MESHOPT[0]: "meshopt"}  # the extra gltf installs both
# Prefixes of extensions that a file may require: they affect only its appearance, add unrelated data or are supported.
_HARMLESS = (
    *("KHR_materials_", "KHR_texture_", "EXT_texture_", "MSFT_texture_", "MSFT_packing_", "KHR_lights_", "EXT_lights_"),
    *("KHR_animation_", "KHR_node_", "KHR_xmp", "KHR_mesh_quantization", "KHR_accessor_", "KHR_audio", "VRM"),
    "EXT_mesh_gpu_instancing",
)
_COLLECTIONS = (
    *("accessors", "animations", "bufferViews", "buffers", "cameras", "images", "materials", "meshes", "nodes"),
    *("samplers", "scenes", "skins", "textures"),
)
_CONVERT = "open it in the program that made it, and export glTF 2.0"
_LEAST_STRIDE = 4  # bytes; smallest `byteStride` that glTF permits
_MOST_ZEROS = 2**20  # an accessor without data may have this many items, or as many as the longest accessor with data
_DEEPEST = 1000  # largest nesting depth of nodes
_DEEPEST_JSON = 200  # largest nesting depth of JSON values
# In total, buffer views may be this many times as long as buffers, and accessors this many times as long as views.
_MOST_OVERLAP = 8
_SMALL = 2**24  # bytes; `_MOST_OVERLAP` is checked only above this total length


@dataclass(frozen=True)
class View:
    """A checked entry of `bufferViews`."""

    buffer: int
    start: int  # first byte in the buffer
    length: int  # bytes, after decompression
    packed: tuple[str, Header] | None  # the name and content of an extension that compresses the view


@dataclass(frozen=True)
class Accessor:
    """A checked entry of `accessors`."""

    count: int
    dtype: np.dtype[Any]  # of a component
    width: int  # number of components
    view: int | None  # None if the accessor has no data
    start: int  # first byte in the view
    stride: int  # bytes from one item to the next
    normalized: bool
    sparse: Any  # checked when it is read


class Contents(NamedTuple):
    """What the bytes of a glTF file hold."""

    header: Header
    chunks: dict[int, bytes]  # the chunks of a GLB file after the JSON text, by their kinds
    views: list[View]
    accessors: list[Accessor]


def read(data: bytes) -> Contents:
    """Return the checked contents of a glTF or GLB file.

    Raises ValueError if the file is cut off, or if the header is inconsistent or needs an unknown extension or version.
    """
    chunks = split_glb(data) if data.startswith(_MAGIC) else {_JSON_CHUNK: data.removeprefix(codecs.BOM_UTF8)}
    header = _parsed(chunks.pop(_JSON_CHUNK))
    if not isinstance(header, dict):
        raise ValueError(f"its JSON is a {type(header).__name__}, not an object")
    _check_depth(header)
    _check_version(header)
    for name in _COLLECTIONS:
        objects(header, name)
    _check_extensions(header)
    views = _views(header, data.startswith(_MAGIC))
    accessors = _accessors(header, views)
    _check_primitives(header)
    _check_nodes(header)
    return Contents(header, chunks, views, accessors)


def _parsed(text: bytes) -> object:
    """Return the value of a JSON text. Raises ValueError with the place at which it is damaged."""
    try:
        return json.loads(text.decode())
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        if not text.lstrip().startswith((b"{", b"[")):
            raise ValueError("it begins neither with glTF, as a GLB file does, nor with a JSON object") from None
        if isinstance(error, UnicodeDecodeError):
            place = f"byte {error.start}, which is not UTF-8"
        else:
            place = f"character {error.pos}: {error.msg}"
        raise ValueError(f"its JSON text is damaged at {place}") from None


def split_glb(data: bytes) -> dict[int, bytes]:
    """Return the chunks of a GLB file by their kinds, the JSON text first."""
    if len(data) < 20:
        raise ValueError(f"it is cut off after {len(data)} bytes")
    version, total = struct.unpack("<II", data[4:12])
    if version != 2:
        raise ValueError(f"it has version {version} of the format, and only 2 can be read: {_CONVERT}")
    if total != len(data):
        raise ValueError(f"it should have {total} bytes, but has {len(data)}")
    chunks: dict[int, bytes] = {}
    end = 12
    while end + 8 <= len(data):
        kind, content, end = _chunk(data, end)
        if not chunks and kind != _JSON_CHUNK:
            raise ValueError("its first chunk is not JSON")
        chunks.setdefault(kind, content)
    return chunks


def join_glb(text: bytes, data: bytes, others: Mapping[int, bytes] = MappingProxyType({})) -> bytes:
    """Return a GLB file with this JSON text, this data chunk and `others`, which are chunks by their kinds."""
    chunks = [
        (_JSON_CHUNK, text + b" " * (-len(text) % 4)),
        (DATA_CHUNK, data + bytes(-len(data) % 4)),
        *others.items(),
    ]
    pieces = [piece for kind, content in chunks for piece in (struct.pack("<II", len(content), kind), content)]
    return b"".join([struct.pack("<4sII", _MAGIC, 2, 12 + sum(map(len, pieces))), *pieces])


def _chunk(data: bytes, start: int) -> tuple[int, bytes, int]:
    """Return the kind, the content and the end of the chunk at byte `start`."""
    length, kind = struct.unpack("<II", data[start : start + 8])
    end = start + 8 + length
    if end > len(data):
        raise ValueError(f"one of its chunks should have {length} bytes, but has {len(data) - start - 8}")
    return kind, data[start + 8 : end], end


def objects(owner: Header, name: str) -> list[Header]:
    """Return the list of objects `owner[name]` of the header; [] if there is none."""
    values = owner.get(name, [])
    if not isinstance(values, list) or not all(isinstance(value, dict) for value in values):
        raise ValueError(f"its {name!r} must be a list of objects")
    return values


def item(header: Header, name: str, index: object) -> Header | None:
    """Return the object with this index in the list `name` of the header; None if there is none."""
    values: list[Header] = header.get(name, [])
    return values[cast(int, index)] if is_index(index, len(values)) else None


def extension(owner: Header, name: str) -> Header | None:
    """Return the extension `name` of an object of the header; None if there is none."""
    found = owner.get("extensions")
    value = found.get(name) if isinstance(found, dict) else None
    return value if isinstance(value, dict) else None


def drop_extension(header: Header, owner: Header, name: str) -> None:
    """Remove the extension `name` of an object, and from the header's lists if no other node or primitive uses it."""
    owner["extensions"].pop(name)
    if not owner["extensions"]:
        del owner["extensions"]
    meshes = objects(header, "meshes")
    users = chain(objects(header, "nodes"), chain.from_iterable(objects(mesh, "primitives") for mesh in meshes))
    if any(extension(each, name) is not None for each in users):
        return
    for list_name in ("extensionsUsed", "extensionsRequired"):
        if name in header.get(list_name, []):
            header[list_name].remove(name)
            if not header[list_name]:  # the format allows no empty lists
                del header[list_name]


def drop_attribute(primitive: Header, name: str) -> None:
    """Remove an attribute from a primitive and from its morph targets, which must not refer to a missing attribute."""
    for owner in (primitive["attributes"], *objects(primitive, "targets")):
        owner.pop(name, None)


def parents(header: Header) -> dict[int, int]:
    """Return the parent of each child node, by the index of the child."""
    nodes = enumerate(objects(header, "nodes"))
    return {child: index for index, node in nodes for child in node.get("children", [])}


def animated_nodes(header: Header) -> set[object]:
    """Return the nodes that animations of the file translate, rotate or scale."""
    channels = (each for animation in objects(header, "animations") for each in objects(animation, "channels"))
    targets = (channel.get("target") for channel in channels)
    return {each.get("node") for each in targets if isinstance(each, dict) and each.get("path") != "weights"}


def primitives(mesh: Header) -> list[tuple[int, Header]]:
    """Return the index and the content of each primitive of a mesh, without primitives of points or lines."""
    return [each for each in enumerate(objects(mesh, "primitives")) if each[1].get("mode", 4) in MODES_READ]


def _check_depth(header: Header) -> None:
    """Raise ValueError if the nesting is so deep that Python's recursion limit could prevent writing the header."""
    layer: list[Any] = [header]
    for _ in range(_DEEPEST_JSON):
        inner = chain.from_iterable(value.values() if isinstance(value, dict) else value for value in layer)
        layer = [value for value in inner if isinstance(value, dict | list)]
        if not layer:
            return
    raise ValueError(f"its values are nested more than {_DEEPEST_JSON} deep")


def _check_version(header: Header) -> None:
    asset = header.get("asset", {})
    old = any(isinstance(header.get(name), dict) for name in _COLLECTIONS)  # version 1.0 had no lists
    usual = "1.0" if old else "2.0"
    version = str(asset.get("version", usual) if isinstance(asset, dict) else usual)
    if not version.startswith("2."):
        what = f"it has version {shortened(version)} of the format, and only 2 can be read"
        raise ValueError(f"{what}: {_CONVERT}")


def _check_extensions(header: Header) -> None:
    for list_name in ("extensionsRequired", "extensionsUsed"):
        names = header.get(list_name, [])
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise ValueError(f"its {list_name!r} must be a list of names")
    for name in header.get("extensionsRequired", []):
        library = _LIBRARIES.get(name)
        if library is not None:
            if importlib.util.find_spec(library) is None:
                raise ValueError(f"it is compressed with {name}, which needs `{pip_install('gltf')}` ({library})")
        elif not name.startswith(_HARMLESS):
            what = f"it requires the extension {shortened(name)}, which cannot be read"
            raise ValueError(f"{what}: export the file without this extension")


def _views(header: Header, glb: bool) -> list[View]:
    for i, buffer in enumerate(objects(header, "buffers")):
        fallback = any((extension(buffer, name) or {}).get("fallback") for name in MESHOPT)
        if not isinstance(buffer.get("uri"), str) and not (glb and i == 0) and not fallback:
            raise ValueError(f"buffer {i} has no URI")
    lengths = [whole(buffer, "byteLength", f"buffer {i}") for i, buffer in enumerate(objects(header, "buffers"))]
    views = []
    for i, view in enumerate(objects(header, "bufferViews")):
        number = reference(header, view, "buffer", f"bufferView {i}")
        start, length = whole(view, "byteOffset", f"bufferView {i}", 0), whole(view, "byteLength", f"bufferView {i}")
        packed = [(name, found) for name in MESHOPT if (found := extension(view, name)) is not None]
        for _, found in packed:
            reference(header, found, "buffer", f"bufferView {i}")
        if start + length > lengths[number]:
            end = f"bufferView {i} ends at byte {start + length}"
            raise ValueError(f"{end}, but its buffer has {lengths[number]} bytes")
        views.append(View(number, start, length, next(iter(packed), None)))
    total = sum(view.length for view in views)
    if total > max(_MOST_OVERLAP * sum(lengths), _SMALL):
        raise ValueError(f"its bufferViews cover {total} bytes in total, but its buffers have {sum(lengths)}")
    return views


def _accessors(header: Header, views: list[View]) -> list[Accessor]:
    if views and "accessors" not in header:
        raise ValueError("it has data, but no accessors and so no faces")
    total, longest, found = 0, 0, list[Accessor]()
    for i, accessor in enumerate(objects(header, "accessors")):
        count = whole(accessor, "count", f"accessor {i}")
        component, kind = accessor.get("componentType"), accessor.get("type")
        if not isinstance(component, int) or component not in COMPONENT_TYPES:
            raise ValueError(f"accessor {i} has the unknown componentType {shortened(component)}")
        if not isinstance(kind, str) or kind not in COMPONENTS:
            raise ValueError(f"accessor {i} has the unknown type {shortened(kind)}")
        dtype, width = np.dtype(COMPONENT_TYPES[component]), COMPONENTS[kind]
        size, normalized, sparse = dtype.itemsize * width, bool(accessor.get("normalized")), accessor.get("sparse")
        if "bufferView" not in accessor:
            found.append(Accessor(count, dtype, width, None, 0, size, normalized, sparse))
            continue
        view = reference(header, accessor, "bufferView", f"accessor {i}")
        owner = header["bufferViews"][view]
        stride = whole(owner, "byteStride", f"bufferView {view}", default=max(size, _LEAST_STRIDE))
        if stride < _LEAST_STRIDE:
            raise ValueError(f"bufferView {view} has the byteStride {stride}; glTF permits 4 to 252 bytes")
        if stride < size:
            raise ValueError(
                f"bufferView {view} has the byteStride {stride}, but items of accessor {i} have {size} bytes"
            )
        stride = stride if "byteStride" in owner else size
        start = whole(accessor, "byteOffset", f"accessor {i}", default=0)
        end, stored = start + ((count - 1) * stride + size if count else 0), views[view].length
        if end > stored:
            raise ValueError(f"accessor {i} has {count} items up to byte {end}, but its bufferView has {stored} bytes")
        found.append(Accessor(count, dtype, width, view, start, stride, normalized, sparse))
        total, longest = total + count * size, max(longest, count)
    stored = sum(view.length for view in views)
    if total > max(_MOST_OVERLAP * stored, _SMALL):
        raise ValueError(f"its accessors cover {total} bytes in total, but its bufferViews have {stored}")
    packed: set[object] = set()  # accessors whose data is in a Draco stream
    for _, primitive in (each for mesh in objects(header, "meshes") for each in primitives(mesh)):
        attributes = primitive.get("attributes")
        if extension(primitive, DRACO) is not None and isinstance(attributes, dict):
            packed.update(each for each in (*attributes.values(), primitive.get("indices")) if isinstance(each, int))
    for i, each in enumerate(found):
        if each.view is None and each.count > max(longest, _MOST_ZEROS) and i not in packed:
            raise ValueError(f"accessor {i} has {each.count} items but no data")
    return found


def _check_primitives(header: Header) -> None:
    accessors = objects(header, "accessors")
    for _, primitive in (each for mesh in objects(header, "meshes") for each in primitives(mesh)):
        attributes = primitive.get("attributes")
        if not isinstance(attributes, dict):
            raise ValueError("a primitive has no attributes")
        for name, number in (("positions", attributes.get("POSITION")), ("indices", primitive.get("indices"))):
            if not is_index(number, len(accessors)) and (number is not None or name == "positions"):
                raise ValueError(
                    f"a primitive names accessor {shortened(number)} for its {name}, but there are {len(accessors)}"
                )


def _check_nodes(header: Header) -> None:
    children = [node.get("children", []) for node in objects(header, "nodes")]
    for i, below in enumerate(children):
        if not isinstance(below, list) or not all(is_index(child, len(children)) for child in below):
            raise ValueError(f"node {i} has children that do not exist")
    parents = Counter(child for below in children for child in below)
    if many := [i for i in range(len(children)) if parents[i] > 1]:
        raise ValueError(f"node {many[0]} is the child of more than one node")
    layer, reached = [i for i in range(len(children)) if not parents[i]], 0
    for _ in range(_DEEPEST):
        reached += len(layer)
        layer = [child for i in layer for child in children[i]]
    if layer:
        raise ValueError(f"its nodes are nested more than {_DEEPEST} deep")
    if reached < len(children):
        raise ValueError("its nodes are their own ancestors")


def is_index(value: object, count: int) -> bool:
    """Return whether a value of the header is an index below `count`."""
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < count


def are_numbers(value: object) -> TypeGuard[list[float]]:
    """Return whether a value of the header is a list of numbers."""
    return isinstance(value, list) and all(type(each) in (int, float) for each in value)


def reference(header: Header, owner: Header, name: str, what: str) -> int:
    """Return the index `owner[name]` of an object in the header's list `f"{name}s"`. Errors begin with `what`."""
    value, count = whole(owner, name, what), len(header.get(f"{name}s", []))
    if value >= count:
        raise ValueError(f"{what} names {name} {value}, but there are {count}")
    return value


def whole(owner: Header, name: str, what: str, default: int | None = None) -> int:
    """Return the nonnegative integer `owner[name]` of the header. Errors begin with `what`."""
    value = owner.get(name, default)
    if isinstance(value, float) and value.is_integer():  # some programs write 12.0
        value = int(value)
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise ValueError(f"{what} has {name} {shortened(value)}")
    return value
