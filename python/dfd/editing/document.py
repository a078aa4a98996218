"""The edit document: what `Deformer.save` writes, as pydantic models from which other programs' types are generated.

    {
      "format": "dfd-edit",
      "version": 3,
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
          "along": null,
          "reach": 1.0,
          "falloff": "linear",
          "locality": 2.0,
          "radius": null,
          "strength": 1.0,
          "instances": "together",
          "level": false,
          "without_instances": [{"vertex": 812, "position": [-0.1, 0.9, -0.6]}],
          "within": null,
          "within_width": 0.0
        }
      ],
      "fixed": [{"vertex": 77, "position": [0.2, -0.7, 0.1], "region": null, "strength": 1.0}],
      "symmetry": {"normal": [1.0, 0.0, 0.0], "offset": 0.0, "band": 0.05},
      "default": null,
      "overlap": "add",
      "blend": "linear",
      "arrive": true,
      "mirrored_locality": true,
      "bridges": true
    }

Required: `format`, `version`, and for every handle and fixed point a `vertex`, a `position` or a `region`. All else may
be left out, and is then as the document's `preset` has it (`dfd.editing.presets`). Unknown keys, keys that are given
twice, and numbers that are not finite are refused: a misspelt key is an error, never a default.

A version 2 document has none of `preset`, `mirrored_locality` and `bridges`, and what it leaves out is what `VERSION_2`
says. A version 1 document has none of `hash`, `bounds`, `region`, `axes`, `along`, `reach`, `falloff`, `radius`,
`strength`, `instances`, `level`, `without_instances`, `within`, `within_width`, `overlap`, `blend` and `arrive` either.
It is read as one of version 2, but for `arrive`, which is false there: fixed points shortened the move.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, ValidationError

from dfd.common.preset import Preset
from dfd.editing.controls import Blend, Falloff, Overlap
from dfd.editing.presets import PRESETS, Instances
from dfd.posing.transforms import Along

__all__ = [
    "FORMAT",
    "VERSION",
    "BallDocument",
    "BoxDocument",
    "DefaultDocument",
    "EditDocument",
    "FixedDocument",
    "GroupDocument",
    "HalfSpaceDocument",
    "HandleDocument",
    "MadeOnDocument",
    "MeshDocument",
    "PartDocument",
    "PlaceDocument",
    "PlaneDocument",
    "PointDocument",
    "RegionDocument",
    "VertexSetDocument",
    "edit_schema",
    "parse",
]

FORMAT = "dfd-edit"
VERSION = 3
NEW = PRESETS["default"]
# What versions 1 and 2 meant by a handle, a plane and a shape of which they said nothing more.
VERSION_2: dict[str, dict[str, Any]] = {
    "handle": {"reach": 1.0, "falloff": "linear", "instances": "together"},
    "plane": {"band": 0.0},
    "shape": {"overlap": "add", "blend": "linear", "arrive": True, "mirrored_locality": True, "bridges": True},
}

Length = Annotated[float, Field(description="Mesh units.")]
Three = Annotated[tuple[float, float, float], Field(strict=False)]
Rows = Annotated[tuple[Three, Three, Three], Field(strict=False)]


def _list_or(other: str) -> Discriminator:
    return Discriminator(lambda value: "list" if isinstance(value, list | tuple) else other)


def _text_or(other: str) -> Discriminator:
    return Discriminator(lambda value: "text" if isinstance(value, str) else other)


Factors = Annotated[Annotated[float, Tag("number")] | Annotated[Three, Tag("list")], _list_or("number")]
Rotation = Annotated[list[float], Field(min_length=3, max_length=4)]


class Document(BaseModel):
    """What all parts of a document have in common: it is taken by the letter."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class UnitsDocument(Document):
    """What lengths and angles are in; no other units are read."""

    length: Literal["mesh"] = "mesh"
    angle: Literal["degree"] = "degree"


class MeshDocument(Document):
    """The shape that the edit was made on, for which its vertex indices count."""

    vertices: int = Field(ge=1, description="How many vertices it has.")
    hash: str | None = Field(None, description="Its `Mesh.content_hash`.")
    bounds: Annotated[tuple[Three, Three], Field(strict=False)] | None = Field(
        None, description="The smallest and largest coordinates of its box, mesh units."
    )


class MadeOnDocument(Document):
    """The files that the edit was made on: from its own folder where they are inside, else from the root."""

    mesh: str | None = Field(None, min_length=1)
    field: str | None = Field(None, min_length=1)
    field_sha256: str | None = Field(None, pattern="^[0-9a-f]{64}$")


class BallDocument(Document):
    """What lies within `radius` of `center`."""

    kind: Literal["ball"]
    center: Three
    radius: float = Field(gt=0)


class BoxDocument(Document):
    """What lies between two corners."""

    kind: Literal["box"]
    low: Three
    high: Three


