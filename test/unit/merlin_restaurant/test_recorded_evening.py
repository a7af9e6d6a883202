# SPDX-License-Identifier: Apache-2.0
"""How the mission's node ends: with the exit codes of its README, and a sentence instead of a traceback."""

import functools
from pathlib import Path
from typing import Any, List

import pytest
from fake_robot import FakeRobot

from merlin_executor.mission import mission_host
from merlin_executor.mission.readiness import NotReady
from merlin_restaurant.evening_record import CLOSED
from merlin_restaurant.recorded_evening import BALANCED, RecordedEvening
from merlin_ros.service_proxy import ServiceError

GONE = "service /rosplan_knowledge_base/state/propositions does not answer: it is gone"
MISSION = "merlin_restaurant.recorded_evening:RecordedEvening"


@pytest.fixture(autouse=True)
def evening(robot: FakeRobot, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> FakeRobot:
    """An evening without guests, in a restaurant that has closed before it began."""
    robot.parameters = {"~results": str(tmp_path / "results")}
    robot.things = {"table": ["table_1", "table_2"]}
    robot.known = ["(quiet)", "(ready table_1)", "(ready table_2)"]
    monkeypatch.setattr(mission_host, "init_node", lambda name: None)
    made = RecordedEvening.__init__

    @functools.wraps(made)
    def close(self: RecordedEvening, *arguments: Any, **named: Any) -> None:
        made(self, *arguments, **named)
        self._record.guest_event(0.0, CLOSED, "", "", (), "")

    monkeypatch.setattr(RecordedEvening, "__init__", close)
    return robot


def test_the_evening_of_a_closed_restaurant_is_written(
    robot: FakeRobot, capsys: pytest.CaptureFixture
) -> None:
    assert mission_host.main(MISSION) == 0
    assert BALANCED in capsys.readouterr().out
    results = Path(robot.parameters["~results"])
    assert sorted(path.name for path in results.iterdir()) == ["guests.csv", "robots.csv", "timeline.png"]
    (arguments,) = robot.waited
    assert arguments[-2:] == (("move_base", "sound_play", "listen", "recognize", "calls/listen"), 240.0)
    assert robot.published[-1].mission == "Evening"


def test_records_that_do_not_balance_are_another_end(robot: FakeRobot, capsys: pytest.CaptureFixture) -> None:
    robot.known.append("(carrying table_1)")
    robot.on_goal = lambda goal: robot.change(add="(carrying table_1)")
    assert mission_host.main(MISSION) == 1
    assert "NOT BALANCED: the robot still has to do with (carrying table_1)" in capsys.readouterr().out


def test_an_evening_that_is_interrupted_writes_nothing(robot: FakeRobot) -> None:
    robot.on_goal = lambda goal: robot.shut_down()
    assert mission_host.main(MISSION) == 130
    assert list(Path(robot.parameters["~results"]).iterdir()) == []


def test_a_missing_part_is_named(robot: FakeRobot, capsys: pytest.CaptureFixture) -> None:
    robot.missing = NotReady("no knowledge base rosplan_knowledge_base after 90 s")
    assert mission_host.main(MISSION) == 2
    assert capsys.readouterr().err == "mission: no knowledge base rosplan_knowledge_base after 90 s\n"
    assert robot.goals == []


@pytest.mark.parametrize(("down", "code", "said"), [(False, 2, f"mission: {GONE}\n"), (True, 130, "")])
def test_a_knowledge_base_that_is_gone_at_the_end_is_a_sentence(
    robot: FakeRobot,
    capsys: pytest.CaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
    down: bool,
    code: int,
    said: str,
) -> None:
    def gone(self: RecordedEvening, kind: str) -> List[str]:
        raise ServiceError(GONE)

    def run(self: RecordedEvening) -> str:
        robot.down = down
        monkeypatch.setattr(RecordedEvening, "objects", gone)
        return "aborted"

    monkeypatch.setattr(RecordedEvening, "run", run)
    assert mission_host.main(MISSION) == code
    assert capsys.readouterr().err == said


def test_a_timeout_that_is_not_a_number_is_named(robot: FakeRobot, capsys: pytest.CaptureFixture) -> None:
    robot.parameters["~startup_timeout"] = "x"
    assert mission_host.main(MISSION) == 2
    assert "parameter ~startup_timeout is 'x', not a number" in capsys.readouterr().err
    assert not Path(robot.parameters["~results"]).exists()


def test_a_folder_that_cannot_be_made_and_a_full_disk_are_two_things(
    robot: FakeRobot, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("merlin_restaurant.evening_results.plot_timeline", full)
    assert mission_host.main(MISSION) == 2
    printed = capsys.readouterr()
    assert BALANCED in printed.out, "what is known is said first"
    assert "the results cannot be written: [Errno 28] No space left on device" in printed.err

    (Path(robot.parameters["~results"]) / "file").touch()
    robot.parameters["~results"] += "/file/below"
    assert mission_host.main(MISSION) == 2
    assert "no folder for the results" in capsys.readouterr().err
