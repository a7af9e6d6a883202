# SPDX-License-Identifier: Apache-2.0
"""What is done, when it ends, and how sure that is."""

from typing import List

import pytest
from merlin_msgs.msg import QueuedGoal
from robot_story import BEGIN, RobotStory

from merlin_explain.claims import Answer, QuestionError, Words
from merlin_explain.execution.doing import doing
from merlin_explain.execution.moment import clock
from merlin_explain.execution.waiting import waiting

REQUEST = "/mission-1-5.0"
DRIVE, MOP = "(drive d1 hall kitchen)", "(mop kitchen)"


def ask(story: RobotStory, about: str = "") -> Answer:
    return doing(story.moment(), about, Words())


def kinds(answer: Answer) -> List[str]:
    return [claim.kind for claim in answer.claims]


def drive(story: RobotStory) -> None:
    story.runs(REQUEST, ["(tidy kitchen)"], expected_end=BEGIN + 14.0)
    story.plans((DRIVE, 0.0, 10.0), (MOP, 10.0, 4.0), edges=[(0, 1)])
    story.begins(0)
    story.wait(2.0)


def test_before_a_step_has_ended_the_plan_is_all_there_is(story: RobotStory) -> None:
    drive(story)
    answer = ask(story)
    assert kinds(answer) == ["doing", "running", "estimate", "sureness"]
    assert (
        f"It is expected to end at {clock(BEGIN + 14)}; no step of its plan has ended yet" in answer.sentence
    )
    assert "for “kitchen tidy”" in answer.sentence


def test_the_pace_of_the_steps_says_how_sure_it_is(story: RobotStory) -> None:
    drive(story)
    story.wait(13.0)
    story.succeeds(0)
    story.runs(REQUEST, ["(tidy kitchen)"], expected_end=BEGIN + 25.3)
    answer = ask(story)
    assert "one step has taken 1.5 times the planned time" in answer.sentence
    assert f"at that pace it ends at {clock(BEGIN + 30)}." in answer.sentence


def test_an_estimate_that_has_passed_is_not_one(story: RobotStory) -> None:
    drive(story)
    story.wait(20.0)
    assert "that was 8 s ago: it is late" in ask(story).sentence


def test_requests_that_run_in_one_plan(story: RobotStory) -> None:
    joined = QueuedGoal(request="/tablet-1", goals=["(wet kitchen)"])
    story.runs(REQUEST, ["(tidy kitchen)"], together=[joined])
    story.plans((DRIVE, 0.0, 10.0), (MOP, 10.0, 4.0), edges=[(0, 1)])
    story.begins(0)
    story.queues({"request": "/tablet-2", "goals": ["(at attic)"]})
    assert ask(story, "(wet kitchen)").sentence == ask(story).sentence
    with pytest.raises(QuestionError, match="does not wait: its request runs"):
        waiting(story.moment(), "(wet kitchen)", Words())
    queued = waiting(story.moment(), "(at attic)", Words())
    assert "“(tidy kitchen) and (wet kitchen)” has to end first" in queued.sentence
    assert "(wet kitchen), /tablet-1" in [each.text for each in queued.claims[0].evidence]


def test_a_plan_without_durations(story: RobotStory) -> None:
    story.runs(REQUEST, ["(tidy kitchen)"])
    story.plans((DRIVE, 0.0, 0.0))
    story.begins(0)
    assert "its plan has no durations" in ask(story).sentence


def test_when_another_request_comes(story: RobotStory) -> None:
    drive(story)
    story.queues({"request": "/tablet-1-6.0", "goals": ["(tidy attic)"], "expected_begin": BEGIN + 14.0})
    assert f"expected to begin at {clock(BEGIN + 14)}" in ask(story, "(tidy attic)").sentence
    with pytest.raises(QuestionError, match="is neither in the plan nor in the queue"):
        ask(story, "(tidy hall)")


def test_idle(story: RobotStory) -> None:
    story.runs()
    answer = ask(story)
    assert (answer.sentence, kinds(answer)) == ("Idle.", ["doing"])
