"""Make glTF files of a cube, compressed by the encoders of Draco and meshopt."""

import json
from typing import Any

import numpy as np
from mesh_files import CORNERS, CUBE, Gltf

from dfd.mesh.file.gltf.header import join_glb

__all__ = ["DRACO", "MESHOPT", "draco_cube", "meshopt_cube", "packed_glb"]

DRACO, MESHOPT = "KHR_draco_mesh_compression", "EXT_meshopt_compression"


def draco_cube(**attributes: Any) -> Gltf:
    import DracoPy

    stream = DracoPy.encode(CORNERS.astype(np.float32), CUBE.astype(np.uint32), quantization_bits=14, **attributes)
    decoded = DracoPy.decode(stream)
    gltf = Gltf()
    position = next(each["unique_id"] for each in decoded.attributes if each["data"].shape[1] == 3)
    packed = {"bufferView": gltf.view(stream), "attributes": {"POSITION": position}}
    gltf.header["accessors"] += [
        {"componentType": 5126, "count": len(decoded.points), "type": "VEC3"},
        {"componentType": 5125, "count": decoded.faces.size, "type": "SCALAR"},
    ]
    primitive = {"attributes": {"POSITION": 0}, "indices": 1, "extensions": {DRACO: packed}}
    gltf.header["meshes"] = [{"name": "cube", "primitives": [primitive]}]
    gltf.header |= {name: [DRACO] for name in ("extensionsUsed", "extensionsRequired")}
    gltf.node(name="cube", mesh=0)
    return gltf


def meshopt_cube() -> Gltf:
    import meshopt

    positions = np.pad(CORNERS, ((0, 0), (0, 1))).astype("<f4")
    indices = CUBE.astype("<u4").ravel()
    packed = [meshopt.encode_gltf_buffer(positions, "ATTRIBUTES"), meshopt.encode_gltf_buffer(indices, "TRIANGLES")]
    gltf = Gltf()
    gltf.node(name="cube", mesh=gltf.mesh("cube", CORNERS, CUBE))
    gltf.header["bufferViews"], gltf.data = [], b""
    start = 0
    for stream, count, stride, mode in zip(packed, (8, 36), (16, 4), ("ATTRIBUTES", "TRIANGLES"), strict=True):
        place = len(gltf.data)
        gltf.data += stream + b"\0" * (-len(stream) % 4)
        extension = {"buffer": 0, "byteOffset": place, "byteLength": len(stream), "byteStride": stride, "count": count}
        view = {
            "buffer": 1,
            "byteOffset": start,
            "byteLength": count * stride,
            "extensions": {MESHOPT: extension | {"mode": mode}},
        }
        gltf.header["bufferViews"].append(view | ({"byteStride": 16} if stride == 16 else {}))
        start += count * stride
    gltf.header["buffers"] = [
        {"byteLength": len(gltf.data)},
        {"byteLength": start, "extensions": {MESHOPT: {"fallback": True}}},
    ]
    gltf.header |= {name: [MESHOPT] for name in ("extensionsUsed", "extensionsRequired")}
    return gltf


def packed_glb(gltf: Gltf) -> bytes:
    header = {key: value for key, value in gltf.header.items() if value != []}
    return join_glb(json.dumps(header).encode(), gltf.data)
