"""The binary data of a glTF file: buffers, buffer views and accessors, each read and decompressed on first use."""

import base64
import binascii
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from dfd.common.distribution import pip_install
from dfd.common.linear_algebra import UInt8
from dfd.mesh.file.assets import AssetFolder
from dfd.mesh.file.gltf.header import (
    COMPONENT_TYPES,
    DATA_CHUNK,
    DRACO,
    Accessor,
    Header,
    extension,
    is_index,
    item,
    objects,
    read,
    reference,
    whole,
)
from dfd.mesh.file.primitives import Primitive
from dfd.mesh.file.text import shortened

_MOST_DECOMPRESSED = 64  # largest number of decompressed bytes per compressed byte, in all buffer views together
_SMALL = 2**26  # bytes; the ratio `_MOST_DECOMPRESSED` is checked only above this decompressed size
_DATA_ENDINGS = (".bin", ".glbin", ".glbuf")
_ALIGNMENT = 4  # bytes; programs may pad data to a multiple of this length
_UNSIGNED = (5121, 5123, 5125)  # component types of unsigned integers with 8, 16 and 32 bits


class GltfData:
    """The JSON header of a glTF file, and its data. Methods raise ValueError or OSError if data cannot be read."""

    def __init__(self, content: bytes, assets: AssetFolder) -> None:
        """Check the header of the glTF or GLB file with this content. External files are read from a folder."""
        self._checked = read(content)
        self.header, self.chunks = self._checked.header, self._checked.chunks
        self.content = np.frombuffer(content, np.uint8)  # an array, because processes can share arrays
        self._embedded = self.chunks.pop(DATA_CHUNK, None)
        self.assets = assets
        self._buffers: dict[int, UInt8] = {}  # arrays, because processes can share them
        self._views: dict[int, bytes] = {}
        self._draco: dict[int, tuple[dict[int, NDArray[Any]], NDArray[Any]]] = {}
        self._compressed = self._decompressed = 0

    @property
    def is_complete(self) -> bool:
        """Whether the file refers to no other files."""
        owners = [*objects(self.header, "buffers"), *objects(self.header, "images")]
        return all(str(each.get("uri", "data:")).startswith("data:") for each in owners)

    def buffer(self, index: int) -> UInt8:
        """Return the bytes of a buffer."""
        if index not in self._buffers:
            buffer = self.header["buffers"][index]
            uri, length = buffer.get("uri"), int(buffer["byteLength"])
            if uri is not None:
                data = self._linked(uri)
                # Saving copies the data into the new file, so a malicious glTF file could leak any file that it
                # references. Therefore, the header must state the true length of a file without a usual ending.
                usual = uri.startswith("data:") or uri.lower().endswith(_DATA_ENDINGS)
                if not usual and not 0 <= len(data) - length < _ALIGNMENT:
                    raise ValueError(f"buffer {index} should have {length} bytes, but {shortened(uri)} has {len(data)}")
            elif index == 0 and self._embedded is not None:
                data = self._embedded
            else:
                raise ValueError(f"buffer {index} has no data")
            if len(data) < length:
                raise ValueError(f"buffer {index} should have {length} bytes, but has {len(data)}")
            if data is self._embedded:
                self._embedded = None
            self._buffers[index] = np.frombuffer(data, np.uint8)[:length]
        return self._buffers[index]

    def _linked(self, uri: str) -> bytes:
        """Return the content of a data URI in base 64, or of an external file."""
        if not uri.startswith("data:"):
            return self.assets.read(uri)
        head, _, body = uri.partition(",")
        if not head.endswith(";base64"):
            raise ValueError(f"{shortened(uri)} is not in base 64")
        try:
            return base64.b64decode(body, validate=False)
        except binascii.Error as error:
            raise ValueError(f"{shortened(uri)} is not in base 64: {error}") from error

    def view(self, index: int) -> memoryview:
        """Return the bytes of a buffer view, decompressed."""
        view = self._checked.views[index]
        if view.packed is None:
            return self.buffer(view.buffer).data[view.start : view.start + view.length]
        if index not in self._views:
            self._views[index] = self._decompress(index, *view.packed, view.length)
        return memoryview(self._views[index])

    def picture(self, image: Header) -> bytes:
        """Return the bytes of an entry of `images`: from a buffer view, a data URI or an external file."""
        uri = image.get("uri")
        if isinstance(uri, str):
            return self._linked(uri)
        if item(self.header, "bufferViews", image.get("bufferView")) is None:
            raise ValueError("an image has no data")
        return bytes(self.view(image["bufferView"]))

    def accessor(self, index: object) -> NDArray[Any]:
        """Return the items (count, components) of an accessor; normalized integers are converted to floats."""
        accessor = self._accessor(index)
        if accessor is None:
            raise ValueError(f"accessor {shortened(index)} does not exist")
        values = np.zeros((accessor.count, accessor.width), accessor.dtype)
        if accessor.view is not None and accessor.count:
            # The view may end after the last item, before the end of this item's stride.
            strides = (accessor.stride, accessor.dtype.itemsize)
            values = np.ndarray(values.shape, accessor.dtype, self.view(accessor.view), accessor.start, strides)
        if accessor.sparse is not None:
            values = self._replaced(values.copy(), accessor.sparse, f"accessor {index}")
        return _as_numbers(values, accessor.normalized)

    def _accessor(self, index: object) -> Accessor | None:
        found = self._checked.accessors
        return found[cast(int, index)] if is_index(index, len(found)) else None

    def primitive(self, each: Primitive) -> Header:
        """Return the header of a primitive of the scene."""
        _, mesh, number = each.source
        return cast(Header, self.header["meshes"][mesh]["primitives"][number])

    def attribute(self, primitive: Header, name: str) -> NDArray[Any] | None:
        """Return an attribute (vertices, components) of a primitive, or None if the primitive lacks it."""
        packed = self.draco(primitive) or {}
        if name in packed:
            return packed[name]
        return self.accessor(primitive["attributes"][name]) if name in primitive["attributes"] else None

    def corners(self, primitive: Header) -> NDArray[Any]:
        """Return the vertex indices (N,) of a primitive's face corners, in order."""
        packed = self.draco(primitive)
        if packed is not None:
            return packed["indices"].ravel()
        if "indices" not in primitive:
            return np.arange(len(self.accessor(primitive["attributes"]["POSITION"])))
        index = primitive["indices"]
        accessor = self._accessor(index)
        if accessor is None or accessor.dtype.kind != "u" or accessor.width > 1 or accessor.normalized:
            found = item(self.header, "accessors", index) or {}
            kinds = (found.get("componentType"), found.get("type"), found.get("normalized", False))
            raise ValueError(f"accessor {shortened(index)}, of indices, must hold unsigned whole numbers, got {kinds}")
        return self.accessor(index).ravel()

    def draco(self, primitive: Header) -> dict[str, NDArray[Any]] | None:
        """Return the attributes of a Draco-compressed primitive by name, and its vertex indices as "indices".

        Return None if the primitive is not compressed.
        """
        packed = extension(primitive, DRACO)
        if packed is None:
            return None
        names, view = packed.get("attributes"), packed.get("bufferView")
        if not isinstance(names, dict) or item(self.header, "bufferViews", view) is None:
            raise ValueError(f"its {DRACO} has no attributes or no data")
        by_id, faces = self._draco_mesh(cast(int, view))
        found: dict[str, NDArray[Any]] = {}
        for name, number in names.items():
            accessor = self._accessor(primitive["attributes"].get(name))
            if accessor is not None and isinstance(number, int) and number in by_id:
                values = by_id[number].reshape(len(by_id[number]), -1)
                self._require_count(primitive["attributes"][name], len(values))
                found[name] = _as_numbers(values, accessor.normalized)
        if "POSITION" not in found:
            raise ValueError(f"its {DRACO} holds no positions")
        if "indices" in primitive and primitive.get("mode", 4) == 4:
            self._require_count(primitive["indices"], len(faces))
        return {**found, "indices": faces}

    def _require_count(self, index: object, count: int) -> None:
        accessor = self._accessor(index)
        if accessor is None or accessor.count != count:
            stated = "no" if accessor is None else accessor.count
            raise ValueError(f"accessor {shortened(index)} has {stated} items, but {DRACO} holds {count}")

    def _draco_mesh(self, view: int) -> tuple[dict[int, NDArray[Any]], NDArray[Any]]:
        """Return the attributes of a Draco stream by their ids, and the vertex index (N, 1) of each face corner."""
        if view not in self._draco:
            try:
                import DracoPy
            except ImportError as error:
                raise ValueError(f"it is compressed with {DRACO}, which needs `{pip_install('gltf')}`") from error
            try:
                decoded = DracoPy.decode(bytes(self.view(view)))
                by_id = {each["unique_id"]: np.asarray(each["data"]) for each in decoded.attributes}
                self._draco[view] = by_id, np.asarray(decoded.faces).reshape(-1, 1)  # fails for point clouds
            except Exception as error:  # DracoPy raises errors of many types
                raise ValueError(f"its {DRACO} cannot be decoded: {str(error) or type(error).__name__}") from error
        return self._draco[view]

    def _decompress(self, index: int, name: str, packed: Header, length: int) -> bytes:
        """Return the bytes of a view that is compressed with meshoptimizer."""
        try:
            import meshopt
        except ImportError as error:
            raise ValueError(f"it is compressed with {name}, which needs `{pip_install('gltf')}`") from error
        what = f"bufferView {index}, of {name},"
        buffer = reference(self.header, packed, "buffer", what)
        size = whole(packed, "byteLength", what)
        start = whole(packed, "byteOffset", what, default=0)
        count, stride = whole(packed, "count", what), whole(packed, "byteStride", what)
        if count * stride != length:
            raise ValueError(f"{what} should have {length} bytes, but has {count} items of {stride} bytes")
        data = self.buffer(buffer)[start : start + size].tobytes()
        if len(data) < size:
            raise ValueError(f"{what} is cut off")
        self._compressed, self._decompressed = self._compressed + size, self._decompressed + length
        if self._decompressed > max(_MOST_DECOMPRESSED * self._compressed, _SMALL):
            raise ValueError(f"{what} and others expand from {self._compressed} to {self._decompressed} bytes")
        try:
            plain = meshopt.decode_gltf_buffer(data, count, stride, packed.get("mode"), packed.get("filter", "NONE"))
        except Exception as error:
            raise ValueError(f"{what} cannot be decoded: {str(error) or type(error).__name__}") from error
        return np.ascontiguousarray(plain).tobytes()

    def _replaced(self, values: NDArray[Any], sparse: Any, what: str) -> NDArray[Any]:
        """Replace the items of `values` that the `sparse` object of an accessor lists, and return `values`."""
        parts: list[Any] = [sparse.get(name) for name in ("indices", "values")] if isinstance(sparse, dict) else [None]
        if not all(isinstance(part, dict) for part in parts):
            raise ValueError(f"{what} is sparse, but has no indices or no values")
        count = whole(sparse, "count", what)
        kind = parts[0].get("componentType")
        if kind not in _UNSIGNED:
            raise ValueError(f"{what} has sparse indices of the componentType {shortened(kind)}, which is not unsigned")

        def stored(part: Header, dtype: np.dtype[Any], width: int) -> NDArray[Any]:
            start = whole(part, "byteOffset", what, default=0)
            data = self.view(reference(self.header, part, "bufferView", what))
            if start + count * width * dtype.itemsize > len(data):
                raise ValueError(f"{what} has {count} sparse items, which end after byte {len(data)}")
            return np.frombuffer(data, dtype, count * width, start).reshape(count, width)

        where = stored(parts[0], np.dtype(COMPONENT_TYPES[kind]), 1).ravel()
        changed = stored(parts[1], values.dtype, values.shape[1])
        if count and int(where.max()) >= len(values):
            raise ValueError(f"{what} has the sparse index {int(where.max())}, but only {len(values)} items")
        values[where] = changed
        return values


def _as_numbers(values: NDArray[Any], normalized: bool) -> NDArray[Any]:
    """Convert normalized integers to floats: glTF 2.0, section 3.11."""
    if not normalized or values.dtype.kind not in "iu":
        return values
    return np.maximum(values.astype(np.float64) / np.iinfo(values.dtype).max, -1.0)
