"""Edits in files: what `dfd.editing.document` describes, written and read, on the same mesh or on another one."""

from __future__ import annotations

import json
import math
import os
import re
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dfd.common.files import atomic_write
from dfd.editing.controls import LARGEST, Controls
from dfd.editing.document import (
    DefaultDocument,
    EditDocument,
    FixedDocument,
    HandleDocument,
    MadeOnDocument,
    MeshDocument,
    PlaceDocument,
    PlaneDocument,
    PointDocument,
    parse,
)
from dfd.editing.edit import Edit, Fixed, Handle, band_on, box_center, symmetry_on
from dfd.editing.place import Place, place_on
from dfd.editing.presets import WHOLE_SHAPE
from dfd.editing.region_document import region_from, region_to
from dfd.editing.regions import SAME_POSITION, VertexSet, members
from dfd.posing.transforms import Transform
from dfd.symmetry.plane import SymmetryPlane

if TYPE_CHECKING:
    from dfd.field.field import Field
    from dfd.mesh.mesh import Mesh

__all__ = ["from_document", "read_edit", "read_made_on", "to_document", "write_edit"]

# Two resolutions of one shape have boxes whose corners are nearer than this part of the diagonal.
SAME_BOX = 0.05
TRANSFORM_KEYS = ("translation", "rotation", "scale", "pivot", "axes")
CONTROL_KEYS = ("reach", "falloff", "locality", "radius", "strength", "instances", "level", "within_width")


