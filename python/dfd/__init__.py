"""Deep Feature Deformation weights: grab a point of a mesh, and everything that looks alike follows.

>>> import dfd
>>> mesh = dfd.samples.chair().mesh  # or dfd.load("chair.glb")
>>> field = dfd.distill(mesh)  # once per shape
>>> session = dfd.Deformer(mesh, field)
>>> foot = session.add("0.225,0,0.235", translation=(0, -0.2, 0))
>>> mesh.save("longer.glb", session.vertices)

A session computes its vertices with two functions, which implement the equations of the paper:

>>> weights = dfd.bind(field.features(mesh), [17])  # milliseconds
>>> raise_by = [[1, 0, 0, 0], [0, 1, 0, 0.2], [0, 0, 1, 0]]
>>> moved = dfd.pose(mesh.vertices, weights, [raise_by])
"""

from __future__ import annotations

import importlib as _importlib
import typing as _typing

from dfd.common.shown import Shown as _Shown
from dfd.common.threads import get_num_threads, set_num_threads
from dfd.posing.pose import Drag, pose
from dfd.weights.bind import bind
from dfd.weights.compact import CompactFeatures, compact
from dfd.weights.skinning import skinning

if _typing.TYPE_CHECKING:
    from dfd import samples
    from dfd.distillation.distill import distill
    from dfd.distillation.settings import DistillSettings
    from dfd.editing.deformer import Deformer
    from dfd.editing.edit_file import edit_schema
    from dfd.editing.key_pose import KeyPose
    from dfd.editing.transfer import correspond
    from dfd.export.export_rig import export_rig
    from dfd.export.export_weights import export_weights
    from dfd.field.field import Field
    from dfd.field.vertex_field import VertexField
    from dfd.geometry.geodesics import Geodesics
    from dfd.mesh.mesh import Mesh, load
    from dfd.pictures.notebook import show
    from dfd.posing.transforms import Transform
    from dfd.segmentation.parts import Parts, parts
    from dfd.symmetry.plane import SymmetryPlane
    from dfd.symmetry.search import symmetry_planes

# Stable names: while versions begin with 0, they change only with a new minor version.
__all__ = [
    "CompactFeatures",
    "Deformer",
    "DistillSettings",
    "Field",
    "Geodesics",
    "Mesh",
    "SymmetryPlane",
    "bind",
    "compact",
    "distill",
    "edit_schema",
    "get_num_threads",
    "load",
    "pose",
    "samples",
    "set_num_threads",
    "symmetry_planes",
]
# Experimental names: they may change with any version.
__all__ += ["Drag", "KeyPose", "Parts", "Transform", "VertexField", "correspond", "export_rig", "export_weights"]
__all__ += ["parts", "show", "skinning"]

# The module of each name whose module is imported at the first use of the name. These modules import torch, trimesh or
# SciPy, which are slow to import. So `import dfd` and `dfd --help` are fast.
_LAZY = {
    "Deformer": "dfd.editing.deformer",
    "DistillSettings": "dfd.distillation.settings",
    "Field": "dfd.field.field",
    "Geodesics": "dfd.geometry.geodesics",
    "KeyPose": "dfd.editing.key_pose",
    "Mesh": "dfd.mesh.mesh",
    "Parts": "dfd.segmentation.parts",
    "Transform": "dfd.posing.transforms",
    "SymmetryPlane": "dfd.symmetry.plane",
    "VertexField": "dfd.field.vertex_field",
    "distill": "dfd.distillation.distill",
    "edit_schema": "dfd.editing.edit_file",
    "export_rig": "dfd.export.export_rig",
    "correspond": "dfd.editing.transfer",
    "export_weights": "dfd.export.export_weights",
    "load": "dfd.mesh.mesh",
    "parts": "dfd.segmentation.parts",
    "show": "dfd.pictures.notebook",
    "symmetry_planes": "dfd.symmetry.search",
}


def __getattr__(name: str) -> _typing.Any:
    if name == "__version__":
        from importlib.metadata import version

        from dfd.common.distribution import DISTRIBUTION

        return version(DISTRIBUTION)
    if name == "samples":
        return _importlib.import_module(f"dfd.{name}")
    if name in _LAZY:
        value = getattr(_importlib.import_module(_LAZY[name]), name)
        if name == "Deformer":  # `dfd.editing` must not import the app, so the function is set here
            value.page = lambda session, **how: _importlib.import_module("dfd.app").show(session, **how)
            value._repr_png_ = _Shown._repr_png_
        globals()[name] = value
        return value
    raise AttributeError(f"module 'dfd' has no attribute {name!r}")


_Shown.draw = lambda shape: __getattr__("show")(shape)._repr_png_()


def __dir__() -> list[str]:
    return list(__all__)
