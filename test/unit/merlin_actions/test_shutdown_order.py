# SPDX-License-Identifier: Apache-2.0
"""The end of a node that runs several actions: none waits for another one to stop, and each is answered."""

import queue
import threading
from types import SimpleNamespace
from typing import Any, Callable, Dict, List, Tuple

import pytest
import rospy
from actionlib_msgs.msg import GoalID, GoalStatus
from diagnostic_msgs.msg import KeyValue
from fakes.dispatched import Dispatcher
from fakes.topics import Topics
from merlin_msgs.msg import RunActionActionGoal, RunActionGoal
from rosplan_dispatch_msgs.msg import ActionFeedback

from merlin_actions import merlin_action_server, shutdown_order
from merlin_actions.action_interface import ActionInterface
from merlin_actions.core.ending import Ending
from merlin_actions.core.execution import Execution
from merlin_actions.merlin_action_server import MerlinActionServer
from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_actions.nodes import bridges, fsm_host
from merlin_actions.shutdown_order import shut_down
from merlin_sm.states.merlin_state import SUCCEEDED, MerlinState
from merlin_test import LONG

#: Each machine ends when both of them were told to stop.
both_stop = threading.Barrier(2)


class Hold(MerlinState):
    """Runs until it and another one are preempted."""

    def __init__(self) -> None:
        super().__init__()
        self.begun, self.preempted = threading.Event(), threading.Event()

    def run(self, userdata: Any) -> str:
        self.interruptible(self.preempted.set)
        self.begun.set()
        assert self.preempted.wait(LONG)
        self.interruptible(None)
        both_stop.wait(LONG)
        return SUCCEEDED


class Drive(MerlinActionSM):
    parameters = ["to"]

    def build(self) -> None:
        self.holds = Hold()
        self.add("HOLD", self.holds)


class Wave(Drive):
    pass


@pytest.fixture
def ends(monkeypatch: pytest.MonkeyPatch, clock: Any) -> List[Callable[[], None]]:
    """What a node does when it ends, in order; without ROS."""
    found: List[Callable[[], None]] = []
    monkeypatch.setattr(shutdown_order, "SHUTDOWN_WAIT", 2.0 * LONG)
    shown = SimpleNamespace(stop=lambda: None)
    monkeypatch.setattr(merlin_action_server, "start_introspection", lambda name, machine: shown)
    monkeypatch.setattr(rospy, "on_shutdown", found.append)
    monkeypatch.setattr(rospy, "Service", lambda *_: None)
    for name in ("set_param", "loginfo", "logwarn", "logerr"):
        monkeypatch.setattr(rospy, name, lambda *_: None)
    return found


def send(topics: Topics, action: str, goal: str) -> None:
    message = RunActionActionGoal(goal_id=GoalID(id=goal, stamp=rospy.Time(1)))
    message.goal = RunActionGoal(parameters=[KeyValue("to", "hall")])
    topics.send(f"/actions/{action}/goal", message)


def answer(topics: Topics, action: str) -> Tuple[str, int, str]:
    """Goal, status and outcome of the next result."""
    result = topics.published(f"/actions/{action}/result").get(timeout=LONG)
    return result.status.goal_id.id, result.status.status, result.result.outcome


def test_all_machines_of_a_host_are_told_to_stop_before_one_is_waited_for(
    monkeypatch: pytest.MonkeyPatch, ends: List[Callable[[], None]]
) -> None:
    topics = Topics(monkeypatch)
    machines = [Drive(), Wave()]
    monkeypatch.setattr(fsm_host.rospy, "get_param", lambda name, default: default)
    monkeypatch.setattr(fsm_host, "number", lambda name, default, least: default)
    monkeypatch.setattr(fsm_host, "read_machines", lambda: machines)
    monkeypatch.setattr(fsm_host, "wait_for_knowledge_base", lambda name, timeout: None)
    monkeypatch.setattr(fsm_host, "read_world", lambda name: None)
    monkeypatch.setattr(fsm_host, "fitted", lambda machine, world: machine)
    monkeypatch.setattr(fsm_host, "check_machines", lambda *_: {})
    monkeypatch.setattr(fsm_host, "node_holds", SimpleNamespace(offer=lambda: None))
    fsm_host.MachineHost().start()
    for machine in machines:
        send(topics, machine.operator_name(), "a")
        assert machine.holds.begun.wait(LONG)
    for end in ends:
        end()
    assert [answer(topics, name)[:2] for name in ("drive", "wave")] == [("a", GoalStatus.SUCCEEDED)] * 2


