"""Write an `Edit` to a JSON document, and read it on the same mesh or on another one (docs/reference/edit_files.md).

Required keys: `format`, `version`, and for every handle and fixed point a `vertex`, a `position` or a `region`. Other
keys at the top, in handles and in fixed points have defaults, some of which depend on `preset` (`dfd.editing.presets`).
Unknown keys, repeated keys and numbers that are not finite raise an error, so a misspelt key never becomes a default.

`vertex` is used if it lies at `position`, or if there is no `position` and `mesh` does not describe another mesh. If
the vertex lies elsewhere, as on another resolution, `position` is used, as a point in space. The keys of a handle's
place, transform and controls are written directly in the handle's object. All other keys are the fields of `EditFile`.
"""

import json
import math
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from functools import cache, partial
from itertools import count
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import numpy as np
from pydantic import ConfigDict, StringConstraints, TypeAdapter, ValidationError

from dfd.common import check
from dfd.common.described import About, about, check_fields
from dfd.common.errors import ArgumentError, called, within
from dfd.common.files import write_file
from dfd.common.preset import Preset
from dfd.editing.controls import Controls
from dfd.editing.edit import Edit, band_on, box_center, edit_on, symmetry_on
from dfd.editing.points import Place, place_on
from dfd.editing.presets import PRESETS
from dfd.editing.regions import SAME_POSITION, Region, VertexSet
from dfd.field.field import Field
from dfd.mesh.mesh import Mesh
from dfd.posing.transforms import Transform, Vector
from dfd.symmetry.plane import AXES

# Meshes count as one shape if the corners of their bounding boxes differ by at most this fraction of the diagonal.
SAME_BOX = 0.05


@dataclass(frozen=True)
class Units:
    """The units of lengths and angles in the file. Other values are errors."""

    length: Literal["mesh"] = "mesh"
    angle: Literal["degree"] = "degree"


@dataclass(frozen=True)
class MadeFor:
    """The mesh to which the vertex indices of the edit refer."""

    vertices: Annotated[int, About("Number of vertices.", 1.0)]
    hash: Annotated[str | None, About("`Mesh.content_hash` of the mesh.")] = None
    bounds: Annotated[
        tuple[Vector, Vector] | None, About("Smallest and largest coordinates of the bounding box, mesh units.")
    ] = None

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True)
class MadeOn:
    """The files of the mesh and its field. Paths in the folder of the edit file are relative, all others absolute.

    `name` is the name under which the user opened the mesh, for lists of edits.
    """

    mesh: Annotated[str, StringConstraints(min_length=1)] | None = None
    field: Annotated[str, StringConstraints(min_length=1)] | None = None
    field_sha256: Annotated[str, StringConstraints(pattern="^[0-9a-f]{64}$")] | None = None
    name: Annotated[str, StringConstraints(min_length=1)] | None = None


@dataclass(frozen=True)
class EditFile(Edit):
    """An edit, with the format, version and units of the file, and the mesh on which the edit was made."""

    format: Literal["dfd-edit"] = "dfd-edit"
    version: Literal[1] = 1
    units: Units = field(default_factory=Units)
    mesh: MadeFor | None = None
    made_on: MadeOn | None = None

    __pydantic_config__ = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


@cache
def _model() -> TypeAdapter[EditFile]:
    return TypeAdapter(EditFile)


def _keys(owner: type) -> tuple[str, ...]:
    return tuple(each.name for each in fields(owner) if each.init)


# Fields that have no object of their own in a file: their keys are in the object of the handle or fixed point.
SPREAD: dict[str, type] = {"place": Place, "transform": Transform, "controls": Controls}
# Keys of a handle's transform that need the handle's part. The default transform has no part, so it lacks these keys.
OF_HELD_PARTS = tuple(name for name, (_, said) in about(Transform).items() if said is not None and said.of_part)
FIRST = ("format", "version", "preset", "units", "mesh", "made_on")  # first keys of a file, for readability
# Keys that are not written: excluded counterparts have no region, and the default transform has no part.
UNWRITTEN: dict[str, Any] = {
    "handles": {"__all__": {"controls": {"excluded_counterparts": {"__all__": {"region"}}}}},
    "default": set(OF_HELD_PARTS),
}


def edit_schema() -> dict[str, Any]:
    """Return the JSON Schema of the edit document."""
    schema = _model().json_schema()
    definitions = schema["$defs"]
    for owner in ("Handle", "Fixed"):
        own = definitions[owner]
        properties = own.pop("properties")
        for name in [each for each in SPREAD if properties.pop(each, None)]:
            properties |= definitions[name.capitalize()]["properties"]
        own["properties"] = properties
        del own["required"]
    for key in OF_HELD_PARTS:
        del definitions["Transform"]["properties"][key]
    schema["required"] = ["format", "version"]
    return schema


