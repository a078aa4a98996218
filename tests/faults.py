"""`python -m tests.faults [--count N] [--seed N] [--jobs N] [PACKAGE …]`: measure how many faults the tests find.

Each fault changes one line of a package in a copy of the tree: a constant is scaled, a comparison reversed, a term
removed, or a statement deleted. Then those quick tests of that package that call the changed function run until the
first one fails. Without packages, all of `PACKAGES` get faults. COUNT faults are drawn at random, and the faults in
`NAMED` are added. The output is the share of faults that the tests find, and each fault. The exit code is 1 if the
share is below 90 %.
"""

from __future__ import annotations

import argparse
import ast
import builtins
import importlib
import importlib.util
import json
import os
import random
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from multiprocessing import get_context
from multiprocessing.connection import wait
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCES = Path("python/dfd")
PACKAGES = ("editing", "segmentation", "posing", "weights", "field")
COPIED = ("python", "tests", "bench", "docs", "pyproject.toml", "README.md", "CONTRIBUTING.md", "SECURITY.md")
LEFT_OUT = ("node_modules", "__pycache__", "client", "corpus", ".hypothesis")
# Tests run in forked processes, so that these packages, which tests need, are imported only once.
FORK = get_context("fork")
PRELOADED = ("numpy", "scipy.sparse.csgraph", "scipy.spatial", "torch", "pydantic", "trimesh")
WANTED = 0.9  # smallest share of faults that the tests must find
CALLED = "_called"  # name of a set in `builtins`: the functions that a test calls
RECORD = "record.json"  # file in a copy of the tree in which tests write what they found
SLOW = "slow or processes or browser"  # marks of tests that do not run

TINY = 1e-5  # constants up to this prevent divisions by 0 and the like: twice the value is no fault, but 0 is

REVERSED = {"<": ">=", "<=": ">", ">": "<=", ">=": "<", "==": "!=", "!=": "==", "is": "is not", "is not": "is"}
SIGNS: dict[type[ast.cmpop], str] = {
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=", ast.Is: "is",
    ast.IsNot: "is not",
}  # fmt: skip

# Faults that a review found without a test. Each is a file, a text that occurs in it once, and what replaces it.
NAMED = [
    ("geometry/part_axis.py", " * rise * rise * (3 - 2 * rise)", ""),
    ("geometry/part_axis.py", "(gradient * center).sum(axis=1), gradient]", "0 * center[:, 0], 0 * gradient]"),
    ("upright/find_up.py", "UNALIGNED_PRIOR = 0.5", "UNALIGNED_PRIOR = 0.0"),
    ("upright/find_up.py", "of_axes[parallel[first]].sum()", "of_axes[first]"),
]

# Faults that change only the time, the memory, the length of a message, or chance, so that no test can find them. Each
# is a text in the line, before or after the change.
HARMLESS: dict[str, tuple[str, ...]] = {
    "weights/regions.py": ("MOST_CONSIDERED =",),
    "segmentation/border.py": ("COST = ", "2 + COST"),
    "editing/blend.py": ("or 2.0",),
    "editing/deformer.py": ("merge, rebinds=True)", "(poses)), rebinds=True)"),
    "editing/edit_file.py": ("if len(shown) <=",),
    "editing/weights/by_features.py": ("~nodes.used] = 2.0",),
    "editing/weights/counterparts.py": ("component.max() + 3",),
    "editing/weights/fill.py": ("largest = 5",),
    "editing/weights/session_weights.py": ("if len(moving) > 1",),
    "editing/weights/held_part.py": (
        "LARGEST =",
        "component.max() + 3",
        "inward[k] + 3, deviation",
        "full_matrices=True",
        "0.002 * deviation",
    ),
    "symmetry/pair.py": ("SAMPLES =", "ROUNDS ="),
    "editing/transfer.py": ("SAMPLE =", "np.clip(cosines, 0.0, 2.0)"),
}


@dataclass(frozen=True)
class Fault:
    """A change of one line of a file."""

    path: Path  # relative to `SOURCES`
    row: int  # index of the line
    start: int  # columns of the replaced text
    end: int
    new: str  # the text that replaces it

    @property
    def package(self) -> str:
        """Return the package whose tests should find the fault."""
        return self.path.parts[0]

    def put_in(self, text: str) -> str:
        """Return the source `text` of the file with the fault."""
        lines = text.splitlines(keepends=True)
        line = lines[self.row]
        lines[self.row] = line[: self.start] + self.new + line[self.end :]
        return "".join(lines)

    def shown(self, text: str) -> str:
        """Return the place of the fault in the source `text`, with the line before and after the change."""
        old, new = (each.splitlines()[self.row].strip() for each in (text, self.put_in(text)))
        return f"{SOURCES / self.path}:{self.row + 1}\n    - {old}\n    + {new}"


