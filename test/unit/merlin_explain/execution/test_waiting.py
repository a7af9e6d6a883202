# SPDX-License-Identifier: Apache-2.0
"""What a step or a request waits for: the condition, what will make it true, and when."""

from typing import Any, List

import pytest
from merlin_msgs.msg import DispatchStatus
from robot_scenario import BEGIN, RobotScenario

from merlin_explain.claims import Answer, QuestionError, Words
from merlin_explain.execution.moment import Change
from merlin_explain.execution.waiting import waiting
from merlin_ros.work.passed_time import clock_text

RUNNING, NEXT = "/mission-1-5.0", "/tablet-1-6.0"
DRIVE, MOP = "(drive d1 hall kitchen)", "(mop kitchen)"


def ask(scenario: RobotScenario, about: str = "", *timed: Change, seconds: float = 0.0) -> Answer:
    moment = scenario.moment(seconds)
    moment.timed = timed
    return waiting(moment, about, Words())


def kinds(answer: Answer) -> List[str]:
    return [claim.kind for claim in answer.claims]


def drive(scenario: RobotScenario, **fields: Any) -> None:
    scenario.runs(RUNNING, ["(tidy kitchen)"], **fields)
    scenario.plans((DRIVE, 0.0, 10.0), (MOP, 10.0, 4.0), edges=[(0, 1)])
    scenario.begins(0)
    scenario.wait(2.0)


def test_a_step_waits_for_an_action_that_runs(scenario: RobotScenario) -> None:
    drive(scenario)
    answer = ask(scenario)
    due = clock_text(BEGIN + 10.0)
    assert kinds(answer) == ["order", "condition", "bringer"]
    assert (
        answer.claims[0].text
        == f"“{DRIVE}” has to end first, it has run since {clock_text(BEGIN)} and as planned ends at {due}"
    )
    assert "“(at kitchen)” does not hold" in answer.sentence
    assert [each.step for each in answer.claims[2].evidence][0] == 1
    assert f"has waited since {clock_text(BEGIN)}: " in answer.sentence
    assert ask(scenario, MOP) == answer


def test_since_when_is_not_said_of_a_plan_that_was_carried_out_before_it_was_heard(
    scenario: RobotScenario,
) -> None:
    running = DispatchStatus(state=DispatchStatus.RUNNING, plan_id=1, steps_total=2)
    scenario.model.plan.dispatcher(running, scenario.now)
    drive(scenario)
    assert ask(scenario).sentence.startswith(f"“{MOP}” waits: “{DRIVE}” has to end first")


def test_an_action_that_is_late_is_not_said_to_end(scenario: RobotScenario) -> None:
    drive(scenario)
    scenario.wait(13.0)
    assert "is 5 s over its planned 10 s" in ask(scenario).sentence


def test_what_only_has_to_have_begun_does_not_block(scenario: RobotScenario) -> None:
    scenario.runs(RUNNING, ["(tidy kitchen)"])
    scenario.plans((DRIVE, 0.0, 10.0), (MOP, 0.0, 4.0), edges=[(0, 1, "start")])
    scenario.begins(0)
    assert "order" not in kinds(ask(scenario, MOP))


def test_behind_steps_that_wait_it_names_the_one_that_runs(scenario: RobotScenario) -> None:
    scenario.runs(RUNNING, ["(tidy kitchen)"])
    scenario.plans(
        (DRIVE, 0.0, 10.0),
        ("(drive d2 kitchen attic)", 10.0, 10.0),
        ("(mop attic)", 20.0, 4.0),
        edges=[(0, 1), (1, 2)],
    )
    scenario.begins(0)
    orders = [claim.text for claim in ask(scenario, "(mop attic)").claims if claim.kind == "order"]
    assert ["drive d2" in orders[0], "drive d1" in orders[1]] == [True, True]
    assert "has not begun" in orders[0] and "has run since" in orders[1]


def test_a_condition_that_a_timed_fact_makes_true(scenario: RobotScenario) -> None:
    scenario.changes("/door_sensor", remove=["(open d1)"])
    scenario.runs(RUNNING, ["(tidy kitchen)"])
    scenario.plans((DRIVE, 0.0, 10.0))
    opens = Change("+", "(open d1)", "", scenario.now + 60.0)
    answer = ask(scenario, "", opens, Change("+", "(open d2)", "", scenario.now + 30.0))
    assert kinds(answer) == ["condition", "timed"]
    assert f"by itself at {clock_text(opens.at)}" in answer.sentence
    assert kinds(ask(scenario)) == ["condition"]


