"""Deep Feature Deformation weights: grab a point of a mesh, and everything that looks alike follows.

mesh = dfd.load("chair.glb")
field = dfd.distill(mesh)                       # once per shape
weights = dfd.bind(field.features(mesh), [17])  # milliseconds
moved = dfd.pose(mesh.vertices, weights, transforms)
mesh.save("longer.glb", moved)
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from dfd.bind import bind
from dfd.compact import CompactFeatures, compact
from dfd.distill import distill
from dfd.pose import Drag, pose
from dfd.threads import get_num_threads, set_num_threads

if TYPE_CHECKING:
    from dfd import samples
    from dfd.deformer import Deformer
    from dfd.field import Field
    from dfd.geodesics import Geodesics
    from dfd.mesh import Mesh, load
    from dfd.symmetry import SymmetryPlane, symmetry_planes

__all__ = [
    "CompactFeatures",
    "Deformer",
    "Drag",
    "Field",
    "Geodesics",
    "Mesh",
    "SymmetryPlane",
    "bind",
    "compact",
    "distill",
    "get_num_threads",
    "load",
    "pose",
    "samples",
    "set_num_threads",
    "symmetry_planes",
]

# Names whose modules pull in torch, trimesh or scipy: imported when they are first asked for, so that `import dfd`
# and `dfd --help` answer at once.
_LATER = {
    "Deformer": "dfd.deformer",
    "Field": "dfd.field",
    "Geodesics": "dfd.geodesics",
    "Mesh": "dfd.mesh",
    "SymmetryPlane": "dfd.symmetry",
    "load": "dfd.mesh",
    "symmetry_planes": "dfd.symmetry",
}


def __getattr__(name: str) -> Any:
    if name == "samples":
        return import_module("dfd.samples")
    if name in _LATER:
        value = getattr(import_module(_LATER[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'dfd' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(__all__))