def test_a_goal_that_comes_while_its_host_ends_does_not_begin_and_is_answered_behind_the_others(
    monkeypatch: pytest.MonkeyPatch, ends: List[Callable[[], None]]
) -> None:
    topics = Topics(monkeypatch)
    machine = Drive()
    server = MerlinActionServer(machine)
    server.start()
    send(topics, "drive", "a")
    assert machine.holds.begun.wait(LONG)
    server.stop()
    send(topics, "drive", "b")
    assert not server.wait_stopped(0.0)
    both_stop.wait(LONG)
    assert server.wait_stopped(LONG)
    server.close()
    assert answer(topics, "drive") == ("a", GoalStatus.SUCCEEDED, SUCCEEDED)
    assert answer(topics, "drive")[:2] == ("b", GoalStatus.ABORTED)


def test_a_host_ends_behind_the_answer_of_what_ran(
    monkeypatch: pytest.MonkeyPatch, ends: List[Callable[[], None]]
) -> None:
    topics = Topics(monkeypatch)
    machine = Drive()
    server = MerlinActionServer(machine)
    server.start()
    send(topics, "drive", "a")
    assert machine.holds.begun.wait(LONG)
    server.stop()
    answer_of = merlin_action_server.answer_of

    def late(*args: Any) -> Any:
        stopped.append(server.wait_stopped(0.0))  # the machine has ended, and its goal has no answer
        return answer_of(*args)

    stopped: List[bool] = []
    monkeypatch.setattr(merlin_action_server, "answer_of", late)
    both_stop.wait(LONG)
    assert server.wait_stopped(LONG)
    server.close()
    assert answer(topics, "drive") == ("a", GoalStatus.SUCCEEDED, SUCCEEDED)
    assert stopped == [False]


class Probe(ActionInterface):
    """Ends an execution when its node does, and as many others have to stop."""

    def __init__(self, operator: str = "navigate", **_: Any) -> None:
        super().__init__(operator)
        self.running: queue.Queue[int] = queue.Queue()
        self.health = lambda: None

    def run(self, execution: Execution) -> Ending:
        over = threading.Event()
        execution.interruptible(over.set)
        self.running.put(execution.key[1])
        assert over.wait(LONG)
        both_stop.wait(LONG)
        return Ending(True)


def test_all_bridges_of_a_node_are_told_to_stop_before_one_is_waited_for(
    monkeypatch: pytest.MonkeyPatch, ends: List[Callable[[], None]]
) -> None:
    dispatcher = Dispatcher(monkeypatch)
    made: Dict[str, Any] = {
        "run_node": lambda name, start, *_, **__: start(),
        "graph_name": lambda name, default: default,
        "number": lambda name, default, least: default,
        "flag": lambda name: False,
        "wait_for_knowledge_base": lambda name, seconds: None,
        "make_bridges": lambda *_: probes,
        "HealthReporter": lambda checks: SimpleNamespace(start=lambda: None),
    }
    for name, value in made.items():
        monkeypatch.setattr(bridges, name, value)
    monkeypatch.setattr(rospy, "get_param", lambda name, default: default)
    probes = [Probe(), Probe()]  # each of them takes the action
    bridges.main()
    for _ in probes:
        dispatcher.wait_announced()
    dispatcher.dispatch(1)
    for probe in probes:
        assert probe.running.get(timeout=LONG) == 1
    for end in ends:
        end()
    answers = [dispatcher.end().status for _ in probes]
    assert answers == [ActionFeedback.ACTION_SUCCEEDED_TO_GOAL_STATE] * 2


def test_an_interface_ends_behind_its_last_answer_and_takes_no_action_meanwhile(
    monkeypatch: pytest.MonkeyPatch, ends: List[Callable[[], None]]
) -> None:
    dispatcher = Dispatcher(monkeypatch)
    probe = Probe()
    probe.start()
    dispatcher.wait_announced()
    dispatcher.dispatch(1)
    assert probe.running.get(timeout=LONG) == 1
    probe.stop()
    dispatcher.dispatch(2)

    def before(topic: str, message: Any) -> None:
        stopped.append(probe.wait_stopped(0.0))

    stopped: List[bool] = []
    dispatcher.topics.before = before
    both_stop.wait(LONG)
    assert probe.wait_stopped(LONG)
    probe.close()
    assert dispatcher.end().action_id == 1
    assert stopped == [False]
    assert (7, 2) not in dispatcher.begun() and probe.running.empty()


def test_what_one_of_them_raises_does_not_concern_the_others(ends: List[Callable[[], None]]) -> None:
    told: List[str] = []

    def fails() -> None:
        raise OSError("the arm does not answer")

    def part(name: str, stop: Callable[[], None]) -> Any:
        return SimpleNamespace(
            stop=stop, wait_stopped=lambda seconds: True, close=lambda: told.append(f"{name} closed")
        )

    shut_down([part("arm", fails), part("base", lambda: told.append("base stopped"))])
    assert told == ["base stopped", "arm closed", "base closed"]
