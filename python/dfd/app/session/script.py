"""The edit as a Python script and as a command line."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING, Any

from dfd.app.session.exports import file_stem, mesh_file
from dfd.editing.controls import controls_of
from dfd.editing.edit_file import to_document
from dfd.editing.presets import CONTROLS, PRESETS

if TYPE_CHECKING:
    from dfd.editing.deformer import Deformer

# Keys of the edit document that `Deformer.add` takes under other names or not at all.
NOT_CONTROLS = ("id", "vertex", "position", "pivot_at")
AT_REST: dict[str, Any] = {"translation": [0.0] * 3, "rotation": [0.0] * 3, "scale": [1.0] * 3}
AT_REST |= {"bend": [0.0] * 3, "twist": 0.0, "excluded_instances": []}


def as_python(deformer: Deformer, name: str) -> str:
    """A script that makes the same edit, given the mesh's file `name` and its field in the same folder."""
    document = to_document(deformer.edit, deformer.mesh)
    stem = file_stem(name)
    preset = "" if document["preset"] == "default" else f", preset={document['preset']!r}"
    lines = [
        "import dfd",
        "",
        f"mesh = dfd.load({mesh_file(name)!r})",
        f'field = dfd.Field.load("{stem}.field.safetensors")',
        f"session = dfd.Deformer(mesh, field{preset})",
    ]
    defaults = _defaults(document)
    long = {"region", "mask", "excluded_instances"}  # vertex sets, too long for a script
    if any(_changed(entry, defaults).keys() & long for entry in _entries(document)):
        lines[-1] = f'session = dfd.Deformer.load("{stem}_edit.json", mesh, field)'
        lines.append(f'mesh.save("{stem}_edited.glb", session.vertices)')
        return "\n".join(lines) + "\n"
    for handle in document["handles"]:
        lines.append(f"session.add({_arguments(_place(handle), _changed(handle, defaults))})")
    lines += [f"session.fix({_arguments(_place(fixed), _changed(fixed, defaults))})" for fixed in document["fixed"]]
    usual = PRESETS[document["preset"]].whole_shape
    lines += [f"session.{key} = {document[key]!r}" for key in usual if document[key] != usual[key]]
    plane = document["symmetry"]
    if plane is not None:
        shown = f"dfd.SymmetryPlane({_tuple(plane['normal'])}, {plane['offset']!r}, band={plane['band']!r})"
        lines.append(f"session.set_symmetry({shown})")
    if document["default"] is not None:
        lines.append(f"session.set_default({_arguments('', _changed(document['default'], defaults))})")
    lines.append(f'mesh.save("{stem}_edited.glb", session.vertices)')
    return "\n".join(lines) + "\n"


def as_command(deformer: Deformer, name: str) -> str:
    """The command that makes the same edit: by options for one handle, else by the exported edit file."""
    document = to_document(deformer.edit, deformer.mesh)
    stem = file_stem(name)
    words = ["dfd", "deform", mesh_file(name), "--field", f"{stem}.field.safetensors"]
    options = _options(document)
    words += ["--edit", f"{stem}_edit.json"] if options is None else options
    return shlex.join([*words, "-o", f"{stem}_edited.glb"])


def _options(document: dict[str, Any]) -> list[str] | None:
    """The options of `dfd deform` that express the whole edit; None if it cannot be expressed."""
    usual = all(document[key] == value for key, value in PRESETS[document["preset"]].whole_shape.items())
    if len(document["handles"]) != 1 or not usual or document["symmetry"] or document["default"]:
        return None
    (handle,) = document["handles"]
    defaults = _defaults(document)
    changed = _changed(handle, defaults)
    changed.pop("name", None)
    flags = {"translation": "--translate", "rotation": "--rotate", "pivot": "--pivot", "scale": "--scale"}
    words = [] if document["preset"] == "default" else ["--preset", document["preset"]]
    words.append(f"--handle={_point(handle)}")
    for key, value in changed.items():
        if key in flags:
            words += [flags[key], *(repr(number) for number in value)]
        elif key == "locality":
            words += ["--locality", repr(value)]
        else:
            return None
    if any(_changed(fixed, defaults) for fixed in document["fixed"]):
        return None
    if any(
        entry["vertex"] is None for entry in _entries(document)
    ):  # the command takes the nearest point of the surface
        return None
    return words + [f"--fix={_point(fixed)}" for fixed in document["fixed"]]


def _entries(document: dict[str, Any]) -> list[dict[str, Any]]:
    return [*document["handles"], *document["fixed"]]


def _defaults(document: dict[str, Any]) -> dict[str, Any]:
    """The values of a new handle in the document's preset."""
    controls = controls_of(document["preset"])
    return {**AT_REST, **{key: getattr(controls, key) for key in CONTROLS if key != "excluded_instances"}}


def _changed(entry: dict[str, Any], defaults: dict[str, Any]) -> dict[str, Any]:
    """The values of a handle that differ from the defaults."""
    return {
        key: value
        for key, value in entry.items()
        if key not in NOT_CONTROLS and value is not None and defaults.get(key, ...) != value
    }


def _place(entry: dict[str, Any]) -> str:
    return _tuple(entry["position"]) if entry["vertex"] is None else str(entry["vertex"])


def _point(entry: dict[str, Any]) -> str:
    return ",".join(map(repr, entry["position"])) if entry["vertex"] is None else str(entry["vertex"])


def _arguments(first: str, keywords: dict[str, Any]) -> str:
    shown = [f"{key}={value!r}" for key, value in keywords.items()]
    return ", ".join([first, *shown] if first else shown)


def _tuple(numbers: list[float]) -> str:
    return f"({', '.join(map(repr, numbers))})"
