"""Edits in files: an `Edit` as a JSON document, written and read, on the same mesh or on another one.

    {
      "format": "dfd-edit",
      "version": 1,
      "preset": "default",
      "units": {"length": "mesh", "angle": "degree"},
      "mesh": {"vertices": 2930, "hash": null, "bounds": null},
      "made_on": {"mesh": "cow.glb", "field": "cow.field.safetensors", "field_sha256": null},
      "handles": [
        {
          "id": 1,
          "name": "left horn",
          "vertex": 1234,
          "position": [0.1, 0.9, -0.6],
          "region": null,
          "translation": [0.0, 0.2, 0.0],
          "rotation": [0.0, 0.0, 30.0],
          "scale": [1.0, 1.0, 1.0],
          "pivot": null,
          "axes": null,
          "pivot_at": null,
          "bend": [0.0, 0.0, 0.0],
          "twist": 0.0,
          "joint": null,
          "reach": 1.0,
          "falloff": "linear",
          "locality": 2.0,
          "radius": null,
          "strength": 1.0,
          "counterparts": "shared_pivot",
          "excluded_counterparts": [{"vertex": 812, "position": [-0.1, 0.9, -0.6]}],
          "mask": null,
          "mask_feather": 0.0
        }
      ],
      "fixed": [{"vertex": 77, "position": [0.2, -0.7, 0.1], "region": null, "strength": 1.0}],
      "symmetry": {"normal": [1.0, 0.0, 0.0], "offset": 0.0, "band": 0.05},
      "default": null
    }

Required keys: `format`, `version`, and for every handle and fixed point a `vertex`, a `position` or a `region`. The
document's `preset` gives the values of all other keys that are left out (`dfd.editing.presets`). Unknown keys, repeated
keys, and numbers that are not finite raise an error, so a misspelt key never becomes a default.

A vertex is used if it lies at `position`, or if there is no `position` and `mesh` fits. On another resolution it may
lie elsewhere; the position is then used, as a point in space. A handle has the keys of its place, its transform and its
controls on one level. Otherwise pydantic defines the document from the fields of `Edit`.
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
from dfd.editing.influence.regions import SAME_POSITION, Region, VertexSet
from dfd.editing.points import Place, place_on
from dfd.editing.presets import PRESETS
from dfd.field.field import Field
from dfd.mesh.mesh import Mesh
from dfd.posing.transforms import Transform, Vector
from dfd.symmetry.plane import AXES

# Two resolutions of one shape have boxes whose corners differ by less than this fraction of the diagonal.
SAME_BOX = 0.05


@dataclass(frozen=True)
class Units:
    """The units of lengths and angles; a file cannot have others."""

    length: Literal["mesh"] = "mesh"
    angle: Literal["degree"] = "degree"


@dataclass(frozen=True)
class MadeFor:
    """Describes the shape that the edit was made on, to which its vertex indices refer."""

    vertices: Annotated[int, About("How many vertices it has.", 1.0)]
    hash: Annotated[str | None, About("Its `Mesh.content_hash`.")] = None
    bounds: Annotated[
        tuple[Vector, Vector] | None, About("The smallest and largest coordinates of its box, mesh units.")
    ] = None

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True)
class MadeOn:
    """Names the files that the edit was made on: relative paths if they are in its folder, else absolute."""

    mesh: Annotated[str, StringConstraints(min_length=1)] | None = None
    field: Annotated[str, StringConstraints(min_length=1)] | None = None
    field_sha256: Annotated[str, StringConstraints(pattern="^[0-9a-f]{64}$")] | None = None


@dataclass(frozen=True)
class EditFile(Edit):
    """An edit of a shape with the other keys of a file."""

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


# In a file, the keys of these values are on the same level as the other keys of a handle or a fixed point.
SPREAD: dict[str, type] = {"place": Place, "transform": Transform, "controls": Controls}
# Keys of a handle's transform that the default transform lacks.
OF_HELD_PARTS = tuple(name for name, (_, said) in about(Transform).items() if said is not None and said.of_part)
FIRST = ("format", "version", "preset", "units", "mesh", "made_on")  # first keys of a file, for readability
# Keys that are not written; excluded counterparts are points.
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
        for part in [each for each in SPREAD if properties.pop(each, None)]:
            properties |= definitions[part.capitalize()]["properties"]
        own["properties"] = properties
        del own["required"]
    for key in OF_HELD_PARTS:
        del definitions["Transform"]["properties"][key]
    schema["required"] = ["format", "version"]
    return schema


def write_edit(path: str | os.PathLike[str], edit: Edit, mesh: Mesh, field: Field | None = None) -> None:
    """Write `edit` of `mesh` to `path`, whole or not at all. If `field` has a file, also write the paths of both files.

    Raises OSError if `path` cannot be written; an existing file stays unchanged.
    """
    document, source = to_document(edit, mesh), None if field is None else field.source
    if source is not None:
        folder = Path(path).resolve().parent
        files = {"mesh": _from(folder, mesh.source), "field": _from(folder, source.path)}
        document["made_on"] = files | {"field_sha256": source.sha256}
    text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    # Each list of numbers goes on one line, for readability. JSON texts contain no raw line break, so this is safe.
    text = re.sub(r"\[\n[-+.\de,\s]+\]", lambda numbers: "[" + " ".join(numbers[0][1:-1].split()) + "]", text)
    write_file(path, text)


def read_edit(path: str | os.PathLike[str], mesh: Mesh, *, other_shape: bool = False) -> Edit:
    """Read an edit of `mesh`, or of another resolution of the same shape, from `path`.

    `other_shape` accepts an edit of another shape as well, and finds its places by their positions.

    Raises OSError if `path` cannot be read. Raises ValueError if it is no such document, or an edit of another shape;
    the message names the key and the value found there. Warns if a vertex of the edit is no longer at its position; the
    position is then a point in space.
    """
    return from_document(_parsed(path), mesh, name=os.fspath(path), other_shape=other_shape)


def read_made_on(path: str | os.PathLike[str]) -> tuple[Path | None, Path | None, str | None]:
    """Return the mesh and the field that the edit in `path` was made on, and the SHA-256 of the field's file.

    Raises the errors of `read_edit` about a document. The files need not exist.
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