def write_edit(
    path: str | os.PathLike[str], edit: Edit, mesh: Mesh, field: Field | None = None, *, made_on: MadeOn | None = None
) -> None:
    """Write `edit`, made on `mesh`, to `path`. If `field` has a file, also write the paths of the field and the mesh.

    `made_on` replaces these paths. Raises OSError if `path` cannot be written; an existing file then stays unchanged.
    """
    document, source = to_document(edit, mesh), None if field is None else field.source
    if made_on is None and source is not None:
        files = None if mesh.source is None else str(mesh.source)
        made_on = MadeOn(files, str(source.path), source.sha256)
    if made_on is not None:
        folder = Path(path).resolve().parent
        paths = {key: _path_for(folder, getattr(made_on, key)) for key in ("mesh", "field")}
        document["made_on"] = {**vars(made_on), **paths}
    text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    # Put each list of numbers on one line. The pattern needs a line break, which a text in JSON never contains.
    text = re.sub(r"\[\n[-+.\de,\s]+\]", lambda numbers: "[" + " ".join(numbers[0][1:-1].split()) + "]", text)
    write_file(path, text)


def read_edit(path: str | os.PathLike[str], mesh: Mesh, *, other_shape: bool = False) -> Edit:
    """Read an edit of `mesh`, or of another resolution of the same shape, from `path`.

    If a vertex of the edit has another position on `mesh`, the stored position is used, as a point in space. This
    causes a warning if the edit was made on another mesh. `other_shape` also accepts an edit of another shape.

    Raises OSError if `path` cannot be read. Raises ValueError if the file has no edit, or an edit of another shape.
    """
    return from_document(_parsed(path), mesh, name=os.fspath(path), other_shape=other_shape)


def read_made_on(path: str | os.PathLike[str]) -> tuple[Path | None, Path | None, str | None]:
    """Return the files of the mesh and the field on which the edit in `path` was made, and the field's SHA-256.

    A value that the document lacks is None. The files need not exist. Raises OSError or ValueError as `read_edit` does.
    """
    made_on = _validated(_parsed(path), os.fspath(path)).made_on or MadeOn()
    mesh, field = (None if each is None else Path(path).parent / each for each in (made_on.mesh, made_on.field))
    return mesh, field, made_on.field_sha256


def _parsed(path: str | os.PathLike[str]) -> Any:
    name = os.fspath(path)
    try:
        text = Path(path).read_text(encoding="utf-8-sig")  # some editors start a file with a byte order mark
    except UnicodeDecodeError as error:
        raise ValueError(f"{name}: an edit must be UTF-8 text, but byte {error.start} is not") from None
    except OSError as error:
        raise OSError(error.errno, f"{name}: the edit could not be read: {error.strerror}") from error
    try:
        return json.loads(text, object_pairs_hook=_distinct)
    except json.JSONDecodeError as error:
        raise ValueError(f"{name}: no whole JSON document: {error}") from None
    except RecursionError:
        raise ValueError(f"{name}: no edit: nested too deeply") from None
    except ValueError as error:  # a key is given twice, or a number has too many digits
        raise ValueError(f"{name}: {error}") from None


