"""`python -m bench.skins.skin_weights`: the weights of `dfd rig` beside those of the artists who made the rigs.

For every skinned GLB in DFD_MESHES and in its folder "rigs": the share of a vertex's weight that went to other joints
than the artist's, the share that lies far from its bone along the surface, and how far vertices are, under the file's
own animations, from where the artist's weights put them. Beside it weights by the distance to bones straight through
space, by that through voxels of the body, and bounded biharmonic ones (`pip install libigl wildmeshing`), with a line
where those cannot be made. All have four influences a vertex, and of the file know only its bones and which of them
move anything at all.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

import dfd
from bench.quality.baselines import PeerError
from bench.skins.skin_peers import bounded_biharmonic, geodesic_voxels
from dfd.common.linear_algebra import Float64
from dfd.export.bone_weights import BoneDistances, bone_weights, straight_weights
from dfd.export.bones import Bones, bones_of
from dfd.export.gltf.skin import parts_with_deformers
from dfd.export.influences import heaviest
from dfd.export.weigh_skin import bleed
from dfd.mesh.file.gltf.header import objects
from dfd.mesh.file.gltf.read import world_transforms
from dfd.mesh.file.gltf.rest import inverse_binds

MOMENTS = 8  # of every animation
INFLUENCES = 4
METHODS = ("artist", "distance to bones", "geodesic voxels", "bounded biharmonic", "dfd rig")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--fields", type=Path, help="a folder with NAME.field.safetensors; without, they are distilled")
    parser.add_argument("rigs", nargs="*", help="names; all if left out")
    options = parser.parse_args()
    if not os.environ.get("DFD_MESHES"):
        parser.error("DFD_MESHES must name the folder of the meshes")
    folder = Path(os.environ["DFD_MESHES"])
    columns = [f"{method}: {what}" for method in METHODS for what in ("elsewhere", "far", "off")]
    print("| rig | " + " | ".join(columns) + " |")
    print("|---" * (1 + len(columns)) + "|")
    rows = []
    for path in sorted((*folder.glob("*.glb"), *(folder / "rigs").glob("*.glb")), key=lambda path: path.stem):
        if options.rigs and path.stem not in options.rigs:
            continue
        mesh = dfd.load(path, pose="bind")
        if not options.rigs and parts_with_deformers(mesh)[0] is None:  # without a skin
            continue
        try:
            bones = bones_of(mesh)
        except ValueError as error:
            print(f"{path.stem}: {error}", file=sys.stderr, flush=True)
            continue
        rows.append(compared(path, mesh, bones, options.fields))
        print(f"| {path.stem} | " + " | ".join(map(_shown, rows[-1])) + " |", flush=True)
    print("| mean | " + " | ".join(map(_shown, np.nanmean(rows, axis=0))) + " |")


def compared(path: Path, mesh: dfd.Mesh, bones: Bones, fields: Path | None) -> Float64:
    """For each method the share of weight elsewhere and far, and the mean distance in diagonals, NaN without motion."""
    stored = None if fields is None else fields / f"{path.stem}.field.safetensors"
    field = dfd.Field.load(stored) if stored is not None and stored.is_file() else dfd.distill(mesh, progress=False)
    distances = BoneDistances(bones)
    joints = np.flatnonzero(bones.weights.any(axis=0))
    artist = bones.weights / np.maximum(bones.weights.sum(axis=1, keepdims=True), 1e-30)
    methods: tuple[Callable[[], Float64], ...] = (
        lambda: artist,
        lambda: _four(straight_weights(distances, joints)),
        lambda: _four(geodesic_voxels(mesh, bones, joints)),
        lambda: _four(bounded_biharmonic(mesh, bones, joints)),
        lambda: _four(bone_weights(mesh, field, distances, joints)),
    )
    moves = motions(mesh, bones)
    found = []
    for name, method in zip(METHODS, methods, strict=True):
        try:
            weights = method()
        except PeerError as error:
            print(f"{path.stem}: {name} {error}", file=sys.stderr, flush=True)
            found += [np.nan] * 3
            continue
        difference = weights - artist
        elsewhere = np.abs(difference[bones.skinned]).sum(axis=1).mean() / 2
        far = bleed(weights[bones.skinned][:, joints], distances.along[bones.skinned][:, joints]).far
        found += [elsewhere, far, _off(mesh, bones, difference, moves)]
    return np.array(found)


def motions(mesh: dfd.Mesh, bones: Bones) -> list[Float64]:
    """At moments of the animations of a mesh's file, (J, 4, 4) what each joint does to the mesh at rest."""
    header, data = mesh.scene.gltf.header, mesh.scene.gltf.data
    nodes = objects(header, "nodes")
    skin = header["skins"][nodes[bones.primitives[0].source[0]]["skin"]]
    binds = inverse_binds(skin, data)
    back = np.linalg.inv(bones.primitives[0].transform)  # joints act on the mesh's own coordinates
    found = []
    for animation in objects(header, "animations"):
        tracks = []
        for channel in animation["channels"]:
            sampler, target = animation["samplers"][channel["sampler"]], channel["target"]
            times, values = (data.accessor(sampler[name]).astype(np.float64) for name in ("input", "output"))
            if sampler.get("interpolation") != "CUBICSPLINE" and target["path"] != "weights":
                tracks.append((target["node"], target["path"], times.ravel(), values))
        end = max((times[-1] for _, _, times, _ in tracks), default=0.0)
        for seconds in np.linspace(0, end, MOMENTS, endpoint=False):
            moved = [dict(node) for node in nodes]
            for node, name, times, values in tracks:
                moved[node][name] = _at(name, times, values, seconds).tolist()
            world = world_transforms({**header, "nodes": moved})
            found.append(np.array([world[joint] for joint in skin["joints"]]) @ binds @ back)
    return found


def _at(name: str, times: Float64, values: Float64, seconds: float) -> Float64:
    seconds = float(np.clip(seconds, times[0], times[-1]))
    if name != "rotation" or len(times) == 1:
        return np.array([np.interp(seconds, times, column) for column in values.T])
    return Slerp(times, Rotation.from_quat(values))(seconds).as_quat()


def _off(mesh: dfd.Mesh, bones: Bones, difference: Float64, moves: list[Float64]) -> float:
    """Mean distance, in diagonals of the posed box, between vertices under weights that differ by that much."""
    if not moves:
        return float("nan")
    points = np.column_stack([mesh.vertices, np.ones(len(mesh.vertices))])[bones.skinned]
    artist = bones.weights[bones.skinned] / bones.weights[bones.skinned].sum(axis=1, keepdims=True)
    found = []
    for matrices in moves:
        each = np.einsum("jab,vb->vja", matrices[:, :3], points)
        size = np.linalg.norm(np.ptp(np.einsum("vj,vja->va", artist, each), axis=0))
        off = np.einsum("vj,vja->va", difference[bones.skinned], each)
        found.append(np.linalg.norm(off, axis=1).mean() / size)
    return float(np.mean(found))


def _four(weights: Float64) -> Float64:
    order, single, _ = heaviest(weights, INFLUENCES)
    result = np.zeros_like(weights)
    np.add.at(result, (np.arange(len(order))[:, None], order), single)
    return result


def _shown(value: float) -> str:
    return "–" if np.isnan(value) else f"{100 * value:.2g} %"


if __name__ == "__main__":
    main()