def _from(folder: Path, file: Path | None) -> str | None:
    """Return a relative path for a file inside `folder`, so that both can be moved together, else an absolute path.

    Return None for a name that is not UTF-8, because a JSON file cannot hold it.
    """
    whole = file and file.resolve()
    named = whole and (whole.relative_to(folder) if whole.is_relative_to(folder) else whole).as_posix()
    return named if named and named.encode("utf-8", "replace").decode() == named else None


def to_document(edit: Edit, mesh: Mesh) -> dict[str, Any]:
    """Return `edit` of `mesh` as a JSON document."""
    low, high = mesh.bounds.tolist()
    made_for = MadeFor(len(mesh.vertices), mesh.content_hash, (tuple(low), tuple(high)))
    written = _model().dump_python(EditFile(**_values(edit), mesh=made_for), mode="json", exclude=UNWRITTEN)
    document: dict[str, Any] = {key: written.pop(key) for key in FIRST} | written
    for key in ("handles", "fixed"):
        document[key] = [_spread(entry) for entry in document[key]]
    for key in ("score", "relative_score"):  # they describe a plane of a field, and not of an edit
        (document["symmetry"] or {}).pop(key, None)
    return document


def _values(edit: Edit) -> dict[str, Any]:
    return {name: getattr(edit, name) for name in _keys(Edit)}


def _spread(entry: dict[str, Any]) -> dict[str, Any]:
    """Return an entry with the keys of its place, transform and controls on its own level."""
    named = {key: entry.pop(key) for key in ("id", "name") if key in entry}
    return named | {key: value for part in SPREAD for key, value in entry.pop(part, {}).items()} | entry


def from_document(document: Any, mesh: Mesh, *, name: str = "edit", other_shape: bool = False) -> Edit:
    """Return the edit in a parsed JSON document, as `read_edit` does; `name` begins the messages."""
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
            f"{lost} of its vertices or sets of vertices are found by position",
            UserWarning,
        )
    return edit


def _places(edit: Edit) -> Iterator[Place]:
    for handle in edit.handles:
        yield from (handle.place, *handle.controls.excluded_counterparts)
    yield from (fixed.place for fixed in edit.fixed)


def _moved(mesh: Mesh, said: Place) -> bool:
    """Return whether the vertices of a place have other positions on the mesh than in the file."""
    if said.region is not None:
        return isinstance(said.region, VertexSet) and not said.region.lies_on(mesh)
    if said.vertex is None or not said.known:
        return False
    near = SAME_POSITION * mesh.diagonal
    return said.vertex >= len(mesh.vertices) or math.dist(mesh.vertices[said.vertex], said.position) > near


def _placed(mesh: Mesh, made: MadeFor | None, path: str, said: Place) -> Place:
    """Return the place on the mesh, from the place at `path` in an edit that was made for another mesh."""
    if said.region is not None:
        with within(f"{path}.region"):
            return place_on(mesh, said.region)
    if said.vertex is None:
        return said
    if _moved(mesh, said):
        return Place(said.position)
    size = len(mesh.vertices)
    if made is not None and not said.known:
        if made.vertices != size:
            raise ArgumentError(
                path, f"must have a position: the edit counts {made.vertices} vertices, the mesh {size}"
            )
        if made.hash not in (None, mesh.content_hash):
            raise ArgumentError(path, "must have a position: the edit was made on another mesh")
    if said.vertex >= size:
        raise ArgumentError(f"{path}.vertex", f"must lie in 0 … {size - 1}, got {said.vertex}")
    return place_on(mesh, said.vertex)


