# SPDX-License-Identifier: Apache-2.0
"""A watch of leases goes on whatever is done with a change; so does a client whatever is done with an end.

A connection counts while both sides have it open, whatever rospy still lists.
"""

import socket
from queue import Queue
from types import SimpleNamespace
from typing import Any, Iterator, List, Set, Tuple

import pytest
from actionlib_msgs.msg import GoalID, GoalStatus
from merlin_msgs.msg import Lease

from merlin_ros.actions import lease_watch
from merlin_ros.actions.client_goal import ClientGoal
from merlin_ros.actions.lease import LeaseState
from merlin_ros.actions.lease_watch import LeaseWatch
from merlin_ros.actions.peers import (
    address_over,
    connected_peers,
    link_from,
    reaches,
    sender_of,
)
from merlin_ros.alarms import Alarm
from merlin_ros.work import threads
from merlin_test import LONG

Pair = Tuple[socket.socket, socket.socket]


class Watched:
    """A watch of leases, its topic, and its looks."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.looks: List[Alarm] = []
        self.connected: List[str] = ["/a", "/b"]
        self.looked = 0
        self.receive: Any = None
        monkeypatch.setattr(lease_watch.rospy, "resolve_name", lambda name: f"/{name}")
        monkeypatch.setattr(lease_watch.rospy, "Subscriber", self._subscribe)
        monkeypatch.setattr(lease_watch, "connected_peers", self._peers)
        monkeypatch.setattr(lease_watch, "every", self._every)

    def _subscribe(self, _: str, __: type, callback: Any, **___: Any) -> Any:
        self.receive = callback
        return SimpleNamespace(unregister=lambda: None)

    def _peers(self, _: Any) -> Set[str]:
        self.looked += 1
        return set(self.connected)

    def _every(self, period: float, call: Any) -> Alarm:
        self.looks.append(Alarm(call, period))
        return self.looks[-1]


@pytest.fixture
def watched(monkeypatch: pytest.MonkeyPatch) -> Watched:
    return Watched(monkeypatch)


def test_a_change_that_cannot_be_dealt_with_hides_no_later_one(
    watched: Watched, caplog: pytest.LogCaptureFixture
) -> None:
    lost: Queue[str] = Queue()

    def change(found: Any) -> None:
        if found.state is LeaseState.LOST:
            lost.put(found.goal)
            raise ValueError("broken")

    watch = LeaseWatch("drive/lease", change)
    for owner in ("/a", "/b"):
        watched.receive(Lease(owner=owner, life="1", held=[f"goal of {owner}"]))
        watched.receive(Lease(owner=owner, life="1", held=[]))
    assert [lost.get(timeout=LONG) for _ in range(2)] == ["goal of /a", "goal of /b"]
    watch.shutdown()
    assert "'owners /drive/lease'" in caplog.text and "ValueError: broken" in caplog.text


def test_a_watch_that_is_only_asked_starts_no_thread(
    watched: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: List[str] = []
    monkeypatch.setattr(threads, "start_thread", lambda name, *_: started.append(name))
    watch = LeaseWatch("dispatch/lease")
    watched.receive(Lease(owner="/a", life="1", held=["goal"], suspended=[]))
    watched.receive(Lease(owner="/a", life="2", held=[], suspended=[]))  # another life: the goal is lost
    assert not watch.beside("goal")
    assert not started
    watch.shutdown()


def test_the_end_of_a_goal_stays_its_end_when_its_client_fails(caplog: pytest.LogCaptureFixture) -> None:
    def fail(_: ClientGoal) -> None:
        raise ValueError("broken")

    goal = ClientGoal(GoalID(id="goal 1"), lambda goal: None, fail, None)
    goal.finish(GoalStatus.LOST, "its server is gone", None)
    assert goal.done and goal.status == GoalStatus.LOST
    assert "goal 1" in caplog.text and "ValueError: broken" in caplog.text


def test_a_watch_without_a_held_goal_does_not_look(watched: Watched) -> None:
    watch = LeaseWatch("drive/lease", lambda change: None)
    for life in range(50):
        watched.receive(Lease(owner="/a", life=str(life), held=[]))
    assert not watched.looks
    watched.receive(Lease(owner="/a", life="50", held=["goal 1"]))
    (looks,) = watched.looks
    looks.ring()
    assert watched.looked == 1 and looks.waits
    watch.forget("goal 1")
    looks.ring()
    assert watched.looked == 1 and not looks.waits
    watched.receive(Lease(owner="/a", life="50", held=["goal 2"]))
    assert watched.looks[-1].waits
    watch.shutdown()


@pytest.fixture
def pair() -> Iterator[Pair]:
    ours, theirs = socket.socketpair()
    yield ours, theirs
    ours.close()
    theirs.close()


def topic(*links: Any) -> Any:
    return SimpleNamespace(impl=SimpleNamespace(connections=list(links)))


def link(ours: Any, node: str) -> Any:
    return SimpleNamespace(socket=ours, callerid_pub=node, endpoint_id=node, header={"callerid": node})


@pytest.mark.parametrize("side", ["ours", "theirs", "rospy has taken it away"])
def test_a_connection_that_either_side_has_closed_does_not_count(pair: Pair, side: str) -> None:
    ours, theirs = pair
    ann, bob = link(ours, "/ann"), link(None, "/bob")
    both = topic(ann, bob)
    assert connected_peers(both) == {"/ann"}
    assert link_from(both, "/ann") is ann and link_from(both, "/bob") is None
    assert reaches(both, "/ann") and not reaches(both, "/bob") and not reaches(both, "/eve")
    assert address_over(both, ann.header)
    if side == "ours":
        ours.close()
    elif side == "theirs":
        theirs.close()
    else:
        ann.socket = None
    assert connected_peers(both) == set() and link_from(both, "/ann") is None
    assert not reaches(both, "/ann") and not address_over(both, ann.header)


def test_a_message_of_a_connection_before_did_not_come_over_this_one(pair: Pair) -> None:
    ann = topic(link(pair[0], "/ann"))
    assert not address_over(ann, {"callerid": "/ann"})
    assert not address_over(ann, None)
    assert connected_peers(SimpleNamespace(impl=None)) == set(), "the topic was shut down"


def test_a_process_whose_connection_was_made_anew_is_still_there(pair: Pair) -> None:
    ann = link(pair[0], "http://ann:4000/")
    said, many = ann.header, topic(link(None, "http://bob:4000/"), ann)
    address = address_over(many, said)
    ann.header = dict(said)
    assert address_over(many, said) == ""
    assert reaches(many, address)
    ann.endpoint_id = "http://ann:4001/"  # that of its next life
    assert not reaches(many, address)


def test_the_sender_is_known_where_a_message_has_come_from_another_process() -> None:
    assert sender_of(SimpleNamespace(_connection_header={"callerid": "/ann"})) == "/ann"
    assert sender_of(SimpleNamespace(_connection_header=None)) == sender_of(object()) == ""