def _distinct(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result: dict[str, Any] = {}
    for key, value in pairs:
        if key in result:
            raise ArgumentError(key, "is given twice")
        result[key] = value
    return result


def _path_for(folder: Path, file: str | None) -> str | None:
    """Return the path of `file` that an edit in `folder` stores: relative if the file is in `folder`, else absolute.

    Return None if the path cannot be written in UTF-8, as JSON requires.
    """
    absolute = file and Path(file).resolve()
    path = absolute and (absolute.relative_to(folder) if absolute.is_relative_to(folder) else absolute).as_posix()
    return path if path and path.encode("utf-8", "replace").decode() == path else None


def to_document(edit: Edit, mesh: Mesh) -> dict[str, Any]:
    """Return `edit`, made on `mesh`, as a JSON document."""
    low, high = mesh.bounds.tolist()
    made_for = MadeFor(len(mesh.vertices), mesh.content_hash, (tuple(low), tuple(high)))
    written = _model().dump_python(EditFile(**_values(edit), mesh=made_for), mode="json", exclude=UNWRITTEN)
    document: dict[str, Any] = {key: written.pop(key) for key in FIRST} | written
    for key in ("handles", "fixed"):
        document[key] = [_spread(entry) for entry in document[key]]
    for key in ("score", "relative_score"):  # results of the search for planes, which posing does not need
        (document["symmetry"] or {}).pop(key, None)
    return document


def _values(edit: Edit) -> dict[str, Any]:
    return {name: getattr(edit, name) for name in _keys(Edit)}


def _spread(entry: dict[str, Any]) -> dict[str, Any]:
    """Return `entry`, a handle or fixed point, with the keys of its place, transform and controls directly in it."""
    named = {key: entry.pop(key) for key in ("id", "name") if key in entry}
    return named | {key: value for group in SPREAD for key, value in entry.pop(group, {}).items()} | entry


def from_document(document: Any, mesh: Mesh, *, name: str = "edit", other_shape: bool = False) -> Edit:
    """Return the edit in a parsed JSON document, as `read_edit` does. Error messages begin with `name`."""
    said = _validated(document, name, mesh)
    made = said.mesh
    with called(name):
        edit = Edit(**_values(edit_on(mesh, said, partial(_placed, mesh, made))))
        if edit.default is not None:
            with within("default"):
                edit.default.matrix(box_center(mesh))
        if not other_shape and made is not None:
            _check_shape(mesh, made)
    lost = sum(_moved(mesh, place) for place in _places(said))
    if lost and made is not None and made.hash != mesh.content_hash:
        check.warn(
            f"{name}: the edit was made on a mesh of {made.vertices} vertices, and this one has {len(mesh.vertices)}: "
            f"{lost} of the edit's vertices or sets of vertices are found by position",
            UserWarning,
        )
    return edit


def _places(edit: Edit) -> Iterator[Place]:
    for handle in edit.handles:
        yield from (handle.place, *handle.controls.excluded_counterparts)
    yield from (fixed.place for fixed in edit.fixed)


def _moved(mesh: Mesh, said: Place) -> bool:
    """Return whether the vertices of the place `said` have other positions on the mesh than in the file."""
    if said.region is not None:
        return isinstance(said.region, VertexSet) and not said.region.lies_on(mesh)
    if said.vertex is None or not said.known:
        return False
    near = SAME_POSITION * mesh.diagonal
    return said.vertex >= len(mesh.vertices) or math.dist(mesh.vertices[said.vertex], said.position) > near


def _placed(mesh: Mesh, made: MadeFor | None, path: str, said: Place) -> Place:
    """Return the place on `mesh` for `said`, the place at the key `path` of a document for the mesh `made`."""
    if said.region is not None:
        with within(f"{path}.region"):
            return place_on(mesh, said.region)
    if said.vertex is None or _moved(mesh, said):
        with within(path):
            return place_on(mesh, Place(said.position))
    size = len(mesh.vertices)
    if made is not None and not said.known:
        if made.vertices != size:
            raise ArgumentError(
                path, f"must have a position: the edit was made on {made.vertices} vertices, the mesh has {size}"
            )
        if made.hash not in (None, mesh.content_hash):
            raise ArgumentError(path, "must have a position: the edit was made on another mesh")
    if said.vertex >= size:
        raise ArgumentError(f"{path}.vertex", f"must lie in 0 … {size - 1}, got {said.vertex}")
    return place_on(mesh, said.vertex)


def _check_shape(mesh: Mesh, made: MadeFor) -> None:
    """Raise ValueError if the bounding boxes of `mesh` and of the mesh `made`, on which the edit was made, differ."""
    if made.bounds is None or made.hash == mesh.content_hash:
        return
    was, now = np.asarray(made.bounds), np.asarray(mesh.bounds)
    apart = np.linalg.norm(was - now, axis=1).max()
    if apart > SAME_BOX * max(float(np.linalg.norm(was[1] - was[0])), mesh.diagonal):
        raise ArgumentError(
            "mesh.bounds",
            f"must be those of this mesh, {now.round(4).tolist()}, got {was.round(4).tolist()}: the edit is one of "
            "another shape; dfd.editing.transfer transfers it, other_shape=True accepts it anyway",
        )


def _validated(document: Any, name: str, mesh: Mesh | None = None) -> EditFile:
    """Check a document, and return its edit. The places are not yet converted to places on `mesh`."""
    if not isinstance(document, dict):
        raise ArgumentError("document", f"must be an edit, got {_shown(document)}", name)
    for key, value in (("format", EditFile.format), ("version", EditFile.version)):
        found = document.get(key)
        if found != value or isinstance(found, bool):
            raise ArgumentError(key, f"must be {_shown(value)}, got {_shown(found)}", name)
    default = document.get("default")
    for key in OF_HELD_PARTS:
        if isinstance(default, dict) and key in default:
            raise ArgumentError(*_unknown(("default", key)), name)
    try:
        return _model().validate_json(json.dumps(_completed(document, mesh)))
    except ValidationError as error:
        argument, reason = _reported(error)
        raise ArgumentError(argument, reason, name) from None


def _completed(document: dict[str, Any], mesh: Mesh | None) -> dict[str, Any]:
    """Return the document as pydantic expects it: with defaults, and with objects for places, transforms, controls."""
    known: Preset = document["preset"] if document.get("preset") in tuple(PRESETS) else "default"
    whole = dict(document)
    handles, fixed, plane = (whole.get(key) for key in ("handles", "fixed", "symmetry"))
    if isinstance(handles, list):
        ids = {entry["id"] for entry in handles if isinstance(entry, dict) and isinstance(entry.get("id"), int)}
        free = (number for number in count(1) if number not in ids)
        whole["handles"] = [_grouped(entry, SPREAD, PRESETS[known].handle, free) for entry in handles]
    if isinstance(fixed, list):
        whole["fixed"] = [_grouped(entry, ("place",), {}) for entry in fixed]
    if mesh is not None and isinstance(plane, str) and plane in AXES:
        found = symmetry_on(mesh, plane, preset=known)
        whole["symmetry"] = {"normal": found.normal, "offset": found.offset, "band": found.band}
    elif isinstance(plane, dict) and plane.get("band") is None:
        whole["symmetry"] = {**plane, "band": 0.0 if mesh is None else band_on(mesh, known)}
    return whole


def _grouped(entry: Any, groups: Iterable[str], defaults: Mapping[str, Any], free: Iterator[int] | None = None) -> Any:
    """Return a handle or fixed point with `defaults`, and an object for each of `groups`. `free` gives missing ids."""
    if not isinstance(entry, dict):
        return entry
    given = {**defaults, **entry}
    if free is not None and given.get("id") is None:
        given["id"] = next(free)
    grouped = {group: {key: given.pop(key) for key in _keys(SPREAD[group]) if key in given} for group in groups}
    return given | grouped


# Words in pydantic's path to a value that are no keys of the document: types of a union, and the keys of `SPREAD`.
TAGS = {"float", "str", *SPREAD, *(each.kind for each in get_args(Region)), "SymmetryPlane"}
PHRASES = {  # patterns in pydantic's messages, and the words that replace them
    "be a dictionary or a counterpart of .*": "be an object",
    "be an? valid (tuple|list|array)": "be a list",
    "valid number": "finite number",
    "valid integer": "whole number",
    " after validation.*": "",
}


def _reported(error: ValidationError) -> tuple[str, str]:
    """Return the key of the first error, and its reason in the words of this package."""
    errors = error.errors(include_url=False)
    # pydantic gives one error for each type of a union. Report the longest path; for a text, report choices.
    owner = _path(errors[0]["loc"])
    first = max(
        (each for each in errors if _path(each["loc"]).startswith(owner)),
        key=lambda each: (len(each["loc"]), each["type"] == "literal_error" and isinstance(each["input"], str)),
    )
    steps, kind, shown = first["loc"], first["type"], _shown(first["input"])
    if kind == "json_invalid":  # the text is not Unicode, or lists are nested too deeply
        return "document", f"cannot be read: {first['msg'].removeprefix('Invalid JSON: ')}"
    said = first.get("ctx", {}).get("error")
    if isinstance(said, ArgumentError):
        return _path((*steps, said.argument)), said.reason
    if kind.startswith("missing") or kind == "union_tag_not_found":
        return _path(steps) + (".kind" if kind == "union_tag_not_found" else ""), f"is missing in {shown}"
    if kind == "union_tag_invalid":
        return f"{_path(steps)}.kind", f"must be one of {first['ctx']['expected_tags']}, got {first['ctx']['tag']!r}"
    if kind == "unexpected_keyword_argument":
        return _unknown(steps)
    must = re.sub(r"^\w+ should ", "", first["msg"])
    for theirs, ours in PHRASES.items():
        must = re.sub(theirs, ours, must)
    return _path(steps), f"must {must}, got {shown}"


def _unknown(steps: tuple[int | str, ...]) -> tuple[str, str]:
    """Return the path of an unknown key, and the reason with the known keys."""
    known = edit_schema()
    for key in (step for step in steps[:-1] if isinstance(step, str) and step not in TAGS):
        owners = re.findall(r"\$defs/(\w+)", json.dumps(known["properties"][key]))
        known = edit_schema()["$defs"][owners[0]] if len(owners) == 1 else {}  # a region has several types
    return _path(steps), "is an unknown key" + (f"; known are {', '.join(known['properties'])}" if known else "")


def _path(steps: Iterable[int | str]) -> str:
    path, before = "", ""
    for step in steps:
        # `TAGS` are left out. "vertices" is the tag of a vertex set, but a key of the document in `mesh.vertices`.
        tag = step in TAGS or (isinstance(step, str) and "[" in step)
        if not (tag and path) or (step == "vertices" and before == "mesh"):
            path += f"[{step}]" if isinstance(step, int) else f".{step}" if path else step
        before = str(step)
    return path or "document"


def _shown(value: Any) -> str:
    shown = json.dumps(value, default=str)
    return shown if len(shown) <= 60 else shown[:59] + "…"
