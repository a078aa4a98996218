"""The house: a room imports only rooms to its left, and no file of a room imports one that imports it."""

from __future__ import annotations

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import dfd

ROOMS = (
    "common",
    "mesh",
    "geometry",
    "views",
    "field",
    "encoders",
    "upright",
    "distillation",
    "weights",
    "segmentation",
    "symmetry",
    "posing",
    "editing",
    "pictures",
    "export",
    "batch",
    "app",
    "cli",
)
# They stand beside the path: made shapes know the rooms, no room of the path knows them.
BESIDE = {"samples": "mesh"}
# The demo is of the samples, and the app offers them.
MAY_ALSO = {"app": ("samples",), "cli": ("samples",)}

# What may use the public names, as users do.
ABOVE = {"batch", "cli"}

PACKAGE = Path(dfd.__file__).parent


def module_of(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports_of(path: Path, known: set[str]) -> set[str]:
    """Modules of the package that a file imports, wherever it does so."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:  # a file of a folder, or a name of a file
                file = f"{node.module}.{alias.name}"
                found.add(file if file in known else node.module)
    return {name for name in found if name in known}


FILES = {module_of(path): path for path in sorted(PACKAGE.rglob("*.py")) if "node_modules" not in path.parts}
IMPORTS = {module: imports_of(path, set(FILES)) - {module} for module, path in FILES.items()}


def room_of(module: str) -> str:
    return module.split(".")[1] if "." in module else ""


@pytest.mark.parametrize("room", sorted({room_of(module) for module in FILES} - {"", "__main__", *BESIDE}))
def test_a_room_imports_only_rooms_to_its_left(room: str) -> None:
    allowed = {*ROOMS[: ROOMS.index(room) + 1], *MAY_ALSO.get(room, ())}
    for module, imported in IMPORTS.items():
        if room_of(module) == room:
            public = {""} if room in ABOVE else set()
            wrong = {name for name in imported if room_of(name) not in allowed | public}
            assert not wrong, f"{module} imports {', '.join(sorted(wrong))}"


@pytest.mark.parametrize(("module", "last"), sorted(BESIDE.items()))
def test_what_stands_beside_the_path_imports_what_it_may(module: str, last: str) -> None:
    allowed = {*ROOMS[: ROOMS.index(last) + 1], *BESIDE}
    for name, imported in IMPORTS.items():
        if room_of(name) == module:
            assert {room_of(each) for each in imported} <= allowed | {""}, name


def test_no_file_imports_one_that_imports_it() -> None:
    """Where types alone are meant, an import under TYPE_CHECKING counts as well."""
    try:
        tuple(TopologicalSorter({name: found - {"dfd"} for name, found in IMPORTS.items()}).static_order())
    except CycleError as error:
        pytest.fail(f"circle: {' -> '.join(error.args[1])}")


def test_the_core_needs_none_of_the_tools() -> None:
    """Who computes with meshes, fields, weights and poses loads nothing of app, batches, pictures or commands."""
    reached = {name for name in FILES if room_of(name) in ("mesh", "field", "weights", "posing")}
    waiting = list(reached)
    while waiting:
        found = IMPORTS[waiting.pop()] - reached - {"dfd"}
        reached |= found
        waiting += found
    assert {room_of(name) for name in reached}.isdisjoint({"app", "batch", "cli", "export", "pictures"})
