"""Executions that have to stop or rest: whatever one of them does, and whatever comes first."""

import threading
from typing import Any, List

import pytest
import rospy
from diagnostic_msgs.msg import KeyValue
from rosplan_dispatch_msgs.msg import ActionDispatch
from rosplan_knowledge_msgs.msg import DomainFormula

from merlin_actions import action_interface
from merlin_actions.core.ending import Ending
from merlin_actions.core.execution import Execution
from merlin_ros.actions.lease import LeaseBook, LeaseState
from merlin_ros.actions.lease_watch import LeaseWatch
from merlin_ros.actions.ownership import ownership

LONG = 60.0


class Leases(LeaseWatch):
    """A watch without a topic."""

    def __init__(self, topic: str, on_change: Any) -> None:
        self.topic, self._on_change = topic, on_change
        self._changed, self._book = threading.Condition(), LeaseBook()

    def _begin(self) -> None:
        """Time does not pass."""


class Probe(action_interface.ActionInterface):
    """Runs until it is cancelled; the first execution fails at that."""

    concurrent = True

    def __init__(self) -> None:
        super().__init__("navigate")
        self._owners = Leases("lease", self._owner_changed)
        self.running: threading.Semaphore = threading.Semaphore(0)
        self.suspended: List[bool] = []
        self.ends: List[int] = []
        self.go_on = threading.Event()

    def _run_with_effects(self, execution: Execution) -> Ending:
        stopped = threading.Event()

        def stop() -> None:
            stopped.set()
            if execution.key[1] == 1:
                raise OSError("the arm does not answer")

        self.suspended.append(ownership.suspended(execution.token))
        execution.interruptible(stop)
        self.running.release()
        assert stopped.wait(LONG)
        return Ending(False, execution.cancel_reason)

    def _answer(self, key: Any, ending: Any = None) -> None:
        if ending is not None:
            self.ends.append(key[1])


@pytest.fixture
def interface(monkeypatch: pytest.MonkeyPatch) -> Probe:
    formula = DomainFormula(name="navigate", typed_parameters=[KeyValue("to", "poi")])
    operator = type("Details", (), {"formula": formula})
    knowledge = type("Knowledge", (), {"name": "/kb", "operator": lambda self, name: operator})
    monkeypatch.setattr(action_interface, "knowledge_client", lambda name: knowledge())
    monkeypatch.setattr(action_interface, "effects_of", lambda details, knowledge: None)
    monkeypatch.setattr(action_interface, "master_is_lost", lambda: False)
    for level in ("loginfo", "logwarn", "logerr"):
        monkeypatch.setattr(rospy, level, lambda *_: None)
    return Probe()


def begin(interface: Probe, number: int) -> None:
    parameters = [KeyValue("to", "hall")]
    interface._begin(ActionDispatch(name="navigate", plan_id=7, action_id=number, parameters=parameters))
    assert interface.running.acquire(timeout=LONG)


def test_a_cancel_that_fails_keeps_no_other_one(interface: Probe) -> None:
    for number in (1, 2, 3):
        begin(interface, number)
    interface.master_lost()
    with interface._changed:
        assert interface._changed.wait_for(lambda: not interface.executions(), LONG), "one still runs"
    assert sorted(interface.ends) == [1, 2, 3]


def test_an_action_whose_lease_came_before_it_and_is_suspended_does_not_move(interface: Probe) -> None:
    interface._owners._book.renew("/dispatcher", "a", ["7/2"], ["7/2"])  # the owner of the dispatcher hangs
    begin(interface, 2)
    assert interface.suspended == [True]
    (execution,) = interface.executions()
    for change in interface._owners._book.renew("/dispatcher", "a", ["7/2"], []):
        assert change.state is LeaseState.HELD
        interface._owner_changed(change)
    assert not ownership.suspended(execution.token)
    interface.master_lost()
