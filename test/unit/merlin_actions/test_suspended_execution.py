"""Executions that have to stop or rest: whatever one of them does, and whatever comes first."""

import threading
from types import SimpleNamespace
from typing import Any, Iterator, List

import pytest
import rospy
from diagnostic_msgs.msg import KeyValue
from merlin_msgs.msg import Lease
from rosplan_dispatch_msgs.msg import ActionDispatch, ActionFeedback
from rosplan_knowledge_msgs.msg import DomainFormula
from topics import Topics

from merlin_actions import action_interface
from merlin_actions.core.ending import Ending
from merlin_actions.core.execution import Execution
from merlin_ros.actions.ownership import ownership

LONG = 60.0
DISPATCHER = "/rosplan_plan_dispatcher"


class Probe(action_interface.ActionInterface):
    """Runs until it is cancelled; the first execution fails at that."""

    concurrent = True

    def __init__(self) -> None:
        super().__init__("navigate")
        self.running: threading.Semaphore = threading.Semaphore(0)
        self.suspended: List[bool] = []

    def run(self, execution: Execution) -> Ending:
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


class World:
    """An interface and its dispatcher."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.topics = Topics(monkeypatch)
        self.interface = Probe()
        self.interface.start()
        assert self.topics.published("/kb/pddl_action_parameters").get(timeout=LONG)

    def dispatch(self, number: int) -> None:
        """Returns when the action runs."""
        parameters = [KeyValue("to", "hall")]
        action = ActionDispatch(name="navigate", plan_id=7, action_id=number, parameters=parameters)
        self.topics.send(f"{DISPATCHER}/action_dispatch", action, DISPATCHER)
        assert self.interface.running.acquire(timeout=LONG)

    def lease(self, suspended: List[str]) -> None:
        lease = Lease(owner=DISPATCHER, life="a", held=["7/2"], suspended=suspended)
        self.topics.send(f"{DISPATCHER}/lease", lease, DISPATCHER)

    def failures(self, count: int) -> List[int]:
        """The actions that fail next."""
        feedback = self.topics.published(f"{DISPATCHER}/action_feedback")
        failed: List[int] = []
        while len(failed) < count:
            answer: ActionFeedback = feedback.get(timeout=LONG)
            failed += [answer.action_id] if answer.status == ActionFeedback.ACTION_FAILED else []
        return failed


@pytest.fixture
def world(monkeypatch: pytest.MonkeyPatch, clock: Any) -> Iterator[World]:
    formula = DomainFormula(name="navigate", typed_parameters=[KeyValue("to", "poi")])
    knowledge = SimpleNamespace(name="/kb", operator=lambda name: SimpleNamespace(formula=formula))
    effects = SimpleNamespace(open=lambda opening: None, close=lambda *_: None)
    for name, made in (
        ("LATCH_GRACE", 0.0),
        ("knowledge_client", lambda name: knowledge),
        ("effects_of", lambda details, knowledge: effects),
        ("settle_left", lambda knowledge, operator: []),
        ("connected_peers", lambda subscriber: {DISPATCHER}),
        ("get_param", lambda name, default: default),
        ("master_is_lost", lambda: False),
    ):
        monkeypatch.setattr(action_interface, name, made)
    for level in ("loginfo", "logwarn", "logerr"):
        monkeypatch.setattr(rospy, level, lambda *_: None)
    made = World(monkeypatch)
    yield made
    made.interface.shutdown()


def test_a_cancel_that_fails_keeps_no_other_one(world: World) -> None:
    for number in (1, 2, 3):
        world.dispatch(number)
    world.interface.master_lost()
    assert sorted(world.failures(3)) == [1, 2, 3]


def test_an_action_whose_lease_came_before_it_and_is_suspended_does_not_move(world: World) -> None:
    world.lease(suspended=["7/2"])  # the owner of the dispatcher hangs
    world.dispatch(2)
    assert world.interface.suspended == [True]
    (execution,) = world.interface.executions()
    back = threading.Event()
    notice = lambda: None if ownership.suspended(execution.token) else back.set()  # noqa: E731
    ownership.listen(notice)
    world.lease(suspended=[])
    assert back.wait(LONG)
    ownership.ignore(notice)


def test_an_action_for_which_there_is_no_thread_is_answered_and_keeps_no_next_one(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_thread(thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    with monkeypatch.context() as short_of_threads:
        short_of_threads.setattr(threading.Thread, "start", no_thread)
        world.topics.send(
            f"{DISPATCHER}/action_dispatch",
            ActionDispatch(name="navigate", plan_id=7, action_id=4, parameters=[KeyValue("to", "hall")]),
            DISPATCHER,
        )
    assert world.failures(1) == [4]
    world.dispatch(2)
