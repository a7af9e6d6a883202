# SPDX-License-Identifier: Apache-2.0
"""Failures whose causes are known: the answer names the right part, and says nothing that is not so."""

from typing import Callable, List, NamedTuple

import pytest
from merlin_msgs.msg import ExecuteResult, PlannerStatus
from robot_scenario import BRIDGES, RobotScenario

from merlin_explain.claims import Answer, QuestionError, Words
from merlin_explain.execution.failed import failed
from merlin_monitor.state.history_events import Event

REQUEST = "/mission-1-5.0"
GOAL = "(tidy kitchen)"
DRIVE = "(drive d1 hall kitchen)"


def ask(scenario: RobotScenario, about: str = "", seconds: float = 0.0) -> Answer:
    past = scenario.past(seconds)
    try:
        return failed(past.moment(), past, about, Words())
    finally:
        past.close()


def kinds(answer: Answer) -> List[str]:
    return [claim.kind for claim in answer.claims]


def begin(scenario: RobotScenario) -> None:
    scenario.runs(REQUEST, [GOAL])
    scenario.wait(1.0)
    scenario.plans((DRIVE, 0.0, 10.0), ("(mop kitchen)", 10.0, 4.0), edges=[(0, 1)])
    scenario.begins(0)
    scenario.wait(2.0)


def fail(scenario: RobotScenario, reason: str) -> None:
    begin(scenario)
    scenario.fails(0, reason)
    scenario.dispatch_ended(DRIVE, f"{DRIVE} failed: {reason}")
    scenario.ends(REQUEST, ExecuteResult.ACTION_FAILED, f"{DRIVE} failed: {reason}")
    scenario.runs()


def server_aborts(scenario: RobotScenario) -> None:
    fail(scenario, "/move_base aborted: no valid plan found")


def server_refuses(scenario: RobotScenario) -> None:
    fail(scenario, "/move_base refused the goal: the goal is outside of the map")


def server_is_missing(scenario: RobotScenario) -> None:
    fail(scenario, "no action server /move_base within 5 s")


def server_hangs(scenario: RobotScenario) -> None:
    fail(scenario, "the action server /move_base has been silent for 7.1 s")


def takes_too_long(scenario: RobotScenario) -> None:
    fail(scenario, f"{DRIVE} did not end within 60 s and was stopped")


def door_closes(scenario: RobotScenario) -> None:
    begin(scenario)
    scenario.changes("/door_sensor", remove=["(open d1)"])
    scenario.fails(0, "cancelled")
    reason = f"the plan no longer fits: {DRIVE}: (open d1) does not hold"
    scenario.dispatch_ended(DRIVE, reason)
    scenario.ends(REQUEST, ExecuteResult.ACTION_FAILED, reason)
    scenario.runs()


def client_cancels(scenario: RobotScenario) -> None:
    begin(scenario)
    scenario.cancels("/tablet", REQUEST)
    scenario.fails(0, "cancelled")
    scenario.ends(REQUEST, ExecuteResult.CANCELLED, "cancelled by its client")
    scenario.runs()


def more_urgent(scenario: RobotScenario) -> None:
    begin(scenario)
    scenario.fails(0, "cancelled")
    scenario.ends(REQUEST, ExecuteResult.DROPPED, "interrupted by a more urgent request")
    scenario.runs()


def no_plan(scenario: RobotScenario) -> None:
    scenario.runs(REQUEST, [GOAL])
    scenario.ends(
        REQUEST, ExecuteResult.UNSOLVABLE, "there is no plan: no action can make (tidy kitchen) true"
    )
    scenario.runs()


def late(scenario: RobotScenario) -> None:
    begin(scenario)
    scenario.fails(0, "cancelled")
    scenario.ends(REQUEST, ExecuteResult.LATE, "late: its goals do not hold by its deadline 14:03")
    scenario.runs()


class Label(NamedTuple):
    provoke: Callable[[RobotScenario], None]
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
def test_the_answer_names_the_part_that_failed(scenario: RobotScenario, label: Label) -> None:
    label.provoke(scenario)
    answer = ask(scenario)
    assert answer.claims[0].kind == label.part
    assert label.words in answer.sentence
    assert all(claim.evidence for claim in answer.claims)


