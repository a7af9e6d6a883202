# SPDX-License-Identifier: Apache-2.0
"""The Executor's machine over a planning system that hangs, loses goals, and comes back."""

import contextlib
import threading
from types import SimpleNamespace
from typing import Any, Callable, List, Optional, Sequence

import pytest
import rospy
from merlin_msgs.msg import GoalDeadline
from rosplan_dispatch_msgs.msg import ActionDispatch

from merlin_executor.core.course import Course
from merlin_executor.core.outcome import Outcome, Stop, StopKind, Verdict
from merlin_executor.core.time_window import ALWAYS, TimeWindow
from merlin_executor.node import executor_stages
from merlin_executor.node.executor_sm import ExecutorSM
from merlin_executor.node.executor_stages import GOALS_GONE
from merlin_executor.node.joint_run import PlanningSystem
from merlin_executor.node.robot_return import RobotReturn
from merlin_planning.dispatch_progress import DispatchResult
from merlin_planning.knowledge_text import parse_goal, to_pddl
from merlin_planning.planning_client import Planned, PlanningResult
from merlin_ros.call_scope import current_scope
from merlin_ros.service_proxy import ServiceUnavailable
from merlin_sm.state_factory import MerlinStateFactory
from merlin_test import LONG

KITCHEN = parse_goal("(checked kitchen)")


class Wanted(SimpleNamespace):
    """A request."""

    __hash__ = object.__hash__  # type: ignore[assignment]


class Knowledge:
    """A knowledge base of which some calls hang until they are given up."""

    def __init__(self) -> None:
        self.hanging = ""
        self.hangs = threading.Event()
        self.stored: List[Any] = []
        self.true = False
        self.facts: List[str] = []

    def call(self, name: str) -> None:
        if name != self.hanging:
            return
        given_up = threading.Event()
        with current_scope().calling(given_up.set):
            self.hangs.set()
            assert given_up.wait(LONG), "it was waited for"
            raise ServiceUnavailable(f"service {name} does not answer: given up")

    def query(self, items: List[Any]) -> List[bool]:
        self.call("query")
        return [self.true or to_pddl(item) in self.facts for item in items]

    def goals(self) -> List[Any]:
        self.call("goals")
        return list(self.stored)

    def add(self, items: List[Any]) -> None:
        self.call("add")
        self.stored += items

    def remove(self) -> None:
        self.call("remove")
        self.stored.clear()


class Own:
    """The Executor's goals."""

    def __init__(self, knowledge: Knowledge) -> None:
        self._knowledge = knowledge
        self.left = False

    def add(self, items: List[Any]) -> None:
        self.left = True
        self._knowledge.add(items)

    def remove(self) -> None:
        if self.left:
            self._knowledge.remove()
            self.left = False

    def keep(self, items: List[Any]) -> None:
        if not items:
            self.remove()


