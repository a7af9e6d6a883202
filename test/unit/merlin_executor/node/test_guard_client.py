# SPDX-License-Identifier: Apache-2.0
"""A brake is published to the guards at once, also while the guard of a further robot is being met."""

import threading
from typing import Any, Iterator, List

import pytest
import rospy
from fakes.topics import Topics
from merlin_msgs.msg import RobotHost
from std_srvs.srv import TriggerResponse

from merlin_executor.core.standstill import Halt
from merlin_executor.node import guard_client
from merlin_executor.node.guard_client import GuardClient
from merlin_test import LONG

braked: List[str] = []
ended: List[str] = []
registers = threading.Event()
master_answers = threading.Event()


OWN = "/merlin/brake"


@pytest.fixture
def topics(monkeypatch: pytest.MonkeyPatch) -> Topics:
    """Those of the guards; a topic of a further robot is registered when the master answers."""
    topics = Topics(monkeypatch)
    publisher = rospy.Publisher
    topics.before = lambda topic, message: braked.append(topic)

    def register(name: str, *args: Any, **options: Any) -> Any:
        if rospy.resolve_name(name) != OWN:
            registers.set()
            assert master_answers.wait(LONG)
        made = publisher(name, *args, **options)
        made.unregister = lambda: ended.append(name)
        return made

    monkeypatch.setattr(rospy, "Publisher", register)
    return topics


@pytest.fixture
def client(topics: Topics) -> Iterator[GuardClient]:
    for event in (registers, master_answers):
        event.clear()
    braked.clear()
    ended.clear()
    yield GuardClient("/kb")
    master_answers.set()


def in_thread(call: Any, *args: Any) -> threading.Thread:
    thread = threading.Thread(target=call, args=args, daemon=True)
    thread.start()
    return thread


def test_a_brake_does_not_wait_for_the_master(client: GuardClient, topics: Topics) -> None:
    meeting = in_thread(announce, topics, "/r1/host", "/r1/host")
    assert registers.wait(LONG)
    braking = in_thread(client.brake, "cancelled")
    braking.join(LONG)
    assert not braking.is_alive() and braked == [OWN]
    master_answers.set()
    meeting.join(LONG)
    client.brake("cancelled")
    assert braked == [OWN, OWN, "/r1/merlin/brake"]


def announce(topics: Topics, node: str, sender: str) -> None:
    topics.send("/kb/robots", RobotHost(robot="r", node=node), {"callerid": sender})


def test_a_node_that_names_robots_without_end_gets_no_guards_without_end(
    client: GuardClient, topics: Topics, monkeypatch: pytest.MonkeyPatch
) -> None:
    master_answers.set()
    warnings: List[str] = []
    monkeypatch.setattr(guard_client.rospy, "logwarn", warnings.append)
    for number in range(1000):
        announce(topics, f"/ghost{number}/host", "/flood")
    announce(topics, "/r1/host", "/r1/host")
    client.brake("cancelled")
    assert len(braked) < 100 and braked[0] == OWN and braked[-1] == "/r1/merlin/brake"
    assert len(warnings) == 1 and "/flood" in warnings[0]


def test_the_guard_of_a_robot_that_is_gone_makes_room(
    client: GuardClient, topics: Topics, monkeypatch: pytest.MonkeyPatch
) -> None:
    master_answers.set()
    monkeypatch.setattr(guard_client.time, "monotonic", lambda: now)
    now = 0.0
    for number in range(60):
        now += 60.0
        announce(topics, f"/guest{number}/host", "/relay")
    client.brake("cancelled")
    assert len(braked) < 60 and braked[-1] == "/guest59/merlin/brake"
    assert "/guest0/merlin/brake" in ended and "/guest0/merlin/brake" not in braked


@pytest.mark.parametrize("node", ["", "host", "/two words/host", "//host"])
def test_a_node_of_an_impossible_name_has_no_guard(client: GuardClient, topics: Topics, node: str) -> None:
    master_answers.set()
    announce(topics, node, "/flood")
    client.brake("cancelled")
    assert braked == [OWN]


@pytest.mark.parametrize("short", [False, True])  # of threads
def test_a_guard_that_hangs_keeps_no_other_base_moving(
    topics: Topics, monkeypatch: pytest.MonkeyPatch, short: bool
) -> None:
    """The guard of this robot answers when that of the other one was asked."""
    other = threading.Event()

    class Service:
        def __init__(self, name: str, *_: Any, **__: Any) -> None:
            self.own = name == "merlin/halt"

        def available(self) -> bool:
            return True

        def __call__(self) -> TriggerResponse:
            if not self.own:
                other.set()
                return TriggerResponse(True, "stands")
            return TriggerResponse(other.wait(LONG), "stands")

    def no_thread(*_: Any) -> threading.Thread:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(guard_client, "ServiceProxy", Service)
    if short:
        monkeypatch.setattr(guard_client, "start_thread", no_thread)
    master_answers.set()
    client = GuardClient("/kb")
    announce(topics, "/r1/host", "/r1/host")
    assert client.halt() == Halt(True, True, "stands")
