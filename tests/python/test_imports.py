"""Imports between packages: a package imports only packages before it in `PACKAGES`, and no imports are circular."""

from __future__ import annotations

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import dfd

PACKAGES = (
    "common",
    "mesh",
    "geometry",
    "views",
    "field",
    "encoders",
    "symmetry",
    "upright",
    "distillation",
    "weights",
    "segmentation",
    "posing",
    "editing",
    "pictures",
    "export",
    "batch",
    "app",
    "cli",
)
# `samples` may import the packages up to `mesh`. Only the packages of `MAY_ALSO` may import `samples`.
BESIDE = {"samples": "mesh"}
MAY_ALSO = {"app": ("samples",), "cli": ("samples",)}

# Packages that may import the public names of `dfd`.
ABOVE = {"batch", "cli"}

PACKAGE = Path(dfd.__file__).parent


def module_of(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports_of(path: Path, known: set[str]) -> set[str]:
    """Return the modules in `known` that a file imports, also inside functions."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:  # the alias may be a module, or a name in a module
                file = f"{node.module}.{alias.name}"
                found.add(file if file in known else node.module)
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "import_module":
            found |= {each.value for each in node.args if isinstance(each, ast.Constant)}
    return {name for name in found if name in known}


FILES = {module_of(path): path for path in sorted(PACKAGE.rglob("*.py")) if "node_modules" not in path.parts}
IMPORTS = {module: imports_of(path, set(FILES)) - {module} for module, path in FILES.items()}


def package_of(module: str) -> str:
    return module.split(".")[1] if "." in module else ""


@pytest.mark.parametrize("package", sorted({package_of(module) for module in FILES} - {"", "__main__", *BESIDE}))
def test_a_package_imports_only_packages_before_it(package: str) -> None:
    allowed = {*PACKAGES[: PACKAGES.index(package) + 1], *MAY_ALSO.get(package, ())}
    for module, imported in IMPORTS.items():
        if package_of(module) == package:
            public = {""} if package in ABOVE else set()
            wrong = {name for name in imported if package_of(name) not in allowed | public}
            assert not wrong, f"{module} imports {', '.join(sorted(wrong))}"


@pytest.mark.parametrize(("module", "last"), sorted(BESIDE.items()))
def test_samples_import_only_what_they_may(module: str, last: str) -> None:
    allowed = {*PACKAGES[: PACKAGES.index(last) + 1], *BESIDE}
    for name, imported in IMPORTS.items():
        if package_of(name) == module:
            assert {package_of(each) for each in imported} <= allowed | {""}, name


def test_no_imports_are_circular() -> None:
    """Imports under TYPE_CHECKING also count."""
    try:
        tuple(TopologicalSorter({name: found - {"dfd"} for name, found in IMPORTS.items()}).static_order())
    except CycleError as error:
        pytest.fail(f"circle: {' -> '.join(error.args[1])}")


def test_the_core_imports_no_tools() -> None:
    """The packages mesh, field, weights and posing do not import app, batch, cli, export or pictures."""
    reached = {name for name in FILES if package_of(name) in ("mesh", "field", "weights", "posing")}
    waiting = list(reached)
    while waiting:
        found = IMPORTS[waiting.pop()] - reached - {"dfd"}
        reached |= found
        waiting += found
    assert {package_of(name) for name in reached}.isdisjoint({"app", "batch", "cli", "export", "pictures"})
