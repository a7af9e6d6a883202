# SPDX-License-Identifier: Apache-2.0
"""The mission of the home sends its list, and ends a marked task after some time."""

import pytest
from fake_robot import FakeRobot
from merlin_msgs.msg import ExecuteResult, MissionStatus

from merlin_executor.mission import mission_host
from merlin_home.home_mission import HomeMission
from merlin_home.mission_list import make_mission

POINTS = ["bathroom", "kitchen", "main_door"]
LIST = make_mission(POINTS, 6, 3)
MISSION = "merlin_home.home_mission:HomeMission"


@pytest.fixture(autouse=True)
def home(robot: FakeRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mission_host, "init_node", lambda name: None)
    robot.parameters = {"world/points_of_interest": dict.fromkeys(POINTS), "~seed": 3}


def test_each_task_of_the_list_is_sent_anew(robot: FakeRobot) -> None:
    held = []
    robot.on_goal = lambda goal: held.append(goal in robot.known)
    assert mission_host.main(MISSION) == 0
    assert robot.goals == [f"(checked {task.poi})" for task in LIST]
    assert held == [False] * 6, "a point that was checked before is checked again"
    assert (robot.published[-1].mission, robot.published[-1].tasks) == ("home mission", 6)
    assert robot.waited[0][-2:] == (("move_base", "sound_play"), 60.0)


def test_a_marked_task_that_still_runs_is_cancelled_and_the_mission_goes_on(robot: FakeRobot) -> None:
    robot.parameters["~marked_share"] = 1.0
    robot.never = [f"(checked {point})" for point in POINTS]
    assert mission_host.main(MISSION) == 0
    assert robot.goals == [f"(checked {task.poi})" for task in LIST]


def test_a_task_that_fails_ends_the_mission(robot: FakeRobot) -> None:
    goal = f"(checked {LIST[0].poi})"
    robot.results[goal] = ExecuteResult(outcome=ExecuteResult.UNSOLVABLE, reason="the door is shut")
    assert mission_host.main(MISSION) == 1
    assert robot.goals == [goal]
    assert robot.published[-1].state == MissionStatus.FAILED


def test_a_cancelled_mission_is_not_taken_for_a_marked_task(robot: FakeRobot) -> None:
    robot.parameters["~marked_share"] = 1.0
    robot.never = [f"(checked {point})" for point in POINTS]
    robot.on_goal = lambda goal: robot.shut_down()
    assert mission_host.main(MISSION) == 130
    assert len(robot.goals) == 1


@pytest.mark.parametrize(
    ("name", "value", "why"),
    [
        ("~mission", 4, "there is no mission 4; give one of [1, 2, 3]"),
        ("~marked_share", 0.3, "0.3 of 6 tasks is not a whole number"),
        ("~cancel_after", 0.0, "parameter ~cancel_after is 0, less than 0.1"),
        ("~points", "kitchen", "a mission needs two points of interest or more, not ['kitchen']"),
    ],
)
def test_a_list_that_cannot_be_made_is_one_line(
    robot: FakeRobot, capsys: pytest.CaptureFixture, name: str, value: object, why: str
) -> None:
    robot.parameters[name] = value
    assert mission_host.main(MISSION) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"mission: {why}")


def test_points_may_be_named(robot: FakeRobot) -> None:
    robot.parameters["~points"] = "kitchen main_door"
    mission = HomeMission.from_parameters()
    mission.run()
    assert set(robot.goals) == {"(checked kitchen)", "(checked main_door)"}
