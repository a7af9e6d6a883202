# SPDX-License-Identifier: Apache-2.0
"""Requests that wait are planned ahead: when each is done, which is late, and for what it is left out."""

import math
import threading
from typing import Any, Callable, Dict, Iterator, List

import pytest
import rospy
from diagnostic_msgs.msg import KeyValue
from merlin_msgs.msg import PlannerStatus, RunningAction
from merlin_msgs.srv import PreviewPlanResponse
from rosplan_dispatch_msgs.msg import ActionDispatch
from test_executor import Bench as ExecutorBench
from test_executor import Goal

from merlin_executor.core.outcome import Outcome, Verdict
from merlin_executor.node import executor as executor_module
from merlin_test import LONG


class Bench(ExecutorBench):
    """An Executor and a planner of the test's."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.published = threading.Condition()  # guards the messages
        self.previews: List[dict] = []  # what the planner was asked
        self.answers: List[PreviewPlanResponse] = []  # of the planner; then it does not answer
        self.takes: Dict[str, float] = {}  # goal -> s, in place of these answers
        self.asked, self.may_answer = threading.Event(), threading.Event()
        self.may_answer.set()
        super().__init__(monkeypatch)
        monkeypatch.setattr(executor_module, "publish", self.publish)

    def preview(self, **fields: Any) -> PreviewPlanResponse:
        self.previews.append(fields)
        self.asked.set()
        assert self.may_answer.wait(LONG)
        if self.takes:  # every errand takes its time, from wherever it begins
            (due,) = fields["deadlines"]
            seconds = self.takes[due.goals[0]]
            late = seconds > due.within
            state = PlannerStatus.UNSOLVABLE if late else PlannerStatus.SOLVED
            return planned(*[] if late else [seconds], state=state, reached=seconds)
        return self.answers.pop(0) if self.answers else super().preview()

    def publish(self, publisher: Any, message: Any) -> None:
        with self.published:
            self.statuses.append(message)
            self.published.notify_all()

    def queue_when(self, fits: Callable[[List[Any]], Any]) -> List[Any]:
        """The first queue that fits."""
        with self.published:
            found: List[List[Any]] = []

            def look() -> bool:
                queues = (each.requests for each in self.statuses if hasattr(each, "requests"))
                found[:] = [queue for queue in queues if fits(queue)]
                return bool(found)

            assert self.published.wait_for(look, LONG), self.statuses[-3:]
            return found[0]


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    made = Bench(monkeypatch)
    yield made
    made.executor.shutdown()


def planned(*seconds: float, state: int = PlannerStatus.SOLVED, reached: float = -1.0) -> PreviewPlanResponse:
    """A plan of actions that follow each other."""
    starts = [sum(seconds[:number]) for number in range(len(seconds))]
    reached = sum(seconds) if reached < 0.0 else reached
    actions = [f"(drive a{number})" for number in range(len(seconds))]
    return PreviewPlanResponse(
        status=PlannerStatus(state=state),
        actions=actions,
        starts=starts,
        durations=list(seconds),
        reached=[reached],
        late=[0.0],
    )


def test_when_a_request_that_waits_will_be_done_is_said_before_it_begins(bench: Bench) -> None:
    bench.run(Goal("(checked kitchen)"))
    step = ActionDispatch(
        name="drive", dispatch_time=0.0, duration=60.0, parameters=[KeyValue("to", "kitchen")]
    )
    bench.machine.running[0].take_plan([step])  # it is expected to end at 61
    bench.answers = [
        planned(30.0, 5.0),
        planned(95.0),
        planned(state=PlannerStatus.UNSOLVABLE, reached=95.0),
        planned(20.0),
        PreviewPlanResponse(status=PlannerStatus(state=PlannerStatus.TIMEOUT)),
    ]
    bench.send(Goal("(checked hall)", deadline=rospy.Time(100)))
    queued = bench.queue_when(lambda queue: bool(queue and queue[0].expected_end.to_sec()))[0]
    assert (queued.expected_begin, queued.expected_end, queued.late) == (rospy.Time(61), rospy.Time(96), "")
    asked = bench.previews[0]
    assert (asked["after"], asked["then"]) == ([], ["(drive kitchen)"])
    assert [(due.goals, due.within) for due in asked["deadlines"]] == [(["(checked hall)"], math.inf)]

    hopeless = bench.send(Goal("(not (checked hall))", deadline=rospy.Time(90)))
    queued = bench.queue_when(lambda queue: len(queue) > 1 and bool(queue[0].late))[0]
    late = "cannot be done before its deadline 90.0 s: needs 95 s from 61.0 s on"
    assert (queued.late, hopeless.reported, hopeless.ends) == (late, [late], [])
    assert [asked["deadlines"][0].within for asked in bench.previews[1:]] == [math.inf, 29.0]

    bench.send(Goal("(checked kitchen)", "(checked hall)", deadline=rospy.Time(140)))
    queued = bench.queue_when(lambda queue: len(queue) > 2 and bool(queue[2].expected_end.to_sec()))[2]
    assert (queued.expected_begin, queued.expected_end) == (rospy.Time(96), rospy.Time(116))
    assert bench.previews[3]["then"] == ["(drive kitchen)", "(drive a0)", "(drive a1)"]

    unknown = bench.send(Goal("(checked hall)", deadline=rospy.Time(150)))
    with bench.published:  # the planner has not found out, which is no proof
        assert bench.published.wait_for(lambda: not bench.answers, LONG)
    assert unknown.reported == [] and len(bench.previews) == 5


def test_where_not_all_can_be_in_time_the_most_are_and_the_others_say_for_what(bench: Bench) -> None:
    bench.run(Goal("(checked kitchen)"))
    bench.machine.running[0].take_plan([ActionDispatch(name="drive", duration=60.0)])  # until 61
    bench.takes = {"(checked kitchen)": 35.0, "(checked hall)": 15.0, "(not (checked hall))": 16.0}
    bench.may_answer.clear()  # two of them are too many, too: then the third one changes no reason
    long = bench.send(Goal("(checked kitchen)", deadline=rospy.Time(100)))
    goals = [["(checked hall)"], ["(not (checked hall))"]]
    short = [bench.send(Goal(*each, deadline=rospy.Time(110))) for each in goals]
    bench.may_answer.set()
    queue = bench.queue_when(
        lambda queue: (
            len(queue) == 3
            and queue[-1].late.startswith("there is no")
            and bool(queue[1].expected_end.to_sec())
        )
    )
    assert [each.goals for each in queue] == [*goals, ["(checked kitchen)"]]
    assert [each.expected_end for each in queue[:2]] == [rospy.Time(76), rospy.Time(92)]
    assert [each.late for each in queue[:2]] == ["", ""] and short[1].reported[-1:] in ([], [""])
    preferred = "there is no time for it (preferred: (checked hall), (not (checked hall)))"
    assert queue[2].late == long.reported[-1] == preferred
    for _ in (*short, long):  # all the same it waits, and begins when there is nothing else
        bench.machine.end(Verdict(Outcome.SUCCEEDED))
        assert bench.machine.begun.acquire(timeout=LONG)
    bench.machine.end(Verdict(Outcome.LATE, "cannot be in time"))
    assert [goal.end()[1] for goal in (*short, long)] == ["SUCCEEDED", "SUCCEEDED", "LATE"]


def test_of_a_parallel_plan_that_is_still_to_come_which_has_not_begun(bench: Bench) -> None:
    bench.run(Goal("(checked kitchen)"))
    steps = [ActionDispatch(action_id=number, name=f"step{number}", duration=60.0) for number in range(4)]
    bench.machine.running[0].take_plan(steps)
    bench.dispatcher.succeeded = frozenset({2})
    bench.dispatcher.running = [RunningAction(action_id=0, name="step0")]
    bench.takes = {"(checked hall)": 20.0}
    bench.send(Goal("(checked hall)", deadline=rospy.Time(900)))
    bench.queue_when(lambda queue: bool(queue and queue[0].expected_end.to_sec()))
    assert (bench.previews[0]["after"], bench.previews[0]["then"]) == (["(step0)"], ["(step1)", "(step3)"])


def test_what_the_planner_did_not_find_out_is_asked_again_when_an_action_has_ended(bench: Bench) -> None:
    bench.run(Goal("(checked kitchen)"))
    bench.machine.running[0].take_plan([ActionDispatch(name="drive", duration=60.0)])
    bench.answers = [PreviewPlanResponse(status=PlannerStatus(state=PlannerStatus.TIMEOUT)), planned(20.0)]
    bench.send(Goal("(checked hall)", deadline=rospy.Time(900)))
    with bench.published:
        assert bench.published.wait_for(lambda: len(bench.answers) == 1, LONG)
    bench.pause(False)  # any event
    bench.dispatcher.succeeded = frozenset({0})
    while not bench.queue()[0].expected_end.to_sec():
        bench.pause(False)
    assert len(bench.previews) == 2


def test_one_that_is_worth_more_than_the_others_together_is_preferred(bench: Bench) -> None:
    bench.run(Goal("(checked kitchen)"))
    bench.machine.running[0].take_plan([ActionDispatch(name="drive", duration=60.0)])  # until 61
    bench.takes = {"(checked kitchen)": 35.0, "(checked hall)": 15.0, "(not (checked hall))": 16.0}
    bench.send(Goal("(checked kitchen)", deadline=rospy.Time(100), value=2.5))
    for goal in ("(checked hall)", "(not (checked hall))"):
        bench.send(Goal(goal, deadline=rospy.Time(110)))
    left_out = "there is no time for it (preferred: (checked kitchen))"
    queue = bench.queue_when(lambda queue: [each.late for each in queue] == ["", left_out, left_out])
    assert queue[0].goals == ["(checked kitchen)"]


def test_without_a_deadline_nothing_is_planned_ahead(bench: Bench) -> None:
    bench.run(Goal("(checked kitchen)"))
    bench.machine.running[0].take_plan([ActionDispatch(name="drive", duration=60.0)])
    bench.send(Goal("(checked hall)"))
    bench.send(Goal("(checked hall)", not_before=rospy.Time(500)))
    bench.pause(False)
    assert bench.previews == []


def test_a_planning_system_without_previews_is_no_fault(bench: Bench) -> None:
    bench.run(Goal("(checked kitchen)"))
    bench.machine.running[0].take_plan([ActionDispatch(name="drive", duration=60.0)])
    second = bench.send(Goal("(checked hall)", deadline=rospy.Time(100)))
    bench.machine.end(Verdict(Outcome.SUCCEEDED))
    assert bench.machine.begun.acquire(timeout=LONG)
    bench.machine.end(Verdict(Outcome.SUCCEEDED))
    assert second.end()[1] == "SUCCEEDED" and second.reported == []


def test_an_answer_to_a_question_about_what_did_not_come_about_is_dropped(bench: Bench) -> None:
    first = bench.run(Goal("(checked kitchen)"))
    bench.machine.running[0].take_plan([ActionDispatch(name="drive", duration=60.0)])
    bench.takes = {"(checked hall)": 20.0}
    bench.may_answer.clear()
    bench.send(Goal("(checked hall)", not_before=rospy.Time(50), deadline=rospy.Time(100)))
    assert bench.asked.wait(LONG)
    bench.asked.clear()
    bench.machine.end(Verdict(Outcome.ACTION_FAILED, "it failed"))
    assert first.end()[1] == "ACTION_FAILED"
    bench.may_answer.set()
    assert bench.asked.wait(LONG), "it is planned anew, from where the robot is now"
    (queued,) = bench.queue_when(lambda queue: bool(queue and queue[0].expected_end.to_sec()))
    assert (queued.expected_begin, queued.expected_end) == (rospy.Time(50), rospy.Time(70))
