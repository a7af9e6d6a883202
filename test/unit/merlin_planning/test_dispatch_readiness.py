# SPDX-License-Identifier: Apache-2.0
"""Before a dispatcher without status is called, its action interfaces and the plan have to be there."""

import threading
from typing import Any, List

import pytest
from diagnostic_msgs.msg import KeyValue
from rosplan_dispatch_msgs.msg import ActionDispatch
from rosplan_knowledge_msgs.msg import DomainFormula
from std_msgs.msg import String

from merlin_planning import over_rosplan
from merlin_planning.dispatch_client import WITHDRAWN
from merlin_planning.over_rosplan import ANNOUNCED, SilentDispatcher, drawn_actions
from merlin_ros import deadline
from merlin_test import LONG

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


@pytest.fixture
def ready(dispatcher: Any) -> SilentDispatcher:
    found = SilentDispatcher("/dispatcher", "/kb", threading.Condition(), lambda: None, 20.0)
    announce(dispatcher, "drive", "Restart_engine", "stay")
    return found


def announce(dispatcher: Any, *operators: str) -> None:
    for name in operators:
        dispatcher.heard["/kb/pddl_action_parameters"](DomainFormula(name=name))


def draw(dispatcher: Any, graph: str) -> None:
    dispatcher.heard["/dispatcher/plan_graph"](String(graph))


def waiting(ready: SilentDispatcher, plan: List[ActionDispatch]) -> threading.Thread:
    thread = threading.Thread(target=lambda: ready.wait(plan, lambda: False), daemon=True)
    thread.start()
    return thread


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

    monkeypatch.setattr(over_rosplan, "Deadline", Noted)
    return begun


def test_the_plan_is_waited_for(
    dispatcher: Any, ready: SilentDispatcher, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(over_rosplan, "DRAWING_WAIT", 0.0)
    ready.wait(NEW, lambda: False)  # listens for drawings from now on
    draw(dispatcher, OLD)
    monkeypatch.setattr(over_rosplan, "DRAWING_WAIT", LONG)
    thread = waiting(ready, NEW)
    draw(dispatcher, OLD)  # a step of the old plan is drawn
    thread.join(0.05)
    assert thread.is_alive()
    draw(dispatcher, GRAPH)
    thread.join(LONG)
    assert not thread.is_alive()


def test_a_dispatcher_that_does_not_draw_is_not_waited_for(
    dispatcher: Any, ready: SilentDispatcher, waits: List[float]
) -> None:
    dispatcher.published.clear()
    ready.wait(NEW, lambda: False)
    assert waits == [over_rosplan.INTERFACE_WAIT]


def test_a_plan_that_is_never_drawn_is_not_waited_for_without_end(
    ready: SilentDispatcher, waits: List[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(over_rosplan, "DRAWING_WAIT", 0.01)
    ready.wait(NEW, lambda: False)
    assert waits == [over_rosplan.INTERFACE_WAIT, 0.01]


def test_interfaces_that_are_announced_without_end_do_not_grow_without_end(
    dispatcher: Any, ready: SilentDispatcher, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(over_rosplan, "INTERFACE_WAIT", LONG)
    dispatcher.published.clear()
    for number in range(3 * ANNOUNCED):
        announce(dispatcher, f"ghost{number}", "Drive")
    ready.wait(NEW[:1], lambda: False)
    thread = waiting(ready, [ActionDispatch(name="ghost0")])  # which is forgotten
    thread.join(0.05)
    assert thread.is_alive()
    announce(dispatcher, "ghost0")
    thread.join(LONG)
    assert not thread.is_alive()


def test_a_cancel_ends_the_wait_and_nothing_is_dispatched(
    dispatcher: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(over_rosplan, "INTERFACE_WAIT", 1e6)
    monkeypatch.setattr(over_rosplan, "DRAWING_WAIT", 1e6)

    def interruptible(interrupt: Any) -> None:
        if interrupt is not None:  # the preempt comes during the wait
            threading.Timer(0.05, interrupt).start()

    result = dispatcher.client().dispatch(interruptible, NEW)
    assert result.cancelled and result.reason == WITHDRAWN and not result.gone
    assert dispatcher.calls == []
