# SPDX-License-Identifier: Apache-2.0
"""One dispatcher and several clients: whose turn it is, what ends it, and that each client is answered."""

import contextlib
import threading
from queue import Queue
from types import SimpleNamespace
from typing import Any, Callable, Dict, Iterator, List

import pytest
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus
from fakes.topics import Topics
from merlin_msgs.msg import DispatchStatus, KnowledgeChanges, Lease
from rosplan_dispatch_msgs.msg import CompletePlan, NonBlockingDispatchActionGoal
from rosplan_dispatch_msgs.srv import DispatchServiceRequest, DispatchServiceResponse
from rosplan_knowledge_msgs.msg import KnowledgeItem
from std_srvs.srv import EmptyRequest

from merlin_ros.actions import lease_watch
from merlin_ros.actions.lease import LEASED
from merlin_ros.actions.ownership import ownership
from merlin_ros.alarms import Alarm, wait_ticks
from merlin_ros.deadline import Deadline
from merlin_rosplan.dispatch.dispatch import DispatchReport, DispatchState
from merlin_rosplan.dispatch.dispatch_environment import Event, KnowledgeChanged
from merlin_rosplan.dispatch.dispatch_graph import GraphSchedule
from merlin_rosplan.dispatcher import plan_dispatcher
from merlin_rosplan.dispatcher.simple_and_esterel import SimplePlanDispatcher
from merlin_rosplan.transport import component
from merlin_rosplan.transport.handover import Handover
from merlin_test import LONG

NAME = "/dispatcher"
ACTION = f"{NAME}/dispatch_plan_action"
GOAL = f"goal{LEASED}"


class Dispatch:
    """One run of a plan: at its end at once, or when it is cancelled."""

    plan_id = 1

    def __init__(self, lasts: bool) -> None:
        self._lasts = lasts
        self._report = DispatchReport(DispatchState.SUCCEEDED, "")
        self.reasons: List[str] = []
        self.events: List[Event] = []
        self.suspended, self.resumed, self.ended = threading.Event(), threading.Event(), threading.Event()

    def cancel(self, reason: str) -> None:
        self.reasons.append(reason)
        self._report = DispatchReport(DispatchState.CANCELLED, reason)
        self.ended.set()

    def put(self, event: Event) -> None:
        self.events.append(event)

    def suspend(self, suspended: bool) -> None:
        (self.suspended if suspended else self.resumed).set()

    def run(self) -> DispatchReport:
        assert not self._lasts or self.ended.wait(LONG)
        self.ended.set()
        return self._report


class Dispatcher(SimplePlanDispatcher):
    """Calls `on_schedule` when it has taken a plan, and carries out nothing yet."""

    on_schedule: Callable[[], object] = staticmethod(lambda: None)

    def make_schedule(self, plan: CompletePlan, *_: Any) -> GraphSchedule:
        self.on_schedule()
        return super().make_schedule(plan)


class Call:
    """A client that calls the service, in a thread of its own."""

    def __init__(self, call: Callable[[], DispatchServiceResponse]) -> None:
        self._call = call
        self._answers: Queue[str] = Queue()
        self.thread = threading.Thread(target=self._work, daemon=True)

    def begin(self) -> "Call":
        self.thread.start()
        return self

    def answer(self) -> str:
        return self._answers.get(timeout=LONG)

    def _work(self) -> None:
        try:
            self._answers.put(f"success: {self._call().success}")
        except rospy.ServiceException as refused:
            self._answers.put(str(refused))


