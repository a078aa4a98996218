"""Features from another network's files, and whether their rows are the vertices of the mesh, in its order."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from dfd.mesh.mesh import Mesh

__all__ = ["check_order", "read_features"]

SAME = 1e-4  # of the longest side: the PLY files hold single precision


def read_features(path: Path, named: str) -> NDArray[Any]:
    """The array in an `.npy` file; errors call it what it is `named` where it was given.

    Raises
    ------
    ValueError
        If it is no such file, or cut short, or holds Python objects, which are never opened.
    OSError
        If it cannot be read.
    """
    import numpy as np

    try:
        # mapped, a header that promises more than the file holds is refused before any memory is asked for
        return np.array(np.lib.format.open_memmap(path, mode="r"))
    except OSError:
        raise
    except Exception as error:  # of the header's text: SyntaxError, TokenError, TypeError and more
        reason = " ".join(str(error).split())[:200]
        raise ValueError(f"{named} must be an .npy file of numbers, but {path} is not: {reason}") from None


def check_order(path: Path, features: NDArray[Any], mesh: Mesh, named: str) -> None:
    """Refuse features that the files beside them say are no rows of the vertices of `mesh`.

    MeshFM writes `NAME.json` beside `NAME.npy`, which says what has the features and of how many vertices the mesh was,
    and with `--visualize` its vertices in `NAME_pca.ply`; PartField writes `feat_pca_NAME_0.ply` beside
    `part_feat_NAME_0_batch.npy`, moved and scaled. Where none of these is, the number of rows alone can be judged, by
    whoever takes them.

    Raises
    ------
    ValueError
        If the rows are not of vertices, or the vertices are others or in another order; the message names the file.
    OSError
        If a file that is there cannot be read.
    """
    described = path.with_suffix(".json")
    if described.is_file():
        _check_description(described, features, mesh, named)
    name = path.stem.removesuffix("_batch")
    drawn = path.with_name(f"{re.sub('^part_feat_', 'feat_pca_', name)}.ply")
    if not name.startswith("part_feat_"):
        drawn = path.with_name(f"{path.stem}_pca.ply")
    if drawn.is_file():
        _check_vertices(drawn, mesh, named)


def _check_description(path: Path, features: NDArray[Any], mesh: Mesh, named: str) -> None:
    try:
        said = json.loads(path.read_text("utf-8"))
    except ValueError as error:
        raise ValueError(f"{named} must have a readable description, but {path} is not JSON: {error}") from None
    if not isinstance(said, dict) or not {"mode", "num_vertices", "feature_shape"} <= said.keys():
        return  # another program's
    if said["mode"] != "vertex":
        raise ValueError(
            f"{named} must be those of vertices, but {path} says mode {said['mode']!r}: "
            "extract them with `--mode vertex`"
        )
    if said["feature_shape"] != list(features.shape):
        raise ValueError(
            f"{named} must be the array that {path} describes, of shape {said['feature_shape']}, "
            f"got {list(features.shape)}"
        )
    if said["num_vertices"] != len(mesh.vertices):
        raise ValueError(
            f"{named} must be of this mesh, which has {len(mesh.vertices)} vertices, but {path} says "
            f"{said['num_vertices']}; GLB, glTF and STL files have no one list of vertices: save the mesh as OBJ first"
        )


def _check_vertices(path: Path, mesh: Mesh, named: str) -> None:
    import numpy as np

    from dfd.mesh.mesh import load

    others = load(path).vertices
    if len(others) != len(mesh.vertices):
        raise ValueError(
            f"{named} must be of this mesh, which has {len(mesh.vertices)} vertices, "
            f"but {path} beside them has {len(others)}"
        )
    distances = np.linalg.norm(_in_box(others) - _in_box(mesh.vertices), axis=1)
    if distances.max() > SAME:
        raise ValueError(
            f"{named} must have their rows in the order of the mesh's vertices, "
            f"but vertex {int((distances > SAME).argmax())} lies elsewhere in {path}"
        )


def _in_box(vertices: NDArray[Any]) -> NDArray[Any]:
    """Vertices around the center of their box, in units of its longest side: what scaling and moving leave alike."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    placed: NDArray[Any] = (vertices - (low + high) / 2) / max((high - low).max(), 1e-300)
    return placed
