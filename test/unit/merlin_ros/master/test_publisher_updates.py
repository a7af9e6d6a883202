# SPDX-License-Identifier: Apache-2.0
"""A publisher that comes while this node subscribes is connected to, whichever list is looked at first."""

import threading
from typing import Any, Iterator, List, Tuple

import pytest
from rospy.impl import registration
from rospy.impl.registration import RegManager

from merlin_ros.master import publisher_updates
from merlin_test import LONG

TOPIC, FIRST, SECOND = "/status", "http://ann:1", "http://bob:2"


class Handler:
    """Takes the place of a node: notes what it is to connect to."""

    def __init__(self) -> None:
        self.done = False
        self.changed = threading.Condition()
        self.connected: List[Tuple[str, str]] = []

    def _connect_topic(self, topic: str, uri: str) -> Tuple[int, str, int]:
        with self.changed:
            self.connected.append((topic, uri))
            self.changed.notify_all()
        return 1, "", 0

    def wait_for(self, count: int) -> List[Tuple[str, str]]:
        with self.changed:
            assert self.changed.wait_for(lambda: len(self.connected) >= count, LONG), self.connected
        return sorted(self.connected)


class Topics:
    def check_all(self) -> None:
        pass


@pytest.fixture
def handler(monkeypatch: pytest.MonkeyPatch) -> Iterator[Handler]:
    monkeypatch.setattr(registration, "get_topic_manager", Topics)
    monkeypatch.setattr(RegManager, "publisher_update", RegManager.publisher_update)  # is put back
    publisher_updates.keep_all()
    publisher_updates.keep_all()
    made = Handler()
    yield made
    made.done = True


def run(handler: Handler, *updates: Tuple[str, List[str]]) -> threading.Thread:
    """Looks at what waits, as rospy's thread does."""
    manager: Any = RegManager(handler)
    for topic, publishers in updates:
        manager.publisher_update(topic, publishers)
    thread = threading.Thread(target=manager.run, daemon=True)
    thread.start()
    return thread


def test_an_older_list_that_comes_later_hides_no_publisher(handler: Handler) -> None:
    run(handler, (TOPIC, [FIRST]), (TOPIC, []))
    assert handler.wait_for(1) == [(TOPIC, FIRST)]


def test_each_publisher_of_each_topic_is_connected_to_once(handler: Handler) -> None:
    thread = run(handler, (TOPIC, [FIRST]), ("/other", [SECOND]), (TOPIC, [FIRST, SECOND]), (TOPIC, []))
    expected = [("/other", SECOND), (TOPIC, FIRST), (TOPIC, SECOND)]
    assert handler.wait_for(3) == expected
    handler.done = True
    thread.join(LONG)
    assert sorted(handler.connected) == expected
