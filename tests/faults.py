"""`python -m tests.faults PACKAGE [--count N] [--seed N] [--jobs N] [--recorded]`: measure how many faults tests find.

mutmut (`pip install mutmut`) changes one expression or statement of a function at a time, in a copy of the tree, and
runs the quick tests of the package that call this function. COUNT of its changes are drawn at random. mutmut does not
change constants of modules, so `--constants` of these are doubled, one at a time. Tests of recorded numbers run only
with `--recorded`, because they find nearly every change and say nothing about rules. The output is the share of faults
that the tests find, and each fault that they do not find.
"""

import argparse
import ast
import importlib.util
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
COPIED = ("tests", "bench", "docs", "pyproject.toml", "README.md", "CONTRIBUTING.md", "SECURITY.md")
LEFT_OUT = shutil.ignore_patterns("node_modules", "__pycache__", "client", ".hypothesis")
FOUND = ("killed", "timeout", "segfault", "suspicious", "caught by type check")
QUICK = ["-m", "not (slow or processes or browser)", "-p", "no:cacheprovider"]
# Lines that no test of results can find: messages, names of threads, and assertions about lengths.
LINES = [r"raise \w+Error", "strict=", "cast\\(", "thread_name_prefix"]


def copy_of_tree(tree: Path, package: str, tests: list[str]) -> None:
    """Copy sources, tests and the installed extension to the folder `tree`, in the layout that mutmut needs."""
    shutil.copytree(ROOT / "python/dfd", tree / "src/dfd", ignore=LEFT_OUT)
    for name in COPIED:
        source = ROOT / name
        shutil.copytree(source, tree / name, ignore=LEFT_OUT) if source.is_dir() else shutil.copy(source, tree)
    installed = importlib.util.find_spec("dfd")
    assert installed is not None
    for place in installed.submodule_search_locations or ():
        for extension in Path(place).glob("_core*"):
            shutil.copy(extension, tree / "src/dfd")
    settings = {
        "source_paths": ["src"],
        "only_mutate": [f"src/dfd/{package}/*"],
        "also_copy": [name for name in COPIED if name not in ("tests", "pyproject.toml")],
        "do_not_mutate_patterns": LINES,
        "pytest_add_cli_args": QUICK,
        "pytest_add_cli_args_test_selection": tests,
        "track_dependencies": False,
        "use_git_change_detection": False,
    }
    with (tree / "pyproject.toml").open("a") as stream:
        stream.write("\n[tool.mutmut]\n")
        stream.writelines(f"{name} = {json.dumps(value)}\n" for name, value in settings.items())


def mutmut(tree: Path, *arguments: str) -> list[str]:
    """Run mutmut in the folder `tree`, and return the lines that it prints."""
    command = [sys.executable, "-m", "mutmut", *arguments]
    return subprocess.run(command, cwd=tree, capture_output=True, text=True).stdout.splitlines()


def results(tree: Path) -> dict[str, str]:
    """Return the result of each change, by its name."""
    pairs = [line.strip().rpartition(": ") for line in mutmut(tree, "results", "--all", "True") if "__mutmut_" in line]
    return {name: result for name, _, result in pairs}


def constants(tree: Path, package: str) -> list[tuple[Path, int, int, str]]:
    """Return the file, line, column and text of each number that is a constant of a module of `package`."""
    found = []
    for path in sorted((tree / "src/dfd" / package).rglob("*.py")):
        for node in ast.parse(path.read_text()).body:
            match node:
                case ast.Assign(targets=[ast.Name()], value=ast.Constant(value=int() | float() as value) as number):
                    if not isinstance(value, bool):
                        found.append((path, number.lineno - 1, number.col_offset, ast.unparse(number)))
    return found


def doubled_is_found(tree: Path, constant: tuple[Path, int, int, str], tests: list[str]) -> bool:
    """Double a constant, and return whether a test fails."""
    path, row, column, _ = constant
    text = path.read_text()
    lines = text.splitlines(keepends=True)
    lines[row] = f"{lines[row][:column]}2 * {lines[row][column:]}"
    path.write_text("".join(lines))
    environment = os.environ | {"PYTHONPATH": str(tree / "src")}
    command = [sys.executable, "-m", "pytest", "-x", "-q", *QUICK, *tests]
    ended = subprocess.run(command, cwd=tree, env=environment, capture_output=True)
    path.write_text(text)
    return ended.returncode != 0


def main() -> None:
    """Print the share of faults that the tests find, and each fault that they do not find."""
    parser = argparse.ArgumentParser(prog="python -m tests.faults", description=__doc__)
    parser.add_argument("package", help="a package in python/dfd that has a folder of tests in tests/python")
    parser.add_argument("--count", type=int, default=40, help="number of changes of functions")
    parser.add_argument("--constants", type=int, default=5, help="number of constants that are doubled")
    parser.add_argument("--seed", type=int, default=0, help="equal seeds draw equal faults of equal sources")
    parser.add_argument("--jobs", type=int, default=1, help="number of changes that are tried at the same time")
    parser.add_argument("--recorded", action="store_true", help="also run tests that compare with recorded numbers")
    given = parser.parse_args()
    tests = [f"tests/python/{given.package}", *([] if given.recorded else ["--ignore-glob=*test_recorded*"])]
    if not (ROOT / tests[0]).is_dir():
        parser.error(f"there is no folder {tests[0]}")
    os.environ["OMP_NUM_THREADS"] = "1"
    draw = random.Random(given.seed)
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder).resolve()
        copy_of_tree(tree, given.package, tests)
        mutmut(tree, "run", "none")  # no change has this name: mutmut only writes the list of changes
        known = sorted(results(tree))
        drawn = draw.sample(known, min(given.count, len(known)))
        mutmut(tree, "run", "--max-children", str(given.jobs), *drawn)
        after = results(tree)
        missed = [name for name in drawn if after[name] not in FOUND]
        for name in missed:
            changed = [line for line in mutmut(tree, "show", name) if line[:2] in ("- ", "+ ", "-\t", "+\t")]
            print(f"{after[name]}: {name}", *changed, sep="\n    ", flush=True)
        numbers = constants(tree, given.package)
        doubled = draw.sample(numbers, min(given.constants, len(numbers)))
        for constant in doubled:
            if not doubled_is_found(tree, constant, tests):
                missed.append(f"{constant[0].name}:{constant[1] + 1}")
                print(f"survived: {missed[-1]}, twice {constant[3]}", flush=True)
    count = len(drawn) + len(doubled)
    print(f"The tests of {given.package} find {count - len(missed)} of {count} faults.")


if __name__ == "__main__":
    main()
