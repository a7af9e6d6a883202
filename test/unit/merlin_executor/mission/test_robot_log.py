# SPDX-License-Identifier: Apache-2.0
"""The screen of any mission says what the robot does, and why something failed."""

import itertools
from typing import Any, Dict, List, Tuple

import pytest
from diagnostic_msgs.msg import KeyValue
from merlin_msgs.msg import ExecutorStatus, ListenActionResult, ListenResult
from rosplan_dispatch_msgs.msg import ActionDispatch, ActionFeedback
from sound_play.msg import SoundRequest, SoundRequestActionGoal, SoundRequestGoal

from merlin_executor.core.robot_lines import REMEMBERED, RobotLines, Screen
from merlin_executor.mission import robot_log
from merlin_executor.mission.robot_log import RobotLog


class Log:
    """What a robot log writes, and the messages that it gets."""

    def __init__(self) -> None:
        self.receivers: Dict[str, Any] = {}
        self.lines: List[str] = []
        self.failures: List[tuple] = []

    def subscribe(self, topic: str, kind: type, receive: Any, *arguments: Any, **options: Any) -> None:
        self.receivers[topic] = lambda message: receive(message, *arguments)

    def hear(self, topic: str, message: Any) -> None:
        self.receivers[topic](message)


@pytest.fixture
def log(monkeypatch: pytest.MonkeyPatch) -> Log:
    made = Log()
    monkeypatch.setattr(robot_log.rospy, "Subscriber", made.subscribe)
    monkeypatch.setattr(robot_log.rospy, "get_time", lambda: 12.5)
    made.log = RobotLog(made.lines.append, lambda action, reason: made.failures.append((action, reason)))
    return made


def test_goals_and_their_ends_are_reported(log: Log) -> None:
    first = ExecutorStatus(request="1", goals=["(checked hall)", "(checked kitchen)"])
    urgent = ExecutorStatus(request="2", goals=["(served table_1)"], priority=1, reason="x: interrupted")
    for status in (first, first, urgent, first, ExecutorStatus(reason="x: SUCCEEDED")):
        log.hear("merlin/status", status)
    assert log.lines == [
        "goal (checked hall) and 1 more",
        "goal (checked hall) and 1 more: interrupted",
        "goal (served table_1), urgent",
        "goal (served table_1), urgent: left",
        "goes on with (checked hall) and 1 more",
        "goal (checked hall) and 1 more: SUCCEEDED",
    ]


def test_actions_and_their_failures_are_reported(log: Log) -> None:
    action = ActionDispatch(action_id=1, plan_id=2, name="ask", parameters=[KeyValue("p", "hall")])
    log.hear("rosplan_plan_dispatcher/action_dispatch", action)
    log.hear("rosplan_plan_dispatcher/action_dispatch", ActionDispatch(name="cancel_action"))
    failed = ActionFeedback(
        action_id=1,
        plan_id=2,
        status=ActionFeedback.ACTION_FAILED,
        information=[KeyValue("reason", "nobody is there")],
    )
    log.hear("rosplan_plan_dispatcher/action_feedback", failed)
    log.hear("rosplan_plan_dispatcher/action_feedback", failed)
    assert log.lines == ["(ask hall)", "(ask hall): nobody is there"]
    assert log.failures == [("(ask hall)", "nobody is there")]
    assert log.log.deeds == [("(ask hall)", 12.5, 12.5, "nobody is there")]


@pytest.mark.parametrize("of_dispatcher", itertools.combinations(range(5), 2))
def test_an_answer_that_is_read_before_its_dispatch_counts(log: Log, of_dispatcher: Tuple[int, int]) -> None:
    """All orders in which messages of two topics can be read, one answer of them twice."""
    dispatches = iter(
        [ActionDispatch(action_id=number, plan_id=2, name=f"ask_{number}") for number in (1, 2)]
    )
    done, failed = ActionFeedback.ACTION_SUCCEEDED_TO_GOAL_STATE, ActionFeedback.ACTION_FAILED
    why = [KeyValue("reason", "no answer")]
    answers = iter(
        [
            ActionFeedback(action_id=number, plan_id=2, status=status, information=why)
            for number, status in ((2, failed), (2, failed), (1, done))
        ]
    )
    for place in range(5):
        topic, read = (
            ("action_dispatch", dispatches) if place in of_dispatcher else ("action_feedback", answers)
        )
        log.hear(f"rosplan_plan_dispatcher/{topic}", next(read))
    assert sorted(log.log.deeds) == [("(ask_1)", 12.5, 12.5, ""), ("(ask_2)", 12.5, 12.5, "no answer")]
    assert log.failures == [("(ask_2)", "no answer")]
    assert log.lines == ["(ask_1)", "(ask_2)", "(ask_2): no answer"]