class HalfSpaceDocument(Document):
    """Every p with normal · p ≥ offset."""

    kind: Literal["half_space"]
    normal: Three
    offset: float


class PartDocument(Document):
    """A part of the mesh's scene."""

    kind: Literal["part"]
    name: str = Field(min_length=1)


class GroupDocument(Document):
    """A face group of an OBJ file."""

    kind: Literal["group"]
    name: str = Field(min_length=1)


class VertexSetDocument(Document):
    """A list of vertices, and where they lie."""

    kind: Literal["vertices"]
    indices: list[Annotated[int, Field(ge=0)]] = Field(min_length=1)
    positions: list[Three]
    count: int | None = Field(None, ge=1, description="How many vertices the mesh has that they are of.")


RegionDocument = Annotated[
    BallDocument | BoxDocument | GroupDocument | HalfSpaceDocument | PartDocument | VertexSetDocument,
    Field(discriminator="kind"),
]


class PointDocument(Document):
    """Where something is on the resting shape: a vertex, or a position, or a vertex at a position.

    The vertex counts where it lies at `position` (or where there is no position and `mesh` fits); on another
    resolution, where it does not, the position does, and it is a point of space there.
    """

    vertex: int | None = Field(None, ge=0)
    position: Three | None = Field(None, description="Mesh units; of a region, for people.")


class PlaceDocument(PointDocument):
    """A point or a region of the resting shape."""

    region: RegionDocument | None = None


class FixedDocument(PlaceDocument):
    """A point or a region that stays, with all that looks like it."""

    strength: float = Field(1.0, ge=0, le=1)


class DefaultDocument(Document):
    """Scale, then rotation, then translation, about a pivot."""

    translation: Three = (0.0, 0.0, 0.0)
    rotation: Rotation = Field(
        [0.0, 0.0, 0.0], description="Rotation vector, degrees, right-handed, or a quaternion x, y, z, w."
    )
    scale: Factors = (1.0, 1.0, 1.0)
    pivot: Three | None = Field(None, description="Null is the handle itself, or the center of the box.")
    axes: Rows | None = Field(None, description="Three orthonormal vectors along which it scales; null is x, y, z.")


class HandleDocument(PlaceDocument, DefaultDocument):
    """What is held, what is done to it, and what follows."""

    id: int | None = Field(None, ge=1, description="Once each; given in order where it is missing.")
    name: str | None = Field(None, min_length=1)
    along: Along | None = Field(None, description="What the third of `axes` runs along; each instance has its own.")
    reach: Annotated[
        Annotated[float, Field(gt=0), Tag("number")] | Annotated[Literal["auto", "part"], Tag("text")],
        _text_or("number"),
    ] = NEW.reach
    falloff: Falloff = NEW.falloff
    locality: float = Field(0.0, ge=0, description="λ of Eq. 7.")
    radius: float | None = Field(None, gt=0, description="Mesh units; only where `locality` is 0.")
    strength: float = Field(1.0, ge=0, le=1)
    instances: Instances = NEW.instances
    level: bool = False
    without_instances: list[PointDocument] = Field([], description="A place on each instance that does not move along.")
    within: RegionDocument | None = None
    within_width: float = Field(0.0, ge=0, description="Mesh units beyond `within`, over which it fades.")


class PlaneDocument(Document):
    """The plane {p : normal · p = offset}, with the half width of its smooth band."""

    normal: Three = Field(description="Of length 1.")
    offset: float
    band: float | None = Field(None, ge=0, description="Mesh units; null is the preset's part of the longest side.")


class EditDocument(Document):
    """An edit of a shape."""

    format: Literal["dfd-edit"]
    version: Literal[3]
    preset: Preset = Field("default", description="What is left out is as it has it.")
    units: UnitsDocument = UnitsDocument()
    mesh: MeshDocument | None = None
    made_on: MadeOnDocument | None = Field(None, description="Where whoever carries it to other shapes finds its own.")
    handles: list[HandleDocument] = []
    fixed: list[FixedDocument] = []
    symmetry: (
        Annotated[
            Annotated[Literal["x", "y", "z"], Tag("text")] | Annotated[PlaneDocument, Tag("plane")], _text_or("plane")
        ]
        | None
    ) = Field(None, description="A letter is the plane across that axis through the center of the box.")
    default: DefaultDocument | None = Field(None, description="D₀ of Eq. 1: what happens to what no handle holds.")
    overlap: Overlap = NEW.overlap
    blend: Blend = NEW.blend
    arrive: bool = NEW.arrive
    mirrored_locality: bool = NEW.mirrored_locality
    bridges: bool = NEW.bridges


def edit_schema() -> dict[str, Any]:
    """The JSON Schema of the edit document, of the version that is written."""
    return EditDocument.model_json_schema()


