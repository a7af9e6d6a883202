# SPDX-License-Identifier: Apache-2.0
"""A mission is run by its name, with its parameters, and every end has its exit code."""

import textwrap
from pathlib import Path
from typing import Any

import pytest
from fake_robot import FakeRobot
from merlin_msgs.msg import ExecuteResult, MissionStatus

from merlin_executor.mission import GoalDispatcher, MissionError, MissionSM, mission_host, results_folder
from merlin_executor.mission.readiness import NotReady
from merlin_planning.knowledge_client import fact
from merlin_ros.parameters import ParameterError
from merlin_ros.service_proxy import ServiceError

KITCHEN = "(checked kitchen)"


class Round(GoalDispatcher):
    """Visits rooms; says at the end what it did."""

    servers = ("move_base", "sound_play")
    startup_timeout = 7.0

    def __init__(self, rooms: str, rounds: int = 1, slow: bool = False, results: Path = Path()) -> None:
        if rounds < 1:
            raise ValueError(f"{rounds} rounds cannot be")
        self.rooms, self.rounds = rooms.split(), rounds
        super().__init__("round", rounds)

    def run(self) -> None:
        for room in self.rooms * self.rounds:
            self.remove_facts(f"(checked {room})")
            self.achieve(f"(checked {room})")


class Tour(MissionSM):
    def build(self) -> None:
        self.add_goal_state("KITCHEN", KITCHEN, {"succeeded": "BATH"})
        self.add_goal_state("BATH", "(checked bathroom)")


class OneItem(GoalDispatcher):
    def run(self) -> None:
        self.achieve(fact("checked", "kitchen"))


class OneItemTour(MissionSM):
    def build(self) -> None:
        self.add_goal_state("KITCHEN", fact("checked", "kitchen"))


class Unwritten(GoalDispatcher):
    def run(self) -> None:
        pass

    def finish(self, succeeded: bool) -> bool:
        raise MissionError("the results cannot be written: disk full")


class Judged(GoalDispatcher):
    def run(self) -> None:
        pass

    def finish(self, succeeded: bool) -> bool:
        return False


class Exits(MissionSM):
    def build(self) -> None:
        raise SystemExit(0)


class ForgetsBase(GoalDispatcher):
    def __init__(self) -> None:
        pass

    def run(self) -> None:
        self.achieve("(visited kitchen)")


class Unbuilt(MissionSM):
    pass


class Misbuilt(MissionSM):
    def build(self) -> None:
        self.add_gaol_state("KITCHEN", KITCHEN)  # type: ignore[attr-defined]


@pytest.fixture(autouse=True)
def host(robot: FakeRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mission_host, "init_node", lambda name: None)
    monkeypatch.setattr(mission_host, "load_class", lambda path: globals()[path])
    monkeypatch.setattr("sys.argv", ["mission"])


