"""Features from another network's files, as rows of the mesh's vertices in its order."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import ZipFile

from dfd.common.linear_algebra import Float64

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from dfd.mesh.mesh import Mesh

FEATURE_FILES = (".npy", ".pt")

SAME = 1e-4  # of the longest side: the PLY files hold single precision


def read_features(path: Path, named: str) -> NDArray[Any]:
    """The array in an `.npy` file, or in a `.pt` of torch's, which holds one tensor and nothing else.

    Diff3F saves `torch.save(features, "NAME.pt")`: (V, 2048) in half precision, of whatever device had them. Errors
    call the file what it is `named` where it was given. Objects of Python in either are never opened.

    Raises ValueError if it is no such file, or cut short, or holds something else. Raises OSError if it cannot be read.
    """
    import numpy as np

    if path.suffix.lower() == ".pt":
        return _read_tensor(path, named)
    try:
        # Not mapped: a map of a file that its owner is writing anew ends the process.
        with path.open("rb") as stream:
            return np.lib.format.read_array(stream, allow_pickle=False)
    except OSError:
        raise
    except Exception as error:  # of the header's text: SyntaxError, TokenError, TypeError and more
        reason = " ".join(str(error).split())[:200]
        raise ValueError(f"{named} must be an .npy file of numbers, but {path} is not: {reason}") from None


def _read_tensor(path: Path, named: str) -> NDArray[Any]:
    """Read a tensor; no memory is taken beyond the size of its file, and that of its numbers in single precision."""
    import torch

    whole = path.stat().st_size
    with path.open("rb") as stream:
        try:
            with ZipFile(stream) as archive:
                if sum(entry.file_size for entry in archive.infolist()) > whole:
                    raise ValueError("its archive is compressed, which torch.save never does")
            stream.seek(0)
            tensor = torch.load(stream, map_location="cpu", weights_only=True)
        except Exception as error:  # torch, pickle and zipfile raise ten types for damaged files
            reason = (str(error).splitlines() or [type(error).__name__])[0]
            raise ValueError(f"{named} must be a tensor that torch saved, but {path} is not: {reason}") from None
    if not isinstance(tensor, torch.Tensor):
        raise ValueError(f"{named} must be a .pt file of one tensor, but {path} holds a {type(tensor).__name__}")
    plain = tensor.layout == torch.strided and not (tensor.is_nested or tensor.is_complex() or tensor.is_quantized)
    if not plain or tensor.device.type != "cpu":
        held = "nested tensor" if tensor.is_nested else f"{tensor.type()} on {tensor.device}"
        raise ValueError(f"{named} must be a .pt file of plain numbers, but {path} holds a {held}")
    if tensor.nbytes > whole:
        raise ValueError(
            f"{named} must be a tensor that its file holds in full, but {path} of {whole} bytes expands to "
            f"{tensor.nbytes} bytes"
        )
    return tensor.detach().float().numpy()


def of_vertices(mesh: Mesh, rows: NDArray[Any]) -> Float64:
    """Features (V, D) of vertices from those of faces (F, D): the mean of the directions around, by the faces' areas.

    Vertices at one position share theirs. A vertex of no face has those of the nearest vertex that is of one.
    """
    import numpy as np
    from scipy.sparse import coo_array
    from scipy.spatial import cKDTree

    from dfd.geometry.topology import face_areas

    rows = np.asarray(rows, np.float64)
    rows = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-300)
    areas = np.maximum(face_areas(mesh.vertices, mesh.faces), 1e-12 * mesh.diagonal**2)
    corners = mesh.representative[mesh.faces].ravel()
    faces = np.repeat(np.arange(len(mesh.faces)), 3)
    around = coo_array((np.repeat(areas, 3), (corners, faces)), shape=(len(mesh.vertices), len(mesh.faces))).tocsr()
    means: Float64 = (around @ rows)[mesh.representative]
    used = np.unique(corners)
    bare = np.setdiff1d(np.arange(len(means)), np.flatnonzero(np.isin(mesh.representative, used)))
    if len(bare):
        means[bare] = means[used[cKDTree(mesh.vertices[used]).query(mesh.vertices[bare])[1]]]
    return means


def read_rows(path: Path, mesh: Mesh, named: str) -> NDArray[Any]:
    """Read a row for each vertex of `mesh`, made from those of its faces where that is what `path` holds.

    Rows are those of faces where a file beside them says so, or only the number of faces fits. Errors call the file
    what it is `named` where it was given.

    MeshFM writes `NAME.npy` (float32 or float16) and `NAME.json` beside it, which says what has the features and of how
    many vertices and faces the mesh was, and with `--visualize` its vertices in `NAME_pca.ply`. PartField writes
    `part_feat_NAME_0_batch.npy`, (F, 448) or with `vertex_feature` (V, 448), and beside it `feat_pca_NAME_0.ply`, moved
    and scaled. Where no file lies beside, only the number of rows can be checked, by the caller.

    Raises ValueError as `read_features`, or if the rows are of points of the surface, or the vertices are others or in
    another order; the message names the file. Raises OSError if a file that is there cannot be read.
    """
    features = read_features(path, named)
    described = path.with_suffix(".json")
    mode = _check_description(described, features, mesh, named) if described.is_file() else None
    name = path.stem.removesuffix("_batch")
    drawn = path.with_name(f"{re.sub('^part_feat_', 'feat_pca_', name)}.ply")
    if not name.startswith("part_feat_"):
        drawn = path.with_name(f"{path.stem}_pca.ply")
    if drawn.is_file():
        _check_vertices(drawn, mesh, named)
    if features.ndim != 2 or features.dtype.kind not in "fiu" or len(features) != len(mesh.faces):
        return features
    return of_vertices(mesh, features) if mode == "face" or len(features) != len(mesh.vertices) else features


def _check_description(path: Path, features: NDArray[Any], mesh: Mesh, named: str) -> str | None:
    """What has the features, "vertex" or "face", or None where the file is another program's."""
    try:
        said = json.loads(path.read_text("utf-8"))
    except ValueError as error:
        raise ValueError(f"{named} must have a readable description, but {path} is not JSON: {error}") from None
    if not isinstance(said, dict) or not {"mode", "num_vertices", "feature_shape"} <= said.keys():
        return None
    if said["mode"] not in ("vertex", "face"):
        raise ValueError(
            f"{named} must be those of vertices or faces, but {path} says mode {said['mode']!r}: "
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
    return str(said["mode"])


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
    return (vertices - (low + high) / 2) / max((high - low).max(), 1e-300)
