"""Reading the displayed scene of an FBX file: polygons of its meshes, placed by its nodes, posed by its skins.

Axes and units become glTF's: y up, z to the front, meters. The format is Autodesk's; ufbx reads it, in a process of its
own (`fbx_process`).
"""

from __future__ import annotations

import importlib.util
import io
import json
import os
import subprocess
import sys
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dfd.common.errors import ArgumentError
from dfd.common.linear_algebra import Float64, Int64
from dfd.mesh.appearance import Material, Wrap
from dfd.mesh.file.assets import AssetFolder, shortened
from dfd.mesh.file.images import ImageCache
from dfd.mesh.file.materials import rgba
from dfd.mesh.file.polygons import check_corners, distinct_rows, ranges, triangulate
from dfd.mesh.file.primitives import IDENTITY, MOST_INSTANCES, Geometry, MeshInstance, UniqueNames
from dfd.mesh.weld import weld

MOST_SECONDS = 600.0  # a file that takes longer to read is refused

Header = dict[str, Any]


class _Surface(NamedTuple):
    material: Material
    uv_set: str = ""  # the first one where it is empty, or none of that name
    uv_transform: Float64 | None = None  # (3, 2) of coordinates and 1


class _Corners(NamedTuple):
    """An attribute of a mesh: values, and which of them each corner has."""

    values: NDArray[Any]
    indices: Int64

    def distinct(self) -> _Corners:
        """The same with equal values once: files often write them anew for each corner."""
        padded = np.zeros((len(self.values), max(self.values.shape[1], 3)))
        padded[:, : self.values.shape[1]] = self.values
        first, same = weld(padded[:, :3])
        number = same.astype(np.int64)
        if padded.shape[1] > 3:
            rows, number = distinct_rows(np.column_stack([number, weld(np.roll(padded, 1, axis=1)[:, :3])[1]]))
            first = np.empty(len(rows), np.int64)
            first[number[::-1]] = np.arange(len(number))[::-1]
        return _Corners(self.values[first], number[self.indices])


def read(data: bytes, assets: AssetFolder, *, at_rest: bool = True) -> list[MeshInstance]:
    """Return the mesh instances of the nodes that are visible, in the file's order; of all where none is.

    With `at_rest`, skins and blend shapes are applied as the file's nodes stand; otherwise both are ignored.

    Raises ArgumentError if ufbx is not installed. Raises ValueError if the file is damaged.
    """
    if importlib.util.find_spec("ufbx") is None:
        raise ArgumentError("path", "is an FBX file, which needs `pip install dfd[fbx]` to be read")
    with np.load(io.BytesIO(_in_process(data)), allow_pickle=False) as archive:
        arrays = [archive[str(number)] for number in range(len(archive.files))]
    scene = json.loads(arrays.pop().tobytes())
    images = ImageCache()
    surfaces = [_surface(each, arrays, assets, images) for each in scene["materials"]]
    nodes = [each for each in scene["nodes"] if each["visible"]] or scene["nodes"]
    taken, instances = UniqueNames(), list[MeshInstance]()
    known: dict[tuple[int, tuple[int, ...]], list[Geometry]] = {}
    for node in nodes:
        mesh, materials = scene["meshes"][node["mesh"]], tuple(node["materials"])
        if (key := (node["mesh"], materials)) not in known:
            known[key] = _geometries(mesh, arrays, [surfaces[each] for each in materials], at_rest=at_rest)
        part = taken.unique(node["name"] or mesh["name"] or "node")
        in_scene = at_rest and mesh["posed"] is not None and not mesh["posed_is_local"]
        placed = IDENTITY
        if not in_scene:
            placed = np.vstack([np.array(node["matrix"], np.float64).T, [0, 0, 0, 1]])
            placed = IDENTITY if np.array_equal(placed, IDENTITY) else placed
        instances += [MeshInstance(part, mesh["name"] or part, each, placed) for each in known[key]]
        if len(instances) > MOST_INSTANCES:
            raise ValueError(f"its scene places more than {MOST_INSTANCES} meshes")
    return instances


def _in_process(data: bytes) -> bytes:
    """Return what `fbx_process` makes of a file."""
    command = [sys.executable, str(Path(__file__).with_name("fbx_process.py"))]
    paths = os.pathsep.join(each for each in sys.path if each)
    ended = subprocess.run(
        command,
        input=data,
        capture_output=True,
        timeout=MOST_SECONDS,
        env={**os.environ, "PYTHONPATH": paths, "OPENBLAS_NUM_THREADS": "1"},
        check=False,
    )
    if ended.returncode != 0:
        said = ended.stderr.decode("utf-8", "replace").strip().splitlines()
        raise ValueError(said[-1] if ended.returncode == 1 and said else "its reader crashed")
    return ended.stdout