def test_speech_is_reported(log: Log) -> None:
    goal = SoundRequestActionGoal(goal=SoundRequestGoal(sound_request=SoundRequest(arg="Hello.")))
    log.hear("sound_play/goal", goal)
    log.hear("listen/result", ListenActionResult(result=ListenResult(text="yes", heard=True)))
    log.hear("listen/result", ListenActionResult(result=ListenResult(heard=True)))
    log.hear("listen/result", ListenActionResult())
    assert log.lines == ['says "Hello."', 'understands "yes"', "hears something it does not understand"]


def test_lines_have_the_time_since_the_first(capsys: Any) -> None:
    times = iter([100.0, 103.25])
    screen = Screen(lambda: next(times))
    screen.line("robot", "goal (checked hall)")
    screen.line("robot", "(ask hall)")
    assert (
        capsys.readouterr().out == "    0.0 s  robot   goal (checked hall)\n    3.2 s  robot   (ask hall)\n"
    )


def test_an_action_ends_once_and_a_cancelled_one_is_no_failure() -> None:
    lines: List[str] = []
    failures: List[str] = []
    scenario = RobotLines(lines.append, lambda action, reason: failures.append(action))
    scenario.end((1, 1), 5.0, None)  # it began before this log did
    scenario.begin((1, 2), "(ask hall)", 6.0)
    scenario.begin((1, 3), "(ask kitchen)", 6.5)
    scenario.end((1, 2), 8.0, "cancelled")
    scenario.end((1, 2), 9.0, "late")
    scenario.end((1, 3), 9.5, None)
    assert [(deed.text, deed.ended, deed.reason) for deed in scenario.deeds] == [
        ("(ask hall)", 8.0, "cancelled"),
        ("(ask kitchen)", 9.5, ""),
    ]
    assert lines == ["(ask hall)", "(ask kitchen)", "(ask hall): cancelled"] and failures == []


def test_what_is_remembered_does_not_grow_for_ever() -> None:
    lines: List[str] = []
    scenario = RobotLines(lines.append, lambda action, reason: None)
    for number in range(2 * REMEMBERED):
        scenario.pursue(f"request {number}", ["(checked hall)"], 0, "")
        scenario.begin((number, 0), "(never answered)", 1.0)
        scenario.begin((number, 1), f"(ask {number})", 1.0)
        scenario.end((number, 1), 2.0, None)
    assert len(scenario.deeds) <= REMEMBERED and scenario.deeds[-1].text == f"(ask {number})"
    scenario.pursue(f"request {number - 1}", ["(checked hall)"], 0, "")
    assert lines[-1] == "goes on with (checked hall)"
    scenario.pursue("request 0", ["(checked hall)"], 0, "")
    assert lines[-1] == "goal (checked hall)", "the first request is still known"
    scenario.end((0, 0), 3.0, "late")
    assert lines[-1] == "goal (checked hall)", "the first action still runs"


def test_what_is_seen_is_reported_with_its_place() -> None:
    lines: List[str] = []
    scenario = RobotLines(lines.append, lambda action, reason: None)
    scenario.see([("cup", 1.23, -0.5)])
    scenario.see([])
    assert lines == ["sees cup (1.2, -0.5)", "sees nothing"]


def test_with_several_robots_each_line_names_its_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    log = Log()
    monkeypatch.setattr(robot_log.rospy, "Subscriber", log.subscribe)
    RobotLog(log.lines.append, robots=("robot_1", "robot_2"))
    said = SoundRequestActionGoal(goal=SoundRequestGoal(sound_request=SoundRequest(arg="Good evening.")))
    log.hear("robot_2/sound_play/goal", said)
    log.hear(
        "robot_1/listen/result", ListenActionResult(result=ListenResult(text="a cake please", heard=True))
    )
    assert log.lines == ['robot_2 says "Good evening."', 'robot_1 understands "a cake please"']