def test_a_mission_runs_with_its_parameters(robot: FakeRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    robot.parameters = {"~rooms": "kitchen bathroom", "~rounds": 2}
    monkeypatch.setattr("sys.argv", ["mission", "mission:=Round", "__name:=patrol"])
    assert mission_host.main() == 0
    assert robot.goals == [KITCHEN, "(checked bathroom)"] * 2
    assert robot.waited == [("the knowledge base", robot, Round, ("move_base", "sound_play"), 7.0)]
    assert (robot.published[-1].mission, robot.published[-1].state) == ("round", MissionStatus.SUCCEEDED)


def test_a_machine_is_named_by_a_parameter(robot: FakeRobot) -> None:
    robot.parameters = {"~mission": "Tour", "~startup_timeout": 5}
    assert mission_host.main() == 0
    assert robot.goals == [KITCHEN, "(checked bathroom)"]
    assert robot.waited[0][-1] == 5.0


@pytest.mark.parametrize("mission", ["OneItem", "OneItemTour"])
def test_a_goal_may_be_one_knowledge_item(robot: FakeRobot, mission: str) -> None:
    assert mission_host.main(mission) == 0
    assert robot.goals == [KITCHEN]


@pytest.mark.parametrize("mission", ["Round", "Tour"])
def test_a_goal_that_is_not_reached_fails_the_mission(robot: FakeRobot, mission: str) -> None:
    robot.parameters = {"~rooms": "kitchen"}
    robot.results = {KITCHEN: ExecuteResult(outcome=ExecuteResult.UNSOLVABLE, reason="the door is shut")}
    assert mission_host.main(mission) == 1
    assert robot.published[-1].state == MissionStatus.FAILED
    assert "the door is shut" in robot.published[-1].description


def test_a_mission_judges_its_own_end(robot: FakeRobot, capsys: pytest.CaptureFixture) -> None:
    assert mission_host.main("Judged") == 1
    assert mission_host.main("Unwritten") == 2
    assert capsys.readouterr().err == "mission: the results cannot be written: disk full\n"


@pytest.mark.parametrize("mission", ["Round", "Tour"])
def test_an_interrupted_mission_cancels_its_goal(robot: FakeRobot, mission: str) -> None:
    robot.parameters = {"~rooms": "kitchen bathroom"}
    robot.never = [KITCHEN]
    robot.on_goal = lambda goal: robot.shut_down()
    assert mission_host.main(mission) == 130
    assert robot.goals == [KITCHEN]
    assert robot.published[-1].state == MissionStatus.CANCELLED


@pytest.mark.parametrize(
    ("path", "parameters", "why"),
    [
        ("", {}, "no mission is named; give mission:=package.module:Class or the parameter ~mission"),
        ("Path", {}, "'Path' is not a mission; derive it from GoalDispatcher or MissionSM"),
        ("GoalDispatcher", {}, "'GoalDispatcher' is not a complete mission; it has to implement run()"),
        ("Unbuilt", {}, "'Unbuilt' is not a complete mission; it has to implement build()"),
        ("Round", {}, "parameter ~rooms is missing; Round has no default for it"),
        ("Round", {"~rooms": ["a"]}, "parameter ~rooms is ['a'], not a text"),
        ("Round", {"~rooms": "a", "~rounds": 1.5}, "parameter ~rounds is 1.5, not a whole number"),
        ("Round", {"~rooms": "a", "~slow": 1}, "parameter ~slow is 1, not true or false"),
        ("Round", {"~rooms": "a", "~rounds": 0}, "0 rounds cannot be"),
        (
            "Round",
            {"~rooms": "a", "~startup_timeout": "x"},
            "parameter ~startup_timeout is 'x', not a number",
        ),
        (
            "Tour",
            {"~autonomy": "medium"},
            "parameter ~autonomy: 'medium' is not an autonomy level; there are off, low, high, full",
        ),
    ],
)
def test_a_mission_that_cannot_begin_is_one_line(
    robot: FakeRobot, capsys: pytest.CaptureFixture, path: str, parameters: Any, why: str
) -> None:
    robot.parameters = parameters
    assert mission_host.main(path) == 2
    assert capsys.readouterr().err == f"mission: {why}\n"
    assert robot.goals == []


@pytest.mark.parametrize(
    "missing", [NotReady("no Executor on /merlin/execute after 60 s"), ServiceError("gone")]
)
@pytest.mark.parametrize(("down", "code"), [(False, 2), (True, 130)])
def test_a_missing_part_is_named_unless_the_node_was_interrupted(
    robot: FakeRobot, capsys: pytest.CaptureFixture, missing: Exception, down: bool, code: int
) -> None:
    robot.missing, robot.down = missing, down
    assert mission_host.main("Tour") == code
    assert capsys.readouterr().err == ("" if down else f"mission: {missing}\n")
    assert robot.goals == []
    if not down:
        assert (robot.published[-1].state, robot.published[-1].description) == (4, str(missing))


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    assert results_folder(tmp_path / "a" / "b").is_dir()
    (tmp_path / "file").touch()
    with pytest.raises(ParameterError, match="no folder for the results: .*give another one, results:="):
        results_folder(tmp_path / "file" / "below")


def test_the_command_line_names_a_class_of_a_module(
    robot: FakeRobot, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.undo()
    monkeypatch.setattr(mission_host, "init_node", lambda name: None)
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "broken_mission.py").write_text(textwrap.dedent("class Patrol:\n  def\n"))
    for path, why in (
        ("patrol", "write package.module:Class"),
        ("nowhere.patrol:Patrol", "No module named 'nowhere'"),
        ("merlin_executor.mission:Patrol", "merlin_executor.mission has no Patrol"),
        ("broken_mission:Patrol", "invalid syntax (broken_mission.py, line 2)"),
    ):
        assert mission_host.main(path) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith("mission: ") and why in line


def test_a_mission_whose_build_fails_is_one_line_that_names_its_place(capsys: Any) -> None:
    assert mission_host.main("Misbuilt") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert (
        "Misbuilt cannot be made: AttributeError: 'Misbuilt' object has no attribute 'add_gaol_state'" in line
    )
    assert "(test_mission_host.py, line " in line


def test_a_mission_that_ends_the_process_is_one_line_that_names_its_place(capsys: Any) -> None:
    assert mission_host.main("Exits") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "Exits cannot be made: SystemExit: 0 (test_mission_host.py, line " in line


def test_a_mission_without_its_base_is_one_line(capsys: Any) -> None:
    assert mission_host.main("ForgetsBase") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith("ForgetsBase cannot be made: its __init__ does not call super().__init__()")