def _geometries(mesh: Header, arrays: list[NDArray[Any]], surfaces: list[_Surface], *, at_rest: bool) -> list[Geometry]:
    """Return the geometries of a mesh: one for each of its materials."""

    def corners(entry: Header | None) -> _Corners | None:
        if entry is None or entry.get("values") is None or entry.get("indices") is None:
            return None
        found = _Corners(arrays[entry["values"]].astype(np.float64), arrays[entry["indices"]].astype(np.int64))
        check_corners(found.indices, len(found.values))
        return found

    positions = corners(mesh["positions"])
    if mesh["faces"] is None or positions is None:
        return []
    posed = at_rest and mesh["posed"] is not None
    shown = (corners(mesh["posed"]) if posed else None) or positions
    normals = corners(mesh["posed_normals"] if posed else mesh["normals"])
    colors = corners(mesh["colors"])
    faces = arrays[mesh["faces"]].astype(np.int64)
    material = np.zeros(len(faces), np.int64)
    if mesh["face_material"] is not None and surfaces:
        material = np.minimum(arrays[mesh["face_material"]].astype(np.int64), len(surfaces) - 1)
    kept = faces[:, 1] >= 3
    faces, material = faces[kept], material[kept]
    found = []
    for number in dict.fromkeys(material.tolist()):
        here = material == number
        surface = surfaces[number] if surfaces else None
        used = ranges(faces[here, 0], faces[here, 1])
        named = {each["name"]: each for each in reversed(mesh["uv"])}
        uv = corners(named.get("" if surface is None else surface.uv_set) or next(iter(mesh["uv"]), None))
        attributes = [None if each is None else each.distinct() for each in (normals, uv, colors)]
        keys = [each.indices[used] for each in attributes if each is not None]
        rows, row = distinct_rows(np.column_stack([shown.indices[used], *keys]))
        values = iter(rows[:, 1:].T)
        normal, coordinates, color = (None if each is None else each.values[next(values)] for each in attributes)
        if coordinates is not None and surface is not None and surface.uv_transform is not None:
            coordinates = coordinates @ surface.uv_transform[:2] + surface.uv_transform[2]
        found.append(
            Geometry(
                shown.values[rows[:, 0]],
                row[triangulate(positions.values, positions.indices[used], faces[here, 1])],
                normal,
                coordinates,
                None if color is None else rgba(color),
                material=None if surface is None else surface.material,
            )
        )
    return found


def _surface(content: Header, arrays: list[NDArray[Any]], assets: AssetFolder, images: ImageCache) -> _Surface:
    """Return a material as it is shown: its texture alone, or else its color, as of an OBJ file."""
    name, texture, opacity = content["name"], content["texture"], float(content["opacity"])
    # Many programs write an opacity of 0 for what is solid.
    alpha = opacity if 0 < opacity < 1 else 1.0
    color = content["color"]
    if texture is not None and (data := _picture(texture, arrays, assets)) is not None:
        try:
            texels = images.texels(images.open(data))
        except ValueError:
            assets.unreadable.add(f"the texture of material {shortened(name)}")
        else:
            across, down = (("clamp" if each else "repeat") for each in texture["clamp"])
            wrap: tuple[Wrap, Wrap] = (across, down)  # type: ignore[assignment]
            mode = "BLEND" if alpha < 1 or content["cut_out"] else "OPAQUE"
            made = Material((1.0, 1.0, 1.0, alpha), texels, wrap, mode, name=name)  # type: ignore[arg-type]
            matrix = None if texture["matrix"] is None else np.array(texture["matrix"], np.float64)[[0, 1, 3], :2]
            return _Surface(made, texture["uv_set"], matrix)
    if texture is not None or color is None or not np.isfinite(color).all():
        return _Surface(Material(name=name, is_default=True))
    red, green, blue = np.clip(color, 0, 1).tolist()
    return _Surface(Material((red, green, blue, alpha), alpha_mode="BLEND" if alpha < 1 else "OPAQUE", name=name))


def _picture(texture: Header, arrays: list[NDArray[Any]], assets: AssetFolder) -> bytes | None:
    """Return the file of a texture: inside, or beside, where it is named by paths of another machine too."""
    if texture["content"] is not None:
        return arrays[texture["content"]].tobytes()
    names = [name.replace("\\", "/") for name in texture["names"] if name]
    for name in [*names, *(PurePosixPath(each).name for each in names)]:
        try:
            return assets.read(name)
        except (ValueError, OSError):
            continue
    assets.unreadable.add(shortened(names[0]) if names else "a texture without a name")
    return None
