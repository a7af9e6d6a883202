# SPDX-License-Identifier: Apache-2.0
"""What a holder of leases publishes: one message for each change, and one for each period."""

import threading
from types import MethodType, SimpleNamespace
from typing import Any, Callable, Iterator, List

import pytest
from merlin_msgs.msg import Lease

from merlin_ros.actions import lease_holder
from merlin_ros.actions.lease_holder import LIFE, LeaseHolder
from merlin_ros.alarms import Alarm
from merlin_ros.publishing import OnSubscriber
from merlin_test import LONG


@pytest.fixture
def published(monkeypatch: pytest.MonkeyPatch) -> List[List[str]]:
    messages: List[List[str]] = []
    monkeypatch.setattr(lease_holder, "publish", lambda publisher, message: messages.append(message.held))
    monkeypatch.setattr(lease_holder, "PERIOD", 100.0)
    for name, value in (
        ("Publisher", lambda *args, **options: type("Topic", (), {"unregister": lambda self: None})()),
        ("get_name", lambda: "/client"),
        ("is_shutdown", lambda: False),
    ):
        monkeypatch.setattr(lease_holder.rospy, name, value)
    monkeypatch.setattr(lease_holder.rospy.Time, "now", staticmethod(lambda: lease_holder.rospy.Time(1)))
    return messages


@pytest.fixture
def holder(published: List[List[str]]) -> Iterator[LeaseHolder]:
    made = LeaseHolder("/dispatcher/lease")
    yield made
    made.shutdown()


def test_goals_are_exchanged_in_one_message(holder: LeaseHolder, published: List[List[str]]) -> None:
    holder.hold("7/1")
    holder.exchange(["7/2", "7/3"], ["7/1"])
    assert published == [["7/1"], ["7/2", "7/3"]]


def test_a_server_that_connects_hears_at_once_what_is_held_and_of_which_life(
    published: List[List[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    listeners: List[OnSubscriber] = []

    def topic(*_: Any, subscriber_listener: OnSubscriber, **__: Any) -> Any:
        listeners.append(subscriber_listener)
        return SimpleNamespace(unregister=lambda: None)

    monkeypatch.setattr(lease_holder.rospy, "Publisher", topic)
    holder = LeaseHolder("/dispatcher/lease")
    heard: List[Lease] = []
    server = SimpleNamespace(acquire=lambda: None, release=lambda: None)
    everyone = MethodType(lambda self, message: None, server)
    for goals in ([], ["7/1"]):
        for goal in goals:
            holder.hold(goal)
        listeners[0].peer_subscribe("/dispatcher/lease", everyone, heard.append)
        assert (heard[-1].owner, heard[-1].life, heard[-1].held) == ("/client", LIFE, goals)
    holder.shutdown()
    listeners[0].peer_subscribe("/dispatcher/lease", everyone, heard.append)
    assert len(heard) == 2


def test_releasing_what_is_not_held_says_nothing(holder: LeaseHolder, published: List[List[str]]) -> None:
    holder.hold("7/1")
    holder.release("7/2")
    assert published == [["7/1"]]


def test_what_is_held_is_renewed_and_nothing_is_said_when_nothing_is(
    published: List[List[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    renewals: List[Alarm] = []

    def every(period: float, call: Callable[[], None]) -> Alarm:
        renewals.append(Alarm(call, period))
        return renewals[-1]

    monkeypatch.setattr(lease_holder, "every", every)
    holder = LeaseHolder("/dispatcher/lease")
    holder.hold("7/1")
    (first,) = renewals
    first.ring()
    holder.release("7/1")
    first.ring()
    assert published == [["7/1"], ["7/1"], []] and not first.waits
    holder.hold("7/2")
    renewals[1].ring()
    assert published[3:] == [["7/2"], ["7/2"]]
    holder.shutdown()


def test_a_holder_that_ends_releases_its_own_goals_and_those_of_no_other_holder(
    holder: LeaseHolder, published: List[List[str]]
) -> None:
    other = LeaseHolder("/dispatcher/lease")
    other.exchange(["7/1", "7/2"], [])
    holder.hold("7/3")
    other.release("7/1")
    other.shutdown()
    assert published[-2:] == [["7/2", "7/3"], ["7/3"]]


def test_a_holder_that_ends_while_another_thread_releases_a_goal(
    published: List[List[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    holder = LeaseHolder("/dispatcher/lease")
    holder.exchange(["7/1", "7/2"], [])
    threads: List[threading.Thread] = []

    def publish_meanwhile(publisher: object, message: Lease) -> None:
        published.append(message.held)
        threads.append(threading.Thread(target=holder.release, args=["7/1"], name="release"))
        threads[-1].start()

    monkeypatch.setattr(lease_holder, "publish", publish_meanwhile)
    holder.shutdown()
    (thread,) = threads
    thread.join(LONG)
    assert not thread.is_alive() and published == [["7/1", "7/2"], []]
