# SPDX-License-Identifier: Apache-2.0
"""What is done, when it ends, and how sure that is."""

from typing import List

import pytest
from merlin_msgs.msg import QueuedGoal
from robot_scenario import BEGIN, RobotScenario

from merlin_explain.claims import Answer, QuestionError, Words
from merlin_explain.execution.doing import doing
from merlin_explain.execution.waiting import waiting
from merlin_ros.work.passed_time import clock_text

REQUEST = "/mission-1-5.0"
DRIVE, MOP = "(drive d1 hall kitchen)", "(mop kitchen)"


def ask(scenario: RobotScenario, about: str = "") -> Answer:
    return doing(scenario.moment(), about, Words())


def kinds(answer: Answer) -> List[str]:
    return [claim.kind for claim in answer.claims]


def drive(scenario: RobotScenario) -> None:
    scenario.runs(REQUEST, ["(tidy kitchen)"], expected_end=BEGIN + 14.0)
    scenario.plans((DRIVE, 0.0, 10.0), (MOP, 10.0, 4.0), edges=[(0, 1)])
    scenario.begins(0)
    scenario.wait(2.0)


def test_before_a_step_has_ended_the_plan_is_all_there_is(scenario: RobotScenario) -> None:
    drive(scenario)
    answer = ask(scenario)
    assert kinds(answer) == ["doing", "running", "estimate", "sureness"]
    assert (
        f"It is expected to end at {clock_text(BEGIN + 14)}; no step of its plan has ended yet"
        in answer.sentence
    )
    assert "for “kitchen tidy”" in answer.sentence


def test_the_pace_of_the_steps_says_how_sure_it_is(scenario: RobotScenario) -> None:
    drive(scenario)
    scenario.wait(13.0)
    scenario.succeeds(0)
    scenario.runs(REQUEST, ["(tidy kitchen)"], expected_end=BEGIN + 25.3)
    answer = ask(scenario)
    assert "one step has taken 1.5 times the planned time" in answer.sentence
    assert f"at that pace it ends at {clock_text(BEGIN + 30)}." in answer.sentence


def test_an_estimate_that_has_passed_is_not_one(scenario: RobotScenario) -> None:
    drive(scenario)
    scenario.wait(20.0)
    assert "that was 8 s ago: it is late" in ask(scenario).sentence


def test_requests_that_run_in_one_plan(scenario: RobotScenario) -> None:
    joined = QueuedGoal(request="/tablet-1", goals=["(wet kitchen)"])
    scenario.runs(REQUEST, ["(tidy kitchen)"], together=[joined])
    scenario.plans((DRIVE, 0.0, 10.0), (MOP, 10.0, 4.0), edges=[(0, 1)])
    scenario.begins(0)
    scenario.queues({"request": "/tablet-2", "goals": ["(at attic)"]})
    assert ask(scenario, "(wet kitchen)").sentence == ask(scenario).sentence
    with pytest.raises(QuestionError, match="does not wait: its request runs"):
        waiting(scenario.moment(), "(wet kitchen)", Words())
    queued = waiting(scenario.moment(), "(at attic)", Words())
    assert "“(tidy kitchen) and (wet kitchen)” has to end first" in queued.sentence
    assert "(wet kitchen), /tablet-1" in [each.text for each in queued.claims[0].evidence]


def test_a_plan_without_durations(scenario: RobotScenario) -> None:
    scenario.runs(REQUEST, ["(tidy kitchen)"])
    scenario.plans((DRIVE, 0.0, 0.0))
    scenario.begins(0)
    assert "its plan has no durations" in ask(scenario).sentence


def test_when_another_request_comes(scenario: RobotScenario) -> None:
    drive(scenario)
    scenario.queues({"request": "/tablet-1-6.0", "goals": ["(tidy attic)"], "expected_begin": BEGIN + 14.0})
    assert f"expected to begin at {clock_text(BEGIN + 14)}" in ask(scenario, "(tidy attic)").sentence
    with pytest.raises(QuestionError, match="is neither in the plan nor in the queue"):
        ask(scenario, "(tidy hall)")


def test_idle(scenario: RobotScenario) -> None:
    scenario.runs()
    answer = ask(scenario)
    assert (answer.sentence, kinds(answer)) == ("Idle.", ["doing"])
