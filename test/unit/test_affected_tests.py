# SPDX-License-Identifier: Apache-2.0
"""Which unit tests a change concerns."""

import importlib.util
from pathlib import Path
from typing import Callable, Set

import pytest

TOOL = Path(__file__).resolve().parents[2] / "tools" / "affected_tests.py"
spec = importlib.util.spec_from_file_location("affected_tests", TOOL)
assert spec is not None and spec.loader is not None
affected_tests = importlib.util.module_from_spec(spec)
spec.loader.exec_module(affected_tests)
SOURCES = affected_tests.sources()


@pytest.fixture(scope="module")
def concerned() -> Callable[..., Set[str]]:
    importing = affected_tests.importers(SOURCES)
    return lambda *names: {path.name for path in affected_tests.concerned(names, SOURCES, importing)}


def test_a_module_concerns_its_tests_and_those_of_its_importers(concerned: Callable[..., Set[str]]) -> None:
    found = concerned("src/merlin_executor/src/merlin_executor/core/agenda.py")
    assert {"test_agenda.py", "test_engine.py"} <= found
    assert "test_md5sums.py" not in found


def test_a_module_that_is_started_as_a_process_concerns_the_test(concerned: Callable[..., Set[str]]) -> None:
    assert "test_node.py" in concerned("src/merlin_ros/src/merlin_ros/parameters.py")


def test_what_tests_share_concerns_them(concerned: Callable[..., Set[str]]) -> None:
    assert "test_fleet_backup.py" in concerned("test/unit/merlin_fleet/fleet_world.py")


@pytest.mark.parametrize("name", ["docs/fleet.md", "launch/home.launch"])
def test_other_files_concern_the_tests_that_mention_them(
    concerned: Callable[..., Set[str]], name: str
) -> None:
    found = concerned(name)
    expected = "test_fleet_backup.py" if name == "docs/fleet.md" else "test_check.py"
    assert expected in found and "test_agenda.py" not in found


def test_the_preparation_of_all_tests_concerns_all(concerned: Callable[..., Set[str]]) -> None:
    tests = {path.name for path in SOURCES if path.name.startswith("test_")}
    assert tests <= concerned("test/conftest.py")
    # and what it imports is about how they run.
    assert "test_md5sums.py" not in concerned("src/merlin/src/merlin/local_names.py")