def faults_of(path: Path, text: str) -> list[Fault]:
    """Return all faults that can be drawn in a file with the source `text`."""
    lines = text.splitlines()
    found = []
    for node, new in _replacements(ast.parse(text)):
        if node.lineno != node.end_lineno:
            continue
        line = lines[node.lineno - 1]
        start, end = (len(line.encode()[:column].decode()) for column in (node.col_offset, node.end_col_offset))
        fault = Fault(path, node.lineno - 1, start, end, new)
        both = line + fault.put_in(text).splitlines()[fault.row]
        if line[start:end] != new and not any(part in both for part in HARMLESS.get(path.as_posix(), ())):
            found.append(fault)
    return found


def _replacements(tree: ast.AST) -> Iterator[tuple[ast.expr | ast.stmt, str]]:
    """Yield nodes of a syntax tree, and the text that replaces each.

    Indices, axes and array shapes do not change, because almost any test would find such a fault.
    """
    for node in _nodes(tree):
        match node:
            case ast.Constant(value=bool()):
                yield node, str(not node.value)
            case ast.Constant(value=float() as value):
                yield node, repr(2.0 * value or 1.0) if not 0.0 < value <= TINY else "0.0"
            case ast.Assign(targets=[ast.Name(id=name)], value=ast.Constant(value=int() as value)) if name.isupper():
                yield node.value, str(2 * value)
            case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in SIGNS:
                yield node, f"{ast.unparse(left)} {REVERSED[SIGNS[type(op)]]} {ast.unparse(right)}"
                yield from _next_numbers(left, right)
            case ast.BinOp(left=left, op=ast.Add() | ast.Sub() | ast.Mult() | ast.Div(), right=right):
                yield node, _in_brackets(left)
                if isinstance(node.op, ast.Add | ast.Mult):
                    yield node, _in_brackets(right)
                yield from _next_numbers(left, right)
            case ast.BoolOp(op=op, values=values):
                for left_out in values:
                    others = [each for each in values if each is not left_out]
                    yield node, _in_brackets(others[0] if len(others) == 1 else ast.BoolOp(op, others))
            case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int())):
                continue  # an index or an axis
            case ast.UnaryOp(op=ast.USub() | ast.Not() | ast.Invert(), operand=operand):
                yield node, _in_brackets(operand)
            case ast.IfExp(body=body, orelse=other):
                yield node, _in_brackets(body)
                yield node, _in_brackets(other)
            case ast.AugAssign() | ast.Expr() | ast.Continue() | ast.Break() | ast.Raise():
                yield node, "pass"
            case ast.Assign(targets=[ast.Subscript() | ast.Attribute()]):
                yield node, "pass"


def _next_numbers(*operands: ast.expr) -> Iterator[tuple[ast.expr, str]]:
    """Yield the `operands` that are whole numbers, and the next number of each."""
    for operand in operands:
        if isinstance(operand, ast.Constant) and type(operand.value) is int:
            yield operand, str(operand.value + 1)


def _in_brackets(node: ast.expr) -> str:
    """Return the text of an expression, in brackets unless it is a name, a number, a call or the like."""
    simple = isinstance(node, ast.Name | ast.Constant | ast.Call | ast.Attribute | ast.Subscript)
    return ast.unparse(node) if simple else f"({ast.unparse(node)})"


def _nodes(tree: ast.AST) -> Iterator[ast.expr | ast.stmt]:
    """Yield the nodes of a syntax tree that decide results: no annotations, messages, docstrings, imports, indices.

    The type checker finds changes of `eq`, `frozen` and `total`. `strict` is an assertion. If `finite` is false, a
    kernel makes the check instead. Components are those of symmetric graphs, so `directed` changes nothing.
    """
    for node in ast.iter_child_nodes(tree):
        inner: list[ast.AST] = [node]
        match node:
            case ast.FunctionDef(name="__repr__" | "__str__") | ast.Expr(value=ast.Constant()):
                continue
            case ast.Assert() | ast.JoinedStr() | ast.Import() | ast.ImportFrom():
                continue
            case ast.keyword(arg="axis" | "directed" | "eq" | "finite" | "frozen" | "repr" | "strict" | "total"):
                continue
            case ast.If(test=ast.Name(id="TYPE_CHECKING")):
                continue
            case ast.AnnAssign(value=value):
                yield from () if value is None else _nodes(ast.Expression(value))
                continue
            case ast.arguments(defaults=defaults, kw_defaults=more):
                yield from _nodes(ast.Tuple([each for each in (*defaults, *more) if each is not None]))
                continue
            case ast.Subscript(value=value):
                inner = [ast.Expression(value)]
            case ast.Raise():
                inner = []
        if isinstance(node, ast.expr | ast.stmt):
            yield node
        for each in inner:
            yield from _nodes(each)