def _check_shape(mesh: Mesh, made: MadeFor) -> None:
    """Raise ValueError if the edit is of another shape."""
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
    """Return the edit in a document, with its places as the document has them."""
    if not isinstance(document, dict):
        raise ArgumentError("document", f"must be an edit, got {_shown(document)}", name)
    for key, value in (("format", EditFile.format), ("version", EditFile.version)):
        found = document.get(key)
        if found != value or isinstance(found, bool):
            raise ArgumentError(key, f"must be {_shown(value)}, got {_shown(found)}", name)
    try:
        return _model().validate_json(json.dumps(_completed(document, mesh)))
    except ValidationError as error:
        argument, reason = _complaint(error)
        raise ArgumentError(argument, reason, name) from None


def _completed(document: dict[str, Any], mesh: Mesh | None) -> dict[str, Any]:
    """Return a document for pydantic, with defaults, and with the keys of places, transforms and controls grouped."""
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


def _grouped(entry: Any, parts: Iterable[str], meant: Mapping[str, Any], free: Iterator[int] | None = None) -> Any:
    """Return an entry with the keys of `parts` grouped, the defaults `meant`, and a `free` id if it has none."""
    if not isinstance(entry, dict):
        return entry
    given = {**meant, **entry}
    if free is not None and given.get("id") is None:
        given["id"] = next(free)
    grouped = {part: {key: given.pop(key) for key in _keys(SPREAD[part]) if key in given} for part in parts}
    return given | grouped


# Entries that pydantic adds to the path of a value: the tried member of a union, and the groups of `SPREAD`.
TAGS = {"float", "str", *SPREAD, *(each.kind for each in get_args(Region)), "SymmetryPlane"}
PHRASES = {
    "be a dictionary or a counterpart of .*": "be an object",
    "be an? valid (tuple|list|array)": "be a list",
    "valid number": "finite number",
    "valid integer": "whole number",
    " after validation.*": "",
}


def _complaint(error: ValidationError) -> tuple[str, str]:
    """Return the key and the reason of the first error, in this package's terms."""
    errors = error.errors(include_url=False)
    # For a union, report the member that matched deepest. For a text where words are allowed, report the words.
    owner = _path(errors[0]["loc"])
    first = max(
        (each for each in errors if _path(each["loc"]).startswith(owner)),
        key=lambda each: (len(each["loc"]), each["type"] == "literal_error" and isinstance(each["input"], str)),
    )
    steps, kind, shown = first["loc"], first["type"], _shown(first["input"])
    if kind == "json_invalid":  # the text is no Unicode, or lists are nested too deep
        return "document", f"cannot be read: {first['msg'].removeprefix('Invalid JSON: ')}"
    said = first.get("ctx", {}).get("error")
    if isinstance(said, ArgumentError):
        return _path((*steps, said.argument)), said.reason
    if kind.startswith("missing") or kind == "union_tag_not_found":
        return _path(steps) + (".kind" if kind == "union_tag_not_found" else ""), f"is missing in {shown}"
    if kind == "union_tag_invalid":
        return f"{_path(steps)}.kind", f"must be one of {first['ctx']['expected_tags']}, got {first['ctx']['tag']!r}"
    if kind == "unexpected_keyword_argument":
        known = edit_schema()
        for key in (step for step in steps[:-1] if isinstance(step, str) and step not in TAGS):
            owners = re.findall(r"\$defs/(\w+)", json.dumps(known["properties"][key]))
            known = edit_schema()["$defs"][owners[0]] if len(owners) == 1 else {}  # a region may be of several kinds
        return _path(steps), "is an unknown key" + (f"; known are {', '.join(known['properties'])}" if known else "")
    must = re.sub(r"^\w+ should ", "", first["msg"])
    for theirs, ours in PHRASES.items():
        must = re.sub(theirs, ours, must)
    return _path(steps), f"must {must}, got {shown}"


def _path(steps: Iterable[int | str]) -> str:
    path, before = "", ""
    for step in steps:
        # Tags follow the key of a union and are left out. `mesh.vertices` is a document's own key and stays.
        tag = step in TAGS or (isinstance(step, str) and "[" in step)
        if not (tag and path) or (step == "vertices" and before == "mesh"):
            path += f"[{step}]" if isinstance(step, int) else f".{step}" if path else step
        before = str(step)
    return path or "document"


def _shown(value: Any) -> str:
    shown = json.dumps(value, default=str)
    return shown if len(shown) <= 60 else shown[:59] + "…"
