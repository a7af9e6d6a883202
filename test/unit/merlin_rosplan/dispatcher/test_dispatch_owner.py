# SPDX-License-Identifier: Apache-2.0
"""The owner of a dispatch changes while the dispatcher looks away; and what nothing foresaw is answered."""

import threading
from types import SimpleNamespace
from typing import Any, Callable, Iterator, List, Tuple

import pytest
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus
from rosplan_dispatch_msgs.msg import NonBlockingDispatchAction

from merlin_ros.actions.action_server import ActionServer, ServerGoal
from merlin_ros.actions.lease import LeaseChange, LeaseState
from merlin_ros.actions.lease_watch import LeaseWatch
from merlin_ros.actions.ownership import ownership
from merlin_rosplan.dispatch.dispatch import DispatchReport, DispatchState
from merlin_rosplan.dispatcher import plan_dispatcher
from merlin_rosplan.dispatcher.plan_dispatcher import PlanDispatcher

LONG = 60.0
HELD, SUSPENDED, LOST = LeaseState.HELD, LeaseState.SUSPENDED, LeaseState.LOST


class Book:
    """A book of leases that says what the test says."""

    def __init__(self) -> None:
        self.now = HELD
        self.on_read: Callable[[], None] = lambda: None
        self.goals: List[str] = []

    def state(self, goal: str) -> LeaseState:
        return self.now

    def reason(self, goal: str) -> str:
        read, self.on_read = self.on_read, lambda: None
        reason = "" if self.now is HELD else "/client is silent"
        read()
        return reason

    def goals_of(self, owner: str) -> List[str]:
        return self.goals

    def owner(self, goal: str) -> str:
        return "/client"

    def leases(self, client: str) -> bool:
        return False

    def arrive(self, goal: str, owner: str) -> None:
        pass

    def forget(self, goal: str) -> None:
        pass

    watching = False


class Leases(LeaseWatch):
    """A watch without a topic."""

    def __init__(self, topic: str, on_change: Callable, **_: Any) -> None:
        self._on_change, self._lock, self.book = on_change, threading.RLock(), Book()  # type: ignore[assignment]
        self._looks = None
        self._book = self.book  # type: ignore[assignment]


class Dispatch:
    """One run of a plan; it ends when the test says so."""

    plan_id = 1

    def __init__(self, schedule: Any, topics: Any, *_: Any, **__: Any) -> None:
        self._topics = topics
        self.suspended = False
        self.reasons: List[str] = []
        self.ended = threading.Event()

    def run(self) -> DispatchReport:
        self._topics.begun.release()
        assert self.ended.wait(LONG)
        return DispatchReport(DispatchState.SUCCEEDED, "")

    def suspend(self, suspended: bool) -> None:
        self.suspended = suspended

    def cancel(self, reason: str) -> None:
        self.reasons.append(reason)
        self.ended.set()