def named_faults(packages: tuple[str, ...]) -> list[Fault]:
    """Return the faults in `NAMED` of the `packages`. Raises ValueError if a text does not occur once in its file."""
    found = []
    for name, old, new in NAMED:
        text = (ROOT / SOURCES / name).read_text()
        if text.count(old) != 1:
            raise ValueError(f"{name}: {old!r} must occur once, but occurs {text.count(old)} times")
        before = text[: text.index(old)]
        row, start = before.count("\n"), len(before) - before.rfind("\n") - 1
        found.append(Fault(Path(name), row, start, start + len(old), new))
    return [fault for fault in found if fault.package in packages]


def drawn_faults(packages: tuple[str, ...], count: int, seed: int) -> list[Fault]:
    """Return `count` faults of the `packages`, drawn at random."""
    files = [path for package in packages for path in sorted((ROOT / SOURCES / package).rglob("*.py"))]
    faults = [fault for path in files for fault in faults_of(path.relative_to(ROOT / SOURCES), path.read_text())]
    return random.Random(seed).sample(faults, min(count, len(faults)))


def copy_of_tree(folder: Path) -> Path:
    """Copy the sources, the tests and the installed extension to `folder`."""
    for name in COPIED:
        source, ignored = ROOT / name, shutil.ignore_patterns(*LEFT_OUT)
        shutil.copytree(source, folder / name, ignore=ignored) if source.is_dir() else shutil.copy(source, folder)
    installed = importlib.util.find_spec("dfd")
    assert installed is not None
    for place in installed.submodule_search_locations or ():
        for extension in Path(place).glob("_core*"):
            shutil.copy(extension, folder / SOURCES)
    return folder


class Trial:
    """A run of the quick tests of a package, in a forked process and in the copy `tree`, with or without a fault."""

    def __init__(
        self, tree: Path, package: str, fault: Fault | None, longest: float, order: list[str] | None = None
    ) -> None:
        """Put the fault in, and start the tests in `order`. Without an order, start all tests, and record their calls.

        Tests that take longer than `longest` seconds count as failed.
        """
        self.tree, self.fault = tree, fault
        (tree / RECORD).unlink(missing_ok=True)
        if fault is not None:
            self._file = tree / SOURCES / fault.path
            self._text = self._file.read_text()
            self._file.write_text(fault.put_in(self._text))
        plugin = Watch(tree) if order is None else Order(tree, order)
        self.process = FORK.Process(target=_run_tests, args=(tree, package, plugin))
        self.process.start()
        self._end = time.monotonic() + longest

    @property
    def is_over(self) -> bool:
        """Return whether the tests have ended; end them if they take too long."""
        if self.process.is_alive() and time.monotonic() > self._end:
            self.process.kill()
            self.process.join()
        return not self.process.is_alive()

    def failed_test(self) -> str:
        """Return the name of the test that failed, or a reason if no test ran to its end."""
        record = self.tree / RECORD
        return str(json.loads(record.read_text())) if record.exists() else "an error, or the limit of time"

    def passed(self) -> bool:
        """Take the fault out, and return whether all tests passed."""
        if self.fault is not None:
            self._file.write_text(self._text)
            for compiled in (self._file.parent / "__pycache__").glob(f"{self._file.stem}.*"):
                compiled.unlink()
        return self.process.exitcode in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED)


