# SPDX-License-Identifier: Apache-2.0
"""Which tests without processes of ROS import a module of MERLIN."""

import ast
from collections import defaultdict
from pathlib import Path
from typing import Dict, Iterator, List, Set, Tuple


class Imports:
    """Which test files import a module, and over how many others."""

    def __init__(self, root: Path) -> None:
        folders = ("src/*/src", "extras/*/src", "test/unit", "test/execution")
        files = [path for folder in folders for path in root.glob(f"{folder}/**/*.py")]
        self._tests = [path for path in files if path.name.startswith("test_")]
        # What tests share lies in folders that they put on the path, and is imported by its bare name.
        named = {_name(path, root): path for path in files}
        self._imported: Dict[Path, Set[Path]] = {
            path: {named[name] for name in _imported_names(path) if name in named} for path in files
        }
        for path in files:  # fixtures; those of all unit tests are left out, they know most packages
            if path.name == "conftest.py" and path.parent.name != "unit":
                for test in set(self._tests).intersection(path.parent.glob("**/*.py")):
                    self._imported[test].add(path)

    def tests_of(self, module: Path) -> List[Path]:
        """The test files that import a module, directly or through others, the nearest first."""
        importers: Dict[Path, List[Path]] = defaultdict(list)
        for path, imported in self._imported.items():
            for other in imported:
                importers[other].append(path)
        distance, edge = {module: 0}, [module]
        while edge:
            path = edge.pop(0)
            for other in importers[path]:
                if other not in distance:
                    distance[other] = distance[path] + 1
                    edge.append(other)
        room = module.parts[-2]

        def nearness(test: Path) -> Tuple[bool, bool, int, str]:
            return module.stem not in test.stem, room not in test.parts, distance[test], str(test)

        return sorted((test for test in self._tests if test in distance), key=nearness)


def _name(path: Path, root: Path) -> str:
    parts = path.relative_to(root).with_suffix("").parts
    parts = parts[3:] if parts[0] in ("src", "extras") else parts[-1:]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _imported_names(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
