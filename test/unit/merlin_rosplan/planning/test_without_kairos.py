# SPDX-License-Identifier: Apache-2.0
"""What plans on a Python that kairos does not know, and what the node says of it at its start."""

import os
from pathlib import Path
from typing import Any

import pytest

from merlin_pddl.checks import installed_planners
from merlin_rosplan.planning import planner_engines
from merlin_rosplan.planning.planner_command import PlannerCommandError
from merlin_rosplan.planning.planner_engines import engines

NODE = """
import sys
sys.modules["kairos"] = None
sys.argv = ["planner_interface"]
from merlin_rosplan.nodes.planning_system import run_kind
run_kind("planner_interface")
"""


@pytest.fixture
def old_python(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A Python that kairos does not know; no planner is installed there."""
    monkeypatch.setenv("PATH", "/nowhere")
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"/nowhere:{tmp_path}/src")
    monkeypatch.delenv("MERLIN_PLANNERS", raising=False)
    monkeypatch.setattr(planner_engines, "installed", lambda: False)
    monkeypatch.setattr(installed_planners.importlib.util, "find_spec", lambda name: None)
    return tmp_path


def program(path: Path) -> str:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch(mode=0o755)
    return str(path)


@pytest.mark.parametrize("folder", ["", "ROSPlan"])
def test_popf_of_rosplan_plans_and_what_it_does_not_read_is_said(old_python: Path, folder: str) -> None:
    popf = program(old_python / "src" / folder / "rosplan_planning_system" / "common" / "bin" / "popf")
    chosen = engines("", fallback=True)
    assert chosen.commands == [f"{popf} DOMAIN PROBLEM"] and chosen.name == "popf"
    assert "kairos is not installed; popf plans instead, and reads no negative" in chosen.warning
    with pytest.raises(PlannerCommandError, match="kairos needs Python 3.10"):
        engines("", fallback=False)


def test_lpg_of_a_wheel_plans(old_python: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lpg = program(old_python / "lib" / "python3.8" / "site-packages" / "up_lpg" / "lpg")
    monkeypatch.setenv("MERLIN_PLANNERS", str(old_python))
    assert engines("", fallback=True).commands[0].startswith(f"{lpg} -o DOMAIN")


def test_without_any_planner_the_error_says_what_to_install(old_python: Path) -> None:
    with pytest.raises(PlannerCommandError, match="install popf or lpg, or set ~planner_command"):
        engines("", fallback=True)


@pytest.mark.processes
def test_the_node_says_at_its_start_what_plans(master: Any, tmp_path: Path) -> None:
    program(tmp_path / "bin" / "popf")
    master.env["PATH"] = os.pathsep.join([str(tmp_path / "bin"), os.environ["PATH"]])
    master.node(NODE).expect("kairos is not installed; popf plans instead")


@pytest.mark.processes
def test_the_node_says_at_its_start_that_nothing_plans(master: Any) -> None:
    master.env["PATH"] = os.defpath
    master.node(NODE).expect("there is no planner: kairos needs Python 3.10")
