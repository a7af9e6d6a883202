# SPDX-License-Identifier: Apache-2.0
"""The monitor follows a knowledge base without missing a change, and goes on looking after a failure."""

import queue
import threading
from types import SimpleNamespace
from typing import Any, Callable, Dict, List, Tuple

import pytest
import rospy
from merlin_msgs.msg import KnowledgeChanges

from merlin_monitor import panel_board
from merlin_monitor.listeners import ros_system
from merlin_monitor.listeners.panel import Panel
from merlin_monitor.listeners.ros_system import RosSystem
from merlin_monitor.panel_board import PanelBoard
from merlin_monitor.panels import knowledge as knowledge_panel
from merlin_monitor.panels.knowledge import KnowledgePanel
from merlin_monitor.state.inbox import Inbox
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_test import LONG

NAME = "/knowledge"


class System(RosSystem):
    """What the panel asks, without a master."""

    def parameter(self, name: str, default: Any) -> Any:
        return default

    def address_of(self, service: str) -> str:
        return "rosrpc://here:1"


class Client:
    """A knowledge base that is empty and is read as slowly as the test wants."""

    def __init__(self) -> None:
        self.name = NAME
        self.begun: queue.Queue[None] = queue.Queue()
        self.go_on = threading.Semaphore(0)

    def types(self) -> List[str]:
        self.begun.put(None)
        assert self.go_on.acquire(timeout=LONG)
        return []

    def objects(self) -> Dict[str, str]:
        return dict.fromkeys(self.types(), "")

    def propositions(self) -> List[str]:
        return []

    functions = goals = propositions

    def predicates(self) -> Dict[str, Any]:
        return {}

    operators = function_signatures = predicates

    def read(self) -> None:
        """Waits for a reading and lets it end: the domain's types are read once more."""
        self.begun.get(timeout=LONG)
        self.go_on.release(2)
        self.begun.get(timeout=LONG)


class Followed:
    """A listener, whose topics and inbox the test holds."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.client = Client()
        self.reported: queue.Queue[Tuple[str, Any]] = queue.Queue()
        callbacks: Dict[str, Callable[[Any], None]] = {}
        monkeypatch.setattr(knowledge_panel, "KnowledgeClient", lambda name: self.client)
        monkeypatch.setattr(
            knowledge_panel,
            "ServiceProxy",
            lambda *args, **options: lambda: SimpleNamespace(domain_name="home"),
        )
        monkeypatch.setattr(
            rospy, "Subscriber", lambda topic, kind, receive, **options: callbacks.update({topic: receive})
        )
        monkeypatch.setattr(rospy, "get_time", lambda: 1.0)
        names = ("source", "replace", "changed")
        section = SimpleNamespace(**{name: name for name in names})
        inbox = SimpleNamespace(put=lambda what, *arguments: self.reported.put((what, arguments[0])))
        monkeypatch.setattr(rospy, "get_param", lambda name, default: default)
        state = SimpleNamespace(knowledge=section, inbox=inbox, domain="domain")
        self.listener = KnowledgePanel(state, System())  # type: ignore
        self.changed = callbacks[f"{NAME}/changes"]
        self.listener.look({f"{NAME}/changes": "merlin_msgs/KnowledgeChanges"})

    def next(self) -> Tuple[str, Any]:
        return self.reported.get(timeout=LONG)

    def change(self, version: int) -> KnowledgeChanges:
        message = KnowledgeChanges(version=version)
        message.header.stamp = rospy.Time(1)
        self.changed(message)
        return message


@pytest.fixture
def followed(monkeypatch: pytest.MonkeyPatch) -> Any:
    return Followed(monkeypatch)


def test_what_changes_while_all_is_read_is_reported_behind_it(followed: Followed) -> None:
    assert followed.next()[0] == "source"
    followed.client.begun.get(timeout=LONG)
    held = [followed.change(7), followed.change(8)]
    followed.client.go_on.release(2)
    followed.client.begun.get(timeout=LONG)
    assert [followed.next()[0] for _ in range(2)] == ["domain", "replace"]
    assert [followed.next() for _ in range(2)] == [("changed", message) for message in held]
    after = followed.change(9)
    assert followed.next() == ("changed", after)


def test_a_change_that_was_missed_makes_it_read_everything_again(followed: Followed) -> None:
    assert followed.next()[0] == "source"
    followed.client.read()
    assert [followed.next()[0] for _ in range(2)] == ["domain", "replace"]
    first = followed.change(3)
    assert followed.next() == ("changed", first)
    followed.change(5)
    followed.client.read()
    assert [followed.next()[0] for _ in range(2)] == ["domain", "replace"]


def test_it_reads_again_after_an_answer_that_it_cannot_read(
    followed: Followed, monkeypatch: pytest.MonkeyPatch
) -> None:
    complaints: queue.Queue[str] = queue.Queue()
    monkeypatch.setattr(rospy, "logwarn_throttle", lambda period, text: complaints.put(text))
    monkeypatch.setattr(knowledge_panel, "READ_AGAIN", 0.01)
    assert followed.next()[0] == "source"
    answer, followed.client.propositions = followed.client.propositions, lambda: [][0]
    followed.client.begun.get(timeout=LONG)
    followed.client.go_on.release()
    assert complaints.get(timeout=LONG).endswith("cannot be read: IndexError: list index out of range")
    followed.client.propositions = answer
    followed.client.go_on.release(2)
    assert [followed.next()[0] for _ in range(2)] == ["domain", "replace"]


def test_the_watch_goes_on_after_a_look_that_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    master = SimpleNamespace(
        getSystemState=lambda: ([("/tick", ["/node", rospy.get_name()]), ("/mute", [])], [], []),
        getTopicTypes=lambda: [["/tick", "std_msgs/Empty"], ["/mute", "std_msgs/Empty"]],
    )
    monkeypatch.setattr(ros_system, "bounded_master", lambda: master)
    monkeypatch.setattr(panel_board, "LOOK", 0.01)
    complaints: List[str] = []
    monkeypatch.setattr(rospy, "logerr", complaints.append)
    seen: List[Dict[str, str]] = []
    again = threading.Event()

    class Looks(Panel):
        name = "plan"

        def look(self, topics: Dict[str, str]) -> None:
            seen.append(topics)
            if len(seen) == 1:
                raise OSError("the master has gone")
            again.set()

    watch = PanelBoard(MonitorModel(Inbox()), ros=System(), only=[Looks])
    watch.start(beats=False)
    try:
        assert again.wait(LONG)
    finally:
        watch.stop()
    assert seen[0] == seen[1] == {"/tick": "std_msgs/Empty"}
    assert complaints == ["panel plan: OSError: the master has gone"]
