"""Reading a mesh file, whatever its format, into the scene that it holds."""

from __future__ import annotations

import codecs
import errno
import io
import os
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dfd.mesh.file import plain_formats
from dfd.mesh.file.assets import AssetFolder, read_regular
from dfd.mesh.file.gltf import glb
from dfd.mesh.file.images import ImageCache
from dfd.mesh.file.obj import read as obj_read
from dfd.mesh.file.obj import text as obj_text
from dfd.mesh.file.primitives import MeshInstance
from dfd.mesh.file.scene_file import SceneFile

# What a format needs is imported where it is read: trimesh alone takes half a second.
if TYPE_CHECKING:
    import trimesh

__all__ = ["ENDINGS", "of_trimesh", "read"]

ENDINGS = (".obj", ".ply", ".stl", ".off", ".glb", ".gltf")


def read(path: str | os.PathLike[str]) -> SceneFile:
    """Return the scene of a file; raises what `dfd.load` raises."""
    path = Path(path)
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        raise ValueError(f"load: `path` must end in {', '.join(ENDINGS)}, got {path}")
    data = _read_bytes(path)
    assets = AssetFolder(path)
    reader = {".obj": _read_obj, ".glb": _read_gltf, ".gltf": _read_gltf}.get(ending, _read_plain)
    try:
        scene = reader(path, data, assets)
    except MemoryError as error:
        raise OSError(errno.ENOMEM, f"load: `path` {path} needs more memory than there is") from error
    except ValueError as error:
        if str(error).startswith("load: "):
            raise
        raise _malformed(path, str(error)) from error
    except UserWarning:
        raise
    except Exception as error:  # trimesh raises ten different types on malformed files
        reason = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        raise _malformed(path, reason) from error
    if assets.unreadable:
        names = ", ".join(sorted(assets.unreadable))
        warnings.warn(
            f"load: `path` {path} names {names}, which could not be read; what it would color is grey",
            stacklevel=3,
        )
    return scene


def of_trimesh(source: trimesh.Trimesh | trimesh.Scene) -> SceneFile:
    """Return what a trimesh object holds, as a scene; its arrays are copied.

    Raises
    ------
    ValueError
        If it holds no faces, an index out of range or a coordinate that is not finite.
    """
    import trimesh

    if isinstance(source, trimesh.Trimesh):
        copy = source.copy()
        instances = [MeshInstance(str(source.metadata.get("name") or "mesh"), "mesh", copy)]
        vertices = np.asarray(copy.vertices, np.float64)
        return SceneFile.of(None, instances, {}, own_vertices=vertices, own_numbers=np.arange(len(vertices)))
    copies = {name: each.copy() for name, each in source.geometry.items() if isinstance(each, trimesh.Trimesh)}
    instances = []
    for node in source.graph.nodes_geometry:
        transform, name = source.graph[node]
        if name in copies:
            matrix = None if np.array_equal(transform, np.eye(4)) else np.asarray(transform, np.float64)
            instances.append(MeshInstance(str(node), name, copies[name], matrix))
    return SceneFile.of(None, instances, {})


def _read_bytes(path: Path) -> bytes:
    try:
        data = read_regular(path)
    except OSError as error:
        raise OSError(error.errno, f"load: `path` {path} could not be read: {error.strerror}") from error
    if not data:
        raise ValueError(f"load: `path` {path} is empty")
    return data


def _malformed(path: Path, reason: str) -> ValueError:
    first = " ".join(reason.split())
    return ValueError(f"load: `path` {path} is not a well-formed {path.suffix[1:].upper()} file: {first[:300]}")


def _read_obj(path: Path, data: bytes, assets: AssetFolder) -> SceneFile:
    text = obj_text.parse(data)
    instances, looks, numbers, source = obj_read.read(text, path, assets)
    return SceneFile.of(path, instances, looks, own_vertices=text.positions, own_numbers=numbers, obj=source)


def _read_gltf(path: Path, data: bytes, assets: AssetFolder) -> SceneFile:
    from dfd.mesh.file.gltf import header as gltf_header
    from dfd.mesh.file.gltf import read as gltf_read
    from dfd.mesh.file.gltf.data import GltfData
    from dfd.mesh.file.gltf.patch import GltfSource

    text, embedded = glb.split(data) if glb.is_glb(data) else (data.removeprefix(codecs.BOM_UTF8), None)
    header = gltf_header.read(path, text, glb=glb.is_glb(data))
    content = GltfData(header, embedded, assets)
    instances, looks = gltf_read.read(header, content, assets)
    return SceneFile.of(path, instances, looks, linear=True, gltf=GltfSource(text, header, content))


def _read_plain(path: Path, data: bytes, assets: AssetFolder) -> SceneFile:
    import trimesh

    ending = path.suffix.lower()
    data = plain_formats.checked(data, ending)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.filterwarnings("error", message=".*could not be read to its end.*")  # NumPy, of cut-off numbers
        options = {"file_type": ending[1:], "resolver": _PictureResolver(assets), "process": False}
        loaded: Any = trimesh.load_scene(io.BytesIO(data), **options)
    meshes = [each for each in loaded.geometry.values() if isinstance(each, trimesh.Trimesh)]
    instances = [MeshInstance(path.stem, path.stem, each) for each in meshes]
    if ending == ".stl" or len(instances) != 1:
        return SceneFile.of(path, instances, {})
    vertices = instances[0].geometry.vertices.view(np.ndarray).astype(np.float64)
    return SceneFile.of(path, instances, {}, own_vertices=vertices, own_numbers=np.arange(len(vertices)))


class _PictureResolver:
    """Gives trimesh the pictures that a PLY file names, and nothing else."""

    def __init__(self, assets: AssetFolder) -> None:
        self._assets, self._images = assets, ImageCache()

    def get(self, name: str) -> bytes:
        try:
            data = self._assets.read(name)
            self._images.open(data)
        except (ValueError, OSError):
            self._assets.unreadable.add(name)
            raise
        return data

    __getitem__ = get
