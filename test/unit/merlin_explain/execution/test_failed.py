# SPDX-License-Identifier: Apache-2.0
"""Failures whose causes are known: the answer names the right part, and says nothing that is not so."""

from typing import Callable, List, NamedTuple

import pytest
from merlin_msgs.msg import ExecuteResult, PlannerStatus
from robot_story import BRIDGES, RobotStory

from merlin_explain.claims import Answer, QuestionError, Words
from merlin_explain.execution.failed import failed
from merlin_monitor.state.history_events import Event

REQUEST = "/mission-1-5.0"
GOAL = "(tidy kitchen)"
DRIVE = "(drive d1 hall kitchen)"


def ask(story: RobotStory, about: str = "", seconds: float = 0.0) -> Answer:
    past = story.past(seconds)
    try:
        return failed(past.moment(), past, about, Words())
    finally:
        past.close()


def kinds(answer: Answer) -> List[str]:
    return [claim.kind for claim in answer.claims]


def begin(story: RobotStory) -> None:
    story.runs(REQUEST, [GOAL])
    story.wait(1.0)
    story.plans((DRIVE, 0.0, 10.0), ("(mop kitchen)", 10.0, 4.0), edges=[(0, 1)])
    story.begins(0)
    story.wait(2.0)


def fail(story: RobotStory, reason: str) -> None:
    begin(story)
    story.fails(0, reason)
    story.dispatch_ended(DRIVE, f"{DRIVE} failed: {reason}")
    story.ends(REQUEST, ExecuteResult.ACTION_FAILED, f"{DRIVE} failed: {reason}")
    story.runs()


def server_aborts(story: RobotStory) -> None:
    fail(story, "/move_base aborted: no valid plan found")


def server_refuses(story: RobotStory) -> None:
    fail(story, "/move_base refused the goal: the goal is outside of the map")


def server_is_missing(story: RobotStory) -> None:
    fail(story, "no action server /move_base within 5 s")


def server_hangs(story: RobotStory) -> None:
    fail(story, "the action server /move_base has been silent for 7.1 s")


def takes_too_long(story: RobotStory) -> None:
    fail(story, f"{DRIVE} did not end within 60 s and was stopped")


def door_closes(story: RobotStory) -> None:
    begin(story)
    story.changes("/door_sensor", remove=["(open d1)"])
    story.fails(0, "cancelled")
    reason = f"the plan no longer fits: {DRIVE}: (open d1) does not hold"
    story.dispatch_ended(DRIVE, reason)
    story.ends(REQUEST, ExecuteResult.ACTION_FAILED, reason)
    story.runs()


def client_cancels(story: RobotStory) -> None:
    begin(story)
    story.cancels("/tablet", REQUEST)
    story.fails(0, "cancelled")
    story.ends(REQUEST, ExecuteResult.CANCELLED, "cancelled by its client")
    story.runs()


def more_urgent(story: RobotStory) -> None:
    begin(story)
    story.fails(0, "cancelled")
    story.ends(REQUEST, ExecuteResult.DROPPED, "interrupted by a more urgent request")
    story.runs()


def no_plan(story: RobotStory) -> None:
    story.runs(REQUEST, [GOAL])
    story.ends(REQUEST, ExecuteResult.UNSOLVABLE, "there is no plan: no action can make (tidy kitchen) true")
    story.runs()


def late(story: RobotStory) -> None:
    begin(story)
    story.fails(0, "cancelled")
    story.ends(REQUEST, ExecuteResult.LATE, "late: its goals do not hold by its deadline 14:03")
    story.runs()


class Label(NamedTuple):
    provoke: Callable[[RobotStory], None]
    part: str
    words: str


LABELLED = [
    Label(server_aborts, "server", "the server /move_base aborted: “no valid plan found”"),
    Label(server_refuses, "server", "/move_base refused the goal: “the goal is outside of the map”"),
    Label(server_is_missing, "server", "the server /move_base was not there"),
    Label(server_hangs, "server", "the server /move_base has been silent for 7.1 s"),
    Label(takes_too_long, "time", "it took longer than it may"),
    Label(door_closes, "condition", "“(open d1)” does not hold"),
    Label(client_cancels, "client", "/tablet cancels"),
    Label(more_urgent, "request", "more urgent"),
    Label(no_plan, "planner", "there is no plan"),
    Label(late, "time", "deadline"),
]


@pytest.mark.parametrize("label", LABELLED, ids=lambda label: label.provoke.__name__)
def test_the_answer_names_the_part_that_failed(story: RobotStory, label: Label) -> None:
    label.provoke(story)
    answer = ask(story)
    assert answer.claims[0].kind == label.part
    assert label.words in answer.sentence
    assert all(claim.evidence for claim in answer.claims)


def test_from_the_words_of_the_server_to_the_goal(story: RobotStory) -> None:
    begin(story)
    story.machine("/DRIVE", "GO", into="GO")
    story.wait(1.0)
    story.machine("/DRIVE", "GO", outcome="aborted")
    story.fails(0, "/move_base aborted: no valid plan found")
    story.runs(REQUEST, [GOAL], replans=1, reason=f"{DRIVE} failed: /move_base aborted: no valid plan found")
    story.wait(1.0)
    story.plans((DRIVE, 0.0, 10.0))
    story.begins(0)
    story.machine("/DRIVE", "GO", into="GO")
    story.wait(2.0)
    story.machine("/DRIVE", "GO", outcome="aborted")
    story.fails(0, "/move_base aborted: no valid plan found")
    story.ends(
        REQUEST,
        ExecuteResult.ACTION_FAILED,
        f"{DRIVE} failed: /move_base aborted: no valid plan found (2 times for the same reason)",
    )
    story.runs()
    answer = ask(story)
    assert kinds(answer) == ["server", "state", "action", "replan", "goal"]
    assert "DRIVE/GO ended with aborted" in answer.claims[1].text
    assert answer.sentence == (
        f"“{GOAL}” failed, after 1 new plan: “{DRIVE}” failed: "
        "the server /move_base aborted: “no valid plan found”."
    )


