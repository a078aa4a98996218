"""Read a mesh file of any supported format as a scene."""

import errno
import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from dfd.common import check
from dfd.common.errors import ArgumentError, one_line
from dfd.mesh.file.assets import AssetFolder, read_regular
from dfd.mesh.file.obj import read as obj_read
from dfd.mesh.file.obj import text as obj_text
from dfd.mesh.file.plain import off_stl, ply
from dfd.mesh.file.primitives import MeshInstance, UniqueNames
from dfd.mesh.file.scene_file import FileSource, SceneFile

_MOST_NAMED = 5  # largest number of unreadable files that a warning lists
ENDINGS = (".obj", ".ply", ".stl", ".off", ".glb", ".gltf")


def read(path: str | os.PathLike[str], *, at_rest: bool = True) -> SceneFile:
    """Return the scene of a file, in the bind pose if `at_rest` is False. Raises the errors of `dfd.load`."""
    path = Path(path)
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        raise ArgumentError("path", f"must end in {', '.join(ENDINGS)}, got {path}", "load")
    try:
        data = read_regular(path)
    except OSError as error:
        raise OSError(error.errno, f"load: `path` {path} could not be read: {error.strerror}") from error
    if not data:
        raise ArgumentError("path", f"{path} is empty", "load")
    assets = AssetFolder(path)
    try:
        scene = _scene(path, data, assets, at_rest=at_rest)
    except MemoryError as error:
        raise OSError(errno.ENOMEM, f"load: `path` {path} needs more memory than is available") from error
    except ArgumentError as error:  # the file is well-formed, but its content is no valid mesh
        raise ArgumentError("path", f"{path} {error.reason}", "load") from error
    except UserWarning:
        raise
    except Exception as error:  # for malformed files, libraries raise errors of any type
        kind = "" if isinstance(error, ValueError) else f"{type(error).__name__}: "
        reason = one_line(f"{kind}{error}").removesuffix(":")[:300]
        form = ending[1:].upper()
        raise ArgumentError("path", f"{path} is not a well-formed {form} file: {reason}", "load") from error
    if assets.unreadable:
        names = ", ".join(each[:100] for each in sorted(assets.unreadable)[:_MOST_NAMED])
        names += ", …" if len(assets.unreadable) > _MOST_NAMED else ""
        check.warn(f"load: `path` {path} names {names}, which could not be read; affected faces are gray", UserWarning)
    return scene


def _scene(path: Path, data: bytes, assets: AssetFolder, *, at_rest: bool) -> SceneFile:
    ending, source = path.suffix.lower(), FileSource(path, np.frombuffer(data, np.uint8))
    if ending in (".glb", ".gltf"):
        from dfd.mesh.file.gltf import read as gltf_read

        content = gltf_read.parse(data, assets)
        return SceneFile.of(path, gltf_read.read(content, at_rest=at_rest), gltf=content)
    if ending == ".obj":
        text = obj_text.parse(data)
        instances, numbers, corner_rows = obj_read.read(text, path, assets)
        source = FileSource(path, np.frombuffer(text.data, np.uint8), numbers, corner_rows)
        return SceneFile.of(path, instances, own_vertices=text.positions, source=source)
    if ending == ".stl":
        solids, names = off_stl.read_stl(data), UniqueNames()
        parts = [(names.unique((len(solids) > 1 and name) or path.stem), each) for name, each in solids]
        return SceneFile.of(path, [MeshInstance(name, name, each) for name, each in parts], source=source)
    if ending == ".ply":
        geometry, vertices, numbers = ply.read(path, data, assets)
    else:
        geometry = off_stl.read_off(data)
        vertices, numbers = geometry.vertices, np.arange(len(geometry.vertices))
    instances = [MeshInstance(path.stem, path.stem, geometry)]
    return SceneFile.of(path, instances, own_vertices=vertices, source=replace(source, numbers=numbers))