def parse(document: Any, name: str) -> EditDocument:
    """The model of a parsed JSON document of any version; `name` begins every message.

    Raises
    ------
    ValueError
        If it is no such document; one line names the key and what was found there.
    """
    if not isinstance(document, dict):
        raise ValueError(f"{name}: `document` must be an edit, got {_shown(document)}")
    # These two first: what else is odd in a document of another kind or version helps nobody.
    if document.get("format") != FORMAT:
        raise ValueError(f'{name}: `format` must be "{FORMAT}", got {_shown(document.get("format"))}')
    version = document.get("version")
    if isinstance(version, bool) or version not in (1, 2, VERSION):
        raise ValueError(f"{name}: `version` must be 1, 2 or {VERSION}, got {_shown(version)}")
    if version == VERSION:
        preset = document.get("preset", "default")
        defaults = PRESETS[preset] if preset in get_args(Preset) else NEW
        meant = {"handle": defaults.handle, "shape": defaults.whole_shape}
    else:
        meant = {**VERSION_2, "shape": {**VERSION_2["shape"], "arrive": version == 2}}
    try:
        return EditDocument.model_validate(_completed(document, meant))
    except ValidationError as error:
        raise ValueError(f"{name}: {_sentence(error)}") from None


def _completed(document: dict[str, Any], meant: Mapping[str, dict[str, Any]]) -> dict[str, Any]:
    """A document of the present version, with what is `meant` in the place of keys that it leaves out."""

    def with_keys(entry: Any, kind: str) -> Any:
        return {**meant.get(kind, {}), **entry} if isinstance(entry, dict) else entry

    handles = document.get("handles")
    whole = {**with_keys(document, "shape"), "version": VERSION}
    if isinstance(handles, list):
        whole["handles"] = [with_keys(handle, "handle") for handle in handles]
    if "symmetry" in document:
        whole["symmetry"] = with_keys(document["symmetry"], "plane")
    return whole


# What pydantic puts into the path of a value to say which member of a union it tried.
REGION_KINDS = ("ball", "box", "group", "half_space", "part", "vertices")
TAGS = {"list", "number", "text", "plane", *REGION_KINDS}
PHRASES = {
    "be a valid (dictionary|object) or instance of .*": "be an object",
    "be an? valid (tuple|list)": "be a list",
    "valid number": "finite number",
    "valid integer": "whole number",
    "valid boolean": "true or false",
    "be a true": "be true",
    "greater than or equal to": "at least",
    "greater than": "above",
    "less than or equal to": "at most",
    "have at least 1 character": "hold a character",
    " after validation.*": "",
}
KNOWN_KEYS: dict[str, type[Document]] = {
    "": EditDocument,
    "units": UnitsDocument,
    "mesh": MeshDocument,
    "made_on": MadeOnDocument,
    "handles": HandleDocument,
    "without_instances": PointDocument,
    "fixed": FixedDocument,
    "symmetry": PlaneDocument,
    "default": DefaultDocument,
}


def _sentence(error: ValidationError) -> str:
    """The first thing that is wrong, in the words of this package."""
    first = error.errors(include_url=False, include_context=False)[0]
    steps = list(first["loc"])
    # A list that is too short misses its next item; what is wrong is the list.
    if first["type"] == "missing" and isinstance(steps[-1], int):
        return f"`{_path(steps[:-1])}` must hold more than {steps[-1]} items, got {_shown(first['input'])}"
    if first["type"] == "missing":
        return f"`{_path(steps)}` is missing"
    if first["type"] == "extra_forbidden":
        owner = next((step for step in reversed(steps[:-1]) if isinstance(step, str) and step not in TAGS), "")
        known = f"; known are {', '.join(KNOWN_KEYS[owner].model_fields)}" if owner in KNOWN_KEYS else ""
        return f"`{_path(steps)}` is an unknown key{known}"
    if first["type"].startswith("union_tag"):
        return f"`{_path(steps)}.kind` must be {_listed(REGION_KINDS)}, got {_shown(first['input'])}"
    must = re.sub(r"^\w+ should ", "", first["msg"])
    for theirs, ours in PHRASES.items():
        must = re.sub(theirs, ours, must)
    return f"`{_path(steps)}` must {must}, got {_shown(first['input'])}"


def _listed(words: Sequence[str]) -> str:
    *most, last = (f"'{word}'" for word in words)
    return f"{', '.join(most)} or {last}"


def _path(steps: list[int | str]) -> str:
    path = ""
    for index, step in enumerate(steps):
        # Tags stand behind the key of a union, and a document's own key of that name stands elsewhere.
        if index and step in TAGS and not (step == "vertices" and steps[index - 1] == "mesh"):
            continue
        path += f"[{step}]" if isinstance(step, int) else f".{step}" if path else step
    return path or "document"


def _shown(value: Any) -> str:
    shown = json.dumps(value, default=str)
    return shown if len(shown) <= 60 else shown[:59] + "…"