def test_from_the_words_of_the_server_to_the_goal(scenario: RobotScenario) -> None:
    begin(scenario)
    scenario.machine("/DRIVE", "GO", into="GO")
    scenario.wait(1.0)
    scenario.machine("/DRIVE", "GO", outcome="aborted")
    scenario.fails(0, "/move_base aborted: no valid plan found")
    scenario.runs(
        REQUEST, [GOAL], replans=1, reason=f"{DRIVE} failed: /move_base aborted: no valid plan found"
    )
    scenario.wait(1.0)
    scenario.plans((DRIVE, 0.0, 10.0))
    scenario.begins(0)
    scenario.machine("/DRIVE", "GO", into="GO")
    scenario.wait(2.0)
    scenario.machine("/DRIVE", "GO", outcome="aborted")
    scenario.fails(0, "/move_base aborted: no valid plan found")
    scenario.ends(
        REQUEST,
        ExecuteResult.ACTION_FAILED,
        f"{DRIVE} failed: /move_base aborted: no valid plan found (2 times for the same reason)",
    )
    scenario.runs()
    answer = ask(scenario)
    assert kinds(answer) == ["server", "state", "action", "replan", "goal"]
    assert "DRIVE/GO ended with aborted" in answer.claims[1].text
    assert answer.sentence == (
        f"“{GOAL}” failed, after 1 new plan: “{DRIVE}” failed: "
        "the server /move_base aborted: “no valid plan found”."
    )


def test_a_state_that_is_heard_of_after_its_action_counts(scenario: RobotScenario) -> None:
    begin(scenario)
    scenario.machine("/DRIVE", "GO", into="GO")
    scenario.wait(1.0)
    scenario.fails(0, "/move_base aborted: no valid plan found")
    scenario.wait(0.2)
    scenario.machine("/DRIVE", "GO", outcome="aborted", late=0.25)
    scenario.wait(1.0)
    assert "state" in kinds(ask(scenario, DRIVE))
    scenario.machine("/DRIVE", "GO", into="GO")
    assert "state" in kinds(ask(scenario, DRIVE))


@pytest.mark.parametrize(("late", "known"), [(0.3, True), (1.5, True), (7.0, True), (30.0, False)])
def test_a_state_is_looked_for_in_later_frames(scenario: RobotScenario, late: float, known: bool) -> None:
    """Its topic may be slow; but what a machine says long after is not waited for."""
    begin(scenario)
    scenario.machine("/DRIVE", "GO", into="GO")
    scenario.wait(1.0)
    scenario.fails(0, "/move_base aborted: no valid plan found")
    scenario.wait(late)
    scenario.machine("/DRIVE", "GO", outcome="aborted", late=late + 0.05)  # it ended before its action
    scenario.wait(1.0)
    states = [claim.text for claim in ask(scenario, DRIVE).claims if claim.kind == "state"]
    assert states == (["state DRIVE/GO ended with aborted"] if known else [])


def test_a_fact_whose_difference_would_have_let_it_succeed(scenario: RobotScenario) -> None:
    scenario.changes(BRIDGES, battery=20.0)
    begin(scenario)
    # The start effect is taken back when the drive is given up.
    scenario.changes("/door_sensor", remove=["(open d1)"])
    closed = scenario.version
    scenario.fails(0, "cancelled")
    scenario.ends(
        REQUEST, ExecuteResult.ACTION_FAILED, f"the plan no longer fits: {DRIVE}: (open d1) does not hold"
    )
    answer = ask(scenario)
    reported = {claim.kind: claim for claim in answer.claims}
    assert "by /door_sensor" in reported["client"].text
    assert reported["client"].evidence[0].version == closed
    assert (
        reported["otherwise"].text
        == f"had “(open d1)” held, all conditions of “{DRIVE}” would have been true"
    )


def test_nothing_is_said_of_a_fact_that_would_not_have_been_enough(scenario: RobotScenario) -> None:
    begin(scenario)
    scenario.changes("/door_sensor", remove=["(open d1)", "(at hall)"])
    scenario.fails(0, "cancelled")
    scenario.ends(
        REQUEST, ExecuteResult.ACTION_FAILED, f"the plan no longer fits: {DRIVE}: (open d1) does not hold"
    )
    assert "otherwise" not in kinds(ask(scenario))


def test_the_cancel_names_its_client(scenario: RobotScenario) -> None:
    client_cancels(scenario)
    (first, *_) = ask(scenario).claims
    assert "/tablet cancels" in first.text
    assert [each.text for each in first.evidence][1] == "cancelled by its client"


@pytest.mark.parametrize("goal", ["(not (tidy kitchen))", "(>= (battery d1) 80)"])
def test_a_goal_that_is_more_than_a_fact_is_named_as_it_is(scenario: RobotScenario, goal: str) -> None:
    scenario.runs(REQUEST, [GOAL, goal])
    scenario.ends(REQUEST, ExecuteResult.NO_PLAN, "no plan was found")
    scenario.runs()
    for about in ("", goal):
        answer = ask(scenario, about)
        assert answer.sentence.startswith(f"“{GOAL} and {goal}” has no plan: ")
        assert f"“{GOAL} and {goal}” ended at " in answer.claims[-1].text