@pytest.fixture(autouse=True)
def quiet(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr("merlin_rosplan.dispatch.dispatch.PlanDispatch", Dispatch)
    for level in ("loginfo", "logwarn", "logerr"):
        monkeypatch.setattr(rospy, level, lambda *_: None)
    monkeypatch.setattr(rospy.Time, "now", lambda: rospy.Time(1))
    yield
    ownership.resume("goal")


def server_of(on_goal: Callable, on_owner: Callable) -> Tuple[ActionServer, Book]:
    server = ActionServer("a", NonBlockingDispatchAction, on_goal, lambda goal: None, on_owner)
    silent = SimpleNamespace(publish=lambda message: None)
    server._status_publisher = server._result_publisher = silent  # type: ignore[assignment]
    server._leases = leases = Leases("a/lease", server._owner_changed)
    return server, leases.book


def send(server: ActionServer) -> None:
    server._receive_goal(SimpleNamespace(goal_id=GoalID(id="goal", stamp=rospy.Time(1)), goal=None))


# --- a server and an owner that comes back just now -----------------------------------------------------


def test_an_owner_that_comes_back_while_its_goal_is_taken_is_not_taken_for_silent() -> None:
    server, leases = server_of(lambda goal: None, lambda *_: None)

    def back() -> None:  # its watch says so in another thread
        leases.now = HELD
        server._owner_changed(LeaseChange("goal", HELD, ""))

    leases.now, leases.on_read = SUSPENDED, back
    send(server)
    assert not ownership.suspended("goal")


# --- a dispatcher ---------------------------------------------------------------------------------------


class Dispatcher(PlanDispatcher):
    """Its plans run until they are cancelled."""

    closed = False

    def __init__(self) -> None:
        self.scope, self._state = "/dispatcher", threading.Condition()
        self._dispatch = self._goal = None
        self._busy = self._ending = self._unwanted = False
        self._client, self._begun = "", 0
        self._limits = SimpleNamespace(cancel=LONG)
        self._topics = SimpleNamespace(
            report_status=lambda report: None,
            begin=lambda owner: 1,
            unanswered=lambda: [],
            begun=threading.Semaphore(0),
        )
        self._settler = SimpleNamespace(settle=lambda plan_id, actions: None)
        self._breakpoints = self._plan = None  # type: ignore[assignment]
        self._missed, self._watches_rest = frozenset(), False
        self._knowledge = SimpleNamespace(unmet_goals=lambda: [])
        self._server, self.leases = server_of(self._accept, self._goal_owner_changed)
        self.begun = self._topics.begun

    def _take_plan(self) -> Any:
        return None

    def make_schedule(self, plan: Any) -> Any:
        return None


def called(dispatcher: Dispatcher, client: str) -> threading.Thread:
    """A client calls the service; its plan runs when this returns."""
    request = SimpleNamespace(_connection_header={"callerid": client})
    thread = threading.Thread(target=lambda: dispatcher._serve(request))
    thread.start()
    assert dispatcher.begun.acquire(timeout=LONG)
    return thread


def test_a_client_that_hung_while_its_goal_waited_suspends_its_dispatch(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    dispatcher = Dispatcher()
    first = called(dispatcher, "/first")
    asked = threading.Event()

    def dead(*_: Any) -> None:
        assert asked.wait(LONG)

    monkeypatch.setattr(plan_dispatcher, "living_namesake", dead)
    monkeypatch.setattr(plan_dispatcher, "bounded_master", lambda: None)
    send(dispatcher._server)
    dispatcher.leases.now = SUSPENDED  # its client is stopped: SIGSTOP
    dispatcher._server._owner_changed(LeaseChange("goal", SUSPENDED, "/client is silent"))
    before: Any = dispatcher._dispatch
    assert not before.suspended  # that goal is not the one that runs
    asked.set()  # the client of the first one is dead
    first.join(LONG)
    assert before.reasons == ["its owner /first is gone"]
    assert dispatcher.begun.acquire(timeout=LONG)
    second: Any = dispatcher._dispatch
    assert second.suspended
    dispatcher._server._owner_changed(LeaseChange("goal", HELD, ""))
    assert not second.suspended
    second.cancel("test")


def test_a_dispatch_that_began_while_the_client_of_the_last_was_looked_for_goes_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    dispatcher = Dispatcher()
    first, others = called(dispatcher, "/first"), []

    def dead(*_: Any) -> None:  # it takes 2 s to find that out
        running: Any = dispatcher._dispatch
        running.cancel("it ends")
        first.join(LONG)
        others.append(called(dispatcher, "/second"))

    monkeypatch.setattr(plan_dispatcher, "living_namesake", dead)
    monkeypatch.setattr(plan_dispatcher, "bounded_master", lambda: None)
    with pytest.raises(rospy.ServiceException, match="already, for /second"):
        dispatcher._serve(SimpleNamespace(_connection_header={"callerid": "/third"}))
    second: Any = dispatcher._dispatch
    assert second.reasons == []
    second.cancel("test")
    others[0].join(LONG)


@pytest.mark.parametrize("part", ["unmet_goals", "report_status", "_take_over", "tell_owner"])
def test_a_client_gets_its_answer_whatever_fails(monkeypatch: pytest.MonkeyPatch, part: str) -> None:
    def broken(*_: Any) -> None:
        raise IndexError("a goal that is not text")

    dispatcher = Dispatcher()
    monkeypatch.setattr(Dispatch, "run", lambda _: DispatchReport(DispatchState.SUCCEEDED, ""))
    place: Any = {"unmet_goals": dispatcher._knowledge, "report_status": dispatcher._topics}
    place["tell_owner"] = dispatcher._server
    monkeypatch.setattr(place.get(part, dispatcher), part, broken)
    goal = ServerGoal(dispatcher._server, GoalID(id="goal"), None)
    dispatcher._run_goal(goal, part != "_take_over" and dispatcher._occupy(goal))
    assert goal.done
    assert "a goal that is not text" in goal._status.text
    assert goal.status == (GoalStatus.SUCCEEDED if part == "unmet_goals" else GoalStatus.ABORTED)
    assert dispatcher._occupy(None)  # the next client is not concerned
