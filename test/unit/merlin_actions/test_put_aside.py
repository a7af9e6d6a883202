"""A latched dispatch that comes before its dispatcher's status is begun when the status says so, once."""

from typing import Any, Dict, List, Optional, Tuple

import pytest
from merlin_msgs.msg import DispatchStatus, RunningAction
from rosplan_dispatch_msgs.msg import ActionDispatch
from rosplan_knowledge_msgs.msg import DomainFormula

from merlin_actions import action_interface
from merlin_actions.action_interface import ActionInterface


class Probe(ActionInterface):
    """Notes what begins; everything else of an action is not made."""

    def __init__(self) -> None:
        super().__init__("navigate")
        self.begun: List[Tuple[int, int]] = []

    def connect_long_ago(self) -> None:
        self._latched.connected = action_interface.running_time() - 100.0

    def _begin(self, dispatch: ActionDispatch) -> None:
        self.begun.append((dispatch.plan_id, dispatch.action_id))


class Knowledge:
    name = "/kb"

    def operator(self, name: str) -> Any:
        return type("Details", (), {"formula": DomainFormula(name=name)})


@pytest.fixture
def interface(monkeypatch: pytest.MonkeyPatch) -> Probe:
    monkeypatch.setattr(action_interface, "knowledge_client", lambda name: Knowledge())
    monkeypatch.setattr(action_interface, "effects_of", lambda details, knowledge: None)
    monkeypatch.setattr(action_interface.rospy, "loginfo", lambda text: None)
    return Probe()


def latched(
    name: str = "navigate", action: int = 3, connection: Optional[Dict[str, str]] = None
) -> ActionDispatch:
    message = ActionDispatch(plan_id=7, action_id=action, name=name)
    message._connection_header = {"latching": "1"} if connection is None else connection
    return message


def waits_for(*actions: int) -> DispatchStatus:
    return DispatchStatus(running=[RunningAction(plan_id=7, action_id=action) for action in actions])


def test_it_begins_once_when_the_dispatcher_says_that_it_waits(interface: Probe) -> None:
    interface._receive(latched())
    assert interface.begun == []
    for status in (waits_for(), waits_for(2), waits_for(3), waits_for(3)):
        interface._note_dispatcher(status)
    assert interface.begun == [(7, 3)]


def test_several_begin_when_the_dispatcher_says_that_it_waits_for_them(interface: Probe) -> None:
    for action in (3, 4, 5):
        interface._receive(latched(action=action))
    interface._note_dispatcher(waits_for(3, 5))
    assert interface.begun == [(7, 3), (7, 5)]
    interface._note_dispatcher(waits_for(3, 4, 5))
    assert interface.begun == [(7, 3), (7, 5), (7, 4)]


def test_one_of_an_earlier_plan_is_dropped_when_another_plan_begins(interface: Probe) -> None:
    interface._receive(latched(action=2))
    interface._latched.connected = action_interface.running_time() - 100.0
    new = latched(action=3, connection={"latching": "0"})
    new.plan_id = 8
    interface._receive(new)
    interface._note_dispatcher(waits_for(2))
    assert interface.begun == [(8, 3)]


def test_it_begins_at_once_after_the_status(interface: Probe) -> None:
    interface._note_dispatcher(waits_for(3))
    interface._receive(latched())
    interface._note_dispatcher(waits_for(3))
    assert interface.begun == [(7, 3)]


def test_one_that_is_cancelled_meanwhile_does_not_begin(interface: Probe) -> None:
    interface._receive(latched())
    interface._receive(latched(action_interface.CANCEL_ACTION))
    interface._note_dispatcher(waits_for(3))
    assert interface.begun == []


def test_a_latched_one_that_a_busy_machine_delivers_late_does_not_begin(interface: Probe) -> None:
    interface.connect_long_ago()
    interface._note_dispatcher(waits_for())
    connection = {"latching": "1"}
    interface._receive(latched(action=2, connection=connection))
    assert interface.begun == []
    interface._receive(latched(action=3, connection=connection))  # over the same connection: it is new
    assert interface.begun == [(7, 3)]


def test_of_a_dispatcher_that_tells_nothing_the_first_one_begins(interface: Probe) -> None:
    interface.connect_long_ago()
    interface._receive(latched())
    assert interface.begun == [(7, 3)]
