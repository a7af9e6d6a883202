# SPDX-License-Identifier: Apache-2.0
"""docs/architecture.md names each package and sub-package, in the order of check_imports, and each thread."""

import ast
import importlib
import importlib.util
import re
from pathlib import Path
from types import ModuleType
from typing import Any, Dict, List, Set

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
MAP = PAGE.split("## The map", 1)[1].split("\n## ", 1)[0]
PAPER = PAGE.split("## Who is who in the paper", 1)[1].split("\n## ", 1)[0]
EVERYWHERE = {"merlin_msgs", "merlin_ros"}


def contracts() -> ModuleType:
    spec = importlib.util.spec_from_file_location("check_imports", ROOT / "tools" / "check_imports.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


CONTRACTS = contracts()


def rows(table: str) -> List[List[str]]:
    return [
        [cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines() if "|" in line
    ]


def tables() -> Dict[str, str]:
    """Package → its table of sub-packages."""
    return dict(re.findall(r"^\| `(\w+)` \| \|\n\|---\|---\|\n((?:\|.*\n)+)", MAP, re.MULTILINE))


def folders(path: Path) -> List[str]:
    return sorted(found.parent.name for found in path.glob("*/*.py") if found.parent != path)


def test_every_package_is_there_with_what_it_may_import() -> None:
    (table,) = re.findall(
        r"^\| package \| what it is \| may import \|\n\|---\|---\|---\|\n((?:\|.*\n)+)", MAP, re.M
    )
    documented = {row[0].strip("`"): set(re.findall(r"`(merlin\w*)`", row[2])) for row in rows(table)}
    allowed = {
        name: set(others) - EVERYWHERE
        for name, others in CONTRACTS.MAY_IMPORT.items()
        if not name.startswith("rosplan") and name != "merlin_test"
    }
    assert documented.pop("merlin_msgs") == set()
    assert documented == allowed


@pytest.mark.parametrize("package", sorted(CONTRACTS.LAYERS))
def test_every_sub_package_is_there_in_its_order(package: str) -> None:
    source = CONTRACTS.home_of(package) / "src" / package
    existing = set(folders(source))
    if existing <= {"actions"}:  # an example to copy: its actions need no map
        return
    documented = [re.findall(r"`(\w+)/?`", row[0]) or ["."] for row in rows(tables()[package])]
    levels = {name: level for level, names in enumerate(CONTRACTS.LAYERS[package]) for name in names.split()}
    named = {name for row in documented for name in row}
    assert existing <= named and named | {"."} == set(levels) | {"."}
    order = [{levels[name] for name in row} for row in documented]
    assert all(low <= high for row, after in zip(order, order[1:]) for low in row for high in after)


def test_what_runs_without_ros_says_so() -> None:
    for package, names in CONTRACTS.WITHOUT_ROS.items():
        for name in names.split():
            if name != "*":
                (text,) = [row[1] for row in rows(tables()[package]) if f"`{name}/`" in row[0]]
                assert re.search("without ROS", text, re.IGNORECASE), (package, name)


def test_every_room_of_bench_is_there() -> None:
    assert set(re.findall(r"`bench/(\w+)/`", MAP)) == set(folders(ROOT / "bench"))


def classes_of_the_paper() -> Dict[str, Any]:
    """Name → class, of each row that names its module in the table, also in its last column."""
    (table,) = re.findall(r"^\| in the paper \| module \| \|\n\|---\|---\|---\|\n((?:\|.*\n)+)", PAPER, re.M)
    found: Dict[str, Any] = {}
    for name, module, documented in rows(table):
        loaded = importlib.import_module(module.strip("`"))
        names = re.findall(r"`([A-Z]\w+)`", f"{name} {documented}")
        inside = re.findall(r"`([A-Z]\w+)` \(`([\w.]+)`\)", documented)
        found.update({inner: getattr(importlib.import_module(where), inner) for inner, where in inside})
        own = [n for n in names if n not in found and n != "RPActionInterface"]
        found.update({n: getattr(loaded, n) for n in own})
    return found


def test_each_class_of_the_paper_is_where_the_table_says() -> None:
    found = classes_of_the_paper()
    assert {"MerlinSM", "ExecutorSM", "GoalDispatcher", "ActionInterface", "MerlinExecutorClient"} <= set(
        found
    )


def test_the_class_diagrams_say_who_inherits_from_whom() -> None:
    found = classes_of_the_paper()
    found["MerlinState"] = importlib.import_module("merlin_sm.states.merlin_state").MerlinState
    pairs = re.findall(r"^  (\w+) <\|-- (\w+)$", PAPER, re.M)
    assert len(pairs) == 9
    assert [pair for pair in pairs if not issubclass(found[pair[1]], found[pair[0]])] == []


def text_of(name: ast.expr) -> str:
    """A thread's name as the page writes it; empty: it is given by the caller."""
    if isinstance(name, ast.Constant):
        return str(name.value)
    parts = name.values if isinstance(name, ast.JoinedStr) else []
    return "".join(str(part.value) if isinstance(part, ast.Constant) else "…" for part in parts)


def threads_of(source: str) -> Set[str]:
    """The names of the threads that a module starts."""
    found = set()
    for call in ast.walk(ast.parse(source)):
        if isinstance(call, ast.Call):
            starter = getattr(call.func, "id", getattr(call.func, "attr", ""))
            names = [word.value for word in call.keywords if starter == "Thread" and word.arg == "name"]
            names += call.args[:1] if starter in ("start_thread", "CallQueue", "Alarms") else []
            found |= {text_of(name) for name in names}
    return found - {""}


def test_every_thread_of_a_node_is_in_the_table() -> None:
    section = PAGE.split("\n## Threads", 1)[1].split("\n## ", 1)[0]
    documented = set(re.findall(r"`([^`]+)`", section))
    # Of tests, and of guests, each of which has a thread of its name.
    others = {"testing", "merlin_test", "merlin_guests"}
    for path in sorted((ROOT / "src").glob("merlin_*/src/**/*.py")):
        if not others & set(path.parts):
            assert threads_of(path.read_text(encoding="utf-8")) <= documented, path
