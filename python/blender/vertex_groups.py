"""Write vertex groups and shape keys from a mesh, its field and the settings of its handles."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np

from .shapes import Applied, Shape

OWN = "dfd "  # the names of shape keys that the extension writes begin with this text
PRESENT = f"{OWN}edit"  # name of the shape key with the present pose of an edit

_paused = False  # whether changes of settings write nothing
_kept: dict[int, tuple[object, Shape]] = {}  # by the object's `session_uid`: the inputs of a shape, and the shape


def forget() -> None:
    """Remove every shape from the cache."""
    _kept.clear()


def refresh(obj: bpy.types.Object, handle: bpy.types.PropertyGroup) -> None:
    """Write the handle's vertex group again. Store an error in `handle.note`, because a slider cannot report it.

    If the handle is of an edit file, write all groups and shape keys of the edit again.
    """
    if _paused:
        return
    try:
        with object_mode(obj):
            weigh(obj, handle)
        handle.note = ""
    except (ValueError, OSError) as error:
        handle.note = str(error)


@contextmanager
def paused() -> Iterator[None]:
    """Let `refresh` do nothing inside the `with` block, in which several settings change."""
    global _paused
    _paused = True
    try:
        yield
    finally:
        _paused = False


@contextmanager
def object_mode(obj: bpy.types.Object) -> Iterator[None]:
    """Switch to object mode inside the `with` block, because other modes do not let Python write vertex groups."""
    mode = obj.mode
    if mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    try:
        yield
    finally:
        if mode != "OBJECT":
            bpy.ops.object.mode_set(mode=mode)


def weigh(obj: bpy.types.Object, handle: bpy.types.PropertyGroup) -> None:
    """In object mode, write the vertex group of a handle.

    Raises ValueError if no field is chosen, or it is invalid or of another shape. Raises OSError if there is no file.
    """
    if handle.edit_id:
        apply(obj)
    else:
        _write_group(obj, handle, shape_of(obj).weights(handle.vertex, obj.dfd.preset, **handle.controls()))


def apply(obj: bpy.types.Object) -> Applied:
    """In object mode, write the vertex groups and shape keys of the object's edit, with the controls of the panel.

    Raises ValueError or OSError as `weigh` does, or if a control is invalid. Then nothing is written.
    """
    shape, handles = shape_of(obj), {each.edit_id: each for each in obj.dfd.handles if each.edit_id}
    controls = {number: handle.controls() for number, handle in handles.items()}
    applied = shape.applied(shape.edit(obj.dfd.edit, controls, obj.dfd.preset))
    for number, weights in applied.weights.items():
        _write_group(obj, handles[number], weights)
    _write_keys(obj, {PRESENT: applied.vertices} | dict(zip(key_names(applied), _poses(applied), strict=True)))
    return applied


def key_names(applied: Applied) -> list[str]:
    """Return the names of the shape keys of the key poses."""
    return [f"{OWN}{number} {name}".strip() for number, (_, name, _) in enumerate(applied.poses, 1)]


def animate(obj: bpy.types.Object, applied: Applied) -> None:
    """Set keyframes with which the shape keys of the key poses follow one another. Without key poses, show the edit.

    The keyframe of a pose is at the frame of its time, at which the glTF importer also sets it.
    """
    keys, names = obj.data.shape_keys, key_names(applied)
    if keys.animation_data is not None:
        keys.animation_data_clear()
    keys.key_blocks[PRESENT].value = 0.0 if names else 1.0
    scene = bpy.context.scene
    frames = [seconds * scene.render.fps / scene.render.fps_base for seconds, _, _ in applied.poses]
    for shown, name in enumerate(names):
        for at in range(max(shown - 1, 0), min(shown + 2, len(frames))):
            keys.key_blocks[name].value = float(at == shown)
            keys.key_blocks[name].keyframe_insert("value", frame=frames[at])
    if names:
        for curve in _curves(keys.animation_data.action):
            for each in curve.keyframe_points:
                each.interpolation = "LINEAR"


def _curves(action: bpy.types.Action) -> list[bpy.types.FCurve]:
    """Return the curves of an action that has one layer. Before Blender 5, an action itself has the curves."""
    if hasattr(action, "fcurves"):
        return list(action.fcurves)
    return [curve for bag in action.layers[0].strips[0].channelbags for curve in bag.fcurves]


def _poses(applied: Applied) -> list[np.ndarray]:
    return [vertices for _, _, vertices in applied.poses]


def _write_group(obj: bpy.types.Object, handle: bpy.types.PropertyGroup, weights: np.ndarray) -> None:
    """Write the weights (V,) of a handle to its vertex group."""
    group = obj.vertex_groups.get(handle.name) or obj.vertex_groups.new(name=handle.name)
    group.remove(np.flatnonzero(weights == 0).tolist())
    held = np.flatnonzero(weights)
    for vertex, weight in zip(held.tolist(), weights[held].tolist(), strict=True):
        group.add((vertex,), weight, "REPLACE")


def _write_keys(obj: bpy.types.Object, shapes: dict[str, np.ndarray]) -> None:
    """Write the vertices (V, 3) of each shape key of an edit, and remove the keys of an earlier edit."""
    if obj.data.shape_keys is None:
        obj.shape_key_add(name="Basis")
    blocks = obj.data.shape_keys.key_blocks
    for old in [each for each in blocks if each.name.startswith(OWN) and each.name not in shapes]:
        obj.shape_key_remove(old)
    for name, vertices in shapes.items():
        key = blocks.get(name) or obj.shape_key_add(name=name, from_mix=False)
        key.points.foreach_set("co", vertices.astype(np.float32).ravel())
    obj.data.update()


def cut(obj: bpy.types.Object) -> int:
    """In object mode, write a vertex group for each part of the shape, and return the number of parts.

    Raises ValueError if no field is chosen, or it is invalid or of another shape. Raises OSError if there is no file.
    """
    found = shape_of(obj).parts()
    for number, vertices in enumerate(found, 1):
        name = f"part {number}"
        group = obj.vertex_groups.get(name) or obj.vertex_groups.new(name=name)
        group.remove(range(len(obj.data.vertices)))
        group.add(vertices.tolist(), 1.0, "REPLACE")
    return len(found)


def shape_of(obj: bpy.types.Object, field: Path | None = None) -> Shape:
    """Return the shape of the object's present mesh and field. If nothing has changed, it comes from the cache.

    The file `field` replaces the object's field. Raises ValueError or OSError as `weigh` does.
    """
    if field is None and not obj.dfd.field:
        raise ValueError("Choose a field, or distill one")
    path = field or Path(bpy.path.abspath(obj.dfd.field))
    mesh = obj.data
    vertices = np.empty((len(mesh.vertices), 3), np.float32)
    resting = mesh.vertices if mesh.shape_keys is None else mesh.shape_keys.reference_key.points
    resting.foreach_get("co", vertices.ravel())
    mesh.calc_loop_triangles()
    triangles = np.empty((len(mesh.loop_triangles), 3), np.int32)
    mesh.loop_triangles.foreach_get("vertices", triangles.ravel())
    changed = path.stat().st_mtime_ns  # raises OSError if the field does not exist
    inputs = (path, changed, obj.dfd.axes, len(triangles), zlib.crc32(vertices), zlib.crc32(triangles))
    before, shape = _kept.get(obj.session_uid, (None, None))
    if shape is None or before != inputs:
        shape = Shape(vertices.astype(np.float64), triangles, path, obj.dfd.axes)
        _kept[obj.session_uid] = inputs, shape
    return shape