def test_a_state_that_is_heard_of_after_its_action_counts(story: RobotStory) -> None:
    begin(story)
    story.machine("/DRIVE", "GO", into="GO")
    story.wait(1.0)
    story.fails(0, "/move_base aborted: no valid plan found")
    story.wait(0.2)
    story.machine("/DRIVE", "GO", outcome="aborted", late=0.25)
    story.wait(1.0)
    assert "state" in kinds(ask(story, DRIVE))
    story.machine("/DRIVE", "GO", into="GO")
    assert "state" in kinds(ask(story, DRIVE))


@pytest.mark.parametrize(("late", "known"), [(0.3, True), (1.5, True), (7.0, True), (30.0, False)])
def test_a_state_is_looked_for_in_later_frames(story: RobotStory, late: float, known: bool) -> None:
    """Its topic may be slow; but what a machine says long after is not waited for."""
    begin(story)
    story.machine("/DRIVE", "GO", into="GO")
    story.wait(1.0)
    story.fails(0, "/move_base aborted: no valid plan found")
    story.wait(late)
    story.machine("/DRIVE", "GO", outcome="aborted", late=late + 0.05)  # it ended before its action
    story.wait(1.0)
    states = [claim.text for claim in ask(story, DRIVE).claims if claim.kind == "state"]
    assert states == (["state DRIVE/GO ended with aborted"] if known else [])


def test_a_fact_whose_difference_would_have_let_it_succeed(story: RobotStory) -> None:
    story.changes(BRIDGES, battery=20.0)
    begin(story)
    # The start effect is taken back when the drive is given up.
    story.changes("/door_sensor", remove=["(open d1)"])
    closed = story.version
    story.fails(0, "cancelled")
    story.ends(
        REQUEST, ExecuteResult.ACTION_FAILED, f"the plan no longer fits: {DRIVE}: (open d1) does not hold"
    )
    answer = ask(story)
    told = {claim.kind: claim for claim in answer.claims}
    assert "by /door_sensor" in told["client"].text
    assert told["client"].evidence[0].version == closed
    assert told["otherwise"].text == f"had “(open d1)” held, all conditions of “{DRIVE}” would have been true"


def test_nothing_is_said_of_a_fact_that_would_not_have_been_enough(story: RobotStory) -> None:
    begin(story)
    story.changes("/door_sensor", remove=["(open d1)", "(at hall)"])
    story.fails(0, "cancelled")
    story.ends(
        REQUEST, ExecuteResult.ACTION_FAILED, f"the plan no longer fits: {DRIVE}: (open d1) does not hold"
    )
    assert "otherwise" not in kinds(ask(story))


def test_the_cancel_names_its_client(story: RobotStory) -> None:
    client_cancels(story)
    (first, *_) = ask(story).claims
    assert "/tablet cancels" in first.text
    assert [each.text for each in first.evidence][1] == "cancelled by its client"


def test_a_planner_that_is_heard_after_its_request_is_not_another_failure(story: RobotStory) -> None:
    said = {"planner": "kairos", "reason": "no action can make (tidy kitchen) true", "seconds": 0.2}
    story.model.plan.planner(PlannerStatus(state=PlannerStatus.RUNNING, **said), story.now)
    no_plan(story)
    story.model.plan.planner(PlannerStatus(state=PlannerStatus.UNSOLVABLE, **said), story.now)
    story.record()
    assert ask(story).sentence.startswith(f"“{GOAL}” has no plan: ")
    story.wait(5.0)
    story.model.plan.planner(PlannerStatus(state=PlannerStatus.TIMEOUT, **said), story.now)
    story.record()
    alone = ask(story)
    assert alone.sentence.startswith("No plan was found at ") and kinds(alone) == ["planner"]


def test_of_a_past_moment_the_failure_that_was_last_then(story: RobotStory) -> None:
    server_aborts(story)
    story.wait(60.0)
    then = story.now - 30.0
    story.runs("/mission-2-9.0", ["(tidy attic)"])
    story.ends("/mission-2-9.0", ExecuteResult.UNSOLVABLE, "there is no way")
    assert "(tidy attic)" in ask(story).sentence
    assert "/move_base" in ask(story, seconds=then - 1_700_000_000.0).sentence
    assert "/move_base" in ask(story, about=GOAL).sentence


def test_where_nothing_has_failed_it_says_so(story: RobotStory) -> None:
    begin(story)
    with pytest.raises(QuestionError, match="knows no failure of anything"):
        ask(story)
    server_aborts(story)
    with pytest.raises(QuestionError, match=r"knows no failure of \(tidy attic\)"):
        ask(story, about="(tidy attic)")


@pytest.mark.parametrize("about", ["tidy kitchen", "(tidy kitchen", "()"])
def test_what_is_no_pddl_is_refused(story: RobotStory, about: str) -> None:
    with pytest.raises(QuestionError, match="is not PDDL"):
        ask(story, about)


def test_a_failure_is_found_behind_thousands_of_actions(story: RobotStory) -> None:
    server_aborts(story)
    for number in range(1200):
        story.model.report(Event("action", f"(mop kitchen) succeeded, {number}", story.now, {}))
    story.wait(1.0)
    assert "/move_base aborted" in ask(story).sentence
