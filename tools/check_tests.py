# SPDX-License-Identifier: Apache-2.0
"""Checks that every test asserts something: one that only runs code passes when that code does nothing.

An assertion is: ``assert``, ``raise AssertionError``, ``pytest.raises``, ``warns`` or ``fail``, a method that
is named ``assert…`` or ``fail`` (unittest, mock, numpy), a hypothesis state machine that is run, and a call
of a function of the test tree that has one itself. A called method is looked for by its name, in the file of
the test, in the conftests above it, and in the modules of the test tree that these import.
Ends non-zero at any finding.
"""

import ast
import re
import sys
from functools import lru_cache
from pathlib import Path
from typing import Dict, Iterator, List, NamedTuple, Optional, Set, Tuple, Union

ROOT = Path(__file__).resolve().parent.parent

#: Files in which pytest and rostest look for tests.
SUITES = re.compile(r"(test_.*|.*_test|.*_cases)\.py\Z")

#: Calls that fail a test, as the last part of their name.
ASSERTS = re.compile(r"assert([A-Z_].*)?\Z|(fail|raises|warns|run_state_machine_as_test)\Z")

Function = Union[ast.FunctionDef, ast.AsyncFunctionDef]


class Module(NamedTuple):
    """What one file has for its own tests, and for those of others."""

    path: Path
    functions: Dict[str, List[Function]]
    """By name; methods too."""
    imports: List[str]
    tests: List[Function]


@lru_cache(maxsize=None)
def module_of(path: Path) -> Module:
    """Reads a file."""
    tree = ast.parse(path.read_text(encoding="utf-8"), str(path))
    functions: Dict[str, List[Function]] = {}
    imports: List[str] = []
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            functions.setdefault(node.name, []).append(node)
        elif isinstance(node, ast.Import):
            imports += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            imports += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return Module(path, functions, imports, list(_tests(tree)))


def _tests(tree: ast.Module) -> Iterator[Function]:
    for node in tree.body:
        for member in node.body if isinstance(node, ast.ClassDef) else [node]:
            if isinstance(member, (ast.FunctionDef, ast.AsyncFunctionDef)) and _is_test(member):
                yield member


def _is_test(function: Function) -> bool:
    fixture = any("fixture" in ast.dump(decorator) for decorator in function.decorator_list)
    return function.name.startswith("test") and not fixture


@lru_cache(maxsize=None)
def helpers() -> Dict[str, Tuple[Path, ...]]:
    """The files that may hold functions which assert, by the last part of a module's name."""
    found: Dict[str, List[Path]] = {}
    for pattern in ("test/**/*.py", "src/*/src/*/testing/**/*.py", "extras/*/src/*/testing/**/*.py"):
        for path in sorted(ROOT.glob(pattern)):
            name = path.parent.name if path.name == "__init__.py" else path.stem
            found.setdefault(name, []).append(path)
    return {name: tuple(paths) for name, paths in found.items()}


@lru_cache(maxsize=None)
def seen_from(path: Path) -> Tuple[Module, ...]:
    """The modules whose functions a file may call: itself, conftests above it, and what these import."""
    above = [folder / "conftest.py" for folder in path.parents if ROOT in (folder, *folder.parents)]
    waiting = [path, *(conftest for conftest in above if conftest.is_file())]
    found: Dict[Path, Module] = {}
    while waiting:
        each = waiting.pop()
        if each not in found:
            found[each] = module_of(each)
            waiting += [helper for name in found[each].imports for helper in _files_of(name)]
    return tuple(found.values())


def _files_of(module: str) -> Iterator[Path]:
    parts = module.split(".")
    for path in helpers().get(parts[-1], ()):
        whole = path.parent if path.name == "__init__.py" else path.with_suffix("")
        if list(whole.parts[-len(parts) :]) == parts:
            yield path


def asserts(function: Function, path: Path, visited: Optional[Set[Function]] = None) -> bool:
    """Whether a function can fail a test by an assertion of its own, or of one that it calls."""
    visited = visited if visited is not None else set()
    visited.add(function)
    called: List[str] = []
    for node in ast.walk(function):
        if isinstance(node, ast.Assert):
            return True
        if isinstance(node, ast.Raise) and node.exc is not None and "AssertionError" in ast.dump(node.exc):
            return True
        if isinstance(node, ast.Call):
            name = getattr(node.func, "attr", getattr(node.func, "id", ""))
            if ASSERTS.match(name):
                return True
            called.append(name)
    return any(
        asserts(helper, module.path, visited)
        for name in called
        for module in seen_from(path)
        for helper in module.functions.get(name, [])
        if helper not in visited
    )


def suites() -> List[Path]:
    """The files of all tests."""
    return [path for path in sorted((ROOT / "test").glob("**/*.py")) if SUITES.match(path.name)]


def main() -> int:
    """Prints the tests that assert nothing; returns the exit code."""
    findings = 0
    for path in suites():
        for test in module_of(path).tests:
            if not asserts(test, path):
                findings += 1
                print(f"{path.relative_to(ROOT)}:{test.lineno}: {test.name} asserts nothing", file=sys.stderr)
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
