# SPDX-License-Identifier: Apache-2.0
"""Between two plans: a client that gets the end of one can start the next at once, and cancel it."""

import contextlib
import threading
from types import SimpleNamespace
from typing import Any, Callable, Dict, Iterator, List

import pytest
import rospy
from fakes.topics import Topics
from merlin_msgs.msg import DispatchStatus
from rosplan_dispatch_msgs.msg import CompletePlan
from rosplan_dispatch_msgs.srv import DispatchServiceRequest, DispatchServiceResponse
from std_srvs.srv import EmptyRequest

from merlin_ros.deadline import Deadline
from merlin_rosplan.dispatch.dispatch import DispatchReport, DispatchState
from merlin_rosplan.dispatch.dispatch_schedule import Schedule
from merlin_rosplan.dispatcher import plan_dispatcher
from merlin_rosplan.dispatcher.dispatcher_kinds import SimplePlanDispatcher
from merlin_rosplan.transport import component
from merlin_rosplan.transport.handover import Handover

LONG = 60.0
NAME = "/dispatcher"


class Dispatch:
    """One run of a plan: at its end at once."""

    plan_id = 1

    def __init__(self, *_: Any, **__: Any) -> None:
        self._state, self._reason = DispatchState.SUCCEEDED, ""
        self.ended = threading.Event()

    def cancel(self, reason: str) -> None:
        self._state, self._reason = DispatchState.CANCELLED, reason

    def suspend(self, suspended: bool) -> None: ...

    def run(self) -> DispatchReport:
        self.ended.set()
        return DispatchReport(self._state, self._reason)


class Dispatcher(SimplePlanDispatcher):
    """Calls `on_schedule` when it has taken a plan, and carries out nothing yet."""

    on_schedule: Callable[[], object] = staticmethod(lambda: None)

    def make_schedule(self, plan: CompletePlan, *_: Any) -> Schedule:
        self.on_schedule()
        return super().make_schedule(plan)


class Bench:
    """A dispatcher, the client of its services, and what it publishes. Without a master."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.topics = Topics(monkeypatch)
        self._services: Dict[str, Callable[[Any], Any]] = {}
        knowledge = SimpleNamespace(unmet_goals=lambda: [])
        for place, name, made in (
            (component, "Service", self._service),
            (component, "offer", lambda *_: None),
            (component, "announced_together", contextlib.nullcontext),
            (component, "keep_params", lambda scope: {"watch_rest": False}),
            (rospy.Time, "now", lambda: rospy.Time(1)),
            *((rospy, level, lambda *_: None) for level in ("loginfo", "logwarn", "logerr")),
        ):
            monkeypatch.setattr(place, name, made)
        monkeypatch.setattr("merlin_rosplan.dispatch.dispatch.PlanDispatch", Dispatch)
        monkeypatch.setattr("merlin_rosplan.dispatcher.plan_knowledge.PlanKnowledge", lambda name: knowledge)
        self._parser = Handover.sender(f"{NAME}/complete_plan")
        self.dispatcher = Dispatcher(NAME)

    def _service(self, name: str, _: type, answer: Callable[[Any], Any]) -> Any:
        self._services[name] = answer
        return SimpleNamespace(shutdown=lambda: None)

    def dispatch(self) -> DispatchServiceResponse:
        """Gives it a plan, and has that carried out."""
        self._parser.hand_over(CompletePlan())
        request = DispatchServiceRequest()
        request._connection_header = {"callerid": "/client"}
        return self._services[f"{NAME}/dispatch_plan"](request)

    def cancel(self) -> None:
        self._services[f"{NAME}/cancel_dispatch"](EmptyRequest())

    def close(self) -> None:
        self.dispatcher.shutdown()
        self._parser.shutdown()


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    made = Bench(monkeypatch)
    yield made
    made.close()


def test_one_that_has_told_its_end_is_waited_for(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    waits = threading.Event()
    answers: List[Any] = []

    class Watched(Deadline):
        def wait(self, condition: threading.Condition, predicate: Callable[[], bool]) -> bool:
            if threading.current_thread() is second and not predicate():
                waits.set()
            return super().wait(condition, predicate)

    def call() -> None:
        try:
            answers.append(bench.dispatch().success)
        except rospy.ServiceException as refused:
            answers.append(str(refused))
        waits.set()

    def at_the_end(topic: str, message: Any) -> None:
        if topic == f"{NAME}/dispatch_status" and second.ident is None:
            second.start()
            assert waits.wait(LONG)

    second = threading.Thread(target=call, daemon=True)
    monkeypatch.setattr(plan_dispatcher, "Deadline", Watched)
    bench.topics.before = at_the_end
    assert bench.dispatch().success
    second.join(LONG)
    assert answers == [True]


def test_a_cancel_while_the_plan_is_taken_is_not_lost(bench: Bench) -> None:
    bench.cancel()  # a stray one, with nothing to cancel
    bench.dispatcher.on_schedule = bench.cancel  # type: ignore[method-assign]
    assert not bench.dispatch().success
    statuses = bench.topics.published(f"{NAME}/dispatch_status")
    assert [status.reason for status in statuses.queue][-1] == "cancelled before it began"
    assert statuses.queue[-1].state == DispatchStatus.IDLE
    bench.dispatcher.on_schedule = lambda: None  # type: ignore[method-assign]
    assert bench.dispatch().success
