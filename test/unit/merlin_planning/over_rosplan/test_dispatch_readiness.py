"""Before a dispatcher without status is called, its action interfaces and the plan have to be there."""

import threading
import time
from typing import Any, List

import pytest
import rospy
from diagnostic_msgs.msg import KeyValue
from rosplan_dispatch_msgs.msg import ActionDispatch
from rosplan_knowledge_msgs.msg import DomainFormula
from std_msgs.msg import String

from merlin_planning.dispatch_client import WITHDRAWN
from merlin_planning.over_rosplan import dispatch_readiness
from merlin_planning.over_rosplan.dispatch_readiness import ANNOUNCED, DispatchReadiness, drawn_actions
from merlin_ros import deadline

LONG = 60.0
GRAPH = """digraph plan {
0[ label="plan_start",style=filled,fillcolor=black,fontcolor=white];
1[ label="drive_start\\n(ann,kitchen)",style=filled,fillcolor=darkgoldenrod2];
2[ label="drive_end\\n(ann,kitchen)"];
11[ label="stay_start\\n()"];
12[ label="stay_end\\n()"];
3[ label="restart_engine_start\\n(bob)"];
4[ label="restart_engine_end\\n(bob)"];
"0" -> "1" [ label="[0.001, inf]" , penwidth=2, color="red"]
}
"""
NEW = [
    ActionDispatch(name="Drive", parameters=[KeyValue("?r", "ann"), KeyValue("?to", "kitchen")]),
    ActionDispatch(name="restart_engine", parameters=[KeyValue("?r", "bob")]),
    ActionDispatch(name="stay"),
]
OLD = GRAPH.replace("kitchen", "hall")


@pytest.fixture(autouse=True)
def ros(monkeypatch: pytest.MonkeyPatch) -> List[str]:
    """Topics that are published, of a master that is not there."""
    published = ["/dispatcher/plan_graph"]

    class Master:
        def getPublishedTopics(self, subgraph: str) -> Any:
            return [[topic, "std_msgs/String"] for topic in published]

    monkeypatch.setattr(rospy, "Subscriber", lambda *_, **__: None)
    monkeypatch.setattr(rospy, "is_shutdown", lambda: False)
    monkeypatch.setattr(deadline, "running_time", time.monotonic)
    monkeypatch.setattr(dispatch_readiness, "subscribe", lambda *_: object())
    monkeypatch.setattr(dispatch_readiness, "bounded_master", Master)
    return published


@pytest.fixture
def ready() -> DispatchReadiness:
    found = DispatchReadiness("/dispatcher", "/kb", threading.Condition())
    for name in ("drive", "Restart_engine", "stay"):
        found._receive_interface(DomainFormula(name=name))
    return found


def test_the_actions_of_a_drawing_in_the_order_of_the_plan() -> None:
    assert drawn_actions(GRAPH) == [("drive", ("ann", "kitchen")), ("restart_engine", ("bob",)), ("stay", ())]


@pytest.fixture
def waits(monkeypatch: pytest.MonkeyPatch) -> List[float]:
    """The limits of the waits that have begun, s."""
    begun: List[float] = []

    class Noted(deadline.Deadline):
        """Notes its limit."""

        def __init__(self, seconds: float) -> None:
            super().__init__(seconds)
            begun.append(seconds)

    monkeypatch.setattr(dispatch_readiness, "Deadline", Noted)
    return begun


def test_the_plan_is_waited_for(ready: DispatchReadiness, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dispatch_readiness, "DRAWING_WAIT", LONG)
    ready._receive_drawing(String(OLD))
    done: List[bool] = []
    waiting = threading.Thread(
        target=lambda: done.append(ready.wait(NEW, lambda: False) is None), daemon=True
    )
    waiting.start()
    ready._receive_drawing(String(OLD))  # a step of the old plan is drawn
    waiting.join(0.05)
    assert not done
    ready._receive_drawing(String(GRAPH))
    waiting.join(LONG)
    assert done


def test_a_dispatcher_that_does_not_draw_is_not_waited_for(
    ready: DispatchReadiness, ros: List[str], waits: List[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dispatch_readiness, "DRAWING_WAIT", 0.01)
    ros.clear()
    ready.wait(NEW, lambda: False)
    assert waits == [dispatch_readiness.INTERFACE_WAIT]


def test_a_plan_that_is_never_drawn_is_not_waited_for_without_end(
    ready: DispatchReadiness, waits: List[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dispatch_readiness, "DRAWING_WAIT", 0.01)
    ready.wait(NEW, lambda: False)
    assert waits == [dispatch_readiness.INTERFACE_WAIT, 0.01]


def test_interfaces_that_are_announced_without_end_do_not_grow_without_end(ready: DispatchReadiness) -> None:
    for number in range(3 * ANNOUNCED):
        ready._receive_interface(DomainFormula(name=f"ghost{number}"))
        ready._receive_interface(DomainFormula(name="Drive"))
    assert len(ready._announced) <= ANNOUNCED and "drive" in ready._announced


def test_a_cancel_ends_the_wait_and_nothing_is_dispatched(
    dispatcher: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dispatch_readiness, "INTERFACE_WAIT", 1e6)
    monkeypatch.setattr(dispatch_readiness, "DRAWING_WAIT", 1e6)

    def interruptible(interrupt: Any) -> None:
        if interrupt is not None:  # the preempt comes during the wait
            threading.Timer(0.05, interrupt).start()

    result = dispatcher.client().dispatch(interruptible, NEW)
    assert result.cancelled and result.reason == WITHDRAWN and not result.gone
    assert dispatcher.calls == []