def write_edit(path: str | os.PathLike[str], edit: Edit, mesh: Mesh, field: Field | None = None) -> None:
    """Write `edit` of `mesh` to `path`, whole or not at all; with a `field` that has a file also where both files are.

    Raises
    ------
    OSError
        If `path` cannot be written; a file that was there stays as it was.
    """
    document = to_document(edit, mesh) | {"made_on": _made_on(Path(path), mesh, field)}
    text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
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
        If it is no such document, or one of another shape; the message names the key and what was found there.

    Warns
    -----
    UserWarning
        If a vertex of the edit is no longer where it was, and counts as a point of space.
    """
    return from_document(_parsed(path), mesh, name=os.fspath(path))


def read_made_on(path: str | os.PathLike[str]) -> tuple[Path | None, Path | None, str | None]:
    """The mesh and the field that the edit in `path` says it was made on, and the SHA-256 of the field's file.

    Raises what `read_edit` raises of a document; the files may be gone.
    """
    said = parse(_parsed(path), os.fspath(path)).made_on
    if said is None:
        return None, None, None
    folder = Path(path).parent
    mesh, field = (None if each is None else folder / each for each in (said.mesh, said.field))
    return mesh, field, said.field_sha256


def _parsed(path: str | os.PathLike[str]) -> Any:
    name = os.fspath(path)
    try:
        text = Path(path).read_text(encoding="utf-8-sig")  # some editors begin a file with a byte order mark
    except UnicodeDecodeError as error:
        raise ValueError(f"{name}: an edit must be UTF-8 text, but byte {error.start} is none") from None
    except OSError as error:
        raise OSError(error.errno, f"{name}: the edit could not be read: {error.strerror}") from error
    try:
        return json.loads(text, object_pairs_hook=_distinct, parse_constant=_refuse)
    except json.JSONDecodeError as error:
        raise ValueError(f"{name}: no whole JSON document: {error}") from None
    except RecursionError:
        raise ValueError(f"{name}: no edit: nested too deeply") from None
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None


def _made_on(path: Path, mesh: Mesh, field: Field | None) -> dict[str, str | None] | None:
    """Where the files of a mesh and its field are, as the edit in `path` names them; None where the field has none."""
    source = None if field is None else field.source
    if source is None:
        return None
    folder = path.resolve().parent
    places = {"mesh": _from(folder, mesh.source), "field": _from(folder, source.path)}
    return MadeOnDocument(**places, field_sha256=source.sha256).model_dump(mode="json")


def _from(folder: Path, file: Path | None) -> str | None:
    """A file inside `folder` from there, so that both can be moved together; any other from the root."""
    if file is None:
        return None
    whole = file.resolve()
    return (whole.relative_to(folder) if whole.is_relative_to(folder) else whole).as_posix()


def to_document(edit: Edit, mesh: Mesh) -> dict[str, Any]:
    """`edit` of `mesh` as a JSON document."""
    plane = edit.symmetry
    (low, high) = mesh.bounds.tolist()
    document = EditDocument(
        format="dfd-edit",
        version=3,
        preset=edit.preset,
        mesh=MeshDocument(vertices=len(mesh.vertices), hash=mesh.content_hash, bounds=(tuple(low), tuple(high))),
        made_on=None,
        handles=[_handle_to(handle) for handle in edit.handles],
        fixed=[FixedDocument(**_place_to(fixed.place), strength=fixed.strength) for fixed in edit.fixed],
        symmetry=(None if plane is None else PlaneDocument(normal=plane.normal, offset=plane.offset, band=plane.band)),
        default=None if edit.default is None else DefaultDocument(**_transform_to(edit.default)),
        **{key: getattr(edit, key) for key in WHOLE_SHAPE},
    )
    return document.model_dump(mode="json")


def _handle_to(handle: Handle) -> HandleDocument:
    return HandleDocument(
        id=handle.id,
        name=handle.name,
        **_place_to(handle.place),
        **_transform_to(handle.transform),
        along=handle.transform.along,
        **{key: getattr(handle.controls, key) for key in CONTROL_KEYS},
        without_instances=[_point_to(place) for place in handle.controls.without_instances],
        within=region_to(handle.controls.within),
    )


def _point_to(place: Place) -> PointDocument:
    return PointDocument(vertex=place.vertex, position=place.position)


def _place_to(place: Place) -> dict[str, Any]:
    return {"vertex": place.vertex, "position": place.position, "region": region_to(place.region)}


def _transform_to(transform: Transform) -> dict[str, Any]:
    parts = {key: getattr(transform, key) for key in TRANSFORM_KEYS}
    return {**parts, "rotation": list(transform.rotation)}


def from_document(document: Any, mesh: Mesh, *, name: str = "edit") -> Edit:
    """The edit of `mesh` in a parsed JSON document; `name` begins every message.

    Raises
    ------
    ValueError
        If it is no such document, or one of another shape; the message names the key and what was found there.

    Warns
    -----
    UserWarning
        If a vertex of the edit is no longer where it was, and counts as a point of space.
    """
    return _Reading(parse(document, name), mesh, name).edit()


class _Reading:
    """One document on its way to a mesh."""

    def __init__(self, document: EditDocument, mesh: Mesh, name: str) -> None:
        self.document, self.mesh, self.name = document, mesh, name
        self.lost = 0  # vertices that are not where they were

    def edit(self) -> Edit:
        document = self.document
        handles = self._handles()
        fixed = tuple(
            Fixed(self._place(entry, f"fixed[{i}]"), entry.strength) for i, entry in enumerate(document.fixed)
        )
        default = None
        if document.default is not None:
            default = self._transform(document.default, "default")
            self._named("default", default.matrix, box_center(self.mesh))
        self._same_shape()
        self._check_points("handles", [handle.place for handle in handles])
        self._check_points("fixed", [each.place for each in fixed])
        for i, handle in enumerate(handles):
            self._check_points(f"handles[{i}].without_instances", handle.controls.without_instances)
        symmetry = self._symmetry()
        whole = {key: getattr(document, key) for key in (*WHOLE_SHAPE, "preset")}
        try:
            return Edit(handles, fixed, symmetry, default, **whole)
        except ValueError as error:
            raise ValueError(f"{self.name}: {str(error).removeprefix('Edit: ')}") from None

    def _handles(self) -> tuple[Handle, ...]:
        entries = self.document.handles
        given = {entry.id for entry in entries if entry.id is not None}
        free = (id_ for id_ in range(1, 2 * len(entries) + 1) if id_ not in given)
        handles = []
        for i, entry in enumerate(entries):
            path = f"handles[{i}]"
            parts = {key: getattr(entry, key) for key in CONTROL_KEYS}
            off = enumerate(entry.without_instances)
            parts["without_instances"] = tuple(self._point(one, f"{path}.without_instances[{j}]") for j, one in off)
            within = None
            if entry.within is not None:
                within = self._named(f"{path}.within", region_from, entry.within)
                self._named(f"{path}.within", members, self.mesh, within)
            handles.append(
                self._named(
                    path,
                    Handle,
                    next(free) if entry.id is None else entry.id,
                    self._place(entry, path),
                    self._transform(entry, path),
                    self._named(path, Controls, **parts, within=within),
                    entry.name,
                )
            )
        return tuple(handles)

    def _place(self, entry: PlaceDocument, path: str) -> Place:
        """Where vertex, position or region of a document lie on the mesh."""
        if entry.region is not None:
            region = self._named(f"{path}.region", region_from, entry.region)
            if isinstance(region, VertexSet) and not region.lies_on(self.mesh):
                self.lost += 1
            held: Place = self._named(f"{path}.region", place_on, self.mesh, region)
            return held
        return self._point(entry, path)

    def _point(self, entry: PointDocument, path: str) -> Place:
        """Where vertex or position of a document lie on the mesh."""
        if entry.position is not None:
            if entry.vertex is not None:
                if self._lies_at(entry.vertex, entry.position):
                    return place_on(self.mesh, entry.vertex)
                self.lost += 1
            return Place(entry.position)
        if entry.vertex is None:
            region = " or a region" if isinstance(entry, PlaceDocument) else ""
            raise self._error(f"`{path}` must have a vertex{',' if region else ' or'} a position{region}")
        recorded, count = self.document.mesh, len(self.mesh.vertices)
        if recorded is not None and recorded.vertices != count:
            raise self._error(
                f"`{path}` must have a position: the edit counts {recorded.vertices} vertices, the mesh {count}"
            )
        if recorded is not None and recorded.hash not in (None, self.mesh.content_hash):
            raise self._error(f"`{path}` must have a position: the edit was made on another mesh")
        if entry.vertex >= count:
            raise self._error(f"`{path}.vertex` must lie in 0 … {count - 1}, got {entry.vertex}")
        return place_on(self.mesh, entry.vertex)

    def _lies_at(self, vertex: int, position: tuple[float, float, float]) -> bool:
        vertices = self.mesh.vertices
        return vertex < len(vertices) and math.dist(vertices[vertex], position) <= SAME_POSITION * self.mesh.diagonal

    def _same_shape(self) -> None:
        """Refuse an edit of another shape; say so where one of another resolution goes by positions."""
        recorded = self.document.mesh
        if recorded is None or recorded.hash == self.mesh.content_hash:
            return
        if recorded.bounds is not None:
            was, now = np.asarray(recorded.bounds), np.asarray(self.mesh.bounds)
            apart = np.linalg.norm(was - now, axis=1).max()
            if apart > SAME_BOX * max(float(np.linalg.norm(was[1] - was[0])), self.mesh.diagonal):
                raise self._error(
                    f"`mesh.bounds` must be those of this mesh, {now.tolist()}, got {was.tolist()}: "
                    "the edit is one of another shape; dfd.editing.transfer carries it over"
                )
        if self.lost:
            warnings.warn(
                f"{self.name}: the edit was made on a mesh of {recorded.vertices} vertices, and this one has "
                f"{len(self.mesh.vertices)}: {self.lost} of its vertices or sets of them are taken by position",
                UserWarning,
                stacklevel=4,
            )

    def _check_points(self, key: str, places: Sequence[Place]) -> None:
        """Refuse points that the kernels could not compute with."""
        for i, place in enumerate(places):
            if max(map(abs, place.position)) > LARGEST:
                point = ",".join(f"{x:g}" for x in place.position)
                raise self._error(f"`{key}[{i}].position` must be numbers of at most {LARGEST:g}, got {point}")

    def _transform(self, entry: DefaultDocument, path: str) -> Transform:
        parts = {key: getattr(entry, key) for key in TRANSFORM_KEYS}
        if isinstance(entry, HandleDocument):
            parts["along"] = entry.along
        made: Transform = self._named(path, Transform, **parts)
        return made

    def _symmetry(self) -> SymmetryPlane | None:
        entry = self.document.symmetry
        if entry is None:
            return None
        if isinstance(entry, PlaneDocument):
            band = band_on(self.mesh, self.document.preset) if entry.band is None else entry.band
            plane: SymmetryPlane = self._named("symmetry", SymmetryPlane, entry.normal, entry.offset, band=band)
            return plane
        return symmetry_on(self.mesh, entry, preset=self.document.preset)

    def _named(self, path: str, make: Any, *arguments: Any, **options: Any) -> Any:
        """What `make` makes, or its complaint in the name of the file and of the key."""
        try:
            return make(*arguments, **options)
        except ValueError as error:
            complaint = re.sub(r"^\w+: ", "", str(error))
            joined = re.sub(r"^`(\w+)`", lambda key: f"`{path}.{key[1]}`", complaint)
            raise self._error(joined if joined != complaint else f"`{path}`: {complaint}") from None

    def _error(self, complaint: str) -> ValueError:
        return ValueError(f"{self.name}: {complaint}")


def _distinct(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result: dict[str, Any] = {}
    for key, value in pairs:
        if key in result:
            raise ValueError(f"`{key}` is given twice")
        result[key] = value
    return result


def _refuse(constant: str) -> Any:
    raise ValueError(f"numbers must be finite, got {constant}")
