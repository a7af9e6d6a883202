# SPDX-License-Identifier: Apache-2.0
"""Whether an action server counts as alive in the moments after its process has died, and come back."""

import socket
from types import SimpleNamespace
from typing import Any, Iterator, List, Optional

import pytest
from actionlib_msgs.msg import GoalStatusArray
from merlin_msgs.msg import ListenAction

from merlin_ros.actions import action_client
from merlin_ros.actions.action_client import GREETED, ActionClient
from merlin_ros.alarms import TickClock

SERVER = "/speech"


class Link:
    """A connection of rospy's to the server; of a publisher with a real socket."""

    def __init__(self) -> None:
        self.ours, self.theirs = socket.socketpair()
        self.socket: Optional[socket.socket] = self.ours
        self.endpoint_id = self.callerid_pub = SERVER
        self.header = {"callerid": SERVER}

    def die(self, noticed: bool = True) -> None:
        """The server's process ends.

        :param noticed: whether a subscriber's thread of rospy has noticed it.
        """
        self.theirs.close()
        if noticed:
            self.socket = None


class Topic:
    """A publisher or subscriber, with what rospy knows of its connections."""

    def __init__(self, name: str, receive: Any = None) -> None:
        self.name = name
        self.receive = receive
        self.links: List[Link] = []

    @property
    def impl(self) -> Any:
        there = lambda node: any(link.endpoint_id == node for link in self.links)  # noqa: E731
        return SimpleNamespace(connections=self.links, has_connection=there)

    def get_num_connections(self) -> int:
        return len(self.links)


class Topics(List[Topic]):
    """Those of the client; `now` is its running time, s."""

    now = 100.0


@pytest.fixture
def topics(clock: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[Topics]:
    made = Topics()

    def topic(name: str, _: type, receive: Any = None, **__: Any) -> Topic:
        made.append(Topic(name, receive))
        return made[-1]

    monkeypatch.setattr(action_client.rospy, "Publisher", topic)
    monkeypatch.setattr(action_client.rospy, "Subscriber", topic)
    monkeypatch.setattr(action_client, "LeaseHolder", lambda _: None)
    monkeypatch.setattr(action_client, "running_time", lambda: made.now)
    yield made
    for each in made:
        for link in each.links:
            link.ours.close()
            link.theirs.close()


@pytest.fixture
def client(topics: Topics) -> ActionClient:
    return ActionClient("listen", ListenAction)


def of(topics: Topics, name: str) -> Topic:
    return next(topic for topic in topics if topic.name.endswith(name))


def connect(topics: Topics, *names: str) -> None:
    for name in names or ("goal", "cancel", "result", "feedback", "status"):
        of(topics, name).links.append(Link())


def say_once(topics: Topics) -> None:
    message = GoalStatusArray()
    message._connection_header = of(topics, "status").links[-1].header
    of(topics, "status").receive(message)


def say(topics: Topics) -> None:
    """The server publishes its status, and again after a period."""
    say_once(topics)
    topics.now += 0.2
    say_once(topics)


def die(topics: Topics, noticed: bool = True) -> None:
    for topic in topics:
        for link in topic.links:
            link.die(noticed)


@pytest.mark.parametrize("noticed", [True, False])
def test_a_server_whose_process_has_ended_is_not_alive(
    client: ActionClient, topics: Topics, noticed: bool
) -> None:
    connect(topics)
    assert client.missing == "its status was never heard"
    say(topics)
    assert client.alive
    die(topics, noticed)
    assert client.missing == "its process is gone"
    say(topics)  # what the status of a process says that has ended comes later
    assert client.missing == "its process is gone"


def test_its_successor_is_alive_when_it_is_connected_and_has_spoken(
    client: ActionClient, topics: Topics
) -> None:
    connect(topics)
    say(topics)
    die(topics)
    connect(topics, "status", "result", "feedback")
    assert client.missing == "its process is gone", "it has not spoken yet"
    say(topics)
    assert client.missing == "it speaks, but has no connection for goals"
    connect(topics, "goal")
    assert client.missing == "it speaks, but has no connection for cancels"
    connect(topics, "cancel")
    assert client.alive


def test_statuses_of_one_moment_do_not_show_that_results_come(client: ActionClient, topics: Topics) -> None:
    """rospy greets a subscriber some ms before it sends to it; a server sends a status at each change."""
    connect(topics)
    for _ in range(3):
        say_once(topics)
        assert client.missing == "it speaks, but has no connection for results"
    topics.now += 0.2
    say_once(topics)
    assert client.alive


class Looks:
    """The clock of this process as its looks see it, set by a test."""

    def __init__(self) -> None:
        self.time = 0.0

    def __call__(self, *_: Any, longest: float) -> TickClock:
        return TickClock(lambda: self.time, longest)


def test_while_the_clock_of_ros_stands_the_link_for_results_counts_after_a_while(
    topics: Topics, monkeypatch: pytest.MonkeyPatch
) -> None:
    """actionlib's server publishes its status by ROS time: only the latched one comes, here as the first."""
    looks = Looks()
    monkeypatch.setattr(action_client, "TickClock", looks)
    client = ActionClient("listen", ListenAction)

    def ready_after(seconds: float) -> bool:
        looks.time += seconds
        return client.alive

    connect(topics, "goal", "cancel", "feedback", "status")
    say_once(topics)
    connect(topics, "result")
    assert client.missing == "it speaks, but has no connection for results"
    assert not ready_after(60.0), "a stall of this process proves nothing"
    assert ready_after(GREETED)
    of(topics, "result").links.pop().die()
    assert not ready_after(60.0)
    connect(topics, "result")
    assert not ready_after(0.0), "that of the next process"
    assert not ready_after(0.1)
    assert any(ready_after(0.1) for _ in range(10))


def test_a_server_that_only_hangs_is_connected(client: ActionClient, topics: Topics) -> None:
    connect(topics)
    say(topics)
    assert client.alive