@pytest.mark.parametrize(("battery", "shown"), [(2.0, "2"), (4.9999999, "4.9999999")])
def test_a_number_that_is_too_low(scenario: RobotScenario, battery: float, shown: str) -> None:
    scenario.changes("/battery", battery=battery)
    scenario.runs(RUNNING, ["(tidy kitchen)"])
    scenario.plans((DRIVE, 0.0, 10.0))
    (claim,) = ask(scenario).claims
    assert "(>= (battery) 5)" in claim.text
    assert [each.text for each in claim.evidence][1] == f"(= (battery) {shown})"


def test_a_breakpoint_holds_a_step(scenario: RobotScenario) -> None:
    scenario.plans((DRIVE, 0.0, 10.0))
    scenario.runs(RUNNING, ["(tidy kitchen)"], held=DRIVE)
    assert kinds(ask(scenario)) == ["held"]


def test_a_robot_that_takes_no_actions(scenario: RobotScenario) -> None:
    scenario.plans((DRIVE, 0.0, 10.0))
    scenario.runs(RUNNING, ["(tidy kitchen)"])
    scenario.model.tree.set("robots", "parameters", {"drive": "d"})
    scenario.model.tree.set("robots", "robots", "d1", {"away": "its host is silent"})
    scenario.record()
    assert "robot d1 takes no actions: its host is silent" in ask(scenario).sentence


def test_a_step_that_does_not_wait(scenario: RobotScenario) -> None:
    drive(scenario)
    assert "does not wait: it has run since" in ask(scenario, DRIVE).sentence
    scenario.succeeds(0)
    assert "does not wait: it has succeeded" in ask(scenario, DRIVE).sentence


def queued(**fields: Any) -> Any:
    return {"request": NEXT, "goals": ["(tidy attic)"], "priority": 1, **fields}


def test_a_request_waits_for_the_one_that_runs(scenario: RobotScenario) -> None:
    drive(scenario, priority=1, expected_end=BEGIN + 14.0)
    scenario.queues(queued(expected_begin=BEGIN + 14.0))
    answer = ask(scenario, "(tidy attic)")
    assert kinds(answer) == ["request", "estimate"]
    assert f"“(tidy kitchen)” has to end first, expected at {clock_text(BEGIN + 14)}" in answer.sentence
    assert ask(scenario, NEXT) == answer


@pytest.mark.parametrize("kept", ["", f"waits until {DRIVE} can be interrupted"])
def test_a_more_urgent_request_is_not_said_to_stop_what_cannot_be_interrupted(
    scenario: RobotScenario, kept: str
) -> None:
    drive(scenario, priority=1)
    scenario.queues({**queued(waits=kept), "priority": 5})
    reported = "cannot be interrupted now" if kept else "is being stopped"
    assert f"is less urgent, and {reported}" in ask(scenario, "(tidy attic)").sentence


def test_a_request_waits_for_its_time_and_for_more_urgent_ones(scenario: RobotScenario) -> None:
    other = {"request": "/door-1-2.0", "goals": ["(tidy hall)"], "priority": 5}
    scenario.runs()
    scenario.queues(other, queued(not_before=BEGIN + 100.0))
    answer = ask(scenario, "(tidy attic)")
    assert kinds(answer) == ["time", "request"]
    assert "it is more urgent" in answer.claims[1].text
    scenario.wait(200.0)
    assert kinds(ask(scenario, "(tidy attic)")) == ["request"]


@pytest.mark.parametrize(
    "kind, fields, words",
    [
        ("guard", {"waits": "the base is held by Ana since 14:03"}, "the base is held by Ana"),
        ("paused", {"paused": True}, "until it is resumed"),
        ("held", {"held": "(tidy attic)"}, "a breakpoint holds “(tidy attic)”"),
    ],
)
def test_what_keeps_every_request(scenario: RobotScenario, kind: str, fields: Any, words: str) -> None:
    scenario.runs(**fields)
    scenario.queues(queued())
    answer = ask(scenario)
    assert kinds(answer) == [kind]
    assert words in answer.sentence


def test_of_a_past_moment(scenario: RobotScenario) -> None:
    drive(scenario)
    scenario.wait(20.0)
    scenario.succeeds(0)
    scenario.begins(1)
    assert "“(mop kitchen)” has waited" in ask(scenario, seconds=2.0).sentence
    assert ask(scenario).sentence.startswith("Nothing waits")
    with pytest.raises(QuestionError, match="the recording is of"):
        ask(scenario, seconds=-100.0)


def test_what_is_not_there_cannot_wait(scenario: RobotScenario) -> None:
    drive(scenario)
    for about, words in (
        ("(mop attic)", "is neither in the plan nor in the queue"),
        ("(tidy kitchen)", "its request runs"),
        ("mop", "is not PDDL"),
    ):
        with pytest.raises(QuestionError, match=words):
            ask(scenario, about)
