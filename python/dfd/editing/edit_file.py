"""Edits in files: one JSON document that a person can read, write and carry to another resolution of the shape.

    {
      "format": "dfd-edit",
      "version": 1,
      "units": {"length": "mesh", "angle": "degree"},
      "mesh": {"vertices": 2930},
      "handles": [
        {
          "id": 1,
          "name": "left horn",
          "vertex": 1234,
          "position": [0.1, 0.9, -0.6],
          "translation": [0.0, 0.2, 0.0],
          "rotation": [0.0, 0.0, 30.0],
          "scale": [1.0, 1.0, 1.0],
          "pivot": null,
          "locality": 2.0
        }
      ],
      "fixed": [{"vertex": 77, "position": [0.2, -0.7, 0.1]}],
      "symmetry": {"normal": [1.0, 0.0, 0.0], "offset": 0.0, "band": 0.05},
      "default": null
    }

Required: `format`, `version`, and for every handle and fixed point a `vertex`, a `position` or both. All else may be
left out.

`units`      What lengths and angles are in; no other units are read.
`mesh`       How many vertices the shape had, for which the vertex indices count.
`handles`    In order; `id` a whole number of at least 1, once each, given in order where it is missing.
  `vertex`, `position`   Where the handle sits on the resting shape. The vertex counts where it lies at `position` (or
               where there is no position and `mesh` fits); on another resolution, where it doesn't, the position does,
               and the handle is a point of space there.
  `translation`  Three lengths.
  `rotation`   A rotation vector (axis times angle, right-handed) of three numbers, or a quaternion x, y, z, w.
  `scale`      One factor or three, along the axes, before the rotation.
  `pivot`      Point about which it turns and scales; null is the handle's own position.
  `locality`   λ of Eq. 7, at least 0.
  `name`       A text, or null.
`fixed`      Points that stay, with all that looks like them.
`symmetry`   A plane {p : normal · p = offset} with the half width of its smooth band (0 when it is missing), or "x",
             "y" or "z" for the plane across that axis through the centre of the box, or null.
`default`    What happens to what no handle holds (D₀ of Eq. 1): `translation`, `rotation`, `scale` and `pivot`, null
             being the centre of the box; or null, nothing.

Unknown keys, keys that are given twice, and numbers that are not finite are refused: a misspelt key is an error, never
a default.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dfd.common.files import atomic_write
from dfd.editing.edit import Edit, Handle, Place, Transform, box_center, symmetry_on
from dfd.posing.transforms import Vector, rotation_vector, scale_factors, vector
from dfd.symmetry.plane import AXES, SymmetryPlane

if TYPE_CHECKING:
    from dfd.mesh.mesh import Mesh

__all__ = ["from_document", "read_edit", "to_document", "write_edit"]

FORMAT = "dfd-edit"
VERSION = 1
UNITS = {"length": "mesh", "angle": "degree"}
PLACE_KEYS = ("vertex", "position")
TRANSFORM_KEYS = ("translation", "rotation", "scale", "pivot")
HANDLE_KEYS = ("id", "name", *PLACE_KEYS, *TRANSFORM_KEYS, "locality")
# A vertex that moved by no more than this part of the box's diagonal is the same one: files round positions to float32.
SAME_PLACE = 1e-5


def write_edit(path: str | os.PathLike[str], edit: Edit, mesh: Mesh) -> None:
    """Write `edit` of `mesh` to `path`, whole or not at all.

    Raises
    ------
    OSError
        If `path` cannot be written; a file that was there stays as it was.
    """
    text = json.dumps(to_document(edit, mesh), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    # Lists of numbers on one line each, for people; no text of a JSON document holds a line break as it is.
    text = re.sub(r"\[\n[-+.\de,\s]+\]", lambda numbers: "[" + " ".join(numbers[0][1:-1].split()) + "]", text)
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def read_edit(path: str | os.PathLike[str], mesh: Mesh) -> Edit:
    """Read an edit of `mesh`, or of another resolution of the same shape, from `path`.

    Raises
    ------
    OSError
        If `path` cannot be read.
    ValueError
        If it is no such document; the message names the key and what was found there.
    """
    name = os.fspath(path)
    try:
        text = Path(path).read_text(encoding="utf-8-sig")  # some editors begin a file with a byte order mark
    except UnicodeDecodeError as error:
        raise ValueError(f"{name}: an edit must be UTF-8 text, but byte {error.start} is none") from None
    except OSError as error:
        raise OSError(error.errno, f"{name}: the edit could not be read: {error.strerror}") from error
    try:
        document = json.loads(text, object_pairs_hook=_distinct, parse_constant=_refuse)
    except json.JSONDecodeError as error:
        raise ValueError(f"{name}: no whole JSON document: {error}") from None
    except RecursionError:
        raise ValueError(f"{name}: no edit: nested too deeply") from None
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None
    return from_document(document, mesh, name=name)


def to_document(edit: Edit, mesh: Mesh) -> dict[str, Any]:
    """`edit` of `mesh` as a JSON document."""
    plane = edit.symmetry
    return {
        "format": FORMAT,
        "version": VERSION,
        "units": dict(UNITS),
        "mesh": {"vertices": len(mesh.vertices)},
        "handles": [
            {
                "id": handle.id,
                "name": handle.name,
                **_place_document(handle.place),
                **_transform_document(handle.transform),
                "locality": handle.locality,
            }
            for handle in edit.handles
        ],
        "fixed": [_place_document(place) for place in edit.fixed],
        "symmetry": plane and {"normal": list(plane.normal), "offset": plane.offset, "band": plane.band},
        "default": edit.default and _transform_document(edit.default),
    }


def _place_document(place: Place) -> dict[str, Any]:
    return {"vertex": place.vertex, "position": list(place.position)}


def _transform_document(transform: Transform) -> dict[str, Any]:
    return {
        "translation": list(transform.translation),
        "rotation": list(transform.rotation),
        "scale": list(transform.scale),
        "pivot": transform.pivot and list(transform.pivot),
    }


def from_document(document: Any, mesh: Mesh, *, name: str = "edit") -> Edit:
    """The edit of `mesh` in a parsed JSON document; `name` begins every message.

    Raises
    ------
    ValueError
        If it is no such document; the message names the key and what was found there.
    """
    root = _Node(name, "", document)
    root.kind(dict, "an edit")
    # These two first: what else is odd in a document of another kind or version helps nobody.
    for key, wanted in (("format", FORMAT), ("version", VERSION)):
        node = root.child(key, document.get(key))
        if isinstance(node.value, bool) or node.value != wanted:
            raise node.error(json.dumps(wanted))
    entries = root.entries("format", "version", "units", "mesh", "handles", "fixed", "symmetry", "default")
    if "units" in entries and entries["units"].value != UNITS:
        raise entries["units"].error(json.dumps(UNITS))
    recorded = None
    if "mesh" in entries:
        recorded = entries["mesh"].entries("vertices", required=("vertices",))["vertices"].whole(1)
    places = _Places(mesh, recorded)
    handles = _handles(entries["handles"].items(), places) if "handles" in entries else ()
    fixed = (
        tuple(places.read(node, node.entries(*PLACE_KEYS)) for node in entries["fixed"].items())
        if "fixed" in entries
        else ()
    )
    symmetry = _symmetry(entries["symmetry"], mesh) if "symmetry" in entries else None
    default = None
    if "default" in entries and entries["default"].value is not None:
        node = entries["default"]
        default = _transform(node, node.entries(*TRANSFORM_KEYS), box_center(mesh))
    try:
        return Edit(handles, fixed, symmetry, default)
    except ValueError as error:
        raise ValueError(f"{name}: {str(error).removeprefix('Edit: ')}") from None


def _handles(nodes: Sequence[_Node], places: _Places) -> tuple[Handle, ...]:
    read = [node.entries(*HANDLE_KEYS) for node in nodes]
    given = {entries["id"].whole(1) for entries in read if "id" in entries}
    free = (id_ for id_ in range(1, 2 * len(nodes) + 1) if id_ not in given)
    handles = []
    for node, entries in zip(nodes, read, strict=True):
        place = places.read(node, entries)
        handles.append(
            Handle(
                id=entries["id"].whole(1) if "id" in entries else next(free),
                place=place,
                transform=_transform(node, entries, place.position),
                locality=entries["locality"].number(0.0) if "locality" in entries else 0.0,
                name=entries["name"].text() if "name" in entries else None,
            )
        )
    return tuple(handles)


class _Places:
    """Where vertices and positions of a document lie on a mesh."""

    def __init__(self, mesh: Mesh, recorded: int | None) -> None:
        self.mesh = mesh
        self.recorded = recorded  # the number of vertices that the document's indices count for

    def read(self, node: _Node, entries: dict[str, _Node]) -> Place:
        vertex, position = (
            entries[key] if key in entries and entries[key].value is not None else None for key in PLACE_KEYS
        )
        count = len(self.mesh.vertices)
        if position is None:
            if vertex is None:
                raise node.error("have a vertex or a position")
            if self.recorded not in (None, count):
                raise node.error(f"have a position: the edit counts {self.recorded} vertices, the mesh {count}")
            index = vertex.whole(0)
            if index >= count:
                raise vertex.error(f"lie in 0 … {count - 1}")
            return self._at(index)
        point = position.vector()
        if vertex is not None:
            index = vertex.whole(0)
            if index < count and math.dist(self.mesh.vertices[index], point) <= SAME_PLACE * self.mesh.diagonal:
                return self._at(index)
        return Place(point)

    def _at(self, index: int) -> Place:
        x, y, z = (float(number) for number in self.mesh.vertices[index])
        return Place((x, y, z), index)


def _transform(node: _Node, entries: dict[str, _Node], center: Vector) -> Transform:
    rotation, scale, pivot = (entries.get(key) for key in TRANSFORM_KEYS[1:])
    transform = Transform(
        translation=entries["translation"].vector() if "translation" in entries else (0.0, 0.0, 0.0),
        rotation=rotation.rotation() if rotation else (0.0, 0.0, 0.0),
        scale=scale.scale() if scale else (1.0, 1.0, 1.0),
        pivot=pivot.vector() if pivot and pivot.value is not None else None,
    )
    try:
        transform.matrix(center)
    except ValueError:
        raise node.error("have a finite matrix") from None
    return transform


def _symmetry(node: _Node, mesh: Mesh) -> SymmetryPlane | None:
    if node.value is None:
        return None
    if isinstance(node.value, str):
        if node.value not in AXES:
            raise node.error('be "x", "y", "z", a plane or null')
        return symmetry_on(mesh, node.name, node.value, None)
    entries = node.entries("normal", "offset", "band", required=("normal", "offset"))
    band = entries["band"].number(0.0) if "band" in entries else 0.0
    normal, offset = entries["normal"].vector(), entries["offset"].number()
    if abs(math.hypot(*normal) - 1.0) > 1e-6:
        raise entries["normal"].error("have length 1")
    return SymmetryPlane(normal, offset, band=band)


class _Node:
    """A value of a document with the path that leads to it, so that every message can say which and what."""

    def __init__(self, name: str, path: str, value: Any) -> None:
        self.name, self.path, self.value = name, path, value

    def error(self, must: str) -> ValueError:
        shown = json.dumps(self.value, default=str)
        shown = shown if len(shown) <= 60 else shown[:59] + "…"
        must = must if must.startswith(("be ", "have ", "lie ", "hold ")) else f"be {must}"
        return ValueError(f"{self.name}: `{self.path or 'document'}` must {must}, got {shown}")

    def child(self, key: str | int, value: Any) -> _Node:
        step = f"[{key}]" if isinstance(key, int) else f".{key}" if self.path else key
        return _Node(self.name, f"{self.path}{step}", value)

    def kind(self, kind: type, what: str) -> None:
        if not isinstance(self.value, kind) or isinstance(self.value, bool):
            raise self.error(what)

    def entries(self, *keys: str, required: Sequence[str] = ()) -> dict[str, _Node]:
        self.kind(dict, "an object")
        for key in self.value:
            if key not in keys:
                raise ValueError(
                    f"{self.name}: `{self.child(str(key), None).path}` is an unknown key; known are {', '.join(keys)}"
                )
        for key in required:
            if key not in self.value:
                raise ValueError(f"{self.name}: `{self.child(key, None).path}` is missing")
        return {key: self.child(key, value) for key, value in self.value.items()}

    def items(self) -> list[_Node]:
        self.kind(list, "a list")
        return [self.child(i, value) for i, value in enumerate(self.value)]

    def text(self) -> str | None:
        if self.value is not None and not (isinstance(self.value, str) and self.value):
            raise self.error("a text that is not empty, or null")
        return self.value

    def whole(self, minimum: int) -> int:
        if isinstance(self.value, bool) or not isinstance(self.value, int) or self.value < minimum:
            raise self.error(f"a whole number of at least {minimum}")
        return self.value

    def number(self, minimum: float | None = None) -> float:
        what = "a finite number" if minimum is None else f"a finite number of at least {minimum:g}"
        if isinstance(self.value, bool) or not isinstance(self.value, int | float):
            raise self.error(what)
        try:
            result = float(self.value)
        except OverflowError:
            raise self.error(what) from None
        if not math.isfinite(result) or (minimum is not None and result < minimum):
            raise self.error(what)
        return result

    def numbers(self, what: str, *counts: int) -> list[float]:
        if not isinstance(self.value, list) or len(self.value) not in counts:
            raise self.error(what)
        return [node.number() for node in self.items()]

    def vector(self) -> Vector:
        return vector(self.name, self.path, self.numbers("3 numbers", 3))

    def rotation(self) -> Vector:
        numbers = self.numbers("3 numbers, or the 4 of a quaternion", 3, 4)
        try:
            return rotation_vector(self.name, numbers)
        except ValueError:
            raise self.error("a rotation within ±1e9 degrees, or a quaternion other than 0") from None

    def scale(self) -> Vector:
        if isinstance(self.value, list):
            return scale_factors(self.name, self.numbers("a number or 3", 3))
        return scale_factors(self.name, self.number())


def _distinct(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result: dict[str, Any] = {}
    for key, value in pairs:
        if key in result:
            raise ValueError(f"`{key}` is given twice")
        result[key] = value
    return result


def _refuse(constant: str) -> Any:
    raise ValueError(f"numbers must be finite, got {constant}")