class Watch:
    """A plugin of pytest that writes the time of each test, and the functions that it calls (`with_calls`)."""

    def __init__(self, tree: Path) -> None:
        self._tree, self._called = tree, set[str]()
        self._shared: dict[str, set[str]] = {}  # calls by each fixture that several tests share
        self._found: dict[str, tuple[float, list[str]]] = {}
        setattr(builtins, CALLED, self._called)

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: pytest.FixtureDef[object]) -> Iterator[None]:
        before = set(self._called)
        self._called.clear()
        try:
            return (yield)
        finally:
            if fixturedef.scope != "function":
                self._shared.setdefault(fixturedef.argname, set()).update(self._called)
            self._called |= before

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Function) -> Iterator[None]:
        self._called.clear()
        began = time.process_time()
        try:
            return (yield)
        finally:
            called = self._called.union(*(self._shared.get(name, ()) for name in item.fixturenames))
            self._found[item.nodeid] = time.process_time() - began, sorted(called)

    def pytest_sessionfinish(self) -> None:
        (self._tree / RECORD).write_text(json.dumps(self._found))


def with_calls(text: str, name: str) -> str:
    """Return the source `text` of the file `name`, in which each function adds its name to the set `CALLED`."""
    lines = text.splitlines()
    for start, node in sorted(_functions(ast.parse(text)).items(), reverse=True):
        first = node.body[min(1, len(node.body) - 1)] if ast.get_docstring(node) else node.body[0]
        line = min([first.lineno, *(each.lineno for each in getattr(first, "decorator_list", []))])
        own_line = not lines[line - 1][: first.col_offset].strip()
        if own_line and not ast.get_docstring(ast.Module([first], [])):
            added = f"getattr(__import__('builtins'), {CALLED!r}, set()).add('{name}:{start}')"
            lines.insert(line - 1, " " * first.col_offset + added)
    return "\n".join(lines) + "\n"


class Order:
    """A plugin of pytest that runs only the tests in `order`, and writes which test fails."""

    def __init__(self, tree: Path, order: list[str]) -> None:
        self._tree, self._rank = tree, {name: rank for rank, name in enumerate(order)}

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items[:] = sorted(
            (item for item in items if item.nodeid in self._rank), key=lambda item: self._rank[item.nodeid]
        )

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            (self._tree / RECORD).write_text(json.dumps(report.nodeid))


@dataclass
class Tests:
    """What is known about the quick tests of a package."""

    longest: float  # limit of time in seconds
    times: dict[str, float]  # seconds that each test takes
    called: dict[str, set[str]]  # the functions that each test calls: "file:first line"
    finds: Counter[str] = field(default_factory=Counter)  # number of faults that each test found

    def order(self, fault: Fault, texts: dict[str, str]) -> list[str]:
        """Return the tests that call a function with the fault; those that found most per second first.

        `texts` are the sources of the package without the fault. If no function has the fault, any of its file counts.
        """
        own = (SOURCES / fault.path).as_posix()
        changed = functions_with(texts, own, fault.row + 1)
        calls = [
            test
            for test, called in self.called.items()
            if (changed & called if changed else any(name.startswith(f"{own}:") for name in called))
        ]
        return sorted(calls, key=lambda test: self.times[test] / (1 + self.finds[test]))


def functions_with(texts: dict[str, str], own: str, row: int) -> set[str]:
    """Return the functions that a change in line `row` of the file `own` changes, as in `Tests.called`.

    Of a constant, these are the functions in `texts` that use its name.
    """
    tree = ast.parse(texts[own])
    around = {start for start, node in _functions(tree).items() if start <= row <= (node.end_lineno or 0)}
    if around:
        return {f"{own}:{max(around)}"}
    names = {
        name
        for node in tree.body
        if isinstance(node, ast.Assign) and node.lineno <= row <= (node.end_lineno or 0)
        for target in node.targets
        for name in _names(target)
    }
    return {
        f"{file}:{start}"
        for file, text in texts.items()
        for start, node in _functions(ast.parse(text)).items()
        if names & _names(node)
    }


def _functions(tree: ast.AST) -> dict[int, ast.FunctionDef]:
    """Return the functions of a syntax tree by their first lines."""
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    return {min([node.lineno, *(each.lineno for each in node.decorator_list)]): node for node in functions}


def _names(node: ast.AST) -> set[str]:
    """Return the names of variables and attributes in a syntax tree."""
    found = [getattr(each, "id", getattr(each, "attr", "")) for each in ast.walk(node)]
    return {name for name in found if name}


def _run_tests(tree: Path, package: str, plugin: Watch | Order) -> None:
    """Run quick tests of `package` with a `plugin` until one fails. Exit with pytest's code."""
    os.chdir(tree)
    own = ROOT, ROOT / "python"
    sys.path[:] = [str(tree / "python"), str(tree), *(path for path in sys.path if Path(path).resolve() not in own)]
    for name in [name for name in sys.modules if name.partition(".")[0] == "tests"]:
        del sys.modules[name]
    for stream in (sys.stdout, sys.stderr):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    options = ["-x", "-q", "-p", "no:cacheprovider", "-m", f"not ({SLOW})", str(Path("tests/python", package))]
    os._exit(int(pytest.main(options, [plugin])))


