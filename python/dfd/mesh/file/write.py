"""Write a mesh to a file. A mesh from a file keeps its scene, in which only positions and normals change."""

import os
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from dfd.common import check
from dfd.common.files import atomic_write
from dfd.common.linear_algebra import Float64, Int32
from dfd.mesh.appearance import Appearance
from dfd.mesh.file.edits import COARSE
from dfd.mesh.file.formats import ENDINGS, FORMATS
from dfd.mesh.file.moved import Saving, moved_primitives
from dfd.mesh.file.scene_file import SceneFile


def write(
    path: str | os.PathLike[str], vertices: Float64, faces: Int32, look: Appearance | None, scene: SceneFile | None
) -> Float64:
    """Write a mesh with its vertices at `vertices` (V, 3). A mesh from a file keeps the other content of its `scene`.

    Return the distances (N,) by which rounding to 32-bit floats moves vertices. Only STL files, and moved glTF meshes
    with a skin or morph targets, give such distances; N is 0 for all other files. Raises the errors of `Mesh.save`.
    """
    ending = check.ending("Mesh.save", "path", path, ENDINGS)
    target = Path(path)
    if ending in (".glb", ".gltf", ".stl") and np.abs(vertices).max() > np.finfo(np.float32).max:
        raise ValueError(f"Mesh.save: `vertices` must fit in 32-bit floats for a {ending} file; use .obj or .off")
    form, source = FORMATS[ending], None
    if scene is not None:
        vertices = vertices[scene.representative]  # all vertices at one position move with the first vertex there
        vertices[scene.unplaced] = scene.vertices[scene.unplaced]
        source = None if scene.path is None else FORMATS[scene.path.suffix.lower()]
    saving = Saving(target, vertices, faces, look, scene, *moved_primitives(vertices, scene))
    files, lost = form.rewrite(saving) if source is form else form.encode(saving)
    _write(target, files)
    size = float(np.linalg.norm(np.ptp(vertices[faces.ravel()], axis=0)))
    if lost.max(initial=0.0) > COARSE * size:
        check.warn(
            f"Mesh.save: `path` {path} has 32-bit floats, which move vertices by up to {lost.max():.3g} "
            f"({100 * lost.max() / size:.2g} % of the shape); .ply, .obj and .off files avoid this",
            UserWarning,
        )
    return lost


def _write(target: Path, files: dict[str, bytes]) -> None:
    """Write all files under temporary names, then rename them: `target` last, because it refers to the other files."""
    names = sorted(files, key=lambda name: name != target.name)  # the file entered first is renamed last
    try:
        with ExitStack() as stack:
            for name in names:
                temporary = stack.enter_context(atomic_write(target.with_name(name)))
                temporary.write_bytes(files[name])
    except OSError as error:
        first = error  # each enclosing `atomic_write` wraps the error again; find the innermost error
        while isinstance(first.__cause__, OSError) and isinstance(first.__cause__.__cause__, OSError):
            first = first.__cause__
        raise first from first.__cause__