class Bench:
    """A machine over a planning system that always finds a plan, which always succeeds."""

    def __init__(self) -> None:
        self.knowledge = Knowledge()
        self.own = Own(self.knowledge)
        self.on_dispatch: Any = lambda: None
        self.troubles: List[str] = []  # that keep the planning system from rest
        self.dispatched = 0
        self.results: List[DispatchResult] = []  # of the next dispatches; then they succeed
        self.without: List[List[str]] = []  # of each planning
        self.unsolvable = False  # when something is left out
        self.deadlines: List[GoalDeadline] = []  # with which it was planned
        self.in_time = PlanningResult(Planned.SOLVED)  # then
        self.held = False
        self.plan: List[ActionDispatch] = []
        self.waited_standing = False
        self.waits, self.woken = threading.Event(), threading.Event()
        self.now = 0.0  # s of running time, where a test counts it
        self.ended: List[tuple] = []  # before the run
        self.newcomers: List[str] = []
        self.planned_for: List[List[str]] = []
        self.patience: List[float] = []  # s for which the planning system was waited for
        planning = SimpleNamespace(
            read_ahead=lambda: None,
            generate_problem=lambda: None,
            plan=self._plan,
            plan_text="0.000: (check kitchen) [95.000]",
            parse_plan=lambda: self.plan,
            wait_back=self._wait_back,
        )
        self.dispatcher = SimpleNamespace(
            dispatch=self._dispatch,
            available=lambda: not self.troubles,
            steps_done=0,
            hand_over=lambda owner: None,
        )
        recovery = SimpleNamespace(rest=self._rest)
        robots = RobotReturn(self.knowledge, [], 0.1)  # type: ignore[arg-type]
        parts: Any = self.knowledge, planning, self.dispatcher, recovery, self, robots, 0.1
        self.machine = ExecutorSM(
            PlanningSystem(*parts),
            self.own,  # type: ignore[arg-type]
            lambda: None,
            lambda: self,  # type: ignore[arg-type, return-value]
        )
        self.request = self.make_request(KITCHEN, Course(3))
        self.requests: List[Any] = [self.request]

    def make_request(self, items: List[Any], course: Course) -> Any:
        goal = SimpleNamespace(id="goal")
        request = Wanted(course=course, items=items, plan=[], stop=None, goal=goal, window=ALWAYS)
        request.due = lambda begin: GoalDeadline(list(map(to_pddl, items)), request.window.deadline - begin)

        def take_plan(actions: Any, reached: Optional[float]) -> None:
            request.plan, request.reached = list(actions), reached

        request.take_plan = take_plan
        return request

    def joined_by(self, *goals: str) -> None:
        """Further requests that run in the same plan."""
        self.requests += [self.make_request(parse_goal(goal), self.request.course) for goal in goals]

    # --- the requests

    def achieved(self, requests: List[Any], verdict: Verdict) -> None:
        self.ended += [(request, verdict.outcome) for request in requests]

    def planned_again(self) -> List[Any]:
        self.joined_by(*self.newcomers)
        return [each for each in self.requests if each not in [ended for ended, _ in self.ended]]

    def revision(self) -> List[Any]:
        return []

    # --- the guards

    def wait_standing(self) -> bool:
        self.waited_standing = True
        return True

    def brake(self, reason: str) -> None:
        pass

    def wait_released(self, stopped: Callable[[], bool]) -> None:
        while self.held and not stopped():
            self.waits.set()
            assert self.woken.wait(LONG)
            self.woken.clear()

    def wake(self) -> None:
        self.woken.set()

    def _rest(self, interruptible: Any) -> str:
        self.knowledge.call("executions")
        return self.troubles[0] if self.troubles else ""

    def _wait_back(self, timeout: float, cancelled: threading.Event, missing: Any) -> str:
        assert missing()
        self.patience.append(timeout)
        self.now += 0.02
        self.troubles.pop()
        return str(missing())

    def _dispatch(self, *_: Any) -> DispatchResult:
        self.dispatched += 1
        self.on_dispatch()
        if self.results:
            return self.results.pop(0)
        self.knowledge.true = self.knowledge.true or bool(self.knowledge.stored)
        return DispatchResult(True)

    def _plan(self, _: Any, without: Sequence[str], deadlines: Sequence[Any] = ()) -> PlanningResult:
        if deadlines:
            self.deadlines = list(deadlines)
            return self.in_time
        self.without.append(list(without))
        self.planned_for.append(list(map(to_pddl, self.knowledge.stored)))
        if without and self.unsolvable:
            return PlanningResult(Planned.UNSOLVABLE, "the problem has no plan")
        return PlanningResult(Planned.SOLVED)

    def run(self) -> Verdict:
        self.request.course.begin()
        self.machine.prepare()
        return self.machine.run_requests(self.requests)

    def run_and_cancel(self) -> Verdict:
        verdicts: List[Verdict] = []
        thread = threading.Thread(target=lambda: verdicts.append(self.run()), daemon=True)
        thread.start()
        assert self.knowledge.hangs.wait(LONG)
        self.request.stop = Stop(StopKind.CANCELLED)
        self.machine.cancel()
        thread.join(LONG)
        return verdicts[0]


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Bench:
    monkeypatch.setattr("merlin_sm.states.planning.master_answers", lambda: True)
    for level in ("loginfo", "logwarn", "logerr", "logerr_throttle_identical"):
        monkeypatch.setattr(rospy, level, lambda *_: None)
    return Bench()


STAGES = {
    "settle": "SETTLE",
    "add_goals": "ADD_GOALS",
    "generate_problem": "GENERATE_PROBLEM",
    "plan_in_time": "PLAN",
    "parse_plan": "PARSE_PLAN",
    "dispatch_goals": "DISPATCH_PLAN",
    "replan": "REPLAN",
    "remove_goals": "REMOVE_GOALS",
}


@pytest.mark.parametrize(("name", "label"), STAGES.items())
def test_each_state_is_what_the_factory_makes_under_its_name(name: str, label: str) -> None:
    class Other(MerlinStateFactory.maker(name)):  # type: ignore[misc]
        pass

    with contextlib.suppress(InterruptedError), MerlinStateFactory.renewed():
        MerlinStateFactory.register(name, Other)
        machine = Bench().machine
        raise InterruptedError("the factory forgets it")
    made = machine.get_children()
    assert isinstance(made[label], Other)
    assert set(made) == set(STAGES.values())


SAID_NO = DispatchResult(False, action="(ask ann)", reason="ann said no", no_retry="(ask ann)")


def test_what_was_given_up_is_planned_around(bench: Bench) -> None:
    bench.results = [SAID_NO]
    assert bench.run().outcome is Outcome.SUCCEEDED
    assert bench.without == [[], ["(ask ann)"]]


