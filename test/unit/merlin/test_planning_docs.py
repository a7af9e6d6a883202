# SPDX-License-Identifier: Apache-2.0
"""docs/planners.md and docs/dispatch.md: their commands run, their names and numbers are the code's."""

import re
import shlex
import subprocess
from pathlib import Path
from unittest.mock import create_autospec

import pytest
import yaml
from merlin_msgs.msg import DispatchStatus, RunningAction

from merlin_pddl.checks import installed_planners, validate
from merlin_pddl.checks.installed_planners import expand, is_preset
from merlin_planning.dispatch_client import DispatchClient
from merlin_planning.knowledge_text import action_text
from merlin_planning.planning_client import PlanningClient
from merlin_rosplan.nodes.planner_interface import PlannerInterface
from merlin_rosplan.planning.planner_command import parse_command
from merlin_rosplan.planning.planner_engines import _parts as parts_of
from merlin_rosplan.planning.planning_outcome import PlannerState

ROOT = Path(__file__).parents[3]
PLANNERS = (ROOT / "docs" / "planners.md").read_text()
DISPATCH = (ROOT / "docs" / "dispatch.md").read_text()
EXECUTION = ROOT / "test" / "execution"


def rows(heading, text=PLANNERS):
    """The first table of a section, without its head, as cells."""
    section = text.split(f"## {heading}\n", 1)[1].split("\n## ", 1)[0]
    lines = [line for line in section.splitlines() if line.startswith("|")]
    found = [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines]
    return found[2:]


def names(cell):
    return re.findall(r"`([^`]+)`", cell)


@pytest.mark.parametrize(
    "value", [value for cells in rows("Which planner") for value in names(cells[0])], ids=str
)
def test_each_planner_command_of_the_page_is_understood(value):
    for part in parts_of(value.replace("NAME", "tamer")):
        assert (
            part == "kairos" or is_preset(part) or parse_command(part).program in ("popf", "/opt/popf/popf")
        )
        if part != "kairos":
            assert "PROBLEM" in expand(part)


def test_the_commands_that_install_planners_name_packages_and_variable_of_the_code():
    (block,) = re.findall(r"```bash\n(.*?)```", PLANNERS, re.DOTALL)
    venv, pip, export = block.splitlines()
    folder = shlex.split(venv)[-1]
    assert shlex.split(venv)[:3] == ["python3", "-m", "venv"]
    program, verb, *packages = shlex.split(pip)
    assert (program, verb) == (f"{folder}/bin/pip", "install")
    looked_in = {preset.package for preset in installed_planners._PRESETS.values()} - {""}
    looked_in.add("unified_planning")
    assert {package.replace("-", "_") for package in packages} == looked_in
    assert export == f"export {installed_planners.PLANNERS}={folder}"
    assert subprocess.run(["bash", "-n", "-c", block], check=False).returncode == 0


def test_the_outcomes_of_the_page_are_those_of_the_planner_interface():
    reported = {cells[0] for cells in rows("How it ends")}
    assert reported == {state.name for state in PlannerState} - {"IDLE", "RUNNING"}


def test_the_limits_of_the_page_are_the_defaults():
    class Defaults:
        def param(self, name, default):
            return default

        def number(self, name, default, *_):
            return default

        flag = number

    settings = PlannerInterface._read_settings(Defaults())
    found = {names(cells[0])[0].lstrip("~"): float(cells[1].split()[0]) for cells in rows("Limits")}
    assert found == {name: getattr(settings, name) for name in found} and len(found) == 4


def test_validate_runs_as_the_page_calls_it():
    (command,) = re.findall(r"`(rosrun merlin_rosplan validate [^`]*)`", PLANNERS)
    done = subprocess.run(
        shlex.split(command),
        cwd=str(ROOT / "pddl" / "home"),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == validate.VALID, done.stdout
    limit, size = re.findall(r"`--(?:time-limit|max-size)` \((\d+) (?:s|MB)\)", PLANNERS)
    assert (float(limit), float(size)) == (validate.TIME_LIMIT, validate.MAX_SIZE)


@pytest.mark.parametrize("page", [PLANNERS, DISPATCH], ids=["planners", "dispatch"])
def test_files_that_a_page_names_exist(page):
    paths = set(re.findall(r"`((?:bench|test|docs|src|pddl|tools)/[\w./-]+)`", page))
    assert paths and all((ROOT / path).exists() for path in paths), paths


def test_the_parameters_that_a_page_names_exist():
    folders = (ROOT / "src/merlin_rosplan/src", ROOT / "src/merlin_executor/src")
    sources = "".join(path.read_text() for folder in folders for path in folder.rglob("*.py"))
    for name in set(re.findall(r"`~(\w+)", PLANNERS + DISPATCH)):
        assert re.search(f'"~?{name}"', sources), name


def test_the_fields_that_the_page_on_dispatching_names_exist():
    fields = set(re.findall(r"`(goal_achieved|unmet_goals)`", DISPATCH))
    assert fields == {"goal_achieved", "unmet_goals"} and fields <= set(DispatchStatus.__slots__)


def test_the_suite_has_as_many_cases_as_the_page_says(monkeypatch):
    monkeypatch.syspath_prepend(str(EXECUTION))
    from cases import CASES
    from test_cases import PACES

    runs = len(CASES) * 2 * len(PACES)
    assert f"runs {len(CASES)} plans" in DISPATCH and f"{runs} runs" in DISPATCH
    assert f"| {len(CASES)} cases × 2 dispatchers × {len(PACES)} paces |" in DISPATCH
    few = yaml.safe_load(
        re.search(r"<rosparam>(.*?)</rosparam>", (EXECUTION / "conformance.test").read_text(), re.DOTALL)[1]
    )
    assert set(few["cases"]) <= {case.name for case in CASES}


def test_the_exchange_of_the_page_is_that_of_the_clients():
    (block,) = re.findall(r"```python\n(.*?)```", DISPATCH, re.DOTALL)
    dispatcher, planning = (create_autospec(kind, instance=True) for kind in (DispatchClient, PlanningClient))
    dispatcher.running, planning.parse_plan.return_value = [RunningAction(name="sing")], ["a step"]
    known = {"dispatcher": dispatcher, "planning": planning, "action_text": action_text}
    exec(block, {**known, "interruptible": print})
    planning.plan.assert_called_with(print, after=["(sing)"])
    dispatcher.exchange.assert_called_with(["a step"], keep=dispatcher.running)