def test_a_planner_that_is_heard_after_its_request_is_not_another_failure(scenario: RobotScenario) -> None:
    said = {"planner": "kairos", "reason": "no action can make (tidy kitchen) true", "seconds": 0.2}
    scenario.model.plan.planner(PlannerStatus(state=PlannerStatus.RUNNING, **said), scenario.now)
    no_plan(scenario)
    scenario.model.plan.planner(PlannerStatus(state=PlannerStatus.UNSOLVABLE, **said), scenario.now)
    scenario.record()
    assert ask(scenario).sentence.startswith(f"“{GOAL}” has no plan: ")
    scenario.wait(5.0)
    scenario.model.plan.planner(PlannerStatus(state=PlannerStatus.TIMEOUT, **said), scenario.now)
    scenario.record()
    alone = ask(scenario)
    assert alone.sentence.startswith("No plan was found at ") and kinds(alone) == ["planner"]


def test_an_action_that_is_heard_after_its_request_is_not_a_later_failure(scenario: RobotScenario) -> None:
    reason = "/move_base aborted: no valid plan found"
    begin(scenario)
    scenario.ends(REQUEST, ExecuteResult.ACTION_FAILED, f"{DRIVE} failed: {reason}")
    scenario.runs()
    scenario.fails(0, reason)
    scenario.dispatch_ended(DRIVE, f"{DRIVE} failed: {reason}")
    scenario.record()
    whole = ask(scenario)
    assert whole.sentence.startswith(f"“{GOAL}” failed: ")
    assert kinds(whole) == ["server", "action", "goal"]
    assert ask(scenario, about=DRIVE) == whole


@pytest.mark.parametrize("stall", [1.0, 5.0])
@pytest.mark.parametrize("first", ["result", "feedback"])
def test_what_a_monitor_that_hangs_hears_later_belongs_together(
    scenario: RobotScenario, stall: float, first: str
) -> None:
    reason = "/move_base aborted: no valid plan found"
    begin(scenario)
    at = scenario.now
    scenario.now += stall
    if first == "feedback":  # which has no stamp: its time is when it is heard
        scenario.fails(0, reason)
    scenario.ends(REQUEST, ExecuteResult.ACTION_FAILED, f"{DRIVE} failed: {reason}", at=at)
    if first == "result":
        scenario.fails(0, reason)
    scenario.runs()
    whole = ask(scenario)
    assert whole.sentence.startswith(f"“{GOAL}” failed: ")
    assert kinds(whole) == ["server", "action", "goal"]
    assert ask(scenario, about=DRIVE) == whole


def test_an_action_of_the_next_request_is_the_later_failure(scenario: RobotScenario) -> None:
    begin(scenario)
    scenario.ends(REQUEST, ExecuteResult.ACTION_FAILED, "(mop attic) failed: it was silent")
    scenario.fails(0, "/move_base aborted: no valid plan found")
    assert kinds(ask(scenario)) == ["server", "action"]


def test_of_a_past_moment_the_failure_that_was_last_then(scenario: RobotScenario) -> None:
    server_aborts(scenario)
    scenario.wait(60.0)
    then = scenario.now - 30.0
    scenario.runs("/mission-2-9.0", ["(tidy attic)"])
    scenario.ends("/mission-2-9.0", ExecuteResult.UNSOLVABLE, "there is no way")
    assert "(tidy attic)" in ask(scenario).sentence
    assert "/move_base" in ask(scenario, seconds=then - 1_700_000_000.0).sentence
    assert "/move_base" in ask(scenario, about=GOAL).sentence


def test_where_nothing_has_failed_it_says_so(scenario: RobotScenario) -> None:
    begin(scenario)
    with pytest.raises(QuestionError, match="knows no failure of anything"):
        ask(scenario)
    server_aborts(scenario)
    with pytest.raises(QuestionError, match=r"knows no failure of \(tidy attic\)"):
        ask(scenario, about="(tidy attic)")


@pytest.mark.parametrize("about", ["tidy kitchen", "(tidy kitchen", "()"])
def test_what_is_no_pddl_is_refused(scenario: RobotScenario, about: str) -> None:
    with pytest.raises(QuestionError, match="is not PDDL"):
        ask(scenario, about)


def test_a_failure_is_found_behind_thousands_of_actions(scenario: RobotScenario) -> None:
    server_aborts(scenario)
    for number in range(1200):
        scenario.model.report(Event("action", f"(mop kitchen) succeeded, {number}", scenario.now, {}))
    scenario.wait(1.0)
    assert "/move_base aborted" in ask(scenario).sentence