@pytest.mark.parametrize(("done", "waits"), [(0, True), (1, False)])
def test_with_a_goal_that_came_true_on_the_way_the_base_has_to_stand(
    bench: Bench, done: int, waits: bool
) -> None:
    bench.plan = [ActionDispatch()]
    bench.dispatcher.steps_done = done
    bench.results = [DispatchResult(True)]
    assert bench.run().outcome is Outcome.SUCCEEDED
    assert bench.waited_standing is waits


def test_while_a_base_is_held_nothing_is_planned_again(bench: Bench) -> None:
    bench.results, bench.held = [SAID_NO], True
    ended: List[Verdict] = []
    run = threading.Thread(target=lambda: ended.append(bench.run()))
    run.start()
    assert bench.waits.wait(LONG)
    assert len(bench.without) == 1 and not ended
    bench.held = False
    bench.wake()
    run.join(LONG)
    assert ended[0].outcome is Outcome.SUCCEEDED and len(bench.without) == 2


def test_a_cancel_ends_the_wait_for_the_release(bench: Bench) -> None:
    bench.results, bench.held = [SAID_NO], True
    ended: List[Verdict] = []
    run = threading.Thread(target=lambda: ended.append(bench.run()))
    run.start()
    assert bench.waits.wait(LONG)
    bench.request.stop = Stop(StopKind.CANCELLED)
    bench.machine.cancel()
    run.join(LONG)
    assert ended[0].outcome is Outcome.CANCELLED and len(bench.without) == 1


def test_where_there_is_no_way_round_the_reason_stands(bench: Bench) -> None:
    bench.results, bench.unsolvable = [SAID_NO], True
    verdict = bench.run()
    assert verdict.outcome is Outcome.ACTION_FAILED and verdict.action == "(ask ann)"
    assert verdict.reason.startswith("(ask ann): ann said no; no plan without it")
    assert (bench.without, bench.own.left) == ([[], ["(ask ann)"]], False)


@pytest.mark.parametrize("call", ["executions", "query", "goals", "add", "remove"])
def test_a_cancel_does_not_wait_for_a_knowledge_base_that_hangs(bench: Bench, call: str) -> None:
    bench.knowledge.hanging = call
    if call == "remove":  # the cancel finds the request at its end
        bench.request.stop = Stop(StopKind.CANCELLED)
        verdict = bench.run()
        assert verdict.outcome is Outcome.SUCCEEDED
    else:
        verdict = bench.run_and_cancel()
        assert verdict.outcome is Outcome.CANCELLED
    assert f"the planning system's knowledge base: service {call} does not answer" in verdict.trouble
    assert bench.own.left == (call in ("add", "remove"))
    bench.knowledge.hanging = ""
    bench.machine.clean_up()
    assert not bench.machine.left
    assert bench.knowledge.stored == []


def test_goals_that_were_removed_meanwhile_do_not_count_as_achieved(bench: Bench) -> None:
    def lose() -> None:
        bench.knowledge.stored.clear()
        bench.on_dispatch = reach

    def reach() -> None:
        bench.knowledge.true = True

    bench.on_dispatch = lose
    verdict = bench.run()
    assert verdict.outcome is Outcome.SUCCEEDED
    assert bench.dispatched == 2


def test_goals_that_are_always_removed_are_reported(bench: Bench) -> None:
    bench.on_dispatch = bench.knowledge.stored.clear
    verdict = bench.run()
    assert verdict.outcome is Outcome.ACTION_FAILED
    assert GOALS_GONE in verdict.reason


def test_goals_that_hold_need_not_be_there_any_more(bench: Bench) -> None:
    def reach() -> None:
        bench.knowledge.stored.clear()
        bench.knowledge.true = True

    bench.on_dispatch = reach
    assert bench.run().outcome is Outcome.SUCCEEDED
    assert bench.dispatched == 1


def test_a_dispatcher_that_is_away_before_anything_is_planned_is_waited_for(bench: Bench) -> None:
    bench.troubles = ["the dispatcher is gone"]
    assert bench.run().outcome is Outcome.SUCCEEDED
    assert bench.request.course.replans == 1


@pytest.mark.parametrize(("works", "waits"), [(0.03, [0.1, 0.05]), (0.2, [0.1, 0.1, 0.1])])
def test_all_returns_of_a_planning_system_that_dies_again_and_again_have_one_deadline(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, works: float, waits: List[float]
) -> None:
    monkeypatch.setattr(executor_stages, "running_time", lambda: bench.now)
    bench.request.course = Course(3, replan_wait=0.0)

    def dies() -> None:
        bench.now += works
        bench.troubles.append("gone")
        bench.results.append(DispatchResult(False, reason="the dispatcher died", gone=True))

    bench.on_dispatch = dies
    verdict = bench.run()
    assert bench.patience == pytest.approx(waits)
    assert verdict.outcome is Outcome.INTERNAL
    if works < 0.1:
        assert verdict.reason == "the dispatcher died; lost 3 times, and not back for 0.1 s in between"