def trials(
    faults: list[Fault], trees: list[Path], tests: dict[str, Tests], texts: dict[str, str]
) -> Iterator[tuple[Fault, str | None]]:
    """Try the faults in the copies `trees`, one in each at a time. Yield each fault, and the test that fails or None.

    `tests` are those of each package, and `texts` are the sources of each file.
    """
    waiting, running = list(reversed(faults)), list[Trial]()
    while waiting or running:
        free = [tree for tree in trees if all(trial.tree is not tree for trial in running)]
        for tree in free[: len(waiting)]:
            fault = waiting.pop()
            known = tests[fault.package]
            own = (SOURCES / fault.package).as_posix()
            order = known.order(fault, {name: text for name, text in texts.items() if name.startswith(f"{own}/")})
            running.append(Trial(tree, fault.package, fault, known.longest, order))
        wait([trial.process.sentinel for trial in running], timeout=1.0)
        for trial in [trial for trial in running if trial.is_over]:
            running.remove(trial)
            assert trial.fault is not None
            found = None if trial.passed() else trial.failed_test()
            tests[trial.fault.package].finds[found or ""] += 1
            yield trial.fault, found


def tests_of(tree: Path, package: str) -> Tests:
    """Run the quick tests of `package` without a fault, and return what they do; raise ValueError if one fails."""
    texts = {path: path.read_text() for path in (tree / SOURCES / package).rglob("*.py")}
    for path, text in texts.items():
        path.write_text(with_calls(text, path.relative_to(tree).as_posix()))
    began = time.monotonic()
    trial = Trial(tree, package, None, float("inf"))
    trial.process.join()
    if not trial.passed():
        raise ValueError(f"the tests of {package} fail without any fault")
    found = json.loads((tree / RECORD).read_text())
    for path, text in texts.items():
        path.write_text(text)
    shutil.rmtree(tree / SOURCES / package / "__pycache__", ignore_errors=True)
    times = {name: seconds for name, (seconds, _) in found.items()}
    return Tests(5 * (time.monotonic() - began) + 60, times, {name: set(called) for name, (_, called) in found.items()})


def main() -> int:
    """Print the share of faults that the tests find, and each fault."""
    parser = argparse.ArgumentParser(prog="python -m tests.faults", description=__doc__)
    parser.add_argument("--count", type=int, default=100, help="number of faults that are drawn at random")
    parser.add_argument("--seed", type=int, default=0, help="equal seeds give equal faults of equal sources")
    parser.add_argument("--jobs", type=int, default=1, help="number of faults that are tried at the same time")
    parser.add_argument("packages", nargs="*", help=f"packages in {SOURCES}, by default {', '.join(PACKAGES)}")
    given = parser.parse_args()
    packages = tuple(given.packages or PACKAGES)
    if missing := [each for each in packages if not (ROOT / SOURCES / each).is_dir()]:
        parser.error(f"there is no package {', '.join(missing)} in {SOURCES}")
    faults = named_faults(packages) + drawn_faults(packages, given.count, given.seed)
    os.environ["OMP_NUM_THREADS"] = "1"
    for name in PRELOADED:
        importlib.import_module(name)
    missed = 0
    with tempfile.TemporaryDirectory() as folder:
        trees = [copy_of_tree(Path(folder, str(number)).resolve()) for number in range(given.jobs)]
        tests = {package: tests_of(trees[0], package) for package in sorted({fault.package for fault in faults})}
        files = [path for package in tests for path in (trees[0] / SOURCES / package).rglob("*.py")]
        texts = {path.relative_to(trees[0]).as_posix(): path.read_text() for path in files}
        for number, (fault, found) in enumerate(trials(faults, trees, tests, texts), 1):
            missed += found is None
            print(f"{number}/{len(faults)}", "NOT FOUND" if found is None else f"found by {found}", end=": ")
            print(fault.shown(texts[(SOURCES / fault.path).as_posix()]), flush=True)
    share = 1 - missed / len(faults)
    print(f"The tests find {len(faults) - missed} of {len(faults)} faults ({share:.0%}).")
    return int(share < WANTED)


if __name__ == "__main__":
    sys.exit(main())
