"""The formats of mesh files: how each is read, written anew, and rewritten with only positions and normals changed."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from dfd.common.linear_algebra import Float64
from dfd.mesh.file.assets import AssetFolder
from dfd.mesh.file.gltf import build as gltf_build
from dfd.mesh.file.gltf import patch as gltf_patch
from dfd.mesh.file.gltf import read as gltf_read
from dfd.mesh.file.moved import Saving
from dfd.mesh.file.obj import patch as obj_patch
from dfd.mesh.file.obj import read as obj_read
from dfd.mesh.file.obj import write as obj_write
from dfd.mesh.file.plain import off, ply, stl
from dfd.mesh.file.scene_file import SceneFile

# The contents of the written files, by name, and the distances by which rounding to 32-bit floats moves vertices.
_Written = tuple[dict[str, bytes], Float64]


class Format(NamedTuple):
    """The functions of a format."""

    read: Callable[[Path, bytes, AssetFolder, bool], SceneFile]  # the last argument: at rest, or in the bind pose
    encode: Callable[[Saving], _Written]
    rewrite: Callable[[Saving], _Written]  # for a mesh from a file of the same format


_GLTF = Format(gltf_read.read_scene, gltf_build.encode, gltf_patch.rewrite)
FORMATS = {
    ".obj": Format(obj_read.read, obj_write.encode, obj_patch.rewrite),
    ".ply": Format(ply.read, ply.encode, ply.rewrite),
    ".stl": Format(stl.read, stl.encode, stl.rewrite),
    ".off": Format(off.read, off.encode, off.rewrite),
    ".glb": _GLTF,
    ".gltf": _GLTF,
}
ENDINGS = tuple(FORMATS)