def test_a_brake_that_cannot_be_sent_does_not_keep_the_cancel(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(_: str) -> None:
        raise OSError("the topic is closed")

    stopped = []

    def cancel() -> None:
        with pytest.raises(OSError, match="closed"):
            bench.machine.cancel()
        stopped.append(bench.machine.preempt_requested())

    monkeypatch.setattr(bench, "brake", broken)
    bench.on_dispatch = cancel
    bench.run()
    assert stopped == [True]


def test_of_several_requests_those_end_at_once_whose_goals_hold_already(bench: Bench) -> None:
    bench.joined_by("(checked hall)", "(and (checked bath) (checked hall))")
    bench.knowledge.facts = ["(checked hall)"]
    bench.plan = [ActionDispatch(name="drive")]
    stored: List[str] = []
    bench.on_dispatch = lambda: stored.extend(map(to_pddl, bench.knowledge.stored))
    assert bench.run().outcome is Outcome.SUCCEEDED
    assert bench.ended == [(bench.requests[1], Outcome.ALREADY_TRUE)]
    assert stored == ["(checked kitchen)", "(checked bath)", "(checked hall)"]
    assert [len(request.plan) for request in bench.requests] == [1, 0, 1]
    assert not bench.own.left


def test_what_came_true_before_it_is_planned_again_has_succeeded(bench: Bench) -> None:
    bench.joined_by("(checked hall)")
    bench.results = [SAID_NO]
    bench.on_dispatch = lambda: bench.knowledge.facts.append("(checked hall)")
    assert bench.run().outcome is Outcome.SUCCEEDED
    assert bench.ended == [(bench.requests[1], Outcome.SUCCEEDED)]


def test_a_request_that_ends_while_goals_are_looked_at_does_not_end_the_others(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.joined_by("(checked hall)")
    kitchen, _ = bench.requests
    bench.results = [SAID_NO]
    bench.on_dispatch = lambda: bench.knowledge.facts.append("(checked kitchen)")
    query = bench.knowledge.query

    def end_meanwhile(items: List[Any]) -> List[bool]:
        found = query(items)
        if bench.dispatched == 1 and not bench.ended:
            bench.machine.run.end([kitchen], Verdict(Outcome.SUCCEEDED))
        return found

    monkeypatch.setattr(bench.knowledge, "query", end_meanwhile)
    assert bench.run().outcome is Outcome.SUCCEEDED
    assert bench.ended == [(kitchen, Outcome.SUCCEEDED)]
    assert bench.dispatched == 2, "the hall is not checked yet"


def test_others_join_a_run_before_it_is_planned_again(bench: Bench) -> None:
    bench.results, bench.newcomers = [SAID_NO], ["(checked hall)"]
    assert bench.run().outcome is Outcome.SUCCEEDED
    assert bench.planned_for == [["(checked kitchen)"], ["(checked kitchen)", "(checked hall)"]]


@pytest.mark.parametrize(
    ("verdict", "outcome"),
    [
        (Planned.SOLVED, Outcome.SUCCEEDED),
        (Planned.TIMEOUT, Outcome.SUCCEEDED),  # not a proof: the first plan is carried out
        (Planned.NO_PLAN, Outcome.SUCCEEDED),
        (Planned.ERROR, Outcome.SUCCEEDED),
        (Planned.LATE, Outcome.LATE),
    ],
)
def test_a_request_whose_plan_is_late_ends_when_none_is_in_time(
    bench: Bench, verdict: Planned, outcome: Outcome, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rospy, "get_time", lambda: 100.0)
    bench.request.window = TimeWindow(deadline=160.0)
    bench.in_time = PlanningResult(verdict, "needs 95 s")
    found = bench.run()
    assert found.outcome is outcome and bench.dispatched == (outcome is Outcome.SUCCEEDED)
    assert bench.deadlines == [GoalDeadline(["(checked kitchen)"], 60.0)]
    assert outcome is Outcome.SUCCEEDED or found.reason == "needs 95 s"
    assert not bench.knowledge.stored


def test_several_are_planned_with_all_their_deadlines_when_a_plan_ends_after_one(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rospy, "get_time", lambda: 100.0)
    bench.joined_by("(checked hall)", "(checked attic)")
    bench.request.window = TimeWindow(deadline=400.0)
    bench.requests[2].window = TimeWindow(deadline=160.0)
    bench.in_time = PlanningResult(Planned.SOLVED, reached=(90.0, 50.0))
    assert bench.run().outcome is Outcome.SUCCEEDED
    assert [due.within for due in bench.deadlines] == [300.0, 60.0]
    assert [each.reached for each in bench.requests] == [90.0, None, 50.0]