class Bench:
    """A dispatcher, its clients, and what it publishes. Without a master."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, watch_rest: bool = False) -> None:
        self.topics = Topics(monkeypatch)
        self.dispatches: Queue[Dispatch] = Queue()
        self.last = False  # whether runs last until they are cancelled
        self.lives: Callable[[str], bool] = lambda client: True
        self.unmet_goals: Callable[[], List[str]] = lambda: []
        self._services: Dict[str, Callable[[Any], Any]] = {}
        knowledge = SimpleNamespace(unmet_goals=lambda: self.unmet_goals())
        for place, name, made in (
            (component, "Service", self._service),
            (component, "offer", lambda *_: None),
            (component, "announced_together", contextlib.nullcontext),
            (component, "keep_params", lambda scope: {"watch_rest": watch_rest, "cancel_deadline": 0.0}),
            (plan_dispatcher, "bounded_master", lambda: None),
            (plan_dispatcher, "living_namesake", lambda name, _: name if self.lives(name) else None),
            (lease_watch, "every", lambda period, call: Alarm(call, period)),  # for owners no time passes
            (rospy.Time, "now", lambda: rospy.Time(1)),
            *((rospy, level, lambda *_: None) for level in ("loginfo", "logwarn", "logerr")),
        ):
            monkeypatch.setattr(place, name, made)
        monkeypatch.setattr("merlin_rosplan.dispatch.dispatch.PlanDispatch", self._dispatch)
        monkeypatch.setattr("merlin_rosplan.dispatcher.plan_knowledge.PlanKnowledge", lambda name: knowledge)
        self._parser = Handover.sender(f"{NAME}/complete_plan")
        self.dispatcher = Dispatcher(NAME)

    def _service(self, name: str, _: type, answer: Callable[[Any], Any]) -> Any:
        self._services[name] = answer
        return SimpleNamespace(shutdown=lambda: None)

    def _dispatch(self, *_: Any, **__: Any) -> Dispatch:
        made = Dispatch(self.last)
        self.dispatches.put(made)
        return made

    def call(self, client: str) -> Call:
        """A client that calls `dispatch_plan` when it begins."""
        return Call(lambda: self.dispatch(client))

    def dispatch(self, client: str = "/client") -> DispatchServiceResponse:
        """Gives it a plan, and has that carried out."""
        self._parser.hand_over(CompletePlan())
        request = DispatchServiceRequest()
        request._connection_header = {"callerid": client}
        return self._services[f"{NAME}/dispatch_plan"](request)

    def cancel(self) -> None:
        self._services[f"{NAME}/cancel_dispatch"](EmptyRequest())

    def next(self) -> Dispatch:
        """The next dispatch that has begun."""
        return self.dispatches.get(timeout=LONG)

    def send_goal(self, goal: str = GOAL) -> None:
        """Gives it a plan, and sends a goal to have that carried out."""
        self._parser.hand_over(CompletePlan())
        message = NonBlockingDispatchActionGoal(goal_id=GoalID(id=goal, stamp=rospy.Time(1)))
        self.topics.send(f"{ACTION}/goal", message)

    def lease(self, *suspended: str) -> None:
        """The client of the goal names it."""
        self.topics.send(f"{ACTION}/lease", Lease(owner="/other", life="1", held=[GOAL], suspended=suspended))

    def result(self) -> GoalStatus:
        """How the goal has ended."""
        return self.topics.published(f"{ACTION}/result").get(timeout=LONG).status

    def close(self) -> None:
        self.dispatcher.shutdown()
        self._parser.shutdown()


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    made = Bench(monkeypatch)
    yield made
    made.close()


# --- between two plans ----------------------------------------------------------------------------------


def test_one_that_has_reported_its_end_is_waited_for(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    waits = threading.Event()

    class Watched(Deadline):
        def wait(self, condition: threading.Condition, predicate: Callable[[], bool]) -> bool:
            if threading.current_thread() is second.thread and not predicate():
                waits.set()
            return super().wait(condition, predicate)

    def at_the_end(topic: str, message: Any) -> None:
        if topic == f"{NAME}/dispatch_status" and second.thread.ident is None:
            second.begin()
            assert waits.wait(LONG)

    second = bench.call("/second")
    monkeypatch.setattr(plan_dispatcher, "Deadline", Watched)
    bench.topics.before = at_the_end
    assert bench.dispatch().success
    assert second.answer() == "success: True"


def test_a_cancel_while_the_plan_is_taken_is_not_lost(bench: Bench) -> None:
    bench.cancel()  # a stray one, with nothing to cancel
    bench.dispatcher.on_schedule = bench.cancel  # type: ignore[method-assign]
    assert not bench.dispatch().success
    statuses = bench.topics.published(f"{NAME}/dispatch_status")
    assert [status.reason for status in statuses.queue][-1] == "cancelled before it began"
    assert statuses.queue[-1].state == DispatchStatus.IDLE
    bench.dispatcher.on_schedule = lambda: None  # type: ignore[method-assign]
    assert bench.dispatch().success


def test_a_dispatcher_ends_behind_the_answer_to_its_client(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    judges, goes_on = threading.Event(), threading.Event()
    over: List[bool] = []

    def unmet_goals() -> List[str]:
        judges.set()
        assert goes_on.wait(LONG)
        return []

    def wait(attempt: Callable[[float], bool], seconds: float) -> bool:
        assert judges.wait(LONG)  # the dispatch has ended
        over.append(attempt(0.0))
        goes_on.set()
        return wait_ticks(attempt, LONG)

    monkeypatch.setattr(plan_dispatcher, "wait_ticks", wait)
    bench.unmet_goals, bench.last = unmet_goals, True
    bench.send_goal()
    bench.next()
    bench.dispatcher.shutdown()
    result = bench.result()
    assert (result.status, result.text) == (GoalStatus.PREEMPTED, "the dispatcher ends")
    assert over == [False]


def test_a_goal_for_which_there_is_no_thread_is_answered_and_keeps_no_next_client(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_thread(*_: Any) -> threading.Thread:
        raise RuntimeError("can't start new thread")

    with monkeypatch.context() as short:
        short.setattr(plan_dispatcher, "start_thread", no_thread)
        bench.send_goal()
    result = bench.result()
    assert result.status == GoalStatus.ABORTED and "can't start new thread" in result.text
    assert bench.dispatch("/next").success


def test_a_watch_begins_with_what_has_changed_since_the_dispatch_before(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begun_with: List[Any] = []
    monkeypatch.setattr(
        "merlin_rosplan.rest.rest_watch.PlanWatch", lambda schedule, topics, missed: begun_with.append(missed)
    )
    with contextlib.closing(Bench(monkeypatch, watch_rest=True)) as bench:
        opened = KnowledgeChanges(added=[KnowledgeItem(attribute_name="open")])
        for changes in ([opened], [KnowledgeChanges(cleared=True), opened], []):
            for change in changes:
                bench.topics.send("/rosplan_knowledge_base/changes", change)
            assert bench.dispatch().success
    assert begun_with == [{"open"}, None, set()], "None: any may have"


def test_what_changes_while_a_dispatch_is_made_reaches_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def watch(*_: Any) -> None:
        opened = KnowledgeChanges(added=[KnowledgeItem(attribute_name="open")])
        bench.topics.send("/rosplan_knowledge_base/changes", opened)

    monkeypatch.setattr("merlin_rosplan.rest.rest_watch.PlanWatch", watch)
    with contextlib.closing(Bench(monkeypatch, watch_rest=True)) as bench:
        assert bench.dispatch().success
        assert bench.next().events == [KnowledgeChanged(frozenset({"open"}))]


# --- whose turn it is -----------------------------------------------------------------------------------


def test_the_end_of_a_dispatch_that_is_cancelled_is_waited_for(bench: Bench) -> None:
    bench.last = True
    first = bench.call("/first").begin()
    running = bench.next()
    bench.last = False
    with pytest.raises(rospy.ServiceException, match="a plan is being dispatched already, for /first"):
        bench.dispatch("/second")
    bench.cancel()
    assert bench.dispatch("/second").success
    assert first.answer() == "success: False"
    assert running.reasons == ["cancelled by cancel_dispatch"]


def test_one_that_waited_first_has_the_turn_of_a_dead_client(bench: Bench) -> None:
    looking: Queue[threading.Event] = Queue()

    def lives(client: str) -> bool:
        if client == "/first":  # it takes time to find out that it is dead
            found = threading.Event()
            looking.put(found)
            assert found.wait(LONG)
        return client != "/first"

    bench.lives, bench.last = lives, True
    bench.call("/first").begin()
    running = bench.next()
    second = bench.call("/second").begin()
    found_by_second = looking.get(timeout=LONG)
    third = bench.call("/third").begin()
    found_by_third = looking.get(timeout=LONG)
    found_by_third.set()
    assert third.answer() == "a plan is being dispatched already, for /second"
    assert running.reasons == ["its owner /first is gone"]
    found_by_second.set()
    bench.next().cancel("test")
    assert second.answer() == "success: False"


def test_a_dispatch_that_ends_while_its_client_is_looked_for_leaves_its_turn(bench: Bench) -> None:
    def lives(client: str) -> bool:
        running.cancel("it ends")
        assert first.answer() == "success: False"
        return True

    bench.last = True
    first = bench.call("/first").begin()
    running = bench.next()
    bench.lives, bench.last = lives, False
    assert bench.dispatch("/second").success


def test_a_client_that_hung_while_its_goal_waited_suspends_its_dispatch(bench: Bench) -> None:
    asked, silent = threading.Event(), threading.Event()

    def lives(client: str) -> bool:
        assert asked.wait(LONG)
        return False

    def changed() -> None:
        if ownership.suspended(GOAL):
            silent.set()

    bench.lives, bench.last = lives, True
    bench.call("/first").begin()
    first = bench.next()
    bench.send_goal()
    ownership.listen(changed)
    bench.lease(GOAL)  # the client of its client is stopped: SIGSTOP
    assert silent.wait(LONG)
    ownership.ignore(changed)
    assert not first.suspended.is_set()  # that goal is not the one that runs
    asked.set()
    second = bench.next()
    assert second.suspended.wait(LONG)
    assert first.reasons == ["its owner /first is gone"]
    bench.lease()
    assert second.resumed.wait(LONG)
    second.cancel("test")
    assert bench.result().status == GoalStatus.PREEMPTED


@pytest.mark.parametrize("part", ["goals", "status", "schedule", "look"])
def test_a_client_gets_its_answer_whatever_fails(bench: Bench, part: str) -> None:
    def broken(*_: Any) -> Any:
        raise IndexError("a goal that is not text")

    if part == "look":  # for the client of the dispatch before it
        bench.last = True
        other = bench.call("/first").begin()
        first = bench.next()
        bench.lives = broken
    elif part == "status":
        bench.topics.before = lambda topic, _: broken() if topic == f"{NAME}/dispatch_status" else None
    elif part == "schedule":
        bench.dispatcher.on_schedule = broken  # type: ignore[method-assign]
    else:
        bench.unmet_goals = broken
    bench.send_goal()
    result = bench.result()
    assert "a goal that is not text" in result.text
    assert result.status == (GoalStatus.SUCCEEDED if part == "goals" else GoalStatus.ABORTED)
    bench.topics.before = lambda topic, _: None
    bench.dispatcher.on_schedule = lambda: None  # type: ignore[method-assign]
    bench.last = False
    if part == "look":
        first.cancel("test")
        assert other.answer() == "success: False"
    assert bench.dispatch("/next").success  # the next client is not concerned


def test_a_dispatch_that_goes_on_has_the_number_of_the_message() -> None:
    goes_on = DispatchState.IDLE, DispatchState.RUNNING, DispatchState.CANCELLING
    assert all(getattr(DispatchStatus, state.name) == state for state in goes_on)
