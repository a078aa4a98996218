"""Share the mirror planes and parts of equal shapes, which take most of the time of a new session."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any
from unittest import mock

import dfd
from dfd.app.options import SAMPLE_FIELDS
from dfd.geometry import coarse
from dfd.samples import Sample
from dfd.segmentation import parts as module
from dfd.segmentation.alike import Alike
from dfd.segmentation.patches import Patches
from dfd.segmentation.trees import Trees

_KNOWN: dict[tuple[Any, ...], Any] = {}
MOST_KNOWN = 40


def _once(key: tuple[Any, ...], make: Callable[[], Any]) -> Any:
    """Return the result of `make`, which is called once for a key. The key is an attribute of the result."""
    if key not in _KNOWN:
        while len(_KNOWN) >= MOST_KNOWN:
            del _KNOWN[next(iter(_KNOWN))]
        _KNOWN[key] = make()
        _KNOWN[key].made_for = key
    return _KNOWN[key]


@cache
def sample_parts(name: str) -> tuple[Sample, module.Parts]:
    """Return a sample, and its parts by the field that the app has for it."""
    sample = getattr(dfd.samples, name)()
    mesh, field = sample.mesh, dfd.Field.load(SAMPLE_FIELDS / f"{name}.field.safetensors")
    return sample, module.Parts(mesh, field.on(mesh).rows, lambda: dfd.symmetry_planes(mesh, field))


@contextmanager
def parts_once() -> Iterator[None]:
    """Compute the patches and the trees of regions once for equal meshes without objects, features and planes."""

    def patches(mesh: dfd.Mesh, planes: Any = ()) -> Patches:
        if len(mesh.parts) > 1:
            return Patches(mesh, planes)
        known = tuple((each.normal, each.offset) for each in planes)
        key = "patches", mesh.content_hash, known, coarse.MOST_NODES, coarse.CELLS
        return _once(key, lambda: Patches(mesh, planes))

    def trees(own: Patches, features: Any) -> Trees:
        if not hasattr(own, "made_for"):
            return Trees(own, features)
        return _once(("trees", own.made_for, features.tobytes()), lambda: Trees(own, features))

    def alike(own: Trees) -> Alike:
        return _once(("alike", own.made_for), lambda: Alike(own)) if hasattr(own, "made_for") else Alike(own)

    with (
        mock.patch.object(module, "Patches", patches),
        mock.patch.object(module, "Trees", trees),
        mock.patch.object(module, "Alike", alike),
    ):
        yield


def sessions_on(mesh: dfd.Mesh, field: dfd.Field, features: Any) -> Callable[..., dfd.Deformer]:
    """Return a function that makes a session without handles, with a preset."""
    planes = dfd.symmetry_planes(mesh, field)
    parts = dfd.Deformer(mesh, field, features=features).bound.prepare(planes)

    def session(preset: Any = "default") -> dfd.Deformer:
        made = dfd.Deformer(mesh, field, preset=preset, features=features)
        made.bound.prepare(planes, parts)
        return made

    return session
